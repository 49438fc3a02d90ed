"""Nonlinear least squares beside SciPy's MINPACK, and where a search begins badly."""

import numpy as np
import pytest
from scipy import optimize

from sinew.analysis.decay.decay_fit import fit_decay
from sinew.analysis.signal.least_squares import ENOUGH, Linearised, least_squares
from sinew.measure.arrays import Array

T = np.linspace(0.0, 4.0, 200)
DATA = 2.0 * np.exp(-0.4 * T) * np.cos(6.0 * T) + np.random.default_rng(0).normal(0.0, 0.05, T.size)
START = np.array([1.0, 0.1, 5.8])


def decay(p: Array) -> Linearised:
    fading = np.exp(-p[1] * T)
    cosine, sine = fading * np.cos(p[2] * T), fading * np.sin(p[2] * T)
    return p[0] * cosine, lambda: np.stack([cosine, -p[0] * T * cosine, -p[0] * T * sine], axis=1)


def test_a_fit_is_that_of_scipy() -> None:
    theirs = optimize.least_squares(
        lambda p: decay(p)[0] - DATA,
        START,
        lambda p: decay(p)[1](),
        method="lm",
        x_scale="jac",
        ftol=ENOUGH,
        xtol=ENOUGH,
    )
    ours = least_squares(decay, DATA, START)
    np.testing.assert_allclose(ours.parameters, theirs.x, rtol=1e-12)
    np.testing.assert_allclose(ours.jacobian, theirs.jac, rtol=1e-9, atol=1e-12)


def test_a_place_where_the_model_is_not_finite_is_left() -> None:
    def root(p: Array) -> Linearised:
        with np.errstate(invalid="ignore"):
            size = np.sqrt(p[0])
        return np.full(5, size), lambda: np.full((5, 1), 0.5 / size)

    found = least_squares(root, np.full(5, 0.1), np.array([4.0]))
    np.testing.assert_allclose(found.parameters, 0.01, rtol=1e-6)


def test_what_the_data_do_not_determine_stays_or_is_shared() -> None:
    columns = np.stack([T, np.zeros(T.size), np.ones(T.size), np.ones(T.size)], axis=1)
    found = least_squares(lambda p: (columns @ p, lambda: columns), 2.0 * T + 3.0, np.array([1.0, 7.0, 0.5, 0.0]))
    assert found.converged
    np.testing.assert_allclose(found.parameters[:2], [2.0, 7.0], rtol=1e-9)
    assert found.parameters[2:].sum() == pytest.approx(3.0, rel=1e-9)
    assert found.parameters[2:] == pytest.approx([1.75, 1.25], rel=0.01)  # round-off moves what is not determined


@pytest.mark.parametrize("start", [[2.0, -18.0], [2.0, -30.0], [1e8, 2.0], [1e12, 2.0]])
def test_columns_that_shrink_by_many_orders_on_the_way_do_not_stop_a_search(start: list[float]) -> None:
    s = T / T[-1]
    data = 2.0 * np.exp(-3.0 * s) + np.random.default_rng(0).normal(0.0, 0.01, T.size)

    def fading(p: Array) -> Linearised:
        wave = np.exp(-p[1] * s)
        return p[0] * wave, lambda: np.stack([wave, -p[0] * s * wave], axis=1)

    theirs = optimize.least_squares(lambda p: fading(p)[0] - data, [2.0, 3.0], method="lm").x
    found = least_squares(fading, data, np.array(start))
    assert found.converged
    np.testing.assert_allclose(found.parameters, theirs, rtol=1e-5)


def test_a_step_that_was_cut_short_does_not_end_a_search_in_a_flat_valley() -> None:
    t = np.arange(0.0, 6.0, 0.005)
    response = 0.3 * np.exp(-1.5 * t) * np.cos(20.0 * t + 0.2) + 1e-3 * np.random.default_rng(1).normal(size=t.size)
    found = fit_decay(t, response, (-3.0, 20.2))  # as if it grew
    assert (found.decay_rate_per_s, found.omega_rad_s) == pytest.approx((1.5, 20.0), rel=2e-3)
