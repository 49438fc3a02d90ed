"""The bent joint's steady motions as a problem to solve: torsion and sway in large swings, by harmonic balance.

The joint in space moves about its rest pose q_0 in a few shapes, q = q_0 + Φ y: its slowest modes. The equations are
those of `sinew.mechanics.space` as they stand, projected on the shapes,

    Φᵀ M(q) Φ ÿ + Φᵀ m θ̈ = Φᵀ f(q, q̇, z, b),

with centrifugal forces, tendons that go slack, the silicone's memory z as copies that lag behind y, the bristles b of
the guides and the lever θ on its servo. The first coordinate is the head's torsion, linear in the shapes; what the head
really does follows from the coordinates by the poses that they stand for.

Where the pose is a mirror of itself on the plane of its bend, as it is along and across the lever's arms, torsion, sway
across, lever and bristles have odd harmonics only, sway in the plane and stretch even ones, and half a period is enough.
"""

from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg

from sinew.measure.arrays import Array
from sinew.mechanics.drive import commanded_angle, duty, horn_torque
from sinew.mechanics.rod import STRAINS, TERMS, memory_energy
from sinew.mechanics.silicone import BRANCHES, glassy_factor, relaxation_times
from sinew.mechanics.space import Space, SpaceState, free_acceleration, motion_of, pull_of
from sinew.plan.plan import Group, TendonMode
from sinew.plan.pose import Pose
from sinew.plan.rig import RigSpec
from sinew.solve.balance import Coordinate, Equations, Lane, solve
from sinew.solve.curves import Problem
from sinew.solve.spatial import Linear, linear_equations
from sinew.twin.parameters import Effects
from sinew.twin.space import space_lanes

SHAPES = 8
"""Shapes that a motion is made of."""

_TIMES = tuple(float(tau) for tau in relaxation_times())
_STEP = 1e-6  # of the differences, in radians, radians per second and shares


class Shaped(NamedTuple):
    """Numbers of the equations. space: its `added` has no part. rest: coordinates of the rod at rest (18,). shapes: Φ
    (18, r)."""

    space: Space
    rest: jax.Array
    shapes: jax.Array


def _solved(mass: jax.Array, right: jax.Array) -> jax.Array:
    """Return what `solve` says, whose derivatives by the right side need no more than one more of its calls."""
    return jax.lax.custom_linear_solve(lambda x: mass @ x, right, lambda _, b: solve(mass, b), symmetric=True)


def _accelerations(
    v: jax.Array, push: jax.Array, phase: jax.Array, omega: jax.Array, p: Shaped, prescribed: bool
) -> jax.Array:
    """Return the highest derivatives of all coordinates: shapes, lever where it is free, bristles.

    v: shapes' amplitudes and rates (2 r), lever and its rate where it is free, bristles. push: of the silicone's memory
    on the shapes (r,).
    """
    count = p.shapes.shape[1]
    joint = p.space.rod.joint._replace(omega=omega)
    space = p.space._replace(rod=p.space.rod._replace(joint=joint), added=jnp.zeros((count, count)))
    time_s = phase / omega
    goal, goal_rate, goal_acceleration = commanded_angle(time_s, joint)
    lever, lever_rate = (goal, goal_rate) if prescribed else (v[2 * count], v[2 * count + 1])
    bristles = tuple(v[2 * count + (0 if prescribed else 2) :])
    moves = (p.shapes @ v[: 2 * count].reshape(2, count).T).T.reshape(2, len(STRAINS), TERMS)
    q = p.rest.reshape(len(STRAINS), TERMS) + moves[0]
    relaxed = jnp.broadcast_to(q, (BRANCHES, *q.shape))
    state = SpaceState(q, moves[1], lever, lever_rate, relaxed, bristles, jnp.zeros(3), jnp.zeros(3))
    moved = motion_of(q, moves[1], lever, lever_rate, space)
    felt = pull_of(time_s, state, space, moved)
    few = moved._replace(mass=p.shapes.T @ moved.mass @ p.shapes, lever_row=p.shapes.T @ moved.lever_row)
    horn = horn_torque(duty(goal - lever, joint), lever_rate, joint)
    force = p.shapes.T @ (felt.force - moved.bias) + push
    acceleration, free = free_acceleration(force, horn, few, space, goal_acceleration, prescribed, _solved)
    rubbing = jnp.stack(joint.guides.rates(felt.torsion_rate, bristles))
    return jnp.concatenate([acceleration, rubbing] if prescribed else [acceleration, free[None], rubbing])


