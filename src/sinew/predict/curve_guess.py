"""This is where the marked points of a curve are first seen: between which of its points they lie, and about where."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sinew.predict.landmark import FOLD, PEAK, QUARTER

__all__ = ["Guess", "guesses", "interpolated_peak"]

Array = NDArray[np.float64]


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
