"""Registers: how one is described, how its bytes become a quantity and back, and the tables of every model.

A register is a row: where it lies, what may be done to it, and what one count of it means. Quantities are in SI and
radians; a duty (PWM) is a fraction of the supply and temperatures are in degrees Celsius.
"""

import difflib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from struct import Struct

from sinew.measure.errors import RegisterError
from sinew.measure.units import STANDARD_GRAVITY
from sinew.plan.rig import BusSensor
from sinew.plan.servo import (
    ACCELERATION_LSB,
    COUNTS_PER_TURN,
    FULL_DUTY_COUNTS,
    MOST_TURN_COUNTS,
    P_GAIN_LSB,
    PULSE,
    RETURN_DELAY_LSB,
    SERVOS,
    SPEED_LSB,
    VOLTAGE_LSB,
    WATCHDOG_LSB,
)


@dataclass(frozen=True, slots=True)
class Register:
    """One item of a control table.

    name: as in the manual, with underscores. address, size: of its first byte, and how many [bytes].
    writable: RW in the manual, else R. signed: two's complement. unit: of the decoded quantity; 1 for counts and bits.
    scale: quantity of one count [unit]. low, high: counts that may be written; None: all that fit into the size.
    initial: counts after factory reset or start; None where it depends.
    """

    name: str
    address: int
    size: int
    writable: bool = False
    signed: bool = False
    unit: str = "1"
    scale: float = 1.0
    low: int | None = None
    high: int | None = None
    initial: int | None = None

    @property
    def stop(self) -> int:
        """The address behind its last byte."""
        return self.address + self.size

    @property
    def lowest(self) -> int:
        """The least count that may be written."""
        return self.low if self.low is not None else -(1 << (8 * self.size - 1)) if self.signed else 0

    @property
    def highest(self) -> int:
        """The greatest count that may be written."""
        return self.high if self.high is not None else (1 << (8 * self.size - self.signed)) - 1


@dataclass(frozen=True)
class RegisterTable:
    """The control table of one model.

    model: its name. number: what it answers to a ping. rows: by address.
    eeprom_stop: registers below it are kept without power, and locked while the torque is on; 0 where there are none.
    """

    model: str
    number: int
    rows: tuple[Register, ...]
    eeprom_stop: int = 0
    _by_name: dict[str, Register] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_by_name", {row.name: row for row in self.rows})

    def __getitem__(self, name: str) -> Register:
        """Return a register by its name; raises RegisterError with what there is instead."""
        try:
            return self._by_name[name]
        except KeyError:
            alike = difflib.get_close_matches(name, self._by_name, n=4)
            hint = f"there is {', '.join(alike)}" if alike else "docs/reference/registers.md lists them"
            raise RegisterError(f"{self.model} has no register {name!r}; {hint}") from None

    def __iter__(self) -> Iterator[Register]:
        return iter(self.rows)

    def __contains__(self, name: object) -> bool:
        return name in self._by_name

    @property
    def size(self) -> int:
        """The address behind the last register."""
        return max(row.stop for row in self.rows)

    def block(self, names: Iterable[str]) -> tuple[int, int]:
        """Return (address, length) of the smallest block that holds these registers."""
        rows = [self[name] for name in names]
        start = min(row.address for row in rows)
        return start, max(row.stop for row in rows) - start


def decode_raw(register: Register, data: bytes) -> int:
    """Return the counts that the bytes of a register stand for.

    Raises RegisterError if there are more or fewer bytes than the register has.
    """
    if len(data) != register.size:
        raise RegisterError(f"{register.name} came with {len(data)} bytes; expected {register.size}")
    return int.from_bytes(data, "little", signed=register.signed)


