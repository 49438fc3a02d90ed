"""This is where a number that a fit names is made one coordinate of its search, so that it can be held and profiled.

Most are multiples of one. A number in full (a stiffness in N m/rad) is one over the gain, and the damping ratio is
damping over twice the root of the stiffness: then x_k = y_k·c(x_j) with y_k the coordinate that is held, and the chain
rule turns the Jacobian.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sinew.identify.fitted import Fit
from sinew.identify.layout import free_mechanics
from sinew.identify.least_squares import Problem, Solution
from sinew.identify.model import parameter_name
from sinew.identify.numbers import DAMPING, FREQUENCY, number_names
from sinew.measure.errors import SpecError

__all__ = ["Quantity", "find_quantity"]

Array = NDArray[np.float64]
Curve = Callable[[float], float]

_FULL_WORDS = {"inertia": "gain", "mass": "gain"}


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
    if name.split("_")[0] in _FULL_WORDS:
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
    if fit.model.damping == "loss-factor":
        return Quantity(at["loss_factor"], _times(0.5))
    return Quantity(
        at["damping"],
        lambda y: y,
        spring,
        lambda k: 2.0 * float(np.sqrt(max(k, 1e-12))),
        lambda k: 1.0 / float(np.sqrt(max(k, 1e-12))),
    )
