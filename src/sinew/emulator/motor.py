"""An emulated motor: what moves its horn, and the motor as a master sees it.

Not emulated: the secondary (shadow) id, startup_configuration, and the integral, derivative and feed-forward gains.
Assumed where the manual is silent: torque on is refused with error 1 after a shutdown, and so is restoring without a
backup; a watchdog that has tripped takes nothing but 0; what a master asks with malformed parameters gets error 5.
As the manual has it, a new operating mode and a start put goal_current and goal_pwm to their limits, and
torque on leaves them there: a master that wants a gentle start writes them first.
"""

import math
import struct
from dataclasses import dataclass

from sinew.emulator.device import DATA_LIMIT, DATA_RANGE, RESULT_FAIL, START_TIME, ControlTable, Device, Part
from sinew.emulator.plant import HornMotion, JointPlant, Law
from sinew.hardware import codec as ask
from sinew.hardware.codec import Instruction
from sinew.hardware.motor import FAST_READS_FROM
from sinew.hardware.registers import (
    CURRENT_MODE,
    CURRENT_POSITION_MODE,
    ELECTRICAL_SHOCK,
    EXTENDED_POSITION_MODE,
    OVERHEATING,
    OVERLOAD,
    POSITION_MODE,
    PWM_MODE,
    VELOCITY_MODE,
    VOLTAGE,
    WATCHDOG_TRIPPED,
    RegisterTable,
)
from sinew.plan.servo import (
    ACCELERATION_LSB,
    COUNTS_PER_TURN,
    COUNTS_PER_VOLT,
    FULL_DUTY_COUNTS,
    P_GAIN_LSB,
    PULSE,
    SERVOS,
    SPEED_LSB,
    WATCHDOG_LSB,
)

# ---- a motor at its horn: its goals move it, and its motion becomes the present registers


# A goal becomes a trajectory: a motor's speed and acceleration profile.
#
# Source: e-Manual, "What is the Profile". The trajectory is advanced in steps, from where it is and as fast as it is,
# so that a goal that changes on the way is met smoothly.

PROFILE_STEP = 2e-3
"""Time between two points of a trajectory [s]."""


@dataclass(slots=True)
class Profile:
    """Where a trajectory is, in counts and counts/s, and where it goes.

    top_speed: [counts/s], 0: none, the goal is taken at once. acceleration: [counts/s²], 0: the speed is taken at once.
    """

    position: float = 0.0
    speed: float = 0.0
    goal: float = 0.0
    top_speed: float = 0.0
    acceleration: float = 0.0
    is_running: bool = False

    def jump(self, position: float) -> None:
        """Be at a position, at rest."""
        self.position = self.goal = position
        self.speed = 0.0
        self.is_running = False

    def aim(self, goal: float, top_speed: float, acceleration: float) -> None:
        """Set out for a goal."""
        if top_speed <= 0:
            self.jump(goal)
            return
        self.goal, self.top_speed, self.acceleration = goal, top_speed, acceleration
        self.is_running = goal != self.position or self.speed != 0.0

    def advance(self, dt: float) -> None:
        """Move on by a time [s]."""
        if not self.is_running:
            return
        distance = self.goal - self.position
        if self.acceleration <= 0:
            self.speed = math.copysign(self.top_speed, distance)
            done = abs(distance) <= self.top_speed * dt
        else:
            a = self.acceleration
            # Largest speed from which it still stops at the goal, in whole steps.
            brake = a * (math.sqrt(dt * dt / 4 + 2 * abs(distance) / a) - dt / 2)
            wanted = math.copysign(min(self.top_speed, brake), distance)
            change = max(-a * dt, min(a * dt, wanted - self.speed))
            self.speed += change
            done = abs(distance) <= a * dt * dt and abs(self.speed) <= 2 * a * dt
        if done:
            self.jump(self.goal)
        else:
            self.position += self.speed * dt


# An operating mode becomes a law: what of the registers the motor's controller uses.
#
#     0 current           goal_current, duty limited by goal_pwm
#     1 velocity          goal_velocity, duty limited by goal_pwm
#     3 position          goal_position within the position limits, one turn, duty limited by goal_pwm
#     4 extended position goal_position over 512 turns, duty limited by goal_pwm
#     5 current-based     as 4, and the current limited by goal_current
#     16 PWM              goal_pwm
#
# Source: e-Manual, "Operating Mode(11)". Integral, derivative and feed-forward gains
# are kept in their registers and have no effect; the velocity loop's missing integral part is made up for by a larger
# P gain.

