"""What a file is, told by its first bytes: text, MATLAB, HDF5, TDMS, UFF 58, Excel, npz, Parquet, MCAP or JSON.

Each is read by its library, and what it holds becomes runs of columns, as a text's does. What the file states of
units, steps and starts is taken.
"""

import importlib
import io
import json
import re
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd  # type: ignore[import-untyped,unused-ignore]
import xarray as xr
from numpy.typing import NDArray
from scipy.io import loadmat, savemat

from sinew.measure.arrays import Array
from sinew.measure.errors import FileError, RecordingError, SinewError, SpecError, how_to_install
from sinew.measure.files.names import (
    Table,
    find_columns,
    listed,
    number_columns,
    stated_step,
    time_columns,
    unit_suffix,
    unlike,
    with_unit,
)
from sinew.measure.files.text import MADE_TIME, Opened, Run, noted, notes_of, open_text, read_text, with_time
from sinew.measure.recording import SAMPLE_VARIABLES, SEGMENT_VARIABLES, segment_slices, validate_recording
from sinew.measure.validation import as_path, refuse_beyond_memory, write_atomically, write_text

_MOST_COLUMNS = 64  # of one array of a MATLAB or HDF5 file: more is a picture or a matrix
_FEWEST_ROWS = 8  # of a run that a restart of the clock begins: fewer cannot be analysed
_UNITS = ("units", "unit", "Units", "Unit", "unit_string", "NI_UnitDescription")


def open_file(path: Path, width: int | None = None) -> Opened:
    """Return what somebody's file of measurements holds, whatever its format. width: as in `open_text`.

    Raises FileError where the file is absent, empty, its format is not known, it cannot be read, or the library that
    reads it is missing.
    """
    if path.is_dir():
        bags = sorted(path.glob("*.mcap"))
        if len(bags) != 1 or not (path / "metadata.yaml").is_file():
            raise FileError(f"{path} is a folder, expected a CSV file or another table; name a file in it")
        path = bags[0]
    try:
        with path.open("rb") as file:
            head = file.read(600)
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}") from error
    if not head.strip():
        raise FileError(f"{path} is empty; expected a header line with column names and rows of numbers below it")
    what, opener = next((rest for begins, *rest in _FORMATS if re.match(begins, head)), ("", None))
    if opener is None:
        return open_text(path, width)
    if isinstance(opener, str):
        raise FileError(f"{path} is not a text table, it is {what}; {opener}")
    refuse_beyond_memory(path, 2 * path.stat().st_size)
    try:
        opened = opener(path)
    except (SinewError, MemoryError):
        raise
    except Exception as error:  # each library has errors of its own, and plain ones
        said = " ".join(str(error).split())[:160] or type(error).__name__
        raise FileError(
            f"{path} begins as {what} but cannot be read, it is cut short or damaged ({said}); else export it as CSV"
        ) from error
    return opened if opened is not None else open_text(path, width)


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


# MATLAB, HDF5, npz: a tree of arrays, some of which make a run.


@dataclass(frozen=True)
class _Column:
    """One array of a file: group and name of it, values of shape (n,), its unit, step and start [s] where stated."""

    group: str
    name: str
    values: NDArray[Any]
    unit: str | None = None
    step_s: float | None = None
    start_s: float = 0.0


def _open_mat(path: Path) -> Opened:
    read = loadmat(path, simplify_cells=True)
    return _opened(path, "MATLAB 5", _arrays({key: value for key, value in read.items() if not key.startswith("__")}))


def _open_npz(path: Path) -> Opened:
    with np.load(path, allow_pickle=False) as file:
        return _opened(path, "npz (NumPy)", [("", name, file[name]) for name in file.files], axes="xyz")


def _arrays(tree: Any, group: str = "") -> Iterator[tuple[str, str, Any]]:
    """Yield (group, name, value) of everything in a tree of structs, and of cells that hold structs."""
    cells = isinstance(tree, (list, np.ndarray))
    for name, value in [(str(k), v) for k, v in enumerate(tree, start=1)] if cells else tree.items():
        structs = isinstance(value, (list, np.ndarray)) and len(np.shape(value)) == 1 and len(value) <= _MOST_COLUMNS
        if isinstance(value, Mapping) or (structs and any(isinstance(one, Mapping) for one in value)):
            yield from _arrays(value, f"{group}/{name}".lstrip("/"))
        else:
            yield group, str(name), value


