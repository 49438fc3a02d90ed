"""The rod in bending against finite elements of the solid: `python -m benchmarks rod`.

Two motions of a cylinder between rigid plates without friction, that was compressed first: its plates tilt against each
other, their middles kept where they are; and it sways sideways under plates that stay parallel, at the load where it
does so by itself. The plates leave the ends free to widen and to slide, and hold them sideways on average alone, so the
problem is the rod's own: with bonded ends the solid is stiffer by what the ends do, which is not in the rod.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from scipy.sparse import bmat, csr_matrix
from scipy.sparse.linalg import splu

from benchmarks.cylinder_mesh import Cylinder, eighth_of_cylinder
from benchmarks.solid import Indices, balance, settled
from benchmarks.solid_cylinder import DIAMETER_M, LENGTH_M
from sinew.measure.arrays import Array
from sinew.mechanics.rod import SHEAR_FACTOR, Rod, rod_energy, rod_poses, straight
from sinew.mechanics.silicone import compressive_load
from sinew.plan.toml import load_rig
from sinew.solve.programs import configure
from sinew.twin.parameters import space_from_rig

EXACT_LOADS = {0.05: 0.01861, 0.10: 0.07572, 0.15: 0.17566, 0.20: 0.32732, 0.25: 0.54749, 0.296: 0.83658, 0.35: 1.33637}
"""Critical load over G A of the exact incremental solution between guided plates, by radius over length."""

COMPRESSIONS = {0.15: (0.0, 0.02), 0.25: (0.0, 0.05), 0.5 * DIAMETER_M / LENGTH_M: (0.0, 0.05, 0.10)}
"""By radius over length; the last one is the paper's."""
_PRESSURE = 3
_PLANE = (2, 3, 4)
"""Strains of a rod that bends in a plane: bend about z, stretch, shear along y."""


class Ends(NamedTuple):
    """Where a compressed cylinder is held (sideways on average only): unknowns at its upper end."""

    across: Indices
    along: Indices
    mean: Array


def compressed(cylinder: Cylinder, stretch: float) -> Array:
    """Return the unknowns of a cylinder between plates without friction, at a stretch."""
    at, end = cylinder.at, 0.5 * cylinder.length
    zero = np.unique(np.concatenate([at(kind, kind, 0.0) for kind in range(3)]))
    pushed = at(2, 2, end)
    goal = np.concatenate([np.zeros(zero.size), np.full(pushed.size, (stretch - 1) * end)])
    return settled(cylinder.solid, np.zeros(cylinder.solid.total), np.concatenate([zero, pushed]), goal)


def ends_of(cylinder: Cylinder) -> Ends:
    """Return the ends; mean: weights with which motions across average over the end, as an even pressure would."""
    at, end = cylinder.at, 0.5 * cylinder.length
    across, along = at(0, 2, end), at(2, 2, end)
    pressed = balance(cylinder.solid, compressed(cylinder, 0.99)).forces[along]
    place = {tuple(np.round(cylinder.where[:, i], 9)): f for i, f in zip(along, pressed, strict=True)}
    mean = np.array([place[tuple(np.round(cylinder.where[:, i], 9))] for i in across])
    return Ends(across, along, mean / mean.sum())


def pressing(cylinder: Cylinder, ends: Ends, stretch: float) -> float:
    """Return the force that compresses it to a stretch, for a shear modulus of 1 Pa [N]."""
    return -4 * float(np.sum(balance(cylinder.solid, compressed(cylinder, stretch)).forces[ends.along]))


