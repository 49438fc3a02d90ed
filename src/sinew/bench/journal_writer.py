"""This is where rows reach the disk while the control thread goes on.

A thread owns the connection. The control thread only puts rows into a queue that has no end; a few times a second all
that wait are committed at once. What goes wrong on the disk is kept and told to the control thread at its next call.
"""

import sqlite3
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Any

from sinew.measure.errors import FileError

BATCH_S = 0.1
"""Rows wait at most so long, and the time of one commit, until they are safe from a killed process [s]."""

STALL_S = 5.0
"""A disk that takes nothing for so long counts as lost [s]."""

_START_S = 10.0
_CHECKPOINT = "PRAGMA wal_checkpoint(PASSIVE)"

Row = tuple[Any, ...]


def cannot_write(path: Path, error: object) -> FileError:
    """Return what to say of a journal that cannot be written."""
    return FileError(
        f"cannot write the journal {path}: {error}; see that the folder may be written and its disk has space, "
        "then start the run again (with --resume where it had begun)"
    )


class BatchWriter:
    """Commits rows in the background, in the order in which they were put.

    path: of a journal in WAL mode. now: a clock that never goes back [s].
    Committed rows outlive the process at once, and a power cut from the next checkpoint on.
    """

    def __init__(self, path: Path, now: Callable[[], float] = monotonic) -> None:
        self._path, self._now = path, now
        self._rows: SimpleQueue[tuple[str, Row]] = SimpleQueue()
        self._wake, self._ready = threading.Event(), threading.Event()
        self._closing = False
        self._error: str | None = None
        self._told = False
        self._last_done = now()
        self._put_count = 0
        self._committed = 0
        self._advanced = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="journal", daemon=True)
        self._thread.start()
        if not self._ready.wait(_START_S):
            raise cannot_write(path, f"the disk did not answer within {_START_S:g} s")
        self.refuse_if_failed()

    def put(self, statement: str, row: Row = ()) -> None:
        """Have a row written; returns at once. Raises FileError if an earlier one could not be."""
        self.refuse_if_failed()
        self._rows.put((statement, row))
        self._put_count += 1

    def checkpoint(self) -> None:
        """Have all rows so far made safe from a power cut; returns at once."""
        self.put(_CHECKPOINT)

    def refuse_if_failed(self) -> None:
        """Raise FileError if rows could not be written, or have been waiting too long."""
        if self._error is not None:
            self._told = True
            raise cannot_write(self._path, self._error)
        if self._put_count > self._committed and (waited := self._now() - self._last_done) > STALL_S:
            self._told = True
            raise cannot_write(self._path, f"the disk has taken nothing for {waited:.0f} s")

    def flush(self, timeout_s: float = STALL_S) -> None:
        """Return when every row that was put has been committed. Raises FileError, also after timeout_s."""
        goal = self._put_count
        self._wake.set()
        with self._advanced:
            self._advanced.wait_for(lambda: self._committed >= goal or self._error is not None, timeout_s)
        self.refuse_if_failed()
        if self._committed < goal:
            raise cannot_write(self._path, f"{goal - self._committed} rows still wait after {timeout_s:g} s")

    def close(self, timeout_s: float, last: Sequence[tuple[str, Row]] = ()) -> None:
        """Commit what waits, and these last rows, and close the file, in bounded time.

        Raises FileError if rows were lost and no call has said so yet.
        """
        for row in last:
            self._rows.put(row)
            self._put_count += 1
        self._closing = True
        self._wake.set()
        self._thread.join(timeout_s)
        if self._told:
            return
        if self._thread.is_alive():
            raise cannot_write(self._path, f"{self._put_count - self._committed} rows still wait after {timeout_s:g} s")
        if self._error is not None:
            raise cannot_write(self._path, self._error)

    def _run(self) -> None:
        connection: sqlite3.Connection | None = None
        try:
            connection = sqlite3.connect(self._path, isolation_level=None, timeout=STALL_S)
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = NORMAL")
            self._ready.set()
            while True:
                self._wake.wait(BATCH_S)
                self._wake.clear()
                last = self._closing
                self._commit(connection)
                if last:
                    connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
                    return
        except Exception as error:  # whatever it is, the control thread must hear of it
            self._error = " ".join(str(error).split()) or type(error).__name__
        finally:
            self._ready.set()
            if connection is not None:
                connection.close()
            with self._advanced:
                self._advanced.notify_all()

    def _commit(self, connection: sqlite3.Connection) -> None:
        """Write all rows that wait, in one transaction; rows of one statement that follow each other go together."""
        waiting = self._waiting()
        if waiting:
            connection.execute("BEGIN IMMEDIATE")
            start = 0
            for end in range(1, len(waiting) + 1):
                if end == len(waiting) or waiting[end][0] != waiting[start][0]:
                    statement = waiting[start][0]
                    if statement != _CHECKPOINT:
                        connection.executemany(statement, [row for _, row in waiting[start:end]])
                    start = end
            connection.execute("COMMIT")
        self._last_done = self._now()
        with self._advanced:
            self._committed += len(waiting)
            self._advanced.notify_all()
        if any(statement == _CHECKPOINT for statement, _ in waiting):
            connection.execute(_CHECKPOINT).fetchall()

    def _waiting(self) -> list[tuple[str, Row]]:
        rows: list[tuple[str, Row]] = []
        try:
            while True:
                rows.append(self._rows.get_nowait())
        except Empty:
            return rows
