"""What every device on the line is: its registers, what it does with an instruction, and the sensors' plain board.

What the manual leaves open is assumed, and said here: a gap between registers reads as 0, but a read that touches no
register at all, or runs past the table, is an access error; a write that touches a gap is an access error; a write to
several registers of which one is refused stores nothing.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence

from sinew.hardware import codec as ask
from sinew.hardware.codec import BROADCAST, Instruction, Status
from sinew.hardware.registers import BAUD_RATES, Register, RegisterTable
from sinew.plan.servo import RETURN_DELAY_LSB

# Error numbers of the protocol (e-Manual, "DYNAMIXEL Protocol 2.0", Error).
CRC, DATA_RANGE, DATA_LENGTH, DATA_LIMIT, ACCESS = 3, 4, 5, 6, 7

Part = tuple[Register, int]
"""A register and the count that is to be stored in it."""

_MOST_PLANS = 1000  # what a master writes is always the same few; what noise writes must not fill the memory
_Plan = tuple[int, tuple[tuple[Register, int], ...]]  # error number, or registers and where their bytes are


class ControlTable:
    """The bytes of one device, by the rows of its model.

    `indirect_data_n` stands for the byte that `indirect_address_n` points to; one that points to an indirect byte
    (as each does to itself at the start) is plain memory.
    """

    def __init__(self, rows: RegisterTable) -> None:
        self.rows = rows
        self.memory = bytearray(rows.size)
        self._by_name = {row.name: row for row in rows}
        self._places = {row.name: (row.address, row.stop, row.signed) for row in rows}
        self._owner: list[Register | None] = [None] * rows.size
        for row in rows:
            self._owner[row.address : row.stop] = [row] * row.size
        self._pointers = {
            row.address: self._by_name[row.name.replace("data", "address")]
            for row in rows
            if row.name.startswith("indirect_data")
        }
        self._indirect_start = min(self._pointers, default=rows.size)
        self._plans: dict[tuple[int, int], _Plan] = {}
        self.reset()

    def reset(self, keep: Sequence[str] = ()) -> None:
        """Put all registers to what they are when they come from the factory, but those in `keep`."""
        kept = {name: self[name] for name in keep}
        self._initialise(0)
        for name, count in kept.items():
            self[name] = count

    def restart(self) -> None:
        """Put the registers that do not outlive a loss of power to what they are at the start."""
        self._initialise(self.rows.eeprom_stop)

    def _initialise(self, start: int) -> None:
        self.memory[start:] = bytes(len(self.memory) - start)
        for row in self.rows:
            if row.address >= start and row.initial is not None:
                self[row.name] = row.initial

    def __getitem__(self, name: str) -> int:
        start, stop, signed = self._places[name]
        return int.from_bytes(self.memory[start:stop], "little", signed=signed)

    def __setitem__(self, name: str, count: int) -> None:
        self.store(self._by_name[name], count)

    def __contains__(self, name: object) -> bool:
        return name in self._by_name

    def store(self, row: Register, count: int) -> None:
        """Put counts into a register without asking whether a master might."""
        self.memory[row.address : row.stop] = count.to_bytes(row.size, "little", signed=row.signed)

    def read(self, address: int, length: int) -> tuple[int, bytes]:
        """Return (0, the bytes), or (error number, nothing)."""
        if not self._is_readable(address, length):
            return ACCESS, b""
        data = self.memory[address : address + length]
        if self._is_indirect(address, length):
            for at in range(max(address, self._indirect_start), address + length):
                data[at - address] = self.memory[self._target(at)]
        return 0, bytes(data)

    def parts(self, address: int, data: bytes, *, locked: bool) -> tuple[int, list[Part]]:
        """Return (0, what a write would store), or (error number, nothing).

        locked: whether the registers that outlive a loss of power must not change, as while the torque is on.
        """
        if self._is_indirect(address, len(data)):
            number, places = self._plan([self._target(at) for at in range(address, address + len(data))])
        else:
            key = (address, len(data))
            if key not in self._plans:
                if len(self._plans) > _MOST_PLANS:
                    self._plans.clear()
                self._plans[key] = self._plan(range(address, address + len(data)))
            number, places = self._plans[key]
        if number:
            return number, []
        found: list[Part] = []
        for row, at in places:
            if locked and row.address < self.rows.eeprom_stop:
                return ACCESS, []
            count = int.from_bytes(data[at : at + row.size], "little", signed=row.signed)
            if not row.is_float and not row.lowest <= count <= row.highest:
                return DATA_RANGE, []
            found.append((row, count))
        return 0, found

    def _plan(self, addresses: Sequence[int]) -> _Plan:
        """Return which registers bytes at these addresses make up, and the index of each one's first byte."""
        places: list[tuple[Register, int]] = []
        at = 0
        while at < len(addresses):
            row = self._owner[addresses[at]] if addresses[at] < len(self._owner) else None
            if row is None or not row.writable:
                return ACCESS, ()
            if list(addresses[at : at + row.size]) != list(range(row.address, row.stop)):
                return DATA_LENGTH, ()
            places.append((row, at))
            at += row.size
        return (0, tuple(places)) if places else (DATA_LENGTH, ())

    def _is_readable(self, address: int, length: int) -> bool:
        stop = address + length
        return length > 0 and stop <= len(self.memory) and any(self._owner[address:stop])

    def _is_indirect(self, address: int, length: int) -> bool:
        """Return whether one of the bytes stands for another."""
        return address + length > self._indirect_start and any(
            at in self._pointers for at in range(address, address + length)
        )

    def _target(self, address: int) -> int:
        pointer = self._pointers.get(address)
        if pointer is None:
            return address
        return int.from_bytes(self.memory[pointer.address : pointer.stop], "little")


