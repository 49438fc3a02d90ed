"""This is where the instructions of the protocol are written and read: what is asked of whom.

The builders are the master's side, the readers `reads_of` and `writes_of` the device's. A device must expect anything,
so the readers return None for parameters that make no sense and never raise.

Addresses and lengths are 16-bit numbers, low byte first. Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0".
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from sinew.hardware.codec import BROADCAST, HIGHEST_ID, Instruction
from sinew.hardware.errors import PacketError

__all__ = [
    "ACTION",
    "BULK_READ",
    "BULK_WRITE",
    "CLEAR",
    "FACTORY_RESET",
    "FAST_BULK_READ",
    "FAST_SYNC_READ",
    "PING",
    "READ",
    "REBOOT",
    "REG_WRITE",
    "SYNC_READ",
    "SYNC_WRITE",
    "WRITE",
    "Read",
    "Write",
    "action",
    "bulk_read",
    "bulk_write",
    "ping",
    "read",
    "reads_of",
    "reboot",
    "reg_write",
    "sync_read",
    "sync_write",
    "write",
    "writes_of",
]

PING, READ, WRITE, REG_WRITE, ACTION, FACTORY_RESET, REBOOT, CLEAR = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x08, 0x10
SYNC_READ, SYNC_WRITE, FAST_SYNC_READ = 0x82, 0x83, 0x8A
BULK_READ, BULK_WRITE, FAST_BULK_READ = 0x92, 0x93, 0x9A


@dataclass(frozen=True, slots=True)
class Read:
    """`length` bytes from `address` on are asked from device `id`."""

    id: int
    address: int
    length: int


@dataclass(frozen=True, slots=True)
class Write:
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
