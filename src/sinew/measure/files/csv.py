"""Columns of somebody's table, over a stretch of time.

Columns are named by specifications "COL" or "COL:unit" (see `find_columns`). Without a unit, the one in the column's
own name counts ("angle_deg", "x [mm]"), else 1, and seconds for time.
"""

import difflib
import math
import re
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import FileError, RecordingError, SpecError, TimeError, UnitError
from sinew.measure.files.formats import open_file
from sinew.measure.files.runs import (
    Opened,
    Run,
    RunChoice,
    bare_name,
    choose_run,
    notes_of,
    number_columns,
    time_columns,
    with_restarts,
)
from sinew.measure.files.text import STAMP
from sinew.measure.recording import IMPORT_SEGMENTS, ReadKind
from sinew.measure.timing import Gaps, Timeline, choose_stretch, refuse_backwards, straighten_times
from sinew.measure.units import canonical_unit, convert, unit_in_name
from sinew.measure.validation import as_path, as_seconds

# A pandas DataFrame with one column for each field and the names as the file has them (duplicates kept).
Table: TypeAlias = "pd.DataFrame"
ColumnNames: TypeAlias = str | Sequence[str] | None

_LISTED = 24
_SPARSE = 0.2  # of the rows: so many that hold other columns' samples make a table sparse
_RATE_OFF = 0.01  # of the rate: how far the stamps' own may be from the one that was given
_SUSPECT_STEP_S = 5.0  # whole numbers so far apart are hardly seconds
_EPOCHS = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))  # since 1970, by the size of the number


def read_table(
    path: "Path | str | Table", *, run: RunChoice = None, columns: ColumnNames = None, time: str | None = None
) -> Table:
    """Return the table of a file as a DataFrame, columns named by its header; a DataFrame is one already.

    path: of a text table in any dialect (see `sinew.measure.files.text`) or of a file of another program (see
    `sinew.measure.files.formats`). run: which, by number from 1 or name, of a file that holds several.
    columns: names for all columns, in order, instead of the file's; a table without header has the places from "1".
    time: specification of the time column, where one that starts anew is to part runs; else it is told by its name.
    `sinew.measure.files.runs.notes_of` tells what was done. Cells are not judged here: see `numbers`.
    Raises FileError for a file that is absent, empty, unknown or holds no table, RecordingError for a run that is not
    there, or none named of several.
    """
    if isinstance(path, pd.DataFrame):
        if run is not None:
            raise SpecError("a DataFrame is one run; leave run out")
        table = path.set_axis([str(name) for name in path.columns], axis=1).reset_index(drop=True)
        return table if columns is None else _renamed(table, columns)
    path = as_path(path)
    return choose_run(opened_table(path, columns, time), run, path.name)


def opened_table(path: Path, columns: ColumnNames = None, time: str | None = None) -> Opened:
    """Return the runs of a file, their columns named anew where names are given; arguments as of `read_table`."""
    opened = open_file(path, None if columns is None else len(_split(columns)))
    if columns is not None:
        runs = tuple(Run(one.name, partial(_renamed_run, one, columns)) for one in opened.runs)
        opened = Opened(opened.form, runs)
    return with_restarts(opened, partial(_stamp_column, spec=time))


def _stamp_column(table: Table, spec: str | None) -> str | None:
    """Return the column of the time, by its specification or its name; None where there is not just one."""
    try:
        found = time_columns(table) if spec is None else find_columns(table, spec)[0]
    except RecordingError:
        return None  # whoever reads it says what is missing
    return found[0] if len(found) == 1 else None


def _renamed_run(run: Run, columns: str | Sequence[str]) -> Table:
    return _renamed(run.load(), columns)


def _split(columns: str | Sequence[str]) -> list[str]:
    return [name.strip() for name in (columns.split(",") if isinstance(columns, str) else columns)]


