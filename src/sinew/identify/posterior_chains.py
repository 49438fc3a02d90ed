"""This is where chains of draws say whether they agree and how many independent draws they are worth.

Both figures are those of Vehtari, Gelman, Simpson, Carpenter and Bürkner (Bayesian Analysis 16, 2021): chains are split
in half, draws replaced by the normal scores of their ranks, so that heavy tails and skewness do no harm.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import fft, special, stats

__all__ = ["effective_number", "split_r_hat"]

Array = NDArray[np.float64]


def split_r_hat(draws: Array) -> float:
    """Return the larger of the split R-hat of the ranks and of the ranks of the distance from the median.

    draws: shape (chain, draw). Infinite where chains stand still at different places, NaN where draws are not finite.
    """
    if not np.isfinite(draws).all():
        return float("nan")
    halves = _halves(draws)
    return max(_r_hat(_scores(halves)), _r_hat(_scores(np.abs(halves - np.median(halves)))))


def effective_number(draws: Array) -> float:
    """Return the bulk effective number of draws; draws: shape (chain, draw). NaN where draws are not finite."""
    if not np.isfinite(draws).all():
        return float("nan")
    scores = _scores(_halves(draws))
    chains, n = scores.shape
    within, pooled = _variances(scores)
    if not pooled > 0:
        return float("nan")
    centred = scores - scores.mean(axis=1, keepdims=True)
    waves = fft.rfft(centred, 2 * fft.next_fast_len(n), axis=1)
    lagged = fft.irfft(np.abs(waves) ** 2, axis=1)[:, :n].mean(axis=0) / n
    rho = 1.0 - (within - lagged * n / (n - 1)) / pooled
    rho[0] = 1.0
    pairs = rho[: 2 * (n // 2)].reshape(-1, 2).sum(axis=1)  # Geyer: sums of neighbours are positive and fall
    negative = np.flatnonzero(pairs < 0)
    pairs = np.minimum.accumulate(pairs[: negative[0] if negative.size else pairs.size])
    time = max(-1.0 + 2.0 * float(pairs.sum()), 1.0 / np.log10(chains * n))
    return float(chains * n / time)


def _halves(draws: Array) -> Array:
    half = draws.shape[1] // 2
    return np.concatenate([draws[:, :half], draws[:, -half:]])


def _scores(draws: Array) -> Array:
    ranks = stats.rankdata(draws).reshape(draws.shape)
    return np.asarray(special.ndtri((ranks - 0.375) / (draws.size + 0.25)), dtype=float)


def _variances(scores: Array) -> tuple[float, float]:
    n = scores.shape[1]
    within = float(np.mean(np.var(scores, axis=1, ddof=1)))
    return within, within * (n - 1) / n + float(np.var(scores.mean(axis=1), ddof=1))


def _r_hat(scores: Array) -> float:
    within, pooled = _variances(scores)
    return float(np.sqrt(pooled / within)) if within > 0 else float("inf")
