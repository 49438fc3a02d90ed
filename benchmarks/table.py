"""One row of the table of benchmarks: a piece of work, what it takes here and at a peer, in the same run."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple


class Row(NamedTuple):
    """ours, theirs: what the work takes, in `unit`; the peer's None where it did not run, and `note` says why."""

    work: str
    ours: float
    peer: str
    theirs: float | None
    unit: str = "s"
    note: str = ""

    def text(self) -> str:
        """Return the row; the ratio is how many times as much the peer takes."""
        beside = "" if self.theirs is None else f"{self.theirs:10.4g} {self.unit:3} {self.theirs / self.ours:8.2f}"
        return f"{self.work:52} {self.ours:10.4g} {self.unit:3}  {self.peer:36} {beside:23}  {self.note}".rstrip()


HEADER = f"{'work':52} {'Sinew':>10}      {'peer':36} {'peer':>10} {'times':>12}  note"


def best_of(runs: int, work: Callable[[], Any]) -> tuple[float, Any]:
    """Return the shortest time of some runs [s] and the last result."""
    best, result = float("inf"), None
    for _ in range(runs):
        start = time.perf_counter()
        result = work()
        best = min(best, time.perf_counter() - start)
    return best, result
