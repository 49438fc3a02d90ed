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
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.silicone import BRANCHES, silicone_energy, viscoelastic_energy
from sinew.mechanics.space import SpaceState
from sinew.mechanics.tendons import span_lengths
from sinew.plan.rig import RigSpec
from sinew.solve.march import runge_kutta
from sinew.twin.parameters import from_rig

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
