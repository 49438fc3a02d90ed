"""Repeats of one measurement: one value with its interval."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from sinew.measure.arrays import Array, mean_and_spread
from sinew.measure.estimate import NORMAL_90, Estimate


@dataclass(frozen=True)
class Interval:
    """Value, standard deviation and ends of the 90 % interval, arrays of one shape (...,), NaN where unknown.

    std: over repeats, of one draw; that of the fit where there is one repeat. std_of_value: of the value itself.
    """

    value: Array
    std: Array
    std_of_value: Array
    low: Array
    high: Array


def combine_repeats(
    values: Array, stds: Array, degrees_of_freedom: ArrayLike = np.inf, systematic: ArrayLike = 0.0
) -> Interval:
    """Return mean and 90 % interval over the last axis, (..., r), of which NaN repeats are left out.

    stds, degrees_of_freedom: of each repeat's own estimate, (..., r); used where only one repeat is left, since the
    scatter of two or more says more: Student's t with n - 1 degrees of freedom on their standard error.
    systematic: standard uncertainty that all repeats share, (...,), added in quadrature to the interval.
    """
    valid = np.isfinite(values)
    count = valid.sum(axis=-1)
    mean, scatter = mean_and_spread(values)
    first = np.argmax(valid, axis=-1)[..., None]
    alone = np.take_along_axis(np.broadcast_to(stds, values.shape), first, axis=-1)[..., 0]
    freedom = np.take_along_axis(np.broadcast_to(np.asarray(degrees_of_freedom, float), values.shape), first, axis=-1)
    single = count == 1
    std = np.where(count == 0, np.nan, np.where(single, alone, scatter))
    own = std / np.sqrt(np.maximum(count, 1))
    freedom = np.where(single, freedom[..., 0], count - 1.0)
    usable = (count > 0) & (freedom > 0)
    known = np.where(usable & np.isfinite(freedom), freedom, 1.0)
    factor = np.where(np.isfinite(freedom), special.stdtrit(known, 0.95), NORMAL_90)
    shared = np.asarray(systematic, dtype=float)
    half = np.where(usable, np.hypot(factor * own, NORMAL_90 * shared), np.nan)
    return Interval(mean, std, np.hypot(own, shared), mean - half, mean + half)


@dataclass(frozen=True)
class Pooled:
    """Means over repeats of several conditions, whose scatter is taken to be the same.

    estimates: one for each condition. std: of a single draw, by all of them, with its degrees of freedom.
    shared: standard uncertainty of each that repeating does not make smaller.
    """

    estimates: tuple[Estimate, ...]
    std: float
    degrees_of_freedom: float
    shared: tuple[float, ...]

    def significant(self, level: float = 0.1) -> tuple[int, int]:
        """Return how many conditions lie above and below zero beyond chance, at a level for all of them together."""
        count = sum(math.isfinite(one.std) for one in self.estimates)
        if not count or not self.degrees_of_freedom > 0:
            return 0, 0
        t = float(special.stdtrit(self.degrees_of_freedom, 1.0 - level / (2.0 * count)))
        reach = [t * one.std for one in self.estimates]
        above = sum(one.value > r for one, r in zip(self.estimates, reach, strict=True))
        return above, sum(one.value < -r for one, r in zip(self.estimates, reach, strict=True))


def pool_repeats(
    groups: Sequence[Sequence[float]], stds: Sequence[Sequence[float]], shared: Sequence[float] | None = None
) -> Pooled:
    """Return the mean of each condition's repeats with a 90 % interval from the scatter of all conditions.

    groups: repeats of each condition, NaN left out. stds: standard deviation of each repeat by its own fit. shared:
    standard uncertainty of each condition beside the scatter.

    The standard deviation of one repeat is the larger of the pooled scatter (Σ(r - 1) degrees of freedom) and the root
    mean square of the fits' own; without any repeats it is the latter, its intervals normal.
    """
    rows = [np.asarray(group, dtype=float) for group in groups]
    known = [row[np.isfinite(row)] for row in rows]
    freedom = sum(max(row.size - 1, 0) for row in known)
    squares = sum(float(((row - row.mean()) ** 2).sum()) for row in known if row.size > 1)
    own = np.array([value for row in stds for value in row], dtype=float)
    own = own[np.isfinite(own)]
    by_fit = float(np.sqrt(np.mean(own**2))) if own.size else math.nan
    scatter = math.sqrt(squares / freedom) if freedom else math.nan
    std = float(np.fmax(scatter, by_fit))
    dof = float(freedom) if freedom and scatter >= np.nan_to_num(by_fit) else 1e6
    beside = tuple(0.0 for _ in rows) if shared is None else tuple(map(float, shared))
    return Pooled(tuple(_mean(row, std, dof, more) for row, more in zip(known, beside, strict=True)), std, dof, beside)


def _mean(row: Array, std: float, dof: float, shared: float) -> Estimate:
    if not row.size or not math.isfinite(std):
        return Estimate(float(row.mean()) if row.size else math.nan, math.nan, math.nan, math.nan)
    return Estimate.student(float(row.mean()), math.hypot(std / math.sqrt(row.size), shared), dof)
