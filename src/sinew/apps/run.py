"""This is where `sinew run` takes a plan to a bench, and `sinew stop` brings a bench to rest."""

import math
import shlex
import shutil
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps.console import print_json, remark, require_folder
from sinew.apps.options import Json, PlanArgument, Rig
from sinew.apps.realtime import keeping_time
from sinew.apps.screen import showing

if TYPE_CHECKING:
    from sinew.bench.journal import Journal
    from sinew.bench.run import RunReport
    from sinew.hardware.rig import Rig as HardwareRig
    from sinew.hardware.transport import Clock
    from sinew.plan.plan import Plan
    from sinew.plan.rig import RigSpec

__all__ = ["Port", "Wait", "await_port", "open_rig", "run", "stop"]

Port = Annotated[str, typer.Option("--port", metavar="PORT", help="Serial port of the bench, or of `sinew emulate`.")]
Wait = Annotated[
    float, typer.Option("--wait", metavar="S", min=0.0, max=3600.0, help="Wait so long for the port to appear [s].")
]

_RETRIES = 2
_LOOK_S = 0.2
_JOURNAL, _RECORDING = "journal.sqlite", "recording.nc"
_ROW_BYTES = 350  # a cycle in the journal, 230, and in the recording, 110
_SET_S = 20.0  # to set a pretension; these cycles are in the journal, too


def await_port(port: str, seconds: float) -> None:
    """Return when there is such a port, or after so many seconds; whoever opens it says what is wrong then."""
    end = time.monotonic() + seconds
    while not Path(port).exists() and time.monotonic() < end:
        time.sleep(_LOOK_S)


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
    wait: Wait = 0.0,
    json: Json = False,
) -> int:
    """Run a plan on a bench: pull the tendons, set each pretension, swing, record.

    Every sample goes into DIR/journal.sqlite as it comes; at the end the whole groups become DIR/recording.nc, which
    `sinew analyse` reads. Whatever happens, and after Ctrl-C, the motors end in the rig's declared safe state; where
    the port is lost, their own bus watchdog stops them. A run that was cut off goes on at its first unfinished group
    with --resume. Exit status: 0 complete, 1 stopped early, 2 refused before anything moved.
    """
    from sinew.bench.preflight import refuse_unready
    from sinew.bench.run import Runner
    from sinew.plan.toml import load_plan, load_rig

    plan_, spec = load_plan(plan), load_rig(rig)
    words = ["sinew", "run", plan, "--rig", rig, "--port", port, "--out", str(out)]
    _refuse_unfit_folder(out, resume)
    await_port(port, wait)
    with ExitStack() as signals:
        with open_rig(port, spec) as (bench, clock):
            # What the bench lacks is said at once; the runner looks again, for the preview takes a while.
            refuse_unready(bench, clock, plan_, torque_may_be_on=resume)
            tension = _refuse_unfit_plan(plan_, spec, out)
            with keeping_time(), _journal(out, plan_, spec, words, resume) as journal, showing() as screen:
                screen.progress(0.0, sum(group.duration_s for group in plan_.groups()))
                runner = Runner(bench, clock, plan_, journal, tension, listener=screen, progress=screen.progress)
                signals.enter_context(_on_signals(runner.request_stop))
                report = runner.run(resume=resume)
                _close(journal, report)
            statistics = bench.bus.statistics
        recording = _convert(out, report)
    document = _document(report, plan_, spec, recording, out / _JOURNAL)
    document["bus"] = {name: getattr(statistics, name) for name in statistics.__dataclass_fields__}
    if json:
        print_json(document)
    else:
        _print(document)
    if not report.is_complete:
        end = f"{report.sentence}; " if json else ""
        remark(f"{end}go on with: {shlex.join([*words, '--resume'])}")
    return 0 if report.is_complete and document["is_safe"] else 1


