"""A bent head on the live page: its tilt by the sensors of the bench, and how near the tendons drew the plates."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.bench_journal import RIG, RIG_TEXT, Node, cycle
from tests.unit.bent_signals import Rates, arc, orientation, sensed

from sinew.apps.dashboard.hub import JournalTail
from sinew.apps.dashboard.work.design import preview_document
from sinew.apps.dashboard.work.samples import LiveChannels, drawn_rig
from sinew.bench.record.journal import Journal
from sinew.bench.record.sample import Sample
from sinew.measure.events import Contact
from sinew.plan.plan import Plan, Pose
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_plan, load_plan
from sinew.predict.design import Design, design_rig
from sinew.predict.section import rectangle_section

RATE_HZ = 200.0
BENT = load_plan("bent")
AT_AXIS = RIG.model_copy(
    update={"imu": RIG.imu.model_copy(update={"mount_radius": RIG.imu.mount_radius.model_copy(update={"value": 0.0})})}
)


def rows_of(motion: Callable[[Rates], Rates], seconds: float, rig: RigSpec = AT_AXIS) -> dict[str, np.ndarray]:
    """What the journal has of a head that moves like that; the tendons pull as at first contact."""
    time = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    told = sensed(motion, time, 0.0, np.random.default_rng(0))
    zero = np.zeros_like(time)
    rows = {"time_s": time, "imu_time_s": time}
    rows |= dict.fromkeys(("drive_command_rad", "drive_rad", "drive_current_a", "tilt_rad"), zero)
    for axis, name in enumerate("xyz"):
        rows[f"gyro_{name}_rad_s"] = told["gyro_rad_s"][:, axis]
        rows[f"acceleration_{name}_m_s2"] = told["acceleration_m_s2"][:, axis]
    current = rig.tendons.current(rig.tendons.first_contact_tension.value)
    for i in range(rig.tendons.count):
        rows |= {f"tendon_{i + 1}_rad": zero + 1.0 + 0.1 * i, f"tendon_{i + 1}_current_a": zero + current}
    return rows


def traced(channels: LiveChannels, rows: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return dict(zip((one.key for one in channels.channels), channels.take(rows), strict=True))


def swinging(bend: float, azimuth: float, torsion: float = 0.0, frequency_hz: float = 3.5) -> Callable[[Rates], Rates]:
    """A head that leans like that and twists to and fro, from a quarter of a second on; evenly, as a rod does."""

    def motion(time: Rates) -> Rates:
        begun = np.clip(4 * time, 0.0, 1.0) ** 2
        return arc(bend, azimuth, torsion * begun * np.sin(2 * math.pi * frequency_hz * time))

    return motion


@pytest.mark.parametrize("azimuth_deg", [0.0, 90.0, -130.0])
def test_a_head_at_rest_stands_where_it_leans(azimuth_deg: float) -> None:
    pose = Pose(bend_deg=20.0, azimuth_deg=azimuth_deg)
    found = traced(LiveChannels(AT_AXIS, pose), rows_of(swinging(pose.bend_rad, pose.azimuth_rad), 8.0))
    pitch, roll = np.degrees(pose.swing_rad)
    assert [found["pitch"][-1], found["roll"][-1]] == pytest.approx([pitch, roll], abs=0.1)
    assert [found["in_plane"][-1], found["out_of_plane"][-1]] == pytest.approx([0.0, 0.0], abs=0.1)


def test_a_bent_head_that_twists_evenly_sways_by_half_the_sine_of_its_bend() -> None:
    motion = swinging(math.radians(20.0), math.radians(90.0), math.radians(15.0))
    found = traced(LiveChannels(AT_AXIS, BENT.rest_pose), rows_of(motion, 14.0))
    late = slice(-400, None)
    sway = 0.5 * np.ptp(found["out_of_plane"][late])
    assert sway == pytest.approx(15.0 * 0.5 * math.sin(math.radians(20.0)), rel=0.1)
    assert np.abs(np.mean(found["in_plane"][late])) < 1.0


def test_what_the_gyroscope_under_reads_of_a_bent_head_is_made_good() -> None:
    motion = swinging(math.radians(30.0), 0.0, math.radians(15.0))
    pose = Pose(bend_deg=30.0, azimuth_deg=0.0)
    rows = rows_of(motion, 14.0)
    found = traced(LiveChannels(AT_AXIS, pose), rows)["torsion"][-400:]
    w, x = orientation(motion, rows["time_s"]).T[:2]
    true = np.degrees(2 * np.arctan2(x, w))[-400:]
    assert np.ptp(found) == pytest.approx(np.ptp(true), rel=0.01)


def test_a_flat_joint_is_drawn_with_its_own_outline() -> None:
    flat = design_rig(RIG, Design(section=rectangle_section(0.06, 0.03)))
    outline = 1e3 * RIG.silicone.length.value * np.array(drawn_rig(flat)["shape"]["outline"])
    assert np.abs(outline).max(axis=0) == pytest.approx([30.0, 15.0], abs=1e-3)


def test_the_plates_come_together_by_the_take_up_less_what_the_cables_stretch() -> None:
    channels, rows = LiveChannels(AT_AXIS, BENT.rest_pose), rows_of(swinging(0.3, 0.0), 0.1)
    channels.touch(np.array([1.0, 1.1, 1.2, 1.3]))
    tendons, more_n = AT_AXIS.tendons, 20.0
    for i in range(4):
        rows[f"tendon_{i + 1}_rad"] = rows[f"tendon_{i + 1}_rad"] + 6e-3 / tendons.pulley_radius.value
        rows[f"tendon_{i + 1}_current_a"] = rows[f"tendon_{i + 1}_current_a"] + tendons.current(more_n)
    found = traced(channels, rows)["shortening"]
    assert found[-1] == pytest.approx(6.0 - 1e3 * more_n / tendons.cable_stiffness.value, abs=1e-9)


def pulled(index: int, angle: float) -> Sample:
    one = cycle(100 + index / RATE_HZ, 3.0, 100.0, Node(), np.random.default_rng(0))
    return replace(one, tendon_rad=(angle, angle + 0.1, angle + 0.2, angle + 0.3))


def test_where_the_tendons_met_first_contact_last_is_read_from_the_journal(tmp_path: Path) -> None:
    with Journal.create(tmp_path / "journal.sqlite", dump_plan(BENT), RIG_TEXT) as journal:
        for index, angle in enumerate((0.5, 1.5)):
            journal.append(pulled(index, angle))
            journal.event(Contact.of(current_ma=85.0))
        journal.append(pulled(2, 9.0))
        journal.flush()
        news = JournalTail(tmp_path / "journal.sqlite", 100).look()
    assert news.contact is not None
    assert news.contact.tolist() == pytest.approx([1.5, 1.6, 1.7, 1.8])


# What is said of a bent plan before it runs.


def at(plan: Plan, *pretension_mm: float) -> str:
    held = plan.pretension.model_copy(update={"pretension_mm": pretension_mm})
    return dump_plan(plan.model_copy(update={"pretension": held}))


def test_a_bent_plan_is_previewed_by_what_holds_it() -> None:
    found = preview_document(at(BENT, 6.0), RIG_TEXT)
    assert (found["ok"], found["torsion"]) == (True, [])
    assert found["pose"]["bend_deg"] == 20.0
    assert found["tension"][0]["tension_n"] == pytest.approx(69.0, abs=1.0)  # what `sinew pose` says in the tutorial


def test_a_tendon_that_would_be_slack_is_refused_before_a_bench_refuses_it() -> None:
    found = preview_document(at(BENT, 2.0), RIG_TEXT)
    assert not found["ok"]
    assert "tendon 4 would be slack" in " ".join(found["refusals"])
