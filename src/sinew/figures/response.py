"""This is where Figure 6 is drawn: amplitude response and phase difference over frequency, for all pretensions."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.figures.spread import mean_and_spread
from sinew.figures.style import (
    GREY,
    INK,
    MARKERS,
    Floats,
    few,
    in_style,
    new_figure,
    note_panel,
    pretension_bar,
    pretension_colours,
)

__all__ = ["draw_response", "draw_tubes"]


@in_style
def draw_response(results: xr.Dataset) -> Figure | None:
    """Return Figure 6 of the paper, or None where the results hold no sweep.

    Left: gain by nominal drive (Eq. 6), with its peaks; right: lag of the torsion behind the drive. Lines are means
    over repeats, tubes ±1 standard deviation.
    """
    if "gain" not in results or results.sizes["frequency_hz"] < 2:
        return None
    frequency, pretension = results["frequency_hz"].values, results["pretension_mm"].values
    figure = new_figure(3.5)
    left, right = figure.subplots(1, 2)
    draw_tubes(left, frequency, results["gain"].values, pretension)
    draw_tubes(right, frequency, np.rad2deg(results["phase_lag_rad"].values), pretension)
    if "resonance_hz" in results:
        _mark_peaks(left, results)
    units = (str(results.attrs.get("response_unit", "rad")), str(results.attrs.get("drive_unit", "rad")))
    if units[0] == units[1]:
        left.axhline(1.0, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
    label = (
        "gain: torsion amplitude / nominal drive" if units == ("rad", "rad") else f"gain in {units[0]} per {units[1]}"
    )
    left.set(xlabel="drive frequency in Hz", ylabel=label, ylim=(0, None))
    right.axhline(90.0, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
    right.set(xlabel="drive frequency in Hz", ylabel="lag of torsion behind drive in degrees")
    right.set_yticks(range(0, 181, 45))
    note_panel(left, "a", "amplitude response")
    note_panel(right, "b", "phase difference")
    for axes in (left, right):
        axes.set_xlim(frequency.min(), frequency.max())
    pretension_bar(figure, (left, right), pretension)
    return figure


def draw_tubes(axes: Axes, frequency_hz: Floats, values: Floats, pretension_mm: Floats) -> None:
    """Draw one mean line with a tube of ±1 standard deviation for each pretension.

    values: (p, f, r), in the unit of the axes. Every few pretensions carry a marker of their own.
    """
    mean, spread = mean_and_spread(values)
    marked = dict(zip(few(len(pretension_mm), 4).tolist(), MARKERS, strict=False))
    for p, colour in enumerate(pretension_colours(pretension_mm)):
        if np.isfinite(spread[p]).any():
            tube = (mean[p] - spread[p], mean[p] + spread[p])
            axes.fill_between(frequency_hz, *tube, color=colour, alpha=0.45, linewidth=0.5)
        axes.plot(
            frequency_hz,
            mean[p],
            color=colour,
            linewidth=0.8,
            marker=marked.get(p, ""),
            markevery=(p % 3, 3),
            markersize=3.6,
            markeredgecolor="white",
            markeredgewidth=0.4,
            label=f"{pretension_mm[p]:g} mm",
        )


def _mark_peaks(axes: Axes, results: xr.Dataset) -> None:
    """Put a ring on each peak and write the pretension beside every few of them."""
    where, height = results["paper_resonance_hz"].values, results["paper_gain_peak"].values
    axes.plot(where, height, linestyle="none", marker="o", markersize=3, color="white", markeredgecolor=INK, zorder=5)
    for p in few(where.size, 4) if where.size > 1 else ():
        if np.isfinite(where[p]) and np.isfinite(height[p]):
            text = f"{results['pretension_mm'].values[p]:g} mm"
            axes.annotate(text, (where[p], height[p]), (4, 4), textcoords="offset points", fontsize=8, color=INK)
