"""This is where `sinew track` keeps a joint in resonance, on a bench or on the emulated one."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps.bench_run import (
    JOURNAL,
    Wait,
    await_port,
    close_journal,
    convert_journal,
    on_signals,
    open_rig,
    refuse_full_disk,
    refuse_unfit_folder,
    rig_on,
    run_document,
    run_journal,
    source_of,
)
from sinew.apps.console import print_json
from sinew.apps.options import Json, Seed
from sinew.apps.realtime import keeping_time
from sinew.apps.run_control import listening
from sinew.apps.screen import showing
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.hardware.rig import Rig as HardwareRig
    from sinew.hardware.transport import Clock
    from sinew.plan.plan import Plan
    from sinew.plan.rig import RigSpec
    from sinew.tune.expected import ExpectedBackbone

__all__ = ["track"]

Bench = AbstractContextManager["tuple[HardwareRig, Clock]"]


def track(
    rig: Annotated[
        str, typer.Argument(metavar="[RIG]", help="A rig: a TOML file, or the name of a shipped one.")
    ] = "paper",
    port: Annotated[str | None, typer.Option("--port", metavar="PORT", help="Serial port of the bench.")] = None,
    emulate: Annotated[bool, typer.Option("--emulate", help="Instead: an emulated bench, in virtual time.")] = False,
    pretension: Annotated[
        str | None,
        typer.Option("--pretension-mm", metavar="MM,...|FROM:TO", help="Pretensions, or one that moves; else 4."),
    ] = None,
    amplitude: Annotated[
        str, typer.Option("--amplitude-deg", metavar="DEG,...", help="Amplitudes that are held.")
    ] = "20",
    hold: Annotated[
        str, typer.Option("--hold", metavar="command|lever|torsion", help="Of what they are: half of peak to peak.")
    ] = "command",
    duration: Annotated[
        float | None,
        typer.Option("--duration-s", metavar="S", min=3.0, max=3600.0, help="Of each; else 10, moving 30."),
    ] = None,
    start: Annotated[
        float | None,
        typer.Option("--from-hz", metavar="HZ", min=0.1, help="First drive frequency; else the expected one."),
    ] = None,
    follow: Annotated[
        str | None,
        typer.Option("--follow-hz", metavar="FROM:TO", help="Move the pretension so that it resonates there."),
    ] = None,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for journal, recording, figure.")] = Path(
        "out/track"
    ),
    fault: Annotated[
        list[str] | None, typer.Option("--fault", metavar="SPEC", help="With --emulate: as of `sinew emulate`.")
    ] = None,
    seed: Seed = 0,
    wait: Wait = 0.0,
    json: Json = False,
) -> int:
    """Hold the torsion 90° behind the lever: a phase-locked loop moves the drive's frequency.

    At each pretension, and with each amplitude, that is a point of the backbone, in seconds instead of a sweep. With
    FROM:TO the pretension moves, within --duration-s, while the lock is kept. With --follow-hz a slower loop moves it
    within that range, or 0:12, so that the resonance follows a frequency.

    Samples, journal, limits and the end in the rig's safe state are those of `sinew run`. Exit status: 0 complete, 1
    stopped early, 2 refused before anything moved.
    """
    from sinew.apps.track_found import found_tracks, print_found, write_found
    from sinew.apps.track_plan import track_plan
    from sinew.plan.toml import load_rig

    _require_one_bench(port, emulate=emulate, has_faults=bool(fault))
    spec = load_rig(rig)
    refuse_unfit_folder(out, resume=False)
    plan, expected = track_plan(spec, pretension, amplitude, hold, duration, start, follow)
    where = ["--emulate", "--seed", str(seed)] if emulate else ["--port", str(port)]
    asked = {"--pretension-mm": pretension, "--amplitude-deg": amplitude, "--hold": hold, "--duration-s": duration}
    asked |= {"--from-hz": start, "--follow-hz": follow}
    words = ["sinew", "track", rig, *where, *_options(asked, fault or ()), "--out", str(out)]
    with ExitStack() as stack:
        bench = _emulated(spec, seed, fault or []) if port is None else _real(port, spec, wait)
        document = _run(bench, plan, spec, expected, out, words, stack, virtual=port is None)
    document |= found_tracks(document, plan, spec, expected)
    write_found(document, expected, out)
    if json:
        print_json(document)
    else:
        print_found(document)
    return 0 if document["complete"] and document["is_safe"] else 1


def _require_one_bench(port: str | None, *, emulate: bool, has_faults: bool) -> None:
    if (port is None) is not emulate:
        raise SpecError("found both --port and --emulate, or neither; expected one of them: where is the bench?")
    if has_faults and not emulate:
        raise SpecError("found --fault with a real bench; faults are for --emulate")


def _options(asked: Mapping[str, object], faults: Sequence[str]) -> list[str]:
    """Return the words of a command line that says what was asked."""
    options = [word for name, value in asked.items() if value is not None for word in (name, str(value))]
    return options + [word for text in faults for word in ("--fault", text)]


@contextmanager
def _real(port: str, spec: "RigSpec", wait: float) -> "Iterator[tuple[HardwareRig, Clock]]":
    await_port(port, wait)
    with open_rig(port, spec) as bench:
        yield bench


@contextmanager
def _emulated(spec: "RigSpec", seed: int, faults: Sequence[str]) -> "Iterator[tuple[HardwareRig, Clock]]":
    from sinew.apps.emulate import found_bench
    from sinew.emulator.virtual import VirtualPort

    port = VirtualPort(found_bench(spec, seed, list(faults)))
    yield rig_on(port, port, spec), port


def _run(
    bench: Bench,
    plan: "Plan",
    spec: "RigSpec",
    expected: "Sequence[ExpectedBackbone]",
    out: Path,
    words: Sequence[str],
    signals: ExitStack,
    *,
    virtual: bool,
) -> dict[str, Any]:
    """Run a plan that tracks and return how it ended, as JSON holds it."""
    from sinew.apps.track_plan import tensions
    from sinew.bench.preflight import refuse_unready
    from sinew.bench.run import Runner
    from sinew.bench.steering import Steering
    from sinew.tune.planned import planned_tracker

    held = tensions(plan, spec)
    refuse_full_disk(out, plan, sum(group.duration_s for group in plan.groups()))
    with bench as (rig, clock), listening(out, steering := Steering(clock.now, can_pause=False)) as control:
        refuse_unready(rig, clock, plan)
        pace = nullcontext() if virtual else keeping_time()
        told = {"source": source_of(rig)}
        with pace, run_journal(out, plan, spec, words, False, **told) as journal, showing(tracking=True) as screen:
            runner = control.runner = Runner(
                rig,
                clock,
                plan,
                journal,
                held,
                listener=screen,
                steering=steering,
                law=lambda group, time: planned_tracker(group, plan, spec, expected, time),
            )
            signals.enter_context(on_signals(runner.request_stop, runner.request_emergency))
            report = runner.run()
            close_journal(journal, report)
    recording = convert_journal(out, report)
    document = run_document(report, plan, spec, recording, out / JOURNAL)
    document["laws"] = [dict(report.tracks[index]) for index in sorted(report.tracks)]
    return document
