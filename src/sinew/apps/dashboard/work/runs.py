"""The runs in a folder: what each was, how far it came, its state; the shelf of rigs and plans beside them."""

import json
import os
import re
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

from sinew.apps.bench.bench_run import JOURNAL
from sinew.apps.console import write_json
from sinew.apps.dashboard.operators import CACHE, SHELVES, held_inside, unlinked
from sinew.bench.record.journal import is_being_written, summarise_journal
from sinew.measure.errors import FileError, SinewError, SpecError
from sinew.measure.events import Event, Pretensioned
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.plan.toml import Shelf, list_shipped, parse_plan, parse_rig, read_spec

RECORDING = "recording.nc"
_SUMMARY, _VERSION = "summary.json", 1
_KEPT = (JOURNAL, f"{JOURNAL}-wal", RECORDING)


def list_runs(runs: Path | str) -> list[dict[str, Any]]:
    """Return the summary of every run in a folder, the newest first; a thousand take less than a second.

    Folders without a journal or a recording are left out. A run that cannot be read has the state damaged.
    """
    folder = Path(runs)
    if not folder.is_dir():
        return []
    with os.scandir(folder) as entries:
        places = [Path(entry.path) for entry in entries if _may_be_run(entry)]
    found = [_summary(place) for place in places]
    return sorted((row for row in found if row is not None), key=lambda row: str(row["started"]), reverse=True)


def _may_be_run(entry: "os.DirEntry[str]") -> bool:
    is_name = not entry.name.startswith(".") and entry.name.lower() not in SHELVES
    return is_name and entry.is_dir(follow_symlinks=False)


def run_summary(folder: Path | str) -> dict[str, Any]:
    """Return what a run's folder holds.

    `name` of the folder; `started` (ISO 8601), `duration_s`, `rig` and `plan` (names), `pretensions_mm`, `groups_done`,
    `groups` (of the plan): None where not known; `state`: running, complete, stopped, damaged, or recording where there
    is no journal; `sentence` on the state; `bytes` on the disk. Raises FileError where there is no run.
    """
    summary = _summary(Path(folder))
    if summary is None:
        raise FileError(f"{Path(folder).name} holds no run; expected a {JOURNAL} or a {RECORDING} in it")
    return summary


def _summary(folder: Path) -> dict[str, Any] | None:
    journal = folder / JOURNAL
    stamp = _stamp(folder)
    if JOURNAL not in stamp and RECORDING not in stamp:
        return None
    try:
        unlinked(folder)
    except FileError as trouble:
        return _unread(folder, stamp) | {"state": "damaged", "sentence": str(trouble)}
    if JOURNAL in stamp and is_being_written(journal):
        return _read(folder, stamp) | {"state": "running", "sentence": "The run is under way."}
    stored = _stored(folder, stamp)
    if stored is not None:
        return stored | {"name": folder.name}
    summary = _read(folder, stamp)
    if summary["state"] != "damaged":
        with suppress(SinewError, OSError):  # a folder that may not be written is listed all the same
            (folder / CACHE).mkdir(exist_ok=True)
            write_json({"version": _VERSION, "stamp": stamp, "summary": summary}, folder / CACHE / _SUMMARY)
    return summary


def _stamp(folder: Path) -> dict[str, list[int]]:
    """Return size and time of change of the files that a summary is made from."""
    stamp = {}
    for name in _KEPT:
        with suppress(OSError):
            about = (folder / name).lstat()
            if about.st_size:  # who reads a journal may leave an empty log beside it
                stamp[name] = [about.st_size, about.st_mtime_ns]
    return stamp


def _stored(folder: Path, stamp: Mapping[str, list[int]]) -> dict[str, Any] | None:
    try:
        stored = json.loads((folder / CACHE / _SUMMARY).read_text(encoding="utf-8"))
        if stored["version"] == _VERSION and stored["stamp"] == stamp:
            return dict(stored["summary"])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    return None


def _unread(folder: Path, stamp: Mapping[str, list[int]]) -> dict[str, Any]:
    """Return what is known of a run without opening a file of it."""
    changed = max(stamp.values(), key=lambda one: one[1])[1]
    return {
        "name": folder.name,
        "started": datetime.fromtimestamp(changed / 1e9, UTC).isoformat(timespec="seconds"),
        "duration_s": None,
        "rig": None,
        "plan": None,
        "pretensions_mm": [],
        "groups_done": None,
        "groups": None,
        "state": "recording",
        "sentence": "A recording without a journal.",
        "bytes": sum(size for size, _ in stamp.values()),
    }


def _read(folder: Path, stamp: Mapping[str, list[int]]) -> dict[str, Any]:
    row = _unread(folder, stamp)
    if JOURNAL not in stamp:
        return row
    try:
        journal = summarise_journal(folder / JOURNAL)
        plan = parse_plan(journal.plan_toml, source="the journal's plan")
    except SinewError as trouble:
        return row | {"state": "damaged", "sentence": str(trouble)}
    groups, last = len(plan.groups()), journal.last
    is_complete = journal.finished >= groups
    return row | {
        "started": journal.dates[0] if journal.dates else row["started"],
        "duration_s": journal.duration_s,
        "rig": _name_in(journal.rig_toml),
        "plan": plan.name,
        "pretensions_mm": list(plan.pretension.pretension_mm),
        "groups_done": journal.finished,
        "groups": groups,
        "state": "complete" if is_complete else "stopped",
        "sentence": "Every group of the plan is recorded." if is_complete else _why(last, plan),
    }


