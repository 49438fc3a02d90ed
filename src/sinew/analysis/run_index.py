"""Index of the runs in a folder, and the search among them: words and conditions on numbers, as a condition of SQL.

A query is words and conditions with spaces between, all of which must hold: `aged f_r>3.2 pretension=6 tag:first`.
Conditions on what was measured hold at one and the same pretension. `=` takes what rounds to the digits that were
written: f_r=3.2 is 3.15 to 3.25; a pretension, as a number that was set, is met exactly.
"""

import json
import math
import os
import re
import sqlite3
import threading
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

from sinew.measure.errors import FileError, SpecError
from sinew.measure.units import one_number


class Quantity(NamedTuple):
    """What a run has found at a pretension. words: its title. unit: empty for a plain number. called: names in a query,
    the shortest first."""

    words: str
    unit: str
    called: tuple[str, ...]

    def head(self, between: str = " / ") -> str:
        """Return the head of a column of it: its name and its unit."""
        return f"{self.called[0]}{between}{self.unit}" if self.unit else self.called[0]


QUANTITIES: Mapping[str, Quantity] = {
    "resonance_hz": Quantity("frequency of the largest fundamental", "Hz", ("f_r", "fr")),
    "damping_ratio": Quantity("Lehr's damping", "", ("D", "damping")),
    "gain_peak": Quantity("largest gain", "", ("gain",)),
    "phase_90_hz": Quantity("frequency of 90° of lag", "Hz", ("f_90", "f90")),
    "half_power_width_hz": Quantity("half-power width", "Hz", ("width",)),
    "decay_frequency_hz": Quantity("frequency of the decay", "Hz", ("f_d", "fd")),
    "decay_rate_per_s": Quantity("decay rate", "1/s", ("rate", "decay")),
    "paper_resonance_hz": Quantity("frequency of the largest mean of peaks (Eq. 6)", "Hz", ("f_paper",)),
    "gain_peak_measured_drive": Quantity("largest gain over the measured lever", "", ("gain_measured",)),
    "energy_reduction": Quantity("share of a swing's energy that resonance saves", "", ("saved",)),
    "paper_stiffness_n_m_rad": Quantity("stiffness ω² I", "N m/rad", ("k", "stiffness")),
    "paper_damping_n_m_s_rad": Quantity("damping constant 2 λ I", "N m s/rad", ("d", "damping_constant")),
}
"""What is kept of each run at each pretension, by its name in results."""

COMMON = ("resonance_hz", "damping_ratio", "gain_peak")
"""The three that every list shows."""

_OF_RUN = {"duration": "duration_s", "segments": "groups_done", "bytes": "bytes"}
_TEXTS = {
    "name": "name",
    "run": "name",
    "rig": "rig",
    "plan": "plan",
    "source": "source",
    "state": "state",
    "reason": "sentence",
    "notes": "notes",
}
_DATES = ("begin", "began", "date")
_SIGNS = {":": "=", "=": "=", "==": "=", "!=": "!=", "<": "<", "<=": "<=", ">": ">", ">=": ">="}
_TERM = re.compile(r"(?P<key>[A-Za-z_][A-Za-z0-9_]*)\s*(?P<sign>==|!=|<=|>=|[:=<>])\s*(?P<value>\"[^\"]*\"|\S*)")
_PART = re.compile(r"-?(?:[A-Za-z_][A-Za-z0-9_]*\s*(?:==|!=|<=|>=|[:=<>])\s*)?(?:\"[^\"]*\"|[^\s\"]+)")
_DATE = re.compile(r"\d{4}(-\d{2}){0,2}")
_MOST_CHARACTERS, _MOST_TERMS = 500, 30
_SET_EXACTLY = 1e-6  # mm


def columns_of(quantity: str) -> tuple[str, str, str, str]:
    """Return the columns of the index that hold value, standard deviation and ends of the interval of a quantity."""
    return quantity, f"{quantity}_std", f"{quantity}_low", f"{quantity}_high"


