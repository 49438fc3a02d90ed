"""What a prediction is worth: each assumption with a number, a limit and a sentence."""

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy import optimize

from sinew.measure.arrays import Array, namespace_of
from sinew.measure.result import Field, Result
from sinew.measure.units import STANDARD_GRAVITY
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.rod import column_load
from sinew.mechanics.silicone import compressive_load
from sinew.mechanics.tendons import tendon_stretch, tendon_tension
from sinew.plan.check import mast_load
from sinew.plan.rig import RigSpec
from sinew.predict.design import section_of, shear_modulus_of
from sinew.predict.section import Section
from sinew.solve.curves import Problem
from sinew.solve.programs import program
from sinew.solve.rest import sunk

# A predicted joint's tensions and compression are found, at rest and where it twists most.


_STEPS = 12


@dataclass(frozen=True)
class Torso:
    """What sits on a joint and presses on it. mass [kg]; centre: height of its centre above the head plate [m]."""

    mass: float
    centre: float = 0.25

    @property
    def weight(self) -> float:
        """Return its weight [N]."""
        return self.mass * STANDARD_GRAVITY

    def moment(self, tilt_deg: float) -> float:
        """Return the moment by which it wants to tip over where the head is tilted by so much [N m]."""
        return self.weight * self.centre * math.sin(math.radians(tilt_deg))


class Loads(NamedTuple):
    """By lane: tension of one tendon at rest and at the largest torsion [N], stretch λ at rest and at that torsion [1],
    and that torsion [rad]."""

    rest_tension: Array
    tension: Array
    rest_stretch: Array
    stretch: Array
    torsion: Array


def loads_of(problem: Problem, torsion: Array) -> Loads:
    """Return the loads of a rig's lanes at rest and, statically, at a torsion (lane,) [rad].

    At that torsion the head has sunk to where the relaxed axial force vanishes; inertia of the head, the silicone's
    memory and friction are left out.
    """
    p: Parameters = problem.lane.p
    rest = problem.rest[:, 1]
    there = np.asarray(_sunk(torsion, rest, p), dtype=float)
    length = np.asarray(p.length)
    return Loads(
        _tendon_tensions(np.zeros_like(rest), rest, p),
        _tendon_tensions(torsion, there, p),
        1 - rest / length,
        1 - there / length,
        torsion,
    )


def loads_under(loads: Loads, torso: Torso, shear_rigidity: float, guides: tuple[int, float], tilt_deg: float) -> Loads:
    """Return the loads with a torso's weight on the joint.

    shear_rigidity: G A of the silicone [N]. guides: number of tendons and radius of their circle [m]. tilt_deg: how far
    the head may tilt. The silicone carries the weight on top of the tendons, G A (1/λ² - λ) = ΣT + m g, and is
    shortened by it; pretension counts from the first contact with the torso on the joint, so that the weight alone
    changes no tension. The moment of the tilted torso is held by the tendons: at most 2 M/(n r) more in one of them.
    """
    count, radius = guides
    more = 2 * torso.moment(tilt_deg) / (count * radius)

    def pressed(stretch: Array) -> Array:
        return np.array([_stretch_under(float(one), torso.weight / shear_rigidity) for one in stretch])

    return loads._replace(
        rest_tension=loads.rest_tension + more,
        tension=loads.tension + more,
        rest_stretch=pressed(loads.rest_stretch),
        stretch=pressed(loads.stretch),
    )


def _stretch_under(stretch: float, more: float) -> float:
    """Return the stretch under an additional load, as a share of G A."""
    load = compressive_load(1.0, stretch) + more
    return float(optimize.brentq(lambda x: compressive_load(1.0, x) - load, 1e-3, 2.0))


def _tendon_tensions(torsion: Array, shortening: Array, p: Parameters) -> Array:
    each = [tendon_tension(s, p) for s in tendon_stretch(jnp.asarray(torsion), jnp.asarray(shortening), p)]
    return np.asarray(jnp.max(jnp.stack(each), axis=0))


@program()
def _sunk(torsion: jax.Array, rest: jax.Array, p: Parameters) -> jax.Array:
    return jax.vmap(partial(sunk, steps=_STEPS))(torsion, rest, p)


# It is estimated how much the plates at its ends stiffen a silicone that is bonded to them.

