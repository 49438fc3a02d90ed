"""Pose: where a joint that bends comes to rest, what holds it there, and what speaks against it."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import BarycentricInterpolator
from scipy.optimize import brentq

from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import SpecError
from sinew.measure.estimate import fixed, number
from sinew.measure.told import Table
from sinew.mechanics.parameters import CURRENT, POSITION, TENDON_MODES
from sinew.mechanics.rod import grid, rest_strains, rod_poses
from sinew.mechanics.space import Space, plate_guides
from sinew.plan.check import Finding
from sinew.plan.pose import STRAIGHT, Pose, bend_of_swing, swing_of_bend
from sinew.plan.rig import LIMIT_RESERVE_N, RigSpec
from sinew.predict.joints.validity import STRAIN, largest_strain
from sinew.solve.programs import configure, program
from sinew.solve.spatial import (
    Rest,
    bend,
    bend_by_tension,
    first_contact,
    hold,
    in_mode,
    patterns,
    rest,
    rest_at,
    rest_by_tension,
    set_across,
    steer,
)
from sinew.twin.parameters import space_from_rig

FURTHEST_DEG = 60.0
"""Bend up to which it is looked for where a tendon goes slack."""

_MOST_N, _MOST_MM = 10_000.0, 1000.0
"""Of a tendon; beyond them a number was meant in another unit."""

_BEND_STEP = math.radians(2.5)
_PRETENSION_STEP, _LEAST_STEP = 4e-3, 2e-4
_CHORD_POINTS = np.linspace(0.0, 1.0, 41)


class Asked(NamedTuple):
    """What is asked of the tendons of a rig: to hold a pose at a pretension, or take-ups or tensions of their own.

    mode: of the motors. take_up_mm: of each tendon from first contact; tension_n: that the currents hold. Where one of
    them is given, the pose is what comes out.
    """

    pretension_mm: float = 6.0
    pose: Pose = STRAIGHT
    mode: str = "position"
    take_up_mm: tuple[float, ...] | None = None
    tension_n: tuple[float, ...] | None = None

    @property
    def wants_tilt(self) -> bool:
        """Whether a tilt is asked for, not what tendons do."""
        return self.take_up_mm is None and self.tension_n is None

    @property
    def swing(self) -> Array:
        """Return pitch and roll of the pose [rad], (2,)."""
        return np.array(self.pose.swing_rad)

    def words(self) -> str:
        """Return what is asked in a few words."""
        if self.take_up_mm is not None:
            return f"take-ups of {', '.join(f'{mm:g}' for mm in self.take_up_mm)} mm"
        if self.tension_n is not None:
            return f"tensions of {', '.join(f'{n:g}' for n in self.tension_n)} N"
        return f"{self.pose.words()} at {self.pretension_mm:g} mm"


class Slack(NamedTuple):
    """Where the first tendon goes slack on a way of growing bend: bend [deg], and which tendon, from 1."""

    bend_deg: float
    tendon: int


class Buckling(NamedTuple):
    """Where the pose stops being stable as the pretension rises: pretension [mm] and load of all tendons [N] there.

    None of both where it is stable as far as was looked, `up_to_mm`.
    """

    pretension_mm: float | None
    load_n: float | None
    up_to_mm: float


class Shape(NamedTuple):
    """The bent silicone and its tendons, in frame B [m]. line: of its sections' centres (point, 3). turns: their
    rotations (point, 3, 3). chords: of the tendons' ends (tendon, 2, 3)."""

    line: Array
    turns: Array
    chords: Array


