"""Serial ports and sockets as transports, and the latency timer of an adapter; only here is pyserial imported."""

import os
import select
import socket
import termios
from pathlib import Path
from typing import Any

from sinew.hardware.bus import Clock
from sinew.measure.errors import PortError

_AT_ONCE = 4096  # bytes
_OPENS_S = 5.0  # on a busy computer


class _Port:
    """What serial port and socket share; a Transport.

    opened: what was opened; None when closed. advice: where it is lost.
    """

    def __init__(self, path: str, clock: Clock, advice: str) -> None:
        self._path, self._clock, self._advice = path, clock, advice
        self._opened: Any = None

    def write(self, data: bytes) -> None:
        opened = self._open()
        try:
            opened.sendall(data) if isinstance(opened, socket.socket) else opened.write(data)
        except OSError as trouble:
            raise self._gone(trouble) from trouble

    def read(self, deadline: float) -> bytes:
        file = self._open().fileno()
        try:
            ready, _, _ = select.select([file], [], [], max(0.0, deadline - self._clock.now()))
            data = os.read(file, _AT_ONCE) if ready else b""
        except OSError as trouble:
            raise self._gone(trouble) from trouble
        if ready and not data:
            # A serial line has no end of file: the device behind it was unplugged.
            raise self._gone("nothing there any more")
        return data

    def close(self) -> None:
        if self._opened is not None:
            self._opened.close()
            self._opened = None

    def _open(self) -> Any:
        if self._opened is None:
            raise self._gone("closed")
        return self._opened

    def _gone(self, why: object) -> PortError:
        return PortError(f"lost {self._path} ({why}); {self._advice}")


class SerialPort(_Port):
    """A serial port of Linux or macOS, locked against other masters.

    path: such as /dev/ttyUSB0. baud: 1/s. clock: the one that deadlines are told by.
    Raises PortError if there is no such port, or it is in use, or it cannot do that baud.
    """

    def __init__(self, path: str, baud: int, clock: Clock) -> None:
        import serial

        super().__init__(path, clock, "expected an open port; check plug and power, then start again")
        try:
            self._opened = serial.Serial(path, baud, timeout=0, write_timeout=1.0, exclusive=True)
        except (OSError, ValueError, termios.error) as trouble:
            reason = os.strerror(trouble.errno) if isinstance(trouble, OSError) and trouble.errno else trouble
            raise PortError(
                f"cannot open {path} at {baud} baud ({reason}); "
                "expected a free serial port; is it plugged in, and no other program on it?"
            ) from trouble


class LocalPort(_Port):
    """A Unix socket at which `sinew emulate --socket` listens: an emulated bench that keeps time.

    A pseudo-terminal passes bytes on by a worker of the kernel, which on a busy computer waits its turn behind whatever
    computes, for 50 ms and more; a real bench would count as lost. A socket has no such worker.
    path: of the socket, or of a link to it. clock: the one that deadlines are told by.
    Raises PortError if nobody listens there, or another master is served.
    """

    def __init__(self, path: str, clock: Clock) -> None:
        super().__init__(path, clock, "expected an emulated bench; is it running? then start again")
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


def find_latency_timer(port: str, system: Path = _SYSTEM) -> LatencyTimer | None:
    """Return the timer of the adapter behind a port, or None where there is none.

    port: its path; a link such as those in /dev/serial/by-id is followed. system: where the adapters are listed.
    """
    path = system / Path(port).resolve().name / "latency_timer"
    return LatencyTimer(path) if path.is_file() else None
