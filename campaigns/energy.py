"""The measured energy against the twin's exact balance: `python -m campaigns.energy --seeds 20`.

Each trial records the paper's sweep on the twin with every effect on (noise, delays, rounding, jitter, scatter between
repeats) and analyses it. Its numbers are held against the power balance of `campaigns.balance`, twice: of the very
lanes that were recorded, which shows what the measuring adds; and of the rig without scatter, of which the intervals
should hold nine in ten.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import jax
import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import stats

from campaigns.balance import Balance, balance_lanes
from campaigns.options import asked_seeds, trial_parser
from sinew.analysis.signal.signals import read_signals
from sinew.analysis.sweep.energy import energy_of_repeats, estimate_energy, fit_line_trend, fit_swing_trend
from sinew.analysis.sweep.resonance import read_resonances
from sinew.analysis.sweep.response import estimate_response
from sinew.measure.arrays import Array
from sinew.measure.schema import companions
from sinew.plan.plan import Group, Plan
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_plan, load_rig
from sinew.twin.parameters import Effects
from sinew.twin.simulate import Lanes, lane_parameters, record_tracks, simulate_tracks

Pair = tuple[float, int]

EXACT_QUANTITIES = (
    "drive_power_at_resonance_w",
    "copper_at_resonance_w",
    "gear_at_resonance_w",
    "mechanical_at_resonance_w",
    "holding_at_resonance_w",
    "energy_per_cycle_at_resonance_j",
    "swing_cost_at_resonance_j_rad2",
    "energy_reduction",
    "energy_reduction_with_holding",
    "current_reduction",
    "break_even_rad",
    "cheapest_hz",
    "swing_cost_at_cheapest_j_rad2",
    "cheapest_reduction",
    "line_reduction",
)
_BY_SPLINE = ("cheapest_hz", "swing_cost_at_cheapest_j_rad2", "cheapest_reduction")


@dataclass(frozen=True)
class Trial:
    """One campaign. Arrays (quantity, p), in the order of `EXACT_QUANTITIES`.

    measured, low, high: value and 90 % interval. same: exact, of the lanes that were recorded, mean over the repeats.
    steady: exact, of the rig without scatter.
    """

    seed: int
    pretension_mm: Array
    measured: Array
    low: Array
    high: Array
    same: Array
    steady: Array
    seconds: float

    @property
    def error(self) -> Array:
        """Return measured over exact of the same lanes, less one."""
        return self.measured / self.same - 1

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Return whether the interval holds the rig's own value."""
        return np.asarray((self.low <= self.steady) & (self.steady <= self.high))


def paper_sweep(pretension_mm: Sequence[float] = ()) -> Plan:
    """Return the paper's plan without ring-downs, at some of its pretensions or all."""
    plan = load_plan("paper").model_copy(update={"ring_down": None})
    if not pretension_mm:
        return plan
    return plan.model_copy(
        update={"pretension": plan.pretension.model_copy(update={"pretension_mm": tuple(pretension_mm)})}
    )


def _columns(balance: Balance, part: slice) -> dict[str, Array]:
    """Return the balance of some lanes under the names of the result schema."""
    names = {
        "drive_power_w": balance.electrical,
        "drive_power_std_w": np.zeros_like(balance.electrical),
        "drive_copper_w": balance.copper,
        "drive_mechanical_w": balance.mechanical,
        "holding_power_w": balance.holding,
        "drive_current_rms_a": balance.current_rms,
        "amplitude_rad": balance.torsion,
    }
    return {name: values[part] for name, values in names.items()}