def _renamed(table: Table, columns: str | Sequence[str]) -> Table:
    names = _split(columns)
    if len(names) != table.shape[1] or len(set(names)) < len(names) or not all(names):
        raise SpecError(
            f"columns names {', '.join(names)}, expected a name of its own for each of the {table.shape[1]} columns: "
            f"{_shown(table)}"
        )
    return table.set_axis(pd.Index(names), axis=1)


def find_columns(table: Table, spec: str) -> tuple[list[str], str | None]:
    """Return (columns, unit) that a specification "COL", "COL:unit" or "COL,COL,COL:unit" names.

    An exact column name goes first, whatever it holds, then one without the bracket at its end ("Angle" of
    "Angle (deg)") where that is unique; the unit stands after the last colon; several columns are separated by commas.
    The unit is None where none was written.
    Raises RecordingError for a column that is missing or not unique, with the columns that were found.
    """
    present = [str(name) for name in table.columns]
    bare = [bare_name(name) for name in present]

    def meant(name: str) -> str | None:
        return name if name in present else present[bare.index(name)] if bare.count(name) == 1 else None

    head, colon, unit = spec.rpartition(":")
    for text, stated in ((spec, None), (head, unit.strip())):
        whole = meant(text)
        if whole is not None:
            return [_unique(table, whole)], stated
        names = [meant(name.strip()) for name in text.split(",")]
        known = [name for name in names if name is not None]
        if len(known) == len(names):
            return [_unique(table, name) for name in known], stated
        if not colon:
            break
    wanted = (head if colon else spec).split(",")
    raise RecordingError(_missing(next((n.strip() for n in wanted if meant(n.strip()) is None), spec), present))


def _unique(table: Table, name: str) -> str:
    count = int((table.columns == name).sum())
    if count > 1:
        raise RecordingError(
            f"column {name!r} occurs {count} times; name all columns anew, in their order (--columns, columns=)"
        )
    return name


def _missing(name: str, present: Sequence[str]) -> str:
    close = difflib.get_close_matches(name.lower(), [p.lower() for p in present], n=1, cutoff=0.5)
    meant = next((p for p in present if close and p.lower() == close[0]), None)
    return f"no column {name!r}{f', did you mean {meant!r}?' if meant else ';'} columns found: {_listed(present)}"


def _listed(names: Iterable[object]) -> str:
    words = list(map(str, names))
    more = f" and {len(words) - _LISTED} more" if len(words) > _LISTED else ""
    return (", ".join(words[:_LISTED]) + more) or "none"


def _shown(table: Table) -> str:
    return _listed(table.columns)


def numbers(table: Table, name: str, rows: slice = slice(None)) -> NDArray[np.float64]:
    """Return the numbers of one column as float64, shape (n,).

    rows: the data rows that matter, the others are not judged.
    Raises RecordingError naming the first data row (from 1, below the header) that is empty, NaN, infinite or text.
    """
    column = table[name].iloc[rows]
    if _holds_dates(column):
        raise RecordingError(f"column {name!r} holds dates or durations, expected numbers; they can only be the time")
    values = np.asarray(pd.to_numeric(column, errors="coerce"), dtype=float)
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        row = int(_rows(column)[bad[0]])
        cell = column.iloc[int(bad[0])]
        if isinstance(cell, str):
            hint = "; if this row holds units, delete it and write COLUMN:unit instead" if row == 1 else ""
            raise RecordingError(f"column {name!r} holds {cell!r} in data row {row}, expected a number{hint}")
        what = "infinity" if np.isinf(values[bad[0]]) else "NaN or an empty cell"
        raise RecordingError(_hole(column, ~np.isfinite(values), what))
    return values


def _hole(column: "pd.Series", missing: Mask, what: str) -> str:
    """Return what to say of a column that lacks numbers."""
    return (
        f"column {column.name!r} holds {what} in data row {_rows(column)[missing][0]} ({missing.sum()} such rows in "
        "all); fill in or remove them, or select the rows without them by start and stop, or take them for missing "
        "samples (--gaps bridge)"
    )