@dataclass(frozen=True)
class Posed:
    """What came of it. space: with the motors that hold it; rest: None where there is none, and why says so.

    strain: largest principal strain of the silicone's surface [1]. clearance: least distance of each chord to the
    silicone's surface, negative inside [m] (tendon,); sagitta: how far each leaves its place in the straight joint [m]
    (tendon,). slack: on the way to this azimuth at this pretension; buckling: of this pose with growing pretension;
    both None where take-ups or tensions were given. coordinates (6, term): also of a pose that does not stay.
    """

    rig: RigSpec
    asked: Asked
    space: Space
    rest: Rest | None
    why: str
    shape: Shape | None
    strain: float
    clearance: Array
    sagitta: Array
    slack: Slack | None
    buckling: Buckling | None
    findings: tuple[Finding, ...]
    coordinates: Array | None = None

    @property
    def ok(self) -> bool:
        """Whether it is there, stays, and breaks no limit of the rig."""
        return not any(finding.severity == "refuse" for finding in self.findings)

    def document(self) -> dict[str, Any]:
        """Return it as JSON holds it; see docs/reference/json.md."""
        rig, asked, at_rest = self.rig, self.asked, self.rest
        bend_deg, azimuth_deg = asked.pose.bend_and_azimuth_deg
        document: dict[str, Any] = {
            "rig": rig.name,
            "mode": asked.mode,
            "asked": {
                "pretension_mm": asked.pretension_mm if asked.wants_tilt else None,
                "bend_deg": bend_deg if asked.wants_tilt else None,
                "azimuth_deg": azimuth_deg if asked.wants_tilt else None,
                "take_up_mm": None if asked.take_up_mm is None else list(asked.take_up_mm),
                "tension_n": None if asked.tension_n is None else list(asked.tension_n),
            },
            "ok": self.ok,
            "found": at_rest is not None,
            "pose": None,
            "tendons": [],
            "margins": None,
            "slack": None if self.slack is None else self.slack._asdict(),
            "buckling": None if self.buckling is None else self.buckling._asdict(),
            "findings": [{"severity": one.severity, "sentence": one.sentence} for one in self.findings],
        }
        if at_rest is None or self.shape is None:
            return document
        pitch, roll = map(float, at_rest.at.tilt)
        bend_deg, azimuth_deg = map(math.degrees, bend_of_swing(pitch, roll))
        document["pose"] = {
            "bend_deg": bend_deg,
            "azimuth_deg": azimuth_deg,
            "pitch_deg": math.degrees(pitch),
            "roll_deg": math.degrees(roll),
            "torsion_deg": math.degrees(float(at_rest.at.torsion)),
            "head_mm": [1e3 * float(x) for x in self.shape.line[-1]],
            "stretch": 1 + float(at_rest.q[3, 0]),
        }
        document["tendons"] = [
            {
                "tendon": i + 1,
                "take_up_mm": 1e3 * float(at_rest.take_up[i]),
                "tension_n": float(at_rest.at.tension[i]),
                "current_a": float(rig.tendons.current(at_rest.at.tension[i])),
                "slack": bool(at_rest.at.tension[i] <= 0),
                "span_mm": 1e3 * float(at_rest.at.spans[i]),
                "clearance_mm": 1e3 * float(self.clearance[i]),
                "sagitta_mm": 1e3 * float(self.sagitta[i]),
            }
            for i in range(rig.tendons.count)
        ]
        document["margins"] = {
            "softest": at_rest.softest,
            "tension_n": rig.limits.tension_n - float(np.max(at_rest.at.tension)),
            "slack_n": float(np.min(at_rest.at.tension)),
            "strain": self.strain,
        }
        return document

    def told(self) -> list[Table | str]:
        """Return it as a person reads it."""
        head = f"{self.rig.name}, {self.asked.mode}: {self.asked.words()}"
        sentences = [f"- {'' if one.severity == 'warn' else 'refused: '}{one.sentence}" for one in self.findings]
        if self.rest is None:
            return [head, *sentences]
        document = self.document()
        rows = [
            (
                str(one["tendon"]),
                fixed(one["take_up_mm"], 2),
                fixed(one["tension_n"], 1),
                fixed(one["current_a"], 2),
                fixed(one["clearance_mm"], 1),
                fixed(one["sagitta_mm"], 1),
            )
            for one in document["tendons"]
        ]
        columns = ("tendon", "take-up/mm", "tension/N", "current/A", "from surface/mm", "sagitta/mm")
        pose, margins = document["pose"], document["margins"]
        place = ", ".join(fixed(x, 1) for x in pose["head_mm"])
        lines = [
            f"head at {place} mm (x, y, z), bent by {fixed(pose['bend_deg'], 2)}° towards "
            f"{fixed(pose['azimuth_deg'], 1)}° (pitch {fixed(pose['pitch_deg'], 2)}°, roll "
            f"{fixed(pose['roll_deg'], 2)}°), twisted by {fixed(pose['torsion_deg'], 3)}°",
            f"the silicone's surface is strained by {margins['strain']:.0%}; the softest way out of the pose is "
            f"{number(margins['softest'])} times as stiff as the unloaded silicone",
        ]
        return [Table(columns, rows, head), *lines, *self._outlook(), *sentences]

    def _outlook(self) -> Iterator[str]:
        if self.slack is not None:
            yield (
                f"on the way to this azimuth tendon {self.slack.tendon} goes slack from a bend of "
                f"{fixed(self.slack.bend_deg, 1)}° on"
            )
        buckling = self.buckling
        if buckling is not None and buckling.pretension_mm is not None:
            yield (
                f"the pose would buckle at {fixed(buckling.pretension_mm, 1)} mm of pretension, where the tendons "
                f"press with {number(buckling.load_n)} N"
            )
        elif buckling is not None and self.rest is not None:
            yield f"it does not buckle up to {buckling.up_to_mm:g} mm of pretension, as far as it was followed"


