"""The packets printed in ROBOTIS's protocol manual, both ways."""

import json
from pathlib import Path

import pytest

from sinew.hardware import codec

GOLDEN = json.loads(Path(__file__).with_name("robotis_protocol2.json").read_text(encoding="utf-8"))["packets"]
WIRE = {name: bytes.fromhex(text) for name, text in GOLDEN.items()}

# What the text around each example says it means: position 166 = 0xA6, 2079 = 0x081F, voltage 119, temperature 36, ...
MEANT: dict[str, codec.Packet] = {
    "ping 1": codec.ping(1),
    "ping 1 status": codec.Status(1, 0, (1030).to_bytes(2, "little") + bytes([38])),
    "ping all": codec.ping(),
    "ping 2 status": codec.Status(2, 0, (1030).to_bytes(2, "little") + bytes([38])),
    "read": codec.read(1, 132, 4),
    "read status": codec.Status(1, 0, (166).to_bytes(4, "little")),
    "write": codec.write(1, 116, (512).to_bytes(4, "little")),
    "write status": codec.Status(1),
    "reg write": codec.reg_write(1, 104, (200).to_bytes(4, "little")),
    "action": codec.action(1),
    "factory reset": codec.Instruction(1, 0x06, b"\x01"),
    "reboot": codec.reboot(1),
    "clear": codec.Instruction(1, 0x10, b"\x01DXL\x22"),
    "control table backup": codec.Instruction(1, 0x20, b"\x01CTRL"),
    "control table restore": codec.Instruction(1, 0x20, b"\x02CTRL"),
    "sync read": codec.sync_read(132, 4, [1, 2]),
    "sync read 2 status": codec.Status(2, 0, (2079).to_bytes(4, "little")),
    "sync write": codec.sync_write(116, {1: (150).to_bytes(4, "little"), 2: (170).to_bytes(4, "little")}),
    "fast sync read": codec.sync_read(132, 4, [3, 7, 4], fast=True),
    "fast sync read status": codec.FastStatus(WIRE["fast sync read status"][8:]),
    "bulk read": codec.bulk_read([codec.Read(1, 144, 2), codec.Read(2, 146, 1)]),
    "bulk read 1 status": codec.Status(1, 0, (119).to_bytes(2, "little")),
    "bulk read 2 status": codec.Status(2, 0, bytes([36])),
    "bulk write": codec.bulk_write([codec.Write(1, 32, (160).to_bytes(2, "little")), codec.Write(2, 31, bytes([80]))]),
    "fast bulk read": codec.bulk_read([codec.Read(3, 132, 4), codec.Read(7, 124, 2), codec.Read(4, 146, 1)], fast=True),
    "fast bulk read status": codec.FastStatus(WIRE["fast bulk read status"][8:]),
}

each_packet = pytest.mark.parametrize("name", WIRE)


@each_packet
def test_what_the_manual_means_is_written_as_the_manual_prints_it(name: str) -> None:
    assert codec.encode(MEANT[name]).hex(" ") == WIRE[name].hex(" ")


@each_packet
def test_what_the_manual_prints_is_read_as_the_manual_means_it(name: str) -> None:
    assert codec.Decoder().feed(WIRE[name]) == [MEANT[name]]


def test_all_26_examples_are_there() -> None:
    assert len(WIRE) == 26


@pytest.mark.parametrize(("name", "printed"), [("fast bulk read", "20 F2"), ("control table restore", "92 F5")])
def test_the_two_wrong_crcs_that_the_manual_prints_are_refused(name: str, printed: str) -> None:
    assert codec.Decoder().feed(WIRE[name][:-2] + bytes.fromhex(printed)) == []


def test_the_parts_of_the_fast_sync_read_are_the_positions_the_manual_gives() -> None:
    parts = codec.fast_blocks(WIRE["fast sync read status"], [4, 4, 4])
    assert parts == [codec.Status(d, 0, v.to_bytes(4, "little")) for d, v in [(3, 166), (7, 2079), (4, 1023)]]


def test_the_parts_of_the_fast_bulk_read_are_the_values_the_manual_gives() -> None:
    parts = codec.fast_blocks(WIRE["fast bulk read status"], [4, 2, 1])
    assert parts == [codec.Status(3, 0, b"\xa6\0\0\0"), codec.Status(7, 0, b"\xa5\x01"), codec.Status(4, 0, b"\x1f")]


@pytest.mark.parametrize(
    ("kept", "devices"), [(32, [3, 7, 4]), (31, [3, 7]), (24, [3, 7]), (23, [3]), (15, []), (3, [])]
)
def test_what_arrived_before_a_fast_sync_read_was_cut_off_is_kept(kept: int, devices: list[int]) -> None:
    assert [part.id for part in codec.fast_blocks(WIRE["fast sync read status"][:kept], [4, 4, 4])] == devices


@pytest.mark.parametrize(
    ("name", "reads"),
    [
        ("read", (codec.Read(1, 132, 4),)),
        ("sync read", (codec.Read(1, 132, 4), codec.Read(2, 132, 4))),
        ("fast sync read", (codec.Read(3, 132, 4), codec.Read(7, 132, 4), codec.Read(4, 132, 4))),
        ("bulk read", (codec.Read(1, 144, 2), codec.Read(2, 146, 1))),
        ("fast bulk read", (codec.Read(3, 132, 4), codec.Read(7, 124, 2), codec.Read(4, 146, 1))),
    ],
)
def test_a_device_understands_what_the_manual_asks(name: str, reads: tuple[codec.Read, ...]) -> None:
    (packet,) = codec.Decoder().feed(WIRE[name])
    assert isinstance(packet, codec.Instruction)
    assert codec.reads_of(packet) == reads


@pytest.mark.parametrize(
    ("name", "writes"),
    [
        ("write", (codec.Write(1, 116, b"\0\x02\0\0"),)),
        ("reg write", (codec.Write(1, 104, b"\xc8\0\0\0"),)),
        ("sync write", (codec.Write(1, 116, b"\x96\0\0\0"), codec.Write(2, 116, b"\xaa\0\0\0"))),
        ("bulk write", (codec.Write(1, 32, b"\xa0\0"), codec.Write(2, 31, b"\x50"))),
    ],
)
def test_a_device_understands_what_the_manual_orders(name: str, writes: tuple[codec.Write, ...]) -> None:
    (packet,) = codec.Decoder().feed(WIRE[name])
    assert isinstance(packet, codec.Instruction)
    assert codec.writes_of(packet) == writes
