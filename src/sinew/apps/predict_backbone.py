"""This is where `sinew predict` tells of backbones and of harmonics above the first."""

from typing import TYPE_CHECKING, Any

from sinew.apps.console import print_table
from sinew.measure.estimate import number

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from sinew.plan.plan import TendonMode
    from sinew.plan.rig import RigSpec
    from sinew.predict.backbone import Backbone
    from sinew.predict.branch import Branch
    from sinew.predict.describing import Equivalent
    from sinew.predict.oscillator import Oscillator
    from sinew.twin.effects import Effects

__all__ = [
    "equivalent_document",
    "oscillator_backbones",
    "print_backbones",
    "rig_backbones",
    "shares_document",
]


def _numbers(values: "NDArray[np.float64]") -> list[float | None]:
    import numpy as np

    return [float(value) if np.isfinite(value) else None for value in values]


def shares_document(branch: "Branch") -> dict[str, list[float | None]]:
    """Return the harmonics from the second to the fifth as shares of the fundamental, by order."""
    from sinew.predict.describing import harmonic_shares

    return {str(order): _numbers(share) for order, share in harmonic_shares(branch).items()}


def equivalent_document(equivalent: "Equivalent") -> dict[str, list[float | None]]:
    """Return the spring and damper that take the fundamental's place."""
    return {
        "stiffness_n_m_rad": _numbers(equivalent.stiffness),
        "damping_n_m_s_rad": _numbers(equivalent.damping),
        "damping_ratio": _numbers(equivalent.damping_ratio),
    }


def _document(
    backbone: "Backbone", pretension_mm: float | None, drive: dict[str, Any], equivalent: "Equivalent"
) -> dict[str, Any]:
    import numpy as np

    curve = backbone.curve
    return {
        "pretension_mm": pretension_mm,
        "frequency_hz": curve.frequency_hz.tolist(),
        "amplitude_deg": np.degrees(curve.amplitude).tolist(),
        "fundamental_deg": np.degrees(curve.fundamental).tolist(),
        **drive,
        **equivalent_document(equivalent),
        "harmonic_shares": shares_document(curve),
        "stable": curve.stable.tolist(),
        "multiplier": curve.multiplier.tolist(),
        "error": curve.error.tolist(),
        "complete": curve.complete,
        "message": curve.message,
    }


def oscillator_backbones(one: "Oscillator", band_hz: tuple[float, float]) -> list[dict[str, Any]]:
    """Return the backbone of an oscillator up to its drive."""
    import numpy as np

    from sinew.predict.backbone import follow_backbones
    from sinew.predict.describing import equivalent_of_oscillator
    from sinew.predict.oscillator import oscillator_problem, resolution_of

    (backbone,) = follow_backbones(oscillator_problem([one], band_hz), band_hz, resolution_of([one]))
    share = backbone.share
    drive = {"torque_n_m": (share * one.torque).tolist()}
    if one.base:
        drive = {"base_deg": np.degrees(share * one.base).tolist()}
    return [_document(backbone, None, drive, equivalent_of_oscillator(backbone.curve, one, share))]


def rig_backbones(
    rig: "RigSpec",
    pretensions: list[float],
    amplitude_deg: float,
    band_hz: tuple[float, float],
    mode: "TendonMode",
    effects: "Effects",
) -> list[dict[str, Any]]:
    """Return the backbone of a rig at each pretension, up to an amplitude of the command."""
    import numpy as np

    from sinew.predict.backbone import follow_backbones
    from sinew.predict.describing import equivalent_of_rig
    from sinew.predict.joint import RESOLUTION, joint_problem

    problem = joint_problem(rig, pretensions, amplitude_deg, band_hz, mode=mode, effects=effects)
    documents = []
    for mm, backbone in zip(pretensions, follow_backbones(problem, band_hz, RESOLUTION), strict=True):
        command = backbone.share * np.radians(amplitude_deg)
        lever = backbone.curve.drive * (command if problem.equations.drive is None else 1.0)
        drive = {
            "command_deg": np.degrees(command).tolist(),
            "lever_deg": np.degrees(np.abs(lever)).tolist(),
        }
        documents.append(_document(backbone, mm, drive, equivalent_of_rig(backbone.curve, lever, rig)))
    return documents


def print_backbones(backbones: list[dict[str, Any]]) -> None:
    """Print where each backbone begins and ends."""

    def cells(one: dict[str, Any], at: int) -> str:
        ratio = one["damping_ratio"][at]
        swing = f"{number(one['frequency_hz'][at], unit='Hz')}, {number(one['amplitude_deg'][at])}°"
        return swing if ratio is None else f"{swing}, D {number(ratio, 3)}"

    rows = []
    for one in backbones:
        name = "-" if one["pretension_mm"] is None else f"{one['pretension_mm']:g}"
        ends = (cells(one, 0), cells(one, -1)) if one["frequency_hz"] else ("-", "-")
        rows.append((name, *ends, str(len(one["frequency_hz"]))))
    print_table(("pretension/mm", "weakest drive", "whole drive", "points"), rows, "backbone: response lags by 90°")
    for one in backbones:
        if not one["complete"]:
            print(f"- {one['message']}")
