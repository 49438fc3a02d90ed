"""One degree of freedom simulated over a record, with derivatives: fixed-step RK4, compiled once.

In time of 1/ω_r and amplitudes of A (so that all numbers are near one), r being the motion relative to its base,

    r'' + law(r, r', z) = g a(t),

the law being a sum of terms (see `sinew.mechanics.laws`). Friction that sticks has its reversals located inside the
step, and rest where it holds.

What is measured is r (or r', r''), plus g z for the absolute motion over a moving base, plus a rest position that may
drift or creep: offset + drift·t/T, or offset + drift·(1 - exp(-t/τ)).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array
from sinew.mechanics.laws import HISTORIES, NUMBERS, Law, Number
from sinew.solve.programs import program

LOCAL: dict[str, Number] = {
    **NUMBERS,
    "gain": Number("gain", "input gain", 0.5),
    "start": Number("start", "start position", 0.5, (0, 1)),
    "start_rate": Number("start_rate", "start velocity", 0.5, (1, 1)),
    "offset": Number("offset", "offset", 0.5),
    "drift": Number("drift", "drift", 0.5),
    "creep_time": Number("creep_time", "creep time", 2.0, prior=2.0),
    **HISTORIES,
}
"""What a simulation depends on, in this order, each in its normal form; of the gain what matters is a share of it."""

PLACE = {name: i for i, name in enumerate(LOCAL)}
"""Where the numbers of `LOCAL` stand in a vector."""

_FAR = 1e4  # amplitudes: further nothing is followed


class Grid(NamedTuple):
    """Steps and inputs of a simulation, padded to a length that is compiled for.

    step: in 1/ω_r, zero where padded, shape (s,). forcing: a at begin, middle and end of each step, shape (s, 3).
    carried: z at the ends of the steps, shape (s + 1,). time: over the record's length, shape (s + 1,).
    relaxation: relaxation times of the Prony branches in 1/ω_r, shape (b,). amplitude: A where s(r) needs it [rad].
    """

    step: Array
    forcing: Array
    carried: Array
    time: Array
    relaxation: Array
    amplitude: Array


class _Motion(NamedTuple):
    """State: position, rate, and the states of the law's terms."""

    r: jax.Array
    v: jax.Array
    z: tuple[Any, ...]


Values = dict[str, Any]


def _restoring(motion: _Motion, p: Values, law: Law) -> jax.Array:
    return jnp.asarray(law.force(p, jnp.clip(motion.r, -_FAR, _FAR), motion.v, motion.z, sliding=False))


def _rate(motion: _Motion, push: jax.Array, p: Values, law: Law) -> _Motion:
    return _Motion(motion.v, push - _restoring(motion, p, law), law.rate(p, *motion))


def _moved(motion: _Motion, slope: _Motion, step: jax.Array) -> _Motion:
    return _Motion(*jax.tree.map(lambda y, dy: y + step * dy, motion, slope))


def _runge_kutta(motion: _Motion, step: jax.Array, push: jax.Array, p: Values, law: Law) -> _Motion:
    """Return the motion after one step; push: at its begin, middle and end, shape (3,)."""
    k1 = _rate(motion, push[0], p, law)
    k2 = _rate(_moved(motion, k1, 0.5 * step), push[1], p, law)
    k3 = _rate(_moved(motion, k2, 0.5 * step), push[1], p, law)
    k4 = _rate(_moved(motion, k3, step), push[2], p, law)
    return _moved(motion, jax.tree.map(lambda a, b, c, d: (a + 2 * b + 2 * c + d) / 6, k1, k2, k3, k4), step)


def _between(push: jax.Array, share: jax.Array) -> jax.Array:
    """Return the forcing at shares of the step, by the parabola through begin, middle and end."""
    begin, middle, end = push[0], push[1], push[2]
    return begin + share * (4 * middle - 3 * begin - end) + share**2 * 2 * (begin - 2 * middle + end)


