"""The wire: a half-duplex line with devices, on which every byte takes its time.

An instruction is heard when its last byte has come; a device answers when its return delay has passed, with what its
registers hold then. In a sync or bulk read the answers follow one another: each device waits for the status before its
own. Behind a device that does not answer a motor stays silent, while a board goes on after the time that the answer
would have taken (`Device.is_node`); the manual does not say what a motor does, and this is the worse of the two.
A device set to another baud hears nothing that makes sense, and says nothing. Who speaks at the same time spoils the
bytes: zeros win over ones. Some adapters return what their master sends (`echoes`). A status that a USB adapter hands
over in one piece is handed over here when its last byte has come. Answers to a ping of all come by id.

An instruction whose bytes pause for longer than `GAP_S` is dropped, up to the next header. The motor that is named in
one with a wrong CRC answers with the protocol's CRC error, unless it is one for all. Instructions that are not stuffed
are not understood.
"""

import heapq
import itertools
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from sinew.emulator.device import CRC, Device
from sinew.hardware import codec as ask
from sinew.hardware.codec import (
    BROADCAST,
    HEADER,
    LONGEST,
    STATUS,
    Decoder,
    Instruction,
    Status,
    crc16,
    encode,
    wire_bytes,
)

Disturbance = Callable[[float, bytes], list[tuple[float, bytes]]]
"""Turns (when the last byte has come [s], bytes) into what arrives instead, and when; nothing for what is lost."""

GAP_S = 1.5e-3
"""Longest pause between two bytes of an instruction [s] (e-Manual, "DYNAMIXEL Protocol 2.0", Byte to Byte Time)."""

_BITS_PER_BYTE = 10
_READS = (ask.READ, ask.SYNC_READ, ask.BULK_READ)
_FAST_READS = (ask.FAST_SYNC_READ, ask.FAST_BULK_READ)
_GROUP_WRITES = (ask.SYNC_WRITE, ask.BULK_WRITE)


@dataclass(slots=True, eq=False)
class _Burst:
    """Bytes that one party puts on the wire without a pause."""

    start: float
    stop: float
    data: bytearray


@dataclass(slots=True)
class _Round:
    """Answers that follow one another.

    crc: of a fast read so far, which is one packet of all. broken: whether the device before the next was silent.
    """

    reads: Sequence[ask.Read]
    fast: bool = False
    next: int = 0
    crc: int = 0
    broken: bool = False

    @property
    def length(self) -> int:
        """LEN of the one packet of a fast read."""
        return 1 + sum(part.length + 4 for part in self.reads)

    def block(self, status: Status, read: ask.Read) -> bytes:
        """Return the next device's part of a fast read; of the first, with the header."""
        part = bytes((status.error, status.id)) + (bytes(read.length) if status.number else status.params)
        if self.next == 0:
            part = HEADER + bytes((BROADCAST, self.length & 0xFF, self.length >> 8, STATUS)) + part
        self.crc = crc16(part, self.crc)
        check = bytes((self.crc & 0xFF, self.crc >> 8))
        self.crc = crc16(check, self.crc)
        return part + check


