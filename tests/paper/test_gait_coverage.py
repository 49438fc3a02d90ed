"""Do the 90 % intervals of a gait hold what made-up people were made with?"""

import pytest
from tests.experiments.gait import count

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("strides", "likeness"), [(14, 0.4), (45, 0.4)])
def test_nine_of_ten_intervals_hold_frequency_and_yaw(strides: int, likeness: float) -> None:
    found = count(strides, likeness, 80, seed=7)
    assert min(found.held) >= 0.82  # of 80 draws at 0.9, one in a hundred falls below
    assert found.bias == pytest.approx((0, 0), abs=0.02)