def _open_hdf5(path: Path) -> Opened:
    h5py = library(path, "h5py", "h5py", "HDF5 or NetCDF")
    found: list[tuple[str, str, Any]] = []
    units: dict[tuple[str, str], str] = {}
    with path.open("rb") as file:
        is_matlab = file.read(6) == b"MATLAB"

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiu" or name.startswith("#"):
            return
        if item.attrs.get("MATLAB_class") in (b"char", b"cell"):
            return
        group, _, own = name.rpartition("/")
        values = item[()]
        found.append((group, own, values.T if is_matlab and np.ndim(values) == 2 else values))
        unit = next((item.attrs[key] for key in _UNITS if key in item.attrs), None)
        if isinstance(unit, (str, bytes)):
            units[group, own] = unit.decode(errors="replace") if isinstance(unit, bytes) else unit

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    return _opened(path, "MATLAB 7.3 (HDF5)" if is_matlab else "HDF5", found, units)


def _opened(
    path: Path,
    form: str,
    found: Iterable[tuple[str, str, Any]],
    units: Mapping[tuple[str, str], str] | None = None,
    axes: str = "",
) -> Opened:
    """Return the runs of a tree of arrays; a scalar that is named like a rate or a step gives its group a time.

    axes: names of the columns of an array that has as many; numbers from 1 else.
    """
    columns: list[_Column] = []
    steps: dict[str, float] = {}
    for group, name, value in found:
        values = np.asarray(value)
        flat = values.squeeze()
        if values.dtype.kind not in "fiu" or flat.ndim > 2 or (flat.ndim == 2 and min(flat.shape) > _MOST_COLUMNS):
            continue
        if not flat.ndim:
            if step := stated_step(name, float(flat)):
                steps[group] = step
        elif flat.ndim == 1:
            columns.append(_Column(group, name, flat, (units or {}).get((group, name))))
        else:
            tall, unit = flat if flat.shape[0] >= flat.shape[1] else flat.T, (units or {}).get((group, name))
            labels = axes if tall.shape[1] == len(axes) else range(1, tall.shape[1] + 1)
            columns += [_Column(group, f"{name}_{label}", one, unit) for label, one in zip(labels, tall.T, strict=True)]
    if not columns:
        raise FileError(f"{path} holds no columns of numbers; expected arrays of one number for each sample")
    stated = [replace(one, step_s=steps.get(one.group, steps.get(""))) for one in columns]
    return Opened(form, _runs_of(stated))


def _runs_of(columns: Sequence[_Column], *, apart: bool = False) -> tuple[Run, ...]:
    """Return the runs that columns of a file with groups make up.

    Each group is a run. Unless groups are to stay apart, those of which all columns have one length, and which do not
    repeat each other's names, are one table, whose columns are named by their paths.
    """
    groups: dict[str, list[_Column]] = {}
    for column in columns:
        groups.setdefault(column.group, []).append(column)
    one_length = len({column.values.size for column in columns}) == 1
    all_names = [column.name for column in columns]
    apart = apart or (len(set(all_names)) < len(all_names) and max(map(len, groups.values())) > 1)
    if len(groups) > 1 and one_length and not apart:
        whole = [replace(column, name=f"/{column.group}/{column.name}".replace("//", "")) for column in columns]
        return (Run("", _table_of(whole)),)
    return tuple(Run(name, _table_of(group)) for name, group in groups.items())


def _table_of(columns: Sequence[_Column]) -> Table:
    """Return columns as a table; those of another length than most samples have are left out, with a note."""
    sizes = [column.values.size for column in columns]
    usual = max(sorted(set(sizes), reverse=True), key=sizes.count)
    chosen = [column for column in columns if column.values.size == usual]
    names = unlike([with_unit(column.name, column.unit) for column in chosen])
    table = pd.DataFrame(dict(zip(names, (column.values for column in chosen), strict=True)))
    if left := [column.name for column in columns if column.values.size != usual]:
        table = noted(table, f"columns of another length than {usual} are left out: {', '.join(left[:8])}")
    steps = {column.step_s for column in chosen if column.step_s}
    starts = [column.start_s for column in chosen if column.step_s]
    if len(steps) != 1 or (time_columns(table) and len(set(starts)) < 2):
        return table
    step = float(steps.pop() or 0.0)
    return with_time(table, step, starts[0]) if len(set(starts)) == 1 else _together(table, step, np.array(starts))


