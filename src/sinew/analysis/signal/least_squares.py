"""Least squares: a search with derivatives, columns of one length, and the covariance under coloured noise.

Sensors average and filter, so neighbouring samples share noise, and a covariance that takes them for independent is
too small by the share of noise below the oscillation's frequency. The residuals are described by an autoregression
(Yule-Walker, order by the corrected Akaike criterion), which needs few samples; the covariance is then the sandwich
(JᵀJ)⁻¹ JᵀΓJ (JᵀJ)⁻¹ with Γ the autocovariance of that process. A Newey-West sandwich of the scores would use only the
few samples in which a decay is still large, and be too small for a short one.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sinew.measure.arrays import Array

# The search is Levenberg and Marquardt's, for hundreds of small fits.


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
    same by QR of all samples, which is much of a fit of some hundred.
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


# Columns of one length, and noise that is not white.


_MAX_ORDER = 8
_MANY = 10_000  # samples for each parameter


def unit_columns(design: Array) -> tuple[Array, Array]:
    """Return the columns (..., n, m) scaled to one length, and their lengths (..., m), one for a column of zeros."""
    lengths = np.linalg.norm(design, axis=-2)
    lengths[lengths == 0] = 1.0
    return design / lengths[..., None, :], lengths


def solve_scaled(design: Array, target: Array, smallest: float = 1e-13) -> Array:
    """Return the least-squares solution by columns of one length; smallest: singular value, of the largest."""
    scaled, lengths = unit_columns(design)
    return np.asarray(np.linalg.lstsq(scaled, target, rcond=smallest)[0] / lengths)


def solve_damped(design: Array, target: Array, damping: ArrayLike) -> Array:
    """Return the solutions (k, m) of k damped least-squares problems by columns of one length.

    design: shape (k, n, m); target: shape (k, n). damping: what is added to each squared singular value, a number or
    (k,), positive: below 1e-24 it only keeps the solution small where the columns do not determine it.
    """
    scaled, lengths = unit_columns(design)
    count = lengths.shape[1]
    rows = np.zeros((scaled.shape[0], scaled.shape[1] + count, count + 1))
    rows[:, :-count, :-1], rows[:, :-count, -1] = scaled, target
    rows[:, -count:, :-1] = np.sqrt(np.asarray(damping))[..., None, None] * np.eye(count)
    # Never singular, so that one problem without a solution does not take the others with it.
    upper = np.asarray(np.linalg.qr(rows, mode="r"))
    return np.asarray(np.linalg.solve(upper[:, :count, :count], upper[:, :count, count:])[:, :, 0] / lengths)


def noise_spectrum(residual: Array, basis: Array) -> Array:
    """Return the power spectrum of the noise, shape (size/2 + 1,), on the grid of `rfft` with size >= 2 n samples.

    residual: shape (n,), evenly sampled; basis: shape (n, m), orthonormal, of the columns of the Jacobian of the fit
    that left these residuals. The spectrum's mean over the whole circle of frequencies is the variance of one sample;
    white noise has it everywhere.

    A fit takes from the residuals what of the noise looks like its parameters, mostly at low frequency. That bias is
    undone: the expected lagged sums of (1 - QQᵀ)·noise are linear in the noise's autocovariance, and are solved for it
    (Worsley et al., NeuroImage 15, 2002).
    """
    power = 2 ** int(np.ceil(np.log2(2 * residual.size)))
    size = next((share * power // 8 for share in (5, 6) if share * power >= 16 * residual.size), power)
    coefficients, innovation = autoregression(residual, basis)
    response = np.fft.rfft(np.concatenate([[1.0], -coefficients]), size)
    return np.asarray(innovation / np.abs(response) ** 2, dtype=float)


def autoregression(residual: Array, basis: Array) -> tuple[Array, float]:
    """Return (a, variance of e) of the noise e_n + Σ a_k noise_{n-k} that the residuals tell, a of shape (order,).

    Arguments as in `noise_spectrum`; white noise, and what cannot be told from it, has order zero.
    """
    n = residual.size
    lags = _unbiased_lags(residual, basis, min(_MAX_ORDER, n // 10))
    if not lags[0] > 0:
        return np.zeros(0), float(residual @ residual) / n
    return _best_order(lags, n)


def orthonormal(jacobian: Array) -> Array:
    """Return an orthonormal basis of the columns, shape (n, <= m); by the Gram matrix, faster than QR for tall ones."""
    values, vectors = np.linalg.eigh(jacobian.T @ jacobian)
    retained = values > 1e-13 * values[-1]
    return np.asarray(
        (vectors[:, retained] / np.sqrt(values[retained])).T @ jacobian.T, dtype=float
    ).T  # columns in one piece


def _unbiased_lags(residual: Array, basis: Array, order: int) -> Array:
    n = residual.size
    sums = np.array([float(residual[: n - k] @ residual[k:]) for k in range(order + 1)])
    if n > _MANY * basis.shape[1]:  # the fit took a share of m/n
        return np.asarray(sums / (n - np.arange(order + 1.0)), dtype=float)
    rows = basis.T
    shifted, half = np.empty((order + 1, *rows.shape)), 0.5 * rows
    shifted[0] = rows
    for k in range(1, order + 1):
        shifted[k, :, :-k], shifted[k, :, -k:] = half[:, k:], 0.0
        shifted[k, :, k:] += half[:, :-k]
    flat, inner = shifted.reshape(order + 1, -1), (shifted @ basis).reshape(order + 1, -1)  # each of inner symmetric
    lost = inner @ inner.T - 2.0 * flat @ flat.T
    expected = lost * np.where(np.arange(order + 1) == 0, 1.0, 2.0) + np.diag(n - np.arange(order + 1.0))
    return np.asarray(np.linalg.solve(expected, sums), dtype=float)


def _best_order(lags: Array, n: int) -> tuple[Array, float]:
    """Return (coefficients, innovation variance) of the autoregression that the criterion prefers (Levinson)."""
    coefficients, innovation = np.zeros(0), float(lags[0])
    best, chosen = n * np.log(innovation), (coefficients, innovation)
    for order in range(1, lags.size):
        past = float(coefficients @ lags[order - 1 : 0 : -1]) if order > 1 else 0.0
        reflection = (float(lags[order]) - past) / innovation
        if abs(reflection) >= 1.0:
            break
        coefficients = np.concatenate([coefficients - reflection * coefficients[::-1], [reflection]])
        innovation *= 1.0 - reflection**2
        criterion = n * np.log(innovation) + 2.0 * order * n / (n - order - 1.0)
        if criterion < best - 2.0:  # a little evidence, or white noise is called coloured too often
            best, chosen = criterion, (coefficients, innovation)
    return chosen


def independent(spectrum: Array, n: int) -> float:
    """Return how many independent samples n samples of noise of a spectrum are worth, n γ₀² / Σ γ², γ at all lags."""
    weight = _circle(spectrum)
    variance = float(weight @ spectrum)
    return n * variance**2 / float(weight @ spectrum**2) if variance > 0 else float(n)


def _circle(spectrum: Array) -> Array:
    size = 2 * (spectrum.size - 1)
    weight = np.full(spectrum.size, 2.0 / size)  # both halves of the circle
    weight[[0, -1]] = 1.0 / size
    return weight


class Factors(NamedTuple):
    """The pseudo-inverse of a Jacobian (n, m): the parameters of x (n,) are unscale * (inverse @ (rows @ x)).

    rows: orthonormal, (k, n), k the rank. inverse: (m, k). unscale: (m,), one over the length of each column.
    """

    rows: Array
    inverse: Array
    unscale: Array


def factorised(jacobian: Array) -> Factors:
    """Return the factors of a Jacobian of shape (n, m), its columns brought to one length.

    By singular values: JᵀJ would lose half of the digits, and with them a direction that the record hardly shows.
    """
    scaled, lengths = unit_columns(jacobian)
    turned, singular, rows = np.linalg.svd(scaled.T, full_matrices=False)
    retained = singular > 1e-14 * singular[0]
    return Factors(rows[retained], turned[:, retained] / singular[retained], 1.0 / lengths)


def sandwich(jacobian: Array, residual: Array) -> tuple[Array, float]:
    """Return (covariance, degrees of freedom) of parameters fitted by least squares under coloured noise.

    jacobian: shape (n, m), derivatives of the model at the solution; residual: shape (n,).
    The degrees of freedom are those of the variance estimate, the independent samples less m, at least one.
    """
    factors, (n, m) = factorised(jacobian), jacobian.shape
    spectrum = noise_spectrum(residual, factors.rows.T)
    if float(_circle(spectrum) @ spectrum) <= 0:
        return np.zeros((m, m)), float(max(n - m, 1))
    return covariance_by(factors, spectrum), max(independent(spectrum, n) - m, 1.0)


def covariance_by(factors: Factors, spectrum: Array, loudness: Array | None = None) -> Array:
    """Return the covariance of least squares under noise of a spectrum, shape (m, m), see `noise_spectrum`.

    loudness: shape (n,), standard deviation of the noise at each sample over its root mean square; None for one size.
    No variance is smaller than that for white noise of the same size: a spectrum from few samples that happens to dip
    at the oscillation's frequency is no reason for confidence.
    """
    weight, inverse = _circle(spectrum) * spectrum, factors.inverse
    loud = factors.rows if loudness is None else factors.rows * loudness
    waves = np.fft.rfft(loud, 2 * (spectrum.size - 1)) * np.sqrt(weight)
    parts = waves.view(float)
    covariance = inverse @ (parts @ parts.T) @ inverse.T
    white = float(weight.sum()) * np.diag(inverse @ (loud @ loud.T) @ inverse.T)
    larger = np.sqrt(np.maximum(1.0, white / np.maximum(np.diag(covariance), 1e-300))) * factors.unscale
    return np.asarray(covariance * np.outer(larger, larger), dtype=float)
