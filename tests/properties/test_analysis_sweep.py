"""The laws of linear systems in the response, whatever the numbers."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.unit.analysis_sweep import QUIET, Joint, rig_with, sweep

from sinew.analysis.signal.harmonics import fit_harmonics
from sinew.analysis.sweep.response import estimate_response, lissajous_phase

FREQUENCY_HZ = [2.0, 3.1, 4.4]
dampings = st.floats(0.02, 0.4)
naturals = st.floats(1.0, 8.0)


@settings(max_examples=25, deadline=None)
@given(dampings, naturals, st.floats(0.1, 40.0))
def test_scaling_the_drive_scales_the_torsion_and_leaves_gain_and_lag(damping, natural_hz, scale) -> None:
    joint, rig = Joint(natural_hz, damping), rig_with(QUIET)
    one, other = (
        estimate_response(sweep([joint], FREQUENCY_HZ, drive_amplitude=lambda _, s=s: 0.1 * s), rig).columns
        for s in (1.0, scale)
    )
    np.testing.assert_allclose(other["amplitude_rad"], scale * one["amplitude_rad"], rtol=1e-6)
    for name in ("gain_measured_drive", "phase_lag_rad"):
        np.testing.assert_allclose(other[name], one[name], rtol=1e-6, atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(dampings, naturals)
def test_the_lag_of_a_passive_joint_lies_between_0_and_180_degrees(damping, natural_hz) -> None:
    lag = estimate_response(sweep([Joint(natural_hz, damping)], FREQUENCY_HZ), rig_with(QUIET)).columns["phase_lag_rad"]
    assert ((lag > 0) & (lag < np.pi)).all()


@settings(max_examples=50, deadline=None)
@given(st.floats(-1.5, 4.6), st.floats(0.01, 10.0), st.floats(0.01, 10.0))
def test_the_lissajous_phase_is_the_lag_whatever_the_amplitudes(lag, drive, torsion) -> None:
    psi = 2 * np.pi * np.arange(200) / 40
    step, periods = np.array([2 * np.pi / 40]), np.array([5.0])
    found = lissajous_phase(drive * np.cos(psi)[None], torsion * np.cos(psi - lag)[None], step, periods)
    np.testing.assert_allclose(found, lag, atol=1e-9)


@settings(max_examples=50, deadline=None)
@given(st.floats(1.0, 8.0), st.floats(-100.0, 100.0), st.floats(-10.0, 10.0), st.integers(200, 900))
def test_offset_and_slope_change_no_harmonic(frequency_hz, offset, slope, samples) -> None:
    time = (np.arange(samples) / 200.0)[None]
    wave = np.cos(2 * np.pi * frequency_hz * time)
    plain, moved = (
        fit_harmonics(time, signal[:, None], np.array([frequency_hz])).coefficient
        for signal in (wave, wave + offset + slope * time)
    )
    np.testing.assert_allclose(moved, plain, atol=1e-8)
