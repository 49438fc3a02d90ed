"""The rigid head on its tendons as a MuJoCo model, beside the joint in space.

Compared are spans, tensions, accelerations of moving states, and frequencies about a rest.

The rod is replaced by springs that both know: one against the head's displacement, along and across, and one against
its rotation vector. What is left is what a rigid body and tendons make: anchors, chords, locked and current-held
tendons, weight, the masses of head and lever with their heights and tensors, and gyroscopic terms with a turning
lever. Our side has the same functions as the twin, on a rod of constant strain and without mass, six coordinates that
reach every pose.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
import scipy.optimize

from sinew.measure.arrays import Array
from sinew.mechanics.parameters import POSITION
from sinew.mechanics.rod import rod_poses
from sinew.mechanics.space import Space, motion_of, tendon_spans, tensions, weight_energy
from sinew.mechanics.tendons import tendon_energy
from sinew.plan.toml import load_rig
from sinew.twin.parameters import space_from_rig

DISPLACING = np.array([9.5e3, 3.1e3, 3.1e3])
"""Springs against displacement of the plate along x, y, z of B [N/m], about as stiff as the rod."""
TURNING = 5.0
"""Spring against the rotation vector of the plate [N m/rad]."""
TAKE_UPS = np.array([6.0e-3, 6.8e-3, 6.0e-3, 5.2e-3])
"""Of the four tendons, so that the head rests bent [m]."""


class Motion(NamedTuple):
    """How head and lever move: spin of the head in its own axes (3,) [rad/s], velocity of the plate in B (3,) [m/s],
    the lever's angle [rad] and rate [rad/s] against the head."""

    spin: Array
    velocity: Array
    lever: float
    lever_rate: float


def held_head() -> Space:
    """Return the paper's head and lever on a rod without mass, its tendons held at lengths taken up unevenly."""
    space = space_from_rig(load_rig("paper"))
    joint = space.rod.joint._replace(mode=np.float64(POSITION))  # type: ignore[arg-type]
    none = np.float64(0.0)
    rod = space.rod._replace(joint=joint, line_mass=none, line_inertia=(none, none, none))  # type: ignore[arg-type]
    return space._replace(rod=rod, cable_end=float(joint.free_span) - TAKE_UPS)


def head_xml(space: Space) -> str:
    """Return the MJCF of head, lever, springs and tendons; x is the axis of the rod."""
    joint = space.rod.joint
    height = float(joint.length)
    directions = [(float(c), float(s)) for c, s in joint.guide_directions]
    sites = [
        "".join(f'<site name="{name}{i}" pos="{at} {r * c} {r * s}"/>' for i, (c, s) in enumerate(directions))
        for name, r, at in (
            ("base", float(joint.base_radius), 0.0),
            ("head", float(joint.head_radius), float(joint.free_span) - height),
        )
    ]
    spatial = "".join(
        f'<spatial stiffness="{float(joint.stiffness)}" springlength="0 {float(end)}">'
        f'<site site="base{i}"/><site site="head{i}"/></spatial>'
        for i, end in enumerate(space.cable_end)
    )
    slides = "".join(
        f'<joint type="slide" axis="{axis}" stiffness="{k}"/>'
        for axis, k in zip(("1 0 0", "0 1 0", "0 0 1"), DISPLACING, strict=True)
    )

    def body(mass: Any, above: Any, tensor: Any) -> str:
        moments = " ".join(str(float(m)) for m in tensor)
        return f'<inertial pos="{float(above)} 0 0" mass="{float(mass)}" diaginertia="{moments}"/>'

    weight = " ".join(str(float(g)) for g in space.weight)
    return f"""<mujoco><compiler angle="radian"/><option gravity="{weight}"><flag contact="disable"/></option>
    <worldbody>{sites[0]}<body name="head" pos="{height} 0 0">{slides}<joint type="ball" stiffness="{TURNING}"/>
    {sites[1]}
    {body(space.head_mass, space.head_height, space.head_tensor)}
    <body name="lever"><joint type="hinge" axis="1 0 0"/>
    {body(space.lever_mass, space.lever_height, space.lever_tensor)}</body></body></worldbody>
    <tendon>{spatial}</tendon></mujoco>"""


def _log(matrix: jax.Array) -> jax.Array:
    """Return the rotation vector of a rotation by less than half a turn (3,) [rad]."""
    skew = 0.5 * jnp.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])
    sine = jnp.sqrt(jnp.sum(skew**2) + 1e-30)
    return skew * jnp.arctan2(sine, 0.5 * (jnp.trace(matrix) - 1)) / sine


@jax.jit
def _potential(q: jax.Array, space: Space) -> jax.Array:
    rotations, positions = rod_poses(q, space.rod)
    moved = positions[-1] - jnp.array([1.0, 0.0, 0.0]) * space.rod.joint.length
    springs = 0.5 * jnp.sum(DISPLACING * moved**2) + 0.5 * TURNING * jnp.sum(_log(rotations[-1]) ** 2)
    held = tendon_energy(tendon_spans(q, space) - space.cable_end, space.joint)
    return springs + jnp.sum(held) + weight_energy(q, space)


