"""Profile likelihood: a parameter's interval from the sum of squares itself.

For each trial value of one parameter all others are fitted anew; the interval ends where the smallest sum of squares
has risen by the factor 1 + F/ν, F the 90 % quantile of F(1, ν). It is not symmetric, and it is right where the
symmetric one of the covariance is not: near a bound, or where a parameter is known only within a factor.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import special

from sinew.identify.oscillator.fitted import DAMPING, FREQUENCY, Fit, number_names
from sinew.identify.oscillator.least_squares import Problem, Solution, covariance, restricted, solve
from sinew.identify.oscillator.model import free_mechanics, parameter_name
from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.measure.estimate import Estimate
from sinew.mechanics.laws import LossFactor

# A number that a fit names is made one coordinate of its search, so that it can be held and profiled.
#
# Most are multiples of one. A number in full (a stiffness in N m/rad) is one over the gain, and the damping ratio is
# damping over twice the root of the stiffness: then x_k = y_k·c(x_j) with y_k the coordinate that is held, and the
# chain rule turns the Jacobian.

Curve = Callable[[float], float]


@dataclass(frozen=True)
class Quantity:
    """One number of a fit as a coordinate.

    index: of the entry of the search that it replaces. physical: from the coordinate to the number, increasing or
    decreasing. other: the entry j with x_k = y_k·curve(x_j), or -1; slope: the derivative of that curve.
    """

    index: int
    physical: Curve
    other: int = -1
    curve: Curve = lambda x: 1.0
    slope: Curve = lambda x: 0.0

    def coordinates(self, x: Array) -> Array:
        """Return y for a vector of the search, shape (m,)."""
        y = np.array(x, dtype=float)
        if self.other >= 0:
            y[self.index] = x[self.index] / self.curve(float(x[self.other]))
        return y

    def values(self, y: Array) -> Array:
        """Return the vector of the search for y, shape (m,)."""
        x = np.array(y, dtype=float)
        if self.other >= 0:
            x[self.index] = y[self.index] * self.curve(float(y[self.other]))
        return x

    def turn(self, jacobian: Array, y: Array) -> Array:
        """Return the derivatives by y from those by x, shape (n, m)."""
        if self.other < 0:
            return jacobian
        turned = jacobian.copy()
        own, at = jacobian[:, self.index], float(y[self.other])
        turned[:, self.index] = own * self.curve(at)
        turned[:, self.other] += own * y[self.index] * self.slope(at)
        return turned

    def gradient(self, y: Array) -> Array:
        """Return the derivatives of y_k by x, shape (m,)."""
        found = np.zeros(y.size)
        found[self.index] = 1.0
        if self.other >= 0:
            size, slope = self.curve(float(y[self.other])), self.slope(float(y[self.other]))
            found[self.index] = 1.0 / size
            found[self.other] = -y[self.index] * slope / size
        return found

    def problem(self, problem: Problem) -> Problem:
        """Return a least-squares problem in the coordinates y."""
        return Problem(
            lambda y: problem.residual(self.values(y)),
            lambda y: self.turn(problem.jacobian(self.values(y)), y),
        )

    def solution(self, solution: Solution) -> Solution:
        """Return a solution in the coordinates y."""
        y = self.coordinates(solution.values)
        return Solution(
            y,
            solution.residual,
            self.turn(solution.jacobian, y),
            solution.converged,
            solution.message,
            solution.evaluations,
        )


def find_quantity(fit: Fit, name: str) -> Quantity:
    """Return a number of a fit as a coordinate. name: of `Fit.parameters`, or natural_frequency_hz or damping_ratio.

    Raises SpecError for any other name, and where the fit has no such number (a spring that pushes away).
    """
    if name not in number_names(fit):
        raise SpecError(f"{name!r} is no number of this fit, expected one of {', '.join(number_names(fit))}")
    if name in (FREQUENCY, DAMPING):
        return _oscillation(fit, name)
    return _mechanical(fit, name)


def _mechanical(fit: Fit, name: str) -> Quantity:
    record, scales = fit.layout.parts[0].record, fit.layout.parts[0].scales
    entries = list(enumerate(fit.layout.entries))
    free = [(k, entry) for k, entry in entries if entry.local in free_mechanics(fit.model, record)]
    for k, entry in free:
        plain = parameter_name(entry.local, record.excitation, record.motion_unit, record.input_motion_unit)
        if name == plain + (entry.label() if entry.group else ""):
            return Quantity(k, _times(scales.physical(entry.local)))
    gain = next(k for k, entry in free if entry.local == "gain")
    if name.startswith(("inertia_", "mass_")):
        inverse = 1.0 / scales.physical("gain")
        return Quantity(gain, lambda y: inverse / y)
    for k, entry in free:
        if entry.local != "gain" and name.startswith(entry.local) and name.endswith(entry.label()):
            factor = scales.physical(entry.local) / scales.physical("gain")
            return Quantity(k, _times(factor), gain, lambda g: g, lambda g: 1.0)
    raise SpecError(f"{name} cannot be profiled; take it over the inertia")


def _times(factor: float) -> Curve:
    return lambda y: y * factor


def _oscillation(fit: Fit, name: str) -> Quantity:
    at = {entry.local: k for k, entry in reversed(list(enumerate(fit.layout.entries)))}
    spring = at["stiffness"]
    if not fit.solution.values[spring] > 0:
        raise SpecError(f"the spring of this fit pushes away, so there is no {name}")
    hertz = fit.layout.parts[0].scales.omega / (2 * np.pi)
    if name == FREQUENCY:
        return Quantity(spring, lambda y: hertz * float(np.sqrt(max(y, 0.0))))
    if fit.model.law.has(LossFactor):
        return Quantity(at["loss_factor"], _times(0.5))
    return Quantity(
        at["damping"],
        lambda y: y,
        spring,
        lambda k: 2.0 * float(np.sqrt(max(k, 1e-12))),
        lambda k: 1.0 / float(np.sqrt(max(k, 1e-12))),
    )


_STEPS = 14
_CLOSE = 1e-3  # of the rise that is wanted
_BETTER = 1.0  # residual variances: a sum of squares that is smaller by more belongs to another minimum
_RESTARTS = 3
_FAR = 1e100  # no residual counts for more


@dataclass(frozen=True)
class Profile:
    """Interval of one parameter by its profile.

    low, high: its ends; infinite where the sum of squares does not rise that far.
    tried, risen: trial values, and √(rise of the sum of squares over the residual variance), signed, shape (t,): for a
        linear model a straight line, (trial - value)/std.
    better: parameters with a clearly smaller sum of squares than the solution's, if the trials came upon any, shape
        (m,): then the solution is not the best, and the interval not to be used.
    """

    low: float
    high: float
    tried: Array
    risen: Array
    better: Array | None = None


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
    value = float(solution.values[index])
    tried, risen, ends, better = [value], [0.0], [], None
    for side in (-1.0, 1.0):
        followed = _Followed(problem, solution, index)

        def rise(trial: float, side: float = side, followed: _Followed = followed) -> float:
            gained = max(followed.least(trial) - solution.sum_of_squares, 0.0) / variance
            tried.append(trial)
            risen.append(side * float(np.sqrt(gained)))
            return float(np.sqrt(gained) - wanted)

        first = std * float(special.stdtrit(freedom, 0.5 + 0.5 * level))
        ends.append(_crossing(rise, value, side * first, wanted))
        if followed.best[0] < solution.sum_of_squares - _BETTER * variance:
            better = followed.best[1]
    order = np.argsort(tried)
    return Profile(ends[0], ends[1], np.array(tried)[order], np.array(risen)[order], better)


def interval90(fit: Fit, name: str) -> Estimate | None:
    """Return a number of a fit with its 90 % interval by profile likelihood; None where it is bounded on neither side.

    name: of `Fit.parameters`, or natural_frequency_hz or damping_ratio. value, std: as in the fit; low, high: of the
    profile, infinite where the record does not bound that side. Where the trials come upon a smaller sum of squares
    than the fit's, the profile starts again from there, and the value is the one there.

    Under correlated residuals the sum of squares rises too fast, by the ratio of the robust variance of the fit to the
    classical one; the rise that ends the interval is that much larger. Raises SpecError for an unknown name.
    """
    quantity = find_quantity(fit, name)
    solution = quantity.solution(fit.solution)
    gradient = quantity.gradient(solution.values)
    taking = np.flatnonzero(gradient)
    robust = float(gradient[taking] @ fit.covariance.matrix[np.ix_(taking, taking)] @ gradient[taking])
    classical = float(covariance(solution.jacobian, solution.residual).matrix[quantity.index, quantity.index])
    if not (np.isfinite(robust) and np.isfinite(classical) and robust > 0 and classical > 0):
        return None
    problem, freedom = quantity.problem(fit.layout.problem(fit.kept)), fit.covariance.degrees_of_freedom
    for _ in range(_RESTARTS):
        found = profile_interval(
            problem,
            solution,
            quantity.index,
            float(np.sqrt(robust)),
            degrees_of_freedom=freedom,
            inflation=robust / classical,
        )
        if found.better is None:
            break
        solution = solve(problem, found.better, tolerance=1e-9, max_evaluations=100)
    if not np.isfinite([found.low, found.high]).any():
        return None
    known = (fit.parameters | {FREQUENCY: fit.natural_frequency_hz, DAMPING: fit.damping_ratio})[name]
    value = quantity.physical(float(solution.values[quantity.index]))
    ends = sorted((quantity.physical(found.low), quantity.physical(found.high)))
    if not ends[0] <= value <= ends[1]:  # 1/y, and y may be zero
        return None
    return Estimate(value, known.std, ends[0], ends[1])


class _Followed:
    """The other parameters, followed from trial to trial. best: the smallest sum of squares met, and where."""

    def __init__(self, problem: Problem, solution: Solution, index: int) -> None:
        self._problem, self._x, self._lean = problem, solution.values, solution.lean(index)
        self._index, self._free = index, np.arange(self._x.size) != index
        self.best = solution.sum_of_squares, solution.values

    def least(self, trial: float) -> float:
        """Return the smallest sum of squares with the parameter at its trial value."""
        x = self._x.copy()
        x[self._index] = trial
        held = restricted(self._problem, x, self._free)
        starts = [one[self._free] for one in (x, x + self._lean * (trial - self._x[self._index]))]
        off = [np.clip(np.nan_to_num(held.residual(start), nan=_FAR), -_FAR, _FAR) for start in starts]
        nearer = starts[int(np.argmin([float(r @ r) for r in off]))]
        found = solve(held, nearer, tolerance=1e-9, max_evaluations=100)
        x[self._free] = found.values
        self._x = x
        if found.sum_of_squares < self.best[0]:
            self.best = found.sum_of_squares, x
        return found.sum_of_squares


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
        if abs(outer_rise) < _CLOSE * wanted:
            break
        share = np.clip(inner_rise / (inner_rise - outer_rise), 0.05, 0.95)
        middle = inner + float(share) * (outer - inner)
        middle_rise = rise(middle)
        if abs(middle_rise) < _CLOSE * wanted:
            return middle
        if middle_rise >= 0:
            outer, outer_rise = middle, middle_rise
        else:
            inner, inner_rise = middle, middle_rise
    return outer
