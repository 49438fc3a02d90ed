"""This is where a serial port becomes a transport, and the only place that imports pyserial."""

import os
import select
import termios
from typing import Any

from sinew.hardware.errors import PortError
from sinew.hardware.transport import Clock

__all__ = ["SerialPort"]

_AT_ONCE = 4096  # bytes


class SerialPort:
    """A serial port of Linux or macOS, locked against other masters.

    path: such as /dev/ttyUSB0. baud: 1/s. clock: the one that deadlines are told by.
    Raises PortError if there is no such port, or it is in use, or it cannot do that baud.
    """

    def __init__(self, path: str, baud: int, clock: Clock) -> None:
        import serial

        self._path, self._clock = path, clock
        self._port: Any = None
        try:
            self._port = serial.Serial(path, baud, timeout=0, write_timeout=1.0, exclusive=True)
        except (OSError, ValueError, termios.error) as trouble:
            reason = os.strerror(trouble.errno) if isinstance(trouble, OSError) and trouble.errno else trouble
            raise PortError(
                f"cannot open {path} at {baud} baud ({reason}); "
                "expected a free serial port; is it plugged in, and no other program on it?"
            ) from trouble

    def write(self, data: bytes) -> None:
        """Send bytes; raises PortError if the port is gone."""
        try:
            self._open().write(data)
        except OSError as trouble:
            raise self._gone(trouble) from trouble

    def read(self, deadline: float) -> bytes:
        """Return what has arrived, waiting for at least a byte until `deadline` [s]; then b"".

        Raises PortError if the port is gone.
        """
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
        """Give the port back; may be called again."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def _open(self) -> Any:
        if self._port is None:
            raise self._gone("closed")
        return self._port

    def _gone(self, why: object) -> PortError:
        return PortError(f"lost {self._path} ({why}); expected an open port; check plug and power, then start again")
