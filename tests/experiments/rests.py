"""The energy of a joint that bends, written down apart, and its minimum.

In plain NumPy from the rig's own numbers: a rod of 48 straight steps, each turned by the strain in its middle, and
tendons from its end to its foot. `scipy.optimize.minimize` gets nothing of it but its value.
"""

import numpy as np
from numpy.polynomial import legendre
from scipy.optimize import OptimizeResult, minimize
from scipy.spatial.transform import Rotation

from sinew.measure.arrays import Array
from sinew.measure.units import STANDARD_GRAVITY
from sinew.plan.rig import RigSpec

STEPS = 48
_BASIS = legendre.legvander(2 * (np.arange(STEPS) + 0.5) / STEPS - 1, 2)


class PlainJoint:
    """The energy of a rig's joint, in plain NumPy from the rig's numbers. x: 18 strains, the curvatures times L."""

    def __init__(self, rig: RigSpec) -> None:
        assert rig.space is not None
        silicone, tendons, space = rig.silicone, rig.tendons, rig.space
        self.length = silicone.length.value
        diameter = silicone.diameter.value
        if rig.section is None:
            torsion, area = np.pi * diameter**4 / 32, np.pi * diameter**2 / 4
            self.moments = np.array([torsion / 2, torsion / 2])
        else:
            torsion, area = rig.section.torsion_constant.value, rig.section.area.value
            self.moments = np.array([rig.section.least_moment.value, rig.section.greatest_moment.value])
        self.g, self.torsion, self.area = silicone.torsional_rigidity.value / torsion, torsion, area
        azimuth, cast = np.radians(space.rest_azimuth_deg), np.radians(space.rest_bend_deg)
        self.cast = np.array([0.0, -cast * np.sin(azimuth), cast * np.cos(azimuth)])
        angle = 2 * np.pi * np.arange(tendons.count) / tendons.count
        around = np.stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)], axis=1)
        self.feet, self.guides = tendons.base_radius.value * around, tendons.head_radius.value * around
        self.beyond = tendons.free_span.value - self.length
        self.stiffness = 1 / (1 / tendons.cable_stiffness.value + 1 / tendons.servo_stiffness.value)
        self.channel = space.routing == "channel"
        lever = space.lever_mass.value
        head = rig.inertia.head_mass.value - lever
        self.mass, self.line = head + lever, space.density.value * area
        self.above = head * space.head_height.value + lever * space.lever_height.value

    def shape(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """Return strains (step, 6), middles of the steps [m], rotation and place of the end."""
        strains = _BASIS @ x.reshape(6, 3).T
        bent = strains[:, :3] + self.cast
        along = strains[:, 3:] + np.array([1.0, 0.0, 0.0])
        halves = Rotation.from_rotvec(bent / (2 * STEPS)).as_matrix()
        turned, place, middles = np.eye(3), np.zeros(3), np.empty((STEPS, 3))
        for i in range(STEPS):
            middle = turned @ halves[i]
            step = middle @ along[i] * (self.length / STEPS)
            middles[i], place = place + step / 2, place + step
            turned = middle @ halves[i]
        return strains, middles, turned, place

    def spans(self, x: Array) -> Array:
        """Return the length of every tendon [m]."""
        strains, _, turned, place = self.shape(x)
        if self.channel:
            arms = 0.5 * (self.feet + self.guides)
            bent = (strains[:, :3] + self.cast) / self.length
            along = strains[:, 3:] + np.array([1.0, 0.0, 0.0])
            tangents = along[:, None] + np.cross(bent[:, None], arms[None])
            return np.asarray(np.linalg.norm(tangents, axis=2).mean(axis=0) * self.length + self.beyond)
        heads = place + (self.guides + np.array([self.beyond, 0, 0])) @ turned.T
        return np.asarray(np.linalg.norm(heads - self.feet, axis=1))

    def body(self, x: Array) -> float:
        """Return the energy of silicone and weight [J]."""
        strains, middles, turned, place = self.shape(x)
        stretch = 1 + strains[:, 3]
        if np.any(stretch < 0.2):
            return float("inf")
        polar = self.moments.sum()
        twist = self.g * (polar / stretch - (polar - self.torsion) / stretch**4)
        bend = self.g * np.outer((1 + 2 * stretch**-3) / stretch, self.moments)
        dense = self.g * self.area * (stretch**2 + 2 / stretch - 3)
        dense = (
            dense + twist * (strains[:, 0] / self.length) ** 2 + 0.9 * self.g * self.area * (strains[:, 4:] ** 2).sum(1)
        )
        dense = dense + (bend * (strains[:, 1:3] / self.length) ** 2).sum(axis=1)
        high = self.mass * place[0] + self.above * turned[0, 0] + self.line * self.length * middles[:, 0].mean()
        return float(0.5 * self.length * dense.mean() + STANDARD_GRAVITY * high)

    def scale(self) -> Array:
        """Return a size of each unknown, so that the minimiser sees all of them alike."""
        length = self.length
        rows = [self.g * self.torsion / length, *(3 * self.g * self.moments / length)]
        rows += [3 * self.g * self.area * length] + [0.9 * self.g * self.area * length] * 2
        return np.asarray(1 / np.sqrt(np.array(rows)[:, None] / (2 * np.arange(3) + 1))).ravel()


def _stretched(spans: Array, ends: Array | None) -> Array:
    """Return how far tendons are stretched [m] whose motors hold positions; raises ValueError without their ends."""
    if ends is None:
        raise ValueError("found neither cable ends nor tensions, expected one of them; name what the motors hold")
    return np.maximum(spans - ends, 0.0)


def held_energy(joint: PlainJoint, x: Array, ends: Array | None, tension: Array | None) -> float:
    """Return the energy [J] with motors that hold positions (ends [m]) or currents (tension [N])."""
    if tension is not None:
        return joint.body(x) + float(tension @ joint.spans(x))
    taut = _stretched(joint.spans(x), ends)
    return joint.body(x) + 0.5 * joint.stiffness * float(taut @ taut)


def least(joint: PlainJoint, start: Array, ends: Array | None, tension: Array | None) -> OptimizeResult:
    """Return where the energy is least, from a start."""
    scale = joint.scale()
    base = held_energy(joint, start, ends, tension)

    def value(y: Array) -> float:
        return held_energy(joint, scale * y, ends, tension) - base

    y = start / scale
    for _ in range(2):  # the second run begins with a fresh estimate of the curvature
        found = minimize(value, y, jac="3-point", method="BFGS", options={"gtol": 1e-7, "maxiter": 400})
        y = found.x
    found.x = scale * y
    return found
