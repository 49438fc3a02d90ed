"""The runs in a folder: what each was and found, and how they differ; the library of rigs and plans beside them."""

import json
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

from sinew.analysis.runs import RunIndex
from sinew.apps.bench.bench_run import JOURNAL
from sinew.apps.dashboard.folders import (
    RECORDING,
    RESULTS,
    SHELVES,
    RefusedError,
    held_inside,
    name_in,
    unlinked,
)
from sinew.apps.dashboard.work.results import read_found
from sinew.bench.record.journal import is_being_written, summarise_journal
from sinew.measure.errors import FileError, SinewError, SpecError
from sinew.measure.events import Event, Pretensioned
from sinew.measure.validation import write_text
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.plan.toml import Library, list_shipped, parse_plan, parse_rig, read_spec

_LOOKED_AT = (JOURNAL, f"{JOURNAL}-wal", RECORDING, RESULTS)
_READING_S = 2.0  # for so long a run's live curves wait behind a look; what is not read then is read by the next


def look_at_runs(runs: Path | str, query: str = "", most: int | None = None) -> dict[str, Any]:
    """Return `{"runs", "count", "left"}`: the runs that a query finds, the newest first.

    runs: of each what `read_run` says; so many at most. count: how many the query finds. left: how many folders are not
    read yet. Folders without a journal, a recording or results are left out. A run that cannot be read has the state
    damaged. Raises SpecError where the query is none.
    """
    index = index_of(runs)
    left = index.refresh(most_s=_READING_S)
    found = index.search(query)
    return {"runs": found[:most], "count": len(found), "left": left}


