"""This is where a loop that must keep time gets the computer to itself, as far as the system lets it."""

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["keeping_time"]


@contextmanager
def keeping_time(*, collecting: bool = False) -> Iterator[bool]:
    """Run the calling thread before others and without garbage collection; give whether the system granted the first.

    collecting: keep the collector at work on what comes, and only what there is already out of its way.

    Real-time priority is asked of Linux (`ulimit -r`, or the capability SYS_NICE); who does not have it runs as usual.
    Collecting garbage pauses a program for longer than a cycle; a loop that makes no cycles of references needs none.
    """
    gc.collect()  # a tenth of a second where JAX is loaded: not yet at a priority that holds up another bench's loop
    gc.freeze()
    if not collecting:
        gc.disable()
    granted = _raise_priority()
    try:
        yield granted
    finally:
        if granted:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        gc.enable()
        gc.unfreeze()


def _raise_priority() -> bool:
    try:
        # Threads that are started meanwhile inherit it: one without it that holds the interpreter would hold up all.
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    except (AttributeError, OSError):  # another system than Linux, or not permitted
        return False
    return True