MODES = (CURRENT_MODE, VELOCITY_MODE, POSITION_MODE, EXTENDED_POSITION_MODE, CURRENT_POSITION_MODE, PWM_MODE)
"""Values of operating_mode that there are."""
POSITION_MODES = (POSITION_MODE, EXTENDED_POSITION_MODE, CURRENT_POSITION_MODE)
"""Those that go to goal_position."""

_INTEGRAL = 16.0  # factor on the velocity loop's P gain that stands for its integral part


def goal_of(mode: int) -> str:
    """Return the register that a mode goes by."""
    goals = {CURRENT_MODE: "goal_current", VELOCITY_MODE: "goal_velocity", PWM_MODE: "goal_pwm"}
    return goals.get(mode, "goal_position")


def reset_for_mode(registers: ControlTable) -> None:
    """Do to the registers what a new operating mode does: gains as from the factory, no profile, goals to their limits.

    The manual gives the gains of mode 5 no numbers of their own; they are taken to be those of the others.
    """
    for row in registers.rows:
        if row.name.endswith("_gain") and row.initial is not None:
            registers[row.name] = row.initial
    registers["profile_velocity"] = registers["profile_acceleration"] = 0
    registers["goal_pwm"] = registers["pwm_limit"]
    registers["goal_current"] = registers["current_limit"]


def law_of(registers: ControlTable, sign: int, angle: float, speed: float) -> Law:
    """Return the law of the present mode and goals.

    sign: of the plant's sense that counts have. angle: the plant's angle to go to [rad], speed: the plant's speed to
    keep [rad/s], in the modes that do so.
    """
    mode, ampere = registers["operating_mode"], registers.rows["goal_current"].scale
    if mode == PWM_MODE:
        return Law("pwm", sign * _duty(registers["goal_pwm"]))
    limit = abs(_duty(registers["goal_pwm"]))
    if mode == CURRENT_MODE:
        return Law("current", sign * registers["goal_current"] * ampere, duty_limit=limit)
    if mode == VELOCITY_MODE:
        gain = registers["velocity_p_gain"] * P_GAIN_LSB / FULL_DUTY_COUNTS / SPEED_LSB * _INTEGRAL
        return Law("velocity", speed, gain, limit)
    gain = registers["position_p_gain"] * P_GAIN_LSB / FULL_DUTY_COUNTS / PULSE
    current = abs(registers["goal_current"]) * ampere if mode == CURRENT_POSITION_MODE else math.inf
    return Law("position", angle, gain, limit, current)


def _duty(counts: int) -> float:
    return max(-1.0, min(1.0, counts / FULL_DUTY_COUNTS))


_LARGEST_OFFSET_IN_ONE_TURN = 1024  # homing offset beyond it is ignored in position mode
_PRESENT_LAYOUT = struct.Struct("<HBBhhiiiiHB")  # realtime_tick .. present_temperature
_PRESENT_START = 120
_DRIVE_MODE, _MODE = 10, 11  # addresses of single bytes that are asked for all the time
_COUNTS_PER_SPEED = SPEED_LSB / PULSE  # counts/s
_COUNTS_PER_ACCELERATION = ACCELERATION_LSB / PULSE  # counts/s²
_REACHED = 20.0  # counts within which a goal counts as reached, or a trajectory as followed; assumed
_REVERSE, _TIME_BASED = 0x01, 0x04
_ONGOING, _FOLLOWING_ERROR, _IN_POSITION = 0x02, 0x08, 0x01
_RECTANGULAR, _TRAPEZOIDAL = 0x10, 0x30


