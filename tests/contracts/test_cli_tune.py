"""The commands `sinew tune` and `sinew design`: documents, files, and the lines for wrong input."""

import json
from pathlib import Path

import pytest
from tests.contracts.commands import answered, command_lines, refused

from sinew.plan.toml import load_plan, load_rig

GAIT = ("--stride-hz", "0.7:1.1", "--yaw-deg", "7")


@pytest.mark.slow
def test_a_setting_is_told_as_json_and_the_rig_without_calibration_says_so(
    capsys: pytest.CaptureFixture[str],
) -> None:
    document = answered(capsys, "tune", "paper", "--resonance-hz", "3.5,9")
    near, far = document["settings"]
    assert (document["command_deg"], document["yaw_deg"], document["draws"]) == (20.0, None, None)
    assert near["feasible"]
    assert near["frequency_hz"]["value"] == pytest.approx(3.5, rel=1e-4)
    assert near["pretension_mm"]["interval90"] == [None, None]
    assert (far["feasible"], set(far)) == (False, {"wanted_hz", "feasible", "sentence"})
    assert document["range"]["frequency_hz"][0] < 3.5 < document["range"]["frequency_hz"][1]
    assert "holds no intervals" in document["remarks"][0]


@pytest.mark.slow
@pytest.mark.long
def test_a_design_leaves_a_rig_a_plan_and_a_page_that_go_on_from_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "torso"
    words = ["--shape", "circle", "--material", "base", "--starts", "8", "--exact", "2", "--proposals", "1"]
    document = answered(capsys, "design", *GAIT, *words, "--seed", "1000", "--out", str(out))
    (one,) = document["proposals"]
    assert one["is_confirmed"]
    assert all(check["holds"] for check in one["validity"])
    assert [end["frequency_hz"] for end in one["ends"]] == pytest.approx([0.7, 1.1], rel=1e-3)
    assert [end["torsion_deg"] for end in one["ends"]] == pytest.approx([7.0, 7.0], rel=5e-3)
    rig, plan = load_rig(one["rig"]), load_plan(one["plan"])
    assert rig.inertia.head.value == 0.25
    assert plan.pretension.pretension_mm == pytest.approx([end["pretension_mm"] for end in one["ends"]], abs=1e-3)
    assert json.loads((out / "design.json").read_text(encoding="utf-8")) == document
    assert "proposal" in (out / "design.html").read_text(encoding="utf-8")
    assert (out / "figures" / "design_front.png").stat().st_size > 10_000
    assert (out / "figures" / "design_curves.png").stat().st_size > 10_000
    checked = answered(capsys, "check", one["plan"], "--rig", one["rig"])
    assert [row for row in checked["findings"] if row["severity"] == "refuse"] == []


@command_lines("""
    tune paper --resonance-hz 3 --amplitude-deg 9 --yaw-deg 7 => one of
    tune paper --resonance-hz fast => --resonance-hz is 'fast'
    tune paper --resonance-hz 3 --bands 1 => found 1 draw
    tune paper --resonance-hz 3 --bands 9 => holds no intervals
    design --yaw-deg 7 => --stride-hz LOW:HIGH with --yaw-deg
    design --stride-hz 0.7 --yaw-deg 7 => --stride-hz is '0.7'
    design --stride-hz 0.7:1.1 --yaw-deg 7 --torso-centre-mm 200 => belongs to --torso-kg
    design --stride-hz 0.7:1.1 --yaw-deg 7 --envelope-mm big => --envelope-mm is 'big'
    design --stride-hz 0.7:1.1 --yaw-deg 7 --shape star => the section 'star'
    design --stride-hz 0.7:1.1 --yaw-deg 7 --material dragon-skin-31 => did you mean dragon-skin-30
    design --walk nowhere.csv => cannot read nowhere.csv
""")
def test_a_wrong_command_line_is_one_line_and_status_2(
    arguments: tuple[str, ...], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sentence in refused(capsys, *arguments)
