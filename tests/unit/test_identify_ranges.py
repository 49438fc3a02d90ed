"""Training and test ranges at odd places of a record."""

from typing import Any

import numpy as np
import pytest

from sinew.identify.oscillator.comparison import split_record
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.record import make_record
from sinew.measure.errors import RecordingError, SpecError

T = np.arange(0, 6, 0.005)
GROWING = np.where(T < 2, T / 2, np.exp(-0.8 * (T - 2))) * np.cos(2 * np.pi * 3 * T)


def test_a_record_of_which_nothing_is_kept_is_refused() -> None:
    with pytest.raises(RecordingError, match="record 0 has 3 samples to fit, expected at least 16"):
        fit(make_record(T, GROWING), "linear", selected=[np.arange(T.size) < 3])


@pytest.mark.parametrize("name", ["train", "test"])
@pytest.mark.parametrize("asked", [(5, 5), (10, 5), (1150, 1300), (0, 9999), (1200, 1300), (0, 1), (0, 15), (-3, 50)])
def test_a_range_that_is_empty_reversed_outside_or_too_short_is_refused(name: str, asked: tuple[int, int]) -> None:
    record = make_record(T, GROWING)
    with pytest.raises((SpecError, RecordingError), match=rf"--{name} (is|holds)"):
        split_record(record, asked if name == "train" else None, asked if name == "test" else None)


@pytest.mark.parametrize(("train", "test"), [((0, 16), None), ((1184, 1200), None), ((400, 900), (0, 16))])
def test_the_smallest_ranges_at_either_end_are_divided(train: Any, test: Any) -> None:
    split = split_record(make_record(T, GROWING), train, test)
    assert np.count_nonzero(split.selected) >= 8
