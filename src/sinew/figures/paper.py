"""This is where the paper's numbers meet the measured ones, each with a tolerance and its place in the paper."""

import math
from typing import Literal, TypedDict

import numpy as np
import xarray as xr

from sinew.figures.spread import mean_and_spread
from sinew.figures.style import Floats
from sinew.plan.rig import RigSpec

__all__ = ["Role", "Row", "is_the_papers", "paper_table", "role_of"]

Role = Literal["fitted", "input", "follows"]


_NEAR_ONE = 0.4
"""Above the threshold of 12 mm the paper calls the gain bounded near one and prints no number. It prints 1.4 at the
threshold itself, so a gain above it counts as near one while it is not further away than that."""


class Row(TypedDict):
    """One line of the table: a quantity, the paper's number, ours (None where it could not be measured), and whether
    they agree within the tolerance. Counts and rank correlations stand for statements without a number.
    """

    quantity: str
    paper: float
    measured: float | None
    tolerance: float
    ok: bool
    where: str


def is_the_papers(results: xr.Dataset, rig: RigSpec | None) -> bool:
    """Return whether results have to do with the paper: the rig is named `paper` and no file of others was imported."""
    return rig is not None and rig.name == "paper" and results.attrs.get("source") != "import"


_FITTED = (
    "resonance frequency at",
    "gain at resonance at",
    "largest distance between 90° crossing",
    "spread of Lehr's damping",
)
"""How the quantities begin that the calibration of the paper's rig aims at (`sinew.identify.paper_numbers.TARGETS`)."""

_INPUTS = ("stiffness k = G J / L", "frequency of the bare silicone")


def role_of(quantity: str, rig: RigSpec) -> Role:
    """Return what a row's agreement is worth: the rig was fitted to it, it is one of its inputs, or it follows.

    Nothing counts as fitted on a rig without a calibrated parameter.
    """
    if quantity.startswith(_INPUTS):
        return "input"
    calibrated = any(parameter.origin == "calibrated" for _, parameter in rig.parameters())
    return "fitted" if calibrated and quantity.startswith(_FITTED) else "follows"


def paper_table(results: xr.Dataset, beyond: xr.Dataset | None = None, rig: RigSpec | None = None) -> list[Row]:
    """Return the rows for which the data hold the parts: sweep, ring-downs, a sweep above 12 mm, and the rig.

    There are none for a rig other than the paper's, or for an imported recording (`is_the_papers`).
    Trends are counted on means over repeats, without regard to their spread.
    results: of the campaign. beyond: of a sweep at pretensions above 12 mm. rig: for Eq. 5.
    A part that is there but could not be measured (NaN) gives a row that is not ok.
    """
    rows: list[Row] = []
    if rig is None or not is_the_papers(results, rig):
        return rows
    if "resonance_hz" in results:
        rows += _ends(results) + _trends(results)
    if "paper_lehr_damping" in results:
        rows += _damping(results)
    if "resonance_hz" in results:
        rows += _drive(results)
    if beyond is not None and "gain_peak" in beyond:
        rows += _bounded(beyond)
    return rows + _bare_silicone(rig)


def _row(quantity: str, paper: float, measured: float, tolerance: float, where: str, also: bool = True) -> Row:
    """Return a row; it is ok where measured is within the tolerance of paper and `also` holds."""
    known = math.isfinite(measured)
    ok = known and abs(measured - paper) <= tolerance * (1 + 1e-9) and also
    return Row(
        quantity=quantity,
        paper=paper,
        measured=float(measured) if known else None,
        tolerance=tolerance,
        ok=bool(ok),
        where=where,
    )


def _ends(results: xr.Dataset) -> list[Row]:
    where = "Abstract; section 4.1, Figure 6 left"
    rows = []
    for name, quantity, paper, tolerance in (
        ("resonance_hz", "resonance frequency at 0 mm in Hz", {0.0: 3.0, 12.0: 4.3}, {0.0: 0.1, 12.0: 0.1}),
        ("gain_peak", "gain at resonance at 0 mm", {0.0: 2.8, 12.0: 1.4}, {0.0: 0.15, 12.0: 0.1}),
    ):
        for pretension, number in paper.items():
            at = np.flatnonzero(np.isclose(results["pretension_mm"].values, pretension))
            if at.size:
                text = quantity.replace("0 mm", f"{pretension:g} mm")
                rows.append(_row(text, number, float(results[name].values[at[0]]), tolerance[pretension], where))
    return rows


