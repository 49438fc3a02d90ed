"""This is where the shape of a recording is written down and checked.

A recording is an `xarray.Dataset` of samples and segments, a contiguous ragged array in the CF sense: the
samples of segment i are the `row_size[i]` samples after those of the segments before it. Angles are in
radians, everything else in SI; the few columns that a person set are in the units they were set in, and every
name carries its unit.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import xarray as xr

from sinew.measure.doors import as_dataset
from sinew.measure.errors import SchemaError

__all__ = [
    "RECORDING_SCHEMA",
    "SAMPLE_VARIABLES",
    "SEGMENT_VARIABLES",
    "SegmentKind",
    "Variable",
    "validate_recording",
]

RECORDING_SCHEMA = "sinew-recording-1"

SegmentKind = Literal["settle", "steady", "ring-down", "idle", "tracking"]


@dataclass(frozen=True)
class Variable:
    """One row of the schema: dimensions, unit, meaning, and whether a recording may lack it."""

    dims: tuple[str, ...]
    unit: str
    meaning: str
    required: bool = False


SAMPLE_VARIABLES: dict[str, Variable] = {
    "time_s": Variable(("sample",), "s", "host time of the sample, strictly increasing inside a segment", True),
    "drive_command_rad": Variable(("sample",), "rad", "commanded lever angle relative to the head plate"),
    "drive_rad": Variable(("sample",), "rad", "measured lever angle relative to the head plate (encoder)"),
    "drive_current_a": Variable(("sample",), "A", "measured current of the drive motor, signed"),
    "drive_pwm": Variable(("sample",), "1", "measured duty of the drive motor, -1..1"),
    "tendon_rad": Variable(("sample", "tendon"), "rad", "measured position of the tendon motors; pulling is positive"),
    "tendon_current_a": Variable(
        ("sample", "tendon"), "A", "measured current of the tendon motors; pulling is positive"
    ),
    "tendon_pwm": Variable(("sample", "tendon"), "1", "measured duty of the tendon motors, -1..1; pulling is positive"),
    "supply_v": Variable(("sample",), "V", "supply voltage at the motors, mean over those that told it"),
    "gyro_rad_s": Variable(("sample", "axis"), "rad/s", "gyroscope on the head plate, axes of frame H"),
    "acceleration_m_s2": Variable(("sample", "axis"), "m/s2", "accelerometer on the head plate, axes of frame H"),
    "torsion_rad": Variable(("sample",), "rad", "torsion of the head, where an angle was measured directly"),
    "tilt_rad": Variable(("sample",), "rad", "tilt of the head plate against the base plate"),
    "response": Variable(("sample",), "*", "response that is not an angle; its unit is the attribute `units`"),
    "drive": Variable(("sample",), "*", "drive that is not an angle; its unit is the attribute `units`"),
}

SEGMENT_VARIABLES: dict[str, Variable] = {
    "row_size": Variable(("segment",), "1", "number of samples in the segment", True),
    "kind": Variable(("segment",), "", "settle, steady, ring-down, idle or tracking", True),
    "pretension_mm": Variable(
        ("segment",),
        "mm",
        "commanded common shortening of the tendons from first contact; of tracking at its begin",
        True,
    ),
    "frequency_hz": Variable(
        ("segment",), "Hz", "commanded drive frequency; NaN where there is none or it moves", True
    ),
    "amplitude_deg": Variable(
        ("segment",), "deg", "commanded drive amplitude, of tracking the held one; NaN where there is none", True
    ),
    "repeat": Variable(("segment",), "1", "index of the repetition, from 0", True),
}

_RESPONSES = ("torsion_rad", "gyro_rad_s", "response")


def validate_recording(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording unchanged if it keeps the schema.

    Raises SchemaError with one sentence: what was found, what was expected.
    """
    schema = as_dataset(recording, "recording").attrs.get("schema")
    if schema != RECORDING_SCHEMA:
        raise SchemaError(f"this is not a recording of schema {RECORDING_SCHEMA!r} (found {schema!r})")
    for name, variable in {**SAMPLE_VARIABLES, **SEGMENT_VARIABLES}.items():
        _check_variable(recording, name, variable)
    if not any(name in recording for name in _RESPONSES):
        raise SchemaError(f"recording has no response: expected one of {', '.join(_RESPONSES)}")
    _check_segments(recording)
    _check_times(recording)
    return recording


def _check_variable(recording: xr.Dataset, name: str, variable: Variable) -> None:
    if name not in recording:
        if variable.required:
            raise SchemaError(f"recording lacks the variable {name!r} ({variable.meaning})")
        return
    found = recording[name]
    if found.dims != variable.dims:
        raise SchemaError(f"recording variable {name!r} has dimensions {found.dims}, expected {variable.dims}")
    unit = found.attrs.get("units", "")
    if variable.unit == "*":
        if not unit:
            raise SchemaError(f"recording variable {name!r} needs its unit in the attribute 'units'")
    elif unit != variable.unit:
        raise SchemaError(f"recording variable {name!r} has unit {unit!r}, expected {variable.unit!r}")
    if name != "kind" and found.dtype.kind not in "fiu":
        raise SchemaError(f"recording variable {name!r} holds {found.dtype} values, expected numbers")
    if variable.dims[0] == "sample" and not bool(np.isfinite(found.values).all()):
        where = int(np.argmin(np.isfinite(found.values).reshape(found.shape[0], -1).all(axis=1)))
        raise SchemaError(f"recording variable {name!r} holds NaN or infinity (first at sample {where})")


def _check_segments(recording: xr.Dataset) -> None:
    sizes = recording["row_size"].values
    total = recording.sizes["sample"]
    if sizes.size == 0 or total == 0:
        raise SchemaError("recording is empty: it needs at least one segment with samples")
    if sizes.min() < 1 or int(sizes.sum()) != total:
        raise SchemaError(f"segments claim {int(sizes.sum())} samples (smallest {int(sizes.min())}), found {total}")
    unknown = sorted(set(map(str, recording["kind"].values)) - set(get_args(SegmentKind)))
    if unknown:
        raise SchemaError(f"unknown segment kind {unknown[0]!r}, expected one of {', '.join(get_args(SegmentKind))}")
    if not (recording["pretension_mm"].values >= 0).all():
        raise SchemaError("recording has a negative or missing pretension_mm; it counts from first contact, 0 mm")


def _check_times(recording: xr.Dataset) -> None:
    steps = np.diff(recording["time_s"].values)
    ends = np.cumsum(recording["row_size"].values)[:-1]
    inside = np.ones(steps.size, dtype=bool)
    inside[ends - 1] = False
    bad = np.flatnonzero(inside & (steps <= 0))
    if bad.size:
        raise SchemaError(f"time_s does not increase at sample {int(bad[0]) + 1}")