def stop(
    port: Port,
    rig: Rig = "paper",
    state: Annotated[str | None, typer.Option("--state", metavar="hold|release", help="Instead of the rig's.")] = None,
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
    with open_rig(port, spec) as (bench, clock), _on_signals(lambda _: None):
        report = bring_to_rest(bench, clock, wanted)
    if json:
        failed = [{"motor": name, "sentence": why} for name, why in report.failed]
        print_json({"state": wanted, "is_safe": report.is_safe, "reached": report.reached, "failed": failed})
    else:
        print(report.sentence())
    return 0 if report.is_safe else 1


def _refuse_unfit_folder(folder: Path, resume: bool) -> None:
    from sinew.measure.errors import FileError

    require_folder(folder)
    if resume and not (folder / _JOURNAL).exists():
        raise FileError(f"found no run to go on with in {folder}; leave --resume out to start one")
    if not resume and (folder / _JOURNAL).exists():
        raise FileError(f"{folder} holds a run already; go on with it by --resume, or choose another --out")
    if not resume and (folder / _RECORDING).exists():
        raise FileError(f"{folder} holds a {_RECORDING} already, which the run would replace; choose another --out")


def _refuse_unfit_plan(plan: "Plan", spec: "RigSpec", folder: Path) -> dict[float, float]:
    """Return the tension of each tendon at rest [N] by pretension [mm], of a plan that fits the rig and the disk."""
    from sinew.apps.check import preview_plan
    from sinew.measure.errors import FileError
    from sinew.plan.check import refuse_beyond_limits

    preview = preview_plan(plan, spec, swing=True)
    refuse_beyond_limits(preview)
    pretensions = plan.pretension.pretension_mm
    needed = _ROW_BYTES * plan.sample_hz * (preview.longest_s + _SET_S * len(pretensions))
    nearest = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.exists())
    free = shutil.disk_usage(nearest).free
    if free < needed:
        raise FileError(
            f"the disk of {folder} has {1e-6 * free:.1f} MB left, the run writes about {1e-6 * needed:.1f} MB; "
            "make space, or choose another disk with --out"
        )
    return dict(zip(pretensions, preview.tension_n, strict=True))


@contextmanager
def _journal(folder: Path, plan: "Plan", spec: "RigSpec", words: Sequence[str], resume: bool) -> "Iterator[Journal]":
    """Give the journal of a run; a run that is refused leaves nothing behind in its folder."""
    from sinew.bench.errors import StartError
    from sinew.bench.journal import Journal
    from sinew.measure.errors import FileError
    from sinew.plan.toml import dump_plan, dump_rig

    texts = (dump_plan(plan), dump_rig(spec))
    made = [place for place in (folder, *folder.parents) if not place.exists()]
    there = set() if made else set(folder.iterdir())
    try:
        if resume:
            journal = Journal.open(folder / _JOURNAL, *texts)
        else:
            journal = Journal.create(folder / _JOURNAL, *texts, {"command": shlex.join(words)})
    except FileError:
        _clear(folder, there, made)
        raise
    try:
        yield journal
    except StartError:
        journal.close()
        _clear(folder, there, made)
        raise
    finally:
        journal.close()


def _clear(folder: Path, there: set[Path], made: Sequence[Path]) -> None:
    with suppress(OSError):
        for path in set(folder.iterdir()) - there:
            path.unlink()
        for place in made:
            place.rmdir()


def _close(journal: "Journal", report: "RunReport") -> None:
    """Close the journal of a run that has ended; samples that it could not take make the run incomplete."""
    from sinew.measure.errors import FileError

    try:
        journal.close()
    except FileError as trouble:
        report.is_complete, report.sentence = False, str(trouble)


def _convert(folder: Path, report: "RunReport") -> Path | None:
    """Make the recording of a run that has ended, and return where it is; without one the run is incomplete."""
    from sinew.bench.conversion import convert
    from sinew.measure.errors import SinewError

    if not report.groups_done:
        return None
    try:
        return convert(folder / _JOURNAL, folder / _RECORDING)
    except SinewError as trouble:
        report.is_complete = False
        report.sentence += f"; no recording could be made of the journal: {trouble}"
        return None


@contextmanager
def _on_signals(act: Callable[[str], None]) -> Iterator[None]:
    """Have Ctrl-C, SIGTERM and a closed terminal do something, each time, instead of ending the program."""
    names = {signal.SIGINT: "interrupted by Ctrl-C", signal.SIGTERM: "terminated", signal.SIGHUP: "the terminal closed"}

    def handler(number: int, _frame: Any) -> None:
        act(names[signal.Signals(number)])

    before = {number: signal.signal(number, handler) for number in names}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)


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
    done = f"; {document['groups_done']} of {document['groups']} groups are recorded"
    print(f"{document['ended']}{'' if document['complete'] else done}")
    print(document["left"])
    cycles = document["cycles"]
    print(
        f"{cycles['cycles']} cycles, {cycles['missed']} deadlines missed, {cycles['incomplete']} lack an answer; "
        f"latest begin {cycles['worst_late_ms']:.1f} ms after its deadline"
    )
    print(document["recording"] or "no group is whole, so there is no recording")
