"""The torsion's time series against closed forms."""

import numpy as np
import pytest
from tests.unit.analysis_sweep import QUIET, Joint, Sensing, rig_with, sweep

from sinew.analysis.signal.attitude import integrate_rate, steady_motion
from sinew.analysis.signal.signals import response_channel
from sinew.analysis.sweep.response import fit_ellipse

JOINT = Joint(natural_hz=3.2, damping=0.08)


def test_the_integral_of_a_rate_has_the_angles_amplitude_within_1e_4_at_6_hz() -> None:
    time, omega = np.arange(400) / 200.0, 2 * np.pi * 6.0
    angle = integrate_rate(time, omega * np.cos(omega * time))
    np.testing.assert_allclose(angle, np.sin(omega * time), atol=1e-4)


def test_the_integral_uses_the_stamps() -> None:
    time = np.arange(400) / 200.0 + 1e-3 * np.random.default_rng(0).uniform(-1, 1, 400)
    angle = integrate_rate(time, np.cos(6 * time))
    np.testing.assert_allclose(angle, (np.sin(6 * time) - np.sin(6 * time[0])) / 6, atol=1e-6)


def test_the_gyroscope_is_taken_for_the_torsion_before_any_other_channel() -> None:
    recording = sweep([JOINT], [3.0])
    recording["torsion_rad"] = ("sample", np.zeros(recording.sizes["sample"]), {"units": "rad"})
    assert response_channel(recording).is_rate


@pytest.mark.parametrize("frequency_hz", [2.0, 3.2, 5.5])
def test_the_motion_of_a_group_is_the_true_torsion_at_its_true_time(frequency_hz: float) -> None:
    motion = steady_motion(sweep([JOINT], [frequency_hz]), 0, rig_with(QUIET))
    truth = np.deg2rad(20) * JOINT.transfer(frequency_hz)
    # the drive is recorded late and the budget knows it, so the motion's clock is that of the recorded drive
    turn = np.exp(2j * np.pi * frequency_hz * (motion["time_s"].values - QUIET.drive_delay_s))
    np.testing.assert_allclose(motion["torsion"].values, (truth * turn).imag, atol=2e-4)


def test_bias_and_drift_of_the_gyroscope_do_not_reach_the_torsion() -> None:
    recording = sweep([JOINT], [3.0], sensing=Sensing(noise_rad_s=0.0, jitter_s=0.0, lsb_rad=0.0, bias_rad_s=0.2))
    clean = sweep([JOINT], [3.0], sensing=Sensing(noise_rad_s=0.0, jitter_s=0.0, lsb_rad=0.0, bias_rad_s=0.0))
    with_bias, without = (steady_motion(r, 0)["torsion"].values for r in (recording, clean))
    np.testing.assert_allclose(with_bias, without, atol=1e-6)


@pytest.mark.parametrize("frequency_hz", [1.5, 3.0, 3.2, 4.0, 6.0])
def test_the_ellipse_of_a_group_has_the_joints_phase_within_a_third_of_a_degree(frequency_hz: float) -> None:
    recording = sweep([JOINT], [frequency_hz], sensing=Sensing())
    ellipse = fit_ellipse(steady_motion(recording, 0, rig_with(Sensing())))
    assert np.rad2deg(ellipse.lag_rad) == pytest.approx(-np.rad2deg(np.angle(JOINT.transfer(frequency_hz))), abs=0.3)


def test_the_ellipse_has_the_area_of_its_samples() -> None:
    motion = steady_motion(sweep([JOINT], [3.0]), 0, rig_with(QUIET))
    x, y = fit_ellipse(motion).curve(4001)
    assert fit_ellipse(motion).area == pytest.approx(np.trapezoid(x[:-1], y[:-1]), rel=1e-3)
