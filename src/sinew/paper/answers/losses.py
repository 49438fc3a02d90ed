"""What Lehr's damping consists of: silicone, guides, the stopped lever's recoil, sensors.

The tendon joint that was fitted to the recording swings down once more on the twin. The share of a loss is its share of
the energy that the swing loses (`energy_shares`); the sensors' is what D, read off the gyroscope by the paper's method,
changes by with perfect sensors. D with each loss switched off stands beside: it is no share, because without a loss the
joint swings differently, at another frequency and amplitude. The fit's uncertainty, and what the rig leaves
open of the drive, are carried along by drawing the parameters.
"""

import math
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import special
from scipy.stats import qmc

from sinew.analysis.signal.power import supply_uncertainty
from sinew.analysis.signal.repeats import Pooled, pool_repeats
from sinew.analysis.signal.signals import sample_rate
from sinew.identify.joint.fit import JointFit
from sinew.measure.arrays import Array
from sinew.measure.estimate import NORMAL_90, Estimate
from sinew.measure.recording import iterate_segments
from sinew.mechanics.drive import gear_friction
from sinew.mechanics.joint import State, mechanical_energy, rate, state_at_rest
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.silicone import silicone_power
from sinew.mechanics.tendons import total_tension
from sinew.paper.answers.answer import CANNOT_TELL, Answer, Cell, cannot_tell, in_words
from sinew.paper.summary import paper_damping
from sinew.plan.plan import Group
from sinew.plan.rig import RigSpec
from sinew.solve.march import LANES, runge_kutta
from sinew.solve.programs import program
from sinew.twin.parameters import Effects
from sinew.twin.simulate import lane_parameters, simulate_tracks

# A simulated ring-down tells who took its energy: silicone, guides, or the recoiling lever's servo.
#
# Along one and the same motion the power of every loss is integrated from one drive period after the stop on.
# Together they are the energy that the swing had then, less what is left at the end. That energy holds what comes
# back: bristles of the guides' friction that have not broken loose hold some, of whose torque only the slipping part is
# lost (`sinew.mechanics.guides`); and the position loop of the servo is a spring on the lever: only back-EMF and gear
# friction take energy.

_STEP_S = 1.25e-3


class _Spending(NamedTuple):
    """The state, and what each loss has taken so far [J]."""

    state: State
    silicone: jax.Array
    guides: jax.Array
    servo: jax.Array


def energy_shares(lanes: tuple[Parameters, NDArray[np.float64]], groups: list[Group]) -> NDArray[np.float64]:
    """Return what each of `LOSSES` takes of the swing's mechanical energy, shape (lane, 3).

    lanes: parameters with a lane axis and shortening at rest [m], one for each ring-down of `groups`; see
    `sinew.twin.simulate.lane_parameters`. They add up to one but for the work of a tension that changes while bristles
    are bent, a hundredth or so.
    """
    p, shortening = lanes
    free_from = np.array([group.settle_s + 1.0 / group.frequency_hz for group in groups])
    steps = jnp.asarray(int(np.ceil(max(group.duration_s for group in groups) / _STEP_S)))
    shares = []
    for start in range(0, len(groups), LANES):  # blocks of one size, so that it is compiled once
        index = np.minimum(np.arange(start, start + LANES), len(groups) - 1)
        block = jax.tree.map(lambda leaf, index=index: np.asarray(leaf)[index], p)
        shares.append(np.asarray(_spent(block, shortening[index], free_from[index], steps)))
    return np.concatenate(shares)[: len(groups)]


@program()
def _spent(p: Parameters, shortening: jax.Array, free_from: jax.Array, steps: jax.Array) -> jax.Array:
    def lane(own: Parameters, rest: jax.Array, begin: jax.Array) -> jax.Array:
        zero = jnp.zeros(())
        first = _Spending(state_at_rest(rest, own), zero, zero, zero)

        def step(k: jax.Array, carry: tuple[_Spending, jax.Array]) -> tuple[_Spending, jax.Array]:
            now, energy = carry
            time_s = k * _STEP_S
            counted = time_s >= begin
            started = counted & (time_s - _STEP_S < begin)
            energy = jnp.where(started, _energy(now.state, own), energy)
            after = runge_kutta(partial(_slope, p=own), time_s, now, jnp.asarray(_STEP_S))
            kept = [jnp.where(counted, a, b) for a, b in zip(after[1:], now[1:], strict=True)]
            return _Spending(after.state, *kept), energy

        end, energy = jax.lax.fori_loop(0, steps, step, (first, zero))
        lost = energy - _energy(end.state, own)
        return jnp.asarray(jnp.stack(end[1:]) / lost)

    return jnp.asarray(jax.vmap(lane)(p, shortening, free_from))


