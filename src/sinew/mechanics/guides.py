"""Guide friction: its laws, what they hold, lose and store, and the loop that a steady swing goes round.

Tendons that run through guides rub on them. The torque on the head is μ ΣT z: μ [m] a friction arm, ΣT the tension of
all tendons, z between -1 and 1 the mean deflection of bristles that bend before they slip. Each follows the torsion φ,
whatever its speed, by

    dz/dt = (φ̇ - |φ̇| g(z)) / (c φ_s),

g(z) being the share that slips, 0 where the bristle stands straight and ±1 where z is. A law says how many bristles
there are, the reach c of each as a share of φ_s, and g. In its bristles it stores ½ μ ΣT φ_s c z², and it turns
μ ΣT |φ̇| z g(z) to heat, the means over the bristles. Everything that is known of a friction law stands here, for the
motion in time, for prediction, identification, energy and the estimates of a plan.

Numbers may be scalars or arrays, of NumPy or JAX: this module needs neither JAX nor a rig.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, ClassVar, Literal, Self

import numpy as np

from sinew.measure.arrays import namespace_of

LOOP_POINTS = 24
"""Nodes of Chebyshev and Gauss over a half cycle at which a loop's fundamental is taken."""

_SMALLEST = 1e-6  # of a swing over the reach, by which its loop is still told from rounding


@dataclass(frozen=True)
class GuideFriction(ABC):
    """A law of the guides' friction.

    level: μ, torque on the head per tension of all tendons together [m]. reach: φ_s, torsion over which the torque
    builds up [rad]: at small angles the guides are a spring of stiffness μ ΣT/φ_s. spread: c of each bristle; the mean
    of 1/c is one. steepest: the largest slope of g.
    """

    level: Any
    reach: Any
    spread: ClassVar[tuple[float, ...]]
    steepest: ClassVar[float]

    @staticmethod
    @abstractmethod
    def slip(z: Any) -> Any:
        """Return g(z)."""

    @staticmethod
    @abstractmethod
    def rising(travel: Any, amplitude: Any) -> Any:
        """Return z of one bristle on the rising half of the closed loop of a steady swing.

        travel: from the lower turning point; amplitude: of the swing; both over the bristle's reach.
        """

    @staticmethod
    @abstractmethod
    def swept(amplitude: Any) -> Any:
        """Return the energy that one bristle loses in a cycle, over 4 μ ΣT c φ_s; amplitude: over its reach."""

    def fastest(self, speed: Any) -> Any:
        """Return the rate [1/s] at which a bristle forgets at a speed of torsion [rad/s]; time steps resolve it."""
        return self.steepest * abs(speed) / (min(self.spread) * self.reach)

    def scaled(self, factor: Any) -> Self:
        """Return the same law with its level times a factor."""
        return replace(self, level=self.level * factor)

    def rates(self, speed: Any, bristles: tuple[Any, ...]) -> tuple[Any, ...]:
        """Return the time derivative of each bristle's deflection [1/s] at a speed of torsion [rad/s]."""
        pairs = zip(self.spread, bristles, strict=True)
        return tuple((speed - abs(speed) * self.slip(z)) / (c * self.reach) for c, z in pairs)

    def torque(self, tension: Any, bristles: tuple[Any, ...]) -> Any:
        """Return the torque on the head [N m], against the motion. tension: of all tendons together [N]."""
        return self.level * tension * _mean(bristles)

    def greatest_torque(self, tension: Any) -> Any:
        """Return the torque of guides that slip [N m]: μ ΣT."""
        return self.level * tension

    def stiffness(self, tension: Any) -> Any:
        """Return the stiffness of guides that hold [N m/rad]: μ ΣT/φ_s."""
        return self.level * tension / self.reach

    def stored(self, tension: Any, bristles: tuple[Any, ...]) -> Any:
        """Return the energy in bent bristles [J]."""
        bent = _mean([c * z**2 for c, z in zip(self.spread, bristles, strict=True)])
        return 0.5 * self.reach * self.level * tension * bent

    def power(self, tension: Any, speed: Any, bristles: tuple[Any, ...]) -> Any:
        """Return the power turned to heat [W] at a speed of torsion [rad/s]."""
        return self.level * tension * _mean([z * self.slip(z) for z in bristles]) * abs(speed)

    def loop(self, torsion: Any, amplitude: Any) -> Any:
        """Return the mean deflection where the torsion rises from -amplitude to amplitude [rad], swinging steadily."""
        reaches = [c * self.reach for c in self.spread]
        return _mean([self.rising((torsion + amplitude) / reach, amplitude / reach) for reach in reaches])

    def loss(self, tension: Any, amplitude: Any) -> Any:
        """Return the energy lost in one cycle of a steady swing [J]. amplitude: of the torsion [rad]."""
        reaches = [c * self.reach for c in self.spread]
        return 4 * self.level * tension * _mean([reach * self.swept(amplitude / reach) for reach in reaches])

    def fundamental(self, tension: Any, amplitude: Any) -> tuple[Any, Any]:
        """Return (spring, loss): real and imaginary part of the fundamental's stiffness [N m/rad] in a steady swing.

        A swing of nothing has the limit of small ones: guides that hold.
        """
        xp = namespace_of(amplitude)
        amplitude = xp.maximum(amplitude, _SMALLEST * self.reach)
        path = -np.cos((2 * np.arange(LOOP_POINTS) + 1) * np.pi / (2 * LOOP_POINTS))
        each = xp.expand_dims(amplitude, -1)
        held = xp.mean(self.loop(path * each, each) * path, axis=-1)
        return self.level * tension * 2 * held / amplitude, self.loss(tension, amplitude) / (np.pi * amplitude**2)

    def first_guess(self, swing: Any) -> list[Any]:
        """Return the amplitude of each bristle's deflection in a steady swing of some torsion [rad]."""
        return [np.minimum(1.0, swing / (c * self.reach)) for c in self.spread]


