"""The bent joint's steady motions as a problem to solve: torsion and sway in large swings, by harmonic balance.

The joint in space moves about its rest pose q_0 in a few shapes, q = q_0 + Φ y: its slowest modes, and what they bend
by the second order. The equations are those of `sinew.mechanics.space` as they stand, projected on the shapes,

    Φᵀ M(q) Φ ÿ + Φᵀ m θ̈ = Φᵀ f(q, q̇, z, b),

with centrifugal forces, tendons that go slack, the silicone's memory z as copies that lag behind y, the bristles b of
the guides and the lever θ on its servo. The first coordinate is the head's torsion, linear in the shapes; what the head
really does follows from the coordinates by the poses that they stand for.

Where the pose is a mirror of itself on the plane of its bend, as it is along and across the lever's arms, torsion, sway
across, lever and bristles have odd harmonics only, sway in the plane and stretch even ones: half a period is enough.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from scipy.spatial.transform import Rotation

from sinew.measure.arrays import Array, Complexes, wrapped_lag
from sinew.measure.attitude import tilt_from, torsion_of
from sinew.measure.estimate import number
from sinew.measure.result import Column, Field, Result, Rows
from sinew.mechanics.drive import commanded_angle, duty, horn_torque
from sinew.mechanics.rod import STRAINS, TERMS, memory_energy, rod_poses
from sinew.mechanics.silicone import BRANCHES, glassy_factor, relaxation_times
from sinew.mechanics.space import Space, SpaceState, free_acceleration, motion_of, pull_of, tensions
from sinew.plan.plan import Group, Pose, TendonMode
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.predict.predicted import Followed, followed, refuse_drive, refuse_pretensions
from sinew.solve.balance import Coordinate, Equations, Lane, Size, orders, slices, solve
from sinew.solve.branch import Branch, Search, interpolated_peak
from sinew.solve.continuation import Stride
from sinew.solve.curves import Problem, Resolution
from sinew.solve.curves import predict as predict_problem
from sinew.solve.programs import program
from sinew.solve.spatial import Linear, around, linear_equations
from sinew.twin.parameters import Effects
from sinew.twin.space import space_lanes

SHAPES = 8
"""Shapes that a motion is made of."""

_TIMES = tuple(float(tau) for tau in relaxation_times())
_NUDGE = 1e-3  # of a coordinate, for the change of the stiffness
_STEP = 1e-6  # of the differences, in radians, radians per second and shares


class Shaped(NamedTuple):
    """Numbers of the equations. space: its `added` has no part. rest: coordinates of the rod at rest (18,). shapes: Φ
    (18, r)."""

    space: Space
    rest: jax.Array
    shapes: jax.Array


def _solved(mass: jax.Array, right: jax.Array) -> jax.Array:
    """Return what `solve` says, whose derivatives by the right side need no more than one more of its calls."""
    found = jax.lax.custom_linear_solve(lambda x: mass @ x, right, lambda _, b: solve(mass, b), symmetric=True)
    return jnp.asarray(found)


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


# Derivatives by automatic differentiation would differentiate the equations in each of 50 channels. Differences need
# them compiled as they are, in 20: of the silicone's memory the accelerations depend by its push alone, linearly. At 64
# samples of a period that took 0.08 s instead of 0.5 s. Differences only steer Newton's method and tell the stability;
# what is left over is exact.


@partial(jax.custom_jvp, nondiff_argnums=(5,))
def _moved(v: jax.Array, push: jax.Array, phase: jax.Array, omega: jax.Array, p: Shaped, prescribed: bool) -> jax.Array:
    return _accelerations(v, push, phase, omega, p, prescribed)


@_moved.defjvp
def _moved_slopes(prescribed: bool, primals: Any, tangents: Any) -> tuple[jax.Array, jax.Array]:
    v, push, phase, omega, p = primals
    v_rate, push_rate, _, omega_rate, _ = tangents

    def both(step: jax.Array) -> tuple[jax.Array, jax.Array]:
        def by_push(push: jax.Array) -> tuple[jax.Array, jax.Array]:
            there = _accelerations(v + step[:-1], push, phase, omega + step[-1], p, prescribed)
            return there, there

        slopes, there = jax.jacfwd(by_push, has_aux=True)(push)
        return there, slopes

    steps = jnp.concatenate([jnp.zeros((1, v.size + 1)), _STEP * jnp.eye(v.size + 1)])
    there, by_push = jax.lax.map(both, steps)
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
    rates, drive = (_prescribed, None) if prescribed else (_free, shapes)
    return Equations((*moving, *lever, *rubbing), rates, drive=drive)


# The shapes of a pose.


def _mirror(azimuth: float) -> Array:
    """Return what a mirror on the plane of a bend does to the coordinates (18, 18). azimuth: of the bend [rad].

    The tangent's part across the plane turns round, and so do, as axial vectors, the curvatures' parts in it.
    """
    normal = np.array([0.0, -np.sin(azimuth), np.cos(azimuth)])
    polar = np.eye(3) - 2 * np.outer(normal, normal)
    return np.asarray(np.kron(scipy.linalg.block_diag(-polar, polar), np.eye(TERMS)), dtype=np.float64)


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


def _bent_by(mode: Array, other: Array, q: Array, space: Space) -> Array:
    """Return what a joint rests in, to the second order, where it is held in one mode and moves in another (18,).

    -K⁻¹ (∂K/∂q · mode) other, the modal derivative: a joint that twists far sinks by the square of its torsion.
    """
    step = _NUDGE / np.abs(mode).max() * mode.reshape(q.shape)
    above, here, below = (np.asarray(around(at, space).stiffness) for at in (q + step, q, q - step))
    change = (above - below) / (2 * _NUDGE / np.abs(mode).max())
    return np.asarray(-np.linalg.solve(here, change @ other))


def _shapes(linear: Linear, space: Space, q: Array, count: int, mirror: Array | None) -> Array:
    """Return the shapes of a pose (18, count), the odd half first where it is mirrored.

    Slowest modes, and two shapes of the second order: of the torsion with itself, and with the slowest sway, in the
    plane of the bend where that is told. Without them the large swings of a joint of eight shapes are 0.3 % too fast.
    The first coordinate is the head's torsion [rad]; the others have the inertia that the torsional mode has in it.
    """
    sides = [np.eye(len(linear.mass))]
    if mirror is not None:
        sides = [scipy.linalg.null_space(mirror - sign * np.eye(len(mirror))) for sign in (-1, 1)]
    each = count // len(sides)
    whole = each == sides[0].shape[1]
    found = [_slowest(linear, space, side, each if whole else each - 2 // len(sides)) for side in sides]
    twist = linear.around.by_torsion @ found[0]
    most = int(np.argmax(np.abs(twist)))
    torsion = found[0][:, most]
    sway = found[1][:, 0] if len(found) > 1 else found[0][:, 0 if most else 1]
    if not whole:
        more = [_bent_by(torsion, sway, q, space), _bent_by(torsion, torsion, q, space)]
        for i, one in enumerate(more):
            side = min(i, len(found) - 1)
            found[side] = np.column_stack([found[side], _orthogonal(one, found[side], linear.mass)])
    found[0] = np.column_stack([torsion, np.delete(found[0], most, axis=1)])
    modes = np.hstack(found) / twist[most]
    modes[:, 1:] -= np.outer(modes[:, 0], linear.around.by_torsion @ modes[:, 1:])
    return np.asarray(modes, dtype=np.float64)


def _orthogonal(shape: Array, others: Array, mass: Array) -> Array:
    """Return what a shape has beside others that are orthonormal by the mass, of unit mass (18,)."""
    for _ in range(2):
        shape = shape - others @ (others.T @ mass @ shape)
    return np.asarray(shape / np.sqrt(shape @ mass @ shape))


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
        _shapes(one, space, q, shapes, mirror if mirrored else None)
        for one, space, q in zip(linears, spaces, lanes.q, strict=True)
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


# What the head does in a steady motion, and what its tendons bear.

RESOLUTION = Resolution(
    ((Size(5, 24), Size(9, 64)),),
    5e-3,
    Stride(first=0.02, most=0.1, correction=1e-2, tolerance=1e-4),
    Search(nudge=2e-2, enough=5e-3),
)
"""Waves for a joint whose pose is its own mirror image, on half a period."""

_WHOLE = RESOLUTION._replace(sizes=((Size(5, 48), Size(9, 96)),))

_PHASES = 64
_ORDERS = 3


class Motions(NamedTuple):
    """Steady motions of the head, at n points of a curve. torsion, in_plane, across: complex harmonics [rad] of the
    orders 0 to 3, (n, 4), y = Re Σ c_h exp(jhΩt); tilts from the pose, as `measure.attitude.tilt_from` has them.
    tension: lowest and highest of every tendon over the period [N], (n, tendon, 2)."""

    torsion: Complexes
    in_plane: Complexes
    across: Complexes
    tension: Array


@program()
def _heads(q: jax.Array, space: Space) -> tuple[jax.Array, jax.Array]:
    """Return (rotation of the head (k, 3, 3), tension of the tendons (k, tendon) [N]) at coordinates (k, 6, term)."""

    def one(q: jax.Array) -> tuple[jax.Array, jax.Array]:
        return rod_poses(q, space.rod)[0][-1], tensions(q, space)

    return jax.vmap(one)(q)


def motions_of(branch: Branch, problem: Problem, pose: Pose, lane: int = 0) -> Motions:
    """Return what the head does along a curve of a coupled problem."""
    equations, size = problem.equations, branch.waves
    p: Shaped = jax.tree.map(lambda leaf: np.asarray(leaf)[lane], problem.lane.p)
    phase = 2 * np.pi * np.arange(_PHASES) / _PHASES
    parts = slices(equations, size)[: p.shapes.shape[1]]
    moves = []
    for coordinate, part in zip(equations.coordinates, parts, strict=False):
        h, own = orders(coordinate, size), branch.motion[:, part]
        sines = np.sin(np.outer(h[h > 0], phase))
        moves.append(own[:, : h.size] @ np.cos(np.outer(h, phase)) + own[:, h.size :] @ sines)
    count = len(branch.motion)
    q = np.asarray(p.rest) + np.einsum("rnk,cr->nkc", np.array(moves), np.asarray(p.shapes))
    few = 16  # points at a time, so that it is compiled once
    padded = np.concatenate([q, np.repeat(q[-1:], -count % few, axis=0)]).reshape(
        -1, few * _PHASES, len(STRAINS), TERMS
    )
    turned, pulled = (
        np.concatenate(rows)[: count * _PHASES] for rows in zip(*(_heads(one, p.space) for one in padded), strict=True)
    )
    orientation = Rotation.from_matrix(turned).as_quat(scalar_first=True)
    torsion = np.concatenate([torsion_of(one) for one in np.split(orientation, count)])
    tilt = tilt_from(orientation, pose.bend_rad, pose.azimuth_rad)

    def waves(values: Array) -> Complexes:
        c = np.fft.rfft(values.reshape(count, _PHASES), axis=1)[:, : _ORDERS + 1] * 2 / _PHASES
        c[:, 0] /= 2
        return c

    tension = pulled.reshape(count, _PHASES, -1)
    ends = np.stack([tension.min(axis=1), tension.max(axis=1)], axis=2)
    return Motions(waves(torsion), waves(tilt[:, 0]), waves(tilt[:, 1]), ends)


@dataclass(frozen=True, repr=False)
class Crest(Result):
    """Where something is largest along a curve: amplitudes there, of torsion and tilt across those of their
    fundamentals, of the tilt in the plane that at the double frequency, and its mean. tension_n: lowest and highest."""

    frequency_hz: Annotated[float, Field("peak")]
    torsion_deg: Annotated[float, Field("torsion")]
    tilt_across_deg: Annotated[float, Field("tilt across")]
    tilt_in_plane_twice_deg: Annotated[float, Field("in plane at 2f")]
    tilt_in_plane_mean_deg: Annotated[float, Field("", "detail")]
    lever_deg: Annotated[float, Field("lever")]
    tension_n: Annotated[tuple[float, float], Field("tensions")]


@dataclass(frozen=True, repr=False)
class FoldResult(Result):
    """A fold of a curve; torsion_deg: half of peak to peak."""

    frequency_hz: Annotated[float, Field("frequency")]
    torsion_deg: Annotated[float, Field("torsion")]

    def cell(self) -> str:
        """Return it in words."""
        return f"{number(self.frequency_hz, unit='Hz')}, {number(self.torsion_deg)}°"


@dataclass(frozen=True, repr=False)
class Coupled(Followed):
    """The response of one joint in its pose at one pretension: its curve, and what the head does along it.

    Amplitudes of fundamentals, and where named so of the double frequency, (n,); lags behind the lever. Tensions of
    each tendon: rest_tension_n at rest (tendon,), lowest and highest over a period (n, tendon). peak: where the
    torsion's fundamental is largest; sway_peak: where the tilt in the plane at the double frequency is. None where that
    lies at an end of the curve.
    """

    branch: Branch
    seen: Motions
    rest_tension_n: Column
    lever_deg: Column
    torsion_deg: Column
    torsion_lag_deg: Column
    torsion_twice_deg: Column
    tilt_across_deg: Column
    tilt_across_lag_deg: Column
    tilt_in_plane_deg: Column
    tilt_in_plane_twice_deg: Column
    tilt_in_plane_mean_deg: Column
    lowest_tension_n: Column
    highest_tension_n: Column
    peak: Annotated[Crest | None, Field("")]
    sway_peak: Annotated[Crest | None, Field("", "detail")]
    folds: Annotated[Rows[FoldResult], Field("folds", unit="")]

    def of_tendons(self, limit_n: float) -> list[str]:
        """Return what is to be said of its sway and its tendons. limit_n: of a tension, by the rig."""
        lines, peak, sway = [], self.peak, self.sway_peak
        if sway is not None:
            size = f"{number(sway.tilt_in_plane_twice_deg, 3)}°"
            lines.append(f"the tilt in the plane at 2f is largest at {number(sway.frequency_hz, unit='Hz')}, {size}")
        if min(self.rest_tension_n) <= 0:
            lines.append("a tendon is slack at rest")
        elif peak is not None and peak.tension_n[0] <= 0:
            lines.append("a tendon goes slack in the swing")
        if peak is not None and peak.tension_n[1] > limit_n:
            lines.append(f"a tendon is pulled by {peak.tension_n[1]:.0f} N, the rig's limit is {limit_n:g} N")
        return [f"- at {self.pretension_mm:g} mm {one}" for one in lines]


def coupled_of(branch: Branch, problem: Problem, pose: Pose, pretension_mm: float, lane: int = 0) -> Coupled:
    """Return a curve of a coupled problem with what the head does along it."""
    seen = motions_of(branch, problem, pose, lane)
    p: Shaped = jax.tree.map(lambda leaf: np.asarray(leaf)[lane], problem.lane.p)
    rest_n = np.asarray(
        _heads(np.broadcast_to(np.asarray(p.rest).reshape(len(STRAINS), TERMS), (1, len(STRAINS), TERMS)), p.space)[1]
    )[0]

    def size(waves: Complexes, order: int) -> Array:
        return np.degrees(np.abs(waves[:, order]))

    def lag(waves: Complexes) -> Array:
        return np.degrees(wrapped_lag(waves[:, 1] / branch.drive))

    lever, lowest, highest = np.degrees(np.abs(branch.drive)), seen.tension[:, :, 0], seen.tension[:, :, 1]
    torsion, across, twice = size(seen.torsion, 1), size(seen.across, 1), size(seen.in_plane, 2)
    mean = np.degrees(seen.in_plane[:, 0].real)
    rows = (torsion, across, twice, mean, lever, lowest.min(axis=1), highest.max(axis=1))

    def crest(row: Array) -> Crest | None:
        if row.size < _FEWEST or int(np.argmax(row)) in (0, row.size - 1):
            return None
        found = [interpolated_peak(branch.frequency_hz, row, one) for one in rows]
        torsion, across, twice, mean, lever, low, high = (one[2] for one in found)
        return Crest(found[0][0], torsion, across, twice, mean, lever, (low, high))

    return Coupled(
        **vars(followed(branch, pretension_mm)),
        branch=branch,
        seen=seen,
        rest_tension_n=rest_n,
        lever_deg=lever,
        torsion_deg=torsion,
        torsion_lag_deg=lag(seen.torsion),
        torsion_twice_deg=size(seen.torsion, 2),
        tilt_across_deg=across,
        tilt_across_lag_deg=lag(seen.across),
        tilt_in_plane_deg=size(seen.in_plane, 1),
        tilt_in_plane_twice_deg=twice,
        tilt_in_plane_mean_deg=mean,
        lowest_tension_n=lowest,
        highest_tension_n=highest,
        peak=crest(torsion),
        sway_peak=crest(twice),
        folds=Rows(FoldResult(one.frequency_hz, math.degrees(one.amplitude)) for one in branch.folds),
    )


_FEWEST = 7  # points about a peak


@dataclass(frozen=True, repr=False)
class PredictedBent(Result):
    """The response of a rig's joint in a pose: what was asked, and a curve for each pretension. spec: the rig."""

    spec: RigSpec
    pose: Pose
    rig: Annotated[str, Field("", "detail")]
    bend_deg: Annotated[float, Field("", "detail")]
    azimuth_deg: Annotated[float, Field("", "detail")]
    amplitude_deg: Annotated[float, Field("", "detail")]
    mode: Annotated[str, Field("", "detail")]
    without: Annotated[tuple[str, ...], Field("", "detail")]
    band_hz: Annotated[tuple[float, float], Field("", "detail")]
    curves: Annotated[Rows[Coupled], Field("where the torsion's fundamental is largest")]

    def closing(self) -> list[str]:
        """Return what to know of the curves, and how good they are."""
        limit_n = self.spec.limits.tension_n
        lines = [line for one in self.curves for line in (*one.of_tendons(limit_n), *one.remarks())]
        error = max((float(one.branch.error.max(initial=0.0)) for one in self.curves), default=0.0)
        question = f"{self.pose.words()}, command {self.amplitude_deg:g}°"
        return [*lines, f"{question}; error estimate {error:.1e}; {SHAPES} of 18 shapes of the rod"]


