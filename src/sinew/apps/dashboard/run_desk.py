"""Runs from the dashboard: begun, steered and followed to their end, one at a time; and the stop that needs none.

A run is a process of its own, and a child of ours: where we die it stops, and `--resume` goes on. What it is told goes
through its control socket; what it records goes into its journal without us.
"""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from sinew.apps.bench.bench_run import JOURNAL, open_rig
from sinew.apps.bench.run_control import CONTROL
from sinew.apps.dashboard.folders import RefusedError, is_run_name, open_inside, require_run_name, unlinked
from sinew.bench.record.journal import summarise_journal
from sinew.bench.stops import StopReport, stop
from sinew.hardware import ports as _ports  # noqa: F401 - open_rig imports it late
from sinew.measure.errors import PortError, SinewError, SpecError
from sinew.plan.plan import require_motors
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_plan, parse_rig

Process = subprocess.Popen[bytes]

_END_LOOK_S = 0.005
_MOST_TEXT = 48 * 1024
"""Characters of a plan and its rig; one with a calibration has some twelve thousand. Whoever answers for the stop reads
no more than takes some hundredths of a second."""


def sinew_command(*words: str) -> list[str]:
    """Return the command line of a `sinew` command under this interpreter, without what lies in the present folder."""
    return [sys.executable, "-P", "-m", "sinew.apps.dashboard", *words]


def spawn(command: Sequence[str], log: Path) -> Process:
    """Begin a process that outlives our terminal; its stdin ends when we do. What it says goes into a file.

    The pipe is unbuffered: what a process that has died did not take is not tried again when its stdin is closed.
    """
    with log.open("ab") as file:
        return subprocess.Popen(
            list(command),
            bufsize=0,
            stdin=subprocess.PIPE,
            stdout=file,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )


def await_end(process: Process, seconds: float) -> bool:
    """Return whether a process ends within so many seconds."""
    end = time.monotonic() + seconds
    while process.poll() is None:
        if time.monotonic() >= end:
            return False
        time.sleep(_END_LOOK_S)
    return True


def end_process(process: Process, seconds: float, first: int = signal.SIGTERM) -> None:
    """End a process: politely, and by force after so many seconds."""
    process.send_signal(first)
    if not await_end(process, seconds):
        process.send_signal(signal.SIGKILL)
        await_end(process, 1.0)
    let_go(process)


def let_go(process: Process) -> None:
    """Close our end of the stdin of a process, which ends it if it goes on."""
    if process.stdin is not None:
        with suppress(OSError):
            process.stdin.close()


# A run has a plan, a rig, a way to its bench, and a folder.


class Specs(NamedTuple):
    """What is known of a run's plan and rig. plan: its name. sways: whether its head bends or sways."""

    plan: str
    sways: bool
    rig: RigSpec


def read_specs(plan: str, rig: str) -> Specs:
    """Return what two texts hold.

    Raises SpecError where a text is none or too long, or its plan drives as no bench does.
    """
    if len(plan) + len(rig) > _MOST_TEXT:
        raise SpecError(
            f"the plan and the rig have {len(plan) + len(rig)} characters, expected at most {_MOST_TEXT}; "
            "make the plan shorter, or run it with `sinew run`"
        )
    parsed = parse_plan(plan, "the plan")
    require_motors(parsed, "the bench")
    return Specs(parsed.name, parsed.is_spatial, parse_rig(rig, "the rig"))


class BenchPort(NamedTuple):
    """The way to a bench. port: its name. wait_s: how long a run waits for the port to appear [s].

    trouble: says why there will be no port, or None.
    """

    port: str
    wait_s: float = 0.0
    trouble: Callable[[], str | None] = lambda: None


LOG = "run.log"
"""Name of the file in a run's folder that holds what it said."""

RESUMED = "--- the run is taken up again ---"
"""Line of a run's log between what it said before and after it was taken up again."""

