"""What a result is: a frozen dataclass whose fields say what they hold, and the one renderer that reads them.

A field of a result is annotated with `Field`: its title, its role, and its unit where the name does not end with it.
From these come the text of a command, the HTML of a notebook, JSON, LaTeX and pandas; no result writes any of them.
Fields without a `Field` are for Python alone: samples, curves, what a figure draws.

>>> from typing import Annotated
>>> @dataclass(frozen=True, repr=False)
... class Decay(Result, title="ring-down"):
...     frequency_hz: Annotated[Estimate, Field("frequency")]
...     reason: Annotated[str, Field("", "sentence")] = ""
>>> found = Decay(Estimate.normal(3.021, 0.012), "The residuals are white.")
>>> print(found)
ring-down       value ± std   90 % interval
───────────────────────────────────────────
frequency/Hz  3.021 ± 0.012  3.001 to 3.041
<BLANKLINE>
The residuals are white.
>>> found.to_dict()["frequency_hz"]["value"]
3.021
"""

import collections.abc
import html
import inspect
import io
import math
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Generic,
    Literal,
    NamedTuple,
    Self,
    TypeVar,
    cast,
    get_args,
    get_origin,
    overload,
)

import numpy as np

from sinew.measure.arrays import Array
from sinew.measure.estimate import Estimate, finite, number, pair, shown_interval, span
from sinew.measure.files import tables
from sinew.measure.units import named_unit, with_unit

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

_WIDTH = 110
_COLUMNS = ("value ± std", "90 % interval")
Role = Literal["headline", "interval", "detail", "sentence", "doubt"]
Row = TypeVar("Row", bound="Result", covariant=True)


@dataclass(frozen=True)
class Field:
    """What a field of a result is to a reader.

    title: what it is called, without its unit. role: `headline` stands in the text, in a table with its neighbours; in
    a table of rows it is a column, `interval` one that shows the 90 % interval instead of the standard deviation;
    `detail` is in JSON and written tables alone; `sentence` stands below the numbers, `doubt` above all.
    unit: where the name does not end with it, "%" for a share; "[name]" for what the field of that name says.
    """

    title: str
    role: Role = "headline"
    unit: str | None = None


Detail = Annotated[float | None, Field("", "detail")]
"""A number that is in JSON and in written tables alone."""
Column = Annotated[Array, Field("", "detail")]
"""Numbers of one kind that are in JSON alone."""