def _rows(table: "Table | pd.Series") -> NDArray[np.int64]:
    """Return the data rows, counted in the file from 1: they keep their numbers where others were left out."""
    whole = table.index.dtype.kind in "iu"
    return np.asarray(table.index if whole else np.arange(len(table)), dtype=np.int64) + 1


def _holds_dates(column: "pd.Series") -> bool:
    return column.dtype.kind in "mM" or isinstance(column.dtype, pd.DatetimeTZDtype)


# A stretch of a table: its columns found, its time read, rows without a sample left out.


@dataclass(frozen=True)
class Stretch:
    """Columns of a table over a stretch of time.

    timeline: its time [s], the pieces that its gaps make and what was found. values: by role, shape (n,), in SI units
    and radians; units: of them. specs: which columns these are, by role and "time". notes: what was done. said: the
    units that the columns came in, by role.
    """

    timeline: Timeline
    values: dict[str, Array]
    units: dict[str, str]
    specs: dict[str, str]
    notes: tuple[str, ...]
    said: dict[str, str]


def read_stretch(
    path: "Path | str | Table",
    roles: Mapping[str, str | None],
    *,
    time: str | None = None,
    rate_hz: float | None = None,
    run: RunChoice = None,
    columns: ColumnNames = None,
    start_s: float | None = None,
    stop_s: float | None = None,
    samples: tuple[int, int | None] | None = None,
    gaps: Gaps = "refuse",
) -> Stretch:
    """Return columns of a table, by role, over a stretch of time.

    path, run, columns: as in `read_table`. roles: specifications of the columns; that of the first role may be None:
    then it is the only column of numbers that is left, or has to be named. time: of the time, None to tell it by its
    name, or to count the rows by rate_hz [1/s]. start_s, stop_s: the part to take, in the file's own time [s]. samples:
    which of its rows, half open, where it has so many; what lies outside is not judged. gaps: as in `straighten_times`;
    unless they are refused, a row with an empty cell is a missing sample. A sparse table, whose rows hold samples of
    some columns each, loses the rows that are empty in those asked for.
    Raises FileError, SpecError, RecordingError, TimeError or UnitError with one sentence.
    """
    table = read_table(path, run=run, columns=columns, time=time)
    time, named, notes = _choose_columns(table, roles, time, rate_hz)
    found = {role: find_columns(table, spec) for role, spec in named.items()}
    asked = sorted({name for names, _ in found.values() for name in names})
    empty = table[asked].isna().any(axis=1).to_numpy()
    stamp = None if time is None else find_columns(table, time)[0][0]
    others = [name for name in table.columns if name not in (*asked, stamp)]
    elsewhere = empty & table[others].notna().any(axis=1).to_numpy() if others else np.zeros(len(table), dtype=bool)
    if time is not None and elsewhere.mean() >= _SPARSE:
        notes.append(f"{int(elsewhere.sum())} of {len(table)} rows hold samples of other columns only and are left out")
        table, empty = table[~elsewhere], empty[~elsewhere]
        if not len(table):
            raise RecordingError(f"no row holds {' and '.join(asked)} together; bring them to common times first")
    stamps, told = read_time(table, time, rate_hz)
    inside = np.flatnonzero(choose_stretch(stamps, start_s, stop_s))
    inside = np.arange(inside[0], inside[-1] + 1)
    stampless = np.isnan(stamps)
    if outside := int(stampless.sum() - stampless[inside].sum()):
        notes.append(f"{outside} row{'s' if outside > 1 else ''} without a time left out")
    if samples is not None and (samples[1] is None or samples[1] <= inside.size):
        inside = inside[slice(*samples)]
    if gaps == "refuse" and stampless[inside].any():
        assert stamp is not None
        raise RecordingError(_hole(table[stamp].iloc[inside], stampless[inside], "NaN or an empty cell"))
    empty = empty | stampless
    holes = int(empty[inside].sum())
    if holes and gaps != "refuse":
        notes.append(f"{holes} row{'s' if holes > 1 else ''} with an empty cell taken for missing samples")
        inside = inside[~empty[inside]]
    timeline = straighten_times(stamps[inside], gaps=gaps, rows=_rows(table)[inside])
    if time is not None and rate_hz is not None:
        _check_rate(rate_hz, timeline.time_s, time)
    part = table.iloc[inside]
    values, units, said = {}, {}, {}
    for role, (names, stated) in found.items():
        said[role] = _unit_of(names, stated, "1")
        units[role], factor = canonical_unit(said[role])
        values[role] = np.mean([numbers(part, name) for name in names], axis=0) * factor
    specs = named | {"time": time if time is not None else f"{rate_hz:g} Hz"}
    return Stretch(timeline, values, units, specs, (*notes_of(table), *notes, *told), said)


