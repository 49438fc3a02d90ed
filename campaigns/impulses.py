"""Impulse tests with a noisy force sensor: `python -m campaigns.impulses --seeds 100`.

A joint is struck once or twice and rings; measured are the force, with noise of 0.1 to 1 % of its peak, and the angle,
with noise of 0.05 to 0.5 % of its own. Frequency, damping, length of the strokes and noise are drawn anew for every
seed. Each record goes through what `sinew identify --model auto` does, or with `--model linear` through that one fit.
Counted is how often a nonlinear law is preferred for a linear joint, where at most five in a hundred are right, how
often the intervals of frequency, damping and inertia hold the truth, apart for strokes that are long beside the period,
and how often the law of a nonlinear joint (dry friction, a hardening spring) is found.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, get_args

import numpy as np
from scipy.integrate import solve_ivp

from campaigns.options import asked_seeds, spread_of, spread_trials, trial_parser
from sinew.identify.identified import identify
from sinew.identify.oscillator.record import Record, make_record
from sinew.mechanics.laws import Cubic, DryFriction

Joint = Literal["linear", "dry friction", "hardening"]
JOINTS: tuple[Joint, ...] = get_args(Joint)

INERTIA, SWING = 12.74e-3, 0.35  # kg m²; rad
_RATE_HZ, _LASTS_S = 400.0, 4.0
_LONG = 0.15  # periods that a stroke lasts
_DRY, _HARDENING = 0.15, 0.3  # friction over the spring at the largest swing; of the spring's torque there


@dataclass(frozen=True)
class Struck:
    """What one record is made with. pulses: begin [s], length [s] and strength of every stroke."""

    joint: Joint
    frequency_hz: float
    damping_ratio: float
    pulses: tuple[tuple[float, float, float], ...]
    input_noise: float
    output_noise: float

    @property
    def omega(self) -> float:
        """Return the natural angular frequency [rad/s]."""
        return 2 * math.pi * self.frequency_hz

    def torque(self, t: float) -> float:
        """Return the torque over the inertia [rad/s²]: squared sines whose areas make the rate of the swing."""
        total = 0.0
        for begin, lasts, strength in self.pulses:
            if begin <= t <= begin + lasts:
                area = strength * SWING * self.omega
                total += area * 2 / lasts * math.sin(math.pi * (t - begin) / lasts) ** 2
        return total


def draw(joint: Joint, seed: int) -> Struck:
    """Return what a seed makes: 2.5-6 Hz, D of 0.02-0.1, strokes of 20-60 ms."""
    rng = np.random.default_rng([seed, JOINTS.index(joint), 17])
    lasts = float(rng.uniform(0.02, 0.06))
    twice = bool(rng.integers(2))
    later = (0.3 + float(rng.uniform(0.8, 1.6)), lasts, float(rng.uniform(0.4, 0.9)))
    return Struck(
        joint,
        frequency_hz=float(rng.uniform(2.5, 6.0)),
        damping_ratio=math.exp(rng.uniform(math.log(0.02), math.log(0.1))),
        pulses=((0.3, lasts, 1.0), *([later] if twice else [])),
        input_noise=math.exp(rng.uniform(math.log(1e-3), math.log(1e-2))),
        output_noise=math.exp(rng.uniform(math.log(5e-4), math.log(5e-3))),
    )


def struck_record(truth: Struck, seed: int) -> Record:
    """Return the record: angle [rad] under a torque [N m], at 400 Hz."""
    time = np.arange(0.0, _LASTS_S, 1.0 / _RATE_HZ)
    omega, swing = truth.omega, SWING
    dry = _DRY * omega**2 * swing if truth.joint == "dry friction" else 0.0
    cubic = _HARDENING / (1 - _HARDENING) * omega**2 / swing**2 if truth.joint == "hardening" else 0.0

    def rate(t: float, y: np.ndarray) -> list[float]:
        spring = omega**2 * y[0] + cubic * y[0] ** 3
        return [y[1], truth.torque(t) - 2 * truth.damping_ratio * omega * y[1] - spring - dry * math.tanh(y[1] / 1e-3)]

    edges = sorted({0.0, _LASTS_S, *(at for begin, lasts, _ in truth.pulses for at in (begin, begin + lasts))})
    angle, state = np.zeros_like(time), np.zeros(2)
    for a, b in pairwise(edges):  # no step of the integrator over the edge of a stroke
        mine = (time >= a) & (time < b)
        at = np.concatenate([time[mine], [b]])
        done = solve_ivp(rate, (a, b), state, "LSODA", at, rtol=1e-8, atol=1e-10, max_step=0.01)
        angle[mine], state = done.y[0, :-1], done.y[:, -1]
    force = INERTIA * np.array([truth.torque(float(t)) for t in time])
    rng = np.random.default_rng([seed, 18])
    force = force + truth.input_noise * np.abs(force).max() * rng.standard_normal(time.size)
    angle = angle + truth.output_noise * np.abs(angle).max() * rng.standard_normal(time.size)
    return make_record(time, angle, force, excitation="torque", output_unit="rad", input_unit="N*m")


@dataclass(frozen=True)
class Outcome:
    """What came of one record. nonlinear: whether a law that is not linear is preferred; inside: of frequency,
    damping ratio and inertia, whether the interval holds the truth; empty where the model is not the linear one."""

    truth: Struck
    seed: int
    model: str
    nonlinear: bool
    found: bool
    inside: tuple[bool, ...]


def run_trial(joint: Joint, seed: int, model: str = "auto") -> Outcome:
    """Return what comes of one record."""
    truth = draw(joint, seed)
    found = identify(struck_record(truth, seed), model)
    fit = found.fit
    assert fit is not None
    law = fit.model.law
    own: dict[Joint, type[Cubic | DryFriction]] = {"linear": Cubic, "dry friction": DryFriction, "hardening": Cubic}
    inside: tuple[bool, ...] = ()
    if fit.model.name == "linear" and joint == "linear":
        told = (fit.natural_frequency_hz, fit.damping_ratio, fit.parameters["inertia_kg_m2"])
        true = (truth.frequency_hz, truth.damping_ratio, INERTIA)
        inside = tuple(one.low <= at <= one.high for one, at in zip(told, true, strict=True))
    nonlinear = fit.model.name not in ("linear", "loss-factor")
    return Outcome(truth, seed, fit.model.name, nonlinear, law.has(own[joint]), inside)


def table(outcomes: Sequence[Outcome]) -> str:
    """Return the counts as a Markdown table."""
    lines = ["| joint | records | a nonlinear law is preferred | its own law | inside: frequency, damping, inertia |"]
    lines.append("|---|---|---|---|---|")
    for joint in JOINTS:
        mine = [one for one in outcomes if one.truth.joint == joint]
        if mine:
            own = sum(one.found for one in mine) if joint != "linear" else sum(not one.nonlinear for one in mine)
            counts = f"{len(mine)} | {sum(one.nonlinear for one in mine)} | {own}"
            lines.append(f"| {joint} | {counts} | {_held(mine)} |")
    linear = [one for one in outcomes if one.inside]
    for words, long in (("up to", False), ("more than", True)):
        part = [one for one in linear if (one.truth.pulses[0][1] * one.truth.frequency_hz > _LONG) == long]
        if part:
            lines.append(f"| linear, strokes of {words} {_LONG:g} periods | {len(part)} | | | {_held(part)} |")
    return "\n".join(lines)


def _held(outcomes: Sequence[Outcome]) -> str:
    told = np.array([one.inside for one in outcomes if one.inside])
    return " / ".join(f"{100 * share:.1f} %" for share in told.mean(axis=0)) if told.size else ""


def main() -> None:
    """Run the trials and print the table."""
    # each process uses all cores by itself
    parser = trial_parser("impulses", "Noise on a hammer's force.", count=100, of="records of every joint", workers=1)
    parser.add_argument("--joint", choices=JOINTS, action="append", help="only this joint")
    parser.add_argument("--model", default="auto", help="of sinew identify; linear counts intervals fast")
    chosen = parser.parse_args()
    trials = [(joint, seed, chosen.model) for joint in chosen.joint or JOINTS for seed in asked_seeds(chosen)]
    outcomes = []
    for one in spread_trials(run_trial, *zip(*trials, strict=True), spread=spread_of(chosen)):
        outcomes.append(one)
        t = one.truth
        print(
            f"{t.joint} {one.seed}: {t.frequency_hz:.2f} Hz, D {t.damping_ratio:.3f}, {len(t.pulses)} strokes of "
            f"{1e3 * t.pulses[0][1]:.0f} ms, noise {100 * t.input_noise:.2f} % in, {100 * t.output_noise:.2f} % out -> "
            f"{one.model}",
            flush=True,
        )
    print(table(outcomes))


if __name__ == "__main__":
    main()
