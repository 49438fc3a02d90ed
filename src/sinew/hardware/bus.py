"""The bus: devices are asked and answers waited for, one transaction at a time; the clock and line that it needs.

One thread owns a bus. Timeouts are what the bytes need on the wire, the devices' return delay and the latency of the
port, told by a clock that never goes back. What a device does not do is an outcome in its `Reply`; only a port that is
gone raises (PortError).
"""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from time import monotonic, sleep
from typing import Protocol

from sinew.hardware import codec as ask
from sinew.hardware.codec import (
    BROADCAST,
    Decoder,
    Instruction,
    Packet,
    Status,
    encode,
    wire_bytes,
)

# The seams to the outside: what the bus asks of a port, and of a clock.
#
# Both are handed in by the caller: a serial port and the computer's clock on a bench, lists of bytes and a clock moved
# by hand in a test. Whatever is one of them does what is said here, and says only what else it does.


class Clock(Protocol):
    """Tells a time that never goes back, and waits."""

    def now(self) -> float:
        """Return the time [s] since some fixed moment."""
        ...

    def wait_until(self, time: float) -> None:
        """Return at `time` [s] or a little later; at once if it has passed."""
        ...


class Transport(Protocol):
    """Carries bytes to the bus and back. What is sent comes back on some adapters; the bus expects that."""

    def write(self, data: bytes) -> None:
        """Send bytes; raises PortError if the port is gone."""
        ...

    def read(self, deadline: float) -> bytes:
        """Return what has arrived, waiting for at least a byte until `deadline` [s, of the bus's clock]; then b"".

        A deadline that has passed asks for what is there already. Raises PortError if the port is gone.
        """
        ...

    def close(self) -> None:
        """Give the port back; may be called again."""
        ...


class MonotonicClock:
    """The computer's clock that no setting of the date moves; a Clock."""

    def now(self) -> float:
        return monotonic()

    def wait_until(self, time: float) -> None:
        if (left := time - self.now()) > 0:
            sleep(left)


# It is said what became of a question to one device.
#
# Silence, damage and refusal are outcomes of a bus, not exceptions: the caller decides whether one lost sample matters.

# What the number in the byte ERR of a status means.
ERROR_NUMBERS = {
    1: "could not carry it out",
    2: "does not know the instruction, or action without reg write",
    3: "got a damaged packet",
    4: "the value is outside the register's range",
    5: "the data are shorter than the register",
    6: "the value is beyond a limit that is set",
    7: "the register cannot be read or written, or is locked while the torque is on",
}


class Outcome(Enum):
    """How a question to one device ended."""

    ANSWERED = "answered"
    REFUSED = "answered with an error number"
    SILENT = "sent nothing before the deadline"
    DAMAGED = "bytes came before the deadline, but no whole packet"
    WRONG_LENGTH = "answered with another number of bytes than asked for"


