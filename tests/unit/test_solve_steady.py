"""Steady motions and their derivatives by the numbers, against closed forms and against solving anew."""

import numpy as np
import pytest
from tests.unit.prony import complex_stiffness

from sinew.identify.oscillation import Drive, Laws, oscillate
from sinew.mechanics.laws import Cubic, Drag, DryFriction, Linear, LossFactor, Pendulum, Quadratic, Viscous
from sinew.mechanics.silicone import prony_shares
from sinew.solve.branch import FOLD, guesses, interpolated_peak

OMEGA = np.linspace(0.5, 1.6, 23)  # more than a block, and no whole number of blocks
SLOW = pytest.mark.slow  # each law is compiled by itself
LAWS = [
    Laws(Linear() + Viscous() + Cubic()),
    pytest.param(Laws(Linear() + Viscous() + Quadratic() + Cubic()), marks=SLOW),
    Laws(Linear() + LossFactor(), natural=19.0),
    pytest.param(Laws(Linear() + Viscous() + DryFriction()), marks=SLOW),
    pytest.param(Laws(Pendulum() + Viscous(), amplitude=0.8), marks=SLOW),
    pytest.param(Laws(Linear() + Viscous() + Drag()), marks=SLOW),
]
VALUES = {"stiffness": 1.1, "damping": 0.2, "loss_factor": 0.3, "coulomb": 0.05, "drag": 0.3, "quadratic": 0.4}
VALUES |= {"cubic": 0.4, "gain": 1.3}


def numbers_of(laws: Laws) -> np.ndarray:
    """Return numbers of a law, stiffness to gain, those zero that it has not."""
    own = {"gain", *(number.name for number in laws.law.numbers)}
    return np.array([VALUES[name] * (name in own) for name in laws.names])


LINEAR = Laws(Linear() + Viscous())
NUMBERS = numbers_of(LINEAR)


def linear(numbers: np.ndarray) -> np.ndarray:
    return numbers[-1] * 0.2 / (numbers[0] - OMEGA**2 + 1j * OMEGA * numbers[1])


def test_a_linear_response_is_its_closed_form_at_every_frequency() -> None:
    found = oscillate(NUMBERS, OMEGA, Drive(0.2, 0), LINEAR, linear(NUMBERS) * 1.3)
    assert np.abs(found.fundamental / linear(NUMBERS) - 1).max() < 1e-12


def test_a_moved_base_drives_with_its_acceleration() -> None:
    found = oscillate(NUMBERS, OMEGA, Drive(0.2, 2), LINEAR, linear(NUMBERS))
    assert np.abs(found.fundamental / (-(OMEGA**2) * linear(NUMBERS)) - 1).max() < 1e-12


def test_a_loss_factor_is_the_series_of_its_relaxation_times() -> None:
    stiffness = complex_stiffness(prony_shares(0.3), 19.0 / (2 * np.pi))
    laws = Laws(Linear() + LossFactor(), natural=19.0)
    numbers = np.array([{"stiffness": 1.0, "loss_factor": 0.3, "gain": 1.0}.get(name, 0.0) for name in laws.names])
    found = oscillate(numbers, np.ones(1), Drive(1.0, 0), laws, np.array([-3j]))
    assert 1 / found.fundamental[0] == pytest.approx(1j * stiffness.imag / stiffness.real, abs=1e-6)


@pytest.mark.parametrize("laws", LAWS, ids=lambda laws: laws.law.in_words())
def test_derivatives_by_the_numbers_are_those_of_solving_anew(laws: Laws) -> None:
    numbers, start, drive = numbers_of(laws), 0.5 * linear(NUMBERS), Drive(0.1, 0)
    found = oscillate(numbers, OMEGA, drive, laws, start)
    assert found.found.all()
    step = 1e-5
    for k in np.flatnonzero(numbers):
        moved = [oscillate(numbers + s * step * np.eye(numbers.size)[k], OMEGA, drive, laws, start) for s in (1, -1)]
        change = (moved[0].fundamental - moved[1].fundamental) / (2 * step)
        assert np.abs(change - found.slopes[:, k]).max() < 1e-6 * max(np.abs(found.slopes[:, k]).max(), 1.0)


def test_a_fold_is_first_seen_where_a_circle_turns_back() -> None:
    angle = np.array([-0.5, -0.3, -0.1, 0.2, 0.4])
    circle, along = np.stack([np.sin(angle), np.cos(angle)], 1), np.stack([np.cos(angle), -np.sin(angle)], 1)
    (seen,) = guesses(circle, along, angle, np.ones(5, complex))
    assert seen.kind == FOLD
    assert seen.point == pytest.approx([0.0, 1.0], abs=0.3**3 / 24)  # by which the chord is shorter than the arc


def test_a_curve_that_falls_from_its_begin_on_has_its_interpolated_peak_there() -> None:
    hertz = np.linspace(2.0, 2.6, 7)
    assert interpolated_peak(hertz, 3.0 - hertz, 2 * hertz) == pytest.approx((2.0, 1.0, 4.0))