class Line:
    """The wire between a master and devices.

    host_baud: of the master [1/s]; may be set at any time. disturb_down: faults on the way to the devices;
    disturb_up: to the master. echoes: whether the master's adapter returns what it sends, as one does whose receiver
    listens to its own driver. instructions: how many have been heard. Call `work` at every `next_event`, with the
    devices brought to that time.
    """

    def __init__(self, devices: Sequence[Device], host_baud: int = 1_000_000) -> None:
        self.devices = list(devices)
        self.host_baud = host_baud
        self.disturb_down: Disturbance | None = None
        self.disturb_up: Disturbance | None = None
        self.echoes = False
        self._ear = Decoder()
        self._agenda: list[tuple[float, int, Callable[[float], object]]] = []
        self._order = itertools.count()
        self._wire: list[_Burst] = []
        self._arriving: list[tuple[float, int, bytes]] = []
        self._master_free = 0.0
        self._ear_since = -math.inf
        self.instructions = 0

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes that the master begins to send at a time [s]; they wait for those it sent before."""
        start = max(now, self._master_free)
        for part in _at_headers(data):
            burst = self._put(start, part)
            start = self._master_free = burst.stop
            if self.echoes:
                self._plan(burst.stop, partial(self._come_up, burst.data))
            self._plan(burst.stop, partial(self._come_down, burst.data))

    def transmit(self, now: float) -> bytes:
        """Return what has come to the master by a time [s], and was not returned before."""
        came = b""
        while self._arriving and self._arriving[0][0] <= now:
            came += heapq.heappop(self._arriving)[2]
        return came

    def next_event(self) -> float:
        """Return when something happens next, on the line or to the master [s]; infinite: never."""
        return min(self.due, self._arriving[0][0] if self._arriving else math.inf)

    @property
    def due(self) -> float:
        """When `work` is to be called [s]; infinite: never."""
        return self._agenda[0][0] if self._agenda else math.inf

    def work(self, now: float) -> None:
        """Do what is due by a time [s]."""
        while self._agenda and self._agenda[0][0] <= now:
            at, _, act = heapq.heappop(self._agenda)
            act(at)

    def forget(self) -> None:
        """Lose everything that is on its way, as where the master is unplugged."""
        self._agenda.clear()
        self._arriving.clear()
        self._wire.clear()
        self._ear.reset()

    def _plan(self, at: float, act: Callable[[float], object]) -> None:
        heapq.heappush(self._agenda, (at, next(self._order), act))

    def _put(self, start: float, data: bytes) -> _Burst:
        """Put bytes on the wire; where others are there at the same time, both are spoiled."""
        byte = _BITS_PER_BYTE / self.host_baud
        burst = _Burst(start, start + len(data) * byte, bytearray(data))
        self._wire = [other for other in self._wire if other.stop > start - 1e-9]
        for other in self._wire:
            if other.start < burst.stop - 1e-9 and start < other.stop - 1e-9:
                _spoil(burst, other, round((start - other.start) / byte))
        self._wire.append(burst)
        return burst

    def _come_down(self, data: bytearray, at: float) -> None:
        """Let bytes come to the devices. They are looked at when the last has come: others may have spoilt them."""
        for when, part in _arrivals(self.disturb_down, at, data):
            if when <= at:
                self._hear(part, at)
            else:
                self._plan(when, partial(self._hear, part))

    def _come_up(self, data: bytearray, at: float) -> None:
        for when, part in _arrivals(self.disturb_up, at, data):
            if part:
                heapq.heappush(self._arriving, (max(at, when), next(self._order), part))

    def _hear(self, data: bytes, now: float) -> None:
        """Take bytes of the master whose last one has come."""
        if now - len(data) * _BITS_PER_BYTE / self.host_baud - self._ear_since > GAP_S:
            self._ear.reset()
        self._ear_since = now
        errors = self._ear.crc_errors
        for packet in self._ear.feed(data):
            if isinstance(packet, Instruction):
                self._carry_out(packet, now)
        if self._ear.crc_errors > errors:
            number, code = self._ear.damaged
            for device in self._listeners(now):
                if device.id == number and not device.is_node and device.answers_to(code):
                    self._plan(now + device.return_delay, partial(self._speak, encode(device.status(CRC))))

    def _listeners(self, now: float) -> list[Device]:
        return [device for device in self.devices if device.baud == self.host_baud and device.hears(now)]

    def _carry_out(self, instruction: Instruction, now: float) -> None:
        self.instructions += 1
        listeners = self._listeners(now)
        for device in listeners:
            device.heed(now)
        code, to_all = instruction.code, instruction.id == BROADCAST
        if code in _READS or code in _FAST_READS:
            reads = ask.reads_of(instruction)
            if reads:
                group = _Round(reads, code in _FAST_READS)
                if not group.fast or group.length <= LONGEST:
                    self._go_on(group, now)
                return
            if code != ask.READ:
                return
        if code in _GROUP_WRITES:
            for write in ask.writes_of(instruction) or ():
                for device in listeners:
                    if device.id == write.id:
                        device.write(write.address, write.data, now)
            return
        for device in sorted(listeners, key=lambda device: device.id):
            if to_all or device.id == instruction.id:
                delay = device.return_delay
                status = device.obey(instruction, now)
                if status is not None and (not to_all or code == ask.PING):
                    data = encode(status)
                    self._plan(now + delay, partial(self._speak, data))
                    now += to_all * (delay + len(data) * _BITS_PER_BYTE / self.host_baud)  # a ping of all: in turn

    def _speak(self, data: bytes, start: float) -> float:
        """Put a device's bytes on the wire; return when the last has gone [s]."""
        burst = self._put(start, bytes(data))
        self._plan(burst.stop, partial(self._come_up, burst.data))
        return burst.stop

    def _go_on(self, group: _Round, now: float) -> None:
        """Have the next device of a group speak, after its return delay; who is silent may silence those behind it."""
        while group.next < len(group.reads):
            read = group.reads[group.next]
            speakers = [one for one in self._listeners(now) if one.id == read.id and one.status_return_level >= 1]
            speakers = [one for one in speakers if one.firmware >= one.fast_reads_from or not group.fast]
            if group.broken:
                speakers = [device for device in speakers if device.is_node and not group.fast]
            if speakers:
                for index, device in enumerate(speakers):
                    wait = 0.0 if group.fast and group.next else device.return_delay
                    # Of two devices with one id, the first to be named leads on to the next.
                    self._plan(now + wait, partial(self._take, group, device, read, index == 0))
                return
            if group.fast:
                return  # the packet ends where a device does not go on with it
            group.next, group.broken = group.next + 1, True
            now += wire_bytes(read.length, status=True) * _BITS_PER_BYTE / self.host_baud

    def _take(self, group: _Round, device: Device, read: ask.Read, leads: bool, now: float) -> None:
        """Let a device say its part of a group's answer, as its registers are now. leads: whether the next waits."""
        status = device.answer(read.address, read.length, now) if device.hears(now) else None
        stop = now
        if status is not None:
            stop = self._speak(group.block(status, read) if group.fast else encode(status), now)
        if leads:
            group.next, group.broken = group.next + 1, status is None
            if group.next < len(group.reads):
                self._plan(stop, partial(self._go_on, group))


def _arrivals(disturb: Disturbance | None, at: float, data: bytearray) -> list[tuple[float, bytes]]:
    return [(at, bytes(data))] if disturb is None else disturb(at, bytes(data))


def _at_headers(data: bytes) -> list[bytes]:
    """Return the bytes cut before every header in them, so that each packet is heard when it is whole."""
    return [part for part in re.split(b"(?=" + HEADER + b")", data) if part]


def _spoil(one: _Burst, other: _Burst, shift: int) -> None:
    """Let zeros win over ones where two bursts overlap. shift: bytes by which `one` began after `other`."""
    for at in range(len(one.data)):
        there = at + shift
        if 0 <= there < len(other.data):
            one.data[at] = other.data[there] = one.data[at] & other.data[there]