def tilting(cylinder: Cylinder, ends: Ends, stretch: float) -> float:
    """Return the stiffness against the tilt of the plates to each other, for a shear modulus of 1 Pa [N m/rad].

    The motion is odd in x and even in y and z; with the plates' middles kept, an even pressure does no work on it.
    """
    at, d = cylinder.at, compressed(cylinder, stretch)
    matrix = balance(cylinder.solid, d).stiffness
    planes = [at(1, 0, 0.0), at(2, 0, 0.0), at(_PRESSURE, 0, 0.0), at(1, 1, 0.0), at(2, 2, 0.0)]
    moved = np.zeros(cylinder.solid.total)
    where = cylinder.where[0, ends.along]
    x_of = {tuple(np.round(cylinder.where[:, i], 9)): d[i] for i in ends.across}
    now = where + np.array([x_of[tuple(np.round(cylinder.where[:, i], 9))] for i in ends.along])
    moved[ends.along] = -0.5 * now
    held = np.unique(np.concatenate([ends.along, *planes]))
    free = np.setdiff1d(np.arange(cylinder.solid.total), held)
    row = np.zeros(cylinder.solid.total)
    row[ends.across] = ends.mean
    rows = matrix[free]
    blocks: list[list[csr_matrix | None]] = [
        [rows[:, free], csr_matrix(row[free][:, None])],
        [csr_matrix(row[free]), None],
    ]
    whole = bmat(blocks).tocsc()
    moved[free] = splu(whole).solve(np.append(-(rows @ moved), 0.0))[:-1]
    return 8 * float(moved @ (matrix @ moved))


def sway(cylinder: Cylinder, ends: Ends, stretch: float) -> float:
    """Return the stiffness of parallel plates against sideways forces, even over them; zero at the critical load.

    The motion is even in x and y and odd in z: the middle stays, the plates slide against each other.
    """
    at = cylinder.at
    matrix = balance(cylinder.solid, compressed(cylinder, stretch)).stiffness
    planes = [at(1, 0, 0.0), at(2, 0, 0.0), at(_PRESSURE, 0, 0.0), at(1, 1, 0.0)]
    middle = [at(0, 2, 0.0), at(1, 2, 0.0), at(_PRESSURE, 2, 0.0)]
    held = np.unique(np.concatenate([ends.along, *planes, *middle]))
    free = np.setdiff1d(np.arange(cylinder.solid.total), held)
    push = np.zeros(cylinder.solid.total)
    push[ends.across] = ends.mean
    return 1 / float(push[free] @ splu(matrix[free][:, free].tocsc()).solve(push[free]))


def unit_rod(length: float) -> Rod:
    """Return our rod of radius 1 m and shear modulus 1 Pa, elastic."""
    rod = space_from_rig(load_rig("paper")).rod
    area, moment, zero = np.pi, jnp.asarray(np.pi / 4), jnp.zeros(())
    joint = rod.joint._replace(
        length=jnp.asarray(length),
        torsional_rigidity=jnp.asarray(2 * moment),
        axial_rigidity=jnp.asarray(area),
        warping_rigidity=zero,
    )
    return rod._replace(
        joint=joint, rest_bend=(zero, zero), bending=(moment, moment), shear=jnp.asarray(SHEAR_FACTOR * area)
    )


def _spread(flat: jax.Array) -> jax.Array:
    return straight().at[jnp.array(_PLANE)].set(flat.reshape(len(_PLANE), -1))


@jax.jit
def _planar(flat: jax.Array, rod: Rod) -> tuple[jax.Array, jax.Array]:
    """Return slopes and second derivatives of (energy, the end's angle, its place along and across), (4, ...)."""

    def values(at: jax.Array) -> jax.Array:
        q = _spread(at)
        rotations, positions = rod_poses(q, rod)
        angle = jnp.arctan2(rotations[-1][1, 0], rotations[-1][0, 0])
        return jnp.stack([rod_energy(q, rod), angle, positions[-1][0], positions[-1][1]])

    def slopes(at: jax.Array) -> tuple[jax.Array, jax.Array]:
        first = jax.jacfwd(values)(at)
        return first, first

    second, first = jax.jacfwd(slopes, has_aux=True)(flat)
    return first, second