_slope = jax.jit(lambda flat, space: jax.grad(_potential)(flat.reshape(6, 1), space).ravel())
_motion = jax.jit(motion_of)
_poses = jax.jit(lambda q, space: rod_poses(q, space.rod))


@jax.jit
def felt(q: jax.Array, space: Space) -> tuple[jax.Array, jax.Array]:
    """Return (spans [m], tensions [N]) of the tendons (tendon,) at coordinates (6, 1)."""
    return tendon_spans(q, space), tensions(q, space)


def own_accelerations(flat: Array, speed: Array, lever: float, lever_rate: float, space: Space) -> tuple[Motion, Array]:
    """Return (how the head moves, its rates: of the plate's velocity, of the head's spin, of the lever's (7,))."""
    moved = _motion(flat.reshape(6, 1), speed.reshape(6, 1), np.asarray(lever), np.asarray(lever_rate), space)
    row = np.asarray(moved.lever_row)
    whole = np.block([[np.asarray(moved.mass), row[:, None]], [row[None, :], np.atleast_2d(space.lever_tensor[0])]])
    force = np.append(-np.asarray(_slope(flat, space)) - np.asarray(moved.bias), -float(moved.lever_bias))
    rates = np.linalg.solve(whole, force)
    sections, end = moved.sections, np.array([-1])
    head, plate = np.asarray(sections.turned[-1]), sections.places[-1:]
    reach = np.asarray(sections.velocities(plate, end))[0]
    pulled = reach @ rates[:6] + np.asarray(moved.rates.acceleration(plate, end))[0]
    spin = head.T @ np.asarray(sections.spins[-1]) @ rates[:6] + np.asarray(moved.spin_bias)
    now = Motion(np.asarray(moved.spin), reach @ speed, lever, lever_rate)
    return now, np.concatenate([pulled, spin, rates[6:]])


def mujoco_state(flat: Array, motion: Motion, space: Space) -> Any:
    """Return (model, data) of MuJoCo with the head where the rod of coordinates (6,) has it, moving as told."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(head_xml(space))
    data = mujoco.MjData(model)
    rotations, positions = (np.asarray(leaf) for leaf in _poses(flat.reshape(6, 1), space))
    turned = np.zeros(4)
    mujoco.mju_mat2Quat(turned, rotations[-1].ravel())
    data.qpos[:] = [*(positions[-1] - [float(space.rod.joint.length), 0, 0]), *turned, motion.lever]
    data.qvel[:] = [*motion.velocity, *motion.spin, motion.lever_rate]
    mujoco.mj_forward(model, data)
    return model, data


def resting(space: Space) -> Array:
    """Return the coordinates (6,) at which the head rests on springs and tendons."""

    def slope(flat: Array) -> Array:
        return np.asarray(_slope(flat, space))

    found = scipy.optimize.root(slope, np.zeros(6), tol=1e-13)
    return np.asarray(found.x)


def own_frequencies(flat: Array, space: Space, step: float = 1e-5) -> Array:
    """Return the six frequencies about a rest with the lever locked, slowest first [Hz]; forces are differenced."""
    zero = np.zeros(())
    mass = _motion(flat.reshape(6, 1), np.zeros((6, 1)), zero, zero, space).mass
    steps = step * np.eye(6)
    stiffness = np.array([np.asarray(_slope(flat + s, space)) - np.asarray(_slope(flat - s, space)) for s in steps])
    symmetric = (stiffness + stiffness.T) / (4 * step)
    return np.sqrt(scipy.linalg.eigh(symmetric, np.asarray(mass), eigvals_only=True)) / (2 * np.pi)


def mujoco_frequencies(flat: Array, space: Space, step: float = 1e-5) -> Array:
    """Return the same of MuJoCo, its forces differenced over steps of its own coordinates [m, rad]."""
    import mujoco

    model, data = mujoco_state(flat, Motion(np.zeros(3), np.zeros(3), 0.0, 0.0), space)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    rest, stiffness = data.qpos.copy(), np.zeros((6, 6))
    for k in range(6):
        forces = []
        for sign in (1.0, -1.0):
            data.qpos[:] = rest
            mujoco.mj_integratePos(model, data.qpos, np.eye(model.nv)[k], sign * step)
            mujoco.mj_forward(model, data)
            forces.append((data.qfrc_passive - data.qfrc_bias)[:6].copy())
        stiffness[:, k] = (forces[1] - forces[0]) / (2 * step)
    squares = scipy.linalg.eigh(0.5 * (stiffness + stiffness.T), mass[:6, :6], eigvals_only=True)
    return np.sqrt(squares) / (2 * np.pi)
