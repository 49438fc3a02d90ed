"""Whatever file holds a measurement, read: a recording or results of Sinew, or columns of somebody's table over time.

Columns are named by specifications "COL" or "COL:unit" (see `find_columns`). Without a unit, the one in the column's
own name counts ("angle_deg", "x [mm]"), else 1, and seconds for time.
"""

import math
import re
import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from sinew.measure.arrays import Array
from sinew.measure.errors import FileError, RecordingError, SchemaError, SpecError, UnitError
from sinew.measure.estimate import finite, number
from sinew.measure.files.formats import choose_run, open_file, with_restarts
from sinew.measure.files.names import (
    Table,
    find_columns,
    is_time_name,
    listed,
    number_columns,
    over_frequency,
    quantity,
    role_of,
    says,
    time_columns,
    unit_in_name,
)
from sinew.measure.files.netcdf import has_schema, is_netcdf, load_dataset, load_recording, load_results, provenance
from sinew.measure.files.text import STAMP, Opened, Run, notes_of
from sinew.measure.recording import IMPORT_SEGMENTS, ReadKind, Segment, build_recording, cut_recording
from sinew.measure.result import Detail, Field, Result, Rows
from sinew.measure.result import Table as ShownTable
from sinew.measure.timing import Gaps, Timeline, choose_stretch, mend_stamps, mend_values, straighten_times
from sinew.measure.units import canonical_unit, convert
from sinew.measure.validation import as_path, as_seconds

ColumnNames: TypeAlias = str | Sequence[str] | None
RunChoice: TypeAlias = int | str | None

_TABLES_IN_HDF5 = frozenset((".h5", ".hdf5", ".hdf", ".he5", ".mat"))
_SPARSE = 0.2  # of the rows: so many that hold other columns' samples make a table sparse
_MOST_TEXT = 0.1  # of the cells of a column: more that are no numbers are no accidents
_RATE_OFF = 0.01  # of the rate: how far the stamps' own may be from the one that was given
_SUSPECT_STEP_S = 5.0  # whole numbers so far apart are hardly seconds
_EPOCHS = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))  # since 1970, by the size of the number


def read(
    path: "Path | str | Table",
    *,
    time: str | None = None,
    response: str | None = None,
    drive: str | None = None,
    kind: ReadKind = "auto",
    start_s: float | None = None,
    stop_s: float | None = None,
    gaps: Gaps = "refuse",
    run: RunChoice = None,
    columns: ColumnNames = None,
    rate_hz: float | None = None,
) -> xr.Dataset:
    """Return the recording, or the results, that a file holds.

    path: of a NetCDF file of Sinew, which knows its columns; of a text table in any dialect, a MATLAB, HDF5, TDMS,
    UFF 58, Excel, npz, JSON, Parquet or MCAP file, whose columns are named here (`sn.look` shows them); or a DataFrame.
    time, response, drive: "COL", "COL:unit" or "COL,COL,COL:unit" (the mean of several) of a table; without a unit the
    one in the column's name (angle_deg, "x [mm]") counts. A time that is the only one by its name, and a response that
    is the only other column of numbers, need not be named. kind: what a table holds; auto leaves it to `sn.analyse` to
    find out. start_s, stop_s: the part to take [s], of a table or an imported recording. gaps: refuse a table with
    missing samples, split it into segments there, or bridge them in a ring-down: its times are uneven then, which a fit
    in the time domain bears up to half a period. run: which of several in a file, by number from 1 or name. columns:
    names for all columns instead of the file's, as "t_s,angle_deg". rate_hz: samples per second, where no column holds
    the time. What was found and done is text in the attribute `import_notes`.
    Raises FileError, SchemaError, SpecError, RecordingError, TimeError or UnitError with one sentence.

    >>> import pandas as pd
    >>> import sinew as sn
    >>> swing = pd.DataFrame({"stamp_ms": range(0, 500, 10), "angle_deg": [5.0, 3.0, -2.0, -4.0, -1.0] * 10})
    >>> sn.read(swing, time="stamp_ms", response="angle_deg").sizes["sample"]
    50
    """
    if isinstance(path, (str, Path)) and is_recording(as_path(path)):
        if gaps != "refuse" or any(given is not None for given in (time, response, drive, run, columns, rate_hz)):
            raise SpecError(
                "a recording knows its columns and its gaps; time, response, drive, run, columns, rate_hz and gaps are "
                "for tables; leave them out"
            )
        try:
            return cut_recording(load_recording(path), start_s, stop_s)
        except SchemaError:
            with suppress(SchemaError):
                return load_results(path)
            raise
    if kind not in IMPORT_SEGMENTS:
        raise RecordingError(f"unknown kind {kind!r}, expected one of {', '.join(IMPORT_SEGMENTS)}")
    if gaps == "bridge":
        refuse_bridge(kind)
    table = read_table(path, run=run, columns=columns, time=time)
    roles = {"response": response} | ({"drive": drive} if drive else {})
    found = read_stretch(table, roles, time, rate_hz, (start_s, stop_s), gaps=gaps)
    attrs = {
        "import_file": "" if isinstance(path, pd.DataFrame) else as_path(path).name,
        **{f"import_{role}": found.specs.get(role, "") for role in ("time", "response", "drive")},
    }
    recording = _recorded(found, kind, attrs)
    if gaps == "bridge" and found.timeline.diagnosis.gaps:
        recording = recording.assign_attrs(import_gaps="bridge")
    return recording if kind in ("ring-down", "sweep") else recording.assign_attrs(import_kind=kind)