_MOST_LOG = 256 * 1024  # bytes of its end
_LOOK_S = 0.1
_ASK_EVERY = 10  # looks
_ANSWER_S = 1.0

Control = Callable[..., dict[str, Any]]
"""What asks a run for something: (folder, command, timeout_s) -> answer; raises a SinewError if nobody listens."""


@dataclass(frozen=True)
class Run:
    """A run that was begun here. started: [s since 1970]."""

    folder: Path
    process: Process
    started: float
    specs: Specs
    bench: BenchPort

    @property
    def name(self) -> str:
        """The name of its folder."""
        return self.folder.name

    def document(self, status_now: dict[str, Any]) -> dict[str, Any]:
        """Return the run as the status tells it. status_now: state and sentence."""
        return {
            "name": self.name,
            "folder": str(self.folder),
            "started": self.started,
            "plan": self.specs.plan,
            "rig": self.specs.rig.name,
            "pid": self.process.pid,
            **status_now,
        }


def running_elsewhere(runs: Path, control: Control) -> Path | None:
    """Return the folder of a run that answers to its control and was not begun here, as one in a terminal."""
    for file in sorted(runs.glob(f"[!.]*/{CONTROL}")):
        with suppress(SinewError):
            control(unlinked(file.parent), "status", timeout_s=_ANSWER_S)
            return file.parent
    return None


def ending_sentence(folder: Path, log: str = LOG) -> str | None:
    """Return how a run, or what writes another log, says that it ended, or None where it said nothing."""
    try:
        with open_inside(folder.parent, folder / log) as file:
            file.seek(max(0, os.fstat(file.fileno()).st_size - _MOST_LOG))
            lines = file.read(_MOST_LOG).decode("utf-8", "replace").splitlines()
    except (OSError, SinewError):
        return None
    lines = lines[max((number + 1 for number, line in enumerate(lines) if line == RESUMED), default=0) :]
    starts = [number for number, line in enumerate(lines) if line == "{"]
    if starts:
        with suppress(ValueError, KeyError, TypeError):
            ending, _ = json.JSONDecoder().raw_decode("\n".join(lines[starts[-1] :]))
            return f"{ending['ended']}; {ending['left']}"
    said = [line.strip() for line in lines if line.strip()]
    return said[-1].removeprefix("sinew: ") if said else None


def ending_of(folder: Path) -> dict[str, Any]:
    """Return how far a run came that has ended: whether it is `complete`, `can_resume`, `groups_done`, `groups`.

    Where it left no journal nothing has moved: there is nothing to go on with, and the two numbers are None.
    """
    try:
        journal = summarise_journal(folder / JOURNAL)
        groups = len(parse_plan(journal.plan_toml, "the journal's plan").groups())
    except SinewError:
        return {"complete": False, "can_resume": False, "groups_done": None, "groups": None}
    done = journal.finished
    return {"complete": done >= groups, "can_resume": done < groups, "groups_done": done, "groups": groups}


