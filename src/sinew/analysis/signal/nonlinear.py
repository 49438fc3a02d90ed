"""Nonlinear least squares with derivatives, by Levenberg and Marquardt, for hundreds of small fits."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sinew.measure.arrays import Array

Linearised = tuple[Array, Callable[[], Array]]
"""Values of a model at some parameters, shape (n,), and what gives their derivatives there, shape (n, m)."""

Model = Callable[[Array], Linearised]

ENOUGH = 1e-7
"""Relative change of the sum of squares, and of the parameters, that ends a search: no number of the paper's ring-downs
moves by more than 0.001 of its standard deviation where a search goes on."""
_ENOUGH_CUT = 1e-9  # the same after a step that was cut short, which along a flat valley says little

_AMISS = 1e60  # in place of what is not finite: far from any data, and its square still a number
_WORTH, _WELL, _BADLY = 1e-4, 0.75, 0.25  # shares of the promised fall: a step is taken; may be longer; must be shorter
_FARTHEST = 100.0  # times the parameters: the first step
_NEARLY = 0.1  # of the longest step allowed: so near to it is one that is to be as long
_SINGULAR = 1e-14  # of a column's square: keeps steps finite along what the data do not determine
_SHORTEST, _NOTHING = 1e-100, 1e-300  # length and square of a column of zeros


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

    Steps δ solve the normal equations, D⁻¹JᵀJD⁻¹ Dδ = -D⁻¹Jᵀr, D the largest lengths of the columns so far; one longer
    than what is trusted is damped to that length (Moré, Numerical Analysis, 1978). SciPy's door to MINPACK does the
    same by QR of all samples, which is much of a fit of some hundred; and its import takes a tenth of a short command.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # of a step too far, from which the search comes back
        p, trusted, lengths = np.array(start, dtype=float), math.inf, np.full(start.size, _SHORTEST)
        values, slope = model(p)
        off = _finite(values - data, _AMISS)
        square, taken, is_near = float(off @ off), True, False
        for evaluation in range(1, most):
            if taken:
                jacobian = _finite(slope(), 0.0)
                gram, against = jacobian.T @ jacobian, jacobian.T @ off
                lengths = np.maximum(lengths, np.sqrt(gram.diagonal()))
                gram, against = gram / lengths / lengths[:, None], against / lengths
                gram.flat[:: p.size + 1] += _SINGULAR * gram.diagonal() + _NOTHING
                straight = -np.linalg.solve(gram, against)
            if not math.isfinite(straight.sum()):  # squares of the derivatives left the floating point
                break
            if evaluation == 1:
                trusted = _FARTHEST * (math.sqrt(float(np.sum((lengths * p) ** 2))) or 1.0)
            step, damping = _damped(gram, against, straight, trusted)
            size = math.sqrt(float(step @ step))
            trusted = min(trusted, size) if evaluation == 1 else trusted
            there = p + step / lengths
            values, slope_there = model(there)
            off_there = values - data
            square_there = float(off_there @ off_there)
            fall = square - square_there if math.isfinite(square_there) else -math.inf
            promised = damping * size**2 - float(against @ step)
            if fall <= _BADLY * promised:
                along = float(against @ step)  # half of the slope at which the sum of squares falls
                shorter = 0.5 if fall >= 0 else max(0.1, along / (2.0 * along + fall)) if fall > -99.0 * square else 0.1
                trusted = shorter * min(trusted, 10.0 * size)
            elif damping == 0.0 or fall >= _WELL * promised:
                trusted = 2.0 * size
            enough = ENOUGH if damping == 0.0 else _ENOUGH_CUT
            is_near = max(abs(fall), promised) <= enough * square and fall <= 2.0 * promised
            shortest = enough * math.sqrt(float(np.sum((lengths * p) ** 2)))
            is_near = is_near or (size if damping == 0.0 else trusted) <= shortest
            taken = fall > _WORTH * promised
            if taken:
                p, off, square, slope = there, off_there, square_there, slope_there
            if is_near:
                break
        return Solution(p, off, _finite(slope(), 0.0), is_near)


def _damped(gram: Array, against: Array, straight: Array, trusted: float) -> tuple[Array, float]:
    """Return the step that minimises the linearised sum of squares among those no longer than trusted, within a tenth,
    and its damping; straight: the one without."""
    size = math.sqrt(float(straight @ straight))
    if size <= (1.0 + _NEARLY) * trusted:
        return straight, 0.0
    values, vectors = np.linalg.eigh(gram)
    along, damping = vectors.T @ against, 0.0
    values = np.maximum(values, _NOTHING)
    for _ in range(30):
        parts = along / (values + damping)
        size = math.sqrt(float(parts @ parts))
        if size <= (1.0 + _NEARLY) * trusted:
            break
        damping += (size / trusted - 1.0) * size**2 / float(np.sum(parts**2 / (values + damping)))
    return -(vectors @ parts), damping


def _finite(values: Array, instead: float) -> Array:
    if math.isfinite(values.sum()):
        return values
    return np.nan_to_num(values, nan=instead, posinf=instead, neginf=-instead)
