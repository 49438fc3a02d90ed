"""Which rows of a text are numbers: its separator, its decimal mark, where its table begins and what its columns are.

Separators, decimal marks, marks between thousands and widths compete: the one wins with which most rows have numbers
in all columns that hold numbers in most rows. Data begin where four rows in a row are good. The nearest line above
that fits names the columns; a line of units between them goes into the names, a second header above it too where the
names need it. Lines that are no rows of numbers are left out, with a note.
"""

import csv
import io
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd  # type: ignore[import-untyped,unused-ignore]

from sinew.measure.arrays import Mask
from sinew.measure.errors import FileError, RecordingError
from sinew.measure.files.names import (
    Table,
    are_units,
    repeats_itself,
    split_labels,
    stated_step,
    time_columns,
    unlike,
    with_unit,
)
from sinew.measure.validation import refuse_beyond_memory

MADE_TIME = "time [s]"
"""Name of the column of times that is made where a file states a rate or a step and holds no time."""

_WORDS = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", None: "blanks"}
_MARKS = ((".", ""), (",", ""), (",", "."), (".", ","))
"""Decimal mark, and what parts thousands: what needs none goes first."""
_COMMENTS = ("#", "%", "//")
_TEXT_GROWS = 4  # bytes, text and numbers are in memory together
_PROBED = 200  # lines from the top, and as many from all of it
_ROWS_AT_THE_TOP, _LONGEST_PREAMBLE = 4, 500  # lines
_LETTER = re.compile(r"[^\W\d_]|[°%]")
_RULE = re.compile(r"[\s\-=_+|*~.,;]+")  # a line drawn under a header
_NO_NUMBER = frozenset(("nan", "null", "na", "n/a", "inf", "-inf", "+inf"))  # stand for one
STAMP = re.compile(
    r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d(:\d\d([.,]\d+)?)?( ?Z|[+-]\d\d:?\d\d)?)?"  # ISO 8601
    r"|\d{1,2}[./]\d{1,2}[./]\d{2,4}([T ,]+\d{1,2}:\d\d(:\d\d([.,]\d+)?)?)?"
    r"|\d{1,2}:\d\d(:\d\d([.,]\d+)?)?"
)
"""A date, a date with a time, or the time of a clock."""


@dataclass(frozen=True)
class Run:
    """One run in a file. name: as the file has it. table: with `notes_of` what was done to it."""

    name: str
    table: Table


@dataclass(frozen=True)
class Opened:
    """What a file holds. form: its format in words. runs: at least one, in the order of the file."""

    form: str
    runs: tuple[Run, ...]


def notes_of(table: Table) -> tuple[str, ...]:
    """Return the sentences on what was done to read a table."""
    return tuple(table.attrs.get("notes", ()))


def noted(table: Table, *notes: str) -> Table:
    """Return the table with sentences added on what was done to it."""
    fresh = table.copy(deep=False)
    fresh.attrs = {**table.attrs, "notes": (*notes_of(table), *notes)}
    return fresh


def with_time(table: Table, step_s: float, start_s: float = 0.0) -> Table:
    """Return a table with a column of times before the others, of even steps as the file states them [s].

    Its index counts the samples, of those too that were left out.
    """
    made = pd.Series(start_s + step_s * table.index.to_numpy(), index=table.index, name=MADE_TIME)
    whole = pd.concat([made, table], axis=1)
    whole.attrs = dict(table.attrs)
    return noted(whole, f"time made from the step of {step_s:.6g} s that the file states")


def open_text(path: Path, width: int | None = None) -> Opened:
    """Return what a text file holds: one table, or its runs.

    width: how many columns it has, where that is known: whether "0,12" is one number or two may not be clear else.
    Raises FileError for a file that is empty, binary, or holds no table.
    """
    text = _decoded(path)
    form, runs = read_text(str(path), text, width)
    if text.startswith("LabVIEW Measurement"):
        form = form.replace("text", "LabVIEW measurement (.lvm)")
    return Opened(form, tuple(Run(name, table) for name, table in runs))


