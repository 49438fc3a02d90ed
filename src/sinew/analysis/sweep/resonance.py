"""The resonance of a response curve: its peaks by each meaning, 90° crossing and half-power width, with intervals.

"Resonance" has several meanings, and a joint that bends under a motor that saturates tells them apart by a percent: the
frequency of the largest mean of peaks over the nominal drive (Eq. 6, the paper's: `paper_resonance_hz`), of the
largest fundamental over it (`resonance_hz`), of the largest gain by measured drive, and that of 90° of lag.
`resonance_table` sets them side by side.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy
import xarray as xr
from numpy.typing import NDArray

from sinew.analysis.signal.coloured_noise import solve_scaled, unit_columns
from sinew.analysis.signal.repeats import Interval, combine_repeats
from sinew.analysis.sweep.response import Response
from sinew.measure.arrays import Array, Complexes, Mask, mean_of_known, wrapped_lag
from sinew.measure.estimate import Estimate
from sinew.measure.schema import RESULT_VARIABLES, companions
from sinew.plan.plan import FEWEST_FREQUENCIES, too_few_frequencies

# ---- rational curve through a measured resonance, whose peak can be read off between the points


_FULL = np.ones(8, dtype=bool)
_PLAIN = np.array([True, True, True, True, True, True, False, False])
_STEPS = 40
_MISFIT = 5.0
_FINE = 1001


@dataclass(frozen=True)
class RationalCurve:
    """H(v) = (c₀ + c₁v + c₂v²) / (a + jb(1 + wv) - 2v - wv²) around a resonance, v = (f - centre)/half_width.

    w = half_width/centre, so the denominator is a - (u² - 1)/w + jbu with u = f/centre: one resonance times whatever
    is smooth (inertia, a drive that falls short). The linear joint I_l ω²/(k - Iω² + jdω) is contained exactly,
    hysteretic damping to second order in w. A damping of free slope would not do: over a narrow window it only turns
    denominator and numerator alike.
    parameters: a, b, Re c₀, Im c₀, Re c₁, ..., shape (8,). covariance_root: shape (8, 16), covariance = root·rootᵀ,
    eight columns from the residual of the sizes, eight from that of the angles; degrees_of_freedom of the two.
    low, high: window of the fit in v. fits: whether the residual is no more than the noise of the points explains.
    """

    centre_hz: float
    half_width_hz: float
    parameters: Array
    covariance_root: Array
    degrees_of_freedom: tuple[float, float]
    low: float
    high: float
    fits: bool = True


def _denominator(parameters: Array, v: Array, w: float) -> Complexes:
    a, b = parameters[..., 0, None], parameters[..., 1, None]
    return np.asarray(a - 2.0 * v - w * v**2 + 1j * b * (1.0 + w * v))


def evaluate_curve(parameters: Array, v: Array, w: float) -> Complexes:
    """Return H at v, shape (..., n), for parameters of shape (..., 8)."""
    c = parameters[..., 2::2] + 1j * parameters[..., 3::2]
    numerator = c[..., 0, None] + c[..., 1, None] * v + c[..., 2, None] * v**2
    return np.asarray(numerator / _denominator(parameters, v, w))


@dataclass(frozen=True)
class _Points:
    """What is fitted: v, w, complex response, and the weights of the relative residual's size and angle, shape (n,)."""

    v: Array
    w: float
    response: Complexes
    size_weight: Array
    angle_weight: Array

    @cached_property
    def under(self) -> Complexes:
        """Return what a and b are multiplied by in the denominator, shape (n, 2)."""
        return np.stack([np.ones_like(self.v), 1j * (1.0 + self.w * self.v)], axis=1)

    @cached_property
    def over(self) -> Complexes:
        """Return what Re c₀, Im c₀, Re c₁, ... are multiplied by in the numerator, shape (n, 6)."""
        powers = np.vander(self.v, 3, increasing=True)
        return np.stack([powers, 1j * powers], axis=2).reshape(-1, 6)

    @cached_property
    def alone(self) -> Array:
        """Return what the denominator lacks beside a and b, shape (n,)."""
        return np.asarray(2.0 * self.v + self.w * self.v**2)

    def weighted(self, complexes: Complexes) -> Array:
        """Return complex differences (n,) or (n, k) as weighted relative sizes and angles, (2n,) or (2n, k)."""
        relative = (complexes.T / self.response).T
        return np.concatenate([(self.size_weight * relative.real.T).T, (self.angle_weight * relative.imag.T).T])

    def denominator(self, parameters: Array) -> Complexes:
        """Return the curve's denominator at the points, shape (n,)."""
        return np.asarray(self.under @ parameters[:2] - self.alone)

    def residual(self, parameters: Array) -> tuple[Array, Complexes, Complexes]:
        """Return the weighted residual (2n,) of a curve, the curve and its denominator, shape (n,) each."""
        denominator = self.denominator(parameters)
        curve = self.over @ parameters[2:] / denominator
        return self.weighted(self.response - curve), curve, denominator

    def jacobian(self, curve: Complexes, denominator: Complexes, active: Mask) -> Array:
        """Return the derivatives of the weighted curve, shape (2n, active parameters)."""
        columns = np.concatenate([-curve[:, None] * self.under, self.over], axis=1) / denominator[:, None]
        return self.weighted(columns[:, active])


