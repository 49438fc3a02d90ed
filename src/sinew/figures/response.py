"""This is where Figure 6 is drawn: amplitude response and phase difference over frequency, for all pretensions."""

import numpy as np
import xarray as xr
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.axes3d import Axes3D
from scipy.interpolate import PchipInterpolator

from sinew.analysis.sweep.saturation import gain_map
from sinew.figures.style import (
    GREY,
    INK,
    MARKERS,
    RED,
    few,
    in_style,
    mean_and_spread,
    new_figure,
    note_panel,
    pretension_bar,
    pretension_colours,
)
from sinew.measure.arrays import Array


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
    drawn = gain_map(results).isel(pretension_mm=np.argsort(results["pretension_mm"].values))
    pretension = drawn["pretension_mm"].values
    ridge = (drawn["ridge_hz"].values, pretension, drawn["ridge_gain"].values)
    x, gain = along_ridge(drawn["frequency_hz"].values, drawn["gain"].values, ridge[0])
    y = np.broadcast_to(pretension[:, None], x.shape)
    figure = new_figure(3.4)
    columns = figure.add_gridspec(1, 2, width_ratios=(1.15, 1.0))
    surface = figure.add_subplot(columns[0], projection="3d")
    above = figure.add_subplot(columns[1])
    _draw_surface(surface, x, y, gain, ridge)
    _draw_above(figure, above, x, y, gain, ridge)
    return figure


Ridge = tuple[Array, Array, Array]


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


def _label_places(lines: QuadContourSet, x: Array, y: Array) -> list[tuple[float, float]]:
    """Return a place on each line of equal gain up to 1.5, at middle pretension and well inside the frame."""
    (left, right), (low, high) = ((float(v.min()), float(v.max())) for v in (x, y))
    places = []
    for level, path in zip(lines.levels, lines.get_paths(), strict=True):
        at, across = np.asarray(path.vertices, dtype=float).T
        inside = (at > left + 0.08 * (right - left)) & (at < right - 0.08 * (right - left))
        if level <= 1.5 and inside.any():
            off = np.where(inside, np.abs(across - (low + high) / 2), np.inf)
            best = int(np.argmin(off))
            places.append((float(at[best]), float(across[best])))
    return places


def _draw_above(figure: Figure, axes: Axes, x: Array, y: Array, gain: Array, ridge: Ridge) -> None:
    axes.grid(False)
    mesh = axes.pcolormesh(x, y, gain, cmap=_COLOURS, vmin=0, shading="gouraud", rasterized=True)
    levels = [level for level in (0.5, 1.0, 1.5, 2.0, 2.5, 3.0) if np.nanmin(gain) < level < np.nanmax(gain)]
    if levels:
        lines = axes.contour(x, y, gain, levels=levels, colors="white", linewidths=0.6)
        places = _label_places(lines, x, y)
        for text in axes.clabel(lines, fmt="%g", fontsize=8, manual=places) if places else ():
            text.set_path_effects([patheffects.withStroke(linewidth=1.2, foreground="#333333")])
    halo = [patheffects.withStroke(linewidth=3.0, foreground="white")]
    axes.plot(ridge[0], ridge[1], color=RED, linewidth=1.6, path_effects=halo, zorder=4)
    axes.plot(ridge[0], ridge[1], "o", color="white", markersize=3, markeredgecolor=INK, zorder=5, clip_on=False)
    axes.set(xlabel="drive frequency in Hz", ylabel="pretension in mm")
    note_panel(axes, "b", "from above, with the ridge")
    bar = figure.colorbar(mesh, ax=axes, label="gain", aspect=28, pad=0.02)
    bar.outline.set_visible(False)
