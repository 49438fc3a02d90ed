"""This is where the mean over strides in a row gets its uncertainty, though neighbours resemble each other.

A stride's length and size carry over to the next. With few strides their likeness cannot be told from the record, and
taking them as independent gives intervals that are too short. So the mean is taken under every first-order likeness
from 0 to 0.9, each weighed by how well the strides speak for it (Bayes, flat in likeness, mean and log scale).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import stdtr

from sinew.measure.estimate import Estimate

__all__ = ["mean_of_strides"]

Floats = NDArray[np.float64]

_MOST_ALIKE, _GRID = 0.9, 46
_FEWEST = 4


def mean_of_strides(values: Floats) -> Estimate:
    """Return the mean of what strides in a row tell, shape (s,), with its standard deviation and 90 % interval.

    Under the likeness ρ the covariance is σ²R, R_ij = ρ^|i-j|, the variance of the plain mean is σ² 1ᵀR1/s², and σ² is
    known with s - 1 degrees of freedom. The result is the mixture over ρ of these Student distributions. Fewer than
    four values give their mean without an uncertainty.
    """
    n = values.size
    plain = float(values.mean())
    spread = float(values.std())
    if n < _FEWEST:
        return Estimate(plain, np.nan, np.nan, np.nan)
    if not spread > 1e-12 * abs(plain):
        return Estimate(plain, 0.0, plain, plain)
    x = (values - plain) / spread
    likeness = np.linspace(0.0, _MOST_ALIKE, _GRID)
    # R⁻¹ is tridiagonal: vᵀR⁻¹v = v₁² + Σ (v_i - ρ v_{i-1})² / (1 - ρ²), and |R| = (1 - ρ²)^(n-1).
    left = 1 - likeness**2
    information = 1 + (n - 1) * (1 - likeness) ** 2 / left
    middle = (x[0] + (1 - likeness) * np.sum(x[1:, None] - likeness * x[:-1, None], axis=0) / left) / information
    off = x[:, None] - middle
    squares = off[0] ** 2 + np.sum((off[1:] - likeness * off[:-1]) ** 2, axis=0) / left
    log_weight = -0.5 * ((n - 1) * np.log(left) + np.log(information) + (n - 1) * np.log(squares))
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    lag = np.arange(1, n)
    alike = (n + 2 * (n - lag) @ likeness ** lag[:, None]) / n**2
    scale = np.sqrt(alike * squares / (n - 1))
    std = float(np.sqrt(weight @ scale**2 * (n - 1) / (n - 3)))
    half = float(brentq(lambda z: float(weight @ stdtr(n - 1, z / scale)) - 0.95, 0.0, 50.0 * float(scale.max())))
    return Estimate(plain, spread * std, plain - spread * half, plain + spread * half)
