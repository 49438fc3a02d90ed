"""Design of a joint: search, exact evaluation, front, distinct proposals, confirmation on the twin."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sinew.analysis.analysed import analyse_recording
from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import SpecError
from sinew.measure.estimate import Estimate, finite, number
from sinew.measure.tasks import HERE, Spread, run_tasks
from sinew.measure.told import Table, Told
from sinew.plan.plan import Plan, Pretension, Sweep
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_rig, load_rig, parse_rig
from sinew.predict.joint import joint_problem
from sinew.predict.joints.design import Design, design_rig, moment_across, section_of, shear_modulus_of
from sinew.predict.joints.material import list_materials, load_material
from sinew.predict.joints.validity import Check, Torso, check_joint, loads_of
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


@dataclass(frozen=True)
class Proposal:
    """A joint that could be built. ends: its resonance at the lower and the upper end of the band, with the yaw; loads:
    of the drive there. damping_ratio: D there, from the lever's amplitude at resonance.

    energy: electrical, of the drive in a cycle, mean of both ends [J]. volume: of the cylinder around joint and guides
    [m³]; diameter, length: of it [m]. tension: of a tendon at the upper end [N]. holding_a: current of a tendon motor
    there, if its gear held nothing [A]. checks: of the prediction. faults: sentences on limits that are broken; a
    proposal without is feasible.
    """

    draft: Draft
    rig: RigSpec
    ends: tuple[Resonance, Resonance]
    loads: tuple[DriveLoad, DriveLoad]
    damping_ratio: tuple[float, float]
    diameter: float
    length: float
    checks: tuple[Check, ...]
    faults: tuple[str, ...]

    @property
    def energy(self) -> float:
        """Return the drive's electrical energy in a cycle, mean of both ends of the band [J]."""
        return 0.5 * (self.loads[0].energy + self.loads[1].energy)

    @property
    def volume(self) -> float:
        """Return the volume of the cylinder around joint and guides [m³]."""
        return math.pi / 4 * self.diameter**2 * self.length

    @property
    def tension(self) -> float:
        """Return the largest tension of a tendon, at the upper end of the band [N]."""
        return self.ends[1].tension

    @property
    def holding_a(self) -> float:
        """Return the current of a tendon motor at rest at the upper end of the band [A], if its gear held nothing."""
        return self.rig.tendons.current(self.ends[1].rest_tension)

    @property
    def objectives(self) -> tuple[float, float, float]:
        """Return energy, volume and tension, as the search trades them."""
        return self.energy, self.volume, self.tension


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
    problem = joint_problem(rig, pretensions, [math.degrees(one.command) for one in ends], target.band_hz)
    at_yaw = loads_of(problem, np.array([one.torsion for one in ends]))
    checks = check_joint(rig, pretensions, at_yaw, tilt_held=True, torso=target.torso)
    inertia = rig.inertia
    share = inertia.lever.value / (inertia.head.value + inertia.lever.value)
    return Proposal(
        draft=draft,
        rig=rig,
        ends=ends,
        loads=(loads[0], loads[1]),
        damping_ratio=tuple(0.5 * share * abs(one.lever) / one.torsion for one in ends),  # type: ignore[arg-type]
        diameter=max(rig.silicone.diameter.value, 2 * (rig.tendons.head_radius.value + GUIDE)),
        length=rig.tendons.free_span.value,
        checks=tuple(checks),
        faults=tuple(_faults(rig, target, ends, loads, checks)),
    )


