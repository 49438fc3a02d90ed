"""Which measured points miss their prediction: by whose uncertainty, by how much, in what words."""

import math
from typing import Any

import numpy as np
import pytest

from sinew.apps.dashboard.work.results import count_misses, judge, judged, misses

PLAIN = {"pretension_mm": 2.0, "frequency_hz": [2.0, 3.0, 4.0], "gain": [1.0, 2.0, 1.0], "phase": [10.0, 90.0, 170.0]}
BAND = {"gain_low": [0.9, 1.7, 0.9], "gain_high": [1.1, 2.3, 1.1]}
BANDED = PLAIN | BAND | {"phase_low": [5.0, 80.0, 165.0], "phase_high": [15.0, 100.0, 175.0]}
FOLDED = {
    "pretension_mm": 2.0,
    "frequency_hz": [2.0, 3.2, 2.8, 4.0],
    "gain": [1.0, 3.0, 2.0, 0.5],
    "phase": [0.0, 80.0, 120.0, 180.0],
    "stable": [True, True, True, True],
}


def point(value: float, half: float) -> dict[str, Any]:
    return {"value": value, "std": half / 1.645, "interval90": [value - half, value + half]}


@pytest.mark.parametrize(("value", "is_missed"), [(2.49, False), (2.51, True), (1.51, False), (1.49, True)])
def test_measurement_and_band_count_in_quadrature(value: float, is_missed: bool) -> None:
    verdict = judge("gain", BANDED, 3.0, point(value, 0.4))  # 0.3 of the band and 0.4 of the point are 0.5
    assert verdict is not None
    assert verdict.half == pytest.approx(0.5)
    assert verdict.misses is is_missed


def test_one_honest_point_in_ten_misses_a_band() -> None:
    random, missed, count = np.random.default_rng(0), 0, 3000
    for true, noise in zip(random.normal(2.0, 0.3 / 1.645, count), random.normal(0.0, 0.4 / 1.645, count), strict=True):
        verdict = judge("gain", BANDED, 3.0, point(true + noise, 0.4))
        assert verdict is not None
        missed += verdict.misses
    assert missed / count == pytest.approx(0.1, abs=4 * math.sqrt(0.1 * 0.9 / count))


@pytest.mark.parametrize(
    ("value", "half", "is_missed"),
    [(2.19, 0.01, False), (2.21, 0.01, True), (2.4, 0.39, True), (2.4, 0.41, False)],
    ids=["less than a tenth off", "more", "beyond its own interval", "within it"],
)
def test_without_a_band_a_gain_must_be_off_by_its_interval_and_a_tenth(
    value: float, half: float, is_missed: bool
) -> None:
    verdict = judge("gain", PLAIN, 3.0, point(value, half))
    assert verdict is not None
    assert verdict.misses is is_missed


@pytest.mark.parametrize(("value", "is_missed"), [(99.0, False), (101.0, True)])
def test_without_a_band_a_lag_must_be_off_by_ten_degrees(value: float, is_missed: bool) -> None:
    verdict = judge("phase", PLAIN, 3.0, point(value, 1.0))
    assert verdict is not None
    assert verdict.misses is is_missed


@pytest.mark.parametrize(("value", "nearest"), [(2.4, 2.5), (1.8, 1.75)])
def test_at_a_fold_the_nearest_motion_counts(value: float, nearest: float) -> None:
    verdict = judge("gain", FOLDED, 3.0, point(value, 0.05))
    assert verdict is not None
    assert verdict.predicted == pytest.approx(min((8 / 3, 2.5, 1.75), key=lambda one: abs(one - value)))
    assert verdict.predicted == pytest.approx(nearest)


def test_an_unstable_motion_is_none_that_was_predicted() -> None:
    unstable = FOLDED | {"stable": [True, True, False, True]}
    verdict = judge("gain", unstable, 3.0, point(1.8, 0.05))
    assert verdict is not None
    assert verdict.predicted == pytest.approx(8 / 3)


@pytest.mark.parametrize(
    ("frequency_hz", "estimate"),
    [(5.0, point(1.0, 0.1)), (3.0, {"value": 2.0, "std": None, "interval90": [None, None]})],
    ids=["outside the curve", "no interval"],
)
def test_what_is_not_known_is_not_judged(frequency_hz: float, estimate: dict[str, Any]) -> None:
    assert judge("gain", BANDED, frequency_hz, estimate) is None


def test_a_gap_in_the_band_leaves_the_rule_without_one() -> None:
    gap = PLAIN | {"gain_low": [None, None, None], "gain_high": [None, None, None]}
    verdict = judge("gain", gap, 3.0, point(2.3, 0.1))
    assert verdict is not None
    assert (verdict.low, verdict.misses) == (None, True)


MEASURED = {
    "pretension_mm": 2.0,
    "frequency_hz": [2.0, 3.0],
    "gain": [point(1.0, 0.1), point(2.8, 0.4)],
    "phase": [point(10.0, 1.0), point(120.0, 1.0)],
}


def test_misses_are_listed_with_the_farthest_first() -> None:
    said = misses(judged([BANDED], [MEASURED]))
    assert said == [
        "2 mm, 3 Hz: lag 120.0 ° (119.0 to 121.0), predicted 80 to 100 °: +30°, 3.0 of its uncertainty",
        "2 mm, 3 Hz: gain 2.8 (2.4 to 3.2), predicted 1.70 to 2.30: +40 %, 1.6 of its uncertainty",
    ]


def test_how_many_miss_is_told_beside_how_many_do_by_chance() -> None:
    told = count_misses(judged([BANDED], [MEASURED]))
    assert told == "2 of 4 judged values miss the prediction. One in ten does by chance."
