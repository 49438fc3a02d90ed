"""Extremes in turn beside those of `scipy.signal`."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import signal

from sinew.analysis.decay.free_decay import alternating_extremes
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
