"""Continuation on rigs that nobody chose: `python -m campaigns.continuation --rigs 200`.

Every parameter of silicone, inertia, tendons and drive is drawn anew anywhere inside its bounds, with a pretension, an
amplitude and a motor mode; in every fourth rig the lever follows its command exactly. Counted is how each curve ended,
with the reason where it is not whole. One stable point of every curve is held against
time integration of the full twin.
"""

import argparse
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Literal

import jax
import numpy as np

from sinew.plan.plan import Group, TendonMode
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.predict.joint import RESOLUTION, joint_problem
from sinew.solve.branch import Branch, Prediction
from sinew.solve.curves import predict
from sinew.solve.march import Track
from sinew.twin.parameters import Effects
from sinew.twin.simulate import lane_parameters, simulate_tracks

BAND_HZ = (1.0, 6.0)
MODES: tuple[TendonMode, ...] = ("position", "position-with-current-limit", "current")
_PARTS = ("silicone.", "inertia.", "tendons.", "drive.")
_SAMPLE_HZ, _LASTS_S, _LAST_PERIODS = 400.0, 40.0, 4
_HARMONICS = np.arange(1, 20)
_AWAY = 0.02  # of the amplitude: another motion than the predicted one

Outcome = Literal["whole", "with a remark", "not to the end", "crash"]
OUTCOMES: tuple[Outcome, ...] = ("whole", "with a remark", "not to the end", "crash")


@dataclass(frozen=True)
class Drawn:
    """A rig and what is done with it. pretension [mm], amplitude of the command [deg]."""

    seed: int
    rig: RigSpec
    pretension_mm: float
    amplitude_deg: float
    mode: TendonMode
    effects: Effects


@dataclass(frozen=True)
class Trial:
    """What became of one curve.

    reason: why it is not whole, in words, or "". error: the error estimate [1]. folds: their number. point: frequency
    [Hz], amplitude [rad], phase [rad] of the stable point that is held against the twin; nan without one. off:
    amplitude of the twin over the predicted one, less one; off_deg: of the phase; nan without a point.
    """

    drawn: Drawn
    outcome: Outcome
    reason: str
    error: float
    folds: int
    point: tuple[float, float, float]
    others: tuple[float, ...] = ()
    off: float = float("nan")
    off_deg: float = float("nan")
    seconds: float = 0.0


def draw(seed: int) -> Drawn:
    """Return one draw. Bounds that are a factor of ten or more apart are drawn from evenly in the logarithm."""
    rng = np.random.default_rng([seed, 9])
    rig, values = load_rig("paper"), {}
    for name, parameter in rig.parameters():
        low, high = parameter.bounds
        if name.startswith(_PARTS) and low < high:
            if low > 0 and high / low >= 10:
                values[name] = float(np.exp(rng.uniform(np.log(low), np.log(high))))
            else:
                values[name] = float(rng.uniform(low, high))
    effects = Effects().without("drive_dynamics") if rng.random() < 0.25 else Effects()
    mode = MODES[rng.integers(len(MODES))]
    return Drawn(seed, rig.with_values(values), rng.uniform(0, 12), rng.uniform(2, 30), mode, effects)


def _predicted(one: Drawn) -> Prediction:
    problem = joint_problem(
        one.rig, [one.pretension_mm], one.amplitude_deg, BAND_HZ, mode=one.mode, effects=one.effects
    )
    return predict(problem, BAND_HZ, RESOLUTION)


def _judged(one: Drawn, begin: float) -> Trial:
    nowhere = (np.nan, np.nan, np.nan)
    try:
        prediction = _predicted(one)
    except Exception as error:  # whatever it is, it is what is counted
        return Trial(one, "crash", f"{type(error).__name__}: {error}", np.nan, 0, nowhere)
    branch = prediction.branches[0]
    told = [part for part in branch.message.split("; ") if not part.startswith("the curve was followed through")]
    if prediction.error_estimate > RESOLUTION.tolerance:
        told.append("the error estimate is above the tolerance")
    outcome: Outcome = "not to the end" if not branch.complete else "with a remark" if told else "whole"
    point, others = _stable_point(branch, one.seed)
    seconds = perf_counter() - begin
    return Trial(
        one, outcome, "; ".join(told), prediction.error_estimate, len(branch.folds), point, others, seconds=seconds
    )


def _stable_point(branch: Branch, seed: int) -> tuple[tuple[float, float, float], tuple[float, ...]]:
    """Return one stable point by chance, and the amplitudes of other stable motions at its frequency."""
    stable = np.flatnonzero(branch.stable)
    if not stable.size:
        return (np.nan, np.nan, np.nan), ()
    i = int(np.random.default_rng([seed, 10]).choice(stable))
    f, at = branch.frequency_hz, branch.frequency_hz[i]
    crossing = [k for k in range(f.size - 1) if (f[k] - at) * (f[k + 1] - at) < 0 and abs(k - i) > 1]
    others = tuple(float(branch.amplitude[k]) for k in crossing if branch.stable[k])
    return (float(at), float(branch.amplitude[i]), float(branch.phase[i])), others


