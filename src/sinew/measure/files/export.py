"""Recordings written for other programs: text, Parquet, MATLAB, universal files, and MCAP for Foxglove and PlotJuggler.

What is written here, `sinew.measure.files` reads back.
"""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy import io

from sinew.measure.arrays import Array
from sinew.measure.doors import as_path, write_atomically
from sinew.measure.errors import SpecError
from sinew.measure.files.formats import library
from sinew.measure.recording import segment_slices
from sinew.measure.schema import SAMPLE_VARIABLES, SEGMENT_VARIABLES, validate_recording
from sinew.measure.units import unit_suffix

_AXES = "xyz"
_SAMPLES = "/sinew/samples"


def export_csv(recording: xr.Dataset, path: Path | str) -> None:
    """Write a recording as one flat table, atomically: a row for each sample, segment columns repeated in each.

    Channels with several columns get one for each (`gyro_x_rad_s`, `tendon_1_current_a`); numbers are written so that
    they read back unchanged. Rig, plan and other attributes are not in the table.
    Raises SchemaError where it is not a recording, FileError where the file cannot be written.

    >>> import tempfile, pandas as pd
    >>> import sinew as sn
    >>> recording = sn.read(pd.DataFrame({"t": range(50), "x": [0.0, 1.0] * 25}), time="t", response="x")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     sn.export_csv(recording, f"{folder}/mine.csv")
    """
    frame = flat_table(recording)
    write_atomically(path, lambda temporary: frame.to_csv(temporary, index=False))


def flat_table(recording: xr.Dataset) -> pd.DataFrame:
    """Return a recording as one table: a row for each sample, a column for each channel and property of segments.

    Raises SchemaError where it is not a recording.
    """
    validate_recording(recording)
    sizes = recording["row_size"].values
    columns: dict[str, object] = {
        "time_s": recording["time_s"].values,
        "segment": np.repeat(np.arange(sizes.size), sizes),
    }
    for name, row in SEGMENT_VARIABLES.items():
        if name not in recording:
            continue
        if not row.unit:
            columns[name] = pd.Categorical(recording[name].values.astype(str)).repeat(sizes)
        elif name != "row_size":
            columns[name] = np.repeat(recording[name].values, sizes)
    for name in SAMPLE_VARIABLES:
        if name in recording and name not in columns:
            columns |= _channel_columns(name, recording[name])
    return pd.DataFrame(columns)


def _channel_columns(name: str, channel: xr.DataArray) -> dict[str, Array]:
    """Return the columns of one channel by name, the unit at the end of each name."""
    if name in ("response", "drive"):
        unit = str(channel.attrs["units"])
        suffix = unit_suffix(unit)
        return {f"{name}_{suffix}" if suffix else name if unit == "1" else f"{name} [{unit}]": channel.values}
    if channel.ndim == 1:
        return {name: channel.values}
    if channel.dims[1] == "quaternion":
        return {f"{name}_{label}": channel.values[:, i] for i, label in enumerate(("w", *_AXES))}
    stem, rest = name.split("_", 1)
    labels = _AXES if channel.dims[1] == "axis" else [str(i + 1) for i in range(channel.shape[1])]
    return {f"{stem}_{label}_{rest}": channel.values[:, i] for i, label in enumerate(labels)}


_LONGEST_NAME = 63


def export_mat(recording: xr.Dataset, path: Path | str) -> None:
    """Write a recording as a MATLAB 5 file, atomically.

    The file holds one variable for each channel, a row for each sample, by its name in the schema; `segments`, a struct
    with a column for each property of the segments and the numbers of their first and last sample, counted from 1;
    `units`, a struct from name to unit; and `attributes`, the provenance as text.
    Raises SchemaError where it is not a recording, FileError where the file cannot be written.

    >>> import tempfile, pandas as pd
    >>> import sinew as sn
    >>> recording = sn.read(pd.DataFrame({"t": range(50), "x": [0.0, 1.0] * 25}), time="t", response="x")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     sn.export_mat(recording, f"{folder}/mine.mat")
    """
    validate_recording(recording)
    channels = [name for name in map(str, recording.data_vars) if name not in SEGMENT_VARIABLES]
    slices = segment_slices(recording)
    columns = [name for name in SEGMENT_VARIABLES if name in recording]
    segments: dict[str, Any] = {name: _matlab_values(recording[name].values) for name in columns}
    segments["first"] = _matlab_values(np.array([s.start + 1 for s in slices], dtype=float))
    segments["last"] = _matlab_values(np.array([s.stop for s in slices], dtype=float))
    units = {name: str(recording[name].attrs.get("units", "")) for name in [*channels, *columns]}
    content = {
        **{name: _matlab_values(recording[name].values) for name in channels},
        "segments": segments,
        "units": units,
        "attributes": {_matlab_name(str(key)): str(value) for key, value in recording.attrs.items()},
    }
    write_atomically(path, lambda temporary: _save(temporary, content))


