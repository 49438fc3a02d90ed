"""Text tables: their columns by name, and the numbers of a column."""

import csv
import difflib
import io
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd  # type: ignore[import-untyped,unused-ignore]
from numpy.typing import NDArray

from sinew.measure.doors import as_path, most_bytes
from sinew.measure.errors import FileError, RecordingError

# A pandas DataFrame with one column for each field and the names as the file has them (duplicates kept).
Table: TypeAlias = "pd.DataFrame"

_DELIMITERS = (",", ";", "\t")
_COMMENTS = ("#", "%", "//")
_BINARY = {
    b"\x89HDF": "HDF5 or NetCDF",
    b"CDF": "NetCDF",
    b"PK\x03\x04": "a zip archive or an Excel file",
    b"MATLAB": "MAT",
}
_TEXT_GROWS = 4  # bytes, text and numbers are in memory together
_SCANNED_LINES, _HEAD_SIZE = 50, 1_000_000


def read_table(path: "Path | str | Table") -> Table:
    """Return the table of a text file as a DataFrame, columns named by its header; a DataFrame is one already.

    The delimiter (comma, semicolon, tab, else blanks), a decimal comma, comment lines before the header (#, %, //)
    and a header that is itself a comment are recognised. Cells are not judged here: see `numbers`.
    Raises FileError for a file that is absent, empty, binary, without header or without rows.
    """
    if isinstance(path, pd.DataFrame):
        return path.set_axis([str(name) for name in path.columns], axis=1)
    path = as_path(path)
    text = _text(path)
    lines = text[:_HEAD_SIZE].splitlines(keepends=True)
    start, header = _find_header(path, lines)
    body = [line.rstrip("\r\n") for line in lines[start : start + _SCANNED_LINES] if line.strip()]
    if not body:
        raise FileError(f"{path} has a header but no rows below it; record again or choose another file")
    delimiter = _sniff([header, *body])
    names = [name.strip() for name in _fields(header, delimiter)]
    counts = [len(_fields(line, delimiter)) for line in body]
    usual = max(counts, key=counts.count)
    if usual != len(names):
        raise _not_a_table(path, len(names), f"most rows have {usual}")
    decimal = "," if delimiter in (";", "\t") and not any("." in line for line in body) else "."
    frame = _parse(path, text[sum(map(len, lines[:start])) :], len(names), delimiter, decimal)
    frame.columns = pd.Index(names)
    unnamed_and_empty = np.array([not name for name in names]) & frame.isna().all().to_numpy()
    return frame.loc[:, ~unnamed_and_empty]


def _text(path: Path) -> str:
    if path.is_dir():
        raise FileError(f"{path} is a folder, expected a CSV file")
    try:
        if (size := path.stat().st_size) > (most := most_bytes() // _TEXT_GROWS):
            raise FileError(
                f"{path} has {size / 1e6:.0f} MB, expected at most {most / 1e6:.0f} MB of text in the memory there "
                "is; cut it, or read it on a computer with more"
            )
        raw = path.read_bytes()
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}") from error
    if not raw.strip():
        raise FileError(f"{path} is empty; expected a header line with column names and rows of numbers below it")
    kind = next((kind for magic, kind in _BINARY.items() if raw.startswith(magic)), None)
    if kind:
        raise FileError(
            f"{path} is not a text table, it is {kind}; export it as CSV, or give a recording without columns"
        )
    for encoding in ("utf-16", "utf-8-sig", "cp1252"):
        if encoding == "utf-16" and not raw.startswith((b"\xff\xfe", b"\xfe\xff")):
            continue
        try:
            text = raw.decode(encoding)
        except UnicodeDecodeError:
            continue
        controls = sum(text.count(chr(code)) for code in range(32) if chr(code) not in "\t\n\r\f")
        if controls == 0:
            return text
    raise FileError(f"{path} is not a text table (it holds binary data); expected CSV with a header line")


def _find_header(path: Path, lines: Sequence[str]) -> tuple[int, str]:
    """Return (index of the first line below the header, header text)."""
    comment = ""
    for index, line in enumerate(lines):
        text = line.strip()
        if not text:
            continue
        if text.startswith(_COMMENTS):
            comment = text.lstrip("#%/ ")
            continue
        delimiter = _sniff([line])
        fields = _fields(line, delimiter)
        if not all(_is_number(field) for field in fields if field.strip()):
            return index + 1, line.rstrip("\r\n")
        if len(_fields(comment, _sniff([comment, line]))) == len(fields) and comment and not _is_number(comment):
            return index, comment
        raise FileError(
            f"{path} has no header: its first line is {text[:60]!r}; "
            "put a line with the names of the columns above it, such as time_s,angle_deg"
        )
    raise FileError(f"{path} holds only comments; expected a header line and rows of numbers")


