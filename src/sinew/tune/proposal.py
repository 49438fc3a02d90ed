"""A candidate as a rig that could be built, computed by harmonic balance, with a plan."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sinew.measure.errors import SpecError
from sinew.plan.plan import Plan, Pretension, Sweep
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_rig
from sinew.predict.joint import joint_problem
from sinew.predict.joints.design import Design, design_rig
from sinew.predict.joints.material import list_materials, load_material
from sinew.predict.joints.validity import Check, check_joint, loads_of
from sinew.tune.candidate import GUIDE, SHAPES, DesignTarget, DriveLoad, drive_load
from sinew.tune.pretension import stresses_of
from sinew.tune.resonance import Resonance, Swing, resonances_at
from sinew.twin.cache import configure

_STEPS, _CLOSE, _YAW_CLOSE = 8, 2e-4, 3e-3
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
    design = Design(
        section=section,
        length=1e-3 * length_mm,
        material=load_material(draft.material) if known else None,
        tendon_circle=round(2e3 * circle) / 2e3,
        head_inertia=draft.target.inertia,
        lever_inertia=round(lever, 4),
        name=f"{section.shape}, {length_mm} mm, {draft.material}",
    )
    return design_rig(parse_rig(draft.rig), design)


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
    for _ in range(_STEPS):
        low, high = resonances_at(rig, where, commands, band)
        if low is None or high is None:
            return None
        ends = low, high
        now, torsion = (np.array([getattr(one, name) for one in ends]) for name in ("frequency_hz", "torsion"))
        if np.all(np.abs(now / wanted - 1) < _CLOSE) and np.all(np.abs(torsion / yaw - 1) < _YAW_CLOSE):
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
