"""What a caller may hand in at a door of the library: times, numbers, paths, recordings, and the sentence for the rest;
and files that leave it whole or not at all.

Every public function that takes arrays, a path or a recording from a user's own program brings them into one shape
here, so that a list, a pandas Series or Index, an xarray DataArray, whole numbers or float32 mean what they say. What
numpy would turn silently into something else is refused: a masked array (whose mask `np.asarray` drops), dates among
numbers (which become nanoseconds), quantities with a unit of their own, a DataFrame of several columns.
"""

import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array
from sinew.measure.errors import FileError, RecordingError, SchemaError, TimeError

if TYPE_CHECKING:
    import xarray as xr


def as_numbers(values: Any, name: str) -> Array:
    """Return numbers as an array of float64; a DataFrame of one column is that column.

    name: of what they are, for the sentence. Raises RecordingError where they are no numbers.
    """
    plain = _plain(values, name)
    if plain.dtype.kind in "mM":
        raise RecordingError(f"the {name} holds dates or durations, expected numbers; give its values in their unit")
    if plain.dtype.kind == "c":
        raise RecordingError(f"the {name} holds complex numbers, expected real ones; take their real part or size")
    if plain.dtype.kind not in "fiuO":
        raise RecordingError(f"the {name} holds {plain.dtype} values, expected numbers")
    try:
        return np.asarray(plain, dtype=float)
    except (TypeError, ValueError) as error:
        raise RecordingError(f"the {name} holds what is no number ({error}); expected numbers") from error


def as_seconds(values: Any, name: str = "time") -> Array:
    """Return times in seconds as an array of float64.

    Numbers are seconds already. Dates (numpy's, pandas', Python's, with a time zone or without) become seconds since
    the first of them, durations seconds. Raises TimeError where a time is missing, RecordingError where they are none.
    """
    plain = _plain(values, name)
    if plain.dtype.kind == "O" and plain.size and not _is_number(plain.flat[0]):
        plain = _dates(plain, name)
    if plain.dtype.kind not in "mM":
        return as_numbers(plain, name)
    missing = np.isnat(plain)
    if missing.any():
        raise TimeError(f"the {name} is missing at sample {int(np.argmax(missing))} (NaT); fill in or remove such rows")
    if plain.dtype.kind == "M":
        plain = plain - plain.flat[0] if plain.size else plain.astype("timedelta64[ns]")
    return np.asarray(plain / np.timedelta64(1, "ns") * 1e-9, dtype=float)


def _plain(values: Any, name: str) -> NDArray[Any]:
    """Return values as a numpy array, without what numpy would drop in silence."""
    import pandas as pd  # type: ignore[import-untyped,unused-ignore]
    import xarray as xr

    if hasattr(values, "magnitude") and hasattr(values, "units"):
        raise RecordingError(f"the {name} carries a unit of its own ({values.units}); give its numbers in SI units")
    if isinstance(values, pd.DataFrame):
        if values.shape[1] != 1:
            columns = ", ".join(map(str, values.columns[:8]))
            raise RecordingError(f"the {name} is a table of columns {columns}; expected one column, as table['name']")
        values = values.iloc[:, 0]
    if isinstance(values, xr.Dataset):
        raise RecordingError(f"the {name} is a whole dataset; expected one variable of it, as dataset['name']")
    if isinstance(values, np.ma.MaskedArray):
        if np.ma.getmaskarray(values).any():
            count = int(np.ma.getmaskarray(values).sum())
            raise RecordingError(f"the {name} has {count} masked samples; fill them in or cut the record at them")
        values = values.data
    if isinstance(values, (pd.Series, pd.Index)) and isinstance(values.dtype, pd.DatetimeTZDtype):
        values = pd.DatetimeIndex(values).tz_convert("UTC").tz_localize(None)
    if isinstance(values, (pd.Series, pd.Index)) and pd.api.types.is_numeric_dtype(values.dtype):
        return np.asarray(values.to_numpy(dtype=float, na_value=np.nan))  # pandas' own <NA> is NaN, and judged as such
    try:
        return np.asarray(values)
    except ValueError as error:  # rows of different length
        raise RecordingError(f"the {name} is no column of numbers ({error})") from error


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float, np.number))


