"""Calibration of a rig: parameters from recordings, and which of them these determine."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import xarray as xr

from sinew.identify.joint.fit import FREE, JointFit, fit_joint
from sinew.identify.joint.motion import make_coordinates, replaced, stated_repeatability
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import NORMAL_90, NORMAL_95, Estimate
from sinew.measure.files.netcdf import content_hash, load_recording
from sinew.measure.result import Field, Result, Rows
from sinew.measure.tasks import HERE, Spread, run_tasks
from sinew.plan.parameter import Parameter
from sinew.plan.rig import Calibrated, RigSpec
from sinew.plan.toml import load_rig, parse_rig
from sinew.solve.programs import configure

# A calibrated rig is told how its parameters vary together, those that only follow among them.


_STEP = 1e-4  # of a coordinate of the search
_STD_DIGITS, _CORRELATION_DIGITS = 6, 8
_HASH = 12


def with_ties(rig: RigSpec, found: Sequence[str], followed: Sequence[str], covariance: Array) -> Array:
    """Return the covariance of the found parameters and of those that are tied to them, shape (k, k), SI.

    rig: calibrated. found: m dotted names; covariance: of them, (m, m), SI. followed: dotted names.
    """
    coordinates = make_coordinates(rig, found)
    m = len(found)
    slopes = np.eye(m + len(followed), m)
    if followed:
        steps = _STEP * np.eye(m)
        moved = [_values(coordinates.rig_at(x), followed) - _values(coordinates.rig_at(-x), followed) for x in steps]
        slopes[m:] = (np.array(moved) / (2 * _STEP) / coordinates.slopes(np.zeros(m))[:, None]).T
    return np.asarray(slopes @ covariance @ slopes.T)


@dataclass(frozen=True)
class Source:
    """A recording that parameters came from. file: its name, without folder; content_hash: SHA-256, see provenance."""

    file: str
    content_hash: str


def calibrated_together(
    names: Sequence[str], covariance: Array, sources: Sequence[Source] = (), pretension_mm: Sequence[float] = ()
) -> Calibrated:
    """Return what a rig keeps of a covariance, shape (k, k), SI. Raises SpecError for one that is not finite."""
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    if not np.all(np.isfinite(covariance)):
        raise SpecError("the covariance of the calibrated parameters is not finite; free fewer parameters")
    safe = np.where(std > 0, std, 1.0)
    correlation = np.clip(covariance / np.outer(safe, safe), -1.0, 1.0)
    return Calibrated(
        recordings=tuple(f"{one.file} ({one.content_hash[:_HASH]})" for one in sources),
        pretension_mm=tuple(sorted(set(map(float, pretension_mm)))),
        parameters=tuple(names),
        std=tuple(float(f"{one:.{_STD_DIGITS}g}") for one in std),
        correlation=tuple(
            (*(round(float(one), _CORRELATION_DIGITS) + 0.0 for one in row[:i]), 1.0)
            for i, row in enumerate(correlation)
        ),
    )


def _values(rig: RigSpec, names: Sequence[str]) -> Array:
    table = dict(rig.parameters())
    return np.array([table[name].value for name in names])


# A rig gets calibrated parameters: value, origin, interval and a note on where they are from.

_NAMED_SOURCES = 3


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
    return replaced(rig, changed).model_copy(update={"name": name}), followed


def with_intervals(rig: RigSpec, intervals: Mapping[str, tuple[float, float]]) -> RigSpec:
    """Return the rig with 90 % intervals, by dotted name, in the unit of each parameter; values stay as they are.

    An interval that does not hold the value is left out: a most likely value may lie outside a skewed posterior's.
    """
    table = dict(rig.parameters())
    rows = {dotted: (float(f"{low:.4g}"), float(f"{high:.4g}")) for dotted, (low, high) in intervals.items()}
    return replaced(
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


_GEOMETRY = (
    "silicone.length",
    "tendons.free_span",
    "tendons.pulley_radius",
    "tendons.torque_constant",
    "inertia.head_mass",
    "imu.mount_radius",
    "imu.average_samples",
    "imu.low_pass",
)
"""What a joint fit takes from the rig as it is: for a bench that had it otherwise the parameters come out wrong."""

_WIDEST_SHARE = 0.5
"""Of the 90 % interval that a rig's bounds leave a parameter in the joint fit, taken there as a normal prior's 95 %."""

_PRIOR90_SHARE = NORMAL_90 / NORMAL_95


@dataclass(frozen=True, repr=False)
class CalibratedParameter(Result):
    """A parameter of the rig before and after, in its unit (SI); what followed another has no standard deviation."""

    unit: Annotated[str, Field("unit")]
    before: Annotated[float, Field("before")]
    after: Annotated[Estimate, Field("after (90 %)", "interval")]


@dataclass(frozen=True, repr=False)
class CalibratedNumber(Result):
    """A number of the paper, and the twin's with the calibrated rig."""

    quantity: Annotated[str, Field("number of the paper")]
    paper: Annotated[float, Field("paper")]
    twin: Annotated[float, Field("twin")]
    tolerance: Annotated[float, Field("tolerance")]


