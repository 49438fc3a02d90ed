"""This is where a socket of this computer becomes a transport: the way to an emulated bench that keeps time.

A pseudo-terminal passes bytes on by a worker of the kernel, which on a busy computer waits its turn behind whatever
computes, for 50 ms and more; a real bench would count as lost. A socket has no such worker.
"""

import os
import select
import socket

from sinew.hardware.errors import PortError
from sinew.hardware.transport import Clock

__all__ = ["LocalPort"]

_AT_ONCE = 4096  # bytes
_OPENS_S = 5.0  # on a busy computer


class LocalPort:
    """A Unix socket at which `sinew emulate --socket` listens.

    path: of the socket, or of a link to it. clock: the one that deadlines are told by.
    Raises PortError if nobody listens there, or another master is served.
    """

    def __init__(self, path: str, clock: Clock) -> None:
        self._path, self._clock = path, clock
        self._socket: socket.socket | None = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.settimeout(_OPENS_S)
            self._socket.connect(os.path.realpath(path))
            if self._socket.recv(1) != b"+":
                raise OSError("another master is served")
        except OSError as trouble:
            self.close()
            raise PortError(
                f"cannot open {path} ({trouble.strerror or trouble}); expected an emulated bench that nobody uses; is "
                "`sinew emulate --socket` running?"
            ) from trouble

    def write(self, data: bytes) -> None:
        """Send bytes; raises PortError if the other end is gone."""
        try:
            self._open().sendall(data)
        except OSError as trouble:
            raise self._gone(trouble) from trouble

    def read(self, deadline: float) -> bytes:
        """Return what has arrived, waiting for at least a byte until `deadline` [s]; then b"".

        Raises PortError if the other end is gone.
        """
        opened = self._open()
        try:
            ready, _, _ = select.select([opened], [], [], max(0.0, deadline - self._clock.now()))
            data = opened.recv(_AT_ONCE) if ready else b""
        except OSError as trouble:
            raise self._gone(trouble) from trouble
        if ready and not data:
            raise self._gone("nothing there any more")
        return data

    def close(self) -> None:
        """Give the port back; may be called again."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _open(self) -> socket.socket:
        if self._socket is None:
            raise self._gone("closed")
        return self._socket

    def _gone(self, why: object) -> PortError:
        return PortError(f"lost {self._path} ({why}); expected an emulated bench; is it running? then start again")
