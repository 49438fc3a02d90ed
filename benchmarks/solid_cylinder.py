"""The short bonded cylinder against finite elements: `python -m benchmarks solid`.

The twin takes the silicone for a beam: torsional stiffness G J/(L λ), axial force G A (λ - 1/λ²), as if both ends could
widen freely. They are bonded to rigid plates. Finite elements of the incompressible neo-Hookean solid say what that
changes, over slenderness and compression. All motions are incremental about a compressed state of balance; the modulus
does not matter.
"""

import time
from typing import NamedTuple

import numpy as np

from benchmarks.cylinder_mesh import ANGLE, Cylinder, axisymmetric_cylinder, eighth_of_cylinder
from benchmarks.solid import Indices, balance, held_stiffness, settled
from sinew.measure.arrays import Array

DIAMETER_M, LENGTH_M = 0.056, 0.095
SLENDERNESS = (0.5, 1.0, LENGTH_M / DIAMETER_M, 3.0, 5.0)
COMPRESSIONS = (0.0, 0.05, 0.10)


class Stiffness(NamedTuple):
    """Of the whole cylinder at a stretch λ, for a shear modulus of 1 Pa: axial force [N] (negative where compressed),
    its derivative by the length [N/m], torque by torsion [N m/rad]."""

    force: float
    axial: float
    torsional: float


def beam(radius: float, length: float, stretch: float) -> Stiffness:
    """Return what the twin says: W = (L/2) [A (λ² + 2/λ - 3) + J φ²/(L² λ)] and its derivatives."""
    area, polar = np.pi * radius**2, np.pi * radius**4 / 2
    return Stiffness(area * (stretch - stretch**-2), area / length * (1 + 2 * stretch**-3), polar / (length * stretch))


def shape_factor_formula(radius: float, length: float) -> float:
    """Return the axial stiffness of a bonded disc as a multiple of E A/L, 1 + 2 S² with S = d/(4 L).

    Gent and Lindley, The compression of bonded rubber blocks (1959): for blocks that are not slender.
    """
    return 1 + 2 * (radius / (2 * length)) ** 2


def _symmetric(cylinder: Cylinder, *, bonded: bool) -> tuple[Indices, Indices]:
    """Return (unknowns held at zero, axial ones of the end) of a motion that is a mirror image in every plane."""
    at, end = cylinder.at, 0.5 * cylinder.length
    flat = at(1, 1, 0.0) if cylinder.where[1].any() else np.flatnonzero(cylinder.kind == ANGLE)
    rest = [at(0, 0, 0.0), flat, at(2, 2, 0.0), *([at(0, 2, end), at(1, 2, end)] if bonded else [])]
    return np.unique(np.concatenate(rest)), at(2, 2, end)


def _turning(cylinder: Cylinder, d: Array) -> tuple[Indices, Array, Array]:
    """Return (held unknowns, first and second derivative of all by the torsion) of a turn of the end by half of it.

    d: the state that is turned. The motion is odd in every mirror plane. In x and y a turn has a second derivative,
    which bends the path of the end's forces.
    """
    at, end = cylinder.at, 0.5 * cylinder.length
    first, second = np.zeros((2, cylinder.solid.total))
    if not cylinder.where[1].any():
        turned = at(ANGLE, 2, end)
        first[turned] = 0.5
        return np.concatenate([turned, at(ANGLE, 2, 0.0), np.flatnonzero(cylinder.kind != ANGLE)]), first, second
    x, y = at(0, 2, end), at(1, 2, end)
    now_x, now_y = cylinder.where[0, x] + d[x], cylinder.where[1, y] + d[y]
    first[x], first[y] = -0.5 * now_y, 0.5 * now_x
    second[x], second[y] = -0.25 * now_x, -0.25 * now_y
    # On a mirror plane an odd motion has no part along it, and no pressure.
    planes = [at(kind, axis, 0.0) for axis in range(3) for kind in range(4) if kind != axis]
    return np.unique(np.concatenate([x, y, at(2, 2, end), *planes])), first, second


