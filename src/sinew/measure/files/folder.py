"""A folder of runs as one dataset, whose samples are read from the files where they are computed, and not before."""

import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sinew.measure.doors import as_path
from sinew.measure.errors import FileError, SchemaError, SinewError, SpecError, how_to_install
from sinew.measure.files.netcdf import load_part, whole_netcdf
from sinew.measure.recording import Segment
from sinew.measure.schema import RECORDING_SCHEMA, SAMPLE_VARIABLES, SEGMENT_VARIABLES, SPATIAL_SCHEMA

if TYPE_CHECKING:
    import dask.array

_BLOCK = 1 << 18
"""Samples that are read at once, at most: 2 MB of a channel, 8 MB of four tendons."""

_ONE_AT_A_TIME = threading.Lock()
"""HDF5 as it is built for most is used by one thread; two that open files at once end the process."""

_SHARED = ("Conventions", "featureType", "schema")


class _Held(NamedTuple):
    """A variable of samples, as a file declares it."""

    shape: tuple[int, ...]
    kind: np.dtype[Any]
    unit: str


class _Run(NamedTuple):
    """What is known of a run without its samples. segments: attributes and segment variables of its recording."""

    name: str
    file: Path
    segments: xr.Dataset
    held: dict[str, _Held]

    @property
    def samples(self) -> int:
        return self.held["time_s"].shape[0]


def open_runs(folder: Path | str | Sequence[Path | str]) -> xr.Dataset:
    """Return the recordings in a folder as one dataset, whose samples are dask arrays: they are read when computed.

    folder: of runs (NAME/recording.nc) or of recordings (NAME.nc); or the files themselves, as from a search.
    The dataset is one long recording, the runs one after the other by name, so that `segment` and `sample` mean what
    they do in each; `run_name` says of a segment whose it is. Over `run` stand its name, `file`, numbers of `segments`
    and `samples`, and what the recordings say of themselves (rig, plan, source, started ...). Channels that a run lacks
    are NaN. Neither content hashes nor samples are checked, and no file stays open. The attribute `left_out` has a line
    for each file that is no whole recording, or whose response or drive is in another unit than the first one's.
    Raises FileError where there is no recording; SpecError without dask, which comes with the extra `cluster`. A block
    that cannot be read raises FileError when it is computed.

    >>> import tempfile, pandas as pd
    >>> import sinew as sn
    >>> swing = pd.DataFrame({"t": [0.01 * i for i in range(50)], "x": [0.0, 1.0] * 25})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for name in ("monday", "tuesday"):
    ...         sn.save_recording(sn.read(swing, time="t", response="x"), f"{folder}/{name}.nc")
    ...     runs = sn.open_runs(folder)
    ...     print(list(runs["run"].values), runs.sizes["sample"], float(runs["response"].mean()))
    ['monday', 'tuesday'] 100 0.5
    """
    try:
        import dask.array  # noqa: F401
    except ImportError as error:
        raise SpecError(f"runs as one dataset need dask; install it: {how_to_install('cluster')}") from error
    runs: list[_Run] = []
    left = []
    for name, file in _files(folder):
        try:
            runs.append(_alike(_look(name, file), runs))
        except SinewError as trouble:
            left.append(str(trouble))
    if not runs:
        raise FileError(
            f"found no recording in {folder}, neither NAME.nc nor NAME/recording.nc; name a folder of runs"
            + "".join(f"; {sentence}" for sentence in left[:1])
        )
    variables = dict(_segment_variables(runs)) | dict(_sample_variables(runs))
    made = xr.Dataset(variables, dict(_run_coordinates(runs)))
    return made.assign_attrs(
        {name: runs[0].segments.attrs[name] for name in _SHARED if name in runs[0].segments.attrs},
        left_out="\n".join(left),
    )


def _files(folder: Path | str | Sequence[Path | str]) -> list[tuple[str, Path]]:
    """Return (name, file) of what may be recordings, by name."""
    if isinstance(folder, (str, Path)):
        root = as_path(folder)
        found = [*root.glob("*.nc"), *root.glob("*/recording.nc")]
    else:
        found = [as_path(one) for one in folder]
    named = [(one.parent.name if one.name == "recording.nc" else one.stem, one.absolute()) for one in found]
    names = [name for name, _ in named]
    return sorted((name if names.count(name) == 1 else str(file), file) for name, file in named)


def _look(name: str, file: Path) -> _Run:
    """Return what a recording declares. Raises FileError or SchemaError where it is none."""
    import netCDF4

    segments = load_part(file, tuple(SEGMENT_VARIABLES))
    if (schema := segments.attrs.get("schema")) not in (RECORDING_SCHEMA, SPATIAL_SCHEMA):
        raise SchemaError(f"{file} is no recording; its schema is {schema}")
    with whole_netcdf(file), netCDF4.Dataset(file, "r") as opened:
        held = {
            one: _Held(found.shape, np.dtype(found.dtype), str(getattr(found, "units", "")))
            for one in SAMPLE_VARIABLES
            if (found := opened.variables.get(one)) is not None and found.dimensions == SAMPLE_VARIABLES[one].dims
        }
    lacks = [one for one, row in SEGMENT_VARIABLES.items() if row.required and one not in segments]
    if lacks or "time_s" not in held:
        raise SchemaError(f"{file} lacks {', '.join(lacks) or 'time_s'}, which every recording has")
    run = _Run(name, file, segments, held)
    if int(segments["row_size"].sum()) != run.samples or any(one.shape[0] != run.samples for one in held.values()):
        raise SchemaError(f"{file} has {run.samples} samples, and segments or channels of another number")
    return run


