"""Cross-sections: their outlines, and what bending, torsion and compression need to know of them.

By closed form where there is one, else from the outline: an outer ring of corners, and rings around its holes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve
from scipy.spatial import ConvexHull, Delaunay, cKDTree
from scipy.special import ellipe
from skfem import Basis, ElementTriP2, FacetBasis, LinearForm, MeshTri
from skfem.models.poisson import laplace, mass, unit_load

from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import FileError, SpecError

_TOUCH = 1e-9


class Outline(NamedTuple):
    """Corners in order [m]. outer: (n, 2), counter-clockwise; holes: each (m, 2), clockwise."""

    outer: Array
    holes: tuple[Array, ...] = ()

    @property
    def rings(self) -> tuple[Array, ...]:
        """Return the outer ring and those around holes."""
        return (self.outer, *self.holes)


def outline(outer: ArrayLike, holes: Sequence[ArrayLike] = ()) -> Outline:
    """Return the outline of a polygon from its corners [m], in either sense of rotation, with or without the first
    corner again at the end.

    outer: (n, 2). holes: each (m, 2). Raises SpecError where a ring has fewer than three corners, touches or crosses
    itself or another, or where a hole does not lie inside.
    """
    rings = [_ring(outer, "the outline", positive=True)]
    rings += [_ring(hole, f"hole {i + 1}", positive=False) for i, hole in enumerate(holes)]
    _refuse_crossings(rings)
    drawn = Outline(rings[0], tuple(rings[1:]))
    for i, hole in enumerate(drawn.holes):
        others = Outline(drawn.outer, drawn.holes[:i] + drawn.holes[i + 1 :])
        if not inside(hole[:1], others)[0]:
            raise SpecError(f"hole {i + 1} does not lie inside the outline, or lies in another hole; move it")
    return drawn


def rectangle(width: float, height: float) -> Outline:
    """Return a rectangle [m]."""
    _refuse_sizes(width, height)
    x, y = 0.5 * width, 0.5 * height
    return Outline(np.array([[-x, -y], [x, -y], [x, y], [-x, y]]))


def star(outer: float, inner: float, points: int) -> Outline:
    """Return a star with straight edges: its points on one circle, the corners between them on a smaller one.

    outer, inner: diameters of the circles [m]. Raises SpecError unless 0 < inner < outer and points is 2 or more.
    """
    if not 0 < inner < outer:
        raise SpecError(f"a star of {inner:g} m inside and {outer:g} m outside; expected 0 < inner < outer")
    if points < 3:
        raise SpecError(f"a star of {points} points; expected 3 or more")
    angle = np.pi * np.arange(2 * points) / points
    radius = 0.5 * np.where(np.arange(2 * points) % 2, inner, outer)
    return Outline(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))


def segments(drawn: Outline) -> tuple[Array, Array]:
    """Return begin and end of every edge, both (edge, 2)."""
    return np.concatenate(drawn.rings), np.concatenate([np.roll(ring, -1, axis=0) for ring in drawn.rings])


def inside(points: Array, drawn: Outline) -> Mask:
    """Return which points (n, 2) lie in the material, by the number of edges to the right of them."""
    begin, end = segments(drawn)
    x, y = points[:, :1], points[:, 1:]
    spans = (begin[:, 1] > y) != (end[:, 1] > y)
    rise = end[:, 1] - begin[:, 1]
    cross = begin[:, 0] + (y - begin[:, 1]) * (end[:, 0] - begin[:, 0]) / np.where(rise == 0, 1.0, rise)
    return np.asarray(np.sum(spans & (x < cross), axis=1) % 2 == 1)


def _refuse_sizes(width: float, height: float) -> None:
    if not (np.isfinite(width) and np.isfinite(height) and min(width, height) > 0):
        raise SpecError(f"a section of {width:g} m by {height:g} m; expected positive sizes")


def _ring(corners: ArrayLike, what: str, *, positive: bool) -> Array:
    ring = np.asarray(corners, dtype=float)
    if ring.ndim != 2 or ring.shape[1] != 2 or not np.isfinite(ring).all():
        raise SpecError(f"{what} has the shape {ring.shape}, expected rows of finite x and y")
    if len(ring) > 1 and np.allclose(ring[0], ring[-1], rtol=0, atol=_TOUCH * float(np.ptp(ring))):
        ring = ring[:-1]
    if len(ring) < 3:
        raise SpecError(f"{what} has {len(ring)} corners, expected 3 or more")
    following = np.roll(ring, -1, axis=0)
    twice = float(np.sum(ring[:, 0] * following[:, 1] - following[:, 0] * ring[:, 1]))
    if abs(twice) < _TOUCH * float(np.ptp(ring, axis=0).max()) ** 2:
        raise SpecError(f"{what} encloses no area; give its corners in order")
    return ring if (twice > 0) == positive else ring[::-1].copy()


def _side(a: Array, b: Array, c: Array) -> Array:
    """Return twice the signed area of triangles a, b, c."""
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    return np.asarray(ux * vy - uy * vx)


def _refuse_crossings(rings: list[Array]) -> None:
    begin = np.concatenate(rings)
    end = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    starts = np.cumsum([0, *map(len, rings)])
    after = np.concatenate([np.roll(np.arange(a, b), -1) for a, b in pairwise(starts)])
    rows, columns = np.triu_indices(len(begin), 1)
    apart = (after[rows] != columns) & (after[columns] != rows)
    rows, columns = rows[apart], columns[apart]
    a, b, c, d = begin[rows], end[rows], begin[columns], end[columns]
    astride = _side(a, b, c) * _side(a, b, d) <= 0
    across = _side(c, d, a) * _side(c, d, b) <= 0
    boxes = (np.minimum(a, b) <= np.maximum(c, d)) & (np.minimum(c, d) <= np.maximum(a, b))
    if np.any(astride & across & boxes.all(axis=1)):
        raise SpecError("edges of the section cross or touch each other; give the corners of each ring in order")


# Area and second moments of a polygon come from its corners, by Green's theorem.


class Moments(NamedTuple):
    """area [m²], centroid (x, y) [m], and about it the principal second moments [m⁴], the smaller one first;
    perimeter: of all rings [m]; outer_radius: of the farthest corner from the centroid [m]. wide_axis: direction of the
    principal axis with the smaller moment about it, from x towards y [rad]; zero where both are alike."""

    area: float
    centroid: tuple[float, float]
    least: float
    greatest: float
    perimeter: float
    outer_radius: float
    wide_axis: float = 0.0

    @property
    def polar(self) -> float:
        """Return the polar moment about the centroid [m⁴]."""
        return self.least + self.greatest


def moments(drawn: Outline) -> Moments:
    """Return area and moments of an outline: exact for a polygon.

    A ring of corners (x, y) adds A = ½ Σ c, Sx = ⅙ Σ c (x + x'), Ixx = 1/12 Σ c (x² + x x' + x'²) and so on, with
    c = x y' - x' y and ' the next corner; holes run the other way round and so subtract.
    """
    origin = drawn.outer.mean(axis=0)
    sums = np.zeros(6)
    length = 0.0
    for ring in drawn.rings:
        (x, y), (u, v) = (ring - origin).T, (np.roll(ring, -1, axis=0) - origin).T
        c = x * v - u * y
        length += float(np.sum(np.hypot(u - x, v - y)))
        sums += [
            np.sum(c) / 2,
            np.sum(c * (x + u)) / 6,
            np.sum(c * (y + v)) / 6,
            np.sum(c * (x * x + x * u + u * u)) / 12,
            np.sum(c * (y * y + y * v + v * v)) / 12,
            np.sum(c * (x * v + 2 * x * y + 2 * u * v + u * y)) / 24,
        ]
    area = sums[0]
    at = sums[1:3] / area
    xx, yy, xy = sums[3] - area * at[0] ** 2, sums[4] - area * at[1] ** 2, sums[5] - area * at[0] * at[1]
    half, swing = 0.5 * (xx + yy), float(np.hypot(0.5 * (xx - yy), xy))
    centroid = at + origin
    radius = float(np.max(np.hypot(*(drawn.outer - centroid).T)))
    # xx is ∫x² dA: the moment about y. Along the wide axis ∫ of the square is largest.
    wide = 0.5 * float(np.arctan2(2 * xy, xx - yy)) if swing > _TOUCH * half else 0.0
    least, greatest = float(half - swing), float(half + swing)
    return Moments(float(area), (float(centroid[0]), float(centroid[1])), least, greatest, length, radius, wide)


def centred(drawn: Outline) -> Outline:
    """Return the outline with its centroid at the origin."""
    at = np.array(moments(drawn).centroid)
    return Outline(drawn.outer - at, tuple(hole - at for hole in drawn.holes))


def corner_turns(drawn: Outline) -> NDArray[np.float64]:
    """Return by how much the edge turns at each corner of all rings [rad]; negative where the corner points into the
    material (a re-entrant corner)."""
    turns = []
    for ring in drawn.rings:
        edge = np.roll(ring, -1, axis=0) - ring
        before = np.roll(edge, 1, axis=0)
        turns.append(np.arctan2(before[:, 0] * edge[:, 1] - before[:, 1] * edge[:, 0], np.sum(before * edge, axis=1)))
    return np.concatenate(turns)


# The corners of a polygon are read from a text file.


def read_polygon(path: Path) -> Outline:
    """Return the outline in a file of one corner a line, x and y in mm with a comma, semicolon or blank between them.

    The first ring is the outer one; after an empty line each further ring is a hole. `#` begins a comment.
    Raises FileError where a line is no pair of numbers, SpecError where the rings make no section.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"cannot read {path}: {error}; expected a text file with x,y of one corner a line") from error
    rings: list[list[tuple[float, float]]] = [[]]
    for number, line in enumerate(lines, start=1):
        if line.lstrip().startswith("#"):
            continue
        words = line.split("#")[0].replace(",", " ").replace(";", " ").split()
        if not words:
            rings.append([])
            continue
        try:
            x, y = map(float, words)
        except ValueError as error:
            raise FileError(f"{path}, line {number}: found {line.strip()!r}, expected x and y in mm") from error
        rings[-1].append((1e-3 * x, 1e-3 * y))
    filled = [np.array(ring) for ring in rings if ring]
    if not filled:
        raise FileError(f"{path} holds no corners; expected x,y in mm of one corner a line")
    return outline(filled[0], filled[1:])


