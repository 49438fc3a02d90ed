"""The joint at rest, first contact, pretension, tension; and its steady swing by the first harmonic."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sinew.mechanics.joint import potential
from sinew.mechanics.parameters import CURRENT, POSITION, Parameters
from sinew.mechanics.silicone import memory_stiffness, silicone_energy
from sinew.mechanics.tendons import tendon_stretch, tendon_tension, total_tension
from sinew.plan.rig import LIMIT_RESERVE_N
from sinew.solve.programs import program

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


# First-harmonic balance: spring and loss of a steady swing, its frequency, its damping and their shares.
#
# The joint swings steadily as φ = a cos ωt. Over one cycle the torque of silicone, tendons and guides is balanced with
# the inertia: relaxed silicone and tendons by the potential energy, the head sinking as it twists; the silicone's
# storage and loss beyond that by its Prony series at ω; the guides by their closed loop, which is what bristles settle
# to. Harmonics above the first, and the head's axial inertia, are left out: balance with all of them says what that is
# worth.

# Spring and loss in one piece that has slopes, for a search: few nodes, one step of sinking, and the guides under the
# tension that there is at rest.

_NODES = np.cos((2 * np.arange(4) + 1) * np.pi / 16)
"""Positive ones of eight nodes of Chebyshev and Gauss: exact for odd torques up to the fifteenth power."""


def held_at(shortening: jax.Array, p: Parameters) -> tuple[Parameters, jax.Array]:
    """Return (parameters with motors at the positions that keep the joint at a shortening [m], tension of all tendons
    together at rest [N]). p: as `as_one_tendon` of the tendons gives; at rest the tendon runs along the axis."""
    tension = axial_force(shortening, jnp.zeros(()), p)
    span = tendon_stretch(jnp.zeros(()), shortening, p._replace(cable_end=jnp.zeros(())))[0]
    return p._replace(cable_end=span - tension / p.stiffness), tension


def peak_tension(torsion: jax.Array, shortening: jax.Array, p: Parameters) -> jax.Array:
    """Return the tension of all tendons together [N] at a torsion [rad]."""
    return total_tension(torsion, sink(torsion, shortening, p), p)


def swing_stiffness(shortening: jax.Array, amplitude: jax.Array, omega: jax.Array, p: Parameters) -> jax.Array:
    """Return the spring, real part of the fundamental's stiffness [N m/rad].

    shortening: at rest [m]; amplitude: of the torsion [rad]; omega: of the swing [rad/s]; p: as `held_at` gives.
    """
    twists = amplitude * _NODES

    def torque(twist: jax.Array) -> jax.Array:
        return jnp.asarray(jax.grad(potential)(twist, sink(twist, shortening, p), p))

    relaxed = jnp.sum(jax.vmap(torque)(twists) * _NODES) * 2 / (len(_NODES) * amplitude)
    return relaxed + memory_stiffness(omega, shortening, p)[0] + _guides(shortening, amplitude, p)[0]


def swing_loss(shortening: jax.Array, amplitude: jax.Array, omega: jax.Array, p: Parameters) -> jax.Array:
    """Return the loss, imaginary part of the fundamental's stiffness [N m/rad]; arguments as for the spring."""
    return memory_stiffness(omega, shortening, p)[1] + _guides(shortening, amplitude, p)[1]


def _guides(shortening: jax.Array, amplitude: jax.Array, p: Parameters) -> tuple[jax.Array, jax.Array]:
    return p.guides.fundamental(total_tension(jnp.zeros(()), shortening, p), amplitude)


# What one sees of a free swing, the lever locked to the head, the tension as it changes over the cycle. A decay that
# loses much in a cycle never closes its friction loops, and is damped up to a sixth more (at D = 0.065).
#
# - in phase, k A = (1/π) ∮ torque cos ωt d(ωt), and I ω² = k.
# - energy lost: silicone π k_s Im G*(ω) A², guides ∮ F dφ, viscous π d ω A². D = Σ/(2π k A²).

_POINTS = 64
_ROUNDS = 12  # of frequency and stiffness, each a tenth of the error before
_SINKING = 6  # steps of Newton's method


class FreeSwing(NamedTuple):
    """What one pretension's joint is like, at one torsion amplitude.

    tension_n: of one tendon at rest; tendon_moment_n_m: times the head's radius. natural_frequency_hz: undamped.
    damping_ratio: of the energy lost in a cycle. cubic_n_m_rad3: of the static restoring torque. The shares are of the
    energy lost.
    """

    tension_n: Any
    tendon_moment_n_m: Any
    natural_frequency_hz: Any
    damping_ratio: Any
    cubic_n_m_rad3: Any
    silicone_share: Any
    guide_friction_share: Any
    viscous_share: Any


