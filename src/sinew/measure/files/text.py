"""Text tables in any dialect: where the rows of numbers begin, what parts their cells, and what the columns are called.

A table whose first line that is no comment names the columns is read as it stands. Of any other the rows of numbers
are sought: they begin at the first line from which on nine in ten of the next fifty lines have the same number of
cells and share columns of numbers. The nearest line above with as many cells and text over the numbers is the header;
a line of units between them goes into the names, a second header above it too where the names need it. What stands
above is left out, with a note.
"""

import csv
import io
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd  # type: ignore[import-untyped,unused-ignore]

from sinew.measure.errors import FileError, UnitError
from sinew.measure.files.runs import (
    Opened,
    Run,
    Table,
    bare_name,
    is_time_name,
    noted,
    repeats_itself,
    split_labels,
    unlike,
    with_time,
    with_unit,
)
from sinew.measure.units import canonical_unit
from sinew.measure.validation import refuse_beyond_memory

_DELIMITERS = (",", ";", "\t", None)  # None: blanks
_WORDS = {",": "comma", ";": "semicolon", "\t": "tab", None: "blanks"}
_COMMENTS = ("#", "%", "//")
_TEXT_GROWS = 4  # bytes, text and numbers are in memory together
_SCANNED_LINES, _HEAD_SIZE = 50, 1_000_000
_SHARE = 0.9  # of the scanned lines that must be alike
_FEWEST_ROWS = 4  # of a table that does not begin with its header: fewer lines alike are chance
_LONGEST_PREAMBLE = 500  # lines
_NUMBER = re.compile(r"[-+]?(\d+(\.\d*|,\d+)?|[.,]\d+)([eE][-+]?\d+)?")
_LETTER = re.compile(r"[^\W\d_]|[°%]")
_NO_VALUE = frozenset(("nan", "null", "na", "n/a"))
_NO_NUMBER = _NO_VALUE | {"inf", "-inf", "+inf"}  # stand for one
_RULE = re.compile(r"[\s\-=_+|*~.,;]+")  # a line drawn under a header
_TIME_UNITS = frozenset(["s", "ms", "us", "µs", "μs", "ns", "sec", "secs", "seconds", "min", "h"])
_WORDS_OF_UNITS = frozenset(("g", "G", "mg", "°C", "degC", "dB", "-", "--", "1", "counts", "count", "LSB", "raw"))
STAMP = re.compile(
    r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d(:\d\d([.,]\d+)?)?( ?Z|[+-]\d\d:?\d\d)?)?"  # ISO 8601
    r"|\d{1,2}[./]\d{1,2}[./]\d{2,4}([T ,]+\d{1,2}:\d\d(:\d\d([.,]\d+)?)?)?"
    r"|\d{1,2}:\d\d(:\d\d([.,]\d+)?)?"
)
"""A date, a date with a time, or the time of a clock."""


def open_text(path: Path, width: int | None = None) -> Opened:
    """Return what a text file holds: one table, or its runs.

    width: how many columns it has, where that is known: whether "0,12" is one number or two may not be told else.
    Raises FileError for a file that is absent, empty, binary, or holds no table.
    """
    text = _decoded(path)
    if "***End_of_Header***" in text[:_HEAD_SIZE]:
        return _open_labview(path, text)
    first, _, rest = text.partition("\n")
    forced = re.fullmatch(r"\s*\"?sep=(.)\"?\s*", first)
    if forced:
        text = rest
    lines = text[:_HEAD_SIZE].splitlines(keepends=True)
    layout, refusal = _find_layout(path, lines, forced[1] if forced else None, width)
    if layout is None:
        raise refusal
    body = text[sum(map(len, lines[: layout.start])) :]
    form = f"text, {_WORDS.get(layout.delimiter, repr(layout.delimiter))} between columns" + (
        ", decimal comma" if layout.decimal == "," else ""
    )
    tables = [_parse(path, part, layout) for part in _parts(body, layout)]
    if len(tables) > 1:
        runs = [(f"part {k}", noted(one, "its header is repeated")) for k, one in enumerate(tables, start=1)]
    else:
        runs = split_labels(tables[0], layout.labels)
    return Opened(form, tuple(Run(name, partial(noted, one)) for name, one in runs))


