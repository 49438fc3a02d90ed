"""NetCDF files of datasets, written and read whole or not at all."""

import hashlib
import math
import platform
import signal
import threading
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sinew import __version__
from sinew.measure.errors import FileError, SchemaError, SinewError, SpecError, how_to_install
from sinew.measure.recording import (
    RECORDING_SCHEMA,
    SAMPLE_VARIABLES,
    SEGMENT_VARIABLES,
    SPATIAL_SCHEMA,
    SPATIAL_SEGMENTS,
    Segment,
    validate_recording,
    validate_results,
)
from sinew.measure.validation import as_path, refuse_beyond_memory, write_atomically

# A dataset says what it was made from: rig, plan, versions, seed and content hash.

_PACKAGES = ("numpy", "scipy", "xarray", "jax")
# The command names files and folders; the same data made elsewhere are the same data.
_UNHASHED = ("content_hash", "command")


def provenance(source: str, *, rig: str = "", plan: str = "", seed: int | None = None, **more: Any) -> dict[str, Any]:
    """Return the attributes that every dataset of Sinew carries.

    source: twin, emulator, bench or import.
    rig, plan: their TOML texts, whole; empty where there is none.
    seed: of the random numbers, or None.
    """
    return {
        "source": source,
        "rig": rig,
        "plan": plan,
        "versions": _versions(),
        "seed": -1 if seed is None else int(seed),
        **more,
    }


@cache
def _versions() -> str:
    versions = [f"sinew {__version__}", f"python {platform.python_version()}"]
    for package in _PACKAGES:
        try:
            versions.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return "; ".join(versions)


def content_hash(dataset: xr.Dataset) -> str:
    """Return the SHA-256 over names, dimensions, types, values and attributes of a dataset, as hexadecimal text."""
    digest = hashlib.sha256()
    for name in sorted(map(str, dataset.variables)):
        variable = dataset[name]
        digest.update(f"{name}{variable.dims}{variable.shape}".encode())
        values = variable.values
        if values.dtype.kind in "OUST":
            digest.update("\0".join(map(str, values.ravel())).encode())
        else:
            digest.update(values.dtype.str.encode())
            digest.update(np.ascontiguousarray(values).reshape(-1).view(np.uint8).data)
        digest.update(_attributes_text(variable.attrs).encode())
    digest.update(_attributes_text(dataset.attrs).encode())
    return digest.hexdigest()


def _attributes_text(attrs: Mapping[Any, Any]) -> str:
    """Return attributes as one text, the same before and after a file turned lists into arrays."""
    rows = ((str(key), np.atleast_1d(attrs[key]).tolist()) for key in sorted(attrs, key=str) if key not in _UNHASHED)
    return "\0".join(f"{key}={values}" for key, values in rows)


def save_dataset(dataset: xr.Dataset, path: Path | str) -> None:
    """Write any dataset as NetCDF-4, atomically, with its content hash in the attributes.

    The content hash is that of the values as a reader gets them. Raises FileError where the file cannot be written.
    """
    encoding = {str(name): _encoding(dataset[name].variable) for name in dataset.variables}

    def write(temporary: Path) -> None:
        with _uninterrupted():
            dataset.to_netcdf(temporary, engine="netcdf4", encoding=encoding)
        with netCDF4.Dataset(temporary, "a") as file:
            file.setncattr("content_hash", content_hash(dataset))

    write_atomically(path, write)


_SMALL, _CHUNK_ROWS = 4096, 1 << 16


def _encoding(variable: xr.Variable) -> dict[str, Any]:
    """Return how a variable is stored: many numbers deflated, which makes of a campaign's 110 MB less than half."""
    how: dict[str, Any] = {"_FillValue": None} if variable.dtype.kind == "f" else {}
    if variable.dtype.kind not in "fi" or variable.size <= _SMALL:
        return how
    chunks = (min(variable.shape[0], _CHUNK_ROWS), *variable.shape[1:])
    return {**how, "zlib": True, "complevel": 1, "chunksizes": chunks}


def _unpacked(path: Path) -> int:
    """Return how many bytes the variables of a NetCDF file take in memory, from what it declares, nothing read.

    A number counts eight bytes, which it has once it is decoded; a chunk counts whole, for it is unpacked whole.
    """
    total = 0
    with netCDF4.Dataset(path, "r") as opened:
        for variable in opened.variables.values():
            chunks = variable.chunking()
            shape = variable.shape
            if isinstance(chunks, (list, tuple)):
                shape = tuple(max(pair) for pair in zip(shape, chunks, strict=True))
            total += math.prod(shape) * max(8, getattr(variable.dtype, "itemsize", 8))
    return total


def is_netcdf(path: Path | str) -> bool:
    """Return whether a file is NetCDF, going by its first bytes and not by its name.

    Raises FileError where it is absent, a folder, or cannot be read.
    """
    path = as_path(path)
    try:
        with path.open("rb") as file:
            return file.read(8).startswith((b"\x89HDF\r\n\x1a\n", b"CDF\x01", b"CDF\x02", b"CDF\x05"))
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}") from error