class RunDesk:
    """The run under way, and the one before.

    runs: folder of the runs' folders. control: asks a run. command: turns what stands behind `sinew` into a command.
    run: the one under way, or None; last: the one before, as the status tells it. rig: of the newest, how the bench is
    wired as far as we know. newest_s: when it was begun or gone on with [s since 1970]. elsewhere: the folder of a run
    that was begun in a terminal and goes on.
    """

    def __init__(self, runs: Path, control: Control, command: Callable[..., list[str]]) -> None:
        self._runs, self._control, self._command = runs, control, command
        self._lock = threading.Lock()
        self._status: dict[str, Any] = {}
        self._is_starting = False
        self._alarms = self._unanswered = 0
        self._over = threading.Event()
        self._watch = threading.Thread(target=self._follow, name="runs", daemon=True)
        self.run: Run | None = None
        self.last: dict[str, Any] | None = None
        self.rig: RigSpec | None = None
        self.newest_s = 0.0
        self.elsewhere: Path | None = None

    def open(self) -> None:
        """Follow what there is from now on."""
        self._watch.start()

    def close(self) -> None:
        """Follow no longer; a run under way goes on."""
        self._over.set()
        if self._watch.is_alive():
            self._watch.join()

    @property
    def is_idle(self) -> bool:
        """Whether no run is under way or being begun."""
        return self.run is None and not self._is_starting

    def alarm(self) -> Run | None:
        """Return the run under way, and let none begin that is being begun right now."""
        with self._lock:
            self._alarms += 1
            return self.run

    def start(self, name: str, plan: str, rig: str, bench: Callable[[Specs], BenchPort]) -> str:
        """Begin a run, and return a sentence. Raises RefusedError.

        name: of its folder. plan, rig: TOML texts. bench: gives the way to one that can run them, or raises. While one
        is begun or under way, another is refused.
        """

        def prepare() -> tuple[Path, Specs, BenchPort]:
            specs, folder = read_specs(plan, rig), self._runs / require_run_name(name)
            if os.path.lexists(folder):
                raise RefusedError(409, f"there is a run {name} already; choose another name")
            bench_port = bench(specs)
            folder.mkdir()
            _write_texts(folder, plan, rig)
            return folder, specs, bench_port

        return self._begin(prepare, f"the run {name} begins")

    def go_on(self, name: str, bench: Callable[[Specs], BenchPort]) -> str:
        """Go on with a run that ended early, and return a sentence; as `start`. Raises RefusedError."""
        folder = self._runs / name
        if not is_run_name(name) or not (folder / JOURNAL).is_file():
            raise RefusedError(404, "found no run of that name to go on with; the page Runs lists them")

        def prepare() -> tuple[Path, Specs, BenchPort]:
            journal = summarise_journal(unlinked(folder) / JOURNAL)  # also of a run that was begun in a terminal
            if not ending_of(folder)["can_resume"]:
                raise RefusedError(409, f"nothing of the run {name} is left to do; start another")
            specs = read_specs(journal.plan_toml, journal.rig_toml)
            bench_port = bench(specs)
            _write_texts(folder, journal.plan_toml, journal.rig_toml)
            with (folder / LOG).open("a", encoding="utf-8") as log:
                log.write(f"{RESUMED}\n")
            return folder, specs, bench_port

        return self._begin(prepare, f"the run {name} goes on", "--resume")

    def _begin(self, prepare: Callable[[], tuple[Path, Specs, BenchPort]], sentence: str, *more: str) -> str:
        """Have a run begin, unless there is one, or an emergency comes in between; return what is to be said of it."""
        with self._lock:
            if not self.is_idle:
                raise RefusedError(409, f"a run {'is being begun' if self.run is None else self.run.name} already")
            self._is_starting, alarms = True, self._alarms
        try:
            folder, specs, bench_port = prepare()
            words = ["run", str(folder / "plan.toml"), "--rig", str(folder / "rig.toml"), "--port", bench_port.port]
            words += ["--wait", f"{bench_port.wait_s:g}"] if bench_port.wait_s else []
            process = spawn(self._command(*words, "--out", str(folder), "--json", *more), folder / LOG)
            with self._lock:
                is_late = self._alarms != alarms
                if not is_late:
                    self.run, self.rig = Run(folder, process, time.time(), specs, bench_port), specs.rig
                    self._status, self.newest_s = {"state": "starting", "sentence": ""}, time.time()
            if is_late:
                end_process(process, 0.0, signal.SIGKILL)
                raise RefusedError(409, "an emergency stop came in between; the run was ended before it began")
        except OSError as trouble:
            raise RefusedError(
                409, f"cannot begin a run in {self._runs}: {trouble.strerror}; make space, or choose other --runs"
            ) from trouble
        except RefusedError:
            raise
        except SinewError as trouble:
            raise RefusedError(422 if isinstance(trouble, SpecError) else 409, str(trouble)) from trouble
        finally:
            self._is_starting = False
        return sentence

    def tell(self, command: str) -> str:
        """Tell the run under way something, and return what it answers. Raises RefusedError where it does not do it."""
        run = self.run
        if run is None:
            raise RefusedError(409, "no run is under way")
        try:
            answer = self._control(run.folder, command, timeout_s=_ANSWER_S)
        except SinewError as trouble:
            if command != "stop":
                raise RefusedError(409, str(trouble)) from trouble
            run.process.send_signal(signal.SIGTERM)
            return f"the run {run.name} does not answer yet; it was asked to end by a signal"
        sentence = str(answer.get("sentence", ""))
        if answer.get("ok") is not True:
            raise RefusedError(409, sentence or f"the run refuses to {command}")
        self._note(answer)
        return sentence

    def document(self) -> dict[str, Any] | None:
        """Return the run under way as the status tells it, or None."""
        run = self.run
        return None if run is None else run.document(self._status)

    def _follow(self) -> None:
        looks = 0
        while not self._over.wait(_LOOK_S):
            looks += 1
            run = self.run
            trouble = run.bench.trouble() if run is not None and self._status["state"] == "starting" else None
            if run is None:
                if looks % _ASK_EVERY == 0:
                    self.elsewhere = running_elsewhere(self._runs, self._control)
            elif (status := run.process.poll()) is not None:
                let_go(run.process)
                how = trouble or (
                    f"the run was ended by {signal.Signals(-status).name}"
                    if status < 0
                    else ending_sentence(run.folder)
                )
                ended = {"state": "ended", "sentence": how or "the run has ended"}
                self.last = run.document(ended) | {"exit": status, "ended": time.time()} | ending_of(run.folder)
                self.run = None
            elif trouble is not None:
                end_process(run.process, _DIES_S)  # it waits for the port
            elif looks % _ASK_EVERY == 0:
                self._ask(run)

    def _ask(self, run: Run) -> None:
        try:
            self._note(self._control(run.folder, "status", timeout_s=_ANSWER_S))
        except SinewError:
            if self._status["state"] == "starting":
                return
            if not (run.folder / CONTROL).exists():  # it listens as long as it holds the bench
                self._status = {"state": "finishing", "sentence": "the bench is at rest; the recording is written"}
                return
            self._unanswered += 1
            if self._unanswered > 1:  # between the two it may have been about to end
                self._status = {"state": "silent", "sentence": "the run does not answer"}

    def _note(self, answer: dict[str, Any]) -> None:
        self._unanswered = 0
        state = answer.get("state")
        at = state if isinstance(state, dict) else {}
        phase = str(at.get("state") or "running")
        if phase == "running" and at.get("pause_asked") is True:
            phase = "pausing"
        self._status = {"state": phase, "sentence": str(answer.get("sentence", ""))}


