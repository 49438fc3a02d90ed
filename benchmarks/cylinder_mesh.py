"""Meshes of a cylinder: an eighth of it in three dimensions, or a quarter of the plane through its axis.

The cylinder stands on both sides of its middle plane z = 0; its ends are at z = ±L/2 and the meshes have the upper one.
Layers get thinner towards the end, where the edge of a bonded end concentrates the strain. The material is
incompressible and neo-Hookean with a shear modulus of one.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from skfem import Basis, ElementHex1, ElementHex2, ElementQuad1, ElementQuad2, MeshHex1, MeshHex2, MeshQuad, MeshQuad2

from benchmarks.solid import Energy, Indices, Solid
from sinew.measure.arrays import Array

ANGLE = 1
"""Kind of the unknowns that are rotations, in the axisymmetric cylinder."""

_PRESSURE = 3
_ORDER = 5
_CORE, _PULLED = 0.55, 0.12


class Cylinder(NamedTuple):
    """A meshed cylinder of a radius and length [m], and which of its unknowns are what.

    where: places of the unknowns, (3, count): x, y, z, or in the plane radius, 0, z. kind: of each unknown, (count,):
    0, 1, 2 the displacements along these (in the plane 1 is the rotation), 3 the pressure.
    """

    solid: Solid
    where: Array
    kind: Indices
    radius: float
    length: float

    def at(self, kind: int, axis: int, value: float) -> Indices:
        """Return the unknowns of a kind whose place along an axis has a value [m]."""
        near = np.abs(self.where[axis] - value) < 1e-6 * self.radius
        return np.flatnonzero(near & (self.kind == kind))


def _solid_energy(v: jax.Array, place: jax.Array) -> jax.Array:
    f = v[:9].reshape(3, 3) + jnp.eye(3)
    a, b, c = f
    j = jnp.dot(a, jnp.cross(b, c))
    return 0.5 * (jnp.sum(f * f) - 3 - 2 * jnp.log(j)) + v[9] * (j - 1)


def _revolved_energy(v: jax.Array, place: jax.Array) -> jax.Array:
    """v: u, u_R, u_Z, ϑ_R, ϑ_Z, w_R, w_Z, p of the motion r = R + u, θ = Θ + ϑ, z = Z + w; place: R."""
    r = place[0] + v[0]
    hoop = r / place[0]
    plane = (1 + v[1]) * (1 + v[6]) - v[2] * v[5]
    squares = (1 + v[1]) ** 2 + v[2] ** 2 + v[5] ** 2 + (1 + v[6]) ** 2 + hoop**2 + r**2 * (v[3] ** 2 + v[4] ** 2)
    j = hoop * plane
    return 0.5 * (squares - 3 - 2 * jnp.log(j)) + v[7] * (j - 1)


def _layers(length: float, count: int) -> Array:
    """Return heights from the middle plane to the end, (count + 1,); the last layer is the thinnest."""
    left = 1 - np.linspace(0, 1, count + 1)
    return np.asarray(0.5 * length * (1 - 0.4 * left - 0.6 * left**2))


def _quarter_disc(radius: float, parts: int) -> MeshQuad:
    """Return a quarter of a disc: a block by the axis with its corner pulled back, and two between it and the rim."""
    even = np.linspace(0, 1, parts + 1)
    block = MeshQuad.init_tensor(even, even)
    a, b = block.p
    core = _CORE * radius * np.stack([a, b]) * (1 - _PULLED * a * b)
    edge = _CORE * radius * np.stack([np.ones_like(b), b]) * (1 - _PULLED * b)
    rim = radius * np.stack([np.cos(b * np.pi / 4), np.sin(b * np.pi / 4)])
    right = (1 - a) * edge + a * rim
    return MeshQuad(core, block.t) + MeshQuad(right, block.t) + MeshQuad(right[::-1], block.t[[0, 3, 2, 1]])


def _extruded(disc: MeshQuad, heights: Array) -> MeshHex1:
    count, (a, b, c, d) = disc.p.shape[1], disc.t
    places = [np.vstack([disc.p, np.full(count, z)]) for z in heights]
    hexahedra = [
        np.vstack([c + up, c + low, b + up, d + up, b + low, d + low, a + up, a + low])
        for low, up in ((count * i, count * (i + 1)) for i in range(heights.size - 1))
    ]
    return MeshHex1(np.concatenate(places, axis=1), np.concatenate(hexahedra, axis=1))


def _rounded(mesh: MeshHex2, radius: float, parts: int) -> MeshHex2:
    """Return the mesh with the middles of the rim's edges and faces moved out to the rim."""
    places = mesh.doflocs.copy()
    out = np.hypot(places[0], places[1])
    chord = radius * np.cos(np.pi / (8 * parts))
    rim = out > chord * (1 - 1e-6)  # the library places these nodes to about 1e-8
    places[:2, rim] *= radius / out[rim]
    return MeshHex2(places, mesh.t)


