"""This is where a driven response shows how frequency and damping move with amplitude, without a law for either.

In a steady state of amplitude a the joint is, for its fundamental, a linear one whose stiffness and damping are those
of that amplitude (its describing functions):

    [K(a) - ω² + jω d(a)] y = g exp(jφ) · push,   K(a) = K₀ + K₁a² + K₂a⁴, d(a) = d₀ + d₁a + d₂a².

All of it is linear in the coefficients, so points of a few frequencies and levels of the drive tell them by regression,
whatever branch they lie on. ω = sqrt(K(a)) is the backbone: where the motion lags the push by 90°.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize

from sinew.identify.certainty import Covariance
from sinew.identify.response_points import ResponsePoints
from sinew.identify.response_start import motion_and_push
from sinew.identify.response_tests import long_run
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import Estimate

__all__ = ["PhaseResonance", "ResponseCurves", "fit_response_curves"]

Array = NDArray[np.float64]

_ROUNDS = 12
_MOST_TERMS = 3
_CURVE = 25
_UNKNOWN = Estimate(np.nan, np.nan, np.nan, np.nan)


@dataclass(frozen=True)
class PhaseResonance:
    """Where a drive of one amplitude is lagged by 90°: frequency, amplitude of the motion, gain over the drive.

    input_amplitude: in the unit of the input. reason: one sentence where there is none in reach of the points.
    """

    input_amplitude: float
    frequency_hz: Estimate
    amplitude: Estimate
    gain: Estimate
    reason: str = ""


@dataclass(frozen=True)
class ResponseCurves:
    """Stiffness and damping against amplitude of one joint.

    points: that were fitted. stiffness, damping: coefficients K₀ [1/s²], K₁, ...; d₀ [1/s], d₁, ..., of powers of the
    amplitude over `scale`. covariance: of both and of real and imaginary part of the gain, in that order.
    amplitude_low, amplitude_high: of the motion, where there are points. misfit: root mean square of what the curves
    leave of a point, over its size.
    """

    points: tuple[ResponsePoints, ...]
    stiffness: Array
    damping: Array
    gain: complex
    covariance: Covariance
    scale: float
    amplitude_low: float
    amplitude_high: float
    misfit: float

    def frequency_hz(self, amplitude: ArrayLike) -> list[Estimate]:
        """Return the backbone sqrt(K(a))/2π at amplitudes of the motion, shape (a,)."""
        found = []
        for size in np.atleast_1d(np.asarray(amplitude, dtype=float)):
            powers, _ = self._powers(float(size))
            omega = float(np.sqrt(powers @ self.stiffness))
            slope = np.zeros(self.covariance.matrix.shape[0])
            slope[: powers.size] = powers / (2 * omega)
            found.append(self._estimate(omega / (2 * np.pi), slope / (2 * np.pi)))
        return found

    def damping_ratio(self, amplitude: ArrayLike) -> list[Estimate]:
        """Return d(a)/(2 sqrt(K(a))) at amplitudes of the motion, shape (a,)."""
        found = []
        for size in np.atleast_1d(np.asarray(amplitude, dtype=float)):
            even, every = self._powers(float(size))
            stiff, damped = float(even @ self.stiffness), float(every @ self.damping)
            slope = np.zeros(self.covariance.matrix.shape[0])
            slope[: even.size] = -0.25 * damped * stiff**-1.5 * even
            slope[even.size : even.size + every.size] = every / (2 * np.sqrt(stiff))
            found.append(self._estimate(damped / (2 * np.sqrt(stiff)), slope))
        return found

    def amplitudes(self, count: int = _CURVE) -> Array:
        """Return amplitudes from the smallest to the largest of the points, shape (count,)."""
        return np.linspace(self.amplitude_low, self.amplitude_high, count)

    def resonance(self, input_amplitude: float) -> PhaseResonance:
        """Return where a drive of this amplitude is lagged by 90°, standard deviations to first order."""
        like = self.points[0]
        x = np.concatenate([self.stiffness, self.damping, [self.gain.real, self.gain.imag]])
        size, turned = np.linalg.eigh(0.5 * (self.covariance.matrix + self.covariance.matrix.T))
        root = (turned * np.sqrt(np.maximum(size, 0.0))).T
        lanes = [self._meet(lane, like, input_amplitude) for lane in np.concatenate([x[None], x + root, x - root])]
        found = np.array(lanes)
        if not np.isfinite(found).all():
            reason = f"at a drive of {input_amplitude:g} the lag is 90° at no amplitude near the measured ones"
            return PhaseResonance(input_amplitude, _UNKNOWN, _UNKNOWN, _UNKNOWN, reason)
        m = x.size
        std = np.sqrt(np.sum((0.5 * (found[1 : m + 1] - found[m + 1 :])) ** 2, axis=0))
        freedom = self.covariance.degrees_of_freedom
        frequency, amplitude = (Estimate.student(float(found[0, k]), float(std[k]), freedom) for k in range(2))
        gain = Estimate.student(float(found[0, 1]) / input_amplitude, float(std[1]) / input_amplitude, freedom)
        return PhaseResonance(input_amplitude, frequency, amplitude, gain)

    def _meet(self, x: Array, like: ResponsePoints, input_amplitude: float) -> tuple[float, float]:
        """Return frequency [Hz] and amplitude at which d(a) ω a is the push."""
        p, q = self.stiffness.size, self.damping.size
        gain = float(np.hypot(x[p + q], x[p + q + 1]))

        def omega(size: float) -> float:
            return float(np.sqrt(max(float(self._powers(size)[0] @ x[:p]), 1e-12)))

        def excess(size: float) -> float:
            at = omega(size)
            push = motion_and_push(like.at(at / (2 * np.pi), input_amplitude), "relative")[1]
            return at * float(self._powers(size)[1] @ x[p : p + q]) * size - gain * float(np.abs(push[0]))

        low, high = 0.5 * self.amplitude_low, 1.3 * self.amplitude_high
        if not excess(low) < 0 < excess(high):
            return np.nan, np.nan
        size = float(optimize.brentq(excess, low, high, xtol=1e-12 * high, rtol=1e-12))
        return omega(size) / (2 * np.pi), size

    def _powers(self, size: float) -> tuple[Array, Array]:
        even = np.arange(0.0, 2.0 * self.stiffness.size, 2.0)
        return np.power(size / self.scale, even), np.power(size / self.scale, np.arange(1.0 * self.damping.size))

    def _estimate(self, value: float, slope: Array) -> Estimate:
        std = float(np.sqrt(max(float(slope @ self.covariance.matrix @ slope), 0.0)))
        return Estimate.student(value, std, self.covariance.degrees_of_freedom)


def fit_response_curves(
    points: ResponsePoints | Sequence[ResponsePoints],
    *,
    terms: tuple[int, int] | None = None,
    turned: bool = False,
) -> ResponseCurves:
    """Return stiffness and damping against amplitude from the points of one or several levels of a drive.

    terms: how many of K and of d (1 to 3 each); None for those that the information criterion prefers. turned: whether
    the measuring chain may turn the phase by a constant.
    The motion is that relative to the base. Residuals are weighted with the points' scatter and, where it is larger,
    with what the curves leave of a point's size, so that no part of the curve outvotes the rest. The covariance is that
    of the scores over neighbouring frequencies (Newey and West), at least the classical one. The measured motion is on
    both sides of the equation, so its scatter should be small beside it, a tenth or less.
    Raises RecordingError for fewer points than coefficients, or a stiffness that is not positive.
    """
    groups = (points,) if isinstance(points, ResponsePoints) else tuple(points)
    if terms is not None:
        return _fit(groups, *terms, turned)[0]
    sizes = range(1, _MOST_TERMS + 1)
    tried = [_fit(groups, p, q, turned) for p in sizes for q in sizes if sum(g.size for g in groups) >= p + q + 3]
    if not tried:
        raise RecordingError("too few points for curves of stiffness and damping; measure at least five")
    return min(tried, key=lambda one: one[1])[0]


def _fit(groups: tuple[ResponsePoints, ...], p: int, q: int, turned: bool) -> tuple[ResponseCurves, float]:
    """Return the curves of p and q terms and their information criterion."""
    pairs = [motion_and_push(one, "relative") for one in groups]
    y, push = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    omega = 2 * np.pi * np.concatenate([one.frequency_hz for one in groups])
    spread = [np.sqrt(0.5 * np.trace(one.covariance, axis1=1, axis2=2)) / np.abs(one.response) for one in groups]
    relative, size = np.concatenate(spread), np.abs(y)
    scale, centre = float(size.max()), float(np.median(omega)) ** 2
    s = size / scale
    columns = [s ** (2 * k) * y for k in range(p)] + [1j * omega * s**k * y for k in range(q)]
    columns += [-push, -1j * push] if turned else [-push]
    table, target = np.stack(columns, axis=1), (omega**2 - centre) * y
    n, m = 2 * y.size, table.shape[1]
    if n <= m:
        raise RecordingError(f"found {y.size} points for {m} coefficients; measure more frequencies or levels")
    x, misfit = np.zeros(m), 0.0
    weight = 1.0 / (np.abs(push) + 1e-300)
    for _ in range(_ROUNDS):
        rows = _real(table * weight[:, None])
        lengths = np.linalg.norm(rows, axis=0)
        lengths[lengths == 0] = 1.0
        x = np.linalg.lstsq(rows / lengths, _real((target * weight)[:, None])[:, 0], rcond=1e-13)[0] / lengths
        dynamic = np.abs((table[:, : p + q] @ x[: p + q] - target) / y)
        off = np.abs(table @ x - target) / (dynamic * size)
        misfit = float(np.sqrt(np.mean(off**2)))
        weight = 1.0 / (dynamic * size * np.maximum(np.hypot(relative, misfit), 1e-12))
    rows = _real(table * weight[:, None])
    residual = rows @ x - _real((target * weight)[:, None])[:, 0]
    covariance = _covariance(rows, residual, [one.size for one in groups])
    stiffness, gain = x[:p].copy(), x[p + q :]
    stiffness[0] += centre
    curves = ResponseCurves(
        groups,
        stiffness,
        x[p : p + q],
        complex(gain[0], gain[1] if turned else 0.0),
        covariance if turned else Covariance(np.pad(covariance.matrix, (0, 1)), covariance.degrees_of_freedom),
        scale,
        float(size.min()),
        scale,
        misfit,
    )
    if not stiffness[0] > 0:
        raise RecordingError("the points ask for a negative stiffness; is the excitation the right one?")
    return curves, float(n * np.log(max(misfit, 1e-300) ** 2) + m * np.log(n))


def _real(columns: NDArray[np.complex128]) -> Array:
    """Return real and imaginary part of each point in turn, shape (2n, m)."""
    return np.stack([columns.real, columns.imag], axis=1).reshape(-1, columns.shape[1])


def _covariance(rows: Array, residual: Array, sizes: Sequence[int]) -> Covariance:
    n, m = rows.shape
    lengths = np.linalg.norm(rows, axis=0)
    lengths[lengths == 0] = 1.0
    scaled = rows / lengths
    gram = np.linalg.pinv(scaled.T @ scaled, hermitian=True)
    classical = float(residual @ residual) / (n - m) * gram
    scores = (scaled * residual[:, None]).reshape(-1, 2, m).sum(axis=1)
    robust = gram @ long_run(scores, sizes) * (n / (n - m)) @ gram
    ratio = np.sqrt(np.maximum(np.diag(classical), 0.0) / np.maximum(np.diag(robust), 1e-300))
    larger = np.maximum(ratio, 1.0)
    return Covariance(robust * np.outer(larger, larger) / np.outer(lengths, lengths), float(n - m))
