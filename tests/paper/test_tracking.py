"""Resonance tracking through bytes on the emulated bench, against the true motion behind it.

A smaller count of `python -m campaigns.tracking`, with other starts of the bench.
"""

from collections.abc import Sequence

import numpy as np
import pytest
from campaigns.tracked import Tracked, track_plan, tracked
from campaigns.tracking import (
    MOST_BACKBONE,
    MOST_ERROR_DEG,
    MOST_TURNS,
    Row,
    broken,
    expected_at,
    follow_rows,
    lock_rows,
    moving,
    rough_rows,
    sweep_seconds,
)
from tests.tables import rows

from sinew.analysis.tracked import tracked_point, tracked_turns
from sinew.emulator.faults import parse_fault
from sinew.plan.toml import load_plan, load_rig
from sinew.tune.track import ExpectedBackbone

pytestmark = pytest.mark.slow

SEED = 1003
Expected = tuple[ExpectedBackbone, ...]


@pytest.fixture(scope="module")
def expected() -> Expected:
    return expected_at((0.0, 3.0, 6.0, 9.0, 12.0))


@pytest.mark.parametrize("index", [0, *(pytest.param(index, marks=pytest.mark.long) for index in (2, 4))])
def test_it_locks_within_ten_turns_from_a_fifth_off_and_stays(expected: Expected, index: int) -> None:
    rows = list(lock_rows(expected[index : index + 1], [SEED]))
    assert broken(rows) == []
    assert max(max(row.turns_to_lock, row.turns_to_claim) for row in rows) <= MOST_TURNS
    assert max(row.error_deg for row in rows) < MOST_ERROR_DEG


@pytest.mark.parametrize("index", [pytest.param(0, marks=pytest.mark.long), 4])
def test_the_backbone_by_lock_is_the_backbone_by_prediction(expected: Expected, index: int) -> None:
    one, rig = expected[index], load_rig("paper")
    found = tracked(track_plan(one.pretension_mm, None, 10.0), [one], seed=SEED)
    assert found.recording is not None
    (segment,) = np.flatnonzero(found.recording["kind"].values == "tracking").tolist()
    point = tracked_point(tracked_turns(found.recording, segment, rig), rig)
    predicted = one.frequency_at(np.radians(point.torsion_deg.value))
    assert point.frequency_hz.value == pytest.approx(predicted, rel=MOST_BACKBONE)
    late = found.after(5.0)
    assert point.frequency_hz.low < found.frequency_hz[late].mean() < point.frequency_hz.high
    assert point.torsion_deg.value == pytest.approx(found.torsion_deg[late].mean(), rel=5e-3)


@pytest.mark.long
def test_a_weak_drive_is_tracked_on_the_same_backbone(expected: Expected) -> None:
    one = expected[2]
    found = tracked(track_plan(one.pretension_mm, None, 10.0, amplitude_deg=(6.0,)), [one], seed=SEED)
    late = found.after(5.0)
    torsion = found.torsion_deg[late].mean()
    assert torsion < 0.6 * np.degrees(one.torsion[-1])
    predicted = one.frequency_at(np.radians(torsion))
    assert found.frequency_hz[late].mean() == pytest.approx(predicted, rel=MOST_BACKBONE)


@pytest.fixture(scope="module")
def moved(expected: Expected) -> list[tuple[Row, Tracked]]:
    """Return row and motion of the way from 0 to 12 mm, and of the way back."""
    return list(moving(expected, SEED))


@pytest.mark.long
def test_it_keeps_the_lock_from_0_to_12_mm_and_back(moved: list[tuple[Row, Tracked]]) -> None:
    rows = [row for row, _ in moved]
    assert broken(rows) == []
    assert [row.losses for row in rows] == [0, 0]


@pytest.mark.long
def test_the_resonance_follows_a_commanded_frequency_across_the_band(expected: Expected) -> None:
    rows = list(follow_rows(expected, SEED))
    assert broken(rows) == []
    assert max(row.off_hz for row in rows) < 0.02


@pytest.mark.long
def test_it_outlasts_a_silent_sensor_and_pushes(expected: Expected) -> None:
    rows = list(rough_rows(expected[1], SEED))
    assert broken(rows) == []
    assert min(row.largest_deg for row in rows[1:]) > 3.0  # the pushes were felt


@pytest.mark.parametrize(
    ("fault", "sentence"),
    rows("""
        imu-freeze@0-1000 => IMU repeats one sample
        drop:p=1@0-0.5 => have not answered
        unplug@0-1000 => the port is gone
        brown-out:to=5V@0-1000 => not answered
        overheat:motor=2,rate=100@0-1000 => tendon 2 raises its alert
        push:torque=8@0-0.3 => torsion of the head
        slip-tendon:tendon=2,by=6mm@0 => tendon
    """),
)
def test_whatever_ends_it_the_motors_are_safe(expected: Expected, fault: str, sentence: str) -> None:
    found = tracked(track_plan(6.0, None, 8.0), expected[2:3], [(parse_fault(fault), 3.0)], seed=SEED)
    assert not found.report.is_complete
    assert sentence in found.report.sentence
    assert found.is_safe


@pytest.mark.long
def test_the_whole_curve_takes_less_than_a_fifth_of_a_stepped_sweeps_time(
    expected: Expected, moved: list[tuple[Row, Tracked]]
) -> None:
    sweep = load_plan("paper").sweep
    assert sweep is not None
    (_, found), _ = moved
    curve = _curve(found, [one.pretension_mm for one in expected])
    predicted = [float(one.frequency_hz[-1]) for one in expected]
    assert curve == pytest.approx(predicted, rel=MOST_BACKBONE)
    assert 5 * np.ptp(found.time_s) < len(expected) * sweep_seconds(sweep)


def _curve(found: Tracked, pretension_mm: Sequence[float]) -> list[float]:
    """Return the true frequency [Hz] on the way at some pretensions."""
    late = found.after(4.0)
    return np.interp(pretension_mm, found.pretension_mm[late], found.frequency_hz[late]).tolist()
