"""Pose: where a joint that bends comes to rest, what holds it there, and what speaks against it."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
from scipy.interpolate import BarycentricInterpolator
from scipy.optimize import brentq

from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.measure.estimate import ROUND_OFF, fixed, number
from sinew.measure.result import Field, Result, Rows
from sinew.mechanics.parameters import CURRENT, POSITION, TENDON_MODES
from sinew.mechanics.rod import grid, rest_strains, rod_poses
from sinew.mechanics.space import Space, plate_guides
from sinew.plan.check import Finding
from sinew.plan.plan import STRAIGHT, Pose, bend_of_swing, swing_of_bend
from sinew.plan.rig import LIMIT_RESERVE_N, RigSpec
from sinew.predict.validity import STRAIN, largest_strain
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


class PoseRequest(NamedTuple):
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


@dataclass(frozen=True, repr=False)
class Slack(Result):
    """Where the first tendon goes slack on a way of growing bend, and which tendon, from 1."""

    bend_deg: Annotated[float, Field("bend")]
    tendon: Annotated[int, Field("tendon")]


@dataclass(frozen=True, repr=False)
class Buckling(Result):
    """Where the pose stops being stable as the pretension rises, and the load of all tendons there.

    None of both where it is stable as far as was looked, `up_to_mm`.
    """

    pretension_mm: Annotated[float | None, Field("pretension")]
    load_n: Annotated[float | None, Field("load")]
    up_to_mm: Annotated[float, Field("followed up to")]


class Shape(NamedTuple):
    """The bent silicone and its tendons, in frame B [m]. line: of its sections' centres (point, 3). turns: their
    rotations (point, 3, 3). chords: of the tendons' ends (tendon, 2, 3)."""

    line: Array
    turns: Array
    chords: Array


@dataclass(frozen=True, repr=False)
class RequestedPose(Result):
    """What was asked, None of what was not; see `PoseRequest`."""

    pretension_mm: Annotated[float | None, Field("pretension")]
    bend_deg: Annotated[float | None, Field("bend")]
    azimuth_deg: Annotated[float | None, Field("azimuth")]
    take_up_mm: Annotated[tuple[float, ...] | None, Field("", "detail")]
    tension_n: Annotated[tuple[float, ...] | None, Field("", "detail")]


@dataclass(frozen=True, repr=False)
class HeadPose(Result):
    """Where the head is. head_mm: the plate's place (x, y, z) in frame B. stretch: of the silicone, mean."""

    bend_deg: Annotated[float, Field("bend")]
    azimuth_deg: Annotated[float, Field("azimuth")]
    pitch_deg: Annotated[float, Field("pitch")]
    roll_deg: Annotated[float, Field("roll")]
    torsion_deg: Annotated[float, Field("torsion")]
    head_mm: Annotated[tuple[float, ...], Field("", "detail")]
    stretch: Annotated[float, Field("stretch", unit="")]


@dataclass(frozen=True, repr=False)
class TendonRow(Result):
    """One tendon, from 1. clearance_mm: least distance of its chord to the silicone's surface, negative inside;
    sagitta_mm: how far the chord leaves its place in the straight joint."""

    tendon: Annotated[int, Field("tendon")]
    take_up_mm: Annotated[float, Field("take-up")]
    tension_n: Annotated[float, Field("tension")]
    current_a: Annotated[float, Field("current")]
    slack: Annotated[bool, Field("slack")]
    span_mm: Annotated[float, Field("span")]
    clearance_mm: Annotated[float, Field("from surface")]
    sagitta_mm: Annotated[float, Field("sagitta")]


@dataclass(frozen=True, repr=False)
class Margins(Result):
    """What is left. softest: stiffness of the softest way out over that of the unloaded silicone. tension_n: to the
    rig's limit; slack_n: the lowest tension. strain: largest principal strain of the silicone's surface."""

    softest: Annotated[float, Field("softest way out over the unloaded silicone", unit="")]
    tension_n: Annotated[float, Field("left to the tension limit")]
    slack_n: Annotated[float, Field("lowest tension")]
    strain: Annotated[float, Field("strain of the surface", unit="%")]


