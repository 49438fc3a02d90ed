"""This is where a parameter's interval comes from the sum of squares itself: the profile likelihood.

For each trial value of one parameter all others are fitted anew; the interval ends where the smallest sum of squares
has risen by the factor 1 + F/ν, F the 90 % quantile of F(1, ν). It is not symmetric, and it is right where the
symmetric one of the covariance is not: near a bound, or where a parameter is known only within a factor.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from sinew.identify.least_squares import Problem, Solution, solve

__all__ = ["Profile", "profile_interval"]

Array = NDArray[np.float64]

_STEPS = 14


@dataclass(frozen=True)
class Profile:
    """Interval of one parameter by its profile.

    low, high: its ends; infinite where the sum of squares does not rise that far.
    tried, risen: trial values, and √(rise of the sum of squares over the residual variance), signed, shape (t,): for a
        linear model a straight line, (trial - value)/std.
    """

    low: float
    high: float
    tried: Array
    risen: Array


def profile_interval(
    problem: Problem,
    solution: Solution,
    index: int,
    std: float,
    *,
    degrees_of_freedom: float | None = None,
    inflation: float = 1.0,
    level: float = 0.9,
) -> Profile:
    """Return the interval of parameter `index` around a solution by its profile likelihood.

    std: the standard deviation that the covariance gives, a first step. degrees_of_freedom: n - m if not given.
    inflation: ratio of the variance under correlated residuals to the classical one, by which F is stretched.
    """
    freedom = float(solution.degrees_of_freedom if degrees_of_freedom is None else degrees_of_freedom)
    variance = solution.sum_of_squares / max(solution.degrees_of_freedom, 1)
    wanted = float(special.stdtrit(freedom, 0.5 + 0.5 * level) * np.sqrt(inflation))
    tried, risen, ends = [float(solution.values[index])], [0.0], []
    for side in (-1.0, 1.0):
        others = np.delete(solution.values, index)

        def rise(value: float, side: float = side) -> float:
            nonlocal others
            found = solve(_without(problem, index, value), others, tolerance=1e-9, max_evaluations=100)
            others = found.values
            gained = max(found.sum_of_squares - solution.sum_of_squares, 0.0) / variance
            tried.append(value)
            risen.append(side * float(np.sqrt(gained)))
            return float(np.sqrt(gained) - wanted)

        ends.append(_crossing(rise, float(solution.values[index]), side * wanted * std, wanted))
    order = np.argsort(tried)
    return Profile(ends[0], ends[1], np.array(tried)[order], np.array(risen)[order])


def _crossing(rise: Callable[[float], float], value: float, step: float, wanted: float) -> float:
    """Return where `rise` crosses zero, by growing steps and then regula falsi; infinite where it never does."""
    inner, inner_rise, outer = value, -wanted, value + step
    for _ in range(_STEPS):
        outer_rise = rise(outer)
        if outer_rise >= 0:
            break
        inner, inner_rise, outer = outer, outer_rise, value + 2.0 * (outer - value)
    else:
        return float(np.copysign(np.inf, step))
    for _ in range(_STEPS):
        if abs(outer_rise) < 1e-3 * wanted:
            break
        share = np.clip(inner_rise / (inner_rise - outer_rise), 0.05, 0.95)
        middle = inner + float(share) * (outer - inner)
        middle_rise = rise(middle)
        if abs(middle_rise) < 1e-3 * wanted:
            return middle
        if middle_rise >= 0:
            outer, outer_rise = middle, middle_rise
        else:
            inner, inner_rise = middle, middle_rise
    return outer


def _without(problem: Problem, index: int, value: float) -> Problem:
    def whole(others: Array) -> Array:
        return np.insert(others, index, value)

    return Problem(
        lambda others: problem.residual(whole(others)),
        lambda others: np.delete(problem.jacobian(whole(others)), index, axis=1),
    )