def _trends(results: xr.Dataset) -> list[Row]:
    order = np.argsort(results["pretension_mm"].values)
    resonance, gain = results["resonance_hz"].values[order], results["gain_peak"].values[order]
    gap = np.abs(results["phase_90_hz"].values - results["resonance_hz"].values)
    where = "Section 4.1, Figures 6 and 8"
    rows = []
    if order.size > 1:
        rows.append(
            _row("steps of pretension at which the resonance does not rise", 0, _not_rising(resonance), 0, where)
        )
        rows.append(_row("steps of pretension at which the gain does not fall", 0, _not_rising(-gain), 0, where))
    text = "largest distance between 90° crossing and resonance in Hz"
    rows.append(_row(text, 0, float(gap.max()), 0.3, "Section 4.1, Figure 6 right"))
    return rows


def _damping(results: xr.Dataset) -> list[Row]:
    order = np.argsort(results["pretension_mm"].values)
    known = order[np.isfinite(results["paper_lehr_damping"].values[order]).any(axis=1)]
    if known.size < 2:
        return []
    where = "Section 4.2, Figure 10"
    rows = []
    for name, what in (("paper_decay_rate_per_s", "λ"), ("paper_omega_rad_s", "⟨ω⟩")):
        mean = mean_and_spread(results[name].values[known])[0]
        rows.append(_row(f"steps of pretension at which {what} does not rise", 0, _not_rising(mean), 0, where))
    damping = mean_and_spread(results["paper_lehr_damping"].values[known])[0]
    spread = float((damping.max() - damping.min()) / damping.mean())
    text = "spread of Lehr's damping D over pretension, (max − min) / mean"
    return [*rows, _row(text, 0, spread, 0.15, where)]


def _drive(results: xr.Dataset) -> list[Row]:
    order = np.argsort(results["resonance_hz"].values)
    if order.size < 2:
        return []
    amplitude = results["drive_amplitude_at_resonance_rad"].values[order]
    if not np.isfinite(results["resonance_hz"].values).all():
        amplitude = np.full(order.size, np.nan)
    text = (
        "Kendall's τ of the drive amplitude at resonance over frequency (-1: each pair falls; the last below the first)"
    )
    fallen = bool(amplitude[-1] < amplitude[0])
    return [_row(text, -1, _concordance(amplitude), 0.1, "Section 4.1, Figure 7; section 5.2.5", also=fallen)]


def _bounded(beyond: xr.Dataset) -> list[Row]:
    pretension = beyond["pretension_mm"].values
    above = pretension > 12.0
    if not above.any():
        return []
    gain = beyond["gain_peak"].values[above]
    furthest = float(gain[np.argmax(np.abs(gain - 1.0))])
    span = (
        f"{pretension[above].min():g} to {pretension[above].max():g} mm"
        if above.sum() > 1
        else f"{pretension[above][0]:g} mm"
    )
    text = f"gain at resonance above the threshold, furthest from one ({span})"
    return [_row(text, 1, furthest, _NEAR_ONE, "Section 4.1; section 5.2.4")]


def _bare_silicone(rig: RigSpec) -> list[Row]:
    stiffness = rig.silicone.torsional_rigidity.value / rig.silicone.length.value
    inertia = rig.inertia.head.value + rig.inertia.lever.value
    frequency = math.sqrt(stiffness / inertia) / (2 * math.pi)
    text = "frequency of the bare silicone, √(k/I)/2π, in Hz (the joint with tendons: 3.0 Hz)"
    return [
        _row("stiffness k = G J / L of the bare silicone in N m/rad", 3.052, stiffness, 0.001, "Section 2, Equation 5"),
        _row(text, 2.46, frequency, 0.01, "From Equations 4 and 5"),
    ]


def _not_rising(values: Floats) -> float:
    """Return the number of steps that do not rise, NaN where a value is missing."""
    return float((np.diff(values) <= 0).sum()) if np.isfinite(values).all() else math.nan


def _concordance(values: Floats) -> float:
    """Return Kendall's rank correlation of values with their order, (rising - falling pairs) / pairs, or NaN."""
    if not np.isfinite(values).all():
        return math.nan
    upper = np.triu_indices(values.size, 1)
    return float(np.sign(values[upper[1]] - values[upper[0]]).mean())