def _slope(time_s: jax.Array, now: _Spending, p: Parameters) -> _Spending:
    state = now.state
    silicone = p.viscous * state.torsion_rate**2
    silicone += silicone_power(state.torsion, state.shortening, state.memory, state.axial_memory, p)
    sliding = p.guides.power(total_tension(state.torsion, state.shortening, p), state.torsion_rate, state.bristles)
    drag = p.speed_slope * state.lever_rate + gear_friction(state.lever_rate, p)
    return _Spending(rate(time_s, state, p), silicone, sliding, drag * state.lever_rate)


def _energy(state: State, p: Parameters) -> jax.Array:
    """Return the mechanical energy with that of bristles and position loop [J], the drive being told to stay at 0."""
    bristles = p.guides.stored(total_tension(state.torsion, state.shortening, p), state.bristles)
    asked = p.position_gain * jnp.abs(state.lever)
    within = jnp.minimum(asked, p.duty_limit)
    loop = p.duty_torque * within * (asked - 0.5 * within) / p.position_gain
    return jnp.asarray(mechanical_energy(state, p) + bristles + loop)


Lanes = tuple[Parameters, Array]

NAME = "losses"
QUESTION = "How much of D is sensor delay, silicone, guide friction? (sections 4.2, 5.2.5 and 5.3)"
DRAWS = 12
_MOST_PRETENSIONS = 5
_ENERGY = ("silicone_share", "guide_friction_share", "recoil_share")
_OFF = {
    "lehr_damping_without_silicone_loss": "silicone_loss",
    "lehr_damping_without_guide_friction": "guide_friction",
    "lehr_damping_without_recoil": "drive_recoil",
}
_SENSORS = "sensor_share"
_WORDS = {
    "silicone_share": "the silicone",
    "guide_friction_share": "the guides' friction",
    "recoil_share": "the stopped lever's recoil",
    _SENSORS: "the sensors' filter and delay",
}


def answer_losses(
    results: xr.Dataset, recording: xr.Dataset, joint: JointFit | None, why_not: str = "", *, seed: int = 0
) -> Answer:
    """Return the shares of D, over all pretensions and at each of at most five.

    results, recording: with ring-downs. joint: fitted to the recording; None where that was not possible, why_not says
    why. seed: of the draws from the fit's covariance.

    Numbers and rows: `silicone_share`, `guide_friction_share`, `recoil_share`, of the energy, together one;
    `sensor_share`: (D - D with perfect sensors)/D; `method_share`: (D by peaks and Eq. 7 - D by the direct fit)/D, from
    the recording itself. Rows also hold `lehr_damping`, measured, `lehr_damping_model`, that of the fitted joint, and
    `lehr_damping_without_...`, that of the fitted joint with one loss switched off.
    """
    if "paper_lehr_damping" not in results:
        return cannot_tell(NAME, QUESTION, "The recording holds no ring-downs, so there is no D to divide.")
    measured, method, pretensions = _measured(results)
    said = _method_words(results, method)
    numbers = {"method_share": _mean_share(method)}
    if joint is None:
        why = why_not or "There is no tendon joint that was fitted to it."
        return Answer(NAME, QUESTION, CANNOT_TELL, (f"The losses cannot be told apart. {why}", said), numbers)
    wanted = _spread(pretensions)
    levels = [float(pretensions[i]) for i in wanted]
    groups = [_decay_at(recording, pretension).group(pretension) for pretension in levels]
    supply = recording["supply_v"].values if "supply_v" in recording else None
    rigs = [joint.fitted_rig, *_drawn(joint, supply_uncertainty(supply, joint.fitted_rig), seed)]
    hz = round(sample_rate(recording))
    model, perfect = _dampings(rigs, groups, hz)
    if not np.isfinite(model[0]).all():
        return Answer(NAME, QUESTION, CANNOT_TELL, ("The fitted joint's ring-down cannot be analysed.", said), numbers)
    shares = _energies(rigs, groups) | {_SENSORS: 1.0 - perfect / model}
    without = _without(joint.fitted_rig, groups, hz)
    rows: list[dict[str, Cell]] = []
    for place, i in enumerate(wanted):
        row: dict[str, Cell] = {
            "pretension_mm": levels[place],
            "lehr_damping": measured.estimates[i],
            "lehr_damping_model": _over_draws(model[:, place]),
            "method_share": method.estimates[i],
        }
        row |= {name: _over_draws(values[:, place]) for name, values in shares.items()}
        rows.append(row | {name: float(values[place]) for name, values in without.items()})
    overall = {name: _over_draws(values.mean(axis=1)) for name, values in shares.items()}
    verdict, first = _judge(overall)
    words = (first, _trend_words(rows), *_check(rows), _without_words(rows), said, *_caveats(joint))
    return Answer(NAME, QUESTION, verdict, words, overall | numbers, tuple(rows))