# Error numbers of the protocol that are not about a register.
RESULT_FAIL, INSTRUCTION = 1, 2


class Device(ABC):
    """One device: its registers, and how it obeys.

    A line asks `hears`, calls `heed` for every instruction packet that passes, then `obey`, `write` or `answer` where
    the device is meant. Nothing that a master can send makes one of them raise.
    """

    def __init__(self, registers: ControlTable, firmware: int) -> None:
        self.registers = registers
        self.firmware = firmware
        self._pending: tuple[int, bytes] | None = None

    @property
    @abstractmethod
    def id(self) -> int:
        """What it listens to."""

    @property
    @abstractmethod
    def baud(self) -> int:
        """How fast it listens and speaks [1/s]."""

    @property
    def return_delay(self) -> float:
        """How long it waits before it speaks [s]."""
        return 0.0

    @property
    def status_return_level(self) -> int:
        """0: answers to pings; 1: and to reads; 2: to everything."""
        return 2

    @property
    def alert(self) -> bool:
        """Whether it reports a hardware error in every status."""
        return False

    @property
    def knows_fast_reads(self) -> bool:
        """Whether it takes part in fast sync and bulk reads."""
        return False

    @property
    def goes_on_alone(self) -> bool:
        """Whether it answers a sync or bulk read also where the device before it was silent, after that one's time."""
        return False

    @property
    def is_locked(self) -> bool:
        """Whether registers that are kept without power may not be written."""
        return False

    @property
    def answers_damaged(self) -> bool:
        """Whether it answers an instruction with a wrong CRC, with the protocol's error."""
        return True

    def answers_to(self, code: int) -> bool:
        """Return whether it answers an instruction to it alone, by its status return level."""
        return code == ask.PING or self.status_return_level >= (1 if code == ask.READ else 2)

    @abstractmethod
    def hears(self, now: float) -> bool:
        """Return whether it listens to packets of this protocol at a time [s]; without power it does not."""

    @abstractmethod
    def heed(self, now: float) -> None:
        """Take note that an instruction packet, for whomever, has passed."""

    @abstractmethod
    def refresh(self, address: int, length: int, now: float) -> None:
        """Bring the registers that a read touches up to date."""

    @abstractmethod
    def write(self, address: int, data: bytes, now: float) -> int:
        """Store bytes if that is allowed, and act on them; return 0 or the error number."""

    @abstractmethod
    def carry_out(self, instruction: Instruction, now: float) -> int:
        """Do what an instruction other than ping, read and write asks; return 0 or the error number."""

    @abstractmethod
    def restart(self, now: float) -> None:
        """Start anew: registers as at power-on, deaf for a while."""

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

    def register(self, instruction: Instruction) -> int:
        """Keep a reg write until `act`; return 0 or the error number."""
        parts = ask.writes_of(instruction)
        if not parts:
            return DATA_LENGTH
        number, _ = self.admit(parts[0].address, parts[0].data)
        if not number:
            self._pending = parts[0].address, parts[0].data
            self.registers["registered_instruction"] = 1
        return number

    def act(self, now: float) -> int:
        """Carry out what `register` kept; return 0 or the error number."""
        if self._pending is None:
            return INSTRUCTION
        address, data = self._pending
        self._pending = None
        self.registers["registered_instruction"] = 0
        return self.write(address, data, now)

    def status(self, number: int, data: bytes = b"", sender: int | None = None) -> Status:
        """Return a status with an error number, and the alert where there is one."""
        return Status(self.id if sender is None else sender, number | 0x80 * self.alert, data)


