"""This is where a prediction, of one rig or of several, becomes one HTML page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sinew.figures.page import picture, write_page
from sinew.figures.prediction_captions import PREDICTION_CAPTIONS
from sinew.figures.tables import Table, number

__all__ = ["write_prediction_page"]

_HEAD = ["p in mm", "peak in Hz", "amplitude in °", "gain", "90° of lag in Hz", "folds in Hz", "complete"]


def write_prediction_page(
    path: Path,
    rigs: Sequence[Mapping[str, Any]],
    *,
    amplitude_deg: float,
    figures: Sequence[Path] = (),
    rebuild: str = "",
    origins: Sequence[tuple[str, str]] = (),
) -> Path:
    """Write the page, atomically, and return its path.

    rigs: documents of `sinew predict`. amplitude_deg: of the drive's command. figures: the PNGs among them are put
    into the page. rebuild: the command that makes all of this again. origins: (name, value) of what it was made from.
    Raises FileError where the folder cannot be written.
    """
    several = len(rigs) > 1
    broken = sum(not check["holds"] for rig in rigs for check in rig["validity"])
    worth = (
        "Every assumption that was checked holds."
        if not broken
        else f"{broken} of the checked assumptions {'does' if broken == 1 else 'do'} not hold."
    )
    return write_page(
        path,
        "prediction.html",
        title="Rigs compared" if several else f"Predicted response of “{rigs[0]['rig']}”",
        about=f"Steady response to a lever that is commanded to swing by {amplitude_deg:g}°.",
        lead=worth,
        tables=[
            Table(str(rig["rig"]) if several else "", _HEAD, _rows(rig, amplitude_deg), _note(rig)) for rig in rigs
        ],
        pictures=[picture(one, PREDICTION_CAPTIONS) for one in figures if one.suffix == ".png"],
        validity=[{"title": rig["rig"] if several else "", "checks": rig["validity"]} for rig in rigs],
        rebuild=rebuild,
        origins=list(origins),
    )


def _rows(rig: Mapping[str, Any], amplitude_deg: float) -> list[list[str]]:
    rows = []
    for branch in rig["branches"]:
        peak, quarter = branch["peak"] or {}, branch["phase_90"] or {}
        height = peak.get("amplitude_deg")
        rows.append(
            [
                f"{branch['pretension_mm']:g}",
                number(peak.get("frequency_hz"), 5),
                number(height),
                number(None if height is None else height / amplitude_deg),
                number(quarter.get("frequency_hz"), 5),
                ", ".join(number(fold["frequency_hz"], 5) for fold in branch["folds"]) or "none",
                "yes" if branch["complete"] else branch["message"],
            ]
        )
    return rows


def _note(rig: Mapping[str, Any]) -> str:
    return (
        f"{rig['harmonics']} harmonics; the last refinement changed no point by more than {rig['error_estimate']:.1e}."
    )
