"""An emulated bench on a pseudo-terminal, or a socket, in real time.

To whom it shares its clock with, time passes as `sinew.hardware.shared_clock` says; to all others by itself.
"""

import contextlib
import fcntl
import math
import os
import select
import selectors
import shutil
import socket
import struct
import sys
import tempfile
import termios
import tty
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from sinew.emulator.faults import FaultyRig
from sinew.hardware.bus import Clock
from sinew.hardware.shared_clock import ANSWER, ASK, HELLO, PATIENCE_S, READ, SUFFIX, WROTE
from sinew.measure.errors import FileError, PortError, SpecError


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


class _Named(ABC):
    """What stands behind a link. terminal: where the link leads to.

    Raises FileError where something stands there that is no stale link, or where the folder takes no link.
    """

    terminal: str

    def __init__(self, link: Path) -> None:
        self.link = link
        refuse_taken(link)

    def _make_link(self) -> None:
        try:
            make_link(self.link, self.terminal)
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


class _Listener(_Named):
    """A listening socket with a link to it, and one master at most. Raises PortError where the system gives none."""

    def __init__(self, link: Path, name: str) -> None:
        super().__init__(link)
        self._folder = Path(tempfile.mkdtemp(prefix="sinew-"))  # paths of sockets are short, and nobody else's
        self.terminal = str(self._folder / name)
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
        self._make_link()

    def fileno(self) -> int:
        """Return the descriptor that is readable when a master has come, said something or left."""
        return self._ready.fileno()

    def _accept(self) -> bool:
        """Return whether a master has come that is served now; turn it away while another is served."""
        try:
            newcomer, _ = self._listening.accept()
        except OSError:
            return False
        if self._master is not None:
            newcomer.close()
            return False
        newcomer.setblocking(False)
        self._master = newcomer
        self._ready.register(newcomer, selectors.EVENT_READ)
        return True

    def _receive(self, most: int) -> bytes:
        """Return what the master has sent and nobody has read; b"" where there is nothing, or it has left."""
        if self._master is None:
            return b""
        try:
            data = self._master.recv(most)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._part()
        return data

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


# The emulated bench's end of the clock that it shares with its master; see `sinew.hardware.shared_clock`.


class Ask(NamedTuple):
    """What the master says: WROTE, WAIT or READ; its time [s], until when [s], how many bytes it has written so far."""

    what: int
    now: float
    until: float
    written: int


class ClockSocket(_Listener):
    """A listening socket beside the port, with a link to it. One master is served; another is turned away.

    port: name of the port.
    """

    def __init__(self, port: Path) -> None:
        super().__init__(port.with_name(port.name + SUFFIX), "clock")
        self._heard = b""

    @property
    def is_taken(self) -> bool:
        """Whether a master shares the clock."""
        return self._master is not None

    def wait(self, seconds: float) -> bool:
        """Return whether there is something to look at; waits for it at most so long [s]."""
        return bool(self._ready.select(seconds))

    def greet(self, now: float, terminal: str) -> bool:
        """Take a master that has come and tell it the time [s] and the terminal; return whether there is a new one."""
        if not self._accept():
            return False
        self._heard = b""
        name = terminal.encode()
        self._send(HELLO.pack(now, len(name)) + name)
        return True

    def ask(self) -> Ask | None:
        """Return what the master says next, None where it says nothing or has left."""
        self._heard += self._receive(ASK.size - len(self._heard))
        if self._master is None or len(self._heard) < ASK.size:
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

    def _send(self, data: bytes) -> None:
        try:
            if self._master is not None:
                self._master.sendall(data)
        except OSError:
            self._part()


# What a person would do at a real bench is asked of the emulated one by a word: plug a motor in, turn the lever.

HANDS = ".hands"
"""What the socket of the hands is called behind the name of the port."""


class HandsSocket(_Listener):
    """A listening socket beside the port, with a link to it. One line asks for an act, one answers: done, or why not.

    port: name of the port. do: carries an act out, or raises SpecError.
    """

    def __init__(self, port: Path, do: Callable[[str], None]) -> None:
        super().__init__(port.with_name(port.name + HANDS), "hands")
        self._do = do
        self._heard = b""

    def serve(self) -> None:
        """Do what was asked since the last call."""
        if not self._ready.select(0):
            return
        if self._accept():
            self._heard = b""
        self._heard += self._receive(_AT_ONCE)[:_LONGEST_ACT]
        while b"\n" in self._heard and self._master is not None:
            line, _, self._heard = self._heard.partition(b"\n")
            try:
                self._do(line.decode(errors="replace"))
                answer = "done"
            except SpecError as refusal:
                answer = str(refusal)
            with contextlib.suppress(OSError):
                self._master.sendall(answer.encode() + b"\n")


_LONGEST_ACT = 256


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

    def forget(self) -> None:
        """Drop what was sent and no master has read."""
        termios.tcflush(self._theirs, termios.TCIFLUSH)

    def _close_ends(self) -> None:
        os.close(self._ours)
        os.close(self._theirs)