def _write_texts(folder: Path, plan: str, rig: str) -> None:
    """Write plan and rig into a run's folder, where they do not lie there yet."""
    for name, text in (("plan.toml", plan), ("rig.toml", rig)):
        if not (folder / name).exists():
            (folder / name).write_text(text, encoding="utf-8")


# The emergency stop: a bench brought to rest at once, whatever else is going on.
#
# A thread is kept for it, so that nothing can queue before it, and everything it needs is loaded beforehand. A run that
# is under way is asked first, for it holds the port; where it does not confirm in time its process is ended, whereupon
# the motors' own watchdogs act within 0.1 s, and the bench is brought to its declared safe state from here.

CONFIRM_S = 0.15
"""Within so long a run must confirm that it has stopped [s]."""

_DIES_S = 1.0
_PORT_S = 0.5
_PORT_LOOK_S = 0.01

_SETTLES_S = 1.5  # for a run that answered, and asks a motor again that did not
_AGAIN_S = 0.05

Rest = Callable[[str, RigSpec, str | None, Callable[[StopReport], None], Callable[[], bool]], StopReport]
"""What brings the bench behind a port to a state, None for the rig's own.

(port, rig, state, on_frozen, is_emergency) -> report; the last is asked again while the tension is let down.
"""


@dataclass(frozen=True)
class Outcome:
    """How a stop went. at: [s since 1970]. took: until the motors stood still, else until we gave up [s].

    was_emergency: whether it was one, and no ordinary stop.
    """

    is_safe: bool
    sentence: str
    at: float
    took: float
    was_emergency: bool = True


