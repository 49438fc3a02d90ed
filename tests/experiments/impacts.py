"""Coverage of the intervals of modes from hammer blows.

Linear joints with one or two modes are struck once or several times by half sines of drawn strength and width; force
and response are sampled with noise of their own. The response is made at ten times the sample rate. Counted is how
often the 90 % intervals of natural frequency and damping hold the truth, with the number of modes said, and how often
that number is found where it is not said.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy import signal

from sinew.analysis.impact import analyse_impacts
from sinew.analysis.results import ImpactResult
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError
from sinew.measure.read import read

SAMPLE_HZ, FINER = 500.0, 10
HITS, MODES = (1, 3, 6), (1, 2)
Mode = tuple[float, float, float]
"""Natural frequency [Hz], damping ratio, static gain."""


class Pulse(NamedTuple):
    """One half sine of force: when it begins [s], how high it is, how long it lasts [s]."""

    at_s: float
    force: float
    width_s: float

    def over(self, time_s: Array) -> Array:
        """Return the force at times [s], (n,)."""
        share = (time_s - self.at_s) / self.width_s
        return np.where((share > 0) & (share < 1), self.force * np.sin(np.pi * np.clip(share, 0, 1)), 0.0)


def struck(
    modes: Sequence[Mode],
    pulses: Sequence[Pulse],
    duration_s: float,
    rng: np.random.Generator,
    *,
    force_noise: float = 0.0,
    response_noise: float = 0.0,
    sample_hz: float = SAMPLE_HZ,
) -> pd.DataFrame:
    """Return columns t [s], force and phi of a joint that is struck; noises: shares of the largest of each."""
    fine = np.arange(round(duration_s * sample_hz) * FINER) / (sample_hz * FINER)
    force = np.sum([pulse.over(fine) for pulse in pulses], axis=0)
    response = np.zeros(fine.size)
    for hertz, damping, gain in modes:
        w = 2 * np.pi * hertz
        top, bottom, _ = signal.cont2discrete(([[gain * w**2]], [1, 2 * damping * w, w**2]), fine[1], "foh")
        response += signal.lfilter(top.ravel(), bottom, force)
    force, response = force[::FINER], response[::FINER]
    force = force + force_noise * np.abs(force).max() * rng.standard_normal(force.size)
    response = response + response_noise * np.abs(response).max() * rng.standard_normal(response.size)
    return pd.DataFrame({"t": fine[::FINER], "force": force, "phi": response})


def draw(seed: int, hits: int, count: int) -> tuple[list[Mode], pd.DataFrame]:
    """Return the modes of a joint and the record of its being struck, all drawn."""
    rng = np.random.default_rng([seed, hits, count])
    hertz, damping = (
        math.exp(rng.uniform(math.log(2), math.log(10))),
        math.exp(rng.uniform(math.log(0.01), math.log(0.1))),
    )
    modes: list[Mode] = [(hertz, damping, 1.0)]
    if count == 2:
        ratio = rng.uniform(1.7, 2.6)
        # of a free decay the second is a third to all of the first
        modes.append(
            (hertz * ratio, damping * rng.uniform(0.6, 1.4), rng.choice([-1, 1]) * rng.uniform(0.3, 1.0) / ratio)
        )
    wait = float(np.clip(rng.uniform(3, 8) / (2 * np.pi * hertz * damping), 1.5, 15.0))
    begins = 0.3 + wait * (np.arange(hits) + rng.uniform(-0.05, 0.05, hits) * (hits > 1))
    pulses = [Pulse(at, rng.uniform(0.4, 1.0), rng.uniform(0.010, 0.025)) for at in begins]
    noises = {"force_noise": rng.uniform(0.001, 0.01), "response_noise": rng.uniform(0.003, 0.03)}
    return modes, struck(modes, pulses, 0.3 + wait * hits, rng, **noises)


class Row(NamedTuple):
    """What one record gave: how many hits and modes it has, whether each interval holds, how many modes were found."""

    hits: int
    modes: int
    covers: tuple[bool, ...]
    found: int
    refused: str = ""


def analysed(table: pd.DataFrame, modes: int | None = None) -> ImpactResult:
    """Return what a table of force and response says."""
    recording = read(table, time="t", drive="force:N", response="phi:rad", kind="impact")
    return analyse_impacts(recording, modes=modes)


def run_trial(job: tuple[int, int, int]) -> Row:
    """Return what the record of (seed, hits, modes) gave."""
    _, hits, count = job
    modes, table = draw(*job)
    try:
        fit, free = analysed(table, count).fit, analysed(table).fit
    except RecordingError as error:
        return Row(hits, count, (), 0, str(error))
    if fit is None:
        return Row(hits, count, (), 0, "no modes")
    pairs = zip(fit.modes, sorted(modes), strict=True)
    covers = tuple(
        estimate.low <= truth <= estimate.high
        for mode, true in pairs
        for estimate, truth in zip((mode.natural_frequency_hz, mode.damping_ratio), true, strict=False)
    )
    return Row(hits, count, covers, 0 if free is None else len(free.modes))


def jobs(trials: int, seed: int = 0) -> Iterator[tuple[int, int, int]]:
    """Yield (seed, hits, modes) of every record, as many of each combination."""
    yield from product(range(seed, seed + trials), HITS, MODES)


def coverage(rows: Sequence[Row]) -> tuple[float, int]:
    """Return the share of intervals that hold the truth, and how many there are."""
    covers = [one for row in rows for one in row.covers]
    return float(np.mean(covers)), len(covers)