@dataclass(frozen=True, repr=False)
class FindingRow(Result):
    """What speaks against a pose: refuse or warn, in a sentence."""

    severity: Annotated[str, Field("")]
    sentence: Annotated[str, Field("")]


@dataclass(frozen=True, repr=False)
class Posed(Result):
    """Where a joint rests. spec: the rig. space: with the motors that hold it; rest, shape, pose, margins: None where
    there is none, and the findings say why. found: whether there is one; ok: whether no limit is broken either.

    slack: on the way to this azimuth at this pretension; buckling: of this pose with growing pretension; both None
    where take-ups or tensions were given. coordinates (6, term): also of a pose that does not stay.
    """

    spec: RigSpec
    request: PoseRequest
    space: Space
    rest: Rest | None
    shape: Shape | None
    coordinates: Array | None
    rig: Annotated[str, Field("", "detail")]
    mode: Annotated[str, Field("", "detail")]
    requested: Annotated[RequestedPose, Field("", "detail")]
    ok: Annotated[bool, Field("", "detail")]
    found: Annotated[bool, Field("", "detail")]
    pose: Annotated[HeadPose | None, Field("")]
    tendons: Annotated[Rows[TendonRow], Field("")]
    margins: Annotated[Margins | None, Field("")]
    slack: Annotated[Slack | None, Field("", "detail")]
    buckling: Annotated[Buckling | None, Field("", "detail")]
    findings: Annotated[Rows[FindingRow], Field("", "detail")]

    def heading(self) -> str:
        """Return what was asked."""
        return f"{self.rig}, {self.mode}: {self.request.words()}"

    def closing(self) -> list[str]:
        """Return how far the joint may go, and what speaks against the pose."""
        lines = [self.heading()]
        if self.pose is not None:
            lines.append(f"head at {', '.join(fixed(x, 1) for x in self.pose.head_mm)} mm (x, y, z)")
        if self.found and self.slack is not None:
            lines.append(
                f"on the way to this azimuth tendon {self.slack.tendon} goes slack from a bend of "
                f"{fixed(self.slack.bend_deg, 1)}° on"
            )
        if self.found and self.buckling is not None and self.buckling.pretension_mm is not None:
            lines.append(
                f"the pose would buckle at {fixed(self.buckling.pretension_mm, 1)} mm of pretension, where the tendons "
                f"press with {number(self.buckling.load_n)} N"
            )
        elif self.found and self.buckling is not None:
            lines.append(
                f"it does not buckle up to {self.buckling.up_to_mm:g} mm of pretension, as far as it was followed"
            )
        return lines + [f"- {'' if one.severity == 'warn' else 'refused: '}{one.sentence}" for one in self.findings]


