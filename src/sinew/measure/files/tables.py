r"""Tables of results for papers and spreadsheets: LaTeX with uncertainties as siunitx takes them, and CSV.

What is written comes from a result's document, as `--json` prints it: every list of rows in it is a table, and every
group of quantities one of two columns. The unit is in the name (`resonance_hz`), a quantity with an uncertainty is
`{"value", "std", "interval90"}`. In LaTeX a number is `3.021(20)` in a column `S` of siunitx, its digits by the
uncertainty; CSV keeps every digit, with the standard deviation and the ends of the 90 % interval in columns beside it.
"""

import csv
import io
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sinew.measure.errors import SpecError
from sinew.measure.estimate import UNKNOWN, number, parenthesised
from sinew.measure.units import named_unit
from sinew.measure.validation import as_path, write_text

FORMATS = {"latex": ".tex", "csv": ".csv"}

_SPECIAL = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"} | {
    sign: f"\\{sign}" for sign in "&%$#_{}"
}
_MATHS = {
    "λ": r"\lambda", "ω": r"\omega", "τ": r"\tau", "π": r"\pi", "φ": r"\varphi", "θ": r"\theta", "Ω": r"\Omega",
    "β": r"\beta", "δ": r"\delta", "σ": r"\sigma", "√": r"\surd", "−": "-", "≈": r"\approx", "⟨": r"\langle",
    "⟩": r"\rangle", "·": r"\cdot", "±": r"\pm", "×": r"\times", "°": r"{}^\circ", "²": "^2", "³": "^3",
    "½": r"\frac12",
}  # fmt: skip
"""What texts of results have beyond plain letters, so that any LaTeX takes it."""
_SPECIAL |= {sign: f"${macro}$" for sign, macro in _MATHS.items()}
_SPECIAL |= {"“": "``", "”": "''", "’": "'", "–": "--"}
_NUMBER = re.compile(
    r"(?P<sign>-?)(?P<whole>\d+)\.?(?P<part>\d*)(?:\((?P<last>\d+)\))?(?:e(?P<below>-?)(?P<power>\d+))?"
)
_PAGE_WIDTH = 70
"""Characters that a line of a paper takes, roughly."""
_PAGE_ROWS = 40
_HEADING_WIDTH, _LINE_WIDTH = 12, 30
"""Characters of a heading and of a text before their line is broken."""


class Rows(NamedTuple):
    """One table of a document. name: of its part, as `energy_pretensions`; columns: in the order of the rows; rows: a
    cell for each column, a number, a text, a truth, None, or a quantity with its uncertainty."""

    name: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]


def is_quantity(cell: Any) -> bool:
    """Return whether a part of a document is a quantity with an uncertainty."""
    return isinstance(cell, Mapping) and {"value", "std"} <= cell.keys()


def tables_of(document: Mapping[str, Any], parts: Sequence[str] = (), columns: Sequence[str] = ()) -> list[Rows]:
    """Return the tables of a result's document, all or those that are named, with all columns or those that are named.

    columns: in the order in which a table is to have them; a table that has none of them is left out. Raises SpecError
    where there are no tables, or not the ones or the columns that are named.
    """
    found = list(_found("", document))
    names = [one.name for one in found]
    if not found:
        raise SpecError("found no table in this document, expected rows or quantities as a result's --json has them")
    for part in parts:
        if part not in names:
            raise SpecError(f"found no part {part!r}, expected one of {', '.join(names)}")
    chosen = [one for one in found if not parts or one.name in parts]
    if not columns:
        return chosen
    known = list(dict.fromkeys(column for one in chosen for column in one.columns))
    for column in columns:
        if column not in known:
            raise SpecError(f"found no column {column!r}, expected some of {', '.join(known)}")
    narrowed = [_narrowed(one, [column for column in columns if column in one.columns]) for one in chosen]
    return [one for one in narrowed if one.columns]


def _narrowed(table: Rows, columns: Sequence[str]) -> Rows:
    places = [table.columns.index(column) for column in columns]
    return Rows(table.name, tuple(columns), tuple(tuple(row[i] for i in places) for row in table.rows))


def _found(name: str, part: Mapping[str, Any]) -> Iterator[Rows]:
    quantities = {key: cell for key, cell in part.items() if is_quantity(cell)}
    if quantities:
        yield Rows(name or "quantities", ("quantity", "value"), tuple(quantities.items()))
    for key, cell in part.items():
        path = f"{name}_{key}" if name else str(key)
        if isinstance(cell, Mapping) and not is_quantity(cell):
            yield from _found(path, cell)
        elif isinstance(cell, list) and cell and all(isinstance(row, Mapping) for row in cell):
            yield from _of_rows(path, cell)


