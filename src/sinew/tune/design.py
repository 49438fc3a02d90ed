"""Design of a joint: search, exact evaluation, front, distinct proposals, confirmation on the twin."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sinew.analysis.analysed import analyse_recording
from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import SpecError
from sinew.measure.estimate import Estimate
from sinew.measure.result import Field, Result, Rows
from sinew.measure.tasks import HERE, Spread, run_tasks
from sinew.plan.plan import Plan, Pretension, Sweep
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_rig, load_rig, parse_rig
from sinew.predict.design import Design, design_rig, list_materials, load_material, shear_modulus_of
from sinew.predict.joint import joint_problem
from sinew.predict.validity import Check, check_joint, loads_of
from sinew.solve.programs import configure, program
from sinew.tune.candidate import (
    GUIDE,
    LIMITS,
    OBJECTIVES,
    SHAPES,
    SIZES,
    DesignTarget,
    DriveLoad,
    Frame,
    drive_load,
    frame_of,
    judge,
    unpacked,
)
from sinew.tune.pretension import Resonance, Swing, find_resonances, resonances_at, stresses_of
from sinew.twin.simulate import simulate

# ---- a candidate as a rig that could be built, computed by harmonic balance, with a plan


_ROUNDS, _HZ_CLOSE, _YAW_CLOSE = 8, 2e-4, 3e-3
_BAND, _SERVO_DEG = (0.75, 1.2), 0.5
_AROUND = (-0.12, -0.08, -0.05, -0.03, -0.015, 0.0, 0.015, 0.03, 0.05, 0.08, 0.12)
_SETTLED = 3.5
_LONGEST_SETTLE = 90.0
_WINDOW_MM = 2.0


class Draft(NamedTuple):
    """A candidate as the search left it. sizes: see `sinew.tune.candidate.SIZES`; pretension [m] and lever [rad] at
    both ends of the band. rig: text of the base."""

    rig: str
    target: DesignTarget
    shape: str
    material: str
    sizes: tuple[float, ...]
    pretension: tuple[float, float]
    lever: tuple[float, float]


@dataclass(frozen=True, repr=False)
class ProposalEnd(Result):
    """A proposal at one end of the band, where the torsion has the wanted amplitude: resonance and load of the drive.

    command_deg, lever_deg: amplitudes. damping_ratio: D, from the lever's amplitude. rest_tension_n, tension_n: of a
    tendon at rest, and the largest. torque_n_m, speed_rad_s, duty, current_a: of the drive, largest; work_j, energy_j:
    mechanical and electrical, in a cycle.
    """

    wanted_hz: Annotated[float, Field("stride")]
    frequency_hz: Annotated[float, Field("", "detail")]
    pretension_mm: Annotated[float, Field("pretension")]
    command_deg: Annotated[float, Field("command")]
    lever_deg: Annotated[float, Field("", "detail")]
    torsion_deg: Annotated[float, Field("yaw")]
    damping_ratio: Annotated[float, Field("D")]
    rest_tension_n: Annotated[float, Field("", "detail")]
    tension_n: Annotated[float, Field("tension")]
    torque_n_m: Annotated[float, Field("", "detail")]
    speed_rad_s: Annotated[float, Field("", "detail")]
    duty: Annotated[float, Field("", "detail")]
    current_a: Annotated[float, Field("drive's current")]
    work_j: Annotated[float, Field("", "detail")]
    energy_j: Annotated[float, Field("", "detail")]


@dataclass(frozen=True, repr=False)
class Confirmed(Result):
    """One end of the band on the full twin. predicted_hz, measured_hz: 90° of lag behind the measured lever, at the
    plan's command; peak_hz: of the measured gain. yaw_deg: half of peak to peak at that peak. error: share by which
    measured is off."""

    pretension_mm: Annotated[float, Field("pretension")]
    predicted_hz: Annotated[float, Field("predicted")]
    measured_hz: Annotated[Estimate, Field("on the twin")]
    peak_hz: Annotated[Estimate, Field("peak")]
    yaw_deg: Annotated[float, Field("yaw")]
    error: Annotated[float, Field("off by", unit="%")]


@dataclass(frozen=True, repr=False)
class Proposal(Result):
    """A joint that could be built, as it was computed exactly.

    faults: sentences on limits that are broken; a feasible one has none. on_front: whether it is feasible and not
    dominated. energy_j: electrical, of the drive in a cycle, mean of both ends. volume_cm3: of the cylinder around
    joint and guides; diameter_mm, envelope_length_mm: of it. tension_n: of a tendon at the upper end; holding_a:
    current of a tendon motor there, if its gear held nothing. pretension_mm: at both ends. confirmed: by the full twin,
    None of one that is not proposed; error: there, a share. rig: of it.
    """

    name: Annotated[str, Field("proposal")]
    shape: Annotated[str, Field("", "detail")]
    material: Annotated[str, Field("", "detail")]
    feasible: Annotated[bool, Field("", "detail")]
    faults: Annotated[tuple[str, ...], Field("", "detail")]
    pretension_mm: Annotated[tuple[float, float], Field("pretension")]
    length_mm: Annotated[float, Field("", "detail")]
    tendon_circle_mm: Annotated[float, Field("circle")]
    lever_inertia_kg_m2: Annotated[float, Field("lever")]
    diameter_mm: Annotated[float, Field("diameter")]
    envelope_length_mm: Annotated[float, Field("length")]
    volume_cm3: Annotated[float, Field("", "detail")]
    energy_j: Annotated[float, Field("energy")]
    tension_n: Annotated[float, Field("tension")]
    holding_a: Annotated[float, Field("", "detail")]
    ends: Annotated[Rows[ProposalEnd], Field("both ends of the band")]
    validity: Annotated[tuple[Mapping[str, str | float | None], ...], Field("", "detail")]
    draft: Draft
    rig: RigSpec
    checks: tuple[Check, ...]
    on_front: Annotated[bool, Field("", "detail")] = False
    confirmed: Annotated[Rows[Confirmed] | None, Field("both ends on the full twin")] = None
    error: Annotated[tuple[float, ...] | None, Field("off on the twin", unit="%")] = None
    is_confirmed: Annotated[bool | None, Field("", "detail")] = None

    def heading(self) -> str:
        """Return its name."""
        return self.name

    @property
    def objectives(self) -> tuple[float, float, float]:
        """Return energy, volume and tension, as the search trades them."""
        return self.energy_j, self.volume_cm3, self.tension_n


def propose(draft: Draft) -> Proposal | None:
    """Return the rig of a candidate, rounded to what can be made, with its exact resonances; None where it has none.

    Section to half a millimetre, length to one, circle of guides to half, lever to 1e-4 kg m². The pretensions at both
    ends of the band are found anew.
    """
    configure()
    rig = _rig(draft)
    ends = _ends(rig, draft)
    if ends is None:
        return None
    target = draft.target
    rig = _with_window(rig, ends[1].pretension_mm)
    loads = [drive_load(rig, one.frequency_hz, one.lever, one.torsion) for one in ends]
    pretensions = [one.pretension_mm for one in ends]
    problem = joint_problem(rig, pretensions, [math.degrees(one.command) for one in ends], target.stride_band_hz)
    at_yaw = loads_of(problem, np.array([one.torsion for one in ends]))
    checks = check_joint(rig, pretensions, at_yaw, tilt_held=True, torso=target.torso)
    faults = _faults(rig, target, ends, loads, checks)
    diameter = max(rig.silicone.diameter.value, 2 * (rig.tendons.head_radius.value + GUIDE))
    return Proposal(
        name=rig.name,
        shape=draft.shape,
        material=draft.material,
        feasible=not faults,
        faults=tuple(faults),
        pretension_mm=(pretensions[0], pretensions[1]),
        length_mm=1e3 * rig.silicone.length.value,
        tendon_circle_mm=1e3 * rig.tendons.head_radius.value,
        lever_inertia_kg_m2=rig.inertia.lever.value,
        diameter_mm=1e3 * diameter,
        envelope_length_mm=1e3 * rig.tendons.free_span.value,
        volume_cm3=1e6 * (math.pi / 4 * diameter**2 * rig.tendons.free_span.value),
        energy_j=0.5 * (loads[0].energy + loads[1].energy),
        tension_n=ends[1].tension,
        holding_a=rig.tendons.current(ends[1].rest_tension),
        ends=Rows(map(_end, target.stride_band_hz, ends, loads, [rig, rig])),
        validity=tuple(check.to_dict() for check in checks),
        draft=draft,
        rig=rig,
        checks=tuple(checks),
    )


def _end(wanted_hz: float, one: Resonance, load: DriveLoad, rig: RigSpec) -> ProposalEnd:
    share = rig.inertia.lever.value / (rig.inertia.head.value + rig.inertia.lever.value)
    return ProposalEnd(
        wanted_hz=wanted_hz,
        frequency_hz=one.frequency_hz,
        pretension_mm=one.pretension_mm,
        command_deg=math.degrees(one.command),
        lever_deg=math.degrees(abs(one.lever)),
        torsion_deg=math.degrees(one.torsion),
        damping_ratio=0.5 * share * abs(one.lever) / one.torsion,
        rest_tension_n=one.rest_tension,
        tension_n=one.tension,
        torque_n_m=load.torque,
        speed_rad_s=load.speed,
        duty=load.duty,
        current_a=load.current,
        work_j=load.work,
        energy_j=load.energy,
    )


def _rig(draft: Draft) -> RigSpec:
    size, ratio, length, circle, lever = draft.sizes
    known = draft.material in list_materials()
    section = SHAPES[draft.shape].section(size, ratio)
    length_mm = round(1e3 * length)
    base = parse_rig(draft.rig)
    torso, space = draft.target.torso, base.space
    design = Design(
        section=section,
        length=1e-3 * length_mm,
        material=load_material(draft.material) if known else None,
        tendon_circle=round(2e3 * circle) / 2e3,
        head_inertia=draft.target.inertia_kg_m2,
        lever_inertia=round(lever, 4),
        head_mass=None if torso is None else torso.mass + (space.lever_mass.value if space else 0.0),
        head_height=torso.centre if torso is not None and space else None,
        name=f"{section.shape}, {length_mm} mm, {draft.material}",
    )
    return design_rig(base, design)


def _with_window(rig: RigSpec, highest_mm: float) -> RigSpec:
    """Return the rig with a window of pretensions up to a little above the highest that it needs."""
    window = (0.0, float(math.ceil(highest_mm + _WINDOW_MM)))
    return rig.model_copy(update={"limits": rig.limits.model_copy(update={"pretension_mm": window})})


def _ends(rig: RigSpec, draft: Draft) -> tuple[Resonance, Resonance] | None:
    """Return the resonances at both ends of the band, by secants in pretension and command together; None where one
    is lost."""
    wanted, yaw = np.asarray(draft.target.stride_band_hz), math.radians(draft.target.yaw_deg)
    where = np.maximum(1e3 * np.asarray(draft.pretension), 0.0)
    slope = (wanted[1] - wanted[0]) / max(where[1] - where[0], 1e-3)
    commands = np.degrees(np.asarray(draft.lever)) + _SERVO_DEG
    before: tuple[NDArray[np.float64], NDArray[np.float64]] = (np.zeros(2), np.zeros(2))
    band = _BAND[0] * wanted[0], _BAND[1] * wanted[1]
    ends = None
    for _ in range(_ROUNDS):
        low, high = resonances_at(rig, where, commands, band)
        if low is None or high is None:
            return None
        ends = low, high
        now, torsion = (np.array([getattr(one, name) for one in ends]) for name in ("frequency_hz", "torsion"))
        if np.all(np.abs(now / wanted - 1) < _HZ_CLOSE) and np.all(np.abs(torsion / yaw - 1) < _YAW_CLOSE):
            break
        if now[1] > now[0] and where[1] > where[0]:
            slope = (now[1] - now[0]) / (where[1] - where[0])
        rise = np.divide(torsion - before[1], commands - before[0], out=np.zeros(2), where=commands != before[0])
        rise = np.where(rise > 0.2 * torsion / commands, rise, torsion / commands)
        before = commands, torsion
        commands = np.clip(commands + (yaw - torsion) / rise, 0.25 * commands, 4 * commands)
        where = np.maximum(where + (wanted - now) / slope, 0.0)
    return ends


def _faults(
    rig: RigSpec, target: DesignTarget, ends: tuple[Resonance, Resonance], loads: list[DriveLoad], checks: list[Check]
) -> list[str]:
    lines = [check.sentence for check in checks if not check.holds]
    swing = Swing(yaw_deg=target.yaw_deg)
    for one, load, wanted in zip(ends, loads, target.stride_band_hz, strict=True):
        lines += [s.sentence for s in stresses_of(rig, one, swing) if s.share > 1 and s.sentence not in lines]
        if abs(one.frequency_hz / wanted - 1) > 1e-3:
            lines.append(f"it resonates at {one.frequency_hz:.4g} Hz where {wanted:g} Hz is wanted")
        if load.duty > rig.drive.duty_limit.value:
            lines.append(
                f"the drive needs a duty of {load.duty:.2f} at {wanted:g} Hz, {rig.drive.duty_limit.value:g} is all"
            )
    if ends[1].pretension_mm > rig.limits.tendon_travel_mm[1]:
        lines.append(
            f"it needs {ends[1].pretension_mm:.1f} mm of cable, motors have {rig.limits.tendon_travel_mm[1]:g} mm"
        )
    return lines


def plan_of(proposal: Proposal) -> Plan:
    """Return the plan that would test a proposal: at both pretensions a stepped sweep around both ends of the band.

    The command's amplitude is the larger of the two that the yaw needs. The drive runs until 3 % of the transient is
    left. Raises SpecError where the clusters of frequencies do not make a plan.
    """
    target = proposal.draft.target
    amplitude = max(one.command_deg for one in proposal.ends)
    frequency = sorted({round(end * (1 + off), 4) for end in target.stride_band_hz for off in _AROUND})
    if len(frequency) < len(_AROUND):
        raise SpecError("the band's ends are too close for a plan; widen the band")
    slowest = min(one.damping_ratio * 2 * math.pi * one.wanted_hz for one in proposal.ends)
    settle = min(_LONGEST_SETTLE, math.ceil(_SETTLED / slowest))
    return Plan(
        name=f"test of {proposal.rig.name}",
        pretension=Pretension(pretension_mm=tuple(round(mm, 3) for mm in proposal.pretension_mm)),
        sweep=Sweep(
            frequency_hz=tuple(frequency), amplitude_deg=round(amplitude, 2), settle_s=settle, periods=5, repeats=3
        ),
    )


_STEPS = 240
_RATE, _LAST_RATE = 0.05, 0.003
_PENALTY = (3.0, 300.0)
_INSIDE = 0.004
_ROOM = 4.0
_WALL, _EDGE = 1e-3, 8.0
_CLOSE = 1e-6


class Block(NamedTuple):
    """What one worker does. rig: text of the base. target: what is designed for. shape: its name. material: name of the
    silicone, modulus: its G [Pa]. starts: how many. seed, number: of the random starts."""

    rig: str
    target: DesignTarget
    shape: str
    material: str
    modulus: float
    starts: int
    seed: int
    number: int


class Candidates(NamedTuple):
    """Candidates of a block, n of them, whether feasible or not. sizes: (n, 5), see `SIZES`; objectives: (n, 3), see
    `OBJECTIVES`; pretension [m] and lever's amplitude [rad] at both ends of the band, (n, 2). excess: the largest, and
    binding: of which of `LIMITS`, (n,)."""

    shape: str
    material: str
    modulus: float
    sizes: Array
    objectives: Array
    pretension: Array
    lever: Array
    feasible: Mask
    excess: Array
    binding: NDArray[np.int64]


def blocks_of(
    text: str, target: DesignTarget, silicones: dict[str, float], shapes: list[str], starts: int, seed: int
) -> list[Block]:
    """Return the blocks of a search, one for each shape and silicone (name: G [Pa]). text: of the base rig."""
    pairs = [(shape, name) for shape in shapes for name in silicones]
    return [
        Block(text, target, shape, name, silicones[name], starts, seed, number)
        for number, (shape, name) in enumerate(pairs)
    ]


@program()
def _search(logits: jax.Array, weights: jax.Array, modulus: jax.Array, frame: Frame) -> tuple[jax.Array, ...]:
    """Search by Adam from logits (n, 5) of places in the unit cube, by weights (n, 3), and return sizes (n, 5),
    objectives, excess, pretension and lever of the candidates that it ends at. modulus: G [Pa]."""

    def loss(logit: jax.Array, weights: jax.Array, share: jax.Array) -> jax.Array:
        judged = judge(jax.nn.sigmoid(logit), modulus, frame)
        over = jnp.clip(judged.excess + _INSIDE, 0.0, _ROOM)
        penalty = _PENALTY[0] * (_PENALTY[1] / _PENALTY[0]) ** share
        wall = _WALL * jnp.sum(logit**2)
        return weights @ jnp.log(judged.objectives) + penalty * jnp.sum(over + over**2) + wall

    slope = jax.vmap(jax.grad(loss), in_axes=(0, 0, None))

    def step(i: jax.Array, state: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
        x, mean, square = state
        share = i / (_STEPS - 1)
        g = jnp.nan_to_num(slope(x, weights, share))
        g = g / jnp.maximum(1.0, jnp.linalg.norm(g, axis=1, keepdims=True))
        mean, square = 0.9 * mean + 0.1 * g, 0.99 * square + 0.01 * g**2
        hat, spread = mean / (1 - 0.9 ** (i + 1.0)), square / (1 - 0.99 ** (i + 1.0))
        rate = _RATE * (_LAST_RATE / _RATE) ** share
        return jnp.clip(x - rate * hat / (jnp.sqrt(spread) + 1e-8), -_EDGE, _EDGE), mean, square

    none = jnp.zeros_like(logits)
    places = jax.nn.sigmoid(jax.lax.fori_loop(0, _STEPS, step, (logits, none, none))[0])
    found = jax.vmap(judge, in_axes=(0, None, None))(places, modulus, frame)
    sizes = jnp.stack(jax.vmap(unpacked, in_axes=(0, None))(places, frame), axis=1)
    return sizes, found.objectives, found.excess, found.pretension, found.lever


def search_block(block: Block) -> Candidates:
    """Return the improved candidates of a block."""
    configure()
    rig = parse_rig(block.rig)
    frame = frame_of(rig, block.target, block.shape)
    rng = np.random.default_rng([block.seed, block.number])
    seeds = rng.uniform(0.05, 0.95, (block.starts, len(SIZES)))
    weights = rng.dirichlet(np.ones(len(OBJECTIVES)), block.starts)
    done = _search(np.log(seeds / (1 - seeds)), weights, block.modulus, frame)
    sizes, objectives, excess, pretension, lever = (np.asarray(leaf) for leaf in done)
    excess = np.nan_to_num(excess, nan=np.inf, posinf=np.inf)
    worst, binding = excess.max(axis=1), excess.argmax(axis=1)
    feasible = (worst <= _CLOSE) & np.isfinite(objectives).all(axis=1)
    return Candidates(
        block.shape, block.material, block.modulus, sizes, objectives, pretension, lever, feasible, worst, binding
    )


# A proposal is run on the full twin, and what comes out is held against what was predicted of it.

ENOUGH = 0.03
"""Share by which the twin's resonance may be off the predicted one."""