def encode_raw(register: Register, count: int) -> bytes:
    """Return the bytes of so many counts.

    Raises RegisterError if the register cannot be written, or not with that.
    """
    if not register.writable:
        raise RegisterError(f"{register.name} can only be read; expected one that can be written")
    if not register.lowest <= count <= register.highest:
        unit = "" if register.unit == "1" else f" of {register.scale:.4g} {register.unit}"
        raise RegisterError(
            f"{register.name} cannot hold {count} counts{unit}; expected {register.lowest} to {register.highest}"
        )
    return count.to_bytes(register.size, "little", signed=register.signed)


def decode(register: Register, data: bytes) -> float:
    """Return the quantity [register.unit] that the bytes of a register stand for.

    Raises RegisterError if there are more or fewer bytes than the register has.
    """
    return decode_raw(register, data) * register.scale


# Several registers are unpacked from one block of bytes at once, as fast as Python can.

_CODES = {(1, False): "B", (1, True): "b", (2, False): "H", (2, True): "h", (4, False): "I", (4, True): "i"}


@dataclass(frozen=True, slots=True)
class Layout:
    """Where registers lie in the smallest block that holds them.

    address, length: of the block [bytes]. unpack: turns its bytes into counts, in the order of the registers asked for
    (numbers of a float register as they are). scales: quantity of one count, by register.
    """

    address: int
    length: int
    unpack: Struct
    scales: tuple[float, ...]


def lay_out(table: RegisterTable, names: Sequence[str]) -> Layout:
    """Return the layout of some registers, which must be named by increasing address.

    Raises RegisterError where the table has no such register, or the order is another.
    """
    rows = [table[name] for name in names]
    address, length = table.block(names)
    form, at = "<", address
    for row in rows:
        if row.address < at:
            raise RegisterError(f"{row.name} lies before {at}; expected registers by increasing address")
        form += f"{row.address - at}x" + _CODES[row.size, row.signed]
        at = row.stop
    return Layout(address, length, Struct(form), tuple(row.scale for row in rows))


# The control tables of what may be on the bus: the servos of `sinew.plan.servo`, and the head's inertial sensor.
#
# Source: ROBOTIS e-Manual, the page of each model, read beside the model files of ROBOTIS's ROS 2 driver. Speeds are
# the manual's 0.229 rev/min a count; ROBOTIS's driver uses 0.2289.