class Servo:
    """What a motor does with its horn.

    Positions are counts as the registers have them: those of the encoder, less whole turns (since the motor knows its
    turns only from when it was started), plus the homing offset. In reverse mode all of them, speeds and efforts
    included, are inverted (the manual says so of positions; of the others it is assumed).

    index: of the motor in the plant; one beyond the tendons is the drive. sign: of the counts that the plant's positive
    sense makes. zero: what the encoder reads at the plant's angle zero.
    law, law_since: what controls the horn, and since when [s].
    due: when it is to be advanced again [s]. is_on: whether the torque is. is_held: whether it was stopped, and waits
    for another goal. tells_supply: whether its register of the current tells the supply's and not the motor's.
    """

    def __init__(self, registers: ControlTable, plant: JointPlant, index: int, sign: int, zero: float) -> None:
        self._registers, self._plant = registers, plant
        self._index, self._mounted, self._zero = index, sign, zero
        self._profile = Profile()
        self.is_on = False
        self._turns = 0.0
        self.due = math.inf
        self.is_held = self.tells_supply = False
        self.law, self.law_since = Law(), 0.0
        plant.set_law(index, self.law)

    def motion(self) -> HornMotion:
        """Return how the horn moves at present, in the plant's sense."""
        return self._plant.horn(self._index)

    def _set_law(self, law: Law) -> None:
        if law != self.law:
            self._plant.set_law(self._index, law)
            self.law, self.law_since = law, self._plant.time

    @property
    def _direction(self) -> int:
        return -1 if self._registers.memory[_DRIVE_MODE] & _REVERSE else 1

    @property
    def sign(self) -> int:
        """Of the plant's sense that more counts have."""
        return self._direction * self._mounted

    def position(self, *, in_first_turn: bool = False) -> float:
        """Return the present position in counts, with fractions. in_first_turn: whether whole turns are forgotten."""
        counts = self._direction * (self._zero + self._mounted * self.motion().angle / PULSE)
        if in_first_turn or (not self.is_on and self._registers.memory[_MODE] == POSITION_MODE):
            self._turns = math.floor(round(counts) / COUNTS_PER_TURN) * COUNTS_PER_TURN
        return counts - self._turns + self._offset()

    def forget_turns(self) -> None:
        """Take the present position for one within the first turn."""
        self._profile.jump(self.position(in_first_turn=True))
        if self.is_on:
            self._settle_on_present()

    def turn_on(self, now: float) -> None:
        """Put the torque on: from where it is, at rest."""
        self.position()
        self.is_on, self.is_held = True, False
        self._registers["goal_velocity"] = 0
        self._settle_on_present()
        self.pursue(now)

    def turn_off(self) -> None:
        """Take the torque off."""
        self.is_on = False
        self.due = math.inf
        self._set_law(Law())
        self._profile.jump(self.position())

    def hold(self) -> None:
        """Stop where it is, whatever the goal and the profile; with no output in current and PWM mode (assumed).

        In extended position mode the firmware forgets the homing offset here, and the motor moves by as much
        (ROBOTIS-GIT/DynamixelSDK issue 584).
        """
        registers, mode = self._registers, self._registers.memory[_MODE]
        self.is_held = True
        self.due = math.inf
        if mode in POSITION_MODES:
            self._settle_on_present()
            fault = self._offset() if mode == EXTENDED_POSITION_MODE else 0
            self._set_law(law_of(registers, self.sign, self._angle_of(self._profile.position + fault), 0.0))
            return
        registers[goal_of(mode)] = 0
        self._profile.jump(0.0)
        self._set_law(law_of(registers, self.sign, 0.0, 0.0))

    def aim(self, now: float) -> None:
        """Set out for the goal that the registers have now."""
        registers, mode = self._registers, self._registers.memory[_MODE]
        if not self.is_on:
            return
        self.is_held = False
        if mode in POSITION_MODES:
            goal = float(registers["goal_position"])
            self._profile.aim(goal, *self._pace(goal))
        elif mode == VELOCITY_MODE:
            rate = registers["profile_acceleration"] * _COUNTS_PER_ACCELERATION / _COUNTS_PER_SPEED
            self._profile.aim(float(registers["goal_velocity"]), rate, 0.0)
        self.pursue(now)

    def pursue(self, now: float) -> None:
        """Have the horn follow the registers and the trajectory."""
        if not self.is_on or self.is_held:
            return
        self.due = min(self.due, now + PROFILE_STEP) if self._profile.is_running else math.inf
        at, sign = self._profile.position, self.sign
        is_speed = self._registers.memory[_MODE] == VELOCITY_MODE
        angle, speed = (0.0, sign * at * SPEED_LSB) if is_speed else (self._angle_of(at), 0.0)
        self._set_law(law_of(self._registers, sign, angle, speed))

    def advance(self, now: float) -> None:
        """Go one step along the trajectory, if one is due."""
        if now >= self.due:
            self._profile.advance(PROFILE_STEP)
            self.due += PROFILE_STEP
            self.pursue(now)

    def is_moving(self) -> bool:
        """Return what the register `moving` says."""
        is_underway = self._profile.is_running and self._registers.memory[_MODE] in POSITION_MODES
        return is_underway or abs(self.motion().speed) / SPEED_LSB > self._registers["moving_threshold"]

    def tell(self, tick: int, volts: float, degrees: float) -> None:
        """Bring the present registers up to date."""
        registers, sign = self._registers, self.sign
        motion, position, profile = self.motion(), self.position(), self._profile
        current = motion.current * abs(motion.duty) if self.tells_supply else motion.current
        speed = registers.memory[_MODE] == VELOCITY_MODE
        _PRESENT_LAYOUT.pack_into(
            registers.memory,
            _PRESENT_START,
            tick & 0x7FFF,
            self.is_moving(),
            self._status(position),
            _clip(sign * motion.duty * FULL_DUTY_COUNTS, 16),
            _clip(sign * current / registers.rows["present_current"].scale, 16),
            _clip(sign * motion.speed / SPEED_LSB, 32),
            _clip(position, 32),
            _clip(profile.position if speed else profile.speed / _COUNTS_PER_SPEED, 32),
            0 if speed else _clip(profile.position, 32),
            max(0, min(0xFFFF, round(volts * COUNTS_PER_VOLT))),
            max(0, min(0xFF, int(degrees))),
        )

    def _status(self, position: float) -> int:
        """Return the bits of moving_status."""
        registers = self._registers
        if not self.is_on or registers.memory[_MODE] not in POSITION_MODES:
            return 0
        bits = _IN_POSITION * (abs(registers["goal_position"] - position) <= _REACHED)
        bits |= _FOLLOWING_ERROR * (abs(self._profile.position - position) > _REACHED)
        if self._profile.is_running:
            bits |= _ONGOING | (_TRAPEZOIDAL if self._profile.acceleration else _RECTANGULAR)
        return bits

    def _settle_on_present(self) -> None:
        """Make the present position the goal, at rest; of a motor that keeps a speed, take it for standing still."""
        if self._registers.memory[_MODE] == VELOCITY_MODE:
            self._profile.jump(0.0)
            return
        present = round(self.position())
        self._registers["goal_position"] = present
        self._profile.jump(float(present))

    def _offset(self) -> int:
        """Return the homing offset that counts."""
        registers = self._registers
        offset = registers["homing_offset"]
        in_one_turn = registers.memory[_MODE] == POSITION_MODE
        return 0 if in_one_turn and abs(offset) > _LARGEST_OFFSET_IN_ONE_TURN else offset

    def _angle_of(self, position: float) -> float:
        counts = self._direction * (position - self._offset() + self._turns)
        return self._mounted * (counts - self._zero) * PULSE

    def _pace(self, goal: float) -> tuple[float, float]:
        """Return the top speed [counts/s] and acceleration [counts/s²] of the way to a goal; 0 where there is none."""
        registers = self._registers
        velocity, acceleration = registers["profile_velocity"], registers["profile_acceleration"]
        if velocity <= 0:
            return 0.0, 0.0
        if registers["drive_mode"] & _TIME_BASED:
            whole = velocity * 1e-3
            ramp = min(acceleration * 1e-3, whole / 2)
            top = abs(goal - self._profile.position) / (whole - ramp)
            return top, (top / ramp if ramp else 0.0)
        top = min(velocity, registers["velocity_limit"]) * _COUNTS_PER_SPEED
        return top, acceleration * _COUNTS_PER_ACCELERATION


