"""The joint in space behind its motors, in motion: the rod with its head, and a motor for each tendon.

Rod, head, lever, guides and weight are those of `sinew.mechanics.space`; motors, cables and drive those of
`sinew.emulator.joint`. The head has mass here and tilts as it does in the twin, so it sways. What the joint's own
motion asks of a horn costs no speed, as in the twin, whatever moves it: twist and sway.

Modes faster than `solve.spatial.FASTEST_OMEGA` are slowed to it, about first contact with every horn held: there the
cables alone are stiffer than with their motors, so that a tick is one stable step of RK4 in any state of the motors.
"""

import math
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sinew.emulator.joint import (
    DriveOrder,
    Kind,
    Layout,
    TendonOrder,
    drive_torque,
    goal_after,
    held_tension,
    reach_of,
    turned_horn,
)
from sinew.measure.arrays import Array
from sinew.mechanics.drive import gear_friction
from sinew.mechanics.parameters import CURRENT, POSITION
from sinew.mechanics.rod import TERMS
from sinew.mechanics.silicone import BRANCHES
from sinew.mechanics.space import (
    Motion,
    Pull,
    Space,
    SpaceState,
    free_acceleration,
    motion_of,
    pull_of,
    state_rate,
    tendon_spans,
    twist_and_tilt,
)
from sinew.plan.rig import RigSpec
from sinew.solve.march import STAGE_TIMES, next_stage
from sinew.solve.spatial import first_contact, in_mode, linear_equations, settle, slow_down
from sinew.twin.parameters import space_from_rig


class SpaceNow(NamedTuple):
    """All that changes with time: the state of `mechanics.space`, and of motors and drive as `emulator.joint.Now`."""

    motion: SpaceState
    horn: Any
    horn_speed: Any
    wound: Any
    span: Any
    tension: Any
    goal: Any


class SpaceSeen(NamedTuple):
    """What follows from the present: torsion [rad] and its rate [rad/s]; tilt about y and z of B [rad], its rate (2,);
    acceleration of the head plate's centre less gravity, in H (3,) [m/s²]; angular velocity of the head and its rate,
    in H (3,); the drive's torque [N m]."""

    torsion: Any
    torsion_rate: Any
    tilt: Any
    tilt_rate: Any
    force: Any
    spin: Any
    spin_rate: Any
    torque: Any


@cache
def space_layout(kind: Kind) -> Layout:
    """Return the layout for a kind of joint: arrays of indices."""
    each, three, strains = np.zeros(kind.tendons), np.zeros(3), np.zeros((6, TERMS))
    bristles, one = tuple(np.zeros(()) for _ in kind.guides.spread), np.zeros(())
    state: Any = SpaceState(strains, strains, np.zeros(()), one, np.zeros((BRANCHES, 6, TERMS)), bristles, three, three)  # type: ignore[arg-type]
    two = np.zeros(2)
    seen = SpaceSeen(one, one, two, two, three, three, three, one)
    now, seen = _numbered((SpaceNow(state, each, each, each, each, each, one), seen))
    tendons = _numbered(TendonOrder(*(each,) * 12))
    drive, step_s, steps = _numbered((DriveOrder(*(one,) * 13), one, one))
    return Layout(now, tendons, drive, int(step_s), int(steps), seen)


def _numbered(like: Any) -> Any:
    """Return the same with indices in place of its numbers, counted from 0."""
    leaves, tree = jax.tree.flatten(like)
    ends = np.cumsum([leaf.size for leaf in leaves])
    pairs = zip(leaves, ends, strict=True)
    return jax.tree.unflatten(tree, [np.arange(end - leaf.size, end).reshape(leaf.shape) for leaf, end in pairs])


def space_of(spec: RigSpec, rest_tilt: tuple[float, float]) -> tuple[Space, float]:
    """Return (the parameters of a rig whose continuum is bent by `rest_tilt` [rad] when nothing pulls, cables in place
    of cables on motors; mean cable end of the twin at first contact [m])."""
    space = space_from_rig(spec)
    contact, cable = spec.tendons.first_contact_tension.value, spec.tendons.cable_stiffness.value
    q, ends = first_contact(space, contact)
    tense = ends + contact / float(space.rod.joint.stiffness)
    joint = space.rod.joint._replace(stiffness=np.float64(cable))  # type: ignore[arg-type]
    space = space._replace(rod=space.rod._replace(joint=joint))
    held = in_mode(space, POSITION)._replace(cable_end=tense - contact / cable)
    slowed = slow_down(linear_equations(q, held), held)
    bent = (space.rod.rest_bend[0] + rest_tilt[0], space.rod.rest_bend[1] + rest_tilt[1])
    driven = in_mode(slowed, CURRENT)
    return driven._replace(rod=driven.rod._replace(rest_bend=bent)), float(ends.mean())


def hanging(space: Space) -> Array:
    """Return the coordinates (6, term) at which the joint rests while nothing pulls."""
    slack = space._replace(held_tension=np.zeros_like(space.held_tension))
    return settle(np.zeros((6, TERMS)), slack)[0]


