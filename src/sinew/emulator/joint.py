"""The joint behind its motors, in motion: the mechanics' equations, with a motor for each tendon and with tilt.

Torsion, shortening, silicone, guide friction, lever and drive are those of `sinew.mechanics`. What is added:

A tendon's cable of stiffness k_c ends on the horn of its motor, which has taken up h of it: T = k_c (ℓ - ℓ_0 + h) where
taut. The motor wants a tension: by position, that of a spring of compliance 1/k_c + 1/k_servo whose end is at the wound
length w, up to a limit; else a set one. It gets it as long as the horn need not turn faster than the motor can under
that load; at that speed T follows from h. As in the twin, what the twist of the joint asks of the horn costs no speed.

The head tilts by t about y and z of frame B, without inertia: c dt/dt = -∂V/∂t, V holding the tendons' lengths at the
tilted pose and the bending energy ½ (E I/L) |t - t_0|², I about the weaker axis. Neither the head's inertia across its
axis nor the damping of that swing is known, and levelling asks only where the plate comes to rest and how soon: with
`TILT_DAMPING`, in 5 ms on locked tendons and in 65 ms on light constant tensions. Constant tensions bend an arc
further, by n T L²/(12 E I) of its tilt, and would topple it where that reaches one.
"""

import math
from collections.abc import Sequence
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sinew.measure.arrays import Array
from sinew.mechanics.drive import electrical_torque, gear_friction
from sinew.mechanics.guides import GuideFriction
from sinew.mechanics.joint import State, axial_omega, derivative, free_lever_acceleration, head_torque
from sinew.mechanics.parameters import CURRENT, POSITION, Parameters
from sinew.mechanics.rod import TERMS
from sinew.mechanics.silicone import BRANCHES, silicone_energy, viscoelastic_energy
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
from sinew.mechanics.tendons import span_lengths
from sinew.plan.rig import RigSpec
from sinew.solve.march import STAGE_TIMES, next_stage, runge_kutta
from sinew.solve.spatial import first_contact, in_mode, linear_equations, settle, slow_down
from sinew.twin.parameters import from_rig, space_from_rig

TICK_S = 1.25e-3
"""Time between two states of the joint [s]."""

TILT_DAMPING = 0.3
"""Damping of the tilt [N m s/rad]; assumed."""

Numbers = tuple[Any, ...]  # one for each tendon


class Joint(NamedTuple):
    """Constants: the twin's parameters, stiffness of one cable [N/m], rest tilt [rad] and damping [N m s/rad]."""

    p: Parameters
    cable_stiffness: Any
    rest_tilt: tuple[Any, Any]
    damping: Any


class Tilting(NamedTuple):
    """What is integrated: the twin's state and the tilt about y and z of frame B [rad]."""

    motion: State
    tilt: tuple[Any, Any]


class Now(NamedTuple):
    """All that changes with time.

    horn: cable taken up by each motor, h [m], its speed [m/s]; wound: where its position loop's spring ends, w [m].
    span: ℓ [m]; tension: T [N]. goal: the drive's goal on its way [rad].
    """

    tilting: Tilting
    horn: Numbers
    horn_speed: Numbers
    wound: Numbers
    span: Numbers
    tension: Numbers
    goal: Any


class TendonOrder(NamedTuple):
    """What the host asks of the tendon motors, by tendon; or of one of them.

    cable_end: ℓ_0, where the cable goes slack with nothing taken up [m]. goal: of w [m], approached at `speed` [m/s].
    compliance: of the servo [m/N]. limit: of the tension wanted [N]. duty: the largest. stall: tension at full duty
    [N]. fastest: speed of the unloaded horn at full duty [m/s]; wind_cap: bound on its speed when it takes up cable.
    may_wind, may_pay: 1 where the horn may turn that way. follows: 1 where w starts from the horn at each step.
    """

    cable_end: Any
    goal: Any
    speed: Any
    compliance: Any
    limit: Any
    duty: Any
    stall: Any
    fastest: Any
    wind_cap: Any
    may_wind: Any
    may_pay: Any
    follows: Any


class DriveOrder(NamedTuple):
    """What the host asks of the drive.

    duty = clip(feed + gain (goal on its way - angle) - speed_gain speed, ±duty_limit), its torque within ±torque_limit;
    or torque, within what the duty allows, where by_torque is 1; or none where on is 0. speed: at which the goal is
    approached [rad/s], jump: by how much it moves at once [rad]. duty_torque: of full duty at standstill [N m].
    push: what pushes the head from outside [N m].
    """

    goal: Any
    speed: Any
    jump: Any
    gain: Any
    speed_gain: Any
    feed: Any
    duty_limit: Any
    torque: Any
    torque_limit: Any
    by_torque: Any
    on: Any
    duty_torque: Any
    push: Any