LOST = 0.163
"""Length that bonded ends take from a slender cylinder, in diameters: finite elements, decision 15."""


def bonded_axial_factor(area: float, perimeter: float, length: float) -> float:
    """Return by how much bonded ends raise the axial stiffness 3 G A/L of an incompressible block.

    A slender one is as stiff as one that is shorter by 0.163 diameters, 1/(1 - 0.163 d/L), with d = 4 A/P: for a circle
    within 0.3 % from a length of one width on. A squat one follows 1 + 2 S² with S = A/(P L), loaded area over the one
    that is free to bulge (Gent and Lindley, Proc. Inst. Mech. Eng. 173, 1959). The larger of both holds.
    area [m²], perimeter of all edges [m], length [m].
    """
    shape = area / (perimeter * length)
    left = 1 - LOST * 4 * shape
    return max(1 + 2 * shape**2, 1 / left if left > 0.5 else 0.0)


def bonded_torsion_factor(torsion_constant: Any, warping_constant: Any, length: Any) -> Any:
    """Return by how much ends that hold the warping raise the torsional stiffness G J/L: 1/(1 - tanh(h)/h).

    h = L/2 · sqrt(G J/(E I_w)) with E = 3 G. Vlasov's theory of restrained warping (Timoshenko and Gere, Theory of
    Elastic Stability, section 5.3); one for a section that does not warp. Arguments in m⁴, m⁶ and m.
    """
    xp, least = namespace_of(warping_constant), 1e-12 * torsion_constant * length**2
    h = 0.5 * length * xp.sqrt(torsion_constant / (3 * xp.maximum(warping_constant, least)))
    return xp.where(warping_constant > least, 1 / (1 - xp.tanh(h) / h), 1.0)


# The load is found at which tendons make a joint buckle, sideways or by twisting.
#
# Sideways: tendons run straight from guides on the head to guides on the base, so that their pull always points to
# the base. With motors that hold a position they keep the head from tilting as well, the column is held at both ends
# and P = 4 π² E I/L². With motors that hold a current nothing but the silicone keeps the head from tilting; a load
# whose line passes through the foot of a clamped column gives P = π² E I/L² (Timoshenko and Gere, Theory of Elastic
# Stability, chapter 2). Rubber columns are short, shear and thicken as well: `sinew.mechanics.rod`.
#
# By twisting: compression lets a section twist more easily (Wagner). For an incompressible neo-Hookean bar at the
# stretch λ the torsional stiffness is (G/L) (I_p/λ - (I_p - J)/λ⁴) (`sinew.mechanics.silicone.twist_rigidity`), which
# vanishes where λ³ = 1 - J/I_p; for slight compression that is Wagner's P = G J A/I_p.


def euler_load(bending_rigidity: Any, length: Any, *, tilt_held: bool) -> Any:
    """Return the critical load [N] of a joint without shear: E I [N m²], length [m]; tilt_held: by the tendons."""
    return (4 if tilt_held else 1) * np.pi**2 * bending_rigidity / length**2


def twisting_stretch(torsion_constant: Any, polar_moment: Any, least: float = 0.0) -> Any:
    """Return the stretch λ at which the torsional stiffness of the silicone vanishes; 0 for a circle.

    least: of 1 - J/I_p; above zero where a slope by it is wanted.
    """
    xp = namespace_of(torsion_constant)
    return xp.cbrt(xp.maximum(least, 1 - torsion_constant / polar_moment))


SLENDER = 1.0
"""Length over the diameter of the circle around the section, below which a joint is no beam at all."""

CLOSE = 0.1
"""Share by which a stiffness may be off before it counts."""

STRAIN = 0.5
"""Largest principal strain up to which a silicone's neo-Hookean law is taken to hold."""


@dataclass(frozen=True, repr=False)
class Check(Result):
    """One assumption. value and limit: in the unit of the name, else shares; None where there is no number.
    holds: the verdict, never beside a value that exceeds its limit. sentence: with the number and what it means."""

    check: Annotated[str, Field("check")]
    value: Annotated[float | None, Field("value", unit="")]
    limit: Annotated[float, Field("limit", unit="")]
    holds: Annotated[bool, Field("holds")]
    sentence: Annotated[str, Field("", "detail")]

    def __post_init__(self) -> None:
        inside = self.value is None or (
            self.value >= self.limit if self.check == "slenderness" else self.value <= self.limit
        )
        assert inside or not self.holds, f"{self.check} is said to hold at {self.value}, its limit is {self.limit}"

    def line(self) -> str:
        """Return its verdict as a line of a list."""
        return f"- {self.check} {'holds' if self.holds else 'DOES NOT HOLD'}: {self.sentence}"


