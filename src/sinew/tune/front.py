"""This is where candidates are compared in several objectives: who is dominated, and which few stand for the rest."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["nondominated", "spread_out"]

Array = NDArray[np.float64]


def nondominated(objectives: Array) -> NDArray[np.bool_]:
    """Return which rows (n, k) no other row is at least as small as in every objective and smaller in one, (n,).

    Of equal rows the first stays.
    """
    kept = np.ones(len(objectives), dtype=bool)
    for i, row in enumerate(objectives):
        less = np.all(objectives <= row, axis=1)
        smaller = np.any(objectives < row, axis=1) | (np.arange(len(objectives)) < i)
        kept[i] = not np.any(less & smaller)
    return kept


def spread_out(objectives: Array, count: int, begin: Sequence[int] = ()) -> list[int]:
    """Return at most `count` rows (n, k) that lie far apart in the logarithms of the objectives, in order of choice.

    begin: rows that are taken first. Then comes the row that is best in all together, and after it always the one
    that is farthest from those that were taken.
    """
    if not len(objectives):
        return []
    place = np.log(objectives)
    place = (place - place.min(axis=0)) / np.maximum(np.ptp(place, axis=0), 1e-12)
    taken = list(begin) or [int(np.argmin(place.sum(axis=1)))]
    apart = np.min([np.linalg.norm(place - place[i], axis=1) for i in taken], axis=0)
    while len(taken) < min(count, len(objectives)):
        best = int(np.argmax(apart))
        if apart[best] <= 0:
            break
        taken.append(best)
        apart = np.minimum(apart, np.linalg.norm(place - place[best], axis=1))
    return taken[:count]