class Seen(NamedTuple):
    """What follows from the present: torsion acceleration [rad/s²], tilt rates [rad/s], the drive's torque [N m]."""

    torsion_acceleration: Any
    tilt_rate: tuple[Any, Any]
    torque: Any


class Layout(NamedTuple):
    """Where everything is in the vectors of numbers that go to the compiled code, as indices.

    now, tendons: one vector each. drive, step_s [s] and steps (how many to take): a third.
    What comes back is a new `now`, then `seen`.
    """

    now: Any
    tendons: TendonOrder
    drive: DriveOrder
    step_s: int
    steps: int
    seen: Any

    def sizes(self) -> tuple[int, int, int]:
        """Return the lengths of the vectors now, tendons and drive."""
        return self._size(self.now), self._size(self.tendons), len(self.drive) + 2

    @staticmethod
    def _size(indices: Any) -> int:
        return sum(np.size(leaf) for leaf in jax.tree.leaves(indices))


class Kind(NamedTuple):
    """What the compiled code is made for: number of tendons, and the law of their guides' friction."""

    tendons: int
    guides: type[GuideFriction]

    @classmethod
    def of(cls, spec: RigSpec) -> "Kind":
        """Return the kind of a rig."""
        return cls(spec.tendons.count, type(spec.tendons.guides))


@cache
def layout(kind: Kind) -> Layout:
    """Return the layout for a kind of joint."""
    each = (0,) * kind.tendons
    bristles, memory = (0,) * len(kind.guides.spread), (0,) * BRANCHES
    state = State(*(0,) * 6, memory, memory, 0, 0, bristles)  # type: ignore[arg-type]
    now, seen = _numbered((Now(Tilting(state, (0, 0)), *(each,) * 5, goal=0), Seen(0, (0, 0), 0)))
    tendons = _numbered(TendonOrder(*(each,) * 12))
    drive, step_s, steps = _numbered((DriveOrder(*(0,) * 13), 0, 0))
    return Layout(now, tendons, drive, step_s, steps, seen)


def _numbered(like: Any) -> Any:
    leaves, tree = jax.tree.flatten(like)
    return jax.tree.unflatten(tree, range(len(leaves)))


def joint_of(spec: RigSpec, rest_tilt: tuple[float, float]) -> Joint:
    """Return the constants of a rig whose continuum is bent by `rest_tilt` [rad] when nothing pulls."""
    joint = Joint(from_rig(spec), spec.tendons.cable_stiffness.value, rest_tilt, TILT_DAMPING)
    return jax.tree.map(lambda value: np.asarray(value, dtype=float), joint)  # type: ignore[no-any-return]


def steps_per_tick(joint: Joint, speed: float) -> int:
    """Return how many steps of RK4 a tick needs, so that the fastest motion turns by at most 2 rad in a step.

    speed: the largest of the torsion [rad/s].
    """
    p = joint.p
    grip = len(p.guide_directions) * float(joint.cable_stiffness)
    bending = float(p.bending_rigidity / p.length)
    tilt = (0.5 * grip * max(float(p.head_radius), float(p.base_radius)) ** 2 + bending) / float(joint.damping)
    return max(1, int(np.ceil(TICK_S * max(axial_omega(grip, p), tilt, float(p.guides.fastest(speed))) / 2)))


class Reach(NamedTuple):
    """How a motor may turn in a step: start [m] and speed [m/s] of w, speeds at which the horn may wind and pay out.

    As everything of a motor, for one tendon or, as arrays, for all.
    """

    start: Any
    speed: Any
    wind: Any
    pay: Any


def reach_of(tension: Any, horn: Any, wound: Any, order: TendonOrder, free: Any, step_s: jax.Array) -> Reach:
    """Return how a motor may turn in a step. free: speed that the joint itself asks of the horn, at no cost [m/s]."""
    load = tension / order.stall
    start = jnp.where(order.follows > 0, horn, wound)
    speed = jnp.clip((order.goal - start) / step_s, -order.speed, order.speed)
    spare = order.fastest * jnp.maximum(0.0, order.duty - load)
    wind = order.may_wind * (jnp.minimum(spare, order.wind_cap) + free)
    return Reach(start, speed, wind, order.may_pay * (order.fastest * (order.duty + load) + free))


def held_tension(time_s: Any, span: Any, horn: Any, reach: Reach, order: TendonOrder, k: Any) -> Any:
    """Return the tension [N] at a time after the start of a step, where the horn was at its start [m]."""
    wanted = jnp.minimum(_wanted(span, reach.start + reach.speed * time_s, order, k), order.limit)
    grip = span - order.cable_end + horn
    low = k * jnp.maximum(0.0, grip - reach.pay * time_s)
    return jnp.clip(wanted, low, k * jnp.maximum(0.0, grip + reach.wind * time_s))


