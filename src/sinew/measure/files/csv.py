"""CSV files: columns that become a recording, and a recording that becomes columns.

Import: the columns of time, response and drive are named by specifications "COL" or "COL:unit" (see
`sinew.measure.files.table.find_columns`). Without a unit, the one in the column's own name counts ("angle_deg",
"x [mm]"), else 1, and seconds for time. An angle becomes `torsion_rad` (as drive: `drive_rad`), anything else
`response` (`drive`) in SI units. An angular rate stays a rate, `response` in rad/s: where the sensor sat and what its
other axes read is not known, so it is not passed off as the gyroscope of the schema. Its frequency and damping are
those of the angle.

Export: one flat table, a row for each sample, every channel with its unit in its name. `import_csv` reads it.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd  # type: ignore[import-untyped,unused-ignore]
import xarray as xr

from sinew.measure.arrays import Array
from sinew.measure.doors import as_path, as_seconds
from sinew.measure.errors import RecordingError, TimeError, UnitError
from sinew.measure.files.netcdf import provenance, write_atomically
from sinew.measure.files.table import Table, find_columns, numbers, read_table
from sinew.measure.recording import Segment, build_recording
from sinew.measure.schema import SAMPLE_VARIABLES, SEGMENT_VARIABLES, SegmentKind, validate_recording
from sinew.measure.timing import refuse_backwards, straighten_times
from sinew.measure.units import canonical_unit, convert, unit_in_name, unit_suffix

_KINDS: dict[str, SegmentKind] = {"ring-down": "ring-down", "sweep": "steady", "broadband": "steady"}
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
    kind: Literal["ring-down", "sweep", "broadband"] = "ring-down",
    start_s: float | None = None,
    stop_s: float | None = None,
    gaps: Literal["refuse", "split"] = "refuse",
    pretension_mm: float = 0.0,
) -> xr.Dataset:
    """Return a CSV file, or a DataFrame, as a recording.

    path: of the file; or a pandas DataFrame, whose column of the time may hold dates or durations.
    time, response, drive: "COL", "COL:unit" or "COL,COL,COL:unit" (the mean of several columns).
    kind: a ring-down becomes a ring-down segment, a sweep one steady segment that analysis divides by the drive, a
        broadband record (chirp, noise, multisine) one that it takes whole. Frequency and amplitude of the drive are
        not known and NaN.
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
    if kind not in _KINDS:
        raise RecordingError(f"unknown kind {kind!r}, expected one of {', '.join(_KINDS)}")
    table = read_table(path)
    specs = {"response": response} | ({"drive": drive} if drive else {})
    for spec in specs.values():
        find_columns(table, spec)
    stamps = _read_time(table, time)
    rows = _rows(stamps, start_s, stop_s)
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
    segment = Segment(_KINDS[kind], float(pretension_mm), math.nan, math.nan, 0)
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
    return recording.assign_attrs(import_kind=kind) if kind == "broadband" else recording


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
        refuse_backwards(stamps)
        return stamps
    factor = convert(_unit_of(names, stated, "s"), "s")
    stamps = numbers(table, names[0]) * factor
    refuse_backwards(stamps)
    return stamps


def _read_signal(table: Table, spec: str, rows: slice) -> tuple[Array, str]:
    """Return (mean of the named columns in SI units and radians, shape (n,); that unit)."""
    names, stated = find_columns(table, spec)
    unit, factor = canonical_unit(_unit_of(names, stated, "1"))
    return np.mean([numbers(table, name, rows) for name in names], axis=0) * factor, unit


def _rows(stamps: Array, start_s: float | None, stop_s: float | None) -> slice:
    start, stop = (-math.inf if start_s is None else start_s), (math.inf if stop_s is None else stop_s)
    if not start < stop:
        raise TimeError(f"found start {start:g} s and stop {stop:g} s, expected start before stop")
    rows = slice(int(np.searchsorted(stamps, start, "left")), int(np.searchsorted(stamps, stop, "right")))
    if rows.start >= rows.stop:
        raise TimeError(
            f"no samples from {start:g} s to {stop:g} s; the file runs from {stamps[0]:g} s to {stamps[-1]:g} s"
        )
    return rows


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