def _waves(values: np.ndarray, frequency_hz: float) -> np.ndarray:
    """Return the complex amplitudes of `_HARMONICS` over the last periods, by least squares."""
    count = round(_LAST_PERIODS * _SAMPLE_HZ / frequency_hz)
    turns = np.outer(np.arange(values.size)[-count:] / _SAMPLE_HZ, 2 * np.pi * frequency_hz * _HARMONICS)
    basis = np.concatenate([np.ones((count, 1)), np.cos(turns), np.sin(turns)], axis=1)
    found = np.linalg.lstsq(basis, values[-count:], rcond=None)[0][1:]
    return np.asarray(found[: _HARMONICS.size] - 1j * found[_HARMONICS.size :])


def _against(trial: Trial, track: Track) -> Trial:
    hertz, amplitude, phase = trial.point
    torsion, lever = _waves(track.torsion, hertz), _waves(track.lever, hertz)
    turn = np.exp(1j * np.outer(np.linspace(0, 2 * np.pi, 2000), _HARMONICS))
    found = float(np.ptp((turn @ torsion).real) / 2)
    apart = np.angle(np.exp(1j * (phase - np.angle(lever[0] / torsion[0]))))
    return Trial(
        **{**vars(trial), "off": found / amplitude - 1.0, "off_deg": float(np.degrees(apart))},
    )


def _integrated(trials: Sequence[Trial]) -> list[Trial]:
    """Return the trials with their points held against the twin, from rest; all lanes of one kind at once."""
    done = list(trials)
    at = [i for i, trial in enumerate(trials) if np.isfinite(trial.point[0])]
    groups, parts = [], []
    for i in at:
        one = trials[i].drawn
        group = Group("steady", one.pretension_mm, trials[i].point[0], one.amplitude_deg, 0, _LASTS_S, 2.0)
        groups.append(group)
        parts.append(lane_parameters([group], one.rig, mode=one.mode, effects=one.effects))
    if not at:
        return done
    p, rest = jax.tree.map(lambda *leaves: np.concatenate([np.asarray(leaf) for leaf in leaves]), *parts)
    for i, track in zip(at, simulate_tracks((p, rest), groups, _SAMPLE_HZ), strict=True):
        done[i] = _against(trials[i], track)
    return done


def run_trials(seeds: Iterable[int]) -> Iterator[Trial]:
    """Yield the trials in the order of their seeds."""
    trials = []
    for seed in seeds:
        begin = perf_counter()
        trials.append(_judged(draw(seed), begin))
    yield from _integrated(trials)


def _elsewhere(trial: Trial) -> bool:
    """Return whether the twin, from rest, came to another stable motion of the same curve."""
    found = (1 + trial.off) * trial.point[1]
    return abs(trial.off) > _AWAY and any(abs(found / other - 1) < _AWAY for other in trial.others)


def table(trials: Sequence[Trial]) -> str:
    """Return what came of all, the reasons with their numbers, and how far the twin is."""
    lines = [f"{outcome:16}{sum(t.outcome == outcome for t in trials):5} of {len(trials)}" for outcome in OUTCOMES]
    reasons = Counter(t.reason.lstrip("0123456789 ") for t in trials if t.reason)
    lines += [f"{count:5} x {reason}" for reason, count in reasons.most_common()]
    lines.append(f"curves with folds: {sum(t.folds > 0 for t in trials)}")
    held = [t for t in trials if np.isfinite(t.off)]
    near = [t for t in held if not _elsewhere(t)]
    amplitude = np.abs([t.off for t in near])
    phase = np.abs([t.off_deg for t in near])
    away = f"{len(held) - len(near)} came to another stable motion of the curve"
    lines.append(f"against the twin at {len(held)} stable points; {away}")
    for name, off, enough, unit in (("amplitude", 100 * amplitude, 0.5, "%"), ("phase", phase, 0.5, "°")):
        share = np.mean(off <= enough) if off.size else np.nan
        some = np.quantile(off, [0.5, 0.9, 0.99, 1.0]) if off.size else np.full(4, np.nan)
        numbers = ", ".join(f"{x:.3f}" for x in some)
        lines.append(f"  {name:9} off by (median, 90 %, 99 %, largest) {numbers} {unit}")
        lines.append(f"  {'':9} {100 * share:.1f} % within {enough} {unit}")
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> None:
    """Run the campaign and print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0, help="of the first rig")
    arguments = parser.parse_args(argv)
    trials = list(run_trials(range(arguments.seed, arguments.seed + arguments.rigs)))
    for t in trials:
        if t.outcome != "whole" or abs(t.off) > 0.005 or abs(t.off_deg) > 0.5:
            d = t.drawn
            print(
                f"{d.seed:4} {d.mode:27} {d.pretension_mm:5.2f} mm {d.amplitude_deg:5.1f}° {t.outcome:14} "
                f"{t.folds} folds, at {t.point[0]:.3f} Hz off by {100 * t.off:+.2f} % {t.off_deg:+.2f}°  {t.reason}"
            )
    print(table(trials))


if __name__ == "__main__":
    main()