# A section in numbers.

_ROUND = np.linspace(0, 2 * np.pi, 36, endpoint=False)
"""Where the corners of an ellipse's hull lie: its edges are at most 0.4 % inside."""


@dataclass(frozen=True)
class Section:
    """What bending, torsion and compression need to know of a section, in SI.

    shape: in words. diameter: of the circle about the centroid that holds it [m]. area [m²], perimeter of all edges
    [m]. least, greatest: principal second moments [m⁴]. torsion_constant: St Venant's J [m⁴]; torsion_error: how far
    it may be off, as a share; zero for a closed form. warping_constant: Vlasov's, about the shear centre [m⁶].
    shear_arm: the largest shear strain per twist (rad/m) [m]; None where a re-entrant corner makes it unbounded.
    hull: corners of its convex hull about the centroid, the wide principal axis first [m]; None of a round one.
    """

    shape: str
    diameter: float
    area: float
    perimeter: float
    least: float
    greatest: float
    torsion_constant: float
    torsion_error: float
    warping_constant: float
    shear_arm: float | None
    hull: tuple[tuple[float, float], ...] | None = None

    @property
    def polar_moment(self) -> float:
        """Return the polar moment about the centroid [m⁴]; the torsion constant of a circle, and larger else."""
        return self.least + self.greatest

    @property
    def is_solid_circle(self) -> bool:
        """Return whether its diameter says everything of it."""
        return bool(abs(self.area / (np.pi * self.diameter**2 / 4) - 1) < 1e-12)


