"""This is where the dashboard holds on to other processes: those it began, and those that a steward before it began."""

import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Protocol

__all__ = [
    "UNKNOWN",
    "Adopted",
    "Process",
    "adopt",
    "await_end",
    "end_process",
    "read_pid",
    "sinew_command",
    "spawn",
    "write_pid",
]

UNKNOWN = 1 << 16
"""Stands for an exit status that nobody can tell."""

_LOOK_S = 0.005


class Process(Protocol):
    """A process that may be looked at and ended; `subprocess.Popen` is one."""

    @property
    def pid(self) -> int:
        """Return its number."""

    def poll(self) -> int | None:
        """Return its exit status, or None while it goes on."""

    def send_signal(self, sig: int) -> None:
        """Send it a signal, where it goes on."""


class Adopted:
    """A process that is not our child, so that its exit status stays unknown.

    A number may be given to another process once its owner is gone. Where the system has descriptors of processes
    (Linux), one keeps us from ending the wrong one.
    """

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._file = os.pidfd_open(pid) if sys.platform == "linux" else None

    @property
    def pid(self) -> int:
        """Return its number."""
        return self._pid

    def poll(self) -> int | None:
        """Return `UNKNOWN` once it has ended, else None."""
        if self._file is not None:
            ready = select.poll()
            ready.register(self._file, select.POLLIN)
            return UNKNOWN if ready.poll(0) else None
        try:
            os.kill(self._pid, 0)
        except ProcessLookupError:
            return UNKNOWN
        return None

    def send_signal(self, sig: int) -> None:
        """Send it a signal, where it goes on."""
        with suppress(ProcessLookupError):
            if self._file is not None:
                signal.pidfd_send_signal(self._file, sig)
            else:
                os.kill(self._pid, sig)

    def close(self) -> None:
        """Let go of it; it goes on."""
        if self._file is not None:
            os.close(self._file)
            self._file = None


def sinew_command(*words: str) -> list[str]:
    """Return the command line of a `sinew` command under this interpreter, without what lies in the present folder."""
    return [sys.executable, "-P", "-c", "import sys; from sinew.apps.cli import main; sys.exit(main())", *words]


def spawn(command: Sequence[str], log: Path) -> "subprocess.Popen[bytes]":
    """Begin a process that outlives us and our terminal; what it says goes into a file."""
    with log.open("ab") as file:
        return subprocess.Popen(
            list(command), stdin=subprocess.DEVNULL, stdout=file, stderr=subprocess.STDOUT, start_new_session=True
        )


def write_pid(file: Path, pid: int) -> None:
    """Write down which process belongs to a folder, for a steward after us."""
    file.write_text(f"{pid}\n", encoding="utf-8")


def read_pid(file: Path) -> int | None:
    """Return the process number in a file, or None where there is none."""
    try:
        return int(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def adopt(pid: int | None, words: Sequence[str]) -> Adopted | None:
    """Return the process of that number if all `words` stand in its command line; None where it is gone or another."""
    if pid is None or pid <= 1:
        return None
    try:
        process = Adopted(pid)
    except OSError:
        return None
    if process.poll() is None and all(word in _command_line(pid) for word in words):
        return process
    process.close()
    return None


def await_end(process: Process, seconds: float) -> bool:
    """Return whether a process ends within so many seconds."""
    end = time.monotonic() + seconds
    while process.poll() is None:
        if time.monotonic() >= end:
            return False
        time.sleep(_LOOK_S)
    return True


def end_process(process: Process, seconds: float, first: int = signal.SIGTERM) -> None:
    """End a process: politely, and by force after so many seconds."""
    process.send_signal(first)
    if not await_end(process, seconds):
        process.send_signal(signal.SIGKILL)
        await_end(process, 1.0)


def _command_line(pid: int) -> str:
    if sys.platform == "linux":
        try:
            return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode("utf-8", "replace")
        except OSError:
            return ""
    return subprocess.run(
        ["ps", "-ww", "-o", "args=", "-p", str(pid)], capture_output=True, text=True, check=False
    ).stdout
