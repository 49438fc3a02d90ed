"""An emulated bench on a pseudo-terminal, in real time.

To whom it shares its clock with, time passes as `sinew.hardware.ports` says; to all others by itself.
"""

import contextlib
import errno
import fcntl
import math
import os
import select
import shutil
import socket
import struct
import sys
import tempfile
import termios
import tty
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, NamedTuple

from sinew.emulator.bench import EmulatedRig
from sinew.hardware.bus import Clock
from sinew.hardware.ports import ANSWER, ASK, DO, HELLO, PATIENCE_S, READ, SUFFIX, WROTE
from sinew.measure.errors import FileError, PortError


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
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking, contextlib.suppress(OSError):
        asking.settimeout(_ASKS_S)
        return link.is_socket() and asking.connect_ex(str(link.resolve())) == errno.ECONNREFUSED
    return False


_ASKS_S = 1.0


class _Named(ABC):
    """What stands behind a link. terminal: where the link leads to.

    Raises FileError where something stands there that is no stale link, or where the folder takes no link.
    """

    terminal: str

    def __init__(self, link: Path) -> None:
        self.link = link
        refuse_taken(link)

    def _make_link(self) -> None:
        """Make the link, or turn a stale one over, in one stroke."""
        try:
            is_stale = self.link.is_symlink()
            fresh = self.link.with_name(f".{self.link.name}.{os.getpid()}") if is_stale else self.link
            fresh.symlink_to(self.terminal)  # nothing that came there meanwhile is replaced
            if is_stale:
                fresh.replace(self.link)
        except OSError as trouble:
            self._close_ends()
            raise FileError(
                f"cannot link {self.link}: {trouble.strerror}; choose a folder that you may write"
            ) from trouble

    def close(self) -> None:
        """Hang up and remove the link; a master that is still there sees the end of the file or EIO."""
        with contextlib.suppress(OSError):
            if self.link.readlink() == Path(self.terminal):
                self.link.unlink()
        self._close_ends()

    @abstractmethod
    def _close_ends(self) -> None: ...


# The emulated bench's end of the clock that it shares with its master; see `sinew.hardware.ports`.


class Ask(NamedTuple):
    """What the master says: WROTE, WAIT, READ or DO; its time [s]; until when [s], or which act; what it writes."""

    what: int
    now: float
    until: float
    data: bytes


class ClockSocket(_Named):
    """A listening socket beside the port, with a link to it. One master is served; another is turned away.

    port: name of the port. Raises PortError where the system gives no socket.
    """

    def __init__(self, port: Path) -> None:
        super().__init__(port.with_name(port.name + SUFFIX))
        self._folder = Path(tempfile.mkdtemp(prefix="sinew-"))  # paths of sockets are short, and nobody else's
        self.terminal = str(self._folder / "clock")
        self._listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._master: socket.socket | None = None
        self._heard = b""
        try:
            self._listening.bind(self.terminal)
            self._listening.listen(4)
        except OSError as trouble:
            self._close_ends()
            raise PortError(f"no socket to be had ({trouble}); expected a system with Unix sockets") from trouble
        self._listening.setblocking(False)
        self._make_link()

    @property
    def ends(self) -> list[socket.socket]:
        """What is readable when a master has come, said something or left."""
        return [self._listening] if self._master is None else [self._listening, self._master]

    @property
    def is_taken(self) -> bool:
        """Whether a master shares the clock."""
        return self._master is not None

    def wait(self, seconds: float) -> bool:
        """Return whether there is something to look at; waits for it at most so long [s]."""
        return bool(select.select(self.ends, [], [], seconds)[0])

    def greet(self, now: float, terminal: str) -> None:
        """Take a master that has come and tell it the time [s] and the terminal; turn it away while one is served."""
        try:
            newcomer, _ = self._listening.accept()
        except OSError:
            return
        if self._master is not None:
            newcomer.close()
            return
        newcomer.setblocking(False)
        self._master, self._heard = newcomer, b""
        name = terminal.encode()
        self._send(HELLO.pack(now, len(name)) + name)

    def ask(self) -> Ask | None:
        """Return what the master says next, None where it has not said it whole or has left."""
        while True:
            if len(self._heard) >= ASK.size:
                what, now, until, length = ASK.unpack_from(self._heard)
                end = ASK.size + length
                if len(self._heard) >= end:
                    data, self._heard = self._heard[ASK.size : end], self._heard[end:]
                    return Ask(what, now, until, data)
            try:
                data = b"" if self._master is None else self._master.recv(_AT_ONCE)
            except BlockingIOError:
                return None
            except OSError:
                data = b""
            if not data:
                self._part()
                return None
            self._heard += data

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

    def answer(self, now: float, data: bytes) -> None:
        """Tell the master the time [s] and what has come for it."""
        self._send(ANSWER.pack(now, len(data)) + data)

    def _send(self, data: bytes) -> None:
        try:
            if self._master is not None:
                self._master.sendall(data)
        except OSError:
            self._part()

    def _part(self) -> None:
        if self._master is not None:
            self._master.close()
            self._master, self._heard = None, b""

    def _close_ends(self) -> None:
        self._part()
        self._listening.close()
        shutil.rmtree(self._folder, ignore_errors=True)