class Table(NamedTuple):
    """A table of text: its columns' names with units, its rows, and a title above it."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    title: str | None = None

    def put_on(self, console: "Console") -> None:
        """Print it; the first column is text, the others are right-aligned."""
        from rich.box import SIMPLE_HEAD  # no --help needs it
        from rich.table import Table as RichTable
        from rich.text import Text

        table = RichTable(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True, show_edge=False)
        for index, column in enumerate(self.columns):
            table.add_column(column, justify="left" if index == 0 else "right")
        for row in self.rows:
            table.add_row(*map(Text, row))
        if self.title is not None:
            console.print(Text(self.title, style="bold"))
        console.print(table)
        console.print()

    def to_html(self) -> str:
        """Return it as HTML, escaped."""

        def row(cells: Sequence[str], tag: str) -> str:
            return f"<tr>{''.join(f'<{tag}>{html.escape(cell)}</{tag}>' for cell in cells)}</tr>"

        title = "" if self.title is None else f"<caption>{html.escape(self.title)}</caption>"
        body = "".join(row(cells, "td") for cells in self.rows)
        return f"<table>{title}<thead>{row(self.columns, 'th')}</thead><tbody>{body}</tbody></table>"


class Result:
    """A result: text in Python and on a terminal, tables in a notebook, and out as JSON, pandas and LaTeX.

    A subclass is a frozen dataclass with `repr=False`. kind: the word for it in JSON, pinned here, so that a class can
    be renamed; none for what is only part of another result. title: above its numbers.
    """

    _kind: ClassVar[str] = ""
    _title: ClassVar[str] = ""

    def __init_subclass__(cls, kind: str = "", title: str = "", **more: Any) -> None:
        super().__init_subclass__(**more)
        cls._kind, cls._title = kind or cls._kind, title or cls._title
        if cls._kind and "kind" in inspect.get_annotations(cls):
            raise TypeError(f"{cls.__name__} has a field kind, which is of the class; name it otherwise")

    def heading(self) -> str:
        """Return the title above its numbers."""
        return self._title

    def closing(self) -> list[str]:
        """Return sentences below all, beside the fields that are sentences."""
        return []

    def cell(self) -> str:
        """Return it as one cell of a table of rows; empty where its fields are columns."""
        return ""

    def blocks(self) -> list[Table | str]:
        """Return tables and sentences in the order of reading."""
        return list(_blocks(self))

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as JSON holds them: an unknown number is null, a part that there is not is left out."""
        found: dict[str, Any] = {"kind": self._kind} if self._kind else {}
        for name, (_, may_be_absent) in fields_of(type(self)).items():
            value = getattr(self, name)
            if value is not None or not may_be_absent:
                found[name] = plain(value)
        return found

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> Self:
        """Return the result that a document holds, as `to_dict` made it; fields that are for Python alone have their
        defaults. Raises KeyError where a field is missing."""
        hints = {one.name: one.type for one in fields(cast(Any, cls))}
        given = {name: _typed(get_args(hints[name])[0], document[name]) for name in fields_of(cls) if name in document}
        return cls(**given)

    def to_dataframe(self, part: str = "") -> "pd.DataFrame":
        """Return one of its tables: that of this name, else the first. An uncertain number has its standard deviation
        and the ends of its 90 % interval in columns beside it. Raises SpecError where there is none of that name."""
        import pandas as pd

        table = tables.tables_of(self.to_dict(), [part] if part else [])[0]
        return pd.read_csv(io.StringIO(tables.csv_table(table)))

    def to_latex(self, part: str = "") -> str:
        """Return its tables, or that of one name, for booktabs and siunitx."""
        return "\n".join(map(tables.latex_table, tables.tables_of(self.to_dict(), [part] if part else [])))

    def __str__(self) -> str:
        return text_of(self.blocks())

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        return "".join(
            one.to_html() if isinstance(one, Table) else f"<p>{html.escape(one)}</p>" for one in self.blocks()
        )


class Rows(Sequence[Row], Generic[Row]):
    """Results of one kind, one below the other: a table."""

    def __init__(self, rows: Iterable[Row] = ()) -> None:
        self._rows = tuple(rows)

    @overload
    def __getitem__(self, index: int) -> Row: ...
    @overload
    def __getitem__(self, index: slice) -> "Rows[Row]": ...
    def __getitem__(self, index: int | slice) -> "Row | Rows[Row]":
        return Rows(self._rows[index]) if isinstance(index, slice) else self._rows[index]

    def __len__(self) -> int:
        return len(self._rows)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Rows) and self._rows == other._rows

    def __hash__(self) -> int:
        return hash(self._rows)

    def table(self, title: str = "") -> Table | None:
        """Return them as a table of text; None where there is nothing in it."""
        return _table_of(self, title, None)

    def __repr__(self) -> str:
        return text_of([table]) if (table := self.table()) else "no rows"

    def _repr_html_(self) -> str:
        return table.to_html() if (table := self.table()) else ""

    def to_dataframe(self) -> "pd.DataFrame":
        """Return them as a table, see `Result.to_dataframe`."""
        import pandas as pd

        if not self._rows:
            return pd.DataFrame()
        (table, *_) = tables.tables_of({"rows": plain(self)})
        return pd.read_csv(io.StringIO(tables.csv_table(table)))


def text_of(blocks: Iterable[Table | str]) -> str:
    """Return tables and sentences as text, without colours."""
    from rich.console import Console

    text = io.StringIO()
    # rich writes to a notebook's display instead of the file, unless it is kept from looking for one
    console = Console(file=text, width=_WIDTH, color_system=None, force_jupyter=False)
    for one in blocks:
        if isinstance(one, Table):
            one.put_on(console)
        else:
            text.write(f"{one}\n")
    return "\n".join(line.rstrip() for line in text.getvalue().splitlines()).rstrip()


