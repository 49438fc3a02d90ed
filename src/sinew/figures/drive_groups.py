"""This is where Figure 5 is drawn: the driving oscillation, frequency by frequency."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.figures.motion import Group, at_pretension, drive_of, groups_of
from sinew.figures.style import ACCENT, GREY, INK, Floats, few, frequency_colours, in_style, new_figure, note_panel

__all__ = ["draw_drive_groups"]


@in_style
def draw_drive_groups(recording: xr.Dataset) -> Figure | None:
    """Return Figure 5 of the paper, or None where no drive angle was recorded in at least two groups.

    Above: the measured drive over one whole sweep, its recorded groups coloured by frequency; below: settle and
    record of three groups, commanded and measured.
    """
    if "drive_rad" not in recording:
        return None
    groups = groups_of(recording, "steady")
    if not groups:
        return None
    first = groups[0].segment
    sweep = [g for g in groups if (g.segment.pretension_mm, g.segment.repeat) == (first.pretension_mm, first.repeat)]
    if len(sweep) < 2:
        return None
    chosen = [sweep[i] for i in few(len(sweep), 3)]
    figure = new_figure(4.2)
    rows = figure.add_gridspec(2, len(chosen), height_ratios=(1.0, 1.0))
    _draw_sweep(figure.add_subplot(rows[0, :]), recording, sweep)
    panels: list[Axes] = []
    for i, group in enumerate(chosen):
        axes = figure.add_subplot(rows[1, i], sharey=panels[0] if panels else None)
        axes.tick_params(labelleft=not panels)
        _draw_group(axes, recording, group)
        note_panel(axes, "bcd"[i], f"{group.segment.frequency_hz:.3g} Hz")
        panels.append(axes)
    panels[0].set_ylabel("drive θ in degrees")
    figure.supxlabel("time from the start of the record in s (dashed: commanded, solid: measured)", fontsize=8.5)
    return figure


def _draw_sweep(axes: Axes, recording: xr.Dataset, sweep: list[Group]) -> None:
    """Draw the drive over one sweep as the outline of its samples, recorded groups in colour."""
    colours = frequency_colours([g.segment.frequency_hz for g in sweep])
    nominal = sweep[0].segment.amplitude_deg
    labelled = set(few(len(sweep), 9).tolist())
    begin = float(recording["time_s"].values[(sweep[0].settle or sweep[0].record).start])
    for i, (group, colour) in enumerate(zip(sweep, colours, strict=True)):
        for where, shade in ((group.settle, "#cfcfcf"), (group.record, colour)):
            if where is not None:
                time, drive, _ = drive_of(recording, where, begin)
                axes.fill_between(*_outline(time, drive, group.segment.frequency_hz), color=shade, linewidth=0)
        if i in labelled:
            middle = float(recording["time_s"].values[group.record].mean()) - begin
            axes.text(middle, 1.1 * nominal, f"{group.segment.frequency_hz:.3g}", ha="center", va="bottom", fontsize=8)
    for level in (-nominal, nominal):
        axes.axhline(level, color=INK, linestyle=":", linewidth=0.9)
    axes.set(xlabel="time in the sweep in s", ylabel="drive θ in degrees", ylim=(-1.2 * nominal, 1.45 * nominal))
    axes.margins(x=0.01)
    axes.set_yticks([-nominal, 0, nominal])
    place = at_pretension(recording, sweep[0].segment.pretension_mm)
    note_panel(axes, "a", f"outline of a sweep{place}: settling (grey), recorded (colour), frequency in Hz")


def _outline(time_s: Floats, values: Floats, frequency_hz: float) -> tuple[Floats, Floats, Floats]:
    """Return (time, lowest, highest) period by period: an oscillation too dense to draw becomes its outline."""
    periods = max(1, int((time_s[-1] - time_s[0]) * frequency_hz))
    starts = np.linspace(0, values.size, periods + 1).astype(int)[:-1]
    low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
    return np.append(time_s[starts], time_s[-1]), np.append(low, low[-1]), np.append(high, high[-1])


def _draw_group(axes: Axes, recording: xr.Dataset, group: Group) -> None:
    begin = (group.settle or group.record).start
    origin = float(recording["time_s"].values[group.record.start])
    time, drive, command = drive_of(recording, slice(begin, group.record.stop), origin)
    shown = time >= -1.0
    time, drive = time[shown], drive[shown]
    nominal = group.segment.amplitude_deg
    axes.axvspan(0, time[-1], color="#e6eff8", linewidth=0, zorder=0)
    if command is not None:
        axes.plot(time, command[shown], color=INK, linewidth=0.8, linestyle=(0, (3, 2)), label="commanded")
    axes.plot(time[time <= 0], drive[time <= 0], color=GREY, linewidth=1.4, label="settling")
    axes.plot(time[time >= 0], drive[time >= 0], color=ACCENT, linewidth=1.5, label="recorded")
    axes.set(xlim=(time[0], time[-1]), ylim=(-1.2 * nominal, 1.2 * nominal), yticks=[-nominal, 0, nominal])
