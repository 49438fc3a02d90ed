"""Streams of bytes that a bus could carry on a bad day, from a seed, and what a decoder made of them."""

import random
from dataclasses import dataclass

from sinew.hardware.codec import HEADER, Decoder, FastStatus, Instruction, Packet, Status, crc16, encode

# Bits of packets that look like headers, stuffing and their beginnings, and what stands around them.
PIECES = [
    b"\xff",
    b"\xff\xff",
    b"\xff\xff\xfd",
    b"\xff\xff\xfd\xfd",
    b"\xff\xff\xfd\xff",
    HEADER,
    HEADER + b"\x01",
    HEADER + b"\xfe\x19\x00\x55",
    b"\xfd",
    b"\xfd\x00",
    b"\x00",
    b"\x55",
]


def draw_payload(chance: random.Random) -> bytes:
    kind = chance.random()
    if kind < 0.5:
        return b"".join(chance.choices(PIECES, k=chance.randrange(5)))
    return chance.randbytes(chance.randrange(16))


def draw_packet(chance: random.Random) -> Packet:
    kind = chance.random()
    if kind < 0.6:
        return Status(chance.randrange(253), chance.randrange(256), draw_payload(chance))
    if kind < 0.9:
        code = chance.choice([1, 2, 3, 4, 5, 8, 0x82, 0x83, 0x8A, 0x92, 0x93, 0x9A])
        return Instruction(chance.choice([1, 5, 200, 0xFE]), code, draw_payload(chance))
    parts = [chance.randbytes(chance.randrange(9)) for _ in range(chance.randrange(1, 5))]
    length = 1 + sum(len(part) + 4 for part in parts)
    frame = HEADER + bytes([0xFE, length & 0xFF, length >> 8, 0x55])
    for device, part in enumerate(parts):
        frame += bytes([0, device]) + part
        frame += crc16(frame).to_bytes(2, "little")
    return FastStatus(frame[8:])


def damage(wire: bytes, chance: random.Random) -> bytes:
    """Return bytes with something cut out, put in, flipped or repeated."""
    kind = chance.randrange(5)
    at = chance.randrange(len(wire))
    if kind == 0:
        return wire[:at]
    if kind == 1:
        return wire[at + 1 :]
    if kind == 2:
        return wire[:at] + bytes([wire[at] ^ 1 << chance.randrange(8)]) + wire[at + 1 :]
    if kind == 3:
        return wire[:at] + chance.choice(PIECES) + wire[at:]
    return wire[:at] + wire[at : at + chance.randrange(1, 6)] + wire[at:]


@dataclass
class Tally:
    """streams, sent: how many. damaged: packets of them that did not arrive whole.

    lost: packets that arrived whole and did not come out.
    shared: the same, but their first bytes FF replaced just those that had been cut off the packet before, which
    thereby came out whole: nobody can tell whose bytes they were.
    crc_errors: times the decoder found a packet of full length with a wrong CRC.
    invented: packets that came out but do not stand in the stream, whole and with the right CRC.
    undetected: packets that came out, do stand in the stream so, but nobody sent: damage that a CRC of 16 bits misses.
    """

    streams: int = 0
    sent: int = 0
    damaged: int = 0
    accepted: int = 0
    crc_errors: int = 0
    lost: int = 0
    shared: int = 0
    invented: int = 0
    undetected: int = 0


def run_stream(chance: random.Random, tally: Tally) -> None:
    """Send up to four packets, each whole, damaged, or behind garbage, in chunks; count what comes out."""
    sent: list[Packet] = []
    whole: list[Packet] = []
    stream = b""
    for _ in range(chance.randrange(1, 5)):
        packet = draw_packet(chance)
        wire = encode(packet)
        kind = chance.random()
        arriving = damage(wire, chance) if kind < 0.35 else draw_payload(chance) + wire if kind < 0.5 else wire
        sent.append(packet)
        whole += [packet] if wire in arriving else []
        stream += arriving
    decoder = Decoder()
    cut = chance.randrange(len(stream) + 1)
    out = decoder.feed(stream[:cut]) + decoder.feed(stream[cut:])
    tally.streams += 1
    tally.sent += len(sent)
    tally.damaged += len(sent) - len(whole)
    tally.accepted += len(out)
    waiting = iter(out)
    for packet in whole:
        if packet not in waiting:
            waiting = iter(out)
            shared = any(encode(other) + encode(packet)[n:] in stream for other in out for n in (1, 2, 3))
            tally.shared += shared
            tally.lost += not shared
    tally.crc_errors += decoder.crc_errors
    for packet in out:
        if encode(packet) not in stream:
            tally.invented += 1
        elif packet not in sent:
            tally.undetected += 1


def run_streams(count: int, seed: int) -> Tally:
    chance = random.Random(seed)
    tally = Tally()
    for _ in range(count):
        run_stream(chance, tally)
    return tally
