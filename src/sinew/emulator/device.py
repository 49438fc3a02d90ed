"""What every device on the line is: its registers, and what it does with an instruction; and the sensors' boards.

What the manual leaves open is assumed, and said here: a gap between registers reads as 0, but a read that touches no
register at all, or runs past the table, is an access error; a write that touches a gap is an access error; a write to
several registers of which one is refused stores nothing.
"""

import math
import struct
from collections import deque
from collections.abc import Sequence

import numpy as np

from sinew.emulator.plant import JointPlant
from sinew.hardware import codec as ask
from sinew.hardware.codec import BROADCAST, Instruction, Status
from sinew.hardware.registers import (
    BAUD_RATES,
    EMULATED_FIRMWARE,
    FILTER_DELAYS_US,
    OPENCR_NODE,
    Register,
    RegisterTable,
    sensor_table,
)
from sinew.measure.arrays import Array
from sinew.plan.rig import NODE_HZ, BusSensor, Imu
from sinew.plan.servo import RETURN_DELAY_LSB

RESULT_FAIL, INSTRUCTION, CRC, DATA_RANGE, DATA_LENGTH, DATA_LIMIT, ACCESS = range(1, 8)
"""Error numbers of the protocol (e-Manual, "DYNAMIXEL Protocol 2.0", Error)."""

START_TIME = 0.3
"""How long a device is deaf after power-on or reboot [s]; assumed."""

Part = tuple[Register, int]
"""A register and the count that is to be stored in it."""


class ControlTable:
    """The bytes of one device, by the rows of its model.

    `indirect_data_n` stands for the byte that `indirect_address_n` points to; one that points to an indirect byte
    (as each does to itself at the start) is plain memory.
    """

    def __init__(self, rows: RegisterTable) -> None:
        self.rows = rows
        self.memory = bytearray(rows.size)
        self._by_name = {row.name: row for row in rows}
        self._owner: list[Register | None] = [None] * rows.size
        for row in rows:
            self._owner[row.address : row.stop] = [row] * row.size
        self._pointers = {
            row.address: self._by_name[row.name.replace("data", "address")]
            for row in rows
            if row.name.startswith("indirect_data")
        }
        self.reset()

    def reset(self, keep: Sequence[str] = (), start: int = 0) -> None:
        """Put the registers from an address on to what they are when they come from the factory, but those in keep."""
        saved = {name: self[name] for name in keep}
        self.memory[start:] = bytes(len(self.memory) - start)
        for row in self.rows:
            if row.address >= start and row.initial is not None:
                self[row.name] = row.initial
        for name, count in saved.items():
            self[name] = count

    def restart(self) -> None:
        """Put the registers that do not outlive a loss of power to what they are at the start."""
        self.reset(start=self.rows.eeprom_stop)

    def __getitem__(self, name: str) -> int:
        row = self._by_name[name]
        return int.from_bytes(self.memory[row.address : row.stop], "little", signed=row.signed)

    def __setitem__(self, name: str, count: int) -> None:
        self.store(self._by_name[name], count)

    def __contains__(self, name: object) -> bool:
        return name in self._by_name

    def get(self, name: str, otherwise: int) -> int:
        """Return a register's counts; `otherwise` where there is none of that name."""
        return self[name] if name in self._by_name else otherwise

    def store(self, row: Register, count: int) -> None:
        """Put counts into a register without asking whether a master might."""
        self.memory[row.address : row.stop] = count.to_bytes(row.size, "little", signed=row.signed)

    def read(self, address: int, length: int) -> tuple[int, bytes]:
        """Return (0, the bytes), or (error number, nothing)."""
        stop = address + length
        if not (length > 0 and stop <= len(self.memory) and any(self._owner[address:stop])):
            return ACCESS, b""
        return 0, bytes(self.memory[self._target(at)] for at in range(address, stop))

    def parts(self, address: int, data: bytes, *, locked: bool) -> tuple[int, list[Part]]:
        """Return (0, what a write would store), or (error number, nothing).

        locked: whether the registers that outlive a loss of power must not change, as while the torque is on.
        """
        addresses = [self._target(at) for at in range(address, address + len(data))]
        found: list[Part] = []
        number, at = 0 if addresses else DATA_LENGTH, 0
        while at < len(addresses):
            row = self._owner[addresses[at]] if addresses[at] < len(self._owner) else None
            if row is None or not row.writable:
                return ACCESS, []
            if addresses[at : at + row.size] != list(range(row.address, row.stop)):
                return DATA_LENGTH, []
            count = int.from_bytes(data[at : at + row.size], "little", signed=row.signed)
            if locked and row.address < self.rows.eeprom_stop:
                number = number or ACCESS
            elif not row.lowest <= count <= row.highest:
                number = number or DATA_RANGE
            found.append((row, count))
            at += row.size
        return number, [] if number else found

    def _target(self, address: int) -> int:
        """Return the address of the byte that one stands for, its own where it stands for none."""
        pointer = self._pointers.get(address)
        return address if pointer is None else self[pointer.name]