def _dates(values: NDArray[Any], name: str) -> NDArray[Any]:
    import pandas as pd

    try:
        if hasattr(values.flat[0], "total_seconds"):
            return np.asarray(pd.to_timedelta(values))
        return np.asarray(pd.to_datetime(values, utc=True).tz_localize(None))
    except (TypeError, ValueError) as error:
        raise RecordingError(f"the {name} holds {values.flat[0]!r}, expected seconds or dates") from error


def as_path(path: Any) -> Path:
    """Return a path given as `Path` or as text. Raises FileError for anything else, and for no text at all."""
    if isinstance(path, (str, os.PathLike)):
        text = os.fspath(path)
        if isinstance(text, str) and text.strip():
            return Path(text)
        raise FileError(f"found {text!r} where a path is expected; name a file")
    raise FileError(f"found a {type(path).__name__} where a path is expected; name a file, as text or pathlib.Path")


def as_dataset(dataset: Any, what: str) -> "xr.Dataset":
    """Return a recording or results unchanged. what: "recording" or "results". Raises SchemaError for other things."""
    import xarray as xr

    if not isinstance(dataset, xr.Dataset):
        how = {"recording": "load_recording or import_csv gives one", "results": "load_results gives some"}[what]
        raise SchemaError(f"found a {type(dataset).__name__} where a {what} (xarray.Dataset) is expected; {how}")
    return dataset


# How much memory a file may ask for is decided before anything is read.


def most_bytes() -> int:
    """Return how many bytes of numbers this process may take from a file: half of this computer's memory.

    Of a process with a limit of its own (`RLIMIT_DATA`, as the dashboard's workers have) it is a quarter of that limit:
    what is read is copied for its hash, and again where it is analysed. Where the system states neither, no limit.
    """
    half = _memory_bytes() // 2
    try:
        import resource  # POSIX alone has it
    except ModuleNotFoundError:
        return half
    own, _ = resource.getrlimit(resource.RLIMIT_DATA)
    return half if own == resource.RLIM_INFINITY else min(half, own // 4)


def _memory_bytes() -> int:
    """Return the memory of this computer; `sys.maxsize` where the system does not state it."""
    if hasattr(os, "sysconf"):
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    import ctypes

    # MEMORYSTATUSEX of the Windows API: two words of 32 bits, the second a percentage, then seven of 64 bits.
    status = (ctypes.c_uint64 * 8)()
    ctypes.cast(status, ctypes.POINTER(ctypes.c_uint32))[0] = ctypes.sizeof(status)
    try:
        is_known = ctypes.windll.kernel32.GlobalMemoryStatusEx(status)  # type: ignore[attr-defined,unused-ignore]
    except AttributeError:
        return sys.maxsize
    return int(status[1]) if is_known else sys.maxsize


# What leaves: light to import, for a process that steers a bench writes notes, too.


def write_text(path: Path | str, text: str) -> None:
    """Write a text file, see `write_atomically`."""

    def write(temporary: Path) -> None:
        temporary.write_bytes(text.encode("utf-8"))

    write_atomically(path, write)


def write_atomically(path: Path | str, write: Callable[[Path], None]) -> None:
    """Write a file whole or not at all: to a temporary neighbour, flushed to disk, then renamed.

    write: gets the temporary path and writes the content there.
    Raises FileError where the folder cannot be written.
    """
    path = as_path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise FileError(
            f"cannot write {path}: {error.strerror or error}; choose a folder that you may write"
        ) from error
    os.close(handle)
    temporary = Path(name)
    try:
        write(temporary)
        with temporary.open("r+b") as written:  # Windows flushes no file that is open to read alone
            os.fsync(written.fileno())
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(path)
    except (OSError, RuntimeError) as error:  # the NetCDF library reports a full disk as RuntimeError
        reason = (error.strerror if isinstance(error, OSError) else None) or error
        raise FileError(f"cannot write {path}: {reason}; choose another place and check the free space") from error
    finally:
        temporary.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