class _Case(NamedTuple):
    """What is checked: a rig at pretensions [mm] under loads; tilt_held: whether the motors hold positions."""

    rig: RigSpec
    pretension_mm: list[float]
    loads: Loads
    tilt_held: bool

    @property
    def section(self) -> Section:
        return section_of(self.rig)

    @property
    def modulus(self) -> float:
        return shear_modulus_of(self.rig)

    @property
    def length(self) -> float:
        return self.rig.silicone.length.value

    def buckling(self, euler: float) -> float:
        """Return the load [N] at which a joint buckles sideways that shears and thickens as well."""
        return float(column_load(euler, self.modulus * self.section.area))

    def euler(self, *, tilt_held: bool) -> float:
        return float(euler_load(3 * self.modulus * self.section.least, self.length, tilt_held=tilt_held))


def check_joint(
    rig: RigSpec, pretension_mm: list[float], loads: Loads, *, tilt_held: bool, torso: Torso | None = None
) -> list[Check]:
    """Return what is assumed of a rig's joint at the pretension where it matters most.

    pretension_mm: of the lanes of `loads`. tilt_held: whether the motors hold positions, not currents.
    torso: whose weight presses on the joint as well; None leaves it out.
    """
    case = _Case(rig, pretension_mm, loads, tilt_held)
    if torso is not None:
        return _check_under(case, torso)
    each = (_slenderness, _axial_ends, _torsion_ends, _strain, _bending, _twisting, _tension, _current, _torsion)
    return [one(case) for one in each]


def check_drive(rig: RigSpec, amplitude_deg: float, highest_hz: float) -> list[Check]:
    """Return whether a rig allows the command [deg] and the highest frequency [Hz] that are asked of its drive."""
    limits = rig.limits
    return [
        _limited(name, value, limit, f"the drive is asked for {value:g}{unit}, the rig allows {limit:g}{unit}", advice)
        for name, value, limit, unit, advice in (
            (
                "drive_amplitude_deg",
                amplitude_deg,
                limits.drive_amplitude_deg,
                "°",
                f"{_NO_BENCH}, lower the amplitude",
            ),
            ("drive_hz", highest_hz, limits.drive_hz, " Hz", f"{_NO_BENCH}, lower the highest frequency"),
        )
    ]


_NO_BENCH = "no bench of this rig will do it"


def _limited(name: str, value: float, limit: float, said: str, advice: str) -> Check:
    """Return whether a number stays within a limit of the rig; advice: where it does not."""
    return Check(name, value, limit, value <= limit, said if value <= limit else f"{said}; {advice}")


_OF_THE_SWING = ("local_strain", "buckling_sideways", "tension_n", "tendon_current_a", "torsion_deg")


def doubt_broken_curves(checks: list[Check], broken_mm: list[float]) -> list[Check]:
    """Return checks of which those that depend on the largest swing do not hold where a curve was not found whole.

    broken_mm: the pretensions of such curves [mm]; none: the checks as they are.
    """
    if not broken_mm:
        return checks
    but = f"; but the curve at {broken_mm[0]:g} mm broke off, so the swing may be larger, which nothing here rules out"
    return [
        replace(one, value=None, holds=False, sentence=one.sentence + but)
        if one.holds and one.check in _OF_THE_SWING
        else one
        for one in checks
    ]


def _check_under(case: _Case, torso: Torso) -> list[Check]:
    """Return the checks of a joint that carries a torso, each with its weight in it."""
    rig = case.rig
    guides = rig.tendons.count, rig.tendons.head_radius.value
    under = loads_under(case.loads, torso, case.modulus * case.section.area, guides, rig.limits.tilt_deg)
    plain = {one.check: one for one in check_joint(rig, case.pretension_mm, under, tilt_held=case.tilt_held)}
    plain["buckling_sideways"] = _bending_under(case, torso)
    said = f"with {torso.mass:g} kg on it, "
    changed = ("local_strain", "buckling_by_twisting", "tension_n", "tendon_current_a")
    checks = [replace(one, sentence=said + one.sentence) if name in changed else one for name, one in plain.items()]
    return [*checks, _tipping(rig, torso, case.loads)]


