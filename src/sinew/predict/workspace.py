"""Workspace: which poses a joint reaches, over pitch, roll and pretension, and what ends it where it does not."""

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.measure.estimate import NORMAL_90, Estimate
from sinew.measure.result import Column, Field, Result, Rows
from sinew.measure.tasks import HERE, Spread, cores, each_task
from sinew.mechanics.parameters import CURRENT, TENDON_MODES
from sinew.mechanics.space import Space
from sinew.plan.plan import swing_of_bend
from sinew.plan.rig import RigSpec
from sinew.predict.pose import PosePath, pulls_of, surface_strain, upright
from sinew.predict.validity import STRAIN
from sinew.solve.programs import configure
from sinew.solve.spatial import (
    Around,
    Steered,
    around,
    bend,
    first_contact,
    hold,
    rest,
    set_across,
    softest_of,
    steer,
)
from sinew.twin.parameters import space_from_rig

VERDICTS = ("reached", "slack", "over tension", "over travel", "over strain", "buckles", "not found")
"""What a pose is, the worst that is true of it; `OUTSIDE` where it was not asked for."""

REACHED, SLACK, TENSION, TRAVEL, STRAINED, BUCKLES, LOST = range(len(VERDICTS))
OUTSIDE = -1

MOST_POSES = 200_000

_ENOUGH = 2e-3
"""Last step of Newton's method [rad, strain]; what is left is about its square, some hundredths of a newton."""

_STRIP = 400
"""Poses in a task, about: some seconds of a core."""

Progress = Callable[[float, float], None]


@dataclass(frozen=True, repr=False)
class Shares(Result):
    """The share of each of `VERDICTS` among the poses that were asked for."""

    reached: Annotated[float, Field("reached", unit="%")]
    slack: Annotated[float, Field("slack", unit="%")]
    over_tension: Annotated[float, Field("over tension", unit="%")]
    over_travel: Annotated[float, Field("over travel", unit="%")]
    over_strain: Annotated[float, Field("over strain", unit="%")]
    buckles: Annotated[float, Field("buckles", unit="%")]
    not_found: Annotated[float, Field("not found", unit="%")]


@dataclass(frozen=True, repr=False)
class PoseMap(Result):
    """The map of one pretension, over (pitch, roll), NaN where not reached.

    taut_bend_deg: bend up to which every pose is reached with all tendons taut. verdict: index into `VERDICTS`, None
    where it was not asked for. highest_n, lowest_n: tension of a tendon, the latter negative where a cable is slack or
    would have to push; softest: of `Rest`; strain: of the surface [1].
    """

    pretension_mm: Annotated[float, Field("pretension")]
    taut_bend_deg: Annotated[float, Field("all taut up to")]
    shares: Annotated[Shares, Field("")]
    verdict: Annotated[tuple[tuple[int | None, ...], ...], Field("", "detail")]
    highest_n: Column
    lowest_n: Column
    softest: Column
    strain: Column


@dataclass(frozen=True, repr=False)
class Workspace(Result):
    """Maps of poses, one for each pretension; pitch_deg (i,), roll_deg (j,): their rows and columns."""

    rig: Annotated[str, Field("", "detail")]
    mode: Annotated[str, Field("", "detail")]
    verdicts: Annotated[tuple[str, ...], Field("", "detail")]
    pitch_deg: Column
    roll_deg: Column
    maps: Annotated[Rows[PoseMap], Field("poses that the joint reaches")]


def _map_of(plane: "Plane", pretension_mm: float) -> PoseMap:
    bend, verdict = np.hypot(plane.axis[:, None], plane.axis[None, :]), plane.verdict
    out = bend[(verdict != REACHED) & (verdict != OUTSIDE)]
    inside, first = bend[verdict == REACHED], out.min() if out.size else math.inf
    inside_circle = verdict[verdict != OUTSIDE]
    return PoseMap(
        pretension_mm,
        float(max((b for b in inside if b < first - 1e-9), default=0.0)),
        Shares(*(float(np.mean(inside_circle == code)) for code in range(len(VERDICTS)))),
        tuple(tuple(None if v == OUTSIDE else v for v in row) for row in verdict.tolist()),
        plane.highest,
        plane.lowest,
        plane.softest,
        plane.strain,
    )


