"""`sinew run` and `sinew stop`: a plan taken to a bench, and a bench brought to rest."""

import shlex
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from sinew.apps.bench import bench_run
from sinew.apps.bench.run_control import keeping_time, listening, showing
from sinew.apps.console import Json, PlanArgument, Rig, flag, option, print_json, remark

if TYPE_CHECKING:
    from sinew.bench.pretension import Held
    from sinew.plan.plan import Plan
    from sinew.plan.rig import RigSpec


def run(
    plan: PlanArgument,
    port: bench_run.Port,
    out: Annotated[Path, option("DIR", "Folder for journal and recording.")],
    rig: Rig = "paper",
    resume: Annotated[bool, flag("--resume", "Go on with the interrupted run in --out.")] = False,
    wait: bench_run.Wait = 0.0,
    json: Json = False,
) -> int:
    """Run a plan on a bench: pull the tendons, set each pretension, swing, record.

    Every sample goes into DIR/journal.sqlite as it comes; at the end the whole groups become DIR/recording.nc, and what
    `sinew analyse` finds in it DIR/results.nc and DIR/analysis.json. Whatever happens, and after Ctrl-C, the motors end
    in the rig's declared safe state; where the port is lost, their own bus watchdog stops them. A run that was cut off
    goes on at its first unfinished group with --resume.

    Where the computer paused for so long that the motors stopped themselves, an emulated bench is brought to rest and
    the run goes on by itself from its last whole group; a real one is left in its safe state, and on a terminal one
    key, r, goes on. The rig may say how often a run goes on by itself (limits.resumes_after_pause).

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
    bench_run.refuse_unfit_folder(out, resume)
    while True:
        bench_run.await_port(port, wait)
        document = _run_once(plan_, spec, port, out, words, resume)
        if json:
            print_json(document)
        else:
            bench_run.print_run(document)
        if not document["complete"]:
            end = f"{document['ended']}; " if json else ""
            remark(f"{end}go on with: {shlex.join([*words, '--resume'])}")
        if json or not bench_run.goes_on_by_key(document):
            return 0 if document["complete"] and document["is_safe"] else 1
        resume = True


def _run_once(plan: "Plan", spec: "RigSpec", port: str, out: Path, words: list[str], resume: bool) -> dict[str, Any]:
    """Run a plan, or what is left of it, and return how it ended, as JSON holds it."""
    from sinew.bench.preflight import refuse_unready
    from sinew.bench.run import Runner
    from sinew.bench.stops import Steering

    with ExitStack() as signals:
        with (
            bench_run.open_rig(port, spec) as (bench, clock),
            listening(out, steering := Steering(clock.now)) as control,
        ):
            # What the bench lacks is said at once; the runner looks again, for the preview takes a while.
            refuse_unready(bench, clock, plan, torque_may_be_on=resume)
            tension, held, expected = _refuse_unfit_plan(plan, spec, out)
            told = {"source": bench_run.source_of(bench), "expected": expected}
            with (
                keeping_time(),
                bench_run.run_journal(out, plan, spec, words, resume, **told) as journal,
                showing() as screen,
            ):
                runner = control.runner = Runner(
                    bench, clock, plan, journal, tension, held=held, listener=screen, steering=steering
                )
                signals.enter_context(bench_run.on_signals(steering.request_stop, steering.request_emergency))
                report = runner.run(resume=resume)
                bench_run.close_journal(journal, report)
            statistics = bench.bus.statistics
        recording = bench_run.convert_journal(out, report)
    document = bench_run.run_document(report, plan, spec, recording, out / bench_run.JOURNAL)
    document["doubts"] = bench_run.recording_doubts(recording, spec)
    document["bus"] = {name: getattr(statistics, name) for name in statistics.__dataclass_fields__}
    return document


def stop(
    port: bench_run.Port,
    rig: Rig = "paper",
    state: Annotated[str | None, option("hold|release", "Instead of the rig's.")] = None,
    json: Json = False,
) -> int:
    """Bring a bench to its safe state, from whatever state it is in: hold, or release the tension and the torque.

    Takes up to 3 s, which Ctrl-C does not cut short. Exit status: 0 every motor confirms the state, 1 one does not, 2
    the port cannot be opened.
    """
    from sinew.bench.stops import stop as bring_to_rest
    from sinew.measure.errors import SpecError
    from sinew.plan.toml import load_rig

    spec = load_rig(rig)
    wanted = state or spec.limits.safe_state
    if wanted not in ("hold", "release"):
        raise SpecError(f"found --state {wanted}, expected hold or release")
    with bench_run.open_rig(port, spec) as (bench, clock), bench_run.on_signals(lambda _: None):
        report = bring_to_rest(bench, clock, wanted)
    if json:
        failed = [{"motor": name, "sentence": why} for name, why in report.failed]
        print_json({"state": wanted, "is_safe": report.is_safe, "reached": report.reached, "failed": failed})
    else:
        print(report.sentence())
    return 0 if report.is_safe else 1


def _refuse_unfit_plan(
    plan: "Plan", spec: "RigSpec", folder: Path
) -> "tuple[dict[float, float], dict[float, Held] | None, str]":
    """Return the tension of each tendon at rest [N] by pretension [mm], of a plan that fits the rig and the disk; for a
    pose, what holds it; and what the twin expects of its recording."""
    from sinew.bench.pretension import Held
    from sinew.plan.check import refuse_beyond_limits
    from sinew.predict.foreseen import foresee_plan

    if not plan.is_spatial:
        (preview, expected), held = foresee_plan(plan, spec), None
        refuse_beyond_limits(preview)
    else:
        from sinew.predict.preview import expected_of, held_preview, sentences_of

        (preview, rests), expected = held_preview(plan, spec), ""
        refuse_beyond_limits(preview)
        held = {mm: Held.of(rest) for mm, rest in rests.items()}
        for sentence in sentences_of(expected_of(plan, spec, preview), plan):
            remark(sentence)
    pretensions = plan.pretension.pretension_mm
    bench_run.refuse_full_disk(folder, plan, preview.longest_s)
    return dict(zip(pretensions, preview.tension_n, strict=True)), held, expected
