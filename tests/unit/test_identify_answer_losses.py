"""What D consists of: asked of ring-downs of the twin, whose shares can be switched off one by one."""

import math

import numpy as np
import pytest
from tests.unit.identify_campaigns import DECAYS, RIG

from sinew.analysis.analysed import analyse_recording
from sinew.identify.joint.fit import JointFit
from sinew.identify.oscillator.least_squares import Covariance
from sinew.measure.estimate import Estimate
from sinew.paper.answer import CANNOT_TELL, Answer
from sinew.paper.losses import answer_losses, energy_shares
from sinew.plan.plan import Group
from sinew.plan.rig import RigSpec
from sinew.twin.parameters import Effects
from sinew.twin.simulate import lane_parameters, simulate

pytestmark = pytest.mark.slow


def known_joint(rig: RigSpec) -> JointFit:
    """Return a fit that knows a rig's loss factor and friction to a hundredth."""
    values = {"silicone.loss_factor": rig.silicone.loss_factor.value}
    values["tendons.guide_friction"] = rig.tendons.guide_friction.value
    parameters = {name: Estimate.normal(value, 0.01 * value) for name, value in values.items()}
    matrix = np.diag([one.std**2 for one in parameters.values()])
    covariance = Covariance(matrix, 1e3)
    return JointFit(rig, rig, parameters, {}, (0.0, 12.0), 1, (1e-4, 0.03), covariance, (), {}, True, "", ())


@pytest.fixture(scope="module")
def losses() -> Answer:
    recording = simulate(DECAYS, RIG, seed=31)
    return answer_losses(analyse_recording(recording, RIG), recording, known_joint(RIG))


def test_the_fitted_joints_damping_is_the_measured_one(losses: Answer) -> None:
    measured, model = (losses.column(name)[0] for name in ("lehr_damping", "lehr_damping_model"))
    assert model == pytest.approx(measured, rel=0.05)


def test_the_sensors_delay_has_hardly_a_share_in_the_damping(losses: Answer) -> None:
    """A filter shifts a decaying exponential and scales it; only what is not exponential in the decay is read later."""
    assert abs(losses.numbers["sensor_share"].value) < 0.03


def test_silicone_guides_and_servo_take_all_of_the_energy() -> None:
    """The energy of the swing is computed on its own; a tension that changes under bent bristles works a little too."""
    groups = [group for group in DECAYS.groups() if group.kind == "ring-down"]
    whole = energy_shares(lane_parameters(groups, RIG), groups).sum(axis=1)
    smooth = energy_shares(lane_parameters(groups, RIG, effects=Effects().without("guide_friction")), groups)
    assert whole == pytest.approx(np.ones(4), abs=0.04)
    assert smooth.sum(axis=1) == pytest.approx(np.ones(4), abs=1e-5)
    assert smooth[:, 1] == pytest.approx(np.zeros(4), abs=1e-12)


def test_shares_hardly_depend_on_when_the_drive_was_stopped() -> None:
    """Energy that bristles and position loop store at the start is counted as stored, not as lost."""
    groups = [Group("ring-down", 12.0, f, 20.0, 0, math.ceil(3 * f) / f, 3.0) for f in (4.0, 4.15, 4.3, 4.45)]
    shares = energy_shares(lane_parameters(groups, RIG), groups)
    assert np.ptp(shares, axis=0).max() < 0.03


def test_friction_that_doubles_takes_about_twice_as_much_beside_the_silicone() -> None:
    """Dahl friction far below breaking loose: loss and level are in proportion, and the motion hardly changes."""
    groups = [Group("ring-down", 0.0, 3.0, 20.0, 0, 3.0, 3.0)]
    ratios = []
    for level in (1e-4, 2e-4):
        lanes = lane_parameters(groups, RIG.with_values({"tendons.guide_friction": level}))
        silicone, guides, _ = energy_shares(lanes, groups)[0]
        ratios.append(guides / silicone)
    assert ratios[1] / ratios[0] == pytest.approx(2.0, rel=0.03)


def test_the_recoils_share_carries_what_the_rig_leaves_open_of_the_drive(losses: Answer) -> None:
    """A joint known to a hundredth would have it to a few thousandths; friction and armature are not known at all."""
    found = losses.numbers["recoil_share"]
    half = 0.5 * (found.high - found.low)
    groups = [group for group in DECAYS.groups() if group.kind == "ring-down"]
    reached = []
    for name in ("friction", "armature"):
        low, high = getattr(RIG.drive, name).bounds
        ends = [RIG.with_values({f"drive.{name}": value}) for value in (low, high)]
        shares = [energy_shares(lane_parameters(groups, rig), groups) for rig in ends]
        reached += [float((one / one.sum(axis=1, keepdims=True))[:, 2].mean()) for one in shares]
    assert half > 0.15 * (max(reached) - min(reached))
    assert found.low < found.value < found.high


def test_without_a_joint_only_the_methods_own_share_is_told() -> None:
    recording = simulate(DECAYS, RIG, seed=33)
    answer = answer_losses(analyse_recording(recording, RIG), recording, None, "No rig is known.")
    assert answer.verdict == CANNOT_TELL
    assert list(answer.numbers) == ["method_share"]
    assert "No rig is known." in answer.sentences[0]


def test_an_answer_leaves_as_plain_json(losses: Answer) -> None:
    document = losses.to_json()
    assert document["verdict"] == losses.verdict
    assert set(document["numbers"]["silicone_share"]) == {"value", "std", "interval90"}
    assert document["rows"][0]["pretension_mm"] == 0.0
