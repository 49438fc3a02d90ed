"""Marked points of a curve, located as points of their own: folds, peak and 90° of phase.

With x = (q / scale, Ω / omega), balance F(x) = 0 and tangent t(x), [F_x; nᵀ] t = (0, 1), a fold is an extremum of the
frequency along the curve and the peak one of the amplitude: g = ∇h·t = 0. The point is the solution of the extended
system F = 0, g = 0 by Newton's method. As F_x t = 0 along the curve, the derivative of g needs no second solve per
unknown: with y from [F_x; nᵀ]ᵀ (y, ·) = ∇h it is H_h t - yᵀ ∂F_x/∂t. The changes along the tangent are central
differences: they only steer Newton's method, g itself is exact.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array
from sinew.solve.balance import Equations, Lane, Size
from sinew.solve.examination import evaluate, half_range, lag_product, rows_of, solved

FOLD, PEAK, QUARTER = range(3)
"""Kinds: extremum of the frequency, extremum of the amplitude, response 90° behind the drive."""

_STEPS, _LONGEST, _IDLE = 10, 0.05, 3


class Search(NamedTuple):
    """How marked points are searched, in scaled unknowns. nudge: of the central differences. enough: last correction at
    which the search ends; a point whose last correction is larger counts as not found.

    Equations with kinks (a duty at its limit, friction that turns round) have a g that jumps a little where a kink
    passes a sample. Their nudge has to reach over several of these jumps; the points are as exact as the jumps allow,
    and a search that goes from one jump to the next, whose corrections become in three steps no half as long, is given
    up.
    """

    nudge: float = 1e-5
    enough: float = 1e-8


class Located(NamedTuple):
    """Points (k, m + 1) and size of the last correction (k,), in scaled unknowns; half of peak to peak of the response
    in its scale (k,), and drive times conjugate response, fundamentals, (k,)."""

    points: Array
    error: Array
    half_range: Array
    lag: NDArray[np.complex128]


def _height(x: Array, peak: Array, equations: Equations, harmonics: int) -> Array:
    """Return the gradient of what is extremal: the amplitude at a peak, the frequency at a fold."""
    gradient = half_range(x, equations, harmonics).gradient
    level = np.zeros_like(x)
    level[:, -1] = 1.0
    return np.where(peak[:, None], gradient, level)


def locate(
    x: Array, normal: Array, kind: NDArray[np.int64], lane: Lane, equations: Equations, size: Size, search: Search
) -> Located:
    """Return the marked points nearest to k guesses.

    x: (k, m + 1), on or near the curve. normal: tangents of the curve there, (k, m + 1). kind: of each, (k,).
    lane: with a leading axis k.
    """
    best, error = x.copy(), np.full(len(x), np.inf)
    there, tangents, left = x.copy(), normal.copy(), np.arange(len(x))
    near, idle = np.full(len(x), np.inf), np.zeros(len(x), dtype=int)
    for _ in range(_STEPS):
        now, across, own = there[left], normal[left], rows_of(lane, left)
        quarter, peak = kind[left] == QUARTER, kind[left] == PEAK
        bent = np.flatnonzero(~quarter)  # whose condition has derivatives along the curve in it
        nudge = search.nudge * tangents[left[bent]]
        beside = [now[bent] + nudge, now[bent] - nudge]
        lanes = rows_of(own, np.concatenate([np.arange(left.size), bent, bent]))
        seen = evaluate(np.concatenate([now, *beside]), lanes, equations, size)
        slope, ahead, behind = np.split(seen.slope, [left.size, left.size + bent.size])
        matrix = np.concatenate([slope, across[:, None, :]], axis=1)
        last = np.zeros_like(now)
        last[:, -1] = 1.0
        tangents[left] = tangent = solved(matrix, last)
        product, g_slope = lag_product(now, equations, size.harmonics)
        up = _height(now, peak, equations, size.harmonics)
        g = np.where(quarter, product.real, np.sum(up * tangent, axis=1))
        bend = np.subtract(*(_height(z, peak[bent], equations, size.harmonics) for z in beside))
        back = solved(matrix[bent].transpose(0, 2, 1), up[bent])[:, :-1]
        turn = np.einsum("ki,kij->kj", back, ahead - behind)
        g_slope[bent] = (bend - turn) / (2 * search.nudge)
        change = solved(
            np.concatenate([slope, g_slope[:, None, :]], axis=1),
            -np.concatenate([seen.left[: left.size], g[:, None]], axis=1),
        )
        length = np.linalg.norm(change, axis=1)
        there[left] += change * np.minimum(1.0, _LONGEST / np.maximum(length, 1e-300))[:, None]
        again = quarter & (error[left] >= search.enough)  # one more step is free of kinks
        nearer = (length > _LONGEST) | (length < 0.5 * near[left])
        near[left], idle[left] = np.where(nearer, length, near[left]), np.where(nearer, 0, idle[left] + 1)
        better = left[length < error[left]]
        best[better], error[better] = there[better], length[length < error[left]]
        left = left[again | (error[left] >= search.enough) & (idle[left] < _IDLE)]
        if not left.size:
            break
    size_there = half_range(best, equations, size.harmonics).value
    return Located(best, error, size_there, lag_product(best, equations, size.harmonics)[0])


# The marked points of a curve are first seen: between which of its points they lie, and about where.


class Guess(NamedTuple):
    """A marked point about to be located: its kind, point and tangent (m + 1,)."""

    kind: int
    point: Array
    tangent: Array


def _between(points: Array, tangents: Array, i: int, share: float) -> tuple[Array, Array]:
    """Return (point, tangent) at a share of the way from point i to the next one, on the cubic through both."""
    rise = points[i + 1] - points[i]
    length = float(np.linalg.norm(rise))
    begin, end = length * tangents[i], length * tangents[i + 1]
    square, cube = 3 * rise - 2 * begin - end, begin + end - 2 * rise
    point = points[i] + share * (begin + share * (square + share * cube))
    tangent = begin + share * (2 * square + 3 * share * cube)
    return point, tangent / np.linalg.norm(tangent)


def _fold(points: Array, tangents: Array, i: int) -> Guess:
    rise = points[i + 1, -1] - points[i, -1]
    length = float(np.linalg.norm(points[i + 1] - points[i]))
    begin, end = length * tangents[i, -1], length * tangents[i + 1, -1]
    roots = np.roots([3 * (begin + end - 2 * rise), 2 * (3 * rise - 2 * begin - end), begin])
    inside = [float(r.real) for r in np.atleast_1d(roots) if abs(r.imag) < 1e-9 and 0 <= r.real <= 1]
    share = inside[0] if inside else float(begin / (begin - end))
    return Guess(FOLD, *_between(points, tangents, i, share))


def _peak(points: Array, tangents: Array, size: Array) -> list[Guess]:
    i = int(np.argmax(size))
    if i in (0, size.size - 1):
        return []
    left, right = (float(np.linalg.norm(points[j] - points[i])) for j in (i - 1, i + 1))
    down, up = (size[i] - size[i - 1]) / left, (size[i + 1] - size[i]) / right
    curvature = 2 * (up - down) / (left + right)
    slope = (down * right + up * left) / (left + right)
    along = float(np.clip(-slope / curvature, -left, right)) if curvature < 0 else 0.0
    if along < 0:
        return [Guess(PEAK, *_between(points, tangents, i - 1, 1 + along / left))]
    return [Guess(PEAK, *_between(points, tangents, i, along / right))]


def interpolated_peak(frequency: Array, size: Array, lag: Array) -> tuple[float, float, float]:
    """Return frequency, size and lag of the highest point of the quartic through the seven points about the largest.

    frequency, size, lag: along the curve, (n,). Where kinks keep a peak from being located, this is what is left.
    """
    i = int(np.clip(np.argmax(size), 3, max(size.size - 4, 3)))
    near = slice(max(i - 3, 0), i + 4)
    steps = np.hypot(np.diff(frequency[near]) / np.ptp(frequency), np.diff(size[near]) / np.max(size))
    along = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, along[-1], 2001)
    degree = min(4, along.size - 1)
    fits = [np.polynomial.Polynomial.fit(along, row[near], degree)(at) for row in (frequency, size, lag)]
    best = int(np.argmax(fits[1]))
    return float(fits[0][best]), float(fits[1][best]), float(fits[2][best])


def _quarter(points: Array, tangents: Array, size: Array, product: NDArray[np.complex128]) -> list[Guess]:
    real = product.real
    crossings = np.flatnonzero((real[:-1] > 0) & (real[1:] <= 0) | (real[:-1] <= 0) & (real[1:] > 0))
    if not crossings.size:
        return []
    i = int(crossings[np.argmax(size[crossings])])
    share = float(real[i] / (real[i] - real[i + 1]))
    return [Guess(QUARTER, *_between(points, tangents, i, share))]


def guesses(points: Array, tangents: Array, size: Array, product: NDArray[np.complex128]) -> list[Guess]:
    """Return what is to be located on one curve: every fold, the highest point, the highest crossing of 90°.

    points, tangents: (n, m + 1). size: half of peak to peak of the response, (n,). product: drive times conjugate
    response, fundamentals, (n,). A curve that is highest at an end has no peak.
    """
    along = tangents[:, -1]
    folds = [_fold(points, tangents, int(i)) for i in np.flatnonzero(along[:-1] * along[1:] < 0)]
    return [*folds, *_peak(points, tangents, size), *_quarter(points, tangents, size, product)]
