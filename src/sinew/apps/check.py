"""This is where `sinew check` previews a plan: duration, drive reach, tensions, and the limits it would break."""

from typing import TYPE_CHECKING, Any

from sinew.apps.console import Json, PlanArgument, Rig, print_json, print_table
from sinew.measure.estimate import fixed

if TYPE_CHECKING:
    from sinew.plan.check import Preview
    from sinew.plan.plan import Plan
    from sinew.plan.rig import RigSpec

LONGEST_PREVIEW_S = 20_000.0
"""Length of a plan up to which its torsion is previewed [s]; the paper's is 5600 s."""


def check(plan: PlanArgument, rig: Rig = "paper", json: Json = False) -> int:
    """Preview a plan on a rig before anything moves.

    Prints duration, the drive amplitude that can be reached at each frequency, tendon tensions, torsion, and every
    limit of the rig that the plan would break. Ends with status 2 if there is one.
    """
    from sinew.plan.check import refuse_beyond_limits  # pydantic and scipy: not for --help
    from sinew.plan.toml import load_plan, load_rig

    plan_, rig_ = load_plan(plan), load_rig(rig)
    preview = preview_plan(plan_, rig_, swing=True)
    if json:
        print_json(told_preview(plan_, rig_, preview))
    else:
        _print_preview(plan_, rig_, preview)
    refuse_beyond_limits(preview)
    return 0


def preview_plan(plan: "Plan", rig: "RigSpec", *, swing: bool = False) -> "Preview":
    """Return the check of a plan with the twin's tensions at rest and, if asked, its torsions.

    swing: run one repeat of the plan for its torsions, unless a limit is broken already or the plan is longer than
    `LONGEST_PREVIEW_S`, or tracks, which no plan foretells. What runs on the twin next hurts nobody and does not ask.
    """
    import numpy as np

    from sinew.plan.check import check_plan
    from sinew.twin.simulate import peak_torsion, rest_tension

    tension = rest_tension(plan.pretension.pretension_mm, rig).tolist()
    preview = check_plan(plan, rig, tension)
    if not swing or preview.refusals or preview.duration_s > LONGEST_PREVIEW_S or plan.track is not None:
        return preview
    return check_plan(plan, rig, tension, np.degrees(peak_torsion(plan, rig)).tolist())


def foresee_plan(plan: "Plan", rig: "RigSpec") -> tuple["Preview", str]:
    """Return the check of a plan with the twin's tensions and torsions, and what its recording is expected to say.

    The latter is the text of a recording's attribute `expected` (`sinew.analysis.doubts`), empty where the plan is
    refused, is longer than `LONGEST_PREVIEW_S`, tracks, or cannot be analysed.
    """
    import numpy as np

    from sinew.analysis.analysis import analyse_recording
    from sinew.analysis.doubts import foretold
    from sinew.measure.errors import RecordingError
    from sinew.plan.check import check_plan
    from sinew.twin.simulate import foresee

    preview = preview_plan(plan, rig)
    if preview.refusals or preview.duration_s > LONGEST_PREVIEW_S or plan.track is not None:
        return preview, ""
    torsion, recording = foresee(plan, rig)
    preview = check_plan(plan, rig, preview.tension_n, np.degrees(torsion).tolist())
    try:
        return preview, foretold(analyse_recording(recording, rig))
    except RecordingError:  # nothing but rest, or groups too short to say anything
        return preview, ""


def told_preview(plan: "Plan", rig: "RigSpec", preview: "Preview") -> dict[str, Any]:
    """Return the preview of a plan on a rig as JSON holds it."""
    drive = zip(preview.frequency_hz, preview.drive_amplitude_deg, preview.drive_current_a, strict=True)
    tension = zip(plan.pretension.pretension_mm, preview.tension_n, strict=True)
    torsion = zip(plan.pretension.pretension_mm, preview.torsion_deg, strict=False)  # empty where not previewed
    return {
        "plan": plan.name,
        "rig": rig.name,
        "ok": not preview.refusals,
        "duration_s": preview.duration_s,
        "longest_s": preview.longest_s,
        "bench_s": preview.bench_s,
        "groups": preview.groups,
        "samples": preview.samples,
        "full_amplitude_hz": preview.full_amplitude_hz,
        "drive": [{"frequency_hz": f, "amplitude_deg": a, "current_a": c} for f, a, c in drive],
        "tension": [{"pretension_mm": p, "tension_n": t} for p, t in tension],
        "torsion": [{"pretension_mm": p, "torsion_deg": t} for p, t in torsion],
        "findings": [{"severity": f.severity, "sentence": f.sentence} for f in preview.findings],
    }


def _print_preview(plan: "Plan", rig: "RigSpec", preview: "Preview") -> None:
    print(f"plan {plan.name} on rig {rig.name}: {preview.groups} motions, {preview.samples} samples,", end=" ")
    longest = f" (at most {_time(preview.longest_s)})" if preview.longest_s > preview.duration_s else ""
    print(f"{_time(preview.duration_s)}{longest} of motion and rest,", end=" ")
    print(f"about {_time(preview.bench_s)} on a bench with pull, pretensions and stop")
    if preview.frequency_hz and plan.sweep is not None:
        rows = [
            (f"{row['frequency_hz']:g}", fixed(row["amplitude_deg"], 1), fixed(row["current_a"], 2))
            for row in told_preview(plan, rig, preview)["drive"]
        ]
        title = f"drive, nominal {plan.sweep.amplitude_deg:g}°, against a held head (less where the joint resonates)"
        print_table(("frequency/Hz", "amplitude/°", "current/A"), rows, title)
    twists = [fixed(twist, 0) for twist in preview.torsion_deg] or [""] * len(preview.tension_n)
    held = [
        (f"{p:g}", fixed(t, 1), twist)
        for p, t, twist in zip(plan.pretension.pretension_mm, preview.tension_n, twists, strict=True)
    ]
    print_table(("pretension/mm", "tension of each tendon at rest/N", "largest torsion/°"), held, "tendons and torsion")
    for finding in preview.findings:
        print(f"{'REFUSED' if finding.severity == 'refuse' else 'warning'}: {finding.sentence}")
    if not preview.refusals:
        print("no limit of the rig is broken")


def _time(seconds: float) -> str:
    return "{} min {} s".format(*divmod(round(seconds), 60))