class Request(NamedTuple):
    """A proposal to confirm, and the seed of the twin's scatter and noise."""

    proposal: Proposal
    seed: int


def confirm(request: Request) -> Rows[Confirmed]:
    """Return what the full twin, with sensors, scatter and noise, says of a proposal at both ends of the band.

    Its plan runs with one repeat; the recording is analysed as one of a bench would be.
    """
    configure()
    proposal, seed = request
    plan = plan_of(proposal)
    assert plan.sweep is not None
    plan = plan.model_copy(update={"sweep": plan.sweep.model_copy(update={"repeats": 1})})
    assert plan.sweep is not None
    results = analyse_recording(simulate(plan, proposal.rig, seed=seed), proposal.rig)
    swing = Swing(command_deg=plan.sweep.amplitude_deg)
    pretensions = plan.pretension.pretension_mm
    band = 0.75 * plan.sweep.frequency_hz[0], 1.2 * plan.sweep.frequency_hz[-1]
    predicted = find_resonances(proposal.rig, pretensions, swing, band_hz=band)
    ends = []
    for i, (mm, one) in enumerate(zip(pretensions, predicted, strict=True)):
        at = results.isel(pretension_mm=i)
        measured, peak = (_estimate(at, name) for name in ("phase_90_hz", "resonance_hz"))
        wanted = math.nan if one is None else one.frequency_hz
        yaw = float(at["gain_peak"]) * plan.sweep.amplitude_deg
        ends.append(Confirmed(mm, wanted, measured, peak, yaw, measured.value / wanted - 1))
    return Rows(ends)