def map_workspace(
    rig: RigSpec,
    pretension_mm: Sequence[float],
    *,
    step_deg: float = 2.0,
    mode: str = "position",
    spread: Spread = HERE,
    progress: Progress = lambda _done, _total: None,
) -> Workspace:
    """Return which poses a rig reaches up to the bend that it allows (`limits.bend_deg`).

    Each pose is found by `sinew.solve.spatial.steer` from its neighbours: outwards along roll, and from each of these
    poses along pitch. A tendon that is slack makes a pose no failure; a pose is lost where no way leads on.
    spread: over which processes or cluster strips of the map go, with the same result.
    Raises SpecError where the rig knows no space or the map would be too large.
    """
    if mode not in TENDON_MODES:
        raise SpecError(f"found the mode {mode!r}, expected one of {', '.join(TENDON_MODES)}")
    most = rig.limits.most_bend_deg
    if not 0.1 <= step_deg <= most:
        raise SpecError(f"found a step of {step_deg:g}°, expected 0.1 to {most:g}°, as far as the rig may bend")
    planes = planes_of(rig, pretension_mm, step_deg, mode)
    parts = [(plane, strip) for plane in planes for strip in plane.strips()]
    done, total = 0, sum(int((plane.verdict != OUTSIDE).sum()) for plane in planes)
    for index, columns in each_task(fill_strip, [strip for _, strip in parts], spread):
        plane, strip = parts[index]
        done += plane.put(strip.columns, columns)
        progress(done, total)
    axis = planes[0].axis
    maps = Rows(_map_of(plane, float(mm)) for plane, mm in zip(planes, pretension_mm, strict=True))
    return Workspace(rig.name, mode, VERDICTS, axis, axis, maps)


def planes_of(rig: RigSpec, pretension_mm: Sequence[float], step_deg: float, mode: str) -> "list[Plane]":
    """Return the maps of some pretensions, empty. Raises SpecError where they would be too large."""
    most = rig.limits.most_bend_deg
    half = int(most / step_deg + 1e-9)
    axis = np.asarray(step_deg * np.arange(-half, half + 1), dtype=float)
    total = len(pretension_mm) * int((np.hypot(*np.meshgrid(axis, axis)) <= most + 1e-9).sum())
    if total > MOST_POSES:
        raise SpecError(f"found a map of {total} poses, expected at most {MOST_POSES}; take larger steps")
    configure()
    space, contact = space_from_rig(rig), rig.tendons.first_contact_tension.value
    ends = first_contact(space, contact)[1]
    return [Plane(rig, *_upright(space, contact, 1e-3 * mm, mode), ends, axis, most) for mm in pretension_mm]


class _Known(NamedTuple):
    """A pose that was found, for its neighbours to begin at."""

    q: Array
    across: Array


class Strip(NamedTuple):
    """Some columns of a map: what `Plane` takes, which columns [index], and a pose in each to begin at, if any."""

    rig: RigSpec
    space: Space
    upright: _Known
    ends: Array
    axis: Array
    most_deg: float
    columns: tuple[int, ...]
    known: tuple[_Known | None, ...]


def fill_strip(strip: Strip) -> tuple[NDArray[Any], ...]:
    """Return the columns of a strip, each of `Plane.COLUMNS` over (pitch, column)."""
    configure()
    plane = Plane(*strip[:-2])
    with ThreadPoolExecutor(cores()) as workers:
        list(workers.map(plane.fill_column, strip.columns, strip.known))
    return tuple(getattr(plane, name)[:, strip.columns] for name in Plane.COLUMNS)


def _upright(space: Space, contact: float, pretension: float, mode: str) -> tuple[Space, _Known]:
    there, found = upright(space, contact, pretension, mode)
    return jax.tree.map(np.asarray, there), _Known(np.asarray(found.q), np.zeros(2))


