"""Rod: the continuum with all six strains, their energy, and the poses that they add up to.

Strains are those of a section's frame along the reference length s: curvatures κ = (twist, bend about y, bend about z)
[1/m] and the tangent ν = (stretch, shear along y, shear along z) [1], both in the section's own axes. Each is a sum of
Legendre polynomials of s/L; the coordinates are their coefficients, those of the curvatures times the length, so that a
constant twist of 0.1 rad is 0.1.
"""

from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from sinew.measure.arrays import namespace_of
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.silicone import compressive_load, relaxation_times, twist_rigidity

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
    weights: Any  # of the nodes; they add up to one
    at_nodes: Any  # polynomials at the nodes (node, term)
    steps: Any  # length of the way to each node and from the last one to the end (way,)
    within: Any  # polynomials at the two points of Gauss in each of these ways (way, 2, term)


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
    others = jnp.concatenate([strains[:, :3], strains[:, 4:]], axis=1)
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


class Springs(NamedTuple):
    """What sections of a rod are like at rest, along their six strains, curvatures per metre. stress: moments [N m] and
    forces [N], stiffness: slopes of them by their own strains, relaxed; remembered: what branches have shares of; all
    (section, 6)."""

    stress: jax.Array
    stiffness: jax.Array
    remembered: jax.Array


def section_springs(strains: jax.Array, rod: Rod) -> Springs:
    """Return the springs of sections at strains less those at rest, per metre (section, 6)."""

    def energy(one: jax.Array) -> jax.Array:
        return _section_energy(one[None], rod)[0]

    stiffness = jax.vmap(lambda one: jnp.diag(jax.hessian(energy)(one)))(strains)
    return Springs(jax.vmap(jax.grad(energy))(strains), stiffness, _remembered(1 + strains[:, 3], rod).T)


def _remembered(stretch: jax.Array, rod: Rod) -> jax.Array:
    """Return the stiffnesses that branches have shares of, at stretches (n,): (6, n)."""
    twist, bend_y, bend_z, shear_y, shear_z = _stiffnesses(stretch, rod)
    axial = 3 * rod.joint.axial_rigidity * jnp.ones_like(stretch)
    return jnp.stack([twist, bend_y, bend_z, axial, shear_y, shear_z])


def _branch_energies(q: jax.Array, memory: jax.Array, rod: Rod) -> jax.Array:
    """Return the energy in each Maxwell branch [J], (branch,). memory: dashpots' coordinates (branch, 6, term).

    A branch has its share of what resists at the present stretch; of the axial stiffness 3 G A.
    """
    g = grid(q.shape[1])
    stretch = 1 + g.at_nodes @ q[3]
    stiff = _remembered(stretch, rod)
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


# The poses of sections are a product of ways from node to node, each one exponential on SE(3) of Magnus' expansion to
# fourth order, from the strains at two points of Gauss. Ways know nothing of one another, so they are taken all at
# once; what adds up along the rod are poses, one after the other, and in the frame of the foot velocities, as sums.
# Lengths are over the rod's.


def _ends(q: jax.Array, rod: Rod) -> _Pair:
    """Return the strains at both points of Gauss of each way (way, 6), (way, 6)."""
    at = jnp.einsum("wpt,st->pws", grid(q.shape[1]).within, q) + rest_strains(rod)
    return at[0], at[1]


def _magnus(length: jax.Array, first: jax.Array, second: jax.Array) -> _Pair:
    """Return (turn, move) of one way: Ω = h/2 (ξ1 + ξ2) + √3 h²/12 [ξ1, ξ2]; strains multiply from the right, hence
    the sign of the commutator."""
    w1, v1, w2, v2 = first[:3], first[3:], second[:3], second[3:]
    share = np.sqrt(3.0) / 12 * length**2
    turn = 0.5 * length * (w1 + w2) + share * jnp.cross(w1, w2)
    return turn, 0.5 * length * (v1 + v2) + share * (jnp.cross(w1, v2) - jnp.cross(w2, v1))


