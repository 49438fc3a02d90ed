"""Arrays: the types of real and complex ones and of masks, mean and spread that leave out what was not measured."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Mask = NDArray[np.bool_]


def namespace_of(value: Any) -> Any:
    """Return the functions that belong to an array, NumPy's or JAX's; NumPy's for a plain number."""
    return value.__array_namespace__() if hasattr(value, "__array_namespace__") else np


def mean_of_known(values: Array, otherwise: float = np.nan) -> Array:
    """Return the mean over the last axis without what is not finite, `otherwise` where nothing is left.

    `numpy.nanmean` does the same but warns where nothing is left, and a sweep may have lost a group.
    """
    known = np.isfinite(values)
    count = known.sum(axis=-1)
    return np.asarray(np.where(count > 0, np.where(known, values, 0.0).sum(axis=-1) / np.maximum(count, 1), otherwise))


def mean_and_spread(values: ArrayLike) -> tuple[Array, Array]:
    """Return mean and sample standard deviation over the last axis, leaving out NaN.

    The mean is NaN where nothing was measured; the spread is NaN with fewer than two measurements.
    """
    array = np.asarray(values, dtype=float)
    known = np.isfinite(array)
    count, mean = known.sum(axis=-1), mean_of_known(array)
    squares = np.where(known, (array - mean[..., None]) ** 2, 0.0).sum(axis=-1)
    return mean, np.sqrt(squares / np.where(count > 1, count - 1, np.nan))


def robust_std(deviations: ArrayLike) -> float:
    """Return the standard deviation of normal noise whose deviations have this median size; outliers hardly move it."""
    return 1.4826 * float(np.median(np.abs(deviations)))


def wrapped_lag(ratio: Complexes) -> Array:
    """Return the lag of a complex response over its drive, (-π/2, 3π/2] [rad]: 0 and π lie well inside."""
    return np.asarray(1.5 * np.pi - np.mod(1.5 * np.pi + np.angle(ratio), 2.0 * np.pi))
