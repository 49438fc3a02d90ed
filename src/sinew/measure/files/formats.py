"""Files of other programs, read and written: MATLAB, HDF5, TDMS, UFF 58, Excel, Parquet and MCAP, each by its library.

A file is told by its first bytes, never by its name. What it holds becomes runs of columns, as a text's does.
"""

import importlib
import io
import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd  # type: ignore[import-untyped,unused-ignore]
import xarray as xr
from numpy.typing import NDArray
from scipy.io import loadmat, savemat

from sinew.measure.arrays import Array
from sinew.measure.errors import FileError, SinewError, SpecError, how_to_install
from sinew.measure.files.runs import (
    MADE_TIME,
    Column,
    Opened,
    Run,
    Table,
    noted,
    number_columns,
    runs_of_columns,
    time_columns,
)
from sinew.measure.files.text import open_text, table_of_cells
from sinew.measure.recording import SAMPLE_VARIABLES, SEGMENT_VARIABLES, segment_slices, validate_recording
from sinew.measure.units import unit_suffix
from sinew.measure.validation import as_path, refuse_beyond_memory, write_atomically

_MOST_COLUMNS = 64  # of one array of a MATLAB or HDF5 file: more is a picture or a matrix
_RATES = re.compile(r"fs|fsample|samplerate|samplingrate|samplefrequency|samplingfrequency|fsamp|ratehz|fshz", re.I)
_STEPS = re.compile(r"dt|ts|timestep|sampletime|samplingtime|deltat|deltax", re.I)


def open_file(path: Path, width: int | None = None) -> Opened:
    """Return what somebody's file of measurements holds, whatever its format. width: as in `open_text`.

    Raises FileError where the file is absent, its format is not known or it cannot be read, or the library that reads
    it is missing.
    """
    if path.is_dir():
        bags = sorted(path.glob("*.mcap"))
        if len(bags) == 1 and (path / "metadata.yaml").is_file():
            return _open_mcap(bags[0])
        raise FileError(f"{path} is a folder, expected a CSV file or another table; name a file in it")
    try:
        with path.open("rb") as file:
            head = file.read(600)
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}") from error
    for sign, opener in _OPENERS:
        if sign(head):
            refuse_beyond_memory(path, 2 * path.stat().st_size)
            return opener(path)
    return open_text(path, width)