def _dry_step(motion: _Motion, step: jax.Array, push: jax.Array, p: Values, law: Law) -> _Motion:
    """Return the motion after one step with dry friction: its reversal, if there is one, is found and stepped to."""
    c = law.limit(p)
    net = push[0] - _restoring(motion._replace(v=jnp.zeros(())), p, law)
    held = (motion.v == 0) & (jnp.abs(net) <= c)
    sign = jnp.where(motion.v == 0, jnp.sign(net), jnp.sign(motion.v))
    straight = _runge_kutta(motion, step, push - c * sign, p, law)

    def reversed_() -> _Motion:
        return _turned_step(motion, straight, step, push, sign, p, law)

    moved = jax.lax.cond(straight.v * sign < 0, reversed_, lambda: straight)
    return _Motion(*jax.tree.map(lambda a, b: jnp.where(held, a, b), motion, moved))


def _turned_step(
    motion: _Motion,
    straight: _Motion,
    step: jax.Array,
    push: jax.Array,
    sign: jax.Array,
    p: Values,
    law: Law,
) -> _Motion:
    """Return the motion after a step in which the rate, of this sign at its begin, reverses or comes to rest."""
    c = law.limit(p)
    share = _turning_share(motion, straight, step, push - c * sign, p, law)
    parts = jnp.array([0.0, 0.5, 1.0])
    before = _between(push, share * parts)
    turned = _runge_kutta(motion, step * share, before - c * sign, p, law)._replace(v=jnp.zeros(()))
    pull = before[2] - _restoring(turned, p, law)
    after = _between(push, share + (1.0 - share) * parts) - c * jnp.sign(pull)
    back = _runge_kutta(turned, step * (1.0 - share), after, p, law)
    return _Motion(*jax.tree.map(lambda a, b: jnp.where(jnp.abs(pull) <= c, a, b), turned, back))


def _turning_share(motion: _Motion, after: _Motion, step: jax.Array, push: jax.Array, p: Values, law: Law) -> jax.Array:
    """Return the share of the step at which the rate is zero, by Newton on its Hermite cubic."""
    begin = step * _rate(motion, push[0], p, law).v
    end = step * _rate(after, push[2], p, law).v
    fall = after.v - motion.v
    c2, c3 = 3 * fall - 2 * begin - end, begin + end - 2 * fall

    def value(s: jax.Array) -> jax.Array:
        return motion.v + s * (begin + s * (c2 + s * c3))

    def slope(s: jax.Array) -> jax.Array:
        steep = begin + s * (2 * c2 + 3 * s * c3)
        return jax.lax.stop_gradient(jnp.where(jnp.abs(steep) < 1e-30, 1.0, steep))

    share = jax.lax.stop_gradient(jnp.clip(-motion.v / jnp.where(fall == 0, 1.0, fall), 0.0, 1.0))
    for _ in range(3):
        share = jax.lax.stop_gradient(jnp.clip(share - value(share) / slope(share), 0.0, 1.0))
    return jnp.clip(share - value(share) / slope(share), 0.0, 1.0)


def _begin(numbers: jax.Array, grid: Grid, law: Law) -> tuple[Values, _Motion]:
    given = {"relaxation": jnp.asarray(grid.relaxation), "amplitude": jnp.asarray(grid.amplitude)}
    p = law.prepared({name: numbers[i] for name, i in PLACE.items()} | given)
    return p, _Motion(p["start"], p["start_rate"], law.begin(p, p["start"], p["start_rate"]))


def _seen(motion: _Motion, push: jax.Array, p: Values, law: Law, order: int) -> jax.Array:
    if order == 2:
        return jnp.asarray(push - law.limit(p) * jnp.sign(motion.v) - _restoring(motion, p, law))
    return jnp.asarray(motion.v if order == 1 else motion.r)


def _step(
    motion: _Motion, p: Values, given: tuple[jax.Array, jax.Array], law: Law, order: int
) -> tuple[_Motion, jax.Array]:
    length, forcing = given
    push = p["gain"] * forcing
    after = (_dry_step if law.sticks else _runge_kutta)(motion, length, push, p, law)
    return after, _seen(after, push[2], p, law, order)


