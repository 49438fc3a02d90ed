"""A line in memory with devices on it and a clock moved by hand: nothing sleeps, and faults are put in on purpose."""

from collections.abc import Callable
from dataclasses import dataclass, field

from sinew.hardware.codec import (
    ACTION,
    BROADCAST,
    PING,
    REBOOT,
    Decoder,
    Instruction,
    Status,
    encode,
    reads_of,
    writes_of,
)


class ManualClock:
    def __init__(self) -> None:
        self.time = 100.0

    def now(self) -> float:
        return self.time

    def wait_until(self, time: float) -> None:
        self.time = max(self.time, time)


@dataclass
class Slave:
    """A device that does as it is told. error: ERR of its answers. answers: whether it does; absent: not there."""

    id: int
    error: int = 0
    absent: bool = False
    model: int = 1000
    memory: bytearray = field(default_factory=lambda: bytearray(range(256)) * 3)
    heard: list[Instruction] = field(default_factory=list)


Arrivals = list[tuple[float, bytes]]


class Line:
    """A transport. delay: until each answer [s]. spoil: turns the n-th answer's bytes into what arrives, and when."""

    def __init__(self, clock: ManualClock, *slaves: Slave, delay: float = 1e-3) -> None:
        self.clock, self.delay = clock, delay
        self.slaves = {slave.id: slave for slave in slaves}
        self.spoil: Callable[[int, bytes], Arrivals] = lambda _, wire: [(0.0, wire)]
        self.sent: list[Instruction] = []
        self.echo = False
        self.closed = False
        self._answered = 0
        self._ear = Decoder()
        self._arriving: Arrivals = []

    def write(self, data: bytes) -> None:
        if self.echo:
            self.put(data)
        for packet in self._ear.feed(data):
            assert isinstance(packet, Instruction)
            self.sent.append(packet)
            for number, wire in enumerate(self._answers(packet), start=1):
                for later, part in self.spoil(self._answered, wire):
                    self.put(part, number * self.delay + later)
                self._answered += 1

    def put(self, data: bytes, later: float = 0.0) -> None:
        self._arriving.append((self.clock.time + later, data))
        self._arriving.sort(key=lambda arrival: arrival[0])

    def read(self, deadline: float) -> bytes:
        if self._arriving and self._arriving[0][0] <= max(deadline, self.clock.time):
            when, data = self._arriving.pop(0)
            self.clock.time = max(self.clock.time, when)
            return data
        self.clock.time = max(self.clock.time, deadline)
        return b""

    def close(self) -> None:
        self.closed = True

    def _answers(self, packet: Instruction) -> list[bytes]:
        there = [slave for slave in self.slaves.values() if not slave.absent]
        for slave in there:
            slave.heard.append(packet)
        addressed = [slave for slave in there if packet.id in (slave.id, BROADCAST)]
        if packet.code == PING:
            return [encode(Status(s.id, s.error, s.model.to_bytes(2, "little") + b"\x2d")) for s in addressed]
        answers = []
        for read in reads_of(packet) or ():
            slave = self.slaves.get(read.id)
            if slave is not None and not slave.absent:
                answers.append(self._status(slave, bytes(slave.memory[read.address : read.address + read.length])))
        for write in writes_of(packet) or ():
            slave = self.slaves.get(write.id)
            if slave is not None and not slave.absent:
                slave.memory[write.address : write.address + len(write.data)] = write.data
                answers += [self._status(slave)] if packet.id == slave.id else []
        if packet.code in (REBOOT, ACTION) and packet.id != BROADCAST:
            answers += [self._status(slave) for slave in addressed]
        return answers

    def _status(self, slave: Slave, data: bytes = b"") -> bytes:
        return encode(Status(slave.id, slave.error, b"" if slave.error & 0x7F else data))
