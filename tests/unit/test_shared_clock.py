"""The clock that an emulated bench shares with its master; behind it stands a bench that notes what it is asked."""

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from time import monotonic, sleep

import pytest
from tests.unit.test_emulator_pty import Bench

from sinew.emulator import port_server
from sinew.emulator.port_server import ClockSocket, PtyServer
from sinew.hardware.bus import MonotonicClock
from sinew.hardware.ports import TURN_LEVER, SerialPort, SharedClock, SharedPort, shared_clock
from sinew.measure.errors import FileError, PortError


class Echo(Bench):
    """Says what it heard, 3 ms later."""

    def receive(self, data: bytes, now: float) -> None:
        super().receive(data, now)
        self.due.append((now + 0.003, data))


class Served:
    """A bench that is served in a thread, and the name of its port. hold: keeps the server from its next step."""

    def __init__(self, link: Path) -> None:
        self.bench, self.link, self.hold = Echo(), link, threading.Lock()
        self.server = PtyServer(self.bench, link, clock=MonotonicClock(), shared=ClockSocket(link))
        self._thread = threading.Thread(target=self._serve)
        self._over = False
        self._thread.start()

    def _serve(self) -> None:
        while not self._over:
            with self.hold:
                self.server.step()
            sleep(0)

    def opened(self) -> tuple[SharedPort, SharedClock]:
        name = str(self.link)
        port = SerialPort(name, 1_000_000, MonotonicClock())
        clock = shared_clock(name)
        assert clock is not None
        return SharedPort(port, clock), clock

    def close(self) -> None:
        self._over = True
        self._thread.join()
        self.server.close()


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    served = Served(tmp_path / "bench")
    yield served
    served.close()


def grown(claim: Callable[[], bool]) -> bool:
    """Return whether a claim comes true; how long that may take hangs on how busy the computer is."""
    end = monotonic() + 30
    while not claim() and monotonic() < end:
        sleep(0.01)
    return claim()


def read_for_two_seconds(port: SharedPort, clock: SharedClock) -> None:
    for _ in range(20):
        port.read(clock.now() + 0.1)


def echo(port: SharedPort, clock: SharedClock, data: bytes) -> bytes:
    """Return what comes back of some bytes, and close the port."""
    port.write(data)
    got = port.read(clock.now() + 0.1)
    port.close()
    return got


def test_the_time_of_the_bench_stands_while_its_master_does_something_else(served: Served) -> None:
    port, clock = served.opened()
    clock.wait_until(clock.now() + 0.01)
    before = served.bench.time
    sleep(0.3)
    after = served.bench.time
    port.close()
    assert after == before


def test_a_wait_of_the_master_is_as_long_for_the_bench_whatever_was_before(served: Served) -> None:
    port, clock = served.opened()
    sleep(0.2)
    before = clock.now()
    clock.wait_until(before + 0.05)
    port.close()
    assert clock.now() == pytest.approx(before + 0.05, abs=1e-3)


def test_time_passes_no_faster_than_the_computers(served: Served) -> None:
    port, clock = served.opened()
    begin = monotonic()
    clock.wait_until(clock.now() + 0.4)
    took = monotonic() - begin
    port.close()
    assert took > 0.1  # a lag of a quarter of a second, at most, is made up for


def test_an_answer_takes_the_benchs_time_even_where_the_bench_is_held_up(served: Served) -> None:
    port, clock = served.opened()
    told = []
    for number in range(20):
        asked = clock.now()
        port.write(b"question %02d" % number)
        with served.hold:  # the emulator is paused
            sleep(0.02)
        told.append((port.read(asked + 0.02), clock.now() - asked))
    port.close()
    assert [data for data, _ in told] == [b"question %02d" % number for number in range(20)]
    assert all(took == pytest.approx(0.003, abs=0.5e-3) for _, took in told)


