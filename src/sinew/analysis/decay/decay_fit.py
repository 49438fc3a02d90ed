"""Fits of a free decay in the time domain, rest position and all: by least squares, and by maximum likelihood."""

import math
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import scipy
from scipy import linalg

from sinew.analysis.signal.least_squares import (
    Linearised,
    Model,
    Solution,
    autoregression,
    least_squares,
    orthonormal,
    sandwich,
    unit_columns,
)
from sinew.measure.arrays import Array, Complexes
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import ROUND_OFF, Estimate


def lehr_damping(decay_rate: Any, omega: Any) -> Any:
    """Return Lehr's damping ratio D of a decay (paper Eq. 7), of numbers or arrays.

    decay_rate: λ of the envelope A·exp(-λt) [1/s]. omega: angular frequency of the same decay, hence damped [rad/s].
    Eq. 7 divides by that frequency, we by the undamped one, sqrt(ω² + λ²); both agree within 1 % up to D = 0.14.
    """
    return decay_rate / np.hypot(decay_rate, omega)


def pole_estimates(poles: Array, covariance: Array, freedom: float, clock_std: float = 0.0) -> dict[str, Estimate]:
    """Return frequency_hz, natural_frequency_hz, damping_ratio and decay_rate_per_s from (λ, ω) and their covariance.

    poles: [1/s], shape (2,); covariance: shape (2, 2). clock_std: relative, of the time scale, which D does not feel.
    """
    rate, omega = (float(pole) for pole in poles)
    covariance = covariance + clock_std**2 * np.outer(poles, poles)
    natural, turn = float(np.hypot(rate, omega)), 1.0 / (2.0 * np.pi)

    def estimate(value: float, by_rate: float, by_omega: float) -> Estimate:
        gradient = np.array([by_rate, by_omega])
        variance = max(float(gradient @ covariance @ gradient), 0.0)  # D of a perfect fit: round-off around zero
        return Estimate.student(value, float(np.sqrt(variance)), freedom)

    return {
        "frequency_hz": estimate(omega * turn, 0.0, turn),
        "natural_frequency_hz": estimate(natural * turn, rate / natural * turn, omega / natural * turn),
        "damping_ratio": estimate(float(lehr_damping(rate, omega)), omega**2 / natural**3, -rate * omega / natural**3),
        "decay_rate_per_s": estimate(rate, 1.0, 0.0),
    }


# Places of the parameters in the vector of the fit; time runs from 0 to 1 over the window.
_RATE, _OMEGA, _COS, _SIN, _REST, _SLOPE = range(6)

_TIME_CONSTANTS = (0.08, 0.15, 0.3, 0.6, 1.2)  # of the relaxation, in units of the window
_ASKED = 10.0  # fall of n ln(residual²), beyond 2 ln n, that lets the relaxation in