def find_pose(rig: RigSpec, requested: PoseRequest, *, outlook: bool = True) -> Posed:
    """Return where a rig's joint rests, and what speaks against it.

    outlook: look for the bend from which on a tendon is slack, and for the pretension that makes the pose buckle.
    Motors that hold positions with a current limit rest as those without; what makes a tendon pull more than
    `LIMIT_RESERVE_N` above its tension at rest makes them yield. A pose that cannot be found, or does not stay, is no
    error: it is refused in `findings`. Raises SpecError where the rig knows no space, or the numbers cannot be meant.

    >>> import sinew as sn
    >>> from sinew.plan.plan import Pose
    >>> from sinew.predict.pose import PoseRequest, find_pose
    >>> requested = PoseRequest(6.0, Pose(bend_deg=20, azimuth_deg=0))
    >>> bool(find_pose(sn.load_rig("paper"), requested, outlook=False).rest.taut)
    True
    """
    _check(rig, requested)
    configure()
    space, contact = space_from_rig(rig), rig.tendons.first_contact_tension.value
    there, found, why = _rest_of(space, contact, requested)
    slack = buckling = None
    if outlook and requested.wants_tilt:
        slack = slack_bend(space, contact, requested)
        buckling = buckling_pretension(space, contact, requested, rig.limits.tendon_travel_mm[1])
    bend_deg, azimuth_deg = requested.pose.bend_and_azimuth_deg
    shape = pose = margins = None
    tendons: list[TendonRow] = []
    if found is None or why:
        findings = [Finding("refuse", why), *_request_findings(rig, requested)]
    else:
        shape = shape_of(found.q, there)
        pose, tendons = _head_pose(found, shape), _tendon_rows(found, there, rig)
        strain = surface_strain(found.q, there, rig)
        pulls = found.at.tension
        margins = Margins(found.softest, rig.limits.tension_n - float(np.max(pulls)), float(np.min(pulls)), strain)
        findings = [*_request_findings(rig, requested), *_findings(rig, found, tendons, strain, slack)]
        findings += _chord_findings(rig, there, tendons)
    return Posed(
        rig,
        requested,
        there,
        None if why else found,
        shape,
        None if found is None else found.q,
        rig.name,
        requested.mode,
        RequestedPose(
            requested.pretension_mm if requested.wants_tilt else None,
            bend_deg if requested.wants_tilt else None,
            azimuth_deg if requested.wants_tilt else None,
            requested.take_up_mm,
            requested.tension_n,
        ),
        not any(one.severity == "refuse" for one in findings),
        pose is not None,
        pose,
        Rows(tendons),
        margins,
        slack,
        buckling,
        Rows(FindingRow(one.severity, one.sentence) for one in findings),
    )


def _head_pose(found: Rest, shape: Shape) -> HeadPose:
    angles = np.array([*found.at.tilt, found.at.torsion], dtype=float)
    pitch, roll, torsion = np.where(np.abs(angles) > ROUND_OFF, angles, 0.0).tolist()
    bend_rad, azimuth_rad = bend_of_swing(pitch, roll)
    return HeadPose(
        math.degrees(bend_rad),
        math.degrees(azimuth_rad),
        math.degrees(pitch),
        math.degrees(roll),
        math.degrees(torsion),
        tuple(1e3 * float(x) for x in shape.line[-1]),
        1 + float(found.q[3, 0]),
    )


def _tendon_rows(found: Rest, space: Space, rig: RigSpec) -> list[TendonRow]:
    clearance, sagitta = chord_clearance(found.q, space, rig)
    columns = (1e3 * found.take_up, found.at.tension, 1e3 * found.at.spans, 1e3 * clearance, 1e3 * sagitta)
    return [
        TendonRow(i + 1, take_up, pull, float(rig.tendons.current(pull)), pull <= 0, *lengths)
        for i, (take_up, pull, *lengths) in enumerate(np.stack(columns, axis=1).tolist())
    ]


def _check(rig: RigSpec, requested: PoseRequest) -> None:
    if requested.mode not in TENDON_MODES:
        raise SpecError(f"found the mode {requested.mode!r}, expected one of {', '.join(TENDON_MODES)}")
    if not 0 <= requested.pretension_mm <= 100:
        raise SpecError(f"found a pretension of {requested.pretension_mm:g} mm, expected 0 to 100: cables cannot push")
    for name, values in (("take-ups", requested.take_up_mm), ("tensions", requested.tension_n)):
        if values is not None and len(values) != rig.tendons.count:
            raise SpecError(f"found {len(values)} {name}, expected one for each of {rig.tendons.count} tendons")
    by_current = requested.mode == "current"
    if requested.take_up_mm is not None and (by_current or requested.tension_n is not None):
        raise SpecError("found take-ups of motors that hold currents, which follow; give the tensions that they hold")
    if requested.tension_n is not None and not by_current:
        raise SpecError("found tensions of motors that hold positions; give take-ups, or the mode current")
    if requested.tension_n is not None and max(requested.tension_n) > _MOST_N:
        raise SpecError(
            f"found a tension of {max(requested.tension_n):g} N, expected 0 to {_MOST_N:g} N; look at its unit"
        )
    if requested.take_up_mm is not None and max(map(abs, requested.take_up_mm)) > _MOST_MM:
        far = max(requested.take_up_mm, key=abs)
        raise SpecError(f"found a take-up of {far:g} mm, expected -{_MOST_MM:g} to {_MOST_MM:g} mm; look at its unit")
    if requested.tension_n is not None and min(requested.tension_n) < 0:
        raise SpecError(f"found a tension of {min(requested.tension_n):g} N, expected zero or more: cables cannot push")


