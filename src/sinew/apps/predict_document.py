"""This is where a prediction becomes the JSON document of `sinew predict`, and the table that is printed of it."""

from typing import TYPE_CHECKING, Any

from sinew.apps.console import print_table
from sinew.measure.estimate import number

if TYPE_CHECKING:
    from sinew.predict.branch import Branch, Mark, Prediction

__all__ = ["mark_cell", "prediction_document", "print_prediction", "print_remarks"]


def _mark(mark: "Mark | None") -> dict[str, float] | None:
    from math import degrees

    if mark is None:
        return None
    return {"frequency_hz": mark.frequency_hz, "amplitude_deg": degrees(mark.amplitude)}


def _branch(branch: "Branch", pretension_mm: float) -> dict[str, Any]:
    import numpy as np

    from sinew.apps.predict_backbone import shares_document

    return {
        "pretension_mm": pretension_mm if np.isfinite(pretension_mm) else None,
        "frequency_hz": branch.frequency_hz.tolist(),
        "amplitude_deg": np.degrees(branch.amplitude).tolist(),
        "fundamental_deg": np.degrees(branch.fundamental).tolist(),
        "phase_deg": np.degrees(branch.phase).tolist(),
        "stable": branch.stable.tolist(),
        "multiplier": branch.multiplier.tolist(),
        "harmonic_shares": shares_document(branch),
        "folds": [_mark(fold) for fold in branch.folds],
        "peak": _mark(branch.peak),
        "fundamental_peak": _mark(branch.fundamental_peak),
        "phase_90": _mark(branch.phase_90),
        "error": branch.error.tolist(),
        "complete": branch.complete,
        "message": branch.message,
    }


def prediction_document(prediction: "Prediction", pretensions: list[float]) -> dict[str, Any]:
    """Return the document of a prediction. pretensions: of its branches [mm]; NaN for an oscillator."""
    return {
        "branches": [_branch(one, mm) for one, mm in zip(prediction.branches, pretensions, strict=True)],
        "harmonics": prediction.harmonics,
        "error_estimate": prediction.error_estimate,
        "wall_s": prediction.wall_s,
    }


def mark_cell(mark: dict[str, float] | None) -> str:
    """Return a marked point in words."""
    return "-" if mark is None else f"{number(mark['frequency_hz'], unit='Hz')}, {number(mark['amplitude_deg'])}°"


def print_prediction(document: dict[str, Any]) -> None:
    """Print a row for each branch, and what is to be said of them."""
    rows = []
    for branch in document["branches"]:
        pretension = branch["pretension_mm"]
        folds = "; ".join(mark_cell(fold) for fold in branch["folds"]) or "none"
        name = "-" if pretension is None else f"{pretension:g}"
        steady = f"{sum(branch['stable'])} of {len(branch['stable'])}"
        peaks = (mark_cell(branch[key]) for key in ("peak", "fundamental_peak", "phase_90"))
        rows.append((name, *peaks, folds, steady))
    head = ("pretension/mm", "peak (Eq. 6)", "peak of the fundamental", "90° of phase", "folds", "stable points")
    print_table(head, rows)
    print_remarks(document)
    error = document["error_estimate"]
    print(f"{document['harmonics']} harmonics, error estimate {error:.1e}, {document['wall_s'] * 1e3:.0f} ms")


def print_remarks(document: dict[str, Any], *, faults_only: bool = False) -> None:
    """Print what a curve did not reach, and what each assumption is worth; faults_only: those that do not hold."""
    for branch in document["branches"]:
        if not branch["complete"] or "not" in branch["message"]:
            print(f"- {branch['message']}")
    for check in document.get("validity", []):
        if faults_only and check["holds"]:
            continue
        print(f"- {check['check']} {'holds' if check['holds'] else 'DOES NOT HOLD'}: {check['sentence']}")
