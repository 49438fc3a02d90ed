"""The socket of an emulated bench: one master at a time, and either end notices when the other is gone."""

from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import pytest
from tests.patience import LONG_S, until

from sinew.emulator.port_server import SocketPort
from sinew.hardware.bus import MonotonicClock
from sinew.hardware.serial_port import LocalPort
from sinew.measure.errors import FileError, PortError

BAUD = 1_000_000


@pytest.fixture
def port(tmp_path: Path) -> Iterator[SocketPort]:
    made = SocketPort(tmp_path / "bench", BAUD)
    yield made
    made.close()


def opened(port: SocketPort) -> LocalPort:
    """Return a master that has opened a port, which must look up for it."""
    found: list[LocalPort | PortError] = []

    def open_it() -> None:
        try:
            found.append(LocalPort(str(port.link), MonotonicClock()))
        except PortError as trouble:
            found.append(trouble)

    thread = Thread(target=open_it)
    thread.start()

    def is_open() -> bool:
        port.read()
        return not thread.is_alive()

    until(is_open)
    (one,) = found
    if isinstance(one, PortError):
        raise one
    return one


def soon() -> float:
    return MonotonicClock().now() + LONG_S


def test_bytes_pass_both_ways(port: SocketPort) -> None:
    master = opened(port)
    master.write(b"ping")
    assert port.read() == b"ping"
    assert port.write(b"pong") == 4
    assert master.read(soon()) == b"pong"
    master.close()


def test_without_news_a_read_waits_until_its_deadline_and_gives_nothing(port: SocketPort) -> None:
    master = opened(port)
    assert master.read(MonotonicClock().now() + 0.01) == b""
    master.close()


def test_a_second_master_is_turned_away_and_the_first_goes_on(port: SocketPort) -> None:
    master = opened(port)
    with pytest.raises(PortError, match="another master is served"):
        opened(port)
    master.write(b"still here")
    assert port.read() == b"still here"
    master.close()


def test_after_a_master_has_left_another_is_served(port: SocketPort) -> None:
    opened(port).close()
    port.read()
    master = opened(port)
    assert port.baud() == BAUD
    master.close()


def test_without_a_master_there_is_no_rate_and_what_is_sent_is_lost(port: SocketPort) -> None:
    assert (port.baud(), port.write(b"nobody hears")) == (0, 12)


def test_a_master_notices_that_the_bench_is_gone(port: SocketPort) -> None:
    master = opened(port)
    port.close()
    with pytest.raises(PortError, match=r"lost .*nothing there any more"):
        master.read(soon())
    master.close()


def test_a_bench_notices_that_its_master_is_gone(port: SocketPort) -> None:
    opened(port).close()
    assert port.read() == b""
    assert port.baud() == 0


def test_closing_removes_the_link_and_the_socket(port: SocketPort) -> None:
    terminal = Path(port.terminal)
    port.close()
    assert not port.link.is_symlink()
    assert not terminal.exists()


def test_nothing_that_stands_there_is_replaced(port: SocketPort) -> None:
    with pytest.raises(FileError, match="is there"):
        SocketPort(port.link, BAUD)


def test_a_socket_at_which_nobody_listens_is_refused_in_a_sentence(port: SocketPort, tmp_path: Path) -> None:
    with pytest.raises(PortError, match="is `sinew emulate --socket` running"):
        LocalPort(str(tmp_path / "none"), MonotonicClock())
