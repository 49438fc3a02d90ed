"""This is where the fits of `sinew identify` become what it tells: a document, and sentences."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    import xarray as xr

    from sinew.identify.comparison import Comparison
    from sinew.identify.fitted import Fit
    from sinew.identify.held_out import HeldOut, Split
    from sinew.identify.joint_fitted import JointFit
    from sinew.identify.model import Model
    from sinew.identify.posterior import Posterior
    from sinew.identify.record import Record
    from sinew.plan.rig import RigSpec

__all__ = ["Found", "find_joint", "find_mechanics", "joint_names"]

Range = tuple[int, int]
Progress = Callable[[float, float], None]

# A rig's tendons are the same to both sides: a quadratic term is asked for by name.
_SEGMENT_LAWS = ("linear", "loss-factor", "coulomb", "cubic", "loss-factor-cubic", "coulomb-cubic")


@dataclass
class Found:
    """What was found, and what it was found from.

    document: as `--json` prints it. sentences: those of its `message`, the verdict first.
    fit: of one degree of freedom, or None. split, held_out: of one record, what was held out and how it was predicted.
    joint: of the tendon joint, or None. posterior: draws, where they were asked for.
    """

    document: dict[str, Any]
    sentences: list[str]
    fit: "Fit | None" = None
    split: "Split | None" = None
    held_out: "HeldOut | None" = None
    joint: "JointFit | None" = None
    posterior: "Posterior | None" = None


def find_mechanics(
    records: "Sequence[Record]",
    model: str,
    train: Range | None,
    test: Range | None,
    *,
    remarks: Sequence[str] = (),
    progress: Progress | None = None,
) -> Found:
    """Return what records of one degree of freedom tell. remarks: sentences on the input, put behind the verdict.

    Raises RecordingError and SpecError where they tell nothing.
    """
    from sinew.identify.diagnosis import refuse_hopeless
    from sinew.identify.held_out import split_record
    from sinew.identify.model import get_model
    from sinew.twin.cache import configure

    configure()
    wanted = None if model == "auto" else get_model(model)
    for record in records:
        refuse_hopeless(record)
    if len(records) > 1:
        if train is not None or test is not None:
            raise SpecError("--train and --test are for one record; this recording has several segments")
        if len(records) > 2:
            return _of_segments(records, wanted, remarks, progress)
        remarks = [*remarks, "of two segments the first was fitted; three and more are fitted together"]
    split = split_record(records[0], train, test)
    taught = [int(k) for k in split.kept.nonzero()[0][[0, -1]]]
    refuse_hopeless(split.record.cut(taught[0], taught[1] + 1))
    return _of_record(split, wanted, remarks, progress)


def _of_record(split: "Split", wanted: "Model | None", remarks: Sequence[str], progress: Progress | None) -> Found:
    from sinew.identify.comparison import compare, compare_laws

    compared = compare_laws(split, progress) if wanted is None else compare(split, [wanted])
    found = _of_comparison(compared, remarks)
    found.split, found.held_out = split, compared.rows[0].held_out
    return found


def _of_segments(
    records: "Sequence[Record]", wanted: "Model | None", remarks: Sequence[str], progress: Progress | None
) -> Found:
    """Return what several segments of a rig with the same mechanics tell; every third is held out in turn."""
    from sinew.identify.segment_comparison import compare_segments

    models = _SEGMENT_LAWS if wanted is None else (wanted,)
    compared = compare_segments(records, models, varying=(), progress=progress)
    levels = dict.fromkeys(record.group.split(",")[0] for record in records)
    told = f"{len(records)} segments at {' and '.join(levels)} were fitted together, each third of them held out once"
    return _of_comparison(compared, [told, *remarks])


def _of_comparison(compared: "Comparison", remarks: Sequence[str]) -> Found:
    from sinew.identify.diagnosis import suspicions

    best, row = compared.best, compared.rows[0]
    told = [
        compared.verdict,
        *remarks,
        best.message,
        *_impossible(best),
        *suspicions(best, compared=len(compared.rows) > 1),
    ]
    rows = [
        {"model": one.model.name, "rmse_test": _number(one.rmse_test), "bic": _number(one.bic)} for one in compared.rows
    ]
    return Found(_fit_part(best, row.rmse_test, told) | {"compared": rows}, told, fit=best)


def _impossible(best: "Fit") -> list[str]:
    """Return a sentence where a friction or a loss factor is negative for certain."""
    from sinew.identify.comparison import impossible_numbers

    words = {"coulomb": "dry friction", "loss_factor": "loss factor"}
    negative = impossible_numbers(best)
    return [
        f"the {word} came out negative, which nothing has: the damping depends on amplitude or frequency in another way"
        for start, word in words.items()
        if any(name.startswith(start) for name in negative)
    ]


def find_joint(recording: "xr.Dataset", rig: "RigSpec", progress: Progress | None = None) -> Found:
    """Return what the recording of a rig tells of its tendon joint."""
    from sinew.identify.joint_fit import fit_joint
    from sinew.twin.cache import configure

    configure()
    joint = fit_joint([recording], rig, progress=progress)
    whole = joint.document()
    document = {key: one for key, one in whole.items() if key not in _OWN_KEYS}
    named = dict(zip(joint_names(joint), (one.to_json() for one in joint.parameters.values()), strict=True))
    document["parameters"] = named | {name: one.to_json() for name, one in joint.derived.items()}
    levels = ", ".join(f"{one:g}" for one in joint.pretension_mm)
    at = f"natural frequency and damping ratio are those at {joint.pretension_mm[0]:g} mm"
    told = [f"the tendon joint was fitted to {len(joint.segments)} segments at {levels} mm; {at}", joint.message]
    document["message"] = "; ".join(told)
    return Found(document, told, joint=joint)


_OWN_KEYS = ("units", "derived", "by_pretension")
"""Of a joint fit's document what other models have not; here it stands under `parameters`."""


def joint_names(joint: "JointFit") -> tuple[str, ...]:
    """Return the names of the fitted parameters of a tendon joint: the rig's, with their units."""
    units = {name: parameter.unit for name, parameter in joint.rig.parameters()}
    return tuple(_with_unit(name, units.get(name, "1")) for name in joint.parameters)


def _with_unit(name: str, unit: str) -> str:
    """Return a rig's name of a parameter with its unit at the end: "tendons.head_radius" gives "..._m"."""
    token = unit.lower().replace("^", "").replace("*", "_").replace("/", "_per_").replace(" ", "")
    return name if unit == "1" else f"{name}_{token}"


def _fit_part(best: "Fit", rmse_test: float | None, told: Sequence[str]) -> dict[str, Any]:
    return {
        "model": best.model.name,
        "parameters": {name: one.to_json() for name, one in best.parameters.items()},
        "natural_frequency_hz": best.natural_frequency_hz.to_json(),
        "damping_ratio": best.damping_ratio.to_json(),
        "rmse": {"train": _number(best.rmse), "test": None if rmse_test is None else _number(rmse_test)},
        "unit": best.unit,
        "converged": best.converged,
        "message": "; ".join(told),
        "unidentifiable": list(best.unidentifiable),
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
