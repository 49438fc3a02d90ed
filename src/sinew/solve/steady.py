"""Steady motions of many lanes at once, each nearest to a start, with derivatives by the equations' numbers.

One linear condition, row · x = goal, picks the point of a lane's curve: its frequency, or the lag of its fundamental.
With balance F(x, p) = 0 the derivatives follow from the implicit function theorem, [F_x; row] dx/dp = (-F_p, 0).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from sinew.measure.arrays import Array, Mask
from sinew.solve.balance import QUICK_COMPILE, Equations, Lane, Size, balance, slices, solve
from sinew.solve.examination import in_blocks
from sinew.solve.programs import program

_TRIES, _LEAST_SHARE = 100, 1 / 64
_FREQUENCY_SHARE = 0.2  # of the frequency: the longest step over it
_ENOUGH, _RIGHT = 1e-9, 1e-6  # of the motion: last step at which the search ends, and at which it was right


class Steady(NamedTuple):
    """Motions of k lanes in scaled unknowns x (k, m + 1), their derivatives by the numbers in p, in the order of its
    leaves (k, m + 1, n), and whether the balance was reached (k,)."""

    x: Array
    slopes: Array
    found: Mask


class _Search(NamedTuple):
    """x is the last point taken, slope of the balance there, step the one that Newton's method asks for, of which a
    share is tried."""

    x: jax.Array
    slope: jax.Array
    step: jax.Array
    share: jax.Array
    off: jax.Array
    length: jax.Array
    tries: jax.Array


def _weights(lane: Lane, equations: Equations, size: Size) -> jax.Array:
    """Return what makes the balances near one, (m,): each coordinate's highest derivative by scale and frequency."""
    parts = slices(equations, size.harmonics)
    each = [lane.scale[c] * lane.omega**one.order for c, one in enumerate(equations.coordinates)]
    return jnp.concatenate([jnp.full(p.stop - p.start, 1.0) / one for p, one in zip(parts, each, strict=True)])


@program(static=("equations", "size"), options=QUICK_COMPILE)
def _steady(
    given: tuple[jax.Array, jax.Array, jax.Array], lane: Lane, *, equations: Equations, size: Size
) -> tuple[jax.Array, ...]:
    def one(start: jax.Array, row: jax.Array, goal: jax.Array, lane: Lane) -> tuple[jax.Array, ...]:
        weights = _weights(lane, equations, size)

        def seen(x: jax.Array) -> tuple[jax.Array, jax.Array]:
            left, slope, _ = balance(x, lane, equations, size)
            return (
                jnp.append(left * weights, row @ x - goal),
                jnp.concatenate([slope * weights[:, None], row[None]]),
            )

        def advanced(w: _Search) -> _Search:
            x = w.x - w.share * w.step
            left, slope = seen(x)
            off, step = jnp.linalg.norm(left), solve(slope, left)
            length = jnp.linalg.norm(step) / jnp.linalg.norm(x[:-1])
            step = jnp.where(jnp.isfinite(step), step, 0.0)
            first = jnp.minimum(1.0, _FREQUENCY_SHARE * x[-1] / jnp.maximum(jnp.abs(step[-1]), 1e-300))
            taken = _Search(x, slope, step, first, off, length, w.tries)
            tried = w._replace(share=0.5 * w.share)
            better = (off <= w.off) | (w.share <= _LEAST_SHARE)
            best: _Search = jax.tree.map(lambda a, b: jnp.where(better, a, b), taken, tried)
            return best._replace(tries=w.tries + 1)

        none, infinite = jnp.zeros(()), jnp.asarray(jnp.inf)
        slope, still = jnp.zeros((start.size, start.size)), jnp.zeros_like(start)
        begin = _Search(start, slope, still, none, infinite, infinite, jnp.zeros((), dtype=int))
        done: _Search = jax.lax.while_loop(lambda w: ~(w.length <= _ENOUGH) & (w.tries < _TRIES), advanced, begin)
        x = done.x - done.step * (done.length <= _RIGHT)
        numbers, unravel = ravel_pytree(lane.p)
        by_numbers = jax.jacfwd(lambda p: balance(x, lane._replace(p=unravel(p)), equations, size).left)(numbers)
        right = jnp.concatenate([by_numbers * weights[:, None], jnp.zeros((1, numbers.size))])
        return x, -solve(done.slope, right), done.length <= _RIGHT

    return jax.vmap(one)(*given, lane)


def steady(start: Array, row: Array, goal: Array, lane: Lane, equations: Equations, size: Size) -> Steady:
    """Return the steady motions nearest to k starts, by Newton's method with halved steps.

    start: scaled unknowns (k, m + 1); where several motions are possible it says which is meant. row, goal: the
    condition, (k, m + 1) and (k,). lane: with a leading axis k; all of its numbers are floats.
    """
    x, slopes, found = in_blocks(_steady, (start, row, goal), lane, equations, size)
    return Steady(x, slopes, found.astype(bool))


def at_frequency(start: Array, lane: Lane, equations: Equations, size: Size) -> Steady:
    """Return the steady motions at the starts' own frequencies; the rest as of `steady`."""
    level = np.zeros_like(start)
    level[:, -1] = 1.0
    return steady(start, level, start[:, -1], lane, equations, size)