def test_what_a_person_would_do_is_done_before_the_master_goes_on(served: Served) -> None:
    clock = shared_clock(str(served.link))
    assert clock is not None
    before = clock.now()
    clock.do(TURN_LEVER)
    told = (served.bench.acts, clock.now() - before)
    clock.close()
    port, _ = served.opened()  # the next master is served at once
    port.close()
    assert told == ([TURN_LEVER], 0.0)


def test_two_instructions_in_a_row_are_told_apart(served: Served) -> None:
    port, clock = served.opened()
    with served.hold:
        port.write(b"goals")
        port.write(b"read")
    got = port.read(clock.now() + 0.1)
    got += port.read(clock.now() + 0.01)
    port.close()
    assert (got, served.bench.heard) == (b"goalsread", b"goalsread")


def test_without_news_a_read_takes_until_its_deadline(served: Served) -> None:
    port, clock = served.opened()
    before = clock.now()
    got = port.read(before + 0.25)
    port.close()
    assert (got, clock.now()) == (b"", pytest.approx(before + 0.25, abs=1e-3))


def test_a_master_that_has_ended_leaves_the_bench_to_its_own_time(served: Served) -> None:
    port, clock = served.opened()
    clock.wait_until(clock.now() + 0.01)
    port.close()
    before = served.bench.time
    assert grown(lambda: served.bench.time > before + 0.2)


def test_a_master_that_is_silent_for_too_long_counts_as_lost_until_it_is_heard(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(port_server, "PATIENCE_S", 0.2)
    port, clock = served.opened()
    clock.wait_until(clock.now() + 0.01)
    before = served.bench.time
    went_on = grown(lambda: served.bench.time > before + 0.2)
    clock.wait_until(clock.now() + 0.01)
    heard_again = clock.now() > before + 0.2
    monkeypatch.setattr(port_server, "PATIENCE_S", 5.0)
    clock.wait_until(clock.now() + 0.01)
    stands_at = served.bench.time
    sleep(0.1)
    stands = served.bench.time == stands_at
    port.close()
    assert (went_on, heard_again, stands) == (True, True, True)


def test_what_is_late_knows_the_time_at_which_the_bench_has_arrived(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(port_server, "PATIENCE_S", 0.05)
    port, clock = served.opened()
    before = clock.now()
    sleep(1.0)
    now = clock.now()
    port.close()
    assert now > before + 0.2


def test_a_second_master_is_turned_away_and_the_first_goes_on(served: Served) -> None:
    port, clock = served.opened()
    with pytest.raises(PortError, match="does not share its clock"):
        SharedClock(str(served.link))
    assert echo(port, clock, b"still there") == b"still there"


def test_what_an_earlier_master_left_is_not_for_the_next(served: Served) -> None:
    port, clock = served.opened()
    port.write(b"old")
    clock.wait_until(clock.now() + 0.01)
    port.close()
    assert grown(lambda: not served.server._is_shared)
    port, clock = served.opened()
    assert echo(port, clock, b"new") == b"new"


def test_a_master_notices_that_the_bench_is_unplugged(served: Served) -> None:
    port, clock = served.opened()
    served.bench.unplugged = True
    with pytest.raises(PortError, match="lost"):
        read_for_two_seconds(port, clock)
    port.close()


def test_the_clock_is_gone_with_its_bench(tmp_path: Path) -> None:
    served = Served(tmp_path / "bench")
    served.close()
    assert (list(tmp_path.iterdir()), shared_clock(str(served.link))) == ([], None)


def test_a_clock_beside_a_name_that_leads_elsewhere_is_not_used(served: Served, tmp_path: Path) -> None:
    (tmp_path / "real").touch()
    (tmp_path / "real.clock").symlink_to(served.server._shared.link.readlink())
    assert shared_clock(str(tmp_path / "real")) is None


def test_nothing_that_stands_in_the_place_of_the_clock_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "bench.clock").write_text("kept")
    with pytest.raises(FileError, match="is no link"):
        ClockSocket(tmp_path / "bench")
    assert (tmp_path / "bench.clock").read_text() == "kept"