@dataclass(frozen=True)
class DecayFit:
    """One fit of exp(-λt - λ₂t²) (a cos(ωt + ω₂t²) + b sin(ωt + ω₂t²)) + rest(t), with λ₂ = ω₂ = 0 unless `bending`.

    start_s, stop_s: window of the fit [s]; t counts from start_s in units of the window, T = stop_s - start_s.
    parameters: shape (m,): λT, ωT, a, b, rest at the middle, its change over the window, then (relaxing) size and
        ln(time constant/T) of an exponential relaxation, then (bending) λ₂T², ω₂T².
    covariance: shape (m, m), for coloured noise; degrees_of_freedom: of its scale.
    residual: shape (n,), data minus model, unit of the data.
    """

    start_s: float
    stop_s: float
    parameters: Array
    covariance: Array
    degrees_of_freedom: float
    residual: Array
    relaxing: bool
    bending: bool

    @property
    def window_s(self) -> float:
        """Return the length of the window [s]."""
        return self.stop_s - self.start_s

    @property
    def decay_rate_per_s(self) -> float:
        """Return λ at the start of the window [1/s]."""
        return float(self.parameters[_RATE]) / self.window_s

    def mean_rate_per_s(self) -> tuple[float, float]:
        """Return (mean λ over the window, its standard deviation) [1/s]."""
        gradient = np.zeros(self.parameters.size)
        gradient[_RATE] = 1.0
        if self.bending:
            gradient[-2] = 1.0
        std = float(np.sqrt(max(float(gradient @ self.covariance @ gradient), 0.0)))
        return float(gradient @ self.parameters) / self.window_s, std / self.window_s

    @property
    def bend_per_s2(self) -> tuple[float, float] | None:
        """Return (λ₂, ω₂) [1/s²] of a bent fit, else None."""
        if not self.bending:
            return None
        return float(self.parameters[-2]) / self.window_s**2, float(self.parameters[-1]) / self.window_s**2

    @property
    def omega_rad_s(self) -> float:
        """Return the damped angular frequency at the start of the window [rad/s]."""
        return float(self.parameters[_OMEGA]) / self.window_s

    @property
    def amplitude(self) -> float:
        """Return the amplitude of the oscillation at the start of the window."""
        return float(np.hypot(self.parameters[_COS], self.parameters[_SIN]))

    def pole_covariance(self) -> Array:
        """Return the covariance of (λ, ω) [1/s², 1/s²], shape (2, 2)."""
        return np.asarray(self.covariance[:2, :2] / self.window_s**2, dtype=float)

    def rest(self, time_s: Array) -> Array:
        """Return the rest position at the times, shape (n,)."""
        return _rest(self._scaled(time_s), self.parameters, self.relaxing)

    def model(self, time_s: Array) -> Array:
        """Return the fitted response at the times, shape (n,)."""
        return _linearise(self._scaled(time_s), self.parameters, self.relaxing, self.bending)[0]

    def model_variance(self, time_s: Array) -> Array:
        """Return the variance of `model` from that of the parameters, shape (n,)."""
        jacobian = _linearise(self._scaled(time_s), self.parameters, self.relaxing, self.bending)[1]()
        return np.asarray(np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian), dtype=float)

    def drift(self) -> tuple[float, float]:
        """Return (change of the rest position over the window, its standard deviation)."""
        gradient = np.zeros(self.parameters.size)
        gradient[_SLOPE] = 1.0
        if self.relaxing:
            size, rate = self.parameters[6], float(np.exp(-self.parameters[7]))
            gradient[6] = np.exp(-rate) - 1.0
            gradient[7] = size * rate * np.exp(-rate)
        value = self.rest(np.array([self.stop_s])) - self.rest(np.array([self.start_s]))
        return float(value[0]), float(np.sqrt(max(float(gradient @ self.covariance @ gradient), 0.0)))

    def _scaled(self, time_s: Array) -> Array:
        return np.asarray((time_s - self.start_s) / self.window_s, dtype=float)


def _rest(s: Array, p: Array, relaxing: bool) -> Array:
    level: Array = p[_REST] + p[_SLOPE] * (s - 0.5)
    if relaxing:
        level = level + p[6] * np.exp(-s * np.exp(-p[7]))
    return level


def _waves(s: Array, p: Array, bending: bool) -> tuple[Array, Array]:
    rate, phase = p[_RATE] * s, p[_OMEGA] * s
    if bending:
        rate, phase = rate + p[-2] * s * s, phase + p[-1] * s * s
    size = np.exp(np.clip(-rate, -200.0, 50.0))
    return size * np.cos(phase), size * np.sin(phase)


def _linearise(s: Array, p: Array, relaxing: bool, bending: bool) -> Linearised:
    cosine, sine = _waves(s, p, bending)
    wave = p[_COS] * cosine + p[_SIN] * sine

    def slope() -> Array:
        turned = p[_SIN] * cosine - p[_COS] * sine
        columns = [-s * wave, s * turned, cosine, sine, np.ones_like(s), s - 0.5]
        if relaxing:
            rate = float(np.exp(-p[7]))
            fading = np.exp(-s * rate)
            columns += [fading, p[6] * fading * s * rate]
        if bending:
            columns += [-s * s * wave, s * s * turned]
        return np.stack(columns).T

    return wave + _rest(s, p, relaxing), slope


