"""What one sees of the joint's parameters: frequency, damping, its shares, hardening, tension.

The joint swings steadily as φ = A cos ωt, without its drive, the lever locked to the head. Over one cycle the torque
of silicone, tendons and guides is balanced with the inertia (first harmonic); the head sinks as it would at rest. A
decay that loses much in a cycle never closes its friction loops, and is damped up to a sixth more (at D = 0.065).

- in phase, k A = (1/π) ∮ torque cos ωt d(ωt): relaxed silicone and tendons by the potential energy, the silicone's
  storage beyond that by its Prony series at ω, the guides by their loop. I ω² = k.
- energy lost: silicone π k_s Im G*(ω) A², guides ∮ F dφ, viscous π d ω A². D = Σ/(2π k A²).
"""

from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sinew.identify.joint.coordinates import Numbers
from sinew.mechanics.joint import potential
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.silicone import relaxation_times, twist_rigidity
from sinew.mechanics.tendons import tendon_stretch, tendon_tension, total_tension
from sinew.solve.rest import set_pretension
from sinew.twin.simulate import LIMIT_RESERVE_N

_POINTS = 64
_ROUNDS = 12  # of frequency and stiffness, each a tenth of the error before


class Balance(NamedTuple):
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


def _sunk(torsion: jax.Array, rest: jax.Array, p: Parameters) -> jax.Array:
    """Return the shortening at which the twisted joint is in balance along its axis [m]."""
    slope = jax.grad(potential, argnums=1)
    curve = jax.grad(slope, argnums=1)

    def step(_: int, x: jax.Array) -> jax.Array:
        return jnp.asarray(x - slope(torsion, x, p) / curve(torsion, x, p))

    found: jax.Array = jax.lax.fori_loop(0, 6, step, rest)
    return found


def _cubic(rest: jax.Array, p: Parameters) -> jax.Array:
    """Return the cubic coefficient of the static torque [N m/rad³]: R'''/6 at φ = 0, the head sinking as it likes.

    x''(0) = -V_φφx/V_xx, hence R''' = V_φφφφ - 3 V_φφx²/V_xx.
    """
    zero = jnp.zeros(())
    second = jax.grad(jax.grad(potential))
    fourth = jax.grad(jax.grad(second))(zero, rest, p)
    across = jax.grad(second, argnums=1)(zero, rest, p)
    axial = jax.grad(jax.grad(potential, argnums=1), argnums=1)(zero, rest, p)
    return jnp.asarray((fourth - 3 * across**2 / axial) / 6)


def _balance(numbers: Numbers, pretension: jax.Array, mode: jax.Array, amplitude: jax.Array) -> Balance:
    p, rest = set_pretension(numbers.p, pretension, numbers.contact, mode, jnp.asarray(LIMIT_RESERVE_N))
    zero = jnp.zeros(())
    tension = tendon_tension(tendon_stretch(zero, rest, p)[0], p)
    angle = 2 * jnp.pi * (jnp.arange(_POINTS) + 0.5) / _POINTS
    cosine = jnp.cos(angle)
    torsion = amplitude * cosine
    sunk = jax.vmap(_sunk, in_axes=(0, None, None))(torsion, rest, p)
    static = jax.vmap(jax.grad(potential), in_axes=(0, 0, None))(torsion, sunk, p)
    pull = jax.vmap(total_tension, in_axes=(0, 0, None))(torsion, sunk, p)
    rising = jnp.where(jnp.sin(angle) < 0, 1.0, -1.0)  # falling, the loop is its mirror image
    friction = p.guides.greatest_torque(pull) * rising * p.guides.loop(rising * torsion, amplitude)
    held = 2 * jnp.mean((static + friction) * cosine) / amplitude
    torsional = twist_rigidity(1 - rest / p.length, p) / p.length
    lost_guides = -2 * jnp.pi * amplitude * jnp.mean(friction * jnp.sin(angle))
    inertia = p.head + p.lever
    times = relaxation_times()

    def prony(omega: jax.Array) -> tuple[jax.Array, jax.Array]:
        storage, loss = zero, zero
        for share, tau in zip(p.prony_shares, times, strict=True):
            wt = omega * tau
            storage, loss = storage + share * wt**2 / (1 + wt**2), loss + share * wt / (1 + wt**2)
        return torsional * storage, torsional * loss

    def closer(_: int, omega: jax.Array) -> jax.Array:
        return jnp.sqrt((held + prony(omega)[0]) / inertia)

    omega = jax.lax.fori_loop(0, _ROUNDS, closer, jnp.sqrt(held / inertia))
    stiffness = held + prony(omega)[0]
    lost_silicone = jnp.pi * prony(omega)[1] * amplitude**2
    lost_viscous = jnp.pi * p.viscous * omega * amplitude**2
    lost = lost_silicone + lost_guides + lost_viscous
    whole = jnp.maximum(lost, 1e-300)
    return Balance(
        tension,
        tension * p.head_radius,
        omega / (2 * jnp.pi),
        lost / (2 * jnp.pi * stiffness * amplitude**2),
        _cubic(rest, p),
        lost_silicone / whole,
        lost_guides / whole,
        lost_viscous / whole,
    )


@cache
def _compiled() -> Any:
    return jax.jit(_balance)


def balance(numbers: Numbers, pretension_mm: float, mode: float, amplitude_rad: float) -> Balance:
    """Return what the joint is like at a pretension [mm], motor mode and torsion amplitude [rad]."""
    found: Balance = _compiled()(numbers, np.float64(pretension_mm * 1e-3), np.float64(mode), np.float64(amplitude_rad))
    return found
