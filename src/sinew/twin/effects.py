"""This is where each effect of the twin can be switched off, so that its share can be shown."""

from dataclasses import dataclass, fields, replace

import jax.numpy as jnp

from sinew.measure.errors import SpecError
from sinew.twin.parameters import Parameters

__all__ = ["Effects"]


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
            p = p._replace(guide_friction=jnp.zeros_like(p.guide_friction))
        if not self.axial_motion:
            p = p._replace(head_mass=jnp.full_like(p.head_mass, 1e12))
        if not self.drive_saturation:
            p = p._replace(duty_limit=jnp.full_like(p.duty_limit, 1e6))
        if not self.drive_dynamics:
            p = p._replace(prescribed=jnp.ones_like(p.prescribed))
        if not self.drive_recoil:
            p = p._replace(locked_stop=jnp.ones_like(p.locked_stop))
        return p