def predict_bent(
    rig: RigSpec | str | Path,
    pretension_mm: float | Sequence[float] = (0.0, 6.0, 12.0),
    *,
    bend_deg: float,
    azimuth_deg: float = 0.0,
    amplitude_deg: float = 20.0,
    mode: TendonMode = "position",
    without: Sequence[str] = (),
    band_hz: tuple[float, float] = (1.0, 6.0),
    progress: Callable[[float, float], None] | None = None,
) -> PredictedBent:
    """Return the steady response of a bent joint over frequency: torsion, tilt and tensions, through folds, stability.

    rig: as such, the path of its TOML file, or the name of a shipped one; it needs a [space]. pretension_mm: mean
    take-up of the tendons [mm], a curve for each. bend_deg, azimuth_deg: of the head at rest. amplitude_deg: of the
    lever's command [deg]. mode: of the tendon motors, which hold positions until the pose is reached. without: effects
    of the twin that are off. band_hz: lowest and highest frequency [Hz]. progress: called with (done, total) curves.
    Raises SpecError where the rig does not allow what is asked.
    """
    made = rig if isinstance(rig, RigSpec) else load_rig(rig)
    pretensions = [float(mm) for mm in np.atleast_1d(pretension_mm)]
    refuse_pretensions(made, pretensions)
    refuse_drive(mode, amplitude_deg, band_hz)
    pose, effects = Pose(bend_deg=bend_deg, azimuth_deg=azimuth_deg), Effects().without(*without)
    curves = []
    for i, mm in enumerate(pretensions):
        if progress is not None:
            progress(i, len(pretensions))
        problem = coupled_problem(made, [mm], pose, amplitude_deg, band_hz, mode=mode, effects=effects)
        (branch,) = predict_problem(problem, band_hz, resolution_of(problem)).branches
        curves.append(coupled_of(branch, problem, pose, mm))
    bend_deg, azimuth_deg = math.degrees(pose.bend_rad), math.degrees(pose.azimuth_rad)
    heading = (bend_deg, azimuth_deg, amplitude_deg, mode, tuple(without), (band_hz[0], band_hz[1]))
    return PredictedBent(made, pose, made.name, *heading, Rows(curves))


def resolution_of(problem: Problem) -> Resolution:
    """Return the waves of a coupled problem."""
    return _WHOLE if problem.equations.coordinates[0].parity == "all" else RESOLUTION
