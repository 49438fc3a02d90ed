"""The column of rubber: its buckling load against the exact incremental solution and against Euler."""

import jax
import numpy as np
import pytest

from sinew.mechanics.rod import SHORTEST, column_load, column_stretch
from sinew.mechanics.silicone import compressive_load

EXACT_LOADS = {0.05: 0.01861, 0.10: 0.07572, 0.15: 0.17566, 0.20: 0.32732, 0.25: 0.54749, 0.296: 0.83658, 0.35: 1.33637}
"""Critical load over G A of the exact incremental solution between guided plates, by radius over length."""


def euler_share(radius_over_length: float) -> float:
    return 3 * np.pi**2 * radius_over_length**2 / 4


@pytest.mark.parametrize(("radius", "load"), EXACT_LOADS.items())
def test_the_column_buckles_as_the_exact_cylinder_within_2_3_percent(radius: float, load: float) -> None:
    assert column_load(euler_share(radius), 1.0) == pytest.approx(load, rel=0.023)


def test_a_slender_column_buckles_at_eulers_load() -> None:
    assert column_load(1e-4, 1.0) == pytest.approx(1e-4, rel=1e-3)


def test_a_stub_is_told_no_load_beyond_half_its_length() -> None:
    assert column_load(50.0, 2.0) == pytest.approx(compressive_load(2.0, SHORTEST))
    assert column_stretch(np.array([50.0, 1e-6]))[0] == SHORTEST


def test_the_loads_slope_is_that_of_its_differences() -> None:
    with jax.enable_x64(True):
        slope = jax.grad(lambda euler: column_load(euler, 735.0))(476.0)
    assert slope == pytest.approx((column_load(477.0, 735.0) - column_load(475.0, 735.0)) / 2, rel=1e-4)
