"""The IMU node under masters that are not Sinew's, over a pseudo-terminal: the emulator's and the firmware alike.

ROBOTIS's SDK does not stuff what it sends, and fails a group as a whole; rustypot has no class of such a node, an
XL430's talks to any register.
"""

import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from tests.patience import comes
from tests.peers.emulated_port import PATIENCE, emulated, eventually
from tools.build_firmware import build_host

pytestmark = pytest.mark.slow

NODE, MODEL = 200, 0x7400
CONTROL, LEVEL, ID, GYRO, CLOCK = 50, 68, 7, 32, 56
ACCESS, DATA_RANGE = 7, 4
WAYS = ("emulator", "firmware")


@contextmanager
def _spoken(command: list[str], pattern: str) -> Iterator[str]:
    """Give the pseudo-terminal that a program says it has."""
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
        assert process.stdout is not None
        try:
            assert comes(process.stdout, PATIENCE), "the firmware does not get ready"
            found = re.search(pattern, process.stdout.readline().decode())
            assert found
            yield found[0]
        finally:
            process.terminate()


@pytest.fixture(scope="module", params=WAYS)
def path(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Return a port to a node, one way after the other."""
    folder = tmp_path_factory.mktemp("node")
    if request.param == "emulator":
        with emulated(folder) as port:
            yield port
    elif shutil.which("g++") is None:
        pytest.skip("there is no g++: the firmware is not tried")
    else:
        with _spoken([str(build_host(folder)), "pty"], r"/dev/\S+") as port:
            yield port


# ROBOTIS's Python SDK.


@pytest.fixture
def sdk(path: str) -> Iterator[tuple[Any, Any, Any]]:
    """Return the SDK, its packets and a port that waits longer than its own 34 ms."""
    module: Any = pytest.importorskip("dynamixel_sdk", reason="dynamixel-sdk is not installed")

    class PatientPort(module.PortHandler):  # type: ignore[misc]
        def setPacketTimeout(self, _length: int) -> None:  # noqa: N802
            self.setPacketTimeoutMillis(500)

    port = PatientPort(path)
    assert port.setBaudRate(1_000_000)
    packets = module.Protocol2PacketHandler()
    assert eventually(lambda: packets.ping(port, NODE)[1] == module.COMM_SUCCESS)
    yield module, packets, port
    packets.factoryReset(port, NODE, 1)
    port.closePort()


def test_the_sdk_pings_the_node(sdk: Any) -> None:
    module, packets, port = sdk
    assert packets.ping(port, NODE) == (MODEL, module.COMM_SUCCESS, 0)


def test_the_sdk_reads_what_it_wrote(sdk: Any) -> None:
    module, packets, port = sdk
    assert packets.write1ByteTxRx(port, NODE, CONTROL, 0x2A) == (module.COMM_SUCCESS, 0)
    assert packets.read1ByteTxRx(port, NODE, CONTROL) == (0x2A, module.COMM_SUCCESS, 0)


def test_the_sdk_sees_what_is_refused(sdk: Any) -> None:
    module, packets, port = sdk
    assert packets.write2ByteTxRx(port, NODE, GYRO, 1) == (module.COMM_SUCCESS, ACCESS)
    assert packets.write1ByteTxRx(port, NODE, LEVEL, 9) == (module.COMM_SUCCESS, DATA_RANGE)


def test_the_sdks_registered_write_waits_for_action(sdk: Any) -> None:
    module, packets, port = sdk
    assert packets.regWriteTxRx(port, NODE, CONTROL, 1, [7]) == (module.COMM_SUCCESS, 0)
    before = packets.read1ByteTxRx(port, NODE, CONTROL)[0]
    packets.action(port, module.BROADCAST_ID)
    assert (before, packets.read1ByteTxRx(port, NODE, CONTROL)[0]) == (0, 7)


@pytest.mark.parametrize("fast", [False, True])
def test_the_sdk_reads_the_node_in_a_sync_read(sdk: Any, fast: bool) -> None:
    module, packets, port = sdk
    group = module.GroupSyncRead(port, packets, 0, 2)
    group.addParam(NODE)
    assert (group.fastSyncRead() if fast else group.txRxPacket()) == module.COMM_SUCCESS
    assert group.getData(NODE, 0, 2) == MODEL


@pytest.mark.parametrize("fast", [False, True])
def test_the_sdk_reads_the_nodes_samples_in_a_bulk_read(sdk: Any, fast: bool) -> None:
    module, packets, port = sdk
    group = module.GroupBulkRead(port, packets)
    group.addParam(NODE, GYRO, 28)
    clocks = []
    for _ in range(3):
        assert (group.fastBulkRead() if fast else group.txRxPacket()) == module.COMM_SUCCESS
        clocks.append(group.getData(NODE, CLOCK, 4))
    assert clocks == sorted(set(clocks))


def test_the_sdk_writes_to_the_node_in_groups(sdk: Any) -> None:
    module, packets, port = sdk
    sync, bulk = module.GroupSyncWrite(port, packets, CONTROL, 1), module.GroupBulkWrite(port, packets)
    sync.addParam(NODE, [3])
    assert sync.txPacket() == module.COMM_SUCCESS
    first = packets.read1ByteTxRx(port, NODE, CONTROL)[0]
    bulk.addParam(NODE, CONTROL, 1, [4])
    assert bulk.txPacket() == module.COMM_SUCCESS
    assert (first, packets.read1ByteTxRx(port, NODE, CONTROL)[0]) == (3, 4)


def test_the_sdk_gives_the_node_another_id_and_reboots_it(sdk: Any) -> None:
    module, packets, port = sdk
    assert packets.write1ByteTxRx(port, NODE, ID, 33) == (module.COMM_SUCCESS, 0)
    assert packets.reboot(port, 33) == (module.COMM_SUCCESS, 0)
    assert eventually(lambda: packets.ping(port, 33)[1] == module.COMM_SUCCESS)
    assert packets.write1ByteTxRx(port, 33, ID, NODE) == (module.COMM_SUCCESS, 0)


# rustypot.


@pytest.fixture
def rustypot(path: str) -> Any:
    """Return a master in Rust."""
    module: Any = pytest.importorskip("rustypot", reason="rustypot is not installed")
    master = module.Xl430PyController(path, 1_000_000, 0.5)
    assert eventually(lambda: master.ping(NODE))
    return master


def test_rustypot_finds_the_node_in_a_scan(rustypot: Any) -> None:
    assert NODE in rustypot.broadcast_scan()


def test_rustypot_reads_what_it_wrote(rustypot: Any) -> None:
    rustypot.write_raw_data(NODE, CONTROL, [0x55])
    assert bytes(rustypot.read_raw_data(NODE, CONTROL, 1)) == b"\x55"
    rustypot.write_raw_data(NODE, CONTROL, [0])


def test_rustypot_sees_what_is_refused(rustypot: Any) -> None:
    assert rustypot.write_raw_data_with_error(NODE, GYRO, [1, 2]) == ACCESS


@pytest.mark.parametrize("fast", [False, True])
def test_rustypot_reads_the_node_in_a_group(rustypot: Any, fast: bool) -> None:
    rustypot.set_fast_sync_read(fast)
    (block,) = rustypot.sync_read_raw_data([NODE], 0, 2)
    assert bytes(block) == MODEL.to_bytes(2, "little")


def test_rustypot_writes_to_the_node_in_a_group(rustypot: Any) -> None:
    rustypot.sync_write_raw_data([NODE], CONTROL, [[9]])
    assert bytes(rustypot.read_raw_data(NODE, CONTROL, 1)) == b"\x09"
    rustypot.write_raw_data(NODE, CONTROL, [0])
