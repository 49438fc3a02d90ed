"""The saturation threshold on lines with and without a kink."""

import numpy as np
import pytest

from sinew.analysis.sweep.response import fit_saturation

PRETENSION_MM = np.arange(0.0, 17.0)


def kinked(threshold_mm: float, noise: float = 0.0, seed: int = 0):
    random = np.random.default_rng(seed)
    gain = 2.8 - 0.14 * np.minimum(PRETENSION_MM, threshold_mm)
    return gain + noise * random.normal(size=PRETENSION_MM.size)


@pytest.mark.parametrize("missing", [(), (4,)])
def test_a_kink_without_noise_is_found_where_it_is_between_its_lines(missing: tuple[int, ...]) -> None:
    gain = kinked(11.3)
    gain[list(missing)] = np.nan
    fit = fit_saturation(PRETENSION_MM, gain)
    assert fit.threshold_mm.value == pytest.approx(11.3, abs=0.02)
    assert (fit.slope_below_per_mm, fit.slope_above_per_mm) == pytest.approx((-0.14, 0.0), abs=1e-3)


def test_a_kink_is_preferred_where_there_is_one() -> None:
    assert fit_saturation(PRETENSION_MM, kinked(11.3, 0.03)).preferred


def test_a_straight_line_is_not_given_a_kink() -> None:
    fit = fit_saturation(PRETENSION_MM, 2.8 - 0.1 * PRETENSION_MM + 0.03 * np.random.default_rng(1).normal(size=17))
    assert not fit.preferred


@pytest.mark.slow
def test_the_interval_of_the_kink_covers_it_85_to_95_times_in_100() -> None:
    fits = [fit_saturation(PRETENSION_MM, kinked(10.4, 0.04, seed)).threshold_mm for seed in range(200)]
    assert 0.85 <= np.mean([fit.low <= 10.4 <= fit.high for fit in fits]) <= 0.95