# A socket of this computer stands in for a serial port, for masters that keep time on a busy computer.
#
# Other programs than Sinew's cannot open it; for them there is `PtyPort`. One master is served at a
# time: it hears a plus sign first, the next one is turned away.


class SocketPort(_Listener):
    """A listening socket with a link to it.

    link: name of the port. host_baud: rate that a master's adapter is taken to have [1/s], for none is told.
    """

    def __init__(self, link: Path, host_baud: int) -> None:
        super().__init__(link, "port")
        self._baud = host_baud

    def baud(self) -> int:
        """Return the rate that a master is taken to have set [1/s]; 0 where there is none."""
        return self._baud if self._master is not None else 0

    def read(self) -> bytes:
        """Return what the master has sent and nobody has read; b"" where there is nothing."""
        if self._accept():
            self._greet()
        return self._receive(_AT_ONCE)

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

    def _greet(self) -> None:
        assert self._master is not None
        with contextlib.suppress(OSError):
            self._master.send(b"+")


Port = PtyPort | SocketPort
"""What a master opens."""

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
    """Serves a bench on a pseudo-terminal, or another kind of port, until it is stopped. Its times are emulated.

    link: name of the port. speed: emulated seconds in a second of `clock`. make_port: makes the port of that name.
    shared: the clock that it shares with a master that wants to; None: with nobody. hands: who does at the bench what
    is asked of a person; None: nobody.
    slipped: by how much the emulated time was held up [s], because the
    computer did not keep pace. lost: bytes that no master read in time.
    Raises FileError, PortError like `PtyPort`.
    """

    def __init__(
        self,
        rig: FaultyRig,
        link: Path,
        *,
        clock: Clock,
        speed: float = 1.0,
        make_port: Callable[[Path], Port] = PtyPort,
        shared: ClockSocket | None = None,
        hands: HandsSocket | None = None,
    ) -> None:
        self._hands = hands
        self._rig, self._clock, self._speed = rig, clock, speed
        self.link, self._make_port = link, make_port
        self._port: Port | None = make_port(link)
        self._shared, self._is_shared, self._silent = shared, False, 0.0
        self._written = self._sent = 0
        self._inbox = bytearray()  # of what was announced, or will be
        self._reached = rig.time
        self.restart_time()
        self._heard = -math.inf
        self._outbox = bytearray()
        self._held_until = math.inf
        self._stopping = False
        self.slipped = 0.0
        self.lost = 0

    @property
    def is_open(self) -> bool:
        """Whether there is a port that a master can open."""
        return self._port is not None

    @property
    def terminal(self) -> str | None:
        """The terminal that the link leads to; None while unplugged."""
        return self._port.terminal if self._port is not None else None

    def restart_time(self) -> None:
        """Take the present moment for where the emulated time stands: what came before was preparation."""
        self._start = self._clock.now() - self._reached / self._speed

    def clock_time(self, time: float) -> float:
        """Return what the clock showed, or will show, at an emulated time [s]; not where time was held up since."""
        return self._start + time / self._speed

    def stop(self) -> None:
        """Let `run` return soon; may be called from a signal handler or another thread."""
        self._stopping = True

    def run(self, until: float = math.inf) -> None:
        """Serve until stopped, or until an emulated time [s]."""
        self.restart_time()
        while not self._stopping and self._reached < until:
            self.step()

    def step(self) -> None:
        """Do what is due, then sleep until there is more to do or a master sends something."""
        if self._hands is not None:
            self._hands.serve()
        if self._shared is not None:
            if ask := self._shared.ask():
                self._obey(ask, self._shared)
                return
            if self._is_shared and self._shared.is_taken:
                self._await_master(self._shared)
                return
            if self._is_shared and self._port is not None:
                self._port.read()  # the master has ended: so has what it left on the port
            self._is_shared = False
        now = self._go_on()
        if self._rig.unplugged == self.is_open:
            self._change_plug()
        if self._port is None:
            self._clock.wait_until(self._clock.now() + _TICK)
            return
        self._send(self._port, now)
        soonest = min(self._rig.next_event(), self._held_until, now + _TICK * self._speed)
        if soonest - now > _SPARE * self._speed:
            self._rig.catch_up()
        if self._wait(self._port, (soonest - self._now()) / self._speed):
            if self._shared is not None:
                self._greet(self._shared, self._port)
                if self._shared.is_taken:
                    return  # what it says comes before what it writes
            self._take(self._port)
        elif now - self._heard > _QUIET * self._speed:
            self._port.release()
            self._heard = now

    def close(self) -> None:
        """Hang up and remove the link; may be called again."""
        self._unplug()
        for other in (self._shared, self._hands):
            if other is not None:
                other.close()

    def _unplug(self) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None

    def _greet(self, shared: ClockSocket, port: Port) -> None:
        """Share the clock from now on with who has come; what others have left on the port is not for it."""
        if not shared.is_taken and shared.wait(0.0):
            self._take(port)
            port.forget()
            self._outbox.clear()
            self._held_until = math.inf
            self._inbox.clear()
            self._written = self._sent = 0
            self._is_shared, self._silent = True, 0.0
        shared.greet(self._reached, port.terminal)

    def _await_master(self, shared: ClockSocket) -> None:
        """Let the time stand while the master computes, or is paused; one that is silent for too long counts as lost.

        Looks are counted and not seconds: where this program is paused, so may be the master.
        """
        if shared.wait(_TICK):
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
        now = self._advance(max(self._reached, ask.now))
        if ask.what == WROTE:
            self._receive(ask, now)
            return
        if self._port is not None:
            self._inbox += self._port.read()  # which turns away other masters that have come to a socket
        until = max(now, ask.until)
        while now < until and not (ask.what == READ and self._has_news(now)):
            due = min(self._rig.next_event(), self._held_until) if ask.what == READ else until
            now = self._advance(self._await(min(until, max(due, now + _LEAST_STEP))))
        self._gather(now)
        self._deliver()
        shared.answer(now, self._sent)

    def _has_news(self, now: float) -> bool:
        """Return whether there is something for the master, and nothing to come that soon goes with it."""
        self._gather(now)
        return bool(self._outbox) and (now >= self._held_until or self._rig.next_event() > self._held_until)

    def _gather(self, now: float) -> None:
        fresh = self._rig.transmit(now)
        if fresh:
            self._outbox += fresh
            self._held_until = min(self._held_until, now + _TOGETHER * self._speed)

    def _deliver(self) -> None:
        """Send what there is, and count it."""
        if self._outbox and self._port is not None:
            took = self._port.write(bytes(self._outbox))
            self._sent += took
            self.lost += len(self._outbox) - took
        self._outbox.clear()
        self._held_until = math.inf

    def _receive(self, ask: Ask, now: float) -> None:
        """Take the bytes that the master has announced, however long the port takes to pass them on."""
        count, looks = ask.written - self._written, 0
        self._written = ask.written
        while self._port is not None and len(self._inbox) < count and looks < PATIENCE_S / _LOOK:
            self._inbox += self._port.read()
            if len(self._inbox) < count:
                if self._shared is None or self._shared.has_ended():
                    break
                looks += not self._wait(self._port, _LOOK)
        data = bytes(self._inbox[:count])
        del self._inbox[:count]
        if self._port is not None and (baud := self._port.baud()):
            self._rig.line.host_baud = baud
            self._rig.receive(data, now)

    def _advance(self, now: float) -> float:
        """Let time pass up to a moment [s], and return it."""
        self._reached = now
        self._rig.advance(now)
        if self._rig.unplugged == self.is_open:
            self._change_plug()
        return now

    def _await(self, time: float) -> float:
        """Return an emulated time [s], but not before the clock shows it."""
        behind = self._now() - time
        if behind > _LARGEST_STEP:
            self._hold_up(behind - _LARGEST_STEP)
        elif behind < 0:
            if -behind > _SPARE * self._speed:
                self._rig.catch_up()
            self._clock.wait_until(self.clock_time(time))
        return time

    def _hold_up(self, seconds: float) -> None:
        """Let so much of the clock's time pass without the emulated time [s, emulated]."""
        self.slipped += seconds
        self._start += seconds / self._speed

    def _go_on(self) -> float:
        """Let the time pass that has passed; return it [s]."""
        now = self._now()
        behind = now - self._reached - _LARGEST_STEP
        if behind > 0:
            self._hold_up(behind)
            now -= behind
        self._reached = max(now, self._reached)
        self._rig.advance(self._reached)
        return now

    def _now(self) -> float:
        return (self._clock.now() - self._start) * self._speed

    def _change_plug(self) -> None:
        self._outbox.clear()
        if self._port is None:
            self._port = self._make_port(self.link)
        else:
            self._unplug()

    def _send(self, port: Port, now: float) -> None:
        """Send what has reached the master, except that bytes wait a little for others that come soon."""
        fresh = self._rig.transmit(now)
        if fresh:
            room = _BACKLOG - len(self._outbox)
            self._outbox += fresh[: max(0, room)]
            self.lost += max(0, len(fresh) - room)
            self._held_until = min(self._held_until, now + _TOGETHER * self._speed)
        if self._outbox and (now >= self._held_until or self._rig.next_event() > self._held_until):
            del self._outbox[: port.write(bytes(self._outbox))]
            self._held_until = now + _TICK * self._speed if self._outbox else math.inf

    def _wait(self, port: Port, seconds: float) -> bool:
        ends: list[Port | ClockSocket] = [port]
        if self._shared is not None and not self._is_shared:
            ends.append(self._shared)
        return bool(select.select(ends, [], [], max(0.0, seconds))[0])

    def _take(self, port: Port) -> None:
        data = port.read()
        self._heard = self._go_on()
        baud = port.baud()
        if baud:
            self._rig.line.host_baud = baud
            self._rig.receive(data, self._reached)
            self._answer_ahead(self._heard + _AHEAD * self._speed)

    def _answer_ahead(self, until: float) -> None:
        """Work out by `until` [s] what follows from what was heard, so that each answer is there when its time comes.

        On a half-duplex line nobody speaks meanwhile; who does all the same is heard after what was worked out.
        """
        while self._reached <= (due := self._rig.line.due) <= until:
            self._reached = due
            self._rig.advance(due)
