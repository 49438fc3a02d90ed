"""Resonance tracking through bytes on the emulated bench, against the true motion behind it.

A smaller count of the campaign in decision 36, with other starts of the bench.
"""

import numpy as np
import pytest
from tests.experiments.tracked import track_plan, tracked
from tests.tables import rows

from sinew.analysis.tracked import frequency_on_backbone, tracked_point, tracked_turns
from sinew.emulator.faults import parse_fault
from sinew.plan.toml import load_rig
from sinew.tune.track import ExpectedBackbone, expect_backbones

pytestmark = pytest.mark.slow

SEED = 1003
COMMAND_DEG = 20.0
STEADY_S = 4.0
WAY_S, LEAD_S = 30.0, 5.0
Expected = tuple[ExpectedBackbone, ...]


@pytest.fixture(scope="module")
def expected() -> Expected:
    return expect_backbones(load_rig("paper"), (0.0, 3.0, 6.0, 9.0, 12.0), COMMAND_DEG)


@pytest.mark.parametrize("off", [0.8, 1.2])
@pytest.mark.parametrize("index", [0, pytest.param(4, marks=pytest.mark.long)])
def test_it_locks_within_ten_turns_from_a_fifth_off_and_stays(expected: Expected, index: int, off: float) -> None:
    one = expected[index]
    found = tracked(track_plan(one.pretension_mm, off * float(one.frequency_hz[-1]), 8.0), [one], seed=SEED)
    assert found.report.is_complete
    assert found.is_safe
    assert found.tracker is not None
    assert max(found.turns_to_lock, found.tracker.lock.cycles) <= 10
    assert found.tracker.lock.losses == 0
    assert found.rms_deg(STEADY_S) < 3.0


@pytest.mark.parametrize("index", [pytest.param(0, marks=pytest.mark.long), 4])
def test_the_backbone_by_lock_is_the_backbone_by_prediction(expected: Expected, index: int) -> None:
    one, rig = expected[index], load_rig("paper")
    found = tracked(track_plan(one.pretension_mm, None, 10.0), [one], seed=SEED)
    assert found.recording is not None
    (segment,) = np.flatnonzero(found.recording["kind"].values == "tracking").tolist()
    point = tracked_point(tracked_turns(found.recording, segment, rig), rig)
    predicted = frequency_on_backbone(one.torsion, one.frequency_hz, np.radians(point.torsion_deg.value))
    assert point.frequency_hz.value == pytest.approx(predicted, rel=0.01)
    late = found.after(5.0)
    assert point.frequency_hz.low < found.frequency_hz[late].mean() < point.frequency_hz.high
    assert point.torsion_deg.value == pytest.approx(found.torsion_deg[late].mean(), rel=5e-3)


@pytest.mark.long
@pytest.mark.parametrize("ends", [(0, -1), (-1, 0)])
def test_it_keeps_the_lock_while_the_pretension_moves_over_its_range(expected: Expected, ends: tuple[int, int]) -> None:
    begin, end = (expected[k].pretension_mm for k in ends)
    found = tracked(track_plan(begin, None, WAY_S, pretension_to_mm=end, lead_s=LEAD_S), expected, seed=SEED)
    assert found.report.is_complete
    assert found.tracker is not None
    assert found.tracker.lock.losses == 0
    assert found.rms_deg(STEADY_S) < 3.0


@pytest.mark.long
@pytest.mark.parametrize("hertz", [(3.1, 4.15), (4.15, 3.1)])
def test_the_resonance_follows_a_commanded_frequency_across_the_band(
    expected: Expected, hertz: tuple[float, float]
) -> None:
    begin, end = sorted((0.0, 12.0), reverse=hertz[1] < hertz[0])
    plan = track_plan(begin, None, WAY_S, pretension_to_mm=end, wanted_hz=hertz, lead_s=LEAD_S)
    found = tracked(plan, expected, seed=SEED)
    assert found.report.is_complete
    moving = (found.time_s >= LEAD_S) & (found.time_s <= LEAD_S + WAY_S)
    middle = found.time_s + 0.5 / found.frequency_hz
    off = (found.frequency_hz - np.interp(middle, (LEAD_S, LEAD_S + WAY_S), hertz))[moving]
    assert np.sqrt(np.mean(off**2)) < 0.02


@pytest.mark.long
@pytest.mark.parametrize("fault", ["imu-freeze@0-0.5", "push:torque=0.5@0-0.1", "push:torque=1@0-0.1"])
def test_it_outlasts_a_silent_sensor_and_pushes(expected: Expected, fault: str) -> None:
    one = expected[1]
    plan = track_plan(one.pretension_mm, 0.9 * float(one.frequency_hz[-1]), 14.0, amplitude_deg=(12.0,))
    found = tracked(plan, [one], [(parse_fault(fault), 6.0)], seed=SEED)
    assert found.report.is_complete
    assert found.tracker is not None
    assert found.tracker.lock.losses == 0


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
