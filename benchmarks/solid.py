"""Finite elements of an incompressible solid: from energy at points to forces, stiffness and balance.

Mesh, shape functions and quadrature are scikit-fem's. What happens at a quadrature point are numbers v = B d of the
element's unknowns d, displacements and pressure together; their energy density is given as a function of v, and JAX
differentiates it. The pressure is the multiplier of J = 1, so nothing is nearly incompressible. With quadratic
displacements and linear pressure (Taylor-Hood) the elements do not lock.
"""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu

from sinew.measure.arrays import Array
from sinew.solve.programs import configure

Indices = NDArray[np.intp]
Energy = Callable[[jax.Array, jax.Array], jax.Array]

_STEPS, _ENOUGH = 25, 1e-10


class Solid(NamedTuple):
    """A meshed solid. energy(v (k,), place (d,)): density [J/m³ or per whatever the weight counts].

    maps: B, (element, point, k, unknowns of an element). weight: of the points, (element, point). place: (element,
    point, d). unknowns: of each element, (element, unknowns of an element). total: of all unknowns.
    """

    energy: Energy
    maps: Array
    weight: Array
    place: Array
    unknowns: Indices
    total: int


class Balance(NamedTuple):
    """Energy [J], forces: its gradient (total,), stiffness: its second derivative (total, total)."""

    energy: float
    forces: Array
    stiffness: csr_matrix


def balance(solid: Solid, d: Array) -> Balance:
    """Return the balance of a solid with unknowns d (total,)."""
    configure()  # not as this is imported: by then it was settled for every benchmark how many threads JAX has
    local = d[solid.unknowns]
    v = np.einsum("epka,ea->epk", solid.maps, local)
    shape = v.shape[:2]
    points = jnp.asarray(v.reshape(-1, v.shape[2])), jnp.asarray(solid.place.reshape(v.shape[0] * v.shape[1], -1))
    value, slope, bend = (np.asarray(leaf) for leaf in _derivatives(solid.energy)(*points))
    slope = slope.reshape(v.shape) * solid.weight[:, :, None]
    bend = bend.reshape(*shape, v.shape[2], v.shape[2]) * solid.weight[:, :, None, None]
    forces = np.einsum("epk,epka->ea", slope, solid.maps)
    # One element's rows of all points under each other, so that the product is one of matrices.
    elements, width = shape[0], solid.maps.shape[3]
    tall = solid.maps.reshape(elements, -1, width)
    block = tall.transpose(0, 2, 1) @ np.matmul(bend, solid.maps).reshape(elements, -1, width)
    rows = np.repeat(solid.unknowns, width, axis=1).ravel()
    columns = np.tile(solid.unknowns, (1, width)).ravel()
    return Balance(
        float(np.sum(value.reshape(shape) * solid.weight)),
        np.asarray(np.bincount(solid.unknowns.ravel(), forces.ravel(), solid.total), dtype=float),
        csr_matrix((block.ravel(), (rows, columns)), (solid.total, solid.total)),
    )


@cache
def _derivatives(energy: Energy) -> Callable[..., tuple[jax.Array, jax.Array, jax.Array]]:
    def all_of(v: jax.Array, place: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        return energy(v, place), jax.grad(energy)(v, place), jax.hessian(energy)(v, place)

    return jax.jit(jax.vmap(all_of))


def settled(solid: Solid, d: Array, held: Indices, goal: Array) -> Array:
    """Return the unknowns in balance where the held ones (k,) have the values of the goal (k,), from a guess d.

    Raises RuntimeError where Newton's method does not settle.
    """
    free = np.setdiff1d(np.arange(solid.total), held)
    d = d.copy()
    ahead = np.zeros(solid.total)
    ahead[held] = goal - d[held]
    for _ in range(_STEPS):
        now = balance(solid, d)
        matrix = now.stiffness[free]
        change = ahead.copy()
        change[free] = splu(matrix[:, free].tocsc()).solve(-now.forces[free] - matrix @ ahead)
        d += change
        ahead[:] = 0.0
        if np.linalg.norm(change) <= _ENOUGH * np.linalg.norm(d):
            return d
    raise RuntimeError(f"no balance after {_STEPS} steps of Newton's method; the last moved the unknowns by "
                       f"{np.linalg.norm(change):.1e} of {np.linalg.norm(d):.1e}; take smaller steps")  # fmt: skip


def held_stiffness(matrix: csr_matrix, held: Indices, moved: Array) -> float:
    """Return the stiffness against a motion of the held unknowns, the others following: uᵀ K u with moved u.

    matrix: of a balance. moved: (total,), how the held unknowns move; entries of the others do not count.
    """
    free = np.setdiff1d(np.arange(matrix.shape[0]), held)
    u = np.zeros(matrix.shape[0])
    u[held] = moved[held]
    rows = matrix[free]
    u[free] = splu(rows[:, free].tocsc()).solve(-(rows @ u))
    return float(u @ (matrix @ u))