def _pressed(stretch: float, rod: Rod) -> tuple[Array, Array, Array]:
    """Return (slopes of the end's angle and place, second derivative of the energy less its forces' work, forces)."""
    terms = straight().shape[1]
    flat = np.zeros(len(_PLANE) * terms)
    flat[terms] = stretch - 1
    first, second = (np.asarray(leaf) for leaf in _planar(flat, rod))
    forces = np.linalg.lstsq(first[1:].T, first[0], rcond=None)[0]
    return first[1:], second[0] - np.tensordot(forces, second[1:], 1), forces


def rod_tilting(length: float, stretch: float) -> float:
    """Return our rod's stiffness against the tilt of its ends to each other, their middles kept [N m/rad].

    Seen from the foot the end turns by β and its middle lies on a circle of the compressed length, at β/2.
    """
    by, bend, forces = _pressed(stretch, unit_rod(length))
    span = stretch * length
    first, second = np.array([1.0, 0.0, 0.5 * span]), np.array([0.0, -0.25 * span, 0.0])
    # least uᵀHu with J u as asked, and what the bent path of the end adds
    whole = np.block([[bend, by.T], [by, np.zeros((3, 3))]])
    u = np.linalg.solve(whole, np.concatenate([np.zeros(bend.shape[0]), first]))[: bend.shape[0]]
    return float(u @ bend @ u + forces @ second)


def rod_sway(length: float, stretch: float) -> float:
    """Return the least stiffness of our rod between parallel plates that slide [J]; zero at the critical load."""
    by, bend, _ = _pressed(stretch, unit_rod(length))
    _, _, rows = np.linalg.svd(by[:2])
    free = rows[2:].T
    return float(np.linalg.eigvalsh(free.T @ bend @ free)[0])


def critical(stiffness: Callable[[float], float], low: float, high: float) -> float:
    """Return the load over G A at which a stiffness of the stretch vanishes between two stretches."""
    return float(compressive_load(1.0, scipy.optimize.brentq(stiffness, low, high, xtol=1e-5)))


def mesh(ratio: float) -> Cylinder:
    """Return an eighth of a cylinder of radius one, by its radius over length."""
    return eighth_of_cylinder(1.0, 1 / ratio, 2, 4 if ratio > 0.2 else 6)


def _above(ours: float, theirs: float) -> str:
    return f"{100 * (ours / theirs - 1):+.2f} %"


def main() -> None:
    """Print the rod's bending beside the solid's."""
    configure()
    print("the rod in bending beside finite elements, plates without friction (wanted: within 3 %)")
    for ratio, compressions in COMPRESSIONS.items():
        solid = mesh(ratio)
        ends = ends_of(solid)
        for compression in compressions:
            stretch = 1 - compression
            ours, theirs = rod_tilting(1 / ratio, stretch), tilting(solid, ends, stretch)
            head = f"  radius/length {ratio:.3f}, compressed by {100 * compression:2.0f} %"
            print(f"{head}: tilting {ours:.5f} of the rod, {theirs:.5f} of the solid, {_above(ours, theirs)}")
            if compression:
                ours, theirs = np.pi * compressive_load(1.0, stretch), pressing(solid, ends, stretch)
                print(f"{head}: force   {ours:.5f} of the rod, {theirs:.5f} of the solid, {_above(ours, theirs)}")

        def rod(stretch: float, ratio: float = ratio) -> float:
            return rod_sway(1 / ratio, stretch)

        def block(stretch: float, solid: Cylinder = solid, ends: Ends = ends) -> float:
            return sway(solid, ends, stretch)

        own = scipy.optimize.brentq(rod, 0.7, 0.99)
        ours, theirs = critical(rod, 0.7, 0.99), critical(block, own - 0.02, own + 0.02)
        exact = f", exactly {EXACT_LOADS[ratio]:.5f}" if ratio in EXACT_LOADS else ""
        print(f"  radius/length {ratio:.3f}, critical load over G A: {ours:.5f} of the rod, {theirs:.5f} of the solid"
              f"{exact}, {_above(ours, theirs)}")  # fmt: skip


if __name__ == "__main__":
    main()
