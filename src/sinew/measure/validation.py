"""What a caller may hand in: times, numbers, paths, recordings, and the sentence for the rest;
and files that leave it whole or not at all.

Every public function that takes arrays, a path or a recording from a user's own program brings them into one shape
here, so that a list, a pandas Series or Index, an xarray DataArray, whole numbers or float32 mean what they say. What
numpy would turn silently into something else is refused: a masked array (whose mask `np.asarray` drops), dates among
numbers (which become nanoseconds), quantities with a unit of their own, a DataFrame of several columns.
"""

import os
import secrets
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from sinew.measure.arrays import Array
from sinew.measure.errors import FileError, RecordingError, SchemaError, TimeError


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
    if plain.dtype.kind == "O" and plain.size and not isinstance(plain.flat[0], (int, float, np.number)):
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


def _dates(values: NDArray[Any], name: str) -> NDArray[Any]:
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


def as_dataset(dataset: Any, what: str) -> xr.Dataset:
    """Return a recording or results unchanged. what: "recording" or "results". Raises SchemaError for other things."""
    if not isinstance(dataset, xr.Dataset):
        how = {"recording": "sn.read gives one", "results": "sn.read gives some"}[what]
        raise SchemaError(f"found a {type(dataset).__name__} where a {what} (xarray.Dataset) is expected; {how}")
    return dataset


# How much memory a file may ask for is decided before anything is read.


def most_bytes() -> int:
    """Return how many bytes of numbers this process may take from a file: half of this computer's memory.

    Of a process with a limit of its own (`RLIMIT_DATA`, as the dashboard's workers have) it is a quarter of that limit:
    what is read is copied for its hash, and again where it is analysed. Where the system states neither, as Windows
    does in no way that Python reads, no limit.
    """
    try:
        import resource  # POSIX alone has it
    except ModuleNotFoundError:
        return sys.maxsize
    half = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2
    own, _ = resource.getrlimit(resource.RLIMIT_DATA)
    return half if own == resource.RLIM_INFINITY else min(half, own // 4)


def refuse_beyond_memory(path: Path, bytes_: float) -> None:
    """Raise FileError where what a file holds takes more bytes of memory than `most_bytes`."""
    if bytes_ > (most := most_bytes()):
        raise FileError(
            f"{path} takes {bytes_ / 1e6:.0f} MB of memory, expected at most {most / 1e6:.0f} MB; cut it, or read it "
            "on a computer with more"
        )


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
    temporary = path.with_name(f".{path.stem}.{secrets.token_hex(4)}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(temporary)
        with temporary.open("r+b") as written:  # Windows flushes no file that is open to read alone
            os.fsync(written.fileno())
        temporary.replace(path)
    except (OSError, RuntimeError) as error:  # the NetCDF library reports a full disk as RuntimeError
        reason = (error.strerror if isinstance(error, OSError) else None) or error
        raise FileError(
            f"cannot write {path}: {reason}; choose a folder that you may write, and check the free space"
        ) from error
    finally:
        with suppress(OSError):  # below a file there is nothing to remove
            temporary.unlink(missing_ok=True)