_RATE_NOTE = (
    "the {role} is an angular rate and stays one: its frequency and damping are those of the angle, "
    "its amplitude is that of the angle times the angular frequency, and its phase leads the angle's by 90 degrees"
)


def _recorded(found: "Stretch", kind: ReadKind, attrs: Mapping[str, Any]) -> xr.Dataset:
    """Return a stretch of a table as a recording, a segment for each of its pieces.

    An angle becomes `torsion_rad` (as drive: `drive_rad`), anything else `response` (`drive`) in SI units. An angular
    rate stays a rate: where the sensor sat and what its other axes read is not known, so it is not passed off as the
    gyroscope of the schema.
    """
    angles = {"response": "torsion_rad", "drive": "drive_rad"}
    called = {role: angles[role] if unit == "rad" else role for role, unit in found.units.items()}
    samples = {"time_s": found.timeline.time_s} | {called[role]: values for role, values in found.values.items()}
    notes = [*found.notes, *(f"time: {note}" for note in found.timeline.notes)]
    notes += [_RATE_NOTE.format(role=role) for role, unit in found.units.items() if unit == "rad/s"]
    pieces = found.timeline.pieces
    retained = np.concatenate([np.arange(piece.start, piece.stop) for piece in pieces])
    return build_recording(
        {name: values[retained] for name, values in samples.items()},
        [Segment(IMPORT_SEGMENTS[kind], 0.0, math.nan, math.nan, 0)] * len(pieces),
        [piece.stop - piece.start for piece in pieces],
        provenance("import", **attrs, import_notes="\n".join(notes)),
        {called[role]: unit for role, unit in found.units.items()},
    )


def is_recording(file: Path) -> bool:
    """Return whether a file is to be read as NetCDF of Sinew; an absent one is not.

    By its name, else by its first bytes; another program's HDF5 file has the same bytes and no schema in it.
    """
    try:
        if file.suffix == ".nc":
            return True
        return is_netcdf(file) and (file.suffix.lower() not in _TABLES_IN_HDF5 or has_schema(file))
    except FileError:
        return False  # the reader of tables says why


def refuse_bridge(kind: ReadKind) -> None:
    """Raise RecordingError where a record of a kind whose analysis needs even samples is bridged over its gaps."""
    if IMPORT_SEGMENTS[kind] != "ring-down":
        raise RecordingError(f"a {kind} needs even samples, its gaps cannot be bridged; split it (--gaps split)")


# A table as it is.