def quantity_of(name: str) -> str:
    """Return the name in results of a quantity as people call it: fr, f_r, D, gain. Raises SpecError for another."""
    found = _quantity_or_none(name)
    if found is None:
        raise SpecError(f"found the quantity {name!r}, expected one of {', '.join(_names_of_quantities())}")
    return found


def _quantity_or_none(name: str) -> str | None:
    for quantity, about in QUANTITIES.items():
        if name == quantity or name in about.called:
            return quantity
    folded = [q for q, about in QUANTITIES.items() if name.casefold() in map(str.casefold, about.called)]
    return folded[0] if len(folded) == 1 else None  # D and d are two


def _names_of_quantities() -> list[str]:
    return [about.called[0] for about in QUANTITIES.values()]


@dataclass
class Query:
    """A search as SQL. runs: conditions on a run `r`; found: on what it found at a pretension, `f`; each with its
    parameters. Text is compared in lower case."""

    runs: list[str] = field(default_factory=list)
    found: list[str] = field(default_factory=list)
    of_runs: list[object] = field(default_factory=list)
    of_found: list[object] = field(default_factory=list)

    @property
    def where(self) -> tuple[str, list[object]]:
        """The condition on a run, with what it found among it, and its parameters."""
        conditions, parameters = list(self.runs), list(self.of_runs)
        if self.found:
            conditions.append(f"EXISTS (SELECT 1 FROM found f WHERE f.run = r.name AND {' AND '.join(self.found)})")
            parameters += self.of_found
        return " AND ".join(conditions) or "1", parameters


def parse_query(text: str) -> Query:
    """Return what a search asks for. Raises SpecError, naming the part, where it is none."""
    if len(text) > _MOST_CHARACTERS:
        raise SpecError(f"found a search of {len(text)} characters, expected at most {_MOST_CHARACTERS}")
    if text.count('"') % 2:
        raise SpecError(f'found a quote without its end in the search {text!r}, expected pairs of "')
    query = Query()
    terms = list(_terms(text))
    if len(terms) > _MOST_TERMS:
        raise SpecError(f"found a search of {len(terms)} parts, expected at most {_MOST_TERMS}")
    for is_not, key, sign, value in terms:
        _add(query, is_not, key, sign, value)
    return query


def _terms(text: str) -> Iterator[tuple[bool, str, str, str]]:
    """Yield (whether it must not hold, key, sign, value); a word has neither key nor sign."""
    for part in _PART.findall(text):
        is_not = part.startswith("-") and len(part) > 1
        plain = part[1:] if is_not else part
        found = _TERM.fullmatch(plain)
        if found is None:
            dangling = re.fullmatch(r"([A-Za-z_]\w*)\s*(==|!=|<=|>=|[:=<>])", plain)
            if dangling or plain[0] in "<>=":
                raise SpecError(f"found {plain!r} in the search, expected a name, a sign and a value, as in f_r>3.2")
            yield is_not, "", "", plain.strip('"')
        else:
            yield is_not, found["key"], _SIGNS[found["sign"]], found["value"].strip('"')