def _together(table: Table, step_s: float, starts: Array) -> Table:
    """Return columns that begin at different times [s] at common ones, from the latest of them on."""
    late = (starts.max() - starts) / step_s
    count = int(len(table) - late.max() + 1e-6)
    if len(starts) < table.shape[1] or count < 1:
        raise FileError("its channels begin at different times and have none in common; export them with their times")
    moved = pd.DataFrame(index=range(count))
    for (name, column), steps in zip(table.items(), late, strict=True):
        at = steps + np.arange(count)
        at = np.rint(at) if abs(steps - round(steps)) < 1e-3 else at  # whole steps: the samples themselves
        moved[name] = np.interp(at, np.arange(len(table)), column.to_numpy(dtype=float))
    lags = zip(table.columns, starts - starts.min(), strict=True)
    said = ", ".join(f"{name!r} {lag:g} s" for name, lag in lags if lag > 0)
    note = f"the channels do not begin together, as the file states; later than the first: {said}; brought to one time"
    return noted(with_time(moved, step_s, float(starts.max() - starts.min())), *notes_of(table), note)


# TDMS of LabVIEW, and the universal file format of modal analysis.


def _open_tdms(path: Path) -> Opened:
    nptdms = library(path, "nptdms", "npTDMS", "a TDMS file of LabVIEW")
    columns = []
    for group in nptdms.TdmsFile.read(path).groups():
        begins = [one.properties["wf_start_time"] for one in group.channels() if "wf_start_time" in one.properties]
        for channel in group.channels():
            values, stated = np.asarray(channel[:]), channel.properties
            if not values.size or values.dtype.kind not in "fiuM":
                continue
            unit = next((str(stated[key]) for key in _UNITS if stated.get(key)), None)
            start = float(stated.get("wf_start_offset") or 0.0)
            if "wf_start_time" in stated:
                start += float((stated["wf_start_time"] - min(begins)) / np.timedelta64(1, "s"))
            step = float(stated.get("wf_increment") or 0.0) or None
            columns.append(_Column(group.name, channel.name, values, unit, step, start))
    if not columns:
        raise FileError(f"{path} is a TDMS file without a channel of numbers; record again or choose another file")
    return Opened("TDMS (LabVIEW)", _runs_of(columns, apart=True))


_DIRECTIONS = {0: "", 1: "+X", -1: "-X", 2: "+Y", -2: "-Y", 3: "+Z", -3: "-Z", 4: "+RX", -4: "-RX", 5: "+RY", -5: "-RY"}
_TIME_RECORDS = (0, 1)  # of the function types of UFF 58: general or not known, time response


def _open_uff(path: Path) -> Opened:
    file = library(path, "pyuff", "pyuff", "a universal file (UFF)").UFF(str(path))
    kinds = [int(kind) for kind in file.get_set_types()]
    held = [file.read_sets(k) for k, kind in enumerate(kinds) if kind == 58]
    sets = [one for one in held if int(one["func_type"]) in _TIME_RECORDS and not np.iscomplexobj(one["data"])]
    if not sets:
        over = f" and {len(held)} functions over frequency" if held else ""
        raise FileError(
            f"{path} is a universal file without a time record (type 58, function 1); it holds data sets of type "
            f"{', '.join(map(str, sorted(set(kinds)))) or 'none'}{over}; export the time records"
        )
    groups: dict[str, list[_Column]] = {}
    seen: dict[str, int] = {}
    for one in sets:
        node, turn, title = int(one["rsp_node"]), int(one["rsp_dir"]), str(one["id1"]).strip()
        name = f"{node}{_DIRECTIONS.get(turn, '')}" if node or turn else title or "response"
        seen[name] = seen.get(name, 0) + 1  # a sensor that comes again begins another run
        group, unit = f"set {seen[name]}", str(one.get("ordinate_axis_units_lab", ""))
        values, x = np.asarray(one["data"], dtype=float), np.asarray(one["x"], dtype=float)
        even, columns = int(one["abscissa_spacing"]) == 1, groups.setdefault(group, [])
        if not even and MADE_TIME not in [column.name for column in columns]:
            columns.append(_Column(group, MADE_TIME, x))
        columns.append(_Column(group, name, values, unit, float(one["abscissa_inc"]) if even else None, float(x[0])))
    return Opened("universal file (UFF 58)", tuple(run for group in groups.values() for run in _runs_of(group)))


