"""The pose of a plan: what it means, what is refused, and who refuses it."""

import math
from typing import Any, cast

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from sinew.apps.dashboard.run_desk import read_specs
from sinew.apps.dashboard.work.design import preview_document
from sinew.bench.preflight import refuse_unready
from sinew.measure.errors import SpecError
from sinew.plan.check import Preview, check_plan
from sinew.plan.plan import Plan, Pose
from sinew.plan.toml import dump_plan, dump_rig, load_plan, load_rig, parse_plan

RIG = load_rig("paper")
BENT = load_plan("bent")


def plan_of(**parts: Any) -> Plan:
    sweep = {"frequency_hz": (2.0, 4.0)}
    return Plan.model_validate({"name": "x", "pretension": {"pretension_mm": (6.0,)}, "sweep": sweep} | parts)


def refusals(plan: Plan, **known: Any) -> str:
    return "\n".join(check_plan(plan, RIG, **known).refusals)


def warnings(preview: Preview) -> str:
    return "\n".join(f.sentence for f in preview.findings if f.severity == "warn")


def test_the_bend_and_azimuth_of_a_pose_are_a_turn_that_leans_the_head_that_way() -> None:
    pose = Pose(bend_deg=30.0, azimuth_deg=110.0)
    axis = Rotation.from_rotvec([0.0, *pose.swing_rad]).apply([1.0, 0.0, 0.0])
    leaned = math.degrees(math.atan2(axis[2], axis[1]))
    assert (math.degrees(math.acos(axis[0])), leaned) == pytest.approx((30.0, 110.0))


@pytest.mark.parametrize("azimuth", [-170.0, -90.0, 0.0, 45.0, 90.0, 179.0])
def test_pitch_and_roll_say_the_same_as_bend_and_azimuth(azimuth: float) -> None:
    pose = Pose(bend_deg=20.0, azimuth_deg=azimuth)
    pitch, roll = np.degrees(pose.swing_rad)
    assert Pose(pitch_deg=pitch, roll_deg=roll).bend_and_azimuth_deg == pytest.approx((20.0, azimuth))


@pytest.mark.parametrize(
    ("given", "found"),
    [
        ({"bend_deg": 20.0}, "found bend_deg, expected bend_deg and azimuth_deg or pitch_deg and roll_deg"),
        ({"bend_deg": 20.0, "azimuth_deg": 0.0, "roll_deg": 3.0}, "found bend_deg and azimuth_deg and roll_deg,"),
        ({"pitch_deg": 80.0, "roll_deg": 80.0}, "bend the head by 113°, expected at most 90°"),
        ({}, "found nothing,"),
    ],
)
def test_a_pose_is_said_one_way_and_whole(given: dict[str, float], found: str) -> None:
    with pytest.raises(ValidationError, match=found):
        Pose(**given)


DRIVES = {
    "tendons without amplitude": ({"drive": "roll"}, 'drive = "roll" needs amplitude_mm'),
    "tendons' amplitude for the lever": ({"amplitude_mm": 1.0}, "amplitude_mm is of the tendons"),
    "lever's amplitude for tendons": (
        {"drive": "pitch", "amplitude_mm": 1.0, "amplitude_deg": 10.0},
        "amplitude_deg is of the lever",
    ),
}


@pytest.mark.parametrize(("changes", "sentence"), DRIVES.values(), ids=DRIVES.keys())
def test_an_amplitude_is_of_what_is_driven(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValidationError, match=sentence):
        plan_of(sweep={"frequency_hz": (2.0,)} | changes)


SWAYING = plan_of(
    pose={"pitch_deg": 3.0, "roll_deg": -4.0},
    sweep={"frequency_hz": (2.0, 4.0), "drive": "pitch", "amplitude_mm": 0.8},
    ring_down={"frequency_hz": (3.0, 3.0), "drive": "roll", "amplitude_mm": 0.5},
    impulse={"about": "torsion", "impulse_n_m_s": 0.02},
)


