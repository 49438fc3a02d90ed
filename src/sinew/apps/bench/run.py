"""`sinew run` and `sinew stop`: a plan taken to a bench, and a bench brought to rest."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from sinew.apps.bench.bench_run import (
    Needs,
    Port,
    Wait,
    await_port,
    on_signals,
    open_rig,
    print_run,
    recording_doubts,
    refuse_unfit_folder,
    run_plan,
)
from sinew.apps.console import Json, PlanArgument, Rig, flag, option, print_json, remark

if TYPE_CHECKING:
    from sinew.plan.plan import Plan
    from sinew.plan.rig import RigSpec


def run(
    plan: PlanArgument,
    port: Port,
    out: Annotated[Path, option("DIR", "Folder for journal and recording.")],
    rig: Rig = "paper",
    resume: Annotated[bool, flag("--resume", "Go on with the interrupted run in --out.")] = False,
    wait: Wait = 0.0,
    json: Json = False,
) -> int:
    """Run a plan on a bench.

    It pulls the tendons, sets each pretension, swings and records. Every sample goes into DIR/journal.sqlite as it
    comes; at the end the whole groups become DIR/recording.nc, and what `sinew analyse` finds in it DIR/results.nc
    and DIR/analysis.json. Whatever happens, and after Ctrl-C, the motors end in the rig's declared safe state;
    where the port is lost, their own bus watchdog stops them. A run that was cut off goes on at its first
    unfinished group with --resume.

    Where the computer paused for so long that the motors stopped themselves, an emulated bench is brought to rest and
    the run goes on by itself from its last whole group; a real one is left in its safe state, and --resume goes on.
    The rig may say how often a run goes on by itself (limits.resumes_after_pause).

    Ctrl-\\ is the emergency stop: all motors are frozen at once, within 0.2 s, then brought to the declared state. The
    run takes commands (pause, resume, hold, release, stop, emergency) at the socket that DIR/control names.

    At the end the recording is looked at for what speaks against it: a lever that did not go as far as its servo takes
    it, a sensor that repeats itself, a curve far from the rig's prediction. Each such doubt is a warning, and in --json
    a row of `doubts`.

    Exit status: 0 complete, 1 stopped early, 2 refused before anything moved.
    """
    from sinew.plan.toml import load_plan, load_rig

    plan_, spec = load_plan(plan), load_rig(rig)
    words = ["sinew", "run", plan, "--rig", rig, "--port", port, "--out", str(out)]
    refuse_unfit_folder(out, resume)
    await_port(port, wait)
    bench = open_rig(port, spec)
    document = run_plan(bench, plan_, spec, out, words, lambda: _needs(plan_, spec), resume=resume)
    recording = document["recording"]
    document["doubts"] = [] if recording is None else recording_doubts(Path(recording), spec)
    if json:
        print_json(document)
    else:
        print_run(document)
    if not document["complete"]:
        end = f"{document['ended']}; " if json else ""
        remark(f"{end}go on with: {shlex.join([*words, '--resume'])}")
    return 0 if document["complete"] and document["is_safe"] else 1


def stop(
    port: Port,
    rig: Rig = "paper",
    state: Annotated[str | None, option("hold|release", "Instead of the rig's.")] = None,
    json: Json = False,
) -> int:
    """Bring a bench to its safe state.

    From whatever state it is in: hold, or release the tension and the torque. Takes up to 3 s, which Ctrl-C does
    not cut short. Exit status: 0 every motor confirms the state, 1 one does not, 2 the port cannot be opened.
    """
    from sinew.bench.stops import stop as bring_to_rest
    from sinew.measure.errors import SpecError
    from sinew.plan.toml import load_rig

    spec = load_rig(rig)
    wanted = state or spec.limits.safe_state
    if wanted not in ("hold", "release"):
        raise SpecError(f"found --state {wanted}, expected hold or release")
    with open_rig(port, spec) as (bench, clock), on_signals(lambda _: None):
        report = bring_to_rest(bench, clock, wanted)
    if json:
        failed = [{"motor": name, "sentence": why} for name, why in report.failed]
        print_json({"state": wanted, "is_safe": report.is_safe, "reached": report.reached, "failed": failed})
    else:
        print(report.sentence())
    return 0 if report.is_safe else 1


def _needs(plan: "Plan", spec: "RigSpec") -> Needs:
    """Return what the run of a plan needs, and what the twin expects of its recording.

    Raises SpecError where the plan does not fit the rig.
    """
    from sinew.bench.pretension import Held
    from sinew.plan.check import refuse_beyond_limits
    from sinew.predict.preview import expected_of_plan, held_preview

    held, expected = None, ""
    if not plan.is_spatial:
        preview, expected = expected_of_plan(plan, spec)
        refuse_beyond_limits(preview)
    else:
        preview, rests = held_preview(plan, spec)
        refuse_beyond_limits(preview)
        held = {mm: Held.of(rest) for mm, rest in rests.items()}
    tension = dict(zip(plan.pretension.pretension_mm, preview.tension_n, strict=True))
    return Needs(tension, preview.duration_s, held, attrs={"expected": expected})