# Tables already: Excel, Parquet, JSON.


def _open_zip(path: Path) -> Opened:
    """Return what a zip archive or an old Excel file holds: arrays of NumPy, or sheets, read as a text of tabs is."""
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
        if any(name.endswith(".npy") for name in names):
            return _open_npz(path)
    from python_calamine import CalamineWorkbook

    book = CalamineWorkbook.from_path(path)
    runs: list[Run] = []
    refused = ""
    for name in book.sheet_names:
        rows = book.get_sheet_by_name(name).to_python(skip_empty_area=True)
        text = "\n".join("\t".join(map(_cell, row)) for row in rows)
        try:
            _, found = read_text(f"sheet {name!r} of {path}", text, separator="\t")
        except FileError as error:
            refused = refused or str(error)
            continue
        runs += [Run(f"{name} {label}".strip(), table) for label, table in found]
    if not runs:
        raise FileError(refused or f"{path} is an Excel file without a sheet; export the table as CSV")
    return Opened("Excel", tuple(runs))


def _cell(cell: Any) -> str:
    """Return a cell of a sheet as text: numbers in full, dates and times by ISO 8601, and no mark begins a comment."""
    if isinstance(cell, float):
        return repr(cell)
    text = cell.isoformat() if hasattr(cell, "isoformat") else " ".join(str(cell).split())
    return '"{}"'.format(text.replace('"', '""')) if re.search(r'[#"]|^(%|//)', text) else text


def _open_parquet(path: Path) -> Opened:
    fastparquet = library(path, "fastparquet", "fastparquet", "a Parquet file")
    # Of a path it would leave the file open, and of a damaged file it prints what no caller asked for.
    with path.open("rb") as file, redirect_stdout(io.StringIO()):
        table = fastparquet.ParquetFile(file).to_pandas()
    if table.index.name is not None:
        table = table.reset_index()
    return Opened("Parquet", (Run("", _plain(table)),))


def _plain(table: Table) -> Table:
    return table.reset_index(drop=True).set_axis(pd.Index(list(map(str, table.columns))), axis=1)


def _open_json(path: Path) -> Opened | None:
    """Return the lists of a JSON file with the columns of the longest, or its lines of objects; None of no JSON."""
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    try:
        tree = json.loads(text)
    except json.JSONDecodeError as error:
        try:
            tree = [json.loads(line) for line in text.splitlines() if line.strip()]
        except json.JSONDecodeError:
            if text.lstrip().startswith("{"):
                raise FileError(f"{path} begins as JSON but cannot be read, it is cut short ({error})") from error
            return None
    lists = list(_lists(tree))
    longest = max((table for _, table in lists), key=len, default=pd.DataFrame())
    if len(longest) < 2:
        raise FileError(f"{path} is JSON without a list of samples; write its samples as a table")
    alike = {name: table for name, table in lists if len(table) > 1 and set(table.columns) == set(longest.columns)}
    left = [repr(name) for name, _ in lists if name not in alike]
    runs = []
    for name, table in alike.items():
        notes = [f"the samples are {name!r} of the JSON" if name else "the samples are the list of the JSON"]
        notes += [f"lists with other columns are left out: {listed(left)}"] if left else []
        runs.append(Run(name if len(alike) > 1 else "", noted(_plain(table), *notes)))
    return Opened("JSON", tuple(runs))


