"""What every run on a bench needs: port, folder, journal, signals, how it is told."""

import shlex
import shutil
import signal
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from sinew.apps.bench.run_control import keeping_time, listening, showing
from sinew.apps.console import option, require_folder
from sinew.measure.estimate import finite

if TYPE_CHECKING:
    from sinew.bench.group import DriveLaw
    from sinew.bench.pretension import Held
    from sinew.bench.record.journal import Journal
    from sinew.bench.run import RunReport
    from sinew.hardware.bus import Clock, Transport
    from sinew.hardware.rig import Rig as HardwareRig
    from sinew.plan.plan import Group, Plan
    from sinew.plan.rig import RigSpec

Port = Annotated[str, option("PORT", "Serial port of the bench, or of `sinew emulate`.", "--port")]
Wait = Annotated[float, option("S", "Wait so long for the port to appear [s].", "--wait", min=0.0, max=3600.0)]

JOURNAL = "journal.sqlite"
"""Name of a run's journal in its folder."""

_RETRIES = 2
_LOOK_S = 0.2
_RECORDING = "recording.nc"
_ROW_BYTES = 350  # a cycle in the journal, 230, and in the recording, 110
_SET_S = 20.0  # to set a pretension; these cycles are in the journal, too


def await_port(port: str, seconds: float) -> None:
    """Return when there is such a port, or after so many seconds; whoever opens it says what is wrong then."""
    end = time.monotonic() + seconds
    while not Path(port).exists() and time.monotonic() < end:
        time.sleep(_LOOK_S)


@contextmanager
def open_rig(port: str, spec: "RigSpec", *, own_time: bool = False) -> "Iterator[tuple[HardwareRig, Clock]]":
    """Open a port and give (rig, clock); the port is closed in the end. Raises PortError.

    port: a serial port, or that of an emulated bench, whose clock is shared where it has one.
    own_time: the computer's clock in any case, for who measures what the computer does.
    """
    from sinew.hardware.bus import MonotonicClock
    from sinew.hardware.ports import SerialPort, SharedPort, shared_clock

    clock: Clock = MonotonicClock()
    transport: Transport = SerialPort(port, spec.wiring.baud, clock)
    try:
        if not own_time and (shared := shared_clock(port)) is not None:
            transport, clock = SharedPort(transport, shared), shared
        rig = rig_on(transport, clock, spec)
    except BaseException:
        transport.close()
        raise
    try:
        yield rig, clock
    finally:
        rig.bus.close()


def rig_on(transport: "Transport", clock: "Clock", spec: "RigSpec") -> "HardwareRig":
    """Return the rig behind a transport."""
    from sinew.hardware.bus import Bus, BusTiming
    from sinew.hardware.rig import Rig as HardwareRig

    timing = BusTiming(spec.wiring.baud, latency=1e-3 * spec.wiring.latency_ms)
    return HardwareRig(Bus(transport, clock, timing, _RETRIES), clock, spec)


def refuse_unfit_folder(folder: Path, resume: bool) -> None:
    from sinew.measure.errors import FileError

    require_folder(folder)
    if resume and not (folder / JOURNAL).exists():
        raise FileError(f"found no run to go on with in {folder}; leave --resume out to start one")
    if not resume and (folder / JOURNAL).exists():
        raise FileError(f"{folder} holds a run already; go on with it by --resume, or choose another --out")
    if not resume and (folder / _RECORDING).exists():
        raise FileError(f"{folder} holds a {_RECORDING} already, which the run would replace; choose another --out")


def _refuse_full_disk(folder: Path, plan: "Plan", seconds: float) -> None:
    """Raise FileError where the disk of a folder has no room for a plan's run of so many seconds."""
    from sinew.measure.errors import FileError

    needed = _ROW_BYTES * plan.sample_hz * (seconds + _SET_S * len(plan.pretension.pretension_mm))
    nearest = next(ancestor for ancestor in (folder.absolute(), *folder.absolute().parents) if ancestor.exists())
    free = shutil.disk_usage(nearest).free
    if free < needed:
        raise FileError(
            f"the disk of {folder} has {1e-6 * free:.1f} MB left, the run writes about {1e-6 * needed:.1f} MB; "
            "make space, or choose another disk with --out"
        )


