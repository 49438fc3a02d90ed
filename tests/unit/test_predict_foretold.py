"""What a bent plan is foretold: the head's tilt beside its torsion, and what slow tendons do."""

import math

import pytest

from sinew.plan.plan import Plan
from sinew.plan.toml import load_plan, load_rig
from sinew.predict.expected_response import expected_of, preview_plan, sentences_of

RIG = load_rig("paper")


def asked(name: str, *frequency_hz: float) -> Plan:
    plan = load_plan(name)
    assert plan.sweep is not None
    return plan.model_copy(update={"sweep": plan.sweep.model_copy(update={"frequency_hz": frequency_hz})})


def test_a_driven_lever_twists_a_bent_head_and_tilts_it_across_as_the_simulated_joint_does() -> None:
    plan = asked("bent", 3.0, 4.4)
    rows = expected_of(plan, RIG, preview_plan(plan, RIG))
    assert [(row.pretension_mm, row.frequency_hz) for row in rows] == [(6, 3.0), (6, 4.4), (12, 3.0), (12, 4.4)]
    # Of a simulated sweep of the nonlinear joint at 6 mm (docs/explanation/space.md); half the sine of 20° is 0.171.
    ratios = [row.across_deg / row.torsion_deg for row in rows[:2]]
    assert ratios == pytest.approx([0.161, 0.178], rel=0.02)
    assert all(row.in_plane_deg == 0 for row in rows)


def test_slow_tendons_tilt_the_head_by_the_cable_over_their_circle() -> None:
    plan = asked("engine", 0.1)
    (row,) = expected_of(plan, RIG, preview_plan(plan, RIG))
    circle_mm = 1e3 * RIG.tendons.head_radius.value
    turned = 0.9 / circle_mm / math.radians(30)  # of the plane of the bend, in which the axis leans by 30°
    assert row.across_deg == pytest.approx(math.degrees(math.sin(math.radians(30)) * turned), rel=0.06)
    assert row.torsion_deg < 0.01
    assert "of torsion, at 0.1 Hz" in sentences_of((row,), plan)[0]


def test_the_lever_reaches_what_a_head_that_swings_leaves_it() -> None:
    plan = asked("bent", 3.6)
    row, _ = expected_of(plan, RIG, preview_plan(plan, RIG))
    # Of the nonlinear joint's harmonic balance, which follows its simulation (docs/explanation/space.md).
    assert row.torsion_deg == pytest.approx(37.3, rel=0.03)
    held_deg = preview_plan(plan, RIG).drive_amplitude_deg[0]
    assert row.drive < 0.7 * held_deg
