"""Rational curve through a measured resonance, whose peak can be read off between the points."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sinew.analysis.signal.coloured_noise import solve_scaled, unit_columns
from sinew.measure.arrays import Array, Complexes, Mask, wrapped_lag

_FULL = np.ones(8, dtype=bool)
_PLAIN = np.array([True, True, True, True, True, True, False, False])
_STEPS = 40
_MISFIT = 5.0
_GRID = 2001


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

    def weighted(self, complexes: Complexes) -> Array:
        """Return complex differences (n,) or (n, k) as weighted relative sizes and angles, (2n,) or (2n, k)."""
        shape = (-1,) + (1,) * (complexes.ndim - 1)
        relative = complexes / self.response.reshape(shape)
        sizes = self.size_weight.reshape(shape) * relative.real
        return np.concatenate([sizes, self.angle_weight.reshape(shape) * relative.imag])


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
        residual = _residual(parameters, points)
        fits = bool(residual @ residual <= _MISFIT * (residual.size - active.sum()))
        if not fits:
            amiss = np.mean(np.abs(evaluate_curve(parameters, v, w) / response - 1.0) ** 2)
            evened = _Points(v, w, response, *(1.0 / np.sqrt(variance + amiss) for variance in variances))
            parameters, points = _refine(parameters, evened, active), evened
        highest = float(np.abs(evaluate_curve(parameters, np.linspace(-1.0, 1.0, 401), w)).max())
        if np.isfinite(highest) and highest < 1.5 * float(np.abs(response).max()):
            root, freedom = _covariance_roots(parameters, points, active)
            return RationalCurve(centre, half, parameters, root, freedom, -1.0, 1.0, fits)
    return None


def _start(points: _Points, active: Mask) -> Array:
    """Return the parameters of the linearised problem H·D - N = 0, reweighted by 1/|D| four times."""
    v, response = points.v, points.response
    columns: list[NDArray[Any]] = [response, 1j * (1.0 + points.w * v) * response]
    for power in range(3):
        columns += [-(v**power) + 0j, -1j * v**power]
    design = np.stack(columns, axis=1)[:, active]
    target = response * (2.0 * v + points.w * v**2)
    parameters, scale = np.zeros(8), np.abs(response)
    for _ in range(4):
        parameters[active] = solve_scaled(points.weighted(scale[:, None] * design), points.weighted(scale * target))
        scale = 1.0 / np.maximum(np.abs(_denominator(parameters, v, points.w)), 1e-9)
    return parameters


def _jacobian(parameters: Array, points: _Points, active: Mask) -> Array:
    """Return the derivatives of the weighted curve, shape (2n, active parameters)."""
    denominator = _denominator(parameters, points.v, points.w)
    bent = -evaluate_curve(parameters, points.v, points.w) / denominator
    columns = [bent, 1j * (1.0 + points.w * points.v) * bent]
    for power in range(3):
        columns += [points.v**power / denominator, 1j * points.v**power / denominator]
    return points.weighted(np.stack(columns, axis=1)[:, active])


def _residual(parameters: Array, points: _Points) -> Array:
    return points.weighted(points.response - evaluate_curve(parameters, points.v, points.w))


def _refine(parameters: Array, points: _Points, active: Mask) -> Array:
    """Return the parameters of the least weighted residual, by Levenberg-Marquardt from a start."""
    damping, residual = 1e-6, _residual(parameters, points)
    for _ in range(_STEPS):
        jacobian = _jacobian(parameters, points, active)
        size = np.sqrt(damping) * np.linalg.norm(jacobian, axis=0)
        step = np.zeros(8)
        step[active] = solve_scaled(np.concatenate([jacobian, np.diag(size)]), np.append(residual, 0.0 * size))
        trial = _residual(parameters + step, points)
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
    return parameters


def _covariance_roots(parameters: Array, points: _Points, active: Mask) -> tuple[Array, tuple[float, float]]:
    """Return roots of the covariance from sizes and from angles, (8, 16), and the degrees of freedom of each.

    Sizes and angles are scaled each by their own residual, for jitter of the stamps is in the angles alone.
    """
    jacobian, residual = _jacobian(parameters, points, active), _residual(parameters, points)
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


def read_curve(curve: RationalCurve) -> tuple[Array, bool]:
    """Return peak frequency, gain, width, crossing and lag slope of the curve and its neighbours, shape (33, 5), and
    whether the curve itself has its peak inside the window."""
    v = np.linspace(curve.low, curve.high, _GRID)
    h = evaluate_curve(parameter_spread(curve), v, curve.half_width_hz / curve.centre_hz)
    gain = np.abs(h)
    rows = np.arange(gain.shape[0])
    top = np.clip(np.argmax(gain, axis=1), 1, _GRID - 2)
    before, middle, after = (gain[rows, top + i] for i in (-1, 0, 1))
    bend = before - 2.0 * middle + after
    shift = np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, -1.0), 0.0).clip(-1.0, 1.0)
    largest = middle - 0.25 * (before - after) * shift
    width = np.full(rows.size, np.nan)
    crossing, slope = np.full(rows.size, np.nan), np.full(rows.size, np.nan)
    lag = wrapped_lag(h)
    for row in rows:
        level = gain[row] - largest[row] / math.sqrt(2.0)
        left, right = _zero(-level[top[row] :: -1]), _zero(-level[top[row] :])
        width[row] = left + right
        passes = np.flatnonzero((lag[row, :-1] < 0.5 * np.pi) & (lag[row, 1:] >= 0.5 * np.pi))
        passes = passes[lag[row, passes + 1] - lag[row, passes] < 0.5 * np.pi]
        if passes.size:
            at = int(passes[np.argmin(np.abs(passes - top[row]))])
            crossing[row] = at + _zero(lag[row, at : at + 2] - 0.5 * np.pi)
            slope[row] = lag[row, at + 1] - lag[row, at]
    pitch = (v[1] - v[0]) * curve.half_width_hz
    start = curve.centre_hz + curve.low * curve.half_width_hz
    readings = np.stack(
        [start + pitch * (top + shift), largest, pitch * width, start + pitch * crossing, slope / pitch]
    )
    inside = 1 < np.argmax(gain[0]) < _GRID - 2
    return readings.T, bool(inside)


def _zero(values: Array) -> float:
    """Return the fractional index of the first passage from below to zero, NaN where there is none."""
    above = np.flatnonzero(values >= 0)
    if above.size == 0 or above[0] == 0:
        return math.nan if above.size == 0 else 0.0
    at = int(above[0])
    return float(at - 1 - values[at - 1] / (values[at] - values[at - 1]))
