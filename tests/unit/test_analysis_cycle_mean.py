"""The mean over a cycle, and the energy between two times, of signals that can be integrated by hand."""

import numpy as np
import pytest

from sinew.analysis.signal.motors import cycle_mean


@pytest.mark.parametrize("frequency_hz", [1.5, 3.1, 4.0, 6.0])
def test_a_broken_last_cycle_does_not_move_the_mean(frequency_hz: float) -> None:
    random = np.random.default_rng(1001)
    count = round(5.3 / frequency_hz * 200)
    time = np.arange(count) / 200 + 1e-4 * random.standard_normal(count)
    turn = 2 * np.pi * frequency_hz * time
    power = 2.0 + 3.0 * np.cos(turn + 0.4) + np.sin(2 * turn)
    mean, _ = cycle_mean(time[None], power[None, None], np.array([frequency_hz]))
    assert mean[0, 0] == pytest.approx(2.0, abs=1e-9)


def test_the_deviation_of_the_mean_is_that_of_white_noise() -> None:
    random = np.random.default_rng(1002)
    time = np.broadcast_to(np.arange(300) / 200, (400, 300))
    mean, std = cycle_mean(time, random.standard_normal((400, 1, 300)), np.full(400, 5.0))
    assert np.std(mean) == pytest.approx(1 / np.sqrt(300), rel=0.1)
    assert np.sqrt(np.mean(std**2)) == pytest.approx(1 / np.sqrt(300), rel=0.2)
