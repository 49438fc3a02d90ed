"""This is where it is worked out what the drive has to do for a steady swing: torque, duty, current, energy a cycle.

Lever and torsion are taken as sines, θ = Re(Θ exp jΩt) and φ = Φ cos Ωt; the horn then has to give

    M = (I_l + J_a) θ̈ + I_l φ̈,

and the motor's current that and the gear's friction. Duty and power follow from the torque line of the twin
(`sinew.twin.drive`). What a servo at its limit does instead is not in it: a duty above the limit says that it is there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sinew.plan.rig import RigSpec
from sinew.twin.drive import SLIDING_SPEED
from sinew.twin.parameters import from_rig

__all__ = ["DriveLoad", "drive_load"]

_SAMPLES = 720


@dataclass(frozen=True)
class DriveLoad:
    """torque: largest at the horn [N m]. speed: largest of the lever [rad/s]. duty: largest, 1 is the whole supply.
    current: largest [A]. work: done by the horn in a cycle [J]. energy: electrical, in a cycle, from the supply, what
    the motor gives back taken off [J]."""

    torque: float
    speed: float
    duty: float
    current: float
    work: float
    energy: float


def drive_load(rig: RigSpec, frequency_hz: float, lever: complex, torsion: float) -> DriveLoad:
    """Return what the drive does in a steady swing.

    lever: phasor Θ of the lever against the head [rad], torsion: amplitude Φ [rad], which is the phase zero.
    """
    p = from_rig(rig)
    omega = 2 * np.pi * frequency_hz
    turn = np.exp(2j * np.pi * np.arange(_SAMPLES) / _SAMPLES)
    speed: NDArray[np.float64] = (1j * omega * lever * turn).real
    own, coupled = float(p.lever + p.armature), float(p.lever)
    horn = (-(omega**2) * (own * lever + coupled * torsion) * turn).real
    electrical = horn + float(p.drive_friction) * np.tanh(speed / SLIDING_SPEED)
    duty = (electrical + float(p.speed_slope) * speed) / float(p.duty_torque)
    current = electrical / float(p.torque_constant)
    period = 1 / frequency_hz
    return DriveLoad(
        torque=float(np.max(np.abs(horn))),
        speed=float(np.max(np.abs(speed))),
        duty=float(np.max(np.abs(duty))),
        current=float(np.max(np.abs(current))),
        work=float(np.mean(horn * speed)) * period,
        energy=float(np.mean(duty * current)) * rig.drive.supply_voltage.value * period,
    )