def _segment(turn: jax.Array, move: jax.Array) -> _Pair:
    """Return (rotation, displacement) of the exponential on SE(3) of a twist (turn, move)."""
    sine, cosine, _ = _coefficients(turn @ turn)
    k = hat(turn)
    return jnp.eye(3) + sine * k + cosine * (k @ k), _carried(turn, move)


def _carried(turn: jax.Array, vector: jax.Array) -> jax.Array:
    """Return V(turn) v: the mean of v over all turns from none to the whole."""
    _, cosine, third = _coefficients(turn @ turn)
    across = jnp.cross(turn, vector)
    return vector + cosine * across + third * jnp.cross(turn, across)


def _compose(matrices: jax.Array, moves: jax.Array) -> _Pair:
    """Return poses after each way (way, 3, 3), (way, 3)."""
    turned, moved = [matrices[0]], [moves[0]]
    for matrix, move in zip(matrices[1:], moves[1:], strict=True):
        moved.append(moved[-1] + turned[-1] @ move)
        turned.append(turned[-1] @ matrix)
    return jnp.stack(turned), jnp.stack(moved)


def rod_poses(q: jax.Array, rod: Rod) -> tuple[jax.Array, jax.Array]:
    """Return (rotations (node + 1, 3, 3), positions [m] (node + 1, 3)) of the sections at the nodes and the end.

    In frame B, the foot at its origin, x along the unloaded rod.
    """
    twists = jax.vmap(_magnus)(jnp.asarray(grid(q.shape[1]).steps), *_ends(q, rod))
    rotations, positions = _compose(*jax.vmap(_segment)(*twists))
    return rotations, rod.joint.length * positions


class Sections(NamedTuple):
    """Sections at the nodes and the end, and how coordinates move them, in frame B; s: of node + 1 sections, c: of
    coordinates, of which the first half are curvatures. turned (s, 3, 3), places [m] (s, 3); turns (s, 3, c/2):
    angular velocity by the rates of curvatures; shifts (s, 3, c/2): that of the point of the section which is at the
    foot now [m]. Tangents do not turn sections, and shift them by length times turns.
    """

    turned: jax.Array
    places: jax.Array
    turns: jax.Array
    shifts: jax.Array
    length: jax.Array

    @property
    def spins(self) -> jax.Array:
        """Angular velocity by the rates of all coordinates: (s, 3, c)."""
        return jnp.concatenate([self.turns, jnp.zeros_like(self.turns)], axis=2)

    @property
    def moves(self) -> jax.Array:
        """Velocity of the point of the section which is at the foot now by all coordinates' rates [m]: (s, 3, c)."""
        return jnp.concatenate([self.shifts, self.length * self.turns], axis=2)

    def velocities(self, points: jax.Array, section: NDArray[np.intp]) -> jax.Array:
        """Return the velocity by coordinates' rates of points (point, 3) [m] fixed to sections: (point, 3, c)."""
        turns = self.turns[section]
        return jnp.concatenate([self.shifts[section] + _across(points, turns), self.length * turns], axis=2)


class Rates(NamedTuple):
    """Motion of the sections at coordinates' rates, and its change where these are steady: of node + 1 sections (s, 3).

    spin, drift: angular velocity, and velocity [m/s] of the point of the section which is at the foot now; spin_bias,
    drift_bias: their rates.
    """

    spin: jax.Array
    drift: jax.Array
    spin_bias: jax.Array
    drift_bias: jax.Array

    def velocity(self, points: jax.Array, section: NDArray[np.intp]) -> jax.Array:
        """Return the velocity of points (point, 3) [m] that are fixed to sections [m/s]."""
        return self.drift[section] + jnp.cross(self.spin[section], points)

    def acceleration(self, points: jax.Array, section: NDArray[np.intp]) -> jax.Array:
        """Return the acceleration of such points where coordinates do not accelerate [m/s²]."""
        centripetal = jnp.cross(self.spin[section], self.velocity(points, section))
        return self.drift_bias[section] + jnp.cross(self.spin_bias[section], points) + centripetal


