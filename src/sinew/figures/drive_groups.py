"""This is where Figure 5 is drawn: the driving oscillation, frequency by frequency."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.figures.motion import Group, at_pretension, drive_of, groups_of, rig_of
from sinew.figures.response import draw_tubes
from sinew.figures.style import (
    ACCENT,
    GREY,
    INK,
    RED,
    few,
    frequency_colours,
    in_style,
    new_figure,
    note_panel,
    pretension_bar,
)
from sinew.measure.arrays import Array


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


def _outline(time_s: Array, values: Array, frequency_hz: float) -> tuple[Array, Array, Array]:
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


# The drive's reach is drawn: measured drive amplitude over frequency, for all pretensions.


@in_style
def draw_drive_amplitude(recording: xr.Dataset, results: xr.Dataset) -> Figure | None:
    """Return measured drive amplitude [deg] over frequency, or None where the results hold no sweep.

    The dotted line is the nominal amplitude; rings mark the resonance at each pretension. Where the rig is known, a
    dashed line shows the largest sine whose peak speed stays under the motor's no-load speed, a dash-dotted one the
    fundamental of a triangle at that speed, which no drive exceeds that never runs faster.
    """
    if "drive_amplitude_rad" not in results or "drive_rad" not in recording:
        return None
    if not np.isfinite(results["drive_amplitude_rad"].values).any():
        return None
    frequency, pretension = results["frequency_hz"].values, results["pretension_mm"].values
    amplitude = np.rad2deg(results["drive_amplitude_rad"].values)
    figure = new_figure(3.2, 5.2)
    axes = figure.subplots()
    draw_tubes(axes, frequency, amplitude, pretension)
    nominal = recording["amplitude_deg"].values
    nominal = nominal[np.isfinite(nominal) & (recording["kind"].values == "steady")]
    top = float(np.nanmax(amplitude))
    if nominal.size:
        top = max(top, float(nominal.max()))
        axes.axhline(nominal.max(), color=GREY, linestyle=":", linewidth=1.2)
        axes.annotate("nominal", (frequency.max(), nominal.max()), **_ABOVE, color="#5a5a5a")
    speed = _no_load_speed(results)
    if speed is not None:
        fine = np.linspace(frequency.min(), frequency.max(), 120)
        sine, triangle = (ceiling(fine, speed) for ceiling in (sine_ceiling, triangle_ceiling))
        axes.plot(fine, np.rad2deg(sine), color=RED, linestyle="--", linewidth=1.1, label="sine at no-load speed")
        axes.plot(
            fine, np.rad2deg(triangle), color=RED, linestyle="-.", linewidth=1.1, label="triangle at no-load speed"
        )
        axes.legend(handles=axes.lines[-2:], loc="lower left", handlelength=2.6)
    if "resonance_hz" in results:
        height = np.rad2deg(results["drive_amplitude_at_resonance_rad"].values)
        where = results["resonance_hz"].values
        axes.plot(where, height, "o", markersize=3, color="white", markeredgecolor=INK, zorder=5)
    axes.set(xlabel="drive frequency in Hz", ylabel="measured drive amplitude in degrees")
    axes.set(xlim=(frequency.min(), frequency.max()), ylim=(0, 1.15 * top))
    note_panel(axes, "", "what the drive really does (rings: at resonance)")
    pretension_bar(figure, (axes,), pretension)
    return figure


_ABOVE: dict[str, Any] = {"xytext": (-2, 4), "textcoords": "offset points", "ha": "right", "fontsize": 8}


def sine_ceiling(frequency_hz: Array, speed: float) -> Array:
    """Return the amplitude [rad] of the sine at a frequency [Hz] whose peak speed is `speed` [rad/s]: ω₀/(2πf)."""
    return np.asarray(speed / (2 * np.pi * frequency_hz))


def triangle_ceiling(frequency_hz: Array, speed: float) -> Array:
    """Return the fundamental's amplitude [rad] of the triangle at constant speed [rad/s]: 2ω₀/(π²f).

    Its peak is ω₀/(4f), of which the fundamental is the share 8/π².
    """
    return np.asarray(2 * speed / (np.pi**2 * frequency_hz))


def _no_load_speed(results: xr.Dataset) -> float | None:
    """Return the drive's no-load speed at its supply voltage [rad/s], None where the rig is not known."""
    rig = rig_of(results)
    if rig is None:
        return None
    drive = rig.drive
    return float(drive.no_load_speed.value * drive.supply_voltage.value / drive.nominal_voltage.value)
