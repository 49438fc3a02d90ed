"""The command of the benchmarks: all in one table by `make bench`, one by `python -m benchmarks bus --seconds 20`.

Each row has Sinew and a peer on the same computer in the same run. A peer that is not installed is named as skipped.
"""

import sys
from collections.abc import Callable, Iterable, Sequence

from benchmarks import broadband_speed, bus_loop, gpu, prediction, sweep_fit, swing_speed, table, twin_speed

PARTS: dict[str, Callable[[Sequence[str]], Iterable[table.Row]]] = {
    "twin": lambda _: twin_speed.rows(),
    "bus": bus_loop.rows,
    "broadband": lambda _: broadband_speed.rows(),
    "sweep": lambda _: sweep_fit.rows(),
    "prediction": lambda _: prediction.rows(),
    "swing": lambda _: swing_speed.rows(),
    "gpu": gpu.rows,
}


def main() -> None:
    """Run the benchmark that is named, with its options, or all, and print the table."""
    asked = sys.argv[1:2]
    if asked and asked[0] not in PARTS:
        raise SystemExit(f"found {asked[0]}, expected one of {', '.join(PARTS)}, or nothing for all")
    print(table.HEADER)
    for name in asked or PARTS:
        for row in PARTS[name](sys.argv[2:]):
            print(row.text(), flush=True)


if __name__ == "__main__":
    main()
