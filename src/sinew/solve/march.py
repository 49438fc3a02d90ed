"""Lanes of the joint in time: fixed-step RK4, compiled once, batches on every core."""

import itertools
import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import cache, partial
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from numpy.typing import NDArray

from sinew.measure.arrays import Array
from sinew.measure.tasks import cores
from sinew.mechanics.drive import commanded_angle, duty
from sinew.mechanics.joint import State, rate, state_at_rest
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.space import Motion, Pull, Space, SpaceState, cable_ends, space_at_rest, space_derivative
from sinew.mechanics.tendons import as_one_tendon, tendon_stretch
from sinew.solve.programs import program

S = TypeVar("S")
K = TypeVar("K")
Progress = Callable[[float, float], None]

LANES = 64
"""Lanes in one batch: small enough for the second-level cache, large enough to hide the loop's overhead."""

_LANES_OF_A_GPU = 4096  # each of its kernels takes as long for one lane as for thousands

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

    slope = jax.jit(slope)  # so that what stands here four times is traced and lowered once
    k1 = slope(time_s, state)
    k2 = slope(time_s + 0.5 * step_s, moved(k1, 0.5))
    k3 = slope(time_s + 0.5 * step_s, moved(k2, 0.5))
    k4 = slope(time_s + step_s, moved(k3, 1.0))

    def combined(y: jax.Array, a: jax.Array, b: jax.Array, c: jax.Array, d: jax.Array) -> jax.Array:
        return y + step_s / 6 * (a + 2 * b + 2 * c + d)

    after: S = jax.tree.map(combined, state, k1, k2, k3, k4)
    return after


STAGE_TIMES = np.array([0.0, 0.5, 0.5, 1.0])
"""When each of the four slopes of a step is taken, as shares of the step."""

_SHARES = np.array([0.5, 0.5, 1.0, 0.0])  # of a step to where the next of its four slopes is taken
_WEIGHTS = np.array([1.0, 2.0, 2.0, 1.0]) / 6


def next_stage(stage: jax.Array, begun: S, gone: S, slope: S, step_s: jax.Array) -> tuple[S, S, S]:
    """Return (state at the begin of the step, state where the next slope is taken, sum of the step's slopes), the slope
    of a stage 0 to 3 being known: `runge_kutta` by single slopes. begun, gone: what it returned a stage before."""
    gone = jax.tree.map(lambda total, dy: total + jnp.asarray(_WEIGHTS)[stage] * dy, gone, slope)
    last = stage == 3

    def moved(y: jax.Array, dy: jax.Array, whole: jax.Array) -> jax.Array:
        return y + step_s * jnp.where(last, whole, jnp.asarray(_SHARES)[stage] * dy)

    here: S = jax.tree.map(moved, begun, slope, gone)
    begun = jax.tree.map(lambda old, new: jnp.where(last, new, old), begun, here)
    return begun, here, jax.tree.map(lambda total: jnp.where(last, 0.0, total), gone)


