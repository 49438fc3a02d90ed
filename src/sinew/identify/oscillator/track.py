"""This is where one degree of freedom is simulated over a record, with derivatives: fixed-step RK4, compiled once.

In time of 1/ω_r and amplitudes of A (so that all numbers are near one), r being the motion relative to its base,

    r'' + damping(r, r') + K s(r) + κ₂ r² + κ₃ r³ = g a(t),

with s(r) = r, or sin(r A)/A for a pendulum, and the damping

- viscous: D r';
- coulomb: D r' + c sign(r'), with its reversals located inside the step and with rest where the friction holds;
- loss-factor: a Prony series on K for a constant loss factor η (`sinew.mechanics.silicone`), K being the dynamic
  stiffness at the natural frequency: K_r Re G*(√K) = K.

Before the record the branches have seen a steady oscillation (memory 0), or a long rest where it starts (memory 1).

What is measured is r (or r', r''), plus g z for the absolute motion over a moving base, plus a rest position that may
drift or creep: offset + drift·t/T, or offset + drift·(1 - exp(-t/τ)).
"""

from functools import cache, partial
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.mechanics.silicone import prony_shares

Array = NDArray[np.float64]
DampingLaw = Literal["viscous", "loss-factor", "coulomb"]
StiffnessLaw = Literal["polynomial", "pendulum"]

LOCAL = (
    "stiffness",
    "damping",
    "loss_factor",
    "coulomb",
    "quadratic",
    "cubic",
    "gain",
    "start",
    "start_rate",
    "offset",
    "drift",
    "creep_time",
    "memory",
)
"""What a simulation depends on, in this order, each in its normal form."""

LARGEST_LOSS_FACTOR = 1.0
_FAR = 1e4  # amplitudes: further nothing is followed
_TABLE = 401


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
    """State: position, rate, and the positions of the dashpots' springs, shape (b,)."""

    r: jax.Array
    v: jax.Array
    z: jax.Array


@cache
def _share_table() -> Array:
    return np.stack([prony_shares(factor) for factor in np.linspace(0.0, LARGEST_LOSS_FACTOR, _TABLE)])


def _shares(loss_factor: jax.Array) -> jax.Array:
    """Return the Prony shares, odd in the loss factor so that a fit may pass through zero."""
    table = _share_table()
    size = jnp.clip(jnp.abs(loss_factor) / LARGEST_LOSS_FACTOR, 0.0, 1.0) * (_TABLE - 1)
    row = jnp.clip(jnp.floor(size).astype(int), 0, _TABLE - 2)
    s = size - row
    values, slopes = jnp.asarray(table), jnp.asarray(np.gradient(table, axis=0))
    ends = (2 * s**3 - 3 * s**2 + 1) * values[row] + (3 * s**2 - 2 * s**3) * values[row + 1]
    leaning = (s**3 - 2 * s**2 + s) * slopes[row] + (s**3 - s**2) * slopes[row + 1]
    return jnp.asarray(jnp.sign(loss_factor) * (ends + leaning))


class _Law(NamedTuple):
    """Numbers of one simulation that do not change with time."""

    p: jax.Array
    shares: jax.Array
    relaxed: jax.Array
    relaxation: jax.Array
    amplitude: jax.Array


def _storage(shares: jax.Array, omega: jax.Array, relaxation: jax.Array | Array) -> jax.Array:
    """Return the series' storage stiffness over the relaxed one at a frequency in ω_r."""
    wt = (omega * relaxation) ** 2
    return 1.0 + jnp.sum(shares * wt / (1.0 + wt))


def _natural(p: jax.Array) -> jax.Array:
    return jnp.sqrt(jnp.maximum(p[0], 1e-6))


def _law(p: jax.Array, relaxation: jax.Array | Array, amplitude: jax.Array | Array, damping: DampingLaw) -> _Law:
    if damping != "loss-factor":
        return _Law(p, jnp.zeros(0), p[0], jnp.zeros(0), jnp.asarray(amplitude))
    shares = _shares(p[2])
    relaxed = p[0] / _storage(shares, _natural(p), relaxation)
    return _Law(p, shares, relaxed, jnp.asarray(relaxation), jnp.asarray(amplitude))


def _restoring(motion: _Motion, law: _Law, stiffness: StiffnessLaw) -> jax.Array:
    p, r = law.p, jnp.clip(motion.r, -_FAR, _FAR)
    linear = jnp.sin(r * law.amplitude) / law.amplitude if stiffness == "pendulum" else r
    branches = jnp.sum(law.shares * (r - motion.z))
    return law.relaxed * (linear + branches) + p[1] * motion.v + r * r * (p[4] + p[5] * r)


