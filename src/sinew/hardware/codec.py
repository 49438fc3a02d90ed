"""This is where packets of the Dynamixel Protocol 2.0 become bytes.

    instruction   FF FF FD 00 | ID | LEN_L LEN_H | INST | params | CRC_L CRC_H
    status        FF FF FD 00 | ID | LEN_L LEN_H | 0x55 | ERR | params | CRC_L CRC_H
    fast status   FF FF FD 00 | FE | LEN_L LEN_H | 0x55 | ERR ID data CRC | ERR ID data CRC | ...

LEN counts the bytes behind it. Inside INST..params a `FF FF FD` is followed by a stuffed `FD`, so that the header
appears nowhere else; LEN and CRC are those of the stuffed packet. A fast status, the common answer of several devices
to one Fast Sync or Fast Bulk Read, is not stuffed, and each device's CRC runs over all bytes since the header.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0". Bytes in, bytes out: nothing here knows a port or the time.
"""

from dataclasses import dataclass
from functools import cache
from struct import unpack_from

from sinew.hardware.errors import PacketError

__all__ = [
    "BROADCAST",
    "HEADER",
    "HIGHEST_ID",
    "LONGEST",
    "STATUS",
    "FastStatus",
    "Instruction",
    "Packet",
    "Status",
    "add_stuffing",
    "crc16",
    "encode",
    "fast_blocks",
    "is_stuffed",
    "remove_stuffing",
    "wire_bytes",
]

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
