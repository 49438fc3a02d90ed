"""This is where the energy of a sweep becomes columns and a sentence of the report."""

import math

import numpy as np
import xarray as xr

from sinew.figures.style import Floats
from sinew.measure.results import companions

__all__ = ["energy_columns", "energy_note"]

_COLUMNS = (
    ("drive in W", "drive_power_at_resonance_w", 1.0),
    ("copper in W", "copper_at_resonance_w", 1.0),
    ("gear and friction in W", "gear_at_resonance_w", 1.0),
    ("mechanical in W", "mechanical_at_resonance_w", 1.0),
    ("tendon motors in W", "holding_at_resonance_w", 1.0),
    ("drive in J per cycle", "energy_per_cycle_at_resonance_j", 1.0),
    ("J per cycle and rad²", "swing_cost_at_resonance_j_rad2", 1.0),
    ("trend in J per cycle and rad²", "trend_cost_at_resonance_j_rad2", 1.0),
    ("reduction in %", "energy_reduction", 100.0),
    ("with tendon motors in %", "energy_reduction_with_holding", 100.0),
    ("pays from a swing in °", "break_even_rad", 180 / math.pi),
    ("cheapest at Hz", "cheapest_hz", 1.0),
    ("reduction there in %", "cheapest_reduction", 100.0),
    ("current against a line in %", "line_reduction", 100.0),
)


def energy_columns(results: xr.Dataset) -> list[tuple[str, Floats, Floats]]:
    """Return (head, value, standard deviation over repeats) of every column, (p,); empty without the energy part."""
    if "energy_reduction" not in results:
        return []
    return [
        (head, factor * results[name].values, factor * results[companions(name)[0]].values)
        for head, name, factor in _COLUMNS
    ]


def energy_note(results: xr.Dataset) -> str:
    """Return what the columns mean, and what is in none of them; empty without the energy part."""
    if "energy_reduction" not in results or not np.isfinite(results["drive_power_w"].values).any():
        return ""
    idle, rest = float(results.attrs.get("idle_power_w", math.nan)), results["rest_power_w"].values
    text = (
        "At the resonance of the gain, by duty, current and voltage of the servos. The trend: what spring and inertia "
        "would need for the same swing of the head if neither helped the other; the reduction is the share of it that "
        "resonance saves. A negative last column means more current than on a straight line through the currents off "
        "resonance (the paper's proposal, at the nominal drive amplitude and not at equal swing)."
    )
    if np.isfinite(rest).any():
        ends = rest[np.isfinite(rest)][[0, -1]]
        text += f" At rest all motors draw {ends[0]:.2g} W at the first and {ends[1]:.2g} W at the last pretension."
    if math.isfinite(idle):
        text += f" The servos' electronics, {idle:.2g} W by data sheet, are in none of these numbers."
    return text