def _clip(value: float, bits: int) -> int:
    limit = 1 << (bits - 1)
    return max(-limit, min(limit - 1, round(value)))


# ---- the motor as a master sees it
#
# A motor grows warm, and notices that it is too warm, overloaded or badly fed. The manual says what is detected, not
# how. Assumed: first-order heating by I²R of the winding, whose resistance is nominal voltage over stall current; 6 K/W
# to surroundings of 25 °C with a time constant of 300 s, so that an XH430-W350 may carry 0.99 A for ever and is shut
# down 4.4 min into a stall at 12 V; overload where the current stays at 80 % of the stall current or more for 1 s. The
# voltage's bit follows the voltage unless it is in the shutdown mask; all others stay until the motor starts anew.

FIRMWARE = 47
"""Version that a motor tells; from 45 on they know fast reads and backups of their registers."""

PERIOD = 0.05
"""How often a motor looks after itself [s]."""

_AMBIENT, _PER_WATT, _TIME_CONSTANT = 25.0, 6.0, 300.0
_OVERLOAD_SHARE, _OVERLOAD_TIME = 0.8, 1.0

_GOALS = ("goal_pwm", "goal_current", "goal_velocity", "goal_position")
_LIMITS = {"goal_pwm": "pwm_limit", "goal_current": "current_limit", "goal_velocity": "velocity_limit"}
_GAINS = ("velocity_p_gain", "position_p_gain")
_TORQUE, _ERRORS = 64, 70  # addresses that every packet asks for
_TORQUE_BY_GOAL = 0x08
_CLEAR_TURNS = b"\x01\x44\x58\x4c\x22"
_STORE, _RESTORE = b"\x01CTRL", b"\x02CTRL"
_BACKUP_FROM = 45  # firmware of the X430 series (e-Manual, "DYNAMIXEL Protocol 2.0", Control Table Backup)
_PRESENT = range(120, 148)
_INDIRECT_START = 168