def fit_curve(frequency_hz: Array, response: Complexes, size_std: Array, angle_std: Array) -> RationalCurve | None:
    """Return the weighted least-squares curve through complex points, all of shape (n,), or None where none fits.

    size_std: relative, of the response's size; angle_std: of its angle [rad]. To each variance 0.3 of the median one
    is added, for they are estimates themselves; only their ratios matter, since the covariance is scaled by the
    residual. Where that is far beyond the noise the joint is not linear and the curve an approximation: the points
    then weigh alike. Start by Levy's linearisation with Sanathanan and Koerner's reweighting, then
    Levenberg-Marquardt on the true residual. Where all eight parameters give a curve that leaves the points (too few,
    too noisy), six do: a straight numerator. At least six points are needed.
    """
    if frequency_hz.size < 6 or not np.abs(response).all():
        return None
    centre = 0.5 * float(frequency_hz[0] + frequency_hz[-1])
    half = 0.5 * float(frequency_hz[-1] - frequency_hz[0])
    v, w = (frequency_hz - centre) / half, half / centre
    variances = [std**2 + 0.3 * np.median(std**2) + 1e-20 for std in (size_std, angle_std)]
    points = _Points(v, w, response, *(1.0 / np.sqrt(variance) for variance in variances))
    for active in (_FULL, _PLAIN):
        parameters = _refine(_start(points, active), points, active)
        residual, fitted, _ = points.residual(parameters)
        fits = bool(residual @ residual <= _MISFIT * (residual.size - active.sum()))
        if not fits:
            amiss = np.mean(np.abs(fitted / response - 1.0) ** 2)
            evened = _Points(v, w, response, *(1.0 / np.sqrt(variance + amiss) for variance in variances))
            parameters, points = _refine(parameters, evened, active), evened
        highest = float(np.abs(evaluate_curve(parameters, np.linspace(-1.0, 1.0, 401), w)).max())
        if np.isfinite(highest) and highest < 1.5 * float(np.abs(response).max()):
            root, freedom = _covariance_roots(parameters, points, active)
            return RationalCurve(centre, half, parameters, root, freedom, -1.0, 1.0, fits)
    return None


def _start(points: _Points, active: Mask) -> Array:
    """Return the parameters of the linearised problem H·D - N = 0, reweighted by 1/|D| four times."""
    response = points.response
    design = np.concatenate([response[:, None] * points.under, -points.over], axis=1)[:, active]
    target = response * points.alone
    parameters, scale = np.zeros(8), np.abs(response)
    for _ in range(4):
        parameters[active] = solve_scaled(points.weighted(scale[:, None] * design), points.weighted(scale * target))
        scale = 1.0 / np.maximum(np.abs(points.denominator(parameters)), 1e-9)
    return parameters


def _refine(parameters: Array, points: _Points, active: Mask) -> Array:
    """Return the parameters of the least weighted residual, by Levenberg-Marquardt from a start."""
    damping, (residual, curve, denominator) = 1e-6, points.residual(parameters)
    jacobian = points.jacobian(curve, denominator, active)
    for _ in range(_STEPS):
        size = np.sqrt(damping) * np.linalg.norm(jacobian, axis=0)
        step = np.zeros(8)
        step[active] = solve_scaled(np.concatenate([jacobian, np.diag(size)]), np.append(residual, 0.0 * size))
        trial, curve, denominator = points.residual(parameters + step)
        gained = float(residual @ residual - trial @ trial)
        if not gained > 0:
            damping *= 10.0
            if damping > 1e6:
                break
            continue
        parameters, residual = parameters + step, trial
        damping = max(damping * 0.1, 1e-14)
        if gained <= 1e-7 * float(trial @ trial):
            break
        jacobian = points.jacobian(curve, denominator, active)
    return parameters


