"""Walking people that others measured: stride frequency and yaw as the SOURCE.txt beside each recording has them.

The recordings are no part of this repository.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from sinew.measure.files.walk import read_walk
from sinew.tune.gait import BodyMotion, BoutGait, WalkGait, body_motion, estimate_gait, target_of_walks

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="real recordings are not beside this repository")

# stride frequency [Hz], fundamental of hip, upper back, and upper back minus hip [deg], seconds of walking
BOUTS = ((1.09, 4.9, 2.7, 6.8, 96.0, 114.0), (1.00, 4.1, 3.2, 6.9, 117.5, 137.0))


@cache
def walking() -> tuple[BodyMotion, WalkGait]:
    motion = body_motion(read_walk(DATA / "qmt_walking_imu" / "walking.npz"))
    return motion, estimate_gait(motion, "walking.npz")


@cache
def markers() -> tuple[BodyMotion, BoutGait]:
    motion = body_motion(read_walk(DATA / "gait_mocap" / "bmclab_gait_c3d_markers.csv"))
    (bout,) = estimate_gait(motion, "markers").bouts
    return motion, bout


def test_the_two_walks_are_found_and_the_turn_between_them_is_not() -> None:
    found = [(bout.start_s, bout.stop_s) for bout in walking()[1].bouts]
    assert len(found) == 2
    for (start, stop), (*_, first, last) in zip(found, BOUTS, strict=True):
        assert first <= start < stop <= last


@pytest.mark.parametrize("which", [0, 1])
def test_the_stride_frequency_is_the_sources_within_3_percent(which: int) -> None:
    assert walking()[1].bouts[which].stride_frequency_hz.value == pytest.approx(BOUTS[which][0], rel=0.03)


def test_the_yaw_is_the_sources_within_its_interval_and_half_a_degree_where_the_walk_is_even() -> None:
    # The source fitted one sine to a whole walk, which reads less where the strides' length varies.
    uneven, even = walking()[1].bouts
    assert even.yaw_amplitude_deg.value == pytest.approx(BOUTS[1][3], abs=0.5)
    assert uneven.yaw_amplitude_deg.low < BOUTS[0][3] < uneven.yaw_amplitude_deg.high


def test_the_band_holds_both_walks() -> None:
    low, high = target_of_walks([walking()[1]]).stride_band_hz
    assert low < 1.00 < 1.09 < high


@pytest.mark.parametrize("which", [0, 1])
def test_one_sine_over_the_sources_seconds_gives_the_sources_yaw(which: int) -> None:
    motion = walking()[0]
    frequency, *_, relative, first, last = BOUTS[which]
    inside = (motion.time_s >= first) & (motion.time_s <= last)
    assert motion.relative is not None
    time, rate = motion.time_s[inside], np.gradient(motion.relative, motion.time_s)[inside]
    sizes = []
    for f in np.linspace(0.97 * frequency, 1.03 * frequency, 61):
        wave = np.column_stack([np.ones_like(time), np.cos(2 * np.pi * f * time), np.sin(2 * np.pi * f * time)])
        weights = np.linalg.lstsq(wave, rate, rcond=None)[0]
        sizes.append(np.degrees(np.hypot(*weights[1:])) / (2 * np.pi * f))
    assert max(sizes) == pytest.approx(relative, abs=0.5)


def test_markers_on_hips_and_shoulders_tell_the_stride_that_the_feet_make() -> None:
    # The heels' highest points come again after 0.98 s, right and left.
    table = np.genfromtxt(DATA / "gait_mocap" / "bmclab_gait_c3d_markers.csv", delimiter=",", names=True)
    strides = []
    for heel in ("RHEE_z_mm", "LHEE_z_mm"):
        height, time = np.nan_to_num(table[heel]), table["t_s"]
        peaks = [i for i in range(9, height.size - 9) if height[i] == height[i - 9 : i + 10].max() > 150]
        strides.append(float(np.diff(time[peaks]).mean()))
    assert 1 / markers()[1].stride_frequency_hz.value == pytest.approx(np.mean(strides), rel=0.03)
