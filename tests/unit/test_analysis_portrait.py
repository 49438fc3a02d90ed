"""Phase portraits of motions whose anharmonicity is put in by hand."""

import numpy as np
import pytest
from tests.unit.analysis_sweep import QUIET, Joint, Sensing, gyro_chain, rig_with, sweep

from sinew.analysis.sweep.portrait import phase_portrait
from sinew.measure.files.netcdf import provenance
from sinew.measure.recording import Segment, build_recording


def bent(second: float = 0.0, third: float = 0.0, noise: float = 0.0, sensing: Sensing | None = None):
    """cos ψ + second·cos 2ψ + third·cos 3ψ as a gyroscope sees it, 20 periods of 3 Hz at 200 Hz."""
    time = np.arange(1333) / 200.0
    rate = np.zeros(time.size)
    for order, size in ((1, 1.0), (2, second), (3, third)):
        factor = gyro_chain(sensing, 3.0 * order) if sensing else 1.0
        omega = 2 * np.pi * 3.0 * order
        rate += size * (1j * omega * factor * np.exp(1j * omega * time)).real
    rate += noise * np.random.default_rng(0).normal(size=time.size)
    samples = {"time_s": time, "gyro_rad_s": np.stack([rate, 0 * rate, 0 * rate], axis=1)}
    return build_recording(samples, [Segment("steady", 0.0, 3.0, 20.0, 0)], [time.size], provenance("twin"))


def test_the_even_share_is_what_was_put_in() -> None:
    assert phase_portrait(bent(second=0.04), 0).even_share.value == pytest.approx(0.04, rel=1e-6)


def test_the_third_share_is_what_was_put_in_through_the_sensor_chain() -> None:
    portrait = phase_portrait(bent(third=0.03, sensing=QUIET), 0, rig_with(QUIET))
    assert portrait.third_share.value == pytest.approx(0.03, rel=1e-3)


def test_a_symmetric_orbit_has_no_asymmetry() -> None:
    portrait = phase_portrait(bent(third=0.05), 0)
    assert abs(portrait.half_area_asymmetry.value) < 1e-3


def test_the_half_areas_of_an_asymmetric_orbit_differ_as_the_integral_says() -> None:
    psi = (np.arange(2_000_000) + 0.5) * 2 * np.pi / 2_000_000
    angle, rate = np.cos(psi) + 0.05 * np.cos(2 * psi), -np.sin(psi) - 0.1 * np.sin(2 * psi)
    expected = np.sum(np.sign(angle) * rate**2) / np.sum(rate**2)
    assert phase_portrait(bent(second=0.05), 0).half_area_asymmetry.value == pytest.approx(expected, abs=2e-3)


def test_noise_alone_is_no_asymmetry() -> None:
    asymmetry = phase_portrait(bent(noise=0.2), 0).half_area_asymmetry
    assert abs(asymmetry.value) < 4 * asymmetry.std


def test_the_orbit_of_the_linear_joint_encloses_pi_times_amplitude_times_speed() -> None:
    motion = phase_portrait(sweep([Joint()], [3.0]), 0, rig_with(QUIET)).motion
    area = np.trapezoid(motion["rate"].values ** 2, motion["time_s"].values)
    amplitude = np.deg2rad(20) * abs(Joint().transfer(3.0))
    assert area == pytest.approx(5 * np.pi * amplitude**2 * 2 * np.pi * 3.0, rel=0.01)