def _of_rows(name: str, cell: Sequence[Mapping[str, Any]]) -> Iterator[Rows]:
    """Yield the table of a list of rows, and one for each list of rows inside them, which begins with their first cell.

    A group inside a row, as `peak`, makes columns, `peak_frequency_hz`.
    """
    rows = [_joined(_flat(row)) for row in cell]
    columns = tuple(dict.fromkeys(k for row in rows for k in row))
    if columns:
        yield Rows(name, columns, tuple(tuple(row.get(k) for k in columns) for row in rows))
    inside: dict[str, list[dict[str, Any]]] = {}
    for row in cell:
        first = dict(list(row.items())[:1])
        for key, part in row.items():
            if isinstance(part, list) and part and all(isinstance(one, Mapping) for one in part):
                inside.setdefault(f"{name}_{key}", []).extend(first | dict(one) for one in part)
    for path, found in inside.items():
        yield from _of_rows(path, found)


def _flat(row: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return the cells of a row, those of its groups under their names; without lists."""
    flat: dict[str, Any] = {}
    for name, cell in row.items():
        if isinstance(cell, Mapping) and not is_quantity(cell):
            flat |= _flat(cell, f"{before}{name}_")
        elif not isinstance(cell, list):
            flat[f"{before}{name}"] = cell
    return flat


def _joined(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row in which a number and the standard deviation beside it, `gain` and `gain_std`, are one quantity."""
    beside = {name for name in row if f"{name}_std" in row}
    return {
        name: {"value": cell, "std": row[f"{name}_std"]} if name in beside else cell
        for name, cell in row.items()
        if name.removesuffix("_std") not in beside or name in beside
    }


def csv_table(table: Rows) -> str:
    """Return a table as CSV: a quantity has its value, then `_std`, `_low90` and `_high90` of it."""
    wide = [i for i in range(len(table.columns)) if any(is_quantity(row[i]) for row in table.rows)]
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    head: list[str] = []
    for i, column in enumerate(table.columns):
        head += [column, *(f"{column}_{end}" for end in ("std", "low90", "high90"))] if i in wide else [column]
    out.writerow(head)
    for row in table.rows:
        cells: list[Any] = []
        for i, cell in enumerate(row):
            cells += _in_columns(cell) if i in wide else [_plain(cell)]
        out.writerow(cells)
    return text.getvalue()


def _in_columns(cell: Any) -> list[Any]:
    if not is_quantity(cell):
        return [_plain(cell), "", "", ""]
    low, high = cell.get("interval90") or (None, None)
    return [_plain(one) for one in (cell["value"], cell["std"], low, high)]


def _plain(cell: Any) -> Any:
    return "" if cell is None else repr(cell) if isinstance(cell, float) else cell


def latex_table(table: Rows) -> str:
    r"""Return a table for LaTeX with booktabs and siunitx: numbers in columns `S`, with an uncertainty as 3.021(20).

    A table that is longer than a page breaks, by longtable.
    """
    in_names = table.columns == ("quantity", "value")
    heads = [_stacked(column) for column in table.columns]
    rows = [[_heading(row[0]) if in_names else _cell(row[0]), *map(_cell, row[1:])] for row in table.rows]
    cells = list(zip(*rows, strict=True))
    kinds = ["l" if in_names and not i else _alignment(column) for i, column in enumerate(cells)]
    for i, kind in enumerate(kinds):
        if kind.startswith("S"):
            heads[i] = f"{{{heads[i]}}}"
            for row in rows:
                row[i] = row[i] if _NUMBER.fullmatch(row[i]) else f"{{{row[i]}}}"
    caption = f"\\caption{{{_escaped(_words(table.name))}}}"
    label = f"\\label{{tab:{re.sub(r'[^A-Za-z0-9]+', '-', table.name)}}}"
    head = [r"    \toprule", f"    {' & '.join(heads)} \\\\", r"    \midrule"]
    body = [f"    {' & '.join(row)} \\\\" for row in rows]
    aligned = f"{{{' '.join(kinds)}}}"
    if len(rows) > _PAGE_ROWS:
        above = [f"\\begin{{longtable}}{aligned}", f"  {caption}", f"  {label} \\\\"]
        repeated = [*head, r"    \endfirsthead", *head, r"    \endhead"]
        return "\n".join([*above, *repeated, *body, r"    \bottomrule", r"\end{longtable}", ""])
    above = [r"\begin{table}", r"  \centering", f"  {caption}", f"  {label}", f"  \\begin{{tabular}}{aligned}"]
    return "\n".join([*above, *head, *body, r"    \bottomrule", r"  \end{tabular}", r"\end{table}", ""])


def is_wide(table: Rows) -> bool:
    """Return whether a table is wider in LaTeX than a page of a paper, roughly."""
    widths = [min(_LINE_WIDTH, max(map(len, map(_cell, column)))) for column in zip(*table.rows, strict=True)]
    return sum(width + 2 for width in widths) > _PAGE_WIDTH


def _alignment(cells: Sequence[str]) -> str:
    """Return the column of texts, or that of siunitx that has room for the digits of all numbers in it."""
    found = [match for match in map(_NUMBER.fullmatch, cells) if match]
    if not found:
        return "l" if max(map(len, cells)) <= _LINE_WIDTH else f"p{{{_LINE_WIDTH // 2}em}}"
    most = {part: max((match[part] or "" for match in found), key=len) for part in _NUMBER.groupindex}
    last = f"({len(most['last'])})" if most["last"] else ""
    power = f"e{most['below']}{len(most['power'])}" if most["power"] else ""
    room = f"{most['sign']}{len(most['whole'])}.{len(most['part'])}{last}"
    return f"S[table-format={room}{power}]"


def _heading(column: str) -> str:
    """Return the name of a column or a quantity and, after a stroke, its unit."""
    name, unit = _name_and_unit(column)
    return _escaped(name) + (f" / {unit}" if unit else "")


def _stacked(column: str) -> str:
    """Return the heading of a column over as many lines as keep it about as narrow as its numbers."""
    name, unit = _name_and_unit(column)
    lines = [*map(_escaped, textwrap.wrap(name, _HEADING_WIDTH)), *([f"/ {unit}"] if unit else [])]
    return lines[0] if len(lines) == 1 else r"\shortstack{%s}" % r" \\ ".join(lines)  # noqa: UP031


def _name_and_unit(column: str) -> tuple[str, str]:
    """Return the words of a name, and its unit as siunitx takes it; empty for a plain number."""
    stem, bracket, element = column.partition("[")
    words, *parts = named_unit(stem)
    above, below = (
        ".".join(_SIUNITX.get(unit, unit) + (f"^{power}" if power > 1 else "") for unit, power in part)
        for part in parts
    )
    if below:
        above = f"{above or '1'}/{f'({below})' if '.' in below else below}"
    return _words("_".join(words) + bracket + element), f"\\unit{{{above}}}" if above else ""


_SIUNITX = {"deg": r"\degree"}


def _words(name: str) -> str:
    return name.replace("_", " ")


def _cell(cell: Any) -> str:
    if cell is None:
        return "--"
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if isinstance(cell, str):
        return _escaped(cell)
    text = parenthesised(cell["value"], cell["std"]) if is_quantity(cell) else number(float(cell))
    return "--" if text == UNKNOWN else re.sub(r"e\+?(-?)0*", r"e\1", text).replace("∞", r"$\infty$")


def _escaped(text: str) -> str:
    return "".join(_SPECIAL.get(sign, sign) for sign in text)


def table_files(path: Path, tables: Sequence[Rows]) -> list[Path]:
    """Return the files of tables: `path`, and of several as CSV one for each, `NAME-part.csv`."""
    if path.suffix == ".tex" or len(tables) == 1:
        return [path]
    return [path.with_name(f"{path.stem}-{one.name}.csv") for one in tables]


def export_table(
    document: Mapping[str, Any], path: Path | str, parts: Sequence[str] = (), columns: Sequence[str] = ()
) -> list[Path]:
    """Write the tables of a result's document, atomically, and return the files.

    document: as `--json` of a command prints it, and a result's `to_dict()`. path: .tex, one file of all tables; .csv,
    a file of one table, or where there are several one for each, `NAME-part.csv`. parts: names of those to write.
    columns: of those the ones to write, in this order. Raises SpecError for another ending, and where there is no such
    table or column; FileError where it cannot be written.

    >>> import tempfile
    >>> import sinew as sn
    >>> document = {"resonance": [{"pretension_mm": 6.0, "resonance_hz": sn.Estimate.normal(3.584, 0.012).to_json()}]}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [file] = sn.export_table(document, f"{folder}/mine.tex")
    ...     print(file.read_text().splitlines()[8].strip())
    6 & 3.584(12) \\\\
    """
    file = as_path(path)
    tables = tables_of(document, parts, columns)
    if file.suffix == ".tex":
        texts = {file: "\n".join(map(latex_table, tables))}
    elif file.suffix == ".csv":
        texts = dict(zip(table_files(file, tables), map(csv_table, tables), strict=True))
    else:
        raise SpecError(f"the table's name is {file}, expected one that ends with {' or '.join(FORMATS.values())}")
    for one, text in texts.items():
        write_text(one, text)
    return list(texts)
