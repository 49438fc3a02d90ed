"""The preview of a plan: its check with the twin's tensions and torsions, and what its recording should say."""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np

from sinew.analysis.analysed import analyse_recording
from sinew.analysis.doubts import foretold
from sinew.measure.arrays import Array, Complexes
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import finite
from sinew.measure.result import Field, Result
from sinew.plan.check import Finding, Preview, check_plan, drive_reach
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.predict import modes, pose
from sinew.predict.bent import INPUTS, driven, driven_findings
from sinew.solve.spatial import Rest, patterns
from sinew.twin.simulate import foresee, rest_tension

# ---- what a plan with a bent or swaying head is expected to show, by the linear joint
#
# Small motion about the rest pose: the guides slip in the torsion that comes of it, the drive reaches what it reaches
# against a head that swings like that, and the lever's motor gives way where tendons drive; but tendons do not stiffen
# in a large swing, nothing happens at twice the frequency, and a tendon that goes slack in the swing is told and not
# followed. Held against the twin it is a guide, no verdict; `sinew.predict.coupled` follows large swings.


@dataclass(frozen=True, repr=False)
class ExpectedRow(Result):
    """What the sweep should give at a pretension and a frequency.

    drive: amplitude of the drive's motion, the lever's against the swinging head [deg] or of the tendons [mm].
    torsion_deg, across_deg, in_plane_deg: amplitudes of the torsion and of the tilt across the bend and in its plane.
    highest_n, lowest_n: tension of a tendon over the swing; what torsion adds to it grows with its square and is not
    in it.
    """

    pretension_mm: Annotated[float, Field("pretension")]
    frequency_hz: Annotated[float, Field("frequency")]
    drive: Annotated[float, Field("drive")]
    torsion_deg: Annotated[float, Field("torsion")]
    across_deg: Annotated[float, Field("tilt across")]
    in_plane_deg: Annotated[float, Field("tilt in the plane")]
    highest_n: Annotated[float, Field("highest tension")]
    lowest_n: Annotated[float, Field("lowest tension")]


_INPUT_OF = {"lever": "lever_rad", "pitch": "pitch_take_up_m", "roll": "roll_take_up_m"}
_NOTHING = 1e-9  # of the motion: what rounding makes of a direction in which the head does not move


def expected_of(plan: Plan, rig: RigSpec, preview: Preview) -> tuple[ExpectedRow, ...]:
    """Return what the sweep of a plan with a bent or swaying head should give, by the linear joint, a row for each
    pretension and frequency; nothing of others, nor of a refused one, nor of one that tracks, nor at a pretension
    without a stable pose."""
    if not plan.is_spatial or preview.refusals or plan.sweep is None or rig.space is None:
        return ()
    bend_deg, azimuth_deg = plan.rest_pose.bend_and_azimuth_deg
    finder = modes.Finder(
        rig, modes.Asked(plan.pretension.pretension_mm, (bend_deg,), azimuth_deg, plan.pretension.mode)
    )
    tendons_mm = plan.sweep.amplitude_mm
    asked = math.radians(plan.sweep.amplitude_deg) if tendons_mm is None else 1e-3 * tendons_mm
    rows = []
    for mm in plan.pretension.pretension_mm:
        try:
            finder.linear(mm, bend_deg)
        except SpecError:  # the check says that there is no pose
            continue
        rows += [_at(finder, rig, mm, bend_deg, hz, plan.sweep.drive, asked) for hz in plan.sweep.frequency_hz]
    return tuple(rows)


