"""Bands of a calibrated rig against the truth: `python -m campaigns.bands --seeds 20`.

Each trial draws a rig around the paper's, records a modest plan of it on the twin with every effect on, calibrates the
paper's rig from that, and predicts a pretension that was not recorded. Counted is how often the truth's curve, which is
computed as the draws are, lies inside the 90 % band, and its marked points inside their intervals. The drive is known:
a calibration does not look for it.
"""

from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from campaigns.options import asked_seeds, trial_parser
from campaigns.recovery import draw_rig, plans
from sinew.identify.joint.calibration import Source, calibrate_rig
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.predict.band import Band, band_of, crest, draw_rigs, drawn_branches
from sinew.predict.joint import joint_problem
from sinew.solve.branch import Branch, sweep
from sinew.solve.curves import Problem
from sinew.twin.simulate import simulate

BAND_HZ, PRETENSION_MM, AMPLITUDE_DEG = (2.0, 5.5), 7.0, 20.0
AT_HZ = np.array([2.2, 2.8, 3.2, 3.5, 3.8, 4.2, 5.0])
MARKS = ("frequency of the peak", "amplitude of the peak", "frequency of 90°")


@dataclass(frozen=True)
class Trial:
    """One hidden rig. amplitude, phase: whether the truth is inside the band at `AT_HZ`, (f,); marks: inside their
    intervals, in the order of `MARKS`. width: half of the band of the amplitude over its median, (f,)."""

    seed: int
    amplitude: NDArray[np.bool_]
    phase: NDArray[np.bool_]
    marks: NDArray[np.bool_]
    width: NDArray[np.float64]
    seconds: float


def _problem(rig: RigSpec) -> Problem:
    return joint_problem(rig, [PRETENSION_MM], AMPLITUDE_DEG, BAND_HZ)


def run_trial(seed: int, draws: int = 40) -> Trial:
    """Return one trial with so many draws."""
    begin = perf_counter()
    hidden = draw_rig(seed)
    paper = load_rig("paper")
    drive = {name: one.value for name, one in hidden.parameters() if name.startswith("drive.")}
    recordings = [simulate(plan, hidden, seed=1000 * seed + k) for k, plan in enumerate(plans())]
    sources = [Source(f"{k}.nc", f"{seed:x}".zfill(64)) for k in range(len(recordings))]
    rig = calibrate_rig(recordings, sources, paper.with_values(drive), name="found").rig
    rigs = [hidden, rig, *draw_rigs(rig, draws, seed).rigs]
    truth, nominal, *drawn = (branches[0] for branches in drawn_branches(rigs, _problem, BAND_HZ))
    band = band_of(nominal, nominal, drawn, AT_HZ)
    met, (amplitude, phase) = sweep(truth, AT_HZ, "up"), band.up
    return Trial(
        seed,
        (amplitude.low <= met.amplitude) & (met.amplitude <= amplitude.high),
        (phase.low <= met.phase) & (met.phase <= phase.high),
        _marks(truth, band),
        0.5 * (amplitude.high - amplitude.low) / amplitude.median,
        perf_counter() - begin,
    )


def _marks(truth: Branch, band: Band) -> NDArray[np.bool_]:
    top, crossing, peak, quarter = crest(truth), truth.phase_90, band.peak, band.phase_90
    assert top is not None
    assert crossing is not None
    assert peak is not None
    assert quarter is not None
    pairs = (
        (peak.frequency_hz, top.frequency_hz),
        (peak.amplitude, top.amplitude),
        (quarter.frequency_hz, crossing.frequency_hz),
    )
    return np.array([one.low <= true <= one.high for one, true in pairs])


def table(trials: list[Trial]) -> str:
    """Return the shares as text, with the range that a true share of 90 % reaches in 19 of 20 campaigns."""
    count = len(trials)
    rows: list[tuple[str, NDArray[np.bool_]]] = []
    for i, f in enumerate(AT_HZ):
        rows.append((f"amplitude at {f:g} Hz", np.array([t.amplitude[i] for t in trials])))
    for i, f in enumerate(AT_HZ):
        rows.append((f"phase at {f:g} Hz", np.array([t.phase[i] for t in trials])))
    rows += [(name, np.array([t.marks[i] for t in trials])) for i, name in enumerate(MARKS)]
    low, high = stats.binom.interval(0.95, count, 0.9)
    lines = [f"{name:24} {inside.sum():4d} of {count}  {100 * inside.mean():5.1f} %" for name, inside in rows]
    whole = np.concatenate([np.concatenate([t.amplitude, t.phase, t.marks]) for t in trials])
    lines.append(f"{'all':24} {whole.sum():4d} of {whole.size}  {100 * whole.mean():5.1f} %")
    lines.append(f"of {count} independent trials {low:.0f} to {high:.0f} are inside where the share is 90 %")
    width = np.median([t.width for t in trials], axis=0)
    lines.append("median half width of the band: " + ", ".join(f"{100 * w:.2f} %" for w in width))
    return "\n".join(lines)


def main() -> None:
    """Run trials and print the shares."""
    parser = trial_parser("bands", __doc__, count=20, of="trials")
    parser.add_argument("--draws", type=int, default=40, help="draws of each band")
    asked = parser.parse_args()
    trials = []
    for seed in asked_seeds(asked):
        trials.append(run_trial(seed, asked.draws))
        last = trials[-1]
        inside = np.concatenate([last.amplitude, last.phase, last.marks])
        print(f"seed {seed}: {inside.sum()} of {inside.size} inside, {last.seconds:.0f} s", flush=True)
    print(table(trials))


if __name__ == "__main__":
    main()
