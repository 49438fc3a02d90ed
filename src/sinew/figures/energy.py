"""This is where energy is drawn: the drive's power, what a swing costs against the trend, and where the power goes."""

import math

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.analysis.signal.power import winding_resistance
from sinew.analysis.sweep.energy import cost_of_swing, fit_swing_trend
from sinew.figures.motion import rig_of
from sinew.figures.response import draw_tubes
from sinew.figures.style import (
    GREY,
    INK,
    few,
    in_style,
    mean_and_spread,
    new_figure,
    note_panel,
    pretension_bar,
    pretension_colours,
)
from sinew.measure.arrays import Array

_SHARES = (
    ("electronics (data sheet)", "", "#c9ced6"),
    ("tendon motors", "holding_at_resonance_w", "#e3a857"),
    ("copper", "copper_at_resonance_w", "#b3543e"),
    ("gear and friction", "gear_at_resonance_w", "#7b6b9a"),
    ("mechanical", "mechanical_at_resonance_w", "#3b7ea1"),
)


@in_style
def draw_energy(_: xr.Dataset, results: xr.Dataset) -> Figure | None:
    """Return power over frequency, cost of a swing over frequency with its trend, and shares of the power at resonance.

    None where the results hold no powers, or none but NaN.
    """
    if "energy_reduction" not in results or not np.isfinite(results["drive_power_w"].values).any():
        return None
    figure = new_figure(6.0)
    grid = figure.add_gridspec(2, 2)
    power, cost = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    _draw_power(power, results)
    _draw_cost(cost, results)
    _draw_shares(figure.add_subplot(grid[1, :]), results)
    pretension_bar(figure, (power, cost), results["pretension_mm"].values)
    return figure


def _draw_power(axes: Axes, results: xr.Dataset) -> None:
    frequency, watts = results["frequency_hz"].values, results["drive_power_w"].values
    draw_tubes(axes, frequency, watts, results["pretension_mm"].values)
    where, height = results["resonance_hz"].values, results["drive_power_at_resonance_w"].values
    axes.plot(where, height, "o", markersize=3, color="white", markeredgecolor=INK, zorder=5)
    axes.set(xlabel="drive frequency in Hz", ylabel="electrical power of the drive in W")
    axes.set(xlim=(frequency.min(), frequency.max()), ylim=(0, 1.15 * float(np.nanmax(watts))))
    note_panel(axes, "a", "as driven (rings: at resonance)")


def _draw_cost(axes: Axes, results: xr.Dataset) -> None:
    """Draw cost and trend of a few pretensions; the arrow is the reduction at resonance."""
    rig = rig_of(results)
    pretension, frequency = results["pretension_mm"].values, results["frequency_hz"].values
    colours = pretension_colours(pretension)
    columns = {name: mean_and_spread(results[name].values)[0] for name in _CURVES}
    known = np.flatnonzero(np.isfinite(results["energy_reduction"].values))
    for p in known[few(known.size, 3)]:
        watts, swing, current = (columns[name][p] for name in _CURVES)
        cost = cost_of_swing(watts, frequency, swing)
        axes.plot(frequency, cost, color=colours[p], linewidth=1.6)
        trend = fit_swing_trend(frequency, current, swing)
        if rig is not None and trend is not None:
            saved = winding_resistance(rig) * trend.squared_saving(frequency) / frequency
            axes.plot(frequency, cost + saved, color=colours[p], linestyle="--", linewidth=1.1)
        at = float(results["resonance_hz"].values[p])
        ends = [
            float(results[name].values[p])
            for name in ("trend_cost_at_resonance_j_rad2", "swing_cost_at_resonance_j_rad2")
        ]
        axes.annotate("", (at, ends[1]), (at, ends[0]), arrowprops=_ARROW)
        cheapest = float(results["cheapest_hz"].values[p])
        if math.isfinite(cheapest):
            least = float(results["swing_cost_at_cheapest_j_rad2"].values[p])
            axes.plot(cheapest, least, "v", markersize=4, color=colours[p], markeredgecolor=INK, zorder=5)
    axes.set(xlabel="drive frequency in Hz", ylabel="energy per cycle and rad² in J", yscale="log")
    axes.set_xlim(frequency.min(), frequency.max())
    note_panel(axes, "b", "per swing of the head (dashed: trend)")


_ARROW = {"arrowstyle": "->", "color": GREY, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
_CURVES = ("drive_power_w", "amplitude_rad", "drive_current_rms_a")


def _draw_shares(axes: Axes, results: xr.Dataset) -> None:
    pretension = results["pretension_mm"].values
    idle = float(results.attrs.get("idle_power_w", math.nan))
    width = 0.7 * float(np.min(np.diff(pretension))) if pretension.size > 1 else 0.7
    floor: Array = np.zeros(pretension.size)
    for label, name, colour in _SHARES:
        height = np.nan_to_num(results[name].values if name else np.full(pretension.size, idle))
        axes.bar(pretension, height, width, bottom=floor, color=colour, label=label)
        floor = floor + height
    axes.set(xlabel="pretension in mm", ylabel="power at resonance in W", ylim=(0, 1.3 * max(1.0, float(floor.max()))))
    axes.legend(loc="upper left", ncols=len(_SHARES), handlelength=1.0, columnspacing=1.2)
    note_panel(axes, "c", "where it goes, at resonance")
