"""A rig as numbers of the equations of motion, and which of its effects act."""

from dataclasses import dataclass, fields, replace

import jax
import jax.numpy as jnp
import numpy as np

from sinew.measure.errors import SpecError
from sinew.measure.units import STANDARD_GRAVITY
from sinew.mechanics.parameters import POSITION, Parameters
from sinew.mechanics.rod import SHEAR_FACTOR, TERMS, Rod
from sinew.mechanics.silicone import prony_shares
from sinew.mechanics.space import Space
from sinew.mechanics.tendons import guide_directions
from sinew.plan.rig import RigSpec, moments_of


def from_rig(rig: RigSpec) -> Parameters:
    """Return scalar parameters of a rig at rest: tendons slack (cable_end huge), drive idle.

    The cross-section's second moments follow from the diameter: J = π d⁴/32, A = π d²/4, and G = G·J / J. Where the
    rig has a section of its own, J is its torsion constant and A its area.
    """
    silicone, tendons, drive = rig.silicone, rig.tendons, rig.drive
    series = 1 / (1 / tendons.cable_stiffness.value + 1 / tendons.servo_stiffness.value)
    values = {
        "length": silicone.length.value,
        "torsional_rigidity": silicone.torsional_rigidity.value,
        "axial_rigidity": silicone.torsional_rigidity.value * rig.area_over_torsion_constant,
        "warping_rigidity": _warping_rigidity(rig),
        "bending_rigidity": rig.bending_over_torsional_rigidity * silicone.torsional_rigidity.value,
        "prony_shares": tuple(prony_shares(silicone.loss_factor.value)),
        "viscous": silicone.viscous.value,
        "head": rig.inertia.head.value,
        "lever": rig.inertia.lever.value,
        "armature": drive.armature.value,
        "head_mass": rig.inertia.head_mass.value,
        "guide_directions": guide_directions(tendons.count),
        "base_radius": tendons.base_radius.value,
        "head_radius": tendons.head_radius.value,
        "free_span": tendons.free_span.value,
        "stiffness": series,
        "cable_end": 1e3,
        "held_tension": 0.0,
        "mode": POSITION,
        "guides": tendons.guides,
        "duty_torque": drive.duty_torque,
        "speed_slope": drive.speed_slope,
        "drive_friction": drive.friction.value,
        "position_gain": drive.position_gain.value,
        "duty_limit": drive.duty_limit.value,
        "torque_constant": drive.torque_constant,
        "amplitude": 0.0,
        "omega": 1.0,
        "stop_s": np.inf,
        "prescribed": 0.0,
        "locked_stop": 0.0,
        "low_pass_omega": 2 * np.pi * rig.imu.low_pass.value,
    }
    return jax.tree.map(lambda value: np.asarray(value, dtype=float), Parameters(**values))  # type: ignore[arg-type,no-any-return]


def space_from_rig(rig: RigSpec) -> Space:
    """Return the parameters of a rig's joint in space, at rest: tendons slack, drive idle.

    Raises SpecError for a rig that does not tell its masses.
    """
    if rig.space is None:
        raise SpecError(
            f"rig {rig.name} has no [space], expected the masses and the routing of a joint that bends; "
            "take the table [space] of the rig paper as a start"
        )
    joint, spatial, tendons = from_rig(rig), rig.space, rig.tendons.count
    if rig.section is None:
        least = greatest = rig.silicone.torsional_rigidity.value / 2
    else:
        shear_modulus = rig.silicone.torsional_rigidity.value / rig.section.torsion_constant.value
        least, greatest = (shear_modulus * m.value for m in (rig.section.least_moment, rig.section.greatest_moment))
    area = float(joint.axial_rigidity) / _shear_modulus(rig)
    moments = least / _shear_modulus(rig), greatest / _shear_modulus(rig)
    density = spatial.density.value
    bend, azimuth = np.radians(spatial.rest_bend_deg), np.radians(spatial.rest_azimuth_deg)
    lever_mass = spatial.lever_mass.value
    if lever_mass >= rig.inertia.head_mass.value:
        raise SpecError(
            f"rig {rig.name}: found a lever of {lever_mass:g} kg on a head of {rig.inertia.head_mass.value:g} kg with "
            "it, expected less; raise inertia.head_mass or lower space.lever_mass"
        )
    rod = Rod(
        joint=joint,
        # A bend towards azimuth a turns about the axis across it: y to -sin a, z to cos a.
        rest_bend=(-bend * np.sin(azimuth), bend * np.cos(azimuth)),
        bending=(least, greatest),  # type: ignore[arg-type]
        shear=SHEAR_FACTOR * joint.axial_rigidity,
        line_mass=density * area,  # type: ignore[arg-type]
        line_inertia=(density * sum(moments), density * moments[0], density * moments[1]),  # type: ignore[arg-type]
    )
    bodies = moments_of(rig)
    space = Space(
        rod=rod,
        head_mass=rig.inertia.head_mass.value - lever_mass,  # type: ignore[arg-type]
        head_height=spatial.head_height.value,  # type: ignore[arg-type]
        head_tensor=bodies.head,  # type: ignore[arg-type]
        lever_mass=lever_mass,  # type: ignore[arg-type]
        lever_height=spatial.lever_height.value,  # type: ignore[arg-type]
        lever_tensor=bodies.lever,  # type: ignore[arg-type]
        weight=np.array([-STANDARD_GRAVITY, 0.0, 0.0]),  # type: ignore[arg-type]
        channel=float(spatial.routing == "channel"),  # type: ignore[arg-type]
        cable_end=np.full(tendons, 1e3),
        held_tension=np.zeros(tendons),
        pulls=np.zeros(tendons),  # type: ignore[arg-type]
        blow=np.zeros(3),  # type: ignore[arg-type]
        added=np.zeros((6 * TERMS, 6 * TERMS)),
    )
    return jax.tree.map(lambda value: np.asarray(value, dtype=float), space)  # type: ignore[no-any-return]


