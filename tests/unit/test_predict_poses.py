"""Poses of a joint that bends: what they say of slack, limits, chords and buckling, and their commands."""

import json
import sys

import numpy as np
import pytest
from tests.contracts.commands import command_lines, refused

from sinew.apps.cli import main
from sinew.measure.errors import SpecError
from sinew.mechanics.rod import column_load
from sinew.plan.plan import Pose
from sinew.plan.toml import load_plan, load_rig
from sinew.predict.design import Design, design_rig, section_of, shear_modulus_of
from sinew.predict.pose import PoseRequest, find_pose, surface_strain
from sinew.predict.preview import preview_plan
from sinew.predict.section import ellipse_section
from sinew.predict.workspace import VERDICTS, map_workspace
from sinew.twin.parameters import space_from_rig

RIG = load_rig("paper")
ROLL = float(np.degrees(Pose(bend_deg=20, azimuth_deg=0).swing_rad[1]))
"""Of a bend of 20° towards y."""


@pytest.mark.parametrize(("pretension_mm", "bend_deg"), [(0.0, 5.7), (6.0, 29.5)])
def test_the_bend_from_which_on_a_tendon_is_slack_is_told(pretension_mm: float, bend_deg: float) -> None:
    found = find_pose(RIG, PoseRequest(pretension_mm, Pose(bend_deg=2, azimuth_deg=90))).slack
    assert found is not None
    assert found.bend_deg == pytest.approx(bend_deg, rel=0.05)
    assert found.tendon == 4  # across from the azimuth of 90°


def test_currents_buckle_the_upright_joint_at_the_columns_load() -> None:
    found = find_pose(RIG, PoseRequest(12.0, mode="current")).buckling
    assert found is not None
    section, modulus = section_of(RIG), shear_modulus_of(RIG)
    euler = np.pi**2 * 3 * modulus * section.least / RIG.silicone.length.value**2
    weight = 9.81 * RIG.inertia.head_mass.value  # which presses on top, and wants to fall over
    assert found.load_n is not None
    assert column_load(euler, modulus * section.area) == pytest.approx(found.load_n + weight, rel=0.05)


def test_a_pose_that_buckles_is_refused_with_its_reason() -> None:
    found = find_pose(RIG, PoseRequest(22.0, Pose(bend_deg=5, azimuth_deg=0), "current"), outlook=False)
    assert not found.ok
    assert found.rest is None
    assert "does not stay" in found.findings[0].sentence


def test_a_pose_beyond_the_rigs_bend_is_found_and_refused() -> None:
    found = find_pose(RIG, PoseRequest(12.0, Pose(bend_deg=42, azimuth_deg=0)), outlook=False)
    assert found.rest is not None
    assert "bent by 42.0°, the rig allows 40°" in found.findings[0].sentence


def test_chords_of_a_circle_inside_the_silicone_are_told_of() -> None:
    found = find_pose(RIG, PoseRequest(0.0, Pose(bend_deg=20, azimuth_deg=0)), outlook=False)
    assert any("lies inside the silicone" in one.sentence for one in found.findings)
    # hardly pressed, the silicone bends to an arc, whose sagitta is L β/8
    assert np.mean([one.sagitta_mm for one in found.tendons]) == pytest.approx(95 * np.radians(20) / 8, rel=0.2)


def test_a_chord_keeps_clear_of_an_oval_on_its_flat_side_only() -> None:
    oval = design_rig(RIG, Design(section=ellipse_section(0.070, 0.040), name="oval"))
    found = find_pose(oval, PoseRequest(0.0), outlook=False)
    circle = 1e3 * RIG.tendons.head_radius.value
    # 0 mm hardly press it: wide by 70 mm along y, where tendons 1 and 3 are, and 40 mm along z
    expected = [circle - 35, circle - 20, circle - 35, circle - 20]
    np.testing.assert_allclose([one.clearance_mm for one in found.tendons], expected, atol=0.5)
    assert any("reaches to 35.0 mm at tendon 1, 3" in one.sentence for one in found.findings)


def test_the_outline_of_an_oval_is_its_ellipse() -> None:
    oval = design_rig(RIG, Design(section=ellipse_section(0.070, 0.040), name="oval"))
    y, z = oval.outline(np.linspace(0, 2 * np.pi, 50)).T
    np.testing.assert_allclose(np.hypot(y / 0.035, z / 0.020), 1, atol=0.005)  # a hull's edges lie a little inside


def test_an_oval_is_strained_less_where_it_bends_over_its_flat_side() -> None:
    oval = design_rig(RIG, Design(section=ellipse_section(0.070, 0.040), name="oval"))
    q = np.zeros((6, 3))
    strained = []
    for row, reach in ((1, 0.020), (2, 0.035)):  # a bend about y stretches what lies along z
        bent = q.copy()
        bent[row, 0] = 0.2
        strained.append(surface_strain(bent, space_from_rig(oval), oval) / (0.2 * reach / RIG.silicone.length.value))
    assert strained == pytest.approx([1, 1], rel=0.005)


