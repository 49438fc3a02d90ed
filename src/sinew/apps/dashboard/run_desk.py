"""Runs from the dashboard: begun, steered and followed to their end, one at a time.

A run is a process of its own that outlives us. What it is told goes through its control socket; what it records goes
into its journal without us.
"""

import json
import os
import resource
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import psutil

from sinew.apps.bench.bench_run import JOURNAL
from sinew.apps.bench.run_control import CONTROL, own_text
from sinew.apps.dashboard.operators import RefusedError, is_run_name, open_inside, require_run_name, unlinked
from sinew.bench.record.journal import JournalReader, summarise_journal
from sinew.measure.errors import SinewError, SpecError
from sinew.plan.plan import require_motors
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_plan, parse_rig

# Other processes that the dashboard holds on to: those it began, and those that a steward before it began.

UNKNOWN = 1 << 16
"""Stands for an exit status that nobody can tell."""

_END_LOOK_S = 0.005
_READ_S, _READ_CPU_S = 120.0, 20
_READ_BYTES = 1 << 30
_READ_HERE = 48 * 1024  # characters; a rig with a calibration has some twelve thousand
_BEGAN_S = 2.0  # the system counts from its own start, whose date moves a little with the clock


class Process(Protocol):
    """A process that may be looked at and ended; `subprocess.Popen` is one."""

    @property
    def pid(self) -> int:
        """Return its number."""

    def poll(self) -> int | None:
        """Return its exit status, or None while it goes on."""

    def send_signal(self, sig: int) -> None:
        """Send it a signal, where it goes on."""


class Adopted:
    """A process that is not our child, so that its exit status stays unknown.

    A number may be given to another process once its owner is gone. Where the system has descriptors of processes
    (Linux), one keeps us from ending the wrong one.
    """

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._file = os.pidfd_open(pid) if sys.platform == "linux" else None

    @property
    def pid(self) -> int:
        """Return its number."""
        return self._pid

    def poll(self) -> int | None:
        """Return `UNKNOWN` once it has ended, else None."""
        if self._file is not None:
            ready = select.poll()
            ready.register(self._file, select.POLLIN)
            return UNKNOWN if ready.poll(0) else None
        try:
            os.kill(self._pid, 0)
        except ProcessLookupError:
            return UNKNOWN
        return None

    def send_signal(self, sig: int) -> None:
        """Send it a signal, where it goes on."""
        with suppress(ProcessLookupError):
            if self._file is not None:
                signal.pidfd_send_signal(self._file, sig)
            else:
                os.kill(self._pid, sig)

    def close(self) -> None:
        """Let go of it; it goes on."""
        if self._file is not None:
            os.close(self._file)
            self._file = None


def sinew_command(*words: str) -> list[str]:
    """Return the command line of a `sinew` command under this interpreter, without what lies in the present folder."""
    return [sys.executable, "-P", "-c", "import sys; from sinew.apps.cli import main; sys.exit(main())", *words]


def spawn(command: Sequence[str], log: Path) -> "subprocess.Popen[bytes]":
    """Begin a process that outlives us and our terminal; what it says goes into a file."""
    with log.open("ab") as file:
        return subprocess.Popen(
            list(command), stdin=subprocess.DEVNULL, stdout=file, stderr=subprocess.STDOUT, start_new_session=True
        )


class Specs(NamedTuple):
    """What is known of a run's plan and rig. plan: its name. sways: whether its head bends or sways."""

    plan: str
    sways: bool
    rig: RigSpec


def read_specs(plan: str, rig: str) -> Specs:
    """Return what two texts hold; long ones are read by a process of its own.

    What others wrote may keep its reader busy, or fill its memory; whoever answers for the stop reads no more of it
    than takes some hundredths of a second. Raises SpecError where a text is none, its plan drives as no bench does, or
    its reader takes too long.
    """
    if len(plan) + len(rig) <= _READ_HERE:
        return Specs(*_plan_in_brief(plan), parse_rig(rig, "the rig"))
    asked = json.dumps({"plan": plan, "rig": rig})
    command = [sys.executable, "-P", "-c", f"from {__name__} import answer_specs; answer_specs()"]
    try:
        done = subprocess.run(command, input=asked, capture_output=True, text=True, timeout=_READ_S, check=False)
        told = json.loads(done.stdout)
    except (subprocess.TimeoutExpired, ValueError, OSError) as trouble:
        raise SpecError("the plan or the rig takes too long or too much memory to read; make it shorter") from trouble
    if "trouble" in told:
        raise SpecError(told["trouble"])
    return Specs(told["plan"], told["sways"], RigSpec.model_validate_json(told["rig"]))


