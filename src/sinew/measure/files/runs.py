"""Runs of a file: what it holds, one of them chosen, and what the names of its columns tell."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import pandas as pd  # type: ignore[import-untyped,unused-ignore]
from numpy.typing import NDArray

from sinew.measure.errors import RecordingError, UnitError
from sinew.measure.units import canonical_unit, unit_in_name

Table: TypeAlias = "pd.DataFrame"
RunChoice: TypeAlias = int | str | None

MADE_TIME = "time [s]"
"""Name of the column of times that is made where a file states a rate or a step and holds no time."""

_FEWEST_ROWS = 8  # of a run that a restart of the clock begins: fewer cannot be analysed
_LISTED = 12


@dataclass(frozen=True)
class Run:
    """One run in a file. name: as the file has it. load: reads its table, with `notes_of` what was done to it."""

    name: str
    load: Callable[[], Table]


@dataclass(frozen=True)
class Opened:
    """What a file holds. form: its format in words. runs: at least one, in the order of the file."""

    form: str
    runs: tuple[Run, ...]


def notes_of(table: Table) -> tuple[str, ...]:
    """Return the sentences on what was done to read a table."""
    return tuple(table.attrs.get("notes", ()))


def noted(table: Table, *notes: str) -> Table:
    """Return the table with sentences added on what was done to it."""
    told = table.copy(deep=False)
    told.attrs = {**table.attrs, "notes": (*notes_of(table), *notes)}
    return told


def choose_run(opened: Opened, run: RunChoice, source: str) -> Table:
    """Return the table of a run, by its number from 1 or its name; of a file with one run None is enough.

    Raises RecordingError, with the list of runs, where none is chosen of several or there is none of that name.
    """
    runs = opened.runs
    if run is None and len(runs) == 1:
        return runs[0].load()
    names = [f"{place} {one.name!r}" if one.name else str(place) for place, one in enumerate(runs, start=1)]
    listed = ", ".join(names[:_LISTED]) + (f" and {len(names) - _LISTED} more" if len(names) > _LISTED else "")
    if run is None:
        raise RecordingError(
            f"{source} holds {len(runs)} runs: {listed}; choose one by its number or name, as --run 1 (run=1)"
        )
    text = str(run).strip()
    named = [one for one in runs if one.name == text and not isinstance(run, int)]
    if len(named) == 1:
        return named[0].load()
    if text.isdecimal() and 1 <= int(text) <= len(runs):
        return runs[int(text) - 1].load()
    raise RecordingError(f"{source} has no run {text!r}; it holds {listed}")


# Names of columns: a label of the run in them, a unit in brackets, what is a time.

_RUN_WORD = r"(?:Run|Trial|Set|Data ?Set|Lauf|Messung|Series|Serie)"
_LABELS = (
    re.compile(rf"^(?P<label>Latest|{_RUN_WORD} ?#? ?\d+)\s*[:.|]\s*(?P<name>\S.*)$", re.IGNORECASE),
    re.compile(rf"^(?P<name>\S.*?)[\s,;:]+(?P<label>{_RUN_WORD} ?#? ?\d+)$", re.IGNORECASE),
)
_TIME_NAME = re.compile(
    r"t|times?|zeit(en)?|tempo|temps|tiempo|tid|czas|sec(ond)?s?|xvalue|timestamps?|stamp|elapsed(time)?|timeelapsed|"
    r"rel(ative)?time|hosttime|logtime|headerstamp|clock|uhrzeit|datetime|zeitstempel|sys(tem)?time|abs(olute)?time|"
    r"unixtime|epoch(time)?|(time)?(millis|micros)|time(sec|seconds)"
)


def bare_name(name: str) -> str:
    """Return a column's name without the bracket at its end."""
    return re.sub(r"\s*[\[(][^\[\]()]*[\])]\s*$", "", name).strip()


