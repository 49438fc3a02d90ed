"""Nonlinear least squares with derivatives: MINPACK's Levenberg and Marquardt, for hundreds of small fits."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import optimize

from sinew.measure.arrays import Array

Linearised = tuple[Array, Callable[[], Array]]
"""Values of a model at some parameters, shape (n,), and what gives their derivatives there, shape (n, m)."""

Model = Callable[[Array], Linearised]

ENOUGH = 1e-7
"""Relative change of the sum of squares, and of the parameters, that ends a search: of the paper's ring-downs no number
is then further than 0.001 of its standard deviation from where a search goes on to."""

_AMISS = 1e60  # in place of what is not finite: far from any data, and its square still a number


class Solution(NamedTuple):
    """Parameters of the least squares, shape (m,), model less data (n,) and the derivatives (n, m) there.

    converged: whether the search ended by itself.
    """

    parameters: Array
    deviation: Array
    jacobian: Array
    converged: bool


def least_squares(model: Model, data: Array, start: Array, *, most: int = 60) -> Solution:
    """Return the parameters of a model at which it is nearest to data of shape (n,), sought from a start of shape (m,).

    most: evaluations that end it, if the change of the sum of squares, or of the parameters, does not: `ENOUGH`.

    The columns are scaled by their derivatives, as by `scipy.optimize.least_squares` with x_scale="jac", which gives
    the same numbers; its bookkeeping takes longer than a fit of some hundred samples.
    """
    here, (values, slope) = start.tobytes(), model(start)
    derivatives: Array | None = None

    def move(p: Array) -> None:
        nonlocal here, values, slope, derivatives
        if (there := p.tobytes()) != here:
            here, derivatives = there, None
            values, slope = model(p.copy())  # MINPACK goes on to write into its own

    def deviation(p: Array) -> Array:
        move(p)
        off = values - data
        return off if math.isfinite(off @ off) else np.nan_to_num(off, nan=_AMISS, posinf=_AMISS, neginf=-_AMISS)

    def jacobian(p: Array) -> Array:
        nonlocal derivatives
        move(p)
        if derivatives is None:
            derivatives = slope().T
            if not math.isfinite(derivatives.sum()):
                derivatives = np.nan_to_num(derivatives, nan=0.0, posinf=0.0, neginf=0.0)
        return derivatives

    with np.errstate(over="ignore", invalid="ignore"):  # of a step too far, from which the search comes back
        found, _, _, _, end = optimize.leastsq(
            deviation,
            start,
            Dfun=jacobian,
            full_output=True,
            col_deriv=True,
            ftol=ENOUGH,
            xtol=ENOUGH,
            gtol=1e-8,
            maxfev=most,
        )
        return Solution(found, deviation(found), jacobian(found).T, end in (1, 2, 3, 4))
