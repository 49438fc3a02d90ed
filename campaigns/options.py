"""What several campaigns share: options of their command lines, and trials spread over processes."""

import argparse
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

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
    """Return a parser with how many (`--runs`, or what `of` says), `--seed` and `--out`.

    numbered: with `--first`, the number of the first one. workers: default of `--workers`; None: without it.
    verbose: with `--verbose`.
    """
    parser = argparse.ArgumentParser(prog=f"python -m campaigns.{name}", description=about)
    parser.add_argument(f"--{of}", type=int, default=count, help=f"how many [{count}]")
    parser.add_argument("--seed", type=int, default=0, help="of the whole campaign [0]")
    parser.add_argument("--out", type=Path, help="file for table and results, as JSON")
    if numbered:
        parser.add_argument("--first", type=int, default=0, help="number of the first one [0]")
    if workers is not None:
        parser.add_argument("--workers", type=int, default=workers, help=f"processes [{workers}]")
    if verbose:
        parser.add_argument("--verbose", action="store_true", help="a line for each one, on stderr")
    return parser


def trial_parser(
    name: str, about: str | None, *, count: int, of: str, trials: str = "seeds", first: str = "first", workers: int = 0
) -> argparse.ArgumentParser:
    """Return a parser with how many trials (`--seeds`, or what `trials` says) and the first seed (`--first`).

    of: what the count counts. workers: default of `--workers`; 0: without it.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m campaigns.{name}", description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(f"--{trials}", type=int, default=count, help=f"{of} [{count}]")
    parser.add_argument(f"--{first}", type=int, default=0, help="the first seed [0]")
    if workers:
        parser.add_argument("--workers", type=int, default=workers, help=f"processes [{workers}]")
    return parser


def asked_seeds(asked: argparse.Namespace) -> range:
    """Return the seeds that `--first` and `--seeds` of `trial_parser` stand for."""
    return range(asked.first, asked.first + asked.seeds)


def spread_trials(each: Callable[..., _Outcome], *columns: Iterable[Any], workers: int) -> Iterator[_Outcome]:
    """Yield what each row of the columns gives, in order, spread over processes; one: in this process."""
    if workers <= 1:
        yield from map(each, *columns)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        yield from pool.map(each, *columns)