def smooth_force(
    p: jax.Array,
    state: jax.Array,
    relaxation: jax.Array,
    amplitude: jax.Array,
    damping: DampingLaw,
    stiffness: StiffnessLaw,
) -> jax.Array:
    """Return K s(r) + κ₂ r² + κ₃ r³ and what is viscous or of the series: all but dry friction.

    p: at least the first seven numbers of `LOCAL`. state: r, r', and the springs' positions for a loss factor.
    """
    motion = _Motion(state[0], state[1], state[2:])
    return _restoring(motion, _law(p, relaxation, amplitude, damping), stiffness)


def stiffness_at(p: jax.Array, omega: jax.Array, relaxation: jax.Array) -> jax.Array:
    """Return the storage stiffness of a constant loss factor at a frequency in ω_r."""
    shares = _shares(p[2])
    return p[0] * _storage(shares, omega, relaxation) / _storage(shares, _natural(p), relaxation)


def _rate(motion: _Motion, push: jax.Array, law: _Law, stiffness: StiffnessLaw) -> _Motion:
    acceleration = push - _restoring(motion, law, stiffness)
    return _Motion(motion.v, acceleration, (motion.r - motion.z) / law.relaxation)


def _moved(motion: _Motion, slope: _Motion, step: jax.Array) -> _Motion:
    return _Motion(*(y + step * dy for y, dy in zip(motion, slope, strict=True)))


def _runge_kutta(motion: _Motion, step: jax.Array, push: jax.Array, law: _Law, stiffness: StiffnessLaw) -> _Motion:
    """Return the motion after one step; push: at its begin, middle and end, shape (3,)."""
    k1 = _rate(motion, push[0], law, stiffness)
    k2 = _rate(_moved(motion, k1, 0.5 * step), push[1], law, stiffness)
    k3 = _rate(_moved(motion, k2, 0.5 * step), push[1], law, stiffness)
    k4 = _rate(_moved(motion, k3, step), push[2], law, stiffness)
    slope = _Motion(*((a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)))
    return _moved(motion, slope, step)


def _between(push: jax.Array, share: jax.Array) -> jax.Array:
    """Return the forcing at shares of the step, by the parabola through begin, middle and end."""
    begin, middle, end = push[0], push[1], push[2]
    return begin + share * (4 * middle - 3 * begin - end) + share**2 * 2 * (begin - 2 * middle + end)


def _dry_step(motion: _Motion, step: jax.Array, push: jax.Array, law: _Law, stiffness: StiffnessLaw) -> _Motion:
    """Return the motion after one step with dry friction: its reversal, if there is one, is found and stepped to."""
    c = law.p[3]
    net = push[0] - _restoring(motion._replace(v=jnp.zeros(())), law, stiffness)
    held = (motion.v == 0) & (jnp.abs(net) <= c)
    sign = jnp.where(motion.v == 0, jnp.sign(net), jnp.sign(motion.v))
    straight = _runge_kutta(motion, step, push - c * sign, law, stiffness)

    def reversed_() -> _Motion:
        return _turned_step(motion, straight, step, push, sign, law, stiffness)

    moved = jax.lax.cond(straight.v * sign < 0, reversed_, lambda: straight)
    return _Motion(*(jnp.where(held, a, b) for a, b in zip(motion, moved, strict=True)))


def _turned_step(
    motion: _Motion,
    straight: _Motion,
    step: jax.Array,
    push: jax.Array,
    sign: jax.Array,
    law: _Law,
    stiffness: StiffnessLaw,
) -> _Motion:
    """Return the motion after a step in which the rate, of this sign at its begin, reverses or comes to rest."""
    c = law.p[3]
    share = _turning_share(motion, straight, step, push - c * sign, law, stiffness)
    parts = jnp.array([0.0, 0.5, 1.0])
    before = _between(push, share * parts)
    turned = _runge_kutta(motion, step * share, before - c * sign, law, stiffness)._replace(v=jnp.zeros(()))
    pull = before[2] - _restoring(turned, law, stiffness)
    after = _between(push, share + (1.0 - share) * parts) - c * jnp.sign(pull)
    back = _runge_kutta(turned, step * (1.0 - share), after, law, stiffness)
    return _Motion(*(jnp.where(jnp.abs(pull) <= c, a, b) for a, b in zip(turned, back, strict=True)))


def _turning_share(
    motion: _Motion, after: _Motion, step: jax.Array, push: jax.Array, law: _Law, stiffness: StiffnessLaw
) -> jax.Array:
    """Return the share of the step at which the rate is zero, by Newton on its Hermite cubic."""
    begin = step * _rate(motion, push[0], law, stiffness).v
    end = step * _rate(after, push[2], law, stiffness).v
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


def _begin(p: jax.Array, grid: Grid, damping: DampingLaw) -> tuple[_Law, _Motion]:
    law = _law(p, grid.relaxation, grid.amplitude, damping)
    swinging = (p[7] - p[8] * law.relaxation) / (1.0 + law.relaxation**2)
    return law, _Motion(p[7], p[8], swinging + p[12] * (p[7] - swinging))