def _rest_of(space: Space, contact: float, requested: PoseRequest) -> tuple[Space, Rest | None, str]:
    """Return (parameters, rest or None, why it is refused); one that is found and does not stay comes with a why."""
    if requested.tension_n is not None:
        there, found = rest_by_tension(space, contact, np.array(requested.tension_n))
    elif requested.take_up_mm is not None:
        there, found = rest(space, contact, 1e-3 * np.array(requested.take_up_mm))
    elif requested.mode == "current":
        there, by_current = bend_by_tension(space, contact, 1e-3 * requested.pretension_mm, requested.swing)
        if by_current is None:
            return there, None, f"no tensions were found that hold {requested.words()}"
        if (lowest := float(np.min(by_current.at.tension))) < 0:
            tendon = int(np.argmin(by_current.at.tension)) + 1
            return (
                there,
                None,
                f"tendon {tendon} would have to push with {-lowest:.1f} N for {requested.words()}, which no current "
                "does; raise the pretension, bend less, or hold positions",
            )
        found = by_current
    else:
        there, found = bend(space, contact, 1e-3 * requested.pretension_mm, requested.swing)
    if not found.reached or found.residual >= 1e-7:
        why = (
            "the tendons do not bend the joint that far"
            if requested.wants_tilt
            else "under them the joint folds up, or nothing in it holds the head; pull less"
        )
        return there, None, f"no rest pose was found for {requested.words()}; {why}"
    if found.softest <= 0:
        held = "currents" if requested.mode == "current" else "positions"
        return (
            there,
            found,
            f"the joint does not stay in {requested.words()} where the motors hold {held}: it buckles (stiffness of "
            f"the softest way out {found.softest:.2g} of the unloaded silicone's); lower the pretension",
        )
    if requested.mode == "position-with-current-limit":
        there = hold(there, found, TENDON_MODES[requested.mode], LIMIT_RESERVE_N)
        found = rest_at(there, found.q, found.take_up + there.cable_end)
    return there, found, ""


def _request_findings(rig: RigSpec, requested: PoseRequest) -> Iterator[Finding]:
    low, high = rig.limits.pretension_mm
    if requested.wants_tilt and not low <= requested.pretension_mm <= high:
        yield Finding(
            "refuse",
            f"the pretension is {requested.pretension_mm:g} mm, the rig allows {low:g} to {high:g} mm; change it",
        )


def _findings(
    rig: RigSpec, found: Rest, tendons: Sequence[TendonRow], strain: float, slack: Slack | None
) -> Iterator[Finding]:
    """Yield what speaks against a pose, limits of the rig first."""
    limits = rig.limits
    bend_deg = math.degrees(float(np.hypot(*found.at.tilt)))
    if bend_deg > limits.most_bend_deg * (1 + 1e-9):
        yield Finding(
            "refuse", f"the head is bent by {bend_deg:.1f}°, the rig allows {limits.most_bend_deg:g}°; bend less"
        )
    worst = max(tendons, key=lambda one: one.tension_n)
    if worst.tension_n > limits.tension_n:
        yield Finding(
            "refuse",
            f"tendon {worst.tendon} pulls {worst.tension_n:.0f} N, the rig allows {limits.tension_n:g} N; bend less or "
            "lower the pretension",
        )
    if worst.current_a > limits.tendon_current_a:
        yield Finding(
            "refuse",
            f"motor {worst.tendon} draws {worst.current_a:.2f} A, the rig allows {limits.tendon_current_a:g} A; bend "
            "less or lower the pretension",
        )
    low, high = limits.tendon_travel_mm
    for one in tendons:
        if not low <= one.take_up_mm <= high:
            yield Finding(
                "refuse",
                f"tendon {one.tendon} is taken up by {one.take_up_mm:.1f} mm, the rig allows {low:g} to {high:g} mm; "
                "bend less",
            )
    if loose := [str(one.tendon) for one in tendons if one.slack]:
        since = "" if slack is None else f", the first of them from a bend of {slack.bend_deg:.1f}° on"
        yield Finding(
            "warn",
            f"{'tendon' if len(loose) == 1 else 'tendons'} {', '.join(loose)} slack{since}: a push from that side is "
            "held by the silicone alone; raise the pretension or bend less",
        )
    if strain > STRAIN:
        yield Finding(
            "warn",
            f"the silicone's surface is strained by {strain:.0%}, beyond the {STRAIN:.0%} up to which its law is "
            "taken to hold",
        )


