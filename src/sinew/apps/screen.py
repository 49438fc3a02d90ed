"""This is where a run is shown on stderr while it goes on."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from sinew.apps.console import progress_bar, remark

if TYPE_CHECKING:
    from sinew.bench.listeners import Stream

__all__ = ["Screen", "showing"]


@contextmanager
def showing() -> "Iterator[Screen]":
    """Give what shows a run: remarks, and on a terminal a bar."""
    from sinew.bench.listeners import Stream

    with progress_bar("run") as bar:
        stream = Stream([_Writer(bar)])
        try:
            yield Screen(stream)
        finally:
            stream.close()


class Screen:
    """Takes a run's events and progress, and returns at once; a Listener.

    Another thread writes: a terminal that is stopped (Ctrl-S) holds up whoever writes to it, and one that is closed
    raises, neither of which may reach the bench's cycle.
    """

    def __init__(self, stream: "Stream") -> None:
        self._stream = stream

    def on_sample(self, sample: Any) -> None:
        """Do nothing."""

    def on_event(self, kind: str, sentence: str) -> None:
        """Take an event."""
        self._stream.on_event(kind, sentence)

    def progress(self, done: float, total: float) -> None:
        """Take how far the plan is [s]."""
        self._stream.on_event("progress", json.dumps([done, total]))


class _Writer:
    """Writes what happens besides samples."""

    def __init__(self, bar: Callable[[float, float], None]) -> None:
        self._bar = bar

    def on_sample(self, sample: Any) -> None:
        """Do nothing."""

    def on_event(self, kind: str, sentence: str) -> None:
        """Write an event."""
        if kind == "progress":
            self._bar(*json.loads(sentence))
        elif kind == "pretension":
            result = json.loads(sentence)
            remark(f"pretension {result['asked_mm']:g} mm is set, tilt {result['tilt_deg']:.2f}°")
        elif kind != "end":  # the summary says it
            remark(sentence)
