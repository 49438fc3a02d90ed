"""The twin's tendons against MuJoCo's spatial tendons."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.mujoco_joint import joint_xml

from sinew.mechanics.joint import potential
from sinew.plan.plan import Group
from sinew.plan.toml import load_rig
from sinew.twin.cache import configure
from sinew.twin.simulate import lane_parameters

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
configure()


@pytest.mark.parametrize("pretension_mm", [0.0, 6.0, 12.0])
def test_torque_of_twisted_joint_equals_mujocos_at_every_angle(pretension_mm: float) -> None:
    rig = load_rig("paper")
    model = mujoco.MjModel.from_xml_string(joint_xml(rig, pretension_mm, axial=False))
    data = mujoco.MjData(model)
    lanes, shortening = lane_parameters([Group("idle", pretension_mm, np.nan, np.nan, 0, 0.0, 1.0)], rig)
    p = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), lanes)
    slope = jax.jit(jax.grad(potential))
    for angle in np.radians([0.01, 5, 20, 45, 60]):
        data.qpos[:] = (angle, 0)
        mujoco.mj_forward(model, data)
        torque = float(slope(jnp.asarray(angle), jnp.asarray(shortening[0]), p))
        assert torque == pytest.approx(-float(data.qfrc_passive[0]), rel=1e-6)
