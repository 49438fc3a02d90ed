"""The joint behind its motors, in motion: the mechanics' equations, with a motor for each tendon and with tilt.

Torsion, shortening, silicone, guide friction, lever, drive, rod and head are those of `sinew.mechanics`. Added are the
motors of the tendons, and for a joint whose head has no inertia across its axis the tilt of that head.

A tendon's cable of stiffness k_c ends on the horn of its motor, which has taken up h of it: T = k_c (ℓ - ℓ_0 + h) where
taut. The motor wants a tension: by position, that of a spring of compliance 1/k_c + 1/k_servo whose end is at the wound
length w, up to a limit; else a set one. It gets it as long as the horn need not turn faster than the motor can under
that load; at that speed T follows from h. As in the twin, what the motion of the joint itself asks of the horn costs no
speed.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.measure.units import STANDARD_GRAVITY
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
    space_at_rest,
    state_rate,
    tendon_spans,
    twist_and_tilt,
)
from sinew.mechanics.tendons import span_lengths
from sinew.plan.rig import RigSpec
from sinew.solve.march import STAGE_TIMES, next_stage
from sinew.solve.rest import set_pretension
from sinew.solve.spatial import first_contact, in_mode, linear_equations, settle, slow_down, stays_upright
from sinew.twin.parameters import from_rig, space_from_rig

TICK_S = 1.25e-3
"""Time between two states of the joint [s]."""

FAR = 1e3
"""No bound: of a length [m] or a speed [m/s]."""

TILT_DAMPING = 0.3
"""Damping of the tilt [N m s/rad]; assumed."""


class Now(NamedTuple):
    """All that changes with time.

    motion: what is integrated, a `Tilting`, or the state of `mechanics.space`. By tendon, (tendon,): cable taken up by
    each motor, `horn` h [m], its speed [m/s]; wound: where its position loop's spring ends, w [m]; span: ℓ [m];
    tension: T [N]. goal: the drive's goal on its way [rad].
    """

    motion: Any
    horn: Any
    horn_speed: Any
    wound: Any
    span: Any
    tension: Any
    goal: Any


class TendonOrder(NamedTuple):
    """What the host asks of the tendon motors, (tendon,) each.

    cable_end: ℓ_0, where the cable goes slack with nothing taken up [m]. goal: of w [m], approached at `speed` [m/s].
    compliance: of the servo [m/N]. limit: of the tension wanted [N]. duty: the largest. stall: tension at full duty
    [N]. fastest: speed of the unloaded horn at full duty [m/s]; wind_cap: bound on its speed when it takes up cable.
    may_wind, may_pay: 1 where the horn may turn that way. follows: 1 where w starts from the horn at each step.
    """

    cable_end: Any
    goal: Any = FAR
    speed: Any = 0.0
    compliance: Any = 0.0
    limit: Any = 0.0
    duty: Any = 1.0
    stall: Any = 1.0
    fastest: Any = 0.0
    wind_cap: Any = FAR
    may_wind: Any = 1.0
    may_pay: Any = 1.0
    follows: Any = 0.0


class DriveOrder(NamedTuple):
    """What the host asks of the drive.

    duty = clip(feed + gain (goal on its way - angle) - speed_gain speed, ±duty_limit), its torque within ±torque_limit;
    or torque, within what the duty allows, where by_torque is 1; or none where on is 0. speed: at which the goal is
    approached [rad/s], jump: by how much it moves at once [rad]. duty_torque: of full duty at standstill [N m].
    push: what pushes the head from outside [N m].
    """

    push: Any = 0.0
    duty_torque: Any = 0.0
    duty_limit: Any = 0.0
    torque_limit: Any = 0.0
    on: Any = 0.0
    goal: Any = 0.0
    speed: Any = 0.0
    jump: Any = 0.0
    gain: Any = 0.0
    speed_gain: Any = 0.0
    feed: Any = 0.0
    torque: Any = 0.0
    by_torque: Any = 0.0


def _numbered(like: Any) -> Any:
    """Return the same with indices in place of its numbers, counted from 0."""
    flat, parts = ravel_pytree(jax.tree.map(jnp.asarray, like))
    where = jax.tree.map(lambda leaf: np.asarray(leaf).astype(int), parts(jnp.arange(flat.size, dtype=flat.dtype)))
    return jax.tree.map(lambda leaf: leaf if leaf.ndim else int(leaf), where)


Forces = Callable[..., tuple[Any, Now, Any]]
"""(time since the step began, what is integrated, `Now` as the last step left it, orders of tendons and drive,
constants, length of a step, time since that `Now` or 0) to (derivative, `Now` at the step's begin, what is seen)."""


Example = Callable[[type[GuideFriction]], tuple[Any, Any]]
"""A law of guide friction to (what is integrated, what is seen), of zeros."""


@cache
def marcher(forces: Forces, example: Example, tendons: int, guides: type[GuideFriction]) -> tuple[Now, Any, Any]:
    """Return of a kind of joint (where `Now` and what is seen are in the vector of numbers that comes back, as indices;
    function). The function takes the numbers of `Now`, the orders (order, tendon) and those of the drive with length
    [s] and number of the steps behind them, and the constants; it returns the numbers after the steps, also none.

    A turn of the loop is one slope of RK4, which is long to compile and stands here once. The last state is seen in one
    more turn. The loop carries vectors, and takes its constants from one, so that it is a run of few kernels.
    """
    motion, seen = example(guides)
    where, seen_at = _numbered((Now(motion, *(np.zeros(tendons),) * 5, goal=0.0), seen))

    @jax.jit
    def march(now: Array, tendons: Array, drive: Array, constants: Any) -> jax.Array:
        fixed, whole = ravel_pytree(constants)
        step_s, turns = jnp.asarray(drive)[-2], 4 * jnp.asarray(drive)[-1].astype(int) + 1
        begun, state = ravel_pytree(_placed(now, where).motion)

        def turn(n: jax.Array, carry: Any) -> Any:
            begun, here, gone, before, seen = carry
            # the barrier, for the compiler would carry each number of them on its own
            numbers = jax.lax.optimization_barrier((tendons, drive, fixed))  # type: ignore[no-untyped-call]
            order, drive_order = TendonOrder(*jnp.asarray(numbers[0])), DriveOrder(*jnp.asarray(numbers[1])[:-2])
            stage = n % 4
            passed = jnp.where((stage == 0) & (n > 0), step_s, 0.0)
            time_s = jnp.asarray(STAGE_TIMES)[stage] * step_s
            at = _placed(before, where)
            slope, *fresh = forces(time_s, state(here), at, order, drive_order, whole(numbers[2]), step_s, passed)
            held = [jnp.where(stage == 0, _flat(new), old) for new, old in zip(fresh, (before, seen), strict=True)]
            return *next_stage(stage, begun, gone, _flat(slope), step_s), *held

        carry = (begun, begun, jnp.zeros_like(begun), jnp.asarray(now), jnp.zeros(_flat(seen).size))
        *_, last, seen_last = jax.lax.fori_loop(0, turns, turn, carry)
        return jnp.concatenate([last, seen_last])

    return where, seen_at, march


def _placed(vector: Any, where: Any) -> Any:
    """Return the numbers of a vector in their places."""
    return jax.tree.map(jnp.asarray(vector).__getitem__, where)


def _flat(tree: Any) -> jax.Array:
    return ravel_pytree(tree)[0]


class Reach(NamedTuple):
    """How the motors may turn in a step, (tendon,) each: start [m] and speed [m/s] of w, speeds at which the horn may
    wind and pay out."""

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


def goal_after(time_s: Any, start: jax.Array, drive: DriveOrder) -> jax.Array:
    """Return the drive's goal on its way [rad], a time after it was at `start`."""
    reach = drive.speed * time_s + drive.jump
    return start + jnp.clip(drive.goal - start, -reach, reach)


Vector = tuple[float, float, float]
Head = tuple[float, float, tuple[float, float], Vector, Vector]
"""How the head moves, what of `plant.Motion` is its own: torsion and its rate, tilt, gyro and acceleration."""


class Body(ABC):
    """A joint behind motors, compiled: upright, or in space.

    p: of the torsional joint. where, seen_at: `Now` and what is seen, in the numbers; lever, lever_rate: of the drive.
    steps: in a tick. first_end: the twin's cable end at first contact [m].
    """

    lever: int
    lever_rate: int
    steps: int
    first_end: float

    def __init__(self, spec: RigSpec, constants: Any, p: Parameters, forces: Forces, example: Example) -> None:
        self.p, self._chip = p, spec.imu.mount_radius.value
        self._constants = jax.tree.map(lambda value: jnp.asarray(value, dtype=float), constants)
        self.where, self.seen_at, self._march = marcher(forces, example, spec.tendons.count, type(spec.tendons.guides))

    def move_on(self, now: Array, tendons: Array, drive: Array) -> Array:
        """Return the numbers of `now` and what is seen after the steps that the vectors ask for."""
        return np.asarray(self._march(now, tendons, drive, self._constants))

    @abstractmethod
    def begin(self, now: Array) -> Array:
        """Put the unpulled joint at rest into a vector of zeros; return the lengths of its tendons [m], (tendon,)."""

    @abstractmethod
    def head(self, seen: list[float], late: float) -> Head:
        """Return how the head moves, `late` after the last tick [s]."""


# ---- a head that twists and sinks, and tilts without inertia
#
# The head tilts by t about y and z of frame B: c dt/dt = -∂V/∂t, V holding the tendons' lengths at the tilted pose and
# the bending energy ½ (E I/L) |t - t_0|², I about the weaker axis. Neither the head's inertia across its axis nor the
# damping of that swing is known, and levelling asks only where the plate comes to rest and how soon: with
# `TILT_DAMPING`, in 5 ms on locked tendons and in 65 ms on light constant tensions. Constant tensions bend an arc
# further, by n T L²/(12 E I) of its tilt, and would topple it where that reaches one.


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


class Seen(NamedTuple):
    """What follows from the present: torsion acceleration [rad/s²], tilt rates [rad/s], the drive's torque [N m]."""

    torsion_acceleration: Any
    tilt_rate: tuple[Any, Any]
    torque: Any


def steps_per_tick(joint: Joint, speed: float) -> int:
    """Return how many steps of RK4 a tick needs, so that the fastest motion turns by at most 2 rad in a step.

    speed: the largest of the torsion [rad/s].
    """
    p = joint.p
    grip = len(p.guide_directions) * float(joint.cable_stiffness)
    bending = float(p.bending_rigidity / p.length)
    tilt = (0.5 * grip * max(float(p.head_radius), float(p.base_radius)) ** 2 + bending) / float(joint.damping)
    return max(1, int(np.ceil(TICK_S * max(axial_omega(grip, p), tilt, float(p.guides.fastest(speed))) / 2)))


def _upright_example(guides: type[GuideFriction]) -> tuple[Tilting, Seen]:
    bristles, memory = (0.0,) * len(guides.spread), (0.0,) * BRANCHES
    state = State(*(0.0,) * 6, memory, memory, 0.0, 0.0, bristles)  # type: ignore[arg-type]
    return Tilting(state, (0.0, 0.0)), Seen(0.0, (0.0, 0.0), 0.0)


def _upright_forces(
    time_s: jax.Array,
    at: Tilting,
    now: Now,
    order: TendonOrder,
    drive: DriveOrder,
    joint: Joint,
    step_s: jax.Array,
    passed_s: jax.Array,
) -> tuple[Tilting, Now, Seen]:
    """Return (derivative, motors, what is seen); see `Forces`. What the twist asks of a horn costs no speed."""
    p, k, motion = joint.p, joint.cable_stiffness, at.motion

    def reach(motors: Now) -> Reach:
        state = motors.motion.motion
        twist = jnp.abs(p.base_radius * p.head_radius * jnp.sin(state.torsion) * state.torsion_rate)
        return reach_of(motors.tension, motors.horn, motors.wound, order, twist / motors.span, step_s)

    spans = jnp.stack(span_lengths(motion.torsion, motion.shortening, p, at.tilt))
    horn, wound, tension = turned_horn(spans, now.horn, reach(now), order, k, step_s)
    turned = Now(at, horn, (horn - now.horn) / step_s, wound, spans, tension, goal_after(step_s, now.goal, drive))
    motors: Now = jax.tree.map(lambda new, old: jnp.where(passed_s > 0, new, old), turned, now)
    pull = held_tension(time_s, spans, motors.horn, reach(motors), order, k)

    def energy(torsion: jax.Array, shortening: jax.Array, tilt: tuple[Any, Any]) -> jax.Array:
        stored = silicone_energy(torsion, shortening, p)
        stored += viscoelastic_energy(torsion, shortening, motion.memory, motion.axial_memory, p)
        bent = sum((t - rest) ** 2 for t, rest in zip(tilt, joint.rest_tilt, strict=True))
        stored += 0.5 * p.bending_rigidity / p.length * bent
        return jnp.asarray(
            stored + sum(t * span for t, span in zip(pull, span_lengths(torsion, shortening, p, tilt), strict=True))
        )

    slope = jax.grad(energy, argnums=(0, 1, 2))(motion.torsion, motion.shortening, at.tilt)
    torque = head_torque(slope[0], p.guides.torque(pull.sum(), motion.bristles), motion, p) + drive.push
    pulled = drive_torque(time_s, motion, motors.goal, drive, p)
    lever = free_lever_acceleration(torque, pulled - gear_friction(motion.lever_rate, p), p)
    rate = derivative(motion, torque, slope[1], lever, p)
    tilt_rate = (-slope[2][0] / joint.damping, -slope[2][1] / joint.damping)
    return Tilting(rate, tilt_rate), motors, Seen(rate.torsion_rate, tilt_rate, pulled)


class Upright(Body):
    """A head that twists and sinks, and tilts without inertia."""

    def __init__(self, spec: RigSpec, rest_tilt: tuple[float, float]) -> None:
        joint = Joint(from_rig(spec), spec.tendons.cable_stiffness.value, rest_tilt, TILT_DAMPING)
        super().__init__(spec, joint, joint.p, _upright_forces, _upright_example)
        self._rest_tilt = rest_tilt
        self.steps = steps_per_tick(joint, np.radians(spec.limits.torsion_deg) * 2 * np.pi * spec.limits.drive_hz)
        contact = jnp.asarray(spec.tendons.first_contact_tension.value)
        held, _ = jax.jit(set_pretension)(joint.p, jnp.zeros(()), contact, jnp.asarray(POSITION), jnp.zeros(()))
        self.first_end = float(held.cable_end)
        motion = self.where.motion.motion
        self.lever, self.lever_rate = motion.lever, motion.lever_rate

    def begin(self, now: Array) -> Array:
        now[list(self.where.motion.tilt)] = self._rest_tilt
        zero, tilt = jnp.zeros(()), (jnp.asarray(self._rest_tilt[0]), jnp.asarray(self._rest_tilt[1]))
        return np.asarray(jnp.stack(span_lengths(zero, zero, self.p, tilt)))

    def head(self, seen: list[float], late: float) -> Head:
        where, motion = self.seen_at, self.where.motion.motion
        speed = seen[motion.torsion_rate] + late * seen[where.torsion_acceleration]
        torsion = seen[motion.torsion] + late * seen[motion.torsion_rate]
        gyro = seen[motion.gyro] + late * seen[motion.gyro_rate]
        rate_y, rate_z = (seen[i] for i in where.tilt_rate)
        y, z = (seen[i] for i in self.where.motion.tilt)
        c, s = math.cos(torsion), math.sin(torsion)
        along = self._chip * seen[where.torsion_acceleration]
        tilt, turned = (y + late * rate_y, z + late * rate_z), (gyro, c * rate_y + s * rate_z, c * rate_z - s * rate_y)
        return torsion, speed, tilt, turned, _specific_force((y, z), c, s, -self._chip * speed**2, along)


def _specific_force(tilt: tuple[float, float], c: float, s: float, radial: float, tangential: float) -> Vector:
    """Return the specific force [m/s²] in frame H at (0, r, 0): against gravity, and what the twist adds to it."""
    y, z = tilt
    angle = math.hypot(y, z)
    sine = math.sin(angle) / angle if angle else 1.0
    up_y, up_z = -sine * z, sine * y
    force_y, force_z = c * up_y + s * up_z, c * up_z - s * up_y
    g = STANDARD_GRAVITY
    return g * math.cos(angle), g * force_y + radial, g * force_z + tangential


# ---- the joint in space behind its motors, in motion: the rod with its head, and a motor for each tendon
#
# Rod, head, lever, guides and weight are those of `sinew.mechanics.space`. The head has mass here and tilts as it does
# in the twin, so it sways.
#
# Modes faster than `solve.spatial.FASTEST_OMEGA` are slowed to it, about first contact with every horn held: there the
# cables alone are stiffer than with their motors, so that a tick is one stable step of RK4 in any state of the motors.


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


def _space_example(guides: type[GuideFriction]) -> tuple[SpaceState, SpaceSeen]:
    two, three, strains, memory = np.zeros(2), np.zeros(3), np.zeros((6, TERMS)), np.zeros((BRANCHES, 6, TERMS))
    bristles: Any = (0.0,) * len(guides.spread)
    state = SpaceState(strains, strains, 0.0, 0.0, memory, bristles, three, three)  # type: ignore[arg-type]
    return state, SpaceSeen(0.0, 0.0, two, two, three, three, three, 0.0)


def space_of(spec: RigSpec, rest_tilt: tuple[float, float]) -> tuple[Space, float]:
    """Return (the parameters of a rig whose continuum is bent by `rest_tilt` [rad] when nothing pulls, cables in place
    of cables on motors; mean cable end of the twin at first contact [m]). Raises SpecError for a head that falls over
    while no tendon pulls."""
    space = space_from_rig(spec)
    if not stays_upright(space, 0.0):
        raise SpecError(
            f"rig {spec.name}: its head of {spec.inertia.head_mass.value:g} kg falls over on the silicone while no "
            "tendon holds it, so no bench in space can begin with it; leave --in-space out, or lower inertia.head_mass "
            "or space.head_height"
        )
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


def _space_forces(
    time_s: jax.Array,
    at: SpaceState,
    now: Now,
    order: TendonOrder,
    drive: DriveOrder,
    space: Space,
    step_s: jax.Array,
    passed_s: jax.Array,
) -> tuple[SpaceState, Now, SpaceSeen]:
    """Return (derivative, motors, what is seen) at a state; see `Forces`. The motors are taken through the last step
    first: so lengths of tendons are needed where slopes are, and nowhere else. What twist and sway ask of a horn costs
    no speed."""
    k = space.rod.joint.stiffness
    moved = motion_of(at.q, at.q_rate, at.lever, at.lever_rate, space)
    spans, span_rate = jax.jvp(lambda q: tendon_spans(q, space), (at.q,), (at.q_rate,))
    free = jnp.abs(span_rate)
    before = reach_of(now.tension, now.horn, now.wound, order, free, step_s)
    horn, wound, tension = turned_horn(spans, now.horn, before, order, k, passed_s)
    speed = jnp.where(passed_s > 0, (horn - now.horn) / step_s, now.horn_speed)
    goal = goal_after(passed_s, now.goal, drive)
    goal = jnp.where(passed_s > 0, goal, now.goal)
    motors = Now(at, horn, speed, wound, spans, tension, goal)
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


class InSpace(Body):
    """The head of a rod, with mass. Raises SpecError for a rig that tells no masses."""

    steps = 1

    def __init__(self, spec: RigSpec, rest_tilt: tuple[float, float]) -> None:
        space, self.first_end = space_of(spec, rest_tilt)
        super().__init__(spec, space, space.rod.joint, _space_forces, _space_example)
        self._space = jax.tree.map(jnp.asarray, space)
        motion = self.where.motion
        self.lever, self.lever_rate = motion.lever, motion.lever_rate

    def begin(self, now: Array) -> Array:
        slack = self._space._replace(held_tension=np.zeros_like(self._space.held_tension))
        q = jnp.asarray(settle(np.zeros((6, TERMS)), slack)[0])  # as it hangs while nothing pulls
        motion, state = self.where.motion, space_at_rest(q, self._space)
        now[motion.q], now[motion.memory] = state.q, state.memory
        return np.asarray(tendon_spans(q, self._space))

    def head(self, seen: list[float], late: float) -> Head:
        where, motion = self.seen_at, self.where.motion

        def numbers(indices: Array) -> list[float]:
            return [seen[i] for i in indices]

        def going(now: list[float], rates: list[float]) -> tuple[float, ...]:
            return tuple(a + late * b for a, b in zip(now, rates, strict=True))

        (x, y, z), (turn_x, _, turn_z) = numbers(where.spin), numbers(where.spin_rate)
        force, r = numbers(where.force), self._chip
        # what turning gives a chip at (0, r, 0): α x p + ω x (ω x p)
        chip = (force[0] + r * (x * y - turn_z), force[1] - r * (x * x + z * z), force[2] + r * (y * z + turn_x))
        torsion, rate = seen[where.torsion], seen[where.torsion_rate]
        tilt, gyro = (
            going(numbers(where.tilt), numbers(where.tilt_rate)),
            going(*map(numbers, (motion.gyro, motion.gyro_rate))),
        )
        return torsion + late * rate, rate, tilt, gyro, chip  # type: ignore[return-value]