def _plan_in_brief(text: str) -> tuple[str, bool]:
    """Return (name, whether the head bends or sways) of the plan of a text that a bench can run. Raises SpecError."""
    plan = parse_plan(text, "the plan")
    require_motors(plan, "the bench")
    return plan.name, plan.is_spatial


def answer_specs() -> None:
    """Read what `read_specs` asks on stdin, and answer on stdout."""
    for what, most in ((resource.RLIMIT_DATA, _READ_BYTES), (resource.RLIMIT_CPU, _READ_CPU_S)):
        _, hard = resource.getrlimit(what)
        resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))
    asked = json.load(sys.stdin)
    try:
        (name, sways), rig = _plan_in_brief(asked["plan"]), parse_rig(asked["rig"], "the rig")
        told = {"plan": name, "sways": sways, "rig": rig.model_dump_json()}
    except SpecError as trouble:
        told = {"trouble": str(trouble)}
    print(json.dumps(told))


def write_pid(file: Path, pid: int) -> None:
    """Write down which process belongs to a folder, and when it began, for a steward after us. Raises OSError."""
    try:
        began = psutil.Process(pid).create_time()
    except psutil.Error as error:
        raise OSError(f"process {pid} is gone: {error}") from error
    file.unlink(missing_ok=True)
    with file.open("x", encoding="utf-8") as made:
        made.write(f"{pid} {began!r}\n")


def read_pid(file: Path) -> tuple[int, float] | None:
    """Return (number, begin [s since 1970]) of the process in a file of ours, or None where there is none."""
    try:
        pid, began = own_text(file).split()
        return int(pid), float(began)
    except (OSError, ValueError):
        return None


def adopt(pid: int, words: Sequence[str], began: float | None = None) -> Adopted | None:
    """Return the process of that number; None where it is gone, another one has the number, or it is not our own.

    words: each an argument of its command line. began: when it began [s since 1970]; None where the number comes from
    the system, and not out of a file.
    """
    if pid <= 1:
        return None
    try:
        process = Adopted(
            pid
        )  # from here on the number cannot come to mean another one where the system has descriptors
    except OSError:
        return None
    if process.poll() is None and _is_ours(pid, words, began):
        return process
    process.close()
    return None


def adopt_from(file: Path, words: Sequence[str]) -> Adopted | None:
    """Return the process that a file of ours names, as `adopt` does."""
    named = read_pid(file)
    return None if named is None else adopt(named[0], words, named[1])


def _is_ours(pid: int, words: Sequence[str], began: float | None) -> bool:
    try:
        process = psutil.Process(pid)
        is_same = began is None or abs(process.create_time() - began) < _BEGAN_S
        return is_same and process.uids().real == os.getuid() and set(words) <= set(process.cmdline())
    except psutil.Error:
        return False


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


# A run gets its folder, and where runs that are under way are found again.

PID = "run.pid"
"""Name of the file in a run's folder that holds the number of its process."""

LOG = "run.log"
"""Name of the file in a run's folder that holds what it said."""

_MOST_LOG = 256 * 1024  # bytes of its end

RESUMED = "--- the run is taken up again ---"
"""Line of a run's log between what it said before and after it was taken up again."""

Control = Callable[..., dict[str, Any]]
"""What asks a run for something: (folder, command, timeout_s) -> answer; raises a SinewError if nobody listens."""


@dataclass(frozen=True)
class Run:
    """A run that was begun here, or by a steward before. started: [s since 1970]."""

    name: str
    folder: Path
    process: Process
    started: float
    plan: str
    rig: str
    spec: RigSpec


def make_folder(runs: Path, name: str, plan: str, rig: str) -> Path:
    """Return the new folder of a run, with the texts of its plan and rig in it.

    Raises RefusedError where the name is none (422), is in use (409) or the disk takes no folder (409).
    """
    folder = runs / require_run_name(name)
    try:
        folder.mkdir()
        (folder / "plan.toml").write_text(plan, encoding="utf-8")
        (folder / "rig.toml").write_text(rig, encoding="utf-8")
    except FileExistsError:
        raise RefusedError(409, f"there is a run {name} already; choose another name") from None
    except OSError as error:
        raise RefusedError(
            409, f"cannot write {folder}: {error.strerror}; make space, or choose other --runs"
        ) from error
    return folder


