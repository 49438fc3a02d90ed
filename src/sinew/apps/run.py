"""This is where `sinew run` takes a plan to a bench, and `sinew stop` brings a bench to rest."""

import json as json_
import math
import shlex
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps.console import print_json, progress_bar, remark, require_folder
from sinew.apps.options import Json, PlanArgument, Rig
from sinew.apps.realtime import keeping_time

if TYPE_CHECKING:
    from sinew.bench.run import Runner, RunReport
    from sinew.hardware.rig import Rig as HardwareRig
    from sinew.hardware.transport import Clock
    from sinew.plan.plan import Plan
    from sinew.plan.rig import RigSpec

__all__ = ["Port", "open_rig", "run", "stop"]

Port = Annotated[str, typer.Option("--port", metavar="PORT", help="Serial port of the bench, or of `sinew emulate`.")]

_RETRIES = 2


@contextmanager
def open_rig(port: str, spec: "RigSpec") -> "Iterator[tuple[HardwareRig, Clock]]":
    """Open a serial port and give (rig, clock); the port is closed in the end. Raises PortError."""
    from sinew.hardware.bus import Bus, BusTiming
    from sinew.hardware.rig import Rig as HardwareRig
    from sinew.hardware.serial_port import SerialPort
    from sinew.hardware.transport import MonotonicClock

    clock = MonotonicClock()
    baud = spec.wiring.baud
    bus = Bus(SerialPort(port, baud, clock), clock, BusTiming(baud, latency=1e-3 * spec.wiring.latency_ms), _RETRIES)
    try:
        yield HardwareRig(bus, clock, spec), clock
    finally:
        bus.close()


def run(
    plan: PlanArgument,
    port: Port,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for journal and recording.")],
    rig: Rig = "paper",
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the interrupted run in --out.")] = False,
    json: Json = False,
) -> int:
    """Run a plan on a bench: pull the tendons, set each pretension, swing, record.

    Every sample goes into DIR/journal.sqlite as it comes; at the end the whole groups become DIR/recording.nc, which
    `sinew analyse` reads. Whatever happens, the motors end in the rig's declared safe state; Ctrl-C leads there too. A
    run that was cut off goes on at its first unfinished group with --resume. Exit status: 0 complete, 1 stopped early,
    2 refused before anything moved.
    """
    from sinew.apps.check import preview_plan
    from sinew.bench.conversion import convert
    from sinew.bench.journal import Journal
    from sinew.bench.run import Runner
    from sinew.plan.check import refuse_beyond_limits
    from sinew.plan.toml import dump_plan, dump_rig, load_plan, load_rig

    plan_, spec = load_plan(plan), load_rig(rig)
    journal_file = require_folder(out) / "journal.sqlite"
    _refuse_unfit_folder(journal_file, resume)
    preview = preview_plan(plan_, spec, swing=True)
    refuse_beyond_limits(preview)
    tension = dict(zip(plan_.pretension.pretension_mm, preview.tension_n, strict=True))
    words = ["sinew", "run", plan, "--rig", rig, "--port", port, "--out", str(out)] + ["--resume"] * resume
    with open_rig(port, spec) as (bench, clock), keeping_time():
        if resume:
            journal = Journal.open(journal_file, dump_plan(plan_), dump_rig(spec))
        else:
            journal = Journal.create(journal_file, dump_plan(plan_), dump_rig(spec), {"command": shlex.join(words)})
        try:
            with progress_bar("run") as progress:
                runner = Runner(bench, clock, plan_, journal, tension, listener=_Remarks(), progress=progress)
                with _stop_on_signals(runner):
                    report = runner.run(resume=resume)
        finally:
            journal.close()
        statistics = bench.bus.statistics
    recording = out / "recording.nc" if report.groups_done else None
    if recording is not None:
        convert(journal_file, recording)
    document = _document(report, plan_, spec, recording, journal_file)
    document["bus"] = {name: getattr(statistics, name) for name in statistics.__dataclass_fields__}
    if json:
        print_json(document)
    else:
        _print(document)
    return 0 if report.is_complete else 1


