"""The emulated bench against ROBOTIS's own Python SDK as master, over a pseudo-terminal.

What the SDK does wrong is named and worked around here. It does not stuff what it sends, so no write here holds
FF FF FD; it fails a group as a whole for one device that is not there; it drops the error byte in group reads.
"""

import termios
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.peers.emulated_port import emulated, eventually

pytestmark = pytest.mark.slow

sdk: Any = pytest.importorskip("dynamixel_sdk", reason="dynamixel-sdk is not installed")
SUCCESS, TIMEOUT = sdk.COMM_SUCCESS, sdk.COMM_RX_TIMEOUT
PACKETS = sdk.Protocol2PacketHandler()
OPERATING_MODE, TORQUE, STATUS_LEVEL, ERRORS, LED = 11, 64, 68, 70, 65
GOAL_PWM, GOAL_CURRENT, GOAL_POSITION, PRESENT, PRESENT_POSITION = 100, 102, 116, 126, 132
ALERT, DATA_RANGE, DATA_LIMIT, ACCESS = 0x80, 4, 6, 7
MOTORS = (1, 2, 3, 4, 5)


class PatientPort(sdk.PortHandler):  # type: ignore[misc]
    """A port that waits longer than the SDK's 34 ms: the emulator shares this computer with other tests."""

    def setPacketTimeout(self, _length: int) -> None:  # noqa: N802
        self.setPacketTimeoutMillis(300)


def opened(path: str, baud: int = 1_000_000) -> Any:
    port = PatientPort(path)
    assert port.setBaudRate(baud)
    return port


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with emulated(tmp_path_factory.mktemp("bench")) as path:
        yield path


@pytest.fixture
def port(bench: str) -> Iterator[Any]:
    """Return a port to motors that were started anew."""
    port = opened(bench)
    for motor in MOTORS:
        PACKETS.reboot(port, motor)
    eventually(lambda: all(PACKETS.ping(port, motor)[1] == SUCCESS for motor in MOTORS))
    yield port
    port.closePort()


def write1(port: Any, motor: int, address: int, value: int) -> None:
    assert PACKETS.write1ByteTxRx(port, motor, address, value) == (SUCCESS, 0)


def signed(value: int, size: int = 4) -> int:
    return int.from_bytes(value.to_bytes(size, "little"), "little", signed=True)


def position(port: Any, motor: int) -> int:
    value, result, error = PACKETS.read4ByteTxRx(port, motor, PRESENT_POSITION)
    assert (result, error) == (SUCCESS, 0)
    return signed(value)


def test_pings_tell_who_is_there(port: Any) -> None:
    found, result = PACKETS.broadcastPing(port)
    assert (sorted(found), result) == ([*MOTORS, 200], SUCCESS)
    assert [PACKETS.ping(port, motor) for motor in (1, 5)] == [(1000, SUCCESS, 0), (1020, SUCCESS, 0)]
    assert PACKETS.ping(port, 77)[1] == TIMEOUT


def test_what_is_written_is_read_back(port: Any) -> None:
    write1(port, 3, LED, 1)
    assert PACKETS.read1ByteTxRx(port, 3, LED) == (1, SUCCESS, 0)


def test_a_registered_write_waits_for_action(port: Any) -> None:
    write1(port, 3, LED, 0)
    assert PACKETS.regWriteTxRx(port, 3, LED, 1, [1]) == (SUCCESS, 0)
    before = PACKETS.read1ByteTxRx(port, 3, LED)[0]
    PACKETS.action(port, 254)
    assert (before, PACKETS.read1ByteTxRx(port, 3, LED)[0]) == (0, 1)


def test_a_motor_goes_where_it_is_sent(port: Any) -> None:
    write1(port, 2, TORQUE, 1)
    assert PACKETS.write4ByteTxRx(port, 2, GOAL_POSITION, 2400) == (SUCCESS, 0)
    assert eventually(lambda: abs(position(port, 2) - 2400) <= 20)