def fields_of(cls: type[Result]) -> dict[str, tuple[Field, bool]]:
    """Return the fields that a reader sees, by name, and whether each may be absent: None is its default."""
    return _fields_of(cast("Hashable", cls))


@cache
def _fields_of(cls: Any) -> dict[str, tuple[Field, bool]]:
    found = {}
    for one in fields(cls):  # a quoted annotation is of a field for Python alone
        for field in getattr(one.type, "__metadata__", ()):
            if isinstance(field, Field):
                found[one.name] = (field, one.default is None)
    return found


def _typed(hint: Any, value: Any) -> Any:
    """Return a value of a document as its annotation has it."""
    options = [one for one in get_args(hint) if one is not type(None)] if type(None) in get_args(hint) else [hint]
    if value is None and options == [hint] and hint is float:
        return math.nan
    if value is None or len(options) > 1:
        return value
    hint, origin = options[0], get_origin(options[0])
    if origin is Rows:
        return Rows(_typed(get_args(hint)[0], row) for row in value)
    if origin in (dict, Mapping, collections.abc.Mapping):
        return {name: _typed(get_args(hint)[1], one) for name, one in value.items()}
    if origin is tuple:
        return tuple(_typed(get_args(hint)[0], one) for one in value)
    if isinstance(hint, type) and isinstance(value, Mapping):
        if issubclass(hint, Result):
            return hint.from_dict(value)
        if issubclass(hint, Estimate):
            return Estimate.from_json(value)
    return value


def plain(value: Any) -> Any:
    """Return a value as JSON holds it."""
    if isinstance(value, Result):
        return value.to_dict()
    if isinstance(value, Estimate):
        return value.to_json()
    if isinstance(value, Mapping):
        return {str(name): plain(one) for name, one in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(one) for one in value]
    return finite(value) if isinstance(value, float) else value


def _blocks(result: Result, parent: Result | None = None) -> Iterator[Table | str]:
    """Yield doubts, then numbers and tables in the order of the fields, then sentences."""
    known = [(name, field, getattr(result, name)) for name, (field, _) in fields_of(type(result)).items()]
    for _, field, value in known:
        if field.role == "doubt":
            yield from (f"DOUBT: {one.sentence}" for one in value or ())
    numbers: list[tuple[str, Field, Any]] = []
    for name, field, value in known:
        if field.role not in ("headline", "interval"):
            continue
        if isinstance(value, (Result, Rows)):
            yield from _numbers(result, numbers)
            numbers = []
            if isinstance(value, Result):
                yield from _blocks(value, result)
            elif (table := _table_of(value, field.title, result)) is not None:
                yield table
        elif isinstance(value, Mapping) and all(isinstance(one, Result) for one in value.values()):
            yield from _numbers(result, numbers)
            numbers = []
            if value:
                columns = _columns_of([*value.values()], type(next(iter(value.values()))), result)
                cells = [list(value), *(cells for _, cells in columns)]
                yield Table([field.title, *(head for head, _ in columns)], list(zip(*cells, strict=True)))
        elif isinstance(value, Mapping):
            numbers += [(one, Field(" ".join(named_unit(one).words)), of) for one, of in value.items()]
        elif value is not None:
            numbers.append((name, field, value))
    yield from _numbers(result, numbers)
    for name, field, value in known:
        if field.role == "sentence":
            yield from _sentences(field, value, _unit(name, field, result, parent))
    yield from result.closing()