@dataclass(frozen=True)
class _Layout:
    """How a text table is laid out.

    start: index of its first line of numbers. names: of the columns. delimiter, decimal: between cells and in numbers.
    header: the line of the names, which a file of several runs repeats. labels: over the columns, of runs beside one
    another. notes: what was done. named: whether the file names its columns.
    """

    start: int
    names: tuple[str, ...]
    delimiter: str | None
    decimal: str = "."
    header: str = ""
    labels: tuple[str, ...] | None = None
    notes: tuple[str, ...] = ()
    named: bool = True


def _decoded(path: Path) -> str:
    try:
        refuse_beyond_memory(path, _TEXT_GROWS * path.stat().st_size)
        raw = path.read_bytes()
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}") from error
    if not raw.strip():
        raise FileError(f"{path} is empty; expected a header line with column names and rows of numbers below it")
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


def _find_layout(
    path: Path, lines: Sequence[str], forced: str | None, width: int | None
) -> tuple[_Layout | None, FileError]:
    """Return the layout, or None, and what to say where there is none."""
    refusal = FileError(f"{path} holds no table; expected a header line and rows of numbers below it")
    fallback = None
    if forced is None:
        try:
            plain = _plain_layout(path, lines)
        except FileError as error:
            refusal = error
        else:
            if _stands(plain, lines):
                return _with_units(plain, lines), refusal
            fallback = plain
    sought = [_sought_layout(lines, delimiter) for delimiter in ((forced,) if forced else _DELIMITERS)]
    found = [one for one in sought if one is not None]
    if not found:
        return fallback, refusal  # text all through: whoever reads a column says in which row
    best = max(found, key=lambda one: one[0])[1]  # the first of equals
    if forced is None and _may_be_decimals(best, lines):
        if width == 1:
            return next(one for _, one in found if one.delimiter != ","), refusal
        if width is None:
            line = lines[best.start].strip()
            raise FileError(
                f"{path} holds lines as {line!r}, which is one number with a decimal comma or two whole ones; say it "
                "by a name for each column: --columns NAME for one, --columns NAME,NAME for two (columns=)"
            )
    return best, refusal


# A table that begins with its header.


def _plain_layout(path: Path, lines: Sequence[str]) -> _Layout:
    """Return the layout of a table whose first line that is no comment is the header. Raises FileError."""
    start, header = _find_header(path, lines)
    body = [line.rstrip("\r\n") for line in lines[start : start + _SCANNED_LINES] if line.strip()]
    if not body:
        raise FileError(f"{path} has a header but no rows below it; record again or choose another file")
    delimiter = _sniff([header, *body])
    names = tuple(name.strip() for name in _fields(header, delimiter))
    counts = [len(_fields(line, delimiter)) for line in body]
    usual = max(counts, key=counts.count)
    if usual != len(names):
        raise _not_a_table(path, len(names), f"most rows have {usual}")
    return _Layout(start, names, delimiter, _decimal(body, delimiter), header)


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


def _stands(layout: _Layout, lines: Sequence[str]) -> bool:
    """Return whether a header at the top is one: rows of its kind below it, and text over their numbers."""
    if (
        layout.delimiter == "," and layout.names[0].strip('"') == "Record Length"
    ):  # values of a scope beside its samples
        return False
    rows = [_fields(line.rstrip("\r\n"), layout.delimiter) for line in lines[layout.start :][:_SCANNED_LINES]]
    rows = [row for row in rows if any(cell.strip() for cell in row)]
    if not rows:
        return True
    if len(rows) > 1 and _is_rule(rows[0]):
        return False
    below = rows[1:] if _are_units(rows[0]) and len(rows) > 1 else rows
    numeric = _number_columns(below[1:] or below, len(layout.names))
    over = [layout.names[column] for column in numeric]
    if not any(map(_LETTER.search, over)) and any(map(_is_value, over)):
        return False
    first = [[row[column].strip() for column in numeric if column < len(row)] for row in below[:5]]
    sound = sum(1 for row in first if any(row) and all(not cell or _is_value(cell) for cell in row))
    # One bad cell is for whoever reads its column; lines of another kind are no rows.
    return bool(numeric) and 2 * sound >= len(first)


def _with_units(layout: _Layout, lines: Sequence[str]) -> _Layout:
    """Return the layout with the line of units below its header, where there is one, in the names."""
    for index, line in enumerate(lines[layout.start :], start=layout.start):
        cells = _fields(line.rstrip("\r\n"), layout.delimiter)
        if not line.strip():
            continue
        if len(cells) == len(layout.names) and _are_units(cells):
            names = tuple(map(with_unit, layout.names, cells))
            return _Layout(index + 1, names, layout.delimiter, layout.decimal, layout.header, None, layout.notes)
        break
    return layout


