"""Functions for a worker's process to run in tests: ones that end it, fail, or take long."""

import os
import time
from pathlib import Path

from tests.patience import until


def process() -> int:
    """The process it runs in."""
    return os.getpid()


def priority() -> int:
    """The niceness of that process."""
    return os.getpriority(os.PRIO_PROCESS, 0)


def die_once(mark: str) -> str:
    """End the process at the first call, answer at the second."""
    if not Path(mark).exists():
        Path(mark).touch()
        os._exit(1)
    return "answered"


def die() -> None:
    """End the process."""
    os._exit(1)


def fail() -> None:
    """Raise what no user can put right."""
    raise ValueError("no such thing")


def note(path: str, what: str) -> str:
    """Write down that it ran; the first goes on when it may: others queue meanwhile."""
    with Path(path).open("a", encoding="utf-8") as notes:
        notes.write(f"{what}\n")
    if what == "0":
        until(Path(f"{path}.go").exists)
    return what


def hang() -> None:
    """Take longer than anybody waits."""
    time.sleep(600)


def fill() -> int:
    """Ask for more memory than a worker may have, without using it."""
    return len(bytearray((5 << 30) + ((os.cpu_count() or 1) << 26)))