def _estimate(at: xr.Dataset, name: str) -> Estimate:
    stem = name.removesuffix("_hz")
    return Estimate(*(float(at[key]) for key in (name, f"{stem}_std_hz", f"{stem}_low_hz", f"{stem}_high_hz")))


# Candidates are compared in several objectives: who is dominated, and which few stand for the rest.


def nondominated(objectives: Array) -> Mask:
    """Return which rows (n, k) no other row is at least as small as in every objective and smaller in one, (n,).

    Of equal rows the first stays.
    """
    undominated = np.ones(len(objectives), dtype=bool)
    for i, row in enumerate(objectives):
        less = np.all(objectives <= row, axis=1)
        smaller = np.any(objectives < row, axis=1) | (np.arange(len(objectives)) < i)
        undominated[i] = not np.any(less & smaller)
    return undominated


def spread_out(objectives: Array, count: int, begin: Sequence[int] = ()) -> list[int]:
    """Return at most `count` rows (n, k) that lie far apart in the logarithms of the objectives, in order of choice.

    begin: rows that are taken first. Then comes the row that is best in all together, and after it always the one
    that is farthest from those that were taken.
    """
    if not len(objectives):
        return []
    seeds = np.log(objectives)
    seeds = (seeds - seeds.min(axis=0)) / np.maximum(np.ptp(seeds, axis=0), 1e-12)
    taken = list(begin) or [int(np.argmin(seeds.sum(axis=1)))]
    apart = np.min([np.linalg.norm(seeds - seeds[i], axis=1) for i in taken], axis=0)
    while len(taken) < min(count, len(objectives)):
        best = int(np.argmax(apart))
        if apart[best] <= 0:
            break
        taken.append(best)
        apart = np.minimum(apart, np.linalg.norm(seeds - seeds[best], axis=1))
    return taken[:count]