def _is_number(text: str) -> bool:
    try:
        float(text.strip().replace(",", "."))
    except ValueError:
        return False
    return True


def _fields(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    try:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error:  # a cell longer than any
        return line.split(delimiter)


def _sniff(lines: Sequence[str]) -> str | None:
    """Return the delimiter that gives most lines the same number (above one) of fields; None means blanks."""
    best, best_score = None, (0, 0)
    for place, delimiter in enumerate(",;\t"):
        counts = [len(_fields(line, delimiter)) for line in lines]
        usual = max(counts, key=counts.count)
        if usual > 1 and counts[0] > 1 and (counts.count(usual), -place) > best_score:
            best, best_score = delimiter, (counts.count(usual), -place)
    return best or next((delimiter for delimiter in ",;\t" if delimiter in lines[0]), None)


# A table that begins somewhere below.

_Score = tuple[float, bool, int]


def _sought_layout(lines: Sequence[str], delimiter: str | None) -> tuple[_Score, _Layout] | None:
    """Return (score, layout) of the rows of numbers that a delimiter shows, None where it shows none.

    Score: share of the cells that are values, whether a header was found, and how many columns hold numbers.
    """
    head = [line.rstrip("\r\n") for line in lines[: _LONGEST_PREAMBLE + _SCANNED_LINES]]
    rows = [[] if _is_comment(line) else _fields(line, delimiter) for line in head]
    found = find_rows(rows)
    if found is None:
        return None
    start, numeric, share = found
    above = [_fields(line.lstrip("#%/ ") if _is_comment(line) else line, delimiter) for line in head[:start]]
    names, labels, notes, at = name_columns(above, rows[start:], numeric)
    header = head[at] if at is not None else ""
    body = [line for line in head[start:] if line.strip()]
    layout = _Layout(start, names, delimiter, _decimal(body, delimiter), header, labels, notes, at is not None)
    return (round(share, 2), at is not None, len(numeric)), layout


def _may_be_decimals(layout: _Layout, lines: Sequence[str]) -> bool:
    """Return whether two nameless columns of whole numbers may be one of numbers with a decimal comma.

    Where the first of them rises in every line it counts, and is no part of a number that swings.
    """
    if layout.named or layout.delimiter != "," or len(layout.names) != 2:
        return False
    near = [line.strip() for line in lines[layout.start :][:_SCANNED_LINES] if not _is_comment(line)]
    held = [line for line in near if line and line.lower() not in _NO_NUMBER]
    if not all(re.fullmatch(r"[-+]?\d+(,\d+)?", line) for line in held):
        return False
    whole = [int(line.partition(",")[0]) for line in held]
    return not all(a < b for a, b in pairwise(whole))


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS)


def _is_value(cell: str) -> bool:
    """Return whether a cell holds a number, with a decimal point or comma, or what stands for one."""
    text = cell.strip()
    return _NUMBER.fullmatch(text) is not None or text.lower() in _NO_NUMBER


def _is_rule(cells: Sequence[str]) -> bool:
    return any(cells) and all(_RULE.fullmatch(cell) for cell in cells if cell)


def _number_columns(rows: Sequence[Sequence[str]], width: int) -> list[int]:
    """Return the columns of which nine cells in ten, of those that are not empty, are numbers."""
    found = []
    for column in range(width):
        held = [row[column] for row in rows if column < len(row) and row[column].strip()]
        if held and sum(map(_is_value, held)) >= _SHARE * len(held):
            found.append(column)
    return found


def find_rows(rows: Sequence[Sequence[str]]) -> tuple[int, list[int], float] | None:
    """Return (index of the first row of numbers, the columns that hold numbers, share of the cells that are values).

    rows: cells of each line, none for a line that is empty or a comment. None where there are no such rows.
    """
    held = [index for index, row in enumerate(rows) if any(cell.strip() for cell in row)]
    for place, index in enumerate(held[:_LONGEST_PREAMBLE]):
        width = len(rows[index])
        if not any(_is_value(cell) for cell in rows[index]):
            continue
        window = [rows[at] for at in held[place : place + _SCANNED_LINES]]
        if len(window) < _FEWEST_ROWS:
            return None
        alike = [row for row in window if len(row) == width]
        if len(alike) < _SHARE * len(window):
            continue
        numeric = _number_columns(alike[1:], width)
        own = [rows[index][column].strip() for column in numeric]
        if not numeric or any(cell and not _is_value(cell) for cell in own) or not any(own):
            continue
        cells = [cell.strip() for row in alike for cell in row if cell.strip()]
        good = sum(1 for cell in cells if _is_value(cell) or STAMP.fullmatch(cell))
        return index, numeric, good / len(cells)
    return None


