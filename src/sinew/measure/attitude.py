"""Attitude of the head: quaternions, swing and twist, and what a bend takes from a gyroscope.

An orientation is the unit quaternion (w, x, y, z) that turns the axes of the base B into those of the head H. It parts
into a twist τ about B's x axis, done first, and a swing about an axis in the plate, done after it (Dobrowolski,
Swing-twist decomposition in Clifford algebra, 2015):

    q = q_swing q_twist,   τ = 2 atan2(q_x, q_w),   swing = β (0, -sin α, cos α).

The twist is the torsion. The swing is the bend: by β towards the direction α that is counted from y to z, so that the
head's x axis points along (cos β, sin β cos α, sin β sin α). Its components about y and z are pitch and roll. Angles of
Euler would not do: their yaw of a bend in two axes is not zero.
"""

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from sinew.measure.arrays import Array

LEAST_TWIST = 1e-6
"""Of cos(β/2): nearer to a bend of 180° no twist can be told."""


def quaternion(torsion: ArrayLike, bend: ArrayLike = 0.0, azimuth: ArrayLike = 0.0) -> Array:
    """Return the orientation of a head that is twisted by `torsion` and then bent by `bend` towards `azimuth`.

    Angles [rad], shape (n,) or one for all; the quaternions have the shape (n, 4), w ≥ 0 for a torsion within ±180°.
    """
    half_twist, half_bend, towards = np.broadcast_arrays(*(np.atleast_1d(a) for a in (torsion, bend, azimuth)))
    half_twist, half_bend = 0.5 * half_twist, 0.5 * half_bend
    turned = towards - half_twist  # q_swing q_twist: the swing's axis comes out turned back by half the twist
    cos, sin = np.cos(half_bend), np.sin(half_bend)
    parts = (cos * np.cos(half_twist), cos * np.sin(half_twist), -sin * np.sin(turned), sin * np.cos(turned))
    return np.stack(parts, axis=-1)


def torsion_of(orientation: Array) -> Array:
    """Return the torsion [rad] of orientations (n, 4), unwrapped from one to the next, shape (n,).

    The first lies within ±180°. Raises ValueError where a head is bent by 180°: there is no twist to tell then.
    """
    if (np.hypot(orientation[:, 0], orientation[:, 1]) < LEAST_TWIST).any():
        raise ValueError("found a head that is bent by 180°, where torsion means nothing")
    angle = np.unwrap(2.0 * np.arctan2(orientation[:, 1], orientation[:, 0]))
    return np.asarray(angle - math.tau * round(float(angle[0]) / math.tau))


def head_axis(orientation: Array) -> Array:
    """Return the direction of the head's x axis in frame B, unit vectors of shape (n, 3)."""
    return np.asarray(Rotation.from_quat(orientation, scalar_first=True).apply((1.0, 0.0, 0.0)))


def tilt_from(orientation: Array, bend: float, azimuth: float) -> Array:
    """Return how far the head leans from a pose, in the plane of its bend and out of it [rad], shape (n, 2).

    bend, azimuth: of the pose [rad]. In the plane: how much further it bends, out of it: towards a larger azimuth, as
    longitude and latitude on a globe whose equator is the plane of the bend. The torsion is in neither.
    """
    x, y, z = head_axis(orientation).T
    along = math.cos(azimuth) * y + math.sin(azimuth) * z
    across = math.cos(azimuth) * z - math.sin(azimuth) * y
    return np.stack([np.arctan2(along, x) - bend, np.arcsin(np.clip(across, -1.0, 1.0))], axis=-1)


def turned_about_x(orientation: Array, angle: ArrayLike) -> Array:
    """Return orientations (n, 4) seen from a base that stands turned about x by minus an angle [rad], one or (n,)."""
    about = Rotation.from_rotvec(np.atleast_1d(angle)[:, None] * np.array([[1.0, 0.0, 0.0]]))
    return np.asarray((about * Rotation.from_quat(orientation, scalar_first=True)).as_quat(scalar_first=True))


# A gyroscope on a head that twists while it is bent by β.
#
# With R = S(β, α) X(τ) the rate about the head's own x axis is ω_x = dτ/dt - (1 - cos β) dα/dt, whatever the joint is
# made of. A joint that is twisted evenly along its length keeps the bend's direction in its middle: the base sees it
# turn by half the torsion, dα/dt = ½ dτ/dt, and the head leans out of the plane by ½ sin β of the torsion. So
# ω_x = (1 + cos β)/2 dτ/dt: 0.8, 3.0 and 6.7 % less at 10, 20 and 30°. A second form needs no such joint: a small tilt
# out of the plane is dσ = sin β dα, hence ω_x = dτ/dt - tan(β/2) dσ/dt.


def gyro_share(bend: float) -> float:
    """Return the share of the torsion's rate that a gyroscope reads about the head's x axis, (1 + cos β)/2.

    bend: of the head [rad]. Of a joint that is twisted evenly, to first order in what the bend itself changes.
    """
    return 0.5 * (1.0 + math.cos(bend))


def sway_of_torsion(torsion: float, bend: float) -> float:
    """Return the tilt out of the bend's plane [rad] that a torsion [rad] brings with it: asin(sin β sin(τ/2))."""
    return math.asin(math.sin(bend) * math.sin(0.5 * torsion))
