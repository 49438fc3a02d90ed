"""This is where the data-sheet numbers of the servos stand that the energy and the twin's registers need."""

import math
from dataclasses import dataclass

FULL_DUTY_COUNTS = 885
"""Counts of the registers of PWM that are the whole supply."""

VOLTAGE_LSB = 0.1
"""Unit of the register Present Input Voltage [V]."""


@dataclass(frozen=True)
class Servo:
    """One model, as its data sheet has it; torque and speed at the horn.

    nominal_voltage: at which the others hold [V]. stall_torque [N m], stall_current [A], no_load_speed [rad/s].
    standby_current: of the whole servo with its torque off, from the supply [A].
    position_gain_counts: register Position P Gain as from the factory, to which a rig's servo_stiffness belongs.
    """

    model: str
    nominal_voltage: float
    stall_torque: float
    stall_current: float
    no_load_speed: float
    standby_current: float
    position_gain_counts: int

    @property
    def resistance(self) -> float:
        """Return nominal voltage over stall current [Ω]: winding, brushes and bridge."""
        return self.nominal_voltage / self.stall_current


SERVOS = {
    servo.model: servo
    for servo in (
        Servo("XH430-W350", 12.0, 3.4, 1.3, 30 * math.tau / 60, 0.040, 900),
        Servo("XM430-W350", 12.0, 4.1, 2.3, 46 * math.tau / 60, 0.040, 800),
    )
}
"""By model; e-Manual of the maker, specifications."""


def servo_of(model: str) -> Servo | None:
    """Return the data sheet of a model, None for one that is not known here."""
    return SERVOS.get(model)
