"""CSV files: columns that become a recording, and a recording that becomes columns.

Import: the columns of time, response and drive are named by specifications "COL" or "COL:unit" (see
`find_columns`). Without a unit, the one in the column's own name counts ("angle_deg",
"x [mm]"), else 1, and seconds for time. An angle becomes `torsion_rad` (as drive: `drive_rad`), anything else
`response` (`drive`) in SI units. An angular rate stays a rate, `response` in rad/s: where the sensor sat and what its
other axes read is not known, so it is not passed off as the gyroscope of the schema. Its frequency and damping are
those of the angle.

Export: one flat table, a row for each sample, every channel with its unit in its name. `import_csv` reads it.
"""

import csv
import difflib
import io
import math
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import pandas as pd  # type: ignore[import-untyped,unused-ignore]
import xarray as xr
from numpy.typing import NDArray

from sinew.measure.arrays import Array
from sinew.measure.doors import as_path, as_seconds, most_bytes
from sinew.measure.errors import FileError, RecordingError, UnitError
from sinew.measure.files.netcdf import provenance, write_atomically
from sinew.measure.recording import Segment, build_recording
from sinew.measure.schema import IMPORT_SEGMENTS, SAMPLE_VARIABLES, SEGMENT_VARIABLES, ReadKind, validate_recording
from sinew.measure.timing import choose_stretch, refuse_backwards, straighten_times
from sinew.measure.units import canonical_unit, convert, unit_in_name, unit_suffix

# A pandas DataFrame with one column for each field and the names as the file has them (duplicates kept).
Table: TypeAlias = "pd.DataFrame"

_DELIMITERS = (",", ";", "\t")
_COMMENTS = ("#", "%", "//")
_BINARY = {
    b"\x89HDF": "HDF5 or NetCDF",
    b"CDF": "NetCDF",
    b"PK\x03\x04": "a zip archive or an Excel file",
    b"MATLAB": "MAT",
}
_TEXT_GROWS = 4  # bytes, text and numbers are in memory together
_SCANNED_LINES, _HEAD_SIZE = 50, 1_000_000


def read_table(path: "Path | str | Table") -> Table:
    """Return the table of a text file as a DataFrame, columns named by its header; a DataFrame is one already.

    The delimiter (comma, semicolon, tab, else blanks), a decimal comma, comment lines before the header (#, %, //)
    and a header that is itself a comment are recognised. Cells are not judged here: see `numbers`.
    Raises FileError for a file that is absent, empty, binary, without header or without rows.
    """
    if isinstance(path, pd.DataFrame):
        return path.set_axis([str(name) for name in path.columns], axis=1)
    path = as_path(path)
    text = _text(path)
    lines = text[:_HEAD_SIZE].splitlines(keepends=True)
    start, header = _find_header(path, lines)
    body = [line.rstrip("\r\n") for line in lines[start : start + _SCANNED_LINES] if line.strip()]
    if not body:
        raise FileError(f"{path} has a header but no rows below it; record again or choose another file")
    delimiter = _sniff([header, *body])
    names = [name.strip() for name in _fields(header, delimiter)]
    counts = [len(_fields(line, delimiter)) for line in body]
    usual = max(counts, key=counts.count)
    if usual != len(names):
        raise _not_a_table(path, len(names), f"most rows have {usual}")
    decimal = "," if delimiter in (";", "\t") and not any("." in line for line in body) else "."
    frame = _parse(path, text[sum(map(len, lines[:start])) :], len(names), delimiter, decimal)
    frame.columns = pd.Index(names)
    unnamed_and_empty = np.array([not name for name in names]) & frame.isna().all().to_numpy()
    return frame.loc[:, ~unnamed_and_empty]


def _text(path: Path) -> str:
    if path.is_dir():
        raise FileError(f"{path} is a folder, expected a CSV file")
    try:
        if (size := path.stat().st_size) > (most := most_bytes() // _TEXT_GROWS):
            raise FileError(
                f"{path} has {size / 1e6:.0f} MB, expected at most {most / 1e6:.0f} MB of text in the memory there "
                "is; cut it, or read it on a computer with more"
            )
        raw = path.read_bytes()
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}") from error
    if not raw.strip():
        raise FileError(f"{path} is empty; expected a header line with column names and rows of numbers below it")
    kind = next((kind for magic, kind in _BINARY.items() if raw.startswith(magic)), None)
    if kind:
        raise FileError(
            f"{path} is not a text table, it is {kind}; export it as CSV, or give a recording without columns"
        )
    for encoding in ("utf-16", "utf-8-sig", "cp1252"):
        if encoding == "utf-16" and not raw.startswith((b"\xff\xfe", b"\xfe\xff")):
            continue
        try:
            text = raw.decode(encoding)
        except UnicodeDecodeError:
            continue
        controls = sum(text.count(chr(code)) for code in range(32) if chr(code) not in "\t\n\r\f")
        if controls == 0:
            return text
    raise FileError(f"{path} is not a text table (it holds binary data); expected CSV with a header line")


