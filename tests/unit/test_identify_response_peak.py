"""The peak of a fitted response, against closed forms and published numbers."""

from functools import cache

import numpy as np
import pytest
from tests.unit.identify_signals import OMEGA

from sinew.identify.oscillation import Drive, Laws, lagging, top_of_sweep
from sinew.identify.points import make_points
from sinew.identify.steady_fit import ResponseFit, fit_response, peak_of_response
from sinew.mechanics.laws import Cubic, Linear, Viscous

INERTIA, CUBIC = 12.74e-3, 6.0


@cache
def linear(excitation: str, damping: float) -> ResponseFit:
    frequency = np.linspace(1.5, 6.0, 40)
    u = frequency / 3.0
    response = {"lever": 0.65 * u**2, "force": 1.0 / OMEGA**2}[excitation] / (1 - u**2 + 2j * damping * u)
    points = make_points(frequency, response, 1e-6 * np.abs(response).max(), 0.1, excitation=excitation)
    return fit_response(points, "linear")


@pytest.mark.parametrize("damping", [0.05, 0.17, 0.25])
def test_a_lever_puts_the_peak_above_the_natural_frequency(damping: float) -> None:
    peak = peak_of_response(linear("lever", damping))
    assert (peak.frequency_hz.value, peak.gain.value) == (
        pytest.approx(3.0 / np.sqrt(1 - 2 * damping**2), rel=1e-5),
        pytest.approx(0.65 / (2 * damping * np.sqrt(1 - damping**2)), rel=1e-5),
    )


@pytest.mark.parametrize("damping", [0.05, 0.17, 0.25])
def test_a_force_puts_the_peak_below_the_natural_frequency(damping: float) -> None:
    peak = peak_of_response(linear("force", damping))
    assert peak.frequency_hz.value == pytest.approx(3.0 * np.sqrt(1 - 2 * damping**2), rel=1e-5)


@pytest.mark.parametrize("excitation", ["lever", "force"])
def test_the_lag_of_a_linear_joint_passes_90_degrees_at_its_natural_frequency(excitation: str) -> None:
    assert peak_of_response(linear(excitation, 0.17)).phase_90_hz.value == pytest.approx(3.0, rel=1e-6)


def test_a_sweep_that_ends_before_the_peak_has_none_and_says_so() -> None:
    fit = linear("lever", 0.05)
    below = fit.points[0].only(fit.points[0].frequency_hz < 2.7)
    peak = peak_of_response(fit_response(below, "linear"))
    assert (np.isnan(peak.frequency_hz.value), "extend the sweep" in peak.reason) == (True, True)


def through_the_folds() -> tuple[np.ndarray, np.ndarray]:
    """Return frequency [Hz] and largest angle [rad] at 0.45 N m against the lag from 0.3 to 2.9 rad."""
    laws = Laws(Linear() + Viscous() + Cubic())
    values = {"stiffness": 1.0, "damping": 0.1, "cubic": CUBIC / INERTIA / OMEGA**2, "gain": 1.0}
    numbers = np.array([values.get(name, 0.0) for name in laws.names])
    drive = Drive(0.45 / INERTIA / OMEGA**2, 0)
    top, _ = top_of_sweep(numbers, laws, drive, 0.5, 2.0)
    lag = np.linspace(0.3, 2.9, 1301)
    omega, waves, _ = lagging(np.tile(numbers, (lag.size, 1)), lag, laws, drive, top)
    turn = np.exp(1j * np.outer(laws.orders, np.linspace(0, 2 * np.pi, 3600)))
    return 3.0 * omega, np.abs((waves @ turn).real).max(axis=1)


def test_the_largest_angle_of_a_folded_response_is_the_published_one() -> None:
    # Continuation of the same joint by other programs: peak 0.793727 rad, folds 3.818697 and 3.521591 Hz.
    assert through_the_folds()[1].max() == pytest.approx(0.793727, abs=5e-6)


def test_both_folds_of_a_response_are_the_published_ones() -> None:
    frequency = through_the_folds()[0]
    upper = int(np.argmax(frequency[:900]))
    lower = upper + int(np.argmin(frequency[upper:]))
    assert (frequency[upper], frequency[lower]) == (
        pytest.approx(3.818697, abs=2e-5),
        pytest.approx(3.521591, abs=2e-5),
    )


@pytest.mark.slow
def test_the_interval_of_a_peak_holds_it_in_nine_of_ten_draws() -> None:
    damping, truth, inside = 0.1, 3.0 * np.sqrt(1 - 0.02), []
    frequency = np.linspace(2.0, 4.5, 16)
    u = frequency / 3.0
    response = 1.0 / (1 - u**2 + 2j * damping * u)
    for seed in range(200):
        rng = np.random.default_rng([8, seed])
        noise = 0.02 * (rng.standard_normal(16) + 1j * rng.standard_normal(16))
        points = make_points(frequency, response + noise, 0.02, 1.0, excitation="force")
        peak = peak_of_response(fit_response(points, "linear")).frequency_hz
        inside.append(peak.low <= truth <= peak.high)
    assert 0.85 <= np.mean(inside) <= 0.95