def library(path: Path, module: str, package: str, what: str, does: str = "reads") -> Any:
    """Return a library that reads or writes a file, whichever it `does`, and does not come with Sinew.

    Raises FileError, with how to install it, where it is missing.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise FileError(
            f"{path.name} is {what}, which {package} {does}, and that is not installed; "
            f"install it: {how_to_install('files')}"
        ) from error


@contextmanager
def _reading(path: Path, what: str) -> Iterator[None]:
    """Turn whatever a library says of a bad file into a FileError: each has errors of its own, and plain ones."""
    try:
        yield
    except (SinewError, MemoryError):
        raise
    except Exception as error:
        said = " ".join(str(error).split())[:160] or type(error).__name__
        raise FileError(
            f"{path} is not a text table, it is {what}, and cannot be read ({said}); is it whole? else export it as CSV"
        ) from error


# MATLAB and HDF5: a tree of arrays.


def _open_mat(path: Path) -> Opened:
    with _reading(path, "MAT, a file of MATLAB"):
        held = loadmat(path, simplify_cells=True)
    return _opened(path, "MATLAB 5", _arrays({key: value for key, value in held.items() if not key.startswith("__")}))


def _arrays(tree: Mapping[str, Any], group: str = "") -> Iterator[tuple[str, str, Any]]:
    """Yield (group, name, value) of everything in a tree of structs."""
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from _arrays(value, f"{group}/{name}".lstrip("/"))
        else:
            yield group, str(name), value


def _open_hdf5(path: Path) -> Opened:
    h5py = library(path, "h5py", "h5py", "HDF5 or NetCDF")
    found: list[tuple[str, str, Any]] = []
    units: dict[tuple[str, str], str] = {}

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiu" or name.startswith("#"):
            return
        if "MATLAB_class" in item.attrs and item.attrs["MATLAB_class"] in (b"char", b"cell"):
            return
        group, _, own = name.rpartition("/")
        values = item[()]
        found.append((group, own, values.T if is_matlab and np.ndim(values) == 2 else values))
        unit = next((item.attrs[key] for key in ("units", "unit", "Units", "Unit") if key in item.attrs), None)
        if isinstance(unit, (str, bytes)):
            units[group, own] = unit.decode(errors="replace") if isinstance(unit, bytes) else unit

    with path.open("rb") as file:
        is_matlab = file.read(6) == b"MATLAB"
    with _reading(path, "MAT 7.3, a file of MATLAB" if is_matlab else "HDF5 or NetCDF"), h5py.File(path, "r") as file:
        file.visititems(visit)
    return _opened(path, "MATLAB 7.3 (HDF5)" if is_matlab else "HDF5", found, units)


def _opened(
    path: Path, form: str, found: Iterable[tuple[str, str, Any]], units: Mapping[tuple[str, str], str] | None = None
) -> Opened:
    """Return the runs of a tree of arrays; a scalar that is named like a rate or a step gives its group a time."""
    columns: list[Column] = []
    steps: dict[str, float] = {}
    for group, name, value in found:
        values = np.asarray(value)
        word = re.sub(r"[\s_]", "", name)
        if values.dtype.kind not in "fiu":
            continue
        if values.size == 1:
            number = float(values.ravel()[0])
            if number > 0 and math.isfinite(number) and (_RATES.fullmatch(word) or _STEPS.fullmatch(word)):
                steps[group] = 1.0 / number if _RATES.fullmatch(word) else number
            continue
        columns += _columns_of(group, name, values, (units or {}).get((group, name)))
    if not columns:
        raise FileError(f"{path} holds no columns of numbers; expected arrays of one number for each sample")
    stated = [Column(one.group, one.name, one.values, one.unit, steps.get(one.group, steps.get(""))) for one in columns]
    return Opened(form, runs_of_columns(stated))


def _columns_of(group: str, name: str, values: NDArray[Any], unit: str | None) -> list[Column]:
    flat = values.squeeze()
    if flat.ndim == 1:
        return [Column(group, name, flat, unit)]
    if flat.ndim != 2 or min(flat.shape) > _MOST_COLUMNS:
        return []
    tall = flat if flat.shape[0] >= flat.shape[1] else flat.T
    return [Column(group, f"{name}_{k}", tall[:, k - 1], unit) for k in range(1, tall.shape[1] + 1)]


# TDMS of LabVIEW, and the universal file format of modal analysis.


_TDMS_UNITS = ("unit_string", "NI_UnitDescription", "Unit")


def _open_tdms(path: Path) -> Opened:
    nptdms = library(path, "nptdms", "npTDMS", "a TDMS file of LabVIEW")
    columns = []
    with _reading(path, "TDMS, a file of LabVIEW"):
        for group in nptdms.TdmsFile.read(path).groups():
            for channel in group.channels():
                values = np.asarray(channel[:])
                if not values.size or values.dtype.kind not in "fiuM":
                    continue
                told = channel.properties
                unit = next((str(told[key]) for key in _TDMS_UNITS if told.get(key)), None)
                step = float(told.get("wf_increment") or 0.0) or None
                start = float(told.get("wf_start_offset") or 0.0)
                columns.append(Column(group.name, channel.name, values, unit, step, start))
    if not columns:
        raise FileError(f"{path} is a TDMS file without a channel of numbers; record again or choose another file")
    return Opened("TDMS (LabVIEW)", runs_of_columns(columns, apart=True))


_DIRECTIONS = {0: "", 1: "+X", -1: "-X", 2: "+Y", -2: "-Y", 3: "+Z", -3: "-Z", 4: "+RX", -4: "-RX", 5: "+RY", -5: "-RY"}
_TIME_RECORDS = (0, 1)  # of the function types of UFF 58: general or not known, time response


def _open_uff(path: Path) -> Opened:
    pyuff = library(path, "pyuff", "pyuff", "a universal file (UFF)")
    with _reading(path, "a universal file (UFF)"):
        file = pyuff.UFF(str(path))
        kinds = [int(kind) for kind in file.get_set_types()]
        held = [file.read_sets(k) for k, kind in enumerate(kinds) if kind == 58]
        sets = [one for one in held if int(one["func_type"]) in _TIME_RECORDS and not np.iscomplexobj(one["data"])]
    if not sets:
        raise FileError(
            f"{path} is a universal file without a time record (type 58, function 1); it holds data sets of type "
            f"{', '.join(map(str, sorted(set(kinds)))) or 'none'}; export the time records"
        )
    columns: list[Column] = []
    seen: dict[str, int] = {}
    with _reading(path, "a universal file (UFF)"):
        for one in sets:
            node, turn, title = int(one["rsp_node"]), int(one["rsp_dir"]), str(one["id1"]).strip()
            name = f"{node}{_DIRECTIONS.get(turn, '')}" if node or turn else title or "response"
            seen[name] = seen.get(name, 0) + 1  # a sensor that comes again begins another run
            group, unit = f"set {seen[name]}", str(one.get("ordinate_axis_units_lab", ""))
            values, x = np.asarray(one["data"], dtype=float), np.asarray(one["x"], dtype=float)
            even = int(one["abscissa_spacing"]) == 1
            if not even and not any((column.group, column.name) == (group, MADE_TIME) for column in columns):
                columns.append(Column(group, MADE_TIME, x))
            step = float(one["abscissa_inc"]) if even else None
            columns.append(Column(group, name, values, unit, step, float(x[0])))
    groups = list(dict.fromkeys(column.group for column in columns))
    runs = [run for group in groups for run in runs_of_columns([c for c in columns if c.group == group])]
    return Opened("universal file (UFF 58)", tuple(runs))


# Excel and Parquet: tables already.


def _open_excel(path: Path) -> Opened:
    from python_calamine import CalamineWorkbook

    runs: list[Run] = []
    with _reading(path, "a zip archive or an Excel file"):
        book = CalamineWorkbook.from_path(path)
        sheets = {name: book.get_sheet_by_name(name).to_python(skip_empty_area=True) for name in book.sheet_names}
    refused = ""
    for name, rows in sheets.items():
        try:
            found = table_of_cells([[_cell(cell) for cell in row] for row in rows], f"sheet {name!r} of {path}")
        except FileError as error:
            refused = refused or str(error)
            continue
        runs += [Run(f"{name} {label}".strip(), partial(noted, table)) for label, table in found]
    if not runs:
        raise FileError(refused or f"{path} is an Excel file without a sheet; export the table as CSV")
    return Opened("Excel", tuple(runs))


def _cell(cell: Any) -> str:
    """Return a cell of a sheet as text: numbers in full, dates and times by ISO 8601."""
    if isinstance(cell, float):
        return repr(cell)
    return cell.isoformat() if hasattr(cell, "isoformat") else str(cell).strip()


def _open_parquet(path: Path) -> Opened:
    fastparquet = library(path, "fastparquet", "fastparquet", "a Parquet file")
    # Of a path it would leave the file open, and of a damaged file it prints what no caller asked for.
    with _reading(path, "a Parquet file"), path.open("rb") as file, redirect_stdout(io.StringIO()):
        table = fastparquet.ParquetFile(file).to_pandas()
    if table.index.name is not None:
        table = table.reset_index()
    table = table.reset_index(drop=True).set_axis(pd.Index(list(map(str, table.columns))), axis=1)
    return Opened("Parquet", (Run("", partial(noted, table)),))


# MCAP, which rosbag2 writes: a run is a topic, a column each number of its messages.


def _open_mcap(path: Path) -> Opened:
    reader = library(path, "mcap.reader", "mcap", "an MCAP file (rosbag2)")
    with _reading(path, "an MCAP file (rosbag2)"), path.open("rb") as file:
        summary = reader.make_reader(file).get_summary()
        topics = list(dict.fromkeys(channel.topic for channel in summary.channels.values())) if summary else []
    tables = {topic: _read_topic(path, topic) for topic in topics}
    runs = [Run(topic, partial(noted, table)) for topic, table in tables.items() if table is not None]
    if not runs:
        raise FileError(
            f"{path} is an MCAP file without a topic of numbers (of {', '.join(topics) or 'none'}); messages of ROS 2 "
            "and JSON are read"
        )
    return Opened("MCAP (rosbag2)", tuple(runs))


def _read_topic(path: Path, topic: str) -> "Table | None":
    """Return a topic as a table, with its headers' time, its own or the log's; None where it holds no numbers."""
    reader = library(path, "mcap.reader", "mcap", "an MCAP file (rosbag2)")
    ros = library(path, "mcap_ros2.decoder", "mcap-ros2-support", "an MCAP file (rosbag2)")
    rows: list[dict[str, float]] = []
    logged: list[int] = []
    with _reading(path, "an MCAP file (rosbag2)"), path.open("rb") as file:
        factory = ros.DecoderFactory()
        for schema, channel, message in reader.make_reader(file).iter_messages(topics=[topic]):
            decode: Callable[[bytes], Any] | None = factory.decoder_for(channel.message_encoding, schema)
            if decode is None and channel.message_encoding == "json":
                decode = json.loads
            if decode is None:
                return None
            rows.append(dict(_numbers_in(decode(message.data))))
            logged.append(int(message.log_time))
    if not rows:
        return None
    table = pd.DataFrame(rows)
    stamps = [f"header.stamp.{part}" for part in ("sec", "nanosec")]
    if set(stamps) <= set(table.columns) and bool((table[stamps[0]] > 0).all()):
        times = table[stamps[0]].astype("int64") * 1_000_000_000 + table[stamps[1]].astype("int64")
        said = "time by the headers of the messages, from the first on"
    elif time_columns(table):
        return table if number_columns(table) else None
    else:
        times, said = pd.Series(logged, dtype="int64"), "time by the log, from the first message on"
    table = table[[name for name in number_columns(table) if not name.startswith("header.stamp")]]
    if table.shape[1] == 0:
        return None
    seconds = ((times - int(times.iloc[0])) * 1e-9).rename(MADE_TIME)
    return noted(pd.concat([seconds, table], axis=1), said)


def _numbers_in(message: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Yield (path, number) of every number in a message; a list of more than `_MOST_COLUMNS` is left out."""
    if isinstance(message, (bool, int, float)):
        yield path, float(message)
    elif isinstance(message, Mapping):
        for name, value in message.items():
            yield from _numbers_in(value, f"{path}.{name}".lstrip("."))
    elif isinstance(message, (list, tuple)):
        for place, value in enumerate(message if len(message) <= _MOST_COLUMNS else ()):
            yield from _numbers_in(value, f"{path}.{place}".lstrip("."))
    elif hasattr(message, "tolist"):
        yield from _numbers_in(message.tolist(), path)
    elif hasattr(message, "__slots__") and not isinstance(message, (str, bytes)):
        for name in message.__slots__:
            if not name.startswith("_"):
                yield from _numbers_in(getattr(message, name), f"{path}.{name}".lstrip("."))