# A pseudo-terminal stands in for a serial port: a master opens its path like any other port.
#
# The link is a symbolic link of a name that the user chose to the terminal, whose own name changes from run to run. We
# keep the masters' end open ourselves, so that a master may come and go.

_AT_ONCE = 65536  # bytes
# Linux: struct termios2 { c_iflag, c_oflag, c_cflag, c_lflag; c_line; c_cc[19]; c_ispeed, c_ospeed }, read by TCGETS2.
# Its speeds are plain numbers, also of rates that have no constant of their own (4.5 Mbaud).
_TCGETS2, _TERMIOS2 = 0x802C542A, struct.Struct("4I20s2I")


class PtyPort(_Named):
    """A pseudo-terminal with a link to it.

    link: name of the port. Raises PortError where the system gives no pseudo-terminal.
    """

    def __init__(self, link: Path) -> None:
        super().__init__(link)
        try:
            self._ours, self._theirs = os.openpty()
        except OSError as trouble:
            raise PortError(f"no pseudo-terminal to be had ({trouble}); expected a system with /dev/pts") from trouble
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self.terminal = os.ttyname(self._theirs)
        self._make_link()

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

    def _close_ends(self) -> None:
        os.close(self._ours)
        os.close(self._theirs)


_TICK = 1e-3
"""How long it sleeps at most [s]; in between the plant moves on, so that no answer has to wait for much of it."""
_TOGETHER = 0.2e-3
"""How long a byte waits for one that is due soon, to be sent in one go [s]."""
_SPARE = 0.3e-3
"""How long there must be nothing to do [s] for work to be done ahead."""
_AHEAD = 1e-3
"""How far the answers to an instruction are worked out before their time [s]."""
_LARGEST_STEP = 0.25
"""How much emulated time passes at once [s]; where the computer took longer, the emulated time is held up."""
_BACKLOG = 4096
"""How many bytes wait for a master that does not read; more are lost, as in an adapter."""
_QUIET = 0.5
"""After how long a silence a master may have left, and what it claimed is given back [s]."""
_LOOK = 0.05
"""How long one look at a master lasts that shares the clock and says nothing [s]."""
_LEAST_STEP = 1e-5
"""By how much time passes at least where something is due and nothing comes of it [s]."""


