"""Natural frequencies and damping ratios with intervals, of a frequency response with errors."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import linalg

from sinew.analysis.signal.least_squares import solve_scaled, unit_columns
from sinew.measure.arrays import Array, Complexes
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import Estimate
from sinew.measure.result import Field, Result

_RELOCATIONS = 30
_NARROW = 4.0  # bins: a resonance less wide is smeared by the window of its spectra
_MISFIT = 1.5  # times the stated noise: more is not chance but another shape


@dataclass(frozen=True, repr=False)
class SpectrumMode(Result):
    """A mode of a frequency response, by its pole s = ω_n(-ζ ± j sqrt(1 - ζ²)); natural: undamped."""

    natural_frequency_hz: Annotated[Estimate, Field("natural frequency", "interval")]
    damping_ratio: Annotated[Estimate, Field("damping ratio", "interval")]


@dataclass(frozen=True)
class PoleFit:
    """A response as a sum of modes, H = c + Σ r/(s - p) + q/(s - p*) with s = j f/centre_hz.

    modes: by rising frequency. covariance: of (f_1 [Hz], ζ_1, f_2, ...), shape (2m, 2m); degrees_of_freedom: of the
    intervals. parameters: f_1/centre, ζ_1, ..., then real and imaginary parts of r_1, q_1, ..., c.
    misfit: root mean square of the residual in stated standard deviations; message: what to beware of, or empty.
    decay_per_s: of the exponential window under which the points were measured, zero without one.
    """

    modes: tuple[SpectrumMode, ...]
    covariance: Array
    degrees_of_freedom: float
    misfit: float
    message: str
    centre_hz: float
    parameters: Array
    decay_per_s: float = 0.0

    def response(self, frequency_hz: Array) -> Complexes:
        """Return the fitted response at the frequencies, shape (f,), as the points' own window has it."""
        s = _laplace(np.asarray(frequency_hz, dtype=float), self.decay_per_s, self.centre_hz)
        count = len(self.modes)
        linear = self.parameters[2 * count :]
        return np.asarray(_basis(s, self.parameters[: 2 * count], np.ones(1)) @ (linear[0::2] + 1j * linear[1::2]))


@dataclass(frozen=True)
class LineErrors:
    """How the errors of lines belong together, where more is known of them than a correlation by distance.

    scores: from the weighted columns of the relative model, complex (f, m), and the weights of the relative residual,
    (f,), to the covariance of the scores, Re Σ conj(column) residual, shape (m, m).
    alike: how many lines share one independent error.
    """

    scores: Callable[[Complexes, Array], Array]
    alike: float


def _laplace(frequency_hz: Array, decay_per_s: float, centre_hz: float) -> Complexes:
    """Return s over the centre: under a window exp(-σt) on both signals a response is that of σ + jω."""
    return np.asarray((1j * frequency_hz + decay_per_s / (2.0 * math.pi)) / centre_hz)


def _pole(natural: Array, damping: Array) -> Complexes:
    """Return the poles; beyond critical damping both are real, and the first is the slower."""
    return np.asarray(natural * (-damping + 1j * np.sqrt((1.0 - damping**2).astype(complex))))


def _basis(s: Complexes, shape: Array, lag_window: Array, slope: bool = False) -> Complexes:
    """Return 1/(s - p) and 1/(s - p*) of each mode in turn, then ones, shape (f, 2m + 1); with `slope` d/dp of them.

    lag_window: α_k ω_cᵏ of A(τ) = Σ α_k τᵏ; exp(pτ) A(τ) has the transform Σ α_k k!/(s - p)ᵏ⁺¹.
    """
    pole = _pole(shape[0::2], shape[1::2])
    inverse = 1.0 / np.stack([s[:, None] - pole, s[:, None] - np.conj(pole)], axis=2).reshape(s.size, -1)
    columns = np.zeros_like(inverse)
    for k, alpha in enumerate(lag_window):
        factor = alpha * math.factorial(k + slope)
        columns += factor * inverse ** (k + 1 + slope)
    return np.concatenate([columns, np.full((s.size, 1), 0.0 if slope else 1.0)], axis=1)


@dataclass(frozen=True)
class _Points:
    """The response at s = j f/centre with weights of its relative residual, shape (f,)."""

    s: Complexes
    response: Complexes
    weight: Array
    lag_window: Array

    def basis(self, shape: Array) -> Complexes:
        return _basis(self.s, shape, self.lag_window)

    def weighted(self, values: Complexes) -> Array:
        """Return complex columns (f, k) as real ones (2f, k)."""
        relative = self.weight[:, None] * (values / self.response[:, None])
        return np.concatenate([relative.real, relative.imag])

    def real_columns(self, basis: Complexes) -> Array:
        """Return the weighted columns of the real and the imaginary part of each coefficient in turn, (2f, 2k)."""
        return self.weighted(np.stack([basis, 1j * basis], axis=2).reshape(basis.shape[0], -1))

    @property
    def target(self) -> Array:
        return self.weighted(self.response[:, None])[:, 0]