def _forces(
    time_s: jax.Array,
    at: SpaceState,
    now: SpaceNow,
    order: TendonOrder,
    drive: DriveOrder,
    space: Space,
    step_s: jax.Array,
    passed_s: jax.Array,
) -> tuple[SpaceState, SpaceNow, SpaceSeen]:
    """Return (derivative, motors, what is seen) at a state `at`, time_s after a step's start.

    now: as the last step left the motors, `passed_s` before the present step; they are taken through it first. So
    lengths of tendons are needed where slopes are, and nowhere else.
    """
    k = space.rod.joint.stiffness
    moved = motion_of(at.q, at.q_rate, at.lever, at.lever_rate, space)
    spans, span_rate = jax.jvp(lambda q: tendon_spans(q, space), (at.q,), (at.q_rate,))
    free = jnp.abs(span_rate)
    before = reach_of(now.tension, now.horn, now.wound, order, free, step_s)
    horn, wound, tension = turned_horn(spans, now.horn, before, order, k, passed_s)
    speed = jnp.where(passed_s > 0, (horn - now.horn) / step_s, now.horn_speed)
    goal = goal_after(passed_s, now.goal, drive)
    goal = jnp.where(passed_s > 0, goal, now.goal)
    motors = SpaceNow(at, horn, speed, wound, spans, tension, goal)
    reach = reach_of(tension, horn, wound, order, free, step_s)
    pull = held_tension(time_s, spans, horn, reach, order, k)

    felt = pull_of(time_s, at, space._replace(held_tension=pull), moved)
    electrical = drive_torque(time_s, at, goal, drive, space.rod.joint)
    head, spins = moved.sections.turned[-1], moved.sections.spins[-1]
    force = felt.force - moved.bias + drive.push * (head[:, 0] @ spins)
    friction = gear_friction(at.lever_rate, space.rod.joint)
    acceleration, lever = free_acceleration(force, electrical - friction, moved, space)
    return (
        state_rate(at, acceleration, lever, moved, felt, space),
        motors,
        _seen(acceleration, moved, felt, electrical, space),
    )


def _seen(acceleration: jax.Array, moved: Motion, felt: Pull, torque: jax.Array, space: Space) -> SpaceSeen:
    sections, rates, end = moved.sections, moved.rates, np.array([-1])
    head, plate = sections.turned[-1], sections.places[-1:]
    spin = rates.spin[-1]
    (torsion, tilt), (_, tilt_rate) = jax.jvp(twist_and_tilt, (head,), (jnp.cross(spin, head.T).T,))
    pulled = sections.velocities(plate, end)[0] @ acceleration + rates.acceleration(plate, end)[0] - space.weight
    spin_rate = moved.spin_bias + (sections.spins[-1] @ acceleration) @ head
    return SpaceSeen(torsion, felt.torsion_rate, tilt, tilt_rate, pulled @ head, moved.spin, spin_rate, torque)


class Form(NamedTuple):
    """What the compiled code is made for: a kind of joint, and how its constants are taken from one vector."""

    kind: Kind
    tree: Any
    shapes: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, kind: Kind, space: Space) -> tuple["Form", jax.Array]:
        """Return (form, the constants in one vector)."""
        leaves, tree = jax.tree.flatten(space)
        vector = jnp.concatenate([jnp.ravel(jnp.asarray(leaf, dtype=float)) for leaf in leaves])
        return cls(kind, tree, tuple(np.shape(leaf) for leaf in leaves)), vector

    def space(self, constants: jax.Array) -> Space:
        """Return the parameters that a vector holds."""
        ends = np.cumsum([math.prod(shape) for shape in self.shapes])
        parts = zip(jnp.split(constants, ends[:-1]), self.shapes, strict=True)
        return jax.tree.unflatten(self.tree, [part.reshape(shape) for part, shape in parts])  # type: ignore[no-any-return]


@partial(jax.jit, static_argnums=4)
def move_on_in_space(now: Array, tendons: Array, drive: Array, constants: jax.Array, form: Form) -> jax.Array:
    """Return the numbers of `now` and `seen` after the steps that the vectors ask for; see `space_layout`.

    constants: those of a `Space`, as `form` takes them.

    A turn of the loop is one slope of RK4, which is long to compile and stands here once. The last state is seen in one
    more turn.
    """
    where, space = space_layout(form.kind), form.space(constants)
    asked, order = (
        jax.tree.map(jnp.asarray(v).__getitem__, w) for v, w in ((drive, where.drive), (tendons, where.tendons))
    )
    start = jax.tree.map(jnp.asarray(now).__getitem__, where.now)
    step_s, turns = jnp.asarray(drive)[where.step_s], 4 * jnp.asarray(drive)[where.steps].astype(int) + 1

    def turn(n: jax.Array, carry: Any) -> Any:
        begun, here, gone, motors, seen = carry
        stage = n % 4
        passed = jnp.where((stage == 0) & (n > 0), step_s, 0.0)
        time_s = jnp.asarray(STAGE_TIMES)[stage] * step_s
        slope, motors_here, seen_here = _forces(time_s, here, motors, order, asked, space, step_s, passed)
        kept = jax.tree.map(lambda new, old: jnp.where(stage == 0, new, old), (motors_here, seen_here), (motors, seen))
        return *next_stage(stage, begun, gone, slope, step_s), *kept

    zero = jax.tree.map(jnp.zeros_like, start.motion)
    nothing = jax.tree.map(lambda w: jnp.zeros(w.shape), where.seen)
    carry = (start.motion, start.motion, zero, start, nothing)
    *_, motors, seen = jax.lax.fori_loop(0, turns, turn, carry)
    return jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves((motors, seen))])
