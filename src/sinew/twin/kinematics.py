"""This is where tendon lengths come from anchor points and a head pose.

Frame B sits at the lower guide circle with x along the continuum; frame H is the head's. A pose is a rotation of H
against B and the position of H's origin in B. Today the head twists and sinks; a bent head is another pose and no
change here.
"""

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

__all__ = ["guide_directions", "guide_points", "head_pose", "tendon_lengths"]


def guide_directions(count: int) -> NDArray[np.float64]:
    """Return cosine and sine of the angles of `count` equally spaced guides on their circle, shape (count, 2)."""
    angle = np.arange(count) * (2 * np.pi / count)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def guide_points(radius: jax.Array, directions: jax.Array) -> jax.Array:
    """Return guide points on a circle about the x axis [m], shape (tendon, 3); directions as above."""
    return jnp.concatenate([jnp.zeros_like(directions[:, :1]), radius * directions], axis=-1)


def head_pose(torsion: jax.Array, shortening: jax.Array, free_span: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Return (rotation (3, 3), position (3,) [m]) of a head that is twisted [rad] about x and sunk [m]."""
    c, s = jnp.cos(torsion), jnp.sin(torsion)
    one, zero = jnp.ones_like(c), jnp.zeros_like(c)
    rotation = jnp.stack(
        [jnp.stack([one, zero, zero]), jnp.stack([zero, c, -s]), jnp.stack([zero, s, c])],
    )
    return rotation, jnp.stack([free_span - shortening, zero, zero])


def tendon_lengths(base: jax.Array, head: jax.Array, rotation: jax.Array, position: jax.Array) -> jax.Array:
    """Return the straight free spans between base guides and head guides [m], shape (tendon,).

    base: guide points in B [m], (tendon, 3). head: guide points in H [m], (tendon, 3).
    rotation, position: pose of H in B.
    The spans are chords from plate to plate, not helices in the body: 17 % of torque at 60° of torsion.
    """
    # written out instead of head @ rotation.T: a batched 3x3 matrix product is a slow call inside a compiled loop
    points = sum((head[:, i, None] * rotation[:, i] for i in range(3)), position)
    return jnp.sqrt(jnp.sum((points - base) ** 2, axis=-1))