def turned_horn(span: Any, horn: Any, reach: Reach, order: TendonOrder, k: Any, passed_s: Any) -> tuple[Any, Any, Any]:
    """Return (horn [m], w [m], tension [N]) after a time of a step at whose start the horn was there."""
    wound = reach.start + reach.speed * passed_s
    wanted = jnp.minimum(_wanted(span, wound, order, k), order.limit)
    where_taut = order.cable_end - span + wanted / k
    there = jnp.where(span - order.cable_end + wound > 0, where_taut, wound)
    horn = jnp.clip(there, horn - reach.pay * passed_s, horn + reach.wind * passed_s)
    return horn, wound, k * jnp.maximum(0.0, span - order.cable_end + horn)


def _wanted(span: Any, wound: Any, order: TendonOrder, k: Any) -> Any:
    return k / (1 + k * order.compliance) * jnp.maximum(0.0, span - order.cable_end + wound)


def _reaches(now: Now, orders: Sequence[TendonOrder], joint: Joint, step_s: jax.Array) -> list[Reach]:
    p, motion = joint.p, now.tilting.motion
    twist = jnp.abs(p.base_radius * p.head_radius * jnp.sin(motion.torsion) * motion.torsion_rate)
    each = zip(now.tension, now.horn, now.wound, orders, now.span, strict=True)
    return [reach_of(tension, horn, w, order, twist / span, step_s) for tension, horn, w, order, span in each]


def _by_tendon(order: TendonOrder) -> list[TendonOrder]:
    return [TendonOrder(*numbers) for numbers in zip(*order, strict=True)]


def _slope(
    time_s: jax.Array,
    at: Tilting,
    now: Now,
    orders: Sequence[TendonOrder],
    drive: DriveOrder,
    joint: Joint,
    reaches: Sequence[Reach],
) -> tuple[Tilting, jax.Array]:
    """Return the derivative `time_s` after the start `now` of a step, and the drive's torque [N m]."""
    p, k, motion = joint.p, joint.cable_stiffness, at.motion

    def tensions(spans: Sequence[jax.Array]) -> list[jax.Array]:
        each = zip(spans, now.horn, reaches, orders, strict=True)
        return [held_tension(time_s, span, horn, reach, order, k) for span, horn, reach, order in each]

    def energy(torsion: jax.Array, shortening: jax.Array, tilt: tuple[Any, Any]) -> tuple[jax.Array, jax.Array]:
        spans = span_lengths(torsion, shortening, p, tilt)
        pull = [jax.lax.stop_gradient(tension) for tension in tensions(spans)]
        stored = silicone_energy(torsion, shortening, p)
        stored += viscoelastic_energy(torsion, shortening, motion.memory, motion.axial_memory, p)
        bent = sum((t - rest) ** 2 for t, rest in zip(tilt, joint.rest_tilt, strict=True))
        stored += 0.5 * p.bending_rigidity / p.length * bent
        return stored + sum(t * span for t, span in zip(pull, spans, strict=True)), jnp.asarray(sum(pull))

    slope, total = jax.grad(energy, argnums=(0, 1, 2), has_aux=True)(motion.torsion, motion.shortening, at.tilt)
    torque = head_torque(slope[0], p.guides.torque(total, motion.bristles), motion, p) + drive.push
    pulled = drive_torque(time_s, motion, now.goal, drive, p)
    horn = pulled - gear_friction(motion.lever_rate, p)
    lever = free_lever_acceleration(torque, horn, p)
    tilt_rate = (-slope[2][0] / joint.damping, -slope[2][1] / joint.damping)
    return Tilting(derivative(motion, torque, slope[1], lever, p), tilt_rate), pulled


def drive_torque(time_s: Any, motion: State | SpaceState, start: jax.Array, drive: DriveOrder, p: Parameters) -> Any:
    """Return the electrical torque of the drive at its horn [N m]."""
    goal = goal_after(time_s, start, drive)
    speed = motion.lever_rate
    wanted = drive.feed + drive.gain * (goal - motion.lever) - drive.speed_gain * speed
    supplied = p._replace(duty_torque=drive.duty_torque)
    by_duty = electrical_torque(jnp.clip(wanted, -drive.duty_limit, drive.duty_limit), speed, supplied)
    by_duty = jnp.clip(by_duty, -drive.torque_limit, drive.torque_limit)
    low, high = (electrical_torque(sign * drive.duty_limit, speed, supplied) for sign in (-1, 1))
    return jnp.where(drive.on > 0, jnp.where(drive.by_torque > 0, jnp.clip(drive.torque, low, high), by_duty), 0.0)