def runge_kutta_samples(
    slope: Callable[[jax.Array, S], tuple[S, K]],
    start_s: jax.Array,
    state: S,
    sample_s: jax.Array,
    samples: jax.Array,
    steps: jax.Array,
    room: int,
) -> tuple[S, K]:
    """Return (state after some samples, what was seen at each of them (room, ...)); the method of `runge_kutta`.

    slope: returns the derivative and what is seen there. steps: of each sample. A slope that is long to compile, which
    stands four times in `runge_kutta` and once more in what is seen, stands here once: a turn of the loop is one
    evaluation, and what is seen is of the first one of a sample. The loop carries a state as one vector: with an array
    for each of its parts a fifth of the loop's kernels moved them about.
    """
    step_s = sample_s / steps
    first = jax.eval_shape(slope, start_s, state)[1]
    flat, parts = ravel_pytree(state)
    track = jax.tree.map(lambda leaf: jnp.zeros((room + 1, *leaf.shape), leaf.dtype), first)

    def turn(
        n: jax.Array, carry: tuple[jax.Array, jax.Array, jax.Array, K]
    ) -> tuple[jax.Array, jax.Array, jax.Array, K]:
        begun, here, gone, rows = carry
        stage, step = n % 4, n // 4
        rate_here, seen = slope(start_s + (step + jnp.asarray(STAGE_TIMES)[stage]) * step_s, parts(here))
        row = jnp.where(n % (4 * steps) == 0, step // steps, room)
        rows = jax.tree.map(lambda r, one: jax.lax.dynamic_update_index_in_dim(r, one, row, axis=0), rows, seen)
        return *next_stage(stage, begun, gone, ravel_pytree(rate_here)[0], step_s), rows

    carry = (flat, flat, jnp.zeros_like(flat), track)
    end, _, _, track = jax.lax.fori_loop(0, samples * steps * 4, turn, carry)
    return parts(end), jax.tree.map(lambda leaf: leaf[:room], track)


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


@program(static=("room", "steps"))
def _batch(
    p: Parameters, shortening: jax.Array, sample_s: jax.Array, samples: jax.Array, room: int, steps: int
) -> jax.Array:
    """Return observations (room, lane, channel) of one batch; only the first `samples` are filled. The tendons all do
    the same; the last channel is the stretch of each."""
    p = as_one_tendon(p)
    step_s = sample_s / steps
    states = jax.vmap(state_at_rest)(shortening, p)

    def substep(j: int, carry: tuple[jax.Array, State]) -> tuple[jax.Array, State]:
        time_s, now = carry
        at = time_s + j * step_s
        return time_s, jax.vmap(_step, in_axes=(None, 0, None, 0))(at, now, step_s, p)

    def sample(n: int, carry: tuple[State, jax.Array]) -> tuple[State, jax.Array]:
        now, tracks = carry
        time_s = n * sample_s
        seen = jax.vmap(_observe, in_axes=(None, 0, 0))(time_s, now, p)
        tracks = jax.lax.dynamic_update_index_in_dim(tracks, seen, n, axis=0)
        _, now = jax.lax.fori_loop(0, steps, substep, (time_s, now))
        return now, tracks

    tracks = jnp.zeros((room, shortening.shape[0], len(Track._fields)))
    _, filled = jax.lax.fori_loop(0, samples, sample, (states, tracks))
    return jnp.asarray(filled)


def steps_per_sample(p: Parameters, sample_s: float) -> int:
    """Return how many steps of RK4 a sample [s] needs: `STEPS_PER_SAMPLE`, more where guides follow faster than that.

    For torsions up to four times the command: no bristle may forget more than two time constants in a step.
    """
    speed = _LARGEST_GAIN * np.asarray(p.amplitude) * np.asarray(p.omega)
    return max(STEPS_PER_SAMPLE, math.ceil(sample_s * float(np.max(p.guides.fastest(speed))) / _FORGOTTEN))


def lanes_together(count: int) -> int:
    """Return how many of some lanes are one batch on the device that computes: a multiple of `LANES`."""
    return LANES if jax.default_backend() == "cpu" else min(_LANES_OF_A_GPU, -(-count // LANES) * LANES)


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=cores(), thread_name_prefix="sinew-twin")


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

    Lanes are sorted by length and cut into batches that run on all cores; the compiled code is the same
    for all batches, so it is compiled once (and kept in the persistent cache).
    """
    steps = steps or steps_per_sample(p, sample_s)
    room = int(np.ceil(max(samples) / 256) * 256)

    def run(lanes: NDArray[np.intp], longest: int) -> Array:
        chunk = jax.tree.map(lambda leaf: np.asarray(leaf)[lanes], p)
        return np.asarray(_batch(chunk, shortening[lanes], np.float64(sample_s), np.int64(longest), room, steps))

    tracks = in_batches(run, samples, lanes_together(len(samples)), sample_s, progress)
    single = len(Track._fields) - 1
    tendons = len(p.guide_directions)  # all do the same
    return [
        Track(*rows[:single], stretch=np.broadcast_to(rows[single], (tendons, rows.shape[1])))  # type: ignore[misc]
        for rows in tracks
    ]


def in_batches(
    run: Callable[[NDArray[np.intp], int], Array],
    samples: Sequence[int],
    size: int,
    sample_s: float,
    progress: Progress | None,
) -> list[Array]:
    """Return what is kept of every lane, (channel, sample).

    run: returns (sample, lane, channel) of a batch of `size` lanes, given by number, and the number of samples of the
    longest. samples: of each lane. Lanes are sorted by length, the longest first, so that no core is left with one of
    them at the end, and shared out evenly over as few batches as hold them, which are filled up; all cores work.
    """
    order = np.argsort(samples, kind="stable")[::-1]
    batches = np.array_split(order, -(-order.size // size))
    total, done = float(np.sum(samples)) * sample_s, 0.0
    rows: dict[int, Array] = {}

    def march(lanes: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array]:
        padded = np.concatenate([lanes, np.full(size - lanes.size, lanes[-1])])
        return lanes, run(padded, max(samples[i] for i in lanes))

    for future in as_completed([_pool().submit(march, lanes) for lanes in batches]):
        lanes, tracks = future.result()
        for column, lane in enumerate(lanes):
            rows[int(lane)] = tracks[: samples[lane], column].T.copy()
            done += samples[lane] * sample_s
        if progress is not None:
            progress(done, total)
    return [rows[lane] for lane in range(len(samples))]


# ---- lanes of the joint in space: small batches on every core, compiled once for all lengths

SPACE_LANES = 8
"""Lanes in one batch."""

CHUNK = 256
"""Samples that are marched in one call of the compiled code."""

STEPS_PER_PERIOD = 280
"""Steps of RK4 in a period of the drive. Twice in it the gear's friction turns round, in 0.1 ms at 5.5 Hz, and the duty
leaves its limit; what a step gets wrong there grows with the frequency. With so many the energy of a run of five
seconds is kept within 1e-6 of what was put in; with four in a sample, at 5.5 Hz, within 5e-6."""


class Swing(NamedTuple):
    """What is kept of a lane at every sample: arrays (..., sample), SI; see `SpaceState`.

    turned: columns of the head's rotation in B, one after the other (9, sample); place, acceleration: of the head
    plate's centre in B; spin, spin_rate: true angular velocity of the head in its own axes; gyro, gyro_rate: behind
    the gyroscope's low-pass; all (3, sample). stretch: elongation of every tendon; take_up: what its motor has wound
    up since the start (tendon, sample) [m].
    """

    turned: Array
    position: Array
    acceleration: Array
    spin: Array
    spin_rate: Array
    gyro: Array
    gyro_rate: Array
    lever: Array
    lever_rate: Array
    duty: Array
    stretch: Array
    take_up: Array

    @property
    def rotations(self) -> Array:
        """Return the head's rotation matrices (sample, 3, 3)."""
        return np.moveaxis(self.turned.reshape(3, 3, -1), (0, 1, 2), (2, 1, 0))


def _observe_space(
    time_s: jax.Array, state: SpaceState, after: SpaceState, moved: Motion, felt: Pull, space: Space
) -> jax.Array:
    goal, _, _ = commanded_angle(time_s, space.rod.joint)
    sections, rates, speeding = moved.sections, moved.rates, after.q_rate.ravel()
    head, plate, end = sections.turned[-1], sections.places[-1:], np.array([-1], dtype=np.intp)
    pull = (sections.velocities(plate, end) @ speeding + rates.acceleration(plate, end))[0]
    lever = jnp.stack([state.lever, state.lever_rate, duty(goal - state.lever, space.rod.joint)])
    ends = cable_ends(time_s, space)
    return jnp.concatenate(
        [
            head.T.ravel(),
            plate[0],
            pull,
            moved.spin,
            moved.spin_bias + (sections.spins[-1] @ speeding) @ head,
            state.gyro,
            state.gyro_rate,
            lever,
            felt.spans - ends,
            space.cable_end - ends,
        ]
    )


_SIZES = (9, 3, 3, 3, 3, 3, 3)
"""Rows of each of the first fields of a `Swing`; after them come single ones, and tendons."""


def _split(rows: Array) -> Swing:
    edges = [0, *np.cumsum(_SIZES)]
    vectors = [rows[a:b] for a, b in itertools.pairwise(edges)]
    rest = rows[edges[-1] :]
    tendons = (rest.shape[0] - 3) // 2
    return Swing(*vectors, *rest[:3], rest[3 : 3 + tendons], rest[3 + tendons :])  # type: ignore[call-arg]


@partial(jax.jit, donate_argnames=("states",))
def _chunk(
    space: Space, states: SpaceState, start_s: jax.Array, sample_s: jax.Array, samples: jax.Array, steps: jax.Array
) -> tuple[SpaceState, jax.Array]:
    """Return (states of all lanes after some samples, what was seen of them (CHUNK, lane, channel))."""

    def one(time_s: jax.Array, state: SpaceState, own: Space) -> tuple[SpaceState, jax.Array]:
        after, moved, felt = space_derivative(time_s, state, own)
        return after, _observe_space(time_s, state, after, moved, felt, own)

    def all_lanes(time_s: jax.Array, now: SpaceState) -> tuple[SpaceState, jax.Array]:
        return jax.vmap(one, in_axes=(None, 0, 0))(time_s, now, space)

    return runge_kutta_samples(all_lanes, start_s, states, sample_s, samples, steps, CHUNK)


def swing_steps(space: Space, sample_s: float) -> int:
    """Return how many steps of RK4 a sample [s] needs: `steps_per_sample`, more where a lane is driven faster."""
    joint = space.rod.joint
    fastest = float(np.max(np.asarray(joint.omega))) / (2 * math.pi)
    return max(steps_per_sample(joint, sample_s), math.ceil(STEPS_PER_PERIOD * fastest * sample_s))


def swing(
    space: Space,
    q: Array,
    samples: Sequence[int],
    sample_s: float,
    *,
    steps: int | None = None,
    progress: Progress | None = None,
) -> list[Swing]:
    """Return the motion of every lane, from rest.

    space: parameters with a leading lane axis on each leaf, stiff modes slowed by `solve.spatial.slow_down`. q:
    coordinates of the rod at rest (lane, 6, term). samples: number of samples of each lane. sample_s: time between
    them [s]. steps: of RK4 between samples, else `swing_steps` of the lanes of a batch. progress: as of
    `solve.march.integrate`.
    """
    at_rest = jax.vmap(space_at_rest)

    def run(lanes: NDArray[np.intp], longest: int) -> Array:
        own = jax.tree.map(lambda leaf: np.asarray(leaf)[lanes], space)
        between = steps or swing_steps(own, sample_s)
        states = at_rest(jnp.asarray(np.asarray(q)[lanes]), own)
        rows = []
        for begun in range(0, longest, CHUNK):
            count = min(CHUNK, longest - begun)
            states, seen = _chunk(
                own, states, np.float64(begun * sample_s), np.float64(sample_s), np.int64(count), np.int64(between)
            )
            rows.append(np.asarray(seen)[:count])
        return np.concatenate(rows)

    return [_split(rows) for rows in in_batches(run, samples, SPACE_LANES, sample_s, progress)]
