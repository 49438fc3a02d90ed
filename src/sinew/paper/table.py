"""The paper's numbers beside the measured ones: tolerance and its reason, role, and place in the paper.

A row is worth what it could have missed. One that the calibration aims at, or that only repeats an input, says so in
its role; one whose tolerance nothing could leave does not stand here. What the twin misses stands here as well.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypedDict

import numpy as np
import xarray as xr

from sinew.analysis.decay.decay_windows import decay_windows
from sinew.analysis.decay.ring_down import DECAY_FROM_PERIODS
from sinew.analysis.sweep.response import FEWEST_PRETENSIONS, fit_saturation
from sinew.measure.arrays import Array, mean_and_spread
from sinew.plan.rig import RigSpec

Role = Literal["fitted", "input", "follows"]


class Row(TypedDict):
    """One line of the table: a quantity, the paper's number, ours (None where it could not be measured), and whether
    they agree within the tolerance. Counts and rank correlations stand for statements without a number.

    role: what agreement is worth, see `role_of`. reason: of the tolerance, a sentence.
    """

    quantity: str
    paper: float
    measured: float | None
    tolerance: float
    ok: bool
    where: str
    role: Role
    reason: str


def is_the_papers(results: xr.Dataset, rig: RigSpec | None) -> bool:
    """Return whether results have to do with the paper: the rig is named `paper` and no file of others was imported."""
    return rig is not None and rig.name == "paper" and results.attrs.get("source") != "import"


_FITTED = (
    "resonance frequency at",
    "gain at resonance at",
    "largest distance between 90° crossing",
    "spread of Lehr's damping D over pretension from",
)
"""How the quantities begin that the calibration of the paper's rig aims at (`sinew.paper.numbers.TARGETS`)."""

_THRESHOLD_MM = 12.0

_INPUTS = ("stiffness k = G J / L", "frequency of the bare silicone")


def role_of(quantity: str, rig: RigSpec) -> Role:
    """Return what a row's agreement is worth: the rig was fitted to it, it is one of its inputs, or it follows.

    Nothing counts as fitted on a rig without a calibrated parameter.
    """
    if quantity.startswith(_INPUTS):
        return "input"
    calibrated = any(parameter.origin == "calibrated" for _, parameter in rig.parameters())
    return "fitted" if calibrated and quantity.startswith(_FITTED) else "follows"


def count_roles(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return how many rows are met, and how many of those that neither were fitted nor are inputs; one sentence."""
    free = [row for row in rows if row["role"] == "follows"]
    met, follow = (sum(bool(row["ok"]) for row in some) for some in (rows, free))
    fitted, put_in = (sum(row["role"] == role for row in rows) for role in ("fitted", "input"))
    parts = [f"{fitted} were fitted"] if fitted else []
    parts += [f"{put_in} are inputs"] if put_in else []
    worth = f"; {' and '.join(parts)}, of the {len(free)} that follow {follow} are met" if parts else ""
    return f"{met} of {len(rows)} rows within tolerance{worth}"


def paper_table(results: xr.Dataset, beyond: xr.Dataset | None = None, rig: RigSpec | None = None) -> list[Row]:
    """Return the rows for which the data hold the parts: sweep, ring-downs, a sweep above 12 mm, and the rig.

    There are none for a rig other than the paper's, or for an imported recording (`is_the_papers`).
    Trends are counted on means over repeats, without regard to their spread.
    results: of the campaign. beyond: of a sweep at pretensions above 12 mm. rig: for Eq. 5, and for the roles.
    Resonance and gain are Eq. 6's (`paper_resonance_hz`, `paper_gain_peak`).
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
    if beyond is not None and "paper_gain_peak" in beyond and "paper_gain_peak" in results:
        rows += _bounded(results, beyond)
    rows += _bare_silicone(rig)
    for row in rows:
        row["role"] = role_of(row["quantity"], rig)
    return rows


def _row(
    quantity: str, paper: float, measured: float, tolerance: float, where: str, reason: str, also: bool = True
) -> Row:
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
        role="follows",
        reason=reason,
    )