def _choose_columns(
    table: Table, roles: Mapping[str, str | None], time: str | None, rate_hz: float | None
) -> tuple[str | None, dict[str, str], list[str]]:
    """Return (column of the time, columns by role, notes), those without a name guessed where there is no doubt."""
    notes = []
    named = {role: spec for role, spec in roles.items() if spec is not None}
    if time is None and rate_hz is None:
        times = time_columns(table)
        if len(times) != 1:
            found = f"{' and '.join(times)} may be the time" if times else "no column is the time by its name"
            raise SpecError(
                f"this is a table: name its columns; --time COL is missing (time=) and {found}; there are "
                f"{_shown(table)}; `sinew look` shows them. Without one, say the rate: --rate HZ (rate_hz=)"
            )
        time = times[0]
        notes.append(f"the time is column {time!r}, by its name")
    elif time is not None and len(names := find_columns(table, time)[0]) > 1:
        raise RecordingError(f"time needs one column, found {len(names)}: {', '.join(names)}")
    for role in (role for role, spec in roles.items() if spec is None):
        taken = {time, *(name for spec in named.values() for name in find_columns(table, spec)[0])}
        taken |= set(find_columns(table, time)[0]) if time is not None else set()
        left = [name for name in number_columns(table) if name not in taken]
        if len(left) != 1:
            found = f"{' or '.join(left[:6])} may be it" if left else "no column of numbers is left for it"
            raise SpecError(
                f"this is a table: name its columns; --{role} COL is missing ({role}=) and {found}; there are "
                f"{_shown(table)}; `sinew look` shows them"
            )
        named[role] = left[0]
        notes.append(f"the {role} is column {left[0]!r}, the only other one of numbers")
    return time, {role: named[role] for role in roles if role in named}, notes


def _unit_of(names: Sequence[str], stated: str | None, default: str) -> str:
    if stated is not None:
        return stated
    found = {unit_in_name(name) or default for name in names}
    if len(found) > 1:
        raise UnitError(
            f"columns {', '.join(names)} have different units ({', '.join(sorted(found))}); average one kind"
        )
    return found.pop()


def read_time(table: Table, spec: str | None, rate_hz: float | None) -> tuple[Array, list[str]]:
    """Return (time stamps of the whole table [s], shape (n,), NaN where some cells are empty; notes)."""
    if rate_hz is not None and not 0 < rate_hz < math.inf:
        raise SpecError(f"--rate is {rate_hz:g}, expected a positive number of samples per second (rate_hz)")
    if spec is None:
        assert rate_hz is not None
        rows = _rows(table)  # those that hold nothing were left out, and are missing samples
        return (rows - rows[:1]) / rate_hz, []
    (name, *_), stated = find_columns(table, spec)
    stamped = table[name].notna().to_numpy()
    if stamped.any() and not stamped.all():
        stamps = np.full(len(table), math.nan)
        stamps[stamped], notes = read_time(table[stamped], spec, None)
        return stamps, notes
    column, unit = table[name], stated or unit_in_name(name)
    if _holds_dates(column) or _holds_stamps(column):
        if stated is not None:
            raise UnitError(f"the time column {name!r} holds dates or durations, which need no unit; leave it out")
        stamps, notes = (as_seconds(column), []) if _holds_dates(column) else _read_stamps(column, name)
    elif unit is None:
        stamps, notes = _read_unitless(table, name)
    else:
        stamps, notes = numbers(table, name) * convert(unit, "s"), []
    refuse_backwards(stamps, rows=_rows(column))
    return stamps, notes