def test_a_joint_that_is_cast_curved_rests_bent_where_nothing_holds_it() -> None:
    curved = load_rig("curved")
    found = find_pose(curved, PoseRequest(mode="current", tension_n=(0.0, 0.0, 0.0, 0.0)), outlook=False)
    assert found.pose is not None
    assert found.pose.azimuth_deg == pytest.approx(90)
    assert 30 < found.pose.bend_deg < 36  # the head's weight, which leans over, bends it further


def test_take_ups_of_motors_that_hold_currents_are_refused() -> None:
    with pytest.raises(SpecError, match="give the tensions"):
        find_pose(RIG, PoseRequest(mode="current", take_up_mm=(6.0, 6.0, 6.0, 6.0)))


def test_tensions_of_a_plan_stand_beside_their_pretensions_where_one_has_no_pose() -> None:
    bent = load_plan("bent")
    pretension = bent.pretension.model_copy(update={"pretension_mm": (0.0, 12.0), "mode": "current"})
    asked = {"pretension": pretension, "pose": Pose(bend_deg=30, azimuth_deg=0)}
    none, some = preview_plan(bent.model_copy(update=asked), RIG).tension_n
    assert np.isnan(none)
    assert some > 50


@command_lines("""
    pose paper --bend-deg 95 => --bend-deg is 95, expected 0 to 90
    pose paper --take-up-mm 1,2,3 => found 3 take-ups, expected one for each of 4 tendons
    pose paper --take-up-mm 6,6,6,6 --bend-deg 20 => beside what the tendons do
    pose paper --take-up-mm 6,6,6,6 --pretension-mm 6 => give one of them
    pose paper --mode current --tension-n 1e9,1e9,1e9,1e9 => expected 0 to 10000 N
    pose paper --tension-n 50,40,30,40 => give take-ups, or the mode current
    pose paper --mode current --tension-n 50,40,30,-4 => cables cannot push
    pose paper --out pose.txt => expected a name that ends with .png, .pdf or .svg
    pose paper --map --step-deg 0 => --step-deg is 0
    pose paper --map --pretension-mm -1 => cables cannot push
    report paper --rig paper => --rig is for a recording, and paper is a rig
""")
def test_a_pose_that_cannot_be_meant_is_refused(
    arguments: tuple[str, ...], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sentence in refused(capsys, *arguments)


@pytest.mark.slow
def test_a_coarse_workspace_of_the_papers_joint_is_alike_on_all_sides(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["pose", "paper", "--map", "--pretension-mm", "6", "--step-deg", "10", "--json"]) == 0
    verdict = json.loads(capsys.readouterr().out)["maps"][0]["verdict"]
    assert verdict == [row[::-1] for row in verdict] == verdict[::-1]
    assert verdict[4][4] == 0


@pytest.mark.slow
def test_a_cell_of_the_workspace_is_refused_by_just_the_limit_that_its_pose_breaks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The pose of the cell is found by itself; each limit is set just beyond what it needs, and just short of that."""
    posed = find_pose(RIG, PoseRequest(6.0, Pose(bend_deg=20, azimuth_deg=0)), outlook=False)
    assert posed.rest is not None
    assert posed.margins is not None
    pull, take_up = posed.rest.at.tension.max(), 1e3 * posed.rest.take_up

    def verdict(pretension_mm: float = 6.0, **limits: object) -> str:
        rig = RIG.model_copy(update={"limits": RIG.limits.model_copy(update=limits)})
        found = map_workspace(rig, [pretension_mm], step_deg=20.0)
        (cell,) = np.argwhere((found.pitch_deg[:, None] ** 2 + (found.roll_deg - ROLL) ** 2) < 1e-9)
        i, j = cell
        verdict = found.maps[0].verdict[i][j]
        assert verdict is not None
        return VERDICTS[verdict]

    assert verdict() == "reached"
    for more, said in ((1e-2, "reached"), (-1e-2, "over tension")):
        assert verdict(tension_n=pull + more) == said
    for more, said in ((1e-3, "reached"), (-1e-3, "over travel")):
        assert verdict(tendon_travel_mm=(take_up.min() - 1, take_up.max() + more)) == said
        assert verdict(tendon_travel_mm=(take_up.min() - more, take_up.max() + 1)) == said
    for more, said in ((1e-5, "reached"), (-1e-5, "over strain")):
        monkeypatch.setattr(sys.modules[map_workspace.__module__], "STRAIN", posed.margins.strain + more)
        assert verdict() == said
    monkeypatch.undo()
    assert verdict(0.0) == "slack"  # from 5.7° on
