"""`sinew simulate`: a plan run on the physics twin, recorded as a bench would."""

import shlex
from pathlib import Path
from typing import Annotated, Any

from sinew.apps import console
from sinew.apps.console import Json, PlanArgument, Rig, Seed, Without, option


def simulate(
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
    from sinew.twin.cache import use_all_cores
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
    command = ["sinew", "simulate", plan, "--rig", rig, "--seed", str(seed), "--out", str(out)]
    command += [word for effect in without or () for word in ("--without", effect)]
    save_recording(recording.assign_attrs(command=shlex.join(command)), out)
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