class Way(NamedTuple):
    """The way to a bench. port: its name. wait_s: how long a run waits for the port to appear [s]."""

    port: str
    wait_s: float = 0.0


def run_words(folder: Path, way: Way) -> list[str]:
    """Return what stands behind `sinew` to run what lies in a folder on a bench."""
    texts = (str(folder / "plan.toml"), "--rig", str(folder / "rig.toml"))
    waiting = ("--wait", f"{way.wait_s:g}") if way.wait_s else ()
    return ["run", *texts, "--port", way.port, *waiting, "--out", str(folder), "--json"]


def find_runs(runs: Path, control: Control) -> Iterator[Run]:
    """Give the runs below a folder that are under way: those that answer, and those whose process is there."""
    for folder in sorted({file.parent for name in (CONTROL, PID) for file in runs.glob(f"[!.]*/{name}")}):
        if not _is_unlinked(folder):
            continue
        process = adopt_from(folder / PID, [str(folder)]) or _answering(folder, control)
        if process is None:
            continue
        try:
            specs = read_specs(*_texts(folder))
        except SinewError:
            continue
        began = folder / "plan.toml" if (folder / "plan.toml").exists() else folder / CONTROL
        started = began.stat().st_mtime
        yield Run(folder.name, folder, process, started, specs.plan, specs.rig.name, specs.rig)


def _is_unlinked(folder: Path) -> bool:
    try:
        return unlinked(folder) is folder
    except SinewError:
        return False


def told_at_end(folder: Path) -> str | None:
    """Return how a run that has ended says that it ended, or None where it said nothing."""
    try:
        with open_inside(folder.parent, folder / LOG) as file:
            file.seek(max(0, os.fstat(file.fileno()).st_size - _MOST_LOG))
            lines = file.read(_MOST_LOG).decode("utf-8", "replace").splitlines()
    except (OSError, SinewError):
        return None
    lines = lines[max((number + 1 for number, line in enumerate(lines) if line == RESUMED), default=0) :]
    starts = [number for number, line in enumerate(lines) if line == "{"]
    if starts:
        try:
            told, _ = json.JSONDecoder().raw_decode("\n".join(lines[starts[-1] :]))
            return f"{told['ended']}; {told['left']}"
        except (ValueError, KeyError, TypeError):
            pass
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


def texts_to_go_on(runs: Path, name: str) -> tuple[Path, str, str]:
    """Return the folder of a run that ended early, and its plan and rig, which lie in it as files afterwards.

    Raises RefusedError where there is no such run (404), or nothing of it is left to do (409).
    """
    folder = runs / name
    if not is_run_name(name) or not _is_unlinked(folder) or not (folder / JOURNAL).is_file():
        raise RefusedError(404, "found no run of that name to go on with; the page Runs lists them")
    if not ending_of(folder)["can_resume"]:
        raise RefusedError(409, f"nothing of the run {name} is left to do; start another")
    try:
        texts = _texts(folder)
        for file, text in zip(("plan.toml", "rig.toml"), texts, strict=True):
            if not (folder / file).exists():
                (folder / file).write_text(text, encoding="utf-8")
    except OSError as error:
        raise RefusedError(409, f"cannot write into {folder}: {error.strerror}; make space") from error
    except SinewError as error:
        raise RefusedError(409, str(error)) from error
    return folder, *texts


def _texts(folder: Path) -> tuple[str, str]:
    """Return plan and rig of a run: their files, or what its journal holds where it was begun in a terminal.

    Raises FileError where there are neither.
    """
    try:
        plan, rig = (folder / name for name in ("plan.toml", "rig.toml"))
        return plan.read_text(encoding="utf-8"), rig.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        with JournalReader(folder / JOURNAL) as journal:
            return journal.plan_toml, journal.rig_toml


def _answering(folder: Path, control: Control) -> Process | None:
    if not (folder / CONTROL).exists():
        return None
    try:
        pid = control(folder, "status", timeout_s=0.5).get("peer")  # as the system has it, whatever the answer says
    except SinewError:
        return None
    return adopt(pid, []) if isinstance(pid, int) else None


