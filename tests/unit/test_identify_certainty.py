"""Covariances and unidentifiable directions, against what repeated draws and textbooks say."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sinew.analysis.signal.least_squares import autoregression
from sinew.identify.oscillator.least_squares import (
    Problem,
    covariance,
    estimates,
    find_unidentifiable,
    solve,
)
from sinew.measure.errors import RecordingError

X = np.linspace(0, 1, 400)
LINE = np.stack([np.ones_like(X), X], axis=1)


def line_problem(y: np.ndarray) -> Problem:
    return Problem(lambda b: LINE @ b - y, lambda b: LINE)


def slow_noise(generator: np.random.Generator) -> np.ndarray:
    noise = generator.normal(size=X.size + 200)
    for i in range(1, noise.size):
        noise[i] += 0.8 * noise[i - 1]
    return noise[200:]


@pytest.mark.parametrize("samples", [9_999, 10_001])
def test_noise_that_goes_together_is_told_from_few_samples_for_a_parameter_and_from_many(samples: int) -> None:
    shocks = np.random.default_rng(2).normal(size=samples)
    noise = lfilter([1.0], [1.0, -0.8], shocks)
    column = np.full((samples, 1), samples**-0.5)
    coefficients, innovation = autoregression(noise - noise.mean(), column)
    assert coefficients[0] == pytest.approx(0.8, abs=3 * np.sqrt((1 - 0.8**2) / samples))
    assert innovation == pytest.approx(1.0, abs=3 * np.sqrt(2 / samples))


def test_a_robust_covariance_is_that_of_repeated_draws_under_correlated_noise_the_classical_one_is_too_small() -> None:
    generator = np.random.default_rng(1)
    found = [solve(line_problem(slow_noise(generator)), np.zeros(2)) for _ in range(200)]
    drawn = np.std([solution.values for solution in found], axis=0)
    coloured, hac, classical = (
        np.mean([covariance(s.jacobian, s.residual, kind).std for s in found], axis=0)
        for kind in ("coloured", "hac", "classical")
    )
    assert coloured == pytest.approx(drawn, rel=0.25)
    assert hac == pytest.approx(drawn, rel=0.25)
    assert (drawn > 2 * classical).all()


def test_a_coloured_covariance_of_two_recordings_is_half_that_of_one() -> None:
    noise = slow_noise(np.random.default_rng(2))
    one = covariance(LINE, noise, "coloured").matrix
    twice = np.concatenate([LINE, LINE]), np.concatenate([noise, noise])
    both = covariance(*twice, "coloured", pieces=[slice(0, X.size), slice(X.size, 2 * X.size)]).matrix
    assert both == pytest.approx(0.5 * one, rel=1e-9)


def test_a_parameter_that_nothing_depends_on_has_no_standard_deviation() -> None:
    jacobian = np.stack([np.ones_like(X), np.zeros_like(X)], axis=1)
    found = estimates(np.ones(2), covariance(jacobian, np.sin(50 * X)))
    assert np.isnan(found[1].std)


def test_two_parameters_with_the_same_effect_are_named_together() -> None:
    jacobian = np.stack([X, X**2, X * (1 + 1e-12)], axis=1)
    found = find_unidentifiable(["offset", "gain", "quadratic term"], np.ones(3), jacobian, 0.01)
    assert found == ("offset and quadratic term cannot be told apart in this record",)


def test_a_parameter_that_moves_the_data_by_less_than_noise_is_named_alone() -> None:
    jacobian = np.stack([np.ones_like(X), 1e-4 * X], axis=1)
    assert find_unidentifiable(["offset", "cubic stiffness"], np.ones(2), jacobian, 0.1) == (
        "cubic stiffness cannot be determined from this record",
    )


def test_well_determined_parameters_are_not_called_unidentifiable() -> None:
    assert find_unidentifiable(["offset", "slope"], np.ones(2), LINE, 0.1) == ()


def test_the_best_of_several_starts_is_kept() -> None:
    problem = Problem(
        lambda b: np.array([b[0] ** 4 - 5 * b[0] ** 2 + b[0] + 10, 0.0]),
        lambda b: np.array([[4 * b[0] ** 3 - 10 * b[0] + 1], [0.0]]),
    )
    assert round(solve(problem, [2.0], [-2.0]).values[0]) == -2


def test_a_search_that_is_cut_short_says_so() -> None:
    t = np.linspace(0, 3, 30)
    problem = Problem(lambda b: np.exp(-b[0] * t) - np.exp(-2 * t), lambda b: -(t * np.exp(-b[0] * t))[:, None])
    assert not solve(problem, [0.1], max_evaluations=2).converged


def test_fewer_samples_than_parameters_are_refused() -> None:
    with pytest.raises(RecordingError, match="1 samples for 2 parameters"):
        solve(Problem(lambda b: b[:1], lambda b: np.eye(1, 2)), np.zeros(2))


def test_a_start_whose_squares_have_no_sum_is_left_out_without_a_warning(recwarn: pytest.WarningsRecorder) -> None:
    solution = solve(line_problem(X), np.full(2, 1e200), np.zeros(2))
    assert np.isfinite(solution.values).all()
    assert [str(one.message) for one in recwarn] == []


@pytest.mark.parametrize("most", [3, 400])
@pytest.mark.parametrize("bounds", [None, ([0.0, 0.0], [9.0, 9.0])])
def test_residual_and_jacobian_are_those_at_the_values_however_a_search_ends(
    bounds: tuple[list[float], list[float]] | None, most: int
) -> None:
    t = np.linspace(0, 3, 30)
    problem = Problem(
        lambda b: b[0] * np.exp(-b[1] * t) - 2 * np.exp(-3 * t),
        lambda b: np.stack([np.exp(-b[1] * t), -b[0] * t * np.exp(-b[1] * t)], axis=1),
    )
    found = solve(problem, [1.0, 0.3], bounds=bounds, max_evaluations=most)
    assert np.array_equal(found.residual, problem.residual(found.values))
    assert np.array_equal(found.jacobian, problem.jacobian(found.values))
