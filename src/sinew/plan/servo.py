"""The servos: a row of numbers for each model, and what a count of their registers means in all of them.

Source: e-Manual of the maker, specifications and control table of each model. What the registers of a model allow and
begin with stands in `sinew.hardware.registers`; nothing else knows a model by name.
"""

import math
from dataclasses import dataclass

FULL_DUTY_COUNTS = 885
"""Counts of the registers of PWM that are the whole supply."""

COUNTS_PER_VOLT = 10
VOLTAGE_LSB = 1 / COUNTS_PER_VOLT
"""Unit of the registers of voltage [V]."""

COUNTS_PER_TURN = 4096
PULSE = math.tau / COUNTS_PER_TURN
"""Unit of the registers of position [rad]."""

MOST_TURN_COUNTS = 1_048_575
"""What goal_position takes in the modes of many turns, either way: 256 turns."""

SPEED_LSB = 0.229 * math.tau / 60
"""Unit of the registers of speed [rad/s]."""

ACCELERATION_LSB = 214.577 * math.tau / 60**2
"""Unit of the register profile_acceleration [rad/s²]."""

P_GAIN_LSB = 1 / 128
"""Factor of the P gains of position and velocity, in counts of PWM a count of theirs."""

WATCHDOG_LSB, RETURN_DELAY_LSB = 20e-3, 2e-6
"""Units of the registers bus_watchdog and return_delay_time [s]."""


def winding_resistance(nominal_voltage: float, stall_current: float) -> float:
    """Return the resistance of winding, brushes and bridge [Ω], from voltage [V] and current [A] of a stalled motor."""
    return nominal_voltage / stall_current


@dataclass(frozen=True)
class Servo:
    """One model, as its data sheet has it; torque and speed at the horn.

    number: what it answers to a ping. nominal_voltage: at which the others hold [V]. stall_torque [N m],
    stall_current [A], no_load_speed [rad/s].
    standby_current: of the whole servo with its torque off, from the supply [A].
    position_gain_counts: register Position P Gain as from the factory, to which a rig's servo_stiffness belongs.
    current_lsb: unit of its registers of current [A].
    brown_out: supply below which its controller stops working [V]; assumed.
    """

    model: str
    number: int
    nominal_voltage: float
    stall_torque: float
    stall_current: float
    no_load_speed: float
    standby_current: float
    position_gain_counts: int
    current_lsb: float
    brown_out: float

    def supply_share(self, supply: float) -> float:
        """Return a supply [V] over the voltage at which the numbers hold [1]."""
        return supply / self.nominal_voltage

    @property
    def resistance(self) -> float:
        """Return that of winding, brushes and bridge [Ω]."""
        return winding_resistance(self.nominal_voltage, self.stall_current)


PAPER_TENDON, PAPER_DRIVE = "XH430-W350", "XM430-W350"
"""The models of the paper's joint, which a rig has that names none."""

SERVOS = {
    servo.model: servo
    for servo in (
        # model, number, V, N m, A, rad/s, standby A, P gain, A a count, brown-out V
        # 1.34 mA a count, which one finds too, belongs to the 24 V types XH430-V350 and V210.
        Servo("XH430-W350", 1000, 12.0, 3.4, 1.3, 30 * math.tau / 60, 0.040, 900, 2.69e-3, 6.5),
        Servo("XM430-W350", 1020, 12.0, 4.1, 2.3, 46 * math.tau / 60, 0.040, 800, 2.69e-3, 6.5),
        # The manual does not say where it browns out either: below 3.1 V, the least that its voltage limits take.
        Servo("XL330-M288", 1200, 5.0, 0.52, 1.47, 103 * math.tau / 60, 0.017, 400, 1e-3, 3.1),
    )
}
"""By model."""