def fit_decay(
    time_s: Array,
    values: Array,
    guess: tuple[float, float],
    *,
    relaxing: float | None = None,
    bend: tuple[float, float] | None = None,
) -> DecayFit:
    """Return the least-squares fit of a decay to all samples given.

    time_s, values: shape (n,), the free decay alone.
    guess: (λ [1/s], ω [rad/s]) to start from; the rest follows by linear least squares.
    relaxing: with an exponential relaxation of the rest position beside its level and slope, its time constant in
        units of the window to start from.
    bend: (λ₂, ω₂) [1/s²] to start from; lets rate and frequency change with time, a test of the plain exponential.
    Raises RecordingError where there are fewer samples than twice the parameters.
    """
    window = float(time_s[-1] - time_s[0])
    s, scale = (time_s - time_s[0]) / window, float(np.std(values)) or 1.0
    y = values / scale
    relaxes, bends = relaxing is not None, bend is not None
    p = np.zeros(6 + 2 * relaxes + 2 * bends)
    if s.size < 2 * p.size:
        raise RecordingError(
            f"the free decay has {s.size} samples, a fit needs at least {2 * p.size}; sample faster or longer"
        )
    p[_RATE], p[_OMEGA] = guess[0] * window, guess[1] * window
    if relaxing is not None:
        p[6], p[7] = 1.0, np.log(relaxing)
    if bend is not None:
        p[-2:] = bend[0] * window**2, bend[1] * window**2
    linear = [_COS, _SIN, _REST, _SLOPE] + [6] * relaxes
    p[linear] = np.linalg.lstsq(_linearise(s, p, relaxes, bends)[1]()[:, linear], y, rcond=None)[0]

    found = least_squares(lambda q: _linearise(s, q, relaxes, bends), y, p)
    covariance, freedom = sandwich(found.jacobian, found.deviation)
    sizes = np.full(p.size, scale)
    sizes[[_RATE, _OMEGA]] = 1.0
    sizes[7 : 7 + relaxes] = 1.0
    if bends:
        sizes[-2:] = 1.0
    return DecayFit(
        float(time_s[0]),
        float(time_s[-1]),
        found.parameters * sizes,
        covariance * np.outer(sizes, sizes),
        freedom,
        -found.deviation * scale,
        relaxes,
        bends,
    )


def fit_decay_and_rest(time_s: Array, values: Array, guess: tuple[float, float]) -> DecayFit:
    """Return the fit with a level and a slope as rest position, or with a relaxation too where the data ask for it.

    The relaxation stays where it lowers n ln(residual²), n the effective number of samples, by more than 2 ln n + 10,
    and its time constant lies between a twentieth and three times the window. Whether it could is tried first, with
    five time constants in one linear step each.
    """
    plain = fit_decay(time_s, values, guess)
    s = plain._scaled(time_s)
    jacobian = _linearise(s, plain.parameters, plain.relaxing, plain.bending)[1]()
    basis = orthonormal(jacobian)
    before = float(np.sum(plain.residual**2))
    best, start = before, 0.0
    for constant in _TIME_CONSTANTS:
        fading = np.exp(-s / constant)
        fading -= basis @ (basis.T @ fading)
        left = before - float(fading @ plain.residual) ** 2 / float(fading @ fading)
        if left < best:
            best, start = left, constant
    if time_s.size < 24 or best <= 0 or time_s.size * np.log(before / best) < _ASKED:
        return plain
    relaxed = fit_decay(time_s, values, (plain.decay_rate_per_s, plain.omega_rad_s), relaxing=start)
    effective = relaxed.degrees_of_freedom + relaxed.parameters.size
    after = float(np.sum(relaxed.residual**2))
    if after <= 0 or not np.log(0.05) < relaxed.parameters[7] < np.log(3.0):
        return plain
    return relaxed if effective * np.log(before / after) > 2.0 * np.log(effective) + _ASKED else plain


def fit_bent(time_s: Array, values: Array, fit: DecayFit, time_of_peaks_s: Array, size: Array) -> DecayFit:
    """Return the fit whose rate and frequency change linearly with time, started from the peaks.

    time_s, values: shape (n,), what `fit` was fitted to. time_of_peaks_s, size: shape (h,), three or more.
    """
    t, index = time_of_peaks_s - fit.start_s, np.arange(size.size) * np.pi
    degree = 2 if size.size > 3 else 1
    log_size = np.polyfit(t, np.log(size), degree, w=size)
    phase = np.polyfit(t, index, degree, w=size)
    bend = (-float(log_size[0]), float(phase[0])) if degree == 2 else (0.0, 0.0)
    relaxing = float(np.exp(fit.parameters[7])) if fit.relaxing else None
    return fit_decay(time_s, values, (-float(log_size[-2]), float(phase[-2])), relaxing=relaxing, bend=bend)


