"""This is where the rigs and plans that ship with Sinew are found, and where a name becomes a text."""

import difflib
import json
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

from sinew.measure.errors import SpecError

__all__ = ["Shelf", "list_shipped", "read_ranges", "read_spec"]

Shelf = Literal["rigs", "plans"]


def list_shipped(shelf: Shelf) -> list[str]:
    """Return the names of the rigs or plans that ship with Sinew, in alphabetical order."""
    entries = files("sinew").joinpath(shelf).iterdir()
    return sorted(entry.name.removesuffix(".toml") for entry in entries if entry.name.endswith(".toml"))


def read_spec(shelf: Shelf, path_or_name: str | Path) -> str:
    """Return the text of a rig or plan: of the file at a path, else of the shipped one of that name.

    path_or_name: `paper`, `paper.toml`, `rigs/paper.toml`, or the path of a file. A file that exists comes first.
    Raises SpecError where there is neither, or where the file is not UTF-8 text.
    """
    path = Path(path_or_name)
    if path.is_file():
        return _read(path)
    what = shelf.removesuffix("s")
    if path.exists():
        raise SpecError(f"{path} is not a file; expected a {what} as a TOML file")
    name, shipped = path.name.removesuffix(".toml"), list_shipped(shelf)
    if str(path.parent) in (".", shelf) and name in shipped:
        return files("sinew").joinpath(shelf, f"{name}.toml").read_text(encoding="utf-8")
    close = difflib.get_close_matches(name, shipped, n=1)
    advice = f"; did you mean {close[0]}?" if close else ""
    raise SpecError(f"no {what} {path_or_name}: found no such file, and Sinew ships {', '.join(shipped)}{advice}")


def read_ranges(rig: str) -> dict[str, dict[str, Any]] | None:
    """Return how far each calibrated parameter of a shipped rig can move, by dotted name; None where it is not known.

    A row is `{"value", "unit", "bounds": [low, high], "alone": [low, high], "together": [low, high]}`, as the
    calibration writes it beside the rig.
    """
    path = files("sinew").joinpath("rigs", f"{rig}-ranges.json")
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else None


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise SpecError(f"{path} is not text (byte {error.start}); expected TOML in UTF-8") from error
    except OSError as error:
        raise SpecError(f"cannot read {path}: {error.strerror or error}") from error
