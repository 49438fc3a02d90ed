"""The emulated bench's end of the clock that it shares with its master; see `sinew.hardware.shared_clock`."""

import contextlib
import selectors
import shutil
import socket
import tempfile
from pathlib import Path
from typing import NamedTuple

from sinew.emulator.pty_port import make_link, refuse_taken
from sinew.hardware.errors import PortError
from sinew.hardware.shared_clock import ANSWER, ASK, HELLO, SUFFIX
from sinew.measure.errors import FileError


class Ask(NamedTuple):
    """What the master says: WROTE, WAIT or READ; its time [s], until when [s], how many bytes it has written so far."""

    what: int
    now: float
    until: float
    written: int


class ClockSocket:
    """A listening socket beside the port, with a link to it. One master is served; another is turned away.

    port: name of the port. Raises FileError, PortError like `sinew.emulator.socket_port`.
    """

    def __init__(self, port: Path) -> None:
        self.link = port.with_name(port.name + SUFFIX)
        refuse_taken(self.link)
        self._folder = Path(tempfile.mkdtemp(prefix="sinew-"))
        self._path = str(self._folder / "clock")
        self._listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._master: socket.socket | None = None
        self._heard = b""
        self._ready = selectors.DefaultSelector()
        try:
            self._listening.bind(self._path)
            self._listening.listen(4)
        except OSError as trouble:
            self._close_ends()
            raise PortError(f"no socket to be had ({trouble}); expected a system with Unix sockets") from trouble
        self._listening.setblocking(False)
        self._ready.register(self._listening, selectors.EVENT_READ)
        try:
            make_link(self.link, self._path)
        except OSError as trouble:
            self._close_ends()
            raise FileError(
                f"cannot link {self.link}: {trouble.strerror}; choose a folder that you may write"
            ) from trouble

    @property
    def is_taken(self) -> bool:
        """Whether a master shares the clock."""
        return self._master is not None

    def fileno(self) -> int:
        """Return the descriptor that is readable when a master has come, said something or left."""
        return self._ready.fileno()

    def wait(self, seconds: float) -> bool:
        """Return whether there is something to look at; waits for it at most so long [s]."""
        return bool(self._ready.select(seconds))

    def greet(self, now: float, terminal: str) -> bool:
        """Take a master that has come and tell it the time [s] and the terminal; return whether there is a new one."""
        try:
            newcomer, _ = self._listening.accept()
        except OSError:
            return False
        if self._master is not None:
            newcomer.close()
            return False
        newcomer.setblocking(False)
        self._master, self._heard = newcomer, b""
        self._ready.register(newcomer, selectors.EVENT_READ)
        name = terminal.encode()
        self._send(HELLO.pack(now, len(name)) + name)
        return True

    def ask(self) -> Ask | None:
        """Return what the master says next, None where it says nothing or has left."""
        if self._master is None:
            return None
        try:
            data = self._master.recv(ASK.size - len(self._heard))
        except BlockingIOError:
            return None
        except OSError:
            data = b""
        if not data:
            self._part()
            return None
        self._heard += data
        if len(self._heard) < ASK.size:
            return None
        heard, self._heard = self._heard, b""
        return Ask(*ASK.unpack(heard))

    def has_ended(self) -> bool:
        """Return whether the master is gone, or has hung up behind what it still said."""
        if self._master is None:
            return True
        try:
            return self._master.recv(1, socket.MSG_PEEK) == b""
        except BlockingIOError:
            return False
        except OSError:
            return True

    def answer(self, now: float, sent: int) -> None:
        """Tell the master the time [s] and how many bytes were sent so far."""
        self._send(ANSWER.pack(now, sent))

    def close(self) -> None:
        """Hang up and remove the link; may be called again."""
        with contextlib.suppress(OSError):
            if self.link.readlink() == Path(self._path):
                self.link.unlink()
        self._close_ends()

    def _send(self, data: bytes) -> None:
        try:
            if self._master is not None:
                self._master.sendall(data)
        except OSError:
            self._part()

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
