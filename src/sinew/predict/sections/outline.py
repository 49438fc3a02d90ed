"""This is where the shape of a cross-section is drawn: an outer ring of corners, and rings around its holes."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sinew.measure.errors import SpecError

__all__ = ["Outline", "annulus", "circle", "ellipse", "inside", "outline", "rectangle", "segments", "star"]

Array = NDArray[np.float64]

_CORNERS = 360
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


def circle(diameter: float, corners: int = _CORNERS) -> Outline:
    """Return a circle as a regular polygon with its corners on the circle [m]."""
    return ellipse(diameter, diameter, corners)


def annulus(outer: float, inner: float, corners: int = _CORNERS) -> Outline:
    """Return a ring between two diameters [m] as polygons. Raises SpecError unless 0 < inner < outer."""
    if not 0 < inner < outer:
        raise SpecError(f"an annulus of {inner:g} m inside and {outer:g} m outside; expected 0 < inner < outer")
    return Outline(circle(outer, corners).outer, (circle(inner, corners).outer[::-1],))


def ellipse(width: float, height: float, corners: int = _CORNERS) -> Outline:
    """Return an ellipse with two axes [m] as a polygon with its corners on the ellipse."""
    _refuse_sizes(width, height)
    angle = 2 * np.pi * np.arange(corners) / corners
    return Outline(np.column_stack([0.5 * width * np.cos(angle), 0.5 * height * np.sin(angle)]))


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


def inside(points: Array, drawn: Outline) -> NDArray[np.bool_]:
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