def _across(points: jax.Array, spins: jax.Array) -> jax.Array:
    """Return spins (..., 3, c) crossed with points (..., 3): ω × r."""
    x, y, z = (points[..., i, None] for i in range(3))
    a, b, c = (spins[..., i, :] for i in range(3))
    return jnp.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=-2)


def _tangent(turn: jax.Array, move: jax.Array) -> _Pair:
    """Return the blocks V and ∂d/∂ω + d̂ V (3, 3) of the matrix [[V, 0], [∂d/∂ω + d̂ V, V]] from the rate of a twist to
    the velocity of its exponential, in the frame it starts from; displacement d = V v."""
    _, cosine, third = _coefficients(turn @ turn)
    k = hat(turn)
    left = jnp.eye(3) + cosine * k + third * (k @ k)
    by_turn = jax.jacfwd(_carried)(turn, move)
    return left, by_turn + hat(left @ move) @ left


def _velocity(turn: jax.Array, move: jax.Array, turn_rate: jax.Array, move_rate: jax.Array) -> jax.Array:
    """Return the velocity (6,) of a way's end, in the frame it starts from, at the rate of its twist: `_tangent`'s
    matrix times it."""
    spin = _carried(turn, turn_rate)
    end, speed = jax.jvp(_carried, (turn, move), (turn_rate, move_rate))
    return jnp.concatenate([spin, speed + jnp.cross(end, spin)])


def _by_strains(length: jax.Array, first: jax.Array, second: jax.Array) -> _Pair:
    """Return how a way's twist depends on the strains at its two points, of `_magnus`: A, B (point, 3, 3) of
    [[A, 0], [B, A]]."""
    share = np.sqrt(3.0) / 12 * length**2
    half = 0.5 * length * jnp.eye(3)
    diagonal = jnp.stack([half - share * hat(second[:3]), half + share * hat(first[:3])])
    return diagonal, share * jnp.stack([-hat(second[3:]), hat(first[3:])])


