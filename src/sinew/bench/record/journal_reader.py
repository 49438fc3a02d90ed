"""Reader of a journal, after its run or beside it."""

import json
import sqlite3
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self, cast

import numpy as np

from sinew.bench.record.sample import APPLICATION_ID, JOURNAL_VERSION, READABLE_VERSIONS, REGISTERS, sample_columns
from sinew.measure.arrays import Array
from sinew.measure.errors import FileError
from sinew.measure.events import STATES, Contact, Event, read_event
from sinew.measure.recording import Segment
from sinew.measure.schema import SegmentKind
from sinew.plan.toml import parse_rig


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
    asked: Segment
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
        self._path = path
        self._connection = connect_to_read(path)
        try:
            version = self._check()
            meta = dict(self._connection.execute("SELECT key, value FROM meta"))
            self.plan_toml, self.rig_toml = str(meta["plan"]), str(meta["rig"])
            self.attrs: Mapping[str, str | int | float] = json.loads(meta["attrs"])
            self.dates = tuple(date for (date,) in self._connection.execute("SELECT date FROM sessions ORDER BY id"))
            self._columns = sample_columns(parse_rig(self.rig_toml), READABLE_VERSIONS[version])
        except (sqlite3.DatabaseError, KeyError) as error:
            self._connection.close()
            raise FileError(f"{path} is not a journal, or is damaged ({error})") from error
        except FileError:
            self._connection.close()
            raise

    def _check(self) -> int:
        """Return the version of the journal's tables."""
        (kind,) = self._connection.execute("PRAGMA application_id").fetchone()
        (version,) = self._connection.execute("PRAGMA user_version").fetchone()
        if kind != APPLICATION_ID:
            raise FileError(f"{self._path} is an SQLite file, but no journal of Sinew")
        if version not in READABLE_VERSIONS:
            raise FileError(f"{self._path} is a journal of version {version}, expected at most {JOURNAL_VERSION}")
        return int(version)

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
        found, session, last = [], 0, self.last_sample()
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


def connect_to_read(path: Path) -> sqlite3.Connection:
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
    raise FileError(f"{path} is not a journal, or is damaged ({error})") from error


def _stretch(row: Sequence[object]) -> Stretch:
    session, group, attempt, kind, *asked, state, first, end, note = row
    pretension, frequency, amplitude, repeat = (float("nan") if x is None else x for x in asked)
    segment = Segment(
        cast(SegmentKind, kind),
        cast(float, pretension),
        cast(float, frequency),
        cast(float, amplitude),
        int(cast(int, repeat)),
    )
    return Stretch(
        cast(int, session),
        cast(int | None, group),
        cast(int, attempt),
        str(kind),
        segment,
        str(state),
        cast(int, first),
        cast(int | None, end),
        str(note),
    )


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
    with closing(connect_to_read(path)) as journal:
        try:
            (kind,) = journal.execute("PRAGMA application_id").fetchone()
            if kind != APPLICATION_ID:
                raise FileError(f"{path} is an SQLite file, but no journal of Sinew")
            meta = dict(journal.execute("SELECT key, value FROM meta"))
            last = journal.execute(_LAST).fetchone()
            return JournalSummary(
                str(meta["plan"]),
                str(meta["rig"]),
                tuple(date for (date,) in journal.execute("SELECT date FROM sessions ORDER BY id")),
                int(journal.execute("SELECT count(*) FROM finished").fetchone()[0]),
                float(journal.execute(_DURATION).fetchone()[0]),
                None if last is None else read_event(*last),
            )
        except (sqlite3.DatabaseError, KeyError) as error:
            raise FileError(f"{path} is not a journal, or is damaged ({error})") from error


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
