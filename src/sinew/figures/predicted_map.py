"""This is where the predicted gain is drawn over frequency and pretension, a map for each rig."""

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from sinew.figures.predicted import Curves, upper_gain
from sinew.figures.predicted_comparison import label_outer, shortened
from sinew.figures.response_map import along_ridge
from sinew.figures.style import INK, RED, Floats, in_style, new_figure, note_panel

__all__ = ["draw_predicted_map"]

_COLOURS = "cividis"
_FREQUENCIES = 241
_LEVELS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.0, 10.0)
_ACROSS = 2
_ONE_ROW = 3
_FEWEST = 3


@in_style
def draw_predicted_map(rigs: list[Curves]) -> Figure | None:
    """Return the largest stable gain over frequency and pretension, on one scale of colour, or None where fewer than
    three pretensions were predicted.

    The red line with rings is the ridge: the resonance at each predicted pretension. Between pretensions the map
    follows it.
    """
    rigs = [curves for curves in rigs if len(set(curves.pretension_mm)) >= _FEWEST]
    if not rigs:
        return None
    across = len(rigs) if len(rigs) <= _ONE_ROW else _ACROSS
    rows = -(-len(rigs) // across)
    figure = new_figure(2.7 * rows + 0.2, 7.1 if across > 1 else 4.6)
    panels = figure.subplots(rows, across, sharex=True, sharey=True, squeeze=False).ravel()
    maps = [_map(curves) for curves in rigs]
    top = max(float(np.nanmax(gain)) for *_, gain in maps)
    for i, (axes, curves, found) in enumerate(zip(panels, rigs, maps, strict=False)):
        last = _draw(axes, *found, top)
        ridge = np.array([np.nan if b.peak is None else b.peak.frequency_hz for b in curves.branches])
        order = np.argsort(curves.pretension_mm)
        where = (ridge[order], np.asarray(curves.pretension_mm)[order])
        halo = [patheffects.withStroke(linewidth=3.0, foreground="white")]
        axes.plot(*where, color=RED, linewidth=1.6, path_effects=halo, zorder=4)
        axes.plot(*where, "o", color="white", markersize=3, markeredgecolor=INK, zorder=5, clip_on=False)
        note_panel(axes, chr(ord("a") + i) if len(rigs) > 1 else "", shortened(curves.name, across))
        axes.set(xlabel="drive frequency in Hz", ylabel="pretension in mm")
    label_outer(list(panels), len(rigs), across)
    bar = figure.colorbar(last, ax=list(panels[: len(rigs)]), label="gain", aspect=28, pad=0.02)
    bar.outline.set_visible(False)
    return figure


def _map(curves: Curves) -> tuple[Floats, Floats, Floats]:
    """Return frequency [Hz], pretension [mm] and gain, all (p, s), on a mesh along the ridge."""
    order = np.argsort(curves.pretension_mm)
    pretension = np.asarray(curves.pretension_mm)[order]
    branches = [curves.branches[i] for i in order]
    low = max(float(b.frequency_hz.min()) for b in branches)
    high = min(float(b.frequency_hz.max()) for b in branches)
    frequency = np.linspace(low, high, _FREQUENCIES)
    ordered = Curves(curves.name, tuple(pretension.tolist()), tuple(branches), curves.amplitude_deg)
    ridge = np.array([np.nan if b.peak is None else b.peak.frequency_hz for b in branches])
    fine = np.linspace(pretension[0], pretension[-1], 4 * (len(pretension) - 1) + 1)
    x, gain = along_ridge(frequency, upper_gain(ordered, frequency), ridge)
    across = [np.array([np.interp(fine, pretension, column) for column in values.T]).T for values in (x, gain)]
    return across[0], np.broadcast_to(fine[:, None], across[0].shape), across[1]


def _draw(axes: Axes, x: Floats, y: Floats, gain: Floats, top: float) -> QuadMesh:
    axes.grid(False)
    mesh = axes.pcolormesh(x, y, gain, cmap=_COLOURS, vmin=0, vmax=top, shading="gouraud", rasterized=True)
    levels = [level for level in _LEVELS if np.nanmin(gain) < level < np.nanmax(gain)]
    if levels:
        lines = axes.contour(x, y, gain, levels=levels, colors="white", linewidths=0.6)
        told = [level for level in levels if level <= 0.45 * top]  # the others are too close for a number between them
        for text in axes.clabel(lines, levels=told, fmt="%g", fontsize=8):
            text.set_path_effects([patheffects.withStroke(linewidth=1.2, foreground="#333333")])
    return mesh
