"""The journal of a run, written while it happens and read beside it, so that whatever ends it, no sample is lost.

The journal is the record; recordings are made from it (`sinew.bench.record.conversion`). It is an SQLite file in WAL
mode: of the formats that were killed with SIGKILL only it and flushed text lost nothing committed.
"""

import json
import os
import sqlite3
import threading
from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from queue import Empty, SimpleQueue
from time import monotonic
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np

from sinew.bench.record.sample import (
    APPLICATION_ID,
    JOURNAL_VERSION,
    MISSING,
    REGISTERS,
    Sample,
    insert_sample,
    sample_columns,
    sample_row,
    statements,
)
from sinew.measure.arrays import Array
from sinew.measure.errors import FileError
from sinew.measure.events import STATES, Contact, Event, read_event
from sinew.measure.recording import Segment
from sinew.plan.toml import parse_rig

CLOSE_S = 10.0
"""Closing a journal takes at most so long [s]."""

_BEGIN = (
    "INSERT INTO segments (id, session, plan_group, attempt, kind, pretension_mm, frequency_hz, amplitude_deg, "
    "repeat, state, first_sample, note) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, 'running', ?, '')"
)
_END = "UPDATE segments SET state = ?, end_sample = ?, started_s = ?, ended_s = ?, note = ? WHERE id = ?"
_FINISH = "INSERT OR REPLACE INTO finished (plan_group, session, attempt) VALUES (?, ?, ?)"
_META = "INSERT OR REPLACE INTO meta VALUES (?, ?)"
_EVENT = "INSERT INTO events (session, time_s, date, kind, sentence) VALUES (?, ?, ?, ?, ?)"
_COUNT = "INSERT OR REPLACE INTO counts (session, name, number) VALUES (?, ?, ?)"


