"""Rod: the continuum with all six strains, their energy, and the poses that they add up to.

Strains are those of a section's frame along the reference length s: curvatures κ = (twist, bend about y, bend about z)
[1/m] and the tangent ν = (stretch, shear along y, shear along z) [1], both in the section's own axes. Each is a sum of
Legendre polynomials of s/L; the coordinates are their coefficients, those of the curvatures times the length, so that a
constant twist of 0.1 rad is 0.1.
"""

from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.polynomial import legendre

from sinew.measure.arrays import Array
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.silicone import relaxation_times, twist_rigidity

STRAINS = ("twist", "bend_y", "bend_z", "stretch", "shear_y", "shear_z")
TERMS = 3
"""Polynomials for each strain: orders 0 to 2, which is within 1 % of order 3 in all modes below 12 Hz."""

NODES = 6
"""Sections at which energies are summed and poses are known, by the rule of Gauss: exact up to degree 11."""

SHEAR_FACTOR = 0.9
"""Share of the section that carries shear; of a solid circle, ν = ½ (Cowper: 6 (1+ν)/(7+6ν) = 0.9)."""


_Pair = tuple[jax.Array, jax.Array]


class Rod(NamedTuple):
    """What a continuum is made of, in SI; each leaf is a scalar or has a leading lane axis.

    joint: its numbers in torsion and compression. rest_bend: curvatures about y and z at which it was cast, times the
    length [rad]. bending: G·I_y, G·I_z [N m²]. shear: k·G·A [N]. line_mass: ρA [kg/m]. line_inertia: ρ(I_y + I_z),
    ρI_y, ρI_z [kg m].
    """

    joint: Parameters
    rest_bend: tuple[jax.Array, jax.Array]
    bending: tuple[jax.Array, jax.Array]
    shear: jax.Array
    line_mass: jax.Array
    line_inertia: tuple[jax.Array, jax.Array, jax.Array]


class _Grid(NamedTuple):
    weights: Array  # of the nodes; they add up to one
    at_nodes: Array  # polynomials at the nodes (node, term)
    steps: Array  # length of the way to each node and from the last one to the end (step,)
    within: Array  # polynomials at the two points of Gauss in each of these ways (step, 2, term)


@cache
def grid(terms: int = TERMS, nodes: int = NODES) -> _Grid:
    """Return where strains are asked for, as shares of the length."""
    roots, weights = legendre.leggauss(nodes)
    ends = np.concatenate([[-1.0], roots, [1.0]])
    middle, half = 0.5 * (ends[1:] + ends[:-1]), 0.5 * np.diff(ends)
    points = middle[:, None] + half[:, None] * np.array([-1.0, 1.0]) / np.sqrt(3.0)
    return _Grid(0.5 * weights, legendre.legvander(roots, terms - 1), half, legendre.legvander(points, terms - 1))


def rest_strains(rod: Rod) -> jax.Array:
    """Return the six strains of the unloaded rod, curvatures times the length: (6,)."""
    one, zero = jnp.ones_like(rod.shear), jnp.zeros_like(rod.shear)
    return jnp.stack([zero, *rod.rest_bend, one, zero, zero])


def straight(terms: int = TERMS) -> jax.Array:
    """Return the coordinates of the unloaded rod: zeros (6, term)."""
    return jnp.zeros((len(STRAINS), terms))


def _stiffnesses(stretch: jax.Array, rod: Rod) -> tuple[jax.Array, ...]:
    """Return what resists twist, bends and shears at a stretch λ, per reference length [N m², N m², N m², N, N].

    Bending: G I (1 + 2λ⁻³)/λ, fibres of a neo-Hookean bar that was stretched and thinned first; shear: k G A, whatever
    the stretch, from I_1 of a sheared and stretched bar.
    """
    bend = (1 + 2 * stretch**-3) / stretch
    shear = rod.shear * jnp.ones_like(stretch)
    return (twist_rigidity(stretch, rod.joint), rod.bending[0] * bend, rod.bending[1] * bend, shear, shear)


def _section_energy(strains: jax.Array, rod: Rod) -> jax.Array:
    """Return the relaxed energy per length at each node [J/m]. strains: less those at rest (node, 6), per metre."""
    stretch = 1 + strains[:, 3]
    axial = rod.joint.axial_rigidity * (stretch**2 + 2 / stretch - 3)
    others = strains[:, jnp.array([0, 1, 2, 4, 5])]
    stiff = jnp.stack(_stiffnesses(stretch, rod), axis=1)
    return 0.5 * (axial + jnp.sum(stiff * others**2, axis=1))


def _per_metre(rod: Rod) -> jax.Array:
    one = jnp.ones_like(rod.joint.length)
    return jnp.stack([1 / rod.joint.length] * 3 + [one] * 3)


