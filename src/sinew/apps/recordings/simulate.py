"""`sinew simulate` and `sinew check`: a plan run on the physics twin, and previewed there before it meets a bench."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps import console
from sinew.apps.console import Json, PlanArgument, Rig, Seed, Without, option
from sinew.measure.estimate import fixed, number

if TYPE_CHECKING:
    from sinew.plan.check import Preview
    from sinew.plan.plan import Plan
    from sinew.plan.rig import RigSpec


def simulate(
    context: typer.Context,
    plan: PlanArgument,
    out: Annotated[Path, option("FILE", "The recording to write, NetCDF.")],
    rig: Rig = "paper",
    seed: Seed = 0,
    without: Without = None,
    json: Json = False,
) -> None:
    """Run a plan on the physics twin and write the recording.

    Refuses a plan that breaks a limit of the rig; `sinew check` says which.
    """
    from sinew.measure.files.netcdf import save_recording
    from sinew.plan.check import refuse_beyond_limits
    from sinew.plan.toml import load_plan, load_rig
    from sinew.predict.preview import preview_plan
    from sinew.solve.programs import use_all_cores
    from sinew.twin.parameters import Effects
    from sinew.twin.simulate import simulate as run

    plan_, rig_ = load_plan(plan), load_rig(rig)
    effects = Effects().without(*(without or ()))
    if plan_.is_spatial:
        use_all_cores()
    preview = preview_plan(plan_, rig_)
    refuse_beyond_limits(preview)
    console.require_file(out)
    with console.progress_bar("simulate") as progress:
        recording = run(plan_, rig_, seed=seed, effects=effects, progress=progress)
    save_recording(recording.assign_attrs(command=console.command_line(context)), out)
    document: dict[str, Any] = {
        "recording": str(out),
        "plan": plan_.name,
        "rig": rig_.name,
        "seed": seed,
        "effects_off": list(without or ()),
        "segments": recording.sizes["segment"],
        "samples": recording.sizes["sample"],
        "simulated_s": preview.duration_s,
    }
    if json:
        console.print_json(document)
    else:
        print(f"{out}: {document['samples']} samples in {document['segments']} segments, {preview.duration_s:.0f} s")


# ---- `sinew check`: a plan before it meets a bench, previewed on the physics twin


def check(plan: PlanArgument, rig: Rig = "paper", json: Json = False) -> int:
    """Preview a plan on a rig before anything moves.

    Prints duration, the drive amplitude that can be reached at each frequency, tendon tensions, torsion, and every
    limit of the rig that the plan would break. Ends with status 2 if there is one.
    """
    from sinew.bench.preflight import wire_times
    from sinew.plan.check import refuse_beyond_limits  # pydantic and scipy: not for --help
    from sinew.plan.toml import load_plan, load_rig
    from sinew.predict.preview import preview_document, preview_plan

    plan_, rig_ = load_plan(plan), load_rig(rig)
    preview = preview_plan(plan_, rig_, swing=True)
    preview_json = preview_document(plan_, rig_, preview) | {"wire": wire_times(plan_, rig_)}
    if json:
        console.print_json(preview_json)
    else:
        _print_preview(plan_, preview, preview_json)
        _print_wire(plan_, rig_, preview_json["wire"])
    refuse_beyond_limits(preview)
    return 0


def _print_wire(plan: "Plan", rig: "RigSpec", wire: dict[str, Any]) -> None:
    baud = number(1e-6 * rig.wiring.baud, unit="Mbaud")
    print(
        f"a cycle is on the wire for {wire['cycle_ms']:.2f} ms at {baud}; "
        f"{plan.sample_hz:g} Hz allow {wire['limit_ms']:.2f} ms"
    )


def _print_preview(plan: "Plan", preview: "Preview", preview_json: dict[str, Any]) -> None:
    print(
        f"plan {plan.name} on rig {preview_json['rig']}: {preview.groups} motions, {preview.samples} samples,", end=" "
    )
    print(f"{_time(preview.duration_s)} of motion and rest,", end=" ")
    print(f"about {_time(preview.bench_s)} on a bench with pull, pretensions and stop")
    if pose := preview_json.get("pose"):
        print(
            f"pose: {plan.rest_pose.words()} (pitch {fixed(pose['pitch_deg'], 1)}°, roll {fixed(pose['roll_deg'], 1)}°)"
        )
    if preview.frequency_hz and plan.sweep is not None:
        rows = [
            (f"{row['frequency_hz']:g}", fixed(row["amplitude_deg"], 1), fixed(row["current_a"], 2))
            for row in preview_json["drive"]
        ]
        title = f"drive, nominal {plan.sweep.amplitude_deg:g}°, against a held head (less where the joint resonates)"
        console.print_table(("frequency/Hz", "amplitude/°", "current/A"), rows, title)
    if preview.tension_n:
        _print_tensions(plan, preview)
    words = {"refuse": "REFUSED", "warn": "warning", "note": "note"}
    for finding in preview.findings:
        print(f"{words[finding.severity]}: {finding.sentence}")
    if not preview.refusals:
        print("no limit of the rig is broken")


def _print_tensions(plan: "Plan", preview: "Preview") -> None:
    twists = [fixed(twist, 0) for twist in preview.torsion_deg] or ["–"] * len(preview.tension_n)
    held = [
        (f"{p:g}", fixed(t, 1), twist)
        for p, t, twist in zip(plan.pretension.pretension_mm, preview.tension_n, twists, strict=True)
    ]
    whose = "tension of each tendon" if plan.rest_pose.is_straight else "largest tension of a tendon"
    console.print_table(("pretension/mm", f"{whose} at rest/N", "largest torsion/°"), held, "tendons and torsion")


def _time(seconds: float) -> str:
    return "{} min {} s".format(*divmod(round(seconds), 60))