class Journal:
    """The live record of a run. Made by `Journal.create` or `Journal.open`; one run at a time writes to a file.

    The calls of the control thread return at once: `append`, `begin_segment`, `end_segment`, `finish_group`, `event`
    and `count` never wait for the disk. A killed process loses the samples of 0.1 s and one commit; the first commit
    after a checkpoint waits for the disk to sync. A power cut loses those since the last finished group. If the disk
    fails, or takes nothing for five seconds, the next call raises FileError.
    """

    def __init__(self, path: Path, lock: int, session: int, columns: tuple[str, ...], counts: tuple[int, int]) -> None:
        self._path, self._lock, self._session = path, lock, session
        self._insert = insert_sample(columns)
        self._next_sample, self._next_segment = counts
        self._segment: int | None = None
        self._planned: tuple[int | None, int] = (None, 0)
        self._started_s, self._time_s = MISSING, MISSING
        self._finished: set[int] = set()
        self._is_open = True
        self._writer = BatchWriter(path)

    @classmethod
    def create(
        cls, path: Path, plan_toml: str, rig_toml: str, attrs: Mapping[str, str | int | float] | None = None
    ) -> Self:
        """Return a new journal.

        plan_toml, rig_toml: whole, as in a recording. attrs: what else the recording shall carry; `source` is among
        them where the bench is not a real one.
        Raises FileError where the file exists, or the folder cannot be written; SpecError where the rig is not valid.
        """
        columns = sample_columns(parse_rig(rig_toml))
        fresh = path.with_name(f".{path.name}.new")
        with _locked(path) as lock:
            if path.exists():
                raise FileError(f"{path} exists; resume its run, or choose another folder")
            fresh.unlink(missing_ok=True)
            meta = {"plan": plan_toml, "rig": rig_toml, "attrs": json.dumps(dict(attrs or {}))}
            with closing(sqlite3.connect(fresh)) as connection:
                for statement in statements(columns):
                    connection.execute(statement)
                connection.executemany("INSERT INTO meta VALUES (?, ?)", meta.items())
                connection.commit()
            # Only a whole journal gets the name: whenever the process is killed, there is one or there is none.
            fresh.rename(path)
            return cls._begin(path, lock, columns)

    @classmethod
    def open(cls, path: Path, plan_toml: str, rig_toml: str) -> Self:
        """Return the journal of an interrupted run, to go on with it.

        Segments that were running are marked aborted; their samples stay.
        Raises FileError where it is no journal, is damaged, in use, of another version, or of another plan or rig.
        """
        if not path.is_file():
            raise FileError(f"there is no journal {path} to resume; start the run without resuming")
        with _locked(path) as lock:
            with closing(sqlite3.connect(path)) as connection:
                _refuse_unfit(connection, path, {"plan": plan_toml, "rig": rig_toml})
            return cls._begin(path, lock, sample_columns(parse_rig(rig_toml)))

    @classmethod
    def _begin(cls, path: Path, lock: int, columns: tuple[str, ...]) -> Self:
        with closing(sqlite3.connect(path)) as connection:
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute(
                "UPDATE segments SET state = 'aborted', note = 'was running when its run ended' WHERE state = 'running'"
            )
            session = connection.execute("INSERT INTO sessions (date) VALUES (?)", (_date(),)).lastrowid
            connection.commit()
            finished = {group for (group,) in connection.execute("SELECT plan_group FROM finished")}
            counts = [
                connection.execute(f"SELECT 1 + coalesce(max(id), 0) FROM {table}").fetchone()[0]
                for table in ("samples", "segments")
            ]
        assert session is not None
        journal = cls(path, lock, session, columns, (counts[0], counts[1]))
        journal._finished = finished
        return journal

    def append(self, sample: Sample) -> None:
        """Take the sample of one cycle; it belongs to the segment under way, or to none."""
        if self._segment is not None and self._started_s != self._started_s:
            self._started_s = sample.time_s
        self._time_s = sample.time_s
        self._writer.put(self._insert, (self._next_sample, self._session, self._segment, *sample_row(sample)))
        self._next_sample += 1

    def begin_segment(
        self, group: int | None, attempt: int, planned: Segment, kind: Literal["pause"] | None = None
    ) -> None:
        """Begin a segment; samples belong to it from now on.

        group: its index in the plan, or None where it serves none. attempt: which one of this run, from 0.
        planned: what is asked for. kind: "pause" for a stretch that no recording has; else that of `planned`.
        A segment that is still under way becomes aborted.
        """
        if self._segment is not None:
            self.end_segment("aborted", "another segment began")
        self._segment, self._planned, self._started_s = self._next_segment, (group, attempt), MISSING
        self._next_segment += 1
        numbers = (planned.pretension_mm, planned.frequency_hz, planned.amplitude_deg, planned.repeat)
        self._writer.put(
            _BEGIN, (self._segment, self._session, group, attempt, kind or planned.kind, *numbers, self._next_sample)
        )

    def end_segment(self, state: Literal["complete", "aborted"], note: str = "") -> None:
        """End the segment under way; note says why, where it is aborted. Without one, nothing happens."""
        if self._segment is not None:
            row = (state, self._next_sample, self._started_s, self._time_s, note, self._segment)
            self._segment = None
            self._writer.put(_END, row)

    def finish_group(self, group: int) -> None:
        """Say that the attempt whose segment was begun last has recorded this group of the plan, without holes.

        Raises ValueError if that segment belongs to another group.
        """
        if self._planned[0] != group:
            raise ValueError(f"found a segment of group {self._planned[0]}, expected one of group {group}")
        self._writer.put(_FINISH, (group, self._session, self._planned[1]))
        self._writer.checkpoint()
        self._finished.add(group)

    def finished_groups(self) -> frozenset[int]:
        """Return the indices of the plan's groups that are recorded, in this run or before."""
        return frozenset(self._finished)

    def event(self, event: Event) -> None:
        """Write down what happened, at the time of the newest sample."""
        self._writer.put(_EVENT, (self._session, self._time_s, _date(), event.kind, event.written()))

    def count(self, numbers: Mapping[str, float]) -> None:
        """Write down statistics of this run (cycles, retries); the same name again replaces the number.

        The recording has their sums over all runs that wrote here.
        """
        for name, number in numbers.items():
            self._writer.put(_COUNT, (self._session, name, number))

    def note_registers(self, state: Mapping[str, object]) -> None:
        """Keep with which registers the motors of this run measure, as they were read back; see `JournalReader`."""
        self._writer.put(_META, (f"{REGISTERS}{self._session}", json.dumps(state)))

    def flush(self) -> None:
        """Return when all so far is safe from a killed process; waits for the disk. Raises FileError."""
        self._writer.flush()

    def close(self) -> None:
        """Write what waits and close, within `CLOSE_S`; a segment under way becomes aborted. May be called again.

        Raises FileError if samples were lost and no call has said so yet.
        """
        if not self._is_open:
            return
        self._is_open = False
        last = ("aborted", self._next_sample, self._started_s, self._time_s, "the run ended", self._segment)
        try:
            self._writer.close(CLOSE_S, [] if self._segment is None else [(_END, last)])
        finally:
            os.close(self._lock)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def _date() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def _in_words(error: Exception) -> str:
    said = error.strerror if isinstance(error, OSError) else ""
    return said or " ".join(str(error).split()) or type(error).__name__


