"""The resonance of a response curve: its peaks by each meaning, 90° crossing and half-power width, with intervals.

"Resonance" has several meanings, and a joint that bends under a motor that saturates tells them apart by a percent: the
frequency of the largest mean of peaks over the nominal drive (Eq. 6, the paper's: `paper_resonance_hz`), of the
largest fundamental over it (`resonance_hz`), of the largest gain by measured drive, and that of 90° of lag.
`resonance_table` sets them side by side.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
import scipy
import xarray as xr
from numpy.typing import NDArray

from sinew.analysis.signal.least_squares import solve_damped, unit_columns
from sinew.analysis.signal.repeats import combine_repeats, interval_rows, interval_variables
from sinew.analysis.sweep.response import Response
from sinew.measure.arrays import Array, Complexes, Mask, mean_of_known, wrapped_lag
from sinew.measure.estimate import Estimate
from sinew.measure.recording import FEWEST_FREQUENCIES, too_few_frequencies
from sinew.measure.result import plain

# ---- rational curve through a measured resonance, whose peak can be read off between the points


_FULL = np.ones(8, dtype=bool)
_PLAIN = np.array([True, True, True, True, True, True, False, False])
_STEPS = 40
_MISFIT = 5.0
_FINE = 1001
_CHUNK = 16  # curves whose neighbours are read at once: what fits the cache


class RationalCurves(NamedTuple):
    """H(v) = (c₀ + c₁v + c₂v²) / (a + jb(1 + wv) - 2v - wv²) around resonances, v = (f - centre)/half_width, k curves.

    w = half_width/centre, so the denominator is a - (u² - 1)/w + jbu with u = f/centre: one resonance times whatever
    is smooth (inertia, a drive that falls short). The linear joint I_l ω²/(k - Iω² + jdω) is contained exactly,
    hysteretic damping to second order in w. A damping of free slope would not do: over a narrow window it only turns
    denominator and numerator alike.
    found: whether there is a curve, shape (k,); where there is none, the rest says nothing. centre_hz, half_width_hz:
    of the points, shape (k,). parameters: a, b, Re c₀, Im c₀, Re c₁, ..., shape (k, 8). covariance_root: shape (k, 8,
    16), covariance = root·rootᵀ, eight columns from the residual of the sizes, eight from that of the angles;
    degrees_of_freedom of the two, shape (k, 2). fits: whether the residual is no more than the noise of the points
    explains, shape (k,).
    """

    found: Mask
    centre_hz: Array
    half_width_hz: Array
    parameters: Array
    covariance_root: Array
    degrees_of_freedom: Array
    fits: Mask

    def of(self, rows: Any) -> "RationalCurves":
        """Return some of the curves."""
        return RationalCurves(*_of(self, rows))


def _of(columns: Iterable[NDArray[Any]], rows: Any) -> list[Any]:
    return [values[rows] for values in columns]


def _fraction(parameters: Array, v: Array, w: Array) -> tuple[Complexes, Complexes]:
    """Return numerator and denominator of curves of parameters (k, 8), at v of shape (n,) or (k, n); w: shape (k,)."""
    c, w = np.asarray(parameters[:, 2::2] + 1j * parameters[:, 3::2]), w[:, None]
    numerator = c[:, 0, None] + v * (c[:, 1, None] + v * c[:, 2, None])
    denominator = parameters[:, 0, None] - v * (2.0 + w * v) + 1j * parameters[:, 1, None] * (1.0 + w * v)
    return np.asarray(numerator), np.asarray(denominator)


class _Points(NamedTuple):
    """What is fitted: k curves of n points, a point of no weight where a curve has fewer.

    under: what a and b are multiplied by in the denominator, shape (k, 2, n); alone: what it lacks beside them, (k, n).
    over: what Re c₀, Im c₀, Re c₁, ... are multiplied by in the numerator, shape (k, 6, n). response: complex, (k, n).
    weight: of the relative residual's size and angle, shape (k, 1, 2, n).
    """

    under: Complexes
    alone: Array
    over: Complexes
    response: Complexes
    weight: Array

    @staticmethod
    def of_response(v: Array, w: Array, response: Complexes, weight: Array) -> "_Points":
        """Return the points at v (k, n) of windows of relative half width w (k,)."""
        slope, one = w[:, None] * v, np.ones_like(v)
        powers = np.stack([one, 1j * one, v, 1j * v, v**2, 1j * v**2], axis=1)
        return _Points(np.stack([one, 1j * (1.0 + slope)], axis=1), v * (2.0 + slope), powers, response, weight)

    def of(self, rows: Mask) -> "_Points":
        """Return the points of some of the curves."""
        return _Points(*_of(self, rows))

    def weighted(self, complexes: Complexes) -> Array:
        """Return complex differences (k, m, n) as weighted relative sizes and angles, (k, m, 2n)."""
        relative = complexes / self.response[:, None]
        parts = self.weight * np.stack([relative.real, relative.imag], axis=2)
        return parts.reshape(*parts.shape[:2], 2 * parts.shape[3])

    def denominator(self, parameters: Array) -> Complexes:
        """Return the curves' denominators at the points, shape (k, n)."""
        return np.asarray((parameters[:, None, :2] @ self.under)[:, 0] - self.alone)

    def residual(self, parameters: Array) -> tuple[Array, Complexes, Complexes]:
        """Return the weighted residual (k, 2n) of curves, the curves and their denominators, shape (k, n) each."""
        denominator = self.denominator(parameters)
        curve = (parameters[:, None, 2:] @ self.over)[:, 0] / denominator
        return self.weighted((self.response - curve)[:, None])[:, 0], curve, denominator

    def jacobian(self, curve: Complexes, denominator: Complexes, active: Mask) -> Array:
        """Return the derivatives of the weighted curves, shape (k, 2n, active parameters)."""
        columns = np.concatenate([-curve[:, None] * self.under, self.over], axis=1)[:, active] / denominator[:, None]
        return self.weighted(columns).transpose(0, 2, 1)