_LOOK_S = 0.1
_ASK_EVERY = 10  # looks
_ANSWER_S = 1.0
_ENDS_S = 5.0


class RunDesk:
    """The run under way, and the one before.

    runs: folder of the runs' folders. control: asks a run. command: turns what stands behind `sinew` into a command.
    """

    def __init__(self, runs: Path, control: Control, command: Callable[..., list[str]]) -> None:
        self._runs, self._control, self._command = runs, control, command
        self._lock = threading.Lock()
        self._run: Run | None = None
        self._spec: RigSpec | None = None
        self._told: dict[str, Any] = {}
        self._is_starting = False
        self._moved: set[str] = set()  # names of runs that are being renamed, put away or taken back
        self._alarms = 0
        self.newest_s = 0.0  # when a run was begun, gone on with or found last [s since 1970]
        self._unanswered = 0
        self._over = threading.Event()
        self._watch = threading.Thread(target=self._follow, name="runs", daemon=True)
        self.last: dict[str, Any] | None = None
        self.beginning: str | None = None  # name of the run that is being begun

    def open(self) -> None:
        """Find a run that is under way already, and follow what there is from now on."""
        self._find()
        self._watch.start()

    def close(self) -> None:
        """Follow no longer; a run under way goes on."""
        self._over.set()
        if self._watch.is_alive():
            self._watch.join()

    @property
    def run(self) -> Run | None:
        """The run under way, or None."""
        return self._run

    @property
    def is_idle(self) -> bool:
        """Whether no run is under way or being begun."""
        return self._run is None and not self._is_starting

    @property
    def spec(self) -> RigSpec | None:
        """The rig of the run under way or of the last one: how the bench is wired, as far as we know."""
        return self._spec

    def alarm(self) -> Run | None:
        """Return the run under way, and let none begin that is being begun right now."""
        with self._lock:
            self._alarms += 1
            return self._run

    def start(self, name: str, plan: str, rig: str, bench: Callable[[Specs], Way]) -> str:
        """Begin a run, and return a sentence. Raises RefusedError.

        name: of its folder. plan, rig: TOML texts. bench: gives the way to one that can run them, or raises. While one
        is begun or under way, another is refused.
        """

        def begin() -> tuple[Run, str]:
            specs = _parsed(plan, rig)
            way = bench(specs)
            folder = make_folder(self._runs, name, plan, rig)
            return self._spawn(folder, run_words(folder, way), specs), f"the run {name} begins{_once(way)}"

        return self._one(name, begin)

    def go_on(self, name: str, bench: Callable[[Specs], Way]) -> str:
        """Go on with a run that ended early, and return a sentence; as `start`. Raises RefusedError."""

        def begin() -> tuple[Run, str]:
            folder, plan, rig = texts_to_go_on(self._runs, name)
            specs = _parsed(plan, rig)
            way = bench(specs)
            with (folder / LOG).open("a", encoding="utf-8") as log:
                log.write(f"{RESUMED}\n")
            words = [*run_words(folder, way), "--resume"]
            return self._spawn(folder, words, specs), f"the run {name} goes on{_once(way)}"

        return self._one(name, begin)

    def _one(self, name: str, begin: Callable[[], tuple[Run, str]]) -> str:
        """Have a run begin, unless there is one, or an emergency comes in between; return what it says of it."""
        with self._lock:
            if self._run is not None or self._is_starting:
                raise RefusedError(409, f"a run {'is being begun' if self._run is None else self._run.name} already")
            if name in self._moved:
                raise RefusedError(409, f"the run {name} is being renamed or put away; the page Runs lists what is")
            self._is_starting, self.beginning, alarms = True, name, self._alarms
        try:
            run, sentence = begin()
            with self._lock:
                is_late = self._alarms != alarms
                if not is_late:
                    self._hold(run, "starting")
            if is_late:
                end_process(run.process, 0.0, signal.SIGKILL)
                (run.folder / PID).unlink(missing_ok=True)
                raise RefusedError(409, "an emergency stop came in between; the run was ended before it began")
        finally:
            self._is_starting, self.beginning = False, None
        return sentence

    @contextmanager
    def apart(self, *names: str) -> Iterator[None]:
        """Keep runs of some names from being begun, or gone on with, until they are moved.

        Raises RefusedError where one of them is under way, begins, or is being moved already.
        """
        with self._lock:
            busy = {self.beginning, self._run and self._run.name, *self._moved} & set(names)
            if busy:
                raise RefusedError(409, f"the run {busy.pop()} is under way; end it first")
            self._moved |= set(names)
        try:
            yield
        finally:
            with self._lock:
                self._moved -= set(names)

    def forget(self, name: str, to: str | None) -> None:
        """Hear that a run that has ended is called otherwise now, or None: lies in the bin."""
        last = self.last
        if last is not None and last["name"] == name:
            self.last = None if to is None else last | {"name": to, "folder": str(self._runs / to)}

    def tell(self, command: str) -> str:
        """Tell the run under way something, and return what it answers. Raises RefusedError where it does not do it."""
        run = self._run
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
        run = self._run
        return None if run is None else _document(run, self._told)

    def _spawn(self, folder: Path, words: list[str], specs: Specs) -> Run:
        try:
            process = spawn(self._command(*words), folder / LOG)
            try:
                write_pid(folder / PID, process.pid)
            except OSError:
                end_process(process, _ENDS_S)  # no steward after us would find it
                raise
        except OSError as trouble:
            raise RefusedError(409, f"cannot begin a process in {folder}: {trouble.strerror}") from trouble
        return Run(folder.name, folder, process, time.time(), specs.plan, specs.rig.name, specs.rig)

    def _follow(self) -> None:
        looks = 0
        while not self._over.wait(_LOOK_S):
            looks += 1
            run = self._run
            if run is None:
                if looks % _ASK_EVERY == 0 and not self._is_starting:
                    self._find()
            elif (status := run.process.poll()) is not None:
                self._end(run, status)
            elif looks % _ASK_EVERY == 0:
                self._ask(run)

    def _find(self) -> None:
        try:
            found = next(find_runs(self._runs, self._control), None)
        except OSError:
            return  # a folder went away meanwhile; the next look sees what is left
        with self._lock:
            if found is not None and self._run is None and not self._is_starting:
                self._hold(found, "found")

    def _hold(self, run: Run, state: str) -> None:
        self._run, self._spec, self._told, self.newest_s = run, run.spec, {"state": state}, time.time()

    def _ask(self, run: Run) -> None:
        try:
            self._note(self._control(run.folder, "status", timeout_s=_ANSWER_S))
        except SinewError:
            if self._told.get("state") == "starting":
                return
            if not (run.folder / CONTROL).exists():  # it listens as long as it holds the bench
                self._told = {"state": "finishing", "sentence": "the bench is at rest; the recording is written"}
                return
            self._unanswered += 1
            if self._unanswered > 1:  # between the two it may have been about to end
                self._told = {"state": "silent", "sentence": "the run does not answer"}

    def _note(self, answer: dict[str, Any]) -> None:
        self._unanswered = 0
        state = answer.get("state")
        at = state if isinstance(state, dict) else {}
        told = str(at.get("state") or "running")
        if told == "running" and at.get("pause_asked") is True:
            told = "pausing"
        self._told = {"state": told, "sentence": str(answer.get("sentence", ""))}

    def _end(self, run: Run, status: int) -> None:
        (run.folder / PID).unlink(missing_ok=True)
        how = f"the run was ended by {signal.Signals(-status).name}" if status < 0 else told_at_end(run.folder)
        told = {"state": "ended", "sentence": how or "the run has ended"}
        known = None if status == UNKNOWN else status
        self.last = _document(run, told) | {"exit": known, "ended": time.time()} | ending_of(run.folder)
        self._run = None


def _once(way: Way) -> str:
    return " once the emulated bench is there, which is begun anew for it" if way.wait_s else ""


def _parsed(plan: str, rig: str) -> Specs:
    """Return what two texts hold. Raises RefusedError where they are not valid."""
    try:
        return read_specs(plan, rig)
    except SpecError as trouble:
        raise RefusedError(422, str(trouble)) from trouble


def _document(run: Run, told: dict[str, Any]) -> dict[str, Any]:
    return {
        "name": run.name,
        "folder": str(run.folder),
        "state": told.get("state", "running"),
        "started": run.started,
        "plan": run.plan,
        "rig": run.rig,
        "pid": run.process.pid,
        "sentence": told.get("sentence", ""),
    }
