"""The delay budget against formulas and against filters that run in time."""

import numpy as np
import pytest
from scipy import signal
from tests.unit.analysis_sweep import SAMPLE_HZ, Joint, Sensing, gyro_chain, rig_with, sweep

from sinew.analysis.signal.signals import (
    DelayBudget,
    read_signals,
    torsion_chain,
    torsion_delay,
)
from sinew.measure.errors import TimeError
from sinew.measure.recording import Segment, build_recording

FREQUENCY_HZ = np.array([1.5, 3.0, 4.3, 6.0, 12.0])


def budget_of_the_paper() -> DelayBudget:
    return DelayBudget(SAMPLE_HZ, 41.0, 0.4e-3, 3, 0.4e-3)


def test_the_chain_is_the_product_of_its_parts() -> None:
    expected = [gyro_chain(Sensing(), f) for f in FREQUENCY_HZ]
    np.testing.assert_allclose(torsion_chain(budget_of_the_paper(), FREQUENCY_HZ), expected, rtol=1e-12)


def test_the_low_pass_is_the_butterworth_filter_of_scipy() -> None:
    _, expected = signal.freqs(*signal.butter(2, 2 * np.pi * 41.0, analog=True), worN=2 * np.pi * FREQUENCY_HZ)
    np.testing.assert_allclose(torsion_chain(DelayBudget(200.0, 41.0), FREQUENCY_HZ), expected, rtol=1e-12)


def test_the_average_is_what_a_running_mean_of_the_newest_samples_does() -> None:
    time = np.arange(4000) / SAMPLE_HZ
    wave = np.exp(2j * np.pi * 6.0 * time)
    averaged = signal.lfilter(np.ones(3) / 3, [1.0], wave)
    assert torsion_chain(DelayBudget(SAMPLE_HZ, average_samples=3), 6.0) == pytest.approx(averaged[-1] / wave[-1])


def test_an_mpu9250_behind_the_opencr_library_lags_by_about_eleven_milliseconds() -> None:
    assert torsion_delay(budget_of_the_paper(), 3.0) == pytest.approx(10.9e-3, abs=0.2e-3)


def test_a_recording_without_rig_has_a_perfect_sensor() -> None:
    recording = sweep([Joint()], [3.0])
    assert read_signals(recording).budget == DelayBudget(pytest.approx(SAMPLE_HZ))


def test_the_budget_reads_the_rig() -> None:
    budget = read_signals(sweep([Joint()], [3.0]), rig_with(Sensing(drive_delay_s=1.3e-3))).budget
    assert (budget.low_pass_hz, budget.average_samples, budget.drive_delay_s) == pytest.approx((41.0, 3, 1.3e-3))


def test_without_two_samples_in_a_segment_there_is_no_delay_budget() -> None:
    segments = [Segment("steady", 1.0, 1.0 + i, 10.0, 0) for i in range(9)]
    samples = {"time_s": np.arange(9.0), "torsion_rad": np.sin(np.arange(9.0))}
    signals = read_signals(build_recording(samples, segments, [1] * 9, {"source": "import"}))
    with pytest.raises(TimeError, match="no segment holds two samples"):
        _ = signals.budget
