"""What a plan will bring about, kept: the same numbers from the disk, and limits that are looked at each time."""

from pathlib import Path

import pytest

from sinew.plan.plan import Plan, Pretension, Sweep
from sinew.plan.toml import load_rig
from sinew.predict import foreseen, preview

RIG = load_rig("paper")
PLAN = Plan(name="two", pretension=Pretension(pretension_mm=(2.0, 4.0)), sweep=Sweep(frequency_hz=(2.0, 3.0)))


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SINEW_CACHE", str(tmp_path))


@pytest.mark.slow
def test_what_was_foreseen_comes_back_number_for_number() -> None:
    found, expected = foreseen.foresee_plan(PLAN, RIG)
    assert (found, expected) == preview.foresee_plan(PLAN, RIG)
    assert expected
    assert foreseen.foresee_plan(PLAN, RIG) == (found, expected)
    assert preview.preview_plan(PLAN, RIG, swing=True) == found


def test_what_was_kept_is_held_against_the_limits_anew() -> None:
    foreseen.keep_foreseen(PLAN, RIG, [20.0, 900.0], [10.0, 12.0], "told")
    found, expected = foreseen.foresee_plan(PLAN, RIG)
    assert "each tendon pulls 900 N" in found.refusals[0]
    assert (found.torsion_deg, expected) == ((10.0, 12.0), "told")


@pytest.mark.slow
def test_another_plan_is_foreseen_by_itself() -> None:
    foreseen.keep_foreseen(PLAN, RIG, [20.0, 900.0], [10.0, 12.0], "told")
    found, expected = foreseen.foresee_plan(PLAN.model_copy(update={"name": "other"}), RIG)
    assert max(found.tension_n) < 100
    assert expected != "told"