def name_columns(
    above: Sequence[Sequence[str]], below: Sequence[Sequence[str]], numeric: Sequence[int]
) -> tuple[tuple[str, ...], tuple[str, ...] | None, tuple[str, ...], int | None]:
    """Return (names of the columns, labels of runs over them, notes, index of the header in `above`).

    above: cells of the lines above the rows of numbers, below: those rows; numeric: their columns of numbers.
    Without a header the columns are named by their places, from "1".
    """
    width = len(below[0])
    spare = [column for column in range(width) if not any(row[column].strip() for row in below if column < len(row))]
    at, header = _line_above(above, len(above), width, numeric, spare)
    if at is None:
        beside = _beside(above, below, width)
        if beside is not None:
            return beside, None, (), None
        what = "no header: the columns are named by their places, from 1"
        skipped = sum(1 for row in above if any(cell.strip() for cell in row))
        return tuple(map(str, range(1, width + 1))), None, (*_skipped(skipped), what), None
    upper_at, upper = _line_above(above, at, width, numeric, spare)
    names = header
    if _are_units(header) and upper_at is not None and upper_at >= at - 2:
        names, at = [with_unit(name, unit) for name, unit in zip(upper, header, strict=True)], upper_at
        upper_at, upper = _line_above(above, at, width, numeric, spare)
    labels: tuple[str, ...] | None = None
    if upper_at is not None and upper_at >= at - 2 and len(set(filter(None, upper))) < width:
        filled = _filled(upper)
        if repeats_itself(filled, names):
            labels = tuple(filled)
        else:
            twice = {name for name in names if names.count(name) > 1}
            pairs = zip(filled, names, strict=True)
            names = [f"{label}: {name}" if label and name in twice else name for label, name in pairs]
        top = upper_at
    else:
        top = at
    skipped = sum(1 for row in above[:top] if any(cell.strip() for cell in row))
    return tuple(names if labels else unlike(names)), labels, _skipped(skipped), at


def _skipped(lines: int) -> tuple[str, ...]:
    return (f"{lines} line{'s' if lines > 1 else ''} above the table left out",) if lines else ()


def _line_above(
    above: Sequence[Sequence[str]], before: int, width: int, numeric: Sequence[int], spare: Sequence[int]
) -> tuple[int | None, list[str]]:
    """Return (index, cells) of the nearest line above with as many cells and text over the numbers; None without.

    before: index of the line above which to look. spare: columns without a cell below, which a header may leave out.
    """
    for at in range(before - 1, -1, -1):
        cells = [cell.strip() for cell in above[at]]
        if not any(cells) or _is_rule(cells):
            continue
        if len(cells) < width and all(column in spare for column in range(len(cells), width)):
            cells += [""] * (width - len(cells))
        over = [cells[column] for column in numeric if column < len(cells)]
        if len(cells) == width and any(map(_LETTER.search, over)) and not any(map(_is_value, over)):
            return at, cells
        return None, []
    return None, []


def _beside(above: Sequence[Sequence[str]], below: Sequence[Sequence[str]], width: int) -> tuple[str, ...] | None:
    """Return the names of an oscilloscope's columns whose settings stand beside its first samples, else None."""
    if width < 5 or not below or below[0][0].strip('" ') != "Record Length":
        return None
    told = {row[0].strip('" '): row[1].strip('" ') for row in below if len(row) > 1}
    names = [str(place) for place in range(1, width + 1)]
    names[3] = with_unit("time", told.get("Horizontal Units") or "s")
    names[4] = with_unit(told.get("Source") or "5", told.get("Vertical Units"))
    return tuple(names)