def _read_unitless(table: Table, name: str) -> tuple[Array, list[str]]:
    """Return stamps without a unit as seconds, those since 1970 by the size of their numbers, and what was done."""
    values = numbers(table, name)
    size = float(np.abs(values).min()) if values.size else 0.0
    unit = next((unit for least, unit in _EPOCHS if size >= least), None)
    if unit is not None:
        column = table[name]
        since = column - column.iloc[0] if column.dtype.kind in "iu" else values - values[0]  # whole: all digits count
        said = f"the stamps in {name!r} are {unit} since 1970 by their size; time counts from the first"
        return np.asarray(since, dtype=float) * convert(unit, "s"), [said]
    steps = np.diff(values)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    if usual < 1.0 or not bool((values == np.rint(values)).all()):
        return values, []
    if usual >= _SUSPECT_STEP_S:
        raise UnitError(
            f"the stamps in {name!r} are whole numbers {usual:g} apart and no unit is stated: are they seconds, ms or "
            f"us? say it, as --time '{name}:us' (time='{name}:us')"
        )
    return values, [
        f"the stamps in {name!r} are whole numbers {usual:g} apart, taken for seconds, for no unit is stated; where "
        f"they are ms, say it, as --time '{name}:ms' (time='{name}:ms')"
    ]


def _first_text(column: "pd.Series") -> str | None:
    held = column.dropna()
    return held.iloc[0].strip() if len(held) and isinstance(held.iloc[0], str) else None


def _holds_stamps(column: "pd.Series") -> bool:
    first = None if column.dtype.kind in "fiub" else _first_text(column)
    return first is not None and STAMP.fullmatch(first) is not None


def _read_stamps(column: "pd.Series", name: str) -> tuple[Array, list[str]]:
    """Return dates or times of a clock, written as text, as seconds since the first of them, and what was done."""
    texts = column.astype("object").where(column.notna(), "").astype(str).str.strip()
    bad = np.flatnonzero(~texts.map(lambda text: STAMP.fullmatch(text) is not None).to_numpy(dtype=bool))
    if bad.size:
        raise RecordingError(
            f"column {name!r} holds {texts.iloc[int(bad[0])]!r} in data row {_rows(column)[bad[0]]}, expected a date "
            f"or a time of day as {texts.iloc[0]!r}"
        )
    said = f"the stamps in {name!r} became seconds since the first, {texts.iloc[0]}"
    texts = texts.str.replace(",", ".", regex=False)
    if re.fullmatch(r"\d{1,2}:\d\d(:\d\d(\.\d+)?)?", texts.iloc[0]):
        whole = texts.where(texts.str.count(":") == 2, texts + ":00")
        seconds = as_seconds(pd.to_timedelta(whole))
        days = np.concatenate([[0], np.cumsum(np.diff(seconds) < -43_200.0)])  # the clock passes midnight
        return seconds - seconds[0] + 86_400.0 * days, [said]
    try:
        dates = pd.to_datetime(texts, format="mixed", dayfirst="." in texts.iloc[0][:5], utc=True)
    except (ValueError, TypeError, OverflowError) as error:
        raise RecordingError(
            f"column {name!r} holds dates that cannot be read ({error}); write 2026-03-01 14:05:00.5"
        ) from error
    return as_seconds(dates), [said]


def _check_rate(rate_hz: float, time_s: Array, time: str) -> None:
    own = 1.0 / float(np.median(np.diff(time_s)))
    if abs(rate_hz / own - 1.0) > _RATE_OFF:
        raise SpecError(
            f"--rate is {rate_hz:g} Hz, the time stamps in {time!r} are {own:.6g} Hz apart; give one of the two"
        )


