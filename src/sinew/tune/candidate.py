"""Candidates for a joint, judged with slopes: resonance at both ends of the band, loads, energy, size.

A candidate is a point of a unit cube for each of its sizes; `unpacked` says which sizes those are. Its pretensions are
no variables of the search: the shortening at which it resonates at an end of the band is solved for, and moves with
the sizes by the implicit function theorem. All forces are those of the twin. What a design is asked for
(`DesignTarget`), formulas of its sections with slopes, and the drive's load stand with the judging that needs them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sinew.measure.errors import SpecError
from sinew.measure.result import Detail, Field, Result
from sinew.mechanics.drive import duty_for, gear_friction
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.rod import column_load
from sinew.mechanics.silicone import compressive_load
from sinew.mechanics.tendons import as_one_tendon
from sinew.plan.rig import RigSpec
from sinew.predict.section import (
    Section,
    annulus_section,
    circle_section,
    ellipse_section,
    ellipse_torsion,
    rectangle_section,
)
from sinew.predict.validity import (
    CLOSE,
    LOST,
    SLENDER,
    STRAIN,
    Torso,
    bonded_torsion_factor,
    euler_load,
    largest_strain,
    twisting_stretch,
)
from sinew.solve.rest import held_at, peak_tension, swing_loss, swing_stiffness
from sinew.twin.parameters import from_rig

# It is worked out what the drive has to do for a steady swing: torque, duty, current, energy a cycle.
#
# Lever and torsion are taken as sines, θ = Re(Θ exp jΩt) and φ = Φ cos Ωt; the horn then has to give
#
#     M = (I_l + J_a) θ̈ + I_l φ̈,
#
# and the motor's current that and the gear's friction. Duty and power follow from the torque line of the twin
# (`sinew.mechanics.drive`). What a servo at its limit does instead is not in it: a duty above the limit says that it is
# there.

_SAMPLES = 720
_FEW = 64


class DriveLoad(NamedTuple):
    """torque: largest at the horn [N m]. speed: largest of the lever [rad/s]. duty: largest, 1 is the whole supply.
    current: largest [A]. work: done by the horn in a cycle [J]. energy: electrical, in a cycle, from the supply, what
    the motor gives back taken off [J]."""

    torque: float
    speed: float
    duty: float
    current: float
    work: float
    energy: float


def load_of_swing(
    p: Parameters,
    supply: jax.Array,
    omega: jax.Array,
    lever: tuple[jax.Array, jax.Array],
    torsion: jax.Array,
    samples: int = _FEW,
) -> tuple[jax.Array, ...]:
    """Return the fields of a `DriveLoad`, differentiable.

    supply: voltage [V]. lever: real and imaginary part of the phasor Θ of the lever against the head [rad]; torsion:
    amplitude Φ [rad], which is the phase zero. samples: of the period, an even number; the second half repeats the
    first with the other sign, so that one half has every mean of a product and every largest amount.
    """
    # NumPy's, once: by JAX they were computed anew for every candidate and slope, four fifths of a search's time.
    phase = 2 * np.pi * np.arange(samples // 2) / samples
    c, s = np.cos(phase), np.sin(phase)
    real, imaginary = lever
    speed = -omega * (imaginary * c + real * s)
    own, coupled = p.lever + p.armature, p.lever
    horn = -(omega**2) * (own * (real * c - imaginary * s) + coupled * torsion * c)
    electrical = horn + gear_friction(speed, p)
    duty = duty_for(electrical, speed, p)
    current = electrical / p.torque_constant
    period = 2 * jnp.pi / omega
    work, energy = period * jnp.mean(horn * speed), period * supply * jnp.mean(duty * current)
    return (*(jnp.max(jnp.abs(value)) for value in (horn, speed, duty, current)), work, energy)


def drive_load(rig: RigSpec, frequency_hz: float, lever: complex, torsion: float) -> DriveLoad:
    """Return what the drive does in a steady swing.

    lever: phasor Θ of the lever against the head [rad], torsion: amplitude Φ [rad], which is the phase zero.
    """
    supply, omega = (jnp.asarray(x) for x in (rig.drive.supply_voltage.value, 2 * np.pi * frequency_hz))
    turned = jnp.asarray(lever.real), jnp.asarray(lever.imag)
    found = load_of_swing(from_rig(rig), supply, omega, turned, jnp.asarray(torsion), _SAMPLES)
    return DriveLoad(*(float(value) for value in found))


# Cross-sections are closed formulas of two sizes, so that a search can follow their slopes.
#
# The same formulas as in `sinew.predict.section`, which a proposal is computed with in the end; the rectangle's
# torsion is Saint-Venant's series here and finite elements there (Timoshenko and Goodier, Theory of Elasticity,
# chapter 10).

_ODD = (1.0, 3.0, 5.0, 7.0, 9.0)


class Form(NamedTuple):
    """diameter of the circle around it [m], area [m²], perimeter [m], torsion_constant, polar and least moment [m⁴],
    warping_constant [m⁶], shear_arm [m]: as in `sinew.predict.section.Section`."""

    diameter: jax.Array
    area: jax.Array
    perimeter: jax.Array
    torsion_constant: jax.Array
    polar: jax.Array
    least: jax.Array
    warping_constant: jax.Array
    shear_arm: jax.Array


class Shape(NamedTuple):
    """form: from the larger size [m] and the ratio of the smaller to it. ratio: its least and greatest value; equal
    where there is none. section: the exact one of the same sizes."""

    name: str
    form: Callable[[jax.Array, jax.Array], Form]
    ratio: tuple[float, float]
    section: Callable[[float, float], Section]


def _circle(size: jax.Array, _: jax.Array) -> Form:
    return _annulus(size, jnp.zeros_like(size))


def _annulus(size: jax.Array, ratio: jax.Array) -> Form:
    inner = ratio * size
    polar = jnp.pi * (size**4 - inner**4) / 32
    area = jnp.pi * (size**2 - inner**2) / 4
    return Form(size, area, jnp.pi * (size + inner), polar, polar, polar / 2, jnp.zeros_like(size), size / 2)


def _ellipse(size: jax.Array, ratio: jax.Array) -> Form:
    a, b = size / 2, ratio * size / 2
    torsion_constant, warping_constant, shear_arm = ellipse_torsion(a, b)
    h = ((a - b) / (a + b)) ** 2
    perimeter = jnp.pi * (a + b) * (1 + 3 * h / (10 + jnp.sqrt(4 - 3 * h)))  # Ramanujan, within 5e-5 here
    return Form(
        size,
        jnp.pi * a * b,
        perimeter,
        torsion_constant,
        jnp.pi * a * b * (a**2 + b**2) / 4,
        jnp.pi * a * b**3 / 4,
        warping_constant,
        shear_arm,
    )


def _rectangle(size: jax.Array, ratio: jax.Array) -> Form:
    a, b = size, ratio * size
    turns = [jnp.pi * n * a / (2 * b) for n in _ODD]
    series = sum(jnp.tanh(turn) / n**5 for n, turn in zip(_ODD, turns, strict=True))
    peak = sum(1 / (n**2 * jnp.cosh(turn)) for n, turn in zip(_ODD, turns, strict=True))
    return Form(
        size * jnp.sqrt(1 + ratio**2),
        a * b,
        2 * (a + b),
        a * b**3 * (1 / 3 - 64 / jnp.pi**5 * (b / a) * series),
        a * b * (a**2 + b**2) / 12,
        a * b**3 / 12,
        (a * b) ** 3 / 144 * (1 - ratio**2) ** 2,  # of a thin one; a square warps hardly
        b * (1 - 8 / jnp.pi**2 * peak),
    )


def _in_half_mm(length: float) -> float:
    return round(2000 * length) / 2000


SHAPES = {
    shape.name: shape
    for shape in (
        Shape("circle", _circle, (1.0, 1.0), lambda d, _: circle_section(_in_half_mm(d))),
        Shape("annulus", _annulus, (0.2, 0.85), lambda d, q: annulus_section(_in_half_mm(d), _in_half_mm(q * d))),
        Shape("ellipse", _ellipse, (0.35, 0.9), lambda d, q: ellipse_section(_in_half_mm(d), _in_half_mm(q * d))),
        Shape("rectangle", _rectangle, (0.35, 1.0), lambda d, q: rectangle_section(_in_half_mm(d), _in_half_mm(q * d))),
    )
}
"""Shapes that a design is searched among; sizes of the exact section are rounded to half a millimetre."""


# It is said what a joint is to be designed for: a gait, an inertia, and the room that there is.

_FASTEST_HZ = 100.0


@dataclass(frozen=True, repr=False)
class DesignTarget(Result):
    """What a joint has to do and may not exceed.

    stride_band_hz: lowest and highest stride frequency, at which it has to resonate. yaw_deg: amplitude of the torsion
    there. inertia_kg_m2: of what sits on it, about its axis, without the lever that drives it. envelope_mm: largest
    diameter and length; guides stand out by `GUIDE` beyond their circle. torso_kg, torso_centre_mm: mass of what sits
    on it, and the height of its centre above the head plate, else 250; without a mass its weight is left out.
    lever_share: largest inertia of the lever as a share of `inertia_kg_m2`. least_damping: smallest D [1] at both ends:
    a stride that comes 2 D beside the last one still lies within the half-power width. wander: share of its frequency
    that the rig's repeatability of pretension may move the resonance by.
    Raises SpecError where a number cannot be meant.
    """

    stride_band_hz: Annotated[tuple[float, float], Field("", "detail")]
    yaw_deg: Annotated[float, Field("", "detail")]
    inertia_kg_m2: Annotated[float, Field("", "detail")]
    envelope_mm: Annotated[tuple[float, float], Field("", "detail")] = (200.0, 250.0)
    torso_kg: Detail = None
    torso_centre_mm: Detail = None
    lever_share: float = 0.15
    least_damping: float = 0.01
    wander: float = 0.01

    @property
    def torso(self) -> Torso | None:
        """Return what sits on it; None where its weight is left out."""
        if self.torso_kg is None:
            return None
        centre_mm = 250.0 if self.torso_centre_mm is None else self.torso_centre_mm
        return Torso(self.torso_kg, 1e-3 * centre_mm)

    def __post_init__(self) -> None:
        low, high = self.stride_band_hz
        if not 0 < low < high <= _FASTEST_HZ:
            raise SpecError(
                f"found a stride band of {low:g} to {high:g} Hz, expected 0 < lowest < highest, as 0.7:1.1, up to "
                f"{_FASTEST_HZ:g} Hz"
            )
        if not 0 < self.yaw_deg <= 45:
            raise SpecError(f"found a yaw of {self.yaw_deg:g}°, expected an amplitude above 0 and up to 45°")
        if not 1e-4 <= self.inertia_kg_m2 <= 10:
            raise SpecError(f"found an inertia of {self.inertia_kg_m2:g} kg m², expected 0.0001 to 10")
        diameter, length = self.envelope_mm
        if not (30 <= diameter <= 1000 and 30 <= length <= 2000):
            raise SpecError(
                f"found an envelope of {diameter:g} by {length:g} mm, expected a diameter of 30 to 1000 mm and a "
                "length of 30 to 2000 mm"
            )
        if self.torso is not None and not (0 < self.torso.mass <= 500 and 0 <= self.torso.centre <= 3):
            raise SpecError(
                f"found a torso of {self.torso.mass:g} kg with its centre {1e3 * self.torso.centre:g} mm above the "
                "joint, expected above 0 and up to 500 kg, and 0 to 3000 mm"
            )
        if not 0.005 <= self.lever_share <= 1:
            raise SpecError(f"found a lever of {self.lever_share:g} of the inertia, expected a share of 0.005 to 1")


SIZES = ("size", "ratio", "length", "circle", "lever")
"""What is searched: larger size of the section [m], ratio of the smaller one, length [m], radius of the guides' circle
[m], inertia of the lever [kg m²]."""

OBJECTIVES = ("energy_j", "volume_m3", "tension_n")
"""What is traded: the drive's electrical energy in a cycle, mean of both ends of the band; volume of the cylinder
around joint and guides; tension of a tendon at the upper end."""

GUIDE = 0.005
"""How far guides stand out beyond their circle, and half of it how far a tendon keeps from the silicone [m]."""

_RESERVE = 0.9
_SAFE_BUCKLING = 1.5
_CONTACT = 1.3
_BEAM = 0.95
_COMPRESSION = 0.25
_TRAVEL_LEFT = 2e-3
_STEPS = 9

LIMITS = {
    "resonance at the lower end of the band": "raise the lower end, or allow a longer envelope",
    "resonance at the upper end of the band": "lower the upper end, or allow a larger diameter",
    "tension above the first contact": "raise the lower end of the band, or allow a longer envelope",
    "damping": "ask for a larger yaw, or take a rig whose silicone loses more",
    "steps of the pretension": "narrow the band, or take a rig whose pretension repeats better",
    "tension": "lower the upper end of the band, or let less sit on the joint",
    "travel of the cables": "narrow the band",
    "amplitude of the drive": "ask for less yaw",
    "duty of the drive": "ask for less yaw, or lower the upper end of the band",
    "current of the drive": "ask for less yaw, or lower the upper end of the band",
    "strain of the silicone": "ask for less yaw, or allow a longer envelope",
    "compression of the silicone": "lower the upper end of the band, or let less sit on the joint",
    "slenderness": "allow a longer envelope",
    "bonded ends along the axis": "allow a longer envelope",
    "bonded ends in torsion": "allow a longer envelope",
    "buckling sideways": "allow a larger diameter, or lower the upper end of the band",
    "buckling by twisting": "leave out flat sections, or lower the upper end of the band",
    "clearance of the tendons": "allow a larger diameter",
    "buckling under the torso": "let less sit on the joint, or allow a larger diameter",
    "tipping over with the torso": "let less sit on the joint or lower, raise the lower end of the band, or lower the "
    "rig's limits.tilt_deg",
}
"""What a candidate has to keep, in the order of `Judged.excess`, and what helps where it does not."""

Triple = tuple[jax.Array, jax.Array, jax.Array]


class Frame(NamedTuple):
    """What is the same for all candidates of a search, in SI.

    base: parameters of the rig that is changed. shape: number among `SHAPES`. amplitude: of the torsion; omega: of the
    band's ends (2,). contact: tension of all tendons at first contact. beyond: span beyond the silicone. low, high: of
    each size (n,). damping: least D. wander: least difference of the pretensions at the band's ends. tension: of all
    tendons together, travel, command, current: what they may be. tendons: number. weight: of the torso [N]; tipping:
    its moment where the head tilts as far as the rig allows [N m]; zero where no torso is given.
    """

    base: Parameters
    shape: jax.Array
    amplitude: jax.Array
    omega: jax.Array
    inertia: jax.Array
    contact: jax.Array
    beyond: jax.Array
    supply: jax.Array
    low: jax.Array
    high: jax.Array
    damping: jax.Array
    wander: jax.Array
    tension: jax.Array
    travel: jax.Array
    command: jax.Array
    current: jax.Array
    tendons: jax.Array
    weight: jax.Array
    tipping: jax.Array


class Sizes(NamedTuple):
    """The sizes of a candidate, see `SIZES`."""

    size: jax.Array
    ratio: jax.Array
    length: jax.Array
    circle: jax.Array
    lever: jax.Array


class Judged(NamedTuple):
    """objectives: see `OBJECTIVES`. excess: by how much each limit is exceeded, as a share of it; at most 0 where it is
    kept. pretension: at both ends of the band [m]. lever: amplitude at both ends [rad]."""

    objectives: jax.Array
    excess: jax.Array
    pretension: jax.Array
    lever: jax.Array


def frame_of(rig: RigSpec, target: DesignTarget, name: str) -> Frame:
    """Return the frame of a search for one shape, from a base rig whose motors, guides and loss factor are kept."""
    tendons, limits, shape = rig.tendons, rig.limits, SHAPES[name]
    pull = tendons.tension(limits.tendon_current_a)
    most_lever = target.lever_share * target.inertia_kg_m2
    band, (diameter, length) = target.stride_band_hz, (1e-3 * one for one in target.envelope_mm)
    low = (0.015, shape.ratio[0], 0.03, 0.015, min(rig.inertia.lever.value, 0.5 * most_lever))
    high = (diameter, shape.ratio[1], length, 0.5 * diameter - GUIDE, most_lever)
    values = {
        "amplitude": jnp.radians(target.yaw_deg),
        "omega": 2 * jnp.pi * jnp.asarray(band),
        "inertia": target.inertia_kg_m2,
        "contact": tendons.count * tendons.first_contact_tension.value,
        "beyond": tendons.free_span.value - rig.silicone.length.value,
        "supply": rig.drive.supply_voltage.value,
        "low": low,
        "high": high,
        "damping": target.least_damping,
        "wander": rig.repeatability.pretension.value * (band[1] / band[0] - 1) / target.wander,
        "tension": tendons.count * _RESERVE * min(limits.tension_n, pull),
        "tendons": tendons.count,
        "travel": 1e-3 * limits.tendon_travel_mm[1] - _TRAVEL_LEFT,
        "command": jnp.radians(_RESERVE * limits.drive_amplitude_deg),
        "current": _RESERVE * limits.drive_current_a,
        "weight": 0.0 if target.torso is None else target.torso.weight,
        "tipping": 0.0 if target.torso is None else target.torso.moment(limits.tilt_deg),
    }
    arrays = {name: jnp.asarray(value, dtype=float) for name, value in values.items()}
    return Frame(from_rig(rig), jnp.asarray(list(SHAPES).index(name)), **arrays)


def unpacked(location: jax.Array, frame: Frame) -> Sizes:
    """Return the sizes of a place in the unit cube, (5,); they grow by factors."""
    return Sizes(*(frame.low * (frame.high / frame.low) ** location))


def _joint(sizes: Sizes, form: Form, modulus: jax.Array, frame: Frame) -> Parameters:
    return as_one_tendon(frame.base)._replace(
        length=sizes.length,
        torsional_rigidity=modulus * form.torsion_constant,
        axial_rigidity=modulus * form.area,
        warping_rigidity=modulus * (form.polar - form.torsion_constant),
        bending_rigidity=3 * modulus * form.least,
        head=frame.inertia,
        lever=sizes.lever,
        base_radius=sizes.circle,
        head_radius=sizes.circle,
        free_span=sizes.length + frame.beyond,
    )


def _too_stiff(shortening: jax.Array, omega: jax.Array, p: Parameters, frame: Frame) -> jax.Array:
    """Return by how much a joint at a shortening is too stiff to resonate, as a share of what it should be."""
    held, _ = held_at(shortening, p)
    spring = swing_stiffness(shortening, frame.amplitude, omega, held)
    return spring / ((p.head + p.lever) * omega**2) - 1


def _resonant(omega: jax.Array, p: Parameters, frame: Frame) -> tuple[jax.Array, jax.Array]:
    """Return (shortening [m] at which a joint resonates, between nothing and 45 % of its length; what is left over of
    the balance, as a share).

    Secants, held inside; a last step of Newton's method alone carries slopes, which gives those of the root.
    """
    fixed = jax.lax.stop_gradient((omega, p, frame))
    length = fixed[1].length
    low, high = 1e-4 * length, 0.45 * length

    def off(x: jax.Array) -> jax.Array:
        return _too_stiff(x, *fixed)

    def step(state: Triple, _: None) -> tuple[Triple, None]:
        x, last, left_last = state
        left = off(x)
        run = jnp.where(jnp.abs(x - last) > 1e-12 * length, x - last, jnp.inf)
        slope = jnp.maximum((left - left_last) / run, 1e-2 / length)
        slope = jnp.where(jnp.isfinite(run), slope, jnp.inf)
        return (jnp.clip(x - left / slope, low, high), x, left), None

    first = 0.02 * length
    state, _ = jax.lax.scan(step, (0.2 * length, first, off(first)), None, length=_STEPS)
    root = jax.lax.stop_gradient(state[0])
    nudge = 1e-4 * length
    around = jax.lax.stop_gradient(jax.vmap(off)(jnp.stack([root - nudge, root + nudge])))
    slope = (around[1] - around[0]) / (2 * nudge)
    left = _too_stiff(root, omega, p, frame)
    # At an end of the interval there is no root: the place stays, and what is left over counts as a fault.
    inside = (root > 1.001 * low) & (root < 0.999 * high)
    moved = root - left / slope
    return jnp.where(inside, moved, root), jnp.where(inside, 0.0, left)


def _first_contact(p: Parameters, frame: Frame) -> jax.Array:
    """Return the shortening [m] under the first-contact tension."""
    return p.length * (1 - _pressed(jnp.ones(()), frame.contact / p.axial_rigidity))


def _pressed(stretch: jax.Array, more: jax.Array) -> jax.Array:
    """Return the stretch under a further load, as a share of G A, by Newton's method; see `validity.loads_under`."""
    load = compressive_load(1.0, stretch) + more
    found: jax.Array = (1 + load) ** -0.5  # below the root of a convex function, from where Newton's steps only rise
    for _ in range(6):
        found = found - (compressive_load(1.0, found) - load) / (-2 * found**-3 - 1)
    return found