def _step(now: Now, order: TendonOrder, drive: DriveOrder, joint: Joint, step_s: jax.Array) -> tuple[Now, Seen]:
    """Return what there is a step later, and what is seen at its start."""
    orders = _by_tendon(order)
    reaches = _reaches(now, orders, joint, step_s)

    @jax.jit
    def slope(time_s: jax.Array, at: Tilting) -> tuple[Tilting, jax.Array]:
        return _slope(time_s, at, now, orders, drive, joint, reaches)

    zero = jnp.zeros(())
    after = runge_kutta(lambda time_s, at: slope(time_s, at)[0], zero, now.tilting, step_s)
    spans = span_lengths(after.motion.torsion, after.motion.shortening, joint.p, after.tilt)
    each = zip(spans, now.horn, reaches, orders, strict=True)
    turned = [turned_horn(span, h, reach, one, joint.cable_stiffness, step_s) for span, h, reach, one in each]
    horns, wounds, tensions = zip(*turned, strict=True)
    speeds = tuple((new - old) / step_s for new, old in zip(horns, now.horn, strict=True))
    later = Now(after, horns, speeds, wounds, spans, tensions, goal_after(step_s, now.goal, drive))

    rate, torque = slope(zero, now.tilting)  # the first of RK4's: costs nothing
    return later, Seen(rate.motion.torsion_rate, rate.tilt, torque)


def goal_after(time_s: Any, start: jax.Array, drive: DriveOrder) -> jax.Array:
    """Return the drive's goal on its way [rad], a time after it was at `start`."""
    reach = drive.speed * time_s + drive.jump
    return start + jnp.clip(drive.goal - start, -reach, reach)


@partial(jax.jit, static_argnums=4)
def move_on(now: Array, tendons: Array, drive: Array, constants: jax.Array, kind: Kind) -> jax.Array:
    """Return the numbers of `now` and `seen` after the steps that the vectors ask for; see `Layout`.

    constants: the leaves of a `Joint`, stacked. Takes any number of steps, also none.

    The last state is seen in one more turn of the loop, whose step is not taken: a second copy of the equations would
    cost more.
    The loop is to be one run of small kernels in one thread. Hence vectors below 512 bytes (up to five tendons), for
    what is longer the compiler spreads over threads; and the barrier, for it would carry each order on its own.
    """
    where = layout(kind)
    steps = jnp.asarray(drive)[where.steps]

    def step(turn: jax.Array, at: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        numbers, orders, last, fixed = map(list, _fenced(at[0], tendons, drive, constants))
        order = jax.tree.map(orders.__getitem__, where.tendons)
        asked, step_s = jax.tree.map(last.__getitem__, (where.drive, where.step_s))
        joint = _joint(fixed, kind)
        later, seen = _step(jax.tree.map(numbers.__getitem__, where.now), order, asked, joint, step_s)
        kept = [jnp.where(turn < steps, new, old) for new, old in zip(jax.tree.leaves(later), numbers, strict=True)]
        return jnp.stack(kept), jnp.stack(jax.tree.leaves(seen))

    nothing = jnp.zeros(len(jax.tree.leaves(where.seen)))
    return jnp.concatenate(jax.lax.fori_loop(0, steps.astype(int) + 1, step, (jnp.asarray(now), nothing)))


def _fenced(*vectors: Any) -> Any:
    return jax.lax.optimization_barrier(vectors)  # type: ignore[no-untyped-call]


def _joint(leaves: list[jax.Array], kind: Kind) -> Joint:
    fields: dict[str, Any] = dict.fromkeys(Parameters._fields, 0.0)
    fields |= {"prony_shares": (0.0,) * BRANCHES, "guide_directions": ((0.0, 0.0),) * kind.tendons}
    p = Parameters(**{**fields, "guides": kind.guides(0.0, 0.0)})
    like = Joint(p, 0.0, (0.0, 0.0), 0.0)
    return jax.tree.unflatten(jax.tree.structure(like), leaves)  # type: ignore[no-any-return]


# ---- the joint in space behind its motors, in motion: the rod with its head, and a motor for each tendon
#
# Rod, head, lever, guides and weight are those of `sinew.mechanics.space`; motors, cables and drive those of
# `sinew.emulator.joint`. The head has mass here and tilts as it does in the twin, so it sways. What the joint's own
# motion asks of a horn costs no speed, as in the twin, whatever moves it: twist and sway.
#
# Modes faster than `solve.spatial.FASTEST_OMEGA` are slowed to it, about first contact with every horn held: there the
# cables alone are stiffer than with their motors, so that a tick is one stable step of RK4 in any state of the motors.


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
    now, seen = _numbered_arrays((SpaceNow(state, each, each, each, each, each, one), seen))
    tendons = _numbered_arrays(TendonOrder(*(each,) * 12))
    drive, step_s, steps = _numbered_arrays((DriveOrder(*(one,) * 13), one, one))
    return Layout(now, tendons, drive, int(step_s), int(steps), seen)


def _numbered_arrays(like: Any) -> Any:
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