def has_schema(path: Path | str) -> bool:
    """Return whether an HDF5 or NetCDF file names a schema, as all that Sinew writes do."""
    try:
        with netCDF4.Dataset(str(as_path(path))) as file:
            return "schema" in file.ncattrs()
    except (OSError, RuntimeError):  # cut short, or a tree that is no NetCDF
        return False


@contextmanager
def whole_netcdf(path: Path) -> Iterator[None]:
    """Have what is read inside raise FileError where the file is absent, is not NetCDF, or is damaged."""
    if not is_netcdf(path):
        raise FileError(f"{path} is not a NetCDF file; expected a recording or results that Sinew wrote")
    try:
        yield
    except (OSError, ValueError, RuntimeError, LookupError, AttributeError, TypeError) as error:
        reason = " ".join(str(error).split())
        raise FileError(
            f"{path} is a damaged NetCDF file, perhaps cut short ({reason}); copy or write it anew"
        ) from error


def load_dataset(path: Path | str) -> xr.Dataset:
    """Return the dataset of a NetCDF file, read whole into memory.

    Raises FileError where the file is absent, is not NetCDF, is cut short, or no longer matches its content hash; also
    where it declares more than `sinew.measure.validation.most_bytes`, before anything of it is read.
    """
    path = as_path(path)
    with whole_netcdf(path):
        refuse_beyond_memory(path, _unpacked(path))
        with _uninterrupted(), xr.open_dataset(path, engine="netcdf4", decode_times=False) as opened:
            dataset = opened.load()
    for name in dataset.variables:
        dataset[name].encoding = {}
    dataset.encoding = {}
    claimed = dataset.attrs.get("content_hash")
    if claimed is not None and claimed != content_hash(dataset):
        raise FileError(f"{path} does not match its own content hash: it was changed after Sinew wrote it")
    return dataset


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Hold Ctrl-C back for as long as HDF5 works: one that comes as xarray gives a lock back leaves it taken for ever.

    So are other signals that Python handles; only its main thread is interrupted.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    numbers = [one for one in (signal.SIGINT, signal.SIGTERM) if callable(signal.getsignal(one))]
    before = {one: signal.signal(one, lambda number, _: came.append(number)) for one in numbers}
    try:
        yield
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
        for number in came[:1]:
            signal.raise_signal(number)


def load_part(path: Path | str, names: Collection[str]) -> xr.Dataset:
    """Return some variables of a NetCDF file with its attributes; those that are absent are left out.

    names: may be empty, for the attributes alone. Nothing else is read, so neither content hash nor schema are checked.
    Raises FileError where the file is absent, damaged, or declares more than `most_bytes` for them.
    """
    path = as_path(path)
    with whole_netcdf(path), netCDF4.Dataset(path, "r") as opened:
        opened.set_auto_mask(False)
        attrs = {name: opened.getncattr(name) for name in opened.ncattrs()}
        found = {name: opened.variables[name] for name in names if name in opened.variables}
        refuse_beyond_memory(path, sum(8 * math.prod(one.shape) for one in found.values()))
        parts = {
            name: (one.dimensions, one[:], {"units": str(getattr(one, "units", ""))}) for name, one in found.items()
        }
    return xr.Dataset(parts, attrs=attrs)


def save_recording(recording: xr.Dataset, path: Path | str) -> None:
    """Check a recording and write it atomically. Raises SchemaError or FileError.

    >>> import tempfile, pandas as pd
    >>> import sinew as sn
    >>> recording = sn.read(pd.DataFrame({"t": range(50), "x": [0.0, 1.0] * 25}), time="t", response="x")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     sn.save_recording(recording, f"{folder}/mine.nc")
    ...     sn.read(f"{folder}/mine.nc").sizes["sample"]
    50
    """
    save_dataset(validate_recording(recording), path)


def load_recording(path: Path | str) -> xr.Dataset:
    """Return a checked recording from a NetCDF file. Raises FileError or SchemaError."""
    dataset = load_dataset(path)
    for name in ("kind", "excitation"):
        if name in dataset:
            dataset[name] = dataset[name].astype(object)
    try:
        return validate_recording(dataset)
    except SchemaError as error:
        raise SchemaError(f"{path}: {error}") from error


def load_results(path: Path | str) -> xr.Dataset:
    """Return checked results from a NetCDF file. Raises FileError or SchemaError."""
    try:
        return validate_results(load_dataset(path))
    except SchemaError as error:
        raise SchemaError(f"{path}: {error}") from error


# A folder of runs as one dataset, whose samples are read from the files where they are computed, and not before.


_BLOCK = 1 << 18
"""Samples that are read at once, at most: 2 MB of a channel, 8 MB of four tendons."""

_SHARED = ("Conventions", "featureType", "schema")