_OTHER_LENGTH = 1.5


@dataclass(frozen=True, repr=False)
class Effort(Result):
    """How much is done. starts: of the search, in each block of a shape and a silicone. exact: candidates that are
    computed by harmonic balance. proposals: at most. seed: of starts and twin."""

    starts: Annotated[int, Field("", "detail")] = 64
    exact: Annotated[int, Field("", "detail")] = 24
    proposals: Annotated[int, Field("", "detail")] = 4
    seed: Annotated[int, Field("", "detail")] = 0


@dataclass(frozen=True, repr=False)
class Failed(Result):
    """A candidate of the search that breaks a limit. limit: the one it breaks most; excess: by what share of it."""

    shape: Annotated[str, Field("shape")]
    material: Annotated[str, Field("silicone")]
    limit: Annotated[str, Field("limit")]
    excess: Annotated[float, Field("exceeded by", unit="%")]


def nearest_failures(found: Sequence[Candidates]) -> tuple[Failed, ...]:
    """Return of each shape and silicone the candidate that breaks its limits least, the nearest first; those that break
    none are left out."""
    names, failed = list(LIMITS), []
    for one in found:
        i = int(np.argmin(one.excess))
        if not one.feasible[i]:
            failed.append(Failed(one.shape, one.material, names[one.binding[i]], float(one.excess[i])))
    return tuple(sorted(failed, key=lambda row: row.excess))


