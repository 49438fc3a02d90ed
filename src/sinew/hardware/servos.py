"""A motor as a tendon or the drive: angles and currents in the rig's own sense, modes by name."""

import math

from sinew.hardware.bus import Bus
from sinew.hardware.errors import RegisterError
from sinew.hardware.motor import Motor
from sinew.hardware.register_tables import (
    CURRENT_MODE,
    CURRENT_POSITION_MODE,
    EXTENDED_POSITION_MODE,
)
from sinew.hardware.registers import Register, RegisterTable
from sinew.plan.plan import TendonMode
from sinew.plan.servo import COUNTS_PER_TURN, SERVOS

TENDON_MODES: dict[TendonMode, int] = {
    "position": EXTENDED_POSITION_MODE,
    "position-with-current-limit": CURRENT_POSITION_MODE,
    "current": CURRENT_MODE,
}
"""Value of the register `operating_mode` for each way a plan may run the tendon motors."""


class GoalEncoder:
    """Turns quantities in the rig's sense into the bytes of one goal register.

    name: of the motor, for the sentence. row: of the register. sign, zero: of its counts.
    low, high: counts that may be asked for; by default those that the register can hold.
    """

    def __init__(
        self, name: str, row: Register, sign: int, zero: int = 0, low: int | None = None, high: int | None = None
    ) -> None:
        self.name, self.address, self.row = name, row.address, row
        self._per_unit, self._zero = sign / row.scale, zero
        self._size = row.size
        self.low = row.lowest if low is None else low
        self.high = row.highest if high is None else high

    def count(self, value: float) -> int:
        """Return the nearest count. Raises RegisterError where the motor may not be asked for that."""
        if not math.isfinite(value):
            raise RegisterError(f"{self.name} cannot be told {value} as {self.row.name}; expected a finite number")
        count = round(value * self._per_unit) + self._zero
        if not self.low <= count <= self.high:
            ends = sorted((end - self._zero) / self._per_unit for end in (self.low, self.high))
            raise RegisterError(
                f"{self.name} cannot be told {value:.4g} {self.row.unit} as {self.row.name}; "
                f"expected {ends[0]:.4g} to {ends[1]:.4g}"
            )
        return count

    def encode(self, value: float) -> bytes:
        """Return the bytes of the nearest count; errors as for `count`."""
        return self.count(value).to_bytes(self._size, "little", signed=True)


class TendonServo(Motor):
    """A motor that pulls a tendon. Angles and currents are positive where it pulls.

    pull: 1 where more counts pull, else -1. current_limit: the largest current it may be told [A].
    supply: voltage of the bench [V], by default the model's nominal one; the current that a duty drives through a motor
    at rest goes with it.
    """

    def __init__(
        self,
        bus: Bus,
        name: str,
        device: int,
        table: RegisterTable,
        pull: int = 1,
        *,
        current_limit: float = math.inf,
        supply: float | None = None,
    ) -> None:
        super().__init__(bus, name, device, table, pull)
        row = table["goal_current"]
        most = int(min(current_limit / row.scale + 1e-6, row.highest))
        self.goal_angle = GoalEncoder(name, table["goal_position"], pull)
        self.goal_current = GoalEncoder(name, row, pull, low=-most, high=most)
        servo = SERVOS[table.model]
        volts = servo.nominal_voltage if supply is None else supply
        self._stall_current = servo.stall_current * volts / servo.nominal_voltage

    def angle(self) -> float:
        """Return the angle of the horn [rad], from the encoder's zero and over all turns. Raises DeviceError."""
        return self.sign * self.get("present_position")

    def current(self) -> float:
        """Return the current [A]. Raises DeviceError."""
        return self.sign * self.get("present_current")

    def set_goal_angle(self, angle: float) -> None:
        """Tell the motor an angle [rad]. Raises DeviceError, or RegisterError beyond 256 turns."""
        self.set_count("goal_position", self.goal_angle.count(angle))

    def set_goal_current(self, current: float) -> None:
        """Tell the motor a current [A]. Raises DeviceError, or RegisterError beyond the rig's limit."""
        self.set_count("goal_current", self.goal_current.count(current))

    def standstill_duty(self, current: float) -> float:
        """Return the share of the supply, 0 to 1 and more, that drives a current [A] through the motor at rest."""
        return current / self._stall_current

    def limit_output(self, current: float) -> None:
        """Have the motor, torque on or off, drive at most so much current through itself at rest [A].

        Through goal_pwm in position mode, whose duty drives that current through a motor at rest; through goal_current
        in position mode with a current limit; through goal_pwm, too, in current mode, where the goal itself is cut to
        that. Never above the limits set in the motor, so infinity takes the limit away. A change of mode takes it away,
        too. Raises DeviceError.
        """
        if current < 0 or math.isnan(current):
            raise RegisterError(f"{self.name} cannot be limited to {current} A; expected a number that is not negative")
        mode = self.get_count("operating_mode")
        if mode != CURRENT_POSITION_MODE:
            _limit_duty(self, self.standstill_duty(current))
            if mode != CURRENT_MODE:
                return
        count = int(min(current / self.table["goal_current"].scale + 1e-6, self.get_count("current_limit")))
        if mode == CURRENT_MODE:
            goal = self.get_count("goal_current")
            self.set_count("goal_current", max(-count, min(count, goal)))
            return
        self.keep_count("goal_current", count)


class DriveServo(Motor):
    """The motor that swings the lever against the head, in position mode.

    zero: counts of the encoder with the lever in its middle. sign: 1 where more counts turn it positively, else -1.
    window: how far from the middle it may be told to go [rad]; position mode itself allows one turn.
    """

    def __init__(
        self,
        bus: Bus,
        name: str,
        device: int,
        table: RegisterTable,
        sign: int = 1,
        *,
        zero: int = COUNTS_PER_TURN // 2,
        window: float = math.pi,
    ) -> None:
        super().__init__(bus, name, device, table, sign)
        row = table["goal_position"]
        reach = int(window / row.scale)
        self.zero = zero
        self.lowest_count, self.highest_count = max(0, zero - reach), min(COUNTS_PER_TURN - 1, zero + reach)
        self.goal_angle = GoalEncoder(name, row, sign, zero, self.lowest_count, self.highest_count)

    def angle(self) -> float:
        """Return the lever's angle against the head [rad]. Raises DeviceError."""
        return self.sign * (self.get_count("present_position") - self.zero) * self.table["present_position"].scale

    def set_goal_angle(self, angle: float) -> None:
        """Tell the motor an angle [rad]. Raises DeviceError, or RegisterError beyond its window."""
        self.set_count("goal_position", self.goal_angle.count(angle))

    def limit_output(self, share: float) -> None:
        """Have the motor, torque on or off, use at most such a share of the supply, 0 to 1. Raises DeviceError."""
        _limit_duty(self, share)


def _limit_duty(motor: Motor, duty: float) -> None:
    count = min(duty / motor.table["goal_pwm"].scale, motor.get_count("pwm_limit"))
    motor.keep_count("goal_pwm", int(count + 1e-6))