def _find_header(path: Path, lines: Sequence[str]) -> tuple[int, str]:
    """Return (index of the first line below the header, header text)."""
    comment = ""
    for index, line in enumerate(lines):
        text = line.strip()
        if not text:
            continue
        if text.startswith(_COMMENTS):
            comment = text.lstrip("#%/ ")
            continue
        delimiter = _sniff([line])
        fields = _fields(line, delimiter)
        if not all(_is_number(field) for field in fields if field.strip()):
            return index + 1, line.rstrip("\r\n")
        if len(_fields(comment, _sniff([comment, line]))) == len(fields) and comment and not _is_number(comment):
            return index, comment
        raise FileError(
            f"{path} has no header: its first line is {text[:60]!r}; "
            "put a line with the names of the columns above it, such as time_s,angle_deg"
        )
    raise FileError(f"{path} holds only comments; expected a header line and rows of numbers")


def _is_number(text: str) -> bool:
    try:
        float(text.strip().replace(",", "."))
    except ValueError:
        return False
    return True


def _fields(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])


def _sniff(lines: Sequence[str]) -> str | None:
    """Return the delimiter that gives most lines the same number (above one) of fields; None means blanks."""
    best, best_score = None, (0, 0)
    for delimiter in _DELIMITERS:
        counts = [len(_fields(line, delimiter)) for line in lines]
        usual = max(counts, key=counts.count)
        if usual > 1 and counts[0] > 1 and (counts.count(usual), -_DELIMITERS.index(delimiter)) > best_score:
            best, best_score = delimiter, (counts.count(usual), -_DELIMITERS.index(delimiter))
    return best or next((delimiter for delimiter in _DELIMITERS if delimiter in lines[0]), None)


def _parse(path: Path, text: str, width: int, delimiter: str | None, decimal: str) -> Table:
    options: dict[str, Any] = {"sep": delimiter or r"\s+", "decimal": decimal, "skipinitialspace": True}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return pd.read_csv(
                io.StringIO(text),
                header=None,
                names=range(width),
                index_col=False,
                low_memory=False,
                comment="#",
                **options,
            )
        except (pd.errors.ParserError, pd.errors.ParserWarning, pd.errors.EmptyDataError, ValueError) as error:
            reason = " ".join(str(error).split()).removeprefix("Error tokenizing data. C error: ")
            raise _not_a_table(path, width, reason) from error


def _not_a_table(path: Path, width: int, reason: str) -> FileError:
    return FileError(
        f"{path} is not a table of {width} columns as its header says ({reason}); "
        "the first line must name the columns, and lines above it must start with #"
    )


def find_columns(table: Table, spec: str) -> tuple[list[str], str | None]:
    """Return (columns, unit) that a specification "COL", "COL:unit" or "COL,COL,COL:unit" names.

    An exact column name goes first, whatever it holds; the unit stands after the last colon; several columns are
    separated by commas. The unit is None where none was written.
    Raises RecordingError for a column that is missing or not unique, with the columns that were found.
    """
    present = [str(name) for name in table.columns]
    head, colon, unit = spec.rpartition(":")
    for text, stated in ((spec, None), (head, unit.strip())):
        if text in present:
            return [_unique(table, text)], stated
        names = [name.strip() for name in text.split(",")]
        if all(name in present for name in names):
            return [_unique(table, name) for name in names], stated
        if not colon:
            break
    wanted = (head if colon else spec).split(",")
    raise RecordingError(_missing(next((n.strip() for n in wanted if n.strip() not in present), spec), present))


def _unique(table: Table, name: str) -> str:
    count = int((table.columns == name).sum())
    if count > 1:
        raise RecordingError(f"column {name!r} occurs {count} times; give the columns different names")
    return name


