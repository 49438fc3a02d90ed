"""The modes of a shaken joint against pyOMA-2, which does not know the drive: the same modes, within both errors."""

from typing import Any

import numpy as np
import pytest
from tests.unit.broadband_signals import SAMPLE_HZ, noise, response_of

from sinew.analysis.broadband import fit_poles_of

setup: Any = pytest.importorskip("pyoma2.setup", reason="pyOMA-2 is not installed")
algorithms: Any = pytest.importorskip("pyoma2.algorithms", reason="pyOMA-2 is not installed")

MODES = [(3.0, 0.04, 1.0), (5.0, 0.03, 0.5)]
ORDER = 12  # of the state space, in which noise and the drive's colour have room beside two modes


def theirs(response: np.ndarray) -> np.ndarray:
    """Return frequency, its standard deviation, damping ratio, its standard deviation of both modes, shape (2, 4)."""
    single = setup.SingleSetup(response, fs=SAMPLE_HZ)
    single.decimate_data(q=4)
    single.add_algorithms(algorithms.SSI(name="SSI", method="cov", br=20, ordmax=ORDER, calc_unc=True, nb=20))
    single.run_by_name("SSI")
    single.mpe("SSI", sel_freq=[f for f, *_ in MODES], order_in=ORDER)
    found = single["SSI"].result
    return np.stack([found.Fn, found.Fn_std, found.Xi, found.Xi_std], axis=1)


@pytest.mark.slow
def test_the_modes_are_those_of_pyoma_and_the_known_drive_makes_them_surer() -> None:
    rng = np.random.default_rng(3)
    drive, clean = noise(MODES, 1200.0, rng)
    # Two sensors, for pyOMA-2 wants more than one.
    response = clean + 0.02 * clean.std() * rng.standard_normal(clean.size)
    second = clean + 0.02 * clean.std() * rng.standard_normal(clean.size)
    ours = fit_poles_of(response_of(drive, response, SAMPLE_HZ, segment_s=40.0), 1.5, 8.0, modes=2).modes
    for mode, (f, f_std, damping, damping_std) in zip(ours, theirs(np.stack([response, second], axis=1)), strict=True):
        for own, other, std in ((mode.natural_frequency_hz, f, f_std), (mode.damping_ratio, damping, damping_std)):
            assert abs(own.value - other) < 3 * np.hypot(own.std, std)
            assert own.std < std
