"""Serial ports and sockets as transports, and the latency timer of an adapter; only here is pyserial imported."""

import errno
import os
import re
import select
import socket
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from sinew.hardware.bus import Clock
from sinew.measure.errors import PortError

_AT_ONCE = 4096  # bytes
_OPENS_S = 5.0  # on a busy computer

# What the system says where a port is lost, or cannot be opened, is said in words that tell what to do.
#
# Which number comes when a cable is pulled is a matter of driver and moment: an ongoing read gives EIO or an end of
# file, the next call ENXIO or ENODEV, a hub that resets EPROTO; a port closed by this program itself EBADF.

_UNPLUGGED = (
    errno.EIO,
    errno.ENXIO,
    errno.ENODEV,
    errno.ENOENT,
    errno.EPROTO,
    errno.ESHUTDOWN,
    errno.EPIPE,
    errno.ENOTTY,
)
_STALLED = (errno.ETIMEDOUT, errno.EAGAIN)
_FOR_A_MOMENT = (errno.EAGAIN, errno.EWOULDBLOCK, errno.EINTR)
_PLUG_IN = "check plug and power of the adapter; plugged in again it may have another name (see /dev/serial/by-id)"


def _lost(trouble: object) -> str:
    """Return what became of an open port, and what to do, by what the system said."""
    number = getattr(trouble, "errno", None)
    if number in _UNPLUGGED:
        return f"{os.strerror(number)}: the adapter was unplugged or lost its power; {_PLUG_IN}"
    if number in _STALLED or "timeout" in str(trouble).lower():
        return "it takes no bytes any more: the adapter hangs; unplug it and plug it in again"
    if number == errno.EBADF:
        return "it was closed; open it anew"
    said = os.strerror(number) if number else str(trouble)
    return f"{said}; {_PLUG_IN}"


def _bench_lost(trouble: object) -> str:
    """Return the same of an emulated bench."""
    number = getattr(trouble, "errno", None)
    said = "nothing there any more" if number in _UNPLUGGED else os.strerror(number) if number else str(trouble)
    return f"{said}; is the emulated bench running? see to it"


def _unopened(path: str, baud: int, trouble: BaseException) -> str:
    """Return why a port cannot be opened, and what to do."""
    number = getattr(trouble, "errno", None)
    if number in (errno.EACCES, errno.EPERM):
        return f"you may not use it; {_how_to_be_allowed(path)}"
    if number in (errno.EBUSY, errno.EAGAIN):
        return (
            "expected a free serial port, with no other program on it: end that (`fuser -v` with its name shows which)"
        )
    if number in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        return f"expected a free serial port; {_others(path)}"
    if isinstance(trouble, ValueError) or number in (errno.EINVAL, errno.ENOTTY) or "baud" in str(trouble):
        return (
            f"its driver does not know {baud} baud, or it is no serial port; lower wiring.baud, or use another adapter"
        )
    return "expected a free serial port; is it plugged in, and no other program on it?"


def _how_to_be_allowed(path: str) -> str:
    """Return how a user comes to be allowed to use a port that is there: by the group it belongs to."""
    group = "dialout"
    with suppress(OSError, KeyError, ImportError):
        import grp

        group = grp.getgrgid(Path(path).stat().st_gid).gr_name
    if group in ("root", "wheel"):
        return f"it belongs to {group} alone; a rule of udev can give it to a group (see docs/how-to/serial-port.md)"
    return f"join its group and log in again: sudo usermod -a -G {group} $USER"


def _others(path: str) -> str:
    """Return which ports there are instead."""
    if re.fullmatch(r"(?i)(\\\\\.\\)?com\d+", path):
        return f"COM ports are those of Windows, here they are called {_found() or '/dev/ttyUSB0 or the like'}"
    found = _found()
    there = f"there is {found}" if found else "no adapter is plugged in (none at /dev/ttyUSB*, ttyACM* or cu.usb*)"
    emulated = "; an emulated bench is there while `sinew emulate` runs, under the path that its --link names"
    return there if path.startswith("/dev/") else there + emulated


def _found(devices: Path = Path("/dev")) -> str:
    """Return the names of the serial adapters that are plugged in; those of macOS that wait for no carrier."""
    names = [str(place) for form in ("ttyUSB*", "ttyACM*", "cu.usb*") for place in sorted(devices.glob(form))]
    return ", ".join(names)


def _refuse_foreign_name(path: str, platform: str) -> None:
    """Raise PortError for a port, or a system, that cannot be waited for as a bench needs it."""
    if platform == "win32":
        raise PortError(
            f"cannot open {path}: a bench is driven from Linux or macOS, whose ports can be waited for to the "
            "millisecond; on Windows use WSL 2 and hand the adapter over by usbipd (docs/how-to/serial-port.md)"
        )
    if platform == "darwin" and Path(path).name.startswith("tty."):
        called = path.replace("/tty.", "/cu.")
        raise PortError(f"cannot open {path}: on macOS it waits for a carrier that no adapter has; use {called}")


