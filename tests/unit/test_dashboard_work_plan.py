"""What is said of a plan before it runs: its preview and its predicted curves."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from sinew.apps.cli import app
from sinew.apps.dashboard.work.design import (
    plan_outline,
    prediction_for_plan,
    preview_document,
)
from sinew.plan.toml import dump_rig, load_rig, parse_plan, read_spec

pytestmark = pytest.mark.slow

RIG = read_spec("rigs", "paper")
PLAN = """
name = "two"
[pretension]
pretension_mm = [2, 8]
[sweep]
frequency_hz = [3, 3.4]
amplitude_deg = 15
"""


def certain_to(share: float) -> str:
    """The paper's rig, as if its rigidity were known within a share."""
    rig = load_rig("paper")
    row = rig.silicone.torsional_rigidity
    known = row.model_copy(update={"interval90": (row.value * (1 - share), row.value * (1 + share))})
    return dump_rig(rig.model_copy(update={"silicone": rig.silicone.model_copy(update={"torsional_rigidity": known})}))


def test_a_preview_is_what_sinew_check_says(tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    path.write_text(PLAN, encoding="utf-8")
    told = json.loads(CliRunner().invoke(app, ["check", str(path), "--json"]).stdout)
    found = preview_document(PLAN, RIG)
    assert {key: found[key] for key in told} == told


def test_the_outline_of_a_plan_is_its_stages_and_of_what_is_none_its_faults() -> None:
    assert [stage["kind"] for stage in plan_outline(PLAN)["stages"]][:3] == ["pull", "change", "rest"]
    outline = plan_outline(PLAN.replace("[3, 3.4]", "[3.4, 3]"))
    assert [fault["line"] for fault in outline["faults"]] == [6]
    assert "stages" not in outline


def test_a_prediction_has_a_curve_for_each_pretension_in_the_plans_order() -> None:
    found = prediction_for_plan(PLAN.replace("[2, 8]", "[8, 2]"), RIG)
    assert [curve["pretension_mm"] for curve in found["curves"]] == [8, 2]


def test_a_rig_that_does_not_know_how_certain_it_is_has_no_bands() -> None:
    found = prediction_for_plan(PLAN, RIG, 10)
    assert not found["can_have_bands"]
    assert "gain_low" not in found["curves"][0]


@pytest.mark.slow
def test_a_band_widens_with_what_is_not_known() -> None:
    def width(share: float) -> float:
        (curve,) = prediction_for_plan(PLAN.replace("[2, 8]", "[4]"), certain_to(share), 8)["curves"]
        return max(high - low for low, high in zip(curve["gain_low"], curve["gain_high"], strict=True))

    assert width(0.02) > 2 * width(0.005)


@pytest.mark.parametrize("name", ["first", "short"])
def test_shipped_plans_are_predicted_as_plain_json(name: str) -> None:
    found = prediction_for_plan(read_spec("plans", name), RIG)
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert len(found["curves"]) == len(parse_plan(read_spec("plans", name)).pretension.pretension_mm)