def _solid(energy: Energy, fine: Basis, coarse: Basis, rows: list[tuple[int, int | None]], around: bool) -> Cylinder:
    """Return the solid whose numbers v are `rows` (kind, axis of the derivative or None) and the pressure.

    around: whether the mesh is in the plane of radius and height, and counts all the way round.
    """
    n, width = fine.N, fine.Nbfun
    shape = fine.dx.shape
    maps = np.zeros((*shape, len(rows) + 1, 3 * width + coarse.Nbfun))
    for k, (kind, axis) in enumerate(rows):
        for i in range(width):
            field = fine.basis[i][0]
            maps[:, :, k, kind * width + i] = np.asarray(field) if axis is None else field.grad[axis]
    for i in range(coarse.Nbfun):
        maps[:, :, -1, 3 * width + i] = np.asarray(coarse.basis[i][0])
    dofs = fine.dofs.element_dofs.T
    unknowns = np.concatenate([dofs, dofs + n, dofs + 2 * n, coarse.dofs.element_dofs.T + 3 * n], axis=1)
    place = np.moveaxis(np.asarray(fine.global_coordinates()), 0, 2)
    weight = fine.dx * (2 * np.pi * place[:, :, 0] if around else 1.0)
    where = np.concatenate([fine.doflocs, fine.doflocs, fine.doflocs, coarse.doflocs], axis=1)
    if around:
        where = np.stack([where[0], np.zeros_like(where[0]), where[1]])
    kinds = np.repeat([0, 1, 2, _PRESSURE], [n, n, n, coarse.N])
    solid = Solid(energy, maps, weight, place, unknowns, kinds.size)
    return Cylinder(solid, where, kinds, float(np.max(where[0])), 2 * float(np.max(where[2])))


def eighth_of_cylinder(radius: float, length: float, parts: int, layers: int) -> Cylinder:
    """Return an eighth of a cylinder, x, y, z >= 0, in hexahedra with 27 nodes.

    parts: elements along a side of each of the three blocks of the quarter disc.
    """
    mesh = MeshHex2.from_mesh(_extruded(_quarter_disc(radius, parts), _layers(length, layers)))
    fine = Basis(_rounded(mesh, radius, parts), ElementHex2(), intorder=_ORDER)
    rows = [(kind, axis) for kind in range(3) for axis in range(3)]
    return _solid(_solid_energy, fine, fine.with_element(ElementHex1()), list(rows), around=False)


def axisymmetric_cylinder(radius: float, length: float, parts: int, layers: int) -> Cylinder:
    """Return the upper half of a cylinder as a rectangle of radius and height, in quadrilaterals with 9 nodes.

    The motion may turn about the axis by an angle that depends on both, so that torsion of any size is in it.
    """
    rim = np.linspace(0, 1, parts + 1)
    mesh = MeshQuad2.from_mesh(MeshQuad.init_tensor(radius * (1.4 * rim - 0.4 * rim**2), _layers(length, layers)))
    fine = Basis(mesh, ElementQuad2(), intorder=_ORDER)
    rows = [(0, None), (0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)]
    return _solid(_revolved_energy, fine, fine.with_element(ElementQuad1()), list(rows), around=True)
