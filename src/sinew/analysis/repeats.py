"""This is where repeats of one measurement become one value with its interval."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

__all__ = ["Interval", "combine_repeats"]

Floats = NDArray[np.float64]
_NORMAL_90 = 1.6448536269514722


@dataclass(frozen=True)
class Interval:
    """Value, standard deviation and ends of the 90 % interval, arrays of one shape (...,), NaN where unknown.

    std: over repeats, of one draw; that of the fit where there is one repeat. std_of_value: of the value itself.
    """

    value: Floats
    std: Floats
    std_of_value: Floats
    low: Floats
    high: Floats


def combine_repeats(
    values: Floats, stds: Floats, degrees_of_freedom: ArrayLike = np.inf, systematic: ArrayLike = 0.0
) -> Interval:
    """Return mean and 90 % interval over the last axis, (..., r), of which NaN repeats are left out.

    stds, degrees_of_freedom: of each repeat's own estimate, (..., r); used where only one repeat is left, since the
    scatter of two or more says more: Student's t with n - 1 degrees of freedom on their standard error.
    systematic: standard uncertainty that all repeats share, (...,), added in quadrature to the interval.
    """
    valid = np.isfinite(values)
    count = valid.sum(axis=-1)
    clean = np.where(valid, values, 0.0)
    mean = np.where(count > 0, clean.sum(axis=-1) / np.maximum(count, 1), np.nan)
    spread = np.where(valid, values - mean[..., None], 0.0)
    scatter = np.sqrt((spread**2).sum(axis=-1) / np.maximum(count - 1, 1))
    first = np.argmax(valid, axis=-1)[..., None]
    alone = np.take_along_axis(np.broadcast_to(stds, values.shape), first, axis=-1)[..., 0]
    freedom = np.take_along_axis(np.broadcast_to(np.asarray(degrees_of_freedom, float), values.shape), first, axis=-1)
    single = count == 1
    std = np.where(count == 0, np.nan, np.where(single, alone, scatter))
    own = std / np.sqrt(np.maximum(count, 1))
    freedom = np.where(single, freedom[..., 0], count - 1.0)
    usable = (count > 0) & (freedom > 0)
    known = np.where(usable & np.isfinite(freedom), freedom, 1.0)
    factor = np.where(np.isfinite(freedom), special.stdtrit(known, 0.95), _NORMAL_90)
    shared = np.asarray(systematic, dtype=float)
    half = np.where(usable, np.hypot(factor * own, _NORMAL_90 * shared), np.nan)
    return Interval(mean, std, np.hypot(own, shared), mean - half, mean + half)
