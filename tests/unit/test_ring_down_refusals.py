"""Records that hold no ring-down are refused with one helpful line."""

import re

import numpy as np
import pytest
from tests.unit.ring_down_signals import FREQUENCY_HZ, Decay, times

from sinew.analysis.decay.ring_down import analyse_ring_down
from sinew.measure.errors import RecordingError, TimeError

T = times()
SWING = Decay().angle(T)
GAP = np.r_[0:100, 150:300]


@pytest.mark.parametrize(
    ("time_s", "response", "said"),
    [
        (T, np.exp(0.6 * T) * np.sin(20 * T), "grows instead of decaying"),
        (T, np.sin(20 * T) + 0.05 * np.random.default_rng(1).standard_normal(T.size), "no decay|grows"),
        (T, np.full(T.size, 3.0), "constant"),
        (T, np.exp(-T), "no oscillation"),
        (T, np.where(np.arange(T.size) == 17, np.nan, SWING), "sample 17"),
        (T[GAP], SWING[GAP], r"gap of 0.51 s after 0.990 s"),
        (T[::-1], SWING, "does not increase"),
        (T, SWING[:-1], "equal length"),
        (T[:10], SWING[:10], "10 samples"),
    ],
)
def test_what_is_no_ring_down_is_refused_in_one_line(time_s: np.ndarray, response: np.ndarray, said: str) -> None:
    with pytest.raises((RecordingError, TimeError), match=said) as refusal:
        analyse_ring_down(time_s, response)
    assert "\n" not in str(refusal.value)


def test_a_decay_of_two_half_cycles_is_too_short() -> None:
    t = times(duration_s=1.0 / FREQUENCY_HZ, sample_hz=200.0)
    with pytest.raises(RecordingError, match=r"too short|no oscillation"):
        analyse_ring_down(t, Decay(0.08, phase=1.0).angle(t))


@pytest.mark.parametrize("seed", range(20))
def test_noise_alone_is_refused(seed: int) -> None:
    with pytest.raises(RecordingError):
        analyse_ring_down(T, np.random.default_rng(seed).standard_normal(T.size))


def test_a_drive_that_still_moves_at_the_end_is_refused() -> None:
    with pytest.raises(RecordingError, match="still moves at the end"):
        analyse_ring_down(T, Decay().angle(T), drive=np.cos(20 * T))


@pytest.mark.parametrize("size", [1e300, 1e-300])
def test_values_that_no_sensor_measures_are_refused_with_their_size(size: float) -> None:
    with pytest.raises(RecordingError, match=re.escape(f"reaches {size:.3g}")):
        analyse_ring_down(T, size * np.cos(20 * T) * np.exp(-T))


@pytest.mark.parametrize("size", [1e12, 1e-12])
def test_an_odd_unit_is_no_reason_to_refuse(size: float) -> None:
    result = analyse_ring_down(T, size * Decay(0.08).angle(T))
    assert result.damping_ratio.value == pytest.approx(0.08, rel=1e-5)
