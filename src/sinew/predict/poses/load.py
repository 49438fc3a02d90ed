"""Load: how tendons share what bends and loads a joint, and how much it carries in pitch and roll."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from sinew.measure.arrays import Array
from sinew.measure.estimate import NORMAL_90, Estimate
from sinew.mechanics.parameters import CURRENT
from sinew.mechanics.space import Space
from sinew.plan.pose import swing_of_bend
from sinew.plan.rig import RigSpec
from sinew.solve.spatial import (
    Around,
    around,
    bend,
    hold,
    rest,
    set_across,
    softest_of,
    steer,
)
from sinew.twin.cache import configure
from sinew.twin.parameters import space_from_rig

ASSUMED = ("inertia.head_mass", "space.head_height", "space.lever_mass", "space.lever_height", "space.density")
"""Masses and heights that a rig assumes and that its weight is made of."""

PAYLOAD_HEIGHT = 0.1
"""Height of the centre of what is carried above the head plate [m], where nothing else is said."""

_HEAVIEST = 50.0
_MORE_THAN_LEVER = 1.05


def with_bounds(rig: RigSpec, numbers: Callable[[RigSpec], Array]) -> list[Estimate]:
    """Return numbers of a rig with what the bounds of its assumed masses make of them.

    Each of `ASSUMED` is taken as uniform between its bounds and moves the numbers along a straight line, one at a time.
    """
    value = numbers(rig)
    square = np.zeros_like(value)
    table = dict(rig.parameters())
    for name in ASSUMED:
        parameter = table[name]
        if parameter.origin != "assumed":
            continue
        low, high = parameter.bounds
        if name == "inertia.head_mass":  # which holds the lever's
            low = max(low, _MORE_THAN_LEVER * table["space.lever_mass"].value)
        ends = [numbers(rig.with_values({name: end})) for end in (low, high)]
        square += (ends[1] - ends[0]) ** 2 / 12
    return [Estimate.normal(float(v), math.sqrt(float(s))) for v, s in zip(value, square, strict=True)]


def at_least_zero(estimate: Estimate) -> Estimate:
    """Return the estimate of max(0, x) from that of x: quantiles of the one are those of the other, where they are
    positive. What a tendon that is slack would pull is negative; its tension is none, and certain."""
    value, low, high = (max(0.0, x) for x in (estimate.value, estimate.low, estimate.high))
    return Estimate(value, (high - low) / (2 * NORMAL_90), low, high)


def pulls_over_bend(rig: RigSpec, pretension_mm: float, bends_deg: Sequence[float], azimuth_deg: float = 0.0) -> Array:
    """Return what pulls each tendon taut [N] in poses held by position, (bend, tendon): its tension, negative where it
    is slack, by as much as its stiffness makes of the missing length; NaN where there is no pose."""
    configure()
    space, contact = space_from_rig(rig), rig.tendons.first_contact_tension.value
    direction = np.array(swing_of_bend(1.0, math.radians(azimuth_deg)))
    rows = []
    for one in bends_deg:
        there, found = bend(space, contact, 1e-3 * pretension_mm, math.radians(one) * direction)
        pull = float(there.rod.joint.stiffness) * (found.at.spans - np.asarray(there.cable_end))
        rows.append(pull if found.found else np.full(rig.tendons.count, np.nan))
    return np.array(rows)


class TiltStiffness(NamedTuple):
    """Of the upright joint at a pretension, against a moment on its head towards the first tendon: stiffness in tilt
    with motors that hold positions, and with ones that hold currents [N m/rad]; the moment at which a tendon goes
    slack, and at which one reaches the rig's tension limit, along the tangent [N m]."""

    by_position: float
    by_current: float
    slack_moment: float
    tension_moment: float


def tilt_stiffness(rig: RigSpec, pretension_mm: float) -> TiltStiffness:
    """Return how the upright joint resists a moment about z."""
    configure()
    space, contact = space_from_rig(rig), rig.tendons.first_contact_tension.value
    there, found = rest(space, contact, np.full(rig.tendons.count, 1e-3 * pretension_mm))
    turn = found.at.by_tilt[1]
    moved = np.linalg.solve(found.at.stiffness, turn)  # per newton metre
    pulled = float(there.rod.joint.stiffness) * (found.at.by_span @ moved)
    by_current: Around = around(found.q, hold(there, found, CURRENT, 0.0))
    loose = np.linalg.solve(np.asarray(by_current.stiffness), turn)
    room = (rig.limits.tension_n - found.at.tension) / np.abs(pulled)
    return TiltStiffness(
        1 / float(turn @ moved),
        1 / float(turn @ loose),
        float(np.min(found.at.tension / np.maximum(np.abs(pulled), 1e-12))),
        float(np.min(room)),
    )