def _missing(name: str, present: Sequence[str]) -> str:
    close = difflib.get_close_matches(name.lower(), [p.lower() for p in present], n=1, cutoff=0.5)
    meant = next((p for p in present if close and p.lower() == close[0]), None)
    listed = ", ".join(present[:24]) + (f" and {len(present) - 24} more" if len(present) > 24 else "")
    return f"no column {name!r}{f', did you mean {meant!r}?' if meant else ';'} columns found: {listed}"


def numbers(table: Table, name: str, rows: slice = slice(None)) -> NDArray[np.float64]:
    """Return the numbers of one column as float64, shape (n,).

    rows: the data rows that matter, the others are not judged.
    Raises RecordingError naming the first data row (from 1, below the header) that is empty, NaN, infinite or text.
    """
    column = table[name].iloc[rows]
    if column.dtype.kind in "mM" or isinstance(column.dtype, pd.DatetimeTZDtype):
        raise RecordingError(f"column {name!r} holds dates or durations, expected numbers; they can only be the time")
    values = np.asarray(pd.to_numeric(column, errors="coerce"), dtype=float)
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        row = int(bad[0]) + (rows.start or 0) + 1
        cell = column.iloc[int(bad[0])]
        if isinstance(cell, str):
            hint = "; if this row holds units, delete it and write COLUMN:unit instead" if row == 1 else ""
            raise RecordingError(f"column {name!r} holds {cell!r} in data row {row}, expected a number{hint}")
        what = "infinity" if np.isinf(values[bad[0]]) else "NaN or an empty cell"
        raise RecordingError(
            f"column {name!r} holds {what} in data row {row} ({bad.size} such rows in all); "
            "fill in or remove them, or select the rows without them by start and stop"
        )
    return values


_RATE_NOTE = (
    "the {role} is an angular rate and stays one: its frequency and damping are those of the angle, "
    "its amplitude is that of the angle times the angular frequency, and its phase leads the angle's by 90 degrees"
)
_AXES = "xyz"


def import_csv(
    path: "Path | str | Table",
    *,
    time: str,
    response: str,
    drive: str | None = None,
    kind: ReadKind = "ring-down",
    start_s: float | None = None,
    stop_s: float | None = None,
    gaps: Literal["refuse", "split"] = "refuse",
    pretension_mm: float = 0.0,
) -> xr.Dataset:
    """Return a CSV file, or a DataFrame, as a recording.

    path: of the file; or a pandas DataFrame, whose column of the time may hold dates or durations.
    time, response, drive: "COL", "COL:unit" or "COL,COL,COL:unit" (the mean of several columns).
    kind: a ring-down becomes a ring-down segment, a sweep one steady segment that analysis divides by the drive, a
        broadband record (chirp, noise, multisine) and one of hammer blows (impact) one that it takes whole; auto leaves
        the kind to analysis. Frequency and amplitude of the drive are not known and NaN.
    start_s, stop_s: the part to take, in the file's own time [s].
    gaps: refuse a record with missing samples, or split it into segments there.
    pretension_mm: written into every segment [mm].
    What was found and done with the time stamps is text in the attribute `import_notes`.
    Raises FileError, RecordingError, TimeError or UnitError with one sentence.
    """
    if not (math.isfinite(pretension_mm) and pretension_mm >= 0):
        raise RecordingError(
            f"found pretension_mm = {pretension_mm:g}, expected 0 or more: it counts from first contact"
        )
    if kind not in IMPORT_SEGMENTS:
        raise RecordingError(f"unknown kind {kind!r}, expected one of {', '.join(IMPORT_SEGMENTS)}")
    table = read_table(path)
    specs = {"response": response} | ({"drive": drive} if drive else {})
    for spec in specs.values():
        find_columns(table, spec)
    stamps = _read_time(table, time)
    chosen = np.flatnonzero(choose_stretch(stamps, start_s, stop_s))
    rows = slice(int(chosen[0]), int(chosen[-1]) + 1)
    timeline = straighten_times(stamps[rows], gaps=gaps, first_row=rows.start + 1)
    samples: dict[str, Array] = {"time_s": timeline.time_s}
    units: dict[str, str] = {}
    notes = [f"time: {note}" for note in timeline.notes]
    for role, spec in specs.items():
        values, unit = _read_signal(table, spec, rows)
        name = {"response": "torsion_rad", "drive": "drive_rad"}[role] if unit == "rad" else role
        samples[name], units[name] = values, unit
        notes += [_RATE_NOTE.format(role=role)] if unit == "rad/s" else []
    kept = np.concatenate([np.arange(piece.start, piece.stop) for piece in timeline.pieces])
    segment = Segment(IMPORT_SEGMENTS[kind], float(pretension_mm), math.nan, math.nan, 0)
    recording = build_recording(
        {name: values[kept] for name, values in samples.items()},
        [segment] * len(timeline.pieces),
        [piece.stop - piece.start for piece in timeline.pieces],
        provenance(
            "import",
            import_file="" if isinstance(path, pd.DataFrame) else as_path(path).name,
            import_time=time,
            import_response=response,
            import_drive=drive or "",
            import_notes="\n".join(notes),
        ),
        units,
    )
    return recording if kind in ("ring-down", "sweep") else recording.assign_attrs(import_kind=kind)


