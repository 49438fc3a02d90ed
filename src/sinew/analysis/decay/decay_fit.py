"""Least-squares fit of a free decay in the time domain, rest position and all."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import optimize

from sinew.analysis.signal.coloured_noise import orthonormal, sandwich
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import Estimate


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
        return _model(self._scaled(time_s), self.parameters, self.relaxing, self.bending)

    def model_variance(self, time_s: Array) -> Array:
        """Return the variance of `model` from that of the parameters, shape (n,)."""
        jacobian = _jacobian(self._scaled(time_s), self.parameters, self.relaxing, self.bending)
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


def _model(s: Array, p: Array, relaxing: bool, bending: bool) -> Array:
    cosine, sine = _waves(s, p, bending)
    return np.asarray(p[_COS] * cosine + p[_SIN] * sine + _rest(s, p, relaxing), dtype=float)


def _jacobian(s: Array, p: Array, relaxing: bool, bending: bool) -> Array:
    cosine, sine = _waves(s, p, bending)
    wave, turned = p[_COS] * cosine + p[_SIN] * sine, p[_SIN] * cosine - p[_COS] * sine
    columns = [-s * wave, s * turned, cosine, sine, np.ones_like(s), s - 0.5]
    if relaxing:
        rate = float(np.exp(-p[7]))
        fading = np.exp(-s * rate)
        columns += [fading, p[6] * fading * s * rate]
    if bending:
        columns += [-s * s * wave, s * s * turned]
    return np.stack(columns, axis=1)


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
    p[linear] = np.linalg.lstsq(_jacobian(s, p, relaxes, bends)[:, linear], y, rcond=None)[0]

    def deviation(q: Array) -> Array:
        return _model(s, q, relaxes, bends) - y

    def slope(q: Array) -> Array:
        return _jacobian(s, q, relaxes, bends)

    found = optimize.least_squares(
        deviation, p, jac=slope, method="lm", x_scale="jac", ftol=1e-9, xtol=1e-10, max_nfev=60
    )
    covariance, freedom = sandwich(np.asarray(found.jac), np.asarray(found.fun))
    sizes = np.full(p.size, scale)
    sizes[[_RATE, _OMEGA]] = 1.0
    sizes[7 : 7 + relaxes] = 1.0
    if bends:
        sizes[-2:] = 1.0
    return DecayFit(
        float(time_s[0]),
        float(time_s[-1]),
        np.asarray(found.x) * sizes,
        covariance * np.outer(sizes, sizes),
        freedom,
        -np.asarray(found.fun) * scale,
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
    jacobian = _jacobian(s, plain.parameters, plain.relaxing, plain.bending)
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
