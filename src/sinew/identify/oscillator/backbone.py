"""Backbone of a free decay: frequency and damping over amplitude, with bands."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import interpolate, special

from sinew.analysis.decay.decay_fit import (
    FreeOscillation,
    LikelihoodFit,
    fit_oscillation,
    lehr_damping,
    polynomials,
    smooth_functions,
)
from sinew.analysis.decay.free_decay import Peaks, block_means, checked_record, evenly, free_decay
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError

_FEWEST, _MOST = 2, 9  # functions of time that describe logarithm of amplitude and phase
_FLOOR = 3.0  # times the noise of one sample: a swing this small ends the window
_KNOWN = 0.25  # of ln A: where it is less certain, the curves end
_POINTS = 41
_TURN = 2.0 * math.pi


@dataclass(frozen=True)
class Backbone:
    """Frequency and damping against amplitude, shape (a,) each, from large amplitude to small.

    The curves hold the longest stretch in which the amplitude falls and is known to a quarter.

    amplitude: of the fundamental, unit of the response.
    frequency_hz: ω/2π of the swing at that amplitude; damping_ratio: λ/sqrt(ω² + λ²), λ = -d ln A/dt.
    *_std: standard deviations; *_low, *_high: the pointwise 90 % band. Neighbours are not independent.
    time_s: when the decay passed each amplitude. functions: how many describe its course.
    harmonics: whether second and third harmonic and a shift of the rest position with amplitude were fitted too.
    noise_std: of one sample; misfit: noise_std by the scatter of neighbouring samples, near 1 for white noise.
    curve: the fitted response, shape (n,), at window_s, shape (n,).
    """

    amplitude: Array
    frequency_hz: Array
    frequency_std_hz: Array
    frequency_low_hz: Array
    frequency_high_hz: Array
    damping_ratio: Array
    damping_ratio_std: Array
    damping_ratio_low: Array
    damping_ratio_high: Array
    time_s: Array
    functions: int
    harmonics: bool
    noise_std: float
    misfit: float
    window_s: Array
    curve: Array


def fit_backbone(
    time_s: ArrayLike,
    response: ArrayLike,
    *,
    drive: ArrayLike | None = None,
    free_from_s: float | None = None,
    functions: int | None = None,
    harmonics: bool = True,
    creeps: bool = False,
) -> Backbone:
    """Return frequency and damping curves of the free decay in a record.

    time_s, response, drive: shape (n,), drive and free_from_s as in `sinew.analysis.decay.ring_down`, which finds the
    window; it ends where the swing is three times the noise of a sample.

    Logarithm of amplitude and phase are splines of time (cubic from four functions on), their number the one that
    Akaike's corrected criterion prefers plus one, so that the bias of the spline stays below its noise; fitted to all
    samples by maximum likelihood under coloured noise (`sinew.analysis.decay.decay_fit`). A curve of damping
    against amplitude is then -d ln A/dt against A; the band comes from the covariance, through the time of passage too.
    Bands tell how the noise moves the curve, not how a swing that is no slowly changing sine (less than about three
    half cycles of it) would.
    functions: 2 to 9 to fix the number. harmonics: with second and third harmonic.
    creeps: with an exponential relaxation of the rest position beside its line.
    Raises RecordingError where there is no free decay, or fewer than six half cycles of it.
    """
    t, x, lever, _ = evenly(*checked_record(time_s, response, drive))
    first, _, _, peaks = free_decay(t, x, lever, free_from_s)
    t, x = block_means(t, x, peaks.half_period_s)
    rest = first.rest(peaks.time_s)
    size = np.abs(peaks.value - rest)
    small = np.flatnonzero(size < _FLOOR * peaks.noise)
    last = int(small[0]) if small.size else size.size
    if last < 6:
        raise RecordingError(
            f"{last} half cycles stand out of the noise; a backbone needs at least 6: start from a larger amplitude"
        )
    begin, stop = first.start_s, float(peaks.time_s[last - 1]) + 0.5 * peaks.half_period_s
    inside = (t >= begin - 1e-9) & (t <= stop)
    peaks = peaks.between(-np.inf, stop)
    window, values = t[inside], x[inside]
    rest_at = first.rest(peaks.time_s)
    first_count, most = (_FEWEST, min(_MOST, peaks.value.size // 2)) if functions is None else (functions, functions)
    fits: dict[int, tuple[FreeOscillation, LikelihoodFit]] = {}
    for count in range(first_count, most + 1):
        fits[count] = _fit(window, values, peaks, rest_at, count, harmonics, creeps)
        best = min(fits, key=lambda k: fits[k][1].aic)
        if count >= best + 3:
            break
    count = min(best + 2, max(fits))
    return _read(*fits[count], window, count, peaks.noise)


def _slopes(s: Array, count: int, order: int) -> Array:
    """Return derivatives of the basis by s, shape (n, count)."""
    if count <= 4:
        columns = [np.polynomial.polynomial.polyder(row, order) for row in np.eye(count)]
        return np.stack([np.polynomial.polynomial.polyval(s, c) for c in columns], axis=1) + np.zeros((s.size, count))
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, count - 2), np.ones(3)])
    splines = [interpolate.BSpline(knots, row, 3).derivative(order) for row in np.eye(count)]
    return np.stack([spline(s) for spline in splines], axis=1)


def _fit(
    t: Array, x: Array, peaks: Peaks, rest: Array, count: int, harmonics: bool, creeps: bool
) -> tuple[FreeOscillation, LikelihoodFit]:
    """Return model and fit, started from sizes and times of the peaks: ln A through the sizes, π of phase a peak."""
    window = float(t[-1] - t[0])
    s = (t - t[0]) / window
    model = FreeOscillation(s, (smooth_functions(s, count),), polynomials(s, 2), creeps, harmonics)
    height = peaks.value - rest
    at = smooth_functions((peaks.time_s - t[0]) / window, count)
    phase = np.arange(height.size) * math.pi + (0.0 if height[0] > 0 else math.pi)
    weight = np.abs(height)[:, None]
    start = np.zeros(model.width)
    start[0 : 2 * count : 2] = np.linalg.lstsq(at * weight, np.log(np.abs(height)) * weight[:, 0], rcond=1e-8)[0]
    start[1 : 2 * count : 2] = np.linalg.lstsq(at * weight, phase * weight[:, 0], rcond=1e-8)[0]
    if creeps:
        start[-1] = math.log(0.3)
    return model, fit_oscillation(model, [start], x)


def _read(model: FreeOscillation, fit: LikelihoodFit, t: Array, count: int, scatter: float) -> Backbone:
    window, c = float(t[-1] - t[0]), fit.parameters[model.mode(0)]
    fine = np.linspace(0.0, 1.0, 2001)
    functions, place = smooth_functions(fine, count), model.mode(0)
    log = functions @ c[0::2]
    spread = fit.covariance[place, place][0::2, 0::2]
    known = np.einsum("ij,jk,ik->i", functions, spread, functions) < _KNOWN**2
    rising = np.flatnonzero((np.diff(log) >= 0) | ~known[1:])
    first, last = _falling(rising, fine.size)
    levels = np.linspace(log[first], log[last], _POINTS)
    s = np.interp(-levels, -log[first : last + 1], fine[first : last + 1])
    one, two = _slopes(s, count, 1), _slopes(s, count, 2)
    rate, omega = -(one @ c[0::2]), one @ c[1::2]
    # At a given amplitude: δs = -δ ln A / (ln A)', and with it every slope moves.
    moved = smooth_functions(s, count) / rate[:, None]
    by_real = np.zeros((s.size, fit.parameters.size)), np.zeros((s.size, fit.parameters.size))
    by_real[0][:, place][:, 0::2] = -one - (two @ c[0::2])[:, None] * moved
    by_real[1][:, place][:, 0::2] = (two @ c[1::2])[:, None] * moved
    by_real[1][:, place][:, 1::2] = one
    natural = np.hypot(rate, omega)
    by_ratio = (omega**2 / natural**3)[:, None] * by_real[0] - (rate * omega / natural**3)[:, None] * by_real[1]
    stds = [np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", g, fit.covariance, g), 0.0)) for g in (by_ratio, by_real[1])]
    half = float(special.stdtrit(fit.degrees_of_freedom, 0.95))
    ratio, frequency, frequency_std = lehr_damping(rate, omega), omega / (_TURN * window), stds[1] / (_TURN * window)
    return Backbone(
        np.exp(levels),
        frequency,
        frequency_std,
        frequency - half * frequency_std,
        frequency + half * frequency_std,
        ratio,
        stds[0],
        ratio - half * stds[0],
        ratio + half * stds[0],
        t[0] + window * s,
        count,
        model.harmonics,
        fit.noise_std,
        fit.noise_std / scatter,
        t,
        model.values(fit.parameters),
    )


def _falling(rising: NDArray[np.intp], size: int) -> tuple[int, int]:
    """Return first and last index of the longest stretch in which the amplitude falls."""
    edges = np.concatenate([[-1], rising, [size - 1]])
    longest = int(np.argmax(np.diff(edges)))
    return int(edges[longest]) + 1, int(edges[longest + 1])