def circle_section(diameter: float) -> Section:
    """Return a solid circle [m]."""
    return _with_shape(ellipse_section(diameter, diameter), f"circle of {diameter * 1e3:g} mm")


def annulus_section(outer: float, inner: float) -> Section:
    """Return a ring between two diameters [m]: J = π (D⁴ - d⁴)/32; it does not warp.

    Raises SpecError unless 0 < inner < outer."""
    if not 0 < inner < outer:
        raise SpecError(
            f"an annulus of {outer * 1e3:g} mm outside and {inner * 1e3:g} mm inside; expected 0 < inner < outer"
        )
    polar = np.pi * (outer**4 - inner**4) / 32
    return Section(
        shape=f"annulus of {outer * 1e3:g} and {inner * 1e3:g} mm",
        diameter=outer,
        area=np.pi * (outer**2 - inner**2) / 4,
        perimeter=np.pi * (outer + inner),
        least=polar / 2,
        greatest=polar / 2,
        torsion_constant=polar,
        torsion_error=0.0,
        warping_constant=0.0,
        shear_arm=outer / 2,
    )


def ellipse_torsion(a: Any, b: Any) -> tuple[Any, Any, Any]:
    """Return (torsion constant [m⁴], warping constant [m⁶], shear arm [m]) of an ellipse with half axes a ≥ b [m].

    J = π a³ b³/(a² + b²), the warping is -(a² - b²)/(a² + b²) x y, the largest shear strain 2 a² b/(a² + b²) per twist
    (Timoshenko and Goodier). NumPy's numbers or JAX's.
    """
    squares, cubes = a**2 + b**2, np.pi * (a * b) ** 3
    return cubes / squares, ((a**2 - b**2) / squares) ** 2 * cubes / 24, 2 * a**2 * b / squares


