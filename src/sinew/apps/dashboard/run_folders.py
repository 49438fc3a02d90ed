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
from sinew.measure.errors import SinewError
from sinew.plan.rig import RigSpec

__all__ = ["LOG", "PID", "Control", "Run", "find_runs", "make_folder", "run_words", "told_at_end"]

PID = "run.pid"
"""Name of the file in a run's folder that holds the number of its process."""

LOG = "run.log"
"""Name of the file in a run's folder that holds what it said."""

_MOST_LOG = 256 * 1024  # bytes of its end

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
    starts = [number for number, line in enumerate(lines) if line == "{"]
    if starts:
        try:
            told, _ = json.JSONDecoder().raw_decode("\n".join(lines[starts[-1] :]))
            return f"{told['ended']}; {told['left']}"
        except (ValueError, KeyError, TypeError):
            pass
    said = [line.strip() for line in lines if line.strip()]
    return said[-1].removeprefix("sinew: ") if said else None


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