class Device:
    """One device: its registers, and how it obeys.

    A line asks `hears`, calls `heed` for every instruction packet that passes, then `obey`, `write` or `answer` where
    the device is meant. Nothing that a master can send makes one of them raise.

    device_id, baud: what it listens to and how fast [1/s] to begin with, and for good where no register says so.
    is_powered: whether it has a supply. fast_reads_from: version of its firmware from which on it takes part in fast
    sync and bulk reads. is_node: whether Sinew's firmware runs it (`firmware/node/slave.h`): it does not answer an
    instruction with a wrong CRC, and it does answer a sync or bulk read behind a silent device, after that one's time.
    """

    fast_reads_from = math.inf
    is_node = False

    def __init__(self, registers: ControlTable, firmware: int, device_id: int = 0, baud: int = 0) -> None:
        self.registers = registers
        self.firmware = firmware
        self.is_powered = True
        self._id, self._baud = device_id, baud
        if device_id and "id" in registers:
            registers["id"], registers["baud_rate"] = device_id, BAUD_RATES.index(baud)
        self._pending: tuple[int, bytes] | None = None
        self._deaf_until = -math.inf

    @property
    def id(self) -> int:
        """What it listens to."""
        return self.registers.get("id", self._id)

    @property
    def baud(self) -> int:
        """How fast it listens and speaks [1/s]."""
        return BAUD_RATES[self.registers["baud_rate"]] if "baud_rate" in self.registers else self._baud

    @property
    def return_delay(self) -> float:
        """How long it waits before it speaks [s]."""
        return self.registers.get("return_delay_time", 0) * RETURN_DELAY_LSB

    @property
    def status_return_level(self) -> int:
        """0: answers to pings; 1: and to reads; 2: to everything."""
        return self.registers.get("status_return_level", 2)

    @property
    def is_locked(self) -> bool:
        """Whether registers that are kept without power may not be written."""
        return False

    def answers_to(self, code: int) -> bool:
        """Return whether it answers an instruction to it alone, by its status return level."""
        return code == ask.PING or self.status_return_level >= (1 if code == ask.READ else 2)

    def hears(self, now: float) -> bool:
        """Return whether it listens to packets of this protocol at a time [s]; without power it does not."""
        return self.is_powered and now >= self._deaf_until

    def heed(self, now: float) -> None:
        """Take note that an instruction packet, for whomever, has passed."""

    def refresh(self, address: int, length: int, now: float) -> None:
        """Bring the registers that a read touches up to date."""

    def react(self, name: str, count: int, now: float) -> None:
        """Act on a register that has been written."""

    def set_power(self, on: bool, now: float) -> None:
        """Take the power away, or give it back: the device then starts anew, deaf for a while."""
        if on != self.is_powered:
            self.is_powered = on
            self.restart(now)

    def restart(self, now: float) -> None:
        """Start anew: registers as at power-on, deaf for `START_TIME`."""
        self._deaf_until = now + START_TIME
        self._pending = None
        self.registers.restart()

    def write(self, address: int, data: bytes, now: float) -> int:
        """Store bytes if that is allowed, and act on them; return 0 or the error number."""
        number, parts = self.admit(address, data)
        for row, count in parts:
            self.registers.store(row, count)
        for row, count in parts:
            self.react(row.name, count, now)
        return number

    def carry_out(self, instruction: Instruction, now: float) -> int:
        """Do what an instruction other than ping, read and write asks; return 0 or the error number."""
        match instruction.code if "registered_instruction" in self.registers else None:
            case ask.REG_WRITE:
                return self._register(instruction)
            case ask.ACTION:
                return self._act(now)
            case ask.REBOOT:
                self.restart(now)
                return 0
            case ask.FACTORY_RESET:
                return self._reset(instruction, now)
        return INSTRUCTION

    def obey(self, instruction: Instruction, now: float) -> Status | None:
        """Carry out an instruction to this device, or to all; return its answer, None where it is silent.

        Reads are not for here but for `answer`; one that gets here makes no sense and is refused.
        """
        sender = self.id  # also where a write changes it
        if instruction.code == ask.PING:
            return self.status(0, self.registers["model_number"].to_bytes(2, "little") + bytes((self.firmware,)))
        # The answer to a write that changes what is answered, and to whom, still goes by the old settings.
        is_answered = self.answers_to(instruction.code)
        if instruction.code == ask.READ:
            return self.status(DATA_LENGTH) if is_answered else None
        if instruction.code == ask.WRITE:
            parts = ask.writes_of(instruction)
            number = self.write(parts[0].address, parts[0].data, now) if parts else DATA_LENGTH
        else:
            number = self.carry_out(instruction, now)
        return self.status(number, sender=sender) if is_answered else None

    def answer(self, address: int, length: int, now: float) -> Status | None:
        """Return what it says to a read, of the moment; None where it is silent."""
        if self.status_return_level < 1:
            return None
        self.refresh(address, length, now)
        number, data = self.registers.read(address, length)
        return self.status(number, data)

    def admit(self, address: int, data: bytes) -> tuple[int, list[Part]]:
        """Return (0, what a write would store), or (error number, nothing)."""
        return self.registers.parts(address, data, locked=self.is_locked)

    def status(self, number: int, data: bytes = b"", sender: int | None = None) -> Status:
        """Return a status with an error number, and the alert where it has a hardware error."""
        alert = self.registers.get("hardware_error_status", 0) != 0
        return Status(self.id if sender is None else sender, number | 0x80 * alert, data)

    def _register(self, instruction: Instruction) -> int:
        """Keep a reg write until `_act`; return 0 or the error number."""
        parts = ask.writes_of(instruction)
        if not parts:
            return DATA_LENGTH
        number, _ = self.admit(parts[0].address, parts[0].data)
        if not number:
            self._pending = parts[0].address, parts[0].data
            self.registers["registered_instruction"] = 1
        return number

    def _act(self, now: float) -> int:
        """Carry out what `_register` kept; return 0 or the error number."""
        if self._pending is None:
            return INSTRUCTION
        address, data = self._pending
        self._pending = None
        self.registers["registered_instruction"] = 0
        return self.write(address, data, now)

    def _reset(self, instruction: Instruction, now: float) -> int:
        """Put the registers back, but not the id of all devices on a line at once."""
        keep = {b"\xff": (), b"\x01": ("id",), b"\x02": ("id", "baud_rate")}.get(instruction.params)
        if keep is None or (instruction.id == BROADCAST and not keep):
            return DATA_RANGE
        if self.is_locked:
            return ACCESS
        self.registers.reset(keep)
        self.registers["firmware_version"] = self.firmware
        self.restart(now)
        return 0


