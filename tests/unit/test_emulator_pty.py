"""The pseudo-terminal in front of an emulated bench: a bench that only notes what it is asked stands behind it."""

import fcntl
import math
import struct
import termios
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import serial
from tests.patience import comes

from sinew.emulator.port_server import PtyServer
from sinew.measure.errors import FileError

TIOCGEXCL = 0x80045440  # of Linux; the module termios does not have it


@dataclass
class Line:
    """`work`: when it has something to do [s]."""

    host_baud: int = 9600
    work: list[float] = field(default_factory=list)

    @property
    def due(self) -> float:
        return min(self.work, default=math.inf)


@dataclass
class Bench:
    """Notes what it hears and when; `due` holds what it says and when."""

    line: Line = field(default_factory=Line)
    unplugged: bool = False
    heard: bytes = b""
    heard_at: float = -1.0
    time: float = 0.0
    due: list[tuple[float, bytes]] = field(default_factory=list)
    acts: list[int] = field(default_factory=list)

    def do(self, act: int) -> None:
        self.acts.append(act)

    def receive(self, data: bytes, now: float) -> None:
        self.heard += data
        self.heard_at = now

    def transmit(self, now: float) -> bytes:
        said = b"".join(data for when, data in self.due if when <= now)
        self.due = [(when, data) for when, data in self.due if when > now]
        return said

    def next_event(self) -> float:
        return min((when for when, _ in self.due), default=float("inf"))

    def advance(self, now: float) -> None:
        self.time = now
        self.line.work = [when for when in self.line.work if when > now]

    def catch_up(self) -> None:
        pass


@dataclass
class ManualClock:
    time: float = 50.0

    def now(self) -> float:
        return self.time

    def wait_until(self, time: float) -> None:
        self.time = time


class Served:
    """A bench, its server on a clock moved by hand, and the name of the port."""

    def __init__(self, link: Path) -> None:
        self.bench, self.clock, self.link = Bench(), ManualClock(), link
        self.server = PtyServer(self.bench, link, clock=self.clock)

    def at(self, time: float) -> None:
        """Let the server do what it does at a time [s] after its start."""
        self.clock.time = 50.0 + time
        self.server.step()


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    served = Served(tmp_path / "port")
    yield served
    served.server.close()


def opened(served: Served, baud: int = 1_000_000) -> serial.Serial:
    return serial.Serial(str(served.link), baud, timeout=0)


def come(master: serial.Serial) -> bytes:
    """Return what is there for the master, if anything comes."""
    comes(master)
    return bytes(master.read(1 << 20))


def test_what_a_master_writes_gets_to_the_line(served: Served) -> None:
    with opened(served) as master:
        master.write(b"\xff\xff\xfd\x00\r\n\x03\x11\x13")
        served.at(0.001)
    assert served.bench.heard == b"\xff\xff\xfd\x00\r\n\x03\x11\x13"


def test_what_the_line_says_gets_to_the_master_when_it_is_due(served: Served) -> None:
    every_byte = bytes(range(256))
    served.bench.due = [(0.010, every_byte)]
    with opened(served) as master:
        served.at(0.009)
        early = master.read(300)
        served.at(0.0105)
        served.at(0.0108)
        assert (early, come(master)) == (b"", every_byte)


def test_bytes_that_are_due_a_tenth_of_a_millisecond_apart_are_sent_together(served: Served) -> None:
    served.bench.due = [(0.0100, b"one"), (0.0101, b"two")]
    with opened(served) as master:
        served.at(0.01005)
        held = master.read(10)
        served.at(0.01015)
        served.at(0.01030)
        assert (held, come(master)) == (b"", b"onetwo")


def test_answers_are_worked_out_before_their_time_and_sent_at_it(served: Served) -> None:
    served.bench.line.work = [0.0014, 0.0016, 0.0030]
    with opened(served) as master:
        master.write(b"x")
        served.at(0.0010)
        worked_out = served.bench.time
        served.bench.due = [(0.0016, b"answer")]
        served.at(0.0012)
        early = master.read(10)
        served.at(0.0017)
        served.at(0.0019)
        assert (worked_out, early, come(master)) == (0.0016, b"", b"answer")


def test_a_master_that_took_the_port_for_itself_leaves_it_to_others(served: Served) -> None:
    is_exclusive = struct.Struct("i")
    with opened(served) as master:
        fcntl.ioctl(master, termios.TIOCEXCL)
    served.at(0.001)
    served.at(0.2)
    served.at(0.4)
    served.at(0.6)
    with opened(served) as master:
        claim = is_exclusive.unpack(fcntl.ioctl(master, TIOCGEXCL, is_exclusive.pack(1)))
    assert claim == (0,)


def test_a_master_that_does_not_read_holds_nobody_up_and_loses_bytes(served: Served) -> None:
    with opened(served):
        for number in range(40):
            served.bench.due = [(0.0, bytes(4000))]
            served.at(0.001 * number)
    assert served.server.lost > 0


def test_a_stale_link_is_turned_over(tmp_path: Path) -> None:
    link = tmp_path / "port"
    link.symlink_to(tmp_path / "gone")
    served = Served(link)
    where = link.readlink()
    served.server.close()
    assert where.parent == Path("/dev/pts")


def test_a_folder_that_is_not_there_is_refused_without_leaving_a_terminal_open(tmp_path: Path) -> None:
    before = len(list(Path("/dev/fd").iterdir()))
    with pytest.raises(FileError, match="cannot link"):
        Served(tmp_path / "no" / "port")
    assert len(list(Path("/dev/fd").iterdir())) == before
