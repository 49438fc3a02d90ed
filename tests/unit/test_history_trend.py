"""Change over months and difference of two runs: known slopes are found, and intervals hold what they say."""

import math
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest

from sinew.analysis.runs import DAYS_OF_A_MONTH, by_chance, differences, fit_line, is_off_zero, trends

BEGAN = datetime(2026, 1, 1, tzinfo=UTC)


def run(name: str, day: float, value: float, std: float = 0.01, **more: Any) -> dict[str, Any]:
    ends = [value - 1.6448536 * std, value + 1.6448536 * std]
    found = {"pretension_mm": 6.0, "resonance_hz": {"value": value, "std": std, "interval90": ends}}
    started = (BEGAN + timedelta(days=day)).isoformat()
    return {"name": name, "started": started, "rig": "mine", "source": "bench", "found": [found], **more}


def test_where_nothing_scatters_beyond_its_own_uncertainty_the_slope_is_that_of_weighted_least_squares() -> None:
    days, stds = np.array([0.0, 10.0, 30.0, 70.0]), np.array([0.1, 0.1, 0.2, 0.2])
    values = np.array([3.0, 3.01, 3.05, 2.99])
    closed = np.polyfit(days, values, 1, w=1 / np.maximum(stds, np.median(stds)))
    line = fit_line(days, values, stds)
    assert (line.slope.value, line.between) == (pytest.approx(closed[0], rel=1e-9), 0.0)
    assert line.at(np.array([100.0]))[0] == pytest.approx([np.polyval(closed, 100.0)], rel=1e-9)


def test_scatter_between_runs_widens_the_interval() -> None:
    random = np.random.default_rng(0)
    days = np.linspace(0, 100, 20)
    line = fit_line(days, 3 + 0.1 * random.normal(size=20), np.full(20, 1e-3))
    assert line.between == pytest.approx(0.1, rel=0.4)
    assert line.slope.std == pytest.approx(line.between / math.sqrt(20 * np.var(days)), rel=0.01)


@pytest.mark.parametrize("between", [0.02, 0.1])
def test_ninety_of_a_hundred_intervals_hold_the_true_slope(between: float) -> None:
    random = np.random.default_rng(1)
    hits = 0
    for _ in range(400):
        days, stds = np.sort(random.uniform(0, 200, 12)), random.uniform(0.01, 0.03, 12)
        values = 3 + 0.001 * days + np.hypot(between, stds) * random.normal(size=12)
        slope = fit_line(days, values, stds).slope
        hits += slope.low <= 0.001 <= slope.high
    assert 0.86 < hits / 400 < 0.95  # 0.9 within two and a half standard deviations of the count, and a little wide


def test_a_joint_that_ages_is_told_with_slope_and_months() -> None:
    runs = [run(str(k), 15 * k, 3.2 - 0.012 * 15 * k / DAYS_OF_A_MONTH) for k in range(13)]
    (trend,) = trends(runs, "resonance_hz")
    assert trend.slope_per_month.value == pytest.approx(-0.012, rel=1e-6)
    assert trend.differs_from_zero is True
    assert trend.sentence.startswith("f_r at 6 mm falls by 0.012 Hz a month")


def test_runs_that_only_scatter_do_not_change() -> None:
    runs = [run(str(k), 10 * k, 3.0 + 0.01 * (-1) ** k) for k in range(10)]
    (trend,) = trends(runs, "resonance_hz")
    assert trend.differs_from_zero is False
    assert "does not change beyond its uncertainty" in trend.sentence


def test_rigs_sources_and_pretensions_have_lines_of_their_own() -> None:
    runs = [run("a", 0, 3.0), run("b", 1, 3.0, rig="other"), run("c", 2, 3.0, source="twin")]
    assert [trend.title for trend in trends(runs, "resonance_hz")] == ["mine, 6 mm", "mine (twin), 6 mm", "other, 6 mm"]


@pytest.mark.parametrize(
    ("days", "is_told"),
    [
        # Fourteen runs, one each 21 minutes; in an American afternoon some of them are on the next day of UTC.
        ([(13 + 0.35 * k) / 24 for k in range(14)], False),
        ([(20 + 0.35 * k) / 24 for k in range(14)], False),
        ([0.75, 0.8, 1.5], True),
        ([0.0, 9.0], False),
    ],
)
def test_a_line_needs_three_runs_of_more_than_an_afternoon(days: list[float], is_told: bool) -> None:
    (trend,) = trends([run(str(k), day, 3.0 + 0.01 * (-1) ** k) for k, day in enumerate(days)], "resonance_hz")
    assert (trend.line is not None, trend.slope_per_month is not None) == (is_told, is_told)
    assert ("at least 3 runs on 2 days are needed" in trend.sentence) != is_told


def test_a_run_without_a_date_is_left_out() -> None:
    assert trends([run("a", 0, 3.0) | {"started": "soon"}], "resonance_hz") == []


@pytest.mark.parametrize(("by", "is_significant"), [(0.022, False), (0.025, True), (-0.025, True)])
def test_a_difference_is_significant_beyond_1_645_combined_standard_deviations(by: float, is_significant: bool) -> None:
    (found,) = differences(run("a", 0, 3.0), run("b", 1, 3.0 + by))
    assert found.difference.std == pytest.approx(0.01 * math.sqrt(2), rel=1e-6)
    assert is_off_zero(found.difference) is is_significant


def test_a_difference_of_unknown_uncertainty_is_not_called_either_way() -> None:
    other = run("b", 1, 3.5)
    other["found"][0]["resonance_hz"] = {"value": 3.5, "std": None, "interval90": [None, None]}
    (found,) = differences(run("a", 0, 3.0), other)
    assert is_off_zero(found.difference) is None


def test_differences_that_chance_alone_would_call_significant_are_counted() -> None:
    found = differences(run("a", 0, 3.0), run("b", 1, 3.1)) * 10
    assert "1 at most would be so by chance" in by_chance(found)
