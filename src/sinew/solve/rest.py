"""The joint at rest: first contact, pretension, tension."""

import jax
import jax.numpy as jnp

from sinew.mechanics.joint import potential
from sinew.mechanics.parameters import CURRENT, POSITION, Parameters
from sinew.mechanics.silicone import silicone_energy
from sinew.mechanics.tendons import tendon_stretch, tendon_tension

_NEWTON_STEPS = 30


def sink(torsion: jax.Array, shortening: jax.Array, p: Parameters) -> jax.Array:
    """Return the axial shortening [m] one step of Newton's method nearer to where ∂V/∂x = 0 at a torsion [rad]."""
    force, curvature = jax.jvp(
        lambda x: jax.grad(potential, argnums=1)(torsion, x, p), (shortening,), (jnp.ones_like(shortening),)
    )
    return jnp.asarray(shortening - force / curvature)


def sunk(torsion: jax.Array, start: jax.Array, p: Parameters, steps: int) -> jax.Array:
    """Return the axial shortening [m] at which the relaxed joint rests at a torsion [rad]: so many steps of `sink`."""
    found: jax.Array = jax.lax.fori_loop(0, steps, lambda _, x: sink(torsion, x, p), start)
    return found


def rest_shortening(p: Parameters) -> jax.Array:
    """Return the axial shortening x [m] at which the untwisted, relaxed joint rests: ∂V/∂x = 0 at φ = 0."""
    return sunk(jnp.zeros(()), 0.001 * p.length, p, _NEWTON_STEPS)


def set_pretension(
    p: Parameters, pretension: jax.Array, first_contact_tension: jax.Array, mode: jax.Array, limit: jax.Array
) -> tuple[Parameters, jax.Array]:
    """Return (parameters with the motors set, shortening at rest [m]) at a pretension.

    pretension: common shortening of the cables from first contact [m].
    first_contact_tension: tension of each tendon at pretension zero [N] (the current-controlled pull).
    mode: of the motors. In current mode they hold the tension that position mode has at rest at this pretension.
    limit: tension above that at rest, at which a current-limited position loop yields [N].
    """
    contact = p._replace(mode=jnp.full((), CURRENT), held_tension=first_contact_tension)
    x0 = rest_shortening(contact)
    untwisted = tendon_stretch(jnp.zeros(()), x0, p._replace(cable_end=jnp.zeros(())))[0]
    first_end = untwisted - first_contact_tension / p.stiffness
    held = p._replace(mode=jnp.full((), POSITION), cable_end=first_end - pretension)
    shortening = rest_shortening(held)
    tension = tendon_tension(tendon_stretch(jnp.zeros(()), shortening, held)[0], held)
    set_tension = jnp.where(mode == CURRENT, tension, tension + limit)
    return held._replace(mode=mode, held_tension=set_tension), shortening


def torsional_stiffness(shortening: jax.Array, p: Parameters) -> jax.Array:
    """Return the relaxed small-angle torsional stiffness ∂²V/∂φ² at φ = 0 [N m/rad]."""
    return jnp.asarray(jax.hessian(potential)(jnp.zeros(()), shortening, p))


def axial_force(shortening: jax.Array, torsion: jax.Array, p: Parameters) -> jax.Array:
    """Return the force [N] with which the twisted silicone resists a shortening: ∂W/∂x."""
    return jnp.asarray(jax.grad(silicone_energy, argnums=1)(torsion, shortening, p))
