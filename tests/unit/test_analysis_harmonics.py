"""The harmonic fit against signals of which everything is known."""

import numpy as np
import pytest
from scipy import signal

from sinew.analysis.signal.harmonics import fit_harmonics, refine_frequency, relative_noise, waveform

COEFFICIENT = np.array([2.0 - 1.0j, 0.1 + 0.05j, -0.2j, 0.03, 0.01 - 0.02j])


def record(frequency_hz: float, samples: int = 333, jitter_s: float = 0.0, seed: int = 0):
    """One record at 200 Hz with offset 0.3, slope 0.05 per second and five harmonics about its middle."""
    random = np.random.default_rng(seed)
    time = 100.0 + np.arange(samples) / 200.0 + jitter_s * random.uniform(-1, 1, samples)
    elapsed = time - 0.5 * (time[0] + time[-1])
    values = waveform(COEFFICIENT[None], 2 * np.pi * frequency_hz * elapsed)[0]
    return time, 0.3 + 0.05 * elapsed + values


def coloured(records: int, samples: int, seed: int = 0):
    """White noise through a 41 Hz Butterworth low-pass and a mean of three: the gyroscope's."""
    noise = np.random.default_rng(seed).normal(size=(records, samples + 40))
    filtered = signal.lfilter(*signal.butter(2, 41.0, fs=200.0), noise, axis=1)
    return signal.lfilter(np.ones(3) / 3, [1.0], filtered, axis=1)[:, 40:]


@pytest.mark.parametrize("jitter_s", [0.0, 0.5e-3, 2e-3])
def test_harmonics_are_found_on_the_stamps_as_they_are(jitter_s: float) -> None:
    time, values = record(3.0, jitter_s=jitter_s)
    fitted = fit_harmonics(time[None], values[None, None], np.array([3.0]))
    np.testing.assert_allclose(fitted.coefficient[0, 0], COEFFICIENT, atol=1e-10)


def test_harmonics_above_the_sample_rates_reach_are_nan() -> None:
    time, values = record(30.0)
    fitted = fit_harmonics(time[None], values[None, None], np.array([30.0]))
    assert np.isfinite(fitted.coefficient[0, 0]).tolist() == [True, True, True, False, False]


def test_the_standard_deviation_is_right_for_coloured_noise() -> None:
    time = np.tile(np.arange(333) / 200.0, (400, 1))
    fitted = fit_harmonics(time, coloured(400, 333)[:, None], np.full(400, 3.0))
    scatter = np.sqrt(np.mean(np.abs(fitted.coefficient[:, 0]) ** 2, axis=0) / 2)
    np.testing.assert_allclose(np.sqrt((fitted.std[:, 0] ** 2).mean(axis=0)), scatter, rtol=0.12)


def test_jitter_is_seen_as_noise_of_the_phase_and_not_of_the_amplitude() -> None:
    time = np.tile(np.arange(333) / 200.0, (50, 1))
    values = np.cos(2 * np.pi * 3.0 * time)
    stamps = time + 0.2e-3 * np.random.default_rng(1).normal(size=time.shape)
    amplitude, phase = relative_noise(fit_harmonics(stamps, values[:, None], np.full(50, 3.0)), 0)
    assert np.median(amplitude) < 0.8 * np.median(phase)


def test_jitter_that_two_signals_share_drops_out_of_their_quotient() -> None:
    time = np.tile(np.arange(333) / 200.0, (50, 1))
    values = np.stack([np.cos(2 * np.pi * 3.0 * time), 2 * np.cos(2 * np.pi * 3.0 * time - 0.1)], axis=1)
    stamps = time + 0.2e-3 * np.random.default_rng(1).normal(size=time.shape)
    fitted = fit_harmonics(stamps, values, np.full(50, 3.0))
    assert np.median(relative_noise(fitted, 0, 1)[1]) < 0.3 * np.median(relative_noise(fitted, 0)[1])


def test_growth_per_period_is_that_of_a_growing_record() -> None:
    time = np.arange(1000) / 200.0
    values = (1 + 0.01 * 3.0 * (time - time.mean())) * np.cos(2 * np.pi * 3.0 * time)
    fitted = fit_harmonics(time[None], values[None, None], np.array([3.0]))
    assert (fitted.growth[0, 0] / fitted.coefficient[0, 0, 0]).real == pytest.approx(0.01, rel=0.02)


def test_a_frequency_is_refined_from_a_guess_that_is_two_percent_off() -> None:
    time, values = record(3.1234, jitter_s=0.5e-3)
    assert refine_frequency(time, values, 3.06) == pytest.approx(3.1234, rel=1e-6)
