"""This is where it is worked out what the drive has to do for a steady swing: torque, duty, current, energy a cycle.

Lever and torsion are taken as sines, θ = Re(Θ exp jΩt) and φ = Φ cos Ωt; the horn then has to give

    M = (I_l + J_a) θ̈ + I_l φ̈,

and the motor's current that and the gear's friction. Duty and power follow from the torque line of the twin
(`sinew.twin.drive`). What a servo at its limit does instead is not in it: a duty above the limit says that it is there.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sinew.plan.rig import RigSpec
from sinew.twin.drive import gear_friction
from sinew.twin.parameters import Parameters, from_rig

__all__ = ["DriveLoad", "drive_load", "load_of_swing"]

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
    amplitude Φ [rad], which is the phase zero. samples: of the period.
    """
    phase = 2 * jnp.pi * jnp.arange(samples) / samples
    c, s = jnp.cos(phase), jnp.sin(phase)
    real, imaginary = lever
    speed = -omega * (imaginary * c + real * s)
    own, coupled = p.lever + p.armature, p.lever
    horn = -(omega**2) * (own * (real * c - imaginary * s) + coupled * torsion * c)
    electrical = horn + gear_friction(speed, p)
    duty = (electrical + p.speed_slope * speed) / p.duty_torque
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
