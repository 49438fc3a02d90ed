"""This is where numbers become the rows of the report: measured quantities, parameters, what they determine."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from sinew.figures.energy_table import energy_columns, energy_note
from sinew.figures.spread import mean_and_spread
from sinew.figures.style import Floats
from sinew.plan.rig import RigSpec

__all__ = ["Reach", "Table", "fixed", "measured_tables", "number", "parameter_rows", "reaches"]


@dataclass(frozen=True)
class Table:
    """A table of text: title, head, rows of the same length (the first cell names the row), and a sentence below."""

    title: str
    head: list[str]
    rows: list[list[str]]
    note: str


def number(value: float | None, digits: int = 4) -> str:
    """Return a number with so many significant digits, a dash for what is not known."""
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    return text.replace("-", "−") if "e" not in text else text


def fixed(value: float | None, decimals: int) -> str:
    """Return a number with so many decimals, a dash for what is not known."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.{decimals}f}".replace("-", "−")


def measured_tables(results: xr.Dataset) -> list[Table]:
    """Return what was measured at each pretension: of sweep, ring-downs and energy, each where there is one."""
    tables = []
    notes = (str(results.attrs.get("resonance_notes", "")), _verdict(results), energy_note(results))
    parts = (("Resonance", _resonance(results)), ("Ring-down", _decay(results)), ("Energy", energy_columns(results)))
    for (title, columns), note in zip(parts, notes, strict=True):
        known = [column for column in columns if np.isfinite(column[1]).any()]
        if not known:
            continue
        at = np.flatnonzero(np.any([np.isfinite(value) for _, value, _ in known], axis=0))
        pretension = results["pretension_mm"].values
        rows = [[number(pretension[p]), *(_pair(value[p], spread[p]) for _, value, spread in known)] for p in at]
        tables.append(Table(title, ["p in mm", *(head for head, _, _ in known)], rows, note))
    return tables


def _verdict(results: xr.Dataset) -> str:
    """Return how many of the decays are exponential, and what follows where some are not; empty without ring-downs."""
    if "exponential" not in results:
        return ""
    judged = results["exponential"].values[np.isfinite(results["exponential"].values)]
    text = f"Exponential within their noise: {int(judged.sum())} of {judged.size} decays."
    if judged.sum() == judged.size:
        return text
    return text + " Where a decay is not, its damping depends on the amplitude; λ, ⟨ω⟩, D, d and k are means over it."


Column = tuple[str, Floats, Floats]


def _resonance(results: xr.Dataset) -> list[Column]:
    if "resonance_hz" not in results:
        return []
    units = [str(results.attrs.get(name, "rad")) for name in ("response_unit", "drive_unit")]
    scale, drive = (180 / math.pi, "degrees") if units[1] == "rad" else (1.0, units[1])
    per = "" if units[0] == units[1] else f" in {units[0]} per {units[1]}"
    return [
        (head, factor * results[name].values, factor * results[std].values)
        for head, name, std, factor in (
            ("resonance in Hz", "resonance_hz", "resonance_std_hz", 1.0),
            (f"gain{per}", "gain_peak", "gain_peak_std", 1.0),
            (f"gain by measured drive{per}", "gain_peak_measured_drive", "gain_peak_measured_drive_std", 1.0),
            ("90° lag at Hz", "phase_90_hz", "phase_90_std_hz", 1.0),
            ("half-power width in Hz", "half_power_width_hz", "half_power_width_std_hz", 1.0),
            (
                f"drive in {drive}",
                "drive_amplitude_at_resonance_rad",
                "drive_amplitude_at_resonance_std_rad",
                scale,
            ),
        )
    ]


def _decay(results: xr.Dataset) -> list[Column]:
    if "paper_lehr_damping" not in results:
        return []
    return [
        (head, *mean_and_spread(results[name].values))
        for head, name in (
            ("λ in 1/s", "paper_decay_rate_per_s"),
            ("⟨ω⟩ in rad/s", "paper_omega_rad_s"),
            ("D (paper)", "paper_lehr_damping"),
            ("D (direct fit)", "damping_ratio"),
            ("d in N m s/rad", "paper_damping_n_m_s_rad"),
            ("k in N m/rad", "paper_stiffness_n_m_rad"),
        )
    ]


def _pair(value: float, spread: float) -> str:
    """Return `value ± spread`, cut at the spread's first digit (second if the first is a one) or the value's fourth."""
    if not (math.isfinite(value) and math.isfinite(spread) and spread > 0):
        return number(value)
    exponent = math.floor(math.log10(spread))
    decimals = (1 if spread < 2 * 10.0**exponent else 0) - exponent
    if value != 0:
        decimals = min(decimals, 3 - math.floor(math.log10(abs(value))))
    decimals = max(0, decimals)
    return f"{value:.{decimals}f} ± {max(spread, 10.0**-decimals):.{decimals}f}".replace("-", "−")


def _readable(unit: str) -> str:
    """Return a unit as print has it, nothing for a plain number."""
    return "" if unit == "1" else unit.replace("*", " ").replace("^2", "²").replace("^3", "³")


def parameter_rows(rig: RigSpec) -> list[dict[str, str]]:
    """Return name, value, unit, origin, bounds and note of every parameter of a rig, as text."""
    return [
        {
            "name": name,
            "value": number(parameter.value, 5),
            "unit": _readable(parameter.unit),
            "origin": parameter.origin,
            "bounds": f"{number(parameter.bounds[0])} to {number(parameter.bounds[1])}",
            "note": parameter.note,
        }
        for name, parameter in rig.parameters()
    ]


@dataclass(frozen=True)
class Reach:
    """How far one parameter can move without leaving the paper's numbers.

    value, alone, together, bounds: text with the unit; alone: the others held, together: the others following.
    share: of the bounds that `together` covers, 0 to 1; bars: ends of alone and together and the place of the value
    on a scale from 0 (lower bound) to 100 (upper bound).
    """

    name: str
    value: str
    alone: str
    together: str
    bounds: str
    share: float
    bars: dict[str, float]
    sentence: str

    @property
    def is_determined(self) -> bool:
        """Whether the paper's numbers leave less than a fifth of the bounds."""
        return self.share < 0.2


def reaches(determination: Mapping[str, Mapping[str, Any]]) -> list[Reach]:
    """Return the reach of each parameter, the best determined first."""
    return sorted((_reach(name, row) for name, row in determination.items()), key=lambda reach: reach.share)


def _reach(name: str, row: Mapping[str, Any]) -> Reach:
    low, high = map(float, row["bounds"])
    width = high - low if high > low else 1.0

    def place(value: float) -> float:
        return round(100 * min(max((value - low) / width, 0.0), 1.0), 2)

    ends = {kind: tuple(map(float, row[kind])) for kind in ("alone", "together")}
    text = {kind: f"{number(a)} to {number(b)}" for kind, (a, b) in ends.items()}
    bars = {f"{kind}_{end}": place(pair[i]) for kind, pair in ends.items() for i, end in enumerate(("low", "high"))}
    return Reach(
        name=name,
        value=f"{number(float(row['value']))} {_readable(str(row.get('unit', '')))}".rstrip(),
        alone=text["alone"],
        together=text["together"],
        bounds=f"{number(low)} to {number(high)}",
        share=(bars["together_high"] - bars["together_low"]) / 100,
        bars={**bars, "value": place(float(row["value"]))},
        sentence=str(row.get("sentence", "")),
    )