@contextmanager
def _locked(path: Path) -> Iterator[int]:
    """Give an open file whose lock keeps every other run away until it is closed, or the process ends; it stays open.

    What goes wrong meanwhile with the journal is raised as FileError, the lock given back.
    """
    import fcntl  # POSIX alone has it; who only reads a journal needs none

    lock = -1
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = os.open(path.with_name(f"{path.name}.lock"), os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise FileError(
                f"another run is writing the journal {path}; wait until it has ended, or choose another folder"
            ) from None
        yield lock
    except BaseException as error:
        if lock >= 0:
            os.close(lock)
        if isinstance(error, (OSError, sqlite3.OperationalError)):
            raise cannot_write(path, _in_words(error)) from error
        if isinstance(error, sqlite3.Error):
            raise _no_journal(path, error) from error
        raise


def _no_journal(path: Path, error: Exception) -> FileError:
    return FileError(f"{path} is not a journal, or is damaged ({_in_words(error)}); start anew in another folder")


def _version(connection: sqlite3.Connection, path: Path) -> int:
    """Return the version of a journal's tables. Raises FileError where it is not one of Sinew."""
    (kind,) = connection.execute("PRAGMA application_id").fetchone()
    if kind != APPLICATION_ID:
        raise FileError(f"{path} is an SQLite file, but no journal of Sinew; choose another folder")
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


def _refuse_unfit(connection: sqlite3.Connection, path: Path, texts: Mapping[str, str]) -> None:
    """Raise FileError unless this is a sound journal of the same plan and rig."""
    if (version := _version(connection, path)) != JOURNAL_VERSION:
        raise FileError(
            f"{path} is a journal of version {version}, expected {JOURNAL_VERSION}; go on with the Sinew that began it"
        )
    (verdict,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    if verdict != "ok":
        raise FileError(f"{path} is damaged ({verdict}); convert what is left and start anew in another folder")
    stored = dict(connection.execute("SELECT key, value FROM meta"))
    for what, text in texts.items():
        if stored[what] != text:
            raise FileError(f"{path} was begun with another {what} ({_difference(stored[what], text)}); use the same")


def _difference(stored: str, given: str) -> str:
    """Return the first line in which two texts differ, in words."""
    old, new = stored.splitlines(), given.splitlines()
    for number, (a, b) in enumerate(zip(old, new, strict=False), 1):
        if a != b:
            return f"line {number}: found {b.strip()!r}, expected {a.strip()!r}"
    return f"found {len(new)} lines, expected {len(old)}"


BATCH_S = 0.1
"""Rows wait at most so long, and the time of one commit, until they are safe from a killed process [s]."""

STALL_S = 5.0
"""A disk that takes nothing for so long counts as lost [s]."""

_START_S = 10.0
_CHECKPOINT = "PRAGMA wal_checkpoint(PASSIVE)"
_PAGES = 32768
"""With so many pages waiting for a checkpoint (128 MiB) the writer makes one itself, as the file would grow on."""

Row = tuple[Any, ...]


def cannot_write(path: Path, error: object) -> FileError:
    """Return what to say of a journal that cannot be written."""
    return FileError(
        f"cannot write the journal {path}: {error}; see that the folder may be written and its disk has space, "
        "then start the run again (with --resume where it had begun)"
    )


class BatchWriter:
    """Commits rows in the background, in the order in which they were put. path: of a journal in WAL mode.

    Committed rows outlive the process at once, and a power cut from the next checkpoint on. A checkpoint is made in a
    thread of its own, as the disk may take seconds to sync and rows must not wait for it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._rows: SimpleQueue[tuple[str, Row]] = SimpleQueue()
        self._wake, self._ready = threading.Event(), threading.Event()
        self._closing = False
        self._error: str | None = None
        self._has_failed = False
        self._last_done = monotonic()
        self._syncing: threading.Thread | None = None
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
            self._has_failed = True
            raise cannot_write(self._path, self._error)
        if self._put_count > self._committed and (waited := monotonic() - self._last_done) > STALL_S:
            self._has_failed = True
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
        if self._has_failed:
            return
        if self._thread.is_alive():
            left = self._put_count - self._committed
            what = f"{left} rows still wait" if left else "the disk still syncs its rows"
            raise cannot_write(self._path, f"{what} after {timeout_s:g} s")
        if self._error is not None:
            raise cannot_write(self._path, self._error)

    def _run(self) -> None:
        try:
            with closing(self._connect()) as connection:
                connection.execute("PRAGMA journal_mode = WAL")
                connection.execute("PRAGMA synchronous = NORMAL")
                connection.execute(f"PRAGMA wal_autocheckpoint = {_PAGES}")
                self._ready.set()
                is_last = must_sync = False
                while not is_last:
                    self._wake.wait(BATCH_S)
                    self._wake.clear()
                    is_last = self._closing
                    must_sync |= self._commit(connection)
                    if must_sync and (self._syncing is None or not self._syncing.is_alive()):
                        self._syncing = threading.Thread(target=self._sync, name="journal checkpoint", daemon=True)
                        self._syncing.start()
                        must_sync = False
                self._await_sync()
                connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        except Exception as error:  # whatever it is, the control thread must hear of it
            self._error = _in_words(error)
        finally:
            self._ready.set()
            with self._advanced:
                self._advanced.notify_all()
            self._await_sync()

    def _connect(self) -> sqlite3.Connection:
        return sqlite3.connect(self._path, isolation_level=None, timeout=STALL_S)

    def _sync(self) -> None:
        """Make a checkpoint."""
        try:
            with closing(self._connect()) as connection:
                connection.execute(_CHECKPOINT).fetchall()
        except Exception as error:  # whatever it is, the control thread must hear of it
            self._error = _in_words(error)

    def _await_sync(self) -> None:
        if self._syncing is not None:
            self._syncing.join(CLOSE_S)

    def _commit(self, connection: sqlite3.Connection) -> bool:
        """Write all rows that wait, in one transaction, and return whether a checkpoint was asked for; rows of one
        statement that follow each other go together."""
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
        self._last_done = monotonic()
        with self._advanced:
            self._committed += len(waiting)
            self._advanced.notify_all()
        return any(statement == _CHECKPOINT for statement, _ in waiting)

    def _waiting(self) -> list[tuple[str, Row]]:
        rows: list[tuple[str, Row]] = []
        try:
            while True:
                rows.append(self._rows.get_nowait())
        except Empty:
            return rows


# ---- reader of a journal, after its run or beside it


@dataclass(frozen=True)
class Stretch:
    """A segment of a journal.

    session: which run wrote it, from 1; times of different runs are of different clocks. group: its index in the plan,
    or None. attempt: of that run, from 0. kind: settle, steady, ring-down, idle or pause. state: running, complete or
    aborted. first, end: ids of its samples, [first, end); end is None where the run was killed in it.
    """

    session: int
    group: int | None
    attempt: int
    kind: str
    planned: Segment
    state: str
    first: int
    end: int | None
    note: str


class JournalReader:
    """A journal, open for reading; a context manager.

    plan_toml, rig_toml, attrs: as given to `Journal.create`. dates: of every run that wrote here (ISO 8601, UTC).
    Raises FileError where it is no journal, is damaged, or of another version.
    """

    def __init__(self, path: Path) -> None:
        self._connection = _connect_to_read(path)
        try:
            if (version := _version(self._connection, path)) != JOURNAL_VERSION:
                raise FileError(f"{path} is a journal of version {version}, expected {JOURNAL_VERSION}")
            meta = dict(self._connection.execute("SELECT key, value FROM meta"))
            self.plan_toml, self.rig_toml = str(meta["plan"]), str(meta["rig"])
            self.attrs: Mapping[str, str | int | float] = json.loads(meta["attrs"])
            self.dates = tuple(date for (date,) in self._connection.execute("SELECT date FROM sessions ORDER BY id"))
        except BaseException as error:
            self._connection.close()
            if isinstance(error, (sqlite3.DatabaseError, KeyError)):
                raise _no_journal(path, error) from error
            raise

    @cached_property
    def _columns(self) -> tuple[str, ...]:
        return sample_columns(parse_rig(self.rig_toml))

    def finished(self) -> dict[int, list[Stretch]]:
        """Return the segments of every recorded group, by its index in the plan: settle and record, in order."""
        found: dict[int, list[Stretch]] = {}
        where = "plan_group IN (SELECT plan_group FROM finished f WHERE f.plan_group = segments.plan_group "
        where += "AND f.session = segments.session AND f.attempt = segments.attempt) AND state = 'complete'"
        for stretch in self.stretches(where):
            if stretch.group is not None and stretch.kind != "pause":
                found.setdefault(stretch.group, []).append(stretch)
        return dict(sorted(found.items()))

    def stretches(self, where: str = "1") -> list[Stretch]:
        """Return the segments that meet an SQL condition, in order of time."""
        rows = self._connection.execute(
            "SELECT session, plan_group, attempt, kind, pretension_mm, frequency_hz, amplitude_deg, repeat, state, "
            f"first_sample, end_sample, note FROM segments WHERE {where} ORDER BY id"
        )
        return [_stretch(row) for row in rows]

    def samples(self, first: int, end: int, session: int | None = None) -> dict[str, Array]:
        """Return the samples with ids in [first, end), of one run or of all, by column; NaN for what did not come.

        Besides the columns of the journal there is `id`.
        """
        columns = ("id", *self._columns)
        rows = self._connection.execute(
            f"SELECT {', '.join(columns)} FROM samples WHERE id >= ? AND id < ? AND session = coalesce(?, session) "
            "ORDER BY id",
            (first, end, session),
        ).fetchall()
        table = np.array(rows, dtype=float).reshape(len(rows), len(columns))
        return {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(columns)}

    def last_sample(self) -> int:
        """Return the id of the newest sample; ids count from 1 without a gap, 0 where there is none."""
        return int(self._connection.execute("SELECT coalesce(max(id), 0) FROM samples").fetchone()[0])

    def first_samples(self) -> list[int]:
        """Return the id of the first sample of every run that wrote here, in order, without reading the rest."""
        found: list[int] = []
        session, last = 0, self.last_sample()
        while (found[-1] if found else 0) <= last:
            at = bisect_left(range(last + 1), session + 1, lo=found[-1] if found else 1, key=self.session)
            if at > last:
                break
            found.append(at)
            session = self.session(at)
        return found

    def session(self, sample: int) -> int:
        """Return which run wrote a sample, from 1."""
        return int(self._connection.execute("SELECT session FROM samples WHERE id = ?", (sample,)).fetchone()[0])

    def clock(self, sample: int) -> float:
        """Return the time of a sample by the clock of its run [s]."""
        return float(self._connection.execute("SELECT time_s FROM samples WHERE id = ?", (sample,)).fetchone()[0])

    def events(self, after: int = 0) -> list[tuple[int, Event]]:
        """Return (number, event) of every event after a number, in order; numbers count from 1."""
        rows = self._connection.execute("SELECT id, kind, sentence FROM events WHERE id > ? ORDER BY id", (after,))
        return [(number, read_event(kind, text)) for number, kind, text in rows]

    def event_times(self, after: int = 0) -> dict[int, tuple[float, float]]:
        """Return by number when every event after a number was: [s since 1970], and [s] since its session began."""
        rows = self._connection.execute(
            "SELECT events.id, events.date, sessions.date FROM events JOIN sessions ON sessions.id = events.session "
            "WHERE events.id > ?",
            (after,),
        )
        dates = ((number, *map(datetime.fromisoformat, texts)) for number, *texts in rows)
        return {number: (when.timestamp(), (when - began).total_seconds()) for number, when, began in dates}

    def epoch(self, session: int) -> float:
        """Return what makes of the clock of a run [s] seconds since 1970: of its newest event, else of its begin."""
        found = self._connection.execute(
            "SELECT date, time_s FROM events WHERE session = ? AND time_s IS NOT NULL ORDER BY id DESC LIMIT 1",
            (session,),
        ).fetchone()
        if found is None:
            first = self._connection.execute("SELECT min(time_s) FROM samples WHERE session = ?", (session,)).fetchone()
            found = (self.dates[session - 1] if session <= len(self.dates) else _date(), first[0] or 0.0)
        return datetime.fromisoformat(found[0]).timestamp() - float(found[1])

    def tendons_at_contact(self) -> Array | None:
        """Return the angles of the tendon motors [rad] where first contact was found last, (tendon,); else None."""
        found = self._connection.execute(
            "SELECT session, time_s FROM events WHERE kind = ? ORDER BY id DESC LIMIT 1", (Contact.kind,)
        ).fetchone()
        names = [name for name in self._columns if name.startswith("tendon_") and name.endswith("_rad")]
        if found is None or found[1] is None:
            return None
        known = " AND ".join(f"{name} IS NOT NULL" for name in names)
        row = self._connection.execute(
            f"SELECT {', '.join(names)} FROM samples WHERE session = ? AND time_s <= ? AND {known} "
            "ORDER BY id DESC LIMIT 1",
            found,
        ).fetchone()
        return None if row is None else np.array(row, dtype=float)

    def newest_stretch(self) -> Stretch | None:
        """Return the segment that was begun last, or None where there is none yet."""
        found = self.stretches("id = (SELECT max(id) FROM segments)")
        return found[0] if found else None

    def registers(self) -> dict[int, Any]:
        """Return with which registers the motors measured, by run; empty where that was not written down yet."""
        rows = self._connection.execute("SELECT key, value FROM meta WHERE key LIKE ?", (f"{REGISTERS}%",))
        return {int(key.removeprefix(REGISTERS)): json.loads(value) for key, value in sorted(rows)}

    def count_finished(self) -> int:
        """Return how many groups of the plan are recorded."""
        return int(self._connection.execute("SELECT count(*) FROM finished").fetchone()[0])

    def duration_s(self) -> float:
        """Return how long all runs took together, from first to last segment [s]."""
        return float(self._connection.execute(_DURATION).fetchone()[0])

    def newest_event(self) -> Event | None:
        """Return the newest event that is no mere state; None where there is none."""
        found = self._connection.execute(_LAST).fetchone()
        return None if found is None else read_event(*found)

    def counts(self) -> dict[str, float]:
        """Return the statistics of all runs, summed."""
        return dict(self._connection.execute("SELECT name, sum(number) FROM counts GROUP BY name ORDER BY name"))

    def close(self) -> None:
        """Give the file back."""
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def _connect_to_read(path: Path) -> sqlite3.Connection:
    """Return a connection to a journal that changes nothing. Raises FileError."""
    if not path.is_file():
        raise FileError(f"there is no journal {path}")
    # In a folder that may not be written, SQLite reads a WAL file only if told that nobody else is at work.
    options = ("mode=ro",) if path.with_name(f"{path.name}-wal").exists() else ("mode=ro", "mode=ro&immutable=1")
    error: sqlite3.DatabaseError | None = None
    for option in options:
        connection = sqlite3.connect(f"{path.absolute().as_uri()}?{option}", uri=True)
        try:
            connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
            return connection
        except sqlite3.DatabaseError as trouble:
            connection.close()
            error = trouble
    assert error is not None, "one way of reading is tried at least"
    raise _no_journal(path, error) from error


def _stretch(row: Sequence[Any]) -> Stretch:
    session, group, attempt, kind, *planned, state, first, end, note = row
    pretension, frequency, amplitude, repeat = (MISSING if x is None else x for x in planned)
    segment = Segment(kind, pretension, frequency, amplitude, int(repeat))
    return Stretch(session, group, attempt, kind, segment, state, first, end, note)


# A journal is summed up without its samples: what was run, how far it came, whether it still goes on.

_LOCKS = Path("/proc/locks")
_DURATION = (
    "SELECT coalesce(sum(length), 0) FROM "
    "(SELECT max(ended_s) - min(started_s) AS length FROM segments GROUP BY session)"
)
_LAST = f"SELECT kind, sentence FROM events WHERE kind NOT IN {STATES} ORDER BY id DESC LIMIT 1"


@dataclass(frozen=True)
class JournalSummary:
    """plan_toml, rig_toml: as given. dates: of every run that wrote here (ISO 8601, UTC). finished: how many groups of
    the plan are recorded. duration_s: from first to last segment, of all runs together. last: the newest event that is
    no mere state; None where there is none."""

    plan_toml: str
    rig_toml: str
    dates: tuple[str, ...]
    finished: int
    duration_s: float
    last: Event | None


def summarise_journal(path: Path) -> JournalSummary:
    """Return what a journal says of its run, in a millisecond. Raises FileError where it is none, or is damaged."""
    with JournalReader(path) as journal:
        try:
            last, duration = journal.newest_event(), journal.duration_s()
            finished = journal.count_finished()
        except sqlite3.DatabaseError as error:
            raise _no_journal(path, error) from error
        return JournalSummary(journal.plan_toml, journal.rig_toml, journal.dates, finished, duration, last)


def is_being_written(path: Path) -> bool:
    """Return whether a run holds the lock of a journal, without touching it: a run that starts now must get it.

    Known where the system lists its locks in /proc/locks (Linux); else False.
    """
    try:
        inode = path.with_name(f"{path.name}.lock").stat().st_ino
        locks = _LOCKS.read_text(encoding="ascii")
    except OSError:
        return False
    return any(line.split()[1:2] == ["FLOCK"] and f":{inode} " in line for line in locks.splitlines())
