"""Lanes of the joint in time: fixed-step RK4, compiled once, batches on every core."""

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import cache, partial
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array
from sinew.mechanics.drive import commanded_angle, duty
from sinew.mechanics.joint import State, rate, state_at_rest
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.tendons import tendon_stretch

S = TypeVar("S")
Progress = Callable[[float, float], None]

LANES = 64
"""Lanes in one batch: small enough for the second-level cache, large enough to hide the loop's overhead."""

STEPS_PER_SAMPLE = 4
"""Steps of RK4 between samples: 1.25 ms at 200 Hz."""


_LARGEST_GAIN, _FORGOTTEN = 4.0, 2.0


class Track(NamedTuple):
    """What is kept of a lane at every sample: arrays (sample,), SI; see `State`.

    stretch: elongation ℓ - ℓ_c of every tendon [m], (tendon, sample).
    """

    torsion: Array
    torsion_rate: Array
    torsion_acceleration: Array
    shortening: Array
    lever: Array
    lever_rate: Array
    duty: Array
    gyro: Array
    gyro_rate: Array
    stretch: Array


def runge_kutta(slope: Callable[[jax.Array, S], S], time_s: jax.Array, state: S, step_s: jax.Array) -> S:
    """Return the state one step [s] of the classical fourth order later; state: any pytree, slope: its derivative."""

    def moved(rate_there: S, share: float) -> S:
        at: S = jax.tree.map(lambda y, dy: y + share * step_s * dy, state, rate_there)
        return at

    k1 = slope(time_s, state)
    k2 = slope(time_s + 0.5 * step_s, moved(k1, 0.5))
    k3 = slope(time_s + 0.5 * step_s, moved(k2, 0.5))
    k4 = slope(time_s + step_s, moved(k3, 1.0))

    def combined(y: jax.Array, a: jax.Array, b: jax.Array, c: jax.Array, d: jax.Array) -> jax.Array:
        return y + step_s / 6 * (a + 2 * b + 2 * c + d)

    after: S = jax.tree.map(combined, state, k1, k2, k3, k4)
    return after


def _step(time_s: jax.Array, state: State, step_s: jax.Array, p: Parameters) -> State:
    def slope(at: jax.Array, now: State) -> State:
        return rate(at, now, p)

    return runge_kutta(slope, time_s, state, step_s)


def _observe(time_s: jax.Array, state: State, p: Parameters) -> jax.Array:
    goal, _, _ = commanded_angle(time_s, p)
    acceleration = rate(time_s, state, p).torsion_rate
    seen = [
        state.torsion,
        state.torsion_rate,
        acceleration,
        state.shortening,
        state.lever,
        state.lever_rate,
        duty(goal - state.lever, p),
        state.gyro,
        state.gyro_rate,
    ]
    return jnp.stack([*seen, *tendon_stretch(state.torsion, state.shortening, p)])


@partial(jax.jit, static_argnames=("room", "steps"))
def _batch(
    p: Parameters, shortening: jax.Array, sample_s: jax.Array, samples: jax.Array, room: int, steps: int
) -> jax.Array:
    """Return observations (room, lane, channel) of one batch; only the first `samples` are filled."""
    step_s = sample_s / steps
    states = jax.vmap(state_at_rest)(shortening, p)

    def substep(j: int, carry: tuple[jax.Array, State]) -> tuple[jax.Array, State]:
        time_s, now = carry
        at = time_s + j * step_s
        return time_s, jax.vmap(_step, in_axes=(None, 0, None, 0))(at, now, step_s, p)

    def sample(n: int, carry: tuple[State, jax.Array]) -> tuple[State, jax.Array]:
        now, kept = carry
        time_s = n * sample_s
        seen = jax.vmap(_observe, in_axes=(None, 0, 0))(time_s, now, p)
        kept = jax.lax.dynamic_update_index_in_dim(kept, seen, n, axis=0)
        _, now = jax.lax.fori_loop(0, steps, substep, (time_s, now))
        return now, kept

    channels = len(Track._fields) - 1 + len(p.guide_directions)
    kept = jnp.zeros((room, shortening.shape[0], channels))
    _, filled = jax.lax.fori_loop(0, samples, sample, (states, kept))
    return jnp.asarray(filled)


def steps_per_sample(p: Parameters, sample_s: float) -> int:
    """Return how many steps of RK4 a sample [s] needs: `STEPS_PER_SAMPLE`, more where guides follow faster than that.

    For torsions up to four times the command: no bristle may forget more than two time constants in a step.
    """
    speed = _LARGEST_GAIN * np.asarray(p.amplitude) * np.asarray(p.omega)
    return max(STEPS_PER_SAMPLE, math.ceil(sample_s * float(np.max(p.guides.fastest(speed))) / _FORGOTTEN))


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=os.cpu_count() or 1, thread_name_prefix="sinew-twin")


def integrate(
    p: Parameters,
    shortening: Array,
    samples: Sequence[int],
    sample_s: float,
    *,
    steps: int | None = None,
    progress: Progress | None = None,
) -> list[Track]:
    """Return the track of every lane, from rest.

    p: parameters with a leading lane axis on each leaf. shortening: axial shortening at rest [m], (lane,).
    samples: number of samples of each lane. sample_s: time between samples [s]. steps: RK4 steps between samples, else
    `steps_per_sample`.
    progress: called with (done, total) simulated seconds after each batch.

    Lanes are sorted by length and cut into batches of `LANES` that run on all cores; the compiled code is the same
    for all batches, so it is compiled once (and kept in the persistent cache).
    """
    steps = steps or steps_per_sample(p, sample_s)
    order = np.argsort(samples, kind="stable")
    batches = [order[i : i + LANES] for i in range(0, order.size, LANES)]
    room = int(np.ceil(max(samples) / 256) * 256)
    total, done = float(np.sum(samples)) * sample_s, 0.0
    tracks: dict[int, Track] = {}

    def run(lanes: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array]:
        padded = np.concatenate([lanes, np.full(LANES - lanes.size, lanes[-1])])
        chunk = jax.tree.map(lambda leaf: np.asarray(leaf)[padded], p)
        longest = max(samples[i] for i in lanes)
        kept = _batch(chunk, shortening[padded], np.float64(sample_s), np.int64(longest), room, steps)
        return lanes, np.asarray(kept)

    for future in as_completed([_pool().submit(run, lanes) for lanes in batches]):
        lanes, kept = future.result()
        for column, lane in enumerate(lanes):
            rows = kept[: samples[lane], column].T.copy()
            single = len(Track._fields) - 1
            tracks[int(lane)] = Track(*rows[:single], stretch=rows[single:])  # type: ignore[misc]
            done += samples[lane] * sample_s
        if progress is not None:
            progress(done, total)
    return [tracks[lane] for lane in range(len(samples))]
