"""This is where the points of a curve are refined and examined: size, phase, harmonics, stability.

A point of the curve becomes a motion with finer waves, more harmonics and samples, by one step or a few of Newton's
method across the curve. What that changes in amplitude and frequency estimates what the coarser waves cost; what is
left after it is what the finer waves cut off, which is less.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from sinew.predict.amplitude import drive_phasor, half_range, lag_product, phasors
from sinew.predict.balance import Lane, balance
from sinew.predict.floquet import half_map
from sinew.predict.waves import Equations, Size, embedded, size_of

__all__ = ["BLOCK", "Evaluation", "Examination", "evaluate", "examine", "maps_of", "pool", "rows_of"]

Array = NDArray[np.float64]

BLOCK = 16
"""Motions that are evaluated in one call; any number runs in blocks of this size, so that it is compiled once."""

_REFINEMENTS, _ENOUGH = 4, 3e-4
_SETTLED, _NEAR = 0.03, 0.05


class Evaluation(NamedTuple):
    """Of each motion (k,): what is left over (k, m), and its slope (k, m, m + 1)."""

    left: Array
    slope: Array


class Examination(NamedTuple):
    """Of each point (k,), refined: frequency scaled; half_range of the response; its phasors (k, h); the drive's
    fundamental; product, drive times conjugate response; all in the scales of their coordinates. Further what the
    refinement changed in half_range and in the frequency [1], the map of disturbances (k, s, s), and whether the
    refinement settled near the point."""

    frequency: Array
    half_range: Array
    response: NDArray[np.complex128]
    drive: NDArray[np.complex128]
    product: NDArray[np.complex128]
    range_change: Array
    frequency_change: Array
    maps: Array
    settled: NDArray[np.bool_]


def rows_of(tree: Any, index: NDArray[np.intp]) -> Any:
    """Return the rows of every leaf of a tree."""
    return jax.tree.map(lambda leaf: np.asarray(leaf)[index], tree)


@cache
def pool() -> ThreadPoolExecutor:
    """Return the threads that blocks run in."""
    return ThreadPoolExecutor(max_workers=os.cpu_count() or 1, thread_name_prefix="sinew-predict")


@partial(jax.jit, static_argnames=("equations", "size"))
def _balances(x: jax.Array, lane: Lane, *, equations: Equations, size: Size) -> tuple[jax.Array, ...]:
    return jax.vmap(lambda x, lane: balance(x, lane, equations, size)[:2])(x, lane)


@partial(jax.jit, static_argnames=("equations", "size"))
def _maps(x: jax.Array, lane: Lane, *, equations: Equations, size: Size) -> tuple[jax.Array, ...]:
    def one(x: jax.Array, lane: Lane) -> jax.Array:
        return half_map(balance(x, lane, equations, size).local, x[-1] * lane.omega, equations)

    return (jax.vmap(one)(x, lane),)


def _in_blocks(compiled: Any, x: Array, lane: Lane, equations: Equations, size: Size) -> tuple[Array, ...]:
    """Return what a compiled function says of k motions, which it takes in blocks."""
    blocks = [np.minimum(np.arange(i, i + BLOCK), len(x) - 1) for i in range(0, len(x), BLOCK)]

    def run(index: NDArray[np.intp]) -> list[Array]:
        return [np.asarray(leaf) for leaf in compiled(x[index], rows_of(lane, index), equations=equations, size=size)]

    parts = [run(blocks[0])] if len(blocks) == 1 else list(pool().map(run, blocks))
    return tuple(np.concatenate(part)[: len(x)] for part in zip(*parts, strict=True))


def evaluate(x: Array, lane: Lane, equations: Equations, size: Size) -> Evaluation:
    """Return the evaluation of k motions x (k, m + 1); lane: with a leading axis k."""
    if not len(x):
        m = x.shape[1] - 1
        return Evaluation(np.zeros((0, m)), np.zeros((0, m, m + 1)))
    return Evaluation(*_in_blocks(_balances, x, lane, equations, size))


def maps_of(x: Array, lane: Lane, equations: Equations, size: Size) -> Array:
    """Return the map of disturbances (k, s, s) of k motions x (k, m + 1); lane: with a leading axis k."""
    if not len(x):
        return np.zeros((0, size_of(equations), size_of(equations)))
    return _in_blocks(_maps, x, lane, equations, size)[0]


def examine(
    points: Array, normals: Array, lane: Lane, equations: Equations, size: Size, fine: Size, *, stability: bool = True
) -> Examination:
    """Return the examination of k points.

    points: scaled unknowns (k, m + 1). normals: across which they are refined, (k, m + 1), the curve's tangents.
    lane: with a leading axis k. size, fine: of the waves as they are, and as they are to be. stability: whether the
    maps are wanted, which take a third of the time; else they have no rows and columns.
    """
    place = embedded(equations, size.harmonics, fine.harmonics)
    wide, normal = np.zeros((2, len(points), place[-1] + 1))
    wide[:, place], normal[:, place] = points, normals
    there, mapped = wide.copy(), wide.copy()
    left, last = np.arange(len(points)), np.zeros(len(points))
    for _ in range(_REFINEMENTS):
        seen = evaluate(there[left], rows_of(lane, left), equations, fine)
        matrix = np.concatenate([seen.slope, normal[left, None, :]], axis=1)
        right = np.concatenate([-seen.left, np.zeros((left.size, 1))], axis=1)
        change = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
        mapped[left] = there[left]
        there[left] += change
        last[left] = np.linalg.norm(change, axis=1)
        left = left[last[left] > _ENOUGH]
        if not left.size:
            break
    moved = there[:, -1] / wide[:, -1] - 1
    before, after = (half_range(x, equations, fine.harmonics).value for x in (wide, there))
    return Examination(
        there[:, -1],
        after,
        phasors(there, equations, fine.harmonics, equations.response),
        drive_phasor(there, equations, fine.harmonics),
        lag_product(there, equations, fine.harmonics)[0],
        after - before,
        moved,
        maps_of(mapped, lane, equations, fine) if stability else np.zeros((len(points), 0, 0)),
        (last < _SETTLED) & (np.abs(moved) < _NEAR),
    )