def _mean(values: Any) -> Any:
    first, *rest = values
    return sum(rest, start=first) / len(values) if rest else first


class Dahl(GuideFriction):
    """Dahl's law: one bristle, of which the share z slips.

    Between -a and a its loop is z = 1 - (1 + tanh(a/φ_s)) exp(-(φ + a)/φ_s) on the way up, and the mirror image.
    """

    spread = (1.0,)
    steepest = 1.0

    @staticmethod
    def slip(z: Any) -> Any:
        return z

    @staticmethod
    def rising(travel: Any, amplitude: Any) -> Any:
        xp = namespace_of(amplitude)
        return 1 - (1 + xp.tanh(amplitude)) * xp.exp(-travel)

    @staticmethod
    def swept(amplitude: Any) -> Any:
        return amplitude - namespace_of(amplitude).tanh(amplitude)


class MaxwellSlip(GuideFriction):
    """The Maxwell-slip model: springs in parallel that slide, each at its own torsion; here four, an octave apart.

    g(z) = z |z|⁷: a spring is nearly perfect until it slides. The loop is read from tables, made once, of the way that
    a bristle takes from one deflection to another, ∫ dz/(1 - g).
    """

    spread = (0.46875, 0.9375, 1.875, 3.75)
    steepest = 8.0

    @staticmethod
    def slip(z: Any) -> Any:
        return z * abs(z) ** 7

    @staticmethod
    def rising(travel: Any, amplitude: Any) -> Any:
        xp, (z, path, half, _) = namespace_of(amplitude), _sliding()
        turning = xp.interp(amplitude, half, z[-half.size :])
        return xp.interp(xp.interp(-turning, z, path) + travel, path, z)

    @staticmethod
    def swept(amplitude: Any) -> Any:
        xp, (_, _, half, energy) = namespace_of(amplitude), _sliding()
        return xp.interp(amplitude, half, energy) + xp.maximum(amplitude - half[-1], 0.0)


@cache
def _sliding() -> tuple[Any, Any, Any, Any]:
    """Return (deflections, way to them from the first one, and for those from zero on: amplitude of the swing that they
    turn round in, energy it loses in a cycle over 4 μ ΣT), of one bristle of Maxwell-slip, ways over its reach."""
    top = 1 - np.geomspace(0.3, 1e-9, 3000)
    z = np.concatenate([-top[::-1], np.linspace(-0.7, 0.7, 4001)[1:-1], top])
    slopes = 1 / (1 - MaxwellSlip.slip(z))
    path = np.concatenate([[0.0], np.cumsum(0.5 * (slopes[1:] + slopes[:-1]) * np.diff(z))])
    middle = z.size // 2
    half = 0.5 * (path[middle:] - path[middle::-1])
    # ∮ z dφ: twice the integral over the rising half, of which 4 is taken out.
    area = np.concatenate([[0.0], np.cumsum(0.5 * (z[1:] + z[:-1]) * np.diff(path))])
    return z, path, half, 0.5 * (area[middle:] - area[middle::-1])


GuideLaw = Literal["dahl", "maxwell-slip"]
"""Names of the laws, as a rig file has them."""

GUIDE_LAWS: dict[str, type[GuideFriction]] = {"dahl": Dahl, "maxwell-slip": MaxwellSlip}
