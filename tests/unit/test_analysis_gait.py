"""A gait: strides of walking and of nothing else, their frequency, and the yaw that repeats with them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from tests.experiments.walker import RATE_HZ, Walker, alike, walk, yaw_of

from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError
from sinew.tune.gait import (
    BodyMotion,
    WalkGait,
    estimate_gait,
    mean_of_strides,
    target_of_walks,
)

EVEN = Walker(cv=(0.0, 0.0))


def gait(motion: BodyMotion) -> WalkGait:
    return estimate_gait(motion, "made up")


def motion_of(phase: Array, bounce: Array, size: float = 1.0) -> BodyMotion:
    """Return the motion without noise of a phase [rad] that is sampled at 100 Hz."""
    pelvis, trunk = yaw_of(EVEN, phase, np.full(phase.size, size))
    time = np.arange(phase.size) / RATE_HZ
    return BodyMotion(time, pelvis, trunk, trunk - pelvis, bounce, True)


@pytest.mark.parametrize("frequency_hz", [0.45, 0.7, 0.95, 1.1, 1.5])
def test_an_even_walk_gives_the_frequency_and_amplitude_it_was_made_with(frequency_hz: float) -> None:
    walker = replace(EVEN, frequency_hz=frequency_hz)
    (bout,) = gait(walk(walker, 40, np.random.default_rng(1))).bouts
    assert bout.stride_frequency_hz.value == pytest.approx(frequency_hz, rel=2e-3)
    assert bout.yaw_amplitude_deg.value == pytest.approx(walker.relative_deg, rel=0.01)


def test_a_straight_drift_of_the_yaw_changes_nothing() -> None:
    still, drifting = (walk(EVEN, 30, np.random.default_rng(3), drift) for drift in (0.0, 5.0))
    a, b = gait(still).bouts[0], gait(drifting).bouts[0]
    assert b.yaw_amplitude_deg.value == pytest.approx(a.yaw_amplitude_deg.value, rel=1e-3)


def test_the_bounce_of_a_limp_does_not_double_or_halve_the_stride() -> None:
    phase = 2 * np.pi * 0.9 * np.arange(4000) / RATE_HZ
    for bounce in (0.15 * np.cos(2 * phase) + 0.12 * np.cos(phase), 0.1 * np.cos(2 * phase) + 0.12 * np.cos(4 * phase)):
        assert gait(motion_of(phase, bounce)).bouts[0].stride_frequency_hz.value == pytest.approx(0.9, rel=1e-3)


def test_without_a_bounce_the_yaw_alone_tells_the_strides() -> None:
    motion = replace(walk(EVEN, 30, np.random.default_rng(5)), bounce=None)
    assert gait(motion).bouts[0].stride_frequency_hz.value == pytest.approx(0.95, rel=3e-3)


def test_a_stop_divides_a_walk_into_bouts_and_the_band_spans_their_speeds() -> None:
    time = np.arange(0, 110, 1 / RATE_HZ)
    phase = 2 * np.pi * np.cumsum(np.where(time < 55, 0.7, 1.05)) / RATE_HZ
    lively = np.where((time > 50) & (time < 58), 0.0, 1.0)
    noise = 0.005 * np.random.default_rng(6).normal(size=time.size)
    motion = motion_of(phase, 0.2 * lively * np.cos(2 * phase) + noise)
    parts = {name: getattr(motion, name) * lively for name in ("pelvis", "trunk", "relative")}
    found = gait(replace(motion, **parts))
    target = target_of_walks([found])
    assert len(target.bouts) == 2
    assert target.stride_band_hz == pytest.approx((0.7, 1.05), rel=5e-3)
    assert found.left_out_s > 8


def test_a_turn_is_left_out() -> None:
    motion = walk(EVEN, 60, np.random.default_rng(7))
    turn = np.interp(motion.time_s, [30, 33], [0, np.pi])
    assert motion.pelvis is not None
    assert motion.trunk is not None
    turned = replace(motion, pelvis=motion.pelvis + turn, trunk=motion.trunk + turn)
    bouts = gait(turned).bouts
    assert [bout for bout in bouts if bout.start_s < 30.5 and bout.stop_s > 32.5] == []
    assert len(bouts) == 2


def test_a_change_of_stride_length_does_not_smear_the_yaw() -> None:
    time = np.arange(0, 40, 1 / RATE_HZ)
    phase = 2 * np.pi * np.cumsum(np.linspace(0.9, 1.0, time.size)) / RATE_HZ
    (bout,) = gait(motion_of(phase, 0.2 * np.cos(2 * phase))).bouts
    assert bout.yaw_amplitude_deg.value == pytest.approx(EVEN.relative_deg, rel=5e-3)


@pytest.mark.parametrize("seed", range(6))
def test_somebody_who_stands_and_sways_makes_no_steps(seed: int) -> None:
    sway = 5 * gaussian_filter1d(np.random.default_rng(seed).normal(size=(3, 3000)), 20, axis=1)
    pelvis, trunk = np.radians(2) * sway[:2]
    time = np.arange(3000) / RATE_HZ
    with pytest.raises(RecordingError, match="no steps found"):
        gait(BodyMotion(time, pelvis, trunk, trunk - pelvis, 0.01 * sway[2], True))


@pytest.mark.parametrize("seed", range(6))
def test_somebody_who_fidgets_is_not_taken_for_a_walker(seed: int) -> None:
    sway = 5 * gaussian_filter1d(np.random.default_rng(seed).normal(size=(3, 3000)), 20, axis=1)
    pelvis, trunk = np.radians(3) * sway[:2]
    time = np.arange(3000) / RATE_HZ
    with pytest.raises(RecordingError, match=r"no steps found|no 5 strides"):
        gait(BodyMotion(time, pelvis, trunk, trunk - pelvis, 0.1 * sway[2], True))


def test_a_yaw_that_no_person_makes_is_refused() -> None:
    phase = 2 * np.pi * 0.9 * np.arange(4000) / RATE_HZ
    with pytest.raises(RecordingError, match="unit"):
        gait(motion_of(phase, 0.2 * np.cos(2 * phase), size=57.3))


def test_files_that_tell_different_yaws_are_not_averaged() -> None:
    whole = walk(EVEN, 30, np.random.default_rng(11))
    alone = replace(whole, trunk=None, relative=None)
    with pytest.raises(RecordingError, match="different yaws"):
        target_of_walks([gait(whole), gait(alone)])


def test_a_pelvis_alone_is_told_to_be_no_joints_yaw() -> None:
    whole = walk(EVEN, 30, np.random.default_rng(12))
    target = target_of_walks([gait(replace(whole, trunk=None, relative=None))])
    assert target.yaw_of == "pelvis"
    assert "only the pelvis was recorded" in " ".join(target.sentences)


@pytest.mark.parametrize("strides", [2, 3, 5])
def test_a_few_strides_give_numbers_without_an_interval(strides: int) -> None:
    found = gait(walk(EVEN, strides, np.random.default_rng(9)))
    (bout,) = found.bouts
    assert bout.stride_frequency_hz.value == pytest.approx(0.95, rel=0.03)
    assert bout.yaw_amplitude_deg.value == pytest.approx(EVEN.relative_deg, abs=0.5)
    assert np.isnan([bout.stride_frequency_hz.std, bout.stride_frequency_hz.low, bout.yaw_amplitude_deg.high]).all()
    assert "no scatter" in " ".join(target_of_walks([found]).sentences)


def test_the_interval_of_the_mean_scales_and_moves_with_the_strides() -> None:
    values = np.random.default_rng(13).normal(size=20)
    plain, moved = mean_of_strides(values), mean_of_strides(5 - 2 * values)
    assert (moved.value, moved.std) == pytest.approx((5 - 2 * plain.value, 2 * plain.std))
    assert (moved.low, moved.high) == pytest.approx((5 - 2 * plain.high, 5 - 2 * plain.low))


@pytest.mark.parametrize("strides", [5, 8, 18, 40])
def test_nine_of_ten_intervals_hold_the_mean_over_the_likenesses_that_are_allowed_for(strides: int) -> None:
    generator = np.random.default_rng([14, strides])
    held = 0
    for _ in range(600):
        found = mean_of_strides(alike(strides, generator.uniform(0, 0.9), generator))
        held += found.low <= 0 <= found.high
    # The binomial standard deviation of 600 draws at 0.9 is 1.2 %; the prior on the scale costs some more.
    assert 0.86 <= held / 600 <= 0.95
