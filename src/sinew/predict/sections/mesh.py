"""This is where a cross-section is cut into triangles."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, cKDTree

from sinew.measure.errors import SpecError
from sinew.predict.sections.outline import Outline, inside

__all__ = ["Mesh", "triangulate"]

Array = NDArray[np.float64]

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


def _halved(ring: Array, lost: NDArray[np.bool_]) -> Array:
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


def _missing(triangles: NDArray[np.int64], rings: list[Array], count: int) -> list[NDArray[np.bool_]]:
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
