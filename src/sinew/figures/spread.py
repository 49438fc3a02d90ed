"""This is where repeats become a mean and a spread."""

import numpy as np
from numpy.typing import ArrayLike

from sinew.figures.style import Floats

__all__ = ["mean_and_spread"]


def mean_and_spread(values: ArrayLike) -> tuple[Floats, Floats]:
    """Return mean and sample standard deviation over the last axis, leaving out NaN.

    The mean is NaN where nothing was measured; the spread is NaN with fewer than two measurements.
    """
    array = np.asarray(values, dtype=float)
    known = np.isfinite(array)
    count = known.sum(axis=-1)
    mean = np.where(known, array, 0.0).sum(axis=-1) / np.where(count > 0, count, np.nan)
    squares = np.where(known, (array - mean[..., None]) ** 2, 0.0).sum(axis=-1)
    return mean, np.sqrt(squares / np.where(count > 1, count - 1, np.nan))