def exact_energy(
    groups: Sequence[Group], lanes: Lanes, resonance_hz: dict[Pair, float], rig: RigSpec
) -> dict[Pair, dict[str, float]]:
    """Return `EXACT_QUANTITIES` by name for every (pretension, repeat), from the balance of steady cycles.

    groups, lanes: of a sweep, in one order. resonance_hz: where the numbers at resonance are taken: a lane of its own
    runs there, so that nothing is interpolated. The trends are fitted to the balances at the sweep's frequencies.
    """
    rows: list[int] = []
    frequency: list[float] = []
    spans = []
    for pair, at in resonance_hz.items():
        mine = [i for i, g in enumerate(groups) if g.kind == "steady" and (g.pretension_mm, g.repeat) == pair]
        own = sorted((groups[i].frequency_hz, i) for i in mine)
        spans.append(slice(len(rows), len(rows) + len(own)))
        rows += [i for _, i in own] + [own[0][1]]
        frequency += [f for f, _ in own] + [at]
    p, shortening = lanes
    chosen = jax.tree.map(lambda leaf: np.asarray(leaf)[rows], p)._replace(omega=2 * np.pi * np.asarray(frequency))
    balance = balance_lanes((chosen, np.asarray(shortening)[rows]), rig, settle_cycles=30)
    out = {}
    for (pair, at), span in zip(resonance_hz.items(), spans, strict=True):
        last = {name: float(column[0]) for name, column in _columns(balance, slice(span.stop, span.stop + 1)).items()}
        out[pair] = _quantities(balance.frequency_hz[span], _columns(balance, span), last, at, rig.drive.resistance)
    return out


def _quantities(
    f: Array, sweep: dict[str, Array], last: dict[str, float], at: float, resistance: float
) -> dict[str, float]:
    """Return the quantities from the balances of a sweep and of the lane at the resonance."""
    trend = fit_swing_trend(f, sweep["drive_current_rms_a"], sweep["amplitude_rad"])
    line = fit_line_trend(f, sweep["drive_current_rms_a"], at)
    assert trend is not None
    alone = {name: column[None] for name, column in sweep.items()}
    by_spline = energy_of_repeats(f, alone, np.array([at]), resistance)
    power, current, swing, holding = (
        last[name] for name in ("drive_power_w", "drive_current_rms_a", "amplitude_rad", "holding_power_w")
    )
    square = trend.saved * at**2 * swing**2
    saving = resistance * square
    return {
        "drive_power_at_resonance_w": power,
        "copper_at_resonance_w": last["drive_copper_w"],
        "gear_at_resonance_w": power - last["drive_copper_w"] - last["drive_mechanical_w"],
        "mechanical_at_resonance_w": last["drive_mechanical_w"],
        "holding_at_resonance_w": holding,
        "energy_per_cycle_at_resonance_j": power / at,
        "swing_cost_at_resonance_j_rad2": power / at / swing**2,
        "energy_reduction": saving / (power + saving),
        "energy_reduction_with_holding": (saving - holding) / (power + saving),
        "current_reduction": 1 - current / math.sqrt(current**2 + square),
        "break_even_rad": swing * math.sqrt(holding / saving),
        "line_reduction": math.nan if line is None else 1 - current / line.current(at),
    } | {name: float(by_spline[name][0, 0]) for name in _BY_SPLINE}


def _measure(plan: Plan, rig: RigSpec, lanes: Lanes, seed: int, effects: Effects) -> tuple[xr.Dataset, Array, Array]:
    """Return (energy part of the results, resonance (p, r) [Hz], pretensions) of a plan's lanes."""
    groups = plan.groups()
    tracks = simulate_tracks(lanes, groups, plan.sample_hz)
    noise = np.random.default_rng(np.random.SeedSequence(seed).spawn(2)[1])
    recording = record_tracks(tracks, lanes, plan, rig, effects=effects, rng=noise)
    signals = read_signals(recording, rig)
    response = estimate_response(signals)
    resonance = read_resonances(response).value["resonance_hz"]
    energy = estimate_energy(signals, response, resonance)
    assert energy is not None
    return energy, resonance, response.pretension_mm


def steady_truth(plan: Plan, rig: RigSpec) -> Array:
    """Return `EXACT_QUANTITIES` of a rig without scatter, (quantity, p), at the resonance that a quiet sweep shows."""
    once = plan.model_copy(update={"sweep": plan.sweep.model_copy(update={"repeats": 1})})  # type: ignore[union-attr]
    effects = Effects().without("sensor_noise", "stamp_jitter", "repeatability")
    lanes = lane_parameters(once.groups(), rig)
    _, resonance, pretension = _measure(once, rig, lanes, 0, effects)
    at = {(float(p), 0): float(resonance[i, 0]) for i, p in enumerate(pretension)}
    exact = exact_energy(once.groups(), lanes, at, rig)
    return np.array([[exact[float(p), 0][name] for p in pretension] for name in EXACT_QUANTITIES])


