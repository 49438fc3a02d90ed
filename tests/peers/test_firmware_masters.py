"""The IMU node under masters that are not Sinew's, over a pseudo-terminal: emulator, firmware here and in QEMU alike.

ROBOTIS's SDK does not stuff what it sends, and fails a group as a whole; rustypot has no class of such a node, an
XL430's talks to any register; dynamixel2 knows no fast reads, and its bulk read is right for one device alone.
"""

import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.firmware.built import built
from tests.firmware.qemu_port import qemu_port
from tests.patience import comes
from tests.peers.emulated_port import PATIENCE, emulated, eventually
from tools.build_firmware import build_host, build_qemu

pytestmark = pytest.mark.slow

NODE, MODEL = 200, 0x7400
CONTROL, LEVEL, ID, RETURN_DELAY, GYRO, CLOCK = 50, 68, 7, 9, 32, 56
ACCESS, DATA_RANGE = 7, 4
ANSWER_S = 4.0  # how long a master waits: QEMU shares a core with whatever else this computer does
WAYS = ("emulator", "firmware", "qemu")
DYNAMIXEL2 = Path(__file__).parents[2] / ".venv-peers/bin/dynamixel2-master"


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
    elif request.param == "firmware":
        with _spoken([str(built(build_host, folder, "g++")), "pty"], r"/dev/\S+") as port:
            yield port
    else:
        with qemu_port(built(build_qemu, folder, "arm-none-eabi-g++", "qemu-system-arm"), folder) as port:
            yield port


# ROBOTIS's Python SDK.


@pytest.fixture
def sdk(path: str) -> Iterator[tuple[Any, Any, Any]]:
    """Return the SDK, its packets and a port that waits longer than its own 34 ms."""
    module: Any = pytest.importorskip("dynamixel_sdk", reason="dynamixel-sdk is not installed")

    class PatientPort(module.PortHandler):  # type: ignore[misc]
        def setPacketTimeout(self, _length: int) -> None:  # noqa: N802
            self.setPacketTimeoutMillis(1e3 * ANSWER_S)

    port = PatientPort(path)
    assert port.setBaudRate(1_000_000)
    packets = module.Protocol2PacketHandler()
    assert eventually(lambda: packets.ping(port, NODE)[1] == module.COMM_SUCCESS)
    yield module, packets, port
    packets.write1ByteTxRx(port, NODE, CONTROL, 0)
    port.closePort()


def test_the_sdk_reads_what_it_wrote_and_sees_what_is_refused(sdk: Any) -> None:
    module, packets, port = sdk
    done = module.COMM_SUCCESS
    assert packets.ping(port, NODE) == (MODEL, done, 0)
    assert packets.write1ByteTxRx(port, NODE, CONTROL, 0x2A) == (done, 0)
    assert packets.read1ByteTxRx(port, NODE, CONTROL) == (0x2A, done, 0)
    assert packets.write2ByteTxRx(port, NODE, GYRO, 1) == (done, ACCESS)
    assert packets.write1ByteTxRx(port, NODE, LEVEL, 9) == (done, DATA_RANGE)


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


def test_the_sdk_brings_the_node_to_what_it_is_from_the_factory(sdk: Any) -> None:
    module, packets, port = sdk
    assert packets.write1ByteTxRx(port, NODE, RETURN_DELAY, 25) == (module.COMM_SUCCESS, 0)
    assert packets.factoryReset(port, NODE, 1) == (module.COMM_SUCCESS, 0)
    assert eventually(lambda: packets.ping(port, NODE)[1] == module.COMM_SUCCESS)
    assert packets.read1ByteTxRx(port, NODE, RETURN_DELAY) == (0, module.COMM_SUCCESS, 0)


# rustypot.


@pytest.fixture
def rustypot(path: str) -> Any:
    """Return a master in Rust."""
    module: Any = pytest.importorskip("rustypot", reason="rustypot is not installed")
    master = module.Xl430PyController(path, 1_000_000, ANSWER_S)
    assert eventually(lambda: master.ping(NODE))
    return master


def test_rustypot_finds_the_node_reads_what_it_wrote_and_sees_what_is_refused(rustypot: Any) -> None:
    assert eventually(lambda: NODE in rustypot.broadcast_scan())  # it listens for 0.8 s, whatever it was told
    rustypot.write_raw_data(NODE, CONTROL, [0x55])
    assert bytes(rustypot.read_raw_data(NODE, CONTROL, 1)) == b"\x55"
    assert rustypot.write_raw_data_with_error(NODE, GYRO, [1, 2]) == ACCESS
    rustypot.write_raw_data(NODE, CONTROL, [0])


@pytest.mark.parametrize("fast", [False, True])
def test_rustypot_reads_the_node_in_a_group(rustypot: Any, fast: bool) -> None:
    rustypot.set_fast_sync_read(fast)
    (block,) = rustypot.sync_read_raw_data([NODE], 0, 2)
    assert bytes(block) == MODEL.to_bytes(2, "little")


