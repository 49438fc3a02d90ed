"""This is where the residuals of a stepped sine are asked whether scatter alone explains them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import special

from sinew.identify.residual_tests import rank_trend
from sinew.identify.response_fitted import ResponseTests
from sinew.identify.response_points import ResponsePoints

__all__ = ["ask_points", "long_run", "whiten"]

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]


def ask_points(
    points: Sequence[ResponsePoints], residuals: Sequence[Complexes], motion: Sequence[Array], parameters: int
) -> ResponseTests:
    """Return the tests of the residuals of all groups.

    residuals: measured less predicted, in the unit of the response. motion: amplitude of the motion, shape (n,) each.
    parameters: how many were fitted.
    """
    whitened = [whiten(one, r) for one, r in zip(points, residuals, strict=True)]
    squares = [np.sum(w**2, axis=1) for w in whitened]
    count = 2 * sum(one.size for one in points)
    total = float(sum(s.sum() for s in squares))
    freedom = max(count - parameters, 1)
    # Over a scatter that was estimated with ν degrees of freedom each square is Hotelling's, 2ν/(ν-1) F(2, ν-1);
    # their sum is taken for a gamma variate of the same mean and variance.
    mean, variance = _hotelling(min(one.scatter_freedom for one in points))
    scale = freedom / count
    p = np.nan
    if np.isfinite(variance):
        n = 0.5 * count
        p = float(special.gammaincc(scale * n * mean**2 / variance, total * mean / variance))
    neighbours, pairs = _neighbours(whitened)
    size = np.sqrt(np.concatenate(squares))
    by_amplitude = rank_trend(np.concatenate(list(motion)), size)
    by_frequency = rank_trend(np.concatenate([one.frequency_hz for one in points]), size)
    return ResponseTests(
        float(np.sqrt(total / freedom)),
        p,
        float(2 * special.ndtr(-abs(neighbours) * np.sqrt(pairs))) if pairs else np.nan,
        neighbours,
        by_amplitude[1],
        by_amplitude[0],
        by_frequency[1],
        by_frequency[0],
    )


def whiten(points: ResponsePoints, residual: Complexes) -> Array:
    """Return residuals as uncorrelated pairs of unit variance by the stated scatter, shape (n, 2)."""
    root = np.linalg.cholesky(points.covariance)
    pair = np.stack([residual.real, residual.imag], axis=1)
    return np.asarray(np.linalg.solve(root, pair[:, :, None])[:, :, 0])


def _hotelling(freedom: float) -> tuple[float, float]:
    """Return mean and variance of the square of a whitened pair."""
    if not np.isfinite(freedom):
        return 2.0, 4.0
    second = freedom - 1.0
    if second <= 4:
        return 2.0, np.inf
    factor = 2.0 * freedom / second
    mean = factor * second / (second - 2)
    return mean, factor**2 * 2 * second**2 * second / (2 * (second - 2) ** 2 * (second - 4))


def _neighbours(whitened: Sequence[Array]) -> tuple[float, int]:
    """Return the correlation of neighbouring pairs and how many products are in it."""
    above = sum(float(np.sum(w[1:] * w[:-1])) for w in whitened)
    below = sum(float(np.sum(w**2)) for w in whitened)
    pairs = sum(2 * max(w.shape[0] - 1, 0) for w in whitened)
    return (above / below if below > 0 else 0.0), pairs


def long_run(scores: Array, sizes: Sequence[int]) -> Array:
    """Return the covariance of the sum of the scores of points (n, m) whose neighbours in a group go together, (m, m).

    Bartlett weights over a sixth of each group (Newey and West, Econometrica 55, 1987). sizes: of the groups.
    """
    total = np.zeros((scores.shape[1], scores.shape[1]))
    for own in np.split(scores, np.cumsum(sizes)[:-1]):
        total += own.T @ own
        lags = own.shape[0] // 6
        for k in range(1, lags + 1):
            lagged = own[:-k].T @ own[k:]
            total += (1 - k / (lags + 1)) * (lagged + lagged.T)
    return total
