"""The twin's tendons against MuJoCo's spatial tendons, in the exported joint."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sinew.mechanics.tendons import tendon_energy, tendon_stretch
from sinew.plan.plan import Group
from sinew.plan.toml import load_rig
from sinew.predict.modes import ModesRequest
from sinew.predict.multibody import joint_bodies, write_mjcf
from sinew.solve.programs import configure
from sinew.twin.simulate import lane_parameters

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
configure()


@pytest.mark.parametrize("pretension_mm", [0.0, 6.0, 12.0])
def test_torque_of_twisted_joint_equals_mujocos_at_every_angle(pretension_mm: float) -> None:
    rig = load_rig("paper")
    bodies = joint_bodies(rig, ModesRequest((pretension_mm,), (0.0,)), sway=False)
    model = mujoco.MjModel.from_xml_string(write_mjcf(bodies, []))
    data, twist = mujoco.MjData(model), model.joint("twist0").qposadr[0]
    lanes, shortening = lane_parameters([Group("idle", pretension_mm, np.nan, np.nan, 0, 0.0, 1.0)], rig)
    p = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), lanes)
    slope = jax.jit(jax.grad(lambda angle, x: sum(tendon_energy(one, p) for one in tendon_stretch(angle, x, p))))
    for angle in np.radians([0.01, 5, 20, 45, 60]):
        data.qpos[twist] = angle
        mujoco.mj_forward(model, data)
        torque = float(slope(jnp.asarray(angle), jnp.asarray(shortening[0])))
        assert torque == pytest.approx(-float(data.qfrc_actuator[twist]), rel=1e-6)
