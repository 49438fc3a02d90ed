"""Motion of the joint under a lever that was measured: the twin's equations, with derivatives.

The drive plays no part: its horn is wherever the encoder says it was. Everything else is the twin's own.
"""

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.identify.joint.coordinates import Numbers
from sinew.identify.joint.swing import Swing
from sinew.measure.arrays import Array
from sinew.mechanics.joint import State, axial_omega, derivative, head_forces, state_at_rest
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.tendons import total_tension
from sinew.plan.rig import LIMIT_RESERVE_N
from sinew.solve.rest import set_pretension
from sinew.twin.cache import configure

CHANNELS = ("gyro", "current")
"""What is simulated: the gyroscope's rate before its average over samples [rad/s]; a tendon motor's current [A]."""

_LANES = 16
_FEWEST_STEPS = 2
_LARGEST_PHASE = 1.8  # of the axial motion in a step of RK4 [rad]; it is unstable beyond 2.8
_FASTEST_TORSION = 30.0  # that guides are stepped for [rad/s]
_ROOM = 1024  # samples: few different ones, so that few are compiled for
_DIRECTIONS = 9  # fewer are filled up with zeros, for the same reason


class Seen(NamedTuple):
    """What the sensors of one swing would say, and how that changes.

    values: shape (n, channel). slopes: shape (k, n, channel), over the directions that were asked for, the last two
    being the deviation of the pretension [m] and the relative one of the guide friction; None if not asked for.
    """

    values: Array
    slopes: Array | None


class _Lane(NamedTuple):
    """One swing for the compiled code: pretension [m], mode, deviations, time step [s], lever acceleration."""

    pretension: jax.Array
    mode: jax.Array
    moved: jax.Array
    rougher: jax.Array
    step_s: jax.Array
    acceleration: jax.Array


def steps_per_sample(numbers: Numbers, sample_s: float) -> int:
    """Return how many steps of RK4 a sample needs: the head's fast axial motion and the guides have to stay stable."""
    p = numbers.p
    omega = axial_omega(len(p.guide_directions) * float(p.stiffness), p)
    bristles = float(p.guides.fastest(_FASTEST_TORSION))
    return max(_FEWEST_STEPS, math.ceil(max(omega, bristles) * sample_s / _LARGEST_PHASE))


def _step(state: State, push: jax.Array, step_s: jax.Array, p: Parameters) -> State:
    """Return the state a step of RK4 later; push: lever acceleration at its begin, middle and end, shape (3,).

    The stages are a loop, not the twin's four calls: with derivatives those take four times as long to compile.
    """
    share, weight = jnp.array([0.0, 0.5, 0.5, 1.0]), jnp.array([1.0, 2.0, 2.0, 1.0]) / 6
    which = jnp.array([0, 1, 1, 2])

    def stage(i: jax.Array, carry: tuple[State, State]) -> tuple[State, State]:
        before, after = carry
        at: State = jax.tree.map(lambda y, dy: y + share[i] * step_s * dy, state, before)
        slope = derivative(at, *head_forces(at, p), push[which[i]], p)
        return slope, jax.tree.map(lambda y, dy: y + weight[i] * step_s * dy, after, slope)

    still: State = jax.tree.map(jnp.zeros_like, state)
    reached: State = jax.lax.fori_loop(0, 4, stage, (still, state))[1]
    return reached


def _observe(state: State, p: Parameters, numbers: Numbers) -> jax.Array:
    tension = total_tension(state.torsion, state.shortening, p) / len(p.guide_directions)
    return jnp.stack([state.gyro - numbers.delay * state.gyro_rate, tension * numbers.current_per_tension])


def _set(lane: _Lane, numbers: Numbers) -> tuple[Parameters, State]:
    p = numbers.p._replace(guides=numbers.p.guides.scaled(1 + lane.rougher))
    reserve = jnp.asarray(LIMIT_RESERVE_N)
    held, shortening = set_pretension(p, lane.pretension + lane.moved, numbers.contact, lane.mode, reserve)
    return held, state_at_rest(shortening, held)


def _simulate(lanes: _Lane, numbers: Numbers, samples: jax.Array, steps: jax.Array, room: int) -> jax.Array:
    """Return what is seen of every lane, (room, lane, channel); only the first `samples` are filled."""
    p, begin = jax.vmap(_set, in_axes=(0, None))(lanes, numbers)
    acceleration = lanes.acceleration.T

    def substep(j: jax.Array, now: State) -> State:
        push = jax.lax.dynamic_slice_in_dim(acceleration, 2 * j, 3, axis=0)
        after: State = jax.vmap(_step, in_axes=(0, 1, 0, 0))(now, push, lanes.step_s, p)
        return after

    def sample(n: jax.Array, carry: tuple[State, jax.Array]) -> tuple[State, jax.Array]:
        now, kept = carry
        seen = jax.vmap(_observe, in_axes=(0, 0, None))(now, p, numbers)
        kept = jax.lax.dynamic_update_index_in_dim(kept, seen, n, axis=0)
        return jax.lax.fori_loop(n * steps, (n + 1) * steps, substep, now), kept

    kept = jnp.zeros((room, lanes.step_s.shape[0], len(CHANNELS)))
    return jnp.asarray(jax.lax.fori_loop(0, samples, sample, (begin, kept))[1])


