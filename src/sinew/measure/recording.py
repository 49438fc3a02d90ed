"""Recordings, put together and taken apart into segments."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from sinew.measure.doors import as_numbers, as_seconds
from sinew.measure.errors import SchemaError, SpecError
from sinew.measure.schema import (
    RECORDING_SCHEMA,
    SAMPLE_VARIABLES,
    SEGMENT_VARIABLES,
    SPATIAL_SCHEMA,
    SPATIAL_SEGMENTS,
    Excitation,
    SegmentKind,
    validate_recording,
)
from sinew.measure.timing import choose_stretch

if TYPE_CHECKING:
    import xarray as xr

REGISTERS_ATTRIBUTE = "registers"
"""Attribute of a recording from a bench: the motors' registers as they were read back, as JSON."""

SOURCES = {
    "twin": "simulated by the physics twin",
    "emulator": "recorded on the emulated bench: no motor moved",
    "bench": "recorded on the bench",
    "import": "an imported recording",
}
"""What a recording's attribute `source` says, in words."""


FEWEST_FREQUENCIES = 6
"""So many a sweep needs for a resonance to be read off its curve."""


def too_few_frequencies(count: int) -> str:
    """Return why a sweep of so many frequencies has no resonance."""
    return f"too few frequencies for a resonance: found {count}, expected at least {FEWEST_FREQUENCIES}; measure more"


@dataclass(frozen=True)
class Segment:
    """What was asked for in one stretch of a recording.

    kind: settle, steady, ring-down or idle.
    pretension_mm: common shortening of the tendons from first contact [mm].
    frequency_hz, amplitude_deg: of the drive; NaN where there is none (idle, foreign ring-down). Tracking has no
    frequency of its own, and its amplitude is the one that was to be held.
    repeat: index of the repetition, from 0.
    bend_deg, azimuth_deg: the pose; see `sinew.plan.pose`. excitation: what moves the head. amplitude_mm: of tendons
    that drive it, NaN where they hold still. impulse_n_m_s: of a blow; NaN where there is none.
    """

    kind: SegmentKind
    pretension_mm: float
    frequency_hz: float
    amplitude_deg: float
    repeat: int
    bend_deg: float = 0.0
    azimuth_deg: float = 0.0
    excitation: Excitation = "lever"
    amplitude_mm: float = math.nan
    impulse_n_m_s: float = math.nan

    @property
    def is_spatial(self) -> bool:
        """Whether the head is bent, or moved by something else than the lever."""
        return self.bend_deg != 0.0 or self.excitation != "lever"


def build_recording(
    samples: Mapping[str, ArrayLike],
    segments: Sequence[Segment],
    row_size: Sequence[int],
    attrs: Mapping[str, Any],
    units: Mapping[str, str] | None = None,
) -> "xr.Dataset":
    """Return a valid recording.

    samples: arrays by schema name, all of the same first length; see `SAMPLE_VARIABLES`.
    segments, row_size: what was asked for, and how many samples it got, in order.
    attrs: provenance; see `sinew.measure.files.netcdf`.
    units: units of `response` and `drive`, which the schema leaves open.
    Raises SchemaError where the parts do not fit together.
    """
    import xarray as xr

    variables: dict[str, tuple[tuple[str, ...], ArrayLike, dict[str, str]]] = {}
    for name, values in samples.items():
        if name not in SAMPLE_VARIABLES:
            raise SchemaError(f"unknown sample variable {name!r}, expected one of {', '.join(SAMPLE_VARIABLES)}")
        row = SAMPLE_VARIABLES[name]
        unit = (units or {}).get(name, "") if row.unit == "*" else row.unit
        given = as_seconds(values, name) if name == "time_s" else _numbers(values, name)
        variables[name] = (row.dims, given, {"units": unit, "long_name": row.meaning})
    columns: dict[str, ArrayLike] = {
        "row_size": np.asarray(row_size, dtype=np.int64),
        "kind": np.asarray([s.kind for s in segments], dtype=object),
        "pretension_mm": np.asarray([s.pretension_mm for s in segments], dtype=float),
        "frequency_hz": np.asarray([s.frequency_hz for s in segments], dtype=float),
        "amplitude_deg": np.asarray([s.amplitude_deg for s in segments], dtype=float),
        "repeat": np.asarray([s.repeat for s in segments], dtype=np.int64),
    }
    spatial = any(s.is_spatial for s in segments)
    if spatial:
        for name in SPATIAL_SEGMENTS:
            kind: Any = object if name == "excitation" else float
            columns[name] = np.asarray([getattr(s, name) for s in segments], dtype=kind)
    for name, values in columns.items():
        row = SEGMENT_VARIABLES[name]
        variables[name] = (row.dims, values, {"units": row.unit, "long_name": row.meaning})
    try:
        dataset = xr.Dataset(variables)
    except ValueError as error:
        raise SchemaError(f"samples do not fit together: {error}") from error
    dataset["row_size"].attrs["sample_dimension"] = "sample"
    # A straight recording without an orientation is what it always was: readers of the first schema read it.
    schema = SPATIAL_SCHEMA if spatial or "orientation" in samples else RECORDING_SCHEMA
    dataset.attrs = {"Conventions": "CF-1.11", "featureType": "timeSeries", **attrs, "schema": schema}
    return validate_recording(dataset)


