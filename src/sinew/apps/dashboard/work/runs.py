"""The runs in a folder: what each was and found, named, noted, put away; the shelf of rigs and plans beside them."""

import json
import os
import re
import secrets
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

from sinew.analysis.run_index import RunIndex
from sinew.apps.bench.bench_run import JOURNAL
from sinew.apps.dashboard.operators import (
    SHELVES,
    RefusedError,
    held_inside,
    is_run_name,
    open_inside,
    require_run_name,
    unlinked,
)
from sinew.bench.record.journal import is_being_written, summarise_journal
from sinew.measure.doors import write_text
from sinew.measure.errors import FileError, SinewError, SpecError
from sinew.measure.events import Event, Pretensioned
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.plan.toml import Shelf, list_shipped, parse_plan, parse_rig, read_spec

RECORDING, RESULTS, NOTES = "recording.nc", "results.nc", "notes.json"
_LOOKED_AT = (JOURNAL, f"{JOURNAL}-wal", RECORDING, RESULTS, NOTES)
_READING_S = 2.0  # for so long a run's live curves wait behind a look; what is not read then is read by the next


def list_runs(runs: Path | str, query: str = "", most: int | None = None) -> list[dict[str, Any]]:
    """Return the runs in a folder that a query finds, the newest first, see `look_at_runs`."""
    return list(look_at_runs(runs, query, most)["runs"])


def look_at_runs(runs: Path | str, query: str = "", most: int | None = None) -> dict[str, Any]:
    """Return `{"runs", "count", "left"}`: the runs that a query finds, the newest first.

    runs: of each what `read_run` says; so many at most. count: how many the query finds. left: how many folders are not
    read yet. Folders without a journal, a recording or results are left out. A run that cannot be read has the state
    damaged. Raises SpecError where the query is none.
    """
    with index_of(runs) as index:
        left = index.refresh(most_s=_READING_S).left
        return {"runs": index.search(query, most=most), "count": index.count(query), "left": left}


