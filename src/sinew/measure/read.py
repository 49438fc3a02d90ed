"""Whatever file holds a measurement, read or looked into: a recording or results of Sinew, or somebody's table."""

import math
import re
import shlex
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import xarray as xr

from sinew.measure.arrays import Array
from sinew.measure.errors import FileError, RecordingError, SchemaError, SinewError, SpecError, UnitError
from sinew.measure.estimate import finite, number
from sinew.measure.files.csv import (
    ColumnNames,
    Stretch,
    Table,
    opened_table,
    read_stretch,
    read_table,
    read_time,
    refuse_bridge,
)
from sinew.measure.files.netcdf import has_schema, is_netcdf, load_dataset, load_recording, load_results, provenance
from sinew.measure.files.runs import RunChoice, bare_name, notes_of, number_columns, time_columns
from sinew.measure.recording import IMPORT_SEGMENTS, ReadKind, Segment, build_recording, cut_recording
from sinew.measure.result import Detail, Field, Result, Rows
from sinew.measure.result import Table as ShownTable
from sinew.measure.timing import Gaps, diagnose_times
from sinew.measure.units import unit_in_name
from sinew.measure.validation import as_path

_TABLES_IN_HDF5 = frozenset((".h5", ".hdf5", ".hdf", ".he5", ".mat"))


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
    UFF 58, Excel, Parquet or MCAP file, whose columns are named here; or a pandas DataFrame. `sn.look` tells what is in
    a file.
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
    found = read_stretch(
        path,
        {"response": response} | ({"drive": drive} if drive else {}),
        time=time,
        rate_hz=rate_hz,
        run=run,
        columns=columns,
        start_s=start_s,
        stop_s=stop_s,
        gaps=gaps,
    )
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