def _are_units(cells: Sequence[str]) -> bool:
    """Return whether a line holds units and nothing else: one of time among them, or all in brackets."""
    texts = [cell.strip() for cell in cells if cell.strip()]
    bare = [text.strip("[]()").strip() for text in texts]
    if not texts or any(_is_value(text) and text != "1" for text in bare):
        return False
    boxed = all(text[0] in "[(" and text[-1] in ")]" for text in texts)
    return (boxed or not _TIME_UNITS.isdisjoint(bare)) and all(map(_is_unit, bare))


def _is_unit(text: str) -> bool:
    if not text or text in _WORDS_OF_UNITS:
        return True
    for spelling in (text, text.lower()):
        try:
            canonical_unit(spelling)
        except UnitError as error:
            if "ambiguous" in str(error) or "does not start at zero" in str(error):
                return True
        else:
            return True
    return False


def _filled(cells: Sequence[str]) -> list[str]:
    """Return labels over columns, merged cells filled from the left."""
    found, last = [], ""
    for cell in cells:
        last = cell or last
        found.append(last)
    return found


def _decimal(lines: Sequence[str], delimiter: str | None) -> str:
    """Return the decimal sign: a comma where some numbers have one and none has a point."""
    if delimiter == ",":
        return "."
    cells = [cell.strip() for line in lines for cell in _fields(line, delimiter)]
    values = [cell for cell in cells if _NUMBER.fullmatch(cell)]
    return "," if any("," in value for value in values) and not any("." in value for value in values) else "."


# From the text of the rows to numbers.


def _parts(body: str, layout: _Layout) -> list[str]:
    """Return the text of each run: a file of several repeats the header, and what stood above it."""
    header = layout.header.strip()
    if not header or header not in body:
        return [body]
    lines = body.splitlines(keepends=True)
    again = [index for index, line in enumerate(lines) if line.strip() == header]
    if not again:
        return [body]
    cells = [_fields(line.rstrip("\r\n"), layout.delimiter) for line in lines]
    parts = []
    for start, stop in pairwise([-1, *again, len(lines)]):
        first, last = start + 1, stop
        while first < last and (_are_units(cells[first]) or _is_rule(cells[first])):
            first += 1
        while (
            stop < len(lines)
            and last > first
            and not (len(cells[last - 1]) == len(layout.names) and any(map(_is_value, cells[last - 1])))
        ):  # what stands above the next header
            last -= 1
        if any(any(row) for row in cells[first:last]):
            parts.append("".join(lines[first:last]))
    return parts or [body]


def _parse(path: Path, text: str, layout: _Layout) -> Table:
    width = len(layout.names)
    options: dict[str, Any] = {"sep": layout.delimiter or r"\s+", "decimal": layout.decimal, "skipinitialspace": True}
    if text.startswith(("\n", "\r\n")) or text.endswith(("\n\n", "\n\r\n")):
        text = text.strip("\r\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            frame = pd.read_csv(
                io.StringIO(text),
                header=None,
                names=range(width),
                index_col=False,
                low_memory=False,
                comment="#",
                skip_blank_lines=False,
                **options,
            )
        except (pd.errors.ParserError, pd.errors.ParserWarning, pd.errors.EmptyDataError, ValueError) as error:
            reason = " ".join(str(error).split()).removeprefix("Error tokenizing data. C error: ")
            raise _not_a_table(path, width, reason) from error
    frame.columns = pd.Index(layout.names)
    if not layout.named:
        frame.attrs["named"] = False
    frame = _held_rows(frame)
    nameless = np.array([not name or (not layout.named and name.isdecimal()) for name in layout.names])
    empty = nameless & frame.isna().all().to_numpy()
    return noted(frame.loc[:, ~empty], *layout.notes)


def _held_rows(frame: Table) -> Table:
    """Return a table without its rows that hold nothing. The others keep their numbers, by which samples are counted.

    Where no two rows stand next to one another, the empty lines are no samples but spacing.
    """
    held = frame.notna().any(axis=1).to_numpy()
    if held.all() or not held.any():
        return frame[held]
    kept, empty = frame[held], int((~held[: np.flatnonzero(held)[-1]]).sum())
    if len(kept) > 1 and not (held[1:] & held[:-1]).any():
        return kept.reset_index(drop=True)
    return noted(kept, f"{empty} row{'s' if empty > 1 else ''} without a value left out") if empty else kept


def _not_a_table(path: Path, width: int, reason: str) -> FileError:
    return FileError(
        f"{path} is not a table of {width} columns as its header says ({reason}); "
        "the first line must name the columns, and lines above it must start with #"
    )


