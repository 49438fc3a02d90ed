"""NetCDF files of datasets, written and read whole or not at all."""

import _thread
import hashlib
import math
import platform
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

import numpy as np
import xarray as xr

from sinew import __version__
from sinew.measure.doors import as_path, most_bytes, write_atomically
from sinew.measure.errors import FileError, SchemaError
from sinew.measure.schema import upgrade_results, validate_recording, validate_results

T = TypeVar("T")
R = TypeVar("R")

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
        import netCDF4

        write_it = partial(dataset.to_netcdf, temporary, engine="netcdf4", encoding=encoding)
        _, found = _out_of_reach(write_it, partial(content_hash, dataset))  # hashed while it is deflated
        with netCDF4.Dataset(temporary, "a") as file:
            file.setncattr("content_hash", found)

    write_atomically(path, write)


_SMALL, _STRETCHES, _STRETCH, _WORTH, _CHUNK = 4096, 8, 1 << 13, 0.25, 1 << 20


def _encoding(variable: xr.Variable) -> dict[str, Any]:
    """Return how a variable is stored: deflated where stretches of it shrink to a quarter, else as it is.

    Deflating takes 50 times the time of writing. Of a campaign's 110 MB it brings the tendons' counts, 54 MB, to 3;
    noise and time stamps shrink by half at best, and take two thirds of the time.
    """
    how: dict[str, Any] = {"_FillValue": None} if variable.dtype.kind == "f" else {}
    if variable.dtype.kind not in "fi" or variable.size <= _SMALL:
        return how
    rows = np.ascontiguousarray(variable.values)
    row = max(1, rows[:1].nbytes)
    long = max(1, _STRETCH // row)
    some = b"".join(rows[i : i + long].tobytes() for i in np.linspace(0, len(rows) - long, _STRETCHES).astype(int))
    if len(zlib.compress(some, 1)) > _WORTH * len(some):
        return how
    return {**how, "zlib": True, "complevel": 1, "shuffle": False, "chunksizes": _chunks(variable.shape, row)}


def _chunks(shape: tuple[int, ...], row: int) -> tuple[int, ...]:
    """Return chunks of whole rows of so many bytes, about a megabyte each."""
    return (min(shape[0], max(1, _CHUNK // row)), *shape[1:])


def _unpacked(path: Path) -> int:
    """Return how many bytes the variables of a NetCDF file take in memory, from what it declares, nothing read.

    A number counts eight bytes, which it has once it is decoded; a chunk counts whole, for it is unpacked whole.
    """
    import netCDF4

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
    import netCDF4

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
    """Return the dataset of a NetCDF file, read whole into memory, results of an older schema brought to today's.

    Raises FileError where the file is absent, is not NetCDF, is cut short, or no longer matches its content hash; also
    where it declares more than `sinew.measure.doors.most_bytes`, before anything of it is read.
    """
    path = as_path(path)
    with whole_netcdf(path):
        if (size := _unpacked(path)) > (most := most_bytes()):
            raise FileError(
                f"{path} unpacks to {size / 1e6:.0f} MB, expected at most {most / 1e6:.0f} MB in the memory that there "
                "is; cut it, or read it on a computer with more"
            )
        dataset, _ = _out_of_reach(partial(_read_whole, path), lambda: None)
    for name in dataset.variables:
        dataset[name].encoding = {}
    dataset.encoding = {}
    claimed = dataset.attrs.get("content_hash")
    if claimed is not None and claimed != content_hash(dataset):
        raise FileError(f"{path} does not match its own content hash: it was changed after Sinew wrote it")
    return upgrade_results(dataset)


def _read_whole(path: Path) -> xr.Dataset:
    with xr.open_dataset(path, engine="netcdf4", decode_times=False) as opened:
        return opened.load()


def _out_of_reach(call: Callable[[], T], meanwhile: Callable[[], R]) -> tuple[T, R]:
    """Return what a call and what this thread does meanwhile give; the call is made in a thread, which no interrupt
    reaches, and has ended, or never begins, when this returns or raises.

    An interrupt that comes as xarray gives a lock back leaves that taken, and to close the file waits for it forever.
    So does one that comes while a future is waited for, or a thread of `threading` to begin, whose locks are Python's;
    and of two threads in HDF5, the first of them given up, files and the process break. Queues of C leave nothing.
    """
    leave: SimpleQueue[None] = SimpleQueue()
    ended: SimpleQueue[tuple[Any, BaseException | None]] = SimpleQueue()
    leave.put(None)  # to begin: the thread takes it, or who is interrupted takes it back

    def make() -> None:
        try:
            leave.get_nowait()
        except Empty:
            return
        made: tuple[Any, BaseException | None]
        try:
            made = call(), None
        except BaseException as error:  # whoever waits raises it
            made = None, error
        ended.put(made)
        ended.put(made)  # for who is interrupted as the first is taken

    try:
        _thread.start_new_thread(make, ())
        beside = meanwhile()
        found, error = ended.get()
    finally:
        try:
            leave.get_nowait()
        except Empty:
            ended.get()
    if error is not None:
        raise error
    return found, beside


def load_part(path: Path | str, names: Collection[str]) -> xr.Dataset:
    """Return some variables of a NetCDF file with its attributes, in today's shape; those that are absent are left out.

    names: may be empty, for the attributes alone. Nothing else is read, so neither content hash nor schema are checked.
    Raises FileError where the file is absent, damaged, or declares more than `sinew.measure.doors.most_bytes` for them.
    """
    import netCDF4

    path = as_path(path)
    with whole_netcdf(path), netCDF4.Dataset(path, "r") as opened:
        opened.set_auto_mask(False)
        attrs = {name: opened.getncattr(name) for name in opened.ncattrs()}
        found = {name: opened.variables[name] for name in names if name in opened.variables}
        if sum(8 * math.prod(one.shape) for one in found.values()) > most_bytes():
            raise FileError(f"{path} declares more numbers than there is memory for; write it anew")
        parts = {
            name: (one.dimensions, one[:], {"units": str(getattr(one, "units", ""))}) for name, one in found.items()
        }
    return upgrade_results(xr.Dataset(parts, attrs=attrs))


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
    """Return checked results from a NetCDF file, with coordinates whatever the schema they were written by.

    Raises FileError or SchemaError.
    """
    try:
        return validate_results(load_dataset(path))
    except SchemaError as error:
        raise SchemaError(f"{path}: {error}") from error
