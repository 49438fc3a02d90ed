"""What is computed before anything moves: the joint that sliders describe, a plan's preview and its prediction."""

import functools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from sinew.measure.errors import SpecError
from sinew.measure.estimate import all_finite

if TYPE_CHECKING:
    from sinew.measure.arrays import Array
    from sinew.plan.plan import Plan
    from sinew.plan.rig import RigSpec
    from sinew.predict.predicted import BandResult, CurveResult, MarkResult


_CHANGES = ("length_mm", "outer_mm", "tendon_circle_mm", "lever_inertia_kg_m2")
_NEAR = 5  # points of a curve about its 90° of lag


def design_curves(
    rig: str,
    changes: Mapping[str, float | None],
    pretension_mm: float,
    amplitude_deg: float,
    band_hz: Sequence[float] = (1.0, 6.0),
) -> dict[str, Any]:
    """Return the predicted response of a joint that is built or not: a third of a second, once equations are compiled.

    rig: name of a shipped one, or its TOML text. changes: see `changed_rig`; empty for the rig as it is.
    pretension_mm [mm], amplitude_deg: of the drive's command [deg]. band_hz: first and last frequency.

    See `curve_document`; further `damping`: Lehr's D by the slope of the lag over frequency where it is 90°,
    D = 1/(f dφ/df), None where it is not passed. `warnings`: sentences on what is assumed and does not hold, and on the
    curve. `error_estimate`, in shares of the curve's height. Raises SpecError where a number cannot be meant.
    """
    from sinew.predict.predicted import predict
    from sinew.solve.programs import configure

    configure()
    low, high = (float(hertz) for hertz in band_hz)
    made = changed_rig(base_rig(rig), changes)
    found = predict(made, float(pretension_mm), amplitude_deg=amplitude_deg, band_hz=(low, high))
    return {
        **curve_document(found.branches[0], amplitude_deg),
        "damping": slope_damping(found.branches[0]),
        "error_estimate": found.error_estimate,
        "warnings": [
            *(check.sentence for check in found.validity if not check.holds),
            *(remark.removeprefix("- ") for remark in found.branches[0].remarks()),
        ],
    }


def curve_document(curve: "CurveResult", amplitude_deg: float) -> dict[str, Any]:
    """Return a predicted curve as lists over its points, which go through its folds, with its marks, for JSON.

    `frequency_hz`, `gain` (half of peak to peak of the torsion over the command's amplitude, as the analysis' `gain`),
    `phase` (lag behind the lever [deg]), `stable`; `folds`, `peak`, `phase_90`: each with `frequency_hz` and `gain`.
    """

    def mark(one: "MarkResult | None") -> dict[str, float] | None:
        return None if one is None else {"frequency_hz": one.frequency_hz, "gain": one.amplitude_deg / amplitude_deg}

    return {
        "frequency_hz": curve.frequency_hz.tolist(),
        "gain": (curve.amplitude_deg / amplitude_deg).tolist(),
        "phase": curve.phase_deg.tolist(),
        "stable": curve.stable.tolist(),
        "folds": [mark(fold) for fold in curve.folds],
        "peak": mark(curve.peak),
        "phase_90": mark(curve.phase_90),
    }


def slope_damping(curve: "CurveResult") -> float | None:
    """Return Lehr's damping of a curve by the slope of its lag at 90°; None where that is not passed.

    An oscillator's lag has the slope dφ/df = 1/(D f) there. Where losses or stiffness change with the swing, so does
    the slope, which is that of motions of a constant command.
    """
    import numpy as np

    mark = curve.phase_90
    if mark is None:
        return None
    # The cotangent of an oscillator's lag is all but straight over frequency, and its slope there is that of the lag.
    near = np.argsort(np.abs(curve.phase_deg - 90.0))[:_NEAR]
    off = curve.frequency_hz[near] / mark.frequency_hz - 1
    if np.ptp(off) == 0:
        return None
    slope = -np.polyfit(off, 1 / np.tan(np.radians(curve.phase_deg[near])), min(2, near.size - 1))[-2]
    return 1 / float(slope) if slope > 0 else None


