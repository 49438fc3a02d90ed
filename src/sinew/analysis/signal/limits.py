"""A sensor at the end of its range: rows of one value where the signal goes on."""

import numpy as np

from sinew.measure.arrays import Array, Mask

_FEWEST = 3  # samples of one value
_NEAR, _BESIDE = 2.5, 0.3  # steps; share of the samples so near to the limit beside a crest that is not cut off


def resolution(values: Array) -> float:
    """Return the smallest step between different values, the range where there is none."""
    steps = np.diff(np.unique(values))
    return float(steps[steps > 1e-9 * np.ptp(values)].min(initial=np.ptp(values)))


def rows_of_one_value(values: Array) -> list[tuple[int, int]]:
    """Return (first, stop) of all rows of at least three equal samples."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(values) != 0) + 1, [values.size]])
    long = np.flatnonzero(np.diff(edges) >= _FEWEST)
    return [(int(edges[k]), int(edges[k + 1])) for k in long]


def is_cut_off(values: Array, first: int, stop: int, step: float, ends: tuple[float, float]) -> bool:
    """Return whether a row of equal samples is a crest that a limit of the range cut off.

    step: of the values, from `resolution`. ends: their smallest and largest. The rounded crest of a sine has three
    tenths of its samples, or more, within two and a half steps beside its top.
    """
    if first == 0 or stop == values.size:
        return False
    top = values[first]
    side = 1.0 if top > values[first - 1] else -1.0
    if top not in ends or side * (top - values[stop]) <= 0:
        return False
    reach = stop - first
    around = np.concatenate([values[max(0, first - reach) : first], values[stop : stop + reach]])
    return bool(np.count_nonzero(side * (top - around) < _NEAR * step) < _BESIDE * reach)


def overloads(values: Array) -> Mask:
    """Return which samples belong to crests that a limit of the range cut off, (n,)."""
    found = np.zeros(values.size, dtype=bool)
    step, ends = resolution(values), (float(values.min()), float(values.max()))
    for first, stop in rows_of_one_value(values):
        found[first:stop] = is_cut_off(values, first, stop, step, ends)
    return found
