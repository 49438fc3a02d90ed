"""Drive: the motor's position loop, from an error of angle to torque and current."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from sinew.mechanics.parameters import Parameters
from sinew.mechanics.tendons import cos_sin

SLIDING_SPEED = 0.05
"""Speed over which gear friction turns round [rad/s]; Coulomb friction is regularised as tanh(ω/ω_s)."""


_SMALLEST = 1e-9  # rad: the law is linear there


def commanded_angle(time_s: jax.Array, p: Parameters) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Return the commanded lever angle, speed and acceleration: A sin Ωt until the drive stops, then zero."""
    driven = jnp.where(time_s < p.stop_s, p.amplitude, 0.0)
    c, s = cos_sin(p.omega * time_s)
    return driven * s, driven * p.omega * c, -driven * p.omega**2 * s


def duty(error: jax.Array, p: Parameters) -> jax.Array:
    """Return the duty of the position loop, -limit..limit, for an error of angle [rad].

    The loop sees the unrounded angle: rounding to the encoder's 0.088° would only dither the duty by 0.7 %, and it
    would hide the loop from differentiation.
    """
    return jnp.clip(p.position_gain * error, -p.duty_limit, p.duty_limit)


def electrical_torque(duty_now: jax.Array, speed: jax.Array, p: Parameters) -> jax.Array:
    """Return the torque of the motor's current, at the horn [N m], at a duty and a speed [rad/s]."""
    return p.duty_torque * duty_now - p.speed_slope * speed


def duty_for(torque: Any, speed: Any, p: Parameters) -> Any:
    """Return the duty at which the motor's current gives a torque at the horn [N m] at a speed [rad/s]."""
    return (torque + p.speed_slope * speed) / p.duty_torque


def gear_friction(speed: jax.Array, p: Parameters) -> jax.Array:
    """Return the Coulomb friction of the gear, at the horn [N m]."""
    return p.drive_friction * jnp.tanh(speed / SLIDING_SPEED)


def horn_torque(duty_now: jax.Array, speed: jax.Array, p: Parameters) -> jax.Array:
    """Return the torque at the horn [N m] at a duty and a speed [rad/s].

    The line through stall torque and no-load speed (data sheet), scaled by duty and supply voltage: back-EMF limits
    the speed. Friction is taken out of that line, so both data-sheet points are met.
    """
    return electrical_torque(duty_now, speed, p) - gear_friction(speed, p)


_AROUND = np.arange(128) * (2 * np.pi / 128)


def holding_stiffness(amplitude: float, omega: float, p: Parameters) -> complex:
    """Return the stiffness [N m/rad] with which the motor holds its horn where the command is zero, complex.

    Minus the torque's fundamental over the angle's in a swing of the horn by an amplitude [rad] at ω [rad/s]: of the
    laws above as they stand, so that what creeps below `SLIDING_SPEED` loses as much as in the motion in time.
    """
    amplitude = max(amplitude, _SMALLEST)
    angle, speed = amplitude * np.sin(_AROUND), amplitude * omega * np.cos(_AROUND)
    torque = np.asarray(horn_torque(duty(jnp.asarray(-angle), p), jnp.asarray(speed), p))
    first = torque @ np.exp(-1j * _AROUND) * 2 / _AROUND.size  # of cos and -i sin
    return complex(-1j * first / amplitude)


def motor_current(duty_now: jax.Array, speed: jax.Array, p: Parameters) -> jax.Array:
    """Return the motor current [A]: the electrical torque over the torque constant at the horn."""
    return electrical_torque(duty_now, speed, p) / p.torque_constant