# Baud [1/s] by the count of the register baud_rate.
BAUD_RATES = (9_600, 57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
# Values of the register operating_mode.
MODES = 0, 1, 3, 4, 5, 16
CURRENT_MODE, VELOCITY_MODE, POSITION_MODE, EXTENDED_POSITION_MODE, CURRENT_POSITION_MODE, PWM_MODE = MODES
# Bits of the registers hardware_error_status and shutdown.
HARDWARE_ERRORS = {0: "input voltage", 2: "overheating", 3: "encoder", 4: "electrical shock", 5: "overload"}
VOLTAGE, OVERHEATING, _, ELECTRICAL_SHOCK, OVERLOAD = (1 << bit for bit in HARDWARE_ERRORS)
SHUTDOWN = OVERHEATING | ELECTRICAL_SHOCK | OVERLOAD
# What bus_watchdog reads after it has stopped the motor; only writing 0 clears it.
WATCHDOG_TRIPPED = -1

_DUTY = 0.113e-2  # of the supply voltage


def _stored(name: str, address: int, size: int, low: int, high: int, initial: int, **more: object) -> Register:
    return Register(name, address, size, writable=True, low=low, high=high, initial=initial, **more)  # type: ignore[arg-type]


_EEPROM = (
    Register("model_number", 0, 2),
    Register("model_information", 2, 4),
    Register("firmware_version", 6, 1),
    _stored("id", 7, 1, 0, 252, 1),
    _stored("baud_rate", 8, 1, 0, 7, 1),
    _stored("return_delay_time", 9, 1, 0, 254, 250, unit="s", scale=RETURN_DELAY_LSB),
    _stored("drive_mode", 10, 1, 0, 13, 0),
    _stored("operating_mode", 11, 1, 0, 16, 3),
    _stored("shadow_id", 12, 1, 0, 255, 255),  # above 252: none
    _stored("protocol_type", 13, 1, 1, 2, 2),
    _stored("homing_offset", 20, 4, -1_044_479, 1_044_479, 0, signed=True, unit="rad", scale=PULSE),
    _stored("moving_threshold", 24, 4, 0, 1023, 10, unit="rad/s", scale=SPEED_LSB),
    _stored("temperature_limit", 31, 1, 0, 100, 80, unit="degC"),
    _stored("max_voltage_limit", 32, 2, 95, 160, 160, unit="V", scale=VOLTAGE_LSB),
    _stored("min_voltage_limit", 34, 2, 95, 160, 95, unit="V", scale=VOLTAGE_LSB),
    _stored("pwm_limit", 36, 2, 0, FULL_DUTY_COUNTS, FULL_DUTY_COUNTS, scale=_DUTY),
    _stored("current_limit", 38, 2, 0, 648, 648, unit="A"),
    _stored("velocity_limit", 44, 4, 0, 1023, 130, unit="rad/s", scale=SPEED_LSB),
    _stored("max_position_limit", 48, 4, 0, COUNTS_PER_TURN - 1, COUNTS_PER_TURN - 1, unit="rad", scale=PULSE),
    _stored("min_position_limit", 52, 4, 0, COUNTS_PER_TURN - 1, 0, unit="rad", scale=PULSE),
    _stored("startup_configuration", 60, 1, 0, 3, 0),
    _stored("shutdown", 63, 1, 0, 61, SHUTDOWN),
)
_CONTROL = (
    _stored("torque_enable", 64, 1, 0, 1, 0),
    _stored("led", 65, 1, 0, 1, 0),
    _stored("status_return_level", 68, 1, 0, 2, 2),
    Register("registered_instruction", 69, 1, initial=0),
    Register("hardware_error_status", 70, 1, initial=0),
    _stored("velocity_i_gain", 76, 2, 0, 16_383, 1920, scale=1 / 65536),
    _stored("velocity_p_gain", 78, 2, 0, 16_383, 100, scale=P_GAIN_LSB),
    _stored("position_d_gain", 80, 2, 0, 16_383, 0, scale=1 / 16),
    _stored("position_i_gain", 82, 2, 0, 16_383, 0, scale=1 / 65536),
    _stored("position_p_gain", 84, 2, 0, 16_383, 0, scale=P_GAIN_LSB),
    _stored("feedforward_2nd_gain", 88, 2, 0, 16_383, 0, scale=1 / 4),
    _stored("feedforward_1st_gain", 90, 2, 0, 16_383, 0, scale=1 / 4),
    _stored("bus_watchdog", 98, 1, 0, 127, 0, signed=True, unit="s", scale=WATCHDOG_LSB),
    Register("goal_pwm", 100, 2, True, True, scale=_DUTY, low=-FULL_DUTY_COUNTS, high=FULL_DUTY_COUNTS),
    Register("goal_current", 102, 2, True, True, "A", low=-648, high=648),
    Register("goal_velocity", 104, 4, True, True, "rad/s", SPEED_LSB, -1023, 1023),
    _stored("profile_acceleration", 108, 4, 0, 32_767, 0, unit="rad/s^2", scale=ACCELERATION_LSB),
    _stored("profile_velocity", 112, 4, 0, 32_767, 0, unit="rad/s", scale=SPEED_LSB),
    # 256 turns either way in extended position mode; in position mode the motor refuses what is outside its limits.
    Register("goal_position", 116, 4, True, True, "rad", PULSE, -MOST_TURN_COUNTS, MOST_TURN_COUNTS),
)
_PRESENT = (
    Register("realtime_tick", 120, 2, unit="s", scale=1e-3, low=0, high=32_767),
    Register("moving", 122, 1),
    Register("moving_status", 123, 1),
    Register("present_pwm", 124, 2, signed=True, scale=_DUTY),
    Register("present_current", 126, 2, signed=True, unit="A"),
    Register("present_velocity", 128, 4, signed=True, unit="rad/s", scale=SPEED_LSB),
    Register("present_position", 132, 4, signed=True, unit="rad", scale=PULSE),
    Register("velocity_trajectory", 136, 4, signed=True, unit="rad/s", scale=SPEED_LSB),
    Register("position_trajectory", 140, 4, signed=True, unit="rad", scale=PULSE),
    Register("present_input_voltage", 144, 2, unit="V", scale=VOLTAGE_LSB),
    Register("present_temperature", 146, 1, unit="degC"),
    Register("backup_ready", 147, 1),
)


def _indirect(first: int, address: int, data: int, count: int = 28, last: int = 661) -> tuple[Register, ...]:
    """Return indirect addresses and the bytes they point to; each points to its own byte at the start."""
    ways = [_stored(f"indirect_address_{first + i}", address + 2 * i, 2, 64, last, data + i) for i in range(count)]
    return (*ways, *(_stored(f"indirect_data_{first + i}", data + i, 1, 0, 255, 0) for i in range(count)))


_ROWS = (*_EEPROM, *_CONTROL, *_PRESENT)
_INDIRECT = (*_indirect(1, 168, 224), *_indirect(29, 578, 634))


def _motor(
    model: str, own: Mapping[str, Mapping[str, int]] | None = None, more: Iterable[Register] = _INDIRECT
) -> RegisterTable:
    """Return the table of a servo: the rows that all share, with its numbers, and what is its `own` by register.

    more: rows that not all have.
    """
    servo = SERVOS[model]
    numbers: dict[str, Mapping[str, float]] = {
        "model_number": {"initial": servo.number},
        "position_p_gain": {"initial": servo.position_gain_counts},
    }
    numbers |= own or {}
    rows = (replace(row, **numbers.get(row.name, {})) for row in _ROWS)  # type: ignore[arg-type]
    rows = (replace(row, scale=servo.current_lsb) if row.unit == "A" else row for row in rows)
    ordered = sorted((*rows, *more), key=lambda row: row.address)
    return RegisterTable(model, servo.number, tuple(ordered), eeprom_stop=64)


XH430_W350 = _motor("XH430-W350")
XM430_W350 = _motor(
    "XM430-W350",
    {
        "current_limit": {"high": 1193, "initial": 1193},
        "goal_current": {"low": -1193, "high": 1193},
        "velocity_limit": {"initial": 350},
    },
)
XL330_M288 = _motor(
    "XL330-M288",
    {
        "baud_rate": {"high": 6},
        "protocol_type": {"low": 2, "high": 22},
        "temperature_limit": {"initial": 70},
        "max_voltage_limit": {"low": 31, "high": 70, "initial": 70},
        "min_voltage_limit": {"low": 31, "high": 70, "initial": 35},
        "current_limit": {"high": 1750, "initial": 1750},
        "velocity_limit": {"high": 2047, "initial": 445},
        "shutdown": {"initial": SHUTDOWN | VOLTAGE},
        "velocity_i_gain": {"initial": 1600},
        "velocity_p_gain": {"initial": 180},
        "goal_current": {"low": -1750, "high": 1750},
        "goal_velocity": {"low": -2047, "high": 2047},
    },
    # pwm_slope is not emulated: with the factory's 140 the duty takes 18 ms from nothing to all of 5 V.
    (_stored("pwm_slope", 62, 1, 1, 255, 140, unit="V/s", scale=1.977), *_indirect(1, 168, 208, 20, 227)),
)
MOTORS = {table.number: table for table in (XH430_W350, XM430_W350, XL330_M288)}


# The control tables of the head's inertial sensor stand: an OpenCR board that answers like a motor.
#
# `OPENCR_NODE` lies on the motors' bus, and is what Sinew's own firmware has (`firmware/`). Its readings from 32 to 50
# are where the firmware of ROBOTIS's OP3 has them; id, baud and levels are where motors have them. Stock firmware has
# no usable time, so there are two registers more, both in microseconds of the board, which wrap after 71.6 minutes:
# `sample_time`, when the newest sample was taken, which stands still where the sensor is frozen; and `clock`, when the
# board answered. Their difference is the age of the sample, whatever the bus does. `samples` counts those taken,
# `lost_samples` those that the chip made and the board did not read.
#
# Sources: the OP3 firmware in ROBOTIS's OpenCR repository; gyro 2000 °/s, accelerometer 2 g full scale as its IMU
# library sets them.

EMULATED_FIRMWARE = 0xEE
"""Firmware version that an emulated node tells in its answer to a ping; those of real nodes count from 1."""

# What the register who_am_i tells, and by how much that chip's gyroscope is late as Sinew's firmware sets it [µs].
# MPU-9250: its data sheet's delay at 41 Hz. ICM-20648: the data sheet has none; 1/(2π·51.2 Hz), that of one pole, is
# assumed.
MPU_9250, ICM_20648 = 0x71, 0xE0
FILTER_DELAYS_US = {MPU_9250: 5_900, ICM_20648: 3_109}
CHIPS = {MPU_9250: "MPU-9250", ICM_20648: "ICM-20648"}
# Bit of the node's hardware_error_status: the chip does not answer, or has stopped.
SENSOR_ERROR = 1 << 3

_GYRO = math.radians(2000) / 32_768  # rad/s
_CHIP_FORCE = 2 * STANDARD_GRAVITY / 32_768  # m/s²
_TENTH_DEGREE = math.radians(0.1)


def _three(names: tuple[str, str, str], address: int, unit: str, scale: float) -> tuple[Register, ...]:
    return tuple(Register(n, address + 2 * i, 2, signed=True, unit=unit, scale=scale) for i, n in enumerate(names))


OPENCR_NODE = RegisterTable(
    "OpenCR node",
    0x7400,
    (
        Register("model_number", 0, 2, initial=0x7400),
        Register("firmware_version", 6, 1),
        _stored("id", 7, 1, 0, 252, 200),
        _stored("baud_rate", 8, 1, 0, 7, 3),
        _stored("return_delay_time", 9, 1, 0, 254, 0, unit="s", scale=RETURN_DELAY_LSB),
        *_three(("gyro_x", "gyro_y", "gyro_z"), 32, "rad/s", _GYRO),
        *_three(("acceleration_x", "acceleration_y", "acceleration_z"), 38, "m/s^2", _CHIP_FORCE),
        *_three(("roll", "pitch", "yaw"), 44, "rad", _TENTH_DEGREE),
        Register("imu_control", 50, 1, writable=True, initial=0),
        Register("sample_time", 52, 4, unit="s", scale=1e-6),
        Register("clock", 56, 4, unit="s", scale=1e-6),
        Register("samples", 60, 4),
        Register("lost_samples", 64, 4),
        _stored("status_return_level", 68, 1, 0, 2, 2),
        Register("registered_instruction", 69, 1, initial=0),
        Register("hardware_error_status", 70, 1, initial=0),
        Register("who_am_i", 71, 1),
        Register("filter_delay", 72, 2, unit="s", scale=1e-6),
        Register("sample_period", 74, 2, unit="s", scale=1e-6),
    ),
    eeprom_stop=32,
)
IMUS = {OPENCR_NODE.number: OPENCR_NODE}


def sensor_table(sensor: BusSensor) -> RegisterTable:
    """Return the table of a sensor's node; its register is called as the channel of a recording."""
    value = Register(sensor.channel, 32, 2, signed=True, unit=sensor.unit, scale=sensor.lsb)
    return RegisterTable(sensor.model, sensor.number, (Register("model_number", 0, 2, initial=sensor.number), value))