def _is_number(text: str) -> bool:
    try:
        float(text.strip().replace(",", "."))
    except ValueError:
        return False
    return True


def _fields(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])


def _sniff(lines: Sequence[str]) -> str | None:
    """Return the delimiter that gives most lines the same number (above one) of fields; None means blanks."""
    best, best_score = None, (0, 0)
    for delimiter in _DELIMITERS:
        counts = [len(_fields(line, delimiter)) for line in lines]
        usual = max(counts, key=counts.count)
        if usual > 1 and counts[0] > 1 and (counts.count(usual), -_DELIMITERS.index(delimiter)) > best_score:
            best, best_score = delimiter, (counts.count(usual), -_DELIMITERS.index(delimiter))
    return best or next((delimiter for delimiter in _DELIMITERS if delimiter in lines[0]), None)


def _parse(path: Path, text: str, width: int, delimiter: str | None, decimal: str) -> Table:
    options: dict[str, Any] = {"sep": delimiter or r"\s+", "decimal": decimal, "skipinitialspace": True}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return pd.read_csv(
                io.StringIO(text),
                header=None,
                names=range(width),
                index_col=False,
                low_memory=False,
                comment="#",
                **options,
            )
        except (pd.errors.ParserError, pd.errors.ParserWarning, pd.errors.EmptyDataError, ValueError) as error:
            reason = " ".join(str(error).split()).removeprefix("Error tokenizing data. C error: ")
            raise _not_a_table(path, width, reason) from error


def _not_a_table(path: Path, width: int, reason: str) -> FileError:
    return FileError(
        f"{path} is not a table of {width} columns as its header says ({reason}); "
        "the first line must name the columns, and lines above it must start with #"
    )


def find_columns(table: Table, spec: str) -> tuple[list[str], str | None]:
    """Return (columns, unit) that a specification "COL", "COL:unit" or "COL,COL,COL:unit" names.

    An exact column name goes first, whatever it holds; the unit stands after the last colon; several columns are
    separated by commas. The unit is None where none was written.
    Raises RecordingError for a column that is missing or not unique, with the columns that were found.
    """
    present = [str(name) for name in table.columns]
    head, colon, unit = spec.rpartition(":")
    for text, stated in ((spec, None), (head, unit.strip())):
        if text in present:
            return [_unique(table, text)], stated
        names = [name.strip() for name in text.split(",")]
        if all(name in present for name in names):
            return [_unique(table, name) for name in names], stated
        if not colon:
            break
    wanted = (head if colon else spec).split(",")
    raise RecordingError(_missing(next((n.strip() for n in wanted if n.strip() not in present), spec), present))


def _unique(table: Table, name: str) -> str:
    count = int((table.columns == name).sum())
    if count > 1:
        raise RecordingError(f"column {name!r} occurs {count} times; give the columns different names")
    return name


def _missing(name: str, present: Sequence[str]) -> str:
    close = difflib.get_close_matches(name.lower(), [p.lower() for p in present], n=1, cutoff=0.5)
    meant = next((p for p in present if close and p.lower() == close[0]), None)
    listed = ", ".join(present[:24]) + (f" and {len(present) - 24} more" if len(present) > 24 else "")
    return f"no column {name!r}{f', did you mean {meant!r}?' if meant else ';'} columns found: {listed}"


def numbers(table: Table, name: str, rows: slice = slice(None)) -> NDArray[np.float64]:
    """Return the numbers of one column as float64, shape (n,).

    rows: the data rows that matter, the others are not judged.
    Raises RecordingError naming the first data row (from 1, below the header) that is empty, NaN, infinite or text.
    """
    column = table[name].iloc[rows]
    if column.dtype.kind in "mM" or isinstance(column.dtype, pd.DatetimeTZDtype):
        raise RecordingError(f"column {name!r} holds dates or durations, expected numbers; they can only be the time")
    values = np.asarray(pd.to_numeric(column, errors="coerce"), dtype=float)
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        row = int(bad[0]) + (rows.start or 0) + 1
        cell = column.iloc[int(bad[0])]
        if isinstance(cell, str):
            hint = "; if this row holds units, delete it and write COLUMN:unit instead" if row == 1 else ""
            raise RecordingError(f"column {name!r} holds {cell!r} in data row {row}, expected a number{hint}")
        what = "infinity" if np.isinf(values[bad[0]]) else "NaN or an empty cell"
        raise RecordingError(
            f"column {name!r} holds {what} in data row {row} ({bad.size} such rows in all); "
            "fill in or remove them, or select the rows without them by start and stop"
        )
    return values