class _Port:
    """What serial port and socket share; a Transport.

    opened: what was opened; None when closed. words: what became of it and what to do, by what the system said.
    """

    def __init__(self, path: str, clock: Clock, words: Callable[[object], str]) -> None:
        self._path, self._clock, self._words = path, clock, words
        self._opened: Any = None

    def write(self, data: bytes) -> None:
        opened = self._open()
        try:
            opened.sendall(data) if isinstance(opened, socket.socket) else opened.write(data)
        except (OSError, ValueError, TypeError) as trouble:
            raise self._gone(trouble) from trouble

    def read(self, deadline: float) -> bytes:
        opened = self._open()
        try:
            # A port that was closed under our hands has no number any more, which is no OSError.
            file = opened.fileno()
            ready, _, _ = select.select([file], [], [], max(0.0, deadline - self._clock.now()))
            data = os.read(file, _AT_ONCE) if ready else b""
        except (OSError, ValueError, TypeError) as trouble:
            if getattr(trouble, "errno", None) in _FOR_A_MOMENT:
                return b""  # somebody else took the byte: there is nothing at this moment
            raise self._gone(trouble) from trouble
        if ready and not data:
            # A serial line has no end of file: the device behind it was unplugged.
            raise self._gone(OSError(errno.EIO, "end of file"))
        return data

    def close(self) -> None:
        if self._opened is not None:
            self._opened.close()
            self._opened = None

    def _open(self) -> Any:
        if self._opened is None:
            raise self._gone(OSError(errno.EBADF, "closed"))
        return self._opened

    def _gone(self, why: object) -> PortError:
        return PortError(f"lost {self._path}: {self._words(why)}, then start again")


class SerialPort(_Port):
    """A serial port of Linux or macOS, locked against other masters.

    path: such as /dev/ttyUSB0, or /dev/cu.usbserial-1 on macOS. baud: 1/s. clock: the one that deadlines are told by.
    An adapter is asked to hand bytes over at once, which an FTDI chip does after 1 ms then instead of 16.
    Raises PortError if there is no such port, or it is in use, or not for this user, or it cannot do that baud.
    """

    def __init__(self, path: str, baud: int, clock: Clock, platform: str = sys.platform) -> None:
        _refuse_foreign_name(path, platform)
        import termios

        import serial

        super().__init__(path, clock, _lost)
        try:
            self._opened = serial.Serial(path, baud, timeout=0, write_timeout=1.0, exclusive=True)
        except (OSError, ValueError, termios.error) as trouble:
            reason = os.strerror(trouble.errno) if isinstance(trouble, OSError) and trouble.errno else trouble
            raise PortError(
                f"cannot open {path} at {baud} baud ({reason}); {_unopened(path, baud, trouble)}"
            ) from trouble
        # Not every driver knows that; the doctor reads what became of the timer.
        with suppress(OSError, ValueError, NotImplementedError, AttributeError):
            self._opened.set_low_latency_mode(True)


class LocalPort(_Port):
    """A Unix socket at which `sinew emulate --socket` listens: an emulated bench that keeps time.

    A pseudo-terminal passes bytes on by a worker of the kernel, which on a busy computer waits its turn behind whatever
    computes, for 50 ms and more; a real bench would count as lost. A socket has no such worker.
    path: of the socket, or of a link to it. clock: the one that deadlines are told by.
    Raises PortError if nobody listens there, or another master is served.
    """

    def __init__(self, path: str, clock: Clock) -> None:
        super().__init__(path, clock, _bench_lost)
        self._opened = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._opened.settimeout(_OPENS_S)
            self._opened.connect(os.path.realpath(path))
            if self._opened.recv(1) != b"+":
                raise OSError("another master is served")
        except OSError as trouble:
            self.close()
            raise PortError(
                f"cannot open {path} ({trouble.strerror or trouble}); expected an emulated bench that nobody uses; is "
                "`sinew emulate --socket` running?"
            ) from trouble


# The latency timer of a USB adapter is read and set: how long it gathers bytes before it passes them on.
#
# Adapters with an FTDI chip come with 16 ms, three cycles of the bench; 1 ms is what it needs. Linux shows the timer as
# a file. Boards that are a modem by themselves (ttyACM, such as an OpenCR) and pseudo-terminals have none.

WANTED_MS = 1
_SYSTEM = Path("/sys/bus/usb-serial/devices")


class LatencyTimer:
    """The timer of one adapter. path: of the file that shows it."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def read(self) -> int:
        """Return the time [ms]. Raises PortError if it cannot be read."""
        try:
            return int(self.path.read_text(encoding="ascii"))
        except (OSError, ValueError) as trouble:
            raise PortError(f"cannot read {self.path} ({trouble}); expected a time in ms") from trouble

    def write(self, milliseconds: int) -> None:
        """Set the time [ms] until the adapter is unplugged. Raises PortError without the right to."""
        try:
            self.path.write_text(f"{milliseconds}\n", encoding="ascii")
        except OSError as trouble:
            raise PortError(
                f"cannot write {self.path} ({trouble.strerror or trouble}); "
                f"as administrator: echo {milliseconds} > {self.path}"
            ) from trouble


def list_ports() -> list[str]:
    """Return the paths of this computer's serial ports at USB, as a bench's adapter or board is one, in order."""
    from serial.tools.list_ports import comports

    return sorted(port.device for port in comports() if port.vid is not None)


_FTDI = 0x0403
"""FTDI's number as a vendor of USB devices (usb.org)."""


def is_ftdi(port: str) -> bool:
    """Return whether the adapter behind a port is one of FTDI's, by its USB vendor; False for what is not listed."""
    from serial.tools.list_ports import comports

    real = str(Path(port).resolve())
    return any(one.vid == _FTDI and one.device in (port, real) for one in comports())


def find_latency_timer(port: str, system: Path = _SYSTEM) -> LatencyTimer | None:
    """Return the timer of the adapter behind a port, or None where there is none.

    port: its path; a link such as those in /dev/serial/by-id is followed. system: where the adapters are listed.
    """
    path = system / Path(port).resolve().name / "latency_timer"
    return LatencyTimer(path) if path.is_file() else None
