"""Extremes and the local cubic beside `scipy.signal`, which they stand in for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import signal

from sinew.analysis.signal.extremes import alternating_extremes, local_cubic, maxima
from sinew.measure.arrays import Array

LEVELS = st.lists(st.integers(-4, 4), min_size=1, max_size=60).map(lambda levels: np.array(levels, dtype=float))
"""Signals with many equal samples and equal extremes, as an encoder gives them."""
NOISE = st.integers(0, 2**32 - 1).map(lambda seed: np.random.default_rng(seed).normal(size=80))


def prominent(values: Array, least: float) -> NDArray[np.intp]:
    """Return the peaks of SciPy on both sides in turn; of neighbours on one side the first of the most extreme."""
    sides = [signal.find_peaks(side * values, prominence=least)[0] for side in (1, -1)]
    kept: list[int] = []
    for place in sorted(int(one) for side in sides for one in side):
        side = 1 if place in sides[0] else -1
        if kept and (kept[-1] in sides[0]) == (side > 0):
            if side * (values[place] - values[kept[-1]]) > 0:
                kept[-1] = place
        else:
            kept.append(place)
    return np.array(kept, dtype=np.intp)


@given(LEVELS | NOISE, st.sampled_from([0.1, 0.5, 1.0, 1.5, 2.0, 3.0]))
def test_extremes_in_turn_are_those_of_scipy_with_the_same_prominence(values: Array, least: float) -> None:
    assert alternating_extremes(values, least).tolist() == prominent(values, least).tolist()


@given(LEVELS | NOISE)
def test_maxima_are_those_of_scipy(values: Array) -> None:
    assert maxima(values).tolist() == signal.find_peaks(values)[0].tolist()


@pytest.mark.parametrize(("window", "size"), [(5, 40), (7, 7), (101, 400), (399, 400)])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_local_cubic_is_the_filter_of_savitzky_and_golay(window: int, size: int, order: int) -> None:
    values = np.random.default_rng(size).normal(size=size)
    expected = signal.savgol_filter(values, window, 3, deriv=order, delta=0.01)
    assert local_cubic(values, window, 0.01)[order] == pytest.approx(expected, abs=1e-10 * np.abs(expected).max())