def _unit_of(names: Sequence[str], stated: str | None, default: str) -> str:
    if stated is not None:
        return stated
    found = {unit_in_name(name) or default for name in names}
    if len(found) > 1:
        raise UnitError(
            f"columns {', '.join(names)} have different units ({', '.join(sorted(found))}); average one kind"
        )
    return found.pop()


def _read_time(table: Table, spec: str) -> Array:
    """Return the time stamps of the whole file [s], shape (n,)."""
    names, stated = find_columns(table, spec)
    if len(names) > 1:
        raise RecordingError(f"time needs one column, found {len(names)}: {', '.join(names)}")
    column = table[names[0]]
    if column.dtype.kind in "mM" or isinstance(column.dtype, pd.DatetimeTZDtype):
        if stated is not None:
            raise UnitError(f"the time column {names[0]!r} holds dates or durations, which need no unit; leave it out")
        stamps = as_seconds(column)
    else:
        stamps = numbers(table, names[0]) * convert(_unit_of(names, stated, "s"), "s")
    refuse_backwards(stamps)
    return stamps


def _read_signal(table: Table, spec: str, rows: slice) -> tuple[Array, str]:
    """Return (mean of the named columns in SI units and radians, shape (n,); that unit)."""
    names, stated = find_columns(table, spec)
    unit, factor = canonical_unit(_unit_of(names, stated, "1"))
    return np.mean([numbers(table, name, rows) for name in names], axis=0) * factor, unit


def export_csv(recording: xr.Dataset, path: Path | str) -> None:
    """Write a recording as one flat table, atomically: a row for each sample, segment columns repeated in each.

    Channels with several columns get one for each (`gyro_x_rad_s`, `tendon_1_current_a`); numbers are written so that
    they read back unchanged. Rig, plan and other attributes are not in the table.
    Raises SchemaError where it is not a recording, FileError where the file cannot be written.

    >>> import tempfile, pandas as pd
    >>> import sinew as sn
    >>> recording = sn.read(pd.DataFrame({"t": range(50), "x": [0.0, 1.0] * 25}), time="t", response="x")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     sn.export_csv(recording, f"{folder}/mine.csv")
    """
    validate_recording(recording)
    sizes = recording["row_size"].values
    columns: dict[str, object] = {
        "time_s": recording["time_s"].values,
        "segment": np.repeat(np.arange(sizes.size), sizes),
    }
    for name in SEGMENT_VARIABLES:
        if name == "kind":
            columns[name] = pd.Categorical(recording[name].values.astype(str)).repeat(sizes)
        elif name != "row_size":
            columns[name] = np.repeat(recording[name].values, sizes)
    for name in SAMPLE_VARIABLES:
        if name in recording and name not in columns:
            columns |= _channel_columns(name, recording[name])
    frame = pd.DataFrame(columns)
    write_atomically(path, lambda temporary: frame.to_csv(temporary, index=False))


def _channel_columns(name: str, channel: xr.DataArray) -> dict[str, Array]:
    """Return the columns of one channel by name, the unit at the end of each name."""
    if name in ("response", "drive"):
        unit = str(channel.attrs["units"])
        suffix = unit_suffix(unit)
        return {f"{name}_{suffix}" if suffix else name if unit == "1" else f"{name} [{unit}]": channel.values}
    if channel.ndim == 1:
        return {name: channel.values}
    stem, rest = name.split("_", 1)
    labels = _AXES if channel.dims[1] == "axis" else [str(i + 1) for i in range(channel.shape[1])]
    return {f"{stem}_{label}_{rest}": channel.values[:, i] for i, label in enumerate(labels)}