def _measured(results: xr.Dataset) -> tuple[Pooled, Pooled, Array]:
    """Return D by the paper's method, the relative difference to the direct fit's, and the pretensions [mm]."""
    paper = np.asarray(results["paper_lehr_damping"].values, dtype=float)
    direct = np.asarray(results["damping_ratio"].values, dtype=float)
    own = np.asarray(results["damping_ratio_std"].values, dtype=float)
    known = np.isfinite(paper).any(axis=1)
    paper, direct, own = paper[known], direct[known], own[known]
    by_repeat = pool_repeats(paper.tolist(), own.tolist())
    method = pool_repeats((1.0 - direct / paper).tolist(), (own / paper).tolist())
    return by_repeat, method, np.asarray(results["pretension_mm"].values, dtype=float)[known]


def _mean_share(pooled: Pooled) -> Estimate:
    values = [one.value for one in pooled.estimates]
    return pool_repeats([values], [[one.std for one in pooled.estimates]]).estimates[0]


def _spread(pretensions: Array) -> list[int]:
    count = min(_MOST_PRETENSIONS, pretensions.size)
    return sorted({int(i) for i in np.linspace(0, pretensions.size - 1, count).round()})


class _Decay(NamedTuple):
    """A ring-down as it was recorded: drive frequency [Hz], nominal amplitude [deg], time driven and recorded [s]."""

    frequency_hz: float
    amplitude_deg: float
    drive_s: float
    record_s: float

    def group(self, pretension_mm: float) -> Group:
        """Return the same motion for the twin."""
        return Group("ring-down", pretension_mm, self.frequency_hz, self.amplitude_deg, 0, self.drive_s, self.record_s)


def _decay_at(recording: xr.Dataset, pretension_mm: float) -> _Decay:
    """Return the first ring-down at a pretension; what it does not say is 20° near its own frequency for 3 s."""
    time = recording["time_s"].values
    rows = list(iterate_segments(recording))
    for index, segment, where in rows:
        if segment.kind != "ring-down" or segment.pretension_mm != pretension_mm:
            continue
        frequency = segment.frequency_hz if segment.frequency_hz > 0 else 3.0
        amplitude = segment.amplitude_deg if segment.amplitude_deg > 0 else 20.0
        before = rows[index - 1] if index else None
        driven = 3.0
        if before is not None and before[1].kind == "settle":
            driven = float(time[where.start] - time[before[2].start])
        stop = max(1, round(driven * frequency)) / frequency
        return _Decay(frequency, amplitude, stop, float(time[where.stop - 1] - time[where.start]))
    return _Decay(3.0, 20.0, 3.0, 3.0)


_QUIET = Effects().without("repeatability", "sensor_noise", "stamp_jitter")


def _energies(rigs: list[RigSpec], groups: list[Group]) -> dict[str, Array]:
    """Return the losses' shares of the energy by name, shape (1 + draws, p)."""
    lanes = _stacked([lane_parameters(groups, rig, effects=_QUIET) for rig in rigs])
    spent = energy_shares(lanes, groups * len(rigs)).reshape(len(rigs), len(groups), len(_ENERGY))
    spent = spent / spent.sum(axis=2, keepdims=True)
    return {name: spent[:, :, k] for k, name in enumerate(_ENERGY)}


def _stacked(lanes: list[Lanes]) -> Lanes:
    joined: Lanes = jax.tree.map(lambda *leaves: np.concatenate(leaves), *lanes)
    return joined