def _lists(tree: Any, name: str = "") -> Iterator[tuple[str, Table]]:
    """Yield (name, samples) of every list of objects or of rows, and of the lists of one length in an object."""
    if isinstance(tree, list) and tree and all(isinstance(one, (Mapping, list)) for one in tree):
        objects = isinstance(tree[0], Mapping)
        table = pd.json_normalize(tree) if objects else pd.DataFrame(tree).rename(columns=lambda k: k + 1)
        if objects or table.shape[1] <= _MOST_COLUMNS:
            yield name, table
    elif isinstance(tree, Mapping):
        flat = {key: one for key, one in tree.items() if isinstance(one, list) and one and np.ndim(one[0]) == 0}
        flat = {key: one for key, one in flat.items() if not isinstance(one[0], Mapping)}
        sizes = [len(one) for one in flat.values()]
        if sizes:
            usual = max(sizes, key=sizes.count)
            table = pd.DataFrame({key: one for key, one in flat.items() if len(one) == usual})
            left = [key for key, one in flat.items() if len(one) != usual]
            yield name, noted(table, f"lists of another length are left out: {listed(left)}") if left else table
        for key, one in tree.items():
            if key not in flat:
                yield from _lists(one, f"{name}.{key}".lstrip("."))


# MCAP, which rosbag2 writes: a run is a topic, a column each number of its messages.


def _open_mcap(path: Path) -> Opened:
    reader = library(path, "mcap.reader", "mcap", "an MCAP file (rosbag2)")
    with path.open("rb") as file:
        summary = reader.make_reader(file).get_summary()
    topics = list(dict.fromkeys(channel.topic for channel in summary.channels.values())) if summary else []
    tables = {topic: _read_topic(path, reader, topic) for topic in topics}
    runs = [Run(topic, table) for topic, table in tables.items() if table is not None]
    if not runs:
        raise FileError(
            f"{path} is an MCAP file without a topic of numbers (of {', '.join(topics) or 'none'}); messages of ROS 2 "
            "and JSON are read"
        )
    return Opened("MCAP (rosbag2)", tuple(runs))


def _read_topic(path: Path, reader: Any, topic: str) -> Table | None:
    """Return a topic as a table, with its headers' time, its own or the log's; None where it holds no numbers."""
    ros = library(path, "mcap_ros2.decoder", "mcap-ros2-support", "an MCAP file (rosbag2)")
    rows: list[dict[str, float]] = []
    logged: list[int] = []
    with path.open("rb") as file:
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
        return
    if hasattr(message, "tolist"):
        message = message.tolist()
    parts: Iterable[tuple[Any, Any]] = ()
    if isinstance(message, Mapping):
        parts = message.items()
    elif isinstance(message, (list, tuple)):
        parts = enumerate(message if len(message) <= _MOST_COLUMNS else ())
    elif hasattr(message, "__slots__") and not isinstance(message, (str, bytes)):
        parts = [(name, getattr(message, name)) for name in message.__slots__ if not name.startswith("_")]
    for name, value in parts:
        yield from _numbers_in(value, f"{path}.{name}".lstrip("."))


_FORMATS: tuple[tuple[bytes, str, Callable[[Path], Opened | None] | str], ...] = (
    (b"MATLAB 7.3", "MAT 7.3, a file of MATLAB", _open_hdf5),
    (b"MATLAB 5", "MAT, a file of MATLAB", _open_mat),
    (b"\x89HDF\r\n\x1a\n", "HDF5 or NetCDF", _open_hdf5),
    (b"TDSm", "TDMS, a file of LabVIEW", _open_tdms),
    (b"PK\x03\x04|\xd0\xcf\x11\xe0", "a zip archive (Excel, npz) or an Excel file", _open_zip),
    (b"PAR1", "a Parquet file", _open_parquet),
    (b"\x89MCAP", "an MCAP file (rosbag2)", _open_mcap),
    (rb"\s*-1\s*\r?\n\s*\d+b?\s", "a universal file (UFF)", _open_uff),
    (rb"(\xef\xbb\xbf)?\s*[\[{]", "JSON", _open_json),
    (b"CDF", "NetCDF", "export it as CSV, or give a recording without columns"),
    (b"SQLite format 3", "a rosbag2 of SQLite", "turn it into MCAP with `ros2 bag convert`"),
    (b"#ROSBAG", "a bag of ROS 1", "turn it into MCAP with `mcap convert`"),
    (b"version https://git-lfs", "a pointer to a file kept elsewhere (Git LFS)", "fetch it with `git lfs pull`"),
    (rb"\.*/[^\n]*annex/objects/", "a pointer to a file kept elsewhere (git-annex)", "fetch it with `git annex get`"),
)
"""How a file begins, what that is, and what reads it; or what to do where nothing does."""


# The runs of a file.