@pytest.mark.parametrize("mode", [0, 1, 3, 4, 5, 16])
def test_a_mode_is_changed_while_the_torque_is_off(port: Any, mode: int) -> None:
    write1(port, 4, OPERATING_MODE, mode)
    assert PACKETS.read1ByteTxRx(port, 4, OPERATING_MODE) == (mode, SUCCESS, 0)
    write1(port, 4, OPERATING_MODE, 3)


def test_another_mode_puts_the_goals_to_their_limits(port: Any) -> None:
    assert PACKETS.write2ByteTxRx(port, 4, GOAL_PWM, 100) == (SUCCESS, 0)
    assert PACKETS.write2ByteTxRx(port, 4, GOAL_CURRENT, 30) == (SUCCESS, 0)
    write1(port, 4, OPERATING_MODE, 5)
    limits = PACKETS.read2ByteTxRx(port, 4, GOAL_PWM)[0], PACKETS.read2ByteTxRx(port, 4, GOAL_CURRENT)[0]
    write1(port, 4, OPERATING_MODE, 3)
    assert limits == (885, 648)


@pytest.mark.parametrize(
    ("size", "address", "value", "torque", "why"),
    [
        (1, OPERATING_MODE, 4, 1, ACCESS),  # locked while the torque is on
        (1, OPERATING_MODE, 2, 0, DATA_RANGE),
        (4, GOAL_POSITION, 4096, 0, DATA_LIMIT),
        (4, PRESENT_POSITION, 0, 0, ACCESS),
    ],
)
def test_what_cannot_be_written_is_refused(
    port: Any, size: int, address: int, value: int, torque: int, why: int
) -> None:
    write1(port, 1, TORQUE, torque)
    assert getattr(PACKETS, f"write{size}ByteTxRx")(port, 1, address, value) == (SUCCESS, why)


@pytest.mark.parametrize("fast", [False, True])
def test_a_group_is_read_at_once(port: Any, fast: bool) -> None:
    group = sdk.GroupSyncRead(port, PACKETS, PRESENT, 10)
    for motor in MOTORS:
        group.addParam(motor)
    assert (group.fastSyncRead() if fast else group.txRxPacket()) == SUCCESS
    read = [signed(group.getData(motor, PRESENT_POSITION, 4)) for motor in MOTORS]
    assert read == pytest.approx([position(port, motor) for motor in MOTORS], abs=1)


def test_motors_and_sensor_are_read_at_once(port: Any) -> None:
    group = sdk.GroupBulkRead(port, PACKETS)
    for motor in MOTORS:
        group.addParam(motor, 0, 2)
    group.addParam(200, 0, 2)
    assert group.txRxPacket() == SUCCESS
    assert [group.getData(device, 0, 2) for device in (*MOTORS, 200)] == [1000] * 4 + [1020, 0x7400]


def test_a_group_is_written_at_once(port: Any) -> None:
    group = sdk.GroupSyncWrite(port, PACKETS, GOAL_POSITION, 4)
    for motor in MOTORS:
        write1(port, motor, TORQUE, 1)
        group.addParam(motor, list((2000 + 10 * motor).to_bytes(4, "little")))
    assert group.txPacket() == SUCCESS
    goals = [PACKETS.read4ByteTxRx(port, motor, GOAL_POSITION)[0] for motor in MOTORS]
    assert goals == [2010, 2020, 2030, 2040, 2050]


def test_what_the_sdk_forgets_to_stuff_is_not_carried_out(port: Any) -> None:
    # The SDK puts FF FF FD on the wire as it is: no device may take that for a whole packet.
    write1(port, 1, OPERATING_MODE, 4)
    before = PACKETS.read4ByteTxRx(port, 1, GOAL_POSITION)[0]
    result, _ = PACKETS.write4ByteTxRx(port, 1, GOAL_POSITION, 0x00FDFFFF)
    after = PACKETS.read4ByteTxRx(port, 1, GOAL_POSITION)[0]
    write1(port, 1, OPERATING_MODE, 3)
    assert (result, after) == (TIMEOUT, before)