def _numbers(result: Result, numbers: Sequence[tuple[str, Field, Any]]) -> Iterator[Table]:
    """Yield the table of some numbers, one below the other, where there are any."""
    if not numbers:
        return
    rows = []
    for name, field, value in numbers:
        unit, scale = _unit(name, field, result), 100.0 if field.unit == "%" else 1.0
        between = span(scale * value.low, scale * value.high) if isinstance(value, Estimate) else ""
        rows.append((with_unit(field.title, unit), _cell(value, Field(field.title, unit=field.unit), None), between))
    if any(isinstance(value, Estimate) for _, _, value in numbers):
        yield Table((result.heading(), *_COLUMNS), rows)
    else:
        yield Table((result.heading(), "value"), [row[:2] for row in rows])


def _table_of(rows: Rows[Any], title: str, parent: Result | None) -> Table | None:
    """Return rows as a table of their headlines, without columns that no row fills; None without a row."""
    columns = _columns_of(list(rows), type(rows[0]), parent) if rows else []
    if not columns:
        return None
    return Table([head for head, _ in columns], list(zip(*(cells for _, cells in columns), strict=True)), title or None)


def _columns_of(rows: Sequence[Any], cls: type[Result], parent: Result | None) -> list[tuple[str, list[str]]]:
    """Return (head, cells) of the columns of rows; a result in a row has its columns among them. A row may be None."""
    columns: list[tuple[str, list[str]]] = []
    known = fields_of(cls)
    for name, (field, _) in known.items():
        values = [getattr(row, name, None) for row in rows]
        if field.role not in ("headline", "interval") or all(value is None for value in values):
            continue
        if any(not one.cell() for value in values if isinstance(value, Rows) for one in value):
            continue  # a row's own table is no column
        if inside := next((type(value) for value in values if isinstance(value, Result) and not value.cell()), None):
            columns += _columns_of(values, inside, parent)
            continue
        halves = [getattr(row, f"{name}_std", None) for row in rows] if f"{name}_std" in known else [None] * len(rows)
        cells = [_cell(value, field, half) for value, half in zip(values, halves, strict=True)]
        first = next(row for row in rows if row is not None)
        columns.append((with_unit(field.title, _unit(name, field, first, parent)), cells))
    return columns


def _cell(value: Any, field: Field, half: float | None) -> str:
    """Return the text of one value in a table. half: its standard deviation, where it stands in a field beside it."""
    scale = 100.0 if field.unit == "%" else 1.0
    if isinstance(value, Estimate):
        one = value.times(scale) if scale != 1.0 else value
        return shown_interval(one.to_json()) if field.role == "interval" else one.shown()
    if isinstance(value, Result):
        return value.cell()
    if isinstance(value, Rows):
        return "; ".join(one.cell() for one in value) or "none"
    if value is None or isinstance(value, (bool, np.bool_, str)):
        return "–" if value is None else value if isinstance(value, str) else "yes" if value else "no"
    if isinstance(value, tuple):  # the ends of a range
        return " to ".join(_cell(one, field, None) for one in value)
    return pair(scale * float(value), math.nan if half is None else scale * half)


def _sentences(field: Field, value: Any, unit: str) -> Iterator[str]:
    if value is None or value == "":
        return
    if isinstance(value, (tuple, list)):
        yield from value
        return
    if isinstance(value, Estimate):
        text = value.shown(unit)
    elif isinstance(value, (bool, str)):
        text = _cell(value, field, None)
    else:
        text = number(value, unit=unit)
    yield f"{field.title}: {text}" if field.title else text


def _unit(name: str, field: Field, *results: Result | None) -> str:
    """Return the unit of a field: as it says, as another field says, or as its name ends."""
    if field.unit is None:
        _, above, below = named_unit(name)
        over, under = (" ".join(unit + _powers(power) for unit, power in part) for part in (above, below))
        if not under:
            return over.replace("deg", "°")
        return f"{over or '1'}/{f'({under})' if ' ' in under else under}".replace("deg", "°")
    if not field.unit.startswith("["):
        return field.unit
    of = field.unit.strip("[]")
    return next((str(getattr(one, of)) for one in results if hasattr(one, of)), "")


def _powers(power: int) -> str:
    return "" if power == 1 else "⁰¹²³⁴⁵⁶"[power]