def _at(
    finder: modes.Finder, rig: RigSpec, mm: float, bend_deg: float, hz: float, drive: str, asked: float
) -> ExpectedRow:
    """Return the row of one frequency; asked: amplitude of the lever's command [rad] or of the tendons [m]."""
    linear, space = finder.linear(mm, bend_deg)
    at, q = linear.around, finder.rest(mm, bend_deg)[1].q
    stiffness = float(space.rod.joint.stiffness)
    pulled = np.zeros(len(at.tension))
    if drive != "lever":
        pulled = stiffness * patterns(space)[1 if drive == "pitch" else 2]
    # Last the head's turn about the lever's axis, by which it takes torque from the lever.
    rows = np.vstack([at.by_torsion, at.by_tilt, stiffness * at.by_span, linear.lever_row / rig.inertia.lever.value])
    one = np.eye(len(INPUTS))[INPUTS.index(_INPUT_OF[drive])]

    def moves(amplitude: float) -> Complexes:
        return driven(linear, space, q, hz, amplitude * one, rows, held=drive != "lever").moved

    amplitude = asked if drive != "lever" else _reached(moves, rig, asked, hz)
    moved = moves(amplitude)
    swing: Array = np.abs(moved[3:-1] + amplitude * pulled)
    out = math.degrees(abs(modes.out_of_plane(finder.direction, bend_deg) @ moved[1:3]))
    within = math.degrees(abs(finder.direction @ moved[1:3]))
    least = _NOTHING * math.degrees(float(np.max(np.abs(moved[:3]))))
    return ExpectedRow(
        mm,
        hz,
        math.degrees(amplitude) if drive == "lever" else 1e3 * amplitude,
        math.degrees(abs(moved[0])),
        out if out > least else 0.0,
        within if within > least else 0.0,
        float(np.max(at.tension + swing)),
        float(np.min(np.where(at.tension > 0, at.tension - swing, 0.0))),
    )


_MOST_STEPS, _ENOUGH = 60, 1e-4


def _reached(moves: Callable[[float], Complexes], rig: RigSpec, command: float, hz: float) -> float:
    """Return the lever's amplitude [rad] that the drive reaches against the very head that it swings.

    moves: what a lever of some amplitude moves, the head's turn about its axis last.
    """
    lever = drive_reach(rig, command, hz).amplitude_rad
    for _ in range(_MOST_STEPS):
        if lever == 0:
            break
        before, turned = lever, complex(moves(lever)[-1])
        lever = 0.5 * (lever + drive_reach(rig, command, hz, turned / lever).amplitude_rad)
        if abs(lever - before) <= _ENOUGH * lever:
            break
    return lever


def sentences_of(rows: tuple[ExpectedRow, ...], plan: Plan) -> list[str]:
    """Return for each pretension what is expected where the head twists most; of a drive by tendons their tensions."""
    told = []
    by_tendons = plan.sweep is not None and plan.sweep.amplitude_mm is not None
    for mm in dict.fromkeys(row.pretension_mm for row in rows):
        mine = [row for row in rows if row.pretension_mm == mm]
        top = max(mine, key=lambda row: row.torsion_deg)
        least = min(mine, key=lambda row: row.lowest_n)
        slack = f"; a tendon goes slack in the swing at {least.frequency_hz:g} Hz" if least.lowest_n <= 0 else ""
        pulls = f"; tensions {max(least.lowest_n, 0):.0f} to {max(row.highest_n for row in mine):.0f} N{slack}"
        if not by_tendons:
            pulls = f": {top.torsion_deg / top.drive:.2g}° a degree of the lever, which reaches {top.drive:.2g}° there"
        told.append(
            f"expected at {mm:g} mm: at most {top.torsion_deg:.2g}° of torsion, at {top.frequency_hz:g} Hz, and there "
            f"a tilt of {top.across_deg:.2g}° across the bend, {top.in_plane_deg:.2g}° in its plane{pulls}"
        )
    linear = "what is expected is linear: right for small swings, a guide for large ones, which sinew predict follows"
    return [*told, linear] if told else []


# ---- the preview


LONGEST_PREVIEW_S = 20_000.0
"""Length of a plan up to which its torsion is previewed [s]; the paper's is 5600 s."""


def preview_plan(plan: Plan, rig: RigSpec, *, swing: bool = False) -> Preview:
    """Return the check of a plan with the twin's tensions at rest and, if asked, its torsions.

    swing: run one repeat of the plan for its torsions, unless a limit is broken already or the plan is longer than
    `LONGEST_PREVIEW_S`, or tracks, which no plan foretells. What runs on the twin next hurts nobody and does not ask.
    A plan with a pose, or with tendons that move the head, is checked with what holds it at each pretension, its
    largest tension in place of the common one; what its sweep should give, `expected_of` says by the linear joint,
    which refuses nothing.
    """
    if not plan.rest_pose.is_straight or (plan.is_spatial and plan.impulse is None and rig.space is not None):
        return held_preview(plan, rig, slack="warn")[0]
    if swing and not plan.is_spatial:
        return foresee_plan(plan, rig)[0]
    return check_plan(plan, rig, rest_tension(plan.pretension.pretension_mm, rig).tolist())


