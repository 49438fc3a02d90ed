"""The free parameters of a rig as the coordinates of a search, and back."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import numpy as np

from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import SpecError
from sinew.measure.estimate import NORMAL_95
from sinew.mechanics.parameters import Parameters
from sinew.plan.parameter import Parameter
from sinew.plan.rig import RigSpec
from sinew.twin.parameters import from_rig

_STEP = 1e-5  # of a coordinate, for the slopes of `numbers_of`: their error is 1e-10 of them
_NINETY_FIVE = round(NORMAL_95, 2)  # the digits that the shipped rigs were calibrated with
_INSIDE = 1e-9  # share of the bounds by which the search stays inside them
_ACTING = ("silicone.", "inertia.", "tendons.", "imu.residual_delay", "imu.low_pass")
_NOT_ACTING = ("tendons.counts_per_turn", "tendons.current_lsb")


class Numbers(NamedTuple):
    """What the joint's motion and its sensors depend on.

    p: of the equations of motion. contact: tension of one tendon at first contact [N]. delay: of the gyroscope beyond
    its low-pass [s]. current_per_tension: of a tendon motor [A/N].
    """

    p: Parameters
    contact: jax.Array
    delay: jax.Array
    current_per_tension: jax.Array


def numbers_of(rig: RigSpec) -> Numbers:
    """Return the numbers of a rig."""
    tendons = rig.tendons
    return Numbers(
        from_rig(rig),
        np.asarray(tendons.first_contact_tension.value),  # type: ignore[arg-type]
        np.asarray(rig.imu.residual_delay.value),  # type: ignore[arg-type]
        np.asarray(tendons.current(1.0)),  # type: ignore[arg-type]
    )


@dataclass(frozen=True)
class Coordinates:
    """The free parameters of a rig, m of them, as a vector x that is zero at the rig's own values.

    names: dotted. origin: their values in the rig, SI. width: standard deviation that the rig's bounds allow, taken as
    95 % of a normal about the value, SI. low, high: bounds of x. A parameter whose lower bound is above zero is
    value = origin·exp(x); one that may be zero is value = origin + width·x.
    """

    rig: RigSpec
    names: tuple[str, ...]
    origin: Array
    width: Array
    logarithmic: Mask
    low: Array
    high: Array

    def values(self, x: Array) -> Array:
        """Return the parameters' values [SI], shape (m,)."""
        return np.where(self.logarithmic, self.origin * np.exp(x * self.logarithmic), self.origin + self.width * x)

    def slopes(self, x: Array) -> Array:
        """Return ∂value/∂x of each, shape (m,)."""
        return np.where(self.logarithmic, self.values(x), self.width)

    def prior(self, x: Array) -> tuple[Array, Array]:
        """Return (value - origin)/width and its slope over x, shape (m,) each: the rig's own statement of x."""
        return (self.values(x) - self.origin) / self.width, self.slopes(x) / self.width

    def rig_at(self, x: Array) -> RigSpec:
        """Return the rig at x, what is tied moved along, without a look at the bounds."""
        there, values = dict(self.rig.parameters()), self._all_values(x)
        return replaced(self.rig, {name: there[name].model_copy(update={"value": v}) for name, v in values.items()})

    def fitted_rig(self, x: Array) -> RigSpec:
        """Return the rig at x, validated; what the fit moved is called calibrated."""
        everywhere = dict(self.rig.parameters())
        inside = {name: float(np.clip(v, *everywhere[name].bounds)) for name, v in self._all_values(x).items()}
        return self.rig.with_values(inside, origin="calibrated")

    def numbers(self, x: Array) -> Numbers:
        """Return the numbers at x."""
        return numbers_of(self.rig_at(x))

    def directions(self, x: Array) -> Numbers:
        """Return ∂numbers/∂x by central differences, each leaf with a leading axis (m,)."""
        steps = np.eye(len(self.names)) * _STEP
        rows = [jax.tree.map(_slope, self.numbers(x + step), self.numbers(x - step)) for step in steps]
        stacked: Numbers = jax.tree.map(lambda *leaves: np.stack(leaves), *rows)
        return stacked

    def _all_values(self, x: Array) -> dict[str, float]:
        values = dict(zip(self.names, self.values(x).tolist(), strict=True))
        tied: dict[str, float] = {}
        tendons, inertia = self.rig.tendons, self.rig.inertia
        if "tendons.head_radius" in values and "tendons.base_radius" not in values:
            ratio = tendons.base_radius.value / tendons.head_radius.value
            tied["tendons.base_radius"] = ratio * values["tendons.head_radius"]
        if "inertia.lever" in values and "inertia.head" not in values:
            tied["inertia.head"] = inertia.head.value + inertia.lever.value - values["inertia.lever"]
        return values | tied