SAMPLE_PERIOD = 1 / NODE_HZ
"""Time between two samples, by the node's own clock [s]."""

_READINGS = struct.Struct("<9h")
_COUNTS = np.iinfo(np.int16)


class ImuNode(Device):
    """The head's sensor, an OpenCR board with Sinew's firmware.

    The gyroscope is read at the node's own rate, by its own crystal; a reading is the mean over the newest samples
    behind the chip's low-pass, with bias and noise, clipped, in whole LSB, and zero within the dead band. Noise is
    white at the node's rate, and drawn before the mean, as it is in the twin, there coloured by the chip's low-pass. A
    reading appears `residual_delay` after the moment it belongs to, with the time of its appearance. Roll and pitch are
    those of the accelerometer alone; yaw stays 0. What the board answers on the line is what `firmware/` answers
    (tests/firmware holds both to one contract); its readings are averaged as those of the stock firmware. It tells the
    delay of the rig's filter, and is that of the known chips whose own is nearest.

    spec: range, noise and bias of the chip. axes: the chip's axes that point along x, y and z of the head.
    ppm: how much faster than the host's its crystal is [1e-6]; None: drawn, standard deviation 20.
    due: when the next sample is to be taken [s].
    frozen: as a fault, the readings and their time stand still, while the clock goes on. loses: as a fault, the share
    of the samples that the board does not read, evenly; it counts them.
    """

    fast_reads_from = 0
    is_node = True

    def __init__(
        self,
        spec: Imu,
        plant: JointPlant,
        rng: np.random.Generator,
        *,
        device_id: int = 200,
        baud: int = 1_000_000,
        axes: tuple[str, str, str] = ("+x", "+y", "+z"),
        ppm: float | None = None,
        firmware: int = EMULATED_FIRMWARE,
    ) -> None:
        super().__init__(ControlTable(OPENCR_NODE), firmware, device_id, baud)
        self._spec, self._plant, self._rng = spec, plant, rng
        self.frozen = False
        self.loses = self._owed = 0.0
        self._rate = 1 + 1e-6 * (float(rng.normal(0, 20)) if ppm is None else ppm)
        self._phase = float(rng.uniform(0, 0.5))
        self._count = int(self._phase / SAMPLE_PERIOD) + 1
        self.due = self._time_of_sample()
        self._bias = spec.gyro_bias.value * rng.standard_normal(3)
        self._newest: deque[Array] = deque(maxlen=spec.average_samples)
        self._waiting: tuple[float, bytes] | None = None
        # Of each axis of the chip: which axis of the head it lies along, and its sign.
        self._along = [[axis[1] for axis in axes].index(letter) for letter in "xyz"]
        self._signs = np.array([1.0 if axes[head][0] == "+" else -1.0 for head in self._along])
        self._readings_start = OPENCR_NODE["gyro_x"].address
        self._begin()

    def restart(self, now: float) -> None:
        super().restart(now)
        self._newest.clear()
        self._waiting = None
        self._begin()

    def _begin(self) -> None:
        """Tell what the board is and how it samples, and have taken nothing yet."""
        registers = self.registers
        registers["firmware_version"] = self.firmware
        delay = round(1e6 * self._spec.filter_delay)
        registers["filter_delay"] = min(delay, 0xFFFF)
        registers["who_am_i"] = min(FILTER_DELAYS_US, key=lambda chip: abs(FILTER_DELAYS_US[chip] - delay))
        registers["sample_period"] = round(SAMPLE_PERIOD * 1e6)

    def clock(self, now: float) -> float:
        """Return the time by the node's own clock [s]."""
        return now * self._rate + self._phase

    def advance(self, now: float) -> None:
        """Take a sample, if one is due."""
        if now < self.due:
            return
        self._publish(now)
        self._count += 1
        self.due = self._time_of_sample()
        if self.frozen or not self.is_powered:
            return
        self._owed += self.loses
        if self._owed >= 1.0:
            self._owed -= 1.0
            self.registers["lost_samples"] = (self.registers["lost_samples"] + 1) & 0xFFFF_FFFF
            return
        motion, spec, drawn = self._plant.motion(), self._spec, self._rng.standard_normal(6)
        limit = spec.gyro_range.value
        noise = self._bias + spec.gyro_noise.value * drawn[:3]
        self._newest.append(np.clip(motion.gyro + noise, -limit, limit))
        rates = np.rint(np.mean(self._newest, axis=0) / spec.gyro_lsb.value)
        rates = np.where(np.abs(rates) <= spec.dead_band, 0.0, np.clip(rates, _COUNTS.min, _COUNTS.max))
        force = motion.acceleration + drawn[3:] * spec.accelerometer_noise.value
        x, y, z = forces = self._signs * force[self._along]
        most = min(spec.accelerometer_range.value / spec.accelerometer_lsb.value, _COUNTS.max)
        readings = _READINGS.pack(
            *(self._signs * rates[self._along]).astype(int),
            *np.rint(np.clip(forces / spec.accelerometer_lsb.value, -most, most)).astype(int),
            round(math.degrees(math.atan2(y, z)) * 10),
            round(math.degrees(math.atan2(-x, math.hypot(y, z))) * 10),
            0,
        )
        self._waiting = now + spec.residual_delay.value, readings

    def refresh(self, address: int, length: int, now: float) -> None:
        self._publish(now)
        self.registers["clock"] = self._microseconds(now)

    def _time_of_sample(self) -> float:
        return (self._count * SAMPLE_PERIOD - self._phase) / self._rate

    def _publish(self, now: float) -> None:
        """Show the sample taken, if it is time."""
        if self.frozen:
            self._waiting = None
        if self._waiting is not None and now >= self._waiting[0]:
            when, readings = self._waiting
            start = self._readings_start
            self.registers.memory[start : start + len(readings)] = readings
            self.registers["sample_time"] = self._microseconds(when)
            self.registers["samples"] = (self.registers["samples"] + 1) & 0xFFFF_FFFF
            self._waiting = None

    def _microseconds(self, now: float) -> int:
        return int(self.clock(now) * 1e6) & 0xFFFF_FFFF


class SensorBoard(Device):
    """A sensor with a node of its own, which takes its value as it is asked for it."""

    is_node = True

    def __init__(self, spec: BusSensor, plant: JointPlant, rng: np.random.Generator, baud: int) -> None:
        super().__init__(ControlTable(sensor_table(spec)), EMULATED_FIRMWARE, spec.id, baud)
        self._spec, self._plant, self._rng = spec, plant, rng

    def refresh(self, address: int, length: int, now: float) -> None:
        spec = self._spec
        reading = spec.reading(np.asarray(self._plant.motion().tension), self._rng)
        self.registers[spec.channel] = round(float(reading) / spec.lsb)