def refuse_bridge(kind: ReadKind) -> None:
    """Raise RecordingError where a record of a kind whose analysis needs even samples is bridged over its gaps."""
    if IMPORT_SEGMENTS[kind] != "ring-down":
        raise RecordingError(f"a {kind} needs even samples, its gaps cannot be bridged; split it (--gaps split)")


# A walking person's sensors or markers.


_KINDS = {"gyr": "gyr|gyro|gyroscope|omega|angular_?velocity", "acc": "acc|accel|acceleration|accelerometer"}
_SENSOR = re.compile(
    rf"(?:(?P<stem>.*?)[ _.-])?(?:(?P<gyr>{_KINDS['gyr']})|(?P<acc>{_KINDS['acc']}))[ _.-]?(?P<axis>[xyz])(?![a-z])",
    re.IGNORECASE,
)
_MARKER = re.compile(r"(?P<stem>.+)[ _.-](?P<axis>[xyz])(?![a-z0-9])", re.IGNORECASE)
_USUAL = {
    "pelvis": ("pelvis", "hip", "hips", "sacrum", "waist", "lower_back", "LASI,RASI", "LASIS,RASIS", "LPSI,RPSI"),
    "trunk": ("trunk", "torso", "chest", "thorax", "sternum", "upper_back", "LSHO,RSHO", "LACR,RACR"),
}
_LOWEST_RATE_HZ, _BRIDGED_S = 20.0, 0.1
_REST_M_S2 = (7.0, 14.0)
_FAST_RAD_S = 6.0


class Imu(NamedTuple):
    """An inertial sensor on one part of the body, in its own axes: rad/s and m/s², shape (n, 3) each."""

    gyro: Array
    acceleration: Array


class MarkerPair(NamedTuple):
    """A left and a right marker on one part of the body, the third axis up: m, shape (n, 3) each."""

    left: Array
    right: Array


@dataclass(frozen=True)
class WalkColumns:
    """What to read in a file; what is None is found by its usual name.

    time: "COL" or "COL:unit". bodies: "pelvis" and "trunk" to the name of a sensor, or of two markers "LEFT,RIGHT".
    yaw: "COL" or "COL:unit", an angle between trunk and pelvis that others have computed; then no bodies are read.
    up: the markers' upward axis. gyro_unit, acceleration_unit: where the columns' names do not tell.
    """

    time: str | None = None
    bodies: Mapping[str, str] = field(default_factory=dict)
    yaw: str | None = None
    up: str = "z"
    gyro_unit: str | None = None
    acceleration_unit: str | None = None


@dataclass(frozen=True)
class WalkRecord:
    """A walking person's record on an even clock: time_s of shape (n,), the parts of the body by role.

    names: of the sensors or markers, by role. yaw: [rad], shape (n,), where it was read instead. notes: sentences.
    """

    time_s: Array
    bodies: Mapping[str, Imu | MarkerPair]
    names: Mapping[str, str]
    yaw: Array | None
    notes: tuple[str, ...]


