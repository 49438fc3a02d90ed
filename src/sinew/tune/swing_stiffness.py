"""Spring and loss of a swinging joint, in one piece that has slopes: the fundamental alone.

For a torsion a cos Ωt of a joint that rests at a shortening, the fundamental of the torque divided by a: the relaxed
potential of the twin with the head sinking as it twists; the silicone's memory by its Prony series; the guides by
their closed loop, which is what the twin's bristles settle to. Harmonics above
the first, and the head's axial inertia, are left out: balance with all of them says what that is worth.
"""

import jax
import jax.numpy as jnp
import numpy as np

from sinew.mechanics.joint import potential
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.silicone import relaxation_times, twist_rigidity
from sinew.mechanics.tendons import tendon_stretch, tendon_tension
from sinew.solve.rest import axial_force

_NODES = np.cos((2 * np.arange(4) + 1) * np.pi / 16)
"""Positive ones of eight nodes of Chebyshev and Gauss: exact for odd torques up to the fifteenth power."""


def as_one_tendon(p: Parameters) -> Parameters:
    """Return the parameters with the tendons as one that is so many times as stiff. Guides stand on circles of one
    radius and the head does not tilt, so all tendons do the same, and what is compiled is that much smaller."""
    count = len(p.guide_directions)
    return p._replace(guide_directions=p.guide_directions[:1], stiffness=count * p.stiffness)


def held_at(shortening: jax.Array, p: Parameters) -> tuple[Parameters, jax.Array]:
    """Return (parameters with motors at the positions that keep the joint at a shortening [m], tension of all tendons
    together at rest [N]). p: as `as_one_tendon` gives; at rest the tendon runs along the axis."""
    tension = axial_force(shortening, jnp.zeros(()), p)
    span = tendon_stretch(jnp.zeros(()), shortening, p._replace(cable_end=jnp.zeros(())))[0]
    return p._replace(cable_end=span - tension / p.stiffness), tension


def _sunk(torsion: jax.Array, shortening: jax.Array, p: Parameters) -> jax.Array:
    """Return where the head sinks to at a torsion: a step of Newton's method from its place at rest."""
    force, curvature = jax.jvp(
        lambda x: jax.grad(potential, argnums=1)(torsion, x, p), (shortening,), (jnp.ones_like(shortening),)
    )
    return jnp.asarray(shortening - force / curvature)


def peak_tension(torsion: jax.Array, shortening: jax.Array, p: Parameters) -> jax.Array:
    """Return the tension of all tendons together [N] at a torsion [rad]."""
    stretch = tendon_stretch(torsion, _sunk(torsion, shortening, p), p)[0]
    return jnp.asarray(tendon_tension(stretch, p))


def swing_stiffness(shortening: jax.Array, amplitude: jax.Array, omega: jax.Array, p: Parameters) -> jax.Array:
    """Return the spring, real part of the fundamental's stiffness [N m/rad].

    shortening: at rest [m]; amplitude: of the torsion [rad]; omega: of the swing [rad/s]; p: as `held_at` gives.
    """
    twists = amplitude * _NODES

    def torque(twist: jax.Array) -> jax.Array:
        return jnp.asarray(jax.grad(potential)(twist, _sunk(twist, shortening, p), p))

    relaxed = jnp.sum(jax.vmap(torque)(twists) * _NODES) * 2 / (len(_NODES) * amplitude)
    own = twist_rigidity(1 - shortening / p.length, p) / p.length
    return relaxed + own * _memory(omega, p)[0] + _guides(shortening, amplitude, p)[0]


def swing_loss(shortening: jax.Array, amplitude: jax.Array, omega: jax.Array, p: Parameters) -> jax.Array:
    """Return the loss, imaginary part of the fundamental's stiffness [N m/rad]; arguments as for the spring."""
    own = twist_rigidity(1 - shortening / p.length, p) / p.length
    return own * _memory(omega, p)[1] + _guides(shortening, amplitude, p)[1]


def _memory(omega: jax.Array, p: Parameters) -> tuple[jax.Array, jax.Array]:
    storage, loss = jnp.zeros(()), jnp.zeros(())
    for share, tau in zip(p.prony_shares, relaxation_times(), strict=True):
        wt = omega * tau
        storage, loss = storage + share * wt**2 / (1 + wt**2), loss + share * wt / (1 + wt**2)
    return storage, loss


def _guides(shortening: jax.Array, amplitude: jax.Array, p: Parameters) -> tuple[jax.Array, jax.Array]:
    stretch = tendon_stretch(jnp.zeros(()), shortening, p)[0]
    return p.guides.fundamental(tendon_tension(stretch, p), amplitude)