def changed_rig(base: "RigSpec", changes: Mapping[str, float | None]) -> "RigSpec":
    """Return the rig that a base becomes with some changes, by the names of the options of `sinew predict`.

    `length_mm`, `outer_mm` (of a circle), `tendon_circle_mm`, `lever_inertia_kg_m2`; None leaves a part as it is.
    Raises SpecError for an unknown name, and where a number cannot be meant.
    """
    from sinew.apps.joints.options import JointOptions, design_of
    from sinew.predict.design import design_rig

    given: dict[str, Any] = {name: value for name, value in changes.items() if value is not None}
    for name, value in given.items():
        if name not in _CHANGES:
            raise SpecError(f"found a change of {name}, expected one of {', '.join(_CHANGES)}")
        if not (math.isfinite(value) and value > 0):
            raise SpecError(f"{name} is {value:g}, expected a positive number")
    if not given:
        return base
    return design_rig(base, design_of(JointOptions(section="circle" if "outer_mm" in given else None, **given)))


def rig_text(rig: str, changes: Mapping[str, float | None], name: str) -> str:
    """Return the TOML text of a rig with some changes, under a name of its own. Arguments and errors as of
    `changed_rig`."""
    from sinew.plan.toml import dump_rig

    return dump_rig(changed_rig(base_rig(rig), changes).model_copy(update={"name": name}))


@functools.lru_cache(maxsize=16)
def base_rig(rig: str) -> "RigSpec":
    """Return the rig of a shipped name or of a TOML text. Raises SpecError."""
    from sinew.plan.toml import load_rig, parse_rig

    return parse_rig(rig) if "\n" in rig else load_rig(rig)


# A plan's curves are foretold, for what is measured to be held against.

_NOT_PREDICTED = (
    "This page holds no prediction beside a head that bends or sways; sinew predict --bend-deg says how it swings."
)
_ROOM = 0.4


def prediction_for_plan(plan_toml: str, rig_toml: str, draws: int = 0) -> dict[str, Any]:
    """Return the predicted response at each pretension of a plan, over the frequencies that it drives.

    Of a head that bends or sways there is none here, `curves` is empty and `remarks` says so.

    draws: rigs drawn from what is known of the rig's parameters, for 90 % bands; 0 for none.

    `curves`: in the plan's order of pretensions `pretension_mm` and what `curve_document` has; with bands also
    `gain_low`, `gain_high`, `phase_low`, `phase_high`: of what a sweep up or one down meets; None where no draw has a
    curve. `can_have_bands`: whether the rig holds intervals. `remarks`: sentences on the bands.
    Raises SpecError where a text is no plan or no rig.
    """
    from sinew.plan.toml import parse_plan, parse_rig

    plan, rig = parse_plan(plan_toml), parse_rig(rig_toml)
    if plan.is_spatial:
        return {"curves": [], "can_have_bands": False, "remarks": [_NOT_PREDICTED]}
    from sinew.predict.band import spread_of
    from sinew.predict.predicted import predict
    from sinew.solve.programs import configure

    configure()
    amplitude_deg, band_hz = _driven(plan)
    can_have, remarks = True, []
    try:
        spread_of(rig)
    except SpecError as nothing_known:
        can_have, remarks = False, [str(nothing_known)]
    found = predict(
        rig,
        plan.pretension.pretension_mm,
        amplitude_deg=amplitude_deg,
        mode=plan.pretension.mode,
        band_hz=band_hz,
        bands=draws if draws > 1 and can_have else None,
    )
    curves = []
    for pretension, curve in zip(plan.pretension.pretension_mm, found.branches, strict=True):
        curves.append({"pretension_mm": pretension, **curve_document(curve, amplitude_deg)})
    for made, curve, band in zip(curves, found.branches, found.bands or (), strict=False):
        for name, key, scale in (("gain", "amplitude_deg", 1 / amplitude_deg), ("phase", "phase_deg", 1.0)):
            low, high = _ends(curve.frequency_hz, band, key)
            made[f"{name}_low"], made[f"{name}_high"] = all_finite(low * scale), all_finite(high * scale)
    return {
        "curves": curves,
        "can_have_bands": can_have,
        "remarks": [*remarks, *(found.draws.remarks if found.draws else ())],
    }