def open_runs(folder: Path | str | Sequence[Path | str]) -> xr.Dataset:
    """Return the recordings in a folder as one dataset, whose samples are dask arrays: they are read when computed.

    folder: of runs (NAME/recording.nc) or of recordings (NAME.nc); or the files themselves, as from a search.
    The dataset is one long recording, the runs one after the other by name, so that `segment` and `sample` mean what
    they do in each; `run_name` says of a segment whose it is. Over `run` stand its name, `file`, numbers of `segments`
    and `samples`, and what the recordings say of themselves (rig, plan, source, started ...). Channels that a run lacks
    are NaN. Neither content hashes nor samples are checked. The attribute `left_out` has a line for each file that is
    no whole recording, or whose response or drive is in another unit than the first one's.
    Raises FileError where there is no recording; SpecError without dask, which comes with the extra `cluster`.

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
    runs: dict[str, tuple[Path, xr.Dataset]] = {}
    left, units = [], dict[str, str]()
    for name, file in _files(folder):
        try:
            runs[name] = file, _opened_run(file, units)
        except SinewError as trouble:
            left.append(str(trouble))
    if not runs:
        raise FileError(
            f"found no recording in {folder}, neither NAME.nc nor NAME/recording.nc; name a folder of runs"
            + "".join(f"; {sentence}" for sentence in left[:1])
        )
    opened = [one for _, one in runs.values()]
    how: Any = {"data_vars": "all", "coords": "minimal", "compat": "override", "join": "override"}
    samples = xr.concat([_widened(one, opened).drop_dims("segment") for one in opened], "sample", **how)
    segments = xr.concat([_posed(one, opened).drop_dims("sample").load() for one in opened], "segment", **how)
    owners = np.repeat(np.array(list(runs), dtype=object), [one.sizes["segment"] for one in opened])
    made = xr.merge([samples, segments]).drop_attrs(deep=False)
    about: dict[str, Sequence[Any]] = {"run": list(runs), "file": [str(file) for file, _ in runs.values()]}
    about |= {f"{axis}s": [one.sizes[axis] for one in opened] for axis in ("segment", "sample")}
    for name in dict.fromkeys(str(name) for one in opened for name in one.attrs):
        if name not in _SHARED and name not in SAMPLE_VARIABLES:
            about[name] = [one.attrs.get(name, "") for one in opened]
    made = made.assign_coords({name: ("run", _in_row(values)) for name, values in about.items()})
    made["run_name"] = "segment", owners, {"long_name": "run that the segment is of"}
    return made.assign_attrs(
        {name: opened[0].attrs[name] for name in _SHARED if name in opened[0].attrs}, left_out="\n".join(left)
    )


def _in_row(values: Sequence[Any]) -> NDArray[Any]:
    """Return what each run says, as texts where they are not all numbers of one kind."""
    alike = len({type(one) for one in values}) == 1 and not isinstance(values[0], (str, np.ndarray))
    return np.array(values) if alike else np.array([str(one) for one in values], dtype=object)


def _widened(run: xr.Dataset, others: Sequence[xr.Dataset]) -> xr.Dataset:
    """Return a run with as many tendons as the run with most of them has; those that it lacks are NaN."""
    lacks = max(one.sizes.get("tendon", 0) for one in others) - run.sizes.get("tendon", 0)
    return run.pad(tendon=(0, lacks), keep_attrs=True) if lacks and "tendon" in run.dims else run


def _posed(run: xr.Dataset, others: Sequence[xr.Dataset]) -> xr.Dataset:
    """Return a run that says of its segments what others do: upright, and moved by the lever."""
    lacking = [name for name in SPATIAL_SEGMENTS if name not in run and any(name in one for one in others)]
    rows = {name: SEGMENT_VARIABLES[name] for name in lacking}
    usual = {name: [Segment.__dataclass_fields__[name].default] * run.sizes["segment"] for name in lacking}
    posed = run.assign(
        {name: (row.dims, usual[name], {"units": row.unit, "long_name": row.meaning}) for name, row in rows.items()}
    )
    return posed.assign({name: posed[name].astype(object) for name in ("kind", "excitation") if name in posed})


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


def _opened_run(file: Path, units: dict[str, str]) -> xr.Dataset:
    """Return a recording whose samples are not read yet. units: of response and drive, of the first run that has one.

    Raises FileError or SchemaError where it is none, or in other units.
    """
    with whole_netcdf(file):
        found = xr.open_dataset(file, engine="netcdf4", decode_times=False, cache=False)
    if (schema := found.attrs.get("schema")) not in (RECORDING_SCHEMA, SPATIAL_SCHEMA):
        raise SchemaError(f"{file} is no recording; its schema is {schema}")
    known = {**SAMPLE_VARIABLES, **SEGMENT_VARIABLES}
    found = found[[name for name in known if name in found and found[name].dims == known[name].dims]]
    if lacks := [name for name, row in known.items() if row.required and name not in found]:
        raise SchemaError(f"{file} lacks {', '.join(lacks)}, which every recording has")
    if int(found["row_size"].sum()) != found.sizes["sample"]:
        raise SchemaError(f"{file} has {found.sizes['sample']} samples, and segments of another number")
    for name in {"response", "drive"} & set(found.data_vars):
        own = str(found[name].attrs.get("units", ""))
        if units.setdefault(str(name), own) != own:
            raise SchemaError(f"{file} has its {name} in {own!r}, the first one in {units[str(name)]!r}")
    return found.chunk({"sample": _BLOCK})
