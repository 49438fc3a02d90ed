"""This is where the commands speak: results on stdout, progress and remarks on stderr, files whole or not at all."""

import json
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sinew.measure.errors import FileError

__all__ = ["print_json", "print_table", "progress_bar", "remark", "require_file", "require_folder", "write_json"]

Progress = Callable[[float, float], None]

_PIPE_WIDTH = 200


def print_json(document: Any) -> None:
    """Print one JSON document on stdout. NaN and infinity have no JSON form, so they must be null before."""
    sys.stdout.write(_json_text(document))


def write_json(document: Any, path: Path) -> None:
    """Write one JSON document, atomically. Raises FileError where the folder cannot be written."""
    from sinew.measure.netcdf import write_atomically  # xarray: half a second

    text = _json_text(document)

    def write(temporary: Path) -> None:
        temporary.write_text(text, encoding="utf-8")

    write_atomically(path, write)


def _json_text(document: Any) -> str:
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def print_table(columns: Sequence[str], rows: Sequence[Sequence[str]], title: str | None = None) -> None:
    """Print a table on stdout; the first column is text, the others are right-aligned."""
    from rich.box import SIMPLE_HEAD  # no --help needs it
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True, show_edge=False)
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index == 0 else "right")
    for row in rows:
        table.add_row(*map(Text, row))
    console = Console() if sys.stdout.isatty() else Console(width=_PIPE_WIDTH)
    if title is not None:
        console.print(Text(title, style="bold"))
    console.print(table)
    console.print()


def remark(sentence: str) -> None:
    """Print a remark on stderr, where it does not disturb what a pipe reads."""
    sys.stderr.write(f"sinew: {' '.join(sentence.split())}\n")


@contextmanager
def progress_bar(task: str) -> Iterator[Progress]:
    """Give a callable that takes (done, total) and shows a bar on stderr; in a pipe it shows nothing."""
    if not sys.stderr.isatty():
        yield lambda _done, _total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        shown = bar.add_task(task, total=None)
        yield lambda done, total: bar.update(shown, completed=done, total=total)


def require_folder(folder: Path) -> Path:
    """Return a folder that can be written, without making it: a run that fails later leaves nothing behind.

    Raises FileError before long work starts, where the folder, or the nearest one above it, takes no file.
    """
    nearest = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.exists())
    try:
        with tempfile.TemporaryFile(dir=nearest):
            pass
    except OSError as error:
        raise FileError(
            f"cannot write into {folder}: {error.strerror or error}; choose a folder that you may write with --out"
        ) from error
    return folder


def require_file(path: Path) -> Path:
    """Return a path where a file can be written. Raises FileError before long work starts."""
    if path.is_dir():
        raise FileError(f"cannot write {path}: it is a folder; name a file in it")
    require_folder(path.parent)
    return path
