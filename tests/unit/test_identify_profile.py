"""Profile intervals of the numbers that a fit names, and directions that a record does not tell."""

from functools import cache

import numpy as np
import pytest
from tests.unit.identify_signals import OMEGA, chirp, motion, noisy, viscous

from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.fitted import Fit, number_names, physical_numbers
from sinew.identify.oscillator.model import Model
from sinew.identify.oscillator.profile import find_quantity, interval90
from sinew.identify.oscillator.record import make_record
from sinew.measure.errors import SpecError
from sinew.mechanics.laws import Linear, Quadratic, Viscous

TIME = np.arange(0, 6, 0.01)
PHASE = chirp(1, 6, 6)
INERTIA = 0.01
NAMES = (
    "stiffness_per_s2",
    "damping_per_s",
    "input_gain_rad_per_s2_n_m",
    "stiffness_n_m_per_rad",
    "damping_n_m_s_per_rad",
    "inertia_kg_m2",
    "natural_frequency_hz",
    "damping_ratio",
)


@cache
def driven() -> Fit:
    """Return the fit to a sweep by a torque, in which everything is well determined."""
    r = motion(viscous(0.1), lambda t: 20.0 * np.sin(PHASE(t)), TIME)[0]
    given = {"excitation": "torque", "output_unit": "rad", "input_unit": "N*m"}
    return fit(make_record(TIME, noisy(r, 0.002, 11), INERTIA * 20 * np.sin(PHASE(TIME)), **given), "linear")


def test_a_sweep_by_a_torque_has_these_numbers() -> None:
    assert sorted(number_names(driven())) == sorted(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_where_everything_is_well_determined_the_profile_is_the_interval_of_the_covariance(name: str) -> None:
    found = interval90(driven(), name)
    told = {"natural_frequency_hz": driven().natural_frequency_hz, "damping_ratio": driven().damping_ratio}
    known = (driven().parameters | told)[name]
    assert found is not None
    assert (found.low, found.high) == pytest.approx((known.low, known.high), abs=0.06 * known.std)


@pytest.mark.parametrize("name", NAMES)
def test_a_number_as_a_coordinate_and_back_is_the_number_of_the_fit(name: str) -> None:
    quantity = find_quantity(driven(), name)
    y = quantity.coordinates(driven().solution.values)
    known = physical_numbers(driven(), driven().solution.values[None])[0][number_names(driven()).index(name)]
    assert quantity.physical(float(y[quantity.index])) == pytest.approx(known, rel=1e-12)


@pytest.mark.parametrize("name", ["stiffness_n_m_per_rad", "damping_ratio"])
def test_the_derivatives_by_a_coordinate_are_differences(name: str) -> None:
    quantity = find_quantity(driven(), name)
    problem = quantity.problem(driven().layout.problem(driven().kept))
    y = quantity.coordinates(driven().solution.values)
    k = quantity.other
    step = np.where(np.arange(y.size) == k, 1e-6, 0.0)
    slope = (problem.residual(y + step) - problem.residual(y - step)) / 2e-6
    assert problem.jacobian(y)[:, k] == pytest.approx(slope, abs=1e-5 * np.abs(slope).max())


def test_the_profile_of_a_number_that_is_not_there_names_those_that_are() -> None:
    with pytest.raises(SpecError, match="damping_per_s"):
        interval90(driven(), "cubic_per_s2_rad2")


@cache
def odd_swing(noise: float) -> Fit:
    """Return the fit to four periods of a nearly undamped swing whose noise is as odd from half to half as the swing.

    A quadratic term moves the middle of the swing by κ₂A²/2K, which an offset does as well, and adds a second harmonic
    a third as large, to be seen only where the noise is small.
    """
    t = np.arange(40) / 30
    half = np.random.default_rng(5).normal(0, noise, (4, 5))
    x = motion(viscous(0.003), lambda t: 0.0, t, (0.5, 0.0))[0]
    record = make_record(t, x + np.concatenate([half, -half], axis=1).ravel(), output_unit="rad")
    return fit(record, Model("quadratic", Linear() + Viscous() + Quadratic()))


def test_offset_and_quadratic_term_of_a_noisy_steady_swing_are_said_not_to_be_told_apart() -> None:
    assert odd_swing(0.1).unidentifiable == ("offset and quadratic term cannot be told apart in this record",)


def test_with_a_tenth_of_the_noise_the_second_harmonic_tells_them_apart() -> None:
    assert odd_swing(0.01).unidentifiable == ()


def test_the_profile_of_a_quadratic_term_that_is_not_told_spans_a_natural_scale() -> None:
    found = interval90(odd_swing(0.1), "quadratic_per_s2_rad")
    natural = 0.5 * OMEGA**2 / 0.5  # half of the linear restoring force at the largest swing
    assert found is None or found.high - found.low > natural