def test_a_plan_with_pose_drives_and_blows_comes_back_from_its_text() -> None:
    text = dump_plan(SWAYING)
    assert parse_plan(text) == SWAYING
    assert "amplitude_deg" not in text  # of the lever, which does not move


def test_the_text_of_a_straight_plan_has_no_word_of_poses_and_drives() -> None:
    text = dump_plan(load_plan("paper"))
    assert not any(word in text for word in ("pose", "drive =", "_mm_", "impulse"))


def test_the_segments_of_a_plan_say_what_moves_the_head_and_how_far() -> None:
    told = {(g.excitation, g.amplitude_mm, g.impulse_n_m_s) for g in SWAYING.groups() if g.kind != "idle"}
    assert {(name, *(x for x in rest if x == x)) for name, *rest in told} == {
        ("pitch", 0.8),
        ("roll", 0.5),
        ("impulse-torsion", 0.02),
    }


def test_a_pose_may_lean_further_than_the_limit_on_unwanted_tilt() -> None:
    assert RIG.limits.tilt_deg < 20.0
    assert refusals(BENT) == ""


def test_a_pose_beyond_what_the_rig_bends_is_refused() -> None:
    pose = {"bend_deg": 50.0, "azimuth_deg": 0.0}
    assert "asks for a bend of 50° towards 0°, the rig allows 40°; change [pose]" in refusals(plan_of(pose=pose))


def test_a_pose_that_takes_more_cable_than_there_is_is_refused() -> None:
    limits = RIG.limits.model_copy(update={"tendon_travel_mm": (-20.0, 12.0)})
    preview = check_plan(BENT, RIG.model_copy(update={"limits": limits}))
    assert "at 6 mm takes a tendon from -1.9 to 13.9 mm, the rig allows -20 to 12 mm" in preview.refusals[0]


def test_a_swing_that_leans_the_head_too_far_out_of_its_pose_is_refused() -> None:
    sentence = "with 70° of torsion the bent head leans 11.3° out of its pose, the rig allows 10°"
    assert sentence in refusals(BENT, torsion_deg=(30.0, 70.0))


def test_tendons_that_are_told_to_move_faster_than_their_motors_can_are_warned_of() -> None:
    plan = plan_of(sweep={"frequency_hz": (2.0, 4.35), "drive": "roll", "amplitude_mm": 2.0})
    assert "asks for 2 mm of cable at 4.35 Hz, the tendon motors are fast enough for 1." in warnings(
        check_plan(plan, RIG)
    )


@pytest.mark.parametrize(
    "ask", [read_specs, preview_document, lambda *_: refuse_unready(cast(Any, None), cast(Any, None), SWAYING)]
)
def test_dashboard_and_bench_refuse_blows_before_anything_is_asked_of_a_motor(ask: Any) -> None:
    with pytest.raises(SpecError, match=r"blows about .*, the bench has no hammer"):
        ask(dump_plan(SWAYING), dump_rig(RIG))


def test_the_bench_refuses_to_drive_tendons_that_hold_currents() -> None:
    pretension = SWAYING.pretension.model_copy(update={"mode": "current"})
    plan = SWAYING.model_copy(update={"impulse": None, "pretension": pretension})
    with pytest.raises(SpecError, match=r"mode current, the bench drives tendons that hold positions"):
        refuse_unready(cast(Any, None), cast(Any, None), plan)


def test_a_plan_that_tracks_takes_no_pose() -> None:
    track = {"amplitude_deg": (5.0,), "low_hz": 2.0, "high_hz": 5.0, "duration_s": 10.0}
    with pytest.raises(ValidationError, match=r"follows the torsion of an upright head; leave \[pose\]"):
        plan_of(sweep=None, track=track, pose={"bend_deg": 5.0, "azimuth_deg": 0.0})
