"""This is where a steady motion is asked whether it stays: how a small disturbance grows over one period.

The equations are linearised along the motion, δẏ = A(t) δy, in first-order form: coordinates, their rates, and the
copies that lag behind. Each sample of A holds for the interval about it, whose map is the (2, 2) Padé approximant of
exp(A h): stable for whatever is fast, the axial motion of a head or a gear that sticks.

Where the equations are symmetric half a period is enough: with S the change of sign of the odd coordinates, the half
map S Φ(T/2) has the square roots of the multipliers as eigenvalues. One at +1 belongs to a fold, one at -1 to a loss of
symmetry.
"""

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.predict.elimination import solve
from sinew.predict.waves import Equations, is_symmetric, size_of

__all__ = ["half_map", "largest_multiplier"]


def _generator(local: jax.Array, equations: Equations) -> jax.Array:
    """Return A at every sample, (n, s, s), from the slopes of the rates by the channels (n, c, k).

    Channels and states stand in the same order: lower derivatives and lagging copies, coordinate by coordinate.
    """
    total = size_of(equations)
    rates, own = np.zeros((total, total)), 0
    tops = []
    for coordinate in equations.coordinates:
        top = own + coordinate.order - 1
        tops.append(top)
        if coordinate.order == 2:
            rates[own, top] = 1.0
        for i, relaxation in enumerate(coordinate.relaxed):
            rates[top + 1 + i, [own, top + 1 + i]] = 1 / relaxation, -1 / relaxation
        own = top + 1 + len(coordinate.relaxed)
    whole = jnp.broadcast_to(rates, (local.shape[0], total, total))
    return whole.at[:, np.array(tops), :].set(local)


def _signs(equations: Equations) -> NDArray[np.float64]:
    rows = [np.full(c.order + len(c.relaxed), -1.0 if c.parity == "odd" else 1.0) for c in equations.coordinates]
    return np.concatenate(rows)


def half_map(local: jax.Array, omega: jax.Array, equations: Equations) -> jax.Array:
    """Return the map (s, s) of disturbances over half a period, odd coordinates turned back; over a whole one where
    the equations are not symmetric.

    local: slopes of the rates by the channels at the samples, (n, c, k). omega: Ω [rad/s].
    """
    symmetric = is_symmetric(equations)
    duration = (np.pi if symmetric else 2 * np.pi) / omega
    half = _generator(local, equations) * (0.5 * duration / local.shape[0])
    sign = _signs(equations) if symmetric else np.ones(size_of(equations))
    one = jnp.eye(size_of(equations))

    def step(now: jax.Array, odd: jax.Array) -> tuple[jax.Array, None]:
        even = one + odd @ odd / 3
        return solve(even - odd, (even + odd) @ now), None

    whole, _ = jax.lax.scan(step, one, half)
    return jnp.asarray(sign)[:, None] * whole


def largest_multiplier(maps: NDArray[np.float64], equations: Equations) -> NDArray[np.float64]:
    """Return the modulus of the largest Floquet multiplier of each map (..., s, s); a motion is stable below one."""
    largest = np.max(np.abs(np.linalg.eigvals(maps)), axis=-1)
    return np.asarray(largest**2 if is_symmetric(equations) else largest)
