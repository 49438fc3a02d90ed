"""This is where a socket of this computer stands in for a serial port, for masters that keep time on a busy computer.

Other programs than Sinew's cannot open it; for them there is `sinew.emulator.pty_port`. One master is served at a time:
it hears a plus sign first, the next one is turned away.
"""

import contextlib
import selectors
import shutil
import socket
import tempfile
from pathlib import Path

from sinew.emulator.pty_port import make_link, refuse_taken
from sinew.hardware.errors import PortError
from sinew.measure.errors import FileError

__all__ = ["SocketPort"]

_AT_ONCE = 65536  # bytes


class SocketPort:
    """A listening socket with a link to it.

    link: name of the port. host_baud: rate that a master's adapter is taken to have [1/s], for none is told.
    Raises FileError where something stands there that is no stale link, or where the folder takes no link; PortError
    where the system gives no socket.
    """

    def __init__(self, link: Path, host_baud: int) -> None:
        self.link, self._baud = link, host_baud
        refuse_taken(link)
        self._folder = Path(tempfile.mkdtemp(prefix="sinew-"))  # paths of sockets are short, and nobody else's
        self.terminal = str(self._folder / "port")
        self._listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._master: socket.socket | None = None
        self._ready = selectors.DefaultSelector()
        try:
            self._listening.bind(self.terminal)
            self._listening.listen(4)
        except OSError as trouble:
            self._close_ends()
            raise PortError(f"no socket to be had ({trouble}); expected a system with Unix sockets") from trouble
        self._listening.setblocking(False)
        self._ready.register(self._listening, selectors.EVENT_READ)
        try:
            make_link(link, self.terminal)
        except OSError as trouble:
            self._close_ends()
            raise FileError(f"cannot link {link}: {trouble.strerror}; choose a folder that you may write") from trouble

    def fileno(self) -> int:
        """Return the descriptor that is readable when a master has come or sent something."""
        return self._ready.fileno()

    def baud(self) -> int:
        """Return the rate that a master is taken to have set [1/s]; 0 where there is none."""
        return self._baud if self._master is not None else 0

    def read(self) -> bytes:
        """Return what the master has sent and nobody has read; b"" where there is nothing."""
        self._greet()
        if self._master is None:
            return b""
        try:
            data = self._master.recv(_AT_ONCE)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._part()
        return data

    def write(self, data: bytes) -> int:
        """Send bytes to the master; return how many the system took, all of them where there is no master."""
        if self._master is None:
            return len(data)
        try:
            return self._master.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            self._part()
            return len(data)

    def release(self) -> None:
        """Do nothing: a master that has left holds nothing."""

    def forget(self) -> None:
        """Do nothing: every master has a connection of its own."""

    def close(self) -> None:
        """Hang up and remove the link; a master that is still there sees the end."""
        with contextlib.suppress(OSError):
            if self.link.readlink() == Path(self.terminal):
                self.link.unlink()
        self._close_ends()

    def _greet(self) -> None:
        """Serve who has come, or turn it away while another is served."""
        try:
            newcomer, _ = self._listening.accept()
        except OSError:
            return
        if self._master is not None:
            newcomer.close()
            return
        newcomer.setblocking(False)
        self._master = newcomer
        self._ready.register(newcomer, selectors.EVENT_READ)
        with contextlib.suppress(OSError):
            newcomer.send(b"+")

    def _part(self) -> None:
        if self._master is not None:
            self._ready.unregister(self._master)
            self._master.close()
            self._master = None

    def _close_ends(self) -> None:
        self._part()
        self._ready.close()
        self._listening.close()
        shutil.rmtree(self._folder, ignore_errors=True)
