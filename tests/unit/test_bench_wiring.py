"""A rig that is wired otherwise than its file says is named before it pulls or swings."""

import math
from typing import Any

import pytest
from campaigns.wrong_rigs import PRETENSION_MM, WRONG, faults_of, play

from sinew.bench.pretension import _board_advice, _refuse_astray
from sinew.measure.errors import LostError
from sinew.plan.toml import load_rig

SPEC = load_rig("paper")

TENSION_N = 31.47  # of each tendon at 4 mm, as the twin has it


@pytest.mark.slow
@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_rig_is_named_before_the_lever_moves_and_pulls_no_more_than_the_twin(name: str) -> None:
    assert PRETENSION_MM == 4.0
    assert faults_of(name, play(SPEC, WRONG[name][0], "position", 0, TENSION_N), TENSION_N) == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_right_rig_is_not_accused(seed: int) -> None:
    wiring: dict[str, Any] = {}
    assert "groups are recorded" in play(SPEC, wiring, "current" if seed else "position", seed, TENSION_N).sentence


@pytest.mark.parametrize(
    ("axes", "turned_deg"),
    [(("+x", "+z", "-y"), -90.0), (("+x", "-y", "-z"), 180.0), (("+x", "-z", "+y"), 90.0)],
)
def test_the_advice_for_a_turned_board_is_the_frame_that_it_has(axes: tuple[str, ...], turned_deg: float) -> None:
    # The rig says axes, the chip lies along its own: what y and z of the head are is told turned by that angle.
    assert "['+x', '+y', '+z']" in _board_advice(math.radians(turned_deg), axes)


def test_a_tilt_that_does_not_fall_ends_levelling() -> None:
    tilt = math.radians(1.0)
    with pytest.raises(LostError, match=r"does not fall: 1.00° after 3.2 s of levelling, 1.20° before"):
        _refuse_astray(tilt, 1.2 * tilt, 0.0, 3.2, math.radians(0.2))


def test_a_correction_beyond_what_the_tilt_can_ask_for_ends_levelling() -> None:
    tilt = math.radians(1.0)
    with pytest.raises(LostError, match=r"though its tendons were corrected by 2.60°"):
        _refuse_astray(0.5 * tilt, tilt, 2.6 * tilt, 1.0, math.radians(0.2))
