"""Continuation: a curve of steady motions over the frequency, through its folds, by pseudo-arc-length.

The next point lies on the plane at a distance along the tangent, t₀·(x - x₀) = s, and Newton's method solves it with
the balance. Each step starts from the cubic through the last two points and tangents. The step grows and shrinks so
that the first correction stays about as large as asked for. The first point, and the last one at the end of the
window, are solved at their frequency.

The whole curve is one compiled loop whose body is one step of Newton's method on every lane; each lane goes at its own
pace. Lanes are the leading axis of all arrays.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from sinew.solve.balance import QUICK_COMPILE, Equations, Lane, Size, balance, solve
from sinew.solve.programs import program

POINTS = 512
"""Points that a curve can have."""

RUNNING = 0
OUTSIDE = 1
LIMIT = 2
STUCK = 3
LOST = 4
"""How a curve ended: still running; it left the window (as it should); at the limit of points; the smallest step did
not converge; no first point was found."""

_STEPS, _FIRST_STEPS = 6, 40
_STRAIGHT = 0.7
_TRIES = 20 * POINTS


class Stride(NamedTuple):
    """Steps along the curve in scaled unknowns: first, smallest and largest.

    correction: first correction that the step is chosen for. tolerance: last correction at which a point is taken; as
    the order of the method is two, the point is then right to about its square.
    """

    first: float = 0.01
    least: float = 1e-6
    most: float = 0.06
    correction: float = 3e-3
    tolerance: float = 1e-5


class Curve(NamedTuple):
    """Points and tangents (lane, point, m + 1), how many there are (lane,), and how each curve ended (lane,)."""

    points: jax.Array
    tangents: jax.Array
    number: jax.Array
    status: jax.Array


class _Walk(NamedTuple):
    """x is being corrected; base and tangent are the last point, before and tangent_before the one before at a distance
    span; landing: x is solved at the frequency `goal`; first: size of the first correction."""

    x: jax.Array
    base: jax.Array
    tangent: jax.Array
    before: jax.Array
    tangent_before: jax.Array
    span: jax.Array
    step: jax.Array
    goal: jax.Array
    landing: jax.Array
    iteration: jax.Array
    first: jax.Array
    tries: jax.Array
    curve: Curve


def _predicted(w: _Walk) -> jax.Array:
    """Return the cubic through the last two points and tangents, one step on."""
    h = w.span[:, None]
    rise = w.before - w.base + h * w.tangent
    bend = h * (w.tangent_before - w.tangent)
    u = (w.step / w.span)[:, None]
    return w.base + u * (h * w.tangent + u * (3 * rise + bend + u * (2 * rise + bend)))


def _solved(w: _Walk, lane: Lane, equations: Equations, size: Size) -> tuple[jax.Array, jax.Array]:
    """Return (correction, tangent at x), each (lane, m + 1)."""
    left, slope, _ = jax.vmap(lambda x, one: balance(x, one, equations, size))(w.x, lane)
    level = jnp.zeros_like(w.x).at[:, -1].set(1.0)
    normal = jnp.where(w.landing[:, None], level, w.tangent)
    ahead = w.step - jnp.sum(w.tangent * (w.x - w.base), axis=1)
    last = jnp.where(w.landing, w.goal - w.x[:, -1], ahead)
    matrix = jnp.concatenate([slope, normal[:, None, :]], axis=1)
    right = jnp.stack([jnp.concatenate([-left, last[:, None]], axis=1), level], axis=2)
    both = jax.vmap(solve)(matrix, right)
    tangent = both[:, :, 1] / jnp.linalg.norm(both[:, :, 1], axis=1, keepdims=True)
    forward = jnp.where(jnp.sum(tangent * w.tangent, axis=1) < 0, -1.0, 1.0)
    return both[:, :, 0], tangent * forward[:, None]


def _advanced(w: _Walk, lane: Lane, window: jax.Array, limit: jax.Array, s: tuple[Equations, Size, Stride]) -> _Walk:
    equations, size, stride = s
    running, starting = w.curve.status == RUNNING, w.curve.number == 0
    change, tangent = _solved(w, lane, equations, size)
    length = jnp.linalg.norm(change, axis=1)
    change = change * jnp.where(starting, jnp.minimum(1.0, 0.5 / length), 1.0)[:, None]
    x = w.x + change
    first = jnp.where(w.iteration == 0, length, w.first)

    straight = starting | w.landing | (jnp.sum(tangent * w.tangent, axis=1) > _STRAIGHT)
    close = jnp.isfinite(length) & (length < stride.tolerance)
    steps = jnp.where(starting, _FIRST_STEPS, _STEPS)
    far = ~starting & ~w.landing & (length > 2 * w.step)
    failed = ~jnp.isfinite(length) | (w.iteration >= steps) | far | (close & ~straight)
    taken = close & straight
    outside = taken & ~w.landing & ~starting & ((x[:, -1] < window[0]) | (x[:, -1] > window[1]))
    taken = taken & ~outside

    lanes = jnp.arange(x.shape[0])
    at = w.curve.number
    extended = w.curve._replace(
        points=w.curve.points.at[lanes, at].set(x), tangents=w.curve.tangents.at[lanes, at].set(tangent)
    )
    count = at + (running & taken)
    small = failed & (w.step <= stride.least)
    status = jnp.where(starting & failed, LOST, jnp.where(small, STUCK, RUNNING))
    status = jnp.where(w.landing & (taken | failed), OUTSIDE, status)
    status = jnp.where((status == RUNNING) & ((count >= limit) | (w.tries >= _TRIES)), LIMIT, status)
    curve = extended._replace(number=count, status=jnp.where(running, status, w.curve.status))

    grown = w.step * jnp.clip((stride.correction / (first + 1e-12)) ** 0.25, 0.5, 1.6)
    step = jnp.where(starting, stride.first, jnp.clip(grown, stride.least, stride.most))
    step = jnp.where(failed, jnp.maximum(0.5 * w.step, stride.least), step)
    gone, moved = taken[:, None], taken | failed
    walk = w._replace(
        base=jnp.where(gone, x, w.base),
        before=jnp.where(gone, jnp.where(starting[:, None], x - tangent, w.base), w.before),
        tangent=jnp.where(gone, tangent, w.tangent),
        tangent_before=jnp.where(gone, jnp.where(starting[:, None], tangent, w.tangent), w.tangent_before),
        span=jnp.where(taken, jnp.where(starting, 1.0, jnp.linalg.norm(x - w.base, axis=1)), w.span),
        step=jnp.where(moved, step, w.step),
    )
    return walk._replace(
        x=jnp.where(moved[:, None], _predicted(walk), x),
        goal=jnp.where(outside, jnp.clip(x[:, -1], window[0], window[1]), w.goal),
        landing=w.landing | outside,
        iteration=jnp.where(moved | outside, 0, w.iteration + 1),
        first=first,
        tries=w.tries + 1,
        curve=curve,
    )


@program(static=("equations", "size"), options=QUICK_COMPILE)
def follow(
    start: jax.Array,
    lane: Lane,
    window: jax.Array,
    limit: jax.Array,
    stride: Stride,
    *,
    equations: Equations,
    size: Size,
) -> Curve:
    """Return the curves that begin near given motions, in the direction of growing frequency.

    start: scaled unknowns (lane, m + 1), solved at their own frequency first. window: (2,), scaled frequencies at which
    a curve ends. limit: number of points after which it ends.
    """
    lanes, width = start.shape
    level = jnp.zeros_like(start).at[:, -1].set(1.0)
    zero, one = jnp.zeros(lanes), jnp.ones(lanes)
    whole = jnp.zeros(lanes, dtype=int)
    room = jnp.zeros((lanes, POINTS + 1, width))
    curve = Curve(room, room, whole, whole)
    walk = _Walk(start, start, level, start, level, one, zero, zero, whole < 0, whole, zero, whole, curve)
    limit = jnp.minimum(limit, POINTS)
    settings = (equations, size, stride)

    def go_on(w: _Walk) -> jax.Array:
        return jnp.any(w.curve.status == RUNNING)

    done: _Walk = jax.lax.while_loop(go_on, lambda w: _advanced(w, lane, window, limit, settings), walk)
    return done.curve
