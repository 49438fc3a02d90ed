"""The clock of an emulated bench, shared with the one program that drives it.

An emulated bench and its master are two programs on one computer, which may leave either of them alone for a while. A
real bench would go on meanwhile; an emulated one shares the computer, so it waits. It owns the time, and time passes
only while its master waits: for a moment (WAIT) or for bytes (READ). What the master computes takes none, nor does a
pause of either, and no faster than the computer's clock does it pass at all.

Beside the port NAME there is a socket NAME.clock. Bytes go through the port as ever; through the socket goes who has
come how far. Master to bench: what (WROTE, WAIT, READ), the master's time, until when, and how many bytes it has
written so far. Bench to master, after WAIT and READ: the time, and how many bytes it has sent so far. In between the
bench's time stands. A port between them that is slow to pass bytes on therefore costs nothing either.

A master that has ended closes the socket, and from then on time passes by itself: the motors' watchdogs trip as they
would. One that is silent for `PATIENCE_S` counts as lost, with the same effect, until it is heard again.
"""

import os
import select
import socket
import struct
import threading
from pathlib import Path
from time import monotonic

from sinew.hardware.bus import MonotonicClock, Transport
from sinew.measure.errors import PortError

SUFFIX = ".clock"
"""What the clock's socket is called behind the name of the port."""

PATIENCE_S = 5.0
"""For so long a bench waits for a master that is silent; only time in which it runs itself counts [s]."""

WROTE, WAIT, READ = 1, 2, 3
ASK = struct.Struct("!BddQ")
ANSWER = struct.Struct("!dQ")
HELLO = struct.Struct("!dH")  # the time, and the length of what follows: the name of the terminal that it belongs to

_STEP_S = 0.1  # so long a wait at once; in between either side sees whether the other is there
_LOOK_S = 0.05
_LOOKS = round(2 * PATIENCE_S / _LOOK_S)
_SILENT_S = 0.5  # after so long without a word the bench may have gone on by itself
_COST_S = 50e-6  # what a call takes in the bench's time: a master that never waits must get on, too


class SharedClock:
    """The time of an emulated bench; a Clock. What waits for it raises PortError where the bench is gone.

    port: name of the port, beside which the clock lies. Raises PortError where nobody answers, or another master is
    served. `now` may be asked from any thread and in signal handlers; all else by the one that owns the bus.
    """

    def __init__(self, port: str) -> None:
        self._port = port
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._lock = threading.Lock()
        self._heard, self._now = monotonic(), 0.0
        self.sent = self.written = 0
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

    def announce(self, count: int) -> None:
        """Say that so many bytes are about to be written to the port."""
        with self._lock:
            self._now += _COST_S
            self.written += count
            self._say(WROTE, self._now)

    def spend(self) -> None:
        """Let the time of a call pass that asks for nothing."""
        self._now += _COST_S

    def close(self) -> None:
        """Leave the bench to itself; may be called again."""
        self._socket.close()

    def _exchange(self, what: int, until: float) -> None:
        self._say(what, until)
        self._now, self.sent = ANSWER.unpack(self._hear(ANSWER.size))
        self._heard = monotonic()

    def _say(self, what: int, until: float) -> None:
        try:
            self._socket.sendall(ASK.pack(what, self._now, until, self.written))
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

    port: that the bytes go through, by the computer's clock.
    """

    def __init__(self, port: Transport, clock: SharedClock) -> None:
        self._port, self._clock = port, clock
        self._computer = MonotonicClock()
        self._got = 0

    def write(self, data: bytes) -> None:
        self._clock.announce(len(data))
        self._port.write(data)

    def read(self, deadline: float) -> bytes:
        clock = self._clock
        clock.spend()
        while self._got == clock.sent and (now := clock.now()) < deadline:
            clock.ask(READ, min(deadline, now + _STEP_S))
        return self._collect()

    def close(self) -> None:
        self._port.close()
        self._clock.close()

    def _collect(self) -> bytes:
        """Return what the bench says that it has sent, however long that takes in the computer's time."""
        data, asked = self._port.read(self._computer.now()), 0
        while self._got + len(data) < self._clock.sent:
            more = self._port.read(self._computer.now() + _LOOK_S)
            data, asked = data + more, 0 if more else asked + 1
            if asked > _LOOKS:
                missing = self._clock.sent - self._got - len(data)
                raise PortError(f"{missing} bytes from the emulated bench got lost on their way; start it again")
        self._got = self._clock.sent
        return data


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
