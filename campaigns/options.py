"""What several campaigns share: options of their command lines, and trials spread over processes or a cluster."""

import argparse
import importlib
import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from sinew.measure.tasks import Spread, each_task

_Outcome = TypeVar("_Outcome")
TWO = min(2, os.cpu_count() or 1)


def campaign_parser(
    name: str,
    about: str | None,
    *,
    count: int,
    of: str = "runs",
    numbered: bool = False,
    workers: int | None = None,
    verbose: bool = False,
) -> argparse.ArgumentParser:
    """Return a parser with how many (`--runs`, or what `of` says), `--seed` unless seeds are counted, and `--out`.

    numbered: with `--first`, the number or seed of the first one. workers: default of `--workers`; None: without it.
    verbose: with `--verbose`.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m campaigns.{name}", description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(f"--{of}", type=int, default=count, help=f"how many [{count}]")
    if of != "seeds":
        parser.add_argument("--seed", type=int, default=0, help="of the whole campaign [0]")
    parser.add_argument("--out", type=Path, help="file for table and results, as JSON")
    if numbered:
        parser.add_argument("--first", type=int, default=0, help="number of the first one [0]")
    if workers is not None:
        parser.add_argument("--workers", type=int, default=workers, help=f"processes [{workers}]")
        parser.add_argument("--scheduler", help="instead: a Dask scheduler whose workers do it, as tcp://host:8786")
        parser.add_argument("--keep", type=Path, help="file that keeps outcomes as they come, and is gone on from")
    if verbose:
        parser.add_argument("--verbose", action="store_true", help="a line for each one, on stderr")
    return parser


def conclude(out: Path | None, table: str, document: object, wrong: Sequence[str] = ()) -> int:
    """Print a table and what happened that may not, write both as JSON where a file is asked for; return the status."""
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps({"table": table, "found": document, "wrong": list(wrong)}, indent=1, default=str)
        out.write_text(text + "\n", encoding="utf-8")
    print("\n".join([table, *(f"!! {sentence}" for sentence in wrong)]))
    return 1 if wrong else 0


def spread_of(asked: argparse.Namespace) -> Spread:
    """Return where trials run, by the options of `campaign_parser`."""
    return Spread(asked.scheduler, 1 if asked.scheduler else asked.workers, asked.keep)


def asked_seeds(asked: argparse.Namespace) -> range:
    """Return the seeds that `--first` and `--seeds` stand for."""
    return range(asked.first, asked.first + asked.seeds)


def spread_trials(each: Callable[..., _Outcome], *columns: Iterable[Any], spread: Spread) -> Iterator[_Outcome]:
    """Yield what each row of the columns gives, in order, as soon as those before it are there."""
    there: dict[int, _Outcome] = {}
    wanted = 0
    for place, outcome in each_task(partial(_row, _importable(each)), list(zip(*columns, strict=False)), spread):
        there[place] = outcome
        while wanted in there:
            yield there.pop(wanted)
            wanted += 1


def _row(each: Callable[..., _Outcome], row: tuple[Any, ...]) -> _Outcome:
    return each(*row)


def _importable(each: Callable[..., _Outcome]) -> Callable[..., _Outcome]:
    """Return a function of the program that was begun (`python -m`) by the name under which others import it."""
    if isinstance(each, partial):
        return partial(_importable(each.func), *each.args, **each.keywords)
    begun = getattr(sys.modules["__main__"], "__spec__", None)
    if each.__module__ != "__main__" or begun is None:
        return each
    found: Callable[..., _Outcome] = getattr(importlib.import_module(begun.name), each.__qualname__)
    return found
