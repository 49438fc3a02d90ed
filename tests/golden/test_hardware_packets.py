"""The packets printed in ROBOTIS's protocol manual, both ways."""

import json
from pathlib import Path

import pytest

from sinew.hardware.codec import (
    Decoder,
    FastStatus,
    Instruction,
    Packet,
    Read,
    Status,
    Write,
    action,
    bulk_read,
    bulk_write,
    encode,
    fast_blocks,
    ping,
    read,
    reads_of,
    reboot,
    reg_write,
    sync_read,
    sync_write,
    write,
    writes_of,
)

GOLDEN = json.loads(Path(__file__).with_name("robotis_protocol2.json").read_text(encoding="utf-8"))["packets"]
WIRE = {name: bytes.fromhex(text) for name, text in GOLDEN.items()}

# What the text around each example says it means: position 166 = 0xA6, 2079 = 0x081F, voltage 119, temperature 36, ...
MEANT: dict[str, Packet] = {
    "ping 1": ping(1),
    "ping 1 status": Status(1, 0, (1030).to_bytes(2, "little") + bytes([38])),
    "ping all": ping(),
    "ping 2 status": Status(2, 0, (1030).to_bytes(2, "little") + bytes([38])),
    "read": read(1, 132, 4),
    "read status": Status(1, 0, (166).to_bytes(4, "little")),
    "write": write(1, 116, (512).to_bytes(4, "little")),
    "write status": Status(1),
    "reg write": reg_write(1, 104, (200).to_bytes(4, "little")),
    "action": action(1),
    "factory reset": Instruction(1, 0x06, b"\x01"),
    "reboot": reboot(1),
    "clear": Instruction(1, 0x10, b"\x01DXL\x22"),
    "control table backup": Instruction(1, 0x20, b"\x01CTRL"),
    "control table restore": Instruction(1, 0x20, b"\x02CTRL"),
    "sync read": sync_read(132, 4, [1, 2]),
    "sync read 2 status": Status(2, 0, (2079).to_bytes(4, "little")),
    "sync write": sync_write(116, {1: (150).to_bytes(4, "little"), 2: (170).to_bytes(4, "little")}),
    "fast sync read": sync_read(132, 4, [3, 7, 4], fast=True),
    "fast sync read status": FastStatus(WIRE["fast sync read status"][8:]),
    "bulk read": bulk_read([Read(1, 144, 2), Read(2, 146, 1)]),
    "bulk read 1 status": Status(1, 0, (119).to_bytes(2, "little")),
    "bulk read 2 status": Status(2, 0, bytes([36])),
    "bulk write": bulk_write([Write(1, 32, (160).to_bytes(2, "little")), Write(2, 31, bytes([80]))]),
    "fast bulk read": bulk_read([Read(3, 132, 4), Read(7, 124, 2), Read(4, 146, 1)], fast=True),
    "fast bulk read status": FastStatus(WIRE["fast bulk read status"][8:]),
}

each_packet = pytest.mark.parametrize("name", WIRE)


@each_packet
def test_what_the_manual_means_is_written_as_the_manual_prints_it(name: str) -> None:
    assert encode(MEANT[name]).hex(" ") == WIRE[name].hex(" ")


@each_packet
def test_what_the_manual_prints_is_read_as_the_manual_means_it(name: str) -> None:
    assert Decoder().feed(WIRE[name]) == [MEANT[name]]


def test_all_26_examples_are_there() -> None:
    assert len(WIRE) == 26


@pytest.mark.parametrize(("name", "printed"), [("fast bulk read", "20 F2"), ("control table restore", "92 F5")])
def test_the_two_wrong_crcs_that_the_manual_prints_are_refused(name: str, printed: str) -> None:
    assert Decoder().feed(WIRE[name][:-2] + bytes.fromhex(printed)) == []


def test_the_parts_of_the_fast_sync_read_are_the_positions_the_manual_gives() -> None:
    parts = fast_blocks(WIRE["fast sync read status"], [4, 4, 4])
    assert parts == [Status(d, 0, v.to_bytes(4, "little")) for d, v in [(3, 166), (7, 2079), (4, 1023)]]


def test_the_parts_of_the_fast_bulk_read_are_the_values_the_manual_gives() -> None:
    parts = fast_blocks(WIRE["fast bulk read status"], [4, 2, 1])
    assert parts == [Status(3, 0, b"\xa6\0\0\0"), Status(7, 0, b"\xa5\x01"), Status(4, 0, b"\x1f")]


@pytest.mark.parametrize(
    ("kept", "devices"), [(32, [3, 7, 4]), (31, [3, 7]), (24, [3, 7]), (23, [3]), (15, []), (3, [])]
)
def test_what_arrived_before_a_fast_sync_read_was_cut_off_is_kept(kept: int, devices: list[int]) -> None:
    assert [part.id for part in fast_blocks(WIRE["fast sync read status"][:kept], [4, 4, 4])] == devices


@pytest.mark.parametrize(
    ("name", "reads"),
    [
        ("read", (Read(1, 132, 4),)),
        ("sync read", (Read(1, 132, 4), Read(2, 132, 4))),
        ("fast sync read", (Read(3, 132, 4), Read(7, 132, 4), Read(4, 132, 4))),
        ("bulk read", (Read(1, 144, 2), Read(2, 146, 1))),
        ("fast bulk read", (Read(3, 132, 4), Read(7, 124, 2), Read(4, 146, 1))),
    ],
)
def test_a_device_understands_what_the_manual_asks(name: str, reads: tuple[Read, ...]) -> None:
    (packet,) = Decoder().feed(WIRE[name])
    assert isinstance(packet, Instruction)
    assert reads_of(packet) == reads


@pytest.mark.parametrize(
    ("name", "writes"),
    [
        ("write", (Write(1, 116, b"\0\x02\0\0"),)),
        ("reg write", (Write(1, 104, b"\xc8\0\0\0"),)),
        ("sync write", (Write(1, 116, b"\x96\0\0\0"), Write(2, 116, b"\xaa\0\0\0"))),
        ("bulk write", (Write(1, 32, b"\xa0\0"), Write(2, 31, b"\x50"))),
    ],
)
def test_a_device_understands_what_the_manual_orders(name: str, writes: tuple[Write, ...]) -> None:
    (packet,) = Decoder().feed(WIRE[name])
    assert isinstance(packet, Instruction)
    assert writes_of(packet) == writes