@partial(jax.jit, static_argnames=("room",))
def _values(lanes: _Lane, numbers: Numbers, samples: jax.Array, steps: jax.Array, room: int) -> jax.Array:
    return _simulate(lanes, numbers, samples, steps, room)


@partial(jax.jit, static_argnames=("room",))
def _values_and_slopes(
    lanes: _Lane, numbers: Numbers, directions: Numbers, samples: jax.Array, steps: jax.Array, room: int
) -> tuple[jax.Array, jax.Array]:
    """Return values (room, lane, channel) and slopes (k, room, lane, channel); directions: leaves with an axis k."""

    def seen(each: Numbers, moved: jax.Array, rougher: jax.Array) -> jax.Array:
        return _simulate(lanes._replace(moved=moved, rougher=rougher), each, samples, steps, room)

    count = directions.contact.shape[0]
    where = (numbers, lanes.moved, lanes.rougher)
    deviating = jnp.eye(2, count + 2, count)[:, :, None] * jnp.ones(lanes.moved.shape)
    padded = jax.tree.map(lambda leaf: jnp.concatenate([leaf, jnp.zeros((2, *leaf.shape[1:]))]), directions)

    def along(direction: Numbers, moved: jax.Array, rougher: jax.Array) -> tuple[jax.Array, jax.Array]:
        values, slopes = jax.jvp(seen, where, (direction, moved, rougher))
        return jnp.asarray(values), jnp.asarray(slopes)

    found: tuple[jax.Array, jax.Array] = jax.vmap(along, out_axes=(None, 0))(padded, deviating[0], deviating[1])
    return found


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=os.cpu_count() or 1, thread_name_prefix="sinew-joint")


def simulate_swings(
    swings: Sequence[Swing],
    numbers: Numbers,
    deviations: Array,
    steps: int,
    directions: Numbers | None = None,
) -> list[Seen]:
    """Return what the sensors would say of every swing, from rest, at its samples.

    deviations: of pretension [m] and guide friction [1], shape (swing, 2). steps: between samples.
    directions: along which slopes are wanted, a stack of numbers (k,) on each leaf; the deviations are added to them.

    Swings are sorted by length and cut into batches of `_LANES`, so that one compilation does for all.
    """
    configure()
    wanted = 0 if directions is None else directions.contact.shape[0]
    filled = None if directions is None else jax.tree.map(_filled, directions)
    order = np.argsort([swing.size for swing in swings], kind="stable")
    room = math.ceil((max(swing.size for swing in swings) + 1) / _ROOM) * _ROOM
    found: dict[int, Seen] = {}

    def run(mine: NDArray[np.intp]) -> None:
        padded = np.concatenate([mine, np.full(_LANES - mine.size, mine[-1])])
        lanes = _lanes([swings[i] for i in padded], deviations[padded], steps, room)
        longest = np.int64(max(swings[i].size for i in mine))
        slopes = None
        if filled is None:
            values = np.asarray(_values(lanes, numbers, longest, np.int64(steps), room))
        else:
            both = _values_and_slopes(lanes, numbers, filled, longest, np.int64(steps), room)
            values, slopes = np.asarray(both[0]), np.asarray(both[1])
        for column, i in enumerate(mine):
            size = swings[i].size
            own = None
            if slopes is not None:
                own = np.concatenate([slopes[:wanted, :size, column], slopes[-2:, :size, column]])
            found[int(i)] = Seen(values[:size, column].copy(), own)

    for _ in _pool().map(run, [order[i : i + _LANES] for i in range(0, order.size, _LANES)]):
        pass
    return [found[i] for i in range(len(swings))]


def _filled(leaf: Array) -> Array:
    return np.concatenate([leaf, np.zeros((max(0, _DIRECTIONS - leaf.shape[0]), *leaf.shape[1:]))])


def _lanes(swings: Sequence[Swing], deviations: Array, steps: int, room: int) -> _Lane:
    acceleration = np.zeros((len(swings), 2 * steps * room + 1))
    for row, swing in zip(acceleration, swings, strict=True):
        given = swing.lever_acceleration(steps)
        row[: given.size] = given
    return _Lane(
        np.array([swing.pretension_mm * 1e-3 for swing in swings]),  # type: ignore[arg-type]
        np.array([swing.mode for swing in swings]),  # type: ignore[arg-type]
        deviations[:, 0],  # type: ignore[arg-type]
        deviations[:, 1],  # type: ignore[arg-type]
        np.array([swing.sample_s / steps for swing in swings]),  # type: ignore[arg-type]
        acceleration,  # type: ignore[arg-type]
    )