class PtyServer:
    """Serves a bench on a pseudo-terminal until it is stopped. Its times are emulated.

    link: name of the port. shared: the clock that it shares with a master that wants to; None: with nobody. slipped: by
    how much the emulated time was held up [s], because the computer did not keep pace. lost: bytes that no master read
    in time. Raises FileError, PortError like `PtyPort`.
    """

    def __init__(self, rig: EmulatedRig, link: Path, *, clock: Clock, shared: ClockSocket | None = None) -> None:
        self._rig, self._clock = rig, clock
        self.link = link
        self._port: PtyPort | None = PtyPort(link)
        self._shared, self._is_shared, self._silent = shared, False, 0.0
        self._reached = rig.time
        self.restart_time()
        self._heard = -math.inf
        self._outbox = bytearray()
        self._held_until = math.inf
        self._stopping = False
        self.slipped = 0.0
        self.lost = 0

    @property
    def terminal(self) -> str | None:
        """The terminal that the link leads to; None while unplugged."""
        return self._port.terminal if self._port is not None else None

    def restart_time(self) -> None:
        """Take the present moment for where the emulated time stands: what came before was preparation."""
        self._start = self._clock.now() - self._reached

    def clock_time(self, time: float) -> float:
        """Return what the clock showed, or will show, at an emulated time [s]; not where time was held up since."""
        return self._start + time

    def stop(self) -> None:
        """Let `run` return soon; may be called from a signal handler or another thread."""
        self._stopping = True

    def run(self, until: float = math.inf) -> None:
        """Serve until stopped, or until an emulated time [s]."""
        self.restart_time()
        while not self._stopping and self._reached < until:
            self.step()

    def close(self) -> None:
        """Hang up and remove the link; may be called again."""
        if self._port is not None:
            self._port.close()
            self._port = None
        if self._shared is not None:
            self._shared.close()

    def step(self) -> None:
        """Do what is due, then sleep until there is more to do or a master sends something."""
        if self._shared is not None:
            if ask := self._shared.ask():
                self._obey(ask, self._shared)
                return
            if self._is_shared and self._shared.is_taken:
                self._await_master(self._shared)
                return
            self._is_shared = False
        now = self._go_on()
        if self._port is None:
            self._clock.wait_until(self._clock.now() + _TICK)
            return
        if self._has_news(now):
            del self._outbox[: self._port.write(bytes(self._outbox))]
            self._held_until = now + _TICK if self._outbox else math.inf
        soonest = min(self._rig.next_event(), self._held_until, now + _TICK)
        if soonest - now > _SPARE:
            self._rig.catch_up()
        ends: list[Any] = [self._port, *([] if self._shared is None else self._shared.ends)]
        if select.select(ends, [], [], max(0.0, soonest - self._now()))[0]:
            self._take(self._port)
            if self._shared is not None and self._shared.wait(0.0):
                self._greet(self._shared, self._port)
        elif now - self._heard > _QUIET:
            self._port.release()
            self._heard = now

    # ---- the clock is the computer's: bytes go through the port

    def _take(self, port: PtyPort) -> None:
        """Take what masters have written, and work out soon enough what follows, so that each answer is there when its
        time comes. On a half-duplex line nobody speaks meanwhile; who does all the same is heard after that."""
        data = port.read()
        self._heard = self._go_on()
        self._receive(data, self._reached)
        while self._reached <= (due := self._rig.line.due) <= self._heard + _AHEAD:
            self._advance(due)

    def _go_on(self) -> float:
        """Let the time pass that has passed; return it [s]."""
        behind = self._now() - self._reached - _LARGEST_STEP
        if behind > 0:
            self._hold_up(behind)
        now = self._now()
        self._advance(max(now, self._reached))
        return now

    # ---- the clock is shared: all goes through its socket

    def _greet(self, shared: ClockSocket, port: PtyPort) -> None:
        """Share the clock from now on with who has come; what others were told is not for it."""
        if not shared.is_taken:
            self._outbox.clear()
            self._held_until = math.inf
            self._is_shared, self._silent = True, 0.0
        shared.greet(self._reached, port.terminal)

    def _await_master(self, shared: ClockSocket) -> None:
        """Let the time stand while the master computes, or is paused; one that is silent for too long counts as lost.

        Looks are counted and not seconds: where this program is paused, so may be the master.
        """
        if shared.wait(_TICK):
            if not shared.has_ended():
                shared.greet(self._reached, "")  # which turns away who has come as well
            return
        self._rig.catch_up()
        if shared.wait(_LOOK):
            return
        self._silent += _LOOK
        if self._silent >= PATIENCE_S:
            self._is_shared = False
            self._hold_up(self._now() - self._reached)

    def _obey(self, ask: Ask, shared: ClockSocket) -> None:
        """Do what a master asks that shares the clock."""
        self._is_shared, self._silent = True, 0.0
        now = max(self._reached, ask.now)
        self._advance(now)
        if ask.what == WROTE:
            self._receive(ask.data, now)
            return
        if ask.what == DO:
            self._rig.do(round(ask.until))
        until = now if ask.what == DO else max(now, ask.until)
        while now < until and not (ask.what == READ and self._has_news(now)):
            due = min(self._rig.next_event(), self._held_until) if ask.what == READ else until
            now = min(until, max(due, now + _LEAST_STEP))
            self._await(now)
            self._advance(now)
        self._gather(now)
        shared.answer(now, bytes(self._outbox))
        self._outbox.clear()
        self._held_until = math.inf

    def _await(self, time: float) -> None:
        """Wait until the clock shows an emulated time [s]; what it is behind by more than a little is held up."""
        behind = self._now() - time
        if behind > _LARGEST_STEP:
            self._hold_up(behind - _LARGEST_STEP)
        elif behind < 0:
            if -behind > _SPARE:
                self._rig.catch_up()
            self._clock.wait_until(self.clock_time(time))

    # ---- either way

    def _receive(self, data: bytes, now: float) -> None:
        """Put bytes on the line at the rate that the master has set on the port, if it has one open."""
        if self._port is not None and (baud := self._port.baud()):
            self._rig.line.host_baud = baud
            self._rig.receive(data, now)

    def _has_news(self, now: float) -> bool:
        """Return whether there is something for the master, and nothing to come that soon goes with it."""
        self._gather(now)
        return bool(self._outbox) and (now >= self._held_until or self._rig.next_event() > self._held_until)

    def _gather(self, now: float) -> None:
        fresh = self._rig.transmit(now)
        if fresh:
            room = max(0, _BACKLOG - len(self._outbox))
            self._outbox += fresh[:room]
            self.lost += len(fresh[room:])
            self._held_until = min(self._held_until, now + _TOGETHER)

    def _advance(self, now: float) -> None:
        """Let time pass up to a moment [s]; the port goes and comes with its plug."""
        self._reached = now
        self._rig.advance(now)
        if self._rig.unplugged and self._port is not None:
            self._outbox.clear()
            self._port.close()
            self._port = None
        elif not self._rig.unplugged and self._port is None:
            self._outbox.clear()
            self._port = PtyPort(self.link)

    def _hold_up(self, seconds: float) -> None:
        """Let so much of the clock's time pass without the emulated time [s]."""
        self.slipped += seconds
        self._start += seconds

    def _now(self) -> float:
        return self._clock.now() - self._start