def test_rustypot_writes_to_the_node_in_a_group(rustypot: Any) -> None:
    rustypot.sync_write_raw_data([NODE], CONTROL, [[9]])
    assert bytes(rustypot.read_raw_data(NODE, CONTROL, 1)) == b"\x09"
    rustypot.write_raw_data(NODE, CONTROL, [0])


# dynamixel2, asked by the lines of a program of ours.


class Dynamixel2:
    """The program that `make peers` builds of the crate."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._process = process

    def ask(self, instruction: str) -> str:
        """Return what came of an instruction: `ok` and bytes, `refused` and a number, or `failed` and why."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(instruction + "\n")
        self._process.stdin.flush()
        return self._process.stdout.readline().strip()


@pytest.fixture
def dynamixel2(path: str) -> Iterator[Dynamixel2]:
    """Return another master in Rust, which shares no code with rustypot."""
    if not DYNAMIXEL2.exists():
        pytest.skip("there is no dynamixel2-master: build it with `make peers`, or `sh tools/peers.sh masters`")
    command = [str(DYNAMIXEL2), path, "1000000"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        master = Dynamixel2(process)
        assert eventually(lambda: master.ask(f"ping {NODE}").startswith("ok"))
        yield master
        master.ask(f"write {NODE} {CONTROL} 00")


def test_dynamixel2_finds_the_node_and_reads_what_it_wrote(dynamixel2: Dynamixel2) -> None:
    assert re.fullmatch("ok 0074..", dynamixel2.ask(f"ping {NODE}"))
    assert bytes((NODE,)) in bytes.fromhex(dynamixel2.ask("scan").removeprefix("ok"))
    assert dynamixel2.ask(f"write {NODE} {CONTROL} 2a") == "ok"
    assert dynamixel2.ask(f"read {NODE} {CONTROL} 1") == "ok 2a"


def test_what_dynamixel2_stuffs_is_refused_for_what_it_means(dynamixel2: Dynamixel2) -> None:
    assert dynamixel2.ask(f"write {NODE} {GYRO} fffffd00fffffd") == f"refused {ACCESS}"
    assert dynamixel2.ask(f"write {NODE} {LEVEL} 09") == f"refused {DATA_RANGE}"


def test_dynamixel2s_registered_write_waits_for_action(dynamixel2: Dynamixel2) -> None:
    assert dynamixel2.ask(f"reg_write {NODE} {CONTROL} 07") == "ok"
    before = dynamixel2.ask(f"read {NODE} {CONTROL} 1")
    assert dynamixel2.ask(f"action {NODE}") == "ok"
    assert (before, dynamixel2.ask(f"read {NODE} {CONTROL} 1")) == ("ok 00", "ok 07")


def test_dynamixel2_reads_and_writes_the_node_in_a_group(dynamixel2: Dynamixel2) -> None:
    assert dynamixel2.ask(f"sync_write {NODE} {CONTROL} 03") == "ok"
    assert dynamixel2.ask(f"sync_read {NODE} {CONTROL} 1") == "ok 03"
    assert dynamixel2.ask(f"bulk_write {NODE} {CONTROL} 04") == "ok"
    assert dynamixel2.ask(f"bulk_read {NODE} {CONTROL} 1") == "ok 04"


def test_dynamixel2_reads_samples_whose_clock_goes_on(dynamixel2: Dynamixel2) -> None:
    blocks = [dynamixel2.ask(f"bulk_read {NODE} {GYRO} 28").removeprefix("ok ") for _ in range(3)]
    clocks = [int.from_bytes(bytes.fromhex(block)[CLOCK - GYRO :], "little") for block in blocks]
    assert clocks == sorted(set(clocks))


def test_dynamixel2_brings_the_node_to_what_it_is_from_the_factory(dynamixel2: Dynamixel2) -> None:
    assert dynamixel2.ask(f"write {NODE} {RETURN_DELAY} 19") == "ok"
    assert dynamixel2.ask(f"factory_reset {NODE}") == "ok"
    assert eventually(lambda: dynamixel2.ask(f"ping {NODE}").startswith("ok"))
    assert dynamixel2.ask(f"read {NODE} {RETURN_DELAY} 1") == "ok 00"


def test_dynamixel2_gives_the_node_another_id_and_reboots_it(dynamixel2: Dynamixel2) -> None:
    assert dynamixel2.ask(f"write {NODE} {ID} 21") == "ok"
    assert dynamixel2.ask("reboot 33") == "ok"
    assert eventually(lambda: dynamixel2.ask("ping 33").startswith("ok"))
    assert dynamixel2.ask(f"write 33 {ID} {NODE:02x}") == "ok"