def _refuse(what: str, how: str, path: Path) -> Opened:
    raise FileError(f"{path} is not a text table, it is {what}; {how}")


_UFF = re.compile(rb"\s*-1\s*\r?\n\s*\d+b?\s")
_OPENERS: tuple[tuple[Callable[[bytes], object], Callable[[Path], Opened]], ...] = (
    (lambda head: head.startswith(b"MATLAB 7.3"), _open_hdf5),
    (lambda head: head.startswith(b"MATLAB 5"), _open_mat),
    (lambda head: head.startswith(b"\x89HDF\r\n\x1a\n"), _open_hdf5),
    (lambda head: head.startswith(b"TDSm"), _open_tdms),
    (lambda head: head.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")), _open_excel),
    (lambda head: head.startswith(b"PAR1"), _open_parquet),
    (lambda head: head.startswith(b"\x89MCAP"), _open_mcap),
    (_UFF.match, _open_uff),
    (
        lambda head: head.startswith(b"CDF"),
        partial(_refuse, "NetCDF", "export it as CSV, or give a recording without columns"),
    ),
    (
        lambda head: head.startswith(b"SQLite format 3"),
        partial(_refuse, "a rosbag2 of SQLite", "turn it into MCAP with `ros2 bag convert`"),
    ),
    (
        lambda head: head.startswith(b"#ROSBAG"),
        partial(_refuse, "a bag of ROS 1", "turn it into MCAP with `mcap convert`"),
    ),
)


# Written for other programs: what stands here reads it back.


_AXES = "xyz"
_SAMPLES = "/sinew/samples"


def export_recording(recording: xr.Dataset, path: Path | str, to: str) -> None:
    """Write a recording for other programs, atomically.

    to: csv or parquet, one flat table: a row for each sample, the properties of segments repeated in each, a column for
    each part of a channel (`gyro_x_rad_s`, `tendon_1_current_a`), numbers so that they read back unchanged. mat, for
    MATLAB 5: a variable for each channel by its name in the schema, a row for each sample; `segments`, a struct with a
    column for each property and the numbers of their first and last sample, counted from 1; `units`, a struct from name
    to unit; and `attributes`, the provenance as text. uff, a universal file with a data set 58 for every channel of
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
    EXPORTS[to](validate_recording(recording), as_path(path))


def _export_csv(recording: xr.Dataset, path: Path) -> None:
    frame = flat_table(recording)
    write_atomically(path, lambda temporary: frame.to_csv(temporary, index=False))


def flat_table(recording: xr.Dataset) -> pd.DataFrame:
    """Return a recording as one table: a row for each sample, a column for each channel and property of segments."""
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


def _export_mat(recording: xr.Dataset, path: Path) -> None:
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
    options: dict[str, Any] = {"appendmat": False, "long_field_names": True, "do_compression": True}
    write_atomically(path, lambda temporary: savemat(str(temporary), content, **options))


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
    "csv": _export_csv,
    "mat": _export_mat,
    "parquet": _export_parquet,
    "uff": _export_uff,
    "mcap": _export_mcap,
}
"""How a recording is written, by the name that `sinew export --to` has for it."""