class Order:
    """A stop that was ordered. answer: what can be told once the motors stand still. end: once all is done.

    is_emergency: whether the motors are to stand for a while before the tension is let down.
    """

    def __init__(self, is_emergency: bool) -> None:
        self.answer: Future[Outcome] = Future()
        self.end: Future[Outcome] = Future()
        self.is_emergency = is_emergency
        self._lock = threading.RLock()
        self._at, self._start = time.time(), time.monotonic()

    def join(self, is_emergency: bool) -> bool:
        """Return whether this order stands for another one, too: not if it has ended.

        An emergency makes an emergency of it. An answer from before says nothing then, for the motors move again.
        """
        with self._lock:
            if self.end.done():
                return False
            if is_emergency and not self.is_emergency:
                if self.answer.done():
                    self.answer, self._start = Future(), time.monotonic()
                self.is_emergency = True
            return True

    def tell(self, is_safe: bool, sentence: str) -> None:
        """Answer, where that was not done before."""
        with self._lock:
            if not self.answer.done():
                took = time.monotonic() - self._start
                self.answer.set_result(Outcome(is_safe, sentence, self._at, took, self.is_emergency))

    def close(self, is_safe: bool, sentence: str) -> Outcome:
        """Tell the end, and return it."""
        with self._lock:
            self.tell(is_safe, sentence)
            outcome = Outcome(is_safe, sentence, self._at, self.answer.result().took, self.is_emergency)
            self.end.set_result(outcome)
            return outcome