def _covariance_roots(parameters: Array, points: _Points, active: Mask) -> tuple[Array, tuple[float, float]]:
    """Return roots of the covariance from sizes and from angles, (8, 16), and the degrees of freedom of each.

    Sizes and angles are scaled each by their own residual, for jitter of the stamps is in the angles alone.
    """
    residual, curve, denominator = points.residual(parameters)
    jacobian = points.jacobian(curve, denominator, active)
    scaled, scale = unit_columns(jacobian)
    left, singular, right = np.linalg.svd(scaled, full_matrices=False)
    spread = right.T / np.maximum(singular, 1e-10 * singular[0]) / scale[:, None]
    root, freedom = np.zeros((8, 16)), []
    for block, half in enumerate(np.split(np.arange(residual.size), 2)):
        freedom.append(max(half.size - float((left[half] ** 2).sum()), 0.5))
        _, size, axes = np.linalg.svd(left[half], full_matrices=False)
        deviation = np.sqrt(float(residual[half] @ residual[half]) / freedom[-1])
        root[np.ix_(active, 8 * block + np.arange(size.size))] = deviation * spread @ (axes.T * size)
    return root, (freedom[0], freedom[1])


def parameter_spread(curve: RationalCurve) -> Array:
    """Return the parameters and their 32 neighbours one standard deviation away along the columns of the covariance.

    Shape (33, 8): the centre, then plus and minus of each column. Half the difference of any reading over a pair is
    that column's share of the reading's standard deviation.
    """
    steps = curve.covariance_root.T
    return np.concatenate([curve.parameters[None], curve.parameters + steps, curve.parameters - steps])


