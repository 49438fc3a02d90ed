"""Intervals of a calibration against the truth: `python -m campaigns.calibration --seeds 50`.

Each trial records a plan of the paper's rig on the twin, with scatter, noise and jitter, and calibrates the rig from
that recording alone, as the tutorial does. Counted is, parameter by parameter, how often the 90 % interval holds the
true value. With `--hidden` every trial has another rig (`campaigns.recovery`), and the search begins at the paper's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from time import perf_counter

import numpy as np
from scipy import stats

from campaigns.options import asked_seeds, spread_of, spread_trials, trial_parser
from campaigns.recovery import draw_rig
from sinew.identify.joint.calibration import Source, calibrate_rig
from sinew.plan.toml import load_plan, load_rig
from sinew.twin.simulate import simulate

PLAN = "first"
"""The plan that the tutorial records."""


@dataclass(frozen=True)
class Trial:
    """One recording. found: by parameter error over standard deviation, whether the interval holds the truth, and the
    standard deviation as a share of the truth. kept: parameters that the recording does not determine."""

    seed: int
    found: dict[str, tuple[float, bool, float]]
    kept: tuple[str, ...]
    seconds: float


def run_trial(seed: int, plan: str = PLAN, *, hidden: bool = False) -> Trial:
    """Return one trial. seed: of the recording, and of the hidden rig."""
    begin = perf_counter()
    paper = load_rig("paper")
    truth = draw_rig(seed) if hidden else paper
    recording = simulate(load_plan(plan), truth, seed=seed)
    done = calibrate_rig([recording], [Source("piece.nc", f"{seed:x}".zfill(64))], paper, name="piece")
    true = {name: one.value for name, one in truth.parameters()}
    found = {
        name: ((one.value - true[name]) / one.std, one.low <= true[name] <= one.high, one.std / true[name])
        for name, one in done.found.items()
    }
    return Trial(seed, found, done.kept, perf_counter() - begin)


def table(trials: Sequence[Trial]) -> str:
    """Return a row for each parameter, and one for all: how many intervals hold the truth, and how wide they are."""
    names = dict.fromkeys(name for trial in trials for name in trial.found)
    lines = []
    for name in names:
        rows = [trial.found[name] for trial in trials if name in trial.found]
        inside, width = sum(row[1] for row in rows), float(np.median([row[2] for row in rows]))
        spread = float(np.sqrt(np.mean([row[0] ** 2 for row in rows])))
        lines.append(
            f"{name:32} {inside:4d} of {len(rows):<4d} {100 * inside / len(rows):5.1f} %   median std "
            f"{100 * width:6.2f} %   error over std, rms {spread:.2f}"
        )
    every = [row[1] for trial in trials for row in trial.found.values()]
    low, high = stats.binom.interval(0.95, len(trials), 0.9)
    lines.append(f"{'all':32} {sum(every):4d} of {len(every):<4d} {100 * np.mean(every):5.1f} %")
    lines.append(
        f"of {len(trials)} independent intervals {low:.0f} to {high:.0f} hold the truth where the share is 90 %"
    )
    return "\n".join(lines)


def main() -> None:
    """Run the trials and print the table."""
    parser = trial_parser("calibration", __doc__, count=50, of="recordings", workers=1)
    parser.add_argument("--plan", default=PLAN, help="the plan that is recorded")
    parser.add_argument("--hidden", action="store_true", help="another rig in every trial")
    asked = parser.parse_args()
    trials = []
    each = partial(run_trial, plan=asked.plan, hidden=asked.hidden)
    for trial in spread_trials(each, asked_seeds(asked), spread=spread_of(asked)):
        trials.append(trial)
        marks = " ".join(
            f"{name.split('.')[1]} {error:+.1f}{'' if ok else '!'}" for name, (error, ok, _) in trial.found.items()
        )
        print(f"seed {trial.seed}, {trial.seconds:.0f} s: {marks}", flush=True)
    print(table(trials))


if __name__ == "__main__":
    main()