def _alike(run: _Run, others: Sequence[_Run]) -> _Run:
    """Return the run. Raises SchemaError where its response or drive is in another unit than that of one before."""
    for name in ("response", "drive"):
        first = next((one.held[name].unit for one in others if name in one.held), None)
        if first is not None and name in run.held and run.held[name].unit != first:
            raise SchemaError(f"{run.file} has its {name} in {run.held[name].unit!r}, the first one in {first!r}")
    return run


_Variables = Iterator[tuple[str, tuple[Any, ...]]]


def _run_coordinates(runs: Sequence[_Run]) -> _Variables:
    yield "run", ("run", _words([one.name for one in runs]))
    yield "file", ("run", _words([str(one.file) for one in runs]))
    yield "segments", ("run", np.array([one.segments.sizes["segment"] for one in runs]))
    yield "samples", ("run", np.array([one.samples for one in runs]))
    for name in dict.fromkeys(name for one in runs for name in one.segments.attrs):
        if name not in _SHARED and name not in SAMPLE_VARIABLES:
            told = [one.segments.attrs.get(name, "") for one in runs]
            alike = len({type(one) for one in told}) == 1 and not isinstance(told[0], (str, np.ndarray))
            yield str(name), ("run", np.array(told) if alike else _words([str(one) for one in told]))


def _segment_variables(runs: Sequence[_Run]) -> _Variables:
    for name, row in SEGMENT_VARIABLES.items():
        if not any(name in one.segments for one in runs):
            continue
        parts = [
            one.segments[name].values
            if name in one.segments
            else np.full(one.segments.sizes["segment"], Segment.__dataclass_fields__[name].default)
            for one in runs
        ]
        yield name, (row.dims, np.concatenate(parts), {"units": row.unit, "long_name": row.meaning})
    owners = [one.name for one in runs for _ in range(one.segments.sizes["segment"])]
    yield "run_name", ("segment", _words(owners), {"long_name": "run that the segment is of"})


def _words(words: Sequence[str]) -> NDArray[Any]:
    return np.array(words, dtype=object)


def _sample_variables(runs: Sequence[_Run]) -> _Variables:
    for name, row in SAMPLE_VARIABLES.items():
        held = [one.held[name] for one in runs if name in one.held]
        if held:
            unit = held[0].unit if row.unit == "*" else row.unit
            yield name, (row.dims, _lazy(name, runs, held), {"units": unit, "long_name": row.meaning})


def _lazy(name: str, runs: Sequence[_Run], held: Sequence[_Held]) -> "dask.array.Array":
    """Return a channel of all runs as blocks of its files; of so many tendons as the run with most of them has."""
    import dask.array
    from dask.base import tokenize

    tails = {one.shape[1:] for one in held}
    tail = tuple(max(sizes) for sizes in zip(*tails, strict=True))
    has_gaps = len(tails) > 1 or len(held) < len(runs)
    kind = np.result_type(*(one.kind for one in held), *([np.float16] if has_gaps else []))  # no whole number is NaN
    blocks = [
        (run.file, name, start, (min(run.samples - start, _BLOCK), *tail), kind)
        for run in runs
        for start in range(0, run.samples, _BLOCK)
    ]
    key = f"{name}-{tokenize([(run.file, run.file.stat().st_mtime_ns) for run in runs], name)}"
    zeros = (0,) * len(tail)
    graph = {(key, place, *zeros): (_read_block, *block) for place, block in enumerate(blocks)}
    chunks = (tuple(shape[0] for *_, shape, _ in blocks), *((size,) for size in tail))
    return dask.array.Array(graph, key, chunks, dtype=kind)  # type: ignore[no-untyped-call]


def _read_block(file: Path, name: str, start: int, shape: tuple[int, ...], kind: np.dtype[Any]) -> NDArray[Any]:
    """Return samples of a channel from `start` on, NaN where the file has none."""
    import netCDF4

    block = np.full(shape, np.nan if kind.kind == "f" else 0, dtype=kind)
    with _ONE_AT_A_TIME, whole_netcdf(file), netCDF4.Dataset(file, "r") as opened:
        opened.set_auto_mask(False)
        if name in opened.variables:
            values = opened.variables[name][start : start + shape[0]]
            if len(values) != shape[0]:
                raise FileError(f"{file} has changed since it was opened; open the runs anew")
            block[(slice(None), *(slice(size) for size in values.shape[1:]))] = values
    return block