class _Swept(NamedTuple):
    """Curves on a fine grid of v: their size, (k, n), and response times what makes it real and positive, (k, n)."""

    v: Array
    gain: Array
    turned: Complexes

    @staticmethod
    def of(curve: RationalCurve, parameters: Array) -> "_Swept":
        """Return the curves of parameters (k, 8) over the window of a fit."""
        v, w = np.linspace(curve.low, curve.high, _FINE), curve.half_width_hz / curve.centre_hz
        numerator = (parameters[:, 2::2] + 1j * parameters[:, 3::2]) @ np.stack([np.ones_like(v), v, v**2])
        denominator = _denominator(parameters, v, w)
        size = denominator.real**2 + denominator.imag**2
        gain = np.sqrt((numerator.real**2 + numerator.imag**2) / size)
        return _Swept(v, gain, numerator * denominator.conj())

    def tops(self) -> tuple[NDArray[np.intp], Array, Array]:
        """Return where each curve is largest, what a parabola adds to that [grid points], and its height, (k,) each."""
        rows, top = np.arange(self.gain.shape[0]), np.clip(np.argmax(self.gain, axis=1), 1, _FINE - 2)
        before, middle, after = (self.gain[rows, top + i] for i in (-1, 0, 1))
        bend = before - 2.0 * middle + after
        shift = np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, -1.0), 0.0).clip(-1.0, 1.0)
        return top, shift, middle - 0.25 * (before - after) * shift

    def widths(self, top: NDArray[np.intp], level: Array) -> Array:
        """Return how far it is between the points beside the top that are as low as a level [grid points], (k,)."""
        below, place = self.gain <= level[:, None], np.arange(_FINE)
        left = np.where(below & (place < top[:, None]), place, -1).max(axis=1)
        right = np.where(below & (place > top[:, None]), place, _FINE).min(axis=1)

        def passage(low: NDArray[np.intp], high: NDArray[np.intp]) -> Array:
            rows = np.arange(low.size)
            inner, outer = self.gain[rows, high], self.gain[rows, low]
            return np.asarray((inner - level) / (inner - outer))

        known = (left >= 0) & (right < _FINE)
        left, right = np.where(known, left, 0), np.where(known, right, _FINE - 1)
        reach = right - left - 2.0 + passage(left, left + 1) + passage(right, right - 1)
        return np.where(known, reach, np.nan)

    def crossings(self, top: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return where the lag passes 90° nearest to the top [grid points], and by how much it grows there, (k,)."""
        ahead = self.turned.real > 0  # a lag below 90°
        row, at = np.nonzero(ahead[:, :-1] & ~ahead[:, 1:])
        lag, next_lag = wrapped_lag(self.turned[row, at]), wrapped_lag(self.turned[row, at + 1])
        grown = next_lag - lag
        nearest = np.lexsort((np.abs(at - top[row]), row))
        nearest = nearest[grown[nearest] < 0.5 * np.pi]
        row, first = np.unique(row[nearest], return_index=True)
        chosen = nearest[first]
        where, slope = np.full(top.size, np.nan), np.full(top.size, np.nan)
        where[row] = at[chosen] + (0.5 * np.pi - lag[chosen]) / grown[chosen]
        slope[row] = grown[chosen]
        return where, slope


def read_curve(curve: RationalCurve) -> tuple[Array, bool]:
    """Return peak frequency, gain, width, crossing and lag slope of the curve and its neighbours, shape (33, 5), and
    whether the curve itself has its peak inside the window."""
    swept = _Swept.of(curve, parameter_spread(curve))
    top, shift, largest = swept.tops()
    crossing, slope = swept.crossings(top)
    pitch = (swept.v[1] - swept.v[0]) * curve.half_width_hz
    start = curve.centre_hz + curve.low * curve.half_width_hz
    width = swept.widths(top, largest / math.sqrt(2.0))
    readings = [start + pitch * (top + shift), largest, pitch * width, start + pitch * crossing, slope / pitch]
    return np.stack(readings, axis=1), bool(1 < np.argmax(swept.gain[0]) < _FINE - 2)


def _read_top(curve: RationalCurve) -> tuple[float, float]:
    """Return frequency [Hz] and gain of the curve's peak."""
    swept = _Swept.of(curve, curve.parameters[None])
    top, shift, largest = swept.tops()
    v = float(swept.v[0] + (swept.v[1] - swept.v[0]) * (top[0] + shift[0]))
    return curve.centre_hz + v * curve.half_width_hz, float(largest[0])


# The top of a response curve that no linear resonance describes is read by itself.


# ---- the resonance of a response curve


_DEGREE = 4
_GRID = 4001


@dataclass(frozen=True)
class Crest:
    """Where a curve is largest, by its highest points alone.

    frequency_hz, gain: of the maximum; frequency_std_hz, gain_std: from the noise of the points.
    """

    frequency_hz: float
    gain: float
    frequency_std_hz: float
    gain_std: float


def top_points(gain: Array, level: float, fewest: int) -> slice:
    """Return the contiguous points around the largest gain, shape (n,), that reach `level` of it, at least `fewest`.

    Where more are needed, the higher of the two neighbours joins.
    """
    low = high = int(np.argmax(gain))
    floor, last = level * gain[low], gain.size - 1
    while low > 0 and gain[low - 1] >= floor:
        low -= 1
    while high < last and gain[high + 1] >= floor:
        high += 1
    while high - low + 1 < min(fewest, gain.size):
        if high == last or (low > 0 and gain[low - 1] >= gain[high + 1]):
            low -= 1
        else:
            high += 1
    return slice(low, high + 1)


def fit_crest(frequency_hz: Array, gain: Array, relative_std: Array) -> Crest | None:
    """Return the maximum of a curve through at least five points, all arguments of shape (n,), or None without one.

    A polynomial of fourth degree is fitted to 1/gain², which for a linear resonance is nearly a parabola and for one
    that leans or flattens still a smooth curve, where the gain itself has a sharp top. Its noise is that of the points
    (relative_std), or of the residual where that is larger.
    """
    if frequency_hz.size < _DEGREE + 1:
        return None
    centre, half = 0.5 * (frequency_hz[0] + frequency_hz[-1]), 0.5 * float(np.ptp(frequency_hz))
    v, inverse = (frequency_hz - centre) / half, gain**-2.0
    weight = 1.0 / (2.0 * inverse * np.maximum(relative_std, 1e-12))
    left, singular, right = np.linalg.svd(np.vander(v, _DEGREE + 1) * weight[:, None], full_matrices=False)
    root = right.T / singular
    target = inverse * weight
    fitted = root @ (left.T @ target)
    spare = v.size - _DEGREE - 1
    misfit = float(np.sum((target - left @ (left.T @ target)) ** 2)) / spare if spare else 0.0
    root *= np.sqrt(max(1.0, misfit))
    grid = np.linspace(-1.0, 1.0, _GRID)
    values = np.polyval(fitted, grid)
    at = int(np.argmin(values))
    if at in (0, _GRID - 1) or values[at] <= 0:
        return None
    top, level = float(grid[at]), float(values[at])
    bend = float(np.polyval(np.polyder(fitted, 2), top))
    if bend <= 0:
        return None
    powers = np.arange(_DEGREE, -1, -1)
    slopes = np.append(powers[:-1] * top ** (powers[:-1] - 1.0), 0.0)
    return Crest(
        float(centre + half * top),
        level**-0.5,
        half * float(np.linalg.norm(slopes @ root)) / bend,
        0.5 * level**-1.5 * float(np.linalg.norm(top**powers @ root)),
    )


_WINDOW_GAIN = 0.55
_WINDOW_POINTS = 8
_WINDOW_REACH = 0.6
_TOP_GAIN = 0.8
_TOP_POINTS = (5, 6)  # at least, of the polynomial and of the narrow rational curve
Reading = tuple[float, float, float]
_NAN: Reading = (math.nan, math.nan, math.nan)
RESONANCES = (
    "paper_resonance_hz",
    "paper_gain_peak",
    "resonance_hz",
    "gain_peak",
    "resonance_measured_drive_hz",
    "gain_peak_measured_drive",
    "phase_90_hz",
    "half_power_width_hz",
    "drive_amplitude_at_resonance_rad",
)


@dataclass(frozen=True)
class Peak:
    """What one response curve says of its resonance, NaN where a reading is absent.

    Each reading is (value, standard deviation, degrees of freedom of that deviation by Welch and Satterthwaite).
    frequency_hz, gain: of the largest gain. width_hz: between the points at gain/√2. crossing_hz: where the lag
    passes 90°; crossing_slope: change of lag with frequency there [rad/Hz].
    frequency_misfit_hz, gain_misfit: share of the deviations that repeating does not make smaller, because the curve
    is not that of a linear joint; zero where the curve fits the points within their noise.
    reason: one sentence where a reading is absent, else empty.
    """

    frequency_hz: Reading = _NAN
    gain: Reading = _NAN
    width_hz: Reading = _NAN
    crossing_hz: Reading = _NAN
    crossing_slope: float = math.nan
    frequency_misfit_hz: float = 0.0
    gain_misfit: float = 0.0
    reason: str = ""


def _window(frequency: Array, closeness: Array, centre: int) -> slice:
    """Return the contiguous points around a centre whose closeness stays above the limit, at least eight."""
    low = high = centre
    reach = _WINDOW_REACH * frequency[centre]
    good = (closeness >= _WINDOW_GAIN) & (np.abs(frequency - frequency[centre]) <= reach)
    while low > 0 and good[low - 1]:
        low -= 1
    while high < frequency.size - 1 and good[high + 1]:
        high += 1
    while high - low + 1 < min(_WINDOW_POINTS, frequency.size):
        left = frequency[centre] - frequency[low - 1] if low > 0 else math.inf
        right = frequency[high + 1] - frequency[centre] if high < frequency.size - 1 else math.inf
        low, high = (low - 1, high) if left <= right else (low, high + 1)
    return slice(low, high + 1)


def _finite(frequency: Array, response: Complexes, *stds: Array) -> tuple[Any, ...]:
    """Return the points at which everything is known."""
    valid = np.isfinite(response) & np.all(np.isfinite(stds), axis=0)
    return frequency[valid], response[valid], *(std[valid] for std in stds)


def find_peak(frequency_hz: Array, response: Complexes, size_std: Array, angle_std: Array) -> Peak:
    """Return the resonance of one complex response curve, all arguments of shape (f,), NaN points left out.

    size_std: relative standard deviation of the response's size; angle_std: of its angle [rad].
    A rational curve (`sinew.analysis.sweep.resonance`) is fitted to the points around the largest gain, down to 0.55 of
    it; peak, crossing and width are read off the curve and their standard deviations propagated from its covariance.
    Where that curve misfits by more than the noise explains (a drive that saturates, a joint that hardens), frequency
    and gain of the peak are read off its top alone (points above 0.8 of the largest gain;
    `fit_crest`), and their standard deviations hold the disagreement with a rational curve through that top.
    A largest gain at the edge of the points is no resonance: the readings are NaN and `reason` says so.
    """
    f, h, size, angle = _finite(frequency_hz, response, size_std, angle_std)
    if f.size < FEWEST_FREQUENCIES:
        return Peak(reason=too_few_frequencies(f.size))
    gain = np.abs(h)
    window = _window(f, gain / gain.max(), int(np.argmax(gain)))
    curve = fit_curve(f[window], h[window], size[window], angle[window])
    if curve is None:
        return Peak(reason="no smooth curve fits the points around the largest gain; measure more frequencies there")
    readings, inside = read_curve(curve)
    if not inside:
        edge = "lowest" if readings[0, 0] < curve.centre_hz else "highest"
        return Peak(reason=f"the gain is largest at the {edge} frequency of the sweep; extend the sweep beyond it")
    reason = "" if np.isfinite(readings[0, 2]) else "the sweep does not reach down to half power on both sides"
    frequency, largest, width, crossing = (_reading(readings[:, i], curve) for i in range(4))
    peak = Peak(frequency, largest, width, crossing, float(readings[0, 4]), reason=reason)
    return peak if curve.fits else _polished(peak, f, h, size, angle)


def _polished(peak: Peak, f: Array, h: Complexes, size: Array, angle: Array) -> Peak:
    """Return the peak read off the top of the points alone, its misfit that of two models of that top.

    The wide curve's standard deviation, scaled by its residual, belongs to the misfit too.
    """
    gain = np.abs(h)
    near, beside = (top_points(gain, _TOP_GAIN, fewest) for fewest in _TOP_POINTS)
    crest = fit_crest(f[near], gain[near], size[near])
    highest = int(np.argmax(gain))
    if crest is None:
        where, noise = (peak.frequency_hz[0], peak.gain[0]), (0.0, 0.0)
        other = float(f[highest]), float(gain[highest])
    else:
        where, noise = (crest.frequency_hz, crest.gain), (crest.frequency_std_hz, crest.gain_std)
        curve = fit_curve(f[beside], h[beside], size[beside], angle[beside])
        other = (peak.frequency_hz[0], peak.gain[0]) if curve is None else _read_top(curve)
    wide = peak.frequency_hz, peak.gain
    misfit = [math.hypot(where[i] - other[i], wide[i][1]) for i in range(2)]
    polished = [_with_misfit((where[i], noise[i], wide[i][2]), misfit[i]) for i in range(2)]
    return replace(
        peak, frequency_hz=polished[0], gain=polished[1], frequency_misfit_hz=misfit[0], gain_misfit=misfit[1]
    )


def _with_misfit(reading: Reading, misfit: float) -> Reading:
    """Return a reading whose standard deviation holds a misfit, which is taken as known (Welch and Satterthwaite)."""
    value, std, freedom = reading
    both = math.hypot(std, misfit)
    return value, both, freedom * (both / std) ** 4 if std > 0 else math.inf


def _reading(values: Array, curve: RationalCurve) -> Reading:
    """Return (value, std, degrees of freedom) from what the curve and its 32 neighbours say, shape (33,)."""
    shares = (0.25 * (values[1:17] - values[17:]) ** 2).reshape(2, 8).sum(axis=1)
    variance = float(shares.sum())
    spent = float((shares**2 / np.asarray(curve.degrees_of_freedom)).sum())
    return float(values[0]), math.sqrt(variance), variance**2 / spent if spent > 0 else sum(curve.degrees_of_freedom)


def find_crossing(frequency_hz: Array, response: Complexes, size_std: Array, angle_std: Array) -> Peak:
    """Return a Peak that holds only the 90° crossing, from a curve fitted around it instead of around the peak."""
    f, h, size, angle = _finite(frequency_hz, response, size_std, angle_std)
    lag = wrapped_lag(h)
    rising = np.flatnonzero((lag[:-1] < 0.5 * np.pi) & (lag[1:] >= 0.5 * np.pi))
    if f.size < FEWEST_FREQUENCIES or rising.size == 0:
        return Peak(reason="the lag does not pass 90° inside the sweep; extend the sweep")
    centre = int(rising[np.argmax(np.abs(h[rising]))])
    window = _window(f, np.sin(np.clip(lag, 0.0, np.pi)), centre)
    curve = fit_curve(f[window], h[window], size[window], angle[window])
    if curve is None:
        return Peak(reason="no smooth curve fits the points around the 90° crossing; measure more frequencies there")
    readings, _ = read_curve(curve)
    return Peak(crossing_hz=_reading(readings[:, 3], curve), crossing_slope=float(readings[0, 4]))


@dataclass(frozen=True)
class Readings:
    """What each repeat says of its resonance, by name of the quantity, shape (p, r), NaN where it is absent.

    freedom: degrees of freedom of the standard deviations. shared: standard uncertainties that repeats share. notes:
    why readings are absent, by pretension and repeat.
    """

    value: dict[str, Array]
    std: dict[str, Array]
    freedom: dict[str, Array]
    shared: dict[str, Array]
    notes: tuple[str, ...]


def read_resonances(response: Response) -> Readings:
    """Return the resonance of every pretension and repeat, each fitted by itself."""
    shape = (response.pretension_mm.size, response.transfer.shape[2])
    value, std, freedom = ({name: np.full(shape, np.nan) for name in RESONANCES} for _ in range(3))
    shared = {name: np.full(shape, np.nan) for name in RESONANCES}
    notes = []
    for p, r in np.ndindex(*shape):
        paper, *peaks = _peaks(response, p, r)
        for name, reading in _readings(response, p, r, paper, *peaks).items():
            value[name][p, r], std[name][p, r], freedom[name][p, r] = reading
        for name, share in _shared(response, p, r, paper, *peaks).items():
            shared[name][p, r] = share
        used = peaks[1:] if math.isfinite(peaks[0].frequency_hz[0]) else peaks  # no one asks for a nominal width
        said = " and ".join(dict.fromkeys(peak.reason for peak in used if peak.reason))
        if said and np.isfinite(response.columns["gain_harmonic"][p, :, r]).any():
            notes.append(f"{response.pretension_mm[p]:g} mm, repeat {r}: {said}")
    return Readings(value, std, freedom, shared, tuple(notes))


def estimate_resonance(response: Response, readings: Readings | None = None) -> xr.Dataset:
    """Return the resonance part of the results, each over pretension, with `_std`, `_low` and `_high`.

    readings: of `read_resonances`, where they are known already. Repeats are combined by Student's t, a single repeat
    keeps its fit's interval.
    paper_resonance_hz and paper_gain_peak are read off the curve of Eq. 6 itself (mean of peaks over nominal drive).
    gain_peak is the curve's largest gain by nominal drive times the ratio of the mean of peaks to the fundamental
    there, so that it is the paper's. The interval of phase_90_hz holds the delay budget's uncertainty too, those of
    the peaks the misfit of a curve that is not linear: repeats share both.
    Absent readings are NaN; the attribute `resonance_notes` says why, one line per pretension and repeat.
    """
    found = readings or read_resonances(response)
    variables: dict[str, xr.Variable] = {}
    for name in RESONANCES:
        value = found.value[name]
        alone = np.isfinite(value).sum(axis=1) == 1  # a single repeat's deviation holds its misfit already
        common = np.where(alone & (name != "phase_90_hz"), 0.0, mean_of_known(found.shared[name], 0.0))
        variables |= interval_variables(name, combine_repeats(value, found.std[name], found.freedom[name], common))
    return xr.Dataset(variables, attrs={"resonance_notes": "\n".join(found.notes)})


def _peaks(response: Response, p: int, r: int) -> tuple[Peak, Peak, Peak, Peak]:
    """Return the peak of the mean of peaks over the nominal drive (Eq. 6), at the fundamental's angles, the peaks by
    nominal and by measured drive, and the one that holds the 90° crossing."""
    f, columns = response.frequency_hz, response.columns
    stds = (response.nominal_gain_std[p, :, r], response.nominal_phase_std[p, :, r])
    nominal = find_peak(f, response.nominal_transfer[p, :, r], *stds)
    paper = find_peak(f, response.nominal_transfer[p, :, r] * _peaks_over_fundamental(response, p, r), *stds)
    transfer = response.transfer[p, :, r]
    relative = columns["gain_measured_drive_std"][p, :, r] / columns["gain_measured_drive"][p, :, r]
    stds = (relative, columns["phase_std_rad"][p, :, r])
    measured = find_peak(f, transfer, *stds)
    crossing = measured if math.isfinite(measured.crossing_hz[0]) else find_crossing(f, transfer, *stds)
    return paper, nominal, measured, crossing


def _peaks_over_fundamental(response: Response, p: int, r: int) -> Array:
    """Return the mean of peaks over the fundamental, shape (f,); NaN where nothing swings."""
    peaks, harmonic = response.columns["gain"][p, :, r], response.columns["gain_harmonic"][p, :, r]
    return np.divide(peaks, harmonic, out=np.full_like(harmonic, np.nan), where=harmonic > 0)


def _readings(
    response: Response, p: int, r: int, paper: Peak, nominal: Peak, measured: Peak, crossing: Peak
) -> dict[str, Reading]:
    """Return the readings of one pretension and repeat by name."""
    at = nominal.frequency_hz[0]
    ratio, ratio_std = _local(response.frequency_hz, _peaks_over_fundamental(response, p, r), at)
    peak_std = math.hypot(nominal.gain[1] * ratio, nominal.gain[0] * ratio_std)
    drive = _drive_at(response, p, r, nominal)
    return {
        "paper_resonance_hz": paper.frequency_hz,
        "paper_gain_peak": paper.gain,
        "resonance_hz": nominal.frequency_hz,
        "gain_peak": (nominal.gain[0] * ratio, peak_std, nominal.gain[2]),
        "resonance_measured_drive_hz": measured.frequency_hz,
        "gain_peak_measured_drive": measured.gain,
        "phase_90_hz": crossing.crossing_hz,
        "half_power_width_hz": measured.width_hz,
        "drive_amplitude_at_resonance_rad": (drive.value, math.hypot(drive.std, drive.misfit), nominal.frequency_hz[2]),
    }


def _shared(
    response: Response, p: int, r: int, paper: Peak, nominal: Peak, measured: Peak, crossing: Peak
) -> dict[str, float]:
    """Return the standard uncertainties that the repeats share, by name of the reading."""
    return {
        "paper_resonance_hz": paper.frequency_misfit_hz,
        "paper_gain_peak": paper.gain_misfit,
        "resonance_hz": nominal.frequency_misfit_hz,
        "gain_peak": nominal.gain_misfit,
        "resonance_measured_drive_hz": measured.frequency_misfit_hz,
        "gain_peak_measured_drive": measured.gain_misfit,
        "phase_90_hz": _delay_share(response, p, r, crossing),
        "drive_amplitude_at_resonance_rad": _drive_at(response, p, r, nominal).misfit,
    }


class _DriveThere(NamedTuple):
    """The drive's amplitude at a resonance [rad], its standard deviation by noise, and what the grid leaves open."""

    value: float
    std: float
    misfit: float


def _drive_at(response: Response, p: int, r: int, peak: Peak) -> _DriveThere:
    """Return the measured drive amplitude at a peak.

    The lever gives way where the joint swings most, so that its amplitude over frequency is a V whose floor lies at the
    resonance, between two points of the grid. As a complex amplitude it passes smoothly: that is what is interpolated,
    by a cubic spline, and its size is read. The misfit is the difference to Akima's spline, and what the misfit of the
    peak's frequency makes of the slope there.
    """
    f, columns, where = response.frequency_hz, response.columns, peak.frequency_hz[0]
    size, own = columns["drive_amplitude_rad"][p, :, r], columns["drive_amplitude_std_rad"][p, :, r]
    turn = np.angle(response.nominal_transfer[p, :, r] * response.transfer[p, :, r].conj())
    lever = size * np.exp(1j * turn)
    known = np.isfinite(lever)
    if not math.isfinite(where) or known.sum() < 4 or not f[known][0] <= where <= f[known][-1]:
        return _DriveThere(math.nan, math.nan, math.nan)
    x, y = f[known], lever[known]
    spline = scipy.interpolate.CubicSpline(x, y)
    akima = scipy.interpolate.Akima1DInterpolator
    other = akima(x, y.real)(where) + 1j * akima(x, y.imag)(where)
    value = abs(complex(spline(where)))
    near = abs(complex(spline(where - 1e-4))), abs(complex(spline(where + 1e-4)))
    slope = (near[1] - near[0]) / 2e-4
    noise_hz = math.sqrt(max(peak.frequency_hz[1] ** 2 - peak.frequency_misfit_hz**2, 0.0))
    noise = math.hypot(_at(f, own, where), slope * noise_hz)
    return _DriveThere(value, noise, math.hypot(abs(other) - value, slope * peak.frequency_misfit_hz))


def _local(frequency: Array, values: Array, where: float) -> tuple[float, float]:
    """Return value and standard deviation, at a frequency, of a straight line through the six nearest points."""
    valid = np.flatnonzero(np.isfinite(values))
    if not math.isfinite(where) or valid.size < 3:
        return _at(frequency, values, where), 0.0
    near = valid[np.argsort(np.abs(frequency[valid] - where))[:6]]
    design = np.stack([np.ones(near.size), frequency[near] - where], axis=1)
    inverse = np.linalg.pinv(design)
    line = inverse @ values[near]
    residual = values[near] - design @ line
    return float(line[0]), float(np.linalg.norm(inverse[0]) * np.sqrt((residual @ residual) / (near.size - 2)))


def _at(frequency: Array, values: Array, where: float) -> float:
    """Return a column at a frequency, linear between its finite points, NaN outside them."""
    valid = np.isfinite(values)
    if not math.isfinite(where) or not valid.any():
        return math.nan
    return float(np.interp(where, frequency[valid], values[valid], left=math.nan, right=math.nan))


def _delay_share(response: Response, p: int, r: int, crossing: Peak) -> float:
    """Return the standard uncertainty of the crossing from that of the delay [Hz]."""
    lag = _at(response.frequency_hz, response.columns["phase_delay_std_rad"][p, :, r], crossing.crossing_hz[0])
    return lag / abs(crossing.crossing_slope) if math.isfinite(lag) and crossing.crossing_slope else 0.0


def interval_variables(name: str, interval: Interval) -> dict[str, xr.Variable]:
    """Return a quantity and its three companions as variables, under the names of the result schema."""
    numbers = (interval.value, interval.std, interval.low, interval.high)
    rows = {key: RESULT_VARIABLES[key] for key in (name, *companions(name))}
    return {
        key: xr.Variable(row.dims, values, {"units": row.unit, "long_name": row.meaning})
        for (key, row), values in zip(rows.items(), numbers, strict=True)
    }


MEANINGS = {
    "paper_resonance_hz": "largest mean of peaks over the nominal drive: the paper's, Eq. 6",
    "resonance_hz": "largest fundamental over the nominal drive",
    "resonance_measured_drive_hz": "largest fundamental over the measured drive: the joint's own",
    "phase_90_hz": "lag of 90° behind the measured drive",
}
"""What "resonance" can mean, by the quantity of the results that holds it. `sinew predict` gives Eq. 6's as well: of a
motion that repeats exactly, the mean of peaks is half of peak to peak."""


def resonance_table(results: xr.Dataset) -> list[dict[str, Any]]:
    """Return each meaning of resonance beside the others, one row for each pretension, ready for JSON.

    results: of a sweep. Keys: `pretension_mm`, and those of `MEANINGS`, each `{"value", "std", "interval90"}` with the
    standard deviation over repeats; None where it could not be read. Empty without a resonance.
    """
    if "resonance_hz" not in results:
        return []
    rows = []
    for p, pretension in enumerate(results["pretension_mm"].values):
        row: dict[str, Any] = {"pretension_mm": float(pretension)}
        for name in (known for known in MEANINGS if known in results):
            names = (name, *companions(name))
            one = Estimate(*(float(results[key].values[p]) for key in names))
            row[name] = one.to_json() if math.isfinite(one.value) else None
        rows.append(row)
    return rows
