"""An emulated motor, as a master sees it.

Not emulated: the secondary (shadow) id, the status with a CRC error, startup_configuration, backups, and the integral,
derivative and feed-forward gains. Assumed where the manual is silent: torque on is refused with error 1 after a
shutdown; a watchdog that has tripped takes nothing but 0; what a master asks with malformed parameters gets error 5.
As the manual has it, a new operating mode and a start put goal_current and goal_pwm to their limits, and
torque on leaves them there: a master that wants a gentle start writes them first.
"""

import math
from dataclasses import dataclass

from sinew.emulator.devices.device import (
    DATA_LIMIT,
    DATA_RANGE,
    RESULT_FAIL,
    ControlTable,
    Part,
    RegisterSet,
)
from sinew.emulator.devices.servo import MODES, Servo, goal_of, reset_for_mode
from sinew.emulator.plant import Horn
from sinew.hardware import codec as ask
from sinew.hardware.codec import Instruction
from sinew.hardware.motor import FAST_READS_FROM
from sinew.hardware.registers import (
    ELECTRICAL_SHOCK,
    OVERHEATING,
    OVERLOAD,
    POSITION_MODE,
    VOLTAGE,
    WATCHDOG_TRIPPED,
    RegisterTable,
)
from sinew.plan.servo import COUNTS_PER_VOLT, SERVOS, WATCHDOG_LSB
from sinew.plan.servo import Servo as DataSheet

# A motor grows warm, and notices that it is too warm, overloaded or badly fed.
#
# The manual says what is detected, not how. Assumed: first-order heating by I²R of the winding, whose resistance is
# nominal voltage over stall current; 6 K/W to surroundings of 25 °C with a time constant of 300 s, so that an
# XH430-W350 may carry 0.99 A for ever and is shut down 4.4 min into a stall at 12 V; overload where the current
# stays at 80 % of the stall current or more for 1 s. The voltage's bit follows the voltage unless it is in the shutdown
# mask; all others stay until the motor starts anew.

PERIOD = 0.05
"""How often a motor looks after itself [s]."""

_AMBIENT, _PER_WATT, _TIME_CONSTANT = 25.0, 6.0, 300.0
_OVERLOAD_SHARE, _OVERLOAD_TIME = 0.8, 1.0


@dataclass(slots=True)
class Protection:
    """What a motor knows about its own health.

    servo: its model. temperature: of the winding, taken for that of the register [°C]. overloaded_for: [s].
    latched: bits that stay until the motor starts anew.
    """

    servo: DataSheet
    temperature: float = _AMBIENT
    overloaded_for: float = 0.0
    latched: int = 0

    def advance(self, dt: float, current: float) -> None:
        """Carry a current [A] for a time [s]."""
        target = _AMBIENT + _PER_WATT * self.servo.resistance * current * current
        self.temperature += (target - self.temperature) * min(1.0, dt / _TIME_CONSTANT)
        loaded = abs(current) >= _OVERLOAD_SHARE * self.servo.stall_current
        self.overloaded_for = self.overloaded_for + dt if loaded else 0.0

    def errors(self, supply: float, low: float, high: float, temperature_limit: float, shutdown: int) -> int:
        """Return the bits of hardware_error_status, for a supply and its limits [V] and a limit [°C]."""
        bad_voltage = not low <= supply <= high
        if self.temperature > temperature_limit:
            self.latched |= OVERHEATING
        if self.overloaded_for >= _OVERLOAD_TIME - PERIOD / 2:
            self.latched |= OVERLOAD
        if bad_voltage and shutdown & VOLTAGE:
            self.latched |= VOLTAGE
        return self.latched | VOLTAGE * bad_voltage

    def restart(self) -> None:
        """Forget the errors; the winding stays warm."""
        self.latched = 0
        self.overloaded_for = 0.0


START_TIME = 0.3
"""How long a motor is deaf after power-on or reboot [s]; assumed."""