def move_rod(q: jax.Array, q_rate: jax.Array, rod: Rod) -> tuple[Sections, Rates]:
    """Return the sections of a rod with the derivatives of their poses, and their motion at rates of coordinates.

    Velocities add up along the rod: V_n = Σ Ad(G_k) T_k Ω̇_k over the ways k before, T the tangent of the exponential
    and G_k where the way starts; so do their derivatives and, with the bracket [V_k, Ad(G_k) T_k Ω̇_k], their rates.
    """
    g = grid(q.shape[1])
    steps = jnp.asarray(g.steps)
    strains = _ends(q, rod)
    rates = tuple(jnp.einsum("wpt,st->pws", g.within, q_rate))
    twists, speeds = jax.jvp(lambda *at: jax.vmap(_magnus)(steps, *at), strains, rates)
    turned, places = _compose(*jax.vmap(_segment)(*twists))

    still = 2 * np.sqrt(3.0) / 12 * steps[:, None] ** 2
    w1, v1, w2, v2 = rates[0][:, :3], rates[0][:, 3:], rates[1][:, :3], rates[1][:, 3:]
    surges = still * jnp.cross(w1, w2), still * (jnp.cross(w1, v2) - jnp.cross(w2, v1))
    own, own_rate = jax.jvp(jax.vmap(_velocity), (*twists, *speeds), (*speeds, *surges))

    # into frame B: Ad(G) of where each way starts
    start = jnp.concatenate([jnp.eye(3)[None], turned[:-1]])
    origin = jnp.concatenate([jnp.zeros((1, 3)), places[:-1]])

    def in_base(spins: jax.Array, moves: jax.Array) -> _Pair:
        spins = start @ spins
        return spins, start @ moves - _across(origin, spins)

    vectors = jnp.concatenate(
        in_base(*(jnp.stack([own[:, part], own_rate[:, part]], axis=2) for part in (slice(3), slice(3, 6)))), axis=1
    )
    now, bias = vectors[:, :, 0], vectors[:, :, 1]
    velocity = jnp.cumsum(now, axis=0)
    before = velocity - now
    spin, drift = before[:, :3], before[:, 3:]
    bracket = jnp.concatenate(
        [jnp.cross(spin, now[:, :3]), jnp.cross(spin, now[:, 3:]) + jnp.cross(drift, now[:, :3])], axis=1
    )
    velocity_rate = jnp.cumsum(bias + bracket, axis=0)

    # [[V, 0], [Q, V]] [[A, 0], [B, A]]: tangents move sections as curvatures turn them.
    left, below = in_base(*jax.vmap(_tangent)(*twists))
    diagonal, under = jax.vmap(_by_strains)(steps, *strains)
    turns = left[:, None] @ diagonal
    columns = jnp.concatenate([turns, below[:, None] @ diagonal + left[:, None] @ under], axis=2)
    terms = sum(columns[:, p, :, :, None] * g.within[:, p, None, None] for p in range(2))
    by = jnp.cumsum(jnp.asarray(terms).reshape(steps.size, 6, q.size // 2), axis=0)
    length = rod.joint.length
    sections = Sections(turned, length * places, by[:, :3], length * by[:, 3:], length)
    moving = Rates(velocity[:, :3], length * velocity[:, 3:], velocity_rate[:, :3], length * velocity_rate[:, 3:])
    return sections, moving


# ---- column: the load at which a straight compressed rod of silicone buckles sideways, shearing and shortening with
# it.
#
# The rod is that of `sinew.mechanics.rod`: under a load N = G A (1/λ² - λ) it has the stretch λ, bends with G I (1 +
# 2/λ³)/λ and shears with 0.9 G A. Turned by θ, the second variation of its energy with the load's is
#
#     ½ ∫ B θ'² - N (λ + N/(0.9 G A)) θ² ds,
#
# the shear being eliminated; so it buckles where B (π/L)² = N (λ + N/(0.9 G A)) between ends that keep their direction
# and may move aside. A load that always points to the foot, as that of tendons, does the same: for one end free to turn
# at π, for both ends held at 2π. Euler's load E I (π/L)² says which, so it is what is given here.
#
# Haringx's formula with a constant E I leaves out that the rod thickens as it is pressed: for a length of 3.4 radii it
# says half of what the exact incremental solution does. This one is within 2.3 % of it up to a radius of 0.35 lengths.


SHORTEST = 0.5
"""Stretch beyond which the column is not asked: a joint that is pressed to half its length is no rod any more."""

_HALVINGS = 20  # to 5e-7; the step of Newton after them squares that


def column_load(euler: Any, shear_rigidity: Any) -> Any:
    """Return the critical load [N] of a column of rubber by Euler's [N] and G A [N]; NumPy's numbers or JAX's.

    A column so short that it does not buckle before it is pressed to `SHORTEST` has the load of that stretch, the least
    that it can be. Differentiable: the last step is Newton's.
    """
    return compressive_load(shear_rigidity, column_stretch(euler / shear_rigidity))


def column_stretch(share: Any) -> Any:
    """Return the stretch λ at which a column buckles; share: Euler's load over G A, E I (x/L)²/(G A)."""
    xp = namespace_of(share)
    low, high = SHORTEST + 0 * share, 1 + 0 * share
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        bends = _excess(middle, share) > 0
        low, high = xp.where(bends, low, middle), xp.where(bends, middle, high)
    found = xp.where(_excess(low, share) > 0, SHORTEST, high)
    step = 1e-6
    slope = (_excess(found + step, share) - _excess(found - step, share)) / (2 * step)
    return xp.where(found > SHORTEST, found - _excess(found, share) / slope, SHORTEST)


def _excess(stretch: Any, share: Any) -> Any:
    """Return what bending resists less what the load takes, over G A: positive where the column stands."""
    load = compressive_load(1.0, stretch)
    return share / 3 * (1 + 2 * stretch**-3) / stretch - load * (stretch + load / SHEAR_FACTOR)
