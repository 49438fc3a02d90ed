"""Records that hold no ring-down are refused with one helpful line."""

import re

import numpy as np
import pytest
from tests.unit.ring_down_signals import FREQUENCY_HZ, Decay, times

from sinew.analysis.decay.ring_down import analyse_ring_down
from sinew.measure.errors import RecordingError, TimeError

T = times()


def test_a_decay_of_two_half_cycles_is_too_short() -> None:
    t = times(duration_s=1.0 / FREQUENCY_HZ, sample_hz=200.0)
    with pytest.raises(RecordingError, match=r"too short|no oscillation"):
        analyse_ring_down(t, Decay(0.08, phase=1.0).angle(t))


def test_a_record_that_ends_with_its_drive_is_too_short_or_without_decay() -> None:
    t = times(duration_s=0.2, before_s=3.0)
    with pytest.raises(RecordingError, match=r"too short|no decay"):
        analyse_ring_down(t, Decay(0.08).driven_until_zero(t))


def test_a_growing_oscillation_is_refused_as_growing() -> None:
    with pytest.raises(RecordingError, match="grows instead of decaying"):
        analyse_ring_down(T, np.exp(0.6 * T) * np.sin(20 * T))


def test_an_oscillation_that_never_decays_is_refused() -> None:
    noise = 0.05 * np.random.default_rng(1).standard_normal(T.size)
    with pytest.raises(RecordingError, match=r"no decay|grows"):
        analyse_ring_down(T, np.sin(20 * T) + noise)


def test_a_constant_response_is_refused_as_constant() -> None:
    with pytest.raises(RecordingError, match="constant"):
        analyse_ring_down(T, np.full(T.size, 3.0))


@pytest.mark.parametrize("seed", range(20))
def test_noise_alone_is_refused(seed: int) -> None:
    with pytest.raises(RecordingError):
        analyse_ring_down(T, np.random.default_rng(seed).standard_normal(T.size))


def test_a_creep_without_oscillation_is_refused() -> None:
    with pytest.raises(RecordingError, match="no oscillation"):
        analyse_ring_down(T, np.exp(-T))


def test_nan_is_refused_with_its_place() -> None:
    response = Decay().angle(T)
    response[17] = np.nan
    with pytest.raises(RecordingError, match="sample 17"):
        analyse_ring_down(T, response)


def test_a_gap_is_refused_with_its_place() -> None:
    keep = np.r_[0:100, 150:300]
    with pytest.raises(TimeError, match=r"gap of 0.51 s after 0.990 s"):
        analyse_ring_down(T[keep], Decay().angle(T[keep]))


def test_time_that_goes_backwards_is_refused() -> None:
    with pytest.raises(TimeError, match="does not increase"):
        analyse_ring_down(T[::-1], Decay().angle(T))


def test_columns_of_unequal_length_are_refused() -> None:
    with pytest.raises(RecordingError, match="equal length"):
        analyse_ring_down(T, Decay().angle(T)[:-1])


def test_ten_samples_are_refused() -> None:
    with pytest.raises(RecordingError, match="10 samples"):
        analyse_ring_down(T[:10], Decay().angle(T[:10]))


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


def test_each_refusal_is_one_line() -> None:
    with pytest.raises(RecordingError) as refusal:
        analyse_ring_down(T, np.full(T.size, 3.0))
    assert "\n" not in str(refusal.value)
