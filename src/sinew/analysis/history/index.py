"""An index of the runs in a folder: what each is and found, in SQLite beside them, of which only what changed is read.

The folders are the truth, the index is made from them and may be thrown away at any time. A run is known by its
folder's name and by sizes and times of its files; a folder that cannot be read is a row that says why. Several
processes may look after one index at once: SQLite writes one of them after the other, and both write the same.
"""

import json
import os
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from sinew.analysis.history.search import QUANTITIES, Query, columns_of, parse_query
from sinew.measure.errors import FileError

INDEX = ".index"
"""Folder of the index in the folder of the runs."""

MOST_RUNS = 20_000
"""So many folders are looked at; the rest are not in the index."""

_FILE = "runs.sqlite"
_VERSION = 1
_APPLICATION = 0x53_4E_57_49
_BUSY_S = 20.0
_BATCH = 50
_MOST_TEXT = 4000
_MOST_PRETENSIONS = 500
_RUN = ("name", "stamp", "started", "state", "sentence", "rig", "plan", "source", "notes", "tags", "words")
_NUMBERS = ("duration_s", "groups_done", "groups", "bytes")
_UNDER_WAY = "running"

Look = Callable[[Path], str | None]
"""Returns what tells whether a folder has changed, or None for one that holds no run; opens no file."""

Read = Callable[[Path], dict[str, Any]]
"""Returns what a run is and found: the columns of the index by name, `tags` (list) and `found`, a list of
`{"pretension_mm", quantity: {"value", "std", "interval90"}}`; whatever it raises becomes a row, with the state
damaged."""


@dataclass(frozen=True)
class Refreshed:
    """What a refresh did. read: folders that were new or had changed. kept: that had not. gone: rows whose folder is
    there no more. left: folders that were not read in the time there was, or are beyond the most that there may be.
    """

    read: int
    kept: int
    gone: int
    left: int