@dataclass(frozen=True, repr=False)
class CalibrationResult(Result):
    """A rig with new parameters. name, before: of the rig that comes out, and of the one it was made from."""

    name: Annotated[str, Field("", "detail")]
    before: Annotated[str, Field("", "detail")]
    parameters: Annotated[Mapping[str, CalibratedParameter], Field("parameter")]
    remarks: Annotated[tuple[str, ...], Field("", "detail")]

    def closing(self) -> list[str]:
        """Return what to know of the parameters."""
        return [f"- {sentence}" for sentence in self.remarks]


def calibrated_parameter(before: RigSpec, after: RigSpec, name: str, std: float = math.nan) -> CalibratedParameter:
    """Return a parameter in two rigs, by dotted name."""
    old, new = dict(before.parameters())[name], dict(after.parameters())[name]
    low, high = new.interval90 or (math.nan, math.nan)
    return CalibratedParameter(new.unit, old.value, Estimate(new.value, std, low, high))


@dataclass(frozen=True, repr=False)
class PaperCalibration(CalibrationResult):
    """A rig fitted to the paper's numbers. posterior: the file that was written, or None."""

    numbers: Annotated[Rows[CalibratedNumber], Field("")]
    posterior: Annotated[str | None, Field("", "detail")]


@dataclass(frozen=True, repr=False)
class Calibration(CalibrationResult):
    """A rig with parameters from recordings.

    recordings: file and content hash of each. undetermined: free names that the recordings do not determine; they
    have their old value and origin. rmse: residual of the fit, by channel.
    rig: with the new values. found: estimates of what the recordings determined, by dotted name, in the unit of the
    parameter (SI). fit: the last joint fit, with the others held. sources: of the recordings.
    """

    recordings: Annotated[tuple[Mapping[str, str], ...], Field("", "detail")]
    undetermined: Annotated[tuple[str, ...], Field("", "detail")]
    rmse: Annotated[Mapping[str, float], Field("", "detail")]
    converged: Annotated[bool, Field("", "detail")]
    rig: RigSpec
    found: dict[str, Estimate]
    fit: JointFit
    sources: tuple[Source, ...]


