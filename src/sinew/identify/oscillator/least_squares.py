"""Least squares, from one start or several, and word of how the search went."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize

from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError

_HUGE = 1e8  # of the start's largest residual: what a residual that is not finite counts as


@dataclass(frozen=True)
class Problem:
    """Residuals r(x) whose sum of squares is wanted small.

    residual: takes x, shape (m,), returns shape (n,). jacobian: takes x, returns ∂r/∂x, shape (n, m).
    A residual may be NaN or infinite (a simulation that ran away): such a point is refused.
    """

    residual: Callable[[Array], Array]
    jacobian: Callable[[Array], Array]


def restricted(problem: Problem, x: Array, free: NDArray[np.bool_] | NDArray[np.intp]) -> Problem:
    """Return the problem of the free ones among the parameters, a mask or indices, the others being as in x."""

    def whole(values: Array) -> Array:
        full = x.copy()
        full[free] = values
        return full

    return Problem(lambda v: problem.residual(whole(v)), lambda v: problem.jacobian(whole(v))[:, free])


@dataclass(frozen=True)
class Solution:
    """The smallest sum of squares that was found.

    values: shape (m,). residual: shape (n,), jacobian: shape (n, m), both there.
    converged: whether the search ended at a minimum; message: how it ended, a sentence.
    evaluations: residuals that were asked for, over all starts. start: index of the start that led here.
    agreeing: how many starts led to the same minimum (costs within 1e-6 of each other).
    """

    values: Array
    residual: Array
    jacobian: Array
    converged: bool
    message: str
    evaluations: int
    start: int = 0
    agreeing: int = 1

    @property
    def sum_of_squares(self) -> float:
        """Return Σ r²."""
        return float(self.residual @ self.residual)

    @property
    def degrees_of_freedom(self) -> int:
        """Return n - m."""
        return self.residual.size - self.values.size


def solve(
    problem: Problem,
    *starts: ArrayLike,
    bounds: tuple[ArrayLike, ArrayLike] | None = None,
    tolerance: float = 1e-12,
    max_evaluations: int = 400,
) -> Solution:
    """Return the best solution over the starts.

    starts: one or more, shape (m,). bounds: (low, high), shape (m,) each, or None.
    tolerance: relative, of the sum of squares and of the parameters; 1e-15 asks for all that double precision has.
    max_evaluations: of each start.

    Levenberg-Marquardt as MINPACK has it (Moré 1978), columns scaled by their norms; with bounds the trust-region
    reflective method (Branch, Coleman, Li 1999). The Jacobian is the caller's, not differences.
    Raises RecordingError where there are fewer residuals than parameters, or none of the starts has finite residuals.
    """
    if not starts:
        raise ValueError("a search needs at least one start")
    found: list[Solution] = []
    for index, start in enumerate(starts):
        first = problem.residual(np.asarray(start, dtype=float))
        if first.size < np.size(start):
            raise RecordingError(
                f"found {first.size} samples for {np.size(start)} parameters; record longer or fit a smaller model"
            )
        if np.isfinite(first).all():
            found.append(_descend(problem, np.asarray(start, dtype=float), first, bounds, tolerance, max_evaluations))
            found[-1] = replace(found[-1], start=index)
    if not found:
        raise RecordingError(
            "the model runs away from every start; check the excitation, and the units of input and output"
        )
    best = min(found, key=lambda solution: solution.sum_of_squares)
    agreeing = sum(solution.sum_of_squares <= best.sum_of_squares * (1 + 1e-6) for solution in found)
    return replace(best, agreeing=agreeing, evaluations=sum(solution.evaluations for solution in found))


def _descend(
    problem: Problem,
    start: Array,
    first: Array,
    bounds: tuple[ArrayLike, ArrayLike] | None,
    tolerance: float,
    max_evaluations: int,
) -> Solution:
    huge = _HUGE * max(float(np.abs(first).max()), 1e-100)

    def residual(x: Array) -> Array:
        r = problem.residual(x)
        return r if np.isfinite(r).all() else np.full(r.shape, huge)

    def jacobian(x: Array) -> Array:
        return np.nan_to_num(problem.jacobian(x), nan=0.0, posinf=0.0, neginf=0.0)

    low, high = (-np.inf, np.inf) if bounds is None else bounds
    box = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    end = optimize.least_squares(
        residual,
        np.clip(start, *box),
        jacobian,
        bounds=box,
        method="lm" if bounds is None else "trf",
        x_scale="jac",
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
        max_nfev=max_evaluations,
    )
    values = np.asarray(end.x, dtype=float)
    return Solution(
        values,
        np.asarray(end.fun, dtype=float),
        np.asarray(jacobian(values), dtype=float),
        bool(end.status > 0),
        _sentence(int(end.status), int(end.nfev)),
        int(end.nfev),
    )


def _sentence(status: int, evaluations: int) -> str:
    reasons: dict[int, str] = {
        1: "the gradient is zero to within the tolerance",
        2: "the sum of squares no longer changes",
        3: "the parameters no longer change",
        4: "neither the sum of squares nor the parameters change any more",
    }
    if status in reasons:
        return f"converged after {evaluations} evaluations: {reasons[status]}"
    return f"not converged after {evaluations} evaluations; start nearer, or give the search more of them"
