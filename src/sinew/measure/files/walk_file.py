"""Files of a walking person's sensors or markers.

Two kinds of table, as CSV or as NumPy's npz:

- inertial sensors: columns such as `hip_gyr_x`, `hip_acc_x` (in an npz file arrays `hip_gyr` of shape (n, 3));
- markers: columns such as `LASI_x_mm`, a left and a right one for each part of the body.

The unit in a column's name counts (`gyr_x_deg_s`, `LASI_x_mm`), else rad/s, m/s² and m.
"""

import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd  # type: ignore[import-untyped,unused-ignore]

from sinew.measure.arrays import Array
from sinew.measure.errors import FileError, RecordingError, TimeError
from sinew.measure.files.csv import Table, find_columns, read_table
from sinew.measure.timing import choose_stretch, straighten_times
from sinew.measure.units import convert, unit_in_name

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
_TIMES = ("t", "time", "t_s", "time_s", "timestamp", "t_ms", "time_ms", "timestamp_ms", "timestamp_us")
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
    Raises FileError for a file that is no table, RecordingError, TimeError or UnitError with one sentence.
    """
    asked = columns or WalkColumns()
    table = _read_arrays(path) if path.suffix.lower() == ".npz" else read_table(path)
    stamps = _time(table, asked.time)
    channels, names = _channels(table, asked)
    values = np.column_stack(list(channels.values()))
    notes: list[str] = []
    rows = _stretch(stamps, values, start_s, stop_s, notes)
    timeline = straighten_times(stamps[rows], gaps="split", rows=rows.start + 1)
    piece = max(timeline.pieces, key=lambda one: one.stop - one.start)
    if len(timeline.pieces) > 1:
        notes.append(f"the time stamps have gaps; taken is the longest of {len(timeline.pieces)} pieces")
    time = timeline.time_s[piece]
    even, step = _evenly(time)
    taken = _bridged(values[rows][piece])
    signals = dict(zip(channels, (np.interp(even, time, taken[:, i]) for i in range(taken.shape[1])), strict=True))
    notes.append(f"read {even[0]:.5g} to {even[-1]:.5g} s at {1 / step:.4g} Hz")
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


def _time(table: Table, spec: str | None) -> Array:
    if spec is None:
        present = {str(name).lower(): str(name) for name in table.columns}
        spec = next((present[name] for name in _TIMES if name in present), None)
        if spec is None:
            raise RecordingError(
                f"no column of time found among {_listed(table.columns)}; name it with --time COL:unit"
            )
    names, stated = find_columns(table, spec)
    if len(names) > 1:
        raise RecordingError(f"time needs one column, found {len(names)}: {', '.join(names)}")
    unit = stated or unit_in_name(names[0]) or "s"
    stamps = _numbers(table, names[0]) * convert(unit, "s")
    if not np.isfinite(stamps).all():
        row = int(np.flatnonzero(~np.isfinite(stamps))[0]) + 1
        raise TimeError(f"time stamp in data row {row} is not a number; fill it in or remove the row")
    return stamps


def _channels(table: Table, asked: WalkColumns) -> tuple[dict[str, Array], dict[str, str]]:
    """Return (signals in SI units by "role/kind/axis", names of the bodies by role)."""
    if asked.yaw is not None:
        columns, stated = find_columns(table, asked.yaw)
        unit = stated or unit_in_name(columns[0]) or "rad"
        return {"yaw": np.mean([_numbers(table, name) for name in columns], axis=0) * convert(unit, "rad")}, {}
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
    found: dict[str, Array] = {}
    for role, name in chosen.items():
        if "," in name:
            found |= _marker_signals(table, role, name, markers, asked.up)
        else:
            found |= _sensor_signals(table, role, name, sensors, asked)
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


def _sensor_signals(
    table: Table, role: str, name: str, sensors: Mapping[str, Mapping[str, str]], asked: WalkColumns
) -> dict[str, Array]:
    if name not in sensors:
        raise RecordingError(
            f"no sensor {name!r} with gyroscope and accelerometer; columns {name}_gyr_x, {name}_acc_x and so on are "
            f"expected, and these are whole: {_listed(sensors)}; a pair of markers is LEFT,RIGHT"
        )
    stated = {"gyr": (asked.gyro_unit, "rad/s"), "acc": (asked.acceleration_unit, "m/s2")}
    found: dict[str, Array] = {}
    for key, column in sensors[name].items():
        unit, si = stated[key[:3]]
        found[f"{role}/{key}"] = _numbers(table, column) * convert(unit or unit_in_name(column) or si, si)
    turning = float(np.nanmedian(np.linalg.norm([found[f"{role}/gyr/{axis}"] for axis in "xyz"], axis=0)))
    if turning > _FAST_RAD_S:
        raise RecordingError(
            f"the gyroscope {name!r} reads {turning:.3g} rad/s in the median, faster than a body turns in walking; "
            "name its unit with --gyro-unit (deg/s)"
        )
    gravity = float(np.nanmedian(np.linalg.norm([found[f"{role}/acc/{axis}"] for axis in "xyz"], axis=0)))
    if not _REST_M_S2[0] < gravity < _REST_M_S2[1]:
        raise RecordingError(
            f"the accelerometer {name!r} reads {gravity:.3g} m/s² in the median, expected about 9.81; "
            "name its unit with --acc-unit (g_0 for multiples of gravity)"
        )
    return found


def _marker_signals(
    table: Table, role: str, name: str, markers: Mapping[str, Mapping[str, str]], up: str
) -> dict[str, Array]:
    pair = [part.strip() for part in name.split(",")]
    missing = [part for part in pair if part not in markers]
    if len(pair) != 2 or missing:
        wrong = f"no marker {missing[0]!r}" if missing else f"found {len(pair)} markers in {name!r}"
        raise RecordingError(f"{wrong}; expected two, LEFT,RIGHT, out of {_listed(markers)}")
    turned = {"z": "xyz", "y": "zxy", "x": "yzx"}[up]
    found = {}
    for side, part in zip(("left", "right"), pair, strict=True):
        for axis, source in zip("xyz", turned, strict=True):
            column = markers[part][source]
            found[f"{role}/{side}/{axis}"] = _numbers(table, column) * convert(unit_in_name(column) or "m", "m")
    return found


def _numbers(table: Table, name: str) -> Array:
    """Return one column, NaN where a cell is empty. Raises RecordingError for text."""
    column = table[name]
    values = np.array(pd.to_numeric(column, errors="coerce"), dtype=float)
    values[~np.isfinite(values)] = np.nan
    for row in np.flatnonzero(np.isnan(values)) if not pd.api.types.is_numeric_dtype(column) else ():
        cell = column.iloc[int(row)]
        if isinstance(cell, str) and cell.strip().lower() not in ("", "nan", "na", "null", "-"):
            raise RecordingError(f"column {name!r} holds {cell!r} in data row {int(row) + 1}, expected a number")
    return values


def _stretch(stamps: Array, values: Array, start_s: float | None, stop_s: float | None, notes: list[str]) -> slice:
    """Return the rows of the longest stretch whose holes are all short enough to be bridged."""
    inside = choose_stretch(stamps, start_s, stop_s)
    whole = np.flatnonzero(inside & np.isfinite(values).all(axis=1))
    if whole.size < 2:
        raise RecordingError("no two samples where all columns hold numbers; choose other columns or another stretch")
    breaks = np.flatnonzero((np.diff(whole) > 1) & (np.diff(stamps[whole]) > _BRIDGED_S))
    parts = np.split(whole, breaks + 1)
    longest = max(parts, key=lambda part: part[-1] - part[0])
    rows = slice(int(longest[0]), int(longest[-1]) + 1)
    holes = rows.stop - rows.start - longest.size
    if holes:
        notes.append(f"{holes} samples with missing values were bridged by straight lines (holes of at most 0.1 s)")
    if len(parts) > 1:
        notes.append(f"values are missing; taken is the longest of {len(parts)} whole stretches")
    return rows


def _bridged(values: Array) -> Array:
    return np.asarray(pd.DataFrame(values).interpolate(limit_direction="both"), dtype=float)


def _evenly(time: Array) -> tuple[Array, float]:
    step = (time[-1] - time[0]) / (time.size - 1)
    if not 1.0 / step >= _LOWEST_RATE_HZ:
        raise TimeError(f"found {1 / step:.3g} samples per second, expected at least {_LOWEST_RATE_HZ:g} for a gait")
    return time[0] + step * np.arange(time.size), float(step)


def _body(role: str, signals: Mapping[str, Array], name: str) -> Imu | MarkerPair:
    def triple(kind: str) -> Array:
        return np.ascontiguousarray(np.column_stack([signals[f"{role}/{kind}/{axis}"] for axis in "xyz"]))

    if "," in name:
        return MarkerPair(triple("left"), triple("right"))
    return Imu(triple("gyr"), triple("acc"))


def _listed(names: "Sequence[object] | Mapping[str, object] | pd.Index") -> str:
    listed = [str(name) for name in names]
    return (", ".join(listed[:12]) + (f" and {len(listed) - 12} more" if len(listed) > 12 else "")) or "none"
