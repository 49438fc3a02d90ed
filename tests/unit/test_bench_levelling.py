"""Levelling a head with mass: the margins of the law against the joint in space, and the emulated bench upright."""

import pytest
from campaigns.levelling import margin_of, run_trial

from sinew.plan.plan import TendonMode
from sinew.plan.toml import load_rig
from sinew.predict.modes import Asked, Finder

RIG = load_rig("paper")


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["position", "current"])
def test_no_sway_of_the_paper_s_joint_is_fed_by_levelling(mode: TendonMode) -> None:
    finder = Finder(RIG, Asked((0.0, 12.0), (0.0,), mode=mode))
    for pretension_mm in (0.0, 12.0):
        margin = margin_of(finder, RIG, pretension_mm, 0.0)
        assert margin.beyond < 1 / 4
        assert margin.phase_deg > 45


@pytest.mark.slow
def test_a_heavy_head_is_levelled_upright_without_being_made_to_sway() -> None:
    trial = run_trial(RIG, "position", 6.0, 0.0, seed=0)
    assert trial.left_deg < 0.1
    assert trial.tension_n < 60.0  # 43.7 at rest; a loop that feeds the sway meets the limit of 200
    assert "groups are recorded" in trial.ended
