"""Tendons: their spans between two plates, by the head's pose, and their tension, by the motors' mode.

Frame B sits at the lower guide circle with x along the continuum; frame H is the head's. A pose is a rotation of H
against B and the position of H's origin in B. The head twists and sinks, and it tilts where the continuum bends.
"""

import math

import jax
import jax.numpy as jnp

from sinew.mechanics.parameters import CURRENT, POSITION, POSITION_LIMITED, Parameters

# Vectors, matrices and lists of points are tuples of scalars and the loops over them are unrolled: over a batch
# each scalar is one array over the lanes, and the compiler fuses everything into a single pass.
Scalar = jax.Array
Vector = tuple[Scalar, Scalar, Scalar]
Pose = tuple[tuple[Vector, Vector, Vector], Vector]


@jax.custom_jvp
def cos_sin(angle: Scalar) -> tuple[Scalar, Scalar]:
    """Return cosine and sine of an angle [rad], evaluated once.

    The compiler takes sine and cosine for cheap and repeats them in each of the dozens of passes that use them, which
    was two thirds of the cost of a simulation. Quotients it keeps, so both are written as quotients of the tangent of
    half the angle; that is exact to rounding at every angle. The derivative reuses the values.
    """
    tangent = jnp.sin(0.5 * angle) / jnp.cos(0.5 * angle)
    square = tangent * tangent
    return (1 - square) / (1 + square), 2 * tangent / (1 + square)


@cos_sin.defjvp
def _cos_sin_jvp(
    primals: tuple[Scalar], tangents: tuple[Scalar]
) -> tuple[tuple[Scalar, Scalar], tuple[Scalar, Scalar]]:
    c, s = cos_sin(*primals)
    return (c, s), (-s * tangents[0], c * tangents[0])


def guide_directions(count: int) -> tuple[tuple[float, float], ...]:
    """Return cosine and sine of the angles of `count` equally spaced guides on their circle."""
    angles = [2 * math.pi * i / count for i in range(count)]
    return tuple((math.cos(angle), math.sin(angle)) for angle in angles)


def guide_points(radius: Scalar, directions: tuple[tuple[Scalar, Scalar], ...]) -> tuple[Vector, ...]:
    """Return guide points on a circle about the x axis [m]; directions as above."""
    return tuple((jnp.zeros_like(radius), radius * c, radius * s) for c, s in directions)


def head_pose(
    torsion: Scalar, shortening: Scalar, free_span: Scalar, tilt: tuple[Scalar, Scalar] | None = None
) -> Pose:
    """Return (rows of the rotation, position [m]) of a head that is twisted [rad] about x and sunk [m].

    tilt: of a head on a bent continuum: rotation vector [rad] about y and z of frame B, after the twist. The
    continuum is then an arc of constant curvature, so that the head's centre moves aside by half of span times tilt.
    """
    c, s = cos_sin(torsion)
    one, zero = jnp.ones_like(c), jnp.zeros_like(c)
    if tilt is None:
        return ((one, zero, zero), (zero, c, -s), (zero, s, c)), (free_span - shortening, zero, zero)
    y, z = tilt
    sine, cosine = _arc(y * y + z * z)
    span = free_span - shortening
    across = cosine * y * z
    second = (-sine * z, 1 - cosine * z * z, across)  # columns of the rotation by the tilt alone
    third = (sine * y, across, 1 - cosine * y * y)
    first = (1 - cosine * (y * y + z * z), sine * z, -sine * y)
    rows = tuple((a, b * c + d * s, d * c - b * s) for a, b, d in zip(first, second, third, strict=True))
    return (rows[0], rows[1], rows[2]), (span * sine, span * cosine * z, -span * cosine * y)


def _arc(square: Scalar) -> tuple[Scalar, Scalar]:
    """Return sin(θ)/θ and (1 - cos θ)/θ² from θ²: their series, exact to 1e-6 up to 60° and smooth at zero."""
    sine = 1 - square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72)))
    cosine = 0.5 * (1 - square / 12 * (1 - square / 30 * (1 - square / 56 * (1 - square / 90))))
    return sine, cosine


def tendon_lengths(base: tuple[Vector, ...], head: tuple[Vector, ...], pose: Pose) -> tuple[Scalar, ...]:
    """Return the straight free span between each base guide and its head guide [m].

    base: guide points in B [m]. head: guide points in H [m]. pose: of H in B.
    The spans are chords from plate to plate, not helices in the body: 17 % of torque at 60° of torsion.
    """
    rotation, position = pose
    lengths = []
    for foot, guide in zip(base, head, strict=True):
        square = jnp.zeros_like(position[0])
        for row, offset, below in zip(rotation, position, foot, strict=True):
            square = square + (offset + sum(r * g for r, g in zip(row, guide, strict=True)) - below) ** 2
        lengths.append(jnp.sqrt(square))
    return tuple(lengths)


def span_lengths(
    torsion: jax.Array, shortening: jax.Array, p: Parameters, tilt: tuple[jax.Array, jax.Array] | None = None
) -> tuple[jax.Array, ...]:
    """Return the length ℓ of every tendon between its guides [m]; tilt: of the head about y and z of frame B [rad]."""
    base, head = (guide_points(radius, p.guide_directions) for radius in (p.base_radius, p.head_radius))
    return tendon_lengths(base, head, head_pose(torsion, shortening, p.free_span, tilt))


def tendon_stretch(torsion: jax.Array, shortening: jax.Array, p: Parameters) -> tuple[jax.Array, ...]:
    """Return the elongation ℓ - ℓ_c of every tendon [m]; negative means slack."""
    return tuple(length - p.cable_end for length in span_lengths(torsion, shortening, p))


def tendon_energy(stretch: jax.Array, p: Parameters) -> jax.Array:
    """Return the energy of tendons of given elongation [m]: elementwise, [J].

    The motor decides. Position: ½ k_t s² where taut, 0 where slack. Position with current limit: the same up to the
    limit, beyond it the motor yields at constant tension. Current: constant tension, T s.
    """
    taut = jnp.maximum(stretch, 0.0)
    position = 0.5 * p.stiffness * taut**2
    yielding = p.held_tension * (taut - 0.5 * p.held_tension / p.stiffness)
    limited = jnp.where(p.stiffness * taut < p.held_tension, position, yielding)
    current = p.held_tension * stretch
    return jnp.where(p.mode == CURRENT, current, jnp.where(p.mode == POSITION_LIMITED, limited, position))


def tendon_tension(stretch: jax.Array, p: Parameters) -> jax.Array:
    """Return the tension of tendons of given elongation [m], elementwise [N]: the derivative of `tendon_energy`."""
    position = p.stiffness * jnp.maximum(stretch, 0.0)
    held = jnp.where(p.mode == CURRENT, p.held_tension, jnp.minimum(position, p.held_tension))
    return jnp.where(p.mode == POSITION, position, held)


def as_one_tendon(p: Parameters) -> Parameters:
    """Return the parameters with all tendons as one that is so many times as stiff and held so many times as hard.

    Guides stand on circles of one radius each and the head does not tilt, so all tendons do the same: energy and total
    tension are what they are, for a part of the work.
    """
    count = len(p.guide_directions)
    return p._replace(
        guide_directions=p.guide_directions[:1], stiffness=count * p.stiffness, held_tension=count * p.held_tension
    )


def total_tension(torsion: jax.Array, shortening: jax.Array, p: Parameters) -> jax.Array:
    """Return the sum of all tendons' tensions ΣT [N]."""
    return jnp.asarray(sum(tendon_tension(stretch, p) for stretch in tendon_stretch(torsion, shortening, p)))