def _shear_modulus(rig: RigSpec) -> float:
    """Return G [Pa], from G·J."""
    if rig.section is None:
        return float(rig.silicone.torsional_rigidity.value / (np.pi * rig.silicone.diameter.value**4 / 32))
    return rig.silicone.torsional_rigidity.value / rig.section.torsion_constant.value


def _warping_rigidity(rig: RigSpec) -> float:
    """Return G·(I_p - J) [N m²]; zero for a circle."""
    section = rig.section
    if section is None:
        return 0.0
    polar = section.least_moment.value + section.greatest_moment.value
    return rig.silicone.torsional_rigidity.value * (polar / section.torsion_constant.value - 1)


# Each effect of the twin can be switched off, so that its share can be shown.


@dataclass(frozen=True)
class Effects:
    """Which effects act; all do in the real rig.

    silicone_loss: the Prony branches (off: lossless, relaxed silicone).
    guide_friction: friction of the tendon guides.
    tendons: the tendons at all (off: the bare silicone).
    length_locking: tendons of locked length; off, the motors hold tension and follow.
    axial_motion: shortening of the silicone while it twists; off, the head stays at its height at rest.
    drive_saturation: the duty limit of the drive's position loop.
    drive_dynamics: the drive's servo; off, the lever follows the command exactly and stops without recoil.
    drive_recoil: motion of the stopped lever on its servo; off, a stopped lever is locked to the head.
    sensor_filter: low-pass, averaging and delays of the sensors.
    sensor_noise: noise, bias, rounding and dead band of the sensors.
    stamp_jitter: jitter of the time stamps.
    repeatability: scatter of pretension and friction between repetitions.
    """

    silicone_loss: bool = True
    guide_friction: bool = True
    tendons: bool = True
    length_locking: bool = True
    axial_motion: bool = True
    drive_saturation: bool = True
    drive_dynamics: bool = True
    drive_recoil: bool = True
    sensor_filter: bool = True
    sensor_noise: bool = True
    stamp_jitter: bool = True
    repeatability: bool = True

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Return the names of all effects."""
        return tuple(field.name for field in fields(cls))

    def without(self, *names: str) -> "Effects":
        """Return the same effects with some switched off. Raises SpecError for an unknown name."""
        for name in names:
            if name not in self.names():
                raise SpecError(f"unknown effect {name!r}, expected one of {', '.join(self.names())}")
        return replace(self, **dict.fromkeys(names, False))

    def applied(self, p: Parameters) -> Parameters:
        """Return the parameters with the mechanical effects that are off taken out."""
        if not self.silicone_loss:
            p = p._replace(prony_shares=tuple(jnp.zeros_like(share) for share in p.prony_shares))
        if not self.guide_friction:
            p = p._replace(guides=p.guides.scaled(jnp.zeros_like(p.guides.level)))
        if not self.axial_motion:
            p = p._replace(head_mass=jnp.full_like(p.head_mass, 1e12))
        if not self.drive_saturation:
            p = p._replace(duty_limit=jnp.full_like(p.duty_limit, 1e6))
        if not self.drive_dynamics:
            p = p._replace(prescribed=jnp.ones_like(p.prescribed))
        if not self.drive_recoil:
            p = p._replace(locked_stop=jnp.ones_like(p.locked_stop))
        return p