class SwingSprings(NamedTuple):
    """Parts of the fundamental's stiffness in a swing [N m/rad]. silicone: its relaxed part, sinking as it twists;
    guides, guides_loss: real and imaginary part, under the tension as it rises in the swing."""

    silicone: Any
    guides: Any
    guides_loss: Any


def _cubic(rest: jax.Array, p: Parameters) -> jax.Array:
    """Return the cubic coefficient of the static torque [N m/rad³]: R'''/6 at φ = 0, the head sinking as it likes.

    x''(0) = -V_φφx/V_xx, hence R''' = V_φφφφ - 3 V_φφx²/V_xx.
    """
    zero = jnp.zeros(())
    second = _slope(_slope(potential))
    fourth = _slope(_slope(second))(zero, rest, p)
    across = _slope(lambda x: second(zero, x, p))(rest)
    axial = _slope(_slope(lambda x: potential(zero, x, p)))(rest)
    return jnp.asarray((fourth - 3 * across**2 / axial) / 6)


def _slope(function: Callable[..., jax.Array]) -> Callable[..., jax.Array]:
    """Return the derivative by the first argument, a scalar: forwards, which JAX nests in half of `grad`'s time."""
    return lambda x, *others: jax.jvp(lambda at: function(at, *others), (x,), (jnp.ones(()),))[1]


@program()
def _free_swing(
    p: Parameters, contact: jax.Array, pretension: jax.Array, mode: jax.Array, amplitude: jax.Array
) -> tuple[FreeSwing, SwingSprings]:
    p, rest = set_pretension(p, pretension, contact, mode, jnp.asarray(LIMIT_RESERVE_N))
    zero = jnp.zeros(())
    tension = tendon_tension(tendon_stretch(zero, rest, p)[0], p)
    angle = 2 * np.pi * (np.arange(_POINTS) + 0.5) / _POINTS
    cosine, sine = np.cos(angle), np.sin(angle)
    torsion = amplitude * cosine
    position = jax.vmap(lambda twist: sunk(twist, rest, p, _SINKING))(torsion)
    static = jax.vmap(jax.grad(potential), in_axes=(0, 0, None))(torsion, position, p)
    pull = jax.vmap(total_tension, in_axes=(0, 0, None))(torsion, position, p)
    rising = np.where(sine < 0, 1.0, -1.0)  # falling, the loop is its mirror image
    friction = p.guides.greatest_torque(pull) * rising * p.guides.loop(rising * torsion, amplitude)
    guide_spring = 2 * jnp.mean(friction * cosine) / amplitude
    held = 2 * jnp.mean(static * cosine) / amplitude + guide_spring
    silicone = jax.vmap(jax.grad(silicone_energy), in_axes=(0, 0, None))(torsion, position, p)
    lost_guides = -2 * jnp.pi * amplitude * jnp.mean(friction * sine)
    inertia = p.head + p.lever

    def closer(_: int, omega: jax.Array) -> jax.Array:
        return jnp.sqrt((held + memory_stiffness(omega, rest, p)[0]) / inertia)

    omega = jax.lax.fori_loop(0, _ROUNDS, closer, jnp.sqrt(held / inertia))
    storage, loss = memory_stiffness(omega, rest, p)
    stiffness = held + storage
    lost_silicone = jnp.pi * loss * amplitude**2
    lost_viscous = jnp.pi * p.viscous * omega * amplitude**2
    lost = lost_silicone + lost_guides + lost_viscous
    whole = jnp.maximum(lost, 1e-300)
    found = FreeSwing(
        tension,
        tension * p.head_radius,
        omega / (2 * jnp.pi),
        lost / (2 * jnp.pi * stiffness * amplitude**2),
        _cubic(rest, p),
        lost_silicone / whole,
        lost_guides / whole,
        lost_viscous / whole,
    )
    spring = 2 * jnp.mean(silicone * cosine) / amplitude
    return found, SwingSprings(spring, guide_spring, lost_guides / (jnp.pi * amplitude**2))


def free_swing(p: Parameters, contact: Any, pretension_mm: float, mode: float, amplitude_rad: float) -> FreeSwing:
    """Return what the joint is like at a pretension [mm], motor mode and torsion amplitude [rad].

    contact: tension of one tendon at first contact [N].
    """
    return swing_springs(p, contact, pretension_mm, mode, amplitude_rad)[0]


def swing_springs(
    p: Parameters, contact: Any, pretension_mm: float, mode: float, amplitude_rad: float
) -> tuple[FreeSwing, SwingSprings]:
    """Return the same with the springs that it is made of; arguments as `free_swing`."""
    given = (np.float64(pretension_mm * 1e-3), np.float64(mode), np.float64(amplitude_rad))
    found: tuple[FreeSwing, SwingSprings] = _free_swing(p, contact, *given)
    return found