def read_table(
    path: "Path | str | Table", *, run: RunChoice = None, columns: ColumnNames = None, time: str | None = None
) -> Table:
    """Return the table of a file as a DataFrame, columns named by its header; a DataFrame is one already.

    path: of any file that `sinew.measure.files.formats` opens. run: which, by number from 1 or name, of a file that
    holds several. columns: names for all columns, in order, instead of the file's; a table without header has the
    places from "1". time: specification of the time column, where one that starts anew is to part runs; else it is
    known by its name. `sinew.measure.files.text.notes_of` has what was done. Cells are not judged here: see `numbers`.
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
        opened = Opened(opened.form, tuple(Run(one.name, _renamed(one.table, columns)) for one in opened.runs))
    return with_restarts(opened, time)


def _split(columns: str | Sequence[str]) -> list[str]:
    return [name.strip() for name in (columns.split(",") if isinstance(columns, str) else columns)]


def _renamed(table: Table, columns: str | Sequence[str]) -> Table:
    names = _split(columns)
    if len(names) != table.shape[1] or len(set(names)) < len(names) or not all(names):
        raise SpecError(
            f"columns names {', '.join(names)}, expected a name of its own for each of the {table.shape[1]} columns: "
            f"{listed(table.columns)}"
        )
    return table.set_axis(pd.Index(names), axis=1)


def numbers(table: Table, name: str) -> NDArray[np.float64]:
    """Return the numbers of one column as float64, shape (n,).

    Raises RecordingError naming the first data row (from 1, below the header) that is empty, NaN, infinite or text.
    """
    values = _coerced(table[name])
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise RecordingError(
            f"{_bad_cell(table[name], int(bad[0]))} ({bad.size} such rows in all); fill in or remove them"
        )
    return values


def _coerced(column: "pd.Series") -> NDArray[np.float64]:
    """Return the numbers of a column, NaN for what is none. Raises RecordingError for dates."""
    if _holds_dates(column):
        raise RecordingError(
            f"column {column.name!r} holds dates or durations, expected numbers; they can only be the time"
        )
    return np.asarray(pd.to_numeric(column, errors="coerce"), dtype=float)


def _bad_cell(column: "pd.Series", position: int) -> str:
    cell = column.iloc[position]
    row = int(_rows(column)[position])
    if isinstance(cell, str):
        hint = "; if this row holds units, delete it and write COLUMN:unit instead" if row == 1 else ""
        return f"column {column.name!r} holds {cell!r} in data row {row}, expected a number{hint}"
    what = "infinity" if isinstance(cell, float) and math.isinf(cell) else "NaN or an empty cell"
    return f"column {column.name!r} holds {what} in data row {row}"


def _rows(table: "Table | pd.Series") -> NDArray[np.int64]:
    """Return the data rows, counted in the file from 1: they keep their numbers where others were left out."""
    whole = table.index.dtype.kind in "iu"
    return np.asarray(table.index if whole else np.arange(len(table)), dtype=np.int64) + 1


def _holds_dates(column: "pd.Series") -> bool:
    return column.dtype.kind in "mM" or isinstance(column.dtype, pd.DatetimeTZDtype)


# A stretch of it: its columns found, its time read, rows that are no measurement mended or left out.


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


_MENDED = ("response", "output")  # a hammer's blows stand alone, and who computes from others unwraps what comes


def read_stretch(
    table: Table,
    roles: Mapping[str, str | None],
    time: str | None,
    rate_hz: float | None,
    between_s: tuple[float | None, float | None] = (None, None),
    samples: tuple[int, int | None] | None = None,
    gaps: Gaps = "refuse",
) -> Stretch:
    """Return columns of a table, by role, over a stretch of time.

    roles: specifications of the columns; that of the first role may be None: then it is the only column of numbers that
    is left, or has to be named. time: of the time, None to know it by its name, or to count the rows by rate_hz [1/s].
    between_s: start and stop of the part to take, in the file's own time [s]. samples: which of its rows, half open,
    where it has so many. gaps: as in `straighten_times`. A row without a number is a missing sample. A sparse table,
    whose rows hold samples of some columns each, loses the rows that are empty in those asked for. What is no
    measurement is mended as in `mend_stamps` and `mend_values`.
    Raises SpecError, RecordingError, TimeError or UnitError with one sentence.
    """
    first_notes = notes_of(table)
    time, named, notes = _choose_columns(table, roles, time, rate_hz)
    found = {role: find_columns(table, spec) for role, spec in named.items()}
    wanted = sorted({name for names, _ in found.values() for name in names})
    stamp = None if time is None else find_columns(table, time)[0][0]
    others = [name for name in table.columns if name not in (*wanted, stamp)]
    if time is not None and others:
        elsewhere = (table[wanted].isna().any(axis=1) & table[others].notna().any(axis=1)).to_numpy()
        if elsewhere.mean() >= _SPARSE:
            notes.append(f"{elsewhere.sum()} of {len(table)} rows hold samples of other columns only and are left out")
            table = table[~elsewhere]
            if not len(table):
                raise RecordingError(f"no row holds {' and '.join(wanted)} together; bring them to common times first")
    stamps, said = read_time(table, time, rate_hz)
    if missing := int(np.isnan(stamps).sum()):
        notes.append(f"{missing} row{'s' if missing > 1 else ''} without a time left out")
        table, stamps = table[np.isfinite(stamps)], stamps[np.isfinite(stamps)]
    if time is not None:
        places, stamps, mended = mend_stamps(stamps, _rows(table), gaps)
        table, notes = table.iloc[places], [*notes, *mended]
    inside = np.flatnonzero(choose_stretch(stamps, *between_s))
    inside = np.arange(inside[0], inside[-1] + 1)
    if samples is not None and (samples[1] is None or samples[1] <= inside.size):
        inside = inside[slice(*samples)]
    part, stamps, missed = _with_numbers(table.iloc[inside], stamps[inside], wanted)
    values, units, came_in = {}, {}, {}
    for role, (names, stated) in found.items():
        came_in[role] = _unit_of(names, stated)
        units[role], factor = canonical_unit(came_in[role])
        values[role] = np.mean([numbers(part, name) for name in names], axis=0) * factor
        if role in _MENDED:
            unit = came_in[role] if units[role] == "1" else units[role]
            values[role], mended = mend_values(names[0], values[role], unit, _rows(part))
            missed += mended
    sound = np.all([np.isfinite(one) for one in values.values()], axis=0)
    timeline = straighten_times(stamps[sound], gaps=gaps, rows=_rows(part)[sound])
    if time is not None and rate_hz is not None:
        own = 1.0 / float(np.median(np.diff(timeline.time_s)))
        if abs(rate_hz / own - 1.0) > _RATE_OFF:
            raise SpecError(
                f"--rate is {rate_hz:g} Hz, the time stamps in {time!r} are {own:.6g} Hz apart; give one of the two"
            )
    specs = named | {"time": time if time is not None else f"{rate_hz:g} Hz"}
    values = {role: one[sound] for role, one in values.items()}
    return Stretch(timeline, values, units, specs, (*first_notes, *notes, *missed, *said), came_in)


def _with_numbers(table: Table, stamps: Array, names: Sequence[str]) -> tuple[Table, Array, list[str]]:
    """Return rows that hold numbers in all columns, their stamps, and a note that names the first of the others."""
    bad = np.zeros(len(table), dtype=bool)
    first: tuple[int, str] | None = None
    for name in names:
        none = ~np.isfinite(_coerced(table[name]))
        if none.any():
            if (none & table[name].notna().to_numpy()).mean() > _MOST_TEXT:
                numbers(table, name)
            at = int(np.argmax(none))
            first = min(first or (at, name), (at, name))
            bad |= none
    if first is None:
        return table, stamps, []
    at, name = first
    count = int(bad.sum())
    rows = f"{count} row{'s' if count > 1 else ''} without a number taken for {'' if count > 1 else 'a '}missing sample"
    return table[~bad], stamps[~bad], [f"{rows}{'s' if count > 1 else ''}: {_bad_cell(table[name], at)}"]


def choose_clock(table: Table) -> tuple[str | None, list[str]]:
    """Return the column of the time by its name, of several the one with most distinct stamps, and what was chosen."""
    times = time_columns(table)
    if len(times) < 2:
        return (times[0] if times else None), []
    best = max(times, key=lambda name: int(table[name].nunique()) if times.count(name) == 1 else 0)
    return best, [f"{' and '.join(times)} may be the time; {best!r} has most distinct stamps, or comes first"]


def _choose_columns(
    table: Table, roles: Mapping[str, str | None], time: str | None, rate_hz: float | None
) -> tuple[str | None, dict[str, str], list[str]]:
    """Return (column of the time, columns by role, notes), those without a name guessed where there is no doubt."""
    notes: list[str] = []
    named = {role: spec for role, spec in roles.items() if spec is not None}
    over = over_frequency(table)
    if time is not None and len(names := find_columns(table, time)[0]) > 1:
        raise RecordingError(f"time needs one column, found {len(names)}: {', '.join(names)}")
    if over is not None and rate_hz is None and time in (None, over):
        raise RecordingError(no_record(table, over))
    if time is None and rate_hz is None:
        time, notes = choose_clock(table)
        if time is None:
            raise SpecError(
                "this is a table: name its columns; --time COL is missing (time=) and no column is the time by its "
                f"name; there are {listed(table.columns)}; `sinew look` shows them. Without one, say the rate: "
                "--rate HZ (rate_hz=)"
            )
        notes = notes or [f"the time is column {time!r}, by its name"]
    for role in (role for role, spec in roles.items() if spec is None):
        taken = {time, *(name for spec in named.values() for name in find_columns(table, spec)[0])}
        taken |= set(find_columns(table, time)[0]) if time is not None else set()
        left = [name for name in number_columns(table) if name not in taken]
        if len(left) != 1:
            guess = f"{' or '.join(left[:6])} may be it" if left else "no column of numbers is left for it"
            raise SpecError(
                f"this is a table: name its columns; --{role} COL is missing ({role}=) and {guess}; there are "
                f"{listed(table.columns)}; `sinew look` shows them"
            )
        named[role] = left[0]
        notes.append(f"the {role} is column {left[0]!r}, the only other one of numbers")
    return time, {role: named[role] for role in roles if role in named}, notes


def no_record(table: Table, over: str) -> str:
    """Return what to say of a table over frequency."""
    return (
        f"this is a table over frequency ({over!r}, with {listed(table.columns[1:], 4)}), a spectrum or a frequency "
        "response, and no record over time: choose the file of the same program that holds the samples; amplitudes of "
        "input and output with their phase go to `sinew identify FILE --kind stepped --frequency COL "
        "--input COL --output COL --phase COL`"
    )


def _unit_of(names: Sequence[str], stated: str | None) -> str:
    if stated is not None:
        return stated
    found = {unit_in_name(name) or "1" for name in names}
    if len(found) > 1:
        raise UnitError(
            f"columns {', '.join(names)} have different units ({', '.join(sorted(found))}); average one kind"
        )
    return found.pop()


# Its time.


def read_time(table: Table, spec: str | None, rate_hz: float | None) -> tuple[Array, list[str]]:
    """Return (time stamps of the whole table [s], shape (n,), NaN where a cell is none; notes)."""
    if rate_hz is not None and not 0 < rate_hz < math.inf:
        raise SpecError(f"--rate is {rate_hz:g}, expected a positive number of samples per second (rate_hz)")
    if spec is None:
        assert rate_hz is not None
        rows = _rows(table)  # those that hold nothing were left out, and are missing samples
        return (rows - rows[:1]) / rate_hz, []
    (name, *_), stated = find_columns(table, spec)
    column, said = table[name], quantity(name)
    stamped = column.notna().to_numpy()
    text = column[stamped].iloc[0] if stamped.any() else None
    clock = isinstance(text, str) and STAMP.fullmatch(text.strip()) is not None
    notes: list[str] = []
    if not clock and not _holds_dates(column):
        values = _coerced(column)
        odd = stamped & np.isnan(values)
        if odd.sum() > _MOST_TEXT * len(column):
            numbers(table, name)
        if odd.any():
            notes.append(_bad_cell(column, int(np.argmax(odd))))
        stamped = np.isfinite(values)
    if not stamped.any():
        raise RecordingError(f"column {name!r} holds no times")
    stamps = np.full(len(table), math.nan)
    column, unit = column[stamped], stated or said.unit
    if clock or _holds_dates(column):
        if stated is not None:
            raise UnitError(f"the time column {name!r} holds dates or durations, which need no unit; leave it out")
        times, more = _read_stamps(column, name) if clock else (as_seconds(column), [])
    elif unit is not None:
        times, more = values[stamped] * convert(unit, "s"), []
    elif said.unknown is not None and is_time_name(name):
        raise UnitError(
            f"the unit {said.unknown!r} of {name!r} is not understood: say which, as --time '{name}:ms' "
            f"(time='{name}:ms')"
        )
    else:
        times, more = _read_unitless(column, values[stamped], name)
    stamps[stamped] = times
    return stamps, [*notes, *more]


def _read_unitless(column: "pd.Series", values: Array, name: str) -> tuple[Array, list[str]]:
    """Return stamps without a unit as seconds, those since 1970 by the size of their numbers, and what was done."""
    unit = next((unit for least, unit in _EPOCHS if float(np.abs(values).min()) >= least), None)
    if unit is not None:
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


def _read_stamps(column: "pd.Series", name: str) -> tuple[Array, list[str]]:
    """Return dates or times of a clock, written as text, as seconds since the first of them, and what was done."""
    texts = column.astype(str).str.strip()
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


# ---- a first look into somebody's file: format, runs, columns with units, rate, gaps, and the command to go on with


_BARS = "▁▂▃▄▅▆▇█"
_BINS = 40
_SLOWEST_MS = 200  # whole numbers further apart are microseconds rather than milliseconds: below 5 samples a second
_Text = Annotated[str, Field("", "detail")]


@dataclass(frozen=True, repr=False)
class LookedRun(Result):
    """One of several runs in a file, by its number from 1 or its name."""

    number: Annotated[int, Field("--run")]
    name: Annotated[str, Field("name")]


@dataclass(frozen=True, repr=False)
class LookedColumn(Result):
    """One column: its unit by its name, how many values, the least and the largest, its course as a row of bars."""

    name: Annotated[str, Field("column")]
    unit: Annotated[str | None, Field("unit")]
    values: Annotated[int, Field("values")]
    low: Annotated[float | None, Field("least")]
    high: Annotated[float | None, Field("largest")]
    sparkline: Annotated[str, Field("course")]


@dataclass(frozen=True, repr=False)
class LookedTime(Result):
    """What the time of a file is like; gaps: see `sinew.measure.timing.Gap`."""

    column: _Text
    rate_hz: Detail
    duration_s: Detail
    gaps: Annotated[tuple[Mapping[str, float], ...], Field("", "detail")]
    sentence: _Text


@dataclass(frozen=True, repr=False)
class Looked(Result):
    """What is in a file. run: of which the rest is. missing: options whose number nobody but you knows; command: to go
    on with, None where there is none."""

    file: _Text
    format: _Text
    runs: Annotated[Rows[LookedRun], Field("runs")]
    run: _Text
    rows: Annotated[int, Field("", "detail")]
    columns: Annotated[Rows[LookedColumn], Field("")]
    time: Annotated[LookedTime | None, Field("", "detail")] = None
    notes: Annotated[tuple[str, ...], Field("", "sentence")] = ()
    missing: Annotated[tuple[str, ...], Field("", "detail")] = ()
    command: Annotated[str | None, Field("", "detail")] = None

    def blocks(self) -> list[ShownTable | str]:
        """Return tables and sentences in the order of reading; one run alone is not listed."""
        first = f"{self.file}: {self.format}, {self.rows} rows"
        if len(self.runs) == 1:
            return [first, *Result.blocks(replace(self, runs=Rows()))]
        return [f"{first} of {self.run}", *super().blocks()]

    def closing(self) -> list[str]:
        """Return what the time is like, and the command to go on with."""
        time = [] if self.time is None else [f"time, column {self.time.column!r}: {self.time.sentence}"]
        return [*time, *([] if self.command is None else ["", "go on with", f"  {self.command}"])]


def look(
    path: "Path | str", *, run: RunChoice = None, columns: ColumnNames = None, rate_hz: float | None = None
) -> Looked:
    """Return what is in a file of measurements, and the command that goes on with it.

    path: of any file that `sn.read` takes. run: which of several to look at, else the first. columns: names for all
    columns instead of the file's. rate_hz: samples per second, where no column holds the time.
    The command names the time (by its name, else the column that rises evenly), the drive (by its name), the response
    (of the others the column that swings most clearly) and what else is needed; it was tried as far as the import.
    Where a number is missing that nobody but you knows, `missing` says which, and the command has a word in capitals in
    its place.
    Raises FileError where the file cannot be read, SinewError where run or columns do not fit it.

    >>> import tempfile, pathlib
    >>> import sinew as sn
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "swing.csv"
    ...     lines = [f"{i / 100:.2f};{(-1) ** (i // 20) * 0.97**i:.4f}".replace(".", ",") for i in range(200)]
    ...     _ = file.write_text("Zeit;Winkel (deg)\\n" + "\\n".join(lines))
    ...     found = sn.look(file)
    >>> found.format, round(found.time.rate_hz), found.columns[1].unit
    ('text, semicolon between columns, decimal comma', 100, 'deg')
    """
    path = as_path(path)
    if is_recording(path):
        return _look_at_recording(path)
    opened = opened_table(path, columns)
    runs = Rows(LookedRun(number, one.name) for number, one in enumerate(opened.runs, start=1))
    chosen = run
    if run is None and len(runs) > 1:  # the one with most numbers
        held = [one.table.select_dtypes("number").count().sum() for one in opened.runs]
        chosen = int(np.argmax(held)) + 1
    table = choose_run(opened, chosen, path.name)
    words = ["sinew", "analyse", str(path), *([] if len(runs) == 1 else ["--run", str(chosen)])]
    if columns is not None:
        words += ["--columns", columns if isinstance(columns, str) else ",".join(columns)]
    looked = Looked(
        file=path.name,
        format=opened.form,
        runs=runs,
        run=next((one.name for one in runs if chosen in (one.number, one.name, str(one.number))), ""),
        rows=len(table),
        columns=Rows(_column(table, k) for k in range(table.shape[1])),
        notes=notes_of(table),
    )
    return _with_command(looked, table, words, rate_hz)


def _look_at_recording(path: Path) -> Looked:
    dataset = load_dataset(path)
    samples = [name for name in dataset.data_vars if dataset[name].dims == ("sample",)]
    table = pd.DataFrame({name: dataset[name].values for name in samples})
    columns = (_column(table, k) for k in range(table.shape[1]))
    kinds = sorted(set(map(str, dataset["kind"].values))) if "kind" in dataset else []
    return Looked(
        file=path.name,
        format=f"Sinew, {dataset.attrs.get('schema', 'no schema')}",
        runs=Rows([LookedRun(1, "")]),
        run="",
        rows=int(dataset.sizes.get("sample", 0)),
        columns=Rows(replace(one, unit=str(dataset[one.name].attrs.get("units", "")) or None) for one in columns),
        notes=(f"segments: {dataset.sizes.get('segment', 0)}, of {', '.join(kinds)}",) if kinds else (),
        command=shlex.join(["sinew", "analyse", str(path)]) if kinds else None,
    )


def _column(table: Table, position: int) -> LookedColumn:
    column, name = table.iloc[:, position], str(table.columns[position])
    values = np.asarray(pd.to_numeric(column, errors="coerce"), dtype=float) if column.dtype.kind not in "mM" else None
    held, unit = int(column.notna().sum()), unit_in_name(name)
    if values is None or not np.isfinite(values).any():
        return LookedColumn(name, unit, held, None, None, "")
    low, high = (finite(float(end)) for end in (np.nanmin(values), np.nanmax(values)))
    return LookedColumn(name, unit, held, low, high, _sparkline(values))


def _sparkline(values: Array) -> str:
    """Return the course of a signal as a row of bars: in each of 40 stretches its value furthest from the middle."""
    values = _scaled(values[np.isfinite(values)])
    middle, span = float(np.median(values)), float(np.ptp(values))
    if span == 0.0:
        return _BARS[0] * min(_BINS, values.size)
    parts = np.array_split(values, min(_BINS, values.size))
    far = np.array([part[np.argmax(np.abs(part - middle))] for part in parts])
    level = np.clip((far - values.min()) / span * len(_BARS), 0, len(_BARS) - 1).astype(int)
    return "".join(_BARS[k] for k in level)


def _scaled(values: Array) -> Array:
    """Return numbers by their largest, so that no square of theirs leaves the floating point."""
    return values / (float(np.abs(values).max()) or 1.0)


# What to go on with.


def _with_command(looked: Looked, table: Table, words: Sequence[str], rate_hz: float | None) -> Looked:
    """Return what was found with the command to go on, what it lacks, what the time is like, and notes on it.

    words: begin the command; the columns of time, response and drive are added to them.
    """
    notes = list(looked.notes)
    over = over_frequency(table) if rate_hz is None else None
    if over is not None:
        return replace(looked, notes=(*notes, no_record(table, over)))
    time = _time_of(table, notes) if rate_hz is None else None
    missing = ("--rate HZ",) if time is None and rate_hz is None else ()
    if missing:
        notes.append("no column holds times: write the samples per second for HZ")
    response, drive = _motions_of(table, time, notes)
    if response is None:
        notes.append("no column of numbers that changes: there is nothing to go on with")
        return replace(looked, notes=tuple(notes))
    roles, refusal = {"response": response} | ({} if drive is None else {"drive": drive}), ""
    ways: tuple[Gaps, ...] = ("refuse", "bridge", "split") if drive is None else ("refuse", "split")
    for gaps in ways:
        try:
            found = read_stretch(table, roles, time, None if time is not None else rate_hz or 1.0, gaps=gaps)
        except (RecordingError, UnitError) as error:
            refusal = refusal or str(error)
            continue
        if gaps != "bridge" or _short_gaps(found.timeline.time_s, found.values["response"]):
            break
    else:
        return replace(looked, missing=missing, notes=(*notes, refusal))
    words = [*words, *(["--time", time] if time is not None else ["--rate", f"{rate_hz:g}" if rate_hz else "HZ"])]
    words += ["--response", response, *(() if drive is None else ("--drive", drive))]
    words += [] if gaps == "refuse" else ["--gaps", gaps]
    timing = None if time is None else _timing(found, time)
    notes = list(dict.fromkeys((*notes, *found.notes)))
    return replace(looked, notes=tuple(notes), time=timing, missing=missing, command=shlex.join(words))


def _time_of(table: Table, notes: list[str]) -> str | None:
    """Return the specification of the time: by its name, else a first column that rises all the way; None without."""
    name, said = choose_clock(table)
    notes += said
    if name is None and table.shape[1] > 1:
        first = pd.to_numeric(table.iloc[:, 0], errors="coerce").to_numpy(dtype=float)
        steps = np.diff(first[np.isfinite(first)])
        if steps.size > 8 and (steps >= 0).all() and (steps > 0).mean() > 0.5 and (steps != 1).any():  # no counter
            name = str(table.columns[0])
            notes.append(f"no column is the time by its name; {name!r} rises all the way and is taken for it")
    if name is None:
        return None
    values = pd.to_numeric(table[name], errors="coerce").to_numpy(dtype=float)
    steps = np.diff(values[np.isfinite(values)])
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    for spec in (name, f"{name}:{'ms' if usual <= _SLOWEST_MS else 'us'}"):
        try:
            read_time(table, spec, None)
        except UnitError as error:
            notes.append(str(error).partition(": ")[0])
            continue
        except RecordingError as error:
            notes.append(f"{error}; it holds no times that can be read")
            return None
        if spec != name:
            notes.append(f"the unit {spec.rpartition(':')[2]} is a guess by the size of the steps")
        return spec
    return None


def _motions_of(table: Table, time: str | None, notes: list[str]) -> tuple[str | None, str | None]:
    """Return (response, drive): by their names, and of several the column that swings most clearly.

    None where there is none. What is called a supply, a temperature, a status is neither, unless nothing else is there.
    """
    stamp = None if time is None else find_columns(table, time)[0][0]
    names = list(map(str, table.columns))
    scores = {}
    for name in dict.fromkeys(number_columns(table)):
        if names.count(name) > 1:
            notes.append(f"column {name!r} occurs {names.count(name)} times: name all columns anew with --columns")
        elif name != stamp:
            values = pd.to_numeric(table[name], errors="coerce").to_numpy(dtype=float)
            values = values[np.isfinite(values)]
            if values.size > 8 and np.ptp(values) > 0:
                scores[name] = _clearness(values)
    signals = [name for name in scores if role_of(name) != "none"] or list(scores)
    if not signals:
        return None, None
    drives = [name for name in signals if says(name, "drive")]
    others = [name for name in signals if name not in drives] or signals
    by_name = [name for name in others if role_of(name) == "response"]
    best = max(by_name or others, key=lambda name: scores[name])
    drive = drives[0] if drives and drives[0] != best and best not in drives else None
    if drive is not None:
        notes.append(f"{drive!r} is taken for the drive, by its name; choose with --drive")
    if len(others) > 1:
        why = "for it swings most clearly" if len(by_name) != 1 else "by its name"
        rest = listed([name for name in others if name != best], 4)
        driven = "" if drive is not None else "; where another column drove it, name that too: --drive COL"
        notes.append(f"{best!r} is taken for the response, {why}, before {rest}; choose with --response{driven}")
    return best, drive


def _clearness(values: Array) -> float:
    """Return how smooth a signal is beside its own size, 0 where it hardly swings about its line."""
    values = _scaled(values)
    line = np.polyval(np.polyfit(np.arange(values.size), values, 1), np.arange(values.size))
    about = values - line
    crossings = np.count_nonzero(np.diff(np.sign(about)) != 0)
    rough = float(np.std(np.diff(about, 2)))
    return float(np.std(about)) / rough if crossings >= 4 and rough > 0 else 0.0


def _timing(found: Stretch, time: str) -> LookedTime:
    known, lasts = found.timeline.diagnosis, float(np.ptp(found.timeline.time_s))
    gaps = tuple({"start_s": gap.start_s, "stop_s": gap.stop_s, "missing": gap.missing} for gap in known.gaps)
    sentence = f"{known.sentence}; {number(1.0 / known.step_s, 4, 'Hz')}, {number(lasts, 4, 's')}"
    return LookedTime(time, 1.0 / known.step_s, lasts, gaps, sentence)


def _short_gaps(time_s: Array, values: Array) -> bool:
    """Return whether the longest step is shorter than half a period, as crossings of the middle show it."""
    crossings = int(np.count_nonzero(np.diff(np.sign(values - np.median(values)))))
    return bool(np.diff(time_s).max() < float(time_s[-1] - time_s[0]) / max(crossings, 1))