class RunIndex:
    """The index of a folder of runs; a context manager. look, read: how a folder is looked at and read.

    It lies in the folder, or in memory where that may not be written.
    """

    def __init__(self, runs: Path, look: Look, read: Read) -> None:
        self.runs, self._look, self._read = runs, look, read
        self._lock = threading.Lock()
        self._connection = self._opened()

    def _opened(self) -> sqlite3.Connection:
        folder = self.runs / INDEX
        path = folder / _FILE
        with suppress(OSError):
            folder.mkdir(exist_ok=True)
        if not self.runs.is_dir() or folder.is_symlink() or path.is_symlink() or not os.access(folder, os.W_OK):
            return _prepared(sqlite3.connect(":memory:"))
        for _ in range(2):
            connection = sqlite3.connect(path, timeout=_BUSY_S, isolation_level=None)
            try:
                return _prepared(connection)
            except sqlite3.OperationalError:  # of a file system that cannot lock, or that is full
                connection.close()
                break
            except (sqlite3.DatabaseError, _OtherIndexError):  # damaged, or of another version: it is made anew
                connection.close()
                for end in ("", "-wal", "-shm"):
                    path.with_name(path.name + end).unlink(missing_ok=True)
        return _prepared(sqlite3.connect(":memory:"))

    def refresh(
        self, *, most_s: float | None = None, progress: Callable[[float, float], None] = lambda _done, _total: None
    ) -> Refreshed:
        """Read the folders that are new or have changed, and forget those that are gone.

        most_s: no folder is begun after so long [s]; the rest waits for the next refresh. progress: gets (done, total).
        """
        began = time.monotonic()
        found, beyond = self._folders()
        with self._lock:
            known = {name: (stamp, state) for name, stamp, state in self._all("SELECT name, stamp, state FROM runs")}
        gone = [name for name in known if name not in found]
        wanted = []
        for name, stamp in found.items():
            before, state = known.get(name, ("", ""))
            if before != stamp or state == _UNDER_WAY:
                wanted.append(name)
        done = 0
        for start in range(0, len(wanted), _BATCH):
            rows = []
            for name in wanted[start : start + _BATCH]:
                if most_s is not None and time.monotonic() - began > most_s:
                    break
                rows.append((name, found[name], self._read_row(self.runs / name)))
            self._write(rows)
            done += len(rows)
            progress(done, len(wanted))
        self._forget(gone)
        return Refreshed(done, len(found) - len(wanted), len(gone), len(wanted) - done + beyond)

    def _folders(self) -> tuple[dict[str, str], int]:
        """Return the stamp of each folder with a run, by name, and how many are beyond the most."""
        try:
            with os.scandir(self.runs) as entries:
                names = sorted(
                    entry.name
                    for entry in entries
                    if not entry.name.startswith(".") and entry.is_dir(follow_symlinks=False)
                )
        except FileNotFoundError:
            return {}, 0
        except OSError as error:
            raise FileError(f"cannot list {self.runs}: {error.strerror or error}; name a folder of runs") from error
        stamps = {name: stamp for name in names[:MOST_RUNS] if (stamp := self._look(self.runs / name)) is not None}
        return stamps, max(0, len(names) - MOST_RUNS)

    def _read_row(self, folder: Path) -> dict[str, Any]:
        try:
            return self._read(folder)
        except Exception as trouble:  # whatever lies in a folder, the others are listed
            reason = " ".join(str(trouble).split()) or type(trouble).__name__
            return {"name": folder.name, "state": "damaged", "sentence": reason, "found": []}

    def _write(self, rows: Sequence[tuple[str, str, dict[str, Any]]]) -> None:
        """Write rows, all or none of them."""
        with self._lock, self._connection:
            self._connection.execute("BEGIN IMMEDIATE")
            for name, stamp, row in rows:
                self._connection.execute("DELETE FROM found WHERE run = ?", (name,))
                tags = " ".join(map(str, row.get("tags") or []))
                texts = {one: _short(row.get(one)) for one in _RUN} | {"name": name, "stamp": stamp}
                texts["tags"] = f" {tags.lower()} "
                said = (name, *(texts[one] for one in ("rig", "plan", "source", "state", "sentence", "notes")), tags)
                texts["words"] = "\n".join(part for part in said if part).lower()
                kept = {key: value for key, value in row.items() if key != "found"} | {"name": name}
                kept |= {key: _short(value) for key, value in kept.items() if isinstance(value, str)}
                numbers = [row.get(one) for one in _NUMBERS]
                values = [*(texts[one] for one in _RUN), *numbers, json.dumps(kept)]
                self._connection.execute(f"INSERT OR REPLACE INTO runs VALUES ({', '.join('?' * len(values))})", values)
                self._connection.executemany(_INSERT_FOUND, [_found_row(name, one) for one in _bounded(row)])

    def _forget(self, names: Sequence[str]) -> None:
        if not names:
            return
        with self._lock, self._connection:
            self._connection.execute("BEGIN IMMEDIATE")
            for name in names:
                self._connection.execute("DELETE FROM found WHERE run = ?", (name,))
                self._connection.execute("DELETE FROM runs WHERE name = ?", (name,))

    def search(self, text: str = "", *, most: int | None = None) -> list[dict[str, Any]]:
        """Return the runs that a query finds, the newest first: what `read` said of each, and `found`.

        found: what it measured at the pretensions that meet the query, see `Read`. most: so many at most.
        Raises SpecError where the query is none.
        """
        query = parse_query(text)
        where, parameters = query.where
        chosen = f"SELECT name FROM runs r WHERE {where} ORDER BY r.started DESC, r.name LIMIT ?"
        limit = -1 if most is None else most
        with self._lock:
            rows = self._all(
                f"SELECT name, document FROM runs WHERE name IN ({chosen}) ORDER BY started DESC, name",
                [*parameters, limit],
            )
            found = self._found(query, chosen, [*parameters, limit])
        return [json.loads(document) | {"found": found.get(name, [])} for name, document in rows]

    def count(self, text: str = "") -> int:
        """Return how many runs a query finds."""
        where, parameters = parse_query(text).where
        with self._lock:
            return int(self._all(f"SELECT count(*) FROM runs r WHERE {where}", parameters)[0][0])

    def _found(self, query: Query, chosen: str, parameters: Sequence[object]) -> dict[str, list[dict[str, Any]]]:
        conditions = " AND ".join([f"f.run IN ({chosen})", *query.found])
        found: dict[str, list[dict[str, Any]]] = {}
        for name, pretension, *numbers in self._all(
            f"SELECT {_FOUND_COLUMNS} FROM found f WHERE {conditions} ORDER BY f.run, f.pretension_mm",
            [*parameters, *query.of_found],
        ):
            row: dict[str, Any] = {"pretension_mm": pretension}
            for place, quantity in enumerate(QUANTITIES):
                value, std, low, high = numbers[4 * place : 4 * place + 4]
                if value is not None:
                    row[quantity] = {"value": value, "std": std, "interval90": [low, high]}
            found.setdefault(name, []).append(row)
        return found

    def _all(self, command: str, parameters: Sequence[object] = ()) -> list[tuple[Any, ...]]:
        return self._connection.execute(command, parameters).fetchall()

    def close(self) -> None:
        """Give the file back."""
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


