"""Thinning keeps what a screen can show: no peak is lost, no column is drawn twice, parts join."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sinew.apps.dashboard.hub import Ring
from sinew.apps.dashboard.work.samples import thin

values = st.lists(st.floats(-100, 100), min_size=1, max_size=200)


def signal(numbers: list[float]) -> tuple[np.ndarray, np.ndarray]:
    return np.arange(len(numbers)) * 0.005, np.array([numbers])


@given(values, st.floats(0.001, 0.5))
def test_no_peak_is_lost(numbers: list[float], width: float) -> None:
    thinned = thin(*signal(numbers), width)
    assert thinned.low.min() == min(numbers)
    assert thinned.high.max() == max(numbers)


@given(values, st.integers(0, 200), st.floats(0.02, 0.5))
def test_parts_that_are_thinned_apart_join_to_the_whole(numbers: list[float], cut: int, width: float) -> None:
    time, value = signal(numbers)
    whole = thin(time, value, width)
    parts = [thin(t, v, width) for t, v in ((time[:cut], value[:, :cut]), (time[cut:], value[:, cut:])) if t.size]
    assert min(part.low.min() for part in parts) == whole.low.min()
    assert max(part.high.max() for part in parts) == whole.high.max()


@given(st.integers(1, 20), st.lists(st.integers(0, 30), max_size=10))
def test_a_ring_holds_the_newest_columns_and_no_more(capacity: int, sizes: list[int]) -> None:
    ring, put = Ring(1, capacity), 0
    for size in sizes:
        ring.put(np.arange(put, put + size, dtype=float)[None, :])
        put += size
    kept = ring.get(0, put)[0]
    assert kept.tolist() == list(range(max(0, put - capacity), put))
