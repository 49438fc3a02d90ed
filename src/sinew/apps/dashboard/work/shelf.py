"""This is where the rigs and plans to choose from are listed: those that ship with Sinew, and the lab's own."""

import re
from pathlib import Path
from typing import Any, cast

from sinew.apps.dashboard.names import SHELVES, held_inside
from sinew.measure.errors import FileError, SinewError, SpecError
from sinew.plan.library import Shelf, list_shipped, read_spec
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_plan, parse_rig

__all__ = ["read_shelf", "shelf"]

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
        words.append(f"sweep of {frequency[0]:g} to {frequency[-1]:g} Hz at {plan.sweep.amplitude_deg:g}°")
    if plan.ring_down is not None:
        words.append("ring-downs")
    if plan.track is not None:
        words.append("tracking")
    minutes = sum(group.duration_s for group in plan.groups()) / 60
    return f"{', '.join(words)}; {minutes:.1f} min" if minutes < 10 else f"{', '.join(words)}; {minutes:.0f} min"
