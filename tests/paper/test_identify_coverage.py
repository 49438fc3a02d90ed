"""How often the intervals of an identified spring hold the truth, over many draws of the noise."""

from functools import cache

import numpy as np
import pytest
from tests.unit.identify_signals import duffing_sweep

from sinew.identify.fit import fit

pytestmark = pytest.mark.slow
DRAWS = 200


@cache
def drawn() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return value, std, low and high of the cubic stiffness in every draw."""
    found = [fit(duffing_sweep(seed), "cubic").parameters["cubic_n_m_per_rad3"] for seed in range(DRAWS)]
    return tuple(np.array([getattr(one, name) for one in found]) for name in ("value", "std", "low", "high"))


def test_the_cubic_stiffness_has_a_bias_below_a_quarter_of_its_standard_deviation() -> None:
    value, *_ = drawn()
    assert abs(value.mean() - 6.0) < 0.25 * value.std()


def test_nine_of_ten_intervals_hold_the_cubic_stiffness() -> None:
    _, _, low, high = drawn()
    assert 0.86 <= np.mean((low <= 6.0) & (high >= 6.0)) <= 0.94


def test_the_stated_standard_deviation_of_the_cubic_stiffness_is_that_of_the_draws() -> None:
    value, std, *_ = drawn()
    assert std.mean() == pytest.approx(value.std(), rel=0.15)