def run_trends(runs: Path | str, query: str, quantity: str) -> list[dict[str, Any]]:
    """Return how a quantity changed over the runs that a query finds.

    Of each rig, source and pretension `title`, `sentence`, `days` since 1970, `runs`, `values` (estimates as JSON holds
    them), `line`: None, or its own `days` and there `value` and the 90 % band's `low` and `high`.
    Raises SpecError for a query that is none.
    """
    from sinew.analysis.run_trend import trends

    with index_of(runs) as index:
        index.refresh(most_s=_READING_S)
        found = trends(index.search(query), quantity)
    rows = []
    for one in found:
        line = None
        if one.line is not None:
            days = one.days[[0, -1]] if one.days.size < _LINE_POINTS else one.days[:: one.days.size // _LINE_POINTS]
            middle, half = one.line.at(days), one.line.half(days)
            line = {"days": days.tolist(), "value": middle.tolist()}
            line |= {"low": (middle - half).tolist(), "high": (middle + half).tolist()}
        points = {
            "days": one.days.tolist(),
            "runs": list(one.runs),
            "values": [value.to_json() for value in one.values],
        }
        rows.append({"title": one.title, "sentence": one.sentence, **points, "line": line})
    return rows


_LINE_POINTS = 30


def run_differences(runs: Path | str, first: str, others: list[str]) -> dict[str, Any]:
    """Return `{"rows", "sentences"}`: in what some runs differ from a first one, each quantity at each pretension.

    rows: `run`, `pretension_mm`, `quantity`, `first`, `other`, `difference` (estimates as JSON), `is_significant`,
    `sentence`. Only the index is read.
    """
    from sinew.analysis.run_index import QUANTITIES
    from sinew.analysis.run_trend import by_chance, differences

    with index_of(runs) as index:
        index.refresh(most_s=_READING_S)
        known = {row["name"]: row for row in index.search() if row["name"] in {first, *others}}
    rows, sentences = [], []
    for name in others:
        if name not in known or first not in known or name == first:
            continue
        found = differences(known[first], known[name], list(QUANTITIES))
        told = by_chance(found) if found else "no quantity was found in both at the same pretension."
        sentences.append(f"{name} against {first}: {told}")
        rows += [
            {
                "run": name,
                "pretension_mm": one.pretension_mm,
                "quantity": one.quantity,
                "first": one.first.to_json(),
                "other": one.other.to_json(),
                "difference": one.difference.to_json(),
                "is_significant": one.is_significant,
                "sentence": one.sentence,
            }
            for one in found
        ]
    return {"rows": rows, "sentences": sentences}


def index_of(runs: Path | str) -> RunIndex:
    """Return the index of a folder of runs, to be closed. Raises FileError where it is no folder."""
    return RunIndex(Path(runs).absolute(), _look, read_run)


def _look(folder: Path) -> str | None:
    """Return sizes and times of change of a run's files as text; None where the folder holds no run."""
    stamp = {} if folder.name.lower() in SHELVES else _stamp(folder)
    return json.dumps(stamp) if stamp.keys() & {JOURNAL, RECORDING, RESULTS} else None


def run_summary(folder: Path | str) -> dict[str, Any]:
    """Return what a run's folder holds, without what it found.

    `name` of the folder; `started` (ISO 8601), `duration_s`, `rig` and `plan` (names), `pretensions_mm`, `groups_done`,
    `groups`, `has_ring_downs` (of the plan): None where not known; `state`: running, complete, stopped, damaged, or
    recording where there is no journal; `sentence` on the state; `source`: bench, emulator, twin, import or None;
    `notes` and `tags`; `bytes` on the disk. Raises FileError where there is no run.
    """
    folder = Path(folder)
    stamp = _stamp(folder)
    if not stamp.keys() & {JOURNAL, RECORDING, RESULTS}:
        raise FileError(f"{folder.name} holds no run; expected a {JOURNAL} or a {RECORDING} in it")
    try:
        unlinked(folder)
    except FileError as trouble:
        return _unread(folder, stamp) | {"state": "damaged", "sentence": str(trouble)}
    row = _read(folder, stamp) | _noted(folder)
    if JOURNAL in stamp and is_being_written(folder / JOURNAL):
        row |= {"state": "running", "sentence": "The run is under way."}
    return row


def read_run(folder: Path | str) -> dict[str, Any]:
    """Return what `run_summary` does and `found`, what the run measured, as the index keeps it.

    `analysed`: whether there are results of this recording; `remark`: why not; `untold`: why they hold no resonance.
    Nothing is analysed here: that is read which `results.nc` says, and no samples.
    """
    folder = Path(folder)
    row = run_summary(folder)
    planned = row["pretensions_mm"] if row["state"] == "complete" else []
    row |= {"found": [{"pretension_mm": mm} for mm in planned], "analysed": False, "remark": "", "untold": ""}
    if row["state"] in ("damaged", "running"):
        return row
    from sinew.apps.dashboard.work.results import read_found

    try:
        return row | read_found(folder)
    except SinewError as trouble:
        is_alone = not (folder / JOURNAL).is_file()
        return row | ({"state": "damaged", "sentence": str(trouble)} if is_alone else {"remark": str(trouble)})


def _noted(folder: Path) -> dict[str, Any]:
    """Return notes and tags of a run; of a file that is none of ours, nothing."""
    try:
        with open_inside(folder.parent, folder / NOTES) as file:
            said = json.loads(file.read(_MOST_NOTES_BYTES))
        return {"notes": str(said["notes"])[:_MOST_NOTES], "tags": [str(one) for one in said["tags"]][:_MOST_TAGS]}
    except (FileError, OSError, ValueError, KeyError, TypeError, RecursionError):
        return {"notes": "", "tags": []}


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
    made = next(one for one in (JOURNAL, RECORDING, RESULTS) if one in stamp)  # not when it was noted or analysed
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
        "notes": "",
        "tags": [],
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


def name_in(text: str) -> str | None:
    """Return the name in the text of a rig or plan, without reading all of it: a dumped one begins with its name."""
    line = next((one for one in text.splitlines() if one.startswith("name")), "")
    try:
        return str(tomllib.loads(line)["name"])
    except (tomllib.TOMLDecodeError, KeyError):
        return None


# Runs are named, noted and put away: folders of what has ended, each step whole or not at all.

BIN = ".bin"
"""Folder in that of the runs for those that were put away."""

_MOST_NOTES, _MOST_TAGS, _MOST_TAG = 4000, 20, 40
_TAG = re.compile(rf"[\w.+-]{{1,{_MOST_TAG}}}")
_MOST_NOTES_BYTES = 8 * _MOST_NOTES  # as JSON: a sign of notes takes up to 6, all tags with their quotes up to 3500


def rename_run(runs: Path, name: str, to: str) -> str:
    """Give a run another name, and return a sentence. Raises RefusedError."""
    folder = _ended(runs, name)
    target = runs / require_run_name(to)
    if os.path.lexists(target):
        raise RefusedError(409, f"there is a run {to} already; choose another name")
    _move(folder, target)
    return f"the run {name} is called {to} now"


def bin_run(runs: Path, name: str) -> str:
    """Put a run into the bin, its name with a number behind it if need be; return a sentence. Raises RefusedError."""
    folder, place = _ended(runs, name), _bin(runs)
    kept = _free_name(place, name)
    _move(folder, place / kept)
    said = f" as {kept}" if kept != name else ""
    return f"the run {name} lies in the bin{said}; Restore, below the list of runs, takes it out again"


def _free_name(place: Path, name: str) -> str:
    """Return a name that nothing in a folder has: this one, or with a number behind it."""
    more = (f"{name[:75]}.{number}" for number in range(2, 1000))
    return next((one for one in (name, *more) if not os.path.lexists(place / one)), name)


def restore_run(runs: Path, name: str) -> str:
    """Take a run out of the bin, as `bin_run` puts it there, and return a sentence. Raises RefusedError."""
    folder = _bin(runs) / require_run_name(name)
    if not folder.is_dir() or folder.is_symlink():
        raise RefusedError(404, f"there is no {name} in the bin; the page Runs lists what is")
    kept = _free_name(runs, name)
    _move(folder, runs / kept)
    return f"the run {name} is back" + (f" as {kept}: something else has its name" if kept != name else "")


def note_run(runs: Path, name: str, notes: str, tags: list[str]) -> str:
    """Write down notes and tags of a run, which take the place of those before, and return a sentence.

    Where a tag is refused, the notes are written all the same, with the tags before.
    They lie in notes.json in the run's folder and travel with it. Raises RefusedError.
    """
    folder = _own(runs, name)
    if len(notes) > _MOST_NOTES:
        raise RefusedError(422, f"found notes of {len(notes)} characters, expected at most {_MOST_NOTES}")
    tags = list(dict.fromkeys(tags))
    bad = next((tag for tag in tags if not _TAG.fullmatch(tag)), None)
    is_refused = bad is not None or len(tags) > _MOST_TAGS
    kept = {"notes": notes, "tags": _noted(folder)["tags"] if is_refused else tags}
    try:
        write_text(folder / NOTES, json.dumps(kept, ensure_ascii=False, indent=2) + "\n")
    except SinewError as trouble:
        raise RefusedError(409, str(trouble)) from trouble
    if is_refused:
        found = f"the tag {bad[:50]!r}" if bad is not None else f"{len(tags)} tags"
        each = f"each of up to {_MOST_TAG} letters, digits, '.', '_', '+' or '-'"
        raise RefusedError(
            422, f"found {found}, expected up to {_MOST_TAGS} tags, {each}; the notes are kept, the tags are as before"
        )
    return f"notes and tags of {name} are kept"


def list_bin(runs: Path | str) -> list[str]:
    """Return the names of the runs in the bin."""
    try:
        with os.scandir(Path(runs) / BIN) as entries:
            return sorted(entry.name for entry in entries if entry.is_dir(follow_symlinks=False))
    except OSError:
        return []


def _own(runs: Path, name: str) -> Path:
    """Return the folder of a run by its name. Raises RefusedError."""
    folder = runs / name
    if not is_run_name(name) or folder.is_symlink() or _look(folder) is None:
        raise RefusedError(404, f"there is no run {name[:100]!r}; the page Runs lists them")
    return folder


def _ended(runs: Path, name: str) -> Path:
    folder = _own(runs, name)
    if is_being_written(folder / JOURNAL):
        raise RefusedError(409, f"the run {name} is under way; end it first")
    return folder


def _bin(runs: Path) -> Path:
    """Return the bin, made where there is none yet. Raises RefusedError."""
    place = runs / BIN
    with suppress(OSError):
        place.mkdir(exist_ok=True)
    if place.is_symlink() or not place.is_dir():
        raise RefusedError(409, f"{place} is no folder of ours; put it away")
    return place


def _move(folder: Path, target: Path) -> None:
    try:
        folder.rename(target)
    except OSError as error:
        raise RefusedError(409, f"cannot move {folder.name}: {error.strerror}; see who owns the folder") from error


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


_MOST_KEPT = 1000


def put_on_shelf(runs: Path, kind: str, name: str, text: str, *, replace: bool = False) -> str:
    """Write a rig or a plan among the lab's own, whole or not at all, and return a sentence.

    kind: rigs or plans. name: of its file, with or without .toml. replace: whether it may take the place of another.
    What the text says is not looked at: a plan that is half written is kept, and listed as such.
    Raises RefusedError: 422 for a name or kind that is none, 409 where there is one, the shelf is full or not writable.
    """
    file = _file_name(kind, name)
    made = f".{file}.{secrets.token_hex(4)}"
    with _shelf_handle(runs, kind, make=True) as folder:
        with os.scandir(folder) as entries:
            there = [entry.name for entry in entries]
        if file in there and not replace:
            raise RefusedError(
                409,
                f"there is a {kind.removesuffix('s')} {file} already; replace it, or choose another name",
                exists=True,
            )
        if file not in there and len(there) >= _MOST_KEPT:
            raise RefusedError(409, f"the shelf of {kind} holds {len(there)} files; take some away first")
        handle = os.open(made, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o644, dir_fd=folder)
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as out:
                out.write(text)
                out.flush()
                os.fsync(out.fileno())
            os.rename(made, file, src_dir_fd=folder, dst_dir_fd=folder)
        except OSError:
            with suppress(OSError):
                os.unlink(made, dir_fd=folder)
            raise
    return f"{file} is on the shelf of {kind}"


def take_off_shelf(runs: Path, kind: str, name: str) -> str:
    """Delete a rig or plan of the lab's own, and return a sentence. Raises RefusedError: 404 where there is none."""
    file = _file_name(kind, name)
    with _shelf_handle(runs, kind, make=False) as folder:
        try:
            os.unlink(file, dir_fd=folder)
        except FileNotFoundError:
            raise RefusedError(404, f"there is no {file} among the lab's own {kind}") from None
    return f"{file} is deleted from the shelf of {kind}"


def _file_name(kind: str, name: str) -> str:
    file = name if name.endswith(".toml") else f"{name}.toml"
    if kind not in SHELVES:
        raise RefusedError(422, f"found a shelf {kind[:40]!r}, expected rigs or plans")
    if not _NAME.fullmatch(file):
        raise RefusedError(
            422,
            f"found {name[:100]!r} for a name, expected up to 80 letters, digits, '.', '_', '-' or spaces, the first a "
            "letter or a digit",
        )
    return file


@contextmanager
def _shelf_handle(runs: Path, kind: str, *, make: bool) -> Iterator[int]:
    """Give a shelf's folder, opened through no link. Raises RefusedError where it cannot be had or written."""
    try:
        if make:
            (runs / kind).mkdir(parents=True, exist_ok=True)
        handle = os.open(runs / kind, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        try:
            yield handle
        finally:
            os.close(handle)
    except FileNotFoundError:
        raise RefusedError(404, f"the lab has no {kind} of its own") from None
    except OSError as error:
        raise RefusedError(409, f"cannot write among the {kind}: {error.strerror}; see {runs / kind}") from error


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
