"""Extremes of a signal that swing far enough, and the cubic through the samples around each.

`scipy.signal` has both (`find_peaks`, `savgol_filter`), and loads all of `scipy.stats` with them: as long as everything
else that `sinew analyse` of a table needs. Tests hold these beside those.
"""

import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array

Places = NDArray[np.intp]


def _turns(values: Array) -> tuple[Places, Array]:
    """Return places and heights of both ends and of all extremes between, in turn; of a flat one its middle."""
    start = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0]))
    stop = np.append(start[1:], values.size) - 1
    rises = np.diff(values[start]) > 0
    kept = np.concatenate([[True], rises[1:] != rises[:-1], [True]]) if start.size > 1 else np.ones(1, dtype=bool)
    return ((start + stop) // 2)[kept], values[start][kept]


def maxima(values: Array) -> Places:
    """Return the places of the maxima of a signal of shape (n,), without its ends; of a flat one its middle."""
    place, height = _turns(values)
    return place[1:-1][height[1:-1] > height[:-2]]


def alternating_extremes(values: Array, least: float) -> Places:
    """Return the places of maxima and minima in turn whose prominence is `least` or more, without the ends.

    values: shape (n,). A maximum's prominence is what the signal falls by on both sides before it rises above it; of
    equal maxima with no such fall between them the first stays. Neighbours that differ by less than `least`, and by
    less than either differs from its other neighbour, take each other out; that leaves all other prominences as they
    are.
    """
    place, height = _turns(values)
    while place.size > 2:
        step = np.abs(np.diff(height))
        no_more = np.append(step[1:], np.inf) > step  # than the next
        no_less = np.concatenate([[np.inf], step[:-1]]) >= step
        small = step < least
        if not small.any():
            break
        kept = np.ones(place.size, dtype=bool)
        # An end has no neighbour to go with: the extreme beside it becomes the end.
        kept[: int(np.argmin(np.append(small & no_more, False)))] = False
        kept[place.size - int(np.argmin(np.append((small & no_less)[::-1], False))) :] = False
        inner = small & no_more & no_less & kept[:-1] & kept[1:]
        inner[[0, -1]] = False
        kept[:-1] &= ~inner
        kept[1:] &= ~inner
        place, height = place[kept], height[kept]
    return place[1:-1]


def local_cubic(values: Array, window: int, step_s: float) -> tuple[Array, Array, Array]:
    """Return value, slope [1/s] and curvature [1/s²] of the cubic through the samples around each, (n,) (n,) (n,).

    values: shape (n,), evenly sampled; window: of how many samples, odd, from 5 to n (Savitzky and Golay's filter). So
    near an end that there are fewer on one side, the cubic through the window at that end tells.
    """
    half = window // 2
    u = np.arange(-half, half + 1) / half
    powers = np.vander(u, 4, increasing=True)
    fit = np.linalg.pinv(powers)
    first, last = fit @ values[:window], fit @ values[-window:]
    found = []
    for k in range(3):
        middle = np.convolve(values, (powers[half] @ fit)[::-1], "valid")
        found.append(np.concatenate([powers[:half] @ first, middle, powers[half + 1 :] @ last]) / (half * step_s) ** k)
        powers = np.pad(powers[:, :3] * [1.0, 2.0, 3.0], ((0, 0), (1, 0)))  # their slopes
    return found[0], found[1], found[2]