def _add(query: Query, is_not: bool, key: str, sign: str, value: str) -> None:
    if not key:
        query.runs.append(f"r.words {'NOT ' if is_not else ''}LIKE ? ESCAPE '\\'")
        query.of_runs.append(_like(value))
        return
    if value == "":
        raise SpecError(f"found {key}{sign} without a value in the search, as in f_r>3.2 or tag:aged")
    quantity, lower = _quantity_or_none(key), key.lower()
    if lower in ("tag", "tags"):
        _need_equals(key, sign)
        wanted = is_not == (sign == "!=")
        query.runs.append(f"r.tags {'' if wanted else 'NOT '}LIKE ? ESCAPE '\\'")
        query.of_runs.append(f"% {_escaped(value)} %")
    elif lower in _TEXTS:
        _need_equals(key, sign)
        wanted = is_not == (sign == "!=")
        query.runs.append(f"folded(coalesce(r.{_TEXTS[lower]}, '')) {'' if wanted else 'NOT '}LIKE ? ESCAPE '\\'")
        query.of_runs.append(_like(value))
    elif lower in _DATES:
        _refuse_not(is_not, key)
        _add_date(query, key, sign, value)
    elif lower in _OF_RUN:
        _refuse_not(is_not, key)
        condition, numbers = _compared(f"r.{_OF_RUN[lower]}", key, sign, value)
        query.runs.append(condition)
        query.of_runs += numbers
    elif quantity is not None or lower in ("pretension", "pretension_mm", "p"):
        _refuse_not(is_not, key)
        condition, numbers = _compared(f"f.{quantity or 'pretension_mm'}", key, sign, value, is_set=quantity is None)
        query.found.append(condition)
        query.of_found += numbers
    else:
        known = ["pretension", *_names_of_quantities(), *_TEXTS, "tag", "begin", *_OF_RUN]
        near = get_close_matches(key, known, 1)
        hint = f"; is {near[0]} meant?" if near else ""
        raise SpecError(
            f"found {key!r} in the search, expected one of {', '.join(known)}{hint} "
            '(text with a sign in it stands in quotes: "a:b")'
        )


def _need_equals(key: str, sign: str) -> None:
    if sign not in ("=", "!="):
        raise SpecError(f"found {key}{sign} in the search, expected {key}: or {key}!= as {key} is text")


def _refuse_not(is_not: bool, key: str) -> None:
    if is_not:
        raise SpecError(f"found -{key} in the search; turn the sign of the condition round instead: {key}<= for {key}>")


def _compared(column: str, key: str, sign: str, value: str, is_set: bool = False) -> tuple[str, list[object]]:
    """Return the condition on a number, and its parameters. is_set: an equal one is meant exactly."""
    low, dots, high = value.partition("..")
    if dots:
        if sign != "=":
            raise SpecError(f"found {key}{sign}{value} in the search, expected a range as {key}=LOW..HIGH")
        return f"{column} BETWEEN ? AND ?", [*sorted((_number(key, low), _number(key, high)))]
    number = _number(key, value)
    if sign not in ("=", "!="):
        return f"{column} {sign} ?", [number]
    half = _SET_EXACTLY if is_set else _half_a_digit(value)
    return f"{column} {'' if sign == '=' else 'NOT '}BETWEEN ? AND ?", [number - half, number + half]


def _number(key: str, text: str) -> float:
    try:
        number = one_number(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise SpecError(f"found {key} with {text!r} in the search, expected a number, as in {key}>3.2 or {key}=3..3.4")
    return number


def _half_a_digit(text: str) -> float:
    """Return half of the last digit that was written."""
    mantissa, _, power = text.lower().partition("e")
    try:
        return float(0.5 * 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2])))
    except OverflowError:
        raise SpecError(
            f"found {text!r} in the search, expected a number with digits that a number can have, as 3.2 or 3e-2"
        ) from None


def _add_date(query: Query, key: str, sign: str, value: str) -> None:
    if not _DATE.fullmatch(value):
        raise SpecError(
            f"found {key} with {value!r} in the search, expected a date, as in {key}>=2026-03 or {key}=2026"
        )
    # A begin starts with its date: what is later than all of a month is greater than the month and a letter behind it.
    last = f"{value}~"
    if sign in ("=", "!="):
        query.runs.append(f"{'' if sign == '=' else 'NOT '}(r.started BETWEEN ? AND ?)")
        query.of_runs += [value, last]
    else:
        query.runs.append(f"r.started {sign} ?")
        query.of_runs.append(last if sign in (">", "<=") else value)


def _escaped(text: str) -> str:
    return re.sub(r"([\\%_])", r"\\\1", text.lower())


def _like(text: str) -> str:
    return f"%{_escaped(text)}%"


# The index: what each run is and found, in SQLite beside the runs. The folders are the truth, the index is made from
# them and may be thrown away at any time. A run is known by its folder's name and by sizes and times of its files; a
# folder that cannot be read is a row that says why. Several processes may look after one index at once: SQLite writes
# one of them after the other, and both write the same.