def read_text(
    source: str, text: str, width: int | None = None, separator: str | None = None
) -> tuple[str, list[tuple[str, Table]]]:
    """Return (the dialect in words, (name, table) of each run) of a text. source: of what, for the sentences.

    width: of the table, where it is known; separator: likewise. Raises FileError where there is no table.
    """
    lines = text.splitlines()
    forced = re.fullmatch(r"\s*\"?sep=(.)\"?\s*", lines[0]) if lines else None
    lines = lines[1:] if forced else lines
    spoken = _compete(source, lines, forced[1] if forced else separator, width)
    start = spoken.start(lines)
    layout = _named(source, spoken, lines, start)
    below = [line for line in lines[start : start + _PROBED] if line.strip()]
    good = sum(map(spoken.is_row, below))
    if 2 * good < len(below) or (not layout.header and good < _ROWS_AT_THE_TOP):
        raise _no_table(source)
    header = layout.header.strip()
    again = [k for k in range(start, len(lines)) if lines[k].strip() == header] if header and header in text else []
    tables, between, own = [], list[str](), layout
    for first, last in pairwise([start - 1, *again, len(lines)]):
        part = lines[first + 1 : last]
        if any(sum(map(bool, spoken.cells(line))) > 1 for line in between):  # a segment with facts of its own
            top = [*lines[: lines.index(layout.header)], *between, lines[first]]
            top += takewhile(lambda line: not spoken.is_row(line), part)
            own = replace(_named(source, spoken, [*top, *part], len(top)), notes=layout.notes)
        while last < len(lines) and part and not spoken.is_row(part[-1], lines[start]):  # it is above the next header
            part.pop()
        between = lines[first + 1 + len(part) : last]
        if any(map(spoken.is_row, part)):
            tables.append(_parsed(source, part, spoken, own))
    if len(tables) > 1:
        runs = [(f"part {k}", noted(one, "its header is repeated")) for k, one in enumerate(tables, start=1)]
    else:
        runs = split_labels(tables[0], layout.labels)
    words = f"text, {_WORDS.get(spoken.separator, repr(spoken.separator))} between columns"
    return words + (", decimal comma" if spoken.decimal == "," else ""), runs


def _decoded(path: Path) -> str:
    try:
        refuse_beyond_memory(path, _TEXT_GROWS * path.stat().st_size)
        raw = path.read_bytes()
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}") from error
    encodings = ("utf-16",) if raw.startswith((b"\xff\xfe", b"\xfe\xff")) else ("utf-8-sig", "cp1252")
    for encoding in encodings:
        try:
            text = raw.decode(encoding)
        except UnicodeDecodeError:
            continue
        if not any(chr(code) in text for code in range(32) if chr(code) not in "\t\n\r\f"):
            return text
    raise FileError(f"{path} is not a text table (it holds binary data); expected CSV with a header line")


def _no_table(source: str) -> FileError:
    return FileError(
        f"{source} holds no table; expected a line with the names of the columns and rows of numbers below it"
    )


# The dialect.


def _fields(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    if '"' in line:
        try:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]
        except csv.Error:  # a cell longer than any
            pass
    return [cell.strip() for cell in line.split(separator)]