class Carried(NamedTuple):
    """The largest mass on the head [kg] with which it still keeps a pose, and what ends it."""

    mass: float
    ends: str


MARGINS = ("a tendon goes slack", "a tendon pulls more than the rig allows", "the pose buckles")


def carried_mass(
    rig: RigSpec, pretension_mm: float, bend_deg: float, azimuth_deg: float = 0.0, height: float = PAYLOAD_HEIGHT
) -> Carried:
    """Return how much a joint carries on its head in a pose that its motors hold by position.

    The take-ups follow the load so that the tilt stays; their mean stays. height: of the load's centre above the
    plate [m].
    """
    way = _Loaded(rig, pretension_mm, bend_deg, azimuth_deg, height)
    before, mass = 0.0, 0.25
    if way.least(0.0) <= 0:
        return Carried(0.0, way.broken(0.0))
    while mass <= _HEAVIEST:
        if way.least(mass) <= 0:
            found = float(brentq(way.least, before, mass, xtol=1e-3))
            return Carried(found, way.broken(found + 2e-3))
        before, mass = mass, 1.5 * mass
    return Carried(_HEAVIEST, f"not up to {_HEAVIEST:g} kg")


def carried_by_bounds(
    rig: RigSpec, carried: Carried, pretension_mm: float, bend_deg: float, azimuth_deg: float = 0.0
) -> Estimate:
    """Return the largest mass with what the bounds of the rig's assumed masses make of it, each rig loaded anew."""
    if carried.ends not in MARGINS:
        return Estimate.normal(carried.mass, math.nan)
    (found,) = with_bounds(rig, lambda one: np.array([carried_mass(one, pretension_mm, bend_deg, azimuth_deg).mass]))
    return at_least_zero(found)


class _Loaded:
    """A pose under a growing load, each found from the last."""

    def __init__(self, rig: RigSpec, pretension_mm: float, bend_deg: float, azimuth_deg: float, height: float) -> None:
        configure()
        self.rig, self.height = rig, height
        bare, contact = space_from_rig(rig), rig.tendons.first_contact_tension.value
        self.held, upright = rest(bare, contact, np.full(rig.tendons.count, 1e-3 * pretension_mm))
        self.tilt = np.array(swing_of_bend(math.radians(bend_deg), math.radians(azimuth_deg)))
        self.q, self.across = upright.q, np.zeros(2)
        count = max(1, math.ceil(bend_deg / 4))
        for i in range(1, count + 1):
            found = steer(self.held, self.tilt * i / count, self.q, self.across, enough=1e-6)
            if found is not None:
                self.q, self.across = found.q, found.across

    def margins(self, mass: float) -> Array:
        """Return what is left [N], [N], [1] of `MARGINS`; -1 of each where there is no pose."""
        there = _loaded(self.held, mass, self.height)
        found = steer(there, self.tilt, self.q, self.across, enough=1e-6, most_steps=20)
        if found is None:
            return np.full(3, -1.0)
        ends = set_across(there, found.across).cable_end
        pull = float(there.rod.joint.stiffness) * (found.at.spans - ends)
        return np.array([np.min(pull), self.rig.limits.tension_n - np.max(pull), softest_of(found.at, there)])

    def least(self, mass: float) -> float:
        """Return the least of what is left, each in its own unit."""
        return float(np.min(self.margins(mass)))

    def broken(self, mass: float) -> str:
        """Return the first of `MARGINS` that is used up; where all tendons go slack at once, the pose buckles too."""
        return MARGINS[int(np.argmax(self.margins(mass) <= 0))]


def _loaded(space: Space, mass: float, height: float) -> Space:
    whole = space.head_mass + mass
    centre = (space.head_mass * space.head_height + mass * height) / whole
    heavier = space._replace(head_mass=np.asarray(whole))  # type: ignore[arg-type]
    return heavier._replace(head_height=np.asarray(centre))  # type: ignore[arg-type]