# Derivatives by automatic differentiation of these equations take 37 s of computing to compile and 0.5 s to evaluate at
# 64 samples of the period. Differences need the equations compiled once, and nothing of the memory, on which the
# accelerations depend linearly by its push: 11 s and 0.1 s. They only steer Newton's method, and tell the stability; what
# is left over is exact.


@partial(jax.custom_jvp, nondiff_argnums=(5,))
def _moved(
    v: jax.Array, push: jax.Array, phase: jax.Array, omega: jax.Array, p: Shaped, prescribed: bool
) -> jax.Array:
    return _accelerations(v, push, phase, omega, p, prescribed)


@_moved.defjvp
def _moved_slopes(prescribed: bool, primals: Any, tangents: Any) -> tuple[jax.Array, jax.Array]:
    v, push, phase, omega, p = primals
    v_rate, push_rate, _, omega_rate, _ = tangents

    def beside(step: jax.Array) -> tuple[jax.Array, jax.Array]:
        def by_push(push: jax.Array) -> tuple[jax.Array, jax.Array]:
            there = _accelerations(v + step[:-1], push, phase, omega + step[-1], p, prescribed)
            return there, there

        slopes, there = jax.jacfwd(by_push, has_aux=True)(push)
        return there, slopes

    steps = jnp.concatenate([jnp.zeros((1, v.size + 1)), _STEP * jnp.eye(v.size + 1)])
    there, by_push = jax.lax.map(beside, steps)
    slopes = (there[1:] - there[0]).T / _STEP
    return there[0], slopes @ jnp.append(v_rate, omega_rate) + by_push[0] @ push_rate


def _rates(u: jax.Array, phase: jax.Array, omega: jax.Array, p: Shaped, prescribed: bool) -> jax.Array:
    count, each = p.shapes.shape[1], 2 + BRANCHES
    own = u[: each * count].reshape(count, each)
    moved = own[:, 0]
    lagging = p.rest + own[:, 2:].T @ p.shapes.T

    def stored(y: jax.Array) -> jax.Array:
        q, shape = p.rest + p.shapes @ y, (len(STRAINS), TERMS)
        return memory_energy(q.reshape(shape), lagging.reshape(BRANCHES, *shape), p.space.rod)

    v = jnp.concatenate([own[:, :2].T.ravel(), u[each * count :]])
    return _moved(v, -jax.grad(stored)(moved), phase, omega, p, prescribed)


def _free(u: jax.Array, phase: jax.Array, omega: jax.Array, p: Shaped) -> jax.Array:
    return _rates(u, phase, omega, p, False)


def _prescribed(u: jax.Array, phase: jax.Array, omega: jax.Array, p: Shaped) -> jax.Array:
    return _rates(u, phase, omega, p, True)


