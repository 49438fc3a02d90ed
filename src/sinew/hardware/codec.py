"""Packets of the Dynamixel Protocol 2.0, as bytes and back.

    instruction   FF FF FD 00 | ID | LEN_L LEN_H | INST | params | CRC_L CRC_H
    status        FF FF FD 00 | ID | LEN_L LEN_H | 0x55 | ERR | params | CRC_L CRC_H
    fast status   FF FF FD 00 | FE | LEN_L LEN_H | 0x55 | ERR ID data CRC | ERR ID data CRC | ...

LEN counts the bytes behind it. Inside INST..params a `FF FF FD` is followed by a stuffed `FD`, so that the header
appears nowhere else; LEN and CRC are those of the stuffed packet. A fast status, the common answer of several devices
to one Fast Sync or Fast Bulk Read, is not stuffed, and each device's CRC runs over all bytes since the header.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0". Bytes in, bytes out: nothing here knows a port or the time.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from struct import unpack_from
from typing import NamedTuple

from sinew.measure.errors import PacketError

HEADER = b"\xff\xff\xfd\x00"
BROADCAST = 0xFE
HIGHEST_ID = 252
STATUS = 0x55
# The largest LEN that is sent or believed. The protocol allows 65535; the whole control table of an X motor is 662.
# What bounds LEN bounds how long a decoder can be made to wait by noise that looks like a header.
LONGEST = 2048

_PATTERN = b"\xff\xff\xfd"
_POLYNOMIAL = 0x8005
_ALERT = 0x80


def _crc_of_byte(byte: int) -> int:
    crc = byte << 8
    for _ in range(8):
        crc = (crc << 1) ^ _POLYNOMIAL if crc & 0x8000 else crc << 1
    return crc & 0xFFFF


_CRC_TABLE = tuple(_crc_of_byte(byte) for byte in range(256))


@cache
def _crc_of_words() -> list[int]:
    """Return the table that takes two bytes at once; made when it is first needed, which takes 10 ms."""
    two = (((crc << 8) & 0xFF00, crc >> 8) for crc in _CRC_TABLE)
    return [high ^ _CRC_TABLE[low ^ byte] for high, low in two for byte in range(256)]


@dataclass(frozen=True, slots=True)
class Instruction:
    """What the master sends.

    id: 0 to 252, or 254 (broadcast). code: the instruction, 0 to 254 but not 0x55. params: not stuffed.
    """

    id: int
    code: int
    params: bytes = b""


@dataclass(frozen=True, slots=True)
class Status:
    """What one device answers.

    id: 0 to 252. error: the byte ERR, alert and number in one. params: not stuffed.
    """

    id: int
    error: int = 0
    params: bytes = b""

    @property
    def alert(self) -> bool:
        """Whether the device reports a hardware error; its register says which."""
        return bool(self.error & _ALERT)

    @property
    def number(self) -> int:
        """Why the instruction was not carried out, 0 to 127; 0 where it was. A number and not a set of flags."""
        return self.error & ~_ALERT


@dataclass(frozen=True, slots=True)
class FastStatus:
    """What several devices answer together; `fast_blocks` takes it apart.

    body: ERR ID data CRC of each device, all in one, up to the last CRC.
    """

    body: bytes


Packet = Instruction | Status | FastStatus


def crc16(data: bytes | bytearray, crc: int = 0) -> int:
    """Return the CRC-16 of the protocol (polynomial 0x8005, start 0, nothing reflected or inverted).

    crc: the CRC of what came before, to run on.
    """
    table = _crc_of_words()
    for word in unpack_from(f">{len(data) >> 1}H", data):
        crc = table[crc ^ word]
    return (crc << 8) & 0xFF00 ^ _CRC_TABLE[crc >> 8 ^ data[-1]] if len(data) & 1 else crc


def add_stuffing(body: bytes) -> bytes:
    """Return INST..params with FD behind every FF FF FD."""
    return body.replace(_PATTERN, _PATTERN + b"\xfd")


def remove_stuffing(body: bytes) -> bytes:
    """Return INST..params without the FD behind every FF FF FD."""
    return body.replace(_PATTERN + b"\xfd", _PATTERN)


def is_stuffed(body: bytes | bytearray, *, whole: bool = True) -> bool:
    """Return whether every FF FF FD of INST..params is followed by FD, as in what a sender made by the rules.

    whole: False if more bytes follow, which may still bring the FD of a pattern at the very end.
    """
    at = body.find(_PATTERN)
    while at >= 0:
        behind = body[at + 3 : at + 4]
        if behind != b"\xfd" and (behind or whole):
            return False
        at = body.find(_PATTERN, at + 3)
    return True


def encode(packet: Packet) -> bytes:
    """Return the bytes of a packet on the wire.

    Raises PacketError if the id, the instruction or the length is none that the protocol has.
    """
    if isinstance(packet, FastStatus):
        length = len(packet.body) + 1
        _refuse(not 5 <= length <= LONGEST, f"a fast status of {len(packet.body)} bytes")
        return HEADER + bytes((BROADCAST, *_low_high(length), STATUS)) + packet.body
    if isinstance(packet, Status):
        _refuse(not 0 <= packet.id <= HIGHEST_ID, f"a status of id {packet.id}", "an id from 0 to 252")
        _refuse(not 0 <= packet.error <= 0xFF, f"a status with error {packet.error}", "one byte")
        body = bytes((STATUS, packet.error)) + packet.params
    else:
        known = 0 <= packet.id <= HIGHEST_ID or packet.id == BROADCAST
        _refuse(not known, f"an instruction to id {packet.id}", "an id from 0 to 252, or 254 for all")
        fine = 0 <= packet.code <= 0xFF and packet.code != STATUS
        _refuse(not fine, f"instruction {packet.code:#x}", "one byte, not 0x55")
        body = bytes((packet.code,)) + packet.params
    stuffed = add_stuffing(body)
    length = len(stuffed) + 2
    _refuse(length > LONGEST, f"a packet of {length} bytes", f"at most {LONGEST}; ask for less at once")
    frame = HEADER + bytes((packet.id, *_low_high(length))) + stuffed
    return frame + bytes(_low_high(crc16(frame)))


def wire_bytes(params: int, *, status: bool = False) -> int:
    """Return how many bytes an instruction, or a status, with so many bytes of parameters is on the wire, unstuffed."""
    return params + (11 if status else 10)


def fast_blocks(frame: bytes | bytearray, lengths: list[int]) -> list[Status]:
    """Return the devices' parts of a fast status, in order, up to the first that is damaged or missing.

    frame: the bytes from the header on, whole or cut off. Because each device's CRC runs over all before it, what
        arrived before a device fell silent is as good as in a whole packet.
    lengths: data bytes asked from each device.
    """
    expected = 1 + sum(length + 4 for length in lengths)
    if frame[:8] != HEADER + bytes((BROADCAST, *_low_high(expected), STATUS)):
        return []
    blocks: list[Status] = []
    start, crc = 8, crc16(frame[:8])
    for length in lengths:
        stop = start + length + 4
        if len(frame) < stop:
            break
        crc = crc16(frame[start : stop - 2], crc)
        if frame[stop - 2 : stop] != bytes(_low_high(crc)):
            break
        error, device = frame[start : start + 2]
        blocks.append(Status(device, error, bytes(frame[start + 2 : stop - 2])))
        crc = crc16(frame[stop - 2 : stop], crc)
        start = stop
    return blocks


def _low_high(number: int) -> tuple[int, int]:
    return number & 0xFF, number >> 8


def _refuse(bad: bool, found: str, expected: str = f"at least 4 bytes and at most {LONGEST}") -> None:
    if bad:
        raise PacketError(f"cannot send {found}; expected {expected}")


# A stream of bytes becomes packets again, whatever has happened to it on the way.
#
# The decoder believes a packet only if header, length, stuffing and CRC agree. It looks for the next header in every
# byte that no packet has used up, also in those of a packet that turned out broken: garbage costs no packet after it.

_BEFORE_BODY = 7  # header, id and length
_BROKEN, _INCOMPLETE = "broken", "incomplete"


@dataclass(slots=True)
class _Found:
    """A packet and where in the buffer it ends."""

    packet: Packet
    stop: int


class Decoder:
    """Turns chunks of bytes into packets; no input makes it raise, and it never holds more than one packet's bytes.

    A header that appears inside a stuffed packet proves that packet broken, and the decoder goes over to the new one at
    once. Inside a fast status, which is not stuffed, it may be data: then both are followed, and the one that is whole
    and has the right CRC first wins.

    crc_errors: packets of full length whose CRC was wrong. damaged: id and instruction of the newest, as received.
    discarded: bytes that belonged to no packet.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.crc_errors = 0
        self.damaged = BROADCAST, STATUS
        self.discarded = 0

    @property
    def rest(self) -> bytes:
        """The bytes kept because they may be the beginning of a packet."""
        return bytes(self._buffer)

    def reset(self) -> None:
        """Forget the bytes retained: what comes now has nothing to do with them."""
        self._drop(len(self._buffer))

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that these bytes complete, in the order of the stream."""
        self._buffer += data
        packets: list[Packet] = []
        while (found := self._next()) is not None:
            packets.append(found)
        return packets

    def _next(self) -> Packet | None:
        """Return the next whole packet and drop the bytes up to its end; drop what cannot become one."""
        buffer = self._buffer
        if not buffer:
            return None
        pending: int | None = None
        at = buffer.find(HEADER)
        while at >= 0:
            found = self._look(at, counting=pending is None)
            if isinstance(found, _Found):
                self._drop(at)
                del buffer[: found.stop - at]
                return found.packet
            if found is _INCOMPLETE and pending is None:
                pending = at
            at = buffer.find(HEADER, at + 1)
        self._drop(self._beginning() if pending is None else pending)
        return None

    def _beginning(self) -> int:
        """Return where a header begins that the end of the buffer cuts off; the end where there is none."""
        size = len(self._buffer)
        for length in range(min(3, size), 0, -1):
            if self._buffer.endswith(HEADER[:length]):
                return size - length
        return size

    def _look(self, at: int, *, counting: bool) -> _Found | str:
        """Return the packet whose header is at `at`, or why there is none (yet).

        counting: whether a wrong CRC is news; inside a pending packet the same bytes are looked at again and again.
        """
        buffer = self._buffer
        body = at + _BEFORE_BODY
        if len(buffer) <= body:
            return _INCOMPLETE
        device, length, code = buffer[at + 4], buffer[at + 5] | buffer[at + 6] << 8, buffer[body]
        known = device <= HIGHEST_ID or device == BROADCAST
        fast = device == BROADCAST and code == STATUS
        shortest = 5 if fast else 4 if code == STATUS else 3
        if not known or not shortest <= length <= LONGEST:
            return _BROKEN
        stop = body + length
        whole = len(buffer) >= stop
        if not fast and not is_stuffed(buffer[body : min(stop - 2, len(buffer))], whole=whole):
            return _BROKEN
        if not whole:
            return _INCOMPLETE
        if crc16(buffer[at : stop - 2]) != buffer[stop - 2] | buffer[stop - 1] << 8:
            if counting:
                self.crc_errors, self.damaged = self.crc_errors + 1, (device, code)
            return _BROKEN
        if fast:
            return _Found(FastStatus(bytes(buffer[body + 1 : stop])), stop)
        params = remove_stuffing(bytes(buffer[body : stop - 2]))
        if code == STATUS:
            return _Found(Status(device, params[1], params[2:]), stop)
        return _Found(Instruction(device, code, params[1:]), stop)

    def _drop(self, size: int) -> None:
        self.discarded += size
        del self._buffer[:size]


# The instructions of the protocol are written and read: what is asked of whom.
#
# The builders are the master's side, the readers `reads_of` and `writes_of` the device's. A device must expect
# anything, so the readers return None for parameters that make no sense and never raise.
#
# Addresses and lengths are 16-bit numbers, low byte first. Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0".

PING, READ, WRITE, REG_WRITE, ACTION, FACTORY_RESET, REBOOT, CLEAR = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x08, 0x10
CONTROL_TABLE_BACKUP = 0x20
SYNC_READ, SYNC_WRITE, FAST_SYNC_READ = 0x82, 0x83, 0x8A
BULK_READ, BULK_WRITE, FAST_BULK_READ = 0x92, 0x93, 0x9A


class Read(NamedTuple):
    """`length` bytes from `address` on are asked from device `id`."""

    id: int
    address: int
    length: int


class Write(NamedTuple):
    """`data` is to be stored from `address` on in device `id`."""

    id: int
    address: int
    data: bytes


def ping(device: int = BROADCAST) -> Instruction:
    """Return the question who is there, to one or to all; the answer holds model number (2 bytes) and firmware (1)."""
    return Instruction(device, PING)


def read(device: int, address: int, length: int) -> Instruction:
    """Return the question for `length` bytes from `address` on."""
    return Instruction(device, READ, _span(address, length))


def write(device: int, address: int, data: bytes) -> Instruction:
    """Return the order to store `data` from `address` on; nobody answers to one for all."""
    return Instruction(device, WRITE, _span(address, len(data))[:2] + data)


def reg_write(device: int, address: int, data: bytes) -> Instruction:
    """Return the order to keep `data` ready until `action`."""
    return Instruction(device, REG_WRITE, _span(address, len(data))[:2] + data)


def action(device: int = BROADCAST) -> Instruction:
    """Return the order to carry out what `reg_write` left ready."""
    return Instruction(device, ACTION)


def reboot(device: int) -> Instruction:
    """Return the order to start anew: the only way out of a shutdown."""
    return Instruction(device, REBOOT)


def sync_read(address: int, length: int, devices: Sequence[int], *, fast: bool = False) -> Instruction:
    """Return the question for the same bytes of several devices, which answer in this order.

    fast: they answer in one packet together (X430 motors from firmware 45 on).
    """
    return Instruction(
        BROADCAST, FAST_SYNC_READ if fast else SYNC_READ, _span(address, length) + bytes(_distinct(devices))
    )


def sync_write(address: int, data: Mapping[int, bytes]) -> Instruction:
    """Return the order to several devices to store their `data`, all of one length, from `address` on."""
    _distinct(data)
    lengths = {len(part) for part in data.values()}
    if len(lengths) != 1:
        raise PacketError(f"cannot send a sync write with data of {sorted(lengths)} bytes; expected one length for all")
    body = b"".join(bytes((device,)) + part for device, part in data.items())
    return Instruction(BROADCAST, SYNC_WRITE, _span(address, lengths.pop()) + body)


def bulk_read(reads: Sequence[Read], *, fast: bool = False) -> Instruction:
    """Return the question for other bytes of each device, which answer in this order, each device once at most.

    fast: they answer in one packet together (X430 motors from firmware 45 on).
    """
    _distinct(part.id for part in reads)
    body = b"".join(bytes((part.id,)) + _span(part.address, part.length) for part in reads)
    return Instruction(BROADCAST, FAST_BULK_READ if fast else BULK_READ, body)


def bulk_write(writes: Sequence[Write]) -> Instruction:
    """Return the order to several devices to store their data at their addresses, each device once at most."""
    _distinct(part.id for part in writes)
    body = b"".join(bytes((part.id,)) + _span(part.address, len(part.data)) + part.data for part in writes)
    return Instruction(BROADCAST, BULK_WRITE, body)


def reads_of(instruction: Instruction) -> tuple[Read, ...] | None:
    """Return what an instruction asks to be read, in the order of the answers; None if it asks nothing sensible.

    A plain read to all devices keeps the broadcast id; nobody answers it.
    """
    p = instruction.params
    match instruction.code:
        case 0x02 if len(p) == 4:
            return (Read(instruction.id, *_span_of(p)),)
        case 0x82 | 0x8A if len(p) > 4 and _are_devices(p[4:]):
            return tuple(Read(device, *_span_of(p)) for device in p[4:])
        case 0x92 | 0x9A if p and len(p) % 5 == 0 and _are_devices(p[::5]):
            return tuple(Read(p[at], *_span_of(p[at + 1 : at + 5])) for at in range(0, len(p), 5))
    return None


def writes_of(instruction: Instruction) -> tuple[Write, ...] | None:
    """Return what an instruction asks to be stored; None if it asks nothing sensible."""
    p = instruction.params
    match instruction.code:
        case 0x03 | 0x04 if len(p) > 2:
            return (Write(instruction.id, p[0] | p[1] << 8, p[2:]),)
        case 0x83 if len(p) > 4:
            address, length = _span_of(p)
            each = 1 + length
            if not length or (len(p) - 4) % each or not _are_devices(p[4::each]):
                return None
            return tuple(Write(p[at], address, p[at + 1 : at + each]) for at in range(4, len(p), each))
        case 0x93:
            return _bulk_writes(p)
    return None


def _bulk_writes(p: bytes) -> tuple[Write, ...] | None:
    writes: list[Write] = []
    at = 0
    while at < len(p):
        if len(p) < at + 5:
            return None
        address, length = _span_of(p[at + 1 : at + 5])
        data = p[at + 5 : at + 5 + length]
        if not length or len(data) < length:
            return None
        writes.append(Write(p[at], address, data))
        at += 5 + length
    return tuple(writes) if writes and _are_devices(bytes(part.id for part in writes)) else None


def _span(address: int, length: int) -> bytes:
    if not 0 <= address <= 0xFFFF or not 1 <= length <= 0xFFFF:
        raise PacketError(f"cannot ask for {length} bytes at address {address}; expected 16-bit numbers, length >= 1")
    return bytes((address & 0xFF, address >> 8, length & 0xFF, length >> 8))


def _span_of(p: bytes) -> tuple[int, int]:
    return p[0] | p[1] << 8, p[2] | p[3] << 8


def _are_devices(ids: bytes) -> bool:
    return max(ids) <= HIGHEST_ID and len(set(ids)) == len(ids)


def _distinct(devices: Iterable[int]) -> list[int]:
    ids = list(devices)
    if not ids or len(set(ids)) != len(ids) or not all(0 <= device <= HIGHEST_ID for device in ids):
        raise PacketError(f"cannot address devices {ids} together; expected different ids from 0 to {HIGHEST_ID}")
    return ids
