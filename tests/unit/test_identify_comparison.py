"""Which model a record supports: held-out prediction, information criterion, residuals."""

import re
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.sweep_fit import sweep_record
from scipy.stats import chi2
from tests.unit.identify_signals import OMEGA, chirp, dry_decay, motion, noisy, viscous

from sinew.identify.oscillator.comparison import (
    Comparison,
    compare,
    compare_laws,
    criterion,
    fit_and_predict,
    impossible_numbers,
    split_record,
)
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.model import MODELS, ask_fit, ask_residuals
from sinew.identify.oscillator.record import Record, make_record

DECAY = np.arange(0, 6, 0.01)


def viscous_decay(damping_ratio: float, seed: int) -> Record:
    x = motion(viscous(damping_ratio), lambda t: 0.0, DECAY, (0.5, 0.0))[0]
    return make_record(DECAY, noisy(x, 0.003, seed), output_unit="rad")


def dry(seed: int) -> Record:
    return make_record(DECAY, noisy(dry_decay(DECAY, 0.5, 0.0, 0.8, 0.02), 0.003, seed), output_unit="rad")


def laws(record: Record) -> Comparison:
    return compare(split_record(record, None, None), [MODELS[name] for name in ("linear", "loss-factor", "coulomb")])


@pytest.mark.slow
def test_dry_friction_is_found_in_nine_of_ten_decays() -> None:
    assert sum(laws(dry(seed)).best.model.name == "coulomb" for seed in range(10)) >= 9


@pytest.mark.slow
def test_viscous_damping_is_found_in_nine_of_ten_strongly_damped_decays() -> None:
    found = [laws(viscous_decay(0.17, seed)) for seed in range(10)]
    assert sum(one.best.model.name == "linear" and one.decided for one in found) >= 9


@pytest.mark.slow
def test_a_weakly_damped_decay_cannot_tell_viscous_damping_from_a_loss_factor() -> None:
    assert "cannot tell viscous damping from a constant loss factor" in laws(viscous_decay(0.02, 1)).verdict


@pytest.mark.slow
def test_the_cubic_spring_of_the_sweep_is_found_among_the_stiffness_laws() -> None:
    split = split_record(sweep_record(0), None, None)
    found = compare(split, [MODELS[name] for name in ("linear", "cubic", "cubic-quadratic")])
    assert found.best.model.name == "cubic"


@pytest.mark.slow
def test_auto_chooses_stiffness_and_damping_of_a_decay_with_hysteresis_in_the_race() -> None:
    found = compare_laws(split_record(dry(3), None, None))
    assert found.best.model.name == "coulomb"
    assert "bouc-wen" in [row.model.name for row in found.rows]


def test_the_verdict_on_a_single_model_tells_of_its_residuals_too() -> None:
    found = compare(split_record(dry(1), None, None), [MODELS["linear"]])
    assert "residuals are not white" in found.verdict


def test_the_verdict_bounds_dry_friction_that_adds_nothing_and_tells_of_the_winners_residuals() -> None:
    found = laws(viscous_decay(0.17, 3))
    assert "; residuals are white" in found.verdict
    assert found.dry_bound is not None
    assert 0 <= found.dry_bound < 0.8  # rad/s², what the dry decays of this page have
    assert "dry friction, if there is any, is below coulomb_rad_per_s2" in found.verdict


def drag_decay(seed: int) -> Record:
    """Return a decay under a drag that goes with the square of the rate: at small amplitude it hardly damps."""
    x = motion(lambda r, v: 0.3 * v + 0.15 * v * abs(v) + OMEGA**2 * r, lambda t: 0.0, DECAY, (0.5, 0.0))[0]
    return make_record(DECAY, noisy(x, 0.001, seed), output_unit="rad")