def _driven(plan: "Plan") -> tuple[float, tuple[float, float]]:
    """Return (amplitude of the command [deg], lowest and highest frequency [Hz]) that a plan drives with."""
    if plan.sweep is not None:
        low, high, amplitude = plan.sweep.frequency_hz[0], plan.sweep.frequency_hz[-1], plan.sweep.amplitude_deg
    elif plan.track is not None:
        low, high, amplitude = plan.track.low_hz, plan.track.high_hz, max(plan.track.amplitude_deg)
    else:
        assert plan.ring_down is not None
        low, high = min(plan.ring_down.frequency_hz), max(plan.ring_down.frequency_hz)
        amplitude = plan.ring_down.amplitude_deg
    if high < low * (1 + _ROOM):
        return amplitude, (low / (1 + _ROOM), high * (1 + _ROOM))
    return amplitude, (low, high)


def _ends(frequency_hz: "Array", band: "BandResult", key: str) -> "Array":
    """Return the ends of a band at some frequencies, (2, n). key: amplitude_deg or phase_deg."""
    import numpy as np

    up, down = band.up[key], band.down[key]
    low, high = np.fmin(up.low, down.low), np.fmax(up.high, down.high)
    return np.array([np.interp(frequency_hz, band.frequency_hz, end) for end in (low, high)])


# A plan is previewed for its page: its faults and stages at once, and what `sinew check --json` says of it.


def plan_outline(plan_toml: str, rig_toml: str | None = None) -> dict[str, Any]:
    """Return what is known of a plan's text at once: `faults`, as `sinew.plan.toml.plan_faults` has them, each with
    `line`, `sentence` and `is_limit`; where it is a plan, though it may break limits of a rig, also `name` and
    `stages`, as `sinew.plan.check.stages_of` has them. Raises SpecError where the other text is no rig."""
    from sinew.plan.check import stages_of
    from sinew.plan.toml import parse_plan, plan_faults

    faults = plan_faults(plan_toml, None if rig_toml is None else base_rig(rig_toml))
    document = {"faults": [fault._asdict() for fault in faults]}
    if not all(fault.is_limit for fault in faults):
        return document
    plan = parse_plan(plan_toml)
    return {**document, "name": plan.name, "stages": [stage._asdict() for stage in stages_of(plan)]}


def preview_document(plan_toml: str, rig_toml: str, swing: bool = True) -> dict[str, Any]:
    """Return what `sinew check --json` says of a plan on a rig, further `refusals` and `warnings` as sentences.

    plan_toml, rig_toml: texts. swing: simulate the plan for its largest torsions, which takes seconds where it is long;
    of a head that bends or sways they are not foretold. A slack tendon is refused, as every bench refuses it. A plan
    that breaks a limit is an answer, with `ok` false. Raises SpecError where a text is no plan or no rig, or the plan
    drives as no bench does.
    """
    from sinew.bench.preflight import wire_times
    from sinew.plan.plan import require_motors
    from sinew.plan.toml import parse_plan, parse_rig
    from sinew.predict.preview import expected_of_plan, held_preview, preview_document, preview_plan

    plan, rig = parse_plan(plan_toml), parse_rig(rig_toml)
    require_motors(plan, "the bench")
    if swing and not plan.is_spatial:
        preview = expected_of_plan(plan, rig)[0]
    else:
        preview = held_preview(plan, rig)[0] if plan.is_spatial else preview_plan(plan, rig)
    warnings = [finding.sentence for finding in preview.findings if finding.severity == "warn"]
    document = preview_document(plan, rig, preview) | {"wire": wire_times(plan, rig)}
    return {**document, "refusals": list(preview.refusals), "warnings": warnings}