def read_walk(
    path: Path, columns: WalkColumns | None = None, *, start_s: float | None = None, stop_s: float | None = None
) -> WalkRecord:
    """Return the record of a walking person, the longest stretch without missing values between start and stop.

    start_s, stop_s: in the file's own time [s]. Holes of up to 0.1 s are bridged by straight lines.
    Raises FileError for a file that is no table, SpecError, RecordingError, TimeError or UnitError with one sentence.
    """
    asked = columns or WalkColumns()
    table = _read_arrays(path) if path.suffix.lower() == ".npz" else read_table(path)
    specs, names = _channels(table, asked)
    times = time_columns(table) if asked.time is None else find_columns(table, asked.time)[0]
    taken = [name for spec, _ in specs.values() for name in find_columns(table, spec)[0]]
    found = read_stretch(
        table[[*times, *taken]],
        {role: spec for role, (spec, _) in specs.items()},
        time=asked.time,
        start_s=start_s,
        stop_s=stop_s,
        gaps="bridge",
    )
    for role, (_, si) in specs.items():
        convert(found.said[role], si)  # raises where the unit is of another kind
    time, step = found.timeline.time_s, found.timeline.diagnosis.step_s
    parts = np.split(np.arange(time.size), np.flatnonzero(np.diff(time) > max(_BRIDGED_S, 1.5 * step)) + 1)
    longest = max(parts, key=lambda part: time[part[-1]] - time[part[0]])
    if not 1.0 / step >= _LOWEST_RATE_HZ:
        raise TimeError(f"found {1 / step:.3g} samples per second, expected at least {_LOWEST_RATE_HZ:g} for a gait")
    time = time[longest]
    count = 1 + round(float(time[-1] - time[0]) / step)
    even = time[0] + (time[-1] - time[0]) / (count - 1) * np.arange(count)
    notes = [f"read {even[0]:.5g} to {even[-1]:.5g} s at {1 / step:.4g} Hz"]
    if holes := count - time.size:
        notes.append(f"{holes} samples with missing values were bridged by straight lines (holes of at most 0.1 s)")
    if len(parts) > 1:
        notes.append(f"values are missing; taken is the longest of {len(parts)} whole stretches")
    signals = {role: np.interp(even, time, values[longest]) for role, values in found.values.items()}
    bodies = {role: _body(role, signals, name) for role, name in names.items()}
    return WalkRecord(even, bodies, names, signals.get("yaw"), tuple(notes))


def _read_arrays(path: Path) -> Table:
    """Return the arrays of an npz file as a table; (n, 3) becomes three columns, arrays of other lengths are left."""
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name]) for name in file.files}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise FileError(f"cannot read {path}: {error}; expected an npz file of plain arrays") from error
    numeric = {name: a for name, a in arrays.items() if a.ndim in (1, 2) and a.dtype.kind in "fiu"}
    lengths = [a.shape[0] for a in numeric.values()]
    if not lengths:
        raise FileError(f"{path} holds no arrays of numbers; expected t of shape (n,) and NAME_gyr of shape (n, 3)")
    usual = max(lengths, key=lengths.count)
    found: dict[str, Array] = {}
    for name, array in numeric.items():
        if array.shape[0] == usual and array.ndim == 1:
            found[name] = array
        elif array.shape == (usual, 3):
            found |= {f"{name}_{axis}": array[:, i] for i, axis in enumerate("xyz")}
    return pd.DataFrame(found)


def _channels(table: Table, asked: WalkColumns) -> tuple[dict[str, tuple[str, str]], dict[str, str]]:
    """Return (columns with their unit, and the SI unit, by "role/kind/axis"; names of the bodies by role)."""
    if asked.yaw is not None:
        return {"yaw": (asked.yaw, "rad")}, {}
    sensors, markers = _sensors(table), _markers(table)
    names = {role: asked.bodies.get(role) or _usual(role, sensors, markers) for role in _USUAL}
    if not asked.bodies and not any(names.values()) and len(sensors) == 1:
        names["pelvis"] = next(iter(sensors))
    chosen = {role: name for role, name in names.items() if name is not None}
    if not chosen:
        raise RecordingError(
            f"no pelvis or trunk by a usual name; found the sensors {_listed(sensors)} and the "
            f"markers {_listed(markers)}; say --pelvis NAME, --trunk NAME, or LEFT,RIGHT for a pair of markers"
        )
    units = {"gyr": (asked.gyro_unit, "rad/s"), "acc": (asked.acceleration_unit, "m/s2")}
    found: dict[str, tuple[str, str]] = {}
    for role, name in chosen.items():
        columns = _marker_columns(name, markers, asked.up) if "," in name else _sensor_columns(name, sensors)
        for kind, column in columns.items():
            stated, si = units.get(kind[:3], (None, "m"))
            found[f"{role}/{kind}"] = f"{column}:{stated or unit_in_name(column) or si}", si
    return found, chosen


