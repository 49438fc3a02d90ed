"""This is where small systems of linear equations are solved inside compiled loops.

`jnp.linalg.solve` on a batch calls LAPACK through jaxlib, which spreads the batch over the very pool of threads that it
waits in: two such calls at once on two cores wait for each other for ever (seen with jaxlib 0.10.2). Gauss-Jordan
elimination with row pivoting needs neither; it costs three times the operations, on matrices of some ten rows.
"""

import jax
import jax.numpy as jnp

__all__ = ["solve"]


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
