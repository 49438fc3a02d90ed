"""How certain a least-squares solution is, and what it cannot tell apart.

Three covariances of the parameters, J being the Jacobian (n, m) and r the residuals at the solution:

- classical, s² (JᵀJ)⁻¹ with s² = rᵀr/(n - m): right for independent residuals of one size;
- coloured, (JᵀJ)⁻¹ JᵀΓJ (JᵀJ)⁻¹ with Γ the autocovariance of an autoregression through the residuals (see
  `sinew.analysis.signal.coloured_noise`): for residuals that are correlated from sample to sample;
- HAC, the same sandwich with the scores' own autocovariance, Σ_k w_k Σ_n J_n r_n r_{n+k} J_{n+k}ᵀ, Bartlett weights
  (Newey and West 1987): for residuals that also change in size. It needs many samples.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sinew.analysis.signal.coloured_noise import sandwich
from sinew.measure.arrays import Array
from sinew.measure.estimate import Estimate

CovarianceKind = Literal["classical", "coloured", "hac"]

_UNCERTAIN = 0.5  # natural scales: a direction whose standard deviation is larger is not determined
_TAKES_PART = 0.25  # of the largest component of such a direction


@dataclass(frozen=True)
class Covariance:
    """Covariance of parameters, shape (m, m), and the degrees of freedom behind its scale."""

    matrix: Array
    degrees_of_freedom: float

    @property
    def std(self) -> Array:
        """Return the standard deviations, shape (m,)."""
        return np.sqrt(np.maximum(np.diag(self.matrix), 0.0))


def covariance(
    jacobian: Array, residual: Array, kind: CovarianceKind = "classical", *, pieces: Sequence[slice] = ()
) -> Covariance:
    """Return the covariance of parameters that a least-squares fit left with this Jacobian and these residuals.

    jacobian: shape (n, m); residual: shape (n,), in time order and, for `coloured`, evenly sampled.
    pieces: stretches of the residuals that are recordings of their own; the default is one.
    A direction that the Jacobian does not see at all has an infinite variance.
    """
    n, m = jacobian.shape
    scale = np.linalg.norm(jacobian, axis=0)
    seen = scale > 0
    matrix = np.zeros((m, m))
    matrix[~seen, ~seen] = np.inf
    if not seen.any():
        return Covariance(matrix, max(n - m, 1))
    scaled = jacobian[:, seen] / scale[seen]
    bread = _inverse_gram(scaled)
    freedom = float(max(n - m, 1))
    if kind == "classical":
        inner = float(residual @ residual) / freedom * bread
    elif kind == "hac":
        inner = bread @ _scores(scaled * residual[:, None], pieces) * (n / freedom) @ bread
    else:
        filling, freedom = np.zeros_like(bread), 0.0
        for piece in pieces or (slice(0, n),):
            own = scaled[piece]
            part, of_part = sandwich(own, residual[piece])
            gram = own.T @ own
            filling += gram @ part @ gram
            freedom += of_part + own.shape[1]
        inner = bread @ filling @ bread
        freedom = max(freedom - m, 1.0)
    matrix[np.ix_(seen, seen)] = inner / np.outer(scale[seen], scale[seen])
    return Covariance(matrix, freedom)


def _inverse_gram(scaled: Array) -> Array:
    """Return (JᵀJ)⁻¹ by singular values; by the Gram matrix half of the digits would be lost."""
    _, size, turned = np.linalg.svd(scaled, full_matrices=False)
    kept = size > 1e-14 * size[0]
    return np.asarray((turned[kept].T / size[kept] ** 2) @ turned[kept])


def _scores(scores: Array, pieces: Sequence[slice]) -> Array:
    """Return the long-run covariance of the scores J_n r_n, Newey-West with Andrews' (1991) bandwidth for AR(1)."""
    total = np.zeros((scores.shape[1], scores.shape[1]))
    for piece in pieces or (slice(0, scores.shape[0]),):
        own = scores[piece]
        rho = np.clip(np.sum(own[1:] * own[:-1], axis=0) / np.maximum(np.sum(own**2, axis=0), 1e-300), -0.97, 0.97)
        alpha = float(np.max(4 * rho**2 / (1 - rho**2) ** 2))
        lags = min(int(1.1447 * (alpha * own.shape[0]) ** (1 / 3)), own.shape[0] // 4)
        total += long_run(own, lags)
    return total


def long_run(scores: Array, lags: int) -> Array:
    """Return the covariance of the sum of scores (n, m) whose neighbours go together, with Bartlett's weights, (m, m).

    Newey and West, Econometrica 55, 1987.
    """
    total = np.asarray(scores.T @ scores)
    for k in range(1, lags + 1):
        lagged = scores[:-k].T @ scores[k:]
        total += (1 - k / (lags + 1)) * (lagged + lagged.T)
    return total


def correlation(matrix: Array) -> Array:
    """Return the correlation matrix of a covariance matrix, shape (m, m); NaN where a variance is zero or infinite."""
    std = np.sqrt(np.diag(matrix))
    good = np.isfinite(std) & (std > 0)
    found = np.full(matrix.shape, np.nan)
    found[np.ix_(good, good)] = np.clip(matrix[np.ix_(good, good)] / np.outer(std[good], std[good]), -1.0, 1.0)
    return found


def estimates(values: Array, certainty: Covariance) -> list[Estimate]:
    """Return one estimate for each parameter, 90 % intervals of Student; std NaN where the variance is infinite."""
    found = []
    for value, std in zip(values, certainty.std, strict=True):
        known = float(std) if np.isfinite(std) else np.nan
        found.append(Estimate.student(float(value), known, certainty.degrees_of_freedom))
    return found


def find_unidentifiable(names: Sequence[str], natural: Array, jacobian: Array, noise: float) -> tuple[str, ...]:
    """Return one sentence for each direction of the parameters that the record does not determine.

    names: what people call the parameters, m of them. natural: for each the size of a change that matters, shape (m,).
    jacobian: shape (n, m). noise: standard deviation of one residual, times the square root of the number of samples
        that share one independent draw where the residuals are correlated.

    In parameters measured in their natural scales, the eigenvectors of JᵀJ with noise²/eigenvalue > 0.5² are the
    directions along which the fit could move by half a natural scale and nobody would notice.
    """
    _, size, turned = np.linalg.svd(jacobian * natural, full_matrices=False)
    sentences = []
    for s, direction in zip(size[::-1], turned[::-1], strict=True):
        if s > 0 and noise / s <= _UNCERTAIN and s > 1e-13 * size[0]:
            break
        part = np.abs(direction) > _TAKES_PART * np.abs(direction).max()
        taking = sorted(name for name, takes in zip(names, part, strict=True) if takes)
        sentences.append(
            f"{taking[0]} cannot be determined from this record"
            if len(taking) == 1
            else f"{', '.join(taking[:-1])} and {taking[-1]} cannot be told apart in this record"
        )
    return tuple(sentences)