@dataclass(frozen=True, repr=False)
class Designed(Result):
    """What came of it. base: name of the rig that it began with; target, effort: what was asked for. assumptions: what
    is taken for granted of the torso. candidates, feasible: of the search, numbers. failed: of the search, where none
    is feasible, see `nearest_failures`. evaluated: exactly computed ones that have resonances. proposals: those of them
    that the twin ran. wall_s: of the parts."""

    base: Annotated[str, Field("", "detail")]
    target: Annotated[DesignTarget, Field("", "detail")]
    assumptions: Annotated[tuple[str, ...], Field("", "detail")]
    effort: Annotated[Effort, Field("", "detail")]
    candidates: Annotated[int, Field("", "detail")]
    feasible: Annotated[int, Field("", "detail")]
    failed: Annotated[Rows[Failed], Field("", "detail")]
    evaluated: Annotated[Rows[Proposal], Field("", "detail")]
    proposals: Annotated[Rows[Proposal], Field("")]
    wall_s: Annotated[Mapping[str, float], Field("", "detail")]
    sentences: Annotated[tuple[str, ...], Field("", "detail")] = ()

    def closing(self) -> list[str]:
        """Return what to know of the search."""
        return [f"- {sentence}" for sentence in self.sentences]


def design(
    stride_hz: tuple[float, float],
    yaw_deg: float,
    rig: RigSpec | str | Path = "paper",
    *,
    inertia_kg_m2: float = 0.25,
    torso_kg: float | None = None,
    torso_centre_mm: float = 250.0,
    envelope_mm: tuple[float, float] = (200.0, 250.0),
    shapes: Sequence[str] | None = None,
    materials: Sequence[str] | None = None,
    starts: int = 64,
    exact: int = 24,
    proposals: int = 4,
    seed: int = 0,
    spread: Spread = HERE,
    progress: Callable[[str, float, float], None] | None = None,
) -> Designed:
    """Return joints whose resonance can follow a gait: section, silicone, length, tendon circle, lever, pretensions.

    stride_hz: lowest and highest stride frequency to resonate at [Hz]. yaw_deg: amplitude of the torsion there.
    rig: whose motors, guides and sensors are kept. inertia_kg_m2: of what sits on the joint, about its axis. torso_kg,
    torso_centre_mm: its mass and the height of its centre above the head plate; without a mass its weight is left out.
    envelope_mm: largest diameter and length, guides included. shapes, materials: by name, where not all are to be
    tried; "base" is the rig's silicone. starts, exact, proposals, seed: see `Effort`. spread: over which processes or
    cluster, with the same result. progress: called with (part, done, total).
    It takes minutes, with few starts and shapes seconds. No joint within the limits is no error: the answer says so.
    Raises SpecError where a number cannot be meant.

    >>> import sinew as sn
    >>> found = sn.design((0.7, 1.1), 7, shapes=["circle"], starts=8, exact=2, proposals=1)  # doctest: +SKIP
    >>> found.proposals[0].is_confirmed  # doctest: +SKIP
    """
    base = rig if isinstance(rig, RigSpec) else load_rig(rig)
    centre_mm = None if torso_kg is None else torso_centre_mm
    target = DesignTarget(stride_hz, yaw_deg, inertia_kg_m2, envelope_mm, torso_kg, centre_mm)
    effort = Effort(starts, exact, proposals, seed)
    silicones = known_silicones(base, materials)
    return design_joints(base, target, silicones, known_shapes(shapes), effort, spread=spread, progress=progress)


