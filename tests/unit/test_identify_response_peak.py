"""The peak of a fitted response and its backbone, against closed forms and published numbers."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.unit.identify_signals import OMEGA

from sinew.identify.stepped.curves import backbone_of_response, peak_of_response, resonance_by_level
from sinew.identify.stepped.fit import ResponseFit, fit_response
from sinew.identify.stepped.oscillation import Drive, Laws, lagging, top_of_sweep
from sinew.identify.stepped.points import ResponsePoints, make_points
from sinew.measure.errors import SpecError
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


def hardening_points(torques: tuple[float, ...] = (0.02, 0.05), seed: int = 0) -> tuple[ResponsePoints, ...]:
    """Return points of I = 12.74e-3 kg m², 3 Hz, ζ = 0.05, k₃ = 6 N m/rad³ at small torques, by one harmonic.

    The response is chosen by its size: of |r| the frequencies are the roots of a quadratic, with no search in it.
    """
    rng = np.random.default_rng(seed)
    groups = []
    for torque in torques:
        k, k3, push = OMEGA**2, CUBIC / INERTIA, torque / INERTIA
        largest = push / (0.1 * OMEGA**2)
        rows = []
        for size in np.linspace(0.15, 0.985, 12) * largest:
            stiff = k + 0.75 * k3 * size**2
            # (stiff - w)² + (0.1 Ω)² w = (push/size)², w = ω²
            for w in np.roots([1.0, (0.1 * OMEGA) ** 2 - 2 * stiff, stiff**2 - (push / size) ** 2]):
                if abs(np.imag(w)) < 1e-9 and np.real(w) > 0:
                    omega = np.sqrt(np.real(w))
                    rows.append((omega / (2 * np.pi), torque, push / (stiff - omega**2 + 0.1j * OMEGA * omega)))
        f, _, motion = (np.array(column) for column in zip(*rows, strict=True))
        std = 2e-3 * np.abs(motion).max() / torque
        response = motion / torque + std * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
        units = {"output_unit": "rad", "input_unit": "N*m"}
        groups.append(make_points(f, response, std, torque, excitation="torque", group=f"{torque}", **units))
    return tuple(groups)


@cache
def hardening() -> ResponseFit:
    return fit_response(hardening_points(), "cubic")


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


def test_the_backbone_is_that_of_the_undamped_joint_let_go() -> None:
    amplitude = 0.3
    turned = solve_ivp(
        lambda t, y: [y[1], -(OMEGA**2) * y[0] - CUBIC / INERTIA * y[0] ** 3],
        (0, 1),
        (amplitude, 0.0),
        events=lambda t, y: y[1] if t > 1e-6 else -1.0,
        rtol=1e-11,
        atol=1e-13,
        dense_output=True,
    )
    period = 2 * turned.t_events[0][0]
    phase = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    fundamental = 2 * np.mean(turned.sol(phase / (2 * np.pi) * period)[0] * np.cos(phase))
    backbone = backbone_of_response(hardening(), [fundamental])
    exact = 1 / period
    assert backbone.frequency_low_hz[0] < exact < backbone.frequency_high_hz[0]


def test_the_backbone_starts_at_the_natural_frequency() -> None:
    fit = hardening()
    backbone = backbone_of_response(fit, [1e-6])
    assert backbone.frequency_hz[0] == pytest.approx(fit.natural_frequency_hz.value, rel=1e-9)


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


def test_levels_of_a_hardening_joint_are_called_so() -> None:
    assert resonance_by_level(hardening_points((0.01, 0.03, 0.05))).verdict.startswith("the joint hardens")


def test_the_bend_of_the_resonance_is_that_of_the_cubic_stiffness() -> None:
    # f² = f₀² + ¾ k₃ a²/(4π² I) where the lag is 90°, so to first order in a²:
    found = resonance_by_level(hardening_points((0.01, 0.03, 0.05)))
    largest = found.resonances[-1].amplitude.value
    expected = 0.75 * CUBIC / INERTIA * largest**2 / (8 * np.pi**2 * 3.0)
    assert found.bend_hz.value == pytest.approx(expected, rel=0.05)


def test_levels_of_a_linear_joint_show_no_dependence() -> None:
    groups = []
    for k, level in enumerate((0.1, 0.2, 0.4)):
        rng = np.random.default_rng([9, k])
        frequency = np.linspace(2.5, 3.5, 21)
        u = frequency / 3.0
        response = 1.0 / (1 - u**2 + 0.1j * u) + 0.03 * (rng.standard_normal(21) + 1j * rng.standard_normal(21))
        groups.append(make_points(frequency, response, 0.03, level, excitation="force", group=f"{level}"))
    assert resonance_by_level(groups).verdict.startswith("no dependence")


def test_one_level_cannot_show_a_dependence() -> None:
    with pytest.raises(SpecError, match="at least two"):
        resonance_by_level(hardening_points((0.05,)))