class RegisterSet(Device):
    """A device whose registers say who it is and how it answers, at a motor's addresses; it can be reset."""

    @property
    def id(self) -> int:
        return self.registers.memory[7]

    @property
    def baud(self) -> int:
        return BAUD_RATES[self.registers.memory[8]]

    @property
    def return_delay(self) -> float:
        return self.registers.memory[9] * RETURN_DELAY_LSB

    @property
    def status_return_level(self) -> int:
        return self.registers.memory[68]

    @property
    def alert(self) -> bool:
        return self.registers.memory[70] != 0

    def carry_out(self, instruction: Instruction, now: float) -> int:
        match instruction.code:
            case ask.REG_WRITE:
                return self.register(instruction)
            case ask.ACTION:
                return self.act(now)
            case ask.REBOOT:
                self.restart(now)
                return 0
            case ask.FACTORY_RESET:
                return self._reset(instruction, now)
        return INSTRUCTION

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


_START_TIME = 0.3


class Board(Device):
    """A sensor's board: it answers at once and to everything, and knows nothing but ping, read and write.

    is_powered: whether it has a supply.
    """

    def __init__(self, registers: ControlTable, firmware: int, device_id: int, baud: int) -> None:
        super().__init__(registers, firmware)
        self._id, self._baud = device_id, baud
        self.is_powered = True
        self._deaf_until = -math.inf

    @property
    def id(self) -> int:
        return self._id

    @property
    def baud(self) -> int:
        return self._baud

    @property
    def goes_on_alone(self) -> bool:
        return True  # as Sinew's firmware does, firmware/node/slave.h

    @property
    def answers_damaged(self) -> bool:
        return False  # Sinew's firmware is silent then

    def hears(self, now: float) -> bool:
        return self.is_powered and now >= self._deaf_until

    def heed(self, now: float) -> None:
        pass

    def set_power(self, on: bool, now: float) -> None:
        """Take the power away, or give it back: the board then starts anew, deaf for a while."""
        if on and not self.is_powered:
            self.restart(now)
        self.is_powered = on

    def restart(self, now: float) -> None:
        self._deaf_until = now + _START_TIME
        self._pending = None
        self.registers.restart()

    def write(self, address: int, data: bytes, now: float) -> int:
        number, parts = self.admit(address, data)
        for row, count in parts:
            self.registers.store(row, count)
        return number

    def carry_out(self, instruction: Instruction, now: float) -> int:
        return INSTRUCTION
