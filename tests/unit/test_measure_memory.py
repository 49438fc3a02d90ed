"""Files that would fill the memory are refused from what they declare."""

import resource
import tracemalloc
from pathlib import Path

import netCDF4
import numpy as np
import pytest

from sinew.measure.errors import FileError
from sinew.measure.files.netcdf import load_dataset
from sinew.measure.read import read_table
from sinew.measure.validation import most_bytes

GIB = 1 << 30


@pytest.fixture
def limited(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have a process's limit be that of a dashboard's worker."""
    monkeypatch.setattr(resource, "getrlimit", lambda _: (4 * GIB, 4 * GIB))


def bomb(path: Path, bytes_: int, kind: str = "f8") -> Path:
    """Write a small file that declares so many bytes of numbers."""
    count = bytes_ // np.dtype(kind).itemsize
    with netCDF4.Dataset(path, "w") as made:
        made.createDimension("sample", count)
        made.createVariable("time_s", kind, ("sample",), zlib=True, chunksizes=[1 << 20])[:10] = 0
    return path


@pytest.mark.usefixtures("limited")
@pytest.mark.parametrize(("kind", "size"), [("f8", 16 * GIB // 10), ("i1", GIB // 4)])
def test_a_small_file_that_unpacks_to_more_than_the_memory_is_refused_unread(
    tmp_path: Path, kind: str, size: int
) -> None:
    path = bomb(tmp_path / "bomb.nc", size, kind)
    assert path.stat().st_size < 2_000_000
    tracemalloc.start()
    with pytest.raises(FileError, match=r"takes \d+ MB of memory, expected at most 1074 MB"):
        load_dataset(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20_000_000


@pytest.mark.usefixtures("limited")
def test_a_chunk_that_unpacks_to_more_than_the_memory_is_refused_unread(tmp_path: Path) -> None:
    with netCDF4.Dataset(tmp_path / "bomb.nc", "w") as made:
        made.createDimension("sample", None)
        made.createVariable("drive_rad", "f8", ("sample",), zlib=True, chunksizes=[2 * GIB // 8])
        made.createVariable("time_s", "f8", ("sample",))[:] = np.arange(10.0)
    with pytest.raises(FileError, match="MB of memory, expected at most"):
        load_dataset(tmp_path / "bomb.nc")


def test_a_table_that_is_larger_than_the_memory_is_refused_unread(tmp_path: Path) -> None:
    with (tmp_path / "long.csv").open("w") as file:
        file.truncate(most_bytes())  # a hole, which takes no room
    with pytest.raises(FileError, match=r"MB of memory, expected at most \d+ MB"):
        read_table(tmp_path / "long.csv")