def test_a_reboot_takes_the_torque_off(port: Any) -> None:
    write1(port, 5, TORQUE, 1)
    assert PACKETS.reboot(port, 5) == (SUCCESS, 0)
    assert PACKETS.ping(port, 5)[1] == TIMEOUT
    assert eventually(lambda: PACKETS.ping(port, 5)[1] == SUCCESS)
    assert PACKETS.read1ByteTxRx(port, 5, TORQUE) == (0, SUCCESS, 0)


def test_with_status_return_level_1_only_pings_and_reads_are_answered(port: Any) -> None:
    write1(port, 3, STATUS_LEVEL, 1)
    silent = PACKETS.write1ByteTxRx(port, 3, LED, 1)[0]
    heard = PACKETS.read1ByteTxRx(port, 3, LED)
    PACKETS.write1ByteTxOnly(port, 3, STATUS_LEVEL, 2)
    assert (silent, heard) == (TIMEOUT, (1, SUCCESS, 0))


def test_at_another_baud_nobody_answers(bench: str) -> None:
    port = opened(bench, 57_600)
    found = [PACKETS.ping(port, motor)[1] for motor in MOTORS]
    port.closePort()
    assert found == [TIMEOUT] * 5


@pytest.mark.parametrize("baud", [57_600, 4_000_000])
def test_devices_set_to_another_baud_answer_at_that(tmp_path: Path, baud: int) -> None:
    with emulated(tmp_path, "--baud", str(baud)) as path:
        port = opened(path, baud)
        assert PACKETS.ping(port, 1) == (1000, SUCCESS, 0)
        port.closePort()


def test_an_overheated_motor_raises_its_alert_and_lets_go(tmp_path: Path) -> None:
    with emulated(tmp_path, "--fault", "overheat:motor=3,rate=1000@1") as path:
        port = opened(path)
        write1(port, 3, TORQUE, 1)
        assert eventually(lambda: PACKETS.read1ByteTxRx(port, 3, TORQUE) == (0, SUCCESS, ALERT))
        assert PACKETS.read1ByteTxRx(port, 3, ERRORS) == (0x04, SUCCESS, ALERT)
        port.closePort()


def test_an_alert_shows_in_a_group_read_through_the_register_only(tmp_path: Path) -> None:
    # GroupSyncRead drops the error byte: who uses it must read the register hardware_error_status along.
    with emulated(tmp_path, "--fault", "overheat:motor=3,rate=1000@1-2") as path:
        port = opened(path)
        assert eventually(lambda: PACKETS.ping(port, 3)[2] == ALERT)
        group = sdk.GroupSyncRead(port, PACKETS, ERRORS, 1)
        for motor in MOTORS:
            group.addParam(motor)
        result = group.txRxPacket()
        errors = [group.getData(motor, ERRORS, 1) for motor in MOTORS]
        port.closePort()
    assert (result, errors) == (SUCCESS, [0, 0, 4, 0, 0])


def test_an_overloaded_motor_works_again_after_a_reboot(tmp_path: Path) -> None:
    with emulated(tmp_path, "--fault", "overload:motor=2@0-3") as path:
        port = opened(path)
        write1(port, 2, TORQUE, 1)
        assert eventually(lambda: PACKETS.read1ByteTxRx(port, 2, ERRORS) == (0x20, SUCCESS, ALERT))
        assert PACKETS.write1ByteTxRx(port, 2, TORQUE, 1) == (SUCCESS, ALERT | 1)
        PACKETS.reboot(port, 2)
        assert eventually(lambda: PACKETS.ping(port, 2) == (1000, SUCCESS, 0))
        write1(port, 2, TORQUE, 1)
        port.closePort()


@pytest.mark.slow
def test_an_unplugged_port_is_gone_for_the_sdk(tmp_path: Path) -> None:
    with emulated(tmp_path, "--fault", "unplug@1.5") as path:
        port = opened(path)
        assert PACKETS.ping(port, 1)[1] == SUCCESS
        with pytest.raises((OSError, termios.error)):
            eventually(lambda: PACKETS.ping(port, 1)[1] not in (SUCCESS, TIMEOUT))
        # After the exception the SDK holds its port to be busy for ever.
        assert PACKETS.ping(port, 1)[1] == sdk.COMM_PORT_BUSY
        port.closePort()
