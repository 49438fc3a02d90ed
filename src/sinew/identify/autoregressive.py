"""This is where a model is fitted by maximum likelihood under noise whose neighbouring samples are alike."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize, signal, special

from sinew.analysis.coloured_noise import autoregression
from sinew.measure.errors import RecordingError

__all__ = ["LikelihoodFit", "Model", "fit_likelihood"]

Array = NDArray[np.float64]
Model = Callable[[Array], Array]

_ROUNDS = 6
_SETTLED = 1e-3  # change of the noise's coefficients that ends the rounds
_PERFECT = 1e-12  # of the data: a residual this small is round-off, not noise


@dataclass(frozen=True)
class LikelihoodFit:
    """Parameters and noise that make the data most likely, for Gaussian autoregressive noise.

    parameters: shape (m,); covariance: shape (m, m), the inverse Fisher information, its scale from the residual.
    degrees_of_freedom: of that scale, for Student's t: effective samples less parameters.
    residual: data less model, shape (n,); innovation: the same whitened, shape (n,).
    noise: coefficients a of residual_n = Σ a_k residual_{n-k} + e_n, shape (order,); noise_std, innovation_std: of the
        residual and of e, unit of the data.
    log_likelihood: at the parameters. converged: whether search and noise settled.
    """

    parameters: Array
    covariance: Array
    degrees_of_freedom: float
    residual: Array
    innovation: Array
    noise: Array
    noise_std: float
    innovation_std: float
    log_likelihood: float
    converged: bool

    @property
    def bic(self) -> float:
        """Return Bayes' information criterion, -2 ln L + k ln n, of model and noise; smaller is better."""
        count = self.parameters.size + self.noise.size + 1
        return -2.0 * self.log_likelihood + count * math.log(self.residual.size)

    @property
    def aic(self) -> float:
        """Return Akaike's criterion with Hurvich and Tsai's correction for few samples; smaller is better."""
        n, count = self.residual.size, self.parameters.size + self.noise.size + 1
        return -2.0 * self.log_likelihood + 2.0 * count * n / max(n - count - 1.0, 1.0)

    def whiteness(self) -> float:
        """Return the p value of Ljung and Box's test that the innovation is white, over up to 20 lags."""
        n, e = self.innovation.size, self.innovation - self.innovation.mean()
        lags = min(20, n // 5)
        power = float(e @ e)
        if power <= 0 or lags <= self.noise.size:
            return 1.0
        r = np.array([float(e[: n - k] @ e[k:]) / power for k in range(1, lags + 1)])
        statistic = n * (n + 2.0) * float(np.sum(r**2 / (n - np.arange(1, lags + 1))))
        return float(special.gammaincc(0.5 * (lags - self.noise.size), 0.5 * statistic))


def fit_likelihood(values: Model, jacobian: Model, start: Array, data: Array) -> LikelihoodFit:
    """Return the maximum-likelihood fit of values(p) to data of shape (n,), evenly sampled, from a start of shape (m,).

    values, jacobian: take p, return shape (n,) and (n, m).

    Least squares first; its residual tells the noise (Yule-Walker with the fit's share given back, order by Akaike,
    `sinew.analysis.coloured_noise`). Data and model are then whitened by that noise, the first samples by the Cholesky
    factor of their covariance, so that the likelihood is exact; fit and noise take turns until they agree. Noise is
    called coloured only where Bayes' criterion says so: coefficients of white noise found by chance would, where the
    spectrum happens to dip at the oscillation, promise too much.
    Raises RecordingError where there are fewer samples than twice the parameters.
    """
    if data.size < 2 * start.size:
        raise RecordingError(
            f"{data.size} samples are too few for {start.size} parameters; a fit needs at least {2 * start.size}"
        )
    fit = _settle(values, jacobian, start, data, coloured=True)
    if fit.noise.size:
        white = _settle(values, jacobian, fit.parameters, data, coloured=False)
        fit = white if white.bic <= fit.bic else fit
    return fit


def _settle(values: Model, jacobian: Model, start: Array, data: Array, coloured: bool) -> LikelihoodFit:
    noise, p, settled = np.zeros(0), np.asarray(start, dtype=float), False
    for _ in range(_ROUNDS):
        found = _whitened_fit(values, jacobian, p, data, noise)
        p = np.asarray(found.x, dtype=float)
        residual, slopes = data - values(p), jacobian(p)
        telling = coloured and float(residual.std()) > _PERFECT * float(np.ptp(data))
        after = autoregression(residual, slopes)[0] if telling else np.zeros(0)
        moved = np.zeros(max(after.size, noise.size))
        moved[: after.size] += after
        moved[: noise.size] -= noise
        settled = bool(np.abs(moved).max(initial=0.0) < _SETTLED)
        if settled:
            break
        noise = after
    innovation, whitened = _whiten(residual[:, None], noise)[:, 0], _whiten(slopes, noise)
    return _described(p, residual, innovation, whitened, noise, settled and bool(found.success))


def _whitened_fit(values: Model, jacobian: Model, start: Array, data: Array, noise: Array) -> optimize.OptimizeResult:
    def deviation(p: Array) -> Array:
        off = _whiten((values(p) - data)[:, None], noise)[:, 0]
        return np.nan_to_num(off, nan=1e150, posinf=1e150, neginf=-1e150)

    def slope(p: Array) -> Array:
        return np.nan_to_num(_whiten(jacobian(p), noise), nan=0.0, posinf=0.0, neginf=0.0)

    return optimize.least_squares(
        deviation, start, jac=slope, method="lm", x_scale="jac", ftol=1e-9, xtol=1e-9, max_nfev=80
    )


def _whiten(columns: Array, noise: Array) -> Array:
    """Return columns (n, m) filtered so that the noise in them is white and of the innovation's size."""
    order = noise.size
    if order == 0:
        return columns
    out = signal.lfilter(np.concatenate([[1.0], -noise]), [1.0], columns, axis=0)
    root = linalg.cholesky(linalg.toeplitz(_autocovariance(noise)), lower=True)
    out[:order] = linalg.solve_triangular(root, columns[:order], lower=True)
    return np.asarray(out, dtype=float)


def _autocovariance(noise: Array) -> Array:
    """Return the autocovariance of the process at lags 0 to order - 1 for innovations of variance one."""
    order = noise.size
    system, target = np.eye(order + 1), np.zeros(order + 1)
    target[0] = 1.0
    for lag in range(order + 1):
        for k in range(1, order + 1):
            system[lag, abs(lag - k)] -= noise[k - 1]
    return np.asarray(np.linalg.solve(system, target)[:order], dtype=float)


def _described(
    p: Array, residual: Array, innovation: Array, whitened: Array, noise: Array, converged: bool
) -> LikelihoodFit:
    n, m = whitened.shape
    scale = np.linalg.norm(whitened, axis=0)
    scale[scale == 0] = 1.0
    scaled = whitened / scale
    inverse = np.linalg.pinv(scaled.T @ scaled, hermitian=True) / np.outer(scale, scale)
    power = float(innovation @ innovation)
    lags = _autocovariance(noise) if noise.size else np.ones(1)
    variance = power / max(n - m - noise.size, 1)
    determinant = float(np.linalg.slogdet(linalg.toeplitz(lags))[1]) if noise.size else 0.0
    spread = power / n if power > 0 else np.finfo(float).tiny
    likelihood = -0.5 * n * (math.log(2.0 * math.pi * spread) + 1.0) - 0.5 * determinant
    freedom = max(n / _colour(noise) - m, 1.0)
    return LikelihoodFit(
        p,
        np.asarray(variance * inverse, dtype=float),
        freedom,
        residual,
        innovation,
        noise,
        math.sqrt(variance * float(lags[0])),
        math.sqrt(variance),
        likelihood,
        converged,
    )


def _colour(noise: Array) -> float:
    """Return how many samples count as one for the noise's own size, Σ γ²/γ₀² over all lags."""
    if noise.size == 0:
        return 1.0
    spectrum = 1.0 / np.abs(np.fft.fft(np.concatenate([[1.0], -noise]), 4096)) ** 2
    return float(np.mean(spectrum**2) / np.mean(spectrum) ** 2)