def calibrate(
    rig: RigSpec | str | Path,
    recordings: xr.Dataset | str | Path | Sequence[xr.Dataset | str | Path],
    *,
    name: str | None = None,
    free: Sequence[str] = FREE,
    spread: Spread = HERE,
    progress: Callable[[float, float], None] | None = None,
) -> Calibration:
    """Return a rig whose parameters come from recordings of it, each with origin, 90 % interval and source.

    rig: that was recorded, as such, its file or its name. recordings: of it, as such or as NetCDF files; one or more.
    name: of the rig that comes out. free: dotted names of the parameters to find; what the recordings do not determine,
    because its interval is unknown or more than half as wide as the bounds alone leave it, is held at its old value and
    origin, and the rest is fitted again beside it. spread: a cluster that fits instead of this process, and where the
    fit is kept. progress: called with (done, total). It takes about half a minute.
    Raises SpecError for a parameter that cannot be free and for a recording of a joint with another number of tendons,
    RecordingError where there is nothing to fit or nothing is determined.

    >>> import sinew as sn
    >>> mine = sn.calibrate("paper", sn.simulate("short", "paper"), name="mine")
    >>> low, high = mine.rig.silicone.torsional_rigidity.interval90
    >>> 0.28 < low < high < 0.30
    True
    """
    given = [recordings] if isinstance(recordings, (xr.Dataset, str, Path)) else list(recordings)
    rig = rig if isinstance(rig, RigSpec) else load_rig(rig)
    loaded = [one if isinstance(one, xr.Dataset) else load_recording(one) for one in given]
    files = [f"recording {i}" if isinstance(one, xr.Dataset) else Path(one).name for i, one in enumerate(given, 1)]
    sources = [
        Source(file, str(recording.attrs.get("content_hash") or content_hash(recording)))
        for file, recording in zip(files, loaded, strict=True)
    ]
    configure()
    for dotted in free:
        parameter_of(rig, dotted)
    remarks = [
        sentence
        for source, recording in zip(sources, loaded, strict=True)
        for sentence in other_geometry(rig, recording, source.file)
    ]
    sought, undetermined = list(free), list[str]()
    while True:
        if spread.scheduler is None and spread.keep is None:
            fit = fit_joint(loaded, rig, free=sought, progress=progress)
        else:  # each step of a search begins where the last ended: all of it is one task
            (fit,) = run_tasks(_fitted, [(tuple(loaded), rig, tuple(sought))], spread)
        vague = [one for one in sought if not _is_determined(fit.parameters[one], parameter_of(rig, one))]
        undetermined += vague
        if not vague:
            break
        sought = [one for one in sought if one not in vague]
        if not sought:
            raise RecordingError(
                f"the recordings determine none of {', '.join(free)}: every interval is about as wide as the bounds; "
                "record more pretensions and frequencies, or free fewer parameters"
            )
    found = {one: fit.parameters[one] for one in sought}
    calibrated, followed = calibrated_rig(rig, fit.fitted_rig, found, sources, name or f"{rig.name}-calibrated")
    own = fit.covariance.matrix[: len(sought), : len(sought)]
    together = with_ties(calibrated, sought, followed, own)
    record = calibrated_together([*sought, *followed], together, sources, fit.pretension_mm)
    calibrated = calibrated.model_copy(update={"calibration": record})
    pairs, settings = (
        f"pretension {1e3 * a:.2g} mm, guide friction {100 * b:.2g} %"
        for a, b in (fit.repeatability, stated_repeatability(rig))
    )
    remarks.append(
        "every pretension was set once, so how far settings scatter is not in the recordings; the intervals take the "
        f"rig's repeatability ({settings}); record repeats to have it estimated"
        if fit.repeats < 2
        else f"the intervals hold the scatter over {fit.repeats} repeats: {pairs} (the rig says {settings})"
    )
    if undetermined:
        remarks.append(
            f"not determined by these recordings, so with old value and origin: {', '.join(undetermined)}; "
            "the others were fitted beside them"
        )
    remarks += [sentence for sentence in (fit.message, *fit.unidentifiable) if sentence]
    return Calibration(
        name=calibrated.name,
        before=rig.name,
        parameters={
            one: calibrated_parameter(rig, calibrated, one, found[one].std if one in found else math.nan)
            for one in (*found, *followed)
        },
        remarks=tuple(remarks),
        recordings=tuple({"file": source.file, "content_hash": source.content_hash} for source in sources),
        undetermined=tuple(undetermined),
        rmse=fit.rmse,
        converged=fit.converged,
        rig=calibrated,
        found=found,
        fit=fit,
        sources=tuple(sources),
    )


def _fitted(task: tuple[Sequence[xr.Dataset], RigSpec, Sequence[str]]) -> JointFit:
    recordings, rig, sought = task
    return fit_joint(recordings, rig, free=sought)


def other_geometry(rig: RigSpec, recording: xr.Dataset, file: str) -> list[str]:
    """Return sentences on how the bench of a recording differs from the rig in what no fit finds out, if it does.

    file: what to call the recording. Raises SpecError where the number of tendons differs, or where the recording was
    imported from a table.
    """
    if recording.attrs.get("source") == "import":
        raise SpecError(f"{file} was imported from a table; expected a recording of a bench or of the twin")
    text = str(recording.attrs.get("rig", ""))
    if not text.strip():
        return [f"{file} does not say with which rig it was made; its geometry could not be compared"]
    own = parse_rig(text, source=f"the rig in {file}")
    if own.tendons.count != rig.tendons.count:
        raise SpecError(
            f"{file} was recorded with {own.tendons.count} tendons, the rig has {rig.tendons.count}; "
            "give the rig that it was recorded with"
        )
    lines = []
    for dotted in _GEOMETRY:
        theirs, ours = (_number(one, dotted) for one in (own, rig))
        if not math.isclose(theirs, ours, rel_tol=1e-6):
            lines.append(f"{dotted} {theirs:g} instead of {ours:g}")
    if not lines:
        return []
    return [
        f"{file} was recorded with another rig ({', '.join(lines)}, in SI units); the fit took the rig that was given"
    ]


def _number(rig: RigSpec, dotted: str) -> float:
    section, key = dotted.split(".")
    found = getattr(getattr(rig, section), key)
    return float(found.value if isinstance(found, Parameter) else found)


def _is_determined(estimate: Estimate, parameter: Parameter) -> bool:
    low, high = parameter.bounds
    if not all(map(math.isfinite, (estimate.value, estimate.std, estimate.low, estimate.high))):
        return False
    return estimate.high - estimate.low < _WIDEST_SHARE * _PRIOR90_SHARE * (high - low)