class _OtherIndexError(Exception):
    """A file of SQLite is no index of this version."""


_FOUND_NAMES = ["run", "pretension_mm", *(column for quantity in QUANTITIES for column in columns_of(quantity))]
_FOUND_COLUMNS = ", ".join(f"f.{name}" for name in _FOUND_NAMES)
_INSERT_FOUND = f"INSERT OR REPLACE INTO found VALUES ({', '.join('?' * len(_FOUND_NAMES))})"


def _prepared(connection: sqlite3.Connection) -> sqlite3.Connection:
    """Return a connection whose tables are there. Raises where the file is another's, damaged or of another version."""
    connection.isolation_level = None
    connection.execute("PRAGMA trusted_schema = OFF")
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    (tables,) = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    if tables and (application, version) != (_APPLICATION, _VERSION):
        raise _OtherIndexError
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = NORMAL")
    with connection:
        connection.execute("BEGIN IMMEDIATE")  # of two that come at once, the second finds the tables
        texts = ", ".join(f"{name} TEXT" for name in _RUN[1:])
        numbers = ", ".join(f"{name} REAL" for name in _NUMBERS)
        found = ", ".join(f"{name} REAL" for name in _FOUND_NAMES[1:])
        connection.execute(
            f"CREATE TABLE IF NOT EXISTS runs (name TEXT PRIMARY KEY, {texts}, {numbers}, document TEXT) WITHOUT ROWID"
        )
        connection.execute(
            f"CREATE TABLE IF NOT EXISTS found (run TEXT, {found}, PRIMARY KEY (run, pretension_mm)) WITHOUT ROWID"
        )
        connection.execute(f"PRAGMA application_id = {_APPLICATION}")
        connection.execute(f"PRAGMA user_version = {_VERSION}")
    return connection


def _short(value: object) -> str | None:
    return None if value is None else str(value)[:_MOST_TEXT]


def _bounded(row: dict[str, Any]) -> Iterator[dict[str, Any]]:
    yield from row.get("found", [])[:_MOST_PRETENSIONS]


def _found_row(run: str, one: dict[str, Any]) -> list[Any]:
    values: list[Any] = [run, float(one["pretension_mm"])]
    for quantity in QUANTITIES:
        estimate = one.get(quantity)
        ends = (None, None) if estimate is None else estimate["interval90"] or (None, None)
        values += [None] * 4 if estimate is None else [estimate["value"], estimate["std"], *ends]
    return values