# A model is fitted by maximum likelihood under noise whose neighbouring samples are alike: oscillation, drifting rest
# position and coloured noise.

_ROUNDS = 6
_SETTLED = 1e-3  # change of the noise's coefficients that ends the rounds


@dataclass(frozen=True)
class LikelihoodFit:
    """Parameters and noise that make the data most likely, for Gaussian autoregressive noise.

    parameters: shape (m,); covariance: shape (m, m), the inverse Fisher information, its scale from the residual.
    degrees_of_freedom: of that scale, for Student's t: effective samples less parameters.
    residual: data less model, shape (n,).
    noise: coefficients a of residual_n = Σ a_k residual_{n-k} + e_n, shape (order,); noise_std: of the residual, unit
        of the data.
    log_likelihood: at the parameters. converged: whether search and noise settled.
    """

    parameters: Array
    covariance: Array
    degrees_of_freedom: float
    residual: Array
    noise: Array
    noise_std: float
    log_likelihood: float
    converged: bool

    @property
    def bic(self) -> float:
        """Return Bayes' information criterion, -2 ln L + k ln n, of model and noise; smaller is better."""
        count = self.parameters.size + self.noise.size + 1
        return -2.0 * self.log_likelihood + count * math.log(self.residual.size)


def fit_likelihood(model: Model, start: Array, data: Array) -> LikelihoodFit:
    """Return the maximum-likelihood fit of a model to data of shape (n,), evenly sampled, from a start of shape (m,).

    Least squares first; its residual tells the noise (Yule-Walker with the fit's share given back, order by Akaike,
    `sinew.analysis.signal.least_squares`). Data and model are then whitened by that noise, the first samples by the
    Cholesky factor of their covariance, so that the likelihood is exact; fit and noise take turns until they agree.
    Noise is called coloured only where Bayes' criterion says so: coefficients of white noise found by chance would,
    where the spectrum happens to dip at the oscillation, promise too much.
    Raises RecordingError where there are fewer samples than twice the parameters.
    """
    if data.size < 2 * start.size:
        raise RecordingError(
            f"{data.size} samples are too few for {start.size} parameters; a fit needs at least {2 * start.size}"
        )
    fit = _settle(model, start, data, coloured=True)
    if fit.noise.size:
        white = _settle(model, fit.parameters, data, coloured=False)
        fit = white if white.bic <= fit.bic else fit
    return fit


def _settle(model: Model, start: Array, data: Array, coloured: bool) -> LikelihoodFit:
    noise, p, settled = np.zeros(0), np.asarray(start, dtype=float), False
    for _ in range(_ROUNDS):
        found = _whitened_fit(model, p, data, noise)
        p = found.parameters
        values, slope = model(p)
        residual, slopes = data - values, slope()
        telling = coloured and float(residual.std()) > ROUND_OFF * float(np.ptp(data))
        after = autoregression(residual, orthonormal(slopes))[0] if telling else np.zeros(0)
        moved = np.zeros(max(after.size, noise.size))
        moved[: after.size] += after
        moved[: noise.size] -= noise
        settled = bool(np.abs(moved).max(initial=0.0) < _SETTLED)
        if settled:
            break
        noise = after
    innovation, whitened = _whiten(residual[:, None], noise)[:, 0], _whiten(slopes, noise)
    return _described_noise(p, residual, innovation, whitened, noise, settled and found.converged)


def _whitened_fit(model: Model, start: Array, data: Array, noise: Array) -> Solution:
    def whitened(p: Array) -> Linearised:
        values, slope = model(p)
        return _whiten((values - data)[:, None], noise)[:, 0], lambda: _whiten(slope(), noise)

    return least_squares(whitened, np.zeros(data.size), start, most=80)


def _whiten(columns: Array, noise: Array) -> Array:
    """Return columns (n, m) filtered so that the noise in them is white and of the innovation's size."""
    order = noise.size
    if order == 0:
        return columns
    out = scipy.signal.lfilter(np.concatenate([[1.0], -noise]), [1.0], columns, axis=0)
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