def _measured(moving: jax.Array, p: Values, grid: Grid) -> jax.Array:
    """Return what is measured of a motion: the base's added, and the rest position."""
    time = jnp.asarray(grid.time)
    lasting = jnp.exp(jnp.clip(p["creep_time"], -5.0, 5.0))
    creep = jnp.where(p["creep_time"] > 5.0, time, -jnp.expm1(-time / lasting))
    return jnp.asarray(moving + p["gain"] * grid.carried + p["offset"] + p["drift"] * creep)


@program(static=("law", "order"))
def traced_track(numbers: jax.Array, grid: Grid, law: Law, order: int) -> jax.Array:
    """Return the track as JAX sees it, for programs that are compiled themselves; see `track`. law: `Law.compiled`."""
    p, start = _begin(numbers, grid, law)
    first = _seen(start, p["gain"] * jnp.asarray(grid.forcing)[0, 0], p, law, order)

    def step(motion: _Motion, given: tuple[jax.Array, jax.Array]) -> tuple[_Motion, jax.Array]:
        return _step(motion, p, given, law, order)

    _, rest = jax.lax.scan(step, start, (jnp.asarray(grid.step), jnp.asarray(grid.forcing)))
    return _measured(jnp.concatenate([first[None], rest]), p, grid)


@program(static=("law", "order"))
def traced_slopes(numbers: jax.Array, free: jax.Array, grid: Grid, law: Law, order: int) -> jax.Array:
    """Return the derivatives along the directions in `free`, shape (f, local).

    Motion and derivative go through the steps together. (The derivative of the whole loop, which JAX would make of
    `traced_track`, keeps every step's linearisation and is many times slower.)
    """

    def along(direction: jax.Array) -> jax.Array:
        (p, start), (p_slope, start_slope) = jax.jvp(lambda q: _begin(q, grid, law), (numbers,), (direction,))

        def step(
            carry: tuple[_Motion, _Motion], given: tuple[jax.Array, jax.Array]
        ) -> tuple[tuple[_Motion, _Motion], jax.Array]:
            (after, _), (after_slope, slope) = jax.jvp(
                lambda motion, values: _step(motion, values, given, law, order), (carry[0], p), (carry[1], p_slope)
            )
            return (after, after_slope), slope

        push = jnp.asarray(grid.forcing)[0, 0]
        _, first = jax.jvp(
            lambda motion, values: _seen(motion, values["gain"] * push, values, law, order),
            (start, p),
            (start_slope, p_slope),
        )
        _, rest = jax.lax.scan(step, (start, start_slope), (jnp.asarray(grid.step), jnp.asarray(grid.forcing)))
        moving = jnp.concatenate([jnp.asarray(first)[None], rest])
        return jnp.asarray(moving + jax.jvp(lambda q: _measured(jnp.zeros_like(moving), q, grid), (p,), (p_slope,))[1])

    return jnp.asarray(jax.vmap(along)(free)).T


def track(numbers: Array, grid: Grid, law: Law, order: int) -> Array:
    """Return what would be measured at the ends of the steps, shape (s + 1,), in amplitudes A.

    numbers: those named in `LOCAL`, shape (local,). order: 0 for the motion, 1 for its rate, 2 for its acceleration.
    """
    return np.asarray(traced_track(numbers, grid, law.compiled, order), dtype=float)


def track_slopes(numbers: Array, free: NDArray[np.intp], grid: Grid, law: Law, order: int) -> Array:
    """Return the derivatives of the track by the free ones of its numbers, shape (s + 1, f).

    free: indices into `LOCAL`, shape (f,).
    """
    # Of few widths, so that few are compiled for: a direction more costs little, a compilation a second.
    directions = np.zeros((max(8, -(-free.size // 4) * 4), len(LOCAL)))
    directions[np.arange(free.size), free] = 1.0
    return np.asarray(traced_slopes(numbers, directions, grid, law.compiled, order)[:, : free.size], dtype=float)