@dataclass(frozen=True)
class _Dialect:
    """How numbers are written. separator: None for blanks. width: cells in a row. solid: columns of numbers."""

    separator: str | None
    decimal: str
    thousands: str
    width: int
    solid: tuple[int, ...]
    empty: frozenset[int]

    def cells(self, line: str) -> list[str]:
        """Return the cells of a line, as many as a row has or one more."""
        cells = _fields(line, self.separator)
        return cells + [""] * (self.width - len(cells))

    def plain(self, cell: Any) -> Any:
        """Return a number as text with a decimal point and no other mark; anything else as it is."""
        if isinstance(cell, str) and _PATTERNS[self.decimal, self.thousands].fullmatch(cell.strip()):
            return cell.replace(self.thousands, "").replace(self.decimal, ".")
        return cell

    def is_row(self, line: str, like: str = "") -> bool:
        """Return whether a line is a row of numbers: one at least, and no text in a column of numbers.

        like: a sure row; nor anything in a column that is empty elsewhere, or a word in front where that has none.
        """
        cells = [] if _is_comment(line) else self.cells(line)
        if not any(cells) or abs(len(_fields(line, self.separator)) - self.width) > 1:
            return False
        own = [cells[k] for k in self.solid if cells[k]]
        worded = 0 not in self.solid and _LETTER.match(line) and not _LETTER.match(like)
        free = not like or not (worded or any(cells[k] for k in self.empty))
        return bool(own) and free and all(is_value(cell, self.decimal, self.thousands) for cell in own)

    def start(self, lines: Sequence[str]) -> int:
        """Return the first line of numbers: four of them follow one another, or all that there are."""
        filled = [k for k, line in enumerate(lines) if line.strip() and not _is_comment(line)]
        good = [self.is_row(lines[k]) for k in filled[: _LONGEST_PREAMBLE + _ROWS_AT_THE_TOP]]
        alike = [k for k, one in enumerate(good) if one and all(good[k : k + _ROWS_AT_THE_TOP])]
        first = alike[0] if alike else good.index(True) if True in good else 0
        while first > 1 and good[first - 2] and len(self.cells(lines[filled[first - 1]])) == self.width:
            first -= 2  # one bad row near the top
        return filled[first]


def _pattern(decimal: str, thousands: str) -> re.Pattern[str]:
    mark, behind = re.escape(decimal), r"\d*" if decimal == "." else r"\d+"
    grouped = rf"\d{{1,3}}({re.escape(thousands)}\d{{3}})+|" if thousands else ""
    return re.compile(rf"[-+]?(({grouped}\d+)({mark}{behind})?|{mark}\d+)([eE][-+]?\d+)?")


_PATTERNS = {marks: _pattern(*marks) for marks in _MARKS}


def is_value(cell: str, decimal: str = ".", thousands: str = "") -> bool:
    """Return whether a cell holds a number, a date or time, or what stands for a number."""
    if _PATTERNS[decimal, thousands].fullmatch(cell):
        return True
    return cell.lower() in _NO_NUMBER or STAMP.fullmatch(cell) is not None


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS)


def _compete(source: str, lines: Sequence[str], forced: str | None, width: int | None) -> _Dialect:
    """Return the dialect with which most rows hold numbers in all columns of numbers. Raises FileError without one."""
    probed = {*range(min(len(lines), _PROBED)), *map(int, np.linspace(0, len(lines) - 1, _PROBED))} if lines else set()
    near = [lines[k] for k in sorted(probed) if lines[k].strip() and not _is_comment(lines[k])]
    rivals = [
        rival
        for separator in ([forced] if forced else _WORDS)
        for rival in _rivals([_fields(line, separator) for line in near], separator)
    ]
    if not rivals:
        raise _no_table(source)
    _, best = max(rivals, key=lambda rival: rival[0])  # the first of equals
    if not forced and best.separator == "," and best.width == 2 and _may_be_decimals(near, best):
        single = next((one for _, one in rivals if one.width == 1 and one.decimal == ","), best)
        if width is None:
            line = next(line.strip() for line in near if best.is_row(line))
            raise FileError(
                f"{source} holds lines as {line!r}, which is one number with a decimal comma or two whole ones; say it "
                "by a name for each column: --columns NAME for one, --columns NAME,NAME for two (columns=)"
            )
        return single if width == 1 else best
    return best


_Score = tuple[float, int, int]


