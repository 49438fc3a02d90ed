"""This is where a pseudo-terminal stands in for a serial port: a master opens its path like any other port.

The link is a symbolic link of a name that the user chose to the terminal, whose own name changes from run to run. We
keep the masters' end open ourselves, so that a master may come and go.
"""

import contextlib
import fcntl
import os
import socket
import struct
import sys
import termios
import tty
from pathlib import Path

from sinew.hardware.errors import PortError
from sinew.measure.errors import FileError

__all__ = ["PtyPort", "make_link", "refuse_taken"]

_AT_ONCE = 65536  # bytes
# Linux: struct termios2 { c_iflag, c_oflag, c_cflag, c_lflag; c_line; c_cc[19]; c_ispeed, c_ospeed }, read by TCGETS2.
# Its speeds are plain numbers, also of rates that have no constant of their own (4.5 Mbaud).
_TCGETS2, _TERMIOS2 = 0x802C542A, struct.Struct("4I20s2I")


class PtyPort:
    """A pseudo-terminal with a link to it.

    link: name of the port. Raises FileError where something stands there that is no stale link, or where the folder
    takes no link; PortError where the system gives no pseudo-terminal.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        refuse_taken(link)
        try:
            self._ours, self._theirs = os.openpty()
        except OSError as trouble:
            raise PortError(f"no pseudo-terminal to be had ({trouble}); expected a system with /dev/pts") from trouble
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self.terminal = os.ttyname(self._theirs)
        try:
            make_link(link, self.terminal)
        except OSError as trouble:
            self._close_ends()
            raise FileError(f"cannot link {link}: {trouble.strerror}; choose a folder that you may write") from trouble

    def fileno(self) -> int:
        """Return the descriptor that is readable when a master has sent something."""
        return self._ours

    def baud(self) -> int:
        """Return the rate that the master has set [1/s]; 0 where it has hung up."""
        if sys.platform == "linux":
            return int(_TERMIOS2.unpack(fcntl.ioctl(self._theirs, _TCGETS2, bytes(_TERMIOS2.size)))[-1])
        return int(termios.tcgetattr(self._theirs)[5])

    def read(self) -> bytes:
        """Return what masters have sent and nobody has read; b"" where there is nothing."""
        try:
            return os.read(self._ours, _AT_ONCE)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> int:
        """Send bytes to the master; return how many the system took, fewer where nobody reads them."""
        try:
            return os.write(self._ours, data)
        except BlockingIOError:
            return 0

    def release(self) -> None:
        """Let others open the port after a master that took it for itself alone (TIOCEXCL).

        The system would see to it when the last one closes it, but that is us. Locks of files (flock) are not touched.
        """
        fcntl.ioctl(self._theirs, termios.TIOCNXCL)

    def forget(self) -> None:
        """Drop what was sent and no master has read."""
        termios.tcflush(self._theirs, termios.TCIFLUSH)

    def close(self) -> None:
        """Hang up and remove the link; a master that is still there sees the end of the file or EIO."""
        with contextlib.suppress(OSError):
            if self.link.readlink() == Path(self.terminal):
                self.link.unlink()
        self._close_ends()

    def _close_ends(self) -> None:
        os.close(self._ours)
        os.close(self._theirs)


def refuse_taken(link: Path) -> None:
    """Raise FileError where something stands in the place of a link, except a link that an emulator left when it was
    killed: one that leads nowhere, or to a socket at which nobody listens."""
    if link.is_symlink():
        if link.exists() and not _is_left(link):
            raise FileError(
                f"{link} leads to {link.readlink()}, which is there; expected a free name: "
                "is another emulator running? stop it, remove the link, or choose another name"
            )
    elif link.exists():
        raise FileError(f"{link} is there already and is no link; choose another name, nothing is replaced")


def _is_left(link: Path) -> bool:
    """Return whether a link leads to a socket at which nobody listens any more."""
    if not link.is_socket():
        return False
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking:
        asking.settimeout(_ASKS_S)
        try:
            asking.connect(str(link.resolve()))
        except ConnectionRefusedError:
            return True
        except OSError:
            pass
    return False


_ASKS_S = 1.0


def make_link(link: Path, terminal: str) -> None:
    """Make a link, or turn a stale one over, in one stroke. Raises OSError."""
    if link.is_symlink():
        fresh = link.with_name(f".{link.name}.{os.getpid()}")
        fresh.symlink_to(terminal)
        fresh.replace(link)
    else:
        link.symlink_to(terminal)
