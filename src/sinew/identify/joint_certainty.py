"""This is where a joint fit says how certain it is, its residuals not being independent from swing to swing.

The lever's encoder rounds in whole counts. In steady state the same counts come again in every period and in every
repeat, so what rounding does to the fit does not average out as independent noise would. The swings of one setting
(pretension, kind, drive) are therefore taken as one draw, and the covariance is the sandwich clustered by setting. With
A = JᵀJ of all rows and s_c = Jᵀr, G_c = JᵀJ of one setting, the steps d_c that the settings' residuals are worth give

    C = Σ_c d_c d_cᵀ + A⁻¹ P A⁻¹,   d_c = L (1 - L G_c L)^(-1/2) L s_c,   L = A^(-1/2),

P being of the rows whose variance is known: currents, deviations, bounds. The root undoes what the fit has taken from
the residuals: where they are independent draws of variance one, C is A⁻¹ on average (Bell and McCaffrey 2002).
"""

from collections.abc import Hashable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import special

__all__ = ["settled_covariance"]

Array = NDArray[np.float64]

_FEWEST = 4
_NINETY = 1.6448536269514722


def settled_covariance(jacobian: Array, residual: Array, settings: Sequence[tuple[Hashable, slice]]) -> Array:
    """Return the covariance of the coordinates, shape (m, m).

    jacobian: whitened, shape (n, m); residual: shape (n,). settings: of each swing its setting and its rows; rows of no
    swing have a known variance of one.

    The settings' part is widened by Student's factor for their number, so that normal intervals go with the result. No
    standard deviation is smaller than that of independent residuals, (JᵀJ)⁻¹; correlations are those of the latter.
    """
    gram = jacobian.T @ jacobian
    plain = np.linalg.pinv(gram, hermitian=True)
    labels = list(dict.fromkeys(label for label, _ in settings))
    groups = [[rows for label, rows in settings if label == one] for one in labels]
    if len(groups) < _FEWEST:
        groups = [[rows] for _, rows in settings]
    if len(groups) < _FEWEST:
        return np.asarray(plain)
    root = _power(np.asarray(plain), 0.5)
    known = gram.copy()
    moved = []
    for group in groups:
        own = sum((jacobian[rows].T @ jacobian[rows] for rows in group), np.zeros_like(gram))
        score = sum((jacobian[rows].T @ residual[rows] for rows in group), np.zeros(gram.shape[0]))
        known -= own
        moved.append(root @ _power(np.eye(gram.shape[0]) - root @ own @ root, -0.5) @ root @ score)
    steps = float(special.stdtrit(len(groups) - 1, 0.95)) / _NINETY * np.array(moved)
    spread = steps.T @ steps + plain @ known @ plain
    larger = np.sqrt(np.maximum(np.diag(spread) / np.maximum(np.diag(plain), 1e-300), 1.0))
    return np.asarray(plain * np.outer(larger, larger))


def _power(symmetric: Array, exponent: float) -> Array:
    """Return a power of a positive matrix; eigenvalues that rounding has made tiny or negative count as small."""
    values, vectors = np.linalg.eigh(symmetric)
    return np.asarray((vectors * np.maximum(values, 1e-12 * values[-1]) ** exponent) @ vectors.T)
