"""This is where samples are thinned to what a screen can show: least and largest value of each column of pixels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Thinned", "thin"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Thinned:
    """time: begin of each bin [s], (b,), or of each sample where nothing was thinned. low, high: least and largest
    value of each channel there, (c, b); the same array where nothing was thinned."""

    time: Floats
    low: Floats
    high: Floats


def thin(time: Floats, values: Floats, bin_s: float) -> Thinned:
    """Return the least and largest value of every channel in bins of a common grid, k · bin_s.

    time: not decreasing [s], (n,). values: (c, n), not a number where there is none. bin_s: width of a bin [s].
    A bin holds what falls into it and is not empty; with one sample or less to a bin the samples are given as they
    are. Bins lie on one grid, so parts that were thinned one after the other join: a bin that both have is the least
    of the least and the largest of the largest.
    """
    if time.size == 0 or bin_s <= 0 or (time[-1] - time[0]) / bin_s + 1 >= time.size:
        return Thinned(time, values, values)
    number = np.floor(time / bin_s)
    first = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
    low = np.fmin.reduceat(values, first, axis=1)
    high = np.fmax.reduceat(values, first, axis=1)
    return Thinned(number[first] * bin_s, low, high)
