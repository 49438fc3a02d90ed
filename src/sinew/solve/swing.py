"""Lanes of the joint in space in time: small batches on every core, compiled once for all lengths."""

import itertools
import math
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array
from sinew.mechanics.drive import commanded_angle, duty
from sinew.mechanics.space import Motion, Pull, Space, SpaceState, cable_ends, space_at_rest, space_derivative
from sinew.solve.march import Progress, in_batches, runge_kutta_samples, steps_per_sample

LANES = 8
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
    place: Array
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


def _observe(
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
        return after, _observe(time_s, state, after, moved, felt, own)

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

    return [_split(rows) for rows in in_batches(run, samples, LANES, sample_s, progress)]