class Motor(Device):
    """One motor: registers, power, bus watchdog and protection around a `Servo`.

    rows: of its model. index, sign, zero: of its horn in the plant (`Servo`). supply: [V]. temperature: of the winding,
    taken for that of the register [°C].
    As faults: heated_by, from outside [K/s]; is_burdened, whether it bears too much load while its torque is on; loses,
    names of registers whose writes it confirms and forgets.
    """

    fast_reads_from = FAST_READS_FROM

    def __init__(
        self, rows: RegisterTable, plant: JointPlant, index: int, sign: int, zero: float = 2048, supply: float = 12
    ) -> None:
        super().__init__(ControlTable(rows), FIRMWARE)
        self.registers["firmware_version"] = FIRMWARE
        self._data, self.supply = SERVOS[rows.model], supply
        self.is_powered = supply >= self._data.brown_out
        self.temperature, self.heated_by, self.is_burdened = _AMBIENT, 0.0, False
        self._overloaded_for, self._latched = 0.0, 0  # [s]; bits that stay until the motor starts anew
        self.loses: set[str] = set()
        self.servo = Servo(self.registers, plant, index, sign, zero)
        self._backup: bytes | None = None
        self._started = 0.0
        self._watchdog_due = math.inf
        self._next_check = PERIOD
        self._begin()

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
        return min(self.servo.due, self._watchdog_due, self._next_check)

    def hears(self, now: float) -> bool:
        return super().hears(now) and self.registers.memory[13] == 2

    def heed(self, now: float) -> None:
        if self._watchdog_due < math.inf:
            self._watchdog_due = now + self.registers["bus_watchdog"] * WATCHDOG_LSB

    def advance(self, now: float) -> None:
        """Do what is due: trajectory, watchdog, protection."""
        self.servo.advance(now)
        if now >= self._watchdog_due:
            self._watchdog_due = math.inf
            self.registers["bus_watchdog"] = WATCHDOG_TRIPPED
            self.servo.hold()
        if now >= self._next_check:
            self._next_check += PERIOD
            self._carry(self.servo.motion().current)
            self._check()

    def set_supply(self, voltage: float, now: float) -> None:
        """Feed it another voltage [V]: too little turns it off, and from there it starts anew."""
        self.supply = voltage
        self.set_power(voltage >= self._data.brown_out, now)
        self._check()

    def fail(self, bits: int = ELECTRICAL_SHOCK) -> None:
        """Have a hardware error, by bits of hardware_error_status, until it is rebooted."""
        self._latched |= bits
        self._check()

    def restart(self, now: float) -> None:
        self.servo.turn_off()
        super().restart(now)
        self._latched, self._overloaded_for = 0, 0.0  # the winding stays warm
        self._started = now + START_TIME
        self._begin()

    def refresh(self, address: int, length: int, now: float) -> None:
        if (address < _PRESENT.stop and address + length > _PRESENT.start) or address + length > _INDIRECT_START:
            self.servo.tell(int((now - self._started) * 1000), self.supply, self.temperature)

    def carry_out(self, instruction: Instruction, now: float) -> int:
        if instruction.code == ask.CLEAR:
            return self._clear(instruction.params)
        if instruction.code == ask.CONTROL_TABLE_BACKUP and self.firmware >= _BACKUP_FROM:
            return self._back_up(instruction.params, now)
        return super().carry_out(instruction, now)

    def _begin(self) -> None:
        reset_for_mode(self.registers)
        self.registers["backup_ready"] = self._backup is not None
        self._watchdog_due = math.inf
        self.servo.forget_turns()

    def admit(self, address: int, data: bytes) -> tuple[int, list[Part]]:
        number, parts = super().admit(address, data)
        for row, count in parts:
            if objection := self._objection(row.name, count):
                return objection, []
        return number, [part for part in parts if part[0].name not in self.loses]

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
            return RESULT_FAIL if count and self._latched & registers["shutdown"] else 0
        return 0

    def react(self, name: str, count: int, now: float) -> None:
        if name in _GOALS:
            if not self.torque and self.registers["drive_mode"] & _TORQUE_BY_GOAL:
                goal = self.registers[name]
                self.registers["torque_enable"] = 1
                self._switch(True, now)
                self.registers[name] = goal
            if name == goal_of(self.registers["operating_mode"]):
                self.servo.aim(now)
            else:
                self.servo.pursue(now)
        elif name == "torque_enable":
            self._switch(bool(count), now)
        elif name == "operating_mode":
            reset_for_mode(self.registers)
            self.servo.forget_turns()
        elif name == "bus_watchdog":
            self._arm(now)
        elif name in _GAINS:
            self.servo.pursue(now)

    def _switch(self, on: bool, now: float) -> None:
        if on and not self.servo.is_on:
            self.servo.turn_on(now)
        elif not on and self.servo.is_on:
            self.servo.turn_off()
        self._arm(now)

    def _arm(self, now: float) -> None:
        """Let the watchdog count from now on, where it is set and the torque is on."""
        units = self.registers["bus_watchdog"]
        self._watchdog_due = now + units * WATCHDOG_LSB if units > 0 and self.torque else math.inf

    def _carry(self, current: float) -> None:
        """Carry a current for a period [A]."""
        target = _AMBIENT + _PER_WATT * self._data.resistance * current * current
        self.temperature += (target - self.temperature) * min(1.0, PERIOD / _TIME_CONSTANT)
        self.temperature += self.heated_by * PERIOD
        loaded = abs(current) >= _OVERLOAD_SHARE * self._data.stall_current or (self.is_burdened and self.torque)
        self._overloaded_for = self._overloaded_for + PERIOD if loaded else 0.0

    def _check(self) -> None:
        """Look for hardware errors, and take the torque off if one asks for it."""
        registers, memory, shutdown = self.registers, self.registers.memory, self.registers["shutdown"]
        low, high = (registers[f"{end}_voltage_limit"] / COUNTS_PER_VOLT for end in ("min", "max"))
        bad_voltage = VOLTAGE * (not low <= self.supply <= high)
        self._latched |= OVERHEATING * (self.temperature > registers["temperature_limit"])
        self._latched |= OVERLOAD * (self._overloaded_for >= _OVERLOAD_TIME - PERIOD / 2)
        self._latched |= bad_voltage & shutdown
        memory[_ERRORS] = self._latched | bad_voltage
        if self.torque and self._latched & shutdown:
            memory[_TORQUE] = 0
            self.servo.turn_off()
            self._watchdog_due = math.inf

    def _clear(self, params: bytes) -> int:
        if params != _CLEAR_TURNS:
            return DATA_RANGE
        if self.servo.is_moving():
            return RESULT_FAIL
        self.servo.forget_turns()
        return 0

    def _back_up(self, params: bytes, now: float) -> int:
        """Store the registers that outlive a loss of power, or restore them and start anew.

        The gains, profile and indirect addresses of a backup come back by startup_configuration alone.
        """
        if params not in (_STORE, _RESTORE):
            return DATA_RANGE
        if self.torque or (params == _RESTORE and self._backup is None):
            return RESULT_FAIL
        stored = self.registers.memory
        stop = self.registers.rows.eeprom_stop
        if params == _STORE:
            self._backup = bytes(stored[:stop])
            self.registers["backup_ready"] = 1
        elif self._backup is not None:
            stored[:stop] = self._backup
            self.restart(now)
        return 0