def _chord_findings(rig: RigSpec, space: Space, tendons: Sequence[TendonRow]) -> Iterator[Finding]:
    """Yield which chords meet the silicone."""
    if rig.space is not None and rig.space.routing == "channel":
        return
    circle = min(rig.tendons.base_radius.value, rig.tendons.head_radius.value)
    towards = [math.atan2(float(z), float(y)) for y, z in space.rod.joint.guide_directions]
    reach = rig.support(np.array(towards)).tolist()
    inside = [(one, far) for one, far in zip(tendons, reach, strict=True) if circle < far]
    if inside:
        far, radii = max(one.sagitta_mm for one, _ in inside), sorted({f"{1e3 * far:.1f}" for _, far in inside})
        whose = "" if len(inside) == len(tendons) else f" at tendon {_numbered(one for one, _ in inside)}"
        yield Finding(
            "warn",
            f"the guides' circle of {1e3 * circle:.1f} mm lies inside the silicone, which reaches to "
            f"{' and '.join(radii)} mm{whose}: the chords are taken to cut through it, up to {far:.1f} mm away "
            "from where they run straight; in channels of the silicone they could not: set space.routing",
        )
    touched = [one for one, far in zip(tendons, reach, strict=True) if circle >= far and one.clearance_mm < 0]
    if touched:
        yield Finding(
            "warn",
            f"the chord of tendon {_numbered(touched)} would pass {-min(one.clearance_mm for one in touched):.1f} mm "
            "below the surface: it lies on the convex side, is longer and pulls otherwise; bend less or widen the "
            "guides' circle",
        )


def _numbered(tendons: Iterable[TendonRow]) -> str:
    return ", ".join(str(one.tendon) for one in tendons)


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


def slack_bend(space: Space, contact: float, requested: PoseRequest) -> Slack | None:
    """Return where the first tendon goes slack as the joint bends towards an azimuth at a pretension; None where none
    does up to `FURTHEST_DEG`. Motors that hold currents: where the first would have to push."""
    path = PosePath.begin(space, contact, 1e-3 * requested.pretension_mm, requested.mode)
    direction = np.array(swing_of_bend(1.0, requested.pose.azimuth_rad))

    def lowest(bend_rad: float) -> float:
        pull = path.pull(bend_rad * direction)
        return math.nan if pull is None else float(np.min(pull))

    low, at_low = 0.0, lowest(0.0)
    if not at_low > 0:
        return Slack(0.0, path.tendon) if at_low <= 0 else None
    for high in np.arange(_BEND_STEP, math.radians(FURTHEST_DEG) + 1e-9, _BEND_STEP):
        at_high = lowest(float(high))
        if math.isnan(at_high):
            return None
        if at_high <= 0:
            found = brentq(lowest, low, float(high), xtol=1e-5)
            return Slack(math.degrees(found), path.tendon)
        low = float(high)
    return None