def held_preview(
    plan: Plan, rig: RigSpec, slack: Literal["refuse", "warn"] = "refuse"
) -> tuple[Preview, dict[float, Rest]]:
    """Return (check of a plan whose head bends or sways, what holds it at each pretension [mm] where it is found).

    Refused is a pose that is not reached or does not stay, and one with tensions, currents or take-ups beyond the rig's
    limits; so is, on a bench, one with a slack tendon: its motor could not tell where the cable is pulled again; and
    tendons that are to be driven as no motor of them follows, or until one is slack.
    """
    rests: dict[float, Rest] = {}
    found: list[Finding] = []
    for mm in plan.pretension.pretension_mm:
        posed = pose.find_pose(rig, pose.Asked(mm, plan.rest_pose, plan.pretension.mode), outlook=False)
        said = f"{plan.rest_pose.words()} at {mm:g} mm: "
        found += [Finding("refuse", said + one.sentence) for one in posed.findings if one.severity == "refuse"]
        if posed.rest is None:
            continue
        rests[mm] = posed.rest
        if loose := [str(i + 1) for i in np.flatnonzero(posed.rest.at.tension <= 0)]:
            tendons = f"tendon{'s' if len(loose) > 1 else ''} {', '.join(loose)}"
            advice = "would be slack, which a bench refuses; raise the pretension or bend less"
            found.append(Finding(slack, f"{said}{tendons} {advice}"))
        elif driven := [g for g in plan.groups() if g.pretension_mm == mm and g.excitation in ("pitch", "roll")]:
            found += [
                Finding(slack, one.sentence)
                for one in driven_findings(rig, posed.space, posed.rest, mm, driven, plan.rest_pose.words())
            ]
    preview = check_plan(plan, rig)
    tension = tuple(
        float(np.max(rests[mm].at.tension)) if mm in rests else math.nan for mm in plan.pretension.pretension_mm
    )
    return replace(preview, tension_n=tension, findings=(*preview.findings, *found)), rests


def foresee_plan(plan: Plan, rig: RigSpec) -> tuple[Preview, str]:
    """Return the check of a plan with the twin's tensions and torsions, and what its recording is expected to say.

    The latter is the text of a recording's attribute `expected` (`sinew.analysis.doubts`), empty where the plan is
    refused, is longer than `LONGEST_PREVIEW_S`, tracks, or cannot be analysed.
    """
    preview = preview_plan(plan, rig)
    if preview.refusals or preview.duration_s > LONGEST_PREVIEW_S or plan.track is not None or plan.is_spatial:
        return preview, ""
    torsion, recording = foresee(plan, rig)
    torsion_deg, expected = np.degrees(torsion).tolist(), ""
    with suppress(RecordingError):  # nothing but rest, or groups too short to say anything
        expected = foretold(analyse_recording(recording, rig))
    return check_plan(plan, rig, preview.tension_n, torsion_deg), expected


def told_preview(plan: Plan, rig: RigSpec, preview: Preview, expected: tuple[ExpectedRow, ...] = ()) -> dict[str, Any]:
    """Return the preview of a plan on a rig as JSON holds it. expected: of `expected_of`."""
    drive = zip(preview.frequency_hz, preview.drive_amplitude_deg, preview.drive_current_a, strict=True)
    tension = zip(plan.pretension.pretension_mm, preview.tension_n, strict=False)  # empty where not previewed
    torsion = zip(plan.pretension.pretension_mm, preview.torsion_deg, strict=False)
    pose = {} if plan.rest_pose.is_straight else {"pose": plan.rest_pose.to_json()}
    return {
        "plan": plan.name,
        "rig": rig.name,
        **pose,
        "ok": not preview.refusals,
        "duration_s": preview.duration_s,
        "bench_s": preview.bench_s,
        "groups": preview.groups,
        "samples": preview.samples,
        "full_amplitude_hz": preview.full_amplitude_hz,
        "drive": [{"frequency_hz": f, "amplitude_deg": a, "current_a": c} for f, a, c in drive],
        "tension": [{"pretension_mm": p, "tension_n": finite(t)} for p, t in tension],
        "torsion": [{"pretension_mm": p, "torsion_deg": t} for p, t in torsion],
        **({"expected": [row.to_dict() for row in expected]} if expected else {}),
        "findings": [{"severity": f.severity, "sentence": f.sentence} for f in preview.findings],
    }
