r"""Tables of results for papers and spreadsheets: LaTeX with uncertainties as siunitx takes them, and CSV.

What is written comes from a result's document, as `--json` prints it: every list of rows in it is a table, and every
group of quantities one of two columns. The unit is in the name (`resonance_hz`), a quantity with an uncertainty is
`{"value", "std", "interval90"}`. In LaTeX a number is `\num{3.021(20)}`, its digits by the uncertainty; CSV keeps every
digit, with the standard deviation and the ends of the 90 % interval in columns of their own.
"""

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sinew.measure.doors import as_path, write_text
from sinew.measure.errors import SpecError
from sinew.measure.estimate import UNKNOWN, number, parenthesised

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
_UNITS = {
    "n_m_s_rad": "N.m.s/rad",
    "n_m_rad3": "N.m/rad^3",
    "n_m_rad": "N.m/rad",
    "kg_m2": "kg.m^2",
    "j_rad2": "J/rad^2",
    "rad_s": "rad/s",
    "n_m": "N.m",
    "per_s2": "1/s^2",
    "per_s": "1/s",
    "mm": "mm",
    "hz": "Hz",
    "deg": r"\degree",
    "rad": "rad",
    "s": "s",
    "m": "m",
    "n": "N",
    "a": "A",
    "w": "W",
    "j": "J",
}
"""Units at the ends of names in documents, as siunitx takes them; longer endings first."""


class Rows(NamedTuple):
    """One table of a document. name: of its part, as `energy_pretensions`; columns: in the order of the rows; rows: a
    cell for each column, a number, a text, a truth, None, or a quantity with its uncertainty."""

    name: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]


def is_quantity(cell: Any) -> bool:
    """Return whether a part of a document is a quantity with an uncertainty."""
    return isinstance(cell, Mapping) and {"value", "std"} <= cell.keys()


def tables_of(document: Mapping[str, Any], parts: Sequence[str] = ()) -> list[Rows]:
    """Return the tables of a result's document, all or those that are named.

    Raises SpecError where there are none, or not the ones that are named.
    """
    found = list(_found("", document))
    names = [one.name for one in found]
    if not found:
        raise SpecError("found no table in this document, expected rows or quantities as a result's --json has them")
    for part in parts:
        if part not in names:
            raise SpecError(f"found no part {part!r}, expected one of {', '.join(names)}")
    return [one for one in found if not parts or one.name in parts]


def _found(name: str, part: Mapping[str, Any]) -> Iterator[Rows]:
    quantities = {key: cell for key, cell in part.items() if is_quantity(cell)}
    if quantities:
        yield Rows(name or "quantities", ("quantity", "value"), tuple(quantities.items()))
    for key, cell in part.items():
        path = f"{name}_{key}" if name else str(key)
        if isinstance(cell, Mapping) and not is_quantity(cell):
            yield from _found(path, cell)
        elif isinstance(cell, list) and cell and all(isinstance(row, Mapping) for row in cell):
            rows = [
                {k: c for k, c in row.items() if is_quantity(c) or not isinstance(c, Mapping | list)} for row in cell
            ]
            columns = tuple(dict.fromkeys(k for row in rows for k in row))
            if columns:
                yield Rows(path, columns, tuple(tuple(row.get(k) for k in columns) for row in rows))


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
    r"""Return a table for LaTeX with booktabs and siunitx; a number with an uncertainty is `\num{3.021(20)}`."""
    texts = [
        all(isinstance(row[i], str | bool) or row[i] is None for row in table.rows) for i in range(len(table.columns))
    ]
    lines = [
        r"\begin{table}",
        r"  \centering",
        f"  \\caption{{{_escaped(_words(table.name))}}}",
        f"  \\label{{tab:{re.sub(r'[^A-Za-z0-9]+', '-', table.name)}}}",
        f"  \\begin{{tabular}}{{{''.join('l' if text else 'r' for text in texts)}}}",
        r"    \toprule",
        f"    {' & '.join(map(_heading, table.columns))} \\\\",
        r"    \midrule",
    ]
    in_names = table.columns == ("quantity", "value")
    for row in table.rows:
        cells = [_heading(row[0]), _cell(row[1])] if in_names else [_cell(cell) for cell in row]
        lines.append(f"    {' & '.join(cells)} \\\\")
    return "\n".join([*lines, r"    \bottomrule", r"  \end{tabular}", r"\end{table}", ""])


def _heading(column: str) -> str:
    """Return the name of a column or a quantity and, after a stroke, its unit."""
    stem, bracket, place = column.partition("[")
    ending = next((ending for ending in _UNITS if stem.endswith(f"_{ending}")), None)
    name = stem if ending is None else stem.removesuffix(f"_{ending}")
    return _escaped(_words(name + bracket + place)) + ("" if ending is None else f" / \\unit{{{_UNITS[ending]}}}")


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
    return "--" if text == UNKNOWN else r"$\infty$" if "∞" in text else f"\\num{{{text}}}"


def _escaped(text: str) -> str:
    return "".join(_SPECIAL.get(sign, sign) for sign in text)


def export_table(document: Mapping[str, Any], path: Path | str, parts: Sequence[str] = ()) -> list[Path]:
    """Write the tables of a result's document, atomically, and return the files.

    document: as `--json` of a command prints it, and `.document` of a result. path: .tex, one file of all tables; .csv,
    a file of one table, or where there are several one for each, `NAME-part.csv`. parts: names of those to write.
    Raises SpecError for another ending, and where there is no such table; FileError where it cannot be written.

    >>> import tempfile
    >>> import sinew as sn
    >>> document = {"resonance": [{"pretension_mm": 6.0, "resonance_hz": sn.Estimate.normal(3.584, 0.012).to_json()}]}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [file] = sn.export_table(document, f"{folder}/mine.tex")
    ...     print(file.read_text().splitlines()[8].strip())
    \\num{6} & \\num{3.584(12)} \\\\
    """
    file = as_path(path)
    tables = tables_of(document, parts)
    if file.suffix == ".tex":
        texts = {file: "\n".join(map(latex_table, tables))}
    elif file.suffix == ".csv":
        several = len(tables) > 1
        texts = {file.with_name(f"{file.stem}-{one.name}.csv") if several else file: csv_table(one) for one in tables}
    else:
        raise SpecError(f"the table's name is {file}, expected one that ends with {' or '.join(FORMATS.values())}")
    for one, text in texts.items():
        write_text(one, text)
    return list(texts)