def _why(last: Event | None, plan: Plan) -> str:
    """Return why a run ended early. last: the journal's last event."""
    if last is not None and not isinstance(last, Pretensioned):
        return f"The run ended early: {last}"
    return f"The run of the plan {plan.name} ended early; sinew run --resume goes on with it."


def _name_in(rig_toml: str) -> str | None:
    """Return the name in a rig's text, without reading all of it: a dumped rig begins with its name."""
    line = next((one for one in rig_toml.splitlines() if one.startswith("name")), "")
    try:
        return str(tomllib.loads(line)["name"])
    except (tomllib.TOMLDecodeError, KeyError):
        return None


# The rigs and plans to choose from are listed: those that ship with Sinew, and the lab's own.

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._ -]{0,79}\.toml")
_MOST_BYTES = 1_000_000


def shelf(runs: Path | str | None = None) -> dict[str, list[dict[str, Any]]]:
    """Return `{"rigs", "plans"}`, each a list of `{"name", "shipped", "about", "ok"}`.

    runs: folder whose folders `rigs` and `plans` hold the lab's own files; their names end in .toml.
    about: one line, of a file that cannot be read why. ok: whether it can.
    """
    return {"rigs": _listed("rigs", runs), "plans": _listed("plans", runs)}


def read_shelf(kind: str, name: str, runs: Path | str | None = None) -> str:
    """Return the TOML text of a listed rig or plan. kind: rigs or plans. Raises SpecError where there is none."""
    if kind not in SHELVES:
        raise SpecError(f"found a shelf {kind!r}, expected rigs or plans")
    if _NAME.fullmatch(name):
        path = None if runs is None else Path(runs) / kind / name
        try:
            if path is not None and runs is not None:
                with held_inside(Path(runs), path) as held:
                    if held.stat().st_size <= _MOST_BYTES:
                        return read_spec(cast(Shelf, kind), held)
        except (FileError, OSError):
            pass
        raise SpecError(f"there is no {name} among the {kind} of the runs' folder")
    if name not in list_shipped(cast(Shelf, kind)):
        raise SpecError(f"there is no {kind.removesuffix('s')} {name!r}; choose one that is listed")
    return read_spec(cast(Shelf, kind), f"{kind}/{name}.toml")


def _listed(kind: Shelf, runs: Path | str | None) -> list[dict[str, Any]]:
    folder = None if runs is None else Path(runs) / kind
    own = [] if folder is None or not folder.is_dir() else sorted(path.name for path in folder.glob("*.toml"))
    names = [*((name, True) for name in list_shipped(kind)), *((name, False) for name in own if _NAME.fullmatch(name))]
    return [_row(kind, name, runs, shipped) for name, shipped in names]


def _row(kind: Shelf, name: str, runs: Path | str | None, shipped: bool) -> dict[str, Any]:
    row = {"name": name, "shipped": shipped}
    try:
        text = read_shelf(kind, name, runs)
        about = _rig_in_words(parse_rig(text)) if kind == "rigs" else _plan_in_words(parse_plan(text))
    except SinewError as trouble:
        return {**row, "about": str(trouble), "ok": False}
    return {**row, "about": about, "ok": True}


def _rig_in_words(rig: RigSpec) -> str:
    length, diameter = (1e3 * one.value for one in (rig.silicone.length, rig.silicone.diameter))
    known = "calibrated with intervals" if rig.calibration is not None else "no intervals"
    return f"{rig.tendons.count} tendons, silicone of {length:.3g} by {diameter:.3g} mm, {known}"


def _plan_in_words(plan: Plan) -> str:
    pretensions = plan.pretension.pretension_mm
    words = [f"{pretensions[0]:g} mm"]
    if len(pretensions) > 1:
        words = [f"{len(pretensions)} pretensions, {min(pretensions):g} to {max(pretensions):g} mm"]
    if plan.sweep is not None:
        frequency = plan.sweep.frequency_hz
        driven = f"at {plan.sweep.amplitude_deg:g}°" if plan.sweep.drive == "lever" else f"in {plan.sweep.drive}"
        words.append(f"sweep of {frequency[0]:g} to {frequency[-1]:g} Hz {driven}")
    if plan.ring_down is not None:
        words.append("ring-downs")
    if plan.impulse is not None:
        words.append("blows")
    if not plan.rest_pose.is_straight:
        words.append(plan.rest_pose.words())
    if plan.track is not None:
        words.append("tracking")
    minutes = sum(group.duration_s for group in plan.groups()) / 60
    return f"{', '.join(words)}; {minutes:.1f} min" if minutes < 10 else f"{', '.join(words)}; {minutes:.0f} min"
