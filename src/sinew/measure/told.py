"""Results as a person reads them: tables and sentences, the same on a terminal, in Python and in a notebook."""

import html
import io
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from rich.console import Console

_WIDTH = 110


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


class Told(ABC):
    """A result that tells itself: Python and notebooks show the tables and sentences that its command prints."""

    @abstractmethod
    def told(self) -> list[Table | str]:
        """Return tables and sentences in the order of reading."""

    def __str__(self) -> str:
        from rich.console import Console

        text = io.StringIO()
        # rich writes to a notebook's display instead of the file, unless it is kept from looking for one
        console = Console(file=text, width=_WIDTH, color_system=None, force_jupyter=False)
        for one in self.told():
            if isinstance(one, Table):
                one.put_on(console)
            else:
                text.write(f"{one}\n")
        return "\n".join(line.rstrip() for line in text.getvalue().splitlines()).rstrip()

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        return "".join(one.to_html() if isinstance(one, Table) else f"<p>{html.escape(one)}</p>" for one in self.told())