def table_of_cells(rows: Sequence[Sequence[str]], source: str) -> list[tuple[str, Table]]:
    """Return (label, table) of each run in a sheet of cells, found as in a text. Raises FileError where there is none.

    rows: cells as text, as many in each row. source: of what, for the sentence.
    """
    found = find_rows(rows)
    if found is None:
        raise FileError(
            f"{source} holds no table; expected a header and at least {_FEWEST_ROWS} rows of numbers below it"
        )
    start, numeric, _ = found
    names, labels, notes, _ = name_columns(rows[:start], rows[start:], numeric)
    frame = pd.DataFrame(
        [[None if cell.lower() in _NO_VALUE else cell or None for cell in row] for row in rows[start:]]
    )
    for column in frame.columns:
        values = pd.to_numeric(frame[column], errors="coerce")
        if values.notna().sum() == frame[column].notna().sum():
            frame[column] = values
    frame.columns = pd.Index(names)
    filled = frame.notna().any().to_numpy()
    labels = None if labels is None else tuple(np.array(labels)[filled])
    return split_labels(noted(_held_rows(frame.loc[:, filled]), *notes), labels)


# LabVIEW's own text files: a header of keys and values, then one for each segment.


def _open_labview(path: Path, text: str) -> Opened:
    head, *parts = text.split("***End_of_Header***")
    keys = _labview_keys(head, "\t" if "Separator\tComma" not in head else ",")
    delimiter = "," if keys.get("Separator", ["Tab"])[0] == "Comma" else "\t"
    keys = _labview_keys(head, delimiter)
    decimal = keys.get("Decimal_Separator", ["."])[0] or "."
    runs: list[tuple[str, Table]] = []
    if len(parts) == 1:  # one header for file and segment
        parts = [head, *parts]
    about = _labview_keys(parts[0], delimiter)
    for part in parts[1:]:
        lines = part.splitlines()
        ends = next((k for k, line in enumerate(lines) if line.startswith(f"Channels{delimiter}")), len(lines))
        held = [k for k, line in enumerate(lines[:ends]) if line.strip()]  # empty lines between them are samples too
        if len(held) > 1:
            rows = lines[held[0] : held[-1] + 1]
            runs.append((f"part {len(runs) + 1}", _labview_table(path, rows, about, delimiter, decimal)))
        about = _labview_keys("\n".join(lines[ends:]), delimiter)
    if not runs:
        raise FileError(f"{path} is a LabVIEW file with no rows below its header; record again or choose another file")
    form = "LabVIEW measurement (.lvm)" + (", decimal comma" if decimal == "," else "")
    return Opened(form, tuple(Run(name if len(runs) > 1 else "", partial(noted, one)) for name, one in runs))


def _labview_keys(text: str, delimiter: str) -> dict[str, list[str]]:
    rows = [line.rstrip("\r\n").split(delimiter) for line in text.splitlines() if line.strip()]
    return {row[0].strip(): [cell.strip() for cell in row[1:]] for row in rows}


def _labview_table(
    path: Path, lines: Sequence[str], about: dict[str, list[str]], delimiter: str, decimal: str
) -> Table:
    """Return one segment as a table: its comments left out, units in the names, empty times made from their step."""

    def stated(key: str, default: float) -> float:
        try:
            return float(about[key][0].replace(",", "."))
        except (KeyError, IndexError, ValueError):
            return default

    header = [name.strip() for name in lines[0].rstrip("\r\n").split(delimiter)]
    units, channels = about.get("Y_Unit_Label", []), [name for name in header if name not in ("X_Value", "Comment")]
    of = dict(zip(channels, units, strict=False))
    names = unlike(["X_Value [s]" if name == "X_Value" else with_unit(name, of.get(name)) for name in header])
    layout = _Layout(0, tuple(names), delimiter, decimal)
    frame = _parse(path, "\n".join(lines[1:]) + "\n", layout)
    frame = frame.loc[:, [name for name in frame.columns if not str(name).startswith("Comment")]]
    empty = [name for name in frame.columns if is_time_name(bare_name(str(name))) and frame[name].isna().all()]
    frame = frame.drop(columns=empty)
    step = stated("Delta_X", 0.0)
    if (empty or not any(is_time_name(str(name)) for name in frame.columns)) and step > 0:
        return with_time(frame, step, stated("X0", 0.0))
    return frame