def find_pose(rig: RigSpec, asked: Asked, *, outlook: bool = True) -> Posed:
    """Return where a rig's joint rests, and what speaks against it.

    outlook: look for the bend from which on a tendon is slack, and for the pretension that makes the pose buckle.
    Motors that hold positions with a current limit rest as those without; what makes a tendon pull more than
    `LIMIT_RESERVE_N` above its tension at rest makes them yield. A pose that cannot be found, or does not stay, is no
    error: it is refused in `findings`. Raises SpecError where the rig knows no space, or the numbers cannot be meant.

    >>> import sinew as sn
    >>> from sinew.plan.pose import Pose
    >>> from sinew.predict.pose import Asked, find_pose
    >>> asked = Asked(6.0, Pose(bend_deg=20, azimuth_deg=0))
    >>> bool(find_pose(sn.load_rig("paper"), asked, outlook=False).rest.taut)
    True
    """
    _check(rig, asked)
    configure()
    space, contact = space_from_rig(rig), rig.tendons.first_contact_tension.value
    there, found, why = _rest_of(space, contact, asked)
    coordinates = None if found is None else found.q
    slack = buckling = None
    if outlook and asked.wants_tilt:
        slack = slack_bend(space, contact, asked)
        buckling = buckling_pretension(space, contact, asked, rig.limits.tendon_travel_mm[1])
    if found is None or why:
        nothing = np.zeros(rig.tendons.count)
        refusals = (Finding("refuse", why), *_asked_findings(rig, asked))
        return Posed(
            rig, asked, there, None, why, None, math.nan, nothing, nothing, slack, buckling, refusals, coordinates
        )
    shape = shape_of(found.q, there)
    clearance, sagitta = chord_clearance(found.q, there, rig)
    strain = surface_strain(found.q, there, rig)
    posed = Posed(rig, asked, there, found, "", shape, strain, clearance, sagitta, slack, buckling, (), coordinates)
    findings = (*_asked_findings(rig, asked), *_findings(posed, found))
    return Posed(**{**posed.__dict__, "findings": findings})


