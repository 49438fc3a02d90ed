"""Whatever file holds a measurement, read: a recording or results of Sinew, or somebody's table."""

from contextlib import suppress
from pathlib import Path

import xarray as xr

from sinew.measure.doors import as_path
from sinew.measure.errors import FileError, SchemaError, SpecError
from sinew.measure.files.csv import ColumnNames, Table, import_csv
from sinew.measure.files.netcdf import has_schema, is_netcdf, load_recording, load_results
from sinew.measure.files.runs import RunChoice
from sinew.measure.recording import cut_recording
from sinew.measure.schema import ReadKind
from sinew.measure.timing import Gaps

_TABLES_IN_HDF5 = frozenset((".h5", ".hdf5", ".hdf", ".he5", ".mat"))


def read(
    path: "Path | str | Table",
    *,
    time: str | None = None,
    response: str | None = None,
    drive: str | None = None,
    kind: ReadKind = "auto",
    start_s: float | None = None,
    stop_s: float | None = None,
    gaps: Gaps = "refuse",
    run: RunChoice = None,
    columns: ColumnNames = None,
    rate_hz: float | None = None,
) -> xr.Dataset:
    """Return the recording, or the results, that a file holds.

    path: of a NetCDF file of Sinew, which knows its columns; of a text table in any dialect, a MATLAB, HDF5, TDMS,
    UFF 58, Excel, Parquet or MCAP file, whose columns are named here; or a pandas DataFrame. `sn.look` tells what is in
    a file.
    time, response, drive: "COL" or "COL:unit" of a table; without a unit the one in the column's name (angle_deg,
    "x [mm]") counts. A time that is the only one by its name, and a response that is the only other column of numbers,
    need not be named. kind: what a table holds; auto leaves it to `sn.analyse` to find out. start_s, stop_s: the part
    to take [s], of a table or an imported recording. gaps: refuse a table with missing samples, split it there, or
    bridge them in a ring-down. run: which of several in a file, by number from 1 or name. columns: names for all
    columns instead of the file's, as "t_s,angle_deg". rate_hz: samples per second, where no column holds the time.
    Raises FileError, SchemaError, SpecError, RecordingError, TimeError or UnitError with one sentence.

    >>> import pandas as pd
    >>> import sinew as sn
    >>> swing = pd.DataFrame({"stamp_ms": range(0, 500, 10), "angle_deg": [5.0, 3.0, -2.0, -4.0, -1.0] * 10})
    >>> sn.read(swing, time="stamp_ms", response="angle_deg").sizes["sample"]
    50
    """
    if isinstance(path, (str, Path)) and is_recording(as_path(path)):
        if gaps != "refuse" or any(given is not None for given in (time, response, drive, run, columns, rate_hz)):
            raise SpecError(
                "a recording knows its columns and its gaps; time, response, drive, run, columns, rate_hz and gaps are "
                "for tables; leave them out"
            )
        try:
            return cut_recording(load_recording(path), start_s, stop_s)
        except SchemaError:
            with suppress(SchemaError):
                return load_results(path)
            raise
    return import_csv(
        path,
        time=time,
        response=response,
        drive=drive,
        kind=kind,
        start_s=start_s,
        stop_s=stop_s,
        gaps=gaps,
        run=run,
        columns=columns,
        rate_hz=rate_hz,
    )


def is_recording(file: Path) -> bool:
    """Return whether a file is to be read as NetCDF of Sinew; an absent one is not.

    By its name, else by its first bytes; another program's HDF5 file has the same bytes and no schema in it.
    """
    try:
        if file.suffix == ".nc":
            return True
        return is_netcdf(file) and (file.suffix.lower() not in _TABLES_IN_HDF5 or has_schema(file))
    except FileError:
        return False  # the reader of tables says why
