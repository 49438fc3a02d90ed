"""The codec against ROBOTIS's own Python SDK: the bytes of instructions, its checksum, and its undoing of our stuffing.

The SDK itself does not stuff what it sends; as a master it stands in `test_emulator_dynamixel_sdk`.
"""

import random
from typing import Any

import pytest

from sinew.hardware.codec import (
    Instruction,
    Read,
    Status,
    bulk_read,
    encode,
    ping,
    read,
    reboot,
    reg_write,
    sync_read,
    sync_write,
    write,
)

sdk: Any = pytest.importorskip("dynamixel_sdk", reason="dynamixel-sdk is not installed")


def wires() -> list[tuple[str, Instruction]]:
    chance = random.Random(3)
    data = {device: bytes(chance.choices(range(200), k=4)) for device in (1, 2, 3)}
    return [
        ("ping", ping(3)),
        ("read", read(2, 132, 4)),
        ("write", write(2, 116, data[2])),
        ("reg write", reg_write(2, 116, data[2])),
        ("reboot", reboot(2)),
        ("sync read", sync_read(126, 10, [1, 2, 3])),
        ("sync write", sync_write(116, data)),
        ("bulk read", bulk_read([Read(1, 126, 10), Read(200, 32, 24)])),
    ]


class Wire:
    """What the SDK asks of a port that it only writes to."""

    is_using, sent = False, b""

    def clearPort(self) -> None:  # noqa: N802
        pass

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        self.sent = bytes(packet)
        return len(packet)


@pytest.mark.parametrize(("name", "instruction"), wires(), ids=lambda value: value if isinstance(value, str) else "")
def test_an_instruction_without_stuffing_has_the_bytes_that_the_sdk_sends(name: str, instruction: Instruction) -> None:
    port, params = Wire(), list(instruction.params)
    length = len(params) + 3
    header = [0, 0, 0, 0, instruction.id, length & 0xFF, length >> 8]
    found = sdk.Protocol2PacketHandler().txPacket(port, [*header, instruction.code, *params, 0, 0])
    assert (found, port.sent) == (sdk.COMM_SUCCESS, encode(instruction))


def test_the_sdks_crc_agrees_on_a_thousand_random_packets() -> None:
    chance = random.Random(4)
    for _ in range(1000):
        wire = encode(Status(chance.randrange(253), chance.randrange(256), chance.randbytes(chance.randrange(60))))
        crc = sdk.Protocol2PacketHandler().updateCRC(0, list(wire[:-2]), len(wire) - 2)
        assert crc.to_bytes(2, "little") == wire[-2:]


@pytest.mark.parametrize(
    "payload", [b"\xff\xff\xfd", b"\0\xff\xff\xfd\0", b"\xff\xff\xfd\xff\xff\xfd", b"\xff\xff\xff\xfd"]
)
def test_the_sdk_undoes_our_stuffing(payload: bytes) -> None:
    back = sdk.Protocol2PacketHandler().removeStuffing(list(encode(Status(1, 0, payload))))
    length = back[5] | back[6] << 8
    assert bytes(back[9 : 7 + length - 2]) == payload