def _check(rig: RigSpec, asked: Asked) -> None:
    if asked.mode not in TENDON_MODES:
        raise SpecError(f"found the mode {asked.mode!r}, expected one of {', '.join(TENDON_MODES)}")
    if not 0 <= asked.pretension_mm <= 100:
        raise SpecError(f"found a pretension of {asked.pretension_mm:g} mm, expected 0 to 100: cables cannot push")
    for name, values in (("take-ups", asked.take_up_mm), ("tensions", asked.tension_n)):
        if values is not None and len(values) != rig.tendons.count:
            raise SpecError(f"found {len(values)} {name}, expected one for each of {rig.tendons.count} tendons")
    by_current = asked.mode == "current"
    if asked.take_up_mm is not None and (by_current or asked.tension_n is not None):
        raise SpecError("found take-ups of motors that hold currents, which follow; give the tensions that they hold")
    if asked.tension_n is not None and not by_current:
        raise SpecError("found tensions of motors that hold positions; give take-ups, or the mode current")
    if asked.tension_n is not None and max(asked.tension_n) > _MOST_N:
        raise SpecError(f"found a tension of {max(asked.tension_n):g} N, expected 0 to {_MOST_N:g} N; look at its unit")
    if asked.take_up_mm is not None and max(map(abs, asked.take_up_mm)) > _MOST_MM:
        far = max(asked.take_up_mm, key=abs)
        raise SpecError(f"found a take-up of {far:g} mm, expected -{_MOST_MM:g} to {_MOST_MM:g} mm; look at its unit")
    if asked.tension_n is not None and min(asked.tension_n) < 0:
        raise SpecError(f"found a tension of {min(asked.tension_n):g} N, expected zero or more: cables cannot push")


def _rest_of(space: Space, contact: float, asked: Asked) -> tuple[Space, Rest | None, str]:
    """Return (parameters, rest or None, why it is refused); one that is found and does not stay comes with a why."""
    if asked.tension_n is not None:
        there, found = rest_by_tension(space, contact, np.array(asked.tension_n))
    elif asked.take_up_mm is not None:
        there, found = rest(space, contact, 1e-3 * np.array(asked.take_up_mm))
    elif asked.mode == "current":
        there, by_current = bend_by_tension(space, contact, 1e-3 * asked.pretension_mm, asked.swing)
        if by_current is None:
            return there, None, f"no tensions were found that hold {asked.words()}"
        if (lowest := float(np.min(by_current.at.tension))) < 0:
            tendon = int(np.argmin(by_current.at.tension)) + 1
            return (
                there,
                None,
                f"tendon {tendon} would have to push with {-lowest:.1f} N for {asked.words()}, which no current does; "
                "raise the pretension, bend less, or hold positions",
            )
        found = by_current
    else:
        there, found = bend(space, contact, 1e-3 * asked.pretension_mm, asked.swing)
    if not found.reached or found.residual >= 1e-7:
        why = (
            "the tendons do not bend the joint that far"
            if asked.wants_tilt
            else "under them the joint folds up, or nothing in it holds the head; pull less"
        )
        return there, None, f"no rest pose was found for {asked.words()}; {why}"
    if found.softest <= 0:
        held = "currents" if asked.mode == "current" else "positions"
        return (
            there,
            found,
            f"the joint does not stay in {asked.words()} where the motors hold {held}: it buckles (stiffness of the "
            f"softest way out {found.softest:.2g} of the unloaded silicone's); lower the pretension",
        )
    if asked.mode == "position-with-current-limit":
        there = hold(there, found, TENDON_MODES[asked.mode], LIMIT_RESERVE_N)
        found = rest_at(there, found.q, found.take_up + there.cable_end)
    return there, found, ""


def _asked_findings(rig: RigSpec, asked: Asked) -> Iterator[Finding]:
    low, high = rig.limits.pretension_mm
    if asked.wants_tilt and not low <= asked.pretension_mm <= high:
        yield Finding(
            "refuse", f"the pretension is {asked.pretension_mm:g} mm, the rig allows {low:g} to {high:g} mm; change it"
        )


