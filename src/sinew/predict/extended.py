"""This is where the balance is extended by two unknowns' worth of conditions: phase resonance, followed over the drive.

Unknowns y = (x, s): a motion x = (q / scale, Ω / omega) and the share s of the drive that acts. Equations: balance
F(x, s) = 0, and the fundamental of the response 90° behind that of what drives it, Re(drive · conj(response)) = 0. They
leave a curve, the backbone; one row more, a plane or a share, picks a point of it.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.predict.amplitude import lag_product
from sinew.predict.balance import Lane, balance
from sinew.predict.examination import BLOCK, pool, rows_of
from sinew.predict.floquet import half_map
from sinew.predict.prediction import Problem
from sinew.predict.waves import Equations, Size, size_of

__all__ = ["Corrected", "Extended", "corrected", "evaluate_extended"]

Array = NDArray[np.float64]

_STEPS = 8


class Extended(NamedTuple):
    """Of each point (k,): what is left over (k, m + 1), its slope (k, m + 1, m + 2), map of disturbances (k, s, s)."""

    left: Array
    slope: Array
    maps: Array


class Corrected(NamedTuple):
    """Points (k, m + 2), the size of their last correction (k,), and their evaluation before it."""

    points: Array
    error: Array
    seen: Extended


@partial(jax.jit, static_argnames=("equations", "size", "weakened"))
def _block(y: jax.Array, lane: Lane, *, equations: Equations, size: Size, weakened: object) -> tuple[jax.Array, ...]:
    def one(y: jax.Array, lane: Lane) -> tuple[jax.Array, ...]:
        x, share = y[:-1], y[-1]

        def lane_at(share: jax.Array) -> Lane:
            return lane._replace(p=weakened(lane.p, share))  # type: ignore[operator]

        left, slope, local = balance(x, lane_at(share), equations, size)
        by_share = jax.jacfwd(lambda s: balance(x, lane_at(s), equations, size).left)(share)
        return left, jnp.concatenate([slope, by_share[:, None]], axis=1), half_map(local, x[-1] * lane.omega, equations)

    return jax.vmap(one)(y, lane)


def evaluate_extended(y: Array, lanes: NDArray[np.intp], problem: Problem, size: Size) -> Extended:
    """Return the evaluation of k points y (k, m + 2); lanes: of the problem, one for each, (k,)."""
    equations = problem.equations
    if not len(y):
        m, states = y.shape[1] - 1, size_of(equations)
        return Extended(np.zeros((0, m)), np.zeros((0, m, m + 1)), np.zeros((0, states, states)))
    blocks = [np.minimum(np.arange(i, i + BLOCK), len(y) - 1) for i in range(0, len(y), BLOCK)]

    def run(index: NDArray[np.intp]) -> list[Array]:
        lane = rows_of(problem.lane, lanes[index])
        done = _block(y[index], lane, equations=equations, size=size, weakened=problem.weakened)
        return [np.asarray(leaf) for leaf in done]

    parts = [run(blocks[0])] if len(blocks) == 1 else list(pool().map(run, blocks))
    left, slope, maps = (np.concatenate(part)[: len(y)] for part in zip(*parts, strict=True))
    product, by_motion = lag_product(y[:, :-1], equations, size.harmonics)
    scale = np.maximum(np.abs(product), 1e-300)[:, None]
    row = np.concatenate([by_motion, np.zeros((len(y), 1))], axis=1) / scale
    left = np.concatenate([left, product.real[:, None] / scale], axis=1)
    return Extended(left, np.concatenate([slope, row[:, None, :]], axis=1), maps)


def corrected(
    y: Array, normal: Array, lanes: NDArray[np.intp], problem: Problem, size: Size, enough: float, steps: int = _STEPS
) -> Corrected:
    """Return the points of the backbone on the planes through guesses, by Newton's method.

    y: (k, m + 2). normal: of the planes, (k, m + 2). enough: size of the correction at which a point is taken.
    """
    there, error = y.copy(), np.full(len(y), np.inf)
    left: NDArray[np.intp] = np.arange(len(y))
    kept = seen = evaluate_extended(there, lanes, problem, size)
    for step in range(steps if len(y) else 0):
        if step:
            seen = evaluate_extended(there[left], lanes[left], problem, size)
            for row, leaf in zip(kept, seen, strict=True):
                row[left] = leaf
        matrix = np.concatenate([seen.slope, normal[left, None, :]], axis=1)
        off = np.sum(normal[left] * (y[left] - there[left]), axis=1)
        right = np.concatenate([-seen.left, off[:, None]], axis=1)
        change = _solved(matrix, right)
        there[left] += change
        error[left] = np.linalg.norm(change, axis=1)
        left = left[np.isfinite(error[left]) & (error[left] > enough)]
        if not left.size:
            break
    return Corrected(there, error, kept)


def _solved(matrix: Array, right: Array) -> Array:
    """Return the solutions of systems (k, n, n); not a number where there is none."""
    try:
        return np.asarray(np.linalg.solve(matrix, right[:, :, None])[:, :, 0])
    except np.linalg.LinAlgError:
        return np.full_like(right, np.nan)
