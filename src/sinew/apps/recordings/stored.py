"""Files of a campaign's folder that still belong to its recording, taken up again."""

import hashlib
import json
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sinew.apps.console import remark
from sinew.measure.errors import FileError, SchemaError, SpecError

if TYPE_CHECKING:
    import xarray as xr

    from sinew.plan.rig import RigSpec


def hash_file(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, as hexadecimal text; empty where it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


def stored_results(path: Path, recording: "xr.Dataset", rig: "RigSpec | None") -> "xr.Dataset | None":
    """Return the results in a file if they were made from this recording with this rig, else None and a remark.

    None without a remark where there is no such file.
    """
    from sinew.measure.files.netcdf import load_results

    if not path.is_file():
        return None
    try:
        results = load_results(path)
    except (FileError, SchemaError) as error:
        remark(f"{path.name} cannot be used ({error}); analysed anew")
        return None
    if results.attrs.get("recording_hash") != _hash_of(recording):
        remark(f"{path.name} was made from another recording; analysed anew")
        return None
    if not _is_of_rig(results, rig):
        remark(f"{path.name} was made with another rig; analysed anew")
        return None
    return results


def is_of(path: Path, recording: "xr.Dataset") -> bool:
    """Return whether a file holds results of a recording."""
    from sinew.measure.files.netcdf import load_results

    try:
        return bool(load_results(path).attrs.get("recording_hash") == _hash_of(recording))
    except (FileError, SchemaError):
        return False


def _hash_of(recording: "xr.Dataset") -> str:
    from sinew.measure.files.netcdf import content_hash

    return str(recording.attrs.get("content_hash") or content_hash(recording))


def analyse_into(folder: Path, recording: "xr.Dataset", rig: "RigSpec | None") -> "xr.Dataset":
    """Return the results of a recording, left in a folder as results.nc and analysis.json where that may be written.

    Raises RecordingError where the recording cannot be analysed.
    """
    from sinew.analysis.analysed import analyse_with, recording_result
    from sinew.apps.console import write_json
    from sinew.measure.files.netcdf import save_dataset

    results = analyse_with(recording, rig)
    with suppress(FileError, OSError):
        save_dataset(results, folder / "results.nc")
        write_json(recording_result(results).to_dict(), folder / "analysis.json")
    return results


def stored_beyond(path: Path, rig: "RigSpec | None") -> "xr.Dataset | None":
    """Return the results of the sweep above the paper's range if they are of this rig, else None and a remark."""
    from sinew.measure.files.netcdf import load_results

    if not path.is_file():
        return None
    beyond = load_results(path)
    if _is_of_rig(beyond, rig):
        return beyond
    remark(f"{path.name} belongs to another rig and is left out; sinew reproduce writes it anew")
    return None


def stored_answers(path: Path, recording: "xr.Dataset") -> list[dict[str, Any]]:
    """Return the answers in an answers.json (question, verdict, first sentence), if they are this recording's.

    Empty where there is no such file or it cannot be read, and with a remark where it is another recording's.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        if document["recording_hash"] != _hash_of(recording):
            remark(f"{path.name} belongs to another recording and is left out; sinew report --answers writes it anew")
            return []
        return [
            {"question": one["question"], "verdict": one["verdict"], "sentence": one["sentences"][0]}
            for one in document["answers"]
        ]
    except (OSError, ValueError, KeyError, IndexError, TypeError):
        return []


def stored_effects(path: Path, results: "xr.Dataset") -> list[dict[str, Any]]:
    """Return the rows of an effects file if the results name it by its hash, else none and a remark."""
    if not path.is_file():
        return []
    if results.attrs.get("effects_hash") != hash_file(path):
        remark(f"{path.name} belongs to other results and is left out; sinew reproduce writes it anew")
        return []
    rows = json.loads(path.read_text(encoding="utf-8"))
    return list(rows)


def stored_times(path: Path) -> dict[str, float]:
    """Return what an earlier summary said of its own time; empty where there is none."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        return {"wall_s": float(found["wall_s"]), "simulated_s": float(found["simulated_s"])}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _is_of_rig(dataset: "xr.Dataset", rig: "RigSpec | None") -> bool:
    from sinew.analysis.analysed import recording_rig

    try:
        return recording_rig(dataset, None) == rig
    except SpecError:
        return False
