"""The drive's reach: which lever amplitude it gives for a commanded sine.

The servo of the rig against a held head, or one that swings by φ: inertia J = I_l + J_a, and the torque line of the
data sheet with a duty u,

    J θ̈ + I_l φ̈ = τ u - c θ̇ - T_f sign(θ̇),   τ = (T_stall + T_f) V/V_nominal,   c = T_stall/ω_no-load,
    u = clip(K (A sin Ωt - θ), ±u_max).

Harmonic balance on the fundamental replaces the clip by its describing function and the friction by 4 T_f/π in phase
with the speed (Gelb and Vander Velde, Multiple-Input Describing Functions, 1968, ch. 2). With x = K E/u_max for an
error of amplitude E, the motor gives the torque amplitude τ u_max y(x), y = x up to saturation and
(2/π) (x asin(1/x) + sqrt(1 - 1/x²)) beyond, which tends to 4/π. That torque fixes Θ, and the phasors of θ and of the
error add up to the command.

Where a joint resonates, its head swings against the lever and takes torque that the held head does not: there the twin
shows up to half less amplitude (paper's rig), and slightly more above the resonance. Where the head's swing is known,
φ = H θ adds I_l H to the inertia, and the lever is known to a few percent.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq

from sinew.plan.rig import RigSpec

__all__ = ["Reach", "drive_reach"]

_SCAN = np.geomspace(1e-4, 1e6, 400)


@dataclass(frozen=True)
class Reach:
    """What the drive does for one commanded sine.

    amplitude_rad: of the lever against the head; zero where gear friction holds it.
    lag_rad: of the lever behind its command.
    current_a: amplitude of the motor current's fundamental.
    saturated_share: of the time that the duty is at its limit, 1 - (2/π) asin(1/x) for x > 1, else 0.
    """

    amplitude_rad: float
    lag_rad: float
    current_a: float
    saturated_share: float

    @property
    def saturated(self) -> bool:
        """Whether the duty touches its limit."""
        return self.saturated_share > 0


@dataclass(frozen=True)
class _Servo:
    """Servo and load at one frequency: horn torque minus friction is load · θ, phasors, θ real."""

    load: complex
    friction: float
    torque_limit: float
    error_limit: float

    @staticmethod
    def of(rig: RigSpec, omega: float, head: complex) -> "_Servo":
        drive = rig.drive
        inertia = rig.inertia.lever.value * (1 + head) + drive.armature.value
        slope = drive.stall_torque.value / drive.no_load_speed.value
        full_duty = (drive.stall_torque.value + drive.friction.value) * (
            drive.supply_voltage.value / drive.nominal_voltage.value
        )
        return _Servo(
            load=-inertia * omega**2 + 1j * slope * omega,
            friction=4 / math.pi * drive.friction.value,
            torque_limit=full_duty * drive.duty_limit.value,
            error_limit=drive.duty_limit.value / drive.position_gain.value,
        )

    def lever(self, x: float) -> tuple[float, complex]:
        """Return (lever amplitude Θ [rad], phasor of the command [rad], lever's phase zero) for an error x.

        |load Θ + i T_f 4/π| is the torque amplitude, a quadratic in Θ.
        """
        torque = self.torque_limit * _saturated(x)
        if torque <= self.friction:
            return 0.0, complex(0.0, x * self.error_limit)
        square, half = abs(self.load) ** 2, self.load.imag * self.friction
        theta = (math.sqrt(half**2 + square * (torque**2 - self.friction**2)) - half) / square
        phasor = self.load * theta + 1j * self.friction
        return theta, theta + phasor / abs(phasor) * x * self.error_limit


def drive_reach(rig: RigSpec, command_rad: float, frequency_hz: float, head: complex = 0.0) -> Reach:
    """Return lever amplitude, lag and current for a commanded amplitude [rad] at a frequency [Hz].

    head: torsion over lever angle, complex, of a head that swings, a lag having a negative angle; 0 for a held one.
    Where the balance has several solutions the one with the smallest error counts: a drive that starts from rest.
    """
    omega = 2 * math.pi * frequency_hz
    servo = _Servo.of(rig, omega, head)

    def surplus(log_x: float) -> float:
        return abs(servo.lever(math.exp(log_x))[1]) - command_rad

    steps = [(x, surplus(math.log(x))) for x in _SCAN]
    low, high = next(
        ((x, y) for (x, at_x), (y, at_y) in pairwise(steps) if at_x < 0 <= at_y),
        (_SCAN[0], _SCAN[0]),
    )
    x = low if low == high else math.exp(float(brentq(surplus, math.log(low), math.log(high), xtol=1e-12)))
    theta, command = servo.lever(x)
    slope = rig.drive.stall_torque.value / rig.drive.no_load_speed.value
    friction = servo.friction if theta > 0 else 0.0
    electrical = abs((servo.load - 1j * slope * omega) * theta + 1j * friction)
    constant = (rig.drive.stall_torque.value + rig.drive.friction.value) / rig.drive.stall_current.value
    share = 1 - 2 / math.pi * math.asin(1 / x) if x > 1 else 0.0
    return Reach(theta, math.atan2(command.imag, command.real), electrical / constant, share)


def _saturated(x: float) -> float:
    """Return the fundamental of clip(x sin ψ, ±1)."""
    if x <= 1:
        return x
    return 2 / math.pi * (x * math.asin(1 / x) + math.sqrt(1 - 1 / x**2))