def upright(space: Space, contact: float, pretension: float, mode: str) -> tuple[Space, Rest]:
    """Return (parameters with the motors in a mode, the straight pose that they hold) at a pretension [m]; currents
    hold the mean of the tensions there."""
    there, found = rest(space, contact, np.full(np.shape(space.cable_end), pretension))
    if mode == "current":
        pulled = np.full(np.shape(there.cable_end), found.at.tension.mean())
        there = in_mode(there, CURRENT)._replace(held_tension=pulled)
    return there, found


def pulls_of(spans: Array, there: Space) -> Array:
    """Return what pulls each tendon taut where they span lengths [m], negative where it is slack, by as much as its
    stiffness makes of the missing length, or would have to push [N] (tendon,)."""
    if float(there.rod.joint.mode) == CURRENT:
        return np.asarray(there.held_tension)
    return np.asarray(float(there.rod.joint.stiffness) * (spans - np.asarray(there.cable_end)))


@dataclass
class PosePath:
    """Poses one beside the other, each found from the last: by the tilt, for one setting of the motors. tendon: from 1,
    which pulls least at the last of them."""

    space: Space
    q: Array
    across: Array
    tendon: int = 0

    @classmethod
    def begin(cls, space: Space, contact: float, pretension: float, mode: str) -> "PosePath":
        """Return the way that begins straight, at a pretension [m]."""
        there, found = upright(space, contact, pretension, mode)
        return cls(there, found.q, np.zeros(2))

    def pull(self, tilt: Array) -> Array | None:
        """Return what pulls each tendon there, see `pulls_of`; None where no pose is found."""
        found = steer(self.space, tilt, self.q, self.across, enough=1e-6)
        if found is None:
            return None
        self.q, self.across = found.q, found.across
        pull = pulls_of(found.at.spans, set_across(self.space, found.across))
        self.tendon = int(np.argmin(pull)) + 1
        return pull


def buckling_pretension(space: Space, contact: float, requested: PoseRequest, up_to_mm: float) -> Buckling | None:
    """Return where a tilt stops being stable as the pretension rises, with the motors in their mode.

    The pose is followed by position, stable or not, from the pretension that is requested: upwards where it is stable
    there, else downwards. Currents hold its tensions. None where it cannot be followed.
    """
    ends, held = first_contact(space, contact)[1], in_mode(space, POSITION)
    pattern, mode = patterns(space)[1:], TENDON_MODES[requested.mode]
    begin = 1e-3 * requested.pretension_mm
    first = bend(space, contact, begin, requested.swing)[1]
    start = (first.q, np.asarray(np.linalg.lstsq(pattern.T, first.take_up - begin, rcond=None)[0], dtype=float))

    def pose_at(pretension: float, known: tuple[Array, Array]) -> tuple[float, float, tuple[Array, Array]] | None:
        there = held._replace(cable_end=ends - pretension)
        found = steer(there, requested.swing, *known, enough=1e-7)
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
    sense, size = (1 if upwards else -1), _PRETENSION_STEP
    pretension, most = begin, 1e-3 * up_to_mm
    while 0 <= pretension + sense * size <= most + 1e-9:
        after = pose_at(pretension + sense * size, here[2])
        if after is None:  # let go so far at once, all tendons are slack where Newton's method begins
            size /= 2
            if size < _LEAST_STEP:
                break
            continue
        if (after[0] > 0) != upwards:
            known = (pose_at, pretension, sense * size, here[2])
            found_at = pretension + sense * size * brentq(_stiffness_along, 0.0, 1.0, known, xtol=1e-3)
            at_limit = pose_at(found_at, here[2])
            return Buckling(1e3 * found_at, None if at_limit is None else at_limit[1], up_to_mm)
        pretension, here = pretension + sense * size, after
    return Buckling(None, None, round(1e3 * pretension, 6)) if upwards else None


def _stiffness_along(share: float, pose_at: Callable[..., Any], begin: float, step: float, known: Any) -> float:
    found = pose_at(begin + share * step, known)
    return math.nan if found is None else float(found[0])