def _numbers(values: ArrayLike, name: str) -> ArrayLike:
    """Return samples in the precision they have where they are a plain array of numbers, else as float64."""
    if type(values) is np.ndarray and values.dtype.kind in "fiu":
        return values
    return as_numbers(values, name)


def segment_slices(recording: "xr.Dataset") -> list[slice]:
    """Return the sample slice of every segment, in order."""
    ends = map(int, np.cumsum(recording["row_size"].values))
    return [slice(*edges) for edges in pairwise([0, *ends])]


def iterate_segments(recording: "xr.Dataset", kind: SegmentKind | None = None) -> Iterator[tuple[int, Segment, slice]]:
    """Yield (index, segment, sample slice) of every segment, or of those of one kind."""
    names = ["kind", "pretension_mm", "frequency_hz", "amplitude_deg", "repeat"]  # in the order of Segment's fields
    if all(name in recording for name in SPATIAL_SEGMENTS):
        names += SPATIAL_SEGMENTS
    columns = [recording[name].values.tolist() for name in names]
    columns[names.index("repeat")] = list(map(int, columns[names.index("repeat")]))
    for index, (where, row) in enumerate(zip(segment_slices(recording), zip(*columns, strict=True), strict=True)):
        if kind is None or row[0] == kind:
            yield index, Segment(*row), where


def read_registers(recording: "xr.Dataset") -> list[dict[str, Any]]:
    """Return with which registers the motors measured, one mapping for each run that wrote to the recording.

    run: its number, from 1. tendon_mode: position, position-with-current-limit or current. motors: by name ("tendon 1",
    "drive"), each with its id, its model, and registers: counts by the name in the control table, as they were read
    back after the plan's mode was set. Empty for a recording of the twin, an import, and one older than this attribute.
    Raises SchemaError where the attribute is not of that form.
    """
    text = recording.attrs.get(REGISTERS_ATTRIBUTE, "[]")
    try:
        runs = json.loads(text)
    except (TypeError, ValueError) as error:
        raise SchemaError(f"attribute {REGISTERS_ATTRIBUTE!r} is not JSON ({error}); was the file edited?") from error
    if not isinstance(runs, list) or not all(isinstance(run, dict) and "motors" in run for run in runs):
        raise SchemaError(f"attribute {REGISTERS_ATTRIBUTE!r} holds no list of runs with motors; was the file edited?")
    return runs


# An imported recording is cut to the stretch of time that the user names.


def cut_recording(recording: "xr.Dataset", start_s: float | None, stop_s: float | None) -> "xr.Dataset":
    """Return the samples of an imported recording from start_s to stop_s, both included [s]; None leaves an end open.

    The times are those of the recording, as in the file it came from. Segments without a sample left are dropped, and
    `import_notes` tells of the cut. Raises SpecError for a recording that was not imported, whose segments mean
    something, and TimeError where start is not before stop or nothing is left.
    """
    if start_s is None and stop_s is None:
        return recording
    if recording.attrs.get("source") != "import":
        raise SpecError(
            "start and stop choose a stretch of a CSV file or of an imported recording; this one is a campaign whose "
            "segments are analysed whole; leave them out"
        )
    time = recording["time_s"].values
    kept = choose_stretch(time, start_s, stop_s, "recording")
    sizes = np.array([int(kept[where].sum()) for where in segment_slices(recording)], dtype=np.int64)
    cut = recording.isel(sample=np.flatnonzero(kept), segment=np.flatnonzero(sizes))
    cut["row_size"] = ("segment", sizes[sizes > 0], recording["row_size"].attrs)
    note = f"cut to {time[kept].min():g} to {time[kept].max():g} s"
    told = str(recording.attrs.get("import_notes", ""))
    cut.attrs = {k: v for k, v in recording.attrs.items() if k != "content_hash"} | {
        "import_notes": f"{told}\n{note}" if told else note
    }
    return validate_recording(cut)
