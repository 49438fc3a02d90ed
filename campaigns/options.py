"""Options that the command lines of several campaigns share."""

import argparse
from pathlib import Path


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
