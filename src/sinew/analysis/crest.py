"""This is where the top of a response curve that no linear resonance describes is read by itself."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Crest", "fit_crest", "top_points"]

Floats = NDArray[np.float64]

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


def top_points(gain: Floats, level: float, fewest: int) -> slice:
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


def fit_crest(frequency_hz: Floats, gain: Floats, relative_std: Floats) -> Crest | None:
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