_HERTZ = "printed to 0.1 Hz, read off a frequency grid that is not printed"
_GAIN = "printed to 0.1, mean of five periods and three repeats"
_COUNT = "a trend has no exception"


def _ends(results: xr.Dataset) -> list[Row]:
    where = "Abstract; section 4.1, Figure 6 left"
    rows = []
    for name, quantity, paper, tolerance, reason in (
        (
            "paper_resonance_hz",
            "resonance frequency at 0 mm in Hz",
            {0.0: 3.0, 12.0: 4.3},
            {0.0: 0.1, 12.0: 0.1},
            _HERTZ,
        ),
        ("paper_gain_peak", "gain at resonance at 0 mm", {0.0: 2.8, 12.0: 1.4}, {0.0: 0.15, 12.0: 0.1}, _GAIN),
    ):
        for pretension, number in paper.items():
            at = np.flatnonzero(np.isclose(results["pretension_mm"].values, pretension))
            if at.size:
                text = quantity.replace("0 mm", f"{pretension:g} mm")
                measured = float(results[name].values[at[0]])
                rows.append(_row(text, number, measured, tolerance[pretension], where, reason))
    return rows


def _trends(results: xr.Dataset) -> list[Row]:
    order = np.argsort(results["pretension_mm"].values)
    resonance, gain = (results[name].values[order] for name in ("paper_resonance_hz", "paper_gain_peak"))
    gap = np.abs(results["phase_90_hz"].values - results["paper_resonance_hz"].values)
    where = "Section 4.1, Figures 6 and 8"
    rows = []
    if order.size > 1:
        rising = "steps of pretension at which the resonance does not rise"
        rows.append(_row(rising, 0, _not_rising(resonance), 0, where, _COUNT))
        falling = "steps of pretension at which the gain does not fall"
        rows.append(_row(falling, 0, _not_rising(-gain), 0, where, _COUNT))
    text = "largest distance between 90° crossing and resonance in Hz"
    reason = "as for the resonance itself: the paper reads both off one grid"
    rows.append(_row(text, 0, float(gap.max()), 0.1, "Section 4.1, Figure 6 right", reason))
    return rows


_CONSTANT = 0.15
"""Half of what a constant damping constant d would make of D = d/(2ωI) from 3.0 to 4.3 Hz: (1 - 3.0/4.3)/2. A D that
changes by more is not told from that law by the words "approximately constant"."""


def _damping(results: xr.Dataset) -> list[Row]:
    order = np.argsort(results["pretension_mm"].values)
    known = order[np.isfinite(results["paper_lehr_damping"].values[order]).any(axis=1)]
    if known.size < 2:
        return []
    where = "Section 4.2, Figure 10"
    windows = decay_windows(results)
    rates = [_not_rising(mean_and_spread(results["paper_decay_rate_per_s"].values[known])[0])]
    rates += [float(window.falling_rates) for window in windows]
    anywhere = ", wherever the decay begins" if windows else ""
    omega = mean_and_spread(results["paper_omega_rad_s"].values[known])[0]
    rows = [
        _row(f"steps of pretension at which λ does not rise{anywhere}", 0, max(rates), 0, where, _COUNT),
        _row("steps of pretension at which ⟨ω⟩ does not rise", 0, _not_rising(omega), 0, where, _COUNT),
    ]
    damping = mean_and_spread(results["paper_lehr_damping"].values[known])[0]
    spread = float((damping.max() - damping.min()) / damping.mean())
    reason = "half of what a constant d would make of D between 3.0 and 4.3 Hz"
    begun = f"from {DECAY_FROM_PERIODS:g} drive period after the stop on"
    text = f"spread of Lehr's damping D over pretension {begun}, (max − min) / mean"
    rows.append(_row(text, 0, spread, _CONSTANT, where, reason))
    if windows:
        starts = f"{windows[0].start_periods:g} to {windows[-1].start_periods:g}"
        text = f"largest spread of D over pretension, wherever the decay begins ({starts} drive periods after the stop)"
        rows.append(_row(text, 0, max([spread, *(one.spread for one in windows)]), _CONSTANT, where, reason))
    return rows


_ORDER = "one pair in twenty in the wrong order"
_LISSAJOUS_MM = 4.0


