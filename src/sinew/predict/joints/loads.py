"""This is where a predicted joint's tensions and compression are found, at rest and where it twists most."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from sinew.predict.prediction import Problem
from sinew.twin.energy import potential, tendon_stretch, tendon_tension
from sinew.twin.parameters import Parameters

__all__ = ["GRAVITY", "Loads", "Torso", "loads_of", "loads_under"]

Array = NDArray[np.float64]

_STEPS = 12


GRAVITY = 9.80665
"""Standard gravity [m/s²]."""


@dataclass(frozen=True)
class Torso:
    """What sits on a joint and presses on it. mass [kg]; centre: height of its centre above the head plate [m]."""

    mass: float
    centre: float = 0.25

    @property
    def weight(self) -> float:
        """Return its weight [N]."""
        return self.mass * GRAVITY

    def moment(self, tilt_deg: float) -> float:
        """Return the moment by which it wants to tip over where the head is tilted by so much [N m]."""
        return self.weight * self.centre * math.sin(math.radians(tilt_deg))


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


def loads_under(loads: Loads, torso: Torso, shear_rigidity: float, guides: tuple[int, float], tilt_deg: float) -> Loads:
    """Return the loads with a torso's weight on the joint.

    shear_rigidity: G A of the silicone [N]. guides: number of tendons and radius of their circle [m]. tilt_deg: how far
    the head may tilt. The silicone carries the weight on top of the tendons, G A (1/λ² - λ) = ΣT + m g, and is
    shortened by it; pretension counts from the first contact with the torso on the joint, so that the weight alone
    changes no tension. The moment of the tilted torso is held by the tendons: at most 2 M/(n r) more in one of them.
    """
    count, radius = guides
    more = 2 * torso.moment(tilt_deg) / (count * radius)

    def pressed(stretch: Array) -> Array:
        return np.array([_stretch_under(float(one), torso.weight / shear_rigidity) for one in stretch])

    return loads._replace(
        rest_tension=loads.rest_tension + more,
        tension=loads.tension + more,
        rest_stretch=pressed(loads.rest_stretch),
        stretch=pressed(loads.stretch),
    )


def _stretch_under(stretch: float, more: float) -> float:
    """Return the stretch under an additional load, as a share of G A."""
    load = stretch**-2 - stretch + more
    return float(optimize.brentq(lambda x: x**-2 - x - load, 1e-3, 2.0))


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