@dataclass(frozen=True, slots=True)
class Reply:
    """What one device said.

    data: the bytes asked for; empty unless `ok`. number: the error number, 0 where there is none. alert: whether it
    reports a hardware error (register `hardware_error_status` says which). attempts: how often it was asked.
    rivals: other bytes that came under its id in the same transaction: two devices answer to it, or one answer is late.
    at: when the answer was whole [s, of the bus's clock], or when the waiting ended.
    """

    id: int
    outcome: Outcome
    data: bytes = b""
    number: int = 0
    alert: bool = False
    attempts: int = 1
    at: float = float("nan")
    rivals: tuple[bytes, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether the device did what it was asked, and `data` is what was asked for."""
        return self.outcome is Outcome.ANSWERED

    def __str__(self) -> str:
        why = f": {ERROR_NUMBERS.get(self.number, f'error {self.number}')}" if self.number else ""
        alert = "; it raises its alert, read hardware_error_status" if self.alert else ""
        times = f" (asked {self.attempts} times)" if self.attempts > 1 else ""
        twice = "; another answer came under its id" if self.rivals else ""
        return f"device {self.id} {self.outcome.value}{why}{times}{twice}{alert}"


_BITS_PER_BYTE = 10  # start, eight, stop
_CRC_NUMBER = 3
_PING_DATA = 3
_MOST_WAITS_FOR_QUIET = 5
_SENT_MOST = 4  # whose echo may still come: goals that nobody answers go out before the question behind them


@dataclass(frozen=True, slots=True)
class BusTiming:
    """How long an answer may take.

    baud: 1/s. return_delay: of the slowest device [s]; a factory-new motor waits 500 µs. latency: of port, driver and
    operating system [s]; 16 ms for an FTDI adapter as it comes, 1 ms where its timer is set, and some for the computer.
    """

    baud: int = 1_000_000
    return_delay: float = 500e-6
    latency: float = 0.02

    def allowed(self, sent: int, expected: int, answers: int) -> float:
        """Return how long to wait [s] for `answers` of together `expected` bytes to a packet of `sent` bytes."""
        return (sent + expected) * _BITS_PER_BYTE / self.baud + answers * self.return_delay + self.latency


@dataclass(slots=True)
class Statistics:
    """What happened on a bus since it was made.

    transactions: instructions sent, repeated ones included. retries: of them repeated. sent_bytes, received_bytes.
    answers: status packets that belonged to a question. silent, damaged, refused, wrong_length, alerts: of those asked.
    strays: whole packets nobody asked for (late, doubled, of another id). echoes: our own, which the adapter returned;
    they are dropped. rivals: second answers under one id that differ from the first.
    crc_errors: packets of full length with a wrong CRC. heard_damaged: of the refused, those to an instruction that
    reached its device with a wrong CRC. discarded_bytes: belonging to no packet.
    """

    transactions: int = 0
    retries: int = 0
    sent_bytes: int = 0
    received_bytes: int = 0
    answers: int = 0
    silent: int = 0
    damaged: int = 0
    refused: int = 0
    wrong_length: int = 0
    alerts: int = 0
    strays: int = 0
    crc_errors: int = 0
    discarded_bytes: int = 0
    echoes: int = 0
    rivals: int = 0
    heard_damaged: int = 0


class Bus:
    """Asks devices on one line.

    transport, clock: the seams; the transport's deadlines are told by this clock. retries: how often a device that did
    not answer, or answered damaged, is asked again; what must not happen twice is never repeated. others: instructions
    heard so far that were not sent here: another master is on the line.
    """

    def __init__(self, transport: Transport, clock: Clock, timing: BusTiming | None = None, retries: int = 1) -> None:
        self._transport, self._clock = transport, clock
        self.timing = timing or BusTiming()
        self.retries = retries
        self._statistics = Statistics()
        self._decoder = Decoder()
        self._suspect = False
        self._left_wire = self._heard = -math.inf
        self._sent: deque[bytes] = deque(maxlen=_SENT_MOST)
        self.others = 0

    @property
    def statistics(self) -> Statistics:
        """What happened so far; a copy."""
        return replace(self._statistics, crc_errors=self._decoder.crc_errors, discarded_bytes=self._decoder.discarded)

    @property
    def left_wire(self) -> float:
        """When the last byte of the newest instruction has left the wire, by the baud [s]; -inf before the first.

        It waits there for those before it that nobody answers; what the port itself takes is not known.
        """
        return self._left_wire

    def close(self) -> None:
        """Give the port back."""
        self._transport.close()

    def ping(self, device: int) -> Reply:
        """Return the answer to a ping: model number (2 bytes) and firmware version (1)."""
        return self._ask_one(ask.ping(device), _PING_DATA)

    def scan(self, wait: float | None = None) -> dict[int, Reply]:
        """Return the pings of all devices that answer to one question to all, by id.

        wait: how long to listen [s]; by default as long as 253 devices may take.
        """
        sent = encode(ask.ping())
        allowed = self.timing.allowed(len(sent), 253 * wire_bytes(_PING_DATA, status=True), 253)
        stop = self._send(sent) + (allowed if wait is None else wait)
        found: dict[int, Reply] = {}

        def take(packet: Packet) -> bool:
            if isinstance(packet, Status) and packet.id not in found:
                found[packet.id] = self._judge(packet, _PING_DATA)
                return True
            return False

        self._listen(stop, take, lambda: False)
        return found

    def read(self, device: int, address: int, length: int, *, retries: int | None = None) -> Reply:
        """Return `length` bytes from `address` on. retries: instead of the bus's."""
        return self._ask_one(ask.read(device, address, length), length, retries)

    def write(self, device: int, address: int, data: bytes, *, retries: int | None = None) -> Reply:
        """Store bytes from `address` on; return what the device says to that. retries: instead of the bus's.

        The device must answer to writes (register `status_return_level` 2, as from the factory).
        """
        return self._ask_one(ask.write(device, address, data), 0, retries)

    def reg_write(self, device: int, address: int, data: bytes) -> Reply:
        """Have bytes kept ready until `action`; return what the device says to that."""
        return self._ask_one(ask.reg_write(device, address, data), 0)

    def action(self) -> None:
        """Have all devices carry out what they keep ready. Nobody answers."""
        self._tell(ask.action())

    def reboot(self, device: int) -> Reply:
        """Start a device anew; return what it says to that. Its torque is off afterwards. Never repeated."""
        return self._ask_one(ask.reboot(device), 0, retries=0)

    def sync_write(self, address: int, data: Mapping[int, bytes]) -> None:
        """Store bytes, as many for each device, from `address` on, by id. Nobody answers."""
        self._tell(ask.sync_write(address, data))

    def bulk_write(self, writes: Sequence[ask.Write]) -> None:
        """Store other bytes at other addresses of each device. Nobody answers."""
        self._tell(ask.bulk_write(writes))

    def sync_read(self, address: int, length: int, devices: Sequence[int]) -> dict[int, Reply]:
        """Return the same bytes of several devices, by id and in the order asked. Who did not answer is asked alone."""
        reads = [ask.Read(device, address, length) for device in devices]
        return self._ask_group(ask.sync_read(address, length, devices), reads)

    def bulk_read(self, reads: Sequence[ask.Read], *, retries: int | None = None) -> dict[int, Reply]:
        """Return other bytes of each device, by id and in the order asked; see `sync_read`.

        retries: instead of the bus's; with 0 the call is one transaction, whoever answers.
        """
        return self._ask_group(ask.bulk_read(reads), reads, retries)

    def overhear(self, seconds: float) -> int:
        """Return how many whole packets come in a time [s] in which nothing is sent; what came before is dropped."""
        while self._transport.read(self._clock.now()):
            pass
        self._decoder.reset()
        stop, heard = self._clock.now() + seconds, 0
        while data := self._transport.read(stop):
            heard += len(list(self._decoder.feed(data)))
            if self._clock.now() >= stop:
                break
        return heard

    def _ask_one(self, instruction: Instruction, length: int, retries: int | None = None) -> Reply:
        allowed = self.retries if retries is None else retries
        reply = self._ask_once(instruction, length)
        while reply.attempts <= allowed and _is_worth_repeating(reply):
            self._statistics.retries += 1
            reply = replace(self._ask_once(instruction, length), attempts=reply.attempts + 1)
        return reply

    def _ask_once(self, instruction: Instruction, length: int) -> Reply:
        sent = encode(instruction)
        # Stuffing makes an answer longer by a third at most.
        expected = wire_bytes(length + length // 3 + 1, status=True)
        stop = self._send(sent) + self.timing.allowed(len(sent), expected, 1)
        replies: list[Reply] = []

        def take(packet: Packet) -> bool:
            if not isinstance(packet, Status) or packet.id != instruction.id or replies:
                return False
            replies.append(self._judge(packet, length))
            return True

        heard = self._listen(stop, take, lambda: bool(replies))
        return replies[0] if replies else self._missing(instruction.id, heard)

    def _ask_group(
        self, instruction: Instruction, reads: Sequence[ask.Read], retries: int | None = None
    ) -> dict[int, Reply]:
        allowed = self.retries if retries is None else retries
        lengths = {read.id: read.length for read in reads}
        got: dict[int, Reply] = {}

        def take(packet: Packet) -> bool:
            if not isinstance(packet, Status) or packet.id not in lengths:
                return False
            if packet.id in got:
                self._note_rival(packet, got)
                return False
            got[packet.id] = self._judge(packet, lengths[packet.id])
            return True

        sent = encode(instruction)
        expected = sum(wire_bytes(n + n // 3 + 1, status=True) for n in lengths.values())
        stop = self._send(sent) + self.timing.allowed(len(sent), expected, len(lengths))
        heard = self._listen(stop, take, lambda: len(got) == len(lengths))
        return {read.id: self._finish(read, got.get(read.id), heard, allowed) for read in reads}

    def _finish(self, read: ask.Read, reply: Reply | None, heard: bool, retries: int) -> Reply:
        """Return the reply of a device of a group; who has none, or a damaged one, is asked alone."""
        first = reply or self._missing(read.id, heard)
        if not retries or not _is_worth_repeating(first):
            return first
        self._statistics.retries += 1
        again = self._ask_one(ask.read(read.id, read.address, read.length), read.length, retries - 1)
        return replace(again, attempts=again.attempts + 1)

    def _note_rival(self, packet: Status, got: dict[int, Reply]) -> None:
        """Keep a second answer under one id, as long as the first, that says something else."""
        first = got[packet.id]
        if first.ok and len(packet.params) == len(first.data) and packet.params != first.data:
            self._statistics.rivals += 1
            got[packet.id] = replace(first, rivals=(*first.rivals, packet.params))

    def _tell(self, instruction: Instruction) -> None:
        assert instruction.id == BROADCAST
        self._send(encode(instruction))

    def _send(self, data: bytes) -> float:
        """Send an instruction on a line without old bytes; return when it begins on the wire [s]."""
        quiet = self.timing.latency if self._suspect else 0.0
        now = self._clock.now()
        patience = now + _MOST_WAITS_FOR_QUIET * quiet
        # Where answers came to the last instruction, the line has been quiet since the last of them.
        silent_since = self._heard if self._heard > self._left_wire else now
        wait = max(now, silent_since + quiet)
        while old := self._transport.read(wait):
            self._statistics.received_bytes += len(old)
            for packet in self._decoder.feed(old):
                self._note_stray(packet)
            if self._clock.now() > patience:
                break  # a line that never falls silent is no reason to wait for ever
            wait = self._clock.now() + quiet
        self._decoder.reset()
        self._suspect = False
        self._transport.write(data)
        self._sent.append(data)
        self._statistics.transactions += 1
        self._statistics.sent_bytes += len(data)
        # An instruction that nobody answers may still be on its way out; this one goes after it.
        begins = max(self._clock.now(), self._left_wire)
        self._left_wire = begins + len(data) * _BITS_PER_BYTE / self.timing.baud
        return begins

    def _listen(self, stop: float, take: Callable[[Packet], bool], done: Callable[[], bool]) -> bool:
        """Hand packets to `take` until `done` or `stop` [s]; return whether bytes came that belong to no answer."""
        rejected = self._decoder.discarded + self._decoder.crc_errors
        late = False
        while not done():
            data = b"" if late else self._transport.read(stop)
            if not data:
                self._suspect = True
                break
            self._heard = self._clock.now()
            late = self._heard > stop
            self._statistics.received_bytes += len(data)
            for packet in self._decoder.feed(data):
                if not take(packet):
                    self._note_stray(packet)
                    self._suspect = self._suspect or not isinstance(packet, Instruction)
        return self._decoder.discarded + self._decoder.crc_errors > rejected or bool(self._decoder.rest)

    def _note_stray(self, packet: Packet) -> None:
        if isinstance(packet, Instruction):
            is_ours = encode(packet) in self._sent
            self._statistics.echoes += is_ours
            self.others += not is_ours
        else:
            self._statistics.strays += 1

    def _judge(self, status: Status, length: int) -> Reply:
        self._statistics.answers += 1
        self._statistics.alerts += status.alert
        reply = Reply(status.id, Outcome.ANSWERED, status.params, status.number, status.alert, at=self._clock.now())
        if status.number:
            self._statistics.refused += 1
            self._statistics.heard_damaged += status.number == _CRC_NUMBER
            return replace(reply, outcome=Outcome.REFUSED, data=b"")
        if len(status.params) != length:
            self._statistics.wrong_length += 1
            self._suspect = True
            return replace(reply, outcome=Outcome.WRONG_LENGTH, data=b"")
        return reply

    def _missing(self, device: int, heard: bool) -> Reply:
        if heard:
            self._statistics.damaged += 1
        else:
            self._statistics.silent += 1
        return Reply(device, Outcome.DAMAGED if heard else Outcome.SILENT, at=self._clock.now())


def _is_worth_repeating(reply: Reply) -> bool:
    return not reply.ok and (reply.outcome is not Outcome.REFUSED or reply.number == _CRC_NUMBER)
