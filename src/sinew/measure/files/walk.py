"""A walking person's record: which columns of a file are which sensor or marker, in SI units on an even clock."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError, TimeError
from sinew.measure.files.names import Table, find_columns, listed, time_columns, unit_in_name
from sinew.measure.read import read_stretch, read_table
from sinew.measure.units import convert

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
    requested = columns or WalkColumns()
    table = read_table(path)
    specs, names = _channels(table, requested)
    times = time_columns(table) if requested.time is None else find_columns(table, requested.time)[0]
    taken = [name for spec, _ in specs.values() for name in find_columns(table, spec)[0]]
    roles = {role: spec for role, (spec, _) in specs.items()}
    found = read_stretch(table[[*times, *taken]], roles, requested.time, None, (start_s, stop_s), gaps="bridge")
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


def _channels(table: Table, requested: WalkColumns) -> tuple[dict[str, tuple[str, str]], dict[str, str]]:
    """Return (columns with their unit, and the SI unit, by "role/kind/axis"; names of the bodies by role)."""
    if requested.yaw is not None:
        return {"yaw": (requested.yaw, "rad")}, {}
    sensors, markers = _whole_ones(table)
    names = {role: requested.bodies.get(role) or _usual(role, sensors, markers) for role in _USUAL}
    if not requested.bodies and not any(names.values()) and len(sensors) == 1:
        names["pelvis"] = next(iter(sensors))
    chosen = {role: name for role, name in names.items() if name is not None}
    if not chosen:
        raise RecordingError(
            f"no pelvis or trunk by a usual name; found the sensors {listed(sensors)} and the "
            f"markers {listed(markers)}; say --pelvis NAME, --trunk NAME, or LEFT,RIGHT for a pair of markers"
        )
    units = {"gyr": (requested.gyro_unit, "rad/s"), "acc": (requested.acceleration_unit, "m/s2")}
    found: dict[str, tuple[str, str]] = {}
    for role, name in chosen.items():
        columns = _marker_columns(name, markers, requested.up) if "," in name else _sensor_columns(name, sensors)
        for kind, column in columns.items():
            stated, si = units.get(kind[:3], (None, "m"))
            found[f"{role}/{kind}"] = f"{column}:{stated or unit_in_name(column) or si}", si
    return found, chosen


def _whole_ones(table: Table) -> tuple[dict[str, dict[str, str]], dict[str, dict[str, str]]]:
    """Return the columns "gyr/x" ... "acc/z" of each inertial sensor, "x" ... "z" of each marker, that is whole."""
    sensors: dict[str, dict[str, str]] = {}
    markers: dict[str, dict[str, str]] = {}
    for column in map(str, table.columns):
        if match := _SENSOR.match(column):
            kind = "gyr" if match["gyr"] else "acc"
            sensors.setdefault(match["stem"] or "sensor", {})[f"{kind}/{match['axis'].lower()}"] = column
        elif match := _MARKER.match(column):
            markers.setdefault(match["stem"], {})[match["axis"].lower()] = column
    whole = [{stem: one for stem, one in found.items() if len(one) == n} for found, n in ((sensors, 6), (markers, 3))]
    return whole[0], whole[1]


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
            f"expected, and these are whole: {listed(sensors)}; a pair of markers is LEFT,RIGHT"
        )
    return sensors[name]


def _marker_columns(name: str, markers: Mapping[str, Mapping[str, str]], up: str) -> dict[str, str]:
    pair = [part.strip() for part in name.split(",")]
    missing = [part for part in pair if part not in markers]
    if len(pair) != 2 or missing:
        wrong = f"no marker {missing[0]!r}" if missing else f"found {len(pair)} markers in {name!r}"
        raise RecordingError(f"{wrong}; expected two, LEFT,RIGHT, out of {listed(markers)}")
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
