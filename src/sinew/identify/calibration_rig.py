"""This is where a rig gets calibrated parameters: value, origin, interval and a note on where they are from."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import xarray as xr

from sinew.measure.errors import SpecError
from sinew.measure.estimate import Estimate
from sinew.measure.provenance import content_hash
from sinew.plan.parameter import Parameter
from sinew.plan.rig import RigSpec

__all__ = ["Source", "calibrated_rig", "parameter_of", "source_of", "with_intervals"]

_NAMED_SOURCES = 3


@dataclass(frozen=True)
class Source:
    """A recording that parameters came from. file: its name, without folder; content_hash: SHA-256, see provenance."""

    file: str
    content_hash: str


def source_of(file: str, recording: xr.Dataset) -> Source:
    """Return what a parameter's note says of the recording in a file."""
    return Source(file, str(recording.attrs.get("content_hash") or content_hash(recording)))


def parameter_of(rig: RigSpec, dotted: str) -> Parameter:
    """Return one parameter by its dotted name. Raises SpecError where the rig has none of that name."""
    table = dict(rig.parameters())
    if dotted not in table:
        raise SpecError(f"the rig has no parameter {dotted!r}; expected one of {', '.join(table)}")
    return table[dotted]


def calibrated_rig(
    rig: RigSpec, fitted: RigSpec, found: Mapping[str, Estimate], sources: Sequence[Source], name: str
) -> tuple[RigSpec, tuple[str, ...]]:
    """Return (rig with the found values, names that moved because they are tied to those).

    fitted: the rig of the fit, from which tied parameters take their value. found: by dotted name, in the unit of the
    rig's parameter. name: of the new rig. A value has six digits, its interval ends at the bounds; the parameters that
    were not found keep value, origin, interval and note. Raises SpecError for a value outside its bounds.
    """
    note, after = _note(sources), dict(fitted.parameters())
    changed: dict[str, Parameter] = {}
    for dotted, old in rig.parameters():
        if dotted in found:
            one = found[dotted]
            ends = (max(one.low, old.bounds[0]), min(one.high, old.bounds[1]))
            changed[dotted] = _changed(dotted, old, one.value, ends, note)
        elif not math.isclose(after[dotted].value, old.value, rel_tol=1e-9):
            changed[dotted] = _changed(dotted, old, after[dotted].value, None, f"moves with others that were {note}")
    followed = tuple(dotted for dotted in changed if dotted not in found)
    return _replaced(rig, changed).model_copy(update={"name": name}), followed


def with_intervals(rig: RigSpec, intervals: Mapping[str, tuple[float, float]]) -> RigSpec:
    """Return the rig with 90 % intervals, by dotted name, in the unit of each parameter; values stay as they are.

    An interval that does not hold the value is left out: a most likely value may lie outside a skewed posterior's.
    """
    table = dict(rig.parameters())
    rows = {dotted: (float(f"{low:.4g}"), float(f"{high:.4g}")) for dotted, (low, high) in intervals.items()}
    return _replaced(
        rig,
        {
            dotted: table[dotted].model_copy(update={"interval90": ends})
            for dotted, ends in rows.items()
            if ends[0] <= table[dotted].value <= ends[1]
        },
    )


def _note(sources: Sequence[Source]) -> str:
    named = ", ".join(f"{one.file} ({one.content_hash[:12]})" for one in sources[:_NAMED_SOURCES])
    more = len(sources) - _NAMED_SOURCES
    return f"fitted to {named}" + (f" and {more} more" if more > 0 else "")


def _changed(dotted: str, old: Parameter, value: float, ends: tuple[float, float] | None, note: str) -> Parameter:
    low, high = old.bounds
    if not low <= _rounded(value) <= high:
        raise SpecError(
            f"{dotted} came out at {value:.4g} {old.unit}, outside its bounds [{low:g}, {high:g}]; check that the "
            "recordings are of this rig, or widen the bounds in the rig file"
        )
    interval = None if ends is None else (_rounded(min(ends[0], value)), _rounded(max(ends[1], value)))
    return Parameter(
        value=_rounded(value), unit=old.unit, origin="calibrated", bounds=old.bounds, interval90=interval, note=note
    )


def _rounded(number: float) -> float:
    return float(f"{number:.6g}")


def _replaced(rig: RigSpec, changed: Mapping[str, Parameter]) -> RigSpec:
    """Return the rig with whole parameters replaced; `RigSpec.with_values` would drop the intervals of the others."""
    parts: dict[str, object] = {}
    for section in {dotted.split(".")[0] for dotted in changed}:
        mine = {dotted.split(".")[1]: one for dotted, one in changed.items() if dotted.startswith(f"{section}.")}
        parts[section] = getattr(rig, section).model_copy(update=mine)
    return rig.model_copy(update=parts)
