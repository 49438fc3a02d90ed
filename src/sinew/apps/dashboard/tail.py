"""This is where a journal is followed while a run writes to it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sinew.bench.journal_reader import JournalReader, Stretch

__all__ = ["JournalTail", "News"]

Floats = NDArray[np.float64]

_MOST_ROWS = 4000


@dataclass(frozen=True)
class News:
    """What a journal has that it had not: rows by column, as `JournalReader.samples` gives them; events as (id, kind,
    sentence); the segment that was begun last, or None; how many groups are finished."""

    rows: dict[str, Floats]
    events: list[tuple[int, str, str]]
    segment: Stretch | None
    groups_done: int


class JournalTail:
    """Follows one journal.

    path: of the journal. backlog: how many of the samples that there are already are read first.
    Every look is a short read transaction of its own, which keeps nothing from whoever writes. Raises FileError where
    it is no journal; sqlite3.OperationalError may come from a look at a disk that fails.
    """

    def __init__(self, path: Path, backlog: int = 0) -> None:
        self._reader = JournalReader(path)
        self.plan_toml, self.rig_toml = self._reader.plan_toml, self._reader.rig_toml
        self.found = self._reader.last_sample()  # what was there before we came
        self._last = max(0, self.found - backlog)
        self._event = 0
        source = self._reader.attrs.get("source")
        self.source = None if source is None else str(source)

    def look(self) -> News:
        """Return what is new, at most 4000 rows at a time."""
        reader = self._reader
        end = min(reader.last_sample(), self._last + _MOST_ROWS)
        rows = reader.samples(self._last + 1, end + 1) if end > self._last else {}
        self._last = max(self._last, end)
        events = reader.events_after(self._event)
        if events:
            self._event = events[-1][0]
        return News(rows, events, reader.newest_stretch(), reader.count_finished())

    def close(self) -> None:
        """Give the file back."""
        self._reader.close()
