"""The serial port, on a pseudo-terminal."""

import errno
import grp
import os
import subprocess
import sys
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.patience import LONG_S

from sinew.hardware.bus import MonotonicClock
from sinew.hardware.ports import SerialPort
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
    code = "import sys, sinew.hardware.ports, sinew.hardware.bus; print('serial' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"


def test_bytes_go_out_as_they_are(ends: tuple[int, str]) -> None:
    far, path = ends
    port = SerialPort(path, 1_000_000, CLOCK)
    port.write(bytes(range(256)))
    assert os.read(far, 1000) == bytes(range(256))
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


GONE = {
    errno.EIO: "the adapter was unplugged or lost its power",
    errno.ENXIO: "the adapter was unplugged or lost its power",
    errno.ENODEV: "the adapter was unplugged or lost its power",
    errno.EPROTO: "the adapter was unplugged or lost its power",
    errno.EPIPE: "the adapter was unplugged or lost its power",
    errno.ETIMEDOUT: "the adapter hangs; unplug it and plug it in again",
    errno.EBADF: "it was closed; open it anew",
    errno.ENOMEM: "Cannot allocate memory; check plug and power",
}


@pytest.mark.parametrize("number", GONE, ids=errno.errorcode.__getitem__)
@pytest.mark.parametrize("call", ["read", "write"])
def test_a_port_that_is_lost_in_a_cycle_says_why_and_what_to_do(
    number: int, call: str, ends: tuple[int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> bytes:
        raise OSError(number, os.strerror(number))

    far, path = ends
    port = SerialPort(path, 1_000_000, CLOCK)
    os.write(far, b"1")
    monkeypatch.setattr(os, "read" if call == "read" else "write", fail)
    act: dict[str, Any] = {"read": lambda: port.read(CLOCK.now() + LONG_S), "write": lambda: port.write(b"1")}
    with pytest.raises(PortError) as caught:
        act[call]()
    monkeypatch.undo()
    port.close()
    assert path in str(caught.value)
    if call == "read":  # what pyserial makes of a failed write has no number
        assert GONE[number] in str(caught.value)
    assert "then start again" in str(caught.value)


def refused(path: str, monkeypatch: pytest.MonkeyPatch, trouble: BaseException) -> str:
    """Return the sentence with which a port is refused where the system says that."""
    import serial

    def fail(*_: object, **__: object) -> None:
        raise trouble

    monkeypatch.setattr(serial, "Serial", fail)
    with pytest.raises(PortError) as caught:
        SerialPort(path, 4_500_000, CLOCK)
    return str(caught.value)


def test_who_may_not_use_a_port_is_told_the_group_to_join(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    port = tmp_path / "ttyUSB0"
    port.touch()
    groups = {port.stat().st_gid: "dialout"}
    monkeypatch.setattr(grp, "getgrgid", lambda number: type("Group", (), {"gr_name": groups[number]}))
    told = refused(str(port), monkeypatch, PermissionError(errno.EACCES, "Permission denied"))
    assert "you may not use it; join its group and log in again: sudo usermod -a -G dialout $USER" in told


@pytest.mark.parametrize(
    ("trouble", "words"),
    [
        (OSError(errno.EBUSY, "busy"), "no other program on it: end that"),
        (OSError(errno.EAGAIN, "Could not exclusively lock port"), "no other program on it: end that"),
        (ValueError("Failed to set custom baud rate"), "its driver does not know 4500000 baud"),
        (OSError(errno.ENOTTY, "not a typewriter"), "or it is no serial port"),
    ],
)
def test_a_port_that_cannot_be_opened_says_why_and_what_to_do(
    trouble: BaseException, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert words in refused("/dev/ttyUSB0", monkeypatch, trouble)


@pytest.mark.parametrize("path", ["COM5", "com12"])
def test_a_name_of_windows_is_told_what_ports_are_called_here(path: str) -> None:
    with pytest.raises(PortError, match="COM ports are those of Windows, here they are called"):
        SerialPort(path, 1_000_000, CLOCK, "linux")


def test_on_windows_the_way_through_wsl_is_told() -> None:
    with pytest.raises(PortError, match="on Windows use WSL 2 and hand the adapter over by usbipd"):
        SerialPort("COM5", 1_000_000, CLOCK, "win32")


def test_on_macos_the_name_that_waits_for_no_carrier_is_told() -> None:
    with pytest.raises(PortError, match=r"waits for a carrier .* use /dev/cu\.usbserial-1410"):
        SerialPort("/dev/tty.usbserial-1410", 1_000_000, CLOCK, "darwin")


def test_an_adapter_is_asked_to_hand_bytes_over_at_once(ends: tuple[int, str], monkeypatch: pytest.MonkeyPatch) -> None:
    import serial

    asked: list[bool] = []
    monkeypatch.setattr(serial.Serial, "set_low_latency_mode", lambda _, wanted: asked.append(wanted))
    SerialPort(ends[1], 1_000_000, CLOCK).close()
    assert asked == [True]
