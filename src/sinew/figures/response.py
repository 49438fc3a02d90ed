"""Figures over frequency: gain and phase of a sweep, its map, its drive, what a swing costs; broadband and impact."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.axes3d import Axes3D
from scipy.interpolate import PchipInterpolator

from sinew.analysis.sweep.energy import cost_of_swing, fit_swing_trend
from sinew.figures.motion import Group, at_pretension, drive_of, groups_of, rig_of
from sinew.figures.style import (
    ACCENT,
    GREY,
    INK,
    MARKERS,
    RED,
    few,
    frequency_colours,
    in_style,
    new_figure,
    note_panel,
    pretension_bar,
    pretension_colours,
)
from sinew.measure.arrays import Array, Mask, mean_and_spread
from sinew.measure.estimate import shown


@in_style
def draw_response(results: xr.Dataset) -> Figure | None:
    """Return Figure 6 of the paper, or None where the results hold no sweep.

    Left: gain by nominal drive (Eq. 6), with its peaks; right: lag of the torsion behind the drive. Lines are means
    over repeats, tubes ±1 standard deviation.
    """
    if "gain" not in results or results.sizes["frequency_hz"] < 2:
        return None
    pretension = results["pretension_mm"].values
    figure = new_figure(3.5)
    left, right = figure.subplots(1, 2)
    draw_gain(left, results)
    draw_lag(right, results)
    note_panel(left, "a", "amplitude response")
    note_panel(right, "b", "phase difference")
    pretension_bar(figure, (left, right), pretension)
    return figure


def draw_gain(axes: Axes, results: xr.Dataset) -> Axes:
    """Draw the gain by nominal drive over frequency, with its peaks."""
    frequency = results["frequency_hz"].values
    draw_tubes(axes, frequency, results["gain"].values, results["pretension_mm"].values)
    if "resonance_hz" in results:
        _mark_peaks(axes, results)
    units = (str(results.attrs.get("response_unit", "rad")), str(results.attrs.get("drive_unit", "rad")))
    if units[0] == units[1]:
        axes.axhline(1.0, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
    label = (
        "gain: torsion amplitude / nominal drive" if units == ("rad", "rad") else f"gain in {units[0]} per {units[1]}"
    )
    axes.set(xlabel="drive frequency in Hz", ylabel=label, ylim=(0, None), xlim=(frequency.min(), frequency.max()))
    return axes


def draw_lag(axes: Axes, results: xr.Dataset) -> Axes:
    """Draw the lag of the torsion behind the drive over frequency."""
    frequency = results["frequency_hz"].values
    draw_tubes(axes, frequency, np.rad2deg(results["phase_lag_rad"].values), results["pretension_mm"].values)
    axes.axhline(90.0, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
    axes.set(xlabel="drive frequency in Hz", ylabel="lag of torsion behind drive in degrees")
    axes.set_yticks(range(0, 181, 45))
    axes.set_xlim(frequency.min(), frequency.max())
    return axes


def draw_tubes(axes: Axes, frequency_hz: Array, values: Array, pretension_mm: Array) -> None:
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


# Figure 8 is drawn: the gain over frequency and pretension, as a surface and from above.

_COLOURS = "cividis"
_COLUMNS = 61


@in_style
def draw_response_map(results: xr.Dataset) -> Figure | None:
    """Return Figure 8 of the paper, or None with fewer than three pretensions or frequencies.

    Left: mean gain as a surface over frequency and pretension; right: the same from above with lines of equal gain.
    The red line with rings is the ridge, resonance over pretension.
    """
    if (
        not {"gain", "resonance_hz"} <= set(results.data_vars)
        or min(results.sizes["pretension_mm"], results.sizes["frequency_hz"]) < 3
    ):
        return None
    drawn = results[["gain", "resonance_hz", "gain_peak"]].isel(
        pretension_mm=np.argsort(results["pretension_mm"].values)
    )
    pretension = drawn["pretension_mm"].values
    ridge = (drawn["resonance_hz"].values, pretension, drawn["gain_peak"].values)
    x, gain = along_ridge(drawn["frequency_hz"].values, mean_and_spread(drawn["gain"].values)[0], ridge[0])
    y = np.broadcast_to(pretension[:, None], x.shape)
    figure = new_figure(3.4)
    columns = figure.add_gridspec(1, 2, width_ratios=(1.15, 1.0))
    surface = figure.add_subplot(columns[0], projection="3d")
    above = figure.add_subplot(columns[1])
    _draw_surface(surface, x, y, gain, ridge)
    map_bar(figure, draw_map(above, x, y, gain, ridge, float(np.nanmax(gain))), [above])
    note_panel(above, "b", "from above, with the ridge")
    return figure


Ridge = tuple[Array, Array, Array]
"""Resonance [Hz], pretension [mm] and gain there, (p,) each."""


def along_ridge(frequency_hz: Array, gain: Array, ridge_hz: Array) -> tuple[Array, Array]:
    """Return (frequency [Hz], gain), both (p, s), on a mesh whose lines run along the ridge.

    On the measured grid (f) a narrow ridge that crosses it becomes a row of teeth. Here column s is at the same share
    of the resonance for every pretension; between its measured frequencies a curve is the monotone cubic one (PCHIP),
    which never overshoots. Where a resonance is unknown, it is taken on the line between its neighbours.
    """
    known = np.isfinite(ridge_hz)
    index = np.arange(ridge_hz.size)
    low, high = float(frequency_hz.min()), float(frequency_hz.max())
    ridge = np.interp(index, index[known], ridge_hz[known]) if known.any() else np.full(ridge_hz.size, (low + high) / 2)
    share = np.linspace(low / ridge.max(), high / ridge.min(), _COLUMNS)
    mesh = np.clip(ridge[:, None] * share, low, high)
    out = np.full(mesh.shape, np.nan)
    for p, row in enumerate(gain):
        valid = np.isfinite(row)
        if valid.sum() > 1:
            out[p] = PchipInterpolator(frequency_hz[valid], row[valid], extrapolate=False)(mesh[p])
    return mesh, out


def _draw_surface(axes: Axes3D, x: Array, y: Array, gain: Array, ridge: Ridge) -> None:
    look = {"cmap": _COLOURS, "vmin": 0, "linewidth": 0.15, "edgecolor": "#ffffff55", "rasterized": True}
    axes.plot_surface(x, y, gain, rstride=1, cstride=1, **look)
    axes.plot(*ridge[:2], ridge[2] + 0.02, color=RED, linewidth=1.6, zorder=10)
    axes.view_init(elev=32, azim=-38)
    axes.set_box_aspect((1.25, 1.1, 0.8), zoom=1.0)
    axes.set_xlabel("drive frequency in Hz", labelpad=-2)
    axes.set_ylabel("pretension in mm", labelpad=-2)
    axes.text2D(0.93, 0.68, "gain", transform=axes.transAxes, ha="center")
    axes.tick_params(pad=-2)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((1, 1, 1, 0))
    note_panel(axes, "a", "gain over frequency and pretension")


_LEVELS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.0, 10.0)


def draw_map(axes: Axes, x: Array, y: Array, gain: Array, ridge: Sequence[Array], top: float) -> QuadMesh:
    """Draw a gain over frequency and pretension from above, with lines of equal gain and the ridge in red.

    x, y, gain: (p, s), see `along_ridge`. ridge: its frequency and pretension. top: gain of the brightest colour.
    """
    axes.grid(False)
    mesh = axes.pcolormesh(x, y, gain, cmap=_COLOURS, vmin=0, vmax=top, shading="gouraud", rasterized=True)
    levels = [level for level in _LEVELS if np.nanmin(gain) < level < np.nanmax(gain)]
    if levels:
        lines = axes.contour(x, y, gain, levels=levels, colors="white", linewidths=0.6)
        labelled = [
            level for level in levels if level <= 0.45 * top
        ]  # the others are too close for a number between them
        for text in axes.clabel(lines, levels=labelled, fmt="%g", fontsize=8):
            text.set_path_effects([patheffects.withStroke(linewidth=1.2, foreground="#333333")])
    halo = [patheffects.withStroke(linewidth=3.0, foreground="white")]
    axes.plot(*ridge[:2], color=RED, linewidth=1.6, path_effects=halo, zorder=4)
    axes.plot(*ridge[:2], "o", color="white", markersize=3, markeredgecolor=INK, zorder=5, clip_on=False)
    axes.set(xlabel="drive frequency in Hz", ylabel="pretension in mm")
    return mesh


def map_bar(figure: Figure, mesh: QuadMesh, axes: Sequence[Axes]) -> None:
    """Add the key from colour to gain, right of the axes."""
    bar = figure.colorbar(mesh, ax=list(axes), label="gain", aspect=28, pad=0.02)
    bar.outline.set_visible(False)


# What a swing costs, and where its power goes.

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
            saved = rig.drive.resistance * trend.squared_saving(frequency) / frequency
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


# What the drive did of what it was told.


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
    suffix = at_pretension(recording, sweep[0].segment.pretension_mm)
    note_panel(axes, "a", f"outline of a sweep{suffix}: settling (grey), recorded (colour), frequency in Hz")


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


# A broadband record, or one of hammer blows, is drawn: gain by H1 and H2, lag and coherence, with the modes in them.


@in_style
def draw_broadband(document: dict[str, Any]) -> Figure:
    """Return gain, lag and coherence over frequency, one above the other.

    document: of `sinew analyse --kind broadband` (`broadband_json`) or `--kind impact` (`impact_json`).
    """
    figure = new_figure(5.6)
    panels = figure.subplots(3, 1, sharex=True, height_ratios=(1.6, 1.2, 0.8))
    drawn = (draw_lines, draw_lag_lines, draw_coherence)
    for axes, letter, title, draw in zip(panels, "abc", ("gain", "lag", "coherence"), drawn, strict=True):
        draw(axes, document)
        note_panel(axes, letter, title)
        if axes is not panels[-1]:
            axes.set_xlabel("")
    return figure


def draw_lines(axes: Axes, document: dict[str, Any]) -> Axes:
    """Draw |H1| with its 90 % interval, |H2|, and the gain of the fitted modes."""
    frequency, fitted = (_column(document, key) for key in ("frequency_hz", "fitted_gain"))
    if _is_compared(document):
        axes.plot(frequency, _column(document, "gain_h2"), color=GREY, linewidth=0.9, label="H2")
    gain = _banded(axes, document, "gain", "H1")
    axes.plot(frequency, fitted, color=RED, linewidth=1.1, label="modes")
    for k, mode in enumerate(document["modes"]):
        natural = mode["natural_frequency_hz"]["value"]
        axes.axvline(natural, color=INK, linewidth=0.8, linestyle=":")
        words = f"{shown(mode['natural_frequency_hz'], 'Hz')}, D = {shown(mode['damping_ratio'])}"
        axes.annotate(words, (natural, 0.02 + 0.1 * k), (3, 0), ("data", "axes fraction"), "offset points", va="bottom")
    known = gain[_coherent(document)]
    pair = (str(document["response_unit"]), str(document["drive_unit"]))
    units = [f"({unit})" if "*" in unit or "/" in unit else unit for unit in pair]
    same = "" if units[0] == units[1] else f" in {'/'.join(units)}"
    axes.set(ylabel=f"response / drive{same}", yscale="log", ylim=(0.1 * known.min(), 3.0 * known.max()))
    axes.legend(loc="upper right", ncols=3)
    return _over_frequency(axes, document)


def draw_lag_lines(axes: Axes, document: dict[str, Any]) -> Axes:
    """Draw the lag of the response behind the drive by H1, with its 90 % interval, and that of the modes."""
    _banded(axes, document, "phase_lag_deg", "H1")
    lag = _column(document, "fitted_phase_lag_deg")
    axes.plot(_column(document, "frequency_hz"), _unbroken(lag), color=RED, linewidth=1.1, label="modes")
    axes.set(ylabel="lag in degrees", yticks=np.arange(-90, 271, 90), ylim=(-100, 280))
    return _over_frequency(axes, document)


def draw_coherence(axes: Axes, document: dict[str, Any]) -> Axes:
    """Draw the coherence, and the band in which modes were sought."""
    axes.axvspan(*document["band_hz"], color=GREY, alpha=0.15, linewidth=0, label="band of the modes")
    axes.plot(_column(document, "frequency_hz"), _column(document, "coherence"), color=ACCENT, label="γ²")
    if not _is_compared(document):
        axes.text(0.5, 0.5, "one hit: nothing to compare it with", transform=axes.transAxes, ha="center", va="center")
    axes.set(ylabel="coherence γ²", ylim=(0, 1.05))
    return _over_frequency(axes, document)


def _is_compared(document: dict[str, Any]) -> bool:
    """Return whether there is a coherence: a single hit has none, and its H2 is its H1."""
    return bool(np.isfinite(_column(document, "coherence")).any())


def _coherent(document: dict[str, Any]) -> Mask:
    """Return which lines are worth seeing: those of the band, and where half the response is due to the drive."""
    frequency, (low, high) = _column(document, "frequency_hz"), document["band_hz"]
    return np.asarray((_column(document, "coherence") > 0.5) | ((frequency >= low) & (frequency <= high)))


def _over_frequency(axes: Axes, document: dict[str, Any]) -> Axes:
    last = float(_column(document, "frequency_hz")[_coherent(document)].max())
    axes.set(xlabel="frequency in Hz", xlim=(0.0, 1.1 * last))
    return axes


def _column(document: dict[str, Any], key: str) -> Array:
    """Return one plain number of each line, NaN where it is not known, shape (f,)."""
    return np.array([np.nan if row[key] is None else row[key] for row in document["frequency_response"]], dtype=float)


def _banded(axes: Axes, document: dict[str, Any], key: str, label: str) -> Array:
    rows = document["frequency_response"]
    ends = np.array([row[key]["interval90"] for row in rows], dtype=float)
    value = np.array([row[key]["value"] for row in rows], dtype=float)
    frequency = _column(document, "frequency_hz")
    axes.fill_between(frequency, ends[:, 0], ends[:, 1], color=ACCENT, alpha=0.25, linewidth=0)
    axes.plot(frequency, _unbroken(value) if key == "phase_lag_deg" else value, color=ACCENT, label=label)
    return value


def _unbroken(lag: Array) -> Array:
    """Return lags [deg] with a gap where they jump by a turn."""
    jumps = np.abs(np.diff(lag, prepend=lag[:1])) > 180
    return np.where(jumps, np.nan, lag)