def _findings(posed: Posed, found: Rest) -> Iterator[Finding]:
    """Yield what speaks against a pose, limits of the rig first."""
    rig, limits = posed.rig, posed.rig.limits
    bend_deg = math.degrees(float(np.hypot(*found.at.tilt)))
    if bend_deg > limits.most_bend_deg * (1 + 1e-9):
        yield Finding(
            "refuse", f"the head is bent by {bend_deg:.1f}°, the rig allows {limits.most_bend_deg:g}°; bend less"
        )
    worst = int(np.argmax(found.at.tension))
    tension = float(found.at.tension[worst])
    if tension > limits.tension_n:
        yield Finding(
            "refuse",
            f"tendon {worst + 1} pulls {tension:.0f} N, the rig allows {limits.tension_n:g} N; bend less or lower the "
            "pretension",
        )
    if (current := float(rig.tendons.current(tension))) > limits.tendon_current_a:
        yield Finding(
            "refuse",
            f"motor {worst + 1} draws {current:.2f} A, the rig allows {limits.tendon_current_a:g} A; bend less or "
            "lower the pretension",
        )
    low, high = limits.tendon_travel_mm
    for i, take_up in enumerate(1e3 * found.take_up):
        if not low <= take_up <= high:
            yield Finding(
                "refuse",
                f"tendon {i + 1} is taken up by {take_up:.1f} mm, the rig allows {low:g} to {high:g} mm; bend less",
            )
    slack = [str(i + 1) for i in np.flatnonzero(found.at.tension <= 0)]
    if slack:
        since = "" if posed.slack is None else f", the first of them from a bend of {posed.slack.bend_deg:.1f}° on"
        yield Finding(
            "warn",
            f"{'tendon' if len(slack) == 1 else 'tendons'} {', '.join(slack)} slack{since}: a push from that side is "
            "held by the silicone alone; raise the pretension or bend less",
        )
    if posed.strain > STRAIN:
        yield Finding(
            "warn",
            f"the silicone's surface is strained by {posed.strain:.0%}, beyond the {STRAIN:.0%} up to which its law is "
            "taken to hold",
        )
    yield from _chord_findings(posed)


def _chord_findings(posed: Posed) -> Iterator[Finding]:
    """Yield which chords meet the silicone."""
    rig = posed.rig
    if rig.space is not None and rig.space.routing == "channel":
        return
    circle = min(rig.tendons.base_radius.value, rig.tendons.head_radius.value)
    towards = [math.atan2(float(z), float(y)) for y, z in posed.space.rod.joint.guide_directions]
    reach = rig.support(np.array(towards))
    inside = circle < reach
    if np.any(inside):
        far, radii = float(np.max(posed.sagitta[inside])), sorted({f"{1e3 * r:.1f}" for r in reach[inside]})
        whose = "" if np.all(inside) else f" at tendon {_numbered(inside)}"
        yield Finding(
            "warn",
            f"the guides' circle of {1e3 * circle:.1f} mm lies inside the silicone, which reaches to "
            f"{' and '.join(radii)} mm{whose}: the chords are taken to cut through it, up to {1e3 * far:.1f} mm away "
            "from where they run straight; in channels of the silicone they could not: set space.routing",
        )
    touched = ~inside & (posed.clearance < 0)
    if np.any(touched):
        deepest = float(np.min(posed.clearance[touched]))
        yield Finding(
            "warn",
            f"the chord of tendon {_numbered(touched)} would pass {-1e3 * deepest:.1f} mm below the surface: "
            "it lies on the convex side, is longer and pulls otherwise; bend less or widen the guides' circle",
        )


def _numbered(which: Mask) -> str:
    return ", ".join(str(i + 1) for i in np.flatnonzero(which))


# What a bent rod looks like.

_poses = program()(rod_poses)


def shape_of(q: Array, space: Space) -> Shape:
    """Return the shape of the bent silicone, 41 sections from foot to head, and the chords of its tendons."""
    feet, guides = guides_of(space)
    line, turns = sections_at(q, space, _CHORD_POINTS)
    return Shape(line, turns, np.stack([feet, line[-1] + guides @ turns[-1].T], axis=1))


def guides_of(space: Space) -> tuple[Array, Array]:
    """Return the tendons' guides of the base in B and of the head in H (tendon, 3) [m]."""
    feet, guides = (np.asarray(points) for points in plate_guides(space))
    gap = float(space.rod.joint.free_span - space.rod.joint.length)
    return feet, guides + np.array([gap, 0.0, 0.0])


def sections_at(q: Array, space: Space, share: Array) -> tuple[Array, Array]:
    """Return (centres [m] (point, 3), rotations (point, 3, 3)) of sections at shares of the length, in B."""
    turns, line = (np.asarray(part) for part in _poses(q, space.rod))
    whole = np.concatenate([np.zeros((1, 3)), line]), np.concatenate([np.eye(3)[None], turns])
    places, rotations = (BarycentricInterpolator(_stations(), part)(share) for part in whole)
    return places, rotations