def _described_noise(
    p: Array, residual: Array, innovation: Array, whitened: Array, noise: Array, converged: bool
) -> LikelihoodFit:
    n, m = whitened.shape
    scaled, scale = unit_columns(whitened)
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
        noise,
        math.sqrt(variance * float(lags[0])),
        likelihood,
        converged,
    )


def _colour(noise: Array) -> float:
    """Return how many samples count as one for the noise's own size, Σ γ²/γ₀² over all lags."""
    if noise.size == 0:
        return 1.0
    spectrum = 1.0 / np.abs(np.fft.fft(np.concatenate([[1.0], -noise]), 4096)) ** 2
    return float(np.mean(spectrum**2) / np.mean(spectrum) ** 2)


_LARGEST = 50.0  # of the exponent: an amplitude of e^50 is no fit


@dataclass(frozen=True)
class FreeOscillation:
    """x(s) = Σ_m Re[exp(S_m) (1 + h₂ exp(S_m) + h₃ exp(2S_m))] + o |exp(2S)| + rest(s), at the samples of one record.

    S_m(s) = Σ_k c_mk B_mk(s) with complex c: real part the logarithm of the amplitude, imaginary part the phase. With
    B = (1, s) that is one damped oscillation, c_1 = -λ + jω; with more functions of s both change with time.
    s: time in units of the window, from 0 to 1, shape (n,).
    bases: B of each mode, shape (n, K_m).
    rest: columns of the rest position, shape (n, R); relaxing: beside them exp(-s exp(-p)) with its size, p the
        logarithm of the time constant in windows.
    harmonics: with h₂, h₃ and o of the first mode, as a swing of quadratic and cubic stiffness has them.

    Parameters, in this order: Re c_mk, Im c_mk in turn, (Re h₂, Im h₂, Re h₃, Im h₃, o), rest, (size, p).
    """

    s: Array
    bases: tuple[Array, ...]
    rest: Array
    relaxing: bool = False
    harmonics: bool = False

    @cached_property
    def _places(self) -> tuple[slice, ...]:
        """Return where the coefficients of each mode lie in the parameters."""
        ends = np.cumsum([0] + [2 * basis.shape[1] for basis in self.bases]).tolist()
        return tuple(slice(*ends) for ends in pairwise(ends))

    def mode(self, m: int) -> slice:
        """Return where the coefficients of a mode lie in the parameters."""
        return self._places[m]

    @cached_property
    def rest_start(self) -> int:
        """Return where the parameters of the rest position begin."""
        return int(self._places[-1].stop) + 5 * self.harmonics

    @cached_property
    def width(self) -> int:
        """Return how many parameters there are."""
        return self.rest_start + int(self.rest.shape[1]) + 2 * self.relaxing

    @cached_property
    def _rows(self) -> list[Array]:
        """Return functions of time and columns of the rest position as rows, whose products stay together in memory."""
        return [np.ascontiguousarray(basis.T) for basis in (*self.bases, self.rest)]

    def exponent(self, p: Array, m: int = 0) -> Complexes:
        """Return S_m at the samples, shape (n,)."""
        both = p[self._places[m]].reshape(-1, 2).T @ self._rows[m]
        exponent = np.empty(self.s.size, dtype=complex)
        exponent.real, exponent.imag = np.minimum(both[0], _LARGEST), both[1]
        return exponent

    def rest_position(self, p: Array) -> Array:
        """Return the rest position at the samples, shape (n,)."""
        first, count = self.rest_start, self.rest.shape[1]
        level = p[first : first + count] @ self._rows[-1]
        if self.relaxing:
            level = level + p[-2] * self.relaxation(p)
        return np.asarray(level, dtype=float)

    def relaxation(self, p: Array) -> Array:
        """Return the relaxation of the rest position for a size of one, shape (n,)."""
        return np.asarray(np.exp(-self.s * self._relaxation_rate(p)))

    def values(self, p: Array) -> Array:
        """Return x at the samples, shape (n,)."""
        return self.linearise(p)[0]

    def jacobian(self, p: Array) -> Array:
        """Return the derivatives of x by the parameters, shape (n, width)."""
        return self.linearise(p)[1]()

    def linearise(self, p: Array) -> Linearised:
        """Return x at the samples, and what gives its derivatives, which begin from the same waves."""
        x = self.rest_position(p)
        waves = [np.exp(self.exponent(p, m)) for m in range(len(self.bases))]
        for m, wave in enumerate(waves):
            if self.harmonics and m == 0:
                h2, h3, offset = self.overtones(p)
                x += offset * (wave.real**2 + wave.imag**2)
                x += (wave**2 * (h2 + h3 * wave)).real
            x += wave.real
        return x, lambda: self._slopes(p, waves)

    def _slopes(self, p: Array, waves: list[Complexes]) -> Array:
        out = np.empty((self.width, self.s.size))
        for m, wave in enumerate(waves):
            by_real = by_imaginary = wave
            if self.harmonics and m == 0:
                h2, h3, offset = self.overtones(p)
                square = wave**2
                cube, power = square * wave, wave.real**2 + wave.imag**2
                by_imaginary = wave + 2.0 * h2 * square + 3.0 * h3 * cube
                by_real = by_imaginary + 2.0 * offset * power
                first = self.rest_start - 5
                out[first : first + 5] = square.real, -square.imag, cube.real, -cube.imag, power
            here = out[self._places[m]]
            np.multiply(by_real.real, self._rows[m], out=here[0::2])
            np.multiply(-by_imaginary.imag, self._rows[m], out=here[1::2])
        first, count = self.rest_start, self.rest.shape[1]
        out[first : first + count] = self._rows[-1]
        if self.relaxing:
            fading = self.relaxation(p)
            out[-2], out[-1] = fading, p[-2] * fading * self.s * self._relaxation_rate(p)
        return out.T

    @staticmethod
    def _relaxation_rate(p: Array) -> float:
        return float(np.exp(np.clip(-p[-1], -_LARGEST, _LARGEST)))

    def overtones(self, p: Array) -> tuple[complex, complex, float]:
        """Return h₂, h₃ and o of a model with harmonics."""
        h = p[self.rest_start - 5 : self.rest_start].tolist()
        return complex(h[0], h[1]), complex(h[2], h[3]), h[4]


