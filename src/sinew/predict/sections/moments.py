"""This is where area and second moments of a polygon come from its corners, by Green's theorem."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sinew.predict.sections.outline import Outline

__all__ = ["Moments", "centred", "corner_turns", "moments"]


class Moments(NamedTuple):
    """area [m²], centroid (x, y) [m], and about it the principal second moments [m⁴], the smaller one first;
    perimeter: of all rings [m]; outer_radius: of the farthest corner from the centroid [m]."""

    area: float
    centroid: tuple[float, float]
    least: float
    greatest: float
    perimeter: float
    outer_radius: float

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
    return Moments(
        float(area), (float(centroid[0]), float(centroid[1])), float(half - swing), float(half + swing), length, radius
    )


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