def _stations() -> Array:
    """Return where `rod_poses` knows sections, as shares of the length, with the foot."""
    return np.concatenate([[0.0], np.cumsum(grid().steps)])


def chord_clearance(q: Array, space: Space, rig: RigSpec) -> tuple[Array, Array]:
    """Return (least distance of each chord to the silicone's surface, how far each is from its place in the straight
    joint), (tendon,) each [m].

    The surface is that of the rig's section, wider where it is compressed: its tangent across the chord's direction, so
    that of an oval a chord may be further off, never nearer.
    """
    shape, joint = shape_of(q, space), space.rod.joint
    stretch = strains_at(q, space, _CHORD_POINTS)[:, 3]
    lowest, sagitta = [], []
    for i, (foot, head) in enumerate(shape.chords):
        along = head - foot
        # Where the chord meets the plane of each section.
        axes = shape.turns[:, :, 0]
        share = np.einsum("nd,nd->n", shape.line - foot, axes) / (axes @ along)
        offset = foot + share[:, None] * along - shape.line
        inside = np.einsum("nd,ndk->nk", offset, shape.turns)[:, 1:]
        outer = rig.support(np.arctan2(inside[:, 1], inside[:, 0])) / np.sqrt(stretch)
        lowest.append(np.min(np.linalg.norm(inside, axis=1) - outer))
        direction = np.array([float(x) for x in joint.guide_directions[i]])
        arms = (1 - _CHORD_POINTS) * float(joint.base_radius) + _CHORD_POINTS * float(joint.head_radius)
        sagitta.append(np.max(np.linalg.norm(inside - arms[:, None] * direction, axis=1)))
    return np.array(lowest), np.array(sagitta)


def strains_at(q: Array, space: Space, share: Array) -> Array:
    """Return the six strains at shares of the length, curvatures times the length, (point, 6)."""
    terms = np.polynomial.legendre.legvander(2 * share - 1, q.shape[1] - 1)
    return np.asarray(rest_strains(space.rod)) + terms @ q.T


def surface_strain(q: Array, space: Space, rig: RigSpec) -> float:
    """Return the largest principal strain [1] of the silicone's surface.

    Its fibres have the stretch λ ± R |κ - κ_0|, R how far the section reaches in the plane of the bend, and are sheared
    by the twist times the arm of its section (else its radius) and by the section's own shear.
    """
    strains = strains_at(q, space, _CHORD_POINTS)
    bent = strains - np.asarray(rest_strains(space.rod))
    length, section = float(space.rod.joint.length), rig.section
    known = None if section is None or section.shear_arm is None else section.shear_arm.value
    arm = rig.silicone.diameter.value / 2 if known is None else known
    shear = arm / length * np.abs(bent[:, 0]) + np.hypot(bent[:, 4], bent[:, 5])
    # A bend about y stretches what lies along z, one about z compresses what lies along y.
    towards = np.arctan2(bent[:, 1], -bent[:, 2])
    size = np.hypot(bent[:, 1], bent[:, 2]) / length
    fibres = (rig.support(towards) * size, -rig.support(towards + np.pi) * size)
    each = [largest_strain(shear, np.maximum(strains[:, 3] + fibre, 1e-2)) for fibre in fibres]
    return float(np.max(each))


# How far the joint may go.


def slack_bend(space: Space, contact: float, asked: Asked) -> Slack | None:
    """Return where the first tendon goes slack as the joint bends towards an azimuth at a pretension; None where none
    does up to `FURTHEST_DEG`. Motors that hold currents: where the first would have to push."""
    way = _Way.begin(space, contact, asked)
    direction = np.array(swing_of_bend(1.0, asked.pose.azimuth_rad))

    def lowest(bend_rad: float) -> float:
        pull = way.pull(bend_rad * direction)
        return math.nan if pull is None else float(np.min(pull))

    low, at_low = 0.0, lowest(0.0)
    if not at_low > 0:
        return Slack(0.0, way.tendon) if at_low <= 0 else None
    for high in np.arange(_BEND_STEP, math.radians(FURTHEST_DEG) + 1e-9, _BEND_STEP):
        at_high = lowest(float(high))
        if math.isnan(at_high):
            return None
        if at_high <= 0:
            found = brentq(lowest, low, float(high), xtol=1e-5)
            return Slack(math.degrees(found), way.tendon)
        low = float(high)
    return None


