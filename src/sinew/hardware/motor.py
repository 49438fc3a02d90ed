"""A motor of the bus, set up and asked: registers by name, torque, watchdog, modes, errors; as a tendon, as the drive.

What a motor does not do raises DeviceError with a sentence. The bench's cycle does not go this way, see
`sinew.hardware.rig`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sinew.hardware.believable import STATE, contradiction
from sinew.hardware.bus import Bus, Outcome, Reply
from sinew.hardware.registers import (
    CURRENT_MODE,
    CURRENT_POSITION_MODE,
    EXTENDED_POSITION_MODE,
    HARDWARE_ERRORS,
    MOTORS,
    WATCHDOG_TRIPPED,
    Register,
    RegisterTable,
    decode_raw,
    encode_raw,
    lay_out,
)
from sinew.measure.errors import DeviceError, RegisterError
from sinew.plan.plan import TendonMode
from sinew.plan.servo import COUNTS_PER_TURN, SERVOS

RETRIES = 3
"""How often a device that is set up is asked again where it did not answer, or answered damaged."""

FAST_READS_FROM = 45
"""Firmware from which an X430 motor knows the fast reads of several devices."""

_LOOKS = 6
"""How many answers about one state are held against one another before nobody is believed."""

_OUT_OF_RANGE = 4
_ADVICE = {
    Outcome.SILENT: "check its cable, supply, id and baud; if it answers pings, the doctor sets status_return_level",
    Outcome.DAMAGED: "check the cable, and that no two devices have this id",
    Outcome.WRONG_LENGTH: "check that no two devices have this id",
    Outcome.REFUSED: "`sinew doctor` shows the state of its registers",
}


@dataclass(frozen=True, slots=True)
class Identity:
    """Who answers at an id. number: of the model. firmware: its version."""

    id: int
    number: int
    firmware: int


class Motor:
    """One motor on the bus.

    name: as a user knows it, "tendon 1" or "drive". id: on the bus. table: of its model.
    sign: 1 where more counts of the encoder are positive in the rig's sense, else -1.
    kept: counts by register that it was seen to hold when it was set up, and is to hold from then on.
    """

    def __init__(self, bus: Bus, name: str, device: int, table: RegisterTable, sign: int = 1) -> None:
        self.bus, self.name, self.id, self.table, self.sign = bus, name, device, table, sign
        self.kept: dict[str, int] = {}

    def identify(self) -> Identity:
        """Return who answers. Raises DeviceError if nobody does, or another model than expected."""
        return check_identity(self.bus, self.name, self.id, self.table)

    def get(self, register: str) -> float:
        """Return a register's quantity, in the sense of the motor's own counts. Raises DeviceError."""
        row = self.table[register]
        return self.get_count(register) * row.scale

    def get_count(self, register: str) -> int:
        """Return a register's count. Raises DeviceError."""
        row = self.table[register]
        reply = self.bus.read(self.id, row.address, row.size, retries=RETRIES)
        if not reply.ok:
            raise self._trouble("cannot read", row, reply)
        return int(decode_raw(row, reply.data))

    def get_counts(self, registers: Sequence[str]) -> dict[str, int]:
        """Return several registers' counts, read at once; they must be named by increasing address.

        Raises DeviceError, or RegisterError for another order.
        """
        return self._counts_at(registers)[0]

    def state(self) -> dict[str, int]:
        """Return the registers of `STATE` as two answers in succession have them.

        What a motor is told by its own words hangs on them: a single answer may be false. Raises DeviceError where
        answers go on contradicting one another, or cannot be true.
        """
        before, then = self._counts_at(STATE)
        for _ in range(_LOOKS):
            again, now = self._counts_at(STATE)
            why = contradiction(self.table, before, again, now - then)
            if not why:
                return again
            before, then = again, now
        raise DeviceError(
            f"{self._who()} does not tell one state: {why}; check the cable, and that no other device has its id"
        )

    def _counts_at(self, registers: Sequence[str]) -> tuple[dict[str, int], float]:
        """Return counts as `get_counts`, and when they had come [s, of the bus's clock]."""
        layout = lay_out(self.table, registers)
        reply = self.bus.read(self.id, layout.address, layout.length, retries=RETRIES)
        if not reply.ok:
            raise self._trouble("cannot read", self.table[registers[0]], reply)
        return dict(zip(registers, layout.unpack.unpack(reply.data), strict=True)), reply.at

    def set(self, register: str, value: float) -> None:
        """Store a quantity [unit of the register]. Raises DeviceError, or RegisterError where it cannot hold that."""
        self.set_count(register, round(value / self.table[register].scale))

    def set_count(self, register: str, count: int) -> None:
        """Store a count. Raises DeviceError, or RegisterError where it cannot hold that."""
        row = self.table[register]
        reply = self.bus.write(self.id, row.address, encode_raw(row, count), retries=RETRIES)
        if not reply.ok:
            raise self._trouble(f"cannot write {count} to", row, reply)

    def set_counts(self, counts: Mapping[str, int]) -> None:
        """Store counts in registers that follow one another without a gap, at once. Raises as `set_count`."""
        rows = [self.table[register] for register in counts]
        data = b"".join(encode_raw(row, count) for row, count in zip(rows, counts.values(), strict=True))
        reply = self.bus.write(self.id, rows[0].address, data, retries=RETRIES)
        if not reply.ok:
            raise self._trouble(
                f"cannot write {len(rows)} registers, the first {counts[rows[0].name]}, to", rows[0], reply
            )

    def ensure_count(self, register: str, count: int) -> bool:
        """Store a count unless it is there already, and read it back; return whether it was another.

        Raises DeviceError if the motor does not take it.
        """
        if self.get_count(register) == count:
            return False
        self.set_count(register, count)
        self._expect(register, count)
        return True

    def keep_count(self, register: str, count: int) -> None:
        """Store a count, read it back, and remember that the motor is to hold it. Raises DeviceError."""
        self.set_count(register, count)
        self._expect(register, count)
        self.kept[register] = count

    def torque_is_on(self) -> bool:
        """Return whether the motor is under torque. Raises DeviceError."""
        return bool(self.get_count("torque_enable"))

    def torque_on(self) -> None:
        """Switch the torque on and read it back. Raises DeviceError, which names the hardware error if there is one."""
        self.set_count("torque_enable", 1)
        if not self.torque_is_on():
            errors = ", ".join(self.hardware_errors()) or "no hardware error"
            raise DeviceError(
                f"{self._who()} took no torque, expected torque_enable 1 ({errors}); after a shutdown only a reboot "
                "helps"
            )
        self.kept["torque_enable"] = 1

    def torque_off(self) -> None:
        """Switch the torque off and read it back. Raises DeviceError."""
        self.set_count("torque_enable", 0)
        if self.torque_is_on():
            raise DeviceError(f"{self._who()} kept its torque, expected it off; switch the supply off")
        self.kept["torque_enable"] = 0

    def require_torque_off(self, purpose: str) -> None:
        """Raise DeviceError if the torque is on. purpose: what it must be off for."""
        if self.torque_is_on():
            raise DeviceError(
                f"{self._who()} has its torque on, expected off {purpose}; "
                "make sure that nothing falls, then `sinew stop --port PORT --state release`"
            )

    def arm_watchdog(self, seconds: float) -> None:
        """Have the motor stop itself after so long [s] without any instruction on the bus, in whole units of 20 ms.

        At least one unit, else rounded down. Clears a watchdog that has tripped: it is written 0 first. Raises
        DeviceError, also where the motor does not take it, or RegisterError beyond 127 units.
        """
        unit = self.table["bus_watchdog"].scale
        self.disarm_watchdog()
        self.keep_count("bus_watchdog", max(1, int(seconds / unit + 1e-6)))

    def disarm_watchdog(self) -> None:
        """Switch the bus watchdog off, and clear it if it has tripped. Raises DeviceError."""
        self.set_count("bus_watchdog", 0)
        self.kept["bus_watchdog"] = 0

    def watchdog_tripped(self) -> bool:
        """Return whether the bus watchdog has stopped the motor. Raises DeviceError."""
        return self.get_count("bus_watchdog") == WATCHDOG_TRIPPED

    def hardware_errors(self) -> tuple[str, ...]:
        """Return the names of the hardware errors that the motor reports. Raises DeviceError."""
        return name_hardware_errors(self.get_count("hardware_error_status"))

    def _expect(self, register: str, count: int) -> None:
        if (found := self.get_count(register)) != count:
            raise DeviceError(
                f"{self._who()} has {found} in {register}, expected the {count} just written; is its torque on, or are "
                "there two devices with this id?"
            )

    def _who(self) -> str:
        return f"{self.name} (id {self.id})"

    def _trouble(self, what: str, row: Register, reply: Reply) -> DeviceError:
        if reply.number == _OUT_OF_RANGE and row.name.startswith("goal_") and self.watchdog_tripped():
            return DeviceError(f"{self._who()} takes no {row.name}: its bus watchdog has stopped it; arm it anew first")
        return DeviceError(f"{what} {row.name} of {self._who()}: {reply}; {_ADVICE[reply.outcome]}")