def rod_energy(q: jax.Array, rod: Rod) -> jax.Array:
    """Return the relaxed strain energy of a rod of coordinates q (6, term) [J]."""
    g = grid(q.shape[1])
    strains = g.at_nodes @ q.T * _per_metre(rod)
    return rod.joint.length * jnp.sum(g.weights * _section_energy(strains, rod))


def _branch_energies(q: jax.Array, memory: jax.Array, rod: Rod) -> jax.Array:
    """Return the energy in each Maxwell branch [J], (branch,). memory: dashpots' coordinates (branch, 6, term).

    A branch has its share of what resists at the present stretch; of the axial stiffness 3 G A.
    """
    g = grid(q.shape[1])
    stretch = 1 + g.at_nodes @ q[3]
    twist, bend_y, bend_z, shear_y, shear_z = _stiffnesses(stretch, rod)
    axial = 3 * rod.joint.axial_rigidity * jnp.ones_like(stretch)
    stiff = jnp.stack([twist, bend_y, bend_z, axial, shear_y, shear_z])
    apart = jnp.einsum("nt,bst->bsn", g.at_nodes, q - memory) * _per_metre(rod)[:, None]
    shares = 0.5 * jnp.stack(rod.joint.prony_shares) * rod.joint.length
    return shares * jnp.einsum("n,sn,bsn->b", g.weights, stiff, apart**2)


def memory_energy(q: jax.Array, memory: jax.Array, rod: Rod) -> jax.Array:
    """Return the energy in the Maxwell branches of all strains [J]. memory: (branch, 6, term), as q."""
    return jnp.sum(_branch_energies(q, memory, rod))


def memory_power(q: jax.Array, memory: jax.Array, rod: Rod) -> jax.Array:
    """Return the power that the branches' dashpots turn to heat [W]: twice the energy of each over τ_i."""
    return jnp.sum(2 * _branch_energies(q, memory, rod) / relaxation_times())


def hat(v: jax.Array) -> jax.Array:
    """Return the matrix of the cross product with a vector (3,)."""
    zero = jnp.zeros_like(v[0])
    return jnp.array([[zero, -v[2], v[1]], [v[2], zero, -v[0]], [-v[1], v[0], zero]])


def _coefficients(square: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Return sin θ/θ, (1 - cos θ)/θ², (θ - sin θ)/θ³ from θ²: series, exact to rounding up to one radian.

    A way between two nodes turns by less than that; series are smooth at zero, so derivatives of any order are right.
    """
    sine = cosine = third = jnp.zeros_like(square)
    for n in range(7, -1, -1):
        sine = 1 - square / ((2 * n + 2) * (2 * n + 3)) * sine
        cosine = 1 - square / ((2 * n + 3) * (2 * n + 4)) * cosine
        third = 1 - square / ((2 * n + 4) * (2 * n + 5)) * third
    return sine, cosine / 2, third / 6


def rotation(v: jax.Array) -> jax.Array:
    """Return the rotation matrix of a rotation vector (3,) [rad]: Rodrigues."""
    sine, cosine, _ = _coefficients(v @ v)
    k = hat(v)
    return jnp.eye(3) + sine * k + cosine * (k @ k)


def _way(omega: jax.Array, moved: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Return (rotation, displacement) of the exponential on SE(3) of a twist (omega, moved)."""
    sine, cosine, third = _coefficients(omega @ omega)
    k = hat(omega)
    square = k @ k
    return jnp.eye(3) + sine * k + cosine * square, moved + cosine * (k @ moved) + third * (square @ moved)


def rod_poses(q: jax.Array, rod: Rod) -> tuple[jax.Array, jax.Array]:
    """Return (rotations (node + 1, 3, 3), positions [m] (node + 1, 3)) of the sections at the nodes and the end.

    In frame B, the foot at its origin, x along the unloaded rod. Each way is one exponential on SE(3) of Magnus'
    expansion to fourth order, from the strains at two points of Gauss.
    """
    g = grid(q.shape[1])
    base = rest_strains(rod)

    def step(at: _Pair, way: _Pair) -> tuple[_Pair, _Pair]:
        turned, moved = at
        length, basis = way
        first, second = base + basis @ q.T
        # Ω = h/2 (ξ1 + ξ2) + √3 h²/12 [ξ1, ξ2]; strains multiply from the right, hence the sign of the commutator
        w1, w2 = first[:3], second[:3]
        v1, v2 = first[3:], second[3:]
        share = np.sqrt(3.0) / 12 * length**2
        omega = 0.5 * length * (w1 + w2) + share * jnp.cross(w1, w2)
        along = 0.5 * length * (v1 + v2) + share * (jnp.cross(w1, v2) - jnp.cross(w2, v1))
        matrix, displacement = _way(omega, along)
        after = (turned @ matrix, moved + turned @ displacement)
        return after, after

    start = (jnp.eye(3), jnp.zeros(3))
    _, (rotations, positions) = jax.lax.scan(step, start, (jnp.asarray(g.steps), jnp.asarray(g.within)))
    return rotations, rod.joint.length * positions