def stop(
    port: Port,
    rig: Rig = "paper",
    state: Annotated[str | None, typer.Option("--state", metavar="hold|release", help="Instead of the rig's.")] = None,
    json: Json = False,
) -> int:
    """Bring a bench to its safe state, from whatever state it is in: hold, or release the tension and the torque."""
    from sinew.bench.stops import stop as bring_to_rest
    from sinew.measure.errors import SpecError
    from sinew.plan.toml import load_rig

    spec = load_rig(rig)
    wanted = state or spec.limits.safe_state
    if wanted not in ("hold", "release"):
        raise SpecError(f"found --state {wanted}, expected hold or release")
    with open_rig(port, spec) as (bench, clock):
        report = bring_to_rest(bench, clock, wanted)
    if json:
        failed = [{"motor": name, "sentence": why} for name, why in report.failed]
        print_json({"state": wanted, "is_safe": report.is_safe, "reached": report.reached, "failed": failed})
    else:
        print(report.sentence())
    return 0 if report.is_safe else 1


def _refuse_unfit_folder(journal: Path, resume: bool) -> None:
    from sinew.measure.errors import FileError

    if resume and not journal.exists():
        raise FileError(f"found no run to go on with in {journal.parent}; leave --resume out to start one")
    if not resume and journal.exists():
        raise FileError(f"{journal.parent} holds a run already; go on with it by --resume, or choose another --out")
    journal.parent.mkdir(parents=True, exist_ok=True)


@contextmanager
def _stop_on_signals(runner: "Runner") -> Iterator[None]:
    """Turn Ctrl-C, SIGTERM and a closed terminal into a stop in the safe state; a second one changes nothing."""
    names = {signal.SIGINT: "interrupted by Ctrl-C", signal.SIGTERM: "terminated", signal.SIGHUP: "the terminal closed"}

    def handler(number: int, _frame: Any) -> None:
        runner.request_stop(names[signal.Signals(number)])

    before = {number: signal.signal(number, handler) for number in names}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)


class _Remarks:
    """Tells on stderr what happens besides samples."""

    def on_sample(self, sample: Any) -> None:
        """Do nothing."""

    def on_event(self, kind: str, sentence: str) -> None:
        """Print an event."""
        if kind == "pretension":
            result = json_.loads(sentence)
            sentence = f"pretension {result['asked_mm']:g} mm is set, tilt {result['tilt_deg']:.2f}°"
        if kind != "end":
            remark(sentence)


def _document(
    report: "RunReport", plan: "Plan", spec: "RigSpec", recording: Path | None, journal: Path
) -> dict[str, Any]:
    assert report.stop is not None
    cycles = report.loop
    keys = ("asked_mm", "reached_mm", "asked_current_a", "current_a", "tilt_deg", "levelling_s")
    pretensions = [{key: _known(getattr(result, key)) for key in keys} for result in report.pretensions]
    return {
        "plan": plan.name,
        "rig": spec.name,
        "complete": report.is_complete,
        "ended": report.sentence,
        "safe_state": report.stop.declared,
        "is_safe": report.stop.is_safe,
        "left": report.stop.sentence(),
        "groups": report.groups,
        "groups_done": report.groups_done,
        "pretensions": pretensions,
        "cycles": {
            "cycles": cycles.cycles,
            "missed": cycles.missed,
            "incomplete": cycles.incomplete,
            "worst_late_ms": 1e3 * cycles.worst_late_s,
        },
        "journal": str(journal),
        "recording": str(recording) if recording is not None else None,
    }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _print(document: dict[str, Any]) -> None:
    print(f"{document['ended']}; {document['groups_done']} of {document['groups']} groups are recorded")
    print(document["left"])
    cycles = document["cycles"]
    print(
        f"{cycles['cycles']} cycles, {cycles['missed']} deadlines missed, {cycles['incomplete']} with a missing answer; "
        "latest begin "
        f"{cycles['worst_late_ms']:.1f} ms after its deadline"
    )
    print(document["recording"] or "no group is whole, so there is no recording")
