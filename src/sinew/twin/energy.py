"""This is where the joint's potential energy is written down, once; every force is its derivative."""

import jax
import jax.numpy as jnp

from sinew.twin.kinematics import guide_points, head_pose, tendon_lengths
from sinew.twin.parameters import CURRENT, POSITION, POSITION_LIMITED, Parameters


def silicone_energy(torsion: jax.Array, shortening: jax.Array, p: Parameters) -> jax.Array:
    """Return the relaxed strain energy of the silicone [J].

    Incompressible neo-Hookean solid cylinder in combined torsion and compression (Rivlin), stretch λ = 1 - x/L:
    W = (G L / 2) [A (λ² + 2/λ - 3) + J φ² / (L² λ)]; a section that warps see `twist_rigidity`.
    """
    stretch = 1 - shortening / p.length
    axial = p.axial_rigidity * p.length * (stretch**2 + 2 / stretch - 3)
    return 0.5 * (axial + twist_rigidity(stretch, p) * torsion**2 / p.length)


def twist_rigidity(stretch: jax.Array, p: Parameters) -> jax.Array:
    """Return the relaxed torsional rigidity at a stretch λ [N m²]: G (I_p/λ - (I_p - J)/λ⁴).

    Small twist on a stretched incompressible neo-Hookean bar that warps freely; G J/λ for a circle, whose warping
    rigidity G (I_p - J) is zero.
    """
    return (p.torsional_rigidity + p.warping_rigidity * (1 - stretch**-3)) / stretch


def viscoelastic_energy(
    torsion: jax.Array,
    shortening: jax.Array,
    memory: tuple[jax.Array, ...],
    axial_memory: tuple[jax.Array, ...],
    p: Parameters,
) -> jax.Array:
    """Return the energy in the Maxwell branches [J].

    memory [rad], axial_memory [m]: dashpot positions q_i, u_i, by branch. Branch stiffnesses are the shares
    g_i of the torsional stiffness at the present stretch, and of the axial one 3 G A/L.
    """
    stretch = 1 - shortening / p.length
    torsional = twist_rigidity(stretch, p) / p.length
    axial = 3 * p.axial_rigidity / p.length
    stored = jnp.zeros_like(torsion)
    for share, q, u in zip(p.prony_shares, memory, axial_memory, strict=True):
        stored = stored + share * (torsional * (torsion - q) ** 2 + axial * (shortening - u) ** 2)
    return 0.5 * stored


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


def total_tension(torsion: jax.Array, shortening: jax.Array, p: Parameters) -> jax.Array:
    """Return the sum of all tendons' tensions ΣT [N]."""
    return jnp.asarray(sum(tendon_tension(stretch, p) for stretch in tendon_stretch(torsion, shortening, p)))


def potential(torsion: jax.Array, shortening: jax.Array, p: Parameters) -> jax.Array:
    """Return the relaxed potential energy V(φ, x; ℓ_c) of silicone and tendons [J]."""
    tendons = sum(tendon_energy(stretch, p) for stretch in tendon_stretch(torsion, shortening, p))
    return silicone_energy(torsion, shortening, p) + tendons