def is_time_name(name: str) -> bool:
    """Return whether a column's name says that it holds times."""
    bare = bare_name(name).rsplit("/", 1)[-1]
    word = re.sub(r"[\s_.\-]+", "", re.sub(r"_(s|ms|us|ns)$", "", bare.lower()))
    return _TIME_NAME.fullmatch(word) is not None


def time_columns(table: Table) -> list[str]:
    """Return the columns that are times by their names."""
    return [name for name in map(str, table.columns) if is_time_name(name)]


def number_columns(table: Table) -> list[str]:
    """Return the columns that hold numbers and no times, by their names."""
    found = []
    for place, name in enumerate(map(str, table.columns)):
        column = table.iloc[:, place]
        if is_time_name(name) or column.dtype.kind in "mM" or isinstance(column.dtype, pd.DatetimeTZDtype):
            continue
        held = column.notna().sum()
        values = column if column.dtype.kind in "fiu" else pd.to_numeric(column, errors="coerce")
        if held and values.notna().sum() >= 0.9 * held:
            found.append(name)
    return found


def with_unit(name: str, unit: str | None) -> str:
    """Return a column's name with a unit that the file states apart from it, where it is one and none is in the name.

    A word for a unit that is none ("Amplitude", "counts") is left out.
    """
    text = (unit or "").strip().strip("[]()").strip()
    if not text or unit_in_name(name) is not None:
        return name
    for spelling in (text, text.lower()):
        try:
            canonical_unit(spelling)
        except UnitError as error:
            if "ambiguous" not in str(error):
                continue
        else:
            return f"{name} [{spelling}]" if spelling != "1" else name
    return name


def unlike(names: Sequence[str]) -> list[str]:
    """Return names of which no two are the same: the second becomes "NAME 2", before its bracket."""
    found: list[str] = []
    for name in names:
        again, fresh, bare = 1, name, bare_name(name)
        while fresh in found:
            again += 1
            fresh = f"{bare} {again}{name[len(bare) :]}"
        found.append(fresh)
    return found


# Several runs in one table: beside one another, or one below the other.


def split_labels(table: Table, labels: Sequence[str] | None = None) -> list[tuple[str, Table]]:
    """Return (label, table) of the runs that stand beside one another.

    Their columns are told by a label in the name ("Time (s) Run #1", "Run 1: Time (s)"), or by labels, one for each
    column, where every one has the same columns and its own time. A column without a label belongs to all. One run of
    an empty label where there are none.
    """
    names = [str(name) for name in table.columns]
    found = list(labels) if labels is not None else []
    if labels is None:
        for place, name in enumerate(names):
            match = next((match for one in _LABELS if (match := one.match(name))), None)
            found.append(match["label"] if match else "")
            names[place] = match["name"] if match else name
    order = list(dict.fromkeys(label for label in found if label))
    if not order:
        return [("", table)]
    runs = []
    for label in order:
        places = [place for place, own in enumerate(found) if own in (label, "")]
        own = [place for place, one in enumerate(found) if one == label]
        part = table.iloc[:, places]
        part = part.set_axis(pd.Index([names[place] for place in places]), axis=1)
        runs.append((label, part[table.iloc[:, own].notna().any(axis=1).to_numpy()]))
    return runs


def repeats_itself(labels: Sequence[str], names: Sequence[str]) -> bool:
    """Return whether every label stands over the same names, a time among them: then each is a run of its own."""
    groups = {label: [n for one, n in zip(labels, names, strict=True) if one == label] for label in labels}
    first = groups[labels[0]]
    same = all(group == first for group in groups.values())
    return len(groups) > 1 and same and "" not in groups and any(map(is_time_name, first))