def choose_run(opened: Opened, run: int | str | None, source: str) -> Table:
    """Return the table of a run, by its number from 1 or its name; of a file with one run None is enough.

    Raises RecordingError, with the list of runs, where none is chosen of several or there is none of that name.
    """
    runs = opened.runs
    if run is None and len(runs) == 1:
        return runs[0].table
    names = listed((f"{k} {one.name!r}" if one.name else str(k) for k, one in enumerate(runs, start=1)))
    if run is None:
        raise RecordingError(
            f"{source} holds {len(runs)} runs: {names}; choose one by its number or name, as --run 1 (run=1)"
        )
    text = str(run).strip()
    named = [one for one in runs if one.name == text and not isinstance(run, int)]
    if len(named) == 1:
        return named[0].table
    if text.isdecimal() and 1 <= int(text) <= len(runs):
        return runs[int(text) - 1].table
    raise RecordingError(f"{source} has no run {text!r}; it holds {names}")


def with_restarts(opened: Opened, time: str | None) -> Opened:
    """Return what a file holds, its one run taken apart where its time starts anew.

    time: specification of the times' column; None to know it by its name.
    """
    table = opened.runs[0].table
    try:
        found = time_columns(table) if time is None else find_columns(table, time)[0]
    except RecordingError:  # whoever reads it says what is missing
        return opened
    if len(opened.runs) != 1 or len(found) != 1:
        return opened
    stamps = np.asarray(pd.to_numeric(table[found[0]], errors="coerce"), dtype=float)
    known = np.flatnonzero(np.isfinite(stamps))
    steps = np.diff(stamps[known])
    starts = known[np.flatnonzero(steps < 0) + 1]
    if not starts.size or not (steps > 0).any():
        return opened
    edges = [0, *map(int, starts), len(table)]
    beyond, most = stamps[starts] - stamps[known[0]], 2.0 * float(np.median(steps[steps > 0]))
    lasts = float(np.nanmax(stamps) - stamps[known[0]])  # a counter that overflows goes back by far more
    anew = bool(((beyond <= most) & (beyond >= -lasts - most)).all())
    if not anew or min(np.diff(edges)) < _FEWEST_ROWS:
        return opened
    note = f"its time starts anew {starts.size} times"
    parts = enumerate(pairwise(edges), start=1)
    return Opened(opened.form, tuple(Run(f"part {k}", noted(table.iloc[a:b], note)) for k, (a, b) in parts))


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


_ZERO_IN_UFF = (
    *("binary", "abscissa_spacing"),  # text, for the library reads some binary sets back wrongly; with the times
    *("rsp_dir", "ref_node", "ref_dir", "ordinate_spec_data_type", "orddenom_spec_data_type", "z_axis_spec_data_type"),
)


def _export_uff(recording: xr.Dataset, path: Path) -> None:
    pyuff = library(path, "pyuff", "pyuff", "a universal file", "writes")
    frame = flat_table(recording)
    properties = {"segment", *SEGMENT_VARIABLES}
    channels = [name for name in frame.columns if name not in properties | {"time_s"}]

    sets = []
    for segment, rows in frame.groupby("segment", sort=True):
        for node, name in enumerate(channels, start=1):
            data = {
                "type": 58,
                "func_type": 1,  # a time response
                "ver_num": int(segment) + 1,
                "id1": name,
                "id2": f"segment {segment}: {rows['kind'].iloc[0]}",
                "id3": f"time 0 is {float(rows['time_s'].iloc[0])!r} s of the recording",
                "data": rows[name].to_numpy(dtype=float),
                "x": (rows["time_s"] - rows["time_s"].iloc[0]).to_numpy(),
                "rsp_node": node,
                "abscissa_spec_data_type": 17,  # time
            }
            sets.append(dict.fromkeys(_ZERO_IN_UFF, 0) | data)
    write_atomically(path, lambda temporary: pyuff.UFF(str(temporary)).write_sets(sets, mode="overwrite"))


EXPORTS: dict[str, Callable[[xr.Dataset, Path], None]] = {
    "csv": lambda recording, path: write_text(path, flat_table(recording).to_csv(index=False)),
    "mat": _export_mat,
    "parquet": _export_parquet,
    "uff": _export_uff,
    "mcap": _export_mcap,
}
"""How a recording is written, by the name that `sinew export --to` has for it."""