def _bending_under(case: _Case, torso: Torso) -> Check:
    """Return whether tendons and weight together leave the joint straight.

    A weight does not point at the base as the tendons do: where they keep the head from tilting, the head may still
    sway, P = π² E I/L²; where they do not, the weight stands on a clamped column as a rigid mast of its height does,
    k h tan(k L) = 1 with P = k² E I. Both loads together by Dunkerley's sum of shares, which is on the safe side.
    """
    of_tendons = case.buckling(case.euler(tilt_held=case.tilt_held))
    mast = mast_load(3 * case.modulus * case.section.least, case.length, torso.centre)
    of_weight = case.buckling(case.euler(tilt_held=False) if case.tilt_held else mast)
    worst = int(np.argmax(case.loads.tension))
    pull = float(case.rig.tendons.count * case.loads.tension[worst])
    value = pull / of_tendons + torso.weight / of_weight
    means = "the joint stays straight" if value < 1 else "it buckles sideways; lower the pretension, or carry less"
    sentence = (
        f"at {case.pretension_mm[worst]:.3g} mm the tendons press with {pull:.0f} N of the {of_tendons:.0f} N, and "
        f"{torso.mass:g} kg with {torso.weight:.0f} N of the {of_weight:.0f} N, at which either alone buckles it; "
        f"their shares add up to {value:.2f}: {means}"
    )
    return Check("buckling_sideways", value, 1.0, value < 1, sentence)


def _tipping(rig: RigSpec, torso: Torso, loads: Loads) -> Check:
    """Return whether the tendons stay taut, and so hold the head, where the torso tilts as far as the rig allows."""
    tilt, tendons = rig.limits.tilt_deg, rig.tendons
    less = 2 * torso.moment(tilt) / (tendons.count * tendons.head_radius.value)
    rest = float(np.min(loads.rest_tension))
    value = less / rest if rest > 0 else math.inf
    means = "it is held" if value < 1 else "they go slack and it tips over; widen the circle of tendons, or carry less"
    sentence = (
        f"tilted by the {tilt:g}° that the rig allows, {torso.mass:g} kg with their centre {1e3 * torso.centre:.0f} mm "
        f"above the head take {less:.0f} N off a tendon that pulls {rest:.0f} N: {means}"
    )
    return Check("tipping_over", value, 1.0, value < 1, sentence)


def largest_strain(shear: Any, stretch: Any) -> Any:
    """Return the largest principal strain [1] of an incompressible bar's surface at a stretch λ under a shear strain
    (per length at rest): the largest singular value of the deformation gradient, less one."""
    xp, across = namespace_of(stretch), stretch**-0.5
    turned = (shear * across) ** 2
    return 0.5 * (xp.sqrt((across + stretch) ** 2 + turned) + xp.sqrt((across - stretch) ** 2 + turned)) - 1


def _slenderness(case: _Case) -> Check:
    value = case.length / case.section.diameter
    holds = value >= SLENDER
    means = "long enough for a beam with corrections for its ends" if holds else "too short for beam theory"
    sentence = f"the silicone is {value:.2f} times as long as it is wide: {means}"
    return Check("slenderness", value, SLENDER, holds, sentence)


def _axial_ends(case: _Case) -> Check:
    rig, section = case.rig, case.section
    value = bonded_axial_factor(section.area, section.perimeter, case.length) - 1
    fitted = rig.section is None and rig.silicone.diameter.origin == "calibrated"
    holds = value <= CLOSE or fitted
    means = "which hardly matters" if holds else "its shortening under the tendons comes out too large by that share"
    if fitted:
        means = "the diameter is calibrated and has taken it in, so that it is no error"
    sentence = f"bonded ends make it about {value:.0%} stiffer along its axis than 3 G A/L: {means}"
    return Check("bonded_ends_axial", None if fitted else value, CLOSE, holds, sentence)


def _torsion_ends(case: _Case) -> Check:
    section = case.section
    value = float(bonded_torsion_factor(section.torsion_constant, section.warping_constant, case.length)) - 1
    holds = value <= CLOSE
    if value == 0:
        return Check("bonded_ends_torsion", value, CLOSE, True, "the section does not warp, bonded ends change nothing")
    means = "which hardly matters" if holds else "expect the silicone to be stiffer, up to that"
    sentence = f"bonded ends hold the warping and make it up to {value:.0%} stiffer in torsion than G J/L: {means}"
    return Check("bonded_ends_torsion", value, CLOSE, holds, sentence)