def _rig(draft: Draft) -> RigSpec:
    size, ratio, length, circle, lever = draft.sizes
    known = draft.material in list_materials()
    section = SHAPES[draft.shape].section(size, ratio)
    length_mm = round(1e3 * length)
    base = parse_rig(draft.rig)
    inertia, torso = draft.target.inertia, draft.target.torso
    design = Design(
        section=section,
        length=1e-3 * length_mm,
        material=load_material(draft.material) if known else None,
        tendon_circle=round(2e3 * circle) / 2e3,
        head_inertia=inertia,
        lever_inertia=round(lever, 4),
        head_across=moment_across(inertia, torso.mass, torso.centre) if torso is not None and base.space else None,
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
    wanted, yaw = np.asarray(draft.target.band_hz), math.radians(draft.target.yaw_deg)
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
    told = [check.sentence for check in checks if not check.holds]
    swing = Swing(yaw_deg=target.yaw_deg)
    for one, load, wanted in zip(ends, loads, target.band_hz, strict=True):
        told += [s.sentence for s in stresses_of(rig, one, swing) if s.share > 1 and s.sentence not in told]
        if abs(one.frequency_hz / wanted - 1) > 1e-3:
            told.append(f"it resonates at {one.frequency_hz:.4g} Hz where {wanted:g} Hz is wanted")
        if load.duty > rig.drive.duty_limit.value:
            told.append(
                f"the drive needs a duty of {load.duty:.2f} at {wanted:g} Hz, {rig.drive.duty_limit.value:g} is all"
            )
    if ends[1].pretension_mm > rig.limits.tendon_travel_mm[1]:
        told.append(
            f"it needs {ends[1].pretension_mm:.1f} mm of cable, motors have {rig.limits.tendon_travel_mm[1]:g} mm"
        )
    return told


def plan_of(proposal: Proposal) -> Plan:
    """Return the plan that would test a proposal: at both pretensions a stepped sweep around both ends of the band.

    The command's amplitude is the larger of the two that the yaw needs. The drive runs until 3 % of the transient is
    left. Raises SpecError where the clusters of frequencies do not make a plan.
    """
    target = proposal.draft.target
    amplitude = max(math.degrees(one.command) for one in proposal.ends)
    frequency = sorted({round(end * (1 + off), 4) for end in target.band_hz for off in _AROUND})
    if len(frequency) < len(_AROUND):
        raise SpecError("the band's ends are too close for a plan; widen the band")
    slowest = min(d * 2 * math.pi * f for d, f in zip(proposal.damping_ratio, target.band_hz, strict=True))
    settle = min(_LONGEST_SETTLE, math.ceil(_SETTLED / slowest))
    return Plan(
        name=f"test of {proposal.rig.name}",
        pretension=Pretension(pretension_mm=tuple(round(one.pretension_mm, 3) for one in proposal.ends)),
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


class Found(NamedTuple):
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


def search_block(block: Block) -> Found:
    """Return the improved candidates of a block."""
    configure()
    rig = parse_rig(block.rig)
    frame = frame_of(rig, block.target, block.shape)
    rng = np.random.default_rng([block.seed, block.number])
    place = rng.uniform(0.05, 0.95, (block.starts, len(SIZES)))
    weights = rng.dirichlet(np.ones(len(OBJECTIVES)), block.starts)
    done = _search(np.log(place / (1 - place)), weights, block.modulus, frame)
    sizes, objectives, excess, pretension, lever = (np.asarray(leaf) for leaf in done)
    excess = np.nan_to_num(excess, nan=np.inf, posinf=np.inf)
    worst, binding = excess.max(axis=1), excess.argmax(axis=1)
    feasible = (worst <= _CLOSE) & np.isfinite(objectives).all(axis=1)
    return Found(
        block.shape, block.material, block.modulus, sizes, objectives, pretension, lever, feasible, worst, binding
    )


# A proposal is run on the full twin, and what comes out is held against what was predicted of it.

ENOUGH = 0.03
"""Share by which the twin's resonance may be off the predicted one."""


class Request(NamedTuple):
    """A proposal to confirm, and the seed of the twin's scatter and noise."""

    proposal: Proposal
    seed: int


class Confirmed(NamedTuple):
    """One end of the band. predicted_hz, measured_hz: 90° of lag behind the measured lever, at the plan's command;
    peak_hz: of the measured gain. yaw_deg: half of peak to peak at that peak. error: share by which measured is off."""

    pretension_mm: float
    predicted_hz: float
    measured_hz: Estimate
    peak_hz: Estimate
    yaw_deg: float
    error: float


def confirm(request: Request) -> tuple[Confirmed, ...]:
    """Return what the full twin, with sensors, scatter and noise, says of a proposal at both ends of the band.

    Its plan runs with one repeat; the recording is analysed as one of a bench would be.
    """
    configure()
    proposal, seed = request
    plan = _once(plan_of(proposal))
    assert plan.sweep is not None
    results = analyse_recording(simulate(plan, proposal.rig, seed=seed), proposal.rig)
    swing = Swing(command_deg=plan.sweep.amplitude_deg)
    pretensions = plan.pretension.pretension_mm
    band = 0.75 * plan.sweep.frequency_hz[0], 1.2 * plan.sweep.frequency_hz[-1]
    predicted = find_resonances(proposal.rig, pretensions, swing, band_hz=band)
    told = []
    for i, (mm, one) in enumerate(zip(pretensions, predicted, strict=True)):
        at = results.isel(pretension_mm=i)
        measured, peak = (_estimate(at, name) for name in ("phase_90_hz", "resonance_hz"))
        wanted = math.nan if one is None else one.frequency_hz
        yaw = float(at["gain_peak"]) * plan.sweep.amplitude_deg
        told.append(Confirmed(mm, wanted, measured, peak, yaw, measured.value / wanted - 1))
    return tuple(told)


def _estimate(at: xr.Dataset, name: str) -> Estimate:
    stem = name.removesuffix("_hz")
    return Estimate(*(float(at[key]) for key in (name, f"{stem}_std_hz", f"{stem}_low_hz", f"{stem}_high_hz")))


def _once(plan: Plan) -> Plan:
    """Return a plan whose sweep is measured once."""
    assert plan.sweep is not None
    return plan.model_copy(update={"sweep": plan.sweep.model_copy(update={"repeats": 1})})


# Candidates are compared in several objectives: who is dominated, and which few stand for the rest.


def nondominated(objectives: Array) -> Mask:
    """Return which rows (n, k) no other row is at least as small as in every objective and smaller in one, (n,).

    Of equal rows the first stays.
    """
    kept = np.ones(len(objectives), dtype=bool)
    for i, row in enumerate(objectives):
        less = np.all(objectives <= row, axis=1)
        smaller = np.any(objectives < row, axis=1) | (np.arange(len(objectives)) < i)
        kept[i] = not np.any(less & smaller)
    return kept


def spread_out(objectives: Array, count: int, begin: Sequence[int] = ()) -> list[int]:
    """Return at most `count` rows (n, k) that lie far apart in the logarithms of the objectives, in order of choice.

    begin: rows that are taken first. Then comes the row that is best in all together, and after it always the one
    that is farthest from those that were taken.
    """
    if not len(objectives):
        return []
    place = np.log(objectives)
    place = (place - place.min(axis=0)) / np.maximum(np.ptp(place, axis=0), 1e-12)
    taken = list(begin) or [int(np.argmin(place.sum(axis=1)))]
    apart = np.min([np.linalg.norm(place - place[i], axis=1) for i in taken], axis=0)
    while len(taken) < min(count, len(objectives)):
        best = int(np.argmax(apart))
        if apart[best] <= 0:
            break
        taken.append(best)
        apart = np.minimum(apart, np.linalg.norm(place - place[best], axis=1))
    return taken[:count]


_OTHER_LENGTH = 1.5


@dataclass(frozen=True)
class Effort:
    """How much is done. starts: of the search, in each block of a shape and a silicone. exact: candidates that are
    computed by harmonic balance. proposals: at most. seed: of starts and twin."""

    starts: int = 64
    exact: int = 24
    proposals: int = 4
    seed: int = 0


class Failed(NamedTuple):
    """A candidate of the search that breaks a limit. limit: the one it breaks most; excess: by what share of it."""

    shape: str
    material: str
    limit: str
    excess: float


def nearest_failures(found: Sequence[Found]) -> tuple[Failed, ...]:
    """Return of each shape and silicone the candidate that breaks its limits least, the nearest first; those that break
    none are left out."""
    names, failed = list(LIMITS), []
    for one in found:
        i = int(np.argmin(one.excess))
        if not one.feasible[i]:
            failed.append(Failed(one.shape, one.material, names[one.binding[i]], float(one.excess[i])))
    return tuple(sorted(failed, key=lambda row: row.excess))


@dataclass(frozen=True, repr=False)
class Designed(Told):
    """What came of it. candidates, feasible: of the search, numbers. failed: of the search, where none is feasible, see
    `nearest_failures`. evaluated: exactly computed ones that have
    resonances. front: which of them are feasible and not dominated, (n,). chosen: indices of the proposals among them,
    confirmed: what the twin says of each. search_s, exact_s, confirm_s: wall time of the parts [s]. base: name of the
    rig that it began with; target, effort: what was asked for."""

    candidates: int
    feasible: int
    failed: tuple[Failed, ...]
    evaluated: tuple[Proposal, ...]
    front: Mask
    chosen: tuple[int, ...]
    confirmed: tuple[tuple[Confirmed, ...], ...]
    search_s: float
    exact_s: float
    confirm_s: float
    base: str
    target: DesignTarget
    effort: Effort

    def document(self) -> dict[str, Any]:
        """Return it as `sinew design --json` prints it."""
        proposals = [
            {**_joint(self.evaluated[i], bool(self.front[i])), **_proposal(self.evaluated[i], confirmed)}
            for i, confirmed in zip(self.chosen, self.confirmed, strict=True)
        ]
        return {
            "base": self.base,
            "target": {
                "stride_band_hz": list(self.target.band_hz),
                "yaw_deg": self.target.yaw_deg,
                "inertia_kg_m2": self.target.inertia,
                "envelope_mm": [1e3 * self.target.diameter, 1e3 * self.target.length],
                "torso_kg": None if self.target.torso is None else self.target.torso.mass,
                "torso_centre_mm": None if self.target.torso is None else 1e3 * self.target.torso.centre,
            },
            "assumptions": assumptions(self.target),
            "effort": {**self.effort.__dict__},
            "candidates": self.candidates,
            "feasible": self.feasible,
            "failed": [one._asdict() | {"excess": finite(one.excess)} for one in self.failed],
            "evaluated": [_joint(one, bool(on)) for one, on in zip(self.evaluated, self.front, strict=True)],
            "proposals": proposals,
            "sentences": [*_sentences(self, proposals), *assumptions(self.target)],
            "wall_s": {"search": self.search_s, "exact": self.exact_s, "confirm": self.confirm_s},
        }

    def told(self) -> list[Table | str]:
        """Return a row for each proposal, and what to know of the search."""
        document, rows = self.document(), []
        for i, one in enumerate(document["proposals"], start=1):
            twin = ", ".join("-" if end["error"] is None else f"{end['error']:+.1%}" for end in one["confirmed"])
            pretensions = " to ".join(number(end["pretension_mm"], 3) for end in one["ends"])
            size = f"{one['diameter_mm']:.0f} x {one['envelope_length_mm']:.0f}"
            energy, tension = f"{1e3 * one['energy_j']:.0f}", f"{one['tension_n']:.0f}"
            rows.append((f"{i} {one['name']}", pretensions, size, energy, tension, twin))
        columns = ("proposal", "pretension/mm", "envelope/mm", "energy/mJ", "tension/N", "twin off by")
        sentences = [f"- {sentence}" for sentence in document["sentences"]]
        return [*([Table(columns, rows)] if rows else []), *sentences]


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
    >>> found.document()["proposals"][0]["is_confirmed"]  # doctest: +SKIP
    """
    base = rig if isinstance(rig, RigSpec) else load_rig(rig)
    torso = None if torso_kg is None else Torso(torso_kg, 1e-3 * torso_centre_mm)
    size = [1e-3 * one for one in envelope_mm]
    target = DesignTarget((stride_hz[0], stride_hz[1]), yaw_deg, inertia_kg_m2, size[0], size[1], torso=torso)
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
    known = {}
    for name in names:
        if name == "base":
            known["base"] = shear_modulus_of(base)
        else:
            one = load_material(name)
            known[one.name] = one.shear_modulus.value
    return known


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

    def told(part: str) -> Callable[[float, float], None]:
        return lambda done, total: None if progress is None else progress(part, done, total)

    text, begin = dump_rig(rig), time.perf_counter()
    blocks = blocks_of(text, target, silicones, list(shapes), effort.starts, effort.seed)
    found = run_tasks(search_block, blocks, spread, told("search"))
    searched = time.perf_counter()
    drafts = drafts_of(found, text, target, effort.exact)
    evaluated = [one for one in run_tasks(propose, drafts, spread, told("evaluate")) if one is not None]
    front, chosen = select(evaluated, effort.proposals)
    computed = time.perf_counter()
    requests = [Request(evaluated[i], effort.seed) for i in chosen]
    confirmed = run_tasks(confirm, requests, spread, told("confirm"))
    return Designed(
        candidates=sum(len(one.sizes) for one in found),
        feasible=int(sum(one.feasible.sum() for one in found)),
        failed=() if drafts else nearest_failures(found),
        evaluated=tuple(evaluated),
        front=front,
        chosen=tuple(chosen),
        confirmed=tuple(confirmed),
        search_s=searched - begin,
        exact_s=computed - searched,
        confirm_s=time.perf_counter() - computed,
        base=rig.name,
        target=target,
        effort=effort,
    )


def drafts_of(found: Sequence[Found], text: str, target: DesignTarget, count: int) -> list[Draft]:
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


def select(evaluated: Sequence[Proposal], count: int) -> tuple[Mask, list[int]]:
    """Return (which are feasible and not dominated, indices of at most `count` distinct proposals).

    Distinct: another shape, another silicone, or a length that differs by half. The front's come first, then others
    that are feasible; in each those that are far apart in the objectives.
    """
    front = np.zeros(len(evaluated), dtype=bool)
    fit = [i for i, one in enumerate(evaluated) if not one.faults]
    if not fit:
        return front, []
    objectives = np.array([evaluated[i].objectives for i in fit])
    best = nondominated(objectives)
    front[np.array(fit)[best]] = True
    order = [fit[k] for k in np.flatnonzero(best)[spread_out(objectives[best], len(fit))]]
    order += [fit[k] for k in spread_out(objectives, len(fit)) if fit[k] not in order]
    chosen: list[int] = []
    for i in order:
        if len(chosen) < count and not any(_alike(evaluated[i], evaluated[j]) for j in chosen):
            chosen.append(i)
    return front, chosen


def _alike(a: Proposal, b: Proposal) -> bool:
    lengths = sorted((a.rig.silicone.length.value, b.rig.silicone.length.value))
    same = (a.draft.shape, a.draft.material) == (b.draft.shape, b.draft.material)
    return same and lengths[1] < _OTHER_LENGTH * lengths[0]


# What a search found, as JSON holds it.


def _joint(one: Proposal, on_front: bool) -> dict[str, Any]:
    return {
        "name": one.rig.name,
        "shape": one.draft.shape,
        "material": one.draft.material,
        "feasible": not one.faults,
        "faults": list(one.faults),
        "on_front": on_front,
        "energy_j": one.energy,
        "volume_cm3": 1e6 * one.volume,
        "tension_n": one.tension,
        "diameter_mm": 1e3 * one.diameter,
        "envelope_length_mm": 1e3 * one.length,
    }


def _proposal(one: Proposal, confirmed: tuple[Confirmed, ...]) -> dict[str, Any]:
    rig = one.rig
    rows = [_confirmed(found) for found in confirmed]
    return {
        "section": section_of(rig).shape,
        "length_mm": 1e3 * rig.silicone.length.value,
        "tendon_circle_mm": 1e3 * rig.tendons.head_radius.value,
        "lever_inertia_kg_m2": rig.inertia.lever.value,
        "holding_a": one.holding_a,
        "ends": [_end(one, i) for i in range(2)],
        "validity": [c.to_json() for c in one.checks],
        "confirmed": rows,
        "is_confirmed": all(row["error"] is not None and abs(row["error"]) <= ENOUGH for row in rows),
        "rig": None,
        "plan": None,
    }


def _end(one: Proposal, i: int) -> dict[str, float]:
    at, load = one.ends[i], one.loads[i]
    return {
        "wanted_hz": one.draft.target.band_hz[i],
        "frequency_hz": at.frequency_hz,
        "pretension_mm": at.pretension_mm,
        "command_deg": math.degrees(at.command),
        "lever_deg": math.degrees(abs(at.lever)),
        "torsion_deg": math.degrees(at.torsion),
        "damping_ratio": one.damping_ratio[i],
        "rest_tension_n": at.rest_tension,
        "tension_n": at.tension,
        "torque_n_m": load.torque,
        "speed_rad_s": load.speed,
        "duty": load.duty,
        "current_a": load.current,
        "work_j": load.work,
        "energy_j": load.energy,
    }


def _confirmed(found: Confirmed) -> dict[str, Any]:
    return {
        "pretension_mm": found.pretension_mm,
        "predicted_hz": finite(found.predicted_hz),
        "measured_hz": found.measured_hz.to_json(),
        "peak_hz": found.peak_hz.to_json(),
        "yaw_deg": finite(found.yaw_deg),
        "error": finite(found.error),
    }


def assumptions(target: DesignTarget) -> list[str]:
    """Return what is taken for granted of the torso, a sentence each."""
    if target.torso is None:
        return [
            "assumed: nothing presses on the joint but its tendons; the weight of what sits on it is left out, for no "
            "mass was given. Give it (torso-kg), and buckling, strain, tension and tipping are checked under it. "
            "The rigs keep the mass and height of the base's head, so their sways are not the torso's"
        ]
    torso = target.torso
    return [
        f"assumed: {torso.mass:g} kg stand upright on the joint with their centre {1e3 * torso.centre:g} mm above the "
        f"head plate and press with {torso.weight:.0f} N; pretension counts from the first contact under that weight; "
        f"the head tilts no further than the rig allows; the swing's resonance is that without weight. The rigs "
        "get its moments of inertia, across the axis as of a cylinder that stands on the plate; they keep the mass and "
        "height of the base's head, so their sways are not the torso's"
    ]


_SHOWN = 6  # candidates without a proposal


def _why_none(found: Designed) -> list[str]:
    """Return sentences on the limit that binds each of the nearest candidates, and on what helps with it."""
    computed = sorted((one for one in found.evaluated if one.faults), key=lambda one: len(one.faults))[:_SHOWN]
    if computed:
        return [
            f"none of the {len(computed)} best that were computed exactly passed; of each, what is exceeded:",
            *(f"{one.rig.name}: {'; '.join(one.faults)}" for one in computed),
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


def _sentences(found: Designed, proposals: list[dict[str, Any]]) -> list[str]:
    told = [f"{found.feasible} of {found.candidates} candidates of the search keep every limit"]
    fit = sum(not one.faults for one in found.evaluated)
    if found.evaluated:
        told.append(
            f"{fit} of {len(found.evaluated)} that were computed exactly do, {int(found.front.sum())} undominated"
        )
    if not proposals:
        return [*told, *_why_none(found)]
    sure = sum(one["is_confirmed"] for one in proposals)
    told.append(f"{sure} of {len(proposals)} proposals resonate on the full twin within 3 % of what was predicted")
    held = max(one["holding_a"] for one in proposals)
    told.append(
        f"holding the tendons takes up to {held:.2f} A of each tendon motor if its gear holds nothing; that is not in "
        "the drive's energy"
    )
    return told
