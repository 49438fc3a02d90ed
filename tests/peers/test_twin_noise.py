"""The twin's coloured noise beside SciPy's low-pass of white noise."""

import numpy as np
import pytest
from scipy import signal

from sinew.plan.toml import load_rig
from sinew.twin.sensors import _noise


@pytest.mark.parametrize("sample_hz", [200.0, 1000.0])
def test_noise_is_what_scipy_passes_of_white_noise(sample_hz: float) -> None:
    imu = load_rig("paper").imu
    b, a = signal.butter(2, imu.low_pass.value, fs=sample_hz)
    _, gain = signal.freqz(b, a, worN=512)
    passed = signal.lfilter(b, a, np.random.default_rng(3).standard_normal(5000))

    found = _noise(0.5, imu, 5000, sample_hz, np.random.default_rng(3))

    np.testing.assert_allclose(found, 0.5 / np.sqrt(np.mean(np.abs(gain) ** 2)) * passed, atol=1e-12)
