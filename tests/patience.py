"""Patience that follows the load: how long a test waits for what another thread or process must do.

A second of wall time is as much work as the computer has room for. Where twelve programs want two cores, a program that
computes for two seconds needs twelve; a time-out in wall seconds fails there, and says nothing about the program. So
time counts here by the share of a core that each program may have at that moment, and a wait ends, bounded, after
`MOST` times as long at the latest. What comes in time costs nothing.
"""

import os
import select
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

MOST = 15.0
"""A wait takes at most so many times as long as asked for."""
LONG_S = 300.0
"""For time-outs that take a number only, of sockets and HTTP: what does not come by then hangs [s]."""
_LOOK_S = 0.01


class HasFileno(Protocol):
    """What `select` takes."""

    def fileno(self) -> int:
        """Return the descriptor."""
        ...


def share() -> float:
    """Return which share of a core a program that computes has right now, 1 where nothing else does."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        runnable = float(Path("/proc/loadavg").read_text(encoding="ascii").split()[3].partition("/")[0])
    except OSError:  # not Linux
        runnable = os.getloadavg()[0]
    return min(1.0, cores / max(1.0, runnable))


class Patience:
    """So many seconds of an idle computer. clock: wall time [s]; share: of a core, see `share`."""

    def __init__(
        self, seconds: float, clock: Callable[[], float] = time.monotonic, share: Callable[[], float] = share
    ) -> None:
        self._clock, self._share = clock, share
        self._left, self._last = seconds, clock()
        self._end = self._last + MOST * seconds

    def is_over(self) -> bool:
        """Return whether it has been long enough; to be asked again and again."""
        now = self._clock()
        self._left -= (now - self._last) * self._share()
        self._last = now
        return self._left <= 0 or now >= self._end


def until(claim: Callable[[], Any], seconds: float = 30.0, what: str = "it does not come to pass") -> Any:
    """Return the first true answer. Raises AssertionError when patience is over."""
    patience = Patience(seconds)
    while not (answer := claim()):
        assert not patience.is_over(), what
        time.sleep(_LOOK_S)
    return answer


def comes(stream: HasFileno | None, seconds: float = 60.0) -> bool:
    """Return whether there is something to read, or an end, before patience is over."""
    assert stream is not None
    patience = Patience(seconds)
    while not select.select([stream], [], [], 0.1)[0]:
        if patience.is_over():
            return False
    return True


def await_end(process: "subprocess.Popen[Any]", seconds: float = 60.0) -> int:
    """Return the status of a process that is about to end. Raises AssertionError when patience is over."""
    until(lambda: process.poll() is not None, seconds, f"{process.args!r} does not end")
    return int(process.returncode)


def communicate(process: "subprocess.Popen[Any]", seconds: float = 60.0) -> tuple[Any, Any]:
    """Return stdout and stderr of a process that is about to end."""
    patience = Patience(seconds)
    while True:
        try:
            return process.communicate(timeout=0.5)
        except subprocess.TimeoutExpired:
            if patience.is_over():
                process.kill()
                raise


def finished(
    command: Sequence[Any], seconds: float = 60.0, *, check: bool = False, **options: Any
) -> "subprocess.CompletedProcess[str]":
    """Return what a command said, when it has ended; as `subprocess.run` with captured text."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True} | options
    with subprocess.Popen(list(command), **options) as process:
        try:
            out, err = communicate(process, seconds)
        finally:
            process.kill()
    done = subprocess.CompletedProcess(list(command), process.returncode, out, err)
    if check:
        done.check_returncode()
    return done
