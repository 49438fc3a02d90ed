"""This is where a plan's curves are foretold, for what is measured to be held against."""

import math
from typing import TYPE_CHECKING, Any

from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.plan.plan import Plan
    from sinew.predict.band import Band
    from sinew.predict.branch import Branch

__all__ = ["prediction_for_plan"]

_ROOM = 0.4
_SEED = 0


def prediction_for_plan(plan_toml: str, rig_toml: str, draws: int = 0) -> dict[str, Any]:
    """Return the predicted response at each pretension of a plan, over the frequencies that it drives.

    draws: rigs drawn from what is known of the rig's parameters, for 90 % bands; 0 for none.

    `curves`: in the plan's order of pretensions `pretension_mm`, and over the curve's points, which go through its
    folds, `frequency_hz`, `gain` (half of peak to peak over the commanded amplitude, what the analysis calls gain),
    `gain_measured_drive` (fundamentals, over the lever), `phase` (lag behind the lever [deg]), `stable`; `peak`,
    `phase_90` and `folds` as of `design_curves`. With bands also `gain_low`, `gain_high`, `phase_low`, `phase_high`:
    of what a sweep up or one down meets; None where no draw has a curve. `can_have_bands`: whether the rig holds
    intervals. `amplitude_deg`: of the command. `remarks`: sentences on the bands.
    Raises SpecError where a text is no plan or no rig.
    """
    import numpy as np

    from sinew.apps.dashboard.work.design import curve_document
    from sinew.plan.toml import parse_plan, parse_rig
    from sinew.predict.drawn import bands_of
    from sinew.predict.draws import draw_rigs, spread_of
    from sinew.predict.joint import RESOLUTION, joint_problem
    from sinew.predict.prediction import predict
    from sinew.twin.cache import configure

    configure()
    plan, rig = parse_plan(plan_toml), parse_rig(rig_toml)
    pretensions, mode = list(plan.pretension.pretension_mm), plan.pretension.mode
    amplitude_deg, band_hz = _driven(plan)
    prediction = predict(joint_problem(rig, pretensions, amplitude_deg, band_hz, mode=mode), band_hz, RESOLUTION)
    nominal = math.radians(amplitude_deg)
    curves = []
    for pretension, branch in zip(pretensions, prediction.branches, strict=True):
        curve = curve_document(branch, nominal)
        curves.append({"pretension_mm": pretension, **curve, "phase": curve.pop("phase_deg")})
    found: dict[str, Any] = {"curves": curves, "amplitude_deg": amplitude_deg, "remarks": []}
    try:
        spread_of(rig)
    except SpecError as nothing_known:
        return found | {"can_have_bands": False, "remarks": [str(nothing_known)]}
    if draws > 1:
        drawn = draw_rigs(rig, draws, _SEED)
        bands = bands_of(prediction, rig, drawn, pretensions, amplitude_deg, band_hz, mode=mode)
        for curve, branch, band in zip(curves, prediction.branches, bands, strict=True):
            for name, place, scale in (("gain", 0, 1 / nominal), ("phase", 1, float(np.degrees(1.0)))):
                low, high = _ends(branch, band, place)
                curve[f"{name}_low"], curve[f"{name}_high"] = _numbers(low * scale), _numbers(high * scale)
        found["remarks"] = list(drawn.remarks)
    return found | {"can_have_bands": True}


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


def _ends(branch: "Branch", band: "Band", place: int) -> Any:
    """Return the ends of a band at the points of its curve, (2, n); place: 0 amplitude [rad], 1 lag [rad]."""
    import numpy as np

    up, down = band.up[place], band.down[place]
    low, high = np.fmin(up.low, down.low), np.fmax(up.high, down.high)
    return np.array([np.interp(branch.frequency_hz, band.frequency_hz, end) for end in (low, high)])


def _numbers(values: Any) -> list[float | None]:
    return [float(one) if math.isfinite(one) else None for one in values]
