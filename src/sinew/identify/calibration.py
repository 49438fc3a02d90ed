"""This is where a rig takes its parameters from recordings, and where it is said which of them these determine."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import xarray as xr

from sinew.identify.calibration_rig import Source, calibrated_rig, parameter_of
from sinew.identify.calibration_spread import calibrated_together, with_ties
from sinew.identify.joint_fit import FREE, fit_joint
from sinew.identify.joint_fitted import JointFit
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import Estimate
from sinew.plan.parameter import Parameter
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_rig

__all__ = ["Calibration", "calibrate_rig", "other_geometry"]

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

_PRIOR90_SHARE = 1.6448536269514722 / 1.959963984540054


@dataclass(frozen=True)
class Calibration:
    """A rig with parameters from recordings.

    before, rig: as it was given, and with the new values. found: estimates of what the recordings determined, by
    dotted name, in the unit of the parameter (SI). followed: names that moved because they are tied to those.
    kept: names that were free and that the recordings do not determine; they have their old value and origin.
    fit: the last joint fit, with those held. sources: of the recordings. remarks: sentences on what to know of it.
    """

    before: RigSpec
    rig: RigSpec
    found: dict[str, Estimate]
    followed: tuple[str, ...]
    kept: tuple[str, ...]
    fit: JointFit
    sources: tuple[Source, ...]
    remarks: tuple[str, ...]


def calibrate_rig(
    recordings: Sequence[xr.Dataset],
    sources: Sequence[Source],
    rig: RigSpec,
    *,
    name: str,
    free: Sequence[str] = FREE,
    progress: Callable[[float, float], None] | None = None,
) -> Calibration:
    """Return the rig with its free parameters as the recordings have them.

    sources: of the recordings, in their order. name: of the rig that comes out. free: dotted names of parameters.
    What the recordings do not determine, because its interval is unknown or more than half as wide as the bounds alone
    leave it, is held at its old value, and the rest is fitted again beside it.
    Raises SpecError for a name that cannot be free and for a recording of a joint with another number of tendons,
    RecordingError where there is nothing to fit or nothing is determined.
    """
    for dotted in free:
        parameter_of(rig, dotted)
    remarks = [
        sentence
        for source, recording in zip(sources, recordings, strict=True)
        for sentence in other_geometry(rig, recording, source.file)
    ]
    sought, kept = list(free), list[str]()
    while True:
        fit = fit_joint(recordings, rig, free=sought, progress=progress)
        vague = [one for one in sought if not _is_determined(fit.parameters[one], parameter_of(rig, one))]
        kept += vague
        if not vague:
            break
        sought = [one for one in sought if one not in vague]
        if not sought:
            raise RecordingError(
                f"the recordings determine none of {', '.join(free)}: every interval is about as wide as the bounds; "
                "record more pretensions and frequencies, or free fewer parameters"
            )
    found = {one: fit.parameters[one] for one in sought}
    calibrated, followed = calibrated_rig(rig, fit.fitted_rig, found, sources, name)
    own = fit.covariance.matrix[: len(sought), : len(sought)]
    together = with_ties(calibrated, sought, followed, own)
    record = calibrated_together([*sought, *followed], together, sources, fit.pretension_mm)
    calibrated = calibrated.model_copy(update={"calibration": record})
    if kept:
        remarks.append(
            f"not determined by these recordings, so with old value and origin: {', '.join(kept)}; "
            "the others were fitted beside them"
        )
    remarks += [sentence for sentence in (fit.message, *fit.unidentifiable) if sentence]
    return Calibration(rig, calibrated, found, followed, tuple(kept), fit, tuple(sources), tuple(remarks))


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
    told = []
    for dotted in _GEOMETRY:
        theirs, ours = (_number(one, dotted) for one in (own, rig))
        if not math.isclose(theirs, ours, rel_tol=1e-6):
            told.append(f"{dotted} {theirs:g} instead of {ours:g}")
    if not told:
        return []
    return [
        f"{file} was recorded with another rig ({', '.join(told)}, in SI units); the fit took the rig that was given"
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