def run_trial(seed: int, plan: Plan, rig: RigSpec, steady: Array) -> Trial:
    """Return one trial. steady: of `steady_truth`."""
    begin = perf_counter()
    groups = plan.groups()
    scatter = np.random.default_rng(np.random.SeedSequence(seed).spawn(2)[0])
    lanes = lane_parameters(groups, rig, rng=scatter)
    energy, resonance, pretension = _measure(plan, rig, lanes, seed, Effects())
    at = {(float(p), r): float(resonance[i, r]) for i, p in enumerate(pretension) for r in range(resonance.shape[1])}
    exact = exact_energy(groups, lanes, at, rig)
    repeats = range(resonance.shape[1])
    same = [[np.mean([exact[float(p), r][n] for r in repeats]) for p in pretension] for n in EXACT_QUANTITIES]
    ends = [companions(name)[1:] for name in EXACT_QUANTITIES]
    return Trial(
        seed,
        pretension,
        np.array([energy[name].values for name in EXACT_QUANTITIES]),
        np.array([energy[low].values for low, _ in ends]),
        np.array([energy[high].values for _, high in ends]),
        np.array(same),
        steady,
        perf_counter() - begin,
    )


def table(trials: Sequence[Trial]) -> str:
    """Return, by quantity: exact value at the ends, largest and mean deviation, and how often the interval holds it.

    Intervals are counted above zero pretension only: the scatter of the pretension cannot go below zero, so that at
    zero the repeats' mean is not the rig without scatter.
    """
    first = trials[0]
    inside = np.array([t.inside for t in trials])[:, :, first.pretension_mm > 0]
    error = np.array([t.error for t in trials])
    count = inside[:, 0].size
    ends = f"{first.pretension_mm[0]:g} and {first.pretension_mm[-1]:g} mm"
    lines = [f"{'quantity':34}{'exact at ' + ends:>24}{'largest':>9}{'mean':>9}{'inside 90 %':>16}"]
    for i, name in enumerate(EXACT_QUANTITIES):
        exact = f"{first.steady[i, 0]:.4g}, {first.steady[i, -1]:.4g}"
        largest, mean = 100 * np.abs(error[:, i]).max(), 100 * error[:, i].mean()
        share = f"{inside[:, i].sum()} of {count}"
        lines.append(f"{name:34}{exact:>24}{largest:8.2f}%{mean:+8.2f}%{share:>16}")
    low, high = stats.binom.interval(0.95, count, 0.9)
    lines.append(f"of {count} trials {low:.0f} to {high:.0f} are inside where the share is 90 %")
    by_trial = inside.mean(axis=(1, 2))
    lines.append(
        f"all: {100 * inside.mean():.1f} %, by trial {100 * by_trial.min():.0f} to {100 * by_trial.max():.0f} %"
    )
    return "\n".join(lines)


def main() -> None:
    """Run trials and print the table."""
    parser = trial_parser("energy", __doc__, count=20, of="trials")
    parser.add_argument("--pretension-mm", type=float, nargs="*", default=[], help="some of the paper's; all of them")
    asked = parser.parse_args()
    plan, rig = paper_sweep(asked.pretension_mm), load_rig("paper")
    steady = steady_truth(plan, rig)
    trials = []
    for seed in asked_seeds(asked):
        trials.append(run_trial(seed, plan, rig, steady))
        last = trials[-1]
        share = f"{last.inside.sum()} of {last.inside.size} inside"
        print(
            f"seed {seed}: {share}, largest deviation {100 * np.nanmax(np.abs(last.error)):.2f} %, {last.seconds:.0f} s"
        )
    print(table(trials), flush=True)


if __name__ == "__main__":
    main()