def _packed(used: Mask, *columns: NDArray[Any]) -> tuple[Any, ...]:
    """Return which places of (k, n) hold a point once the used ones are moved to the front, and the columns so."""
    count = used.sum(axis=1)
    order = np.argsort(~used, axis=1, kind="stable")[:, : max(1, count.max(initial=0))]
    moved = (np.take_along_axis(np.broadcast_to(column, used.shape), order, axis=1) for column in columns)
    return np.arange(order.shape[1]) < count[:, None], *moved


def _median(values: Array, held: Mask) -> Array:
    """Return the median of what is held, shape (k, 1), of values (k, n); at least one is."""
    ordered, last = np.sort(np.where(held, values, np.inf), axis=1), held.sum(axis=1, keepdims=True) - 1
    return np.asarray(0.5 * sum(np.take_along_axis(ordered, at, axis=1) for at in (last // 2, (last + 1) // 2)))


def fit_curves(
    frequency_hz: Array, response: Complexes, size_std: Array, angle_std: Array, used: Mask
) -> RationalCurves:
    """Return the weighted least-squares curves through complex points, all of shape (k, n), each by those used of it.

    size_std: relative, of the response's size; angle_std: of its angle [rad]. To each variance 0.3 of the median one
    is added, for they are estimates themselves; only their ratios matter, since the covariance is scaled by the
    residual. Where that is far beyond the noise the joint is not linear and the curve an approximation: the points
    then weigh alike. Start by Levy's linearisation with Sanathanan and Koerner's reweighting, then
    Levenberg-Marquardt on the true residual. Where all eight parameters give a curve that leaves the points (too few,
    too noisy), six do: a straight numerator. At least six points are needed, and a response at each. All curves are
    fitted in step, and each as it would be alone.
    """
    count = used.shape[0]
    none, unknown = np.zeros((2, count), dtype=bool), np.full((4, count), np.nan)
    parameters, root = np.full((count, 8), np.nan), np.full((count, 8, 16), np.nan)
    curves = RationalCurves(none[0], unknown[0], unknown[1], parameters, root, unknown[2:].T, none[1])
    rows = np.flatnonzero((used.sum(axis=1) >= 6) & ((response != 0) | ~used).all(axis=1))
    for active in (_FULL, _PLAIN):
        if rows.size:
            points = _packed(used[rows], *_of((frequency_hz, response, size_std, angle_std), rows))
            some = _fit_alike(active, *points)
            for values, found in zip(curves, some, strict=True):
                values[rows] = found
            rows = rows[~some.found]
    return curves


def _fit_alike(
    active: Mask, held: Mask, frequency_hz: Array, response: Complexes, size_std: Array, angle_std: Array
) -> RationalCurves:
    """Return the curves with the active parameters through points (k, n), those held: at the front, six or more."""
    response = np.where(held, response, 1.0)
    count = held.sum(axis=1)
    first, last = frequency_hz[:, 0], _picked(frequency_hz, count - 1)
    centre, half = 0.5 * (first + last), 0.5 * (last - first)
    v, w = np.where(held, (frequency_hz - centre[:, None]) / half[:, None], 0.0), half / centre
    squares = (np.where(held, std, 1.0) ** 2 for std in (size_std, angle_std))
    variance = np.stack([square + 0.3 * _median(square, held) + 1e-20 for square in squares], axis=1)[:, None]
    there = held[:, None, None]
    points = _Points.of_response(v, w, response, there / np.sqrt(variance))
    parameters = _refine(_start(points, active), points, active)
    residual, fitted, _ = points.residual(parameters)
    fits = (residual**2).sum(axis=1) <= _MISFIT * (2 * count - active.sum())
    if not fits.all():
        amiss = (held * np.abs(fitted / response - 1.0) ** 2).sum(axis=1) / count
        points = points._replace(weight=there / np.sqrt(variance + np.where(fits, 0.0, amiss)[:, None, None, None]))
        parameters[~fits] = _refine(parameters[~fits], points.of(~fits), active)
    numerator, denominator = _fraction(parameters, np.linspace(-1.0, 1.0, 401), w)
    found = np.abs(numerator / denominator).max(axis=1) < 1.5 * (held * np.abs(response)).max(axis=1)
    root, freedom = np.full((count.size, 8, 16), np.nan), np.full((count.size, 2), np.nan)
    root[found], freedom[found] = _covariance_roots(parameters[found], points.of(found), active, count[found])
    return RationalCurves(found, centre, half, parameters, root, freedom, fits)


def _start(points: _Points, active: Mask) -> Array:
    """Return the parameters (k, 8) of the linearised problem H·D - N = 0, reweighted by 1/|D| four times."""
    response = points.response[:, None]
    design = np.concatenate([response * points.under, -points.over], axis=1)[:, active]
    target = response * points.alone[:, None]
    parameters, scale = np.zeros((response.shape[0], 8)), np.abs(response)
    for _ in range(4):
        rows = points.weighted(scale * design).transpose(0, 2, 1)
        parameters[:, active] = solve_damped(rows, points.weighted(scale * target)[:, 0], 1e-26)
        scale = 1.0 / np.maximum(np.abs(points.denominator(parameters)), 1e-9)[:, None]
    return parameters


def _refine(parameters: Array, points: _Points, active: Mask) -> Array:
    """Return the parameters (k, 8) of the least weighted residual, by Levenberg-Marquardt from a start.

    Each curve has its own damping, and leaves when it has converged.
    """
    refined, rows = parameters.copy(), np.arange(parameters.shape[0])
    damping, (residual, curve, denominator) = np.full(rows.size, 1e-6), points.residual(parameters)
    jacobian = points.jacobian(curve, denominator, active)
    for _ in range(_STEPS):
        moved = refined[rows]
        moved[:, active] += solve_damped(jacobian, residual, damping)
        trial, curve, denominator = points.residual(moved)
        left = (trial**2).sum(axis=1)
        gained = (residual**2).sum(axis=1) - left
        better = gained > 0
        refined[rows[better]], residual[better] = moved[better], trial[better]
        jacobian[better] = points.jacobian(curve, denominator, active)[better]
        damping = np.where(better, np.maximum(damping * 0.1, 1e-14), damping * 10.0)
        moving = np.where(better, gained > 1e-7 * left, damping <= 1e6)
        if not moving.all():
            rows, damping, residual, jacobian = _of((rows, damping, residual, jacobian), moving)
            points = points.of(moving)
        if not rows.size:
            break
    return refined


def _covariance_roots(parameters: Array, points: _Points, active: Mask, count: NDArray[np.intp]) -> tuple[Array, Array]:
    """Return roots of the covariance from sizes and angles, (k, 8, 16), and the degrees of freedom of each, (k, 2).

    count: of each curve's points, (k,). Sizes and angles are scaled each by their own residual, for jitter of the
    stamps is in the angles alone. Their shares of an orthonormal basis add up to one: they have the same axes.
    """
    residual, curve, denominator = points.residual(parameters)
    scaled, scale = unit_columns(points.jacobian(curve, denominator, active))
    left, singular, right = np.linalg.svd(scaled, full_matrices=False)
    spread = right.transpose(0, 2, 1) / np.maximum(singular, 1e-10 * singular[:, :1])[:, None] / scale[:, :, None]
    sizes = left[:, : left.shape[1] // 2]
    share, axes = np.linalg.eigh(sizes.transpose(0, 2, 1) @ sizes)
    shares = np.stack([share, 1.0 - share], axis=1).clip(0.0)
    freedom = np.maximum(count[:, None] - shares.sum(axis=2), 0.5)
    deviation = np.sqrt((residual.reshape(*freedom.shape, sizes.shape[1]) ** 2).sum(axis=2) / freedom)
    root = np.zeros((count.size, 8, 2, 8))
    columns = deviation[:, :, None] * np.sqrt(shares)
    root[:, active, :, : share.shape[1]] = (spread @ axes)[:, :, None] * columns[:, None]
    return root.reshape(count.size, 8, 16), freedom


def parameter_spread(curves: RationalCurves) -> Array:
    """Return the parameters and their 32 neighbours one standard deviation away along the columns of the covariance.

    Shape (k, 33, 8): the centre, then plus and minus of each column. Half the difference of any reading over a pair is
    that column's share of the reading's standard deviation.
    """
    centre, steps = curves.parameters[:, None], curves.covariance_root.transpose(0, 2, 1)
    return np.concatenate([centre, centre + steps, centre - steps], axis=1)


def _swept(curves: RationalCurves, parameters: Array) -> tuple[Array, Complexes]:
    """Return the size of curves of some parameters (k·m, 8), m of each curve, on a fine even grid over its window, and
    the response times what makes it real and positive, (k·m, n) each."""
    w = np.repeat(curves.half_width_hz / curves.centre_hz, parameters.shape[0] // max(1, curves.found.size))
    v = np.asarray(np.arange(_FINE) * (2.0 / (_FINE - 1)) - 1.0)
    numerator, denominator = _fraction(parameters, v, w)
    size = denominator.real**2 + denominator.imag**2
    return np.sqrt((numerator.real**2 + numerator.imag**2) / size), numerator * denominator.conj()


def _tops(gain: Array) -> tuple[NDArray[np.intp], Array, Array]:
    """Return where each curve (k, n) is largest, what a parabola adds to that [grid points], and its height, (k,)."""
    top = np.argmax(gain, axis=1).clip(1, _FINE - 2)
    before, middle, after = (_picked(gain, top + step) for step in (-1, 0, 1))
    bend = before - 2.0 * middle + after
    shift = np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, -1.0), 0.0).clip(-1.0, 1.0)
    return top, shift, middle - 0.25 * (before - after) * shift


def _widths(gain: Array, top: NDArray[np.intp], level: Array) -> Array:
    """Return how far it is between the points beside the top that are as low as a level [grid points], (k,)."""
    fine_index, low = np.arange(_FINE), gain <= level[:, None]
    width = np.zeros(top.size)
    for side in (-1, 1):
        away = side * (fine_index - top[:, None])
        first = np.where(low & (away > 0), away, _FINE).min(axis=1)
        outer = (top + side * first).clip(0, _FINE - 1)
        inside, outside = _picked(gain, (outer - side).clip(0, _FINE - 1)), _picked(gain, outer)
        with np.errstate(divide="ignore", invalid="ignore"):
            width += np.where(first < _FINE, first - 1 + (inside - level) / (inside - outside), np.nan)
    return width


def _crossings(turned: Complexes, top: NDArray[np.intp]) -> tuple[Array, Array]:
    """Return where the lag passes 90° nearest to the top [grid points], and by how much it grows there, (k,)."""
    ahead = turned.real > 0  # a lag below 90°
    row, at = np.nonzero(ahead[:, :-1] & ~ahead[:, 1:])
    lag = wrapped_lag(turned[row, at])
    grown = wrapped_lag(turned[row, at + 1]) - lag
    nearest = np.lexsort((np.abs(at - top[row]), row))
    nearest = nearest[grown[nearest] < 0.5 * np.pi]
    row, first = np.unique(row[nearest], return_index=True)
    chosen = nearest[first]
    where, slope = np.full(top.size, np.nan), np.full(top.size, np.nan)
    where[row] = at[chosen] + (0.5 * np.pi - lag[chosen]) / grown[chosen]
    slope[row] = grown[chosen]
    return where, slope


def _picked(values: NDArray[Any], at: NDArray[np.intp]) -> NDArray[Any]:
    """Return one value of each row, (k,), of (k, n)."""
    return values[np.arange(at.size), at]


def read_curves(curves: RationalCurves) -> tuple[Array, Mask]:
    """Return peak frequency, gain, width, crossing and lag slope of curves and their neighbours, shape (k, 33, 5), and
    whether a curve itself has its peak inside the window, shape (k,)."""
    readings, inside = np.empty((curves.found.size, 33, 5)), np.empty(curves.found.size, dtype=bool)
    for first in range(0, curves.found.size, _CHUNK):
        rows = slice(first, first + _CHUNK)
        centre, half = curves.centre_hz[rows, None], curves.half_width_hz[rows, None]
        gain, turned = _swept(curves.of(rows), parameter_spread(curves.of(rows)).reshape(-1, 8))
        top, shift, largest = _tops(gain)
        width = _widths(gain, top, largest / math.sqrt(2.0))
        grid = top + shift, largest, width, *_crossings(turned, top)
        at, largest, width, crossing, slope = (values.reshape(-1, 33) for values in grid)
        pitch, start = half * (2.0 / (_FINE - 1)), centre - half
        found = start + pitch * at, largest, pitch * width, start + pitch * crossing, slope / pitch
        readings[rows] = np.stack(found, axis=2)
        inside[rows] = (top[::33] > 1) & (top[::33] < _FINE - 2)
    return readings, inside


# The top of a response curve that no linear resonance describes is read by itself.


# ---- the resonance of a response curve


_DEGREE = 4
_GRID = 4001


class Crests(NamedTuple):
    """Where curves are largest, by their highest points alone; NaN where they have no maximum there.

    frequency_hz, gain: of the maximum, shape (k,); frequency_std_hz, gain_std: from the noise of the points.
    """

    frequency_hz: Array
    gain: Array
    frequency_std_hz: Array
    gain_std: Array


def fit_crests(frequency_hz: Array, gain: Array, relative_std: Array, used: Mask) -> Crests:
    """Return the maxima of curves through points, all of shape (k, n), each by those used of it, five or more.

    A polynomial of fourth degree is fitted to 1/gain², which for a linear resonance is nearly a parabola and for one
    that leans or flattens still a smooth curve, where the gain itself has a sharp top. Its noise is that of the points
    (relative_std), or of the residual where that is larger.
    """
    held, f, gain, noise = _packed(used, frequency_hz, gain, relative_std)
    count = held.sum(axis=1)
    first, last = f[:, 0], _picked(f, count - 1)
    centre, half = 0.5 * (first + last), 0.5 * (last - first)
    v, inverse = np.where(held, (f - centre[:, None]) / half[:, None], 0.0), np.where(held, gain, 1.0) ** -2.0
    weight = held / (2.0 * inverse * np.maximum(np.where(held, noise, 1.0), 1e-12))
    powers = np.arange(_DEGREE, -1, -1)
    left, singular, right = np.linalg.svd(v[:, :, None] ** powers * weight[:, :, None], full_matrices=False)
    root, target = right.transpose(0, 2, 1) / singular[:, None], (inverse * weight)[:, :, None]
    shares = left.transpose(0, 2, 1) @ target
    fitted, misfit = (root @ shares)[:, :, 0], ((target - left @ shares)[:, :, 0] ** 2).sum(axis=1)
    root *= np.sqrt(np.maximum(1.0, misfit / np.maximum(count - _DEGREE - 1, 1)))[:, None, None]
    grid = np.linspace(-1.0, 1.0, _GRID)
    values = fitted @ grid ** powers[:, None]
    at = np.argmin(values, axis=1)
    top, level = grid[at][:, None], _picked(values, at)
    slopes = powers * top ** np.maximum(powers - 1, 0)
    bend = (fitted * powers * (powers - 1) * top ** np.maximum(powers - 2, 0)).sum(axis=1)
    known = (at > 0) & (at < _GRID - 1) & (level > 0) & (bend > 0)
    level, bend = np.where(known, level, np.nan), np.where(known, bend, np.nan)
    along, across = (np.linalg.norm((row[:, None] @ root)[:, 0], axis=1) for row in (slopes, top**powers))
    frequency = np.where(known, centre + half * top[:, 0], np.nan)
    return Crests(frequency, level**-0.5, half * along / bend, 0.5 * level**-1.5 * across)


_WINDOW_GAIN = 0.55
_WINDOW_POINTS = 8
_WINDOW_REACH = 0.6
_TOP_GAIN = 0.8
_TOP_POINTS = (5, 6)  # at least, of the polynomial and of the narrow rational curve
_NO_CURVE = "no smooth curve fits the points around the {}; measure more frequencies there"
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


def _run(centre: NDArray[np.intp], good: Mask, cost: Array, fewest: int) -> Mask:
    """Return the contiguous good points around a centre (k,) as a mask (k, n), at least `fewest`.

    Where more are needed, the cheaper of the two neighbours joins; cost: shape (k, n), infinite where no point is.
    """
    fine_index, middle = np.arange(good.shape[1]), centre[:, None]
    low = np.where(~good & (fine_index < middle), fine_index, -1).max(axis=1) + 1
    high = np.where(~good & (fine_index > middle), fine_index, fine_index.size).min(axis=1) - 1
    beside = np.pad(cost, ((0, 0), (1, 1)), constant_values=np.inf)
    least = np.minimum(fewest, np.isfinite(cost).sum(axis=1))
    for _ in range(fewest - 1):
        short, left = high - low + 1 < least, _picked(beside, low) <= _picked(beside, high + 2)
        low, high = low - (short & left), high + (short & ~left)
    return np.asarray((fine_index >= low[:, None]) & (fine_index <= high[:, None]))


def _window(frequency: Array, closeness: Array, held: Mask, centre: NDArray[np.intp]) -> Mask:
    """Return the contiguous points around a centre whose closeness stays above the limit, at least eight; (k, n)."""
    middle = _picked(frequency, centre)[:, None]
    away = np.where(held, np.abs(frequency - middle), np.inf)
    return _run(centre, (closeness >= _WINDOW_GAIN) & (away <= _WINDOW_REACH * middle), away, _WINDOW_POINTS)


def _finite(frequency: Array, response: Complexes, *stds: Array) -> tuple[Any, ...]:
    """Return which places hold a point once those at which everything is known are moved to the front, (k, n), and
    frequency, response, zero where no point is, and standard deviations so."""
    known = np.isfinite(response) & np.all(np.isfinite(stds), axis=0)
    held, frequency, response, *moved = _packed(known, frequency, response, *stds)
    return held, frequency, np.where(held, response, 0.0), *moved


def find_peaks(frequency_hz: Array, response: Complexes, size_std: Array, angle_std: Array) -> list[Peak]:
    """Return the resonances of complex response curves at frequencies (f,), NaN points left out.

    response: shape (k, f). size_std: relative standard deviation of its size; angle_std: of its angle [rad]; (k, f).
    A rational curve (`RationalCurves`) is fitted to the points around the largest gain, down to 0.55 of
    it; peak, crossing and width are read off the curve and their standard deviations propagated from its covariance.
    Where that curve misfits by more than the noise explains (a drive that saturates, a joint that hardens), frequency
    and gain of the peak are read off its top alone (points above 0.8 of the largest gain;
    `fit_crests`), and their standard deviations hold the disagreement with a rational curve through that top.
    A largest gain at the edge of the points is no resonance: the readings are NaN and `reason` says so.
    """
    held, f, h, size, angle = _finite(frequency_hz, response, size_std, angle_std)
    gain, enough = np.abs(h), held.sum(axis=1) >= FEWEST_FREQUENCIES
    largest = gain.max(axis=1, keepdims=True)
    closeness = np.where(held, gain / np.where(largest > 0, largest, 1.0), 0.0)
    window = _window(f, closeness, held, np.argmax(gain, axis=1)) & enough[:, None]
    curves = fit_curves(f, h, size, angle, window)
    peaks = [
        Peak(reason=_NO_CURVE.format("largest gain") if many else too_few_frequencies(int(number)))
        for many, number in zip(enough, held.sum(axis=1), strict=True)
    ]
    rows = np.flatnonzero(curves.found)
    curves = curves.of(rows)
    values, inside = read_curves(curves)
    readings, misfit = _readings_of(values, curves), np.zeros((rows.size, 2))
    polished = inside & ~curves.fits
    if polished.any():
        own = _of((held, f, h, size, angle), rows[polished])
        readings[polished, :2], misfit[polished] = _polished(readings[polished, :2], *own)
    for i, row in enumerate(rows):
        if not inside[i]:
            edge = "lowest" if values[i, 0, 0] < curves.centre_hz[i] else "highest"
            reason = f"the gain is largest at the {edge} frequency of the sweep; extend the sweep beyond it"
            peaks[row] = Peak(reason=reason)
            continue
        reason = "" if np.isfinite(values[i, 0, 2]) else "the sweep does not reach down to half power on both sides"
        frequency, top, width, crossing = map(tuple, readings[i].tolist())
        off, gain_off = misfit[i].tolist()
        peaks[row] = Peak(frequency, top, width, crossing, float(values[i, 0, 4]), off, gain_off, reason)
    return peaks


def _polished(wide: Array, held: Mask, f: Array, h: Complexes, size: Array, angle: Array) -> tuple[Array, Array]:
    """Return frequency and gain of peaks read off the top of the points alone, (k, 2, 3), their misfit, (k, 2), that of
    two models of that top.

    wide: the same of the wide curves, whose standard deviations, scaled by the residual, belong to the misfit too.
    """
    gain = np.abs(h)
    highest = np.argmax(gain, axis=1)
    good, cost = held & (gain >= _TOP_GAIN * gain.max(axis=1, keepdims=True)), np.where(held, -gain, np.inf)
    near, beside = (_run(highest, good, cost, fewest) for fewest in _TOP_POINTS)
    crest = np.stack(fit_crests(f, gain, size, near), axis=1)
    known = np.isfinite(crest[:, 0])
    narrow = fit_curves(f, h, size, angle, beside & known[:, None])
    where = np.where(known[:, None], crest[:, :2], wide[:, :, 0])
    noise = np.where(known[:, None], crest[:, 2:], 0.0)
    other = np.where(known[:, None], wide[:, :, 0], np.stack([_picked(f, highest), _picked(gain, highest)], axis=1))
    other[narrow.found] = _read_tops(narrow.of(narrow.found))
    misfit = np.hypot(where - other, wide[:, :, 1])
    both = np.hypot(noise, misfit)
    # Welch and Satterthwaite, with a misfit taken as known.
    freedom = wide[:, :, 2] * np.divide(both, noise, out=np.full_like(both, np.inf), where=noise > 0) ** 4
    return np.stack([where, both, freedom], axis=2), misfit


def _read_tops(curves: RationalCurves) -> Array:
    """Return frequency [Hz] and gain of the curves' peaks, (k, 2)."""
    top, shift, largest = _tops(_swept(curves, curves.parameters)[0])
    v = (top + shift) * (2.0 / (_FINE - 1)) - 1.0
    return np.stack([curves.centre_hz + v * curves.half_width_hz, largest], axis=1)


def _readings_of(values: Array, curves: RationalCurves) -> Array:
    """Return (value, std, degrees of freedom) of frequency, gain, width and crossing, (k, 4, 3), from what each curve
    and its 32 neighbours say, (k, 33, 5)."""
    near, freedom = values[:, 1:, :4], curves.degrees_of_freedom[:, :, None]
    shares = (0.25 * (near[:, :16] - near[:, 16:]) ** 2).reshape(-1, 2, 8, 4).sum(axis=2)
    variance, spent = shares.sum(axis=1), (shares**2 / freedom).sum(axis=1)
    whole = np.broadcast_to(freedom.sum(axis=1), spent.shape).copy()
    return np.stack(
        [values[:, 0, :4], np.sqrt(variance), np.divide(variance**2, spent, out=whole, where=spent > 0)], axis=2
    )


def find_crossings(frequency_hz: Array, response: Complexes, size_std: Array, angle_std: Array) -> list[Peak]:
    """Return Peaks that hold only the 90° crossing, from curves fitted around it instead of around the peak.

    Arguments as of `find_peaks`.
    """
    held, f, h, size, angle = _finite(frequency_hz, response, size_std, angle_std)
    lag = np.where(held, wrapped_lag(h), np.nan)
    passed = (lag < 0.5 * np.pi) & np.pad(lag[:, 1:] >= 0.5 * np.pi, ((0, 0), (0, 1)))
    passes = passed.any(axis=1) & (held.sum(axis=1) >= FEWEST_FREQUENCIES)
    centre = np.argmax(np.where(passed, np.abs(h), -1.0), axis=1)
    window = _window(f, np.sin(np.clip(lag, 0.0, np.pi)), held, centre) & passes[:, None]
    curves = fit_curves(f, h, size, angle, window)
    reasons = ("the lag does not pass 90° inside the sweep; extend the sweep", _NO_CURVE.format("90° crossing"))
    peaks = [Peak(reason=reasons[int(there)]) for there in passes]
    rows = np.flatnonzero(curves.found)
    values, _ = read_curves(curves.of(rows))
    readings = _readings_of(values, curves.of(rows))
    for i, row in enumerate(rows):
        peaks[row] = Peak(crossing_hz=tuple(readings[i, 3].tolist()), crossing_slope=float(values[i, 0, 4]))
    return peaks


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


def by_repeat(values: NDArray[Any]) -> NDArray[Any]:
    """Return a column of a response, (p, f, r), with one row for each pretension and repeat, (p·r, f)."""
    return np.swapaxes(values, 1, 2).reshape(-1, values.shape[1])


def read_resonances(response: Response) -> Readings:
    """Return the resonance of every pretension and repeat, each fitted by itself."""
    shape, f = (response.pretension_mm.size, response.transfer.shape[2]), response.frequency_hz
    columns = {name: by_repeat(values) for name, values in response.columns.items()}
    transfer, nominal_transfer = by_repeat(response.transfer), by_repeat(response.nominal_transfer)
    harmonic = columns["gain_harmonic"]
    over_fundamental = np.divide(columns["gain"], harmonic, out=np.full_like(harmonic, np.nan), where=harmonic > 0)
    stds = by_repeat(response.nominal_gain_std), by_repeat(response.nominal_phase_std)
    by_drive = transfer, columns["gain_measured_drive_std"] / columns["gain_measured_drive"], columns["phase_std_rad"]
    # The mean of peaks over the nominal drive (Eq. 6) is taken at the fundamental's angles.
    curves = zip((nominal_transfer * over_fundamental, *stds), (nominal_transfer, *stds), by_drive, strict=True)
    peaks, count = find_peaks(f, *map(np.concatenate, curves)), harmonic.shape[0]
    paper, nominal, measured = peaks[:count], peaks[count : 2 * count], peaks[2 * count :]
    crossing = measured.copy()
    absent = [row for row, peak in enumerate(measured) if not math.isfinite(peak.crossing_hz[0])]
    if absent:
        for row, peak in zip(absent, find_crossings(f, *(values[absent] for values in by_drive)), strict=True):
            crossing[row] = peak
    quantities = {
        "paper_resonance_hz": _column(paper, "frequency_hz", "frequency_misfit_hz"),
        "paper_gain_peak": _column(paper, "gain", "gain_misfit"),
        "resonance_hz": _column(nominal, "frequency_hz", "frequency_misfit_hz"),
        "resonance_measured_drive_hz": _column(measured, "frequency_hz", "frequency_misfit_hz"),
        "gain_peak_measured_drive": _column(measured, "gain", "gain_misfit"),
        "half_power_width_hz": _column(measured, "width_hz"),
    }
    at = quantities["resonance_hz"]
    gain, gain_std, freedom, misfit = _column(nominal, "gain", "gain_misfit")
    ratio, ratio_std = _local(f, over_fundamental, at[0])
    quantities["gain_peak"] = gain * ratio, np.hypot(gain_std * ratio, gain * ratio_std), freedom, misfit
    where, *rest, slope = _column(crossing, "crossing_hz", "crossing_slope")
    late = read_each(f, columns["phase_delay_std_rad"], where, "line", fewest=2)
    of_delay = np.divide(late, np.abs(slope), out=np.zeros_like(late), where=np.isfinite(late) & (slope != 0))
    quantities["phase_90_hz"] = where, *rest, of_delay
    lever = columns["drive_amplitude_rad"] * np.exp(1j * np.angle(nominal_transfer * transfer.conj()))
    quantities["drive_amplitude_at_resonance_rad"] = _drive_at(f, lever, columns["drive_amplitude_std_rad"], at)
    parts = [{name: quantities[name][i].reshape(shape) for name in RESONANCES} for i in range(4)]
    notes = []
    for (p, r), *said in zip(np.ndindex(*shape), nominal, measured, crossing, strict=True):
        used = said[1:] if math.isfinite(said[0].frequency_hz[0]) else said  # no one asks for a nominal width
        reasons = " and ".join(dict.fromkeys(peak.reason for peak in used if peak.reason))
        if reasons and np.isfinite(response.columns["gain_harmonic"][p, :, r]).any():
            notes.append(f"{response.pretension_mm[p]:g} mm, repeat {r}: {reasons}")
    return Readings(parts[0], parts[1], parts[2], parts[3], tuple(notes))


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


_Column = tuple[Array, Array, Array, Array]
"""Value, standard deviation, its degrees of freedom, and the standard uncertainty that repeats share: (k,) each."""


def _column(peaks: list[Peak], reading: str, shared: str = "") -> _Column:
    """Return a reading of peaks by its name, beside another field of theirs."""
    rows = [(*getattr(peak, reading), getattr(peak, shared) if shared else math.nan) for peak in peaks]
    value, std, freedom, common = np.array(rows, dtype=float).T
    return value, std, freedom, common


def read_each(
    x: Array,
    values: NDArray[Any],
    where: Array,
    curve: Literal["cubic", "akima", "line"] = "cubic",
    *,
    fewest: int = 4,
    derivative: int = 0,
) -> NDArray[Any]:
    """Return what each row (k, n) of values at x (n,), NaN left out, is at a place of its own, (k,).

    NaN with fewer known points than the fewest, and outside of them. curve: a cubic spline, Akima's, or straight lines
    from point to point. derivative: its order.
    """
    akima, line = scipy.interpolate.Akima1DInterpolator, partial(scipy.interpolate.make_interp_spline, k=1)
    spline: Any = {"cubic": scipy.interpolate.CubicSpline, "akima": akima, "line": line}[curve]
    out = np.full(where.shape, np.nan, dtype=values.dtype)
    for rows, known in alike(np.isfinite(values)):
        if known.sum() >= fewest:
            inside = rows[(where[rows] >= x[known][0]) & (where[rows] <= x[known][-1])]
            through = spline(x[known], values[np.ix_(inside, known)], axis=1)
            out[inside] = np.diagonal(through(where[inside], derivative))
    return out


def alike(known: Mask) -> Iterator[tuple[NDArray[np.intp], Mask]]:
    """Yield the numbers of those rows of (k, n) that know the same points, and the points, (n,)."""
    patterns, which = np.unique(known, axis=0, return_inverse=True)
    for number, pattern in enumerate(patterns):
        yield np.flatnonzero(which == number), pattern


def _drive_at(f: Array, lever: Complexes, own: Array, peak: _Column) -> _Column:
    """Return the measured drive amplitude at peaks [rad]; repeats share what the grid leaves open.

    lever: complex amplitude of the drive, (k, f); own: standard deviation of its size, (k, f).
    The lever gives way where the joint swings most, so that its amplitude over frequency is a V whose floor lies at the
    resonance, between two points of the grid. As a complex amplitude it passes smoothly: that is what is interpolated,
    by a cubic spline, and its size is read. The misfit is the difference to Akima's spline, and what the misfit of the
    peak's frequency makes of the slope there.
    """
    where, std, freedom, misfit = peak
    through = read_each(f, lever, where)
    other = read_each(f, lever.real, where, "akima") + 1j * read_each(f, lever.imag, where, "akima")
    value = np.abs(through)
    slope = (read_each(f, lever, where, derivative=1) * through.conj()).real / value
    noise_hz = np.sqrt(np.maximum(std**2 - misfit**2, 0.0))
    noise = np.hypot(read_each(f, own, where, "line", fewest=2), slope * noise_hz)
    left_open = np.hypot(np.abs(other) - value, slope * misfit)
    return value, np.hypot(noise, left_open), freedom, left_open


def _local(frequency: Array, values: Array, where: Array) -> tuple[Array, Array]:
    """Return value and standard deviation, (k,), at frequencies (k,), of straight lines through the six nearest points
    of each row (k, f)."""
    known, fine_index = np.isfinite(values), np.where(np.isfinite(where), where, frequency[0])
    away = np.where(known, np.abs(frequency - fine_index[:, None]), np.inf)
    near = np.argsort(away, axis=1, kind="stable")[:, :6]
    held, y, x = (np.take_along_axis(each, near, axis=1) for each in (known, values, frequency - fine_index[:, None]))
    inverse = np.linalg.pinv(np.stack([np.ones_like(x), x], axis=2) * held[:, :, None])
    y = np.where(held, y, 0.0)
    line = (inverse @ y[:, :, None])[:, :, 0]
    squares = (held * (y - line[:, :1] - line[:, 1:] * x) ** 2).sum(axis=1)
    count = held.sum(axis=1)
    std = np.linalg.norm(inverse[:, 0], axis=1) * np.sqrt(squares / np.maximum(count - 2, 1))
    few, usable = read_each(frequency, values, where, "line", fewest=2), (count >= 3) & np.isfinite(where)
    return np.where(usable, line[:, 0], few), np.where(usable, std, 0.0)


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

    results: of a sweep. Keys: `pretension_mm`, and those of `MEANINGS`, each as `Estimate.to_json`, with the standard
    deviation of the mean over repeats; None where it could not be read. Empty without a resonance.
    """
    if "resonance_hz" not in results:
        return []
    rows = interval_rows(results, [name for name in MEANINGS if name in results])
    return [
        {name: None if isinstance(one, Estimate) and math.isnan(one.value) else plain(one) for name, one in row.items()}
        for row in rows
    ]