def _sensors(table: Table) -> dict[str, dict[str, str]]:
    """Return the columns "gyr/x" ... "acc/z" of each inertial sensor that is whole, by its name."""
    found: dict[str, dict[str, str]] = {}
    for column in map(str, table.columns):
        match = _SENSOR.match(column)
        if match:
            kind = "gyr" if match["gyr"] else "acc"
            found.setdefault(match["stem"] or "sensor", {})[f"{kind}/{match['axis'].lower()}"] = column
    return {stem: columns for stem, columns in found.items() if len(columns) == 6}


def _markers(table: Table) -> dict[str, dict[str, str]]:
    found: dict[str, dict[str, str]] = {}
    for column in map(str, table.columns):
        match = _MARKER.match(column)
        if match and not _SENSOR.match(column):
            found.setdefault(match["stem"], {})[match["axis"].lower()] = column
    return {stem: columns for stem, columns in found.items() if len(columns) == 3}


def _usual(role: str, sensors: Mapping[str, object], markers: Mapping[str, object]) -> str | None:
    lower = {name.lower(): name for name in (*sensors, *markers)}
    for name in _USUAL[role]:
        parts = [lower.get(part.lower()) for part in name.split(",")]
        if None not in parts and (len(parts) > 1 or parts[0] in sensors):
            return ",".join(part for part in parts if part is not None)
    return None


def _sensor_columns(name: str, sensors: Mapping[str, Mapping[str, str]]) -> Mapping[str, str]:
    if name not in sensors:
        raise RecordingError(
            f"no sensor {name!r} with gyroscope and accelerometer; columns {name}_gyr_x, {name}_acc_x and so on are "
            f"expected, and these are whole: {_listed(sensors)}; a pair of markers is LEFT,RIGHT"
        )
    return sensors[name]


def _marker_columns(name: str, markers: Mapping[str, Mapping[str, str]], up: str) -> dict[str, str]:
    pair = [part.strip() for part in name.split(",")]
    missing = [part for part in pair if part not in markers]
    if len(pair) != 2 or missing:
        wrong = f"no marker {missing[0]!r}" if missing else f"found {len(pair)} markers in {name!r}"
        raise RecordingError(f"{wrong}; expected two, LEFT,RIGHT, out of {_listed(markers)}")
    axes = dict(zip("xyz", {"z": "xyz", "y": "zxy", "x": "yzx"}[up], strict=True))
    sides = zip(("left", "right"), pair, strict=True)
    return {f"{side}/{axis}": markers[part][source] for side, part in sides for axis, source in axes.items()}


def _body(role: str, signals: Mapping[str, Array], name: str) -> Imu | MarkerPair:
    """Return the signals of one part of the body. Raises RecordingError where a unit was not as it was taken to be."""

    def triple(kind: str) -> Array:
        return np.ascontiguousarray(np.column_stack([signals[f"{role}/{kind}/{axis}"] for axis in "xyz"]))

    if "," in name:
        return MarkerPair(triple("left"), triple("right"))
    one = Imu(triple("gyr"), triple("acc"))
    turning, gravity = (float(np.median(np.linalg.norm(values, axis=1))) for values in one)
    if turning > _FAST_RAD_S:
        raise RecordingError(
            f"the gyroscope {name!r} reads {turning:.3g} rad/s in the median, faster than a body turns in walking; "
            "name its unit with --gyro-unit (deg/s)"
        )
    if not _REST_M_S2[0] < gravity < _REST_M_S2[1]:
        raise RecordingError(
            f"the accelerometer {name!r} reads {gravity:.3g} m/s² in the median, expected about 9.81; "
            "name its unit with --acc-unit (g_0 for multiples of gravity)"
        )
    return one