def stiffness(cylinder: Cylinder, stretch: float, *, bonded: bool = True, steps: int = 2) -> Stiffness:
    """Return the stiffness of a cylinder whose ends keep a distance λ L, and turn about the axis.

    bonded: to plates, so that the ends cannot widen; else they slide, and the motion is that of the beam.
    steps: of the compression.
    """
    zero, end = _symmetric(cylinder, bonded=bonded)
    held = np.concatenate([zero, end])
    d = np.zeros(cylinder.solid.total)
    for part in np.linspace(0, 1, steps + 1)[1:]:
        shift = np.full(end.size, 0.5 * part * (stretch - 1) * cylinder.length)
        d = settled(cylinder.solid, d, held, np.concatenate([np.zeros(zero.size), shift]))
    now = balance(cylinder.solid, d)
    around = 1.0 if not cylinder.where[1].any() else 4.0
    pull = np.zeros(cylinder.solid.total)
    pull[end] = 0.5
    # The mesh is one end's half (or a quarter of it): both halves store the energy of half the motion.
    axial = 2 * around * held_stiffness(now.stiffness, held, pull)
    held, first, second = _turning(cylinder, d)
    torsional = 2 * around * (held_stiffness(now.stiffness, held, first) + float(now.forces @ second))
    return Stiffness(around * float(np.sum(now.forces[end])), axial, torsional)


def deviation(found: Stiffness, radius: float, length: float, stretch: float) -> Stiffness:
    """Return by how much a cylinder is stiffer than the beam, [1]; the force is not a number without compression."""
    told = beam(radius, length, stretch)
    return Stiffness(*(a / b - 1 if b else np.nan for a, b in zip(found, told, strict=True)))


def lost_length(excess: float, slenderness: float) -> float:
    """Return by how many diameters a beam would be shorter that is stiffer by an excess [1] along its axis."""
    return slenderness * excess / (1 + excess)


def _told(found: Stiffness) -> str:
    cells = [("" if np.isnan(x) else f"{100 * x:+.2f}").rjust(9) for x in found]
    return "".join(cells)


def _solid_check() -> None:
    length = 2 * LENGTH_M / DIAMETER_M
    print(
        f"the bonded cylinder, {1e3 * DIAMETER_M:g} mm by {1e3 * LENGTH_M:g} mm, hexahedra of 27 nodes, an eighth of it"
    )
    print("  finite elements above the beam [%]      force    axial  torsion   unknowns")
    for stretch in (1.0, 0.9):
        for parts, layers in ((2, 4), (3, 6)):
            begin = time.perf_counter()
            cylinder = eighth_of_cylinder(1.0, length, parts, layers)
            found = deviation(stiffness(cylinder, stretch), 1.0, length, stretch)
            print(f"  compressed by {100 * (1 - stretch):2.0f} %, {parts:2} by {layers:2}     {_told(found)}"
                  f"{cylinder.solid.total:11}   {time.perf_counter() - begin:.0f} s")  # fmt: skip
        found = deviation(stiffness(axisymmetric_cylinder(1.0, length, 16, 32), stretch), 1.0, length, stretch)
        print(f"  compressed by {100 * (1 - stretch):2.0f} %, axisymmetric{_told(found)}")


def _table() -> None:
    print("axisymmetric finite elements above the beam [%], and 1 + 2 S² of Gent and Lindley")
    print("  length/diameter  compressed    force    axial  torsion   1 + 2 S²   shorter by, in diameters")
    for slenderness in SLENDERNESS:
        length = 2 * slenderness
        cylinder = axisymmetric_cylinder(1.0, length, 16, 32)
        for compression in COMPRESSIONS:
            found = deviation(stiffness(cylinder, 1 - compression), 1.0, length, 1 - compression)
            formula = f"{100 * (shape_factor_formula(1.0, length) - 1):+11.2f}" if not compression else " " * 11
            lost = lost_length(found.axial, slenderness)
            print(f"  {slenderness:15.2f}  {100 * compression:8.0f} %{_told(found)}{formula}{lost:14.3f}")


def main() -> None:
    """Print how far the beam is from the solid: in three dimensions, and over slenderness and compression."""
    _solid_check()
    _table()


if __name__ == "__main__":
    main()