@contextmanager
def run_journal(
    folder: Path, plan: "Plan", spec: "RigSpec", words: Sequence[str], resume: bool, **attrs: str
) -> "Iterator[Journal]":
    """Give the journal of a run; a run that is refused leaves nothing behind in its folder.

    attrs: what else the recording shall carry, such as its source where that is no real bench.
    """
    from sinew.bench.record.journal import Journal
    from sinew.measure.errors import FileError, StartError
    from sinew.plan.toml import dump_plan, dump_rig

    texts = (dump_plan(plan), dump_rig(spec))
    made = [ancestor for ancestor in (folder, *folder.parents) if not ancestor.exists()]
    there = set() if made else set(folder.iterdir())
    try:
        if resume:
            journal = Journal.open(folder / JOURNAL, *texts)
        else:
            journal = Journal.create(folder / JOURNAL, *texts, {"command": shlex.join(words), **attrs})
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
        for ancestor in made:
            ancestor.rmdir()


@dataclass(frozen=True, slots=True)
class Needs:
    """What the run of a plan needs to know beforehand; see `sinew.bench.run.Runner`.

    tension_n: of each tendon at rest, by pretension [mm]. held: the same of a plan with a pose. law: moves the lever in
    a group that tracks. duration_s: of the plan [s]. attrs: what else the recording shall carry.
    """

    tension_n: Mapping[float, float]
    duration_s: float
    held: "Mapping[float, Held] | None" = None
    law: "Callable[[Group, float], DriveLaw] | None" = None
    attrs: Mapping[str, str] = field(default_factory=dict)


def run_plan(
    bench: "AbstractContextManager[tuple[HardwareRig, Clock]]",
    plan: "Plan",
    spec: "RigSpec",
    out: Path,
    words: Sequence[str],
    needs: Callable[[], Needs],
    *,
    resume: bool,
    is_virtual: bool = False,
) -> dict[str, Any]:
    """Run a plan, or what is left of it, and return how it ended, as JSON holds it.

    bench: gives rig and clock. out: folder of journal and recording. words: of the command line. needs: finds out what
    the run needs, when the bench is known to be ready; raises where the plan is refused. is_virtual: the bench's time
    is not the computer's.
    """
    from sinew.bench.preflight import refuse_unready
    from sinew.bench.run import Runner
    from sinew.bench.stops import Steering

    with ExitStack() as signals:
        with bench as (rig, clock):
            steering = Steering(clock.now, can_pause=plan.track is None)
            with listening(out, steering) as control:
                # What the bench lacks is said at once; the runner looks again, for finding out what is needed takes a
                # while.
                refuse_unready(rig, clock, plan, torque_may_be_on=resume)
                known = needs()
                _refuse_full_disk(out, plan, known.duration_s)
                attrs = {"source": "emulator" if rig.imu.is_emulated() else "bench", **known.attrs}
                with (
                    nullcontext() if is_virtual else keeping_time(),
                    run_journal(out, plan, spec, words, resume, **attrs) as journal,
                    showing(tracking=plan.track is not None) as screen,
                ):
                    runner = control.runner = Runner(
                        rig, clock, plan, journal, known.tension_n,
                        held=known.held, law=known.law, listener=screen, steering=steering,
                    )  # fmt: skip
                    signals.enter_context(on_signals(steering.request_stop, steering.request_emergency))
                    report = runner.run(resume=resume)
                    _close_journal(journal, report)
            statistics = rig.bus.statistics
        recording = _convert_journal(out, report)
    bus = {name: getattr(statistics, name) for name in statistics.__dataclass_fields__}
    return run_document(report, plan, spec, recording, out / JOURNAL) | {"bus": bus}


def _close_journal(journal: "Journal", report: "RunReport") -> None:
    """Close the journal of a run that has ended; samples that it could not take make the run incomplete."""
    from sinew.measure.errors import FileError

    try:
        journal.close()
    except FileError as trouble:
        report.is_complete, report.sentence = False, str(trouble)


def _convert_journal(folder: Path, report: "RunReport") -> Path | None:
    """Make the recording of a run that has ended, and return where it is; without one the run is incomplete."""
    from sinew.bench.record.conversion import convert
    from sinew.measure.errors import SinewError

    if not report.groups_done:
        return None
    try:
        return convert(folder / JOURNAL, folder / _RECORDING)
    except SinewError as trouble:
        report.is_complete = False
        report.sentence += f"; no recording could be made of the journal: {trouble}"
        return None