def _rivals(cells: Sequence[Sequence[str]], separator: str | None) -> list[tuple[_Score, _Dialect]]:
    """Return (score, dialect) for every width of rows and every pair of marks, with one separator.

    Score: rows that are good, times the share of their cells that are values, twice for two columns or more; how many
    columns hold numbers; and no thousands mark where none is needed.
    """
    found = []
    for width in sorted({len(row) for row in cells}, reverse=True):
        rows = [row for row in cells if len(row) == width]
        held = np.array([[bool(cell) for cell in row] for row in rows])
        if not held.any():
            continue
        signs = set("".join("".join(row) for row in rows))
        for decimal, thousands in _MARKS:
            needless = (decimal == "," or bool(thousands)) and not {decimal, *thousands} & {",", thousands} <= signs
            if needless or separator in (decimal, thousands):
                continue
            values = np.array([[is_value(cell, decimal, thousands) for cell in row] for row in rows])
            share = values.sum(axis=0) / np.maximum(held.sum(axis=0), 1)
            solid = share > 0.6 * share.max()
            if not solid.any():
                continue
            good = (values | ~held)[:, solid].all(axis=1) & values[:, solid].any(axis=1)
            if not good.any():
                continue
            filled = float(values[good].sum() / held[good].sum())
            if good.sum() < _ROWS_AT_THE_TOP and filled < 0.5:  # numbers in a sentence
                continue
            score = (round(good.sum() * filled * min(int(solid.sum()), 2), 3), int(solid.sum()), -len(thousands))
            columns = tuple(map(int, np.flatnonzero(solid)))
            empty = frozenset(map(int, np.flatnonzero(~held[good].any(axis=0))))
            found.append((score, _Dialect(separator, decimal, thousands, width, columns, empty)))
    return found


def _may_be_decimals(lines: Sequence[str], best: _Dialect) -> bool:
    """Return whether two nameless columns of whole numbers may be one of numbers with a decimal comma.

    Where the first of them rises in every line it counts, and is no part of a number that swings.
    """
    held = [line.strip() for line in lines if line.strip().lower() not in _NO_NUMBER]
    if not all(re.fullmatch(r"[-+]?\d+(,\d+)?", line) for line in held):
        return False
    whole = [int(line.partition(",")[0]) for line in held]
    return not all(a < b for a, b in pairwise(whole))


# What the columns are called, and what else stands above them.


@dataclass(frozen=True)
class _Layout:
    """names: of the columns. header: the line of them, which a file of several runs repeats. labels: over the columns,
    of runs beside one another. step_s, start_s: of the samples, where they are stated. notes: what was done."""

    names: tuple[str, ...]
    header: str = ""
    labels: tuple[str, ...] | None = None
    step_s: float | None = None
    start_s: float = 0.0
    notes: tuple[str, ...] = ()