def _drive(results: xr.Dataset) -> list[Row]:
    rows = []
    order = np.argsort(results["paper_resonance_hz"].values)
    if order.size > 1:
        amplitude = results["drive_amplitude_at_resonance_rad"].values[order]
        if not np.isfinite(results["paper_resonance_hz"].values).all():
            amplitude = np.full(order.size, np.nan)
        text = (
            "Kendall's τ of the drive amplitude at resonance over frequency "
            "(-1: each pair falls; the last below the first)"
        )
        fallen = bool(amplitude[-1] < amplitude[0])
        where = "Section 4.1, Figure 7; section 5.2.5"
        rows.append(_row(text, -1, _concordance(amplitude), 0.1, where, _ORDER, also=fallen))
    here = np.flatnonzero(np.isclose(results["pretension_mm"].values, _LISSAJOUS_MM))
    if here.size:
        sweep = mean_and_spread(results["drive_amplitude_rad"].values[here[0]])[0]
        sweep = sweep[np.argsort(results["frequency_hz"].values)]
        text = f"Kendall's τ of the drive amplitude over frequency at {_LISSAJOUS_MM:g} mm (-1: each pair falls)"
        where = "Section 4.1, Figure 7; section 5.2.5"
        rows.append(_row(text, -1, _concordance(sweep[np.isfinite(sweep)]), 0.1, where, _ORDER))
    return rows


def _bounded(results: xr.Dataset, beyond: xr.Dataset) -> list[Row]:
    """Return what the paper says of the gain above its threshold: that it stays at one, and that this begins there."""
    above = np.flatnonzero(beyond["pretension_mm"].values > _THRESHOLD_MM)
    if not above.size:
        return []
    last = above[np.argmax(beyond["pretension_mm"].values[above])]
    pretension = float(beyond["pretension_mm"].values[last])
    level = float(beyond["paper_gain_peak"].values[last])
    where = "Section 4.1; section 5.2.4"
    text = f"gain at resonance far above the threshold, at {pretension:g} mm"
    rows = [_row(text, 1, level, 0.1, where, "as for the gain at 12 mm; the paper says “bounded to a value of one”")]
    parts = [
        np.stack([part[name].values for name in ("pretension_mm", "paper_gain_peak")]) for part in (results, beyond)
    ]
    x, y = np.concatenate(parts, axis=1)
    if x.size >= FEWEST_PRETENSIONS:
        order, known = np.argsort(x), bool(np.isfinite(y).all())
        kink = fit_saturation(x[order], y[order]).threshold_mm.value if known else math.nan
        text = "pretension from which on the gain levels off in mm (kink of two straight lines)"
        reason = "“≈ 12 mm”; the other pretensions that it names lie 2 mm and more away"
        rows.append(_row(text, _THRESHOLD_MM, kink, 2.0, where, reason))
    return rows


def _bare_silicone(rig: RigSpec) -> list[Row]:
    stiffness = rig.silicone.stiffness(0.0)
    inertia = rig.inertia.head.value + rig.inertia.lever.value
    frequency = math.sqrt(stiffness / inertia) / (2 * math.pi)
    text = "frequency of the bare silicone, √(k/I)/2π, in Hz (the joint with tendons: 3.0 Hz)"
    return [
        _row(
            "stiffness k = G J / L of the bare silicone in N m/rad",
            3.052,
            stiffness,
            0.001,
            "Section 2, Equation 5",
            "printed to 0.001; an input, which only a change of the rig could miss",
        ),
        _row(text, 2.46, frequency, 0.01, "From Equations 4 and 5", "computed from what is printed; an input"),
    ]


def _not_rising(values: Array) -> float:
    """Return the number of steps that do not rise, NaN where a value is missing."""
    return float((np.diff(values) <= 0).sum()) if np.isfinite(values).all() else math.nan


def _concordance(values: Array) -> float:
    """Return Kendall's rank correlation of values with their order, (rising - falling pairs) / pairs, or NaN."""
    if not np.isfinite(values).all():
        return math.nan
    upper = np.triu_indices(values.size, 1)
    return float(np.sign(values[upper[1]] - values[upper[0]]).mean())