def _seen(
    motion: _Motion, push: jax.Array, law: _Law, damping: DampingLaw, stiffness: StiffnessLaw, order: int
) -> jax.Array:
    if order == 2:
        friction = law.p[3] * jnp.sign(motion.v) if damping == "coulomb" else 0.0
        return push - friction - _restoring(motion, law, stiffness)
    return motion.v if order == 1 else motion.r


def _step(
    motion: _Motion,
    law: _Law,
    given: tuple[jax.Array, jax.Array],
    damping: DampingLaw,
    stiffness: StiffnessLaw,
    order: int,
) -> tuple[_Motion, jax.Array]:
    length, forcing = given
    push = law.p[6] * forcing
    after = (_dry_step if damping == "coulomb" else _runge_kutta)(motion, length, push, law, stiffness)
    return after, _seen(after, push[2], law, damping, stiffness, order)


def _measured(moving: jax.Array, p: jax.Array, grid: Grid) -> jax.Array:
    """Return what is measured of a motion: the base's added, and the rest position."""
    time = jnp.asarray(grid.time)
    lasting = jnp.exp(jnp.clip(p[11], -5.0, 5.0))
    creep = jnp.where(p[11] > 5.0, time, -jnp.expm1(-time / lasting))
    return moving + p[6] * grid.carried + p[9] + p[10] * creep


@partial(jax.jit, static_argnames=("damping", "stiffness", "order"))
def traced_track(p: jax.Array, grid: Grid, damping: DampingLaw, stiffness: StiffnessLaw, order: int) -> jax.Array:
    """Return the track as JAX sees it, for programs that are compiled themselves; see `track`."""
    law, start = _begin(p, grid, damping)
    first = _seen(start, p[6] * jnp.asarray(grid.forcing)[0, 0], law, damping, stiffness, order)

    def step(motion: _Motion, given: tuple[jax.Array, jax.Array]) -> tuple[_Motion, jax.Array]:
        return _step(motion, law, given, damping, stiffness, order)

    _, rest = jax.lax.scan(step, start, (jnp.asarray(grid.step), jnp.asarray(grid.forcing)))
    return _measured(jnp.concatenate([first[None], rest]), p, grid)


@partial(jax.jit, static_argnames=("damping", "stiffness", "order"))
def traced_slopes(
    p: jax.Array, free: jax.Array, grid: Grid, damping: DampingLaw, stiffness: StiffnessLaw, order: int
) -> jax.Array:
    """Return the derivatives along the directions in `free`, shape (f, 13).

    Motion and derivative go through the steps together. (The derivative of the whole loop, which JAX would make of
    `traced_track`, keeps every step's linearisation and is many times slower.)
    """

    def along(direction: jax.Array) -> jax.Array:
        (law, start), (law_slope, start_slope) = jax.jvp(lambda q: _begin(q, grid, damping), (p,), (direction,))

        def step(
            carry: tuple[_Motion, _Motion], given: tuple[jax.Array, jax.Array]
        ) -> tuple[tuple[_Motion, _Motion], jax.Array]:
            (after, _), (after_slope, slope) = jax.jvp(
                lambda motion, numbers: _step(motion, numbers, given, damping, stiffness, order),
                (carry[0], law),
                (carry[1], law_slope),
            )
            return (after, after_slope), slope

        push = jnp.asarray(grid.forcing)[0, 0]
        _, first = jax.jvp(
            lambda motion, numbers: _seen(motion, numbers.p[6] * push, numbers, damping, stiffness, order),
            (start, law),
            (start_slope, law_slope),
        )
        _, rest = jax.lax.scan(step, (start, start_slope), (jnp.asarray(grid.step), jnp.asarray(grid.forcing)))
        moving = jnp.concatenate([jnp.asarray(first)[None], rest])
        at_rest = jax.jvp(lambda q: _measured(jnp.zeros_like(moving), q, grid), (p,), (direction,))[1]
        return jnp.asarray(moving + at_rest)

    return jnp.asarray(jax.vmap(along)(free)).T


def track(p: Array, grid: Grid, damping: DampingLaw, stiffness: StiffnessLaw, order: int) -> Array:
    """Return what would be measured at the ends of the steps, shape (s + 1,), in amplitudes A.

    p: the numbers named in `LOCAL`, shape (13,). order: 0 for the motion, 1 for its rate, 2 for its acceleration.
    """
    return np.asarray(traced_track(p, grid, damping, stiffness, order), dtype=float)


def track_slopes(
    p: Array, free: NDArray[np.intp], grid: Grid, damping: DampingLaw, stiffness: StiffnessLaw, order: int
) -> Array:
    """Return the derivatives of the track by the free ones of its numbers, shape (s + 1, f).

    free: indices into `LOCAL`, shape (f,).
    """
    # Of few widths, so that few are compiled for: a direction more costs little, a compilation a second.
    directions = np.zeros((max(8, -(-free.size // 4) * 4), len(LOCAL)))
    directions[np.arange(free.size), free] = 1.0
    return np.asarray(traced_slopes(p, directions, grid, damping, stiffness, order)[:, : free.size], dtype=float)