def _named(source: str, spoken: _Dialect, lines: Sequence[str], start: int) -> _Layout:
    """Return the names of the columns, by their places from "1" without a header, and what the lines above state."""
    held = [k for k in range(start) if lines[k].strip()]
    above = [spoken.cells(lines[k].lstrip("#%/ ") if _is_comment(lines[k]) else lines[k]) for k in held]
    facts = {cells[0].rstrip(": "): [c for c in cells[1:] if c] for cells in above if sum(map(bool, cells)) > 1}
    if (over := facts.get("X_Dimension", ["Time"])[0].lower()) != "time":
        raise RecordingError(f"{source} says X_Dimension {over}: it is no record over time")
    step = next((s for name, cells in facts.items() if (s := _stated(spoken, name, cells)) is not None), None)
    begin = facts.get("X0", ["0"])[0].replace(spoken.decimal, ".")
    rows = [spoken.cells(line) for line in lines[start : start + _PROBED]]
    at, names = _line_above(above, len(above), spoken)
    if at is None:
        beside = _scope_names(rows, spoken.width)
        notes = () if beside else (*_skipped(len(above)), "no header: the columns are named by their places, from 1")
        return _Layout(beside or tuple(map(str, range(1, spoken.width + 1))), step_s=step, notes=notes)
    upper_at, upper = _line_above(above, at, spoken)
    alike = len(set(names)) < len(names) and len(set(upper)) == len(upper)
    if upper_at is not None and (are_units(names) or alike):
        names, at = [with_unit(name, unit) for name, unit in zip(upper, names, strict=True)], upper_at
        upper_at, upper = _line_above(above, at, spoken)
    header, labels = lines[held[at]], None
    if "Y_Unit_Label" in facts and names[0] == "X_Value":
        units = ["s", *facts["Y_Unit_Label"], *[""] * len(names)]
        names = [with_unit(name, unit) for name, unit in zip(names, units, strict=False)]
    elif upper_at is not None and len(set(filter(None, upper))) < spoken.width:
        at, filled = upper_at, [next(filter(None, upper[k::-1]), "") for k in range(len(upper))]  # merged cells
        if repeats_itself(filled, names):
            labels = tuple(filled)
        else:
            twice = {name for name in names if names.count(name) > 1}
            pairs = zip(filled, names, strict=True)
            names = [f"{label}: {name}" if label and name in twice else name for label, name in pairs]
    start_s = float(begin) if is_value(begin) else 0.0
    names = [name or (str(k + 1) if k in spoken.solid else "") for k, name in enumerate(names)]
    notes, fresh = _skipped(at), list(names) if labels else unlike(list(names))
    if fresh != list(names):
        notes = (*notes, f"columns of one name are numbered: {', '.join(n for n in fresh if n not in names)}")
    return _Layout(tuple(fresh), header, labels, step, start_s, notes)


def _stated(spoken: _Dialect, name: str, cells: Sequence[str]) -> float | None:
    """Return the step [s] that a line above states, its unit in the name, behind the number, or in the next cell."""
    first, _, unit = " ".join(cells[:2]).replace(spoken.decimal, ".").partition(" ")
    unit = unit if _LETTER.match(unit) else ""
    return stated_step(name, float(first), unit) if _PATTERNS[".", ""].fullmatch(first) else None


def _skipped(lines: int) -> tuple[str, ...]:
    return (f"{lines} line{'s' if lines > 1 else ''} above the table left out",) if lines else ()


def _line_above(above: Sequence[Sequence[str]], before: int, spoken: _Dialect) -> tuple[int | None, list[str]]:
    """Return (index, cells) of the nearest line above with as many cells and text over the numbers; None without.

    before: index of the line above which to look.
    """
    for at in range(before - 1, -1, -1):
        cells = list(above[at])
        if all(_RULE.fullmatch(cell) for cell in cells if cell):
            continue
        if len(cells) == spoken.width + 1 and spoken.separator:  # the name of a last column that is empty, or a blank
            cells = cells[:-1]
        over = [cells[k] for k in spoken.solid]
        named = any(map(_LETTER.search, over)) and not any(is_value(cell, spoken.decimal) for cell in over)
        enough = len([cell for cell in cells if cell]) > 1 or bool(over[-1])
        return (at, cells) if len(cells) == spoken.width and named and enough else (None, [])
    return None, []


def _scope_names(rows: Sequence[Sequence[str]], width: int) -> tuple[str, ...]:
    """Return the names of an oscilloscope's columns whose settings stand beside its first samples, else none."""
    if width < 5 or rows[0][0] != "Record Length":
        return ()
    facts = {row[0]: row[1] for row in rows}
    names = list(map(str, range(1, width + 1)))
    names[3] = with_unit("time", facts.get("Horizontal Units") or "s")
    names[4] = with_unit(facts.get("Source") or "5", facts.get("Vertical Units"))
    return tuple(names)


# From the text of the rows to numbers.


