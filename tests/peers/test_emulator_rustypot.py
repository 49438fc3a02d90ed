"""The emulated bench against rustypot, a master in Rust, over a pseudo-terminal."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.peers.emulated_port import emulated, eventually

pytestmark = pytest.mark.slow

rustypot: Any = pytest.importorskip("rustypot", reason="rustypot is not installed")
OPERATING_MODE, TORQUE, ERRORS, LED, PRESENT, PRESENT_POSITION, GOAL_POSITION = 11, 64, 70, 65, 126, 132, 116
ALERT, DATA_LIMIT, ACCESS = 0x80, 6, 7
MOTORS = [1, 2, 3, 4, 5]


def opened(path: str, baud: int = 1_000_000) -> Any:
    # rustypot has no class of an XH or XM motor; an XL430 has the same table.
    return rustypot.Xl430PyController(path, baud, 0.5)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with emulated(tmp_path_factory.mktemp("bench")) as path:
        yield path


@pytest.fixture
def master(bench: str) -> Any:
    """Return a master of motors that were started anew."""
    master = opened(bench)
    for motor in MOTORS:
        master.reboot(motor)
    assert eventually(lambda: all(master.ping(motor) for motor in MOTORS))
    return master


def number(data: Any) -> int:
    return int.from_bytes(bytes(data), "little", signed=True)


def test_rustypot_pings_who_is_there(master: Any) -> None:
    assert [master.ping(device) for device in (1, 5, 200)] == [True] * 3


def test_a_ping_to_all_finds_every_device(master: Any) -> None:
    found = master.broadcast_scan()
    assert sorted(found) == [*MOTORS, 200]


def test_what_is_written_is_read_back(master: Any) -> None:
    master.write_raw_data(3, LED, [1])
    assert bytes(master.read_raw_data(3, LED, 1)) == b"\1"


@pytest.mark.parametrize("goal", [0x00FDFF, -65_793, 1_000_000, -1])
def test_a_stuffed_goal_gets_there_whole(master: Any, goal: int) -> None:
    master.write_raw_data(1, OPERATING_MODE, [4])
    master.write_raw_data(1, GOAL_POSITION, list(goal.to_bytes(4, "little", signed=True)))
    read = number(master.read_raw_data(1, GOAL_POSITION, 4))
    master.write_raw_data(1, OPERATING_MODE, [3])
    assert read == goal


def test_a_motor_goes_where_it_is_sent(master: Any) -> None:
    master.write_torque_enable(2, True)
    master.write_raw_data(2, GOAL_POSITION, list((2400).to_bytes(4, "little")))
    assert eventually(lambda: abs(number(master.read_raw_data(2, PRESENT_POSITION, 4)) - 2400) <= 20)


@pytest.mark.parametrize("fast", [False, True])
def test_a_group_is_read_at_once(master: Any, fast: bool) -> None:
    master.set_fast_sync_read(fast)
    blocks = master.sync_read_raw_data(MOTORS, PRESENT, 10)
    read = [number(bytes(block)[6:]) for block in blocks]
    alone = [number(master.read_raw_data(motor, PRESENT_POSITION, 4)) for motor in MOTORS]
    assert read == pytest.approx(alone, abs=1)


def test_a_group_is_written_at_once(master: Any) -> None:
    goals = [list((2000 + 10 * motor).to_bytes(4, "little")) for motor in MOTORS]
    master.sync_write_raw_data(MOTORS, GOAL_POSITION, goals)
    read = [list(bytes(master.read_raw_data(motor, GOAL_POSITION, 4))) for motor in MOTORS]
    assert read == goals


# Without `_with_error` rustypot reports a refused write as done.


@pytest.mark.slow
def test_an_alert_shows_in_a_group_read(tmp_path: Path) -> None:
    with emulated(tmp_path, "--fault", "overheat:motor=3,rate=1000@1") as path:
        master = opened(path)
        assert eventually(lambda: ALERT in master.read_raw_data_with_error(3, LED, 1))
        answers = master.sync_read_raw_data_with_error(MOTORS, LED, 1)
        assert [error for _, error in answers] == [0, 0, ALERT, 0, 0]
