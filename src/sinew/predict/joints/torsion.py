"""St Venant's torsion of a cross-section, solved from two sides by finite elements.

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
from scipy.spatial import Delaunay, cKDTree
from skfem import Basis, ElementTriP2, FacetBasis, LinearForm, MeshTri
from skfem.models.poisson import laplace, mass, unit_load

from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import SpecError
from sinew.predict.joints.section import Moments, Outline, centred, corner_turns, inside, moments

# A cross-section is cut into triangles.


_SPLITS = 30
_FLAT = 1e-9


class Mesh(NamedTuple):
    """points: (n, 2) [m]; triangles: (t, 3), indices into them; ring: (n,), the number of the ring a point lies on,
    -1 inside."""

    points: Array
    triangles: NDArray[np.int64]
    ring: NDArray[np.int64]


def triangulate(drawn: Outline, size: float) -> Mesh:
    """Return triangles of about a size [m] that fill an outline exactly.

    Inside stands a grid of equilateral triangles, on the edges points that are at most as far apart; the Delaunay
    triangulation of all of them is cut at the outline. Edges that it does not contain are halved until it does.
    Raises SpecError where that does not end.
    """
    rings = [_divided(ring, size) for ring in drawn.rings]
    grid = _grid(drawn, size)
    for _ in range(_SPLITS):
        on_edge = np.concatenate(rings)
        near, _ = cKDTree(on_edge).query(grid) if len(grid) else (np.zeros(0), None)
        points = np.concatenate([on_edge, grid[near > 0.7 * size]])
        triangles = Delaunay(points).simplices.astype(np.int64)
        missing = _missing(triangles, rings, len(points))
        if not any(lost.any() for lost in missing):
            ring = np.full(len(points), -1)
            ring[: len(on_edge)] = np.repeat(np.arange(len(rings)), [len(one) for one in rings])
            return Mesh(points, _kept(points, triangles, drawn, size), ring)
        rings = [_halved(ring, lost) for ring, lost in zip(rings, missing, strict=True)]
    raise SpecError("the section could not be cut into triangles; take out corners that nearly touch another edge")


def _divided(ring: Array, size: float) -> Array:
    following = np.roll(ring, -1, axis=0)
    pieces = []
    for a, b in zip(ring, following, strict=True):
        count = max(1, int(np.ceil(float(np.hypot(*(b - a))) / size)))
        pieces.append(a + (b - a) * (np.arange(count) / count)[:, None])
    return np.concatenate(pieces)


def _halved(ring: Array, lost: Mask) -> Array:
    middle = 0.5 * (ring + np.roll(ring, -1, axis=0))
    pairs = np.stack([ring, middle], axis=1)
    keep = np.stack([np.ones_like(lost), lost], axis=1)
    return np.asarray(pairs[keep])


def _grid(drawn: Outline, size: float) -> Array:
    low, high = drawn.outer.min(axis=0), drawn.outer.max(axis=0)
    rows = np.arange(low[1], high[1] + size, size * np.sqrt(0.75))
    columns = np.arange(low[0], high[0] + size, size)
    x, y = np.meshgrid(columns, rows)
    x[1::2] += 0.5 * size
    points = np.column_stack([x.ravel(), y.ravel()])
    return points[inside(points, drawn)]


def _missing(triangles: NDArray[np.int64], rings: list[Array], count: int) -> list[Mask]:
    pairs = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    known = pairs[:, 0] * count + pairs[:, 1]
    found, start = [], 0
    for ring in rings:
        index = start + np.arange(len(ring))
        edge = np.sort(np.column_stack([index, np.roll(index, -1)]), axis=1)
        found.append(~np.isin(edge[:, 0] * count + edge[:, 1], known))
        start += len(ring)
    return found


def _kept(points: Array, triangles: NDArray[np.int64], drawn: Outline, size: float) -> NDArray[np.int64]:
    a, b, c = (points[triangles[:, i]] for i in range(3))
    area = 0.5 * np.abs((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))
    return triangles[inside((a + b + c) / 3, drawn) & (area > _FLAT * size**2)]


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