class Plane:
    """The map of one pretension while it is filled; columns as in `Workspace`, (pitch, roll)."""

    COLUMNS = ("verdict", "highest", "lowest", "softest", "strain")

    def __init__(self, rig: RigSpec, space: Space, upright: _Known, ends: Array, axis: Array, most_deg: float) -> None:
        self.rig, self.space, self.start, self.ends, self.axis, self.most_deg = (
            rig,
            space,
            upright,
            ends,
            axis,
            most_deg,
        )
        inside = np.hypot(axis[:, None], axis[None, :]) <= most_deg + 1e-9
        self.verdict = np.where(inside, LOST, OUTSIDE)
        self.highest, self.lowest, self.softest, self.strain = (np.full(inside.shape, np.nan) for _ in range(4))

    def strips(self) -> Iterator[Strip]:
        """Find the poses without pitch; yield the columns that begin there, so many together as make a task."""
        middle = len(self.axis) // 2
        known: dict[int, _Known] = {}
        for sense in (1, -1):
            for j, at in self._walk([(middle, j) for j in self._outwards(middle, sense)], self.start):
                known[j[1]] = at
        columns = [j for j in range(len(self.axis)) if (self.verdict[:, j] != OUTSIDE).any()]
        size = max(1, _STRIP // len(self.axis))
        for few in (tuple(columns[i : i + size]) for i in range(0, len(columns), size)):
            begin = tuple(map(known.get, few))
            yield Strip(self.rig, self.space, self.start, self.ends, self.axis, self.most_deg, few, begin)

    def put(self, columns: Sequence[int], found: Sequence[NDArray[Any]]) -> int:
        """Take over the columns of a strip; return how many poses they have."""
        for name, values in zip(self.COLUMNS, found, strict=True):
            getattr(self, name)[:, columns] = values
        return int((self.verdict[:, columns] != OUTSIDE).sum())

    def _outwards(self, middle: int, sense: int) -> range:
        return range(middle, len(self.axis)) if sense > 0 else range(middle, -1, -1)

    def fill_column(self, j: int, start: _Known | None) -> None:
        """Find the poses of a column, from the one in its middle on; those of none stay lost."""
        if start is None:
            return
        for sense in (1, -1):
            cells = [(i, j) for i in self._outwards(len(self.axis) // 2, sense) if self.verdict[i, j] != OUTSIDE]
            for _ in self._walk(cells, start):
                pass

    def _walk(self, cells: Sequence[tuple[int, int]], start: _Known) -> Iterator[tuple[tuple[int, int], _Known]]:
        """Find the poses of neighbouring cells one after the other, each begun where the last ones lead."""
        behind = [start]
        for cell in cells:
            tilt = np.radians([self.axis[cell[0]], self.axis[cell[1]]])
            found = self._found(tilt, behind)
            if found is None:
                return
            at = _Known(found.q, found.across)
            behind = [at] if len(behind) == 1 and cell == cells[0] else [*behind[-2:], at]
            self._judge(cell, found)
            yield cell, at

    def _found(self, tilt: Array, behind: list[_Known]) -> Steered | None:
        # A parabola through the last three poses leads on; where a tendon went slack between them, the last one does.
        for weights in ((1.0, -3.0, 3.0), (-1.0, 2.0), (1.0,)):
            if len(weights) <= len(behind):
                last = behind[-len(weights) :]
                q = sum(w * one.q for w, one in zip(weights, last, strict=True))
                across = sum(w * one.across for w, one in zip(weights, last, strict=True))
                found = steer(self.space, tilt, np.asarray(q), np.asarray(across), enough=_ENOUGH, most_steps=8)
                if found is not None:
                    return found
        return None

    def _judge(self, cell: tuple[int, int], found: Steered) -> None:
        """Write what a pose is; tensions by the tangent over the last step of Newton's method."""
        rig, there = self.rig, set_across(self.space, found.across)
        spans = found.at.spans + found.at.by_span @ found.move
        pull, slack = pulls_of(spans, there), there.cable_end
        if float(there.rod.joint.mode) == CURRENT:
            slack = spans - np.maximum(pull, 0.0) / float(there.rod.joint.stiffness)
        take_up = 1e3 * (self.ends - slack)
        self.highest[cell], self.lowest[cell] = np.max(pull), np.min(pull)
        self.softest[cell] = softest_of(found.at, there)
        self.strain[cell] = surface_strain(found.q, there, rig)
        low, high = rig.limits.tendon_travel_mm
        faults = (
            (BUCKLES, self.softest[cell] <= 0),
            (STRAINED, self.strain[cell] > STRAIN),
            (TRAVEL, np.min(take_up) < low or np.max(take_up) > high),
            (TENSION, self.highest[cell] > rig.limits.tension_n),
            (SLACK, self.lowest[cell] <= 0),
        )
        self.verdict[cell] = next((code for code, holds in faults if holds), REACHED)


# ---- load: how tendons share what bends and loads a joint, and how much it carries in pitch and roll


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
        rows.append(pulls_of(found.at.spans, there) if found.found else np.full(rig.tendons.count, np.nan))
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
    sense = _Loaded(rig, pretension_mm, bend_deg, azimuth_deg, height)
    before, mass = 0.0, 0.25
    if sense.least(0.0) <= 0:
        return Carried(0.0, sense.broken(0.0))
    while mass <= _HEAVIEST:
        if sense.least(mass) <= 0:
            found = float(brentq(sense.least, before, mass, xtol=1e-3))
            return Carried(found, sense.broken(found + 2e-3))
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
        sense = PosePath.begin(
            space_from_rig(rig), rig.tendons.first_contact_tension.value, 1e-3 * pretension_mm, "position"
        )
        self.tilt = np.array(swing_of_bend(math.radians(bend_deg), math.radians(azimuth_deg)))
        count = max(1, math.ceil(bend_deg / 4))
        for i in range(1, count + 1):
            sense.pull(self.tilt * i / count)
        self.held, self.q, self.across = sense.space, sense.q, sense.across

    def margins(self, mass: float) -> Array:
        """Return what is left [N], [N], [1] of `MARGINS`; -1 of each where there is no pose."""
        there = _loaded(self.held, mass, self.height)
        found = steer(there, self.tilt, self.q, self.across, enough=1e-6, most_steps=20)
        if found is None:
            return np.full(3, -1.0)
        pull = pulls_of(found.at.spans, set_across(there, found.across))
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