def _parsed(source: str, lines: list[str], spoken: _Dialect, layout: _Layout) -> Table:
    """Return the rows as a table; lines that are none are left out, with a note of the first."""
    while lines and not lines[-1].strip():
        lines.pop()
    widest = spoken.width
    options: dict[str, Any] = {"sep": spoken.separator or r"\s+", "decimal": spoken.decimal, "skipinitialspace": True}
    if spoken.thousands:
        options["thousands"] = spoken.thousands
    for attempt in range(2):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                frame = pd.read_csv(
                    io.StringIO("\n".join(lines) + "\n"),
                    header=None,
                    names=range(widest),
                    index_col=False,
                    low_memory=False,
                    comment="#",
                    skip_blank_lines=False,
                    **options,
                )
                break
            except (pd.errors.ParserError, pd.errors.ParserWarning, pd.errors.EmptyDataError, ValueError) as error:
                reason = " ".join(str(error).split()).removeprefix("Error tokenizing data. C error: ")
                widest = max(len(_fields(line, spoken.separator)) for line in lines)
                if attempt or widest > 2 * spoken.width + 8:
                    raise FileError(f"{source} is not a table of {spoken.width} columns ({reason})") from error
    for column in spoken.solid:
        if frame[column].dtype.kind not in "fiub":  # a word among numbers, which come as they are written then
            frame[column] = frame[column].map(spoken.plain)
    extra = pd.to_numeric(frame.iloc[:, spoken.width :].stack(), errors="coerce").dropna().index.get_level_values(0)
    words = {column: _texts(frame[column]) for column in (*spoken.solid, *spoken.empty)}
    some = np.any([frame[column].notna().to_numpy() & ~words[column] for column in spoken.solid], axis=0)
    bad = (np.any(list(words.values()), axis=0) & ~some) | frame.index.isin(extra)
    notes = list(layout.notes)
    if bad.any():
        first = int(np.argmax(bad))
        shown = f": {lines[first].strip()[:60]!r}" if len(frame) == len(lines) else ""
        s = "s" if bad.sum() > 1 else ""
        notes.append(f"{bad.sum()} line{s} of no numbers left out, the first is data row {first + 1}{shown}")
        frame[bad] = np.nan
        frame = frame.infer_objects()
        for column in spoken.solid:
            if (values := pd.to_numeric(frame[column], errors="coerce")).count() == frame[column].count():
                frame[column] = values
    frame = frame.iloc[:, : spoken.width].set_axis(pd.Index(layout.names), axis=1)
    nothing = frame.isna().all().to_numpy()
    nameless = np.array([not name or name.isdecimal() for name in layout.names])
    frame = _held_rows(noted(frame, *notes))
    spare = nothing & (nameless | np.array([name in ("Comment", "X_Value", "X_Value [s]") for name in layout.names]))
    frame = frame.loc[:, ~spare]
    if layout.step_s is not None and not time_columns(frame):
        frame = with_time(frame, layout.step_s, layout.start_s)
    return frame


def _texts(column: "pd.Series") -> Mask:
    """Return which cells hold text that is no number and no stamp."""
    if column.dtype.kind in "fiub":
        return np.zeros(len(column), dtype=bool)
    odd = (column.notna() & pd.to_numeric(column, errors="coerce").isna()).to_numpy(copy=True)
    odd[odd] = [not is_value(str(cell).strip()) for cell in column[odd]]
    return np.asarray(odd)


def _held_rows(frame: Table) -> Table:
    """Return a table without its rows that hold nothing. The others keep their numbers, by which samples are counted.

    Where no two rows stand next to one another, the empty lines are no samples but spacing.
    """
    held = frame.notna().any(axis=1).to_numpy()
    if held.all() or not held.any():
        return frame[held]
    rest, empty = frame[held], int((~held[: np.flatnonzero(held)[-1]]).sum())
    if len(rest) > 1 and not (held[1:] & held[:-1]).any():
        return rest.reset_index(drop=True)
    return noted(rest, f"{empty} row{'s' if empty > 1 else ''} without a value left out") if empty else rest