def run_trends(runs: Path | str, query: str, quantity: str) -> list[dict[str, Any]]:
    """Return how a quantity changed over the runs that a query finds.

    Of each rig, source and pretension `title`, `sentence`, `days` since 1970, `runs`, `values` (estimates as JSON holds
    them), `line`: None, or its own `days` and there `value` and the 90 % band's `low` and `high`.
    Raises SpecError for a query that is none.
    """
    from sinew.analysis.runs import trends

    found = trends(look_at_runs(runs, query)["runs"], quantity)
    rows = []
    for one in found:
        line = None
        if one.line is not None:
            days = one.days[[0, -1]] if one.runs < _LINE_POINTS else one.days[:: one.runs // _LINE_POINTS]
            middle, half = one.line.at(days)
            line = {"days": days.tolist(), "value": middle.tolist()}
            line |= {"low": (middle - half).tolist(), "high": (middle + half).tolist()}
        points = {"runs": [at.run for at in one.points], "values": [at.value.to_json() for at in one.points]}
        points |= {"days": one.days.tolist(), "line": line}
        rows.append({"title": one.title, "sentence": one.sentence, **points})
    return rows


_LINE_POINTS = 30


def run_differences(runs: Path | str, first: str, others: list[str]) -> dict[str, Any]:
    """Return `{"rows", "sentences"}`: in what some runs differ from a first one, each quantity at each pretension.

    rows: `run`, `pretension_mm`, `quantity`, `first`, `other`, `difference` (estimates as JSON), and
    `is_significant`, None where that cannot be said. Only the index is read.
    """
    from sinew.analysis.runs import QUANTITIES, by_chance, differences, is_off_zero

    known = {row["name"]: row for row in look_at_runs(runs)["runs"]}
    rows, sentences = [], []
    for name in others:
        if name not in known or first not in known or name == first:
            continue
        found = differences(known[first], known[name], list(QUANTITIES))
        comparison = by_chance(found) if found else "no quantity was found in both at the same pretension."
        sentences.append(f"{name} against {first}: {comparison}")
        rows += [
            {
                "run": name,
                "pretension_mm": one.pretension_mm,
                "quantity": one.quantity,
                "first": one.first.to_json(),
                "other": one.other.to_json(),
                "difference": one.difference.to_json(),
                "is_significant": is_off_zero(one.difference),
            }
            for one in found
        ]
    return {"rows": rows, "sentences": sentences}


def index_of(runs: Path | str) -> RunIndex:
    """Return the index of a folder of runs. Raises FileError where it is no folder."""
    return RunIndex(Path(runs).absolute(), _look, read_run)


def _look(folder: Path) -> str | None:
    """Return sizes and times of change of a run's files as text; None where the folder holds no run."""
    stamp = {} if folder.name.lower() in SHELVES else _stamp(folder)
    return json.dumps(stamp) if stamp.keys() & {JOURNAL, RECORDING, RESULTS} else None


def read_run(folder: Path | str) -> dict[str, Any]:
    """Return what a run's folder holds, and what the run found, as the index keeps it.

    `name` of the folder; `started` (ISO 8601), `duration_s`, `rig` and `plan` (names), `pretensions_mm`, `groups_done`,
    `groups`, `has_ring_downs` (of the plan): None where not known; `state`: running, complete, stopped, damaged, or
    recording where there is no journal; `sentence` on the state; `source`: bench, emulator, twin, import or None;
    `bytes` on the disk; `found`: what the run measured at each pretension; `analysed`: whether there are results of
    this recording; `remark`: why not; `untold`: why they hold no resonance.
    Nothing is analysed here: that is read which `results.nc` says, and no samples. Raises FileError where there is no
    run.
    """
    folder = Path(folder)
    stamp = _stamp(folder)
    if not stamp.keys() & {JOURNAL, RECORDING, RESULTS}:
        raise FileError(f"{folder.name} holds no run; expected a {JOURNAL} or a {RECORDING} in it")
    try:
        unlinked(folder)
    except FileError as trouble:
        row = _unread(folder, stamp) | {"state": "damaged", "sentence": str(trouble)}
    else:
        row = _read(folder, stamp)
        if JOURNAL in stamp and is_being_written(folder / JOURNAL):
            row |= {"state": "running", "sentence": "The run is under way."}
    planned = row["pretensions_mm"] if row["state"] == "complete" else []
    row |= {"found": [{"pretension_mm": mm} for mm in planned], "analysed": False, "remark": "", "untold": ""}
    if row["state"] in ("damaged", "running"):
        return row
    try:
        return row | read_found(folder)
    except SinewError as trouble:
        is_alone = not (folder / JOURNAL).is_file()
        return row | ({"state": "damaged", "sentence": str(trouble)} if is_alone else {"remark": str(trouble)})


def _stamp(folder: Path) -> dict[str, list[int]]:
    """Return size and time of change of the files that a summary is made from."""
    stamp = {}
    for name in _LOOKED_AT:
        with suppress(OSError):
            about = (folder / name).lstat()
            if about.st_size:  # who reads a journal may leave an empty log beside it
                stamp[name] = [about.st_size, about.st_mtime_ns]
    return stamp


def _unread(folder: Path, stamp: Mapping[str, list[int]]) -> dict[str, Any]:
    """Return what is known of a run without opening a file of it."""
    made = next(one for one in (JOURNAL, RECORDING, RESULTS) if one in stamp)  # not when it was analysed
    return {
        "name": folder.name,
        "started": datetime.fromtimestamp(stamp[made][1] / 1e9, UTC).isoformat(timespec="seconds"),
        "duration_s": None,
        "rig": None,
        "plan": None,
        "pretensions_mm": [],
        "groups_done": None,
        "groups": None,
        "has_ring_downs": None,
        "state": "recording",
        "sentence": "A recording without a journal." if RECORDING in stamp else "Results without a recording.",
        "source": None,
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
        "rig": name_in(journal.rig_toml),
        "plan": plan.name,
        "pretensions_mm": list(plan.pretension.pretension_mm),
        "groups_done": journal.finished,
        "groups": groups,
        "has_ring_downs": plan.ring_down is not None,
        "state": "complete" if is_complete else "stopped",
        "sentence": "Every group of the plan is recorded." if is_complete else _why(last, plan),
    }


def _why(last: Event | None, plan: Plan) -> str:
    """Return why a run ended early. last: the journal's last event."""
    if last is not None and not isinstance(last, Pretensioned):
        return f"The run ended early: {last}"
    return f"The run of the plan {plan.name} ended early; sinew run --resume goes on with it."


# The rigs and plans to choose from are listed: those that ship with Sinew, and the lab's own.

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._ -]{0,79}\.toml")
_MOST_BYTES = 1_000_000


def library(runs: Path | str | None = None) -> dict[str, list[dict[str, Any]]]:
    """Return `{"rigs", "plans"}`, each a list of `{"name", "shipped", "about", "ok"}`.

    runs: folder whose folders `rigs` and `plans` hold the lab's own files; their names end in .toml.
    about: one line, of a file that cannot be read why. ok: whether it can.
    """
    return {"rigs": _listed("rigs", runs), "plans": _listed("plans", runs)}


