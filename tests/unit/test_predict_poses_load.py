"""What a joint resists and carries, against a minimiser of an energy that was written apart, and its intervals."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize
from tests.experiments.rests import PlainJoint

from sinew.measure.arrays import Array
from sinew.measure.estimate import Estimate
from sinew.paper.answer import Cell
from sinew.paper.bent import answer_asymmetry, answer_carrying
from sinew.plan.plan import Pose
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.predict.pose import PoseRequest, find_pose
from sinew.predict.workspace import PAYLOAD_HEIGHT, at_least_zero, carried_mass, tilt_stiffness, with_bounds

RIG = load_rig("paper")
MM = 12.0
MOMENT = 0.02
WIDE = (("space.head_height", 1.0), ("space.density", 3.0))


def pushed(joint: PlainJoint, start: Array, moment: float, ends: Array | None, tension: Array | None) -> Array:
    """Return where the joint rests under a moment about z, which turns its axis towards y."""
    scale = joint.scale()

    def energy(y: Array) -> float:
        x = scale * y
        held = tension @ joint.spans(x) if tension is not None else 0.0
        if ends is not None:
            held = 0.5 * joint.stiffness * np.sum(np.maximum(joint.spans(x) - ends, 0.0) ** 2)
        return joint.body(x) + float(held) - moment * float(joint.shape(x)[2][1, 0])

    y = start / scale
    for _ in range(2):
        y = minimize(energy, y, jac="3-point", method="BFGS", options={"gtol": 1e-8}).x
    return np.asarray(scale * y)


@pytest.mark.slow
def test_stiffness_in_tilt_and_the_moment_at_which_a_tendon_is_slack_are_those_of_a_minimiser() -> None:
    posed = find_pose(RIG, PoseRequest(MM), outlook=False)
    assert posed.rest is not None
    joint, told = PlainJoint(RIG), tilt_stiffness(RIG, MM)
    ends, tension = np.asarray(posed.space.cable_end), np.asarray(posed.rest.at.tension)
    start = posed.rest.q.ravel()
    stiff, soft = (pushed(joint, start, MOMENT, *held) for held in ((ends, None), (None, tension)))
    assert MOMENT / joint.shape(stiff)[2][1, 0] == pytest.approx(told.by_position, rel=1e-3)
    assert MOMENT / joint.shape(soft)[2][1, 0] == pytest.approx(told.by_current, rel=2e-2)  # a tilt of 0.4°
    lost = tension - joint.stiffness * np.maximum(joint.spans(stiff) - ends, 0.0)
    assert MOMENT * np.min(tension[lost > 0] / lost[lost > 0]) == pytest.approx(told.slack_moment, rel=2e-3)


@pytest.mark.slow
def test_with_the_largest_mass_a_tendon_pulls_no_more_where_a_minimiser_holds_the_tilt() -> None:
    most = carried_mass(RIG, MM, 20.0)
    joint = PlainJoint(RIG)
    joint.mass += most.mass
    joint.above += most.mass * PAYLOAD_HEIGHT
    ends = np.asarray(find_pose(RIG, PoseRequest(MM), outlook=False).space.cable_end)
    near = find_pose(RIG, PoseRequest(MM, Pose(bend_deg=20, azimuth_deg=0)), outlook=False).coordinates
    assert near is not None
    leans, pulls = [], []
    for across in (-0.0064, -0.0067):  # both before it is slack, where the slope is another
        held = ends + across * np.array([1.0, 0.0, -1.0, 0.0])
        x = pushed(joint, near.ravel(), 0.0, held, None)
        axis = joint.shape(x)[2][:, 0]
        leans.append(math.degrees(math.atan2(axis[1], axis[0])))
        pulls.append(joint.stiffness * np.min(joint.spans(x) - held))
    _, pull = np.polyfit(np.array(leans) - 20.0, pulls, 1)
    assert most.ends == "a tendon goes slack"
    assert pull == pytest.approx(0.0, abs=0.2)


def test_bounds_of_assumed_numbers_add_by_squares_and_those_of_others_do_not_count() -> None:
    table = dict(RIG.parameters())

    def numbers(rig: RigSpec) -> Array:
        now = dict(rig.parameters())
        return np.array(
            [now["space.head_height"].value + 3 * now["space.density"].value, now["tendons.free_span"].value]
        )

    both, none = with_bounds(RIG, numbers)
    wide = [share * (table[name].bounds[1] - table[name].bounds[0]) for name, share in WIDE]
    assert both.std == pytest.approx(np.hypot(*wide) / math.sqrt(12))
    assert both.value == table["space.head_height"].value + 3 * table["space.density"].value
    assert none.std == 0


@pytest.mark.slow
def test_tensions_are_alike_upright_and_those_of_the_pose_where_it_bends() -> None:
    answer = answer_asymmetry(RIG, (0.0, MM))
    rows = {(row["pretension_mm"], row["bend_deg"]): row for row in answer.rows}
    upright, bent = (rows[MM, bend] for bend in (0.0, 30.0))
    posed = find_pose(RIG, PoseRequest(MM, Pose(bend_deg=30, azimuth_deg=0)), outlook=False)
    assert posed.rest is not None
    assert value(upright["highest_n"]) == pytest.approx(value(upright["lowest_n"]), rel=1e-6)
    assert value(bent["highest_n"]) == pytest.approx(posed.rest.at.tension.max(), rel=1e-4)
    assert value(bent["lowest_n"]) == pytest.approx(posed.rest.at.tension.min(), rel=1e-4)
    # The first tendon goes slack at 5.7° at 0 mm and beyond 50° at 12 mm.
    assert [value(rows[0.0, bend]["lowest_n"]) > 0 for bend in (0.0, 10.0, 20.0)] == [True, False, False]


@pytest.mark.slow
def test_a_joint_whose_tendon_is_slack_carries_nothing() -> None:
    answer = answer_carrying(RIG, (0.0, MM))
    loose, taut = answer.rows
    assert value(loose["bent_kg"]) == 0 < value(taut["bent_kg"])
    assert value(taut["tilt_stiffness_by_current_n_m_rad"]) < value(taut["tilt_stiffness_n_m_rad"])


@pytest.mark.parametrize(
    ("pull", "tension"),
    [
        (Estimate.normal(30.0, 1.0), Estimate.normal(30.0, 1.0)),
        (Estimate(-10.0, 2.0, -13.0, -7.0), Estimate(0.0, 0.0, 0.0, 0.0)),
        (Estimate(1.0, 2.0, -2.0, 4.0), Estimate(1.0, 4 / 3.29, 0.0, 4.0)),
    ],
    ids=["taut", "slack", "nearly slack"],
)
def test_a_tension_is_what_is_left_of_a_pull_that_may_be_negative(pull: Estimate, tension: Estimate) -> None:
    found = at_least_zero(pull)
    assert (found.value, found.low, found.high) == pytest.approx((tension.value, tension.low, tension.high))
    assert math.isclose(found.std, tension.std, rel_tol=1e-3, abs_tol=1e-12)


def value(cell: Cell) -> float:
    assert isinstance(cell, Estimate)
    assert cell.low <= cell.value <= cell.high
    return cell.value