def judge(location: jax.Array, modulus: jax.Array, frame: Frame) -> Judged:
    """Return what a candidate is worth. location: in the unit cube, (5,). modulus: G of its silicone [Pa]."""
    sizes = unpacked(location, frame)
    forms = [shape.form for shape in SHAPES.values()]
    form = jax.lax.switch(frame.shape, forms, sizes.size, sizes.ratio)
    p = _joint(sizes, form, modulus, frame)
    contact = _first_contact(p, frame)
    first_end = p.free_span - contact - frame.contact / p.stiffness

    def at(omega: jax.Array) -> tuple[jax.Array, ...]:
        x, off = _resonant(omega, p, frame)
        held, tension = held_at(x, p)
        lever = swing_loss(x, frame.amplitude, omega, held) * frame.amplitude / (p.lever * omega**2)
        load = load_of_swing(held, frame.supply, omega, (jnp.zeros(()), lever), frame.amplitude)
        command = lever + load[2] / p.position_gain
        peak = peak_tension(frame.amplitude, x, held)
        return x, first_end - held.cable_end, tension, peak, off, lever, command, load[2], load[3], load[5]

    x, pretension, tension, peak, off, lever, command, duty, current, energy = jax.vmap(at)(frame.omega)
    stretch = _pressed(1 - x[1] / p.length, frame.weight / p.axial_rigidity)
    tilted = 2 * frame.tipping / sizes.circle  # of all tendons together: that of `validity.loads_under`
    excess = [
        100 * jnp.abs(off[0]),
        100 * jnp.abs(off[1]),
        _CONTACT * frame.contact / tension[0] - 1,
        frame.damping / jnp.min(0.5 * p.lever * lever / ((p.head + p.lever) * frame.amplitude)) - 1,
        frame.wander / jnp.maximum(pretension[1] - pretension[0], 1e-9) - 1,
        (peak[1] + tilted) / frame.tension - 1,
        pretension[1] / frame.travel - 1,
        jnp.max(command) / frame.command - 1,
        jnp.max(duty) / _RESERVE - 1,
        jnp.max(current) / frame.current - 1,
        *_material_excess(sizes, form, stretch, modulus, peak[1], frame),
        tilted / (_RESERVE * tension[0]) - 1,
    ]
    diameter = jnp.maximum(form.diameter, 2 * (sizes.circle + GUIDE))
    volume = jnp.pi / 4 * diameter**2 * p.free_span
    return Judged(jnp.stack([jnp.mean(energy), volume, peak[1] / frame.tendons]), jnp.stack(excess), pretension, lever)