def read_library(kind: str, name: str, runs: Path | str | None = None) -> str:
    """Return the TOML text of a listed rig or plan. kind: rigs or plans. Raises SpecError where there is none."""
    if kind not in SHELVES:
        raise SpecError(f"found a library {kind!r}, expected rigs or plans")
    if _NAME.fullmatch(name):
        path = None if runs is None else Path(runs) / kind / name
        try:
            if path is not None and runs is not None:
                with held_inside(Path(runs), path) as held:
                    if held.stat().st_size <= _MOST_BYTES:
                        return read_spec(cast(Library, kind), held)
        except (FileError, OSError):
            pass
        raise SpecError(f"there is no {name} among the {kind} of the runs' folder")
    if name not in list_shipped(cast(Library, kind)):
        raise SpecError(f"there is no {kind.removesuffix('s')} {name!r}; choose one that is listed")
    return read_spec(cast(Library, kind), f"{kind}/{name}.toml")


def put_in_library(runs: Path, kind: str, name: str, text: str, *, replace: bool = False) -> str:
    """Write a rig or a plan among the lab's own, whole or not at all, and return a sentence.

    kind: rigs or plans. name: of its file, with or without .toml. replace: whether it may take the place of another.
    What the text says is not looked at: a plan that is half written is kept, and listed as such.
    Raises RefusedError: 422 for a name or kind that is none, 409 where there is one or the library is not writable.
    """
    file = name if name.endswith(".toml") else f"{name}.toml"
    if kind not in SHELVES:
        raise RefusedError(422, f"found a library {kind[:40]!r}, expected rigs or plans")
    if not _NAME.fullmatch(file):
        raise RefusedError(
            422,
            f"found {name[:100]!r} for a name, expected up to 80 letters, digits, '.', '_', '-' or spaces, the first a "
            "letter or a digit",
        )
    folder = runs / kind
    if folder.is_symlink():
        raise RefusedError(409, f"cannot write among the {kind}: {folder} is a link; put the folder itself there")
    if not replace and os.path.lexists(folder / file):
        said = f"there is a {kind.removesuffix('s')} {file} already; replace it, or choose another name"
        raise RefusedError(409, said, exists=True)
    try:
        write_text(folder / file, text)  # in the place of a link, not through it
    except FileError as error:
        raise RefusedError(409, str(error)) from error
    return f"{file} is in the library of {kind}"


def _listed(kind: Library, runs: Path | str | None) -> list[dict[str, Any]]:
    folder = None if runs is None else Path(runs) / kind
    own = [] if folder is None or not folder.is_dir() else sorted(path.name for path in folder.glob("*.toml"))
    names = [*((name, True) for name in list_shipped(kind)), *((name, False) for name in own if _NAME.fullmatch(name))]
    return [_row(kind, name, runs, shipped) for name, shipped in names]


def _row(kind: Library, name: str, runs: Path | str | None, shipped: bool) -> dict[str, Any]:
    row = {"name": name, "shipped": shipped}
    try:
        text = read_library(kind, name, runs)
        about = _rig_in_words(parse_rig(text)) if kind == "rigs" else _plan_in_words(parse_plan(text))
    except SinewError as trouble:
        return {**row, "about": str(trouble), "ok": False}
    return {**row, "about": about, "ok": True}


def _rig_in_words(rig: RigSpec) -> str:
    length, diameter = (1e3 * one.value for one in (rig.silicone.length, rig.silicone.diameter))
    known = "calibrated with intervals" if rig.calibration is not None else "no intervals"
    cast = rig.space.rest_bend_deg if rig.space is not None else 0.0
    bend = f" cast with a bend of {cast:g}°" if cast else ""
    return f"{rig.tendons.count} tendons, silicone of {length:.3g} by {diameter:.3g} mm{bend}, {known}"


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
    from sinew.plan.check import stages_of

    last = stages_of(plan)[-1]
    whole_s = last.start_s + last.duration_s
    long = f"{whole_s:.0f} s" if whole_s < 90 else f"{whole_s / 60:.0f} min"
    return f"{', '.join(words)}; {long}"