INDEX = ".index"
"""Folder of the index in the folder of the runs."""

MOST_RUNS = 20_000
"""So many folders are looked at; the rest are not in the index."""

_FILE = "runs.sqlite"
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
damaged, and may be trouble of the moment: it is read again at the next look."""


@dataclass(frozen=True)
class Refreshed:
    """What a refresh did. read: folders that were new or had changed. kept: that had not. gone: rows whose folder is
    there no more. left: folders that were not read in the time there was, are beyond the most that there may be, or
    have a name that is no text (not UTF-8).
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
            try:
                connection = sqlite3.connect(path, timeout=_BUSY_S, isolation_level=None)
            except sqlite3.OperationalError:  # what lies there is no file
                break
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
                rows.append((name, *self._read_row(self.runs / name, found[name])))
            self._write(rows)
            done += len(rows)
            progress(done, len(wanted))
        self._forget(gone)
        return Refreshed(done, len(found) - len(wanted), len(gone), len(wanted) - done + beyond)

    def _folders(self) -> tuple[dict[str, str], int]:
        """Return the stamp of each folder with a run, by name, and how many folders were not looked at."""
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
        texts = [name for name in names if _is_text(name)]
        stamps = {name: stamp for name in texts[:MOST_RUNS] if (stamp := self._look(self.runs / name)) is not None}
        return stamps, len(names) - len(texts[:MOST_RUNS])

    def _read_row(self, folder: Path, stamp: str) -> tuple[str, dict[str, Any]]:
        try:
            return stamp, self._read(folder)
        except Exception as trouble:  # whatever lies in a folder, the others are listed
            reason = " ".join(str(trouble).split()) or type(trouble).__name__
            return "", {"name": folder.name, "state": "damaged", "sentence": reason, "found": []}

    def _write(self, rows: Sequence[tuple[str, str, dict[str, Any]]]) -> None:
        """Write rows, all or none of them."""
        with self._lock, self._written():
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
        with self._lock, self._written():
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
        with self._said():
            return self._connection.execute(command, parameters).fetchall()

    @contextmanager
    def _written(self) -> Iterator[None]:
        """Write all that is written inside, or nothing."""
        with self._said(), self._connection:
            self._connection.execute("BEGIN IMMEDIATE")
            yield

    @contextmanager
    def _said(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as trouble:
            raise FileError(
                f"the index {self.runs / INDEX / _FILE} does not answer ({trouble}); wait for who writes it, make room "
                "on the disk, or delete the file: it is made anew from the runs"
            ) from trouble

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
_ROWS = "every pretension, why no resonance"  # what is written down, where the columns are as they were
_VERSION = zlib.crc32(repr((_RUN, _NUMBERS, _FOUND_NAMES, _ROWS)).encode()) & 0x7FFF_FFFF
_INSERT_FOUND = f"INSERT OR REPLACE INTO found VALUES ({', '.join('?' * len(_FOUND_NAMES))})"


def _prepared(connection: sqlite3.Connection) -> sqlite3.Connection:
    """Return a connection whose tables are there. Raises where the file is another's, damaged or of another version."""
    connection.isolation_level = None
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.create_function("folded", 1, str.lower, deterministic=True)  # SQLite's lower() knows no Ä
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


def _is_text(name: str) -> bool:
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


def _bounded(row: dict[str, Any]) -> Iterator[dict[str, Any]]:
    known = (one for one in row.get("found", []) if math.isfinite(float(one["pretension_mm"])))
    yield from islice(known, _MOST_PRETENSIONS)


def _found_row(run: str, one: dict[str, Any]) -> list[Any]:
    values: list[Any] = [run, float(one["pretension_mm"])]
    for quantity in QUANTITIES:
        estimate = one.get(quantity)
        ends = (None, None) if estimate is None else estimate["interval90"] or (None, None)
        values += [None] * 4 if estimate is None else [estimate["value"], estimate["std"], *ends]
    return values
