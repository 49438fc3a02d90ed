"""This is where St Venant's torsion of a cross-section is solved, from two sides, by finite elements.

Per twist θ' [rad/m] a section warps by θ' ψ(x, y) and carries the shear stress G θ' rot(u). The warping ψ minimises
∫ (ψ_x - y)² + (ψ_y + x)², and that minimum is the torsion constant: elements give it too large. Prandtl's function u
solves Δu = -2, is zero on the outer edge and constant on each hole, and J = 2 ∫ u + 2 Σ u_hole A_hole: elements give
it too small. The true constant lies between the two (Timoshenko and Goodier, Theory of Elasticity, chapter 10).
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree
from skfem import Basis, ElementTriP2, FacetBasis, LinearForm, MeshTri
from skfem.models.poisson import laplace, mass, unit_load

from sinew.predict.sections.mesh import Mesh, triangulate
from sinew.predict.sections.moments import Moments, centred, corner_turns, moments
from sinew.predict.sections.outline import Outline

__all__ = ["Torsion", "solve_torsion"]

Array = NDArray[np.float64]

_ENOUGH = 3e-4
_TRIANGLES = 600
_MOST = 20_000
_SHARP = np.radians(20.0)
_CLOSER = 9


class Torsion(NamedTuple):
    """constant: J [m⁴], the middle of its bounds; bounds: (too small, too large) [m⁴]; warping: Vlasov's warping
    constant about the shear centre [m⁶]; shear_arm: the largest shear strain per twist [m], None where a re-entrant
    corner makes it unbounded."""

    constant: float
    bounds: tuple[float, float]
    warping: float
    shear_arm: float | None


def solve_torsion(drawn: Outline, enough: float = _ENOUGH) -> Torsion:
    """Return the torsion of an outline. Triangles are made finer until the bounds are closer than `enough`, as a share
    of the constant on either side of it, or until there are some 20 000 of them. Raises SpecError where the outline
    cannot be cut into triangles."""
    placed = centred(drawn)
    about = moments(placed)
    count = _TRIANGLES
    while True:
        mesh = triangulate(placed, float(np.sqrt(4 * about.area / (np.sqrt(3) * count))))
        found = _solve(mesh, placed, about)
        if found.bounds[1] - found.bounds[0] <= 2 * enough * found.constant or count >= _MOST:
            return found
        count *= 3


def _solve(mesh: Mesh, placed: Outline, about: Moments) -> Torsion:
    sharp = np.concatenate(placed.rings)[corner_turns(placed) < -_SHARP]
    basis = Basis(_graded(MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy()), sharp), ElementTriP2())
    stiffness = laplace.assemble(basis).tocsr()
    high, warping = _warping(basis, stiffness, about)
    low, stress = _stress(basis, stiffness, mesh.ring, placed)
    return Torsion(0.5 * (low + high), (low, high), warping, None if len(sharp) else _largest_slope(basis, stress))


def _graded(triangles: Any, corners: Array) -> Any:
    """Return triangles that become small towards re-entrant corners, where the stress has no bound."""
    if not len(corners):
        return triangles
    _, index = cKDTree(triangles.p.T).query(corners)
    for _ in range(_CLOSER):
        triangles = triangles.refined(np.flatnonzero(np.isin(triangles.t, index).any(axis=0)))
    return triangles


def _warping(basis: Any, stiffness: Any, about: Moments) -> tuple[float, float]:
    """Return the upper bound of J [m⁴] and the warping constant [m⁶]."""

    @LinearForm  # type: ignore[untyped-decorator]
    def turn(v: Any, w: Any) -> Any:
        return w.x[1] * v.grad[0] - w.x[0] * v.grad[1]

    load = turn.assemble(basis)
    psi = np.zeros(basis.N)
    psi[1:] = spsolve(stiffness[1:, 1:].tocsc(), load[1:])
    constant = about.polar - float(psi @ load)
    # About the shear centre the warping holds no share of 1, x and y: no axial force, no bending.
    x, y = basis.doflocs
    rigid = np.column_stack([np.ones_like(x), x, y])
    weight = mass.assemble(basis)
    share = np.linalg.solve(rigid.T @ (weight @ rigid), rigid.T @ (weight @ psi))
    rest = psi - rigid @ share
    return constant, float(rest @ (weight @ rest))


def _rings(triangles: Any, ring: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the facets on the edges and the number of the ring that each lies on.

    ring: of the points before the triangles became smaller; those keep their numbers.
    """
    facets = triangles.boundary_facets()
    a, b = triangles.facets[:, facets]
    size = triangles.p.shape[1]
    _, part = connected_components(coo_matrix((np.ones(a.size), (a, b)), shape=(size, size)), directed=False)
    of_part = np.full(part.max() + 1, -1)
    of_part[part[: ring.size][ring >= 0]] = ring[ring >= 0]
    return facets, of_part[part[a]]


def _stress(basis: Any, stiffness: Any, ring: NDArray[np.int64], placed: Outline) -> tuple[float, Array]:
    """Return the lower bound of J [m⁴] and Prandtl's function at the degrees of freedom [m²]."""
    group = np.arange(basis.N)
    facets, on = _rings(basis.mesh, ring)
    outside = basis.get_dofs(facets[on == 0]).all()
    area = np.zeros(basis.N)
    for i, hole in enumerate(placed.holes, start=1):
        dofs = basis.get_dofs(facets[on == i]).all()
        group[dofs] = dofs[0]
        area[dofs[0]] = moments(Outline(hole[::-1])).area
    free = np.setdiff1d(np.unique(group), outside)
    column = np.full(basis.N, -1)
    column[free] = np.arange(free.size)
    at = column[group]
    rows = np.flatnonzero(at >= 0)
    merge: csr_matrix = coo_matrix((np.ones(rows.size), (rows, at[rows])), shape=(basis.N, free.size)).tocsr()
    load = 2 * (merge.T @ unit_load.assemble(basis) + area[free])
    reduced = spsolve((merge.T @ stiffness @ merge).tocsc(), load)
    return float(load @ reduced), np.asarray(merge @ reduced)


def _largest_slope(basis: Any, stress: Array) -> float:
    """Return the largest slope of Prandtl's function on the edges [m]."""
    slope = FacetBasis(basis.mesh, basis.elem).interpolate(stress).grad
    return float(np.sqrt(np.max(np.sum(np.asarray(slope) ** 2, axis=0))))
