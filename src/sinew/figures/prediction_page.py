"""This is where a prediction, of one rig or of several, becomes one HTML page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sinew.figures.page import Caption, picture, write_page
from sinew.figures.tables import Table, number

# Each figure of a prediction gets its words.

PREDICTION_CAPTIONS = {
    "predicted_response": Caption(
        "Predicted response",
        "(a) Half of peak to peak of the torsion over the amplitude of the drive's command. (b) Lag of the torsion's "
        "fundamental behind the lever's. Colour is pretension. Solid lines are stable, dotted ones are not; rings mark "
        "the peaks, diamonds the folds, where a sweep jumps; dashed lines a gain of one and a lag of 90°.",
        "",
        "Two panels over drive frequency, a line for each pretension: gain on the left, lag on the right.",
    ),
    "predicted_comparison": Caption(
        "Rigs compared",
        "(a) Resonance and (b) gain there over pretension, a line for each rig. Below, each rig's gain over frequency "
        "on equal axes, coloured by pretension; solid lines are stable, dotted ones are not, diamonds are folds.",
        "",
        "Resonance and gain over pretension for all rigs, above a panel of response curves for each.",
    ),
    "predicted_map": Caption(
        "Map of gain",
        "The largest stable gain over frequency and pretension, lines of equal gain in white. The red line is the "
        "resonance; its rings stand at the predicted pretensions, between them the map follows the line.",
        "",
        "Gain as colour over drive frequency and pretension, with a red line along the resonance.",
    ),
    "predicted_bands": Caption(
        "How far the curves can be off",
        "Medians and 90 % bands of rigs drawn from what the calibration knows of the parameters. (a) and (b): what a "
        "sweep with growing frequency meets; dashed edges, where there are folds, what one with falling frequency "
        "meets. (c) Half the width of the gain's band over its median. Assumed parameters do not vary.",
        "",
        "Gain, lag and the half width of the gain's band over drive frequency, a tube for each pretension.",
    ),
    "predicted_against": Caption(
        "Against the recording",
        "(a) and (b): points are measured, bars their 90 % intervals, lines predicted. (c) Error of the predicted gain "
        "at every point. (d) Error of the peak's frequency and gain, both read off the prediction as off the "
        "recording, with the measurement's 90 % intervals. Full marks: pretensions that the rig was calibrated to; "
        "open ones are predictions.",
        "",
        "Measured points and predicted lines of gain and lag, and their differences over frequency and pretension.",
    ),
}
"""By the name of the figure's files, in the order of the page."""


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
