"""The joint in space behind its motors, against the twin's own motion."""

import math
from typing import NamedTuple

import jax
import numpy as np
import pytest

from sinew.emulator.joint import TICK_S
from sinew.emulator.plant import JointPlant, Law
from sinew.measure.errors import SpecError
from sinew.plan.toml import load_rig
from sinew.predict.design import Design, design_rig
from sinew.solve.march import Swing, swing
from sinew.solve.programs import configure
from sinew.solve.spatial import Rest, bend, linear_equations, slow_down
from sinew.twin.parameters import space_from_rig

configure()
RIG = load_rig("paper")
RADIUS = RIG.tendons.pulley_radius.value
GAIN = 900 / 128 / 885 * 4096 / math.tau
DRIVE_GAIN = RIG.drive.position_gain.value
HERTZ = 4.0


class Beside(NamedTuple):
    """plant: held at the twin's take-ups. pose: of the twin. at_rest: tensions of the plant [N]. seen: torsion, tilt
    (2), gyro (3), force at the chip (3) and lever of the plant every 5 ms, the lever swinging. twin: its swing."""

    plant: JointPlant
    pose: Rest
    at_rest: tuple[float, ...]
    tilt: tuple[float, float]
    seen: np.ndarray
    twin: Swing


@pytest.fixture(scope="module")
def beside() -> Beside:
    contact = RIG.tendons.first_contact_tension.value
    there, pose = bend(space_from_rig(RIG), contact, 6e-3, np.array([-math.radians(20), 0.0]))
    plant = JointPlant(RIG, slack_m=[0.0] * 4, in_space=True)
    for tendon, end in enumerate(np.asarray(there.cable_end)):
        plant.set_law(tendon, Law("position", (RIG.tendons.free_span.value - end) / RADIUS, GAIN))
    plant.set_law(4, Law("position", 0.0, DRIVE_GAIN))
    plant.advance(6.0)
    at_rest, tilt = plant.tension, plant.motion().tilt
    seen = []
    for tick in range(600):
        goal = math.radians(20) * math.sin(math.tau * HERTZ * (tick + 0.5) * TICK_S)
        plant.set_law(4, Law("position", goal, DRIVE_GAIN))
        plant.advance(6.0 + (tick + 1) * TICK_S)
        if tick % 4 == 3:
            now = plant.motion()
            seen.append([now.torsion, *now.tilt, *now.gyro, *now.acceleration, now.drive.angle])
    slowed = slow_down(linear_equations(pose.q, there), there)
    driven = slowed.rod.joint._replace(amplitude=np.float64(math.radians(20)), omega=np.float64(math.tau * HERTZ))
    lane = jax.tree.map(lambda x: np.asarray(x)[None], slowed._replace(rod=slowed.rod._replace(joint=driven)))
    return Beside(plant, pose, at_rest, tilt, np.array(seen).T, swing(lane, pose.q[None], [151], 5e-3)[0])


pytestmark = pytest.mark.slow


def test_motors_at_the_twins_take_ups_hold_its_pose(beside: Beside) -> None:
    assert np.degrees(beside.tilt) == pytest.approx([-20.0, 0.0], abs=1e-3)
    assert beside.at_rest == pytest.approx(beside.pose.at.tension.tolist(), rel=1e-3)
    assert beside.plant.pretension == pytest.approx(6e-3, abs=1e-8)


def test_the_bent_joint_swings_as_the_twin_does(beside: Beside) -> None:
    swing_, turned = beside.twin, beside.twin.rotations[1:]
    torsion = np.arctan2(turned[:, 2, 1] - turned[:, 1, 2], turned[:, 1, 1] + turned[:, 2, 2])
    sideways = np.hypot(turned[:, 1, 0], turned[:, 2, 0])
    tilt = np.array([-turned[:, 2, 0], turned[:, 1, 0]]) * np.arctan2(sideways, turned[:, 0, 0]) / sideways
    truth = np.array([torsion, *tilt, *swing_.gyro[:, 1:], swing_.lever[1:]])
    seen = beside.seen[[0, 1, 2, 3, 4, 5, 9]]
    assert (np.abs(seen - truth).max(axis=1) / (0.5 * np.ptp(truth, axis=1)) < 2e-3).all()


def test_the_accelerometer_of_a_bent_head_feels_what_its_chip_does(beside: Beside) -> None:
    swing_, chip = beside.twin, np.array([0.0, RIG.imu.mount_radius.value, 0.0])
    turned, spin = swing_.rotations[1:], swing_.spin[:, 1:].T
    up = swing_.acceleration[:, 1:].T + np.array([9.80665, 0.0, 0.0])
    force = np.einsum("nij,ni->nj", turned, up) + np.cross(swing_.spin_rate[:, 1:].T, chip)
    force += np.cross(spin, np.cross(spin, chip))
    # At the end of a tick the lever's goal stands where the twin's was half a tick ago, which changes the drive's
    # torque by τ unless its duty is at its limit. With head I_h, lever I_l and rotor J about one axis,
    # (I_h + I_l) φ¨ + I_l θ¨ = 0 and I_l φ¨ + (I_l + J) θ¨ = τ: the head turns by
    # φ¨ = -I_l τ/(I_h I_l + J (I_h + I_l)), which the chip feels along z.
    drive, phase = RIG.drive, math.tau * HERTZ * 5e-3 * np.arange(1, 151)
    goals = math.radians(20) * np.sin(phase - np.array([[0.5 * math.tau * HERTZ * TICK_S], [0.0]]))
    standing, going = np.clip(DRIVE_GAIN * (goals - swing_.lever[1:]), -1.0, 1.0)
    head, lever, rotor = RIG.inertia.head.value, RIG.inertia.lever.value, drive.armature.value
    torque = drive.duty_torque * (standing - going)
    turning = -lever * torque / (head * lever + rotor * (head + lever))
    force[:, 2] += chip[1] * turning
    # Where the lever turns round, its gears' friction does so within a step: in each march in a step of its own.
    goes = np.abs(np.gradient(swing_.lever, 5e-3)[1:]) > 0.5
    assert np.mean(goes) > 0.9
    assert np.abs(beside.seen[6:9].T - force)[goes].max() < 0.1 * chip[1] * np.abs(turning).max()


def test_a_rig_that_tells_no_masses_is_refused_in_space() -> None:
    with pytest.raises(SpecError, match=r"has no \[space\], expected the masses"):
        JointPlant(RIG.model_copy(update={"space": None}), slack_m=[0.0] * 4, in_space=True)


def test_a_bench_in_space_refuses_a_head_that_falls_over_before_a_tendon_holds_it() -> None:
    heavy = design_rig(RIG, Design(head_mass=6.33, head_height=0.25))
    with pytest.raises(SpecError, match=r"its head of 6\.33 kg falls over on the silicone"):
        JointPlant(heavy, slack_m=[0.0] * 4, in_space=True)
