"""The bootstrap over repeats, against the scatter that the repeats were made with."""

from functools import cache

import numpy as np
import pytest
from tests.unit.identify_signals import motion, noisy, viscous

from sinew.identify.oscillator.bootstrap import Bootstrap, bootstrap_repeats
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.record import Record, make_record
from sinew.measure.errors import SpecError

TIME = np.arange(0, 1.5, 0.0125)
FREQUENCIES = (2.96, 3.0, 3.07)


def repeat(frequency_hz: float, seed: int, group: str = "") -> Record:
    omega = 2 * np.pi * frequency_hz
    x = motion(viscous(0.1, omega=omega), lambda t: 0.0, TIME, (0.5, 0.0))[0]
    return make_record(TIME, noisy(x, 0.002, seed), output_unit="rad", group=group)


@cache
def three() -> Bootstrap:
    return bootstrap_repeats([repeat(f, i) for i, f in enumerate(FREQUENCIES)], "linear")


def test_the_standard_deviation_over_repeats_is_that_of_the_mean_of_their_frequencies() -> None:
    expected = np.std(FREQUENCIES, ddof=1) / np.sqrt(3)
    assert three().estimates["natural_frequency_hz"].std == pytest.approx(expected, rel=0.1)


def test_repeats_that_differ_make_the_covariance_of_the_noise_too_small() -> None:
    found = three()
    assert found.estimates["natural_frequency_hz"].std > 2 * found.fit.natural_frequency_hz.std


def test_three_repeats_have_an_interval_of_student_with_two_degrees_of_freedom() -> None:
    found = three().estimates["natural_frequency_hz"]
    assert (found.high - found.low) / (2 * found.std) == pytest.approx(2.91999, abs=1e-4)  # t tables


def test_three_repeats_are_said_to_be_coarse() -> None:
    assert "coarse: their width is itself known to about 50 %" in three().message


def test_two_of_three_repeats_can_be_drawn_in_six_ways() -> None:
    found = three()
    assert (found.exact, sorted(found.probability * 9)) == (True, pytest.approx([1, 1, 1, 2, 2, 2]))


def test_the_value_is_that_of_the_fit_to_all_repeats() -> None:
    found = three()
    assert found.estimates["damping_ratio"].value == found.fit.damping_ratio.value


def test_a_draw_of_one_repeat_only_is_the_fit_to_that_repeat() -> None:
    found = three()
    column = found.draws[:, found.names.index("natural_frequency_hz")]
    alone = fit(repeat(FREQUENCIES[0], 0), "linear").natural_frequency_hz.value
    assert np.abs(column - alone).min() < 1e-6


@pytest.mark.slow
def test_repeats_of_two_groups_are_drawn_among_themselves() -> None:
    groups = {"0 mm": 1.0, "8 mm": 1.3}
    records = [repeat(f * more, i, group) for group, more in groups.items() for i, f in enumerate(FREQUENCIES)]
    found = bootstrap_repeats(records, "linear", varying=("stiffness",))
    stiff = [found.estimates[f"stiffness_per_s2[{group}]"] for group in ("0 mm", "8 mm")]
    expected = 2 * 0.0321 / np.mean(FREQUENCIES)  # of stiffness, twice that of the mean frequency, std/√3 of the three
    assert [one.std / one.value for one in stiff] == pytest.approx([expected, expected], rel=0.15)


@pytest.mark.slow
def test_many_repeats_give_the_quantiles_of_their_draws() -> None:
    frequencies = 3.0 + 0.04 * np.random.default_rng(5).normal(size=10)
    found = bootstrap_repeats([repeat(f, i) for i, f in enumerate(frequencies)], "linear", resamples=40, seed=3)
    interval = found.estimates["natural_frequency_hz"]
    expected = 2 * 1.645 * np.std(frequencies, ddof=1) / np.sqrt(10)
    assert interval.high - interval.low == pytest.approx(expected, rel=0.35)


def test_one_repeat_of_a_group_is_refused_with_its_name() -> None:
    with pytest.raises(SpecError, match="'8 mm'"):
        bootstrap_repeats([repeat(3.0, 0, "0 mm"), repeat(3.0, 1, "0 mm"), repeat(3.0, 2, "8 mm")], "linear")


def test_progress_is_told_up_to_the_last_draw() -> None:
    told: list[tuple[float, float]] = []
    bootstrap_repeats([repeat(3.0, 0), repeat(3.01, 1)], "linear", progress=lambda *now: told.append(now))
    assert told == [(1, 2), (2, 2)]
