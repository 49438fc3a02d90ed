"""Hidden rigs recovered from their recordings: `python -m campaigns.recovery --seeds 20`.

Each trial draws a rig around the paper's, runs a modest plan on the twin with every effect on, and fits the tendon
joint from the paper's rig. Counted is how often the truth lies inside the 90 % interval.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from scipy import stats

from campaigns.options import TWO, asked_seeds, spread_of, spread_trials, trial_parser
from sinew.identify.joint.fit import fit_joint
from sinew.plan.plan import Plan, Pretension, RingDown, Sweep
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.twin.simulate import simulate

QUANTITIES = ("stiffness", "tendon moment", "loss factor", "guide friction")
"""G J/L; head radius times the tension at first contact; of the silicone; of the guides, as the rig defines it."""

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
    """One hidden rig. truth, value, std, low, high: of `QUANTITIES`, shape (4,), SI.

    lost_j: true and fitted energy that the guides take in a cycle of 0.4 rad at the tension of first contact.
    """

    seed: int
    truth: tuple[float, ...]
    value: tuple[float, ...]
    std: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    converged: bool
    seconds: float
    lost_j: tuple[float, float]

    @property
    def inside(self) -> tuple[bool, ...]:
        """Return whether the truth is inside the interval, by quantity."""
        return tuple(a <= t <= b for a, t, b in zip(self.low, self.truth, self.high, strict=True))


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


def plans() -> list[Plan]:
    """Return the plan of a trial: three pretensions; a sweep at 20°; ring-downs from 12°; three repeats."""
    return [
        Plan(
            name="recovery",
            pretension=Pretension(pretension_mm=(0, 4, 10), rest_s=0.2),
            sweep=Sweep(frequency_hz=(2.5, 3.0, 3.6, 4.4), amplitude_deg=20, settle_s=1.2, periods=3, repeats=3),
            ring_down=RingDown(frequency_hz=(3, 4.2), amplitude_deg=12, drive_s=1.2, record_s=1.2, repeats=3),
        )
    ]


def _truth(rig: RigSpec) -> tuple[float, ...]:
    tendons = rig.tendons
    return (
        rig.silicone.torsional_rigidity.value / rig.silicone.length.value,
        tendons.head_radius.value * tendons.first_contact_tension.value,
        rig.silicone.loss_factor.value,
        tendons.guide_friction.value,
    )


def _lost(rig: RigSpec, amplitude: float = 0.4) -> float:
    """Return the energy that the guides take in a cycle [J] at constant tension: 4 μ ΣT (A - φ_s tanh(A/φ_s))."""
    tendons = rig.tendons
    sliding = tendons.presliding_angle.value
    level = tendons.guide_friction.value * tendons.count * tendons.first_contact_tension.value
    return float(4 * level * (amplitude - sliding * np.tanh(amplitude / sliding)))


def run_trial(seed: int) -> Trial:
    """Return one trial."""
    hidden = draw_rig(seed)
    recordings = [simulate(plan, hidden, seed=1000 * seed + k) for k, plan in enumerate(plans())]
    begin = perf_counter()
    fit = fit_joint(recordings, load_rig("paper"))
    found = [
        fit.derived["stiffness_n_m_rad"],
        fit.derived["tendon_moment_n_m"],
        fit.parameters["silicone.loss_factor"],
        fit.parameters["tendons.guide_friction"],
    ]
    return Trial(
        seed,
        _truth(hidden),
        tuple(one.value for one in found),
        tuple(one.std for one in found),
        tuple(one.low for one in found),
        tuple(one.high for one in found),
        fit.converged,
        perf_counter() - begin,
        (_lost(hidden), _lost(fit.fitted_rig)),
    )


def covered(trials: Sequence[Trial]) -> float:
    """Return the share of cases, quantities and trials together, whose truth is inside the 90 % interval."""
    return float(np.mean([trial.inside for trial in trials]))


def table(trials: Sequence[Trial]) -> str:
    """Return coverage, precision and error by quantity, as a Markdown table, and the coverage of all."""
    lines = [
        "| quantity | inside | median std | median error | largest error |",
        "|---|---|---|---|---|",
    ]
    inside = np.array([trial.inside for trial in trials])
    truth, value, std = (np.array([getattr(t, name) for t in trials]) for name in ("truth", "value", "std"))
    error = np.abs(value - truth) / truth
    for k, name in enumerate(QUANTITIES):
        lines.append(
            f"| {name} | {inside[:, k].sum()} of {len(trials)} | {100 * np.median(std[:, k] / truth[:, k]):.2f} % | "
            f"{100 * np.median(error[:, k]):.2f} % | {100 * error[:, k].max():.2f} % |"
        )
    hit, whole = int(inside.sum()), inside.size
    low, high = stats.binom.interval(0.95, whole, 0.9)
    lost = np.array([trial.lost_j for trial in trials])
    off = np.abs(lost[:, 1] / lost[:, 0] - 1)
    lines += [
        "",
        f"inside in all: {hit} of {whole}, {100 * hit / whole:.1f} % (90 % intervals give "
        f"{low:.0f} to {high:.0f} in 95 % of campaigns if the cases are independent)",
        f"energy lost in the guides per cycle at 0.4 rad: median error {100 * np.median(off):.2f} %",
        f"converged {sum(t.converged for t in trials)} of {len(trials)}; a fit takes "
        f"{np.median([t.seconds for t in trials]):.1f} s",
    ]
    return "\n".join(lines)


def main() -> None:
    """Run the trials and print the table."""
    asked = trial_parser("recovery", "Hidden rigs, recovered.", count=20, of="hidden rigs", workers=TWO).parse_args()
    trials = []
    for trial in spread_trials(run_trial, asked_seeds(asked), spread=spread_of(asked)):
        trials.append(trial)
        marks = " ".join(
            f"{(v - t) / s:+.2f}{'' if ok else '!'}"
            for v, t, s, ok in zip(trial.value, trial.truth, trial.std, trial.inside, strict=True)
        )
        print(f"seed {trial.seed}: error over std {marks}, {trial.seconds:.1f} s", flush=True)
    print(table(trials))


if __name__ == "__main__":
    main()
