"""This is where a run is shown on stderr while it goes on."""

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from sinew.apps.console import progress_bar, remark

if TYPE_CHECKING:
    from sinew.bench.listeners import Stream

__all__ = ["Screen", "showing", "state_line"]


@contextmanager
def showing(*, tracking: bool = False) -> "Iterator[Screen]":
    """Give what shows a run: remarks, and on a terminal a bar, or the state of a run that tracks."""
    from sinew.bench.listeners import Stream

    with ExitStack() as stack:
        writer = _Follower() if tracking else _Writer(stack.enter_context(progress_bar("run")))
        stream = Stream([writer])
        try:
            yield Screen(stream)
        finally:
            stream.close()
            writer.end()


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
        elif kind not in ("end", "track", "health"):  # the summary says it, or a dashboard shows it
            remark(sentence)

    def end(self) -> None:
        """Do nothing: the bar goes by itself."""


class _Follower(_Writer):
    """Writes the state of the tracking on a line of its own, on a terminal."""

    def __init__(self) -> None:
        super().__init__(lambda _done, _total: None)
        self._is_shown = False

    def on_event(self, kind: str, sentence: str) -> None:
        """Write an event, or the state in the place of the last one."""
        if kind != "track":
            self.end()
            super().on_event(kind, sentence)
        elif sys.stderr.isatty():
            sys.stderr.write(f"\r\x1b[2K{state_line(json.loads(sentence))}")
            sys.stderr.flush()
            self._is_shown = True

    def end(self) -> None:
        """Leave the state on its line, and begin another."""
        if self._is_shown:
            sys.stderr.write("\n")
            self._is_shown = False


def state_line(state: dict[str, Any]) -> str:
    """Return the state of a tracking drive as one line."""

    def number(name: str, form: str, unit: str) -> str:
        return f"{'-' if state.get(name) is None else format(state[name], form)}{unit}"

    lock = "locked" if state["is_locked"] else ("coasting" if state.get("is_coasting") else "searching")
    parts = [
        number("elapsed_s", "6.1f", " s"),
        f"{lock:9s}",
        number("frequency_hz", ".3f", " Hz"),
        f"error {number('phase_error_deg', '+5.1f', '°')}",
        f"torsion {number('torsion_deg', '5.1f', '°')}",
        f"command {number('command_deg', '4.1f', '°')}",
        number("pretension_mm", "5.2f", " mm"),
    ]
    if state.get("wanted_hz") is not None:
        parts.append(f"wanted {number('wanted_hz', '.3f', ' Hz')}")
    return "  ".join(parts)
