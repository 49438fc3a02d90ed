"""Whatever file holds a measurement, read: a recording or results of Sinew, or somebody's table."""

from contextlib import suppress
from pathlib import Path
from typing import Literal

import xarray as xr

from sinew.measure.doors import as_path
from sinew.measure.errors import FileError, SchemaError, SpecError
from sinew.measure.files.csv import Table, import_csv, read_table
from sinew.measure.files.netcdf import is_netcdf, load_recording, load_results
from sinew.measure.recording import cut_recording
from sinew.measure.schema import ReadKind


def read(
    path: "Path | str | Table",
    *,
    time: str | None = None,
    response: str | None = None,
    drive: str | None = None,
    kind: ReadKind = "auto",
    start_s: float | None = None,
    stop_s: float | None = None,
    gaps: Literal["refuse", "split"] = "refuse",
) -> xr.Dataset:
    """Return the recording, or the results, that a file holds.

    path: of a NetCDF file of Sinew, which knows its columns; of a text table (comma, semicolon, tab or blanks between
    its columns), whose columns are named here; or a pandas DataFrame.
    time, response, drive: "COL" or "COL:unit" of a table; without a unit the one in the column's name (angle_deg,
    "x [mm]") counts. kind: what a table holds; auto leaves it to `sn.analyse` to find out. start_s, stop_s: the part to
    take [s], of a table or an imported recording. gaps: refuse a table with missing samples, or split it there.
    Raises FileError, SchemaError, SpecError, RecordingError, TimeError or UnitError with one sentence.

    >>> import pandas as pd
    >>> import sinew as sn
    >>> swing = pd.DataFrame({"stamp_ms": range(0, 500, 10), "angle_deg": [5.0, 3.0, -2.0, -4.0, -1.0] * 10})
    >>> sn.read(swing, time="stamp_ms", response="angle_deg").sizes["sample"]
    50
    """
    named = (time, response, drive)
    if isinstance(path, (str, Path)) and is_recording(as_path(path)):
        if any(column is not None for column in named):
            raise SpecError("a recording knows its columns; time, response and drive are for tables; leave them out")
        try:
            return cut_recording(load_recording(path), start_s, stop_s)
        except SchemaError:
            with suppress(SchemaError):
                return load_results(path)
            raise
    if time is None or response is None:
        missing = "time" if time is None else "response"
        columns = ", ".join(map(str, read_table(path).columns))
        raise SpecError(f"this is a table: name its columns; {missing}= is missing; there are {columns}")
    return import_csv(
        path, time=time, response=response, drive=drive, kind=kind, start_s=start_s, stop_s=stop_s, gaps=gaps
    )


def is_recording(file: Path) -> bool:
    """Return whether a file is to be read as NetCDF: by its name, else by its first bytes; an absent one is not."""
    try:
        return file.suffix == ".nc" or is_netcdf(file)
    except FileError:
        return False  # the reader of tables says why