def _material_excess(
    sizes: Sizes, form: Form, stretch: jax.Array, modulus: jax.Array, load: jax.Array, frame: Frame
) -> list[jax.Array]:
    """Return the excess over strain, compression, beam theory, buckling and clearance at the upper end of the band."""
    shear = form.shear_arm * frame.amplitude / sizes.length
    euler = euler_load(3 * modulus * form.least, sizes.length, tilt_held=True)
    critical = column_load(euler, modulus * form.area)
    swaying = column_load(euler_load(3 * modulus * form.least, sizes.length, tilt_held=False), modulus * form.area)
    bulge = form.area / (form.perimeter * sizes.length)
    twisting = 1 - twisting_stretch(form.torsion_constant, form.polar, 1e-9)
    warping = bonded_torsion_factor(form.torsion_constant, form.warping_constant, sizes.length) - 1
    return [
        largest_strain(shear, stretch) / (_RESERVE * STRAIN) - 1,
        (1 - stretch) / _COMPRESSION - 1,
        SLENDER / _BEAM * form.diameter / sizes.length - 1,
        4 * LOST * bulge * (1 + _BEAM * CLOSE) / (_BEAM * CLOSE) - 1,  # 1/(1 - 4 LOST S) - 1, solved for S
        warping / (_BEAM * CLOSE) - 1,
        _SAFE_BUCKLING * load / critical - 1,
        (1 - stretch) / (_RESERVE * twisting) - 1,
        (0.5 * form.diameter * stretch**-0.5 + 0.5 * GUIDE) / sizes.circle - 1,
        (load / critical + frame.weight / swaying) / _RESERVE - 1,
    ]