def check_identity(bus: Bus, name: str, device: int, table: RegisterTable) -> Identity:
    """Return who answers a ping. Raises DeviceError if nobody does, or another model than the table's.

    name: what to call the device in the sentence.
    """
    reply = bus.ping(device)
    for _ in range(RETRIES):
        if reply.ok or reply.outcome is Outcome.REFUSED:
            break
        reply = bus.ping(device)
    if not reply.ok:
        raise DeviceError(
            f"{name} does not answer: {reply}, expected a {table.model} at id {device}; {_ADVICE[reply.outcome]}"
        )
    found = Identity(device, int.from_bytes(reply.data[:2], "little"), reply.data[2])
    if found.number != table.number:
        other = MOTORS.get(found.number)
        known = f" ({other.model})" if other else ""
        raise DeviceError(
            f"{name} (id {device}) is model {found.number}{known}, expected {table.number} ({table.model}); "
            "correct ids or models in the rig's [wiring]"
        )
    return found


def name_hardware_errors(status: int) -> tuple[str, ...]:
    """Return the names of the bits set in `hardware_error_status`."""
    return tuple(HARDWARE_ERRORS.get(bit, f"bit {bit}") for bit in range(8) if status >> bit & 1)


# A motor as a tendon or the drive: angles and currents in the rig's own sense, modes by name.

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
    supply: voltage of the bench [V]; the current that a duty drives through a motor at rest goes with it.
    """

    def __init__(
        self, bus: Bus, name: str, device: int, table: RegisterTable, pull: int, *, current_limit: float, supply: float
    ) -> None:
        super().__init__(bus, name, device, table, pull)
        row = table["goal_current"]
        most = int(min(current_limit / row.scale + 1e-6, row.highest))
        self.goal_angle = GoalEncoder(name, table["goal_position"], pull)
        self.goal_current = GoalEncoder(name, row, pull, low=-most, high=most)
        servo = SERVOS[table.model]
        self._stall_current = servo.stall_current * servo.supply_share(supply)
        self._no_load_speed = servo.no_load_speed * servo.supply_share(supply)

    def angle(self) -> float:
        """Return the angle of the horn [rad], from the encoder's zero and over all turns. Raises DeviceError."""
        return self.sign * self.state()["present_position"] * self.table["present_position"].scale

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

    def turning_current(self, speed: float) -> float:
        """Return the current [A] through the motor at rest of the duty that turns it, unloaded, at a speed [rad/s]."""
        return self._stall_current * abs(speed) / self._no_load_speed

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
    window: how far from the middle it may be told to go [rad], and reach the same in counts; position mode itself
    allows one turn.
    """

    def __init__(
        self, bus: Bus, name: str, device: int, table: RegisterTable, sign: int, *, zero: int, window: float
    ) -> None:
        super().__init__(bus, name, device, table, sign)
        row = table["goal_position"]
        self.reach = reach = int(window / row.scale)
        self.zero = zero
        self.lowest_count, self.highest_count = max(0, zero - reach), min(COUNTS_PER_TURN - 1, zero + reach)
        self.goal_angle = GoalEncoder(name, row, sign, zero, self.lowest_count, self.highest_count)

    def angle(self) -> float:
        """Return the lever's angle against the head [rad]. Raises DeviceError."""
        return self.sign * (self.state()["present_position"] - self.zero) * self.table["present_position"].scale

    def set_goal_angle(self, angle: float) -> None:
        """Tell the motor an angle [rad]. Raises DeviceError, or RegisterError beyond its window."""
        self.set_count("goal_position", self.goal_angle.count(angle))

    def limit_output(self, share: float) -> None:
        """Have the motor, torque on or off, use at most such a share of the supply, 0 to 1. Raises DeviceError."""
        _limit_duty(self, share)


def _limit_duty(motor: Motor, duty: float) -> None:
    count = min(duty / motor.table["goal_pwm"].scale, motor.get_count("pwm_limit"))
    motor.keep_count("goal_pwm", int(count + 1e-6))
