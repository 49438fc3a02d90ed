"""How often the kind of a record is found.

Records of joints with one or two modes are made of each kind in several manners: let go,
driven by a sine that stops, pulled and released; stepped sines; chirps, noise, multisines; one hammer blow or
several. Frequency, damping, length, sample rate, noise, offset and jitter are drawn. Counted is how often the kind is
found, how often it is refused, and how often it is wrong.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd
from scipy import signal
from tests.experiments.impacts import Mode, Pulse, struck

from sinew.analysis.kinds import find_kind
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError
from sinew.measure.read import read

Columns = tuple[Array, Array | None, Array]
"""Time [s], drive or None, response."""
SPACINGS: tuple[Literal["linear", "logarithmic"], ...] = ("linear", "logarithmic")
"""Of the frequencies of a chirp."""


@dataclass(frozen=True)
class Joint:
    """A joint and its recorder: modes, samples per second, and the random numbers of one record."""

    modes: tuple[Mode, ...]
    sample_hz: float
    rng: np.random.Generator

    @property
    def rate(self) -> float:
        """Return the decay rate of the first mode [1/s]."""
        return 2 * np.pi * self.modes[0][0] * self.modes[0][1]

    def times(self, duration_s: float) -> Array:
        """Return the stamps of a record [s]."""
        return np.arange(round(duration_s * self.sample_hz)) / self.sample_hz

    def respond(self, drive: Array) -> Array:
        """Return the response to a drive, from rest."""
        response = np.zeros(drive.size)
        for hertz, damping, gain in self.modes:
            w = 2 * np.pi * hertz
            parts = [[gain * w**2]], [1, 2 * damping * w, w**2]
            top, bottom, _ = signal.cont2discrete(parts, 1 / self.sample_hz, "foh")
            response += signal.lfilter(top.ravel(), bottom, drive)
        return response


def draw_joint(rng: np.random.Generator) -> Joint:
    """Return a joint of 1.5 to 12 Hz with 1 to 10 % damping, in one record of three with a second mode."""
    hertz = float(np.exp(rng.uniform(np.log(1.5), np.log(12))))
    modes: tuple[Mode, ...] = ((hertz, float(np.exp(rng.uniform(np.log(0.01), np.log(0.1)))), 1.0),)
    if rng.uniform() < 1 / 3:
        modes += ((hertz * rng.uniform(1.8, 4.0), rng.uniform(0.01, 0.05), rng.uniform(0.1, 0.4)),)
    return Joint(modes, hertz * float(rng.choice([25, 40, 80, 160])), rng)


def let_go(joint: Joint) -> Columns:
    """Return a decay from a displacement, after a hold of drawn length or none; no drive is named."""
    hold = float(joint.rng.choice([0.0, 1.0])) * joint.rng.uniform(0.2, 2.0)
    t = joint.times(hold + joint.rng.uniform(2, 6) / joint.rate)
    held = np.where(t < hold, 1.0, 0.0) if hold else np.zeros(t.size)
    if hold:
        settled = joint.respond(np.concatenate([np.ones(20 * t.size), held]))
        return t, None, settled[-t.size :]
    return (
        t,
        None,
        sum(
            (
                g * np.exp(-2 * np.pi * f * d * t) * np.cos(2 * np.pi * f * t + joint.rng.uniform(0, 6))
                for f, d, g in joint.modes
            ),
            start=np.zeros(t.size),
        ),
    )


def pulled(joint: Joint) -> Columns:
    """Return a pull by a recorded force and its release."""
    hold = joint.rng.uniform(1, 3)
    t = joint.times(hold + joint.rng.uniform(2, 6) / joint.rate)
    force = np.where(t < hold, np.clip(t / 0.3, 0, 1), 0.0)
    return t, force, joint.respond(force)


def stopped(joint: Joint) -> Columns:
    """Return a sine near the resonance that stops, and the decay behind it."""
    drive_s = joint.rng.uniform(8, 20) / joint.modes[0][0]
    t = joint.times(drive_s + joint.rng.uniform(2, 6) / joint.rate)
    hertz = joint.modes[0][0] * joint.rng.uniform(0.9, 1.1)
    stop = round(drive_s * hertz) / hertz
    drive = np.where(t < stop, np.sin(2 * np.pi * hertz * t), 0.0)
    return t, drive, joint.respond(drive)


def stepped(joint: Joint) -> Columns:
    """Return stretches of steady sines about the resonance, up or down, the phase going on."""
    count = int(joint.rng.integers(3, 12))
    share = np.linspace(joint.rng.uniform(0.4, 0.8), joint.rng.uniform(1.2, 2.0), count)
    hertz = joint.modes[0][0] * (share if joint.rng.uniform() < 0.7 else share[::-1])
    periods = joint.rng.uniform(12, 30)
    frequency = np.concatenate([np.full(round(periods / f * joint.sample_hz), f) for f in hertz])
    drive = np.sin(2 * np.pi * np.cumsum(frequency) / joint.sample_hz)
    return np.arange(drive.size) / joint.sample_hz, drive, joint.respond(drive)


def chirped(joint: Joint) -> Columns:
    """Return a chirp through the resonance, linear or logarithmic, up or down."""
    t = joint.times(joint.rng.uniform(60, 200) / joint.modes[0][0])
    ends = joint.modes[0][0] * np.array([joint.rng.uniform(0.15, 0.6), joint.rng.uniform(1.6, 4.0)])
    first, last = ends if joint.rng.uniform() < 0.7 else ends[::-1]
    drive = signal.chirp(t, first, t[-1], last, SPACINGS[joint.rng.choice(len(SPACINGS))])
    return t, drive, joint.respond(drive)


def shaken(joint: Joint) -> Columns:
    """Return white noise, or noise below a corner above the resonance."""
    t = joint.times(joint.rng.uniform(100, 300) / joint.modes[0][0])
    drive = joint.rng.standard_normal(t.size)
    if joint.rng.uniform() < 0.6:
        corner = joint.modes[0][0] * joint.rng.uniform(2, 6) / (0.5 * joint.sample_hz)
        drive = signal.lfilter(*signal.butter(4, min(corner, 0.9)), drive)
    return t, drive, joint.respond(drive)


def many_sines(joint: Joint) -> Columns:
    """Return a multisine of random phases, four to ten periods of it."""
    period, periods = joint.rng.uniform(15, 40) / joint.modes[0][0], int(joint.rng.integers(4, 10))
    t = joint.times(period * periods)
    lines = np.arange(1, int(4 * joint.modes[0][0] * period)) / period
    lines = lines[lines > 0.3 * joint.modes[0][0]]
    drive = sum(np.cos(2 * np.pi * f * t + joint.rng.uniform(0, 2 * np.pi)) for f in lines)
    return t, np.asarray(drive), joint.respond(np.asarray(drive))


def hammered(joint: Joint, hits: int | None = None) -> Columns:
    """Return one blow or several, some of them double."""
    count = int(joint.rng.integers(1, 8)) if hits is None else hits
    wait = max(joint.rng.uniform(2, 6) / joint.rate, 4 / joint.modes[0][0])
    width = joint.rng.uniform(6, 12) / joint.sample_hz
    pulses = []
    for at in 0.5 + wait * np.arange(count):
        force = joint.rng.uniform(0.4, 1.0)
        pulses.append(Pulse(float(at), force, width))
        if hits is None and joint.rng.uniform() < 0.2:
            pulses.append(Pulse(float(at) + 2.5 * width, 0.4 * force, width))
    table = struck(joint.modes, pulses, 0.5 + wait * count, joint.rng, sample_hz=joint.sample_hz)
    return table["t"].to_numpy(), table["force"].to_numpy(), table["phi"].to_numpy()


MANNERS: dict[Callable[[Joint], Columns], str] = {
    let_go: "ring-down",
    pulled: "ring-down",
    stopped: "ring-down",
    stepped: "sweep",
    chirped: "broadband",
    shaken: "broadband",
    many_sines: "broadband",
    hammered: "impact",
}


@dataclass(frozen=True)
class Row:
    """What was found of one record; refused where the kind could not be told."""

    manner: str
    kind: str
    found: str
    reason: str


def record(manner: Callable[[Joint], Columns], seed: int) -> pd.DataFrame:
    """Return a record with noise, offsets and jitter, as a table with columns t, x and, where it was driven, u."""
    rng = np.random.default_rng([seed, list(MANNERS).index(manner)])
    joint = draw_joint(rng)
    t, drive, response = manner(joint)
    columns = {"t": t + rng.uniform(0, 0.05) * rng.standard_normal(t.size) / joint.sample_hz}
    noise = float(np.exp(rng.uniform(np.log(1e-4), np.log(0.02))))
    for name, values in (("x", response), ("u", drive)):
        if values is not None:
            size = float(np.abs(values).max())
            columns[name] = values + size * (rng.uniform(-1, 1) + noise * rng.standard_normal(t.size))
    return pd.DataFrame(columns)


def run_trial(job: tuple[int, int]) -> Row:
    """Return what was found of the record of (manner, seed)."""
    manner = list(MANNERS)[job[0]]
    table = record(manner, job[1])
    recording = read(table, time="t", response="x", drive="u" if "u" in table else None, kind="auto")
    try:
        found = find_kind(recording)
    except RecordingError as error:
        return Row(manner.__name__, MANNERS[manner], "", str(error))
    return Row(manner.__name__, MANNERS[manner], found.kind, found.reason)
