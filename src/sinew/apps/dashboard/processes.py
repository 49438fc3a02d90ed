"""Other processes that the dashboard holds on to: those it began, and those that a steward before it began."""

import json
import os
import resource
import select
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Protocol

import psutil

from sinew.apps.run_control import own_text
from sinew.measure.errors import SpecError
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_plan, parse_rig

__all__ = [
    "UNKNOWN",
    "Adopted",
    "Process",
    "adopt",
    "adopt_from",
    "answer_specs",
    "await_end",
    "end_process",
    "read_pid",
    "read_specs",
    "sinew_command",
    "spawn",
    "write_pid",
]

UNKNOWN = 1 << 16
"""Stands for an exit status that nobody can tell."""

_LOOK_S = 0.005
_READ_S, _READ_CPU_S = 120.0, 20
_READ_BYTES = 1 << 30
_READ_HERE = 48 * 1024  # characters; a rig with a calibration has some twelve thousand
_BEGAN_S = 2.0  # the system counts from its own start, whose date moves a little with the clock


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


def read_specs(plan: str, rig: str) -> tuple[str, RigSpec]:
    """Return the name of the plan and the rig that two texts hold; long ones are read by a process of its own.

    What others wrote may keep its reader busy, or fill its memory; whoever answers for the stop reads no more of it
    than takes some hundredths of a second. Raises SpecError where a text is none, or its reader takes too long.
    """
    if len(plan) + len(rig) <= _READ_HERE:
        return parse_plan(plan, "the plan").name, parse_rig(rig, "the rig")
    asked = json.dumps({"plan": plan, "rig": rig})
    command = [sys.executable, "-P", "-c", f"from {__name__} import answer_specs; answer_specs()"]
    try:
        done = subprocess.run(command, input=asked, capture_output=True, text=True, timeout=_READ_S, check=False)
        told = json.loads(done.stdout)
    except (subprocess.TimeoutExpired, ValueError, OSError) as trouble:
        raise SpecError("the plan or the rig takes too long or too much memory to read; make it shorter") from trouble
    if "trouble" in told:
        raise SpecError(told["trouble"])
    return told["plan"], RigSpec.model_validate_json(told["rig"])


def answer_specs() -> None:
    """Read what `read_specs` asks on stdin, and answer on stdout."""
    for what, most in ((resource.RLIMIT_DATA, _READ_BYTES), (resource.RLIMIT_CPU, _READ_CPU_S)):
        _, hard = resource.getrlimit(what)
        resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))
    asked = json.load(sys.stdin)
    try:
        plan, rig = parse_plan(asked["plan"], "the plan"), parse_rig(asked["rig"], "the rig")
        told = {"plan": plan.name, "rig": rig.model_dump_json()}
    except SpecError as trouble:
        told = {"trouble": str(trouble)}
    print(json.dumps(told))


def write_pid(file: Path, pid: int) -> None:
    """Write down which process belongs to a folder, and when it began, for a steward after us. Raises OSError."""
    try:
        began = psutil.Process(pid).create_time()
    except psutil.Error as error:
        raise OSError(f"process {pid} is gone: {error}") from error
    file.unlink(missing_ok=True)
    with file.open("x", encoding="utf-8") as made:
        made.write(f"{pid} {began!r}\n")


def read_pid(file: Path) -> tuple[int, float] | None:
    """Return (number, begin [s since 1970]) of the process in a file of ours, or None where there is none."""
    try:
        pid, began = own_text(file).split()
        return int(pid), float(began)
    except (OSError, ValueError):
        return None


def adopt(pid: int, words: Sequence[str], began: float | None = None) -> Adopted | None:
    """Return the process of that number; None where it is gone, another one has the number, or it is not our own.

    words: each an argument of its command line. began: when it began [s since 1970]; None where the number comes from
    the system, and not out of a file.
    """
    if pid <= 1:
        return None
    try:
        process = Adopted(
            pid
        )  # from here on the number cannot come to mean another one where the system has descriptors
    except OSError:
        return None
    if process.poll() is None and _is_ours(pid, words, began):
        return process
    process.close()
    return None


def adopt_from(file: Path, words: Sequence[str]) -> Adopted | None:
    """Return the process that a file of ours names, as `adopt` does."""
    named = read_pid(file)
    return None if named is None else adopt(named[0], words, named[1])


def _is_ours(pid: int, words: Sequence[str], began: float | None) -> bool:
    try:
        process = psutil.Process(pid)
        is_same = began is None or abs(process.create_time() - began) < _BEGAN_S
        return is_same and process.uids().real == os.getuid() and set(words) <= set(process.cmdline())
    except psutil.Error:
        return False


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
