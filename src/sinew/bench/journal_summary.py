"""This is where a journal is summed up without its samples: what was run, how far it came, whether it still goes on."""

import sqlite3
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from sinew.bench.journal_reader import connect_to_read
from sinew.bench.journal_tables import APPLICATION_ID
from sinew.measure.errors import FileError

__all__ = ["JournalSummary", "is_being_written", "summarise_journal"]

_LOCKS = Path("/proc/locks")
_DURATION = (
    "SELECT coalesce(sum(length), 0) FROM "
    "(SELECT max(ended_s) - min(started_s) AS length FROM segments GROUP BY session)"
)
_LAST = "SELECT kind, sentence FROM events WHERE kind != 'health' ORDER BY id DESC LIMIT 1"


@dataclass(frozen=True)
class JournalSummary:
    """plan_toml, rig_toml: as given. dates: of every run that wrote here (ISO 8601, UTC). finished: how many groups of
    the plan are recorded. duration_s: from first to last segment, of all runs together. last: kind and sentence of the
    newest event that is no report on the health, empty where there is none."""

    plan_toml: str
    rig_toml: str
    dates: tuple[str, ...]
    finished: int
    duration_s: float
    last: tuple[str, str]


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
                ("", "") if last is None else (str(last[0]), str(last[1])),
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