_GOALS = ("goal_pwm", "goal_current", "goal_velocity", "goal_position")
_LIMITS = {"goal_pwm": "pwm_limit", "goal_current": "current_limit", "goal_velocity": "velocity_limit"}
_GAINS = ("velocity_p_gain", "position_p_gain")
_TORQUE, _ERRORS = 64, 70  # addresses that every packet asks for
_TORQUE_BY_GOAL = 0x08
_CLEAR_TURNS = b"\x01\x44\x58\x4c\x22"
_PRESENT = range(120, 148)
_INDIRECT_START = 168


class Motor(RegisterSet):
    """One motor: registers, power, bus watchdog and protection around a `Servo`.

    rows: of its model. horn: what it moves. device_id, baud_code: registers id and baud_rate as set before. firmware:
    45 and later know fast reads. supply: [V].
    loses: as a fault, names of registers whose writes it confirms and forgets.
    """

    def __init__(
        self,
        rows: RegisterTable,
        horn: Horn,
        *,
        device_id: int = 1,
        baud_code: int = 1,
        firmware: int = 47,
        supply: float = 12,
        tells_supply: bool = False,
    ) -> None:
        super().__init__(ControlTable(rows), firmware)
        registers = self.registers
        registers["firmware_version"] = firmware
        registers["id"], registers["baud_rate"] = device_id, baud_code
        self.horn = horn
        self.protection = Protection(SERVOS[rows.model])
        self.supply = supply
        self.loses: set[str] = set()
        self._servo = Servo(registers, horn)
        self._servo.tells_supply = tells_supply
        self._deaf_until = -math.inf
        self._started = 0.0
        self._watchdog_due = math.inf
        self._next_check = PERIOD
        self._begin()

    @property
    def knows_fast_reads(self) -> bool:
        return self.firmware >= FAST_READS_FROM

    @property
    def torque(self) -> bool:
        """Whether the torque is on."""
        return self.registers.memory[_TORQUE] != 0

    @property
    def is_locked(self) -> bool:
        return self.torque

    @property
    def is_tripped(self) -> bool:
        """Whether the bus watchdog has stopped it."""
        return self.registers["bus_watchdog"] == WATCHDOG_TRIPPED

    @property
    def due(self) -> float:
        """When `advance` has something to do [s]."""
        return min(self._servo.due, self._watchdog_due, self._next_check)

    @property
    def is_powered(self) -> bool:
        """Whether the supply is enough for its controller."""
        return self.supply >= self.protection.servo.brown_out

    def hears(self, now: float) -> bool:
        return self.is_powered and now >= self._deaf_until and self.registers.memory[13] == 2

    def heed(self, now: float) -> None:
        if self._watchdog_due < math.inf:
            self._watchdog_due = now + self.registers["bus_watchdog"] * WATCHDOG_LSB

    def advance(self, now: float) -> None:
        """Do what is due: trajectory, watchdog, protection."""
        self._servo.advance(now)
        if now >= self._watchdog_due:
            self._watchdog_due = math.inf
            self.registers["bus_watchdog"] = WATCHDOG_TRIPPED
            self._servo.hold()
        if now >= self._next_check:
            self._next_check += PERIOD
            self.protection.advance(PERIOD, self.horn.motion().current)
            self._check()

    def set_supply(self, voltage: float, now: float) -> None:
        """Feed it another voltage [V]: too little turns it off, and from there it starts anew."""
        was_on = self.is_powered
        self.supply = voltage
        if self.is_powered != was_on:
            self.restart(now)
        self._check()

    def fail(self, bits: int = ELECTRICAL_SHOCK) -> None:
        """Have a hardware error, by bits of hardware_error_status, until it is rebooted."""
        self.protection.latched |= bits
        self._check()

    def restart(self, now: float) -> None:
        """Start anew: torque off, RAM registers as at power-on, deaf for `START_TIME`."""
        self._servo.turn_off()
        self.registers.restart()
        self.protection.restart()
        self._pending = None
        self._deaf_until = self._started = now + START_TIME
        self._begin()

    def refresh(self, address: int, length: int, now: float) -> None:
        if (address < _PRESENT.stop and address + length > _PRESENT.start) or address + length > _INDIRECT_START:
            self._servo.tell(int((now - self._started) * 1000), self.supply, self.protection.temperature)

    def write(self, address: int, data: bytes, now: float) -> int:
        number, parts = self.admit(address, data)
        if not number:
            parts = [(row, count) for row, count in parts if row.name not in self.loses] if self.loses else parts
            for row, count in parts:
                self.registers.store(row, count)
            for row, count in parts:
                self._react(row.name, count, now)
        return number

    def carry_out(self, instruction: Instruction, now: float) -> int:
        if instruction.code == ask.CLEAR:
            return self._clear(instruction.params)
        return super().carry_out(instruction, now)

    def _begin(self) -> None:
        reset_for_mode(self.registers)
        self._watchdog_due = math.inf
        self._servo.forget_turns()

    def admit(self, address: int, data: bytes) -> tuple[int, list[Part]]:
        number, parts = super().admit(address, data)
        for row, count in parts:
            if objection := self._objection(row.name, count):
                return objection, []
        return number, parts

    def _objection(self, name: str, count: int) -> int:
        """Return the error number of a value that the register could hold but the motor does not take; else 0."""
        registers = self.registers
        if name in _GOALS:
            if self.is_tripped:
                return DATA_RANGE
            if name in _LIMITS:
                return DATA_LIMIT if abs(count) > registers[_LIMITS[name]] else 0
            in_window = registers["min_position_limit"] <= count <= registers["max_position_limit"]
            return DATA_LIMIT if registers["operating_mode"] == POSITION_MODE and not in_window else 0
        if name == "operating_mode":
            return 0 if count in MODES else DATA_RANGE
        if name == "bus_watchdog":
            return DATA_RANGE if self.is_tripped and count else 0
        if name == "torque_enable":
            return RESULT_FAIL if count and self.protection.latched & registers["shutdown"] else 0
        return 0

    def _react(self, name: str, count: int, now: float) -> None:
        """Act on a register that has been written."""
        if name in _GOALS:
            if not self.torque and self.registers["drive_mode"] & _TORQUE_BY_GOAL:
                goal = self.registers[name]
                self.registers["torque_enable"] = 1
                self._switch(True, now)
                self.registers[name] = goal
            if name == goal_of(self.registers["operating_mode"]):
                self._servo.aim(now)
            else:
                self._servo.pursue(now)
        elif name == "torque_enable":
            self._switch(bool(count), now)
        elif name == "operating_mode":
            reset_for_mode(self.registers)
            self._servo.forget_turns()
        elif name == "bus_watchdog":
            self._arm(now)
        elif name in _GAINS:
            self._servo.pursue(now)

    def _switch(self, on: bool, now: float) -> None:
        if on and not self._servo.is_on:
            self._servo.turn_on(now)
        elif not on and self._servo.is_on:
            self._servo.turn_off()
        self._arm(now)

    def _arm(self, now: float) -> None:
        """Let the watchdog count from now on, where it is set and the torque is on."""
        units = self.registers["bus_watchdog"]
        self._watchdog_due = now + units * WATCHDOG_LSB if units > 0 and self.torque else math.inf

    def _check(self) -> None:
        """Look for hardware errors, and take the torque off if one asks for it."""
        registers, memory = self.registers, self.registers.memory
        shutdown = registers["shutdown"]
        low, high = (registers[f"{end}_voltage_limit"] / COUNTS_PER_VOLT for end in ("min", "max"))
        errors = self.protection.errors(self.supply, low, high, registers["temperature_limit"], shutdown)
        memory[_ERRORS] = errors
        if self.torque and self.protection.latched & shutdown:
            memory[_TORQUE] = 0
            self._servo.turn_off()
            self._watchdog_due = math.inf

    def _clear(self, params: bytes) -> int:
        if params != _CLEAR_TURNS:
            return DATA_RANGE
        if self._servo.is_moving():
            return RESULT_FAIL
        self._servo.forget_turns()
        return 0
