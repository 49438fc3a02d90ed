"""Intervals of a calibration against the truth: `python -m campaigns.calibration --seeds 50`.

Each trial records a plan of the paper's rig on the twin, with scatter, noise and jitter, and calibrates the rig from
that recording alone, as the tutorial does. Counted is, parameter by parameter, how often the 90 % interval holds the
true value. With `--hidden` every trial has another rig around the paper's, and the search begins at the paper's.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from time import perf_counter

import numpy as np
import pandas as pd
from scipy import stats

from campaigns.options import asked_seeds, campaign_parser, conclude, spread_of, spread_trials
from sinew.identify.joint.calibration import calibrate
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_plan, load_rig
from sinew.twin.simulate import simulate

PLAN = "first"
"""The plan that the tutorial records."""

_SPREAD = {
    "silicone.torsional_rigidity": 0.25,
    "silicone.loss_factor": 0.3,
    "tendons.head_radius": 0.2,
    "tendons.first_contact_tension": 0.3,
    "tendons.guide_friction": 0.3,
    "tendons.presliding_angle": 0.3,
    "silicone.diameter": 0.1,
    "inertia.lever": 0.15,
    "imu.residual_delay": 0.8,
    "drive.supply_voltage": 0.1,
}
"""Half width of the uniform draw, as a share of the paper rig's value."""


@dataclass(frozen=True)
class Trial:
    """One recording. found: by parameter error over standard deviation, whether the interval holds the truth, and the
    standard deviation as a share of the truth. kept: parameters that the recording does not determine."""

    seed: int
    found: dict[str, tuple[float, bool, float]]
    kept: tuple[str, ...]
    seconds: float


def draw_rig(seed: int) -> RigSpec:
    """Return a hidden rig: the paper's with its unknown parameters drawn anew, inside their bounds."""
    rng = np.random.default_rng([seed, 4])
    rig = load_rig("paper")
    there = dict(rig.parameters())
    values = {}
    for name, spread in _SPREAD.items():
        low, high = there[name].bounds
        values[name] = float(np.clip(there[name].value * (1 + spread * rng.uniform(-1, 1)), low, high))
    values["tendons.base_radius"] = values["tendons.head_radius"]
    values["inertia.head"] = rig.inertia.head.value + rig.inertia.lever.value - values["inertia.lever"]
    return rig.with_values(values)


def run_trial(seed: int, plan: str = PLAN, *, hidden: bool = False) -> Trial:
    """Return one trial. seed: of the recording, and of the hidden rig."""
    begin = perf_counter()
    paper = load_rig("paper")
    truth = draw_rig(seed) if hidden else paper
    recording = simulate(load_plan(plan), truth, seed=seed)
    done = calibrate(paper, recording, name="piece")
    true = {name: one.value for name, one in truth.parameters()}
    found = {
        name: ((one.value - true[name]) / one.std, one.low <= true[name] <= one.high, one.std / true[name])
        for name, one in done.found.items()
    }
    return Trial(seed, found, done.undetermined, perf_counter() - begin)


def table(trials: Sequence[Trial]) -> str:
    """Return a row for each parameter, and one for all: how many intervals hold the truth, and how wide they are."""
    columns = ("parameter", "error over std", "inside", "std over truth")
    rows = pd.DataFrame([(name, *one) for trial in trials for name, one in trial.found.items()], columns=columns)
    by = rows.groupby("parameter", sort=False)
    parts = {
        "trials": by.size(),
        "inside/%": 100 * by["inside"].mean(),
        "median std/%": 100 * by["std over truth"].median(),
        "error over std, rms": by["error over std"].agg(lambda one: float(np.sqrt(np.mean(one**2)))),
    }
    low, high = stats.binom.interval(0.95, len(trials), 0.9)
    return (
        f"{pd.DataFrame(parts).round(2).to_string()}\nall: {100 * rows['inside'].mean():.1f} % of {len(rows)}\n"
        f"of {len(trials)} independent intervals {low:.0f} to {high:.0f} hold the truth where the share is 90 %"
    )


def main() -> None:
    """Run the trials and print the table."""
    parser = campaign_parser("calibration", __doc__, count=50, of="seeds", numbered=True, workers=1)
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
    conclude(asked.out, table(trials), list(map(asdict, trials)))


if __name__ == "__main__":
    main()