class Emergency:
    """The thread that brings a bench to rest. control: asks a run. rest: stops a bench that no run holds.

    elsewhere: gives the folder of a run that was begun in a terminal and may hold the bench, if any. is_emulated:
    whether the bench is, so that nothing moves where there is no port.
    """

    def __init__(
        self, control: Control, rest: Rest, elsewhere: Callable[[], Path | None], is_emulated: bool = False
    ) -> None:
        self._control, self._rest, self._elsewhere, self._is_emulated = control, rest, elsewhere, is_emulated
        self._thread = ThreadPoolExecutor(1, "emergency")
        self._thread.submit(int).result()
        self._lock = threading.Lock()
        self._order: Order | None = None
        self.last: Outcome | None = None

    @property
    def is_under_way(self) -> bool:
        """Whether the bench is being brought to rest right now."""
        order = self._order
        return order is not None and not order.end.done()

    def order(
        self, run: Run | None, port: str | None, spec: RigSpec, state: str | None = None, *, is_emergency: bool = True
    ) -> Order:
        """Bring the bench to rest, and return what will tell how that goes; a second order joins the first.

        run: that holds the port, if any. state: hold or release; None: the rig's own. is_emergency: the motors stand
        for a while before the tension is let down.
        """
        with self._lock:
            if self._order is None or not self._order.join(is_emergency):
                self._order = Order(is_emergency)
                self._thread.submit(self._act, self._order, run, port, spec, state)
            return self._order

    def close(self) -> None:
        """Let go of the thread once it has done its work."""
        self._thread.shutdown()

    def _act(self, order: Order, run: Run | None, port: str | None, spec: RigSpec, state: str | None) -> None:
        is_safe, sentence = False, "the stop broke off; switch the supply off"
        try:
            is_safe, sentence = self._stop(order, run, port, spec, state)
        finally:
            self.last = order.close(is_safe, sentence)

    def _stop(
        self, order: Order, run: Run | None, port: str | None, spec: RigSpec, state: str | None
    ) -> tuple[bool, str]:
        before = ""
        if run is not None and run.process.poll() is None:
            confirmed = self._confirmed(run.folder, run.process)
            if confirmed is not None:
                return True, confirmed
            run.process.send_signal(signal.SIGKILL)
            if not await_end(run.process, _DIES_S):
                return False, f"the run {run.name} does not end (process {run.process.pid}); switch the supply off"
            before = f"the run {run.name} did not confirm and was ended; "
        by_hand = self._ask_by_hand() if run is None else None
        if by_hand is not None and (port is None or self._is_emulated):  # only that run can have motors that move
            return by_hand
        if port is None:
            what = "emulated bench is there" if self._is_emulated else "bench is connected here"
            return bool(before) or self._is_emulated, f"{before}no {what}, so no motor was told anything"
        rig = spec if run is None else run.specs.rig

        def tell_frozen(report: StopReport) -> None:
            if len(report.frozen) == 1 + rig.tendons.count:
                order.tell(True, f"{before}all motors stand still; {state or rig.limits.safe_state} follows")

        try:
            report = self._rest(port, rig, state, tell_frozen, lambda: order.is_emergency)
        except SinewError as trouble:
            return by_hand or (False, f"{before}{trouble}; switch the supply off")  # that run holds the port
        return report.is_safe, f"{before}{report.sentence()}"

    def _confirmed(self, folder: Path, process: Process) -> str | None:
        """Return what a run says that confirms, else None.

        One that does not answer in time has no more; one that does, though a motor has not confirmed to it, goes on
        asking that motor, which is better than to end it.
        """
        end = time.monotonic() + _SETTLES_S
        while (answer := self._ask(folder)) is not None:
            is_safe, sentence = answer
            if is_safe:
                return sentence
            if time.monotonic() >= end or await_end(process, _AGAIN_S):
                break
        return None

    def _ask_by_hand(self) -> tuple[bool, str] | None:
        """Return what a run that was begun in a terminal says of an emergency; None where there is none."""
        folder = self._elsewhere()
        if folder is None:
            return None
        is_safe, sentence = self._ask(folder) or (False, "it does not answer; switch the supply off")
        return is_safe, f"the run {folder.name}, begun in a terminal: {sentence}"

    def _ask(self, folder: Path) -> tuple[bool, str] | None:
        """Return what a run answers within the time it has: whether the motors stand, and a sentence; else None.

        Nothing it does can hold us up.
        """
        answers: Future[tuple[bool, str] | None] = Future()

        def ask() -> None:
            try:
                answer = self._control(folder, "emergency", timeout_s=CONFIRM_S)
                answers.set_result((answer.get("ok") is True, str(answer.get("sentence", ""))))
            except Exception:  # whatever is wrong with the run, what comes next is its end
                answers.set_result(None)

        threading.Thread(target=ask, daemon=True).start()
        try:
            return answers.result(CONFIRM_S)
        except TimeoutError:
            return None


def bring_to_rest(
    port: str,
    spec: RigSpec,
    state: str | None,
    on_frozen: Callable[[StopReport], None],
    is_emergency: Callable[[], bool] = lambda: True,
) -> StopReport:
    """Bring the bench behind a port to a state, hold or release; None: the rig's declared one.

    on_frozen: called once the motors were told to stand still. is_emergency: whether they are to stand for a while
    before the tension is let down; it is asked again while that goes on. The port of a run that was ended may be taken
    for a moment yet. Raises PortError if it stays so.
    """
    end = time.monotonic() + _PORT_S
    while True:
        try:
            with open_rig(port, spec) as (bench, clock):
                declared = state or spec.limits.safe_state
                return stop(
                    bench, clock, declared, on_frozen, is_emergency=is_emergency(), emergency_requested=is_emergency
                )
        except PortError:
            if time.monotonic() >= end:
                raise
        time.sleep(_PORT_LOOK_S)