@pytest.mark.slow
def test_a_model_that_needs_negative_friction_beyond_its_interval_is_out_of_the_race() -> None:
    numbers = fit(drag_decay(1), "coulomb").parameters
    assert numbers["coulomb_rad_per_s2"].high < 0
    assert impossible_numbers(numbers) == ["coulomb_rad_per_s2"]
    assert impossible_numbers(fit(viscous_decay(0.17, 3), "coulomb").parameters) == []
    found = laws(drag_decay(1))
    assert not found.best.model.law.sticks
    assert re.search(r"coulomb .*out of the race.* coulomb_rad_per_s2 = -", found.verdict)


def test_residuals_are_asked_over_the_samples_that_taught() -> None:
    spoilt = viscous_decay(0.1, 0)
    spoilt = make_record(DECAY, np.where(DECAY < 4, spoilt.output, spoilt.output + 0.3), output_unit="rad")
    found = compare(split_record(spoilt, (0, 400), (400, 600)), [MODELS["linear"]])
    assert "residuals are white" in found.verdict
    assert ask_fit(found.best).share < 0.1
    assert found.rows[0].rmse_test > 0.2


def test_a_larger_model_that_begins_at_a_smaller_one_leaves_no_more() -> None:
    record = dry(2)
    small = fit(record, "linear")
    for model in ("cubic", "cubic-quadratic", "coulomb"):
        assert fit(record, model, smaller=small).rmse <= small.rmse * (1 + 1e-9)


@pytest.mark.slow
def test_a_rest_position_that_creeps_is_found_and_costs_no_mechanics() -> None:
    x = motion(viscous(0.05), lambda t: 0.0, DECAY, (0.5, 0.0))[0] - 0.08 * (1 - np.exp(-DECAY / 0.7))
    found = compare_laws(split_record(make_record(DECAY, noisy(x, 0.003, 5), output_unit="rad"), None, None)).best
    assert found.model.rest == "creep"
    assert found.damping_ratio.low < 0.05 < found.damping_ratio.high


def test_what_a_loss_factor_saw_before_counts_only_where_the_record_tells_it() -> None:
    found = fit(viscous_decay(0.02, 1), "loss-factor")
    at = [entry.local for entry in found.layout.entries].index("memory")
    matrix = found.covariance.matrix.copy()
    costs = []
    for std in (1e-6, 10.0):
        matrix[at, at] = std**2
        costs.append(criterion(replace(found, covariance=replace(found.covariance, matrix=matrix.copy())), 600.0))
    assert costs[0] - costs[1] == pytest.approx(np.log(600.0))


def test_held_out_samples_do_not_move_the_fit() -> None:
    record = viscous_decay(0.1, 0)
    split = split_record(record, (0, 400), (400, 600))
    spoilt = make_record(DECAY, np.where(DECAY < 4, record.output, 1.0), output_unit="rad")
    one, other = (fit_and_predict(part, "linear").fit for part in (split, split_record(spoilt, (0, 400), (400, 600))))
    assert one.damping_ratio.value == other.damping_ratio.value


@pytest.mark.slow
def test_residuals_of_the_right_model_are_white_in_nine_of_ten_records() -> None:
    asked = [
        ask_residuals(r, fit(r, "linear").residuals()[0], OMEGA) for r in (viscous_decay(0.1, s) for s in range(10))
    ]
    assert sum(one.white_p > 0.01 for one in asked) >= 9


def test_residuals_of_a_linear_spring_grow_with_the_amplitude_of_a_cubic_one() -> None:
    time = np.arange(0, 30, 0.01)
    phase = chirp(1, 6, 30)
    r = motion(viscous(0.05, cubic=470.0), lambda t: 15 * np.sin(phase(t)), time)[0]
    record = make_record(time, noisy(r, 0.002, 1), 15 * np.sin(phase(time)), excitation="force")
    asked = ask_residuals(record, fit(record, "linear").residuals()[0], OMEGA)
    assert "residuals grow with amplitude" in asked.sentences()


