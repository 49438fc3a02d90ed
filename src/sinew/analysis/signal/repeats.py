"""Repeats of one measurement, one value with its interval; and the slope of such values over pretension."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy import special

from sinew.measure.arrays import Array, mean_and_spread
from sinew.measure.estimate import NORMAL_90, Estimate
from sinew.measure.recording import RESULT_VARIABLES, companions


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

    def at(self, index: tuple[int, ...]) -> Estimate:
        """Return the estimate of the value at one place."""
        return Estimate(*(float(one[index]) for one in (self.value, self.std_of_value, self.low, self.high)))


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


def variable_of(name: str, values: NDArray[Any], unit: str = "") -> xr.Variable:
    """Return a variable of the results by the schema. unit: where that leaves it open."""
    row = RESULT_VARIABLES[name]
    return xr.Variable(row.dims, values, {"units": unit if row.unit == "*" else row.unit, "long_name": row.meaning})


def interval_variables(name: str, interval: Interval) -> dict[str, xr.Variable]:
    """Return a quantity and its three companions as variables, under the names of the result schema."""
    numbers = (interval.value, interval.std, interval.low, interval.high)
    return {key: variable_of(key, one) for key, one in zip((name, *companions(name)), numbers, strict=True)}


def interval_rows(results: xr.Dataset, names: Sequence[str]) -> list[dict[str, Any]]:
    """Return one row for each pretension, of its pretension and of estimates by name: the mean over the repeats with
    the standard deviation and the interval of that mean.

    names: of quantities over pretension with their companions, or of those over pretension and repeat.
    """
    means = {name: _means(results, name) for name in names}
    return [
        {"pretension_mm": float(pretension)} | {name: mean[index] for name, mean in means.items()}
        for index, pretension in enumerate(results["pretension_mm"].values)
    ]


def _means(results: xr.Dataset, name: str) -> list[Estimate]:
    values = results.variables[name].values
    if values.ndim > 1:
        own = f"{name}_std"
        mean = combine_repeats(values, results.variables[own].values if own in results else values * np.nan)
        return [mean.at((i,)) for i in range(mean.value.size)]
    repeats = np.isfinite(results["gain"].values).any(axis=1).sum(axis=-1)
    columns = np.stack([results.variables[one].values for one in (name, *companions(name))]).T.tolist()
    return [_of_mean(Estimate(*row), int(count)) for row, count in zip(columns, repeats, strict=True)]


def _of_mean(one: Estimate, repeats: int) -> Estimate:
    """Return an estimate whose std is that of the value, from the standard deviation over repeats that results keep.

    What the interval holds beyond Student's of the scatter (the delay budget) is shared by all repeats, and is added.
    """
    if repeats < 2 or not math.isfinite(one.high - one.low):
        return one
    own = one.std / math.sqrt(repeats)
    scatter = float(special.stdtrit(repeats - 1, 0.95)) * own
    shared = math.sqrt(max(0.0, (0.5 * (one.high - one.low)) ** 2 - scatter**2)) / NORMAL_90
    return Estimate(one.value, math.hypot(own, shared), one.low, one.high)


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
    common = tuple(0.0 for _ in rows) if shared is None else tuple(map(float, shared))
    return Pooled(tuple(_mean(row, std, dof, more) for row, more in zip(known, common, strict=True)), std, dof, common)


def _mean(row: Array, std: float, dof: float, shared: float) -> Estimate:
    if not row.size or not math.isfinite(std):
        return Estimate(float(row.mean()) if row.size else math.nan, math.nan, math.nan, math.nan)
    return Estimate.student(float(row.mean()), math.hypot(std / math.sqrt(row.size), shared), dof)


# The slope of a straight line over pretension has an interval that bends and repeats both enter.
#
# A line y = a + b (x - x̄) by least squares. The standard deviation of b is the larger of two: what the scatter over
# repeats makes of it, and what the residuals about the line do. The first alone would call every bend a certainty.


@dataclass(frozen=True)
class Trend:
    """A line over pretension. slope: per unit of x. middle: its value at `centre`, the mean of x.

    residual: about the line, shape (n,). degrees_of_freedom: of the slope's interval.
    """

    slope: Estimate
    middle: Estimate
    centre: float
    residual: Array
    degrees_of_freedom: float

    def at(self, x: Array) -> Array:
        """Return the line, shape of x."""
        return np.asarray(self.middle.value + self.slope.value * (x - self.centre))


def fit_trend(x: Array, y: Array, std: float = math.nan, freedom: float = math.nan) -> Trend:
    """Return the line through two or more points.

    x, y: shape (n,), finite. std: standard deviation of one y by its repeats, with its degrees of freedom; NaN where
    there are none. With two points and no repeats the slope has no interval. Raises ValueError below two points.
    """
    if x.size < 2 or np.ptp(x) == 0:
        raise ValueError(f"a line needs two different x, found {np.unique(x).size}")
    centre = float(x.mean())
    away = x - centre
    spread = float(away @ away)
    slope, middle = float(away @ y) / spread, float(y.mean())
    residual = y - middle - slope * away
    candidates = []
    if x.size > 2:
        candidates.append((math.sqrt(float(residual @ residual) / (x.size - 2)), float(x.size - 2)))
    if math.isfinite(std) and freedom > 0:
        candidates.append((std, freedom))
    if not candidates:
        nothing = Estimate(slope, math.nan, math.nan, math.nan)
        return Trend(nothing, Estimate(middle, math.nan, math.nan, math.nan), centre, residual, math.nan)
    one, dof = max(candidates, key=lambda pair: pair[0] * float(special.stdtrit(pair[1], 0.95)))
    return Trend(
        Estimate.student(slope, one / math.sqrt(spread), dof),
        Estimate.student(middle, one / math.sqrt(x.size), dof),
        centre,
        residual,
        dof,
    )


def detectable(std: float, degrees_of_freedom: float, power: float = 0.9, level: float = 0.1) -> float:
    """Return the size of an effect that a test at a two-sided level finds with a probability: (t_level + t_power) std.

    std: standard deviation of the estimate. With the level of 0.1 the test is "the 90 % interval leaves zero out".
    """
    if not degrees_of_freedom > 0:
        return math.nan
    t = special.stdtrit(degrees_of_freedom, np.array([1.0 - level / 2.0, power]))
    return float(t.sum() * std)


def ratio_interval(above: Trend, below: Trend, x: Array) -> Estimate:
    """Return the ratio of two slopes over the same x with Fieller's 90 % interval, for errors that are correlated.

    The interval is infinite where the denominator's slope is not known to differ from zero.
    """
    away = x - x.mean()
    spread = float(away @ away)
    freedom = min(above.degrees_of_freedom, below.degrees_of_freedom)
    a, b = above.slope.value, below.slope.value
    if not freedom > 0 or b == 0:
        return Estimate(math.nan, math.nan, -math.inf, math.inf)
    shared = float(above.residual @ below.residual) / max(x.size - 2, 1) / spread if x.size > 2 else 0.0
    vaa, vbb = above.slope.std**2, below.slope.std**2
    vab = float(np.clip(shared, -math.sqrt(vaa * vbb), math.sqrt(vaa * vbb)))
    t = float(special.stdtrit(freedom, 0.95)) ** 2
    ratio = a / b
    variance = max(vaa - 2.0 * ratio * vab + ratio**2 * vbb, 0.0) / b**2
    leading, middle, last = b**2 - t * vbb, a * b - t * vab, a**2 - t * vaa
    inside = middle**2 - leading * last
    if leading <= 0 or inside < 0:
        return Estimate(ratio, math.sqrt(variance), -math.inf, math.inf)
    root = math.sqrt(inside)
    return Estimate(ratio, math.sqrt(variance), (middle - root) / leading, (middle + root) / leading)