def _save(path: Path, content: dict[str, Any]) -> None:
    io.savemat(str(path), content, appendmat=False, format="5", long_field_names=True, do_compression=True)


def _matlab_values(values: Any) -> Any:
    """Return what MATLAB should see: a column of doubles for numbers, a column cell array for text."""
    if values.dtype.kind in "fiub":
        return np.asarray(values, dtype=float).reshape(len(values), -1)
    cells = np.empty((len(values), 1), dtype=object)
    cells[:, 0] = [str(value) for value in values]
    return cells


def _matlab_name(text: str) -> str:
    name = re.sub(r"\W", "_", text, flags=re.ASCII)
    return (name if name[:1].isalpha() else f"x_{name}")[:_LONGEST_NAME]


def export_recording(recording: xr.Dataset, path: Path | str, to: str) -> None:
    """Write a recording for other programs, atomically.

    to: csv or parquet, one flat table; mat, for MATLAB; uff, a universal file with a data set 58 for every channel of
    every segment, twelve digits over six digits of the time since the segment's begin; mcap, for Foxglove and
    PlotJuggler: a message for every sample, at its time in the recording, from its first sample on where that lies
    before zero.
    Raises SchemaError where it is not a recording, SpecError for another format, FileError where the file cannot be
    written or its library is missing.

    >>> import tempfile, pandas as pd
    >>> import sinew as sn
    >>> recording = sn.read(pd.DataFrame({"t": range(50), "x": [0.0, 1.0] * 25}), time="t", response="x")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     sn.export_recording(recording, f"{folder}/mine.csv", "csv")
    """
    if to not in EXPORTS:
        raise SpecError(f"format is {to!r}, expected one of {', '.join(EXPORTS)}")
    EXPORTS[to](recording, as_path(path))


def _export_parquet(recording: xr.Dataset, path: Path) -> None:
    fastparquet = library(path, "fastparquet", "fastparquet", "a Parquet file", "writes")
    frame = flat_table(recording)
    write_atomically(path, lambda temporary: fastparquet.write(str(temporary), frame, write_index=False))


def _export_mcap(recording: xr.Dataset, path: Path) -> None:
    writer = library(path, "mcap.writer", "mcap", "an MCAP file", "writes")
    frame = flat_table(recording)
    earliest = min(0.0, float(frame["time_s"].min()))  # a message has no time before zero
    properties = {
        name: {"type": "number" if pd.api.types.is_numeric_dtype(column) else "string"}
        for name, column in frame.items()
    }
    schema = json.dumps({"title": "sinew.Sample", "type": "object", "properties": properties})

    def write(temporary: Path) -> None:
        with temporary.open("wb") as stream:
            out = writer.Writer(stream)
            out.start(profile="", library="sinew")
            number = out.register_schema("sinew.Sample", "jsonschema", schema.encode())
            channel = out.register_channel(_SAMPLES, "json", number)
            for stamp, row in zip(frame["time_s"], frame.to_dict("records"), strict=True):
                at = round((stamp - earliest) * 1e9)
                known = {name: value for name, value in row.items() if value == value}
                out.add_message(channel, at, json.dumps(known).encode(), at)
            out.add_metadata("sinew", {str(key): str(value) for key, value in recording.attrs.items()})
            out.finish()

    write_atomically(path, write)


def _export_uff(recording: xr.Dataset, path: Path) -> None:
    pyuff = library(path, "pyuff", "pyuff", "a universal file", "writes")
    frame = flat_table(recording)
    properties = {"segment", *SEGMENT_VARIABLES}
    channels = [name for name in frame.columns if name not in properties | {"time_s"}]

    sets = []
    for segment, rows in frame.groupby("segment", sort=True):
        for number, name in enumerate(channels):
            data = {
                "type": 58,
                "binary": 0,  # of binary sets the library reads some back wrongly
                "func_type": 1,  # a time response
                "ver_num": int(segment) + 1,
                "id1": name,
                "id2": f"segment {segment}: {rows['kind'].iloc[0]}",
                "id3": f"time 0 is {float(rows['time_s'].iloc[0])!r} s of the recording",
                "data": rows[name].to_numpy(dtype=float),
                "x": (rows["time_s"] - rows["time_s"].iloc[0]).to_numpy(),
                "abscissa_spacing": 0,  # the times are written, too
                "rsp_node": number + 1,
                "rsp_dir": 0,
                "ref_node": 0,
                "ref_dir": 0,
                "abscissa_spec_data_type": 17,  # time
                "ordinate_spec_data_type": 0,
                "orddenom_spec_data_type": 0,
                "z_axis_spec_data_type": 0,
            }
            sets.append(data)
    write_atomically(path, lambda temporary: pyuff.UFF(str(temporary)).write_sets(sets, mode="overwrite"))


EXPORTS: dict[str, Callable[[xr.Dataset, Path], None]] = {
    "csv": export_csv,
    "mat": export_mat,
    "parquet": _export_parquet,
    "uff": _export_uff,
    "mcap": _export_mcap,
}
"""How a recording is written, by the name that `sinew export --to` has for it."""