def test_residuals_of_several_records_are_asked_over_the_records() -> None:
    rng = np.random.default_rng(8)
    time = np.arange(0, 2, 0.01)
    loud = np.geomspace(0.1, 1.0, 10)
    records = [make_record(time, size * np.sin(OMEGA * time), output_unit="rad") for size in loud]
    residuals = [0.1 * size * rng.normal(size=time.size) for size in loud]
    asked = ask_residuals(records, residuals, OMEGA)
    assert asked.sentences() == ("residuals grow with amplitude",)
    assert asked.share == pytest.approx(0.1 * np.sqrt(2), rel=0.1)


def test_too_few_periods_to_ask_residuals_for_trends_are_told() -> None:
    time = np.arange(0, 1, 0.01)
    record = make_record(time, np.sin(OMEGA * time), output_unit="rad")
    asked = ask_residuals(record, np.random.default_rng(2).normal(size=time.size), OMEGA)
    assert "residuals are white" in asked.telling()
    assert "too few periods" in asked.telling()


@pytest.mark.slow
def test_quadratic_drag_is_told_from_the_other_laws() -> None:
    found = compare_laws(split_record(drag_decay(1), None, None))
    assert (found.best.model.name, found.decided) == ("drag", True)


@pytest.mark.slow
def test_a_pendulum_is_told_from_springs() -> None:
    x = motion(lambda r, v: 0.05 * OMEGA * v + OMEGA**2 * np.sin(r), lambda t: 0.0, DECAY, (0.9, 0.0))[0]
    found = compare_laws(split_record(make_record(DECAY, noisy(x, 0.003, 7), output_unit="rad"), None, None))
    assert found.best.model.name == "pendulum"
    assert "a pendulum with viscous damping" in found.verdict


def test_a_motion_that_is_no_angle_is_not_tried_as_a_pendulum_and_every_fit_moves_the_progress() -> None:
    told: list[tuple[float, float]] = []
    split = split_record(replace(viscous_decay(0.1, 0), output_unit="m"), None, None)
    found = compare_laws(split, lambda done, total: told.append((done, total)))
    assert all("pendulum" not in row.model.name for row in found.rows)
    assert [done for done, _ in told[:-1]] == list(range(1, len(told)))
    assert told[-1][0] == told[-1][1] == len(told) - 1


def test_two_and_a_half_swings_tell_fewer_numbers_than_many() -> None:
    small, large = (fit(viscous_decay(0.05, 1), model) for model in ("linear", "cubic-quadratic"))
    more = [criterion(large, 250.0, swings) - criterion(small, 250.0, swings) for swings in (2.5, 20.0, np.inf)]
    assert more[0] > more[1] + 30  # at 2.5 swings two terms more have to explain what odds of e^15 do
    assert more[1] == pytest.approx(more[2], abs=1.0)


@pytest.mark.slow
def test_two_and_a_half_swings_with_a_crooked_sensor_are_no_law_of_five_numbers() -> None:
    t = np.arange(0, 2.5 / 3, 0.004)
    x = motion(viscous(0.03), lambda s: 0.0, t, (0.5, 0.0))[0]
    crooked = x + 0.004 * np.sin(2.3 * OMEGA * t + 1.0) * np.abs(x)
    found = compare_laws(split_record(make_record(t, noisy(crooked, 5e-4, 4), output_unit="rad"), None, None))
    assert len(found.best.model.mechanics("none")) <= 3


def test_two_opposite_residuals_have_the_statistic_of_ljung_and_box_in_closed_form() -> None:
    # Their correlation is -1/2 at seven samples and zero at all others: Q = n (n + 2) (1/4) / (n - 7).
    residuals = np.zeros(100)
    residuals[40], residuals[47] = 1.0, -1.0
    asked = ask_residuals(viscous_decay(0.05, 0).cut(0, 100), residuals, OMEGA)
    assert asked.white_p == pytest.approx(chi2.sf(100 * 102 / 4 / 93, 20))
