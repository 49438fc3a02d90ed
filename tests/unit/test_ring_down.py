"""Ring-downs whose answer is known in closed form."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import curve_fit
from scipy.special import ellipk
from tests.unit.ring_down_signals import FREQUENCY_HZ, Decay, dry_friction, lever, times

from sinew.analysis.decay.paper_method import fit_envelope, fit_envelopes
from sinew.analysis.decay.ring_down import analyse_ring_down, paper_envelope


@pytest.mark.parametrize("damping", [0.005, 0.03, 0.08, 0.17, 0.25])
def test_without_noise_damping_and_both_frequencies_are_exact(damping: float) -> None:
    t = times()
    result = analyse_ring_down(t, Decay(damping).angle(t))
    assert result.damping_ratio.value == pytest.approx(damping, rel=1e-6)
    assert result.frequency_hz.value == pytest.approx(FREQUENCY_HZ * np.sqrt(1 - damping**2), rel=1e-7)
    assert result.natural_frequency_hz.value == pytest.approx(FREQUENCY_HZ, rel=1e-7)


def test_peaks_that_scatter_in_time_give_the_papers_frequency_and_rate_the_deviations_they_have() -> None:
    random, order = np.random.default_rng(0), np.arange(12)
    found = [
        fit_envelope(0.2 * order + 2e-3 * random.standard_normal(12), np.exp(-0.1 * order) + 0.01 * noise)
        for noise in random.standard_normal((400, 12))
    ]
    # A deviation of 400 draws is known to 1/sqrt(800) = 3.5 %.
    for name, stated in (("omega_rad_s", "omega_std_rad_s"), ("decay_rate_per_s", "decay_rate_std_per_s")):
        scatter = np.std([getattr(one, name) for one in found])
        told = np.sqrt(np.mean([getattr(one, stated) ** 2 for one in found]))
        assert told == pytest.approx(scatter, rel=0.12)


def test_rows_of_any_lengths_get_the_least_squares_fit_that_scipy_finds_for_each() -> None:
    random = np.random.default_rng(1)
    rows = []
    for count, fall, noise in zip(
        random.integers(3, 45, 60), random.uniform(-1, 8, 60), random.choice([1e-3, 0.05, 0.3], 60), strict=True
    ):
        time = np.cumsum(random.uniform(0.05, 0.2, count))
        size = np.exp(-fall * (time - time[0]) / (time[-1] - time[0])) + noise * random.standard_normal(count)
        rows.append((time, random.uniform(1e-3, 1e3) * np.abs(size)))
    for found, (time, size) in zip(fit_envelopes(rows), rows, strict=True):
        start = found.amplitude, 0.9 * found.decay_rate_per_s + 0.01
        theirs, covariance = curve_fit(
            lambda t, a, rate: a * np.exp(-rate * t), time - time[0], size, start, ftol=1e-14
        )
        assert (found.amplitude, found.decay_rate_per_s) == pytest.approx(theirs, rel=1e-5, abs=1e-6)
        assert found.decay_rate_std_per_s == pytest.approx(np.sqrt(covariance[1, 1]), rel=1e-4)


@pytest.mark.parametrize("damping", [0.03, 0.08, 0.17])
def test_the_paper_damping_divides_by_the_damped_frequency(damping: float) -> None:
    t = times(sample_hz=500.0)
    result = analyse_ring_down(t, Decay(damping).angle(t))
    assert result.paper.lehr_damping == pytest.approx(damping / np.sqrt(1 - damping**2), rel=2e-3)


def test_the_paper_stiffness_and_damping_are_those_of_the_oscillator() -> None:
    inertia, stiffness = 0.0127, 0.0127 * (2 * np.pi * FREQUENCY_HZ) ** 2
    t = times(sample_hz=500.0)
    paper = analyse_ring_down(t, Decay(0.08).angle(t), inertia_kg_m2=inertia).paper
    undamped = paper.stiffness_n_m_rad + paper.decay_rate_per_s**2 * inertia
    measured = undamped, paper.stiffness_n_m_rad, paper.damping_n_m_s_rad
    damped = stiffness * (1 - 0.08**2)
    assert measured == pytest.approx((stiffness, damped, 2 * 0.08 * np.sqrt(stiffness * inertia)), rel=2e-3)


def test_creep_does_not_move_the_damping_and_is_reported_as_drift() -> None:
    t = times()
    result = analyse_ring_down(t, Decay(0.08).angle(t) + 3 * np.exp(-t / 0.6))
    change = 3 * (np.exp(-result.stop_s / 0.6) - np.exp(-result.start_s / 0.6))
    assert result.damping_ratio.value == pytest.approx(0.08, rel=1e-3)
    assert result.rest_drift.value == pytest.approx(change, rel=0.02)


@pytest.mark.parametrize("phase", np.linspace(0, np.pi, 7))
def test_behind_a_drive_the_decay_starts_within_half_a_cycle_of_its_stop(phase: float) -> None:
    t = times(before_s=2.0)
    noise = 0.1 * np.random.default_rng(7).standard_normal(t.size)
    result = analyse_ring_down(t, Decay(0.08, phase=phase).driven_until_zero(t) + noise)
    assert -0.02 < result.start_s < 0.5 / FREQUENCY_HZ + 0.02


def test_behind_a_hold_the_decay_starts_after_the_release() -> None:
    t = times(before_s=0.5)
    noise = 0.1 * np.random.default_rng(7).standard_normal(t.size)
    result = analyse_ring_down(t, Decay(0.08).held_until_zero(t) + noise)
    assert -0.02 < result.start_s < 0.6 / FREQUENCY_HZ


def test_a_given_drive_sets_the_start() -> None:
    t = times(before_s=2.0, sample_hz=200.0)
    result = analyse_ring_down(t, Decay(0.08).driven_until_zero(t), drive=lever(t))
    assert 0 <= result.start_s < 0.2 / FREQUENCY_HZ


def test_a_rate_has_the_poles_of_its_angle() -> None:
    t = times(sample_hz=200.0)
    result = analyse_ring_down(t, Decay(0.17).rate(t) + 2, is_rate=True, unit="deg/s")
    found = result.damping_ratio.value, result.frequency_hz.value
    assert found == pytest.approx((0.17, FREQUENCY_HZ * np.sqrt(1 - 0.17**2)), rel=1e-6)


@pytest.mark.parametrize("damping", [0.03, 0.08])
def test_the_papers_numbers_of_a_rate_are_had_without_the_direct_fits(damping: float) -> None:
    t = times(sample_hz=200.0)
    rate = Decay(damping).rate(t) + 0.1
    alone = paper_envelope(t, rate, free_from_s=0.3)
    assert alone.lehr_damping == pytest.approx(damping / np.sqrt(1 - damping**2), rel=0.01)
    whole = analyse_ring_down(t, rate, is_rate=True, unit="rad/s", free_from_s=0.3).paper
    assert (alone.lehr_damping, alone.omega_rad_s) == (whole.lehr_damping, whole.omega_rad_s)


def test_dry_friction_is_no_exponential_but_damping_that_rises_as_the_amplitude_falls() -> None:
    t = times(duration_s=12.0)
    shape = analyse_ring_down(t, dry_friction(t), unit="deg").shape
    assert not shape.exponential
    assert "damping rises" in shape.reason


def test_the_damping_in_windows_follows_viscous_and_dry_friction() -> None:
    # A half cycle takes A to A·e^{-λ T/2} - step·(1 + e^{-λ T/2}): over it, ln of the swing falls by λ T/2 + 2 step/A.
    t = times(duration_s=12.0, sample_hz=200.0)
    table = analyse_ring_down(t, dry_friction(t, step=0.1), unit="deg").dependence
    large = table.amplitude > 6
    expected = 0.005 + 2 * 0.1 / (np.pi * table.amplitude[large])
    assert table.damping_ratio[large] == pytest.approx(expected, rel=0.03)


def drifting(t, rate=0.9, bend=-0.1, omega=15.0, turn=1.2):
    """Return a decay whose rate is rate + 2 bend t [1/s] and whose frequency is omega + 2 turn t [rad/s]."""
    return 30 * np.exp(-rate * t - bend * t**2) * np.cos(omega * t + turn * t**2)


def drifting_means(start_s, stop_s, rate=0.9, bend=-0.1, omega=15.0, turn=1.2):
    """Return the means of rate and frequency weighted by amplitude; that of the rate is the fall over the area."""
    t = np.linspace(start_s, stop_s, 20001)
    amplitude = np.exp(-rate * t - bend * t**2)
    area = np.trapezoid(amplitude, t)
    return (amplitude[0] - amplitude[-1]) / area, np.trapezoid((omega + 2 * turn * t) * amplitude, t) / area


def test_the_rate_and_frequency_of_a_drifting_decay_are_means_weighted_by_amplitude() -> None:
    t = times(duration_s=3.0, sample_hz=200.0)
    result = analyse_ring_down(t, drifting(t))
    expected = drifting_means(result.start_s, result.stop_s)
    assert (result.decay_rate_per_s.value, 2 * np.pi * result.frequency_hz.value) == pytest.approx(expected, rel=1e-4)


@pytest.mark.slow
def test_the_intervals_by_noise_of_a_drifting_decay_hold_its_means_about_nine_times_in_ten() -> None:
    t = times(duration_s=3.0)
    inside = []
    for seed in range(60):
        result = analyse_ring_down(t, drifting(t) + 0.3 * np.random.default_rng(seed).standard_normal(t.size))
        rate, omega = drifting_means(result.start_s, result.stop_s)
        damping, frequency = rate / np.hypot(rate, omega), omega / (2 * np.pi)
        for name, truth in (("damping_ratio", damping), ("frequency_hz", frequency)):
            noise = result.parts[name].noise
            inside.append(noise.low <= truth <= noise.high)
    assert 0.8 <= np.mean(inside) <= 0.97


@pytest.mark.parametrize("step", [0.05, 0.1, 0.2])
def test_the_interval_of_the_rate_of_dry_friction_holds_the_mean_weighted_by_amplitude(step: float) -> None:
    # from crest to crest A falls to A e^{-λT/2} - step (1 + e^{-λT/2}); the mean is the whole fall over the area
    t = times(duration_s=12.0, sample_hz=200.0)
    result = analyse_ring_down(t, dry_friction(t, step=step), unit="deg")
    half = 0.5 / (FREQUENCY_HZ * np.sqrt(1 - 0.005**2))
    shrunk = np.exp(-0.005 * 2 * np.pi * FREQUENCY_HZ * half)
    crests = [30.0]
    while crests[-1] * shrunk > step * (1 + shrunk) and crests[-1] > np.abs(result.peak_value[-1]) * 1.001:
        crests.append(crests[-1] * shrunk - step * (1 + shrunk))
    area = half * (sum(crests) - 0.5 * (crests[0] + crests[-1]))
    assert result.decay_rate_per_s.low <= (crests[0] - crests[-1]) / area <= result.decay_rate_per_s.high


def pendulum(t: np.ndarray, from_deg: float) -> np.ndarray:
    """Return the swing of a pendulum of 1 Hz that is let go at an angle."""
    rate = lambda _, y: [y[1], -((2 * np.pi) ** 2) * np.sin(y[0]) - 0.15 * y[1]]  # noqa: E731
    return solve_ivp(rate, (0, 20), [np.deg2rad(from_deg), 0], t_eval=t, rtol=1e-9, atol=1e-11).y[0]


def test_a_large_swing_keeps_the_exact_period_of_the_pendulum() -> None:
    t = times(duration_s=20.0)
    swing = pendulum(t, 150)
    table = analyse_ring_down(t, swing).dependence
    exact = np.pi / (2 * ellipk(np.sin(table.amplitude / 2) ** 2))
    assert table.frequency_hz == pytest.approx(exact, rel=0.01)


@pytest.mark.parametrize(("jitter_s", "within"), [(0.0008, 1e-6), (0.002, 5e-3)], ids=["a little", "very much"])
def test_samples_taken_at_uneven_times_leave_the_damping(jitter_s: float, within: float) -> None:
    rng = np.random.default_rng(5)
    t = times(sample_hz=200.0)
    jittering = t + rng.uniform(-jitter_s, jitter_s, t.size)
    result = analyse_ring_down(jittering, Decay(0.08).angle(jittering))
    assert result.damping_ratio.value == pytest.approx(0.08, rel=within)


@pytest.mark.slow
def test_the_jitter_of_the_stamps_is_in_the_interval_of_the_frequency() -> None:
    t = times(sample_hz=200.0)
    truth = FREQUENCY_HZ * np.sqrt(1 - 0.08**2)
    found = [
        analyse_ring_down(t + 5e-4 * np.random.default_rng(seed).standard_normal(t.size), Decay(0.08).angle(t))
        for seed in range(100)
    ]
    inside = [result.frequency_hz.low <= truth <= result.frequency_hz.high for result in found]
    assert 0.8 <= np.mean(inside) <= 0.98