def fit_poles(
    frequency_hz: Array,
    response: Complexes,
    relative_std: Array,
    *,
    modes: int = 1,
    bin_correlation: Array | None = None,
    lag_window: Array | None = None,
    decay_per_s: float = 0.0,
    errors: LineErrors | None = None,
) -> PoleFit:
    """Return the weighted least-squares fit of `modes` modes to complex points, all arguments of shape (f,).

    relative_std: standard deviation of the response's size, relative, and of its angle [rad].
    bin_correlation: of errors 0, 1, 2, ... points apart (`FrequencyResponse`); None where they are independent.
    lag_window: α of what segments do to the impulse response (`FrequencyResponse`); None where the points are steady
        responses. It undoes the smearing of a resonance some bins wide, which makes D too large.
    decay_per_s: σ of a window exp(-σt) on drive and response, which adds σ to every decay; the poles are without it.
    errors: how the points' errors belong together, instead of bin_correlation.

    Residues and the constant are free complex numbers, so any output by any input will do, with a constant delay too;
    for one mode this is the curve of `sinew.analysis.sweep.resonance`. Start: vector fitting (Gustavsen and Semlyen,
    IEEE Trans. Power Delivery 14, 1999); then Levenberg-Marquardt on the weighted residual. The covariance is the
    sandwich for correlated bins, times the squared misfit where that exceeds one.
    Raises RecordingError where there are too few points, or no such fit.
    """
    known = np.isfinite(response) & np.isfinite(relative_std) & (np.abs(response) > 0)
    f, std = np.asarray(frequency_hz[known], dtype=float), relative_std[known]
    if f.size < 3 * modes + 2:
        what = "one mode" if modes == 1 else f"{modes} modes"
        raise RecordingError(
            f"too few frequencies for {what}: found {f.size}, expected at least {3 * modes + 2}; measure more"
        )
    centre = float(0.5 * (f[0] + f[-1]))
    powers = np.ones(1) if lag_window is None else lag_window / (2.0 * np.pi * centre) ** np.arange(lag_window.size)
    weight = 1.0 / np.maximum(std, max(1e-3 * float(np.median(std)), 1e-12))
    points = _Points(_laplace(f, decay_per_s, centre), np.asarray(response[known], dtype=complex), weight, powers)

    found = scipy.optimize.least_squares(
        _residual,
        _relocated(points, modes),
        jac=_jacobian,
        method="lm",
        x_scale="jac",
        max_nfev=200,
        args=(points, modes),
    )
    order = np.argsort(np.abs(found.x[0 : 2 * modes : 2]))
    parameters = _sorted(np.asarray(found.x), order)
    natural, damping = parameters[0 : 2 * modes : 2], parameters[1 : 2 * modes : 2]
    if not found.success or not np.isfinite(parameters).all() or (damping <= 0).any() or (damping >= 1).any():
        raise RecordingError(
            f"no {modes} damped modes fit the response between {f[0]:g} and {f[-1]:g} Hz; choose the band around the "
            "resonance, or another number of modes"
        )
    covariance, freedom, misfit = _covariance(parameters, points, modes, bin_correlation, errors)
    scale = np.tile([centre, 1.0], modes)
    covariance = covariance[: 2 * modes, : 2 * modes] * np.outer(scale, scale)
    std = np.sqrt(np.diag(covariance))
    found_modes = tuple(
        SpectrumMode(
            Estimate.student(float(natural[m]) * centre, float(std[2 * m]), freedom),
            Estimate.student(float(damping[m]), float(std[2 * m + 1]), freedom),
        )
        for m in range(modes)
    )
    is_smeared = lag_window is not None and bool(lag_window[1:].any())
    message = _warning(natural * centre, damping, f, misfit, is_smeared)
    return PoleFit(found_modes, covariance, freedom, misfit, message, centre, parameters, decay_per_s)