def make_coordinates(rig: RigSpec, free: Sequence[str]) -> Coordinates:
    """Return the coordinates of the free parameters.

    Raises SpecError for a name that the rig has not, that does not act on the joint's motion, or that its bounds fix.
    """
    there = dict(rig.parameters())
    for name in free:
        if name not in there:
            raise SpecError(f"free parameter {name!r} is not in the rig; expected dotted names as tendons.head_radius")
        if not name.startswith(_ACTING) or name in _NOT_ACTING:
            raise SpecError(
                f"{name} has no part in the motion under a measured lever, so it cannot be free; leave it out"
            )
        if not there[name].bounds[0] < there[name].bounds[1]:
            raise SpecError(f"the bounds of {name} leave it no room; widen them, or leave it out")
    if not free or len(set(free)) != len(free):
        raise SpecError(f"found {len(free)} free parameters, {len(set(free))} of them different; list each once")
    origin = np.array([there[name].value for name in free])
    bounds = np.array([_bounds(rig, name, there[name], free) for name in free])
    width = np.array([there[name].bounds[1] - there[name].bounds[0] for name in free]) / (2 * _NINETY_FIVE)
    logarithmic = (bounds[:, 0] > 0) & (origin > 0)
    room = _INSIDE * (bounds[:, 1] - bounds[:, 0])
    low, high = bounds[:, 0] + room, bounds[:, 1] - room
    safe = np.where(logarithmic, origin, 1.0)
    ends = [
        np.where(logarithmic, np.log(np.where(logarithmic, end, 1.0) / safe), (end - origin) / width)
        for end in (low, high)
    ]
    return Coordinates(rig, tuple(free), origin, width, logarithmic, ends[0], ends[1])


def _bounds(rig: RigSpec, name: str, parameter: Parameter, free: Sequence[str]) -> tuple[float, float]:
    """Return the bounds of a parameter that keep what is tied to it inside its own, too."""
    low, high = parameter.bounds
    if name == "inertia.lever" and "inertia.head" not in free:
        whole, other = rig.inertia.head.value + rig.inertia.lever.value, rig.inertia.head.bounds
        low, high = max(low, whole - other[1]), min(high, whole - other[0])
    if name == "tendons.head_radius" and "tendons.base_radius" not in free:
        ratio, other = rig.tendons.base_radius.value / rig.tendons.head_radius.value, rig.tendons.base_radius.bounds
        low, high = max(low, other[0] / ratio), min(high, other[1] / ratio)
    return low, high


def _slope(up: Array, down: Array) -> Array:
    return np.zeros_like(up) if np.array_equal(up, down) else np.asarray((up - down) / (2 * _STEP))  # inf - inf


def replaced(rig: RigSpec, changed: Mapping[str, Parameter]) -> RigSpec:
    """Return the rig with whole parameters replaced, by dotted name, without a look at the bounds.

    `RigSpec.with_values` would drop the intervals of the others.
    """
    parts: dict[str, dict[str, Parameter]] = {}
    for dotted, one in changed.items():
        part, name = dotted.split(".")
        parts.setdefault(part, {})[name] = one
    return rig.model_copy(update={part: getattr(rig, part).model_copy(update=rows) for part, rows in parts.items()})
