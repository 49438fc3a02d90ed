"""The codec against ROBOTIS's own Python SDK: the SDK as master, our side of the line as devices.

The SDK is given a port in memory. Its known defects are named here and worked around here: it does not stuff what it
sends, and it fails a group as a whole.
"""

import random
from typing import Any

import pytest
from tests.unit.hardware_line import Line, ManualClock, Slave

from sinew.hardware.bus import Bus, BusTiming
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
SUCCESS = sdk.COMM_SUCCESS


class SdkPort:
    """What the SDK asks of a port, on a line in memory."""

    def __init__(self, line: Line) -> None:
        self.line, self.is_using, self.wire, self._kept = line, False, b"", b""
        self._deadline = 0.0

    def clearPort(self) -> None:  # noqa: N802
        self._kept = b""

    def getBaudRate(self) -> int:  # noqa: N802
        return 1_000_000

    def setPacketTimeout(self, length: int) -> None:  # noqa: N802
        self.setPacketTimeoutMillis(34 + length / 100)

    def setPacketTimeoutMillis(self, milliseconds: float) -> None:  # noqa: N802
        self._deadline = self.line.clock.time + milliseconds / 1000

    def isPacketTimeout(self) -> bool:  # noqa: N802
        return self.line.clock.time >= self._deadline

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        self.wire = bytes(packet)
        self.line.write(self.wire)
        return len(packet)

    def readPort(self, length: int) -> bytes:  # noqa: N802
        if len(self._kept) < length:
            self._kept += self.line.read(self._deadline)
        data, self._kept = self._kept[:length], self._kept[length:]
        return data


def master(*slaves: Slave) -> tuple[Any, SdkPort, Line]:
    line = Line(ManualClock(), *(slaves or (Slave(1), Slave(2), Slave(3))))
    return sdk.Protocol2PacketHandler(), SdkPort(line), line


def test_the_sdk_pings_a_device() -> None:
    packets, port, _ = master(Slave(7, model=1020))
    assert packets.ping(port, 7) == (1020, SUCCESS, 0)


@pytest.mark.parametrize("data", [b"\1\2\3\4", b"\xff\xff\xfd\x00", b"\xff\xff\xfd\xff", b"\xff\xff\xff\xfd"])
def test_the_sdk_reads_what_a_device_holds_stuffed_or_not(data: bytes) -> None:
    packets, port, line = master()
    line.slaves[1].memory[132:136] = data
    assert packets.read4ByteTxRx(port, 1, 132) == (int.from_bytes(data, "little"), SUCCESS, 0)


def test_the_sdk_writes_to_a_device() -> None:
    packets, port, line = master()
    assert packets.write4ByteTxRx(port, 1, 116, 0x01020304) == (SUCCESS, 0)
    assert line.slaves[1].memory[116:120] == b"\4\3\2\1"


def test_the_sdk_sees_error_and_alert() -> None:
    packets, port, _ = master(Slave(1, error=0x84))
    assert packets.write1ByteTxRx(port, 1, 11, 77) == (SUCCESS, 0x84)


def test_the_sdk_still_does_not_stuff_what_it_sends() -> None:
    packets, port, _ = master()
    packets.write4ByteTxOnly(port, 1, 116, 0x00FDFFFF)
    assert port.wire != encode(write(1, 116, b"\xff\xff\xfd\x00"))


@pytest.mark.parametrize("fast", [False, True])
def test_the_sdk_reads_a_group(fast: bool) -> None:
    packets, port, _ = master()
    group = sdk.GroupSyncRead(port, packets, 126, 10)
    for device in (1, 2, 3):
        group.addParam(device)
    assert (group.fastSyncRead() if fast else group.txRxPacket()) == SUCCESS
    position = int.from_bytes(bytes([132, 133, 134, 135]), "little")
    assert [group.getData(device, 132, 4) for device in (1, 2, 3)] == [position] * 3


def test_the_sdk_loses_a_group_for_one_absent_device_and_our_bus_does_not() -> None:
    slaves = [Slave(1), Slave(2, absent=True), Slave(3)]
    packets, port, _ = master(*slaves)
    group = sdk.GroupSyncRead(port, packets, 126, 10)
    for device in (1, 2, 3):
        group.addParam(device)
    assert group.txRxPacket() != SUCCESS
    clock = ManualClock()
    ours = Bus(Line(clock, *slaves), clock, BusTiming()).sync_read(126, 10, [1, 2, 3])
    assert [device for device, reply in ours.items() if reply.ok] == [1, 3]


def test_the_sdk_writes_to_a_group() -> None:
    packets, port, line = master()
    group = sdk.GroupSyncWrite(port, packets, 116, 4)
    for device in (1, 2, 3):
        group.addParam(device, [device, 0, 0, 0])
    assert group.txPacket() == SUCCESS
    assert [line.slaves[device].memory[116] for device in (1, 2, 3)] == [1, 2, 3]


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


@pytest.mark.parametrize(("name", "instruction"), wires(), ids=lambda value: value if isinstance(value, str) else "")
def test_an_instruction_without_stuffing_has_the_bytes_that_the_sdk_sends(name: str, instruction: Instruction) -> None:
    packets, port, _ = master()
    params = list(instruction.params)
    length = len(params) + 3
    header = [0, 0, 0, 0, instruction.id, length & 0xFF, length >> 8]
    assert packets.txPacket(port, [*header, instruction.code, *params, 0, 0]) == SUCCESS
    assert port.wire == encode(instruction)


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