def _dampings(rigs: list[RigSpec], groups: list[Group], hz: float) -> tuple[Array, Array]:
    """Return the model's D and its D with perfect sensors, shape (1 + draws, p)."""
    lanes = _stacked([lane_parameters(groups, rig, effects=_QUIET) for rig in rigs])
    tracks = simulate_tracks(lanes, groups * len(rigs), hz)
    found = [
        [
            paper_damping(track, groups[k % len(groups)], rigs[k // len(groups)], effects, hz)
            for k, track in enumerate(tracks)
        ]
        for effects in (_QUIET, _QUIET.without("sensor_filter"))
    ]
    model, perfect = np.array(found).reshape(2, len(rigs), len(groups))
    return model, perfect


def _without(rig: RigSpec, groups: list[Group], hz: float) -> dict[str, Array]:
    """Return D of the fitted joint with one loss switched off, by name, shape (p,)."""
    cases = [_QUIET.without(off) for off in _OFF.values()]
    lanes = _stacked([lane_parameters(groups, rig, effects=effects) for effects in cases])
    tracks = simulate_tracks(lanes, groups * len(cases), hz)
    found = [paper_damping(track, groups[k % len(groups)], rig, _QUIET, hz) for k, track in enumerate(tracks)]
    return dict(zip(_OFF, np.array(found).reshape(len(cases), len(groups)), strict=True))


_DRIVE = ("stall_torque", "no_load_speed", "friction", "armature")
"""What the recoil rests on and a fit under the measured lever does not touch. Gain and limit of the position loop are
registers, known exactly; the supply voltage is read on the bus."""


def _drawn(joint: JointFit, voltage_std: float, seed: int) -> list[RigSpec]:
    """Return rigs with parameters drawn from the fit's covariance, inside their bounds; what is tied moves along.

    The drive's are drawn beside: normal by their interval where the rig has one, else evenly between their bounds, the
    supply voltage by its relative standard uncertainty. They are spread evenly over their quantiles (Latin hypercube),
    so that a dozen draws cover them.
    """
    names = list(joint.parameters)
    matrix = np.asarray(joint.covariance.matrix)[: len(names), : len(names)]
    values = np.array([one.value for one in joint.parameters.values()])
    if not np.isfinite(matrix).all():
        return []
    rng = np.random.default_rng(seed)
    drawn = rng.multivariate_normal(values, matrix, size=DRAWS, method="eigh")
    drives = _drawn_drives(joint, [name for name in _DRIVE if f"drive.{name}" not in names], voltage_std, seed)
    return [
        _rig_with(joint.fitted_rig, dict(zip(names, map(float, row), strict=True)) | drive)
        for row, drive in zip(drawn, drives, strict=True)
    ]


def _drawn_drives(joint: JointFit, names: list[str], voltage_std: float, seed: int) -> list[dict[str, float]]:
    table = dict(joint.fitted_rig.parameters())
    quantile = qmc.LatinHypercube(len(names) + 1, rng=np.random.default_rng([seed, 1])).random(DRAWS)
    columns: dict[str, Array] = {}
    for k, name in enumerate(names):
        parameter = table[f"drive.{name}"]
        if parameter.interval90 is None:
            columns[f"drive.{name}"] = parameter.bounds[0] + np.ptp(parameter.bounds) * quantile[:, k]
        else:
            std = float(np.ptp(parameter.interval90)) / (2.0 * NORMAL_90)
            columns[f"drive.{name}"] = parameter.value + std * special.ndtri(quantile[:, k])
    supply = table["drive.supply_voltage"].value
    columns["drive.supply_voltage"] = supply * (1.0 + voltage_std * special.ndtri(quantile[:, -1]))
    return [{name: float(column[i]) for name, column in columns.items()} for i in range(DRAWS)]


def _rig_with(rig: RigSpec, values: dict[str, float]) -> RigSpec:
    bounds = {name: parameter.bounds for name, parameter in rig.parameters()}
    moved = dict(values)
    if "tendons.head_radius" in moved and "tendons.base_radius" not in moved:
        moved["tendons.base_radius"] = (
            rig.tendons.base_radius.value / rig.tendons.head_radius.value * moved["tendons.head_radius"]
        )
    if "inertia.lever" in moved and "inertia.head" not in moved:
        moved["inertia.head"] = rig.inertia.head.value + rig.inertia.lever.value - moved["inertia.lever"]
    return rig.with_values({name: float(np.clip(value, *bounds[name])) for name, value in moved.items()})


def _over_draws(values: Array) -> Estimate:
    """Return the fit's own value (the first) with the scatter of the draws."""
    drawn = values[1:][np.isfinite(values[1:])]
    if drawn.size < 2:
        return Estimate(float(values[0]), math.nan, math.nan, math.nan)
    return Estimate.student(float(values[0]), float(drawn.std(ddof=1)), drawn.size - 1)


def _judge(overall: dict[str, Estimate]) -> tuple[str, str]:
    ranked = sorted(overall.items(), key=lambda item: item[1].value, reverse=True)
    listed = ", ".join(f"{_WORDS[name]} {in_words(one, 100.0, '%')}" for name, one in ranked)
    first, second = ranked[0], ranked[1]
    if not (math.isfinite(first[1].low) and math.isfinite(second[1].high)):
        return CANNOT_TELL, f"The shares of D have no intervals: {listed}."
    if first[1].low > second[1].high:
        return f"mostly {_WORDS[first[0]]}", f"The largest share of D is that of {_WORDS[first[0]]}: {listed}."
    return "several losses", f"No loss has the largest share of D beyond the fit's uncertainty: {listed}."


def _trend_words(rows: list[dict[str, Cell]]) -> str:
    told = []
    for name, word in _WORDS.items():
        ends = [rows[i][name] for i in (0, -1)]
        values = [100 * one.value if isinstance(one, Estimate) else 100 * one for one in ends]
        told.append(f"{word} {values[0]:.0f} → {values[1]:.0f} %".replace("-", "−"))
    first, last = rows[0]["pretension_mm"], rows[-1]["pretension_mm"]
    return f"From {first:g} to {last:g} mm: {', '.join(told)}."


def _check(rows: list[dict[str, Cell]]) -> list[str]:
    """Return whether the fitted joint's D is the measured one."""
    off = []
    for row in rows:
        measured, model = row["lehr_damping"], row["lehr_damping_model"]
        assert isinstance(measured, Estimate)
        assert isinstance(model, Estimate)
        off.append(model.value / measured.value - 1.0)
    worst = max(off, key=abs)
    told = f"{100 * worst:+.0f} %".replace("-", "−")
    if abs(worst) > 0.15:
        return [
            f"The fitted joint's D is off the measured one by up to {told}: the shares are the model's. The recoil "
            "rests on the drive as the rig describes it, which a fit under the measured lever does not touch; the "
            "intervals hold what the rig leaves open of it."
        ]
    return [
        f"The fitted joint's D agrees with the measured one within {told.lstrip('+−')}. The recoil rests on the drive "
        "as the rig describes it; the intervals hold what the rig leaves open of it: stall torque, no-load speed, "
        "friction and armature within their intervals or else their bounds, and the supply voltage."
    ]


def _method_words(results: xr.Dataset, method: Pooled) -> str:
    damping = float(np.nanmean(results["damping_ratio"].values))
    return (
        f"The method's own part is {in_words(_mean_share(method), 100.0, '%')}: peaks and Eq. 7 against the direct "
        f"fit. Eq. 7 divides by the damped frequency, which alone makes D {50 * damping**2:.2g} % too large."
    )


def _without_words(rows: list[dict[str, Cell]]) -> str:
    words = ("the silicone's loss", "the guides' friction", "the recoil (a lever locked to the head)")
    told = []
    for name, word in zip(_OFF, words, strict=True):
        ends = [row[name] for row in (rows[0], rows[-1])]
        told.append(f"{word} " + " and ".join(f"{x:.3f}" for x in ends if not isinstance(x, Estimate)))
    model = [row["lehr_damping_model"] for row in (rows[0], rows[-1])]
    whole = " and ".join(f"{x.value:.3f}" for x in model if isinstance(x, Estimate))
    return (
        f"At the smallest and largest pretension the fitted joint's D is {whole}; without {'; without '.join(told)}. "
        "These are no shares: without a loss the joint swings at another frequency and amplitude."
    )


def _caveats(joint: JointFit) -> list[str]:
    words = [] if joint.converged else [f"The joint's fit did not converge: {joint.message}."]
    return words + [f"The fit says: {sentence}." for sentence in joint.unidentifiable[:3]]
