"""The preview of a plan: its check with the twin's tensions and torsions, and what its recording should say."""

import math
from contextlib import suppress
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from sinew.analysis.analysed import analyse_recording
from sinew.analysis.doubts import expected_text
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import finite
from sinew.plan.check import Finding, Preview, check_plan
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.predict import pose
from sinew.predict.bent import driven_findings
from sinew.solve.spatial import Rest
from sinew.twin.simulate import foresee, rest_tension

LONGEST_PREVIEW_S = 20_000.0
"""Length of a plan up to which its torsion is previewed [s]; the paper's is 5600 s."""


def preview_plan(plan: Plan, rig: RigSpec, *, swing: bool = False) -> Preview:
    """Return the check of a plan with the twin's tensions at rest and, if asked, its torsions.

    swing: run one repeat of the plan for its torsions, unless a limit is broken already or the plan is longer than
    `LONGEST_PREVIEW_S`, or tracks, which no plan foretells. What runs on the twin next hurts nobody and does not ask.
    A plan with a pose, or with tendons that move the head, is checked with what holds it at each pretension, its
    largest tension in place of the common one.
    """
    if not plan.rest_pose.is_straight or (plan.is_spatial and plan.impulse is None and rig.space is not None):
        return held_preview(plan, rig, slack="warn")[0]
    if swing and not plan.is_spatial:
        return expected_of_plan(plan, rig)[0]
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
        posed = pose.find_pose(rig, pose.PoseRequest(mm, plan.rest_pose, plan.pretension.mode), outlook=False)
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


def expected_of_plan(plan: Plan, rig: RigSpec) -> tuple[Preview, str]:
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
        expected = expected_text(analyse_recording(recording, rig))
    return check_plan(plan, rig, preview.tension_n, torsion_deg), expected


def preview_document(plan: Plan, rig: RigSpec, preview: Preview) -> dict[str, Any]:
    """Return the preview of a plan on a rig as JSON holds it."""
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
        "findings": [{"severity": f.severity, "sentence": f.sentence} for f in preview.findings],
    }