@cache
def coupled_equations(shapes: int, bristles: int, *, mirrored: bool, prescribed: bool) -> Equations:
    """Return the equations of a joint that moves in so many shapes, the first half of them odd where it is mirrored.

    bristles: of its guides' friction. prescribed: the lever follows its command exactly.
    """
    parities = [("odd" if i < shapes // 2 else "even") if mirrored else "all" for i in range(shapes)]
    moving = tuple(Coordinate(f"shape {i + 1}", one, 2, _TIMES) for i, one in enumerate(parities))  # type: ignore[arg-type]
    lever = () if prescribed else (Coordinate("lever", parities[0], 2),)  # type: ignore[arg-type]
    rubbing = tuple(Coordinate(f"bristle {i + 1}", parities[0], 1) for i in range(bristles))  # type: ignore[arg-type]
    return Equations((*moving, *lever, *rubbing), _prescribed if prescribed else _free, drive=None if prescribed else shapes)


# The shapes of a pose.


def _mirror(azimuth: float) -> Array:
    """Return what a mirror on the plane of a bend does to the coordinates (18, 18). azimuth: of the bend [rad].

    The tangent's part across the plane turns round, and so do, as axial vectors, the curvatures' parts in it.
    """
    normal = np.array([0.0, -np.sin(azimuth), np.cos(azimuth)])
    polar = np.eye(3) - 2 * np.outer(normal, normal)
    return np.kron(scipy.linalg.block_diag(-polar, polar), np.eye(TERMS))


def _is_mirrored(linear: Linear, q: Array, mirror: Array) -> bool:
    """Return whether a pose is its own mirror image: at rest, in stiffness, mass and what the lever moves."""
    same = [(q.ravel(), mirror @ q.ravel()), (-linear.lever_row, mirror @ linear.lever_row)]
    tables = (linear.around.stiffness, linear.mass, linear.memory)
    same += [(one, mirror @ one @ mirror) for one in tables]
    return all(np.abs(a - b).max() < 1e-7 * np.abs(a).max() for a, b in same)


def _slowest(linear: Linear, space: Space, among: Array, count: int) -> Array:
    """Return the slowest modes (18, count) of unit mass among the combinations of some shapes (18, n)."""
    glassy = linear.around.stiffness + (float(glassy_factor(space.rod.joint)) - 1) * linear.memory
    found = scipy.linalg.eigh(among.T @ glassy @ among, among.T @ linear.mass @ among)[1]
    return np.asarray(among @ found[:, :count])


def _shapes(linear: Linear, space: Space, count: int, mirror: Array | None) -> Array:
    """Return the shapes of a pose (18, count), the odd half first where it is mirrored.

    The first coordinate is the head's torsion [rad]; the others have the inertia that the torsional mode has in it.
    """
    if mirror is None:
        modes = _slowest(linear, space, np.eye(len(mirror_free := linear.mass)), count) if count else mirror_free
    else:
        sides = [scipy.linalg.null_space(mirror - sign * np.eye(len(mirror))) for sign in (-1, 1)]
        modes = np.hstack([_slowest(linear, space, side, count // 2) for side in sides])
    twist = linear.around.by_torsion @ modes
    most = int(np.argmax(np.abs(twist)))
    modes, twist = modes / twist[most], twist / twist[most]
    order = [most, *(i for i in range(count) if i != most)]
    modes, twist = modes[:, order], twist[order]
    modes[:, 1:] -= np.outer(modes[:, 0], twist[1:])
    return modes


def coupled_problem(
    rig: RigSpec,
    pretension_mm: Array | list[float],
    pose: Pose,
    amplitude_deg: Array | list[float] | float,
    band_hz: tuple[float, float],
    *,
    mode: TendonMode = "position",
    effects: Effects | None = None,
    shapes: int = SHAPES,
) -> Problem:
    """Return the problem of a rig's joint in a pose at some pretensions [mm] and amplitudes of the command [deg].

    pretension_mm, amplitude_deg: one for each lane; a single amplitude holds for all. band_hz: frequencies. shapes: an
    even number, at most 18, which are all.
    """
    effects = effects or Effects()
    pretension = np.atleast_1d(np.asarray(pretension_mm, dtype=float))
    amplitude = np.broadcast_to(np.asarray(amplitude_deg, dtype=float), pretension.shape)
    groups = [
        Group("steady", float(p), float(band_hz[0]), float(a), 0, 1.0, 1.0, pose=pose)
        for p, a in zip(pretension, amplitude, strict=True)
    ]
    lanes = space_lanes(groups, rig, mode=mode, effects=effects)
    spaces = [jax.tree.map(lambda leaf, i=i: leaf[i], lanes.space) for i in range(len(groups))]
    linears = [linear_equations(q, space) for q, space in zip(lanes.q, spaces, strict=True)]
    mirror = _mirror(pose.azimuth_rad)
    mirrored = all(_is_mirrored(one, q, mirror) for one, q in zip(linears, lanes.q, strict=True))
    basis = [
        _shapes(one, space, shapes, mirror if mirrored else None) for one, space in zip(linears, spaces, strict=True)
    ]
    prescribed = not effects.drive_dynamics
    count = len(rig.tendons.guides.spread)
    swing = np.radians(amplitude)
    columns = [1.5 * swing, *(0.5 * swing,) * (shapes - 1)]
    columns += [] if prescribed else [swing]
    columns += rig.tendons.guides.first_guess(1.5 * swing)
    width = np.full(pretension.shape, 2 * np.pi * (band_hz[1] - band_hz[0]))
    p = Shaped(lanes.space, lanes.q.reshape(len(groups), -1), np.stack(basis))  # type: ignore[arg-type]
    lane = Lane(p, np.stack(columns, axis=1), width)  # type: ignore[arg-type]
    equations = coupled_equations(shapes, count, mirrored=mirrored, prescribed=prescribed)
    return Problem(equations, lane, np.zeros((len(groups), len(columns))), _weakened)


def _weakened(p: Shaped, share: float) -> Shaped:
    joint = p.space.rod.joint._replace(amplitude=p.space.rod.joint.amplitude * share)
    return p._replace(space=p.space._replace(rod=p.space.rod._replace(joint=joint)))
