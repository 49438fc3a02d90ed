"""What every device on the line does with an instruction, motor and sensor alike; and the sensors' plain board."""

import math
from abc import ABC, abstractmethod

from sinew.emulator.devices.control_table import DATA_LENGTH, ControlTable
from sinew.hardware import codec as ask
from sinew.hardware.codec import Instruction, Status

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

    def obey(self, instruction: Instruction, now: float) -> Status | None:
        """Carry out an instruction to this device, or to all; return its answer, None where it is silent.

        Reads are not for here but for `answer`; one that gets here makes no sense and is refused.
        """
        sender = self.id  # also where a write changes it
        if instruction.code == ask.PING:
            return self.status(0, self.registers["model_number"].to_bytes(2, "little") + bytes((self.firmware,)))
        if instruction.code == ask.READ:
            return self.status(DATA_LENGTH) if self.status_return_level >= 1 else None
        # The answer to a write that changes what is answered, and to whom, still goes by the old settings.
        level = self.status_return_level
        if instruction.code == ask.WRITE:
            parts = ask.writes_of(instruction)
            number = self.write(parts[0].address, parts[0].data, now) if parts else DATA_LENGTH
        else:
            number = self.carry_out(instruction, now)
        return self.status(number, sender=sender) if level >= 2 else None

    def answer(self, address: int, length: int, now: float) -> Status | None:
        """Return what it says to a read, of the moment; None where it is silent."""
        if self.status_return_level < 1:
            return None
        self.refresh(address, length, now)
        number, data = self.registers.read(address, length)
        return self.status(number, data)

    def status(self, number: int, data: bytes = b"", sender: int | None = None) -> Status:
        """Return a status with an error number, and the alert where there is one."""
        return Status(self.id if sender is None else sender, number | 0x80 * self.alert, data)


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

    def hears(self, now: float) -> bool:
        return self.is_powered and now >= self._deaf_until

    def heed(self, now: float) -> None:
        pass

    def set_power(self, on: bool, now: float) -> None:
        """Take the power away, or give it back: the board then starts anew, deaf for a while."""
        if on and not self.is_powered:
            self._deaf_until = now + _START_TIME
            self.registers.restart()
        self.is_powered = on

    def write(self, address: int, data: bytes, now: float) -> int:
        number, parts = self.registers.parts(address, data, locked=False)
        for row, count in parts:
            self.registers.store(row, count)
        return number

    def carry_out(self, instruction: Instruction, now: float) -> int:
        return INSTRUCTION
