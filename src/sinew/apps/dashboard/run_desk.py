"""This is where runs are begun, steered and followed to their end, one at a time.

A run is a process of its own that outlives us. What it is told goes through its control socket; what it records goes
into its journal without us.
"""

import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sinew.apps.dashboard.processes import UNKNOWN, end_process, read_specs, spawn, write_pid
from sinew.apps.dashboard.refusal import RefusedError
from sinew.apps.dashboard.run_folders import (
    LOG,
    PID,
    RESUMED,
    Control,
    Run,
    ending_of,
    find_runs,
    make_folder,
    run_words,
    texts_to_go_on,
    told_at_end,
)
from sinew.apps.run_control import CONTROL
from sinew.measure.errors import SinewError, SpecError
from sinew.plan.rig import RigSpec

__all__ = ["RunDesk"]

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
        self._alarms = 0
        self._unanswered = 0
        self._over = threading.Event()
        self._watch = threading.Thread(target=self._follow, name="runs", daemon=True)
        self.last: dict[str, Any] | None = None

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

    def start(self, name: str, plan: str, rig: str, port: str) -> str:
        """Begin a run on the bench behind a port, and return a sentence. Raises RefusedError.

        name: of its folder. plan, rig: TOML texts. While one is begun or under way, another is refused.
        """

        def begin() -> Run:
            plan_name, spec = _parsed(plan, rig)
            folder = make_folder(self._runs, name, plan, rig)
            return self._spawn(folder, run_words(folder, port), plan_name, spec)

        return self._one(begin, f"the run {name} begins")

    def go_on(self, name: str, port: str) -> str:
        """Go on with a run that ended early, on the bench behind a port, and return a sentence. Raises RefusedError."""

        def begin() -> Run:
            folder, plan, rig = texts_to_go_on(self._runs, name)
            plan_name, spec = _parsed(plan, rig)
            with (folder / LOG).open("a", encoding="utf-8") as log:
                log.write(f"{RESUMED}\n")
            return self._spawn(folder, [*run_words(folder, port), "--resume"], plan_name, spec)

        return self._one(begin, f"the run {name} goes on")

    def _one(self, begin: Callable[[], Run], sentence: str) -> str:
        """Have a run begin, unless there is one, or an emergency comes in between; return the sentence."""
        with self._lock:
            if self._run is not None or self._is_starting:
                raise RefusedError(409, f"a run {'is being begun' if self._run is None else self._run.name} already")
            self._is_starting, alarms = True, self._alarms
        try:
            run = begin()
            with self._lock:
                is_late = self._alarms != alarms
                if not is_late:
                    self._run, self._spec, self._told = run, run.spec, {"state": "starting"}
            if is_late:
                end_process(run.process, 0.0, signal.SIGKILL)
                (run.folder / PID).unlink(missing_ok=True)
                raise RefusedError(409, "an emergency stop came in between; the run was ended before it began")
        finally:
            self._is_starting = False
        return sentence

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

    def _spawn(self, folder: Path, words: list[str], plan: str, spec: RigSpec) -> Run:
        try:
            process = spawn(self._command(*words), folder / LOG)
            try:
                write_pid(folder / PID, process.pid)
            except OSError:
                end_process(process, _ENDS_S)  # no steward after us would find it
                raise
        except OSError as trouble:
            raise RefusedError(409, f"cannot begin a process in {folder}: {trouble.strerror}") from trouble
        return Run(folder.name, folder, process, time.time(), plan, spec.name, spec)

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
                self._run, self._spec, self._told = found, found.spec, {"state": "found"}

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


def _parsed(plan: str, rig: str) -> tuple[str, RigSpec]:
    """Return the plan's name and the rig that two texts hold. Raises RefusedError where they are not valid."""
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
