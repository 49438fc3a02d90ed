"""This is where a run gets its folder, and where runs that are under way are found again."""

import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sinew.apps.bench_run import JOURNAL
from sinew.apps.dashboard.names import is_run_name, open_inside, unlinked
from sinew.apps.dashboard.processes import Process, adopt, adopt_from, read_specs
from sinew.apps.dashboard.refusal import RefusedError
from sinew.apps.run_control import CONTROL
from sinew.bench.journal_reader import JournalReader
from sinew.bench.journal_summary import summarise_journal
from sinew.measure.errors import SinewError
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_plan

__all__ = [
    "LOG",
    "PID",
    "RESUMED",
    "Control",
    "Run",
    "ending_of",
    "find_runs",
    "make_folder",
    "run_words",
    "texts_to_go_on",
    "told_at_end",
]

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
    if not is_run_name(name):
        raise RefusedError(
            422,
            f"found {name[:100]!r} for a run's name, expected up to 80 letters, digits, '.', '_' or '-', "
            "the first a letter or a digit",
        )
    folder = runs / name
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


def run_words(folder: Path, port: str) -> list[str]:
    """Return what stands behind `sinew` to run what lies in a folder on the bench behind a port."""
    texts = (str(folder / "plan.toml"), "--rig", str(folder / "rig.toml"))
    return ["run", *texts, "--port", port, "--out", str(folder), "--json"]


def find_runs(runs: Path, control: Control) -> Iterator[Run]:
    """Give the runs below a folder that are under way: those that answer, and those whose process is there."""
    for folder in sorted({file.parent for name in (CONTROL, PID) for file in runs.glob(f"[!.]*/{name}")}):
        if not _is_unlinked(folder):
            continue
        process = adopt_from(folder / PID, [str(folder)]) or _answering(folder, control)
        if process is None:
            continue
        try:
            plan_name, spec = read_specs(*_texts(folder))
        except SinewError:
            continue
        began = folder / "plan.toml" if (folder / "plan.toml").exists() else folder / CONTROL
        started = began.stat().st_mtime
        yield Run(folder.name, folder, process, started, plan_name, spec.name, spec)


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
