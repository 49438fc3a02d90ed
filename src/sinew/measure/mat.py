"""This is where recordings become MATLAB files."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy import io

from sinew.measure.netcdf import write_atomically
from sinew.measure.recording import segment_slices
from sinew.measure.schema import SEGMENT_VARIABLES, validate_recording

__all__ = ["export_mat"]

_LONGEST_NAME = 63


def export_mat(recording: xr.Dataset, path: Path | str) -> None:
    """Write a recording as a MATLAB 5 file, atomically.

    The file holds one variable for each channel, a row for each sample, by its name in the schema; `segments`, a struct
    with a column for each property of the segments and the numbers of their first and last sample, counted from 1;
    `units`, a struct from name to unit; and `attributes`, the provenance as text.
    Raises SchemaError where it is not a recording, FileError where the file cannot be written.
    """
    validate_recording(recording)
    channels = [name for name in map(str, recording.data_vars) if name not in SEGMENT_VARIABLES]
    slices = segment_slices(recording)
    segments: dict[str, Any] = {name: _matlab_values(recording[name].values) for name in SEGMENT_VARIABLES}
    segments["first"] = _matlab_values(np.array([s.start + 1 for s in slices], dtype=float))
    segments["last"] = _matlab_values(np.array([s.stop for s in slices], dtype=float))
    units = {name: str(recording[name].attrs.get("units", "")) for name in [*channels, *SEGMENT_VARIABLES]}
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
