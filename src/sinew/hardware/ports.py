"""Ports of a bench as transports: serial ports with their latency timer, and that of an emulated bench with its clock.

Only here is pyserial imported.
"""

import errno
import os
import re
import select
import socket
import struct
import sys
import threading
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import Any

from sinew.hardware.bus import Clock, MonotonicClock, Transport
from sinew.measure.errors import PortError

_AT_ONCE = 4096  # bytes

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
    names = [str(node) for form in ("ttyUSB*", "ttyACM*", "cu.usb*") for node in sorted(devices.glob(form))]
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


class SerialPort:
    """A serial port of Linux or macOS, locked against other masters; a Transport.

    path: such as /dev/ttyUSB0, or /dev/cu.usbserial-1 on macOS. baud: 1/s. clock: the one that deadlines are told by.
    An adapter is asked to hand bytes over at once, which an FTDI chip does after 1 ms then instead of 16.
    Raises PortError if there is no such port, or it is in use, or not for this user, or it cannot do that baud.
    """

    def __init__(self, path: str, baud: int, clock: Clock, platform: str = sys.platform) -> None:
        _refuse_foreign_name(path, platform)
        import termios

        import serial

        self._path, self._clock = path, clock
        self._opened: Any = None  # when closed
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

    def write(self, data: bytes) -> None:
        opened = self._open()
        try:
            opened.write(data)
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
        return PortError(f"lost {self._path}: {_lost(why)}, then start again")


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


# The port of an emulated bench: the clock that it shares with the one program that drives it.
#
# An emulated bench and its master are two programs on one computer, which may leave either of them alone for a while. A
# real bench would go on meanwhile; an emulated one shares the computer, so it waits. It owns the time, and time passes
# only while its master waits: for a moment (WAIT) or for bytes (READ). What the master computes takes none, nor does a
# pause of either, and no faster than the computer's clock does it pass at all.
#
# Beside the port NAME there is a socket NAME.clock, through which everything goes; the port is only held. Master to
# bench: what (WROTE, WAIT, READ), the master's time, until when, and the bytes that it writes; or DO, with the number
# of an act in the place of the moment. Bench to master, after all but WROTE: the time, and the bytes that have come.
# In between the bench's time stands.
#
# A master that has ended closes the socket, and from then on time passes by itself: the motors' watchdogs trip as they
# would. One that is silent for `PATIENCE_S` counts as lost, with the same effect, until it is heard again.


SUFFIX = ".clock"
"""What the clock's socket is called behind the name of the port."""

PATIENCE_S = 5.0
"""For so long a bench waits for a master that is silent; only time in which it runs itself counts [s]."""

WROTE, WAIT, READ, DO = 1, 2, 3, 4
ASK = struct.Struct("!BddI")
ANSWER = struct.Struct("!dI")
HELLO = struct.Struct("!dH")  # the time, and the length of what follows: the name of the terminal that it belongs to

PLUG_ALL, PLUG_DRIVE, TURN_LEVER = 0, -1, -2
"""What a person may do at a bench, and the emulated one does when it is asked: plug all motors in; one alone, that of
the tendon with this number from 1 on, or the drive; turn the lever to its middle."""

_STEP_S = 0.1  # so long a wait at once; in between either side sees whether the other is there
_LOOK_S = 0.05
_LOOKS = round(2 * PATIENCE_S / _LOOK_S)
_SILENT_S = 0.5  # after so long without a word the bench may have gone on by itself
_COST_S = 50e-6  # what a call takes in the bench's time: a master that never waits must get on, too


