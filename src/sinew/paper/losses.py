"""What Lehr's damping consists of: silicone, guides, the stopped lever's recoil, sensors.

The tendon joint that was fitted to the recording swings down once more on the twin. The share of a loss is its share of
the energy that the swing loses (`energy_shares`); the sensors' is what D, read off the gyroscope by the paper's method,
changes by with perfect sensors. The fit's uncertainty, and what the rig leaves open of the drive, are carried along by
drawing the parameters.
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

from sinew.analysis.signal.motors import supply_uncertainty
from sinew.analysis.signal.repeats import Pooled, pool_repeats
from sinew.analysis.signal.signals import read_signals
from sinew.identify.joint.fit import JointFit
from sinew.measure.arrays import Array
from sinew.measure.estimate import NORMAL_90, Estimate
from sinew.measure.recording import iterate_segments
from sinew.mechanics.drive import gear_friction
from sinew.mechanics.joint import State, mechanical_energy, rate, state_at_rest
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.silicone import silicone_power
from sinew.mechanics.tendons import total_tension
from sinew.paper.answer import CANNOT_TELL, Answer, cannot_tell, in_words, rows_of
from sinew.paper.campaign import paper_damping
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
            sums = [jnp.where(counted, a, b) for a, b in zip(after[1:], now[1:], strict=True)]
            return _Spending(after.state, *sums), energy

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
    command = p.position_gain * jnp.abs(state.lever)
    within = jnp.minimum(command, p.duty_limit)
    loop = p.duty_torque * within * (command - 0.5 * within) / p.position_gain
    return jnp.asarray(mechanical_energy(state, p) + bristles + loop)


DRAWS = 12
_MOST_PRETENSIONS = 5
_ENERGY = ("silicone_share", "guide_friction_share", "recoil_share")
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
    the recording itself. Rows also hold `lehr_damping`, measured, and `lehr_damping_model`, that of the fitted joint.
    """
    if "paper_lehr_damping" not in results:
        return cannot_tell("losses", "The recording holds no ring-downs, so there is no D to divide.")
    measured, method, pretensions = _measured(results)
    each = method.estimates
    mean = pool_repeats([[one.value for one in each]], [[one.std for one in each]]).estimates[0]
    numbers = {"method_share": mean}
    if joint is None:
        why = why_not or "There is no tendon joint that was fitted to it."
        return Answer("losses", CANNOT_TELL, (f"The losses cannot be told apart. {why}",), numbers)
    places = np.linspace(0, pretensions.size - 1, min(_MOST_PRETENSIONS, pretensions.size))
    wanted = sorted({int(i) for i in places.round()})
    levels = [float(pretensions[i]) for i in wanted]
    groups = [_decay_at(recording, pretension) for pretension in levels]
    supply = recording["supply_v"].values if "supply_v" in recording else None
    rigs = [joint.fitted_rig, *_drawn(joint, supply_uncertainty(supply, joint.fitted_rig), seed)]
    hz = round(read_signals(recording).budget.sample_hz)
    model, shares = _shares(rigs, groups, hz)
    if not np.isfinite(model[0]).all():
        return Answer("losses", CANNOT_TELL, ("The fitted joint's ring-down cannot be analysed.",), numbers)
    own, modelled = [measured.estimates[i] for i in wanted], [_over_draws(column) for column in model.T]
    rows = rows_of(
        pretension_mm=levels,
        lehr_damping=own,
        lehr_damping_model=modelled,
        method_share=[method.estimates[i] for i in wanted],
        **{name: [_over_draws(column) for column in values.T] for name, values in shares.items()},
    )
    overall = {name: _over_draws(values.mean(axis=1)) for name, values in shares.items()}
    verdict, first = _judge(overall)
    return Answer("losses", verdict, (first, _check(own, modelled)), overall | numbers, rows, _ENERGY)


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


def _decay_at(recording: xr.Dataset, pretension_mm: float) -> Group:
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
        record_s = float(time[where.stop - 1] - time[where.start])
        return Group("ring-down", pretension_mm, frequency, amplitude, 0, stop, record_s)
    return Group("ring-down", pretension_mm, 3.0, 20.0, 0, 3.0, 3.0)


_QUIET = Effects().without("repeatability", "sensor_noise", "stamp_jitter")


def _shares(rigs: list[RigSpec], groups: list[Group], hz: float) -> tuple[Array, dict[str, Array]]:
    """Return the model's D, and the shares by name: of the energy, and of D with perfect sensors; (1 + draws, p)."""
    alone = [lane_parameters(groups, rig, effects=_QUIET) for rig in rigs]
    lanes = jax.tree.map(lambda *leaves: np.concatenate(leaves), *alone)
    decays = groups * len(rigs)
    spent = energy_shares(lanes, decays).reshape(len(rigs), len(groups), len(_ENERGY))
    spent = spent / spent.sum(axis=2, keepdims=True)
    tracks = simulate_tracks(lanes, decays, hz)
    found = [
        [
            paper_damping(track, group, rigs[k // len(groups)], effects, hz)
            for k, (track, group) in enumerate(zip(tracks, decays, strict=True))
        ]
        for effects in (_QUIET, _QUIET.without("sensor_filter"))
    ]
    model, perfect = np.array(found).reshape(2, len(rigs), len(groups))
    return model, {name: spent[:, :, k] for k, name in enumerate(_ENERGY)} | {_SENSORS: 1.0 - perfect / model}


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


def _check(measured: list[Estimate], modelled: list[Estimate]) -> str:
    """Return whether the fitted joint's D is the measured one."""
    worst = max((model.value / own.value - 1.0 for own, model in zip(measured, modelled, strict=True)), key=abs)
    error = f"{100 * worst:+.0f} %".replace("-", "−")
    is_off = f"is off the measured one by up to {error}: the shares are the model's"
    agrees = f"agrees with the measured one within {error.lstrip('+−')}"
    return (
        f"The fitted joint's D {is_off if abs(worst) > 0.15 else agrees}. The recoil rests on the drive as the rig "
        "describes it; the intervals hold what the rig leaves open of it and of the supply voltage."
    )
