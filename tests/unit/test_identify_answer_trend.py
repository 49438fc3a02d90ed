"""What the answers are computed with: pooled repeats, straight lines, ratios of slopes, and numbers in words."""

import math

import numpy as np
import pytest

from sinew.analysis.signal.repeats import detectable, fit_trend, pool_repeats, ratio_interval
from sinew.measure.estimate import Estimate
from sinew.paper.answer import in_words


def test_the_interval_of_a_pooled_mean_covers_nine_times_in_ten() -> None:
    rng = np.random.default_rng(5)
    hits = 0
    for _ in range(400):
        draws = rng.normal(1.0, 0.1, (6, 3))
        pooled = pool_repeats(draws.tolist(), np.full((6, 3), math.nan).tolist())
        hits += sum(one.low <= 1.0 <= one.high for one in pooled.estimates)
    assert 0.88 <= hits / 2400 <= 0.92


def test_pooled_means_without_an_effect_are_called_significant_in_at_most_a_tenth_of_the_campaigns() -> None:
    rng = np.random.default_rng(6)
    campaigns = [pool_repeats(rng.normal(0.0, 1.0, (13, 3)).tolist(), [[math.nan] * 3] * 13) for _ in range(400)]
    assert sum(sum(one.significant()) > 0 for one in campaigns) / 400 <= 0.13


def test_repeats_that_agree_by_chance_are_not_believed_below_the_noise_of_their_fits() -> None:
    pooled = pool_repeats([[1.0, 1.0, 1.0]], [[0.3, 0.3, 0.3]])
    assert pooled.estimates[0].std == pytest.approx(0.3 / math.sqrt(3))


def test_a_slope_has_the_larger_of_the_intervals_by_repeats_and_by_residuals() -> None:
    x = np.arange(6.0)
    bent = fit_trend(x, x**2, std=0.01, freedom=20)
    straight = fit_trend(x, 2 * x, std=0.5, freedom=20)
    assert bent.slope.std == pytest.approx(np.sqrt(((x**2 - bent.at(x)) ** 2).sum() / 4 / 17.5))
    assert straight.slope.std == pytest.approx(0.5 / math.sqrt(17.5))


def test_the_detectable_trend_is_detected_nine_times_in_ten() -> None:
    rng = np.random.default_rng(7)
    x, std = np.arange(8.0), 0.2
    size = detectable(std / math.sqrt(float(((x - x.mean()) ** 2).sum())), 6.0)
    found = 0
    for _ in range(1000):
        trend = fit_trend(x, size * x + rng.normal(0.0, std, x.size))
        found += trend.slope.low > 0
    assert 0.87 <= found / 1000 <= 0.93


def test_fiellers_interval_covers_the_ratio_of_two_slopes_whose_errors_are_correlated() -> None:
    rng = np.random.default_rng(8)
    x = np.arange(9.0)
    hits = 0
    for _ in range(600):
        shared = rng.normal(0.0, 0.3, x.size)
        above, below = (fit_trend(x, slope * x + shared + rng.normal(0.0, 0.1, x.size)) for slope in (-0.1, -0.4))
        found = ratio_interval(above, below, x)
        hits += found.low <= 0.25 <= found.high
    assert 0.86 <= hits / 600 <= 0.94


def test_the_ratio_to_a_slope_that_may_be_zero_has_no_bounds() -> None:
    x = np.arange(5.0)
    below = fit_trend(x, np.array([1.0, -1.0, 0.0, 1.0, -1.0]))
    found = ratio_interval(fit_trend(x, x), below, x)
    assert (found.low, found.high) == (-math.inf, math.inf)


@pytest.mark.parametrize(
    ("estimate", "text"),
    [
        (Estimate(0.1234, 0.01, 0.11, 0.14), "0.123 (0.110 to 0.140)"),
        (Estimate(-12.3, 2.0, -15.6, -9.0), "−12.3 (−15.6 to −9.0)"),
        (Estimate(3.0, math.nan, math.nan, math.nan), "3"),
    ],
)
def test_an_estimate_in_words_has_the_digits_that_its_interval_deserves(estimate: Estimate, text: str) -> None:
    assert in_words(estimate) == text
