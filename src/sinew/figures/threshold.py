"""This is where the report says in words whether the gain levels off above some pretension, and what levels it."""

import numpy as np
import xarray as xr

from sinew.analysis.saturation import FEWEST_PRETENSIONS, fit_saturation
from sinew.figures.style import Floats

__all__ = ["describe_threshold"]

_PAPER_MM = 12.0
"""The paper's saturation threshold (sections 4.1 and 5.2.4)."""

_COLUMNS = (
    "pretension_mm",
    "paper_resonance_hz",
    "paper_gain_peak",
    "gain_peak_measured_drive",
    "drive_amplitude_at_resonance_rad",
)


def describe_threshold(
    results: xr.Dataset, beyond: xr.Dataset | None = None, *, about_paper: bool = False
) -> list[str]:
    """Return sentences on the saturation of the peak gain, none below six pretensions with a resonance.

    results: of the campaign. beyond: results of a sweep at further pretensions, joined to it.
    about_paper: whether to hold the kink against the paper's 12 mm.
    """
    parts = [part for part in (results, beyond) if part is not None and set(_COLUMNS) <= set(part.variables)]
    if not parts:
        return []
    rows = np.concatenate([np.stack([part[name].values for name in _COLUMNS]) for part in parts], axis=1)
    rows = rows[:, np.isfinite(rows).all(axis=0)]
    pretension, resonance, gain, by_measured, drive = rows[:, np.argsort(rows[0])]
    if np.unique(pretension).size < FEWEST_PRETENSIONS:
        return []
    fit = fit_saturation(pretension, gain)
    span = f"{pretension[0]:g} to {pretension[-1]:g} mm"
    sentences = [
        f"Two straight lines through the peak gain at {pretension.size} pretensions, {span}. {_printed(fit.sentence)}"
    ]
    if about_paper:
        inside = fit.threshold_mm.low <= _PAPER_MM <= fit.threshold_mm.high
        sentences.append(
            f"The paper's threshold, {_PAPER_MM:g} mm, lies "
            + ("inside that interval." if inside else "outside that interval: the fit finds no threshold there.")
        )
    if fit.preferred:
        sentences.append("A curve that bends evenly prefers two lines as well, so a kink alone is no threshold.")
    return [
        *sentences,
        f"By measured drive instead. {_printed(fit_saturation(pretension, by_measured).sentence)}",
        _rise(pretension, resonance),
        _upper_half(pretension, gain, by_measured, drive),
    ]


def _rise(pretension: Floats, resonance: Floats) -> str:
    falls = int((np.diff(resonance) <= 0).sum())
    how = "rises at every step" if falls == 0 else f"fails to rise at {falls} of {resonance.size - 1} steps"
    return (
        f"The resonance {how}, from {resonance[0]:.2f} Hz at {pretension[0]:g} mm to {resonance[-1]:.2f} Hz at "
        f"{pretension[-1]:g} mm."
    )


def _upper_half(pretension: Floats, gain: Floats, by_measured: Floats, drive: Floats) -> str:
    """Return whose the change over the upper half of the range is: the drive's or the joint's."""
    first = int(np.searchsorted(pretension, (pretension[0] + pretension[-1]) / 2))
    nominal, joint, reached = (float(row[-1] / row[first] - 1) for row in (gain, by_measured, drive))
    if abs(joint) < 0.25 * abs(nominal):
        verdict = "up there the gain by nominal drive changes because the drive does, not the joint"
    elif abs(joint) < 0.5 * abs(nominal):
        verdict = "up there the gain by nominal drive changes mostly because the drive does"
    else:
        verdict = "up there the joint itself still changes"
    return (
        f"From {pretension[first]:g} to {pretension[-1]:g} mm the gain by nominal drive changes by {_percent(nominal)} "
        f"({gain[first]:.2f} to {gain[-1]:.2f}), the gain by measured drive by {_percent(joint)} "
        f"({by_measured[first]:.2f} to {by_measured[-1]:.2f}), and the drive amplitude at resonance by "
        f"{_percent(reached)}: {verdict}."
    )


def _printed(sentence: str) -> str:
    """Return a sentence with the minus signs of print."""
    return sentence.replace(" -", " −")


def _percent(share: float) -> str:
    return f"{100 * share:+.0f} %".replace("-", "−")