def _recorded(found: Stretch, kind: ReadKind, attrs: Mapping[str, Any]) -> xr.Dataset:
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
    kept = np.concatenate([np.arange(piece.start, piece.stop) for piece in pieces])
    return build_recording(
        {name: values[kept] for name, values in samples.items()},
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


# ---- a first look into somebody's file: format, runs, columns with units, rate, gaps, and the command to go on with


_BARS = "▁▂▃▄▅▆▇█"
_BINS = 40
_DRIVE = re.compile(
    r"(?<![^\W_])(drive|force|torque|input|command|cmd|set ?point|excitation|shaker|hammer|lever|base|antrieb|anregung|"
    r"kraft|u)(?![^\W_])",
    re.IGNORECASE,
)
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
    time: Annotated[LookedTime | None, Field("", "detail")]
    notes: Annotated[tuple[str, ...], Field("", "sentence")]
    missing: Annotated[tuple[str, ...], Field("", "detail")]
    command: Annotated[str | None, Field("", "detail")]

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
    runs = Rows(LookedRun(place, one.name) for place, one in enumerate(opened.runs, start=1))
    chosen: RunChoice = run if run is not None or len(runs) == 1 else 1
    table = read_table(path, run=chosen, columns=columns)
    guess = _guess(path, table, _Asked(str(path), chosen if len(runs) > 1 else None, columns, rate_hz))
    named = next((one.name for one in runs if chosen in (one.number, one.name, str(one.number))), "")
    return Looked(
        file=path.name,
        format=opened.form,
        runs=runs,
        run=named,
        rows=len(table),
        columns=Rows(_column(table, place) for place in range(table.shape[1])),
        time=guess.timing,
        notes=(*notes_of(table), *guess.notes),
        missing=guess.missing,
        command=guess.command,
    )


def _look_at_recording(path: Path) -> Looked:
    dataset = load_dataset(path)
    table = pd.DataFrame(
        {name: dataset[name].values for name in dataset.data_vars if dataset[name].dims == ("sample",)}
    )
    columns = (_column(table, place) for place in range(table.shape[1]))
    kinds = sorted(set(map(str, dataset["kind"].values))) if "kind" in dataset else []
    return Looked(
        file=path.name,
        format=f"Sinew, {dataset.attrs.get('schema', 'no schema')}",
        runs=Rows([LookedRun(1, "")]),
        run="",
        rows=int(dataset.sizes.get("sample", 0)),
        columns=Rows(replace(one, unit=str(dataset[one.name].attrs.get("units", "")) or None) for one in columns),
        time=None,
        notes=(f"segments: {dataset.sizes.get('segment', 0)}, of {', '.join(kinds)}",) if kinds else (),
        missing=(),
        command=shlex.join(["sinew", "analyse", str(path)]) if kinds else None,
    )


def _column(table: Table, place: int) -> LookedColumn:
    column, name = table.iloc[:, place], str(table.columns[place])
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


@dataclass(frozen=True)
class _Asked:
    """What was asked of the file: it stays in the command."""

    file: str
    run: RunChoice
    columns: ColumnNames
    rate_hz: float | None


@dataclass(frozen=True)
class _Guess:
    """The command to go on with, or None; what it lacks; what the time is like; notes."""

    command: str | None = None
    missing: tuple[str, ...] = ()
    timing: LookedTime | None = None
    notes: tuple[str, ...] = ()


def _guess(path: Path, table: Table, asked: _Asked) -> _Guess:
    notes: list[str] = []
    time, response, missing = None, None, []
    if asked.rate_hz is None:
        time = _time_of(table, notes)
        if time is None:
            missing.append("--rate HZ")
            notes.append("no column holds times: write the samples per second for HZ")
    response, drive = _motions_of(table, time, notes)
    if response is None:
        return _Guess(None, (), None, (*notes, "no column of numbers that changes: there is nothing to go on with"))
    timing = _timing(table, time)
    gaps, refusal = _tried(path, time, response, drive, asked)
    if refusal:
        return _Guess(None, tuple(missing), timing, (*notes, refusal))
    words = ["sinew", "analyse", asked.file]
    words += [] if asked.run is None else ["--run", str(asked.run)]
    if asked.columns is not None:
        words += ["--columns", asked.columns if isinstance(asked.columns, str) else ",".join(asked.columns)]
    words += ["--rate", "HZ" if asked.rate_hz is None else f"{asked.rate_hz:g}"] if time is None else ["--time", time]
    words += ["--response", response, *(() if drive is None else ("--drive", drive))]
    words += [] if gaps == "refuse" else ["--gaps", gaps]
    return _Guess(shlex.join(words), tuple(missing), timing, tuple(notes))


def _time_of(table: Table, notes: list[str]) -> str | None:
    """Return the specification of the time: by its name, else a first column that rises all the way; None without."""
    found = time_columns(table)
    if len(found) > 1:
        notes.append(f"{' and '.join(found)} may be the time; the command takes the first that can be read")
    if not found and table.shape[1] > 1:
        first = pd.to_numeric(table.iloc[:, 0], errors="coerce").to_numpy(dtype=float)
        steps = np.diff(first[np.isfinite(first)])
        if steps.size > 8 and (steps >= 0).all() and (steps > 0).mean() > 0.5:
            found = [str(table.columns[0])]
            notes.append(f"no column is the time by its name; {found[0]!r} rises all the way and is taken for it")
    for name in found:
        for spec in (name, *_with_units(table, name)):
            try:
                stamps, told = read_time(table, spec, None)
            except UnitError as error:
                notes.append(str(error).partition(":")[0])
                continue
            except SinewError:
                break
            if stamps.size:
                if spec != name:
                    notes.append(f"the unit {spec.rpartition(':')[2]} is a guess by the size of the steps")
                notes += told
                return spec
    return None


def _with_units(table: Table, name: str) -> list[str]:
    """Return the specification of a time of whole numbers with the unit that its steps suggest."""
    values = pd.to_numeric(table[name], errors="coerce").to_numpy(dtype=float)
    steps = np.diff(values[np.isfinite(values)])
    steps = steps[steps > 0]
    if not steps.size:
        return []
    return [f"{name}:{'ms' if float(np.median(steps)) <= _SLOWEST_MS else 'us'}"]


def _motions_of(table: Table, time: str | None, notes: list[str]) -> tuple[str | None, str | None]:
    """Return (response, drive): of the columns that change the one that swings most clearly, and a drive by its name.

    None where there is none.
    """
    names = [name for name in number_columns(table) if time is None or name not in (time, time.rpartition(":")[0])]
    places = list(map(str, table.columns))
    scores = {}
    for name in dict.fromkeys(names):
        if places.count(name) > 1:
            notes.append(f"column {name!r} occurs {places.count(name)} times: name all columns anew with --columns")
            continue
        values = pd.to_numeric(table[name], errors="coerce").to_numpy(dtype=float)
        values = values[np.isfinite(values)]
        if values.size > 8 and np.ptp(values) > 0:
            scores[name] = _clearness(values)
    if not scores:
        return None, None
    others = [name for name in scores if not _DRIVE.search(bare_name(name))] or list(scores)
    drive = next((name for name in scores if name not in others), None)
    best = max(others, key=lambda name: scores[name])
    if drive is not None:
        notes.append(f"{drive!r} is taken for the drive, by its name; choose with --drive")
    if len(others) > 1:
        driven = "" if drive is not None else "; where another column drove it, name that too: --drive COL"
        notes.append(f"{best!r} swings most clearly and is taken for the response; choose with --response{driven}")
    return best, drive


def _clearness(values: Array) -> float:
    """Return how smooth a signal is beside its own size, 0 where it hardly swings about its line."""
    values = _scaled(values)
    line = np.polyval(np.polyfit(np.arange(values.size), values, 1), np.arange(values.size))
    about = values - line
    crossings = np.count_nonzero(np.diff(np.sign(about)) != 0)
    rough = float(np.std(np.diff(about, 2)))
    return float(np.std(about)) / rough if crossings >= 4 and rough > 0 else 0.0


def _timing(table: Table, time: str | None) -> LookedTime | None:
    if time is None:
        return None
    try:
        stamps, _ = read_time(table, time, None)
        stamps = stamps[np.isfinite(stamps)]
        found = diagnose_times(stamps)
    except RecordingError as error:
        return LookedTime(time, None, None, (), str(error))
    gaps = tuple({"start_s": gap.start_s, "stop_s": gap.stop_s, "missing": gap.missing} for gap in found.gaps)
    rate, lasts = 1.0 / found.step_s, float(stamps[-1] - stamps[0])
    sentence = f"{found.sentence}; {number(rate, 4, 'Hz')}, {number(float(np.ptp(stamps)), 4, 's')}"
    return LookedTime(time, rate, lasts, gaps, sentence)


def _tried(path: Path, time: str | None, response: str, drive: str | None, asked: _Asked) -> tuple[Gaps, str]:
    """Return how gaps must be taken for the import to do well, and why it cannot where it does not."""
    refusal = ""
    ways: tuple[Gaps, ...] = ("refuse", "bridge", "split") if drive is None else ("refuse", "split")
    for gaps in ways:
        rate = None if time is not None else asked.rate_hz or 1.0
        try:
            recording = read(
                path,
                time=time,
                response=response,
                drive=drive,
                gaps=gaps,
                run=asked.run,
                columns=asked.columns,
                rate_hz=rate,
            )
        except (RecordingError, UnitError) as error:
            refusal = refusal or str(error)
            continue
        if gaps == "bridge" and not _short_gaps(recording["time_s"].values, np.asarray(recording[_channel(recording)])):
            continue
        return gaps, ""
    return "refuse", refusal


def _channel(recording: Any) -> str:
    return "torsion_rad" if "torsion_rad" in recording else "response"


def _short_gaps(time_s: Array, values: Array) -> bool:
    """Return whether the longest step is shorter than half a period, as crossings of the middle tell it."""
    crossings = int(np.count_nonzero(np.diff(np.sign(values - np.median(values)))))
    return bool(np.diff(time_s).max() < float(time_s[-1] - time_s[0]) / max(crossings, 1))
