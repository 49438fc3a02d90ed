"""The response table against the linear joint in closed form."""

import numpy as np
import pytest
import xarray as xr
from tests.unit.analysis_sweep import QUIET, Joint, Sensing, rig_with, sweep

from sinew.analysis.sweep.response import DRIFT_THRESHOLD, estimate_response

FREQUENCY_HZ = np.array([1.5, 2.0, 2.6, 2.9, 3.1, 3.2, 3.3, 3.5, 3.9, 4.6, 5.3, 6.0])
DAMPINGS = (0.03, 0.08, 0.15, 0.25)
JOINTS = [Joint(damping=damping) for damping in DAMPINGS]
TRUTH = np.stack([joint.transfer(FREQUENCY_HZ) for joint in JOINTS])[:, :, None]


def shrinking(frequency_hz: float) -> float:
    """A drive that falls short of its 20° as the frequency rises."""
    return float(np.deg2rad(20) / (1 + (frequency_hz / 5) ** 2))


@pytest.fixture(scope="module")
def noisy():
    recording = sweep(JOINTS, FREQUENCY_HZ, repeats=3, drive_amplitude=shrinking, sensing=Sensing(), seed=4)
    return estimate_response(recording, rig_with(Sensing())).columns


@pytest.fixture(scope="module")
def quiet():
    return estimate_response(sweep(JOINTS, FREQUENCY_HZ, drive_amplitude=shrinking), rig_with(QUIET)).columns


def test_the_lag_is_right_within_0_3_degrees(noisy) -> None:
    np.testing.assert_allclose(np.rad2deg(noisy["phase_lag_rad"] + np.angle(TRUTH)), 0.0, atol=0.3)


def test_without_noise_gain_and_lag_are_exact(quiet) -> None:
    measured = quiet["gain_measured_drive"] * np.exp(-1j * quiet["phase_lag_rad"])
    np.testing.assert_allclose(measured, TRUTH, rtol=1e-9)


def test_the_lissajous_phase_agrees_with_the_least_squares_phase(noisy) -> None:
    np.testing.assert_allclose(noisy["lissajous_phase_rad"], noisy["phase_lag_rad"], atol=np.deg2rad(0.3))


def test_the_mean_of_peaks_is_the_amplitude_of_a_sine(noisy) -> None:
    np.testing.assert_allclose(noisy["amplitude_peaks_rad"] / noisy["amplitude_rad"], 1.0, atol=0.003)


def test_the_gain_of_eq_6_divides_by_the_nominal_drive(quiet) -> None:
    short = np.array([shrinking(f) for f in FREQUENCY_HZ])[None, :, None] / np.deg2rad(20)
    np.testing.assert_allclose(quiet["gain"], np.abs(TRUTH) * short, rtol=1e-4)


def test_the_stated_noise_of_gain_and_lag_is_the_scatter() -> None:
    recording = sweep([Joint()], [2.5, 3.0, 3.5], repeats=120, sensing=Sensing(), seed=9)
    columns = estimate_response(recording, rig_with(Sensing())).columns
    scatter = [columns[name].std(axis=2, ddof=1) for name in ("gain_measured_drive", "phase_lag_rad")]
    stated = [np.sqrt((columns[name] ** 2).mean(axis=2)) for name in ("gain_measured_drive_std", "phase_std_rad")]
    np.testing.assert_allclose(np.array(stated) / np.array(scatter), 1.0, atol=0.4)


def test_the_delays_uncertainty_is_given_beside_the_noise() -> None:
    columns = estimate_response(sweep([Joint()], [3.0]), rig_with(QUIET, delay_std_s=0.5e-3)).columns
    assert columns["phase_delay_std_rad"][0, 0, 0] == pytest.approx(2 * np.pi * 3.0 * 0.5e-3)


def test_without_the_budget_the_lag_at_3_hz_is_11_to_12_degrees_too_large() -> None:
    recording = sweep([Joint()], [3.0])
    with_rig, without = (estimate_response(recording, rig).columns["phase_lag_rad"] for rig in (rig_with(QUIET), None))
    assert 11 < np.rad2deg(without - with_rig).item() < 12


@pytest.mark.parametrize(("damping", "transient", "settled"), [(0.03, 0.5, 0.0), (0.08, 0.002, 1.0)])
def test_a_group_is_settled_once_its_transient_is_too_small_to_matter(damping, transient, settled) -> None:
    recording = sweep([Joint(damping=damping)], [3.1], sensing=Sensing(), transient=transient)
    columns = estimate_response(recording, rig_with(Sensing())).columns
    assert columns["settled"].item() == settled
    assert (abs(columns["drift_per_period"].item()) < DRIFT_THRESHOLD) == bool(settled)


def with_third_harmonic(share: float) -> xr.Dataset:
    recording = sweep([Joint()], [2.0])
    wave = np.sin(3 * 2 * np.pi * 2.0 * recording["time_s"].values)
    return recording.assign(drive_rad=recording["drive_rad"] + share * np.deg2rad(20) * wave)


def test_the_drives_distortion_is_its_third_harmonics_share() -> None:
    columns = estimate_response(with_third_harmonic(0.07), rig_with(QUIET)).columns
    assert columns["drive_distortion"].item() == pytest.approx(0.07, rel=1e-6)


def test_saturated_samples_are_counted_and_the_current_is_a_root_mean_square() -> None:
    recording = sweep([Joint()], [3.0])
    duty = np.full(recording.sizes["sample"], 0.5)
    duty[: duty.size // 4] = -1.0
    current = np.sin(2 * np.pi * 3.0 * recording["time_s"].values)
    columns = estimate_response(
        recording.assign(
            drive_pwm=("sample", duty, {"units": "1"}), drive_current_a=("sample", current, {"units": "A"})
        )
    ).columns
    assert columns["saturated_share"].item() == pytest.approx(0.25, abs=0.005)
    assert columns["drive_current_rms_a"].item() == pytest.approx(np.sqrt(0.5), rel=0.01)


def test_what_was_not_measured_or_is_shorter_than_a_period_is_nan() -> None:
    recording = sweep([Joint(), Joint()], [2.0, 3.0])
    recording["kind"][3] = "idle"
    assert np.isnan(estimate_response(recording).columns["gain"][1, 1, 0])
    short = sweep([Joint()], [2.0, 3.0])
    short["frequency_hz"][0] = 0.2
    assert np.isnan(estimate_response(short).columns["gain"][0]).any(axis=1).tolist() == [True, False]


def test_a_foreign_rate_gives_the_angle_that_its_gyroscope_would() -> None:
    recording = sweep([Joint()], [3.0])
    rate = ("sample", recording["gyro_rad_s"].values[:, 0], {"units": "rad/s"})
    foreign = recording.drop_vars("gyro_rad_s").assign(response=rate)
    expected = estimate_response(recording).columns["amplitude_rad"]
    np.testing.assert_allclose(estimate_response(foreign).columns["amplitude_rad"], expected)


def test_a_response_in_volts_has_a_gain_but_no_angle() -> None:
    recording = sweep([Joint()], [3.0])
    recording = recording.assign(response=("sample", recording["drive_rad"].values * 4, {"units": "V"}))
    columns = estimate_response(recording.drop_vars("gyro_rad_s")).columns
    assert columns["gain_measured_drive"].item() == pytest.approx(4.0)
    assert np.isnan(columns["amplitude_rad"].item())
