"""Harmonic balance of a steady motion: harmonics of what the equations leave over, and their derivatives.

Alternating frequency and time: the harmonics give the channels on a grid of the period, the equations of motion are
evaluated there as they stand, and what they differ by from the waves' highest derivatives is projected on the harmonics
again. Derivatives at the samples come from automatic differentiation of the same equations.

The unknowns are scaled: x = (q / scale, Ω / omega), so that all are near one.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from sinew.solve.waves import Equations, Size, channels, grid, slices


class Lane(NamedTuple):
    """One curve to be computed. p: the equations' numbers. scale: size of each coordinate, (c,), in its unit.
    omega: frequency that is taken for one [rad/s]."""

    p: Any
    scale: jax.Array
    omega: jax.Array


class Balance(NamedTuple):
    """left: harmonics of what is left over, (m,). slope: their derivatives by the scaled unknowns, (m, m + 1).
    local: derivatives of the equations' rates by the channels at the samples, (n, c, k)."""

    left: jax.Array
    slope: jax.Array
    local: jax.Array


def scales(lane: Lane, equations: Equations, harmonics: int) -> jax.Array:
    """Return the scale of each unknown amplitude, (m,)."""
    parts = slices(equations, harmonics)
    return jnp.concatenate([jnp.full(part.stop - part.start, lane.scale[c]) for c, part in enumerate(parts)])


def motion(x: jax.Array, lane: Lane, equations: Equations, harmonics: int) -> tuple[jax.Array, jax.Array]:
    """Return (amplitudes q (m,) in the coordinates' units, Ω [rad/s]) of scaled unknowns x (m + 1,)."""
    return x[:-1] * scales(lane, equations, harmonics), x[-1] * lane.omega


def balance(x: jax.Array, lane: Lane, equations: Equations, size: Size) -> Balance:
    """Return the balance at scaled unknowns x (m + 1,)."""
    at = grid(equations, size)
    q, omega = motion(x, lane, equations, size.harmonics)
    u = channels(q, omega, equations, at, size.harmonics)

    def rates(values: jax.Array, phase: jax.Array, omega: jax.Array) -> tuple[jax.Array, jax.Array]:
        here = equations.rates(values, phase, omega, lane.p)
        return here, here

    each = jax.vmap(jax.jacfwd(rates, argnums=(0, 2), has_aux=True), in_axes=(1, 0, None))
    (local, by_omega), here = each(u.values, jnp.asarray(at.phase), omega)
    over = here - u.top.T
    by_omega = by_omega + jnp.einsum("nck,kn->nc", local, u.slopes) - u.top_slopes.T
    rows = []
    for c, project in enumerate(at.project):
        blocks, first = [], 0
        for other, part in enumerate(u.maps):
            block = jnp.einsum("nk,knm->nm", local[:, c, first : first + part.shape[0]], part)
            blocks.append(block - u.top_maps[c] if other == c else block)
            first += part.shape[0]
        rows.append(project @ jnp.concatenate([*blocks, by_omega[:, c : c + 1]], axis=1))
    left = jnp.concatenate([project @ over[:, c] for c, project in enumerate(at.project)])
    scale = jnp.append(scales(lane, equations, size.harmonics), lane.omega)
    return Balance(left, jnp.concatenate(rows) * scale, local)


# Small systems of linear equations are solved inside compiled loops.
#
# `jnp.linalg.solve` on a batch calls LAPACK through jaxlib, which spreads the batch over the very pool of threads
# that it waits in: two such calls at once on two cores wait for each other for ever (seen with jaxlib 0.10.2).
# Gauss-Jordan elimination with row pivoting needs neither; it costs three times the operations, on matrices of some
# ten rows.


def solve(matrix: jax.Array, right: jax.Array) -> jax.Array:
    """Return the solution of a system: matrix (m, m), right (m,) or (m, r). Not finite where there is none."""
    m = matrix.shape[0]
    columns = right[:, None] if right.ndim == 1 else right
    rows = jnp.arange(m)

    def eliminated(k: jax.Array, state: tuple[jax.Array, jax.Array, jax.Array]) -> tuple[jax.Array, ...]:
        table, free, order = state
        column = jax.lax.dynamic_index_in_dim(table, k, axis=1, keepdims=False)
        pivot = jnp.argmax(jnp.where(free, jnp.abs(column), -1.0))
        row = jax.lax.dynamic_index_in_dim(table, pivot, axis=0, keepdims=False)
        row = row / jax.lax.dynamic_index_in_dim(row, k, keepdims=False)
        here = rows == pivot
        table = jnp.where(here[:, None], row, table - column[:, None] * row)
        return table, free & ~here, order.at[k].set(pivot)

    start = jnp.concatenate([matrix, columns], axis=1), jnp.ones(m, dtype=bool), jnp.zeros(m, dtype=int)
    table, _, order = jax.lax.fori_loop(0, m, eliminated, start)
    found = jnp.asarray(table)[order, m:]
    return found[:, 0] if right.ndim == 1 else found