def recording_doubts(recording: Path, spec: "RigSpec") -> list[dict[str, Any]]:
    """Analyse a run's recording, leave the results beside it, and return what speaks against it, as JSON holds it;
    nothing where nothing in it can be analysed."""
    from sinew.analysis.doubts import doubts_of
    from sinew.apps.recordings.stored import analyse_into
    from sinew.measure.errors import SinewError
    from sinew.measure.files.netcdf import load_recording

    try:
        results = analyse_into(recording.parent, load_recording(recording), spec)
        return [doubt.to_dict() for doubt in doubts_of(results)]
    except SinewError:
        return []


@contextmanager
def signals_to(act: Callable[[int], None], numbers: Iterable[int]) -> Iterator[None]:
    """Have signals do something, each time, instead of what they did before."""
    before = {number: signal.signal(number, lambda number, _frame: act(number)) for number in numbers}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)


def on_signals(
    act: Callable[[str], None], emergency: Callable[[str], None] | None = None
) -> AbstractContextManager[None]:
    """Have Ctrl-C, SIGTERM and a closed terminal do something, each time, instead of ending the program.

    emergency: what Ctrl-\\ (SIGQUIT) does; None: the same.
    """
    names = {signal.SIGINT: "interrupted by Ctrl-C", signal.SIGTERM: "terminated", signal.SIGHUP: "the terminal closed"}
    names[signal.SIGQUIT] = "emergency stop by Ctrl-\\"

    def handle(number: int) -> None:
        which = signal.Signals(number)
        (emergency if emergency is not None and which == signal.SIGQUIT else act)(names[which])

    return signals_to(handle, names)


def run_document(
    report: "RunReport", plan: "Plan", spec: "RigSpec", recording: Path | None, journal: Path
) -> dict[str, Any]:
    assert report.stop is not None
    cycles = report.loop
    keys = ("asked_mm", "reached_mm", "asked_current_a", "current_a", "tilt_deg", "levelling_s")
    pretensions = [{key: finite(getattr(result, key)) for key in keys} for result in report.pretensions]
    return {
        "plan": plan.name,
        "rig": spec.name,
        "complete": report.is_complete,
        "ended": report.sentence,
        "safe_state": report.stop.declared,
        "is_safe": report.stop.is_safe,
        "left": report.stop.sentence(),
        "frozen_ms": None if report.halted_s is None else round(1e3 * report.halted_s, 1),
        "pauses": list(report.pauses),
        "ended_by_pause": report.is_paused,
        "groups": report.groups,
        "groups_done": report.groups_done,
        "pretensions": pretensions,
        "cycles": {
            "cycles": cycles.cycles,
            "missed": cycles.missed,
            "incomplete": cycles.incomplete,
            "stale": cycles.stale,
            "impossible": cycles.impossible,
            "samples_lost": report.lost_samples,
            "worst_late_ms": 1e3 * cycles.worst_late_s,
        },
        "wire": {"cycle_ms": round(1e3 * report.wire_s, 3), "period_ms": round(1e3 / plan.sample_hz, 3)},
        "journal": str(journal),
        "recording": str(recording) if recording is not None else None,
    }


def print_pauses(document: Mapping[str, Any]) -> None:
    """Print how often a run went on by itself, if it did."""
    if pauses := document["pauses"]:
        print(f"went on by itself after {len(pauses)} pause{'s' * (len(pauses) > 1)} of the computer")


def print_run(document: dict[str, Any]) -> None:
    done = f"; {document['groups_done']} of {document['groups']} groups are recorded"
    print(f"{document['ended']}{'' if document['complete'] else done}")
    print_pauses(document)
    print(document["left"])
    cycles = document["cycles"]
    print(
        f"{cycles['cycles']} cycles, {cycles['missed']} skipped for lateness, {cycles['incomplete']} lack an answer; "
        f"the latest began {cycles['worst_late_ms']:.1f} ms late"
    )
    wire = document["wire"]
    print(f"{wire['cycle_ms']:.2f} ms of each {wire['period_ms']:.2f} ms on the wire")
    if left_out := cycles["stale"] + cycles["impossible"]:
        print(
            f"{left_out} readings are left out: {cycles['stale']} came late, of an earlier cycle, "
            f"{cycles['impossible']} cannot be true"
        )
    if lost := cycles["samples_lost"]:
        print(f"{lost} samples of the IMU are lost: its board did not read them in time; restart it, or flash it anew")
    for one in document.get("doubts", []):
        print(f"DOUBT: {one['sentence']}")
    print(document["recording"] or "no group is whole, so there is no recording")