@dataclass
class _Way:
    """Poses one beside the other, each found from the last: by the tilt, for one setting of the motors."""

    space: Space
    q: Array
    across: Array
    tendon: int = 0

    @classmethod
    def begin(cls, space: Space, contact: float, asked: Asked) -> "_Way":
        there, upright = rest(space, contact, np.full(space.cable_end.shape, 1e-3 * asked.pretension_mm))
        if asked.mode == "current":
            there = in_mode(there, CURRENT)
            pulled = np.full(there.cable_end.shape, upright.at.tension.mean())
            there = there._replace(held_tension=pulled)
        return cls(there, upright.q, np.zeros(2))

    def pull(self, tilt: Array) -> Array | None:
        """Return what pulls each tendon taut there, negative where it is slack or would have to push [N] (tendon,)."""
        found = steer(self.space, tilt, self.q, self.across, enough=1e-6)
        if found is None:
            return None
        self.q, self.across = found.q, found.across
        there = set_across(self.space, found.across)
        joint = there.rod.joint
        pull = float(joint.stiffness) * (found.at.spans - np.asarray(there.cable_end))
        pull = np.asarray(there.held_tension) if float(joint.mode) == CURRENT else pull
        self.tendon = int(np.argmin(pull)) + 1
        return np.asarray(pull)


def buckling_pretension(space: Space, contact: float, asked: Asked, up_to_mm: float) -> Buckling | None:
    """Return where a tilt stops being stable as the pretension rises, with the motors in their mode.

    The pose is followed by position, stable or not, from the pretension that is asked: upwards where it is stable
    there, else downwards. Currents hold its tensions. None where it cannot be followed.
    """
    ends, held = first_contact(space, contact)[1], in_mode(space, POSITION)
    pattern, mode = patterns(space)[1:], TENDON_MODES[asked.mode]
    begin = 1e-3 * asked.pretension_mm
    first = bend(space, contact, begin, asked.swing)[1]
    start = (first.q, np.asarray(np.linalg.lstsq(pattern.T, first.take_up - begin, rcond=None)[0], dtype=float))

    def pose_at(pretension: float, known: tuple[Array, Array]) -> tuple[float, float, tuple[Array, Array]] | None:
        there = held._replace(cable_end=ends - pretension)
        found = steer(there, asked.swing, *known, enough=1e-7)
        if found is None:
            return None
        at_rest = rest_at(set_across(there, found.across), found.q, ends)
        if mode == CURRENT:
            at_rest = rest_at(hold(there, at_rest, mode, 0.0), found.q, ends)
        return at_rest.softest, float(at_rest.at.tension.sum()), (found.q, found.across)

    here = pose_at(begin, start) if first.reached else None
    if here is None:
        return None
    upwards = here[0] > 0
    way, size = (1 if upwards else -1), _PRETENSION_STEP
    pretension, most = begin, 1e-3 * up_to_mm
    while 0 <= pretension + way * size <= most + 1e-9:
        after = pose_at(pretension + way * size, here[2])
        if after is None:  # let go so far at once, all tendons are slack where Newton's method begins
            size /= 2
            if size < _LEAST_STEP:
                break
            continue
        if (after[0] > 0) != upwards:
            known = (pose_at, pretension, way * size, here[2])
            found_at = pretension + way * size * brentq(_stiffness_along, 0.0, 1.0, known, xtol=1e-3)
            at_limit = pose_at(found_at, here[2])
            return Buckling(1e3 * found_at, None if at_limit is None else at_limit[1], up_to_mm)
        pretension, here = pretension + way * size, after
    return Buckling(None, None, round(1e3 * pretension, 6)) if upwards else None


def _stiffness_along(share: float, pose_at: Callable[..., Any], begin: float, step: float, known: Any) -> float:
    found = pose_at(begin + share * step, known)
    return math.nan if found is None else float(found[0])
