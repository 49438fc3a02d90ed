"""This is where a predicted joint's tensions and compression are found, at rest and where it twists most."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.predict.prediction import Problem
from sinew.twin.energy import potential, tendon_stretch, tendon_tension
from sinew.twin.parameters import Parameters

__all__ = ["Loads", "loads_of"]

Array = NDArray[np.float64]

_STEPS = 12


class Loads(NamedTuple):
    """By lane: tension of one tendon at rest and at the largest torsion [N], stretch λ at rest and at that torsion [1],
    and that torsion [rad]."""

    rest_tension: Array
    tension: Array
    rest_stretch: Array
    stretch: Array
    torsion: Array


def loads_of(problem: Problem, torsion: Array) -> Loads:
    """Return the loads of a rig's lanes at rest and, statically, at a torsion (lane,) [rad].

    At that torsion the head has sunk to where the relaxed axial force vanishes; inertia of the head, the silicone's
    memory and friction are left out.
    """
    p: Parameters = problem.lane.p
    rest = problem.rest[:, 1]
    sunk = _sunk(torsion, rest, p)
    length = np.asarray(p.length)
    return Loads(
        _tension(np.zeros_like(rest), rest, p),
        _tension(torsion, sunk, p),
        1 - rest / length,
        1 - sunk / length,
        torsion,
    )


def _tension(torsion: Array, shortening: Array, p: Parameters) -> Array:
    each = [tendon_tension(s, p) for s in tendon_stretch(jnp.asarray(torsion), jnp.asarray(shortening), p)]
    return np.asarray(jnp.max(jnp.stack(each), axis=0))


def _sunk(torsion: Array, start: Array, p: Parameters) -> Array:
    """Return the shortening at which ∂V/∂x = 0 at a torsion, by Newton's method in each lane."""
    return np.asarray(_relaxed(jnp.asarray(torsion), jnp.asarray(start), p), dtype=float)


@jax.jit
def _relaxed(torsion: jax.Array, start: jax.Array, p: Parameters) -> jax.Array:
    def total(x: jax.Array) -> jax.Array:
        return jnp.sum(potential(torsion, x, p))

    def slope(x: jax.Array) -> jax.Array:
        return jnp.asarray(jax.grad(total)(x))

    def step(x: jax.Array, _: None) -> tuple[jax.Array, None]:
        force, stiffness = jax.jvp(slope, (x,), (jnp.ones_like(x),))
        return x - force / stiffness, None

    return jax.lax.scan(step, start, None, length=_STEPS)[0]