def known_shapes(wanted: Sequence[str] | None) -> list[str]:
    """Return the names of sections, all where none is named. Raises SpecError for an unknown one."""
    for name in wanted or ():
        if name not in SHAPES:
            raise SpecError(f"found the section {name!r}, expected some of {', '.join(SHAPES)}")
    return list(SHAPES if wanted is None else wanted)


def known_silicones(base: RigSpec, wanted: Sequence[str] | None) -> dict[str, float]:
    """Return name and shear modulus [Pa] of each silicone that may be used."""
    names = ["base", *list_materials()] if wanted is None else wanted
    others = [load_material(name) for name in names if name != "base"]
    own = {"base": shear_modulus_of(base)} if "base" in names else {}
    return own | {one.name: one.shear_modulus_pa.value for one in others}


def design_joints(
    rig: RigSpec,
    target: DesignTarget,
    silicones: dict[str, float],
    shapes: Sequence[str],
    effort: Effort,
    *,
    spread: Spread = HERE,
    progress: Callable[[str, float, float], None] | None = None,
) -> Designed:
    """Return proposals for a target, from a base rig whose motors, guides, sensors and loss factor are kept.

    silicones: name and G [Pa]; a name that is no known material stands for the base's. spread: over which processes
    or cluster; the result is the same. progress: called with (part, done, total).
    """

    def lines(part: str) -> Callable[[float, float], None]:
        return lambda done, total: None if progress is None else progress(part, done, total)

    text, begin = dump_rig(rig), time.perf_counter()
    blocks = blocks_of(text, target, silicones, list(shapes), effort.starts, effort.seed)
    found = run_tasks(search_block, blocks, spread, lines("search"))
    searched = time.perf_counter()
    drafts = drafts_of(found, text, target, effort.exact)
    evaluated = [one for one in run_tasks(propose, drafts, spread, lines("evaluate")) if one is not None]
    evaluated, chosen = select(evaluated, effort.proposals)
    computed = time.perf_counter()
    confirmed = run_tasks(confirm, [Request(one, effort.seed) for one in chosen], spread, lines("confirm"))
    wall_s = {"search": searched - begin, "exact": computed - searched, "confirm": time.perf_counter() - computed}
    made = Designed(
        base=rig.name,
        target=target,
        assumptions=assumptions(target),
        effort=effort,
        candidates=sum(len(one.sizes) for one in found),
        feasible=int(sum(one.feasible.sum() for one in found)),
        failed=Rows(() if drafts else nearest_failures(found)),
        evaluated=Rows(evaluated),
        proposals=Rows(map(_confirmed, chosen, confirmed)),
        wall_s=wall_s,
    )
    return replace(made, sentences=(*_sentences(made), *made.assumptions))