def ellipse_section(width: float, height: float) -> Section:
    """Return an ellipse with two axes [m]. Raises SpecError where a size is not positive."""
    if not (np.isfinite(width) and np.isfinite(height) and min(width, height) > 0):
        raise SpecError(f"an ellipse of {width * 1e3:g} mm by {height * 1e3:g} mm; expected positive sizes")
    a, b = max(width, height) / 2, min(width, height) / 2
    torsion_constant, warping_constant, shear_arm = ellipse_torsion(a, b)
    return Section(
        shape=f"ellipse of {width * 1e3:g} by {height * 1e3:g} mm",
        diameter=2 * a,
        area=np.pi * a * b,
        perimeter=float(4 * a * ellipe(1 - (b / a) ** 2)),
        least=np.pi * a * b**3 / 4,
        greatest=np.pi * a**3 * b / 4,
        torsion_constant=torsion_constant,
        torsion_error=0.0,
        warping_constant=warping_constant,
        shear_arm=shear_arm,
        hull=None if a == b else _corners(np.column_stack([a * np.cos(_ROUND), b * np.sin(_ROUND)])),
    )


def rectangle_section(width: float, height: float) -> Section:
    """Return a rectangle [m]; torsion by finite elements. Raises SpecError where a size is not positive."""
    return section_of_outline(rectangle(width, height), f"rectangle of {width * 1e3:g} by {height * 1e3:g} mm")


def star_section(outer: float, inner: float, points: int) -> Section:
    """Return a star between two diameters [m]; torsion by finite elements. Raises SpecError as `star` does."""
    shape = f"star of {points} points, {outer * 1e3:g} and {inner * 1e3:g} mm"
    return section_of_outline(star(outer, inner, points), shape)


def section_of_outline(drawn: Outline, shape: str) -> Section:
    """Return any polygon: moments are exact, torsion and warping come from finite elements.

    Raises SpecError where the outline cannot be cut into triangles."""
    about, torsion = moments(drawn), solve_torsion(drawn)
    return Section(
        shape=shape,
        diameter=2 * about.outer_radius,
        area=about.area,
        perimeter=about.perimeter,
        least=about.least,
        greatest=about.greatest,
        torsion_constant=torsion.constant,
        torsion_error=0.5 * (torsion.bounds[1] - torsion.bounds[0]) / torsion.constant,
        warping_constant=torsion.warping,
        shear_arm=torsion.shear_arm,
        hull=_hull(drawn),
    )


def _hull(drawn: Outline) -> tuple[tuple[float, float], ...]:
    """Return the corners of an outline's convex hull about its centroid, the wide principal axis first [m]."""
    about = moments(drawn)
    corners = drawn.outer[ConvexHull(drawn.outer).vertices] - np.array(about.centroid)
    cos, sin = np.cos(about.wide_axis), np.sin(about.wide_axis)
    return _corners(corners @ np.array([[cos, -sin], [sin, cos]]))


def _corners(points: Array) -> tuple[tuple[float, float], ...]:
    return tuple((float(x), float(y)) for x, y in points)


def _with_shape(section: Section, shape: str) -> Section:
    return Section(**{**section.__dict__, "shape": shape})


# St Venant's torsion of a section that has no closed form, solved from two sides by finite elements.
#
# Per twist θ' [rad/m] a section warps by θ' ψ(x, y) and carries the shear stress G θ' rot(u). The warping ψ minimises
# ∫ (ψ_x - y)² + (ψ_y + x)², and that minimum is the torsion constant: elements give it too large. Prandtl's function u
# solves Δu = -2, is zero on the outer edge and constant on each hole, and J = 2 ∫ u + 2 Σ u_hole A_hole: elements give
# it too small. The true constant lies between the two (Timoshenko and Goodier, Theory of Elasticity, chapter 10).


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
            return Mesh(points, _inner_triangles(points, triangles, drawn, size), ring)
        rings = [_split(ring, lost) for ring, lost in zip(rings, missing, strict=True)]
    raise SpecError("the section could not be cut into triangles; take out corners that nearly touch another edge")


def _divided(ring: Array, size: float) -> Array:
    following = np.roll(ring, -1, axis=0)
    pieces = []
    for a, b in zip(ring, following, strict=True):
        count = max(1, int(np.ceil(float(np.hypot(*(b - a))) / size)))
        pieces.append(a + (b - a) * (np.arange(count) / count)[:, None])
    return np.concatenate(pieces)


def _split(ring: Array, lost: Mask) -> Array:
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


def _inner_triangles(points: Array, triangles: NDArray[np.int64], drawn: Outline, size: float) -> NDArray[np.int64]:
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
