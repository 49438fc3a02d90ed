"""The serial port, on a pseudo-terminal."""

import os
import subprocess
import sys
import tty
from collections.abc import Iterator

import pytest
from tests.patience import LONG_S

from sinew.hardware.bus import MonotonicClock
from sinew.hardware.serial_port import SerialPort
from sinew.measure.errors import PortError

pytest.importorskip("serial", reason="pyserial is not installed")
CLOCK = MonotonicClock()


@pytest.fixture
def ends() -> Iterator[tuple[int, str]]:
    """Return the far end of a line, as a file, and the path of the near end."""
    far, near = os.openpty()
    tty.setraw(near)
    yield far, os.ttyname(near)
    os.close(near)
    os.close(far)


def test_pyserial_is_loaded_only_when_a_port_is_opened() -> None:
    code = "import sys, sinew.hardware.serial_port, sinew.hardware.bus; print('serial' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"


def test_bytes_go_out_as_they_are(ends: tuple[int, str]) -> None:
    far, path = ends
    port = SerialPort(path, 1_000_000, CLOCK)
    port.write(bytes(range(256)))
    assert os.read(far, 1000) == bytes(range(256))
    port.close()


def test_bytes_come_in_as_they_are(ends: tuple[int, str]) -> None:
    far, path = ends
    port = SerialPort(path, 1_000_000, CLOCK)
    os.write(far, bytes(range(256)))
    assert port.read(CLOCK.now() + LONG_S) == bytes(range(256))
    port.close()


def test_a_deadline_that_has_passed_returns_at_once_with_nothing(ends: tuple[int, str]) -> None:
    port = SerialPort(ends[1], 1_000_000, CLOCK)
    assert port.read(CLOCK.now() - 1) == b""
    port.close()


def test_a_port_in_use_is_refused(ends: tuple[int, str]) -> None:
    first = SerialPort(ends[1], 1_000_000, CLOCK)
    with pytest.raises(PortError, match=r"cannot open .*no other program on it"):
        SerialPort(ends[1], 1_000_000, CLOCK)
    first.close()


def test_a_port_that_is_not_there_is_refused() -> None:
    with pytest.raises(PortError, match="cannot open /dev/absent at 57600 baud"):
        SerialPort("/dev/absent", 57_600, CLOCK)


def test_a_closed_port_is_gone_and_may_be_closed_again(ends: tuple[int, str]) -> None:
    port = SerialPort(ends[1], 1_000_000, CLOCK)
    port.close()
    port.close()
    with pytest.raises(PortError, match="lost"):
        port.write(b"1")


def test_a_port_whose_far_end_is_gone_is_reported() -> None:
    far, near = os.openpty()
    port = SerialPort(os.ttyname(near), 1_000_000, CLOCK)
    os.close(near)
    os.close(far)
    with pytest.raises(PortError, match="lost"):
        port.read(CLOCK.now() + LONG_S)
    port.close()