def polynomials(s: Array, count: int) -> Array:
    """Return 1, s, s², ..., shape (n, count)."""
    return np.asarray(np.vander(s, count, increasing=True), dtype=float)


def smooth_functions(s: Array, count: int) -> Array:
    """Return `count` B-splines at s, shape (n, count), the knots at even distances from 0 to 1; powers up to four."""
    return polynomials(s, count) if count <= 4 else np.asarray(_splines(count)(np.clip(s, 0.0, 1.0)), dtype=float)


def smooth_slopes(s: Array, count: int) -> Array:
    """Return the derivatives of `smooth_functions` by s, from 0 to 1, shape (n, count)."""
    if count <= 4:
        return np.concatenate([np.zeros((s.size, 1)), polynomials(s, count - 1) * np.arange(1.0, count)], axis=1)
    return np.asarray(_splines(count, 1)(s), dtype=float)


@cache
def _splines(count: int, derivative: int = 0) -> "scipy.interpolate.BSpline":
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, count - 2), np.ones(3)])
    return scipy.interpolate.BSpline(knots, np.eye(count), 3).derivative(derivative)


def fit_oscillation(model: FreeOscillation, starts: list[Array], values: Array) -> LikelihoodFit:
    """Return the likeliest fit of a model to its samples, shape (n,), over the starts.

    starts: shape (model.width,) each, of which the rest position and the size of a relaxation are found here, by
    linear least squares.
    """
    fits = [fit_likelihood(model.linearise, with_rest(model, start, values), values) for start in starts]
    return min(fits, key=lambda fit: fit.bic)


def with_rest(model: FreeOscillation, start: Array, values: Array) -> Array:
    """Return a start, shape (model.width,), whose rest position and size of a relaxation fit the samples best."""
    p = np.array(start, dtype=float)
    linear = np.arange(model.rest_start, model.rest_start + model.rest.shape[1] + model.relaxing)
    p[linear] = 0.0
    columns = [model.rest] + [model.relaxation(p)[:, None]] * model.relaxing
    p[linear] = np.linalg.lstsq(np.concatenate(columns, axis=1), values - model.values(p), rcond=None)[0]
    return p