def _strain(case: _Case) -> Check:
    section, loads = case.section, case.loads
    arm = section.shear_arm or section.diameter / 2
    twist = loads.torsion / case.length
    strains = largest_strain(arm * twist, loads.stretch)
    worst = int(np.argmax(strains))
    value = float(strains[worst])
    holds = value <= STRAIN
    shear, short = float(arm * twist[worst]), 1 - float(loads.stretch[worst])
    corner = "" if section.shear_arm else ", more at its re-entrant corners"
    means = "neo-Hookean within that" if holds else "silicone stiffens there, which the law does not know"
    sentence = (
        f"at {case.pretension_mm[worst]:.3g} mm the surface is sheared by {shear:.2f} and shortened by {short:.0%}, a "
        f"strain of {value:.0%}{corner}: {means}"
    )
    return Check("local_strain", value, STRAIN, holds, sentence)


def _bending(case: _Case) -> Check:
    euler = case.euler(tilt_held=case.tilt_held)
    critical = case.buckling(euler)
    worst = int(np.argmax(case.loads.tension))
    load = float(case.rig.tendons.count * case.loads.tension[worst])
    value = load / critical
    means = "the joint stays straight" if value < 1 else "it buckles sideways; lower the pretension"
    how = "tendons that hold their length" if case.tilt_held else "tendons that hold their force"
    sentence = (
        f"at {case.pretension_mm[worst]:.3g} mm the tendons press with {load:.0f} N, {value:.2f} of the buckling load "
        f"of {critical:.0f} N with {how} (Euler's alone: {euler:.0f} N): {means}"
    )
    return Check("buckling_sideways", value, 1.0, value < 1, sentence)


def _twisting(case: _Case) -> Check:
    critical = float(twisting_stretch(case.section.torsion_constant, case.section.polar_moment))
    worst = int(np.argmin(case.loads.stretch))
    stretch = float(case.loads.stretch[worst])
    if critical < 1e-3:
        sentence = "compression does not twist a round section"
        return Check("buckling_by_twisting", 0.0, 1.0, True, sentence)
    value = (1 - stretch) / (1 - critical)
    load = compressive_load(case.modulus * case.section.area, critical)
    means = "it does not twist by itself" if value < 1 else "only the tendons keep it from twisting by itself"
    sentence = (
        f"at {case.pretension_mm[worst]:.3g} mm the silicone is shortened by {1 - stretch:.0%}, {value:.2f} of the "
        f"{1 - critical:.0%} ({load:.0f} N) at which its stiffness in torsion is lost: {means}"
    )
    return Check("buckling_by_twisting", value, 1.0, value < 1, sentence)


def _tension(case: _Case) -> Check:
    loads = case.loads
    worst, limit = int(np.argmax(loads.tension)), case.rig.limits.tension_n
    value, rest = float(loads.tension[worst]), float(loads.rest_tension[worst])
    said = (
        f"at {case.pretension_mm[worst]:.3g} mm a tendon pulls {rest:.0f} N at rest and {value:.0f} N at "
        f"{math.degrees(float(loads.torsion[worst])):.0f}° of torsion, the rig allows {limit:g} N"
    )
    return _limited("tension_n", value, limit, said, "lower the pretension or the drive")


def _current(case: _Case) -> Check:
    limit, value = case.rig.limits.tendon_current_a, case.rig.tendons.current(float(np.max(case.loads.tension)))
    said = f"its motor draws {value:.2f} A for that, the rig allows {limit:g} A"
    return _limited("tendon_current_a", value, limit, said, "take a smaller pulley or lower the pretension")


def _torsion(case: _Case) -> Check:
    worst, limit = int(np.argmax(case.loads.torsion)), case.rig.limits.torsion_deg
    value = math.degrees(float(case.loads.torsion[worst]))
    said = f"at {case.pretension_mm[worst]:.3g} mm the head twists by {value:.0f}°, the rig allows {limit:g}°"
    return _limited("torsion_deg", value, limit, said, "lower the drive's amplitude")