class SharedClock:
    """The time of an emulated bench; a Clock. What waits for it raises PortError where the bench is gone.

    port: name of the port, beside which the clock lies. came: bytes that the bench has sent and nobody took. Raises
    PortError where nobody answers, or another master is served. `now` may be asked from any thread and in signal
    handlers; all else by the one that owns the bus.
    """

    def __init__(self, port: str) -> None:
        self._port = port
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._lock = threading.Lock()
        self._heard, self._now = monotonic(), 0.0
        self.came = b""
        try:
            self._socket.connect(os.path.realpath(port + SUFFIX))
            self._now, length = HELLO.unpack(self._hear(HELLO.size))
            self.terminal = self._hear(length).decode()
        except (OSError, PortError) as trouble:
            self._socket.close()
            raise PortError(
                f"the emulated bench at {port} does not share its clock ({trouble}); expected one that nobody uses; is "
                "another program on it?"
            ) from trouble

    def now(self) -> float:
        if monotonic() - self._heard > _SILENT_S and self._lock.acquire(blocking=False):
            try:
                self._exchange(WAIT, self._now)
            except PortError:
                pass  # the next call that needs the bench says so
            finally:
                self._lock.release()
        return self._now

    def wait_until(self, time: float) -> None:
        while self._now < time:
            self.ask(WAIT, min(time, self._now + _STEP_S))

    def ask(self, what: int, until: float) -> None:
        """Let time pass until a moment [s], or with READ until bytes have come."""
        with self._lock:
            self._exchange(what, until)

    def do(self, act: int) -> None:
        """Have something done that a person at the bench would do, by its number above."""
        self.ask(DO, act)

    def write(self, data: bytes) -> None:
        """Have bytes on the bench's line from now on."""
        with self._lock:
            self._now += _COST_S
            self._say(WROTE, self._now, data)

    def spend(self) -> None:
        """Let the time of a call pass that asks for nothing."""
        self._now += _COST_S

    def close(self) -> None:
        """Leave the bench to itself; may be called again."""
        self._socket.close()

    def _exchange(self, what: int, until: float) -> None:
        self._say(what, until)
        self._now, length = ANSWER.unpack(self._hear(ANSWER.size))
        self.came += self._hear(length) if length else b""
        self._heard = monotonic()

    def _say(self, what: int, until: float, data: bytes = b"") -> None:
        try:
            self._socket.sendall(ASK.pack(what, self._now, until, len(data)) + data)
        except OSError as trouble:
            raise self._gone(trouble.strerror or trouble) from trouble

    def _hear(self, length: int) -> bytes:
        got = b""
        for _ in range(_LOOKS):  # not seconds: if this program is paused, the bench may have been, too
            if not select.select([self._socket], [], [], _LOOK_S)[0]:
                continue
            try:
                data = self._socket.recv(length - len(got))
            except OSError as trouble:
                raise self._gone(trouble.strerror or trouble) from trouble
            got += data
            if len(got) == length:
                return got
            if not data:
                raise self._gone("nothing there any more")
        raise self._gone(f"silent for {_LOOKS * _LOOK_S:.0f} s")

    def _gone(self, why: object) -> PortError:
        return PortError(f"lost {self._port} ({why}); expected an emulated bench; is it running? then start again")


class SharedPort:
    """A port of a bench that shares its clock; a Transport. Deadlines are told by that clock.

    port: the bench's own, which is held, and gone where the bench is unplugged.
    """

    def __init__(self, port: Transport, clock: SharedClock) -> None:
        self._port, self._clock = port, clock
        self._computer = MonotonicClock()

    def write(self, data: bytes) -> None:
        self._clock.write(data)

    def read(self, deadline: float) -> bytes:
        clock = self._clock
        clock.spend()
        while not clock.came and (now := clock.now()) < deadline:
            clock.ask(READ, min(deadline, now + _STEP_S))
        if not clock.came:
            self._port.read(self._computer.now())  # raises PortError where the bench was unplugged
        data, clock.came = clock.came, b""
        return data

    def close(self) -> None:
        self._port.close()
        self._clock.close()


def shared_clock(port: str) -> SharedClock | None:
    """Return the clock that an emulated bench shares beside a port; None: a real bench, or one that keeps own time.

    Raises PortError where it is shared with another master.
    """
    if not Path(port + SUFFIX).is_socket():
        return None
    clock = SharedClock(port)
    if clock.terminal == os.path.realpath(port):
        return clock
    clock.close()  # an emulator's, but the name leads elsewhere by now
    return None