def _relocated(points: _Points, modes: int) -> Array:
    """Return the parameters that vector fitting ends at, poles moved to the zeros of its scaling function."""
    u = points.s.imag
    span = float(u[-1] - u[0])
    pole = 1j * np.linspace(u[0] + span / (2 * modes), u[-1] - span / (2 * modes), modes) - 0.02 * span
    for _ in range(_RELOCATIONS):
        ones = np.ones((u.size, 1))
        near, far = 1.0 / (points.s[:, None] - pole), 1.0 / (points.s[:, None] - np.conj(pole))
        paired = np.stack([near + far, 1j * (near - far)], axis=2).reshape(u.size, -1)
        own = points.real_columns(np.concatenate([near, far, ones], axis=1))
        design = np.concatenate([own, points.weighted(-points.response[:, None] * paired)], axis=1)
        scaling = solve_scaled(design, points.target)[-2 * modes :]
        moved = linalg.block_diag(*[np.array([[p.real, p.imag], [-p.imag, p.real]]) for p in pole])
        zeros = np.linalg.eigvals(moved - np.outer(np.tile([2.0, 0.0], modes), scaling))
        upper = zeros[np.argsort(-zeros.imag)][:modes]
        pole = -np.abs(upper.real) + 1j * np.maximum(np.abs(upper.imag), 1e-6)
    shape = np.stack([np.abs(pole), -pole.real / np.abs(pole)], axis=1).ravel()
    return np.concatenate([shape, solve_scaled(points.real_columns(points.basis(shape)), points.target)])


def _residual(parameters: Array, points: _Points, modes: int) -> Array:
    linear = parameters[2 * modes :]
    model = points.basis(parameters[: 2 * modes]) @ (linear[0::2] + 1j * linear[1::2])
    return points.weighted((model - points.response)[:, None])[:, 0]


def _jacobian(parameters: Array, points: _Points, modes: int) -> Array:
    shape, linear = parameters[: 2 * modes], parameters[2 * modes :]
    coefficients = linear[0::2] + 1j * linear[1::2]
    basis, slopes = points.basis(shape), _basis(points.s, shape, points.lag_window, slope=True)
    natural, damping = shape[0::2], shape[1::2]
    pole = _pole(natural, damping)
    turn = natural * (-1.0 - 1j * damping / np.sqrt((1.0 - damping**2).astype(complex)))
    columns = []
    for m in range(modes):
        near, far = (coefficients[k] * slopes[:, k] for k in (2 * m, 2 * m + 1))
        for slope in (pole[m] / natural[m], turn[m]):
            columns.append(near * slope + far * np.conj(slope))
    return np.concatenate([points.weighted(np.stack(columns, axis=1)), points.real_columns(basis)], axis=1)


def _covariance(
    parameters: Array, points: _Points, modes: int, bin_correlation: Array | None, errors: LineErrors | None
) -> tuple[Array, float, float]:
    """Return (covariance, degrees of freedom, misfit), the sandwich where the errors of lines are correlated."""
    jacobian, residual = _jacobian(parameters, points, modes), _residual(parameters, points, modes)
    (scaled, scale), count = unit_columns(jacobian), points.s.size
    inverse = np.linalg.pinv(scaled.T @ scaled, hermitian=True)
    lags = np.ones(1) if bin_correlation is None else np.asarray(bin_correlation)[:count]
    middle, alike = scaled.T @ scaled, float(1.0 + 2.0 * np.sum(lags[1:] ** 2))
    for k, correlation in enumerate(lags[1:], start=1):
        for half in (scaled[:count], scaled[count:]):
            lagged = half[k:].T @ half[:-k]
            middle = middle + correlation * (lagged + lagged.T)
    if errors is not None:
        middle, alike = errors.scores(scaled[:count] + 1j * scaled[count:], points.weight), errors.alike
    effective = 2.0 * count / alike
    freedom = max(effective - parameters.size, 1.0)
    misfit = math.sqrt(float(residual @ residual) / max(2 * count - parameters.size, 1))
    covariance = inverse @ middle @ inverse * max(misfit, 1.0) ** 2
    return np.asarray(covariance / np.outer(scale, scale), dtype=float), freedom, misfit


def _sorted(parameters: Array, order: NDArray[np.intp]) -> Array:
    modes = order.size
    shape = parameters[: 2 * modes].reshape(modes, 2)[order]
    linear = parameters[2 * modes : -2].reshape(modes, 4)[order]
    return np.concatenate([shape.ravel(), linear.ravel(), parameters[-2:]])


def _warning(natural_hz: Array, damping: Array, f: Array, misfit: float, is_smeared: bool) -> str:
    said = []
    if misfit > _MISFIT:
        said.append(f"the modes miss the points by {misfit:.2g} times their stated errors; the intervals are widened")
    bins = 2.0 * damping * natural_hz / float(np.median(np.diff(f)))
    if is_smeared and bins.min() < _NARROW:
        said.append(f"a resonance is {bins.min():.1f} bins wide, smeared too much; take longer segments")
    outside = (natural_hz < f[0]) | (natural_hz > f[-1])
    if outside.any():
        said.append(f"the mode at {natural_hz[outside][0]:.4g} Hz lies outside the band")
    return "; ".join(said)
