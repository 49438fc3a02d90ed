"""Slope of a straight line over pretension, with an interval that bends and repeats both enter.

A line y = a + b (x - x̄) by least squares. The standard deviation of b is the larger of two: what the scatter over
repeats makes of it, and what the residuals about the line do. The first alone would call every bend a certainty.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

from sinew.measure.arrays import Array
from sinew.measure.estimate import Estimate


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