def _confirmed(one: Proposal, confirmed: Rows[Confirmed]) -> Proposal:
    error = tuple(end.error for end in confirmed)
    sure = all(abs(share) <= ENOUGH for share in error)
    return replace(one, confirmed=confirmed, error=error, is_confirmed=sure)


def drafts_of(found: Sequence[Candidates], text: str, target: DesignTarget, count: int) -> list[Draft]:
    """Return at most `count` candidates for exact evaluation: of each shape those that are not dominated by another of
    that shape, as far apart as may be."""
    shapes = list(dict.fromkeys(one.shape for one in found))
    drafts = []
    for shape in shapes:
        own = [one for one in found if one.shape == shape and one.feasible.any()]
        rows = [(one, i) for one in own for i in np.flatnonzero(one.feasible)]
        if not rows:
            continue
        objectives = np.array([one.objectives[i] for one, i in rows])
        best = np.flatnonzero(nondominated(objectives))
        for pick in spread_out(objectives[best], -(-count // len(shapes))):
            one, i = rows[best[pick]]
            pretension, lever = (tuple(row[i].tolist()) for row in (one.pretension, one.lever))
            drafts.append(Draft(text, target, shape, one.material, tuple(one.sizes[i].tolist()), pretension, lever))
    return drafts


def select(evaluated: Sequence[Proposal], count: int) -> tuple[list[Proposal], list[Proposal]]:
    """Return (all, those on the front marked; at most `count` distinct ones of them to propose).

    Distinct: another shape, another silicone, or a length that differs by half. The front's come first, then others
    that are feasible; in each those that are far apart in the objectives.
    """
    every = list(evaluated)
    fit = [i for i, one in enumerate(every) if one.feasible]
    if not fit:
        return every, []
    objectives = np.array([every[i].objectives for i in fit])
    best = np.flatnonzero(nondominated(objectives))
    order = [fit[k] for k in best[spread_out(objectives[best], len(fit))]]
    for i in order:
        every[i] = replace(every[i], on_front=True)
    order += [fit[k] for k in spread_out(objectives, len(fit)) if fit[k] not in order]
    chosen: list[Proposal] = []
    for i in order:
        if len(chosen) < count and not any(_alike(every[i], one) for one in chosen):
            chosen.append(every[i])
    return every, chosen


def _alike(a: Proposal, b: Proposal) -> bool:
    lengths = sorted((a.length_mm, b.length_mm))
    same = (a.shape, a.material) == (b.shape, b.material)
    return same and lengths[1] < _OTHER_LENGTH * lengths[0]


def assumptions(target: DesignTarget) -> tuple[str, ...]:
    """Return what is taken for granted of the torso, a sentence each."""
    if target.torso is None:
        return (
            "assumed: nothing presses on the joint but its tendons; the weight of what sits on it is left out, for no "
            "mass was given. Give it (torso-kg), and buckling, strain, tension and tipping are checked under it. "
            "The rigs keep the mass and height of the base's head, so their sways are not the torso's",
        )
    torso = target.torso
    return (
        f"assumed: {torso.mass:g} kg stand upright on the joint with their centre {1e3 * torso.centre:g} mm above the "
        f"head plate and press with {torso.weight:.0f} N; pretension counts from the first contact under that weight, "
        "the torso held upright; the head tilts no further than the rig allows; the swing's resonance is that without "
        "weight. The rigs get its mass, beside the lever's, the height of its centre and its moments of inertia, those "
        "across the axis as of a cylinder that stands on the plate",
    )


_SHOWN = 6  # candidates without a proposal


def _why_none(found: Designed) -> list[str]:
    """Return sentences on the limit that binds each of the nearest candidates, and on what helps with it."""
    computed = sorted((one for one in found.evaluated if one.faults), key=lambda one: len(one.faults))[:_SHOWN]
    if computed:
        return [
            f"none of the {len(computed)} best that were computed exactly passed; of each, what is exceeded:",
            *(f"{one.name}: {'; '.join(one.faults)}" for one in computed),
        ]
    shown = found.failed[:_SHOWN]
    if not shown:
        return ["none of them has both resonances by harmonic balance; allow a narrower band or another silicone"]
    limits = dict.fromkeys(one.limit for one in shown)
    return [
        "no candidate passed; of the best, the limit that each breaks most, and by how much of it:",
        *(f"{one.shape} of {one.material}: {one.limit}, {100 * one.excess:.3g} %" for one in shown),
        *(f"for {limit}: {LIMITS[limit]}" for limit in limits),
    ]


def _sentences(found: Designed) -> list[str]:
    lines = [f"{found.feasible} of {found.candidates} candidates of the search keep every limit"]
    fit, front = (sum(getattr(one, name) for one in found.evaluated) for name in ("feasible", "on_front"))
    if found.evaluated:
        lines.append(f"{fit} of {len(found.evaluated)} that were computed exactly do, {front} undominated")
    if not found.proposals:
        return [*lines, *_why_none(found)]
    sure, many = sum(bool(one.is_confirmed) for one in found.proposals), len(found.proposals)
    lines.append(f"{sure} of {many} proposals resonate on the full twin within 3 % of what was predicted")
    held = max(one.holding_a for one in found.proposals)
    lines.append(
        f"holding the tendons takes up to {held:.2f} A of each tendon motor if its gear holds nothing; that is not in "
        "the drive's energy"
    )
    return lines
