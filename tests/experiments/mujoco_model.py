"""Where the exported joint rests in MuJoCo, straight and bent, beside the twin.

The model is written from the mechanics alone. Its motors take up cable, and the head goes where it rests.
"""

import math
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from sinew.measure.arrays import Array
from sinew.mechanics.space import twist_and_tilt
from sinew.plan.plan import STRAIGHT, Pose, bend_of_swing
from sinew.plan.rig import RigSpec
from sinew.predict import modes
from sinew.predict.multibody import PIECES, Bodies, joint_bodies, write_mjcf
from sinew.predict.pose import PoseRequest, find_pose

REST_S, SETTLING_S = 1.5, 0.03


def loaded(bodies: Bodies) -> tuple[Any, Any]:
    """Return MuJoCo's (model, data) of a joint, at its rest."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(write_mjcf(bodies, []))
    return model, mujoco.MjData(model)


class Rested(NamedTuple):
    """Where a head rests: bend and its azimuth [deg], place of the plate in B (3,) [mm], tensions (tendon,) [N]."""

    bend_deg: float
    azimuth_deg: float
    place_mm: Array
    tension_n: Array


def rest_beside(rig: RigSpec, pretension_mm: float, pose: Pose, *, pieces: int = PIECES) -> tuple[Rested, Rested]:
    """Return where the head rests in the twin and in MuJoCo, the model being that of the upright joint and its motors
    told to take up what the twin's do for the pose."""
    upright, posed = (find_pose(rig, PoseRequest(pretension_mm, one), outlook=False) for one in (STRAIGHT, pose))
    assert upright.rest is not None
    assert posed.rest is not None
    assert posed.shape is not None
    model, data = loaded(joint_bodies(rig, modes.ModesRequest((pretension_mm,), (0.0,)), pieces))
    data.ctrl[: rig.tendons.count] = posed.rest.take_up - upright.rest.take_up
    _settle(model, data)
    base = data.body("base").xmat.reshape(3, 3)
    turned = base.T @ data.body("head").xmat.reshape(3, 3)
    tilt = np.asarray(twist_and_tilt(jnp.asarray(turned))[1])
    place = 1e3 * base.T @ data.body("head").xpos
    theirs = Rested(*_bend_of(tilt), place, -data.actuator_force[: rig.tendons.count])
    at = posed.rest.at
    return Rested(*_bend_of(np.asarray(at.tilt)), 1e3 * posed.shape.line[-1], np.asarray(at.tension)), theirs


def _bend_of(tilt: Array) -> tuple[float, float]:
    bend, azimuth = bend_of_swing(float(tilt[0]), float(tilt[1]))
    return math.degrees(bend), math.degrees(azimuth)


def _settle(model: Any, data: Any) -> None:
    """Step until the joint rests: without its memory, which only takes time, and with dampers on its springs."""
    import mujoco

    for i in range(model.ntendon):
        if model.tendon(i).name.startswith("memory"):
            model.tendon_stiffness[i] = 0.0
    model.dof_damping[model.jnt_dofadr] += SETTLING_S * model.jnt_stiffness
    for _ in range(round(REST_S / model.opt.timestep)):
        mujoco.mj_step(model, data)