def split_restarts(table: Table, time: str | None) -> list[Table]:
    """Return the runs that stand one below the other, told by a time that starts anew; the table itself where none do.

    time: name of the column of times; None where it is not known.
    """
    if time is None or list(table.columns).count(time) != 1:
        return [table]
    stamps = np.asarray(pd.to_numeric(table[time], errors="coerce"), dtype=float)
    known = np.flatnonzero(np.isfinite(stamps))
    steps = np.diff(stamps[known])
    back = np.flatnonzero(steps < 0)
    if not back.size or not (steps > 0).any():
        return [table]
    first, usual = float(stamps[known[0]]), float(np.median(steps[steps > 0]))
    starts = known[back + 1]
    edges = [0, *map(int, starts), len(table)]
    anew = bool((stamps[starts] <= first + 2.0 * usual).all())
    if not anew or min(np.diff(edges)) < _FEWEST_ROWS:
        return [table]
    return [table.iloc[a:b] for a, b in pairwise(edges)]


def with_restarts(opened: Opened, time_of: Callable[[Table], str | None]) -> Opened:
    """Return what a file holds, its one run taken apart where its time starts anew.

    time_of: names the column of the times of a table, None where that is not known.
    """
    if len(opened.runs) != 1:
        return opened
    table = opened.runs[0].load()
    parts = split_restarts(table, time_of(table))
    if len(parts) == 1:
        return Opened(opened.form, (Run(opened.runs[0].name, lambda: table),))
    note = f"its time starts anew {len(parts) - 1} times"
    runs = [Run(f"part {k}", partial(noted, part, note)) for k, part in enumerate(parts, start=1)]
    return Opened(opened.form, tuple(runs))


# Arrays of a file with a tree (MATLAB, HDF5, TDMS): which of them belong to one run.


@dataclass(frozen=True)
class Column:
    """One array of a file: group and name of its place, values of shape (n,), its unit, step and start where stated."""

    group: str
    name: str
    values: NDArray[Any]
    unit: str | None = None
    step_s: float | None = None
    start_s: float = 0.0


def runs_of_columns(columns: Sequence[Column], *, apart: bool = False) -> tuple[Run, ...]:
    """Return the runs that columns of a file with groups make up.

    Each group is a run. Unless groups are to stay apart, those of which all columns have one length, and which do not
    repeat each other's names, are one table, whose columns are named by their paths.
    """
    groups: dict[str, list[Column]] = {}
    for column in columns:
        groups.setdefault(column.group, []).append(column)
    one_length = len({column.values.size for column in columns}) == 1
    all_names = [column.name for column in columns]
    apart = apart or (len(set(all_names)) < len(all_names) and max(map(len, groups.values())) > 1)
    if len(groups) > 1 and one_length and not apart:
        whole = [
            Column("", f"{column.group}/{column.name}".lstrip("/"), column.values, column.unit, column.step_s)
            for column in columns
        ]
        return (Run("", partial(_table_of, whole)),)
    return tuple(Run(name, partial(_table_of, group)) for name, group in groups.items())


def _table_of(columns: Sequence[Column]) -> Table:
    """Return columns as a table; those of another length than most samples have are left out, with a note."""
    sizes = [column.values.size for column in columns]
    usual = max(sorted(set(sizes), reverse=True), key=sizes.count)
    kept = [column for column in columns if column.values.size == usual]
    names = unlike([with_unit(column.name, column.unit) for column in kept])
    table = pd.DataFrame(dict(zip(names, (column.values for column in kept), strict=True)))
    left = [column.name for column in columns if column.values.size != usual]
    if left:
        table = noted(table, f"columns of another length than {usual} are left out: {', '.join(left[:8])}")
    steps = {(column.step_s, column.start_s) for column in kept if column.step_s}
    if len(steps) == 1 and not time_columns(table):
        ((step, start),) = steps
        assert step is not None
        return with_time(table, step, start)
    return table


def with_time(table: Table, step_s: float, start_s: float = 0.0) -> Table:
    """Return a table with a column of times before the others, of even steps as the file states them [s].

    Its index counts the samples, of those too that were left out.
    """
    made = pd.Series(start_s + step_s * table.index.to_numpy(), index=table.index, name=MADE_TIME)
    whole = pd.concat([made, table], axis=1)
    whole.attrs = dict(table.attrs)
    return noted(whole, f"time made from the step of {step_s:.6g} s that the file states")
