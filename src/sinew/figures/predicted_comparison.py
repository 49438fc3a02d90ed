"""This is where the predicted responses of several rigs are drawn beside each other."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.figures.predicted import Curves, draw_gains
from sinew.figures.style import ACCENT, GREEN, INK, MARKERS, RED, in_style, new_figure, note_panel, pretension_bar

__all__ = ["draw_comparison", "label_outer", "shortened"]

_COLOURS = (ACCENT, RED, GREEN, "#7a4fa3", "#b8690b", "#4d4d4d", "#008b8b")
_ACROSS = 3
_CHARACTERS = 69


@in_style
def draw_comparison(rigs: list[Curves]) -> Figure:
    """Return resonance, peak gain over pretension for all rigs, and below them each rig's curves on equal axes."""
    across = min(_ACROSS, max(2, len(rigs)))
    rows = -(-len(rigs) // across)
    heights = [2.4 + 0.1 * len(rigs), 2.4 * rows]
    figure = new_figure(sum(heights))
    above, below = np.ravel(figure.subfigures(2, 1, squeeze=False, height_ratios=heights))
    left, right = above.subplots(1, 2)
    _draw_marks(left, rigs, "frequency_hz")
    left.set(xlabel="pretension in mm", ylabel="resonance in Hz")
    _draw_marks(right, rigs, "gain")
    right.set(xlabel="pretension in mm", ylabel="gain at resonance", ylim=(0, None))
    note_panel(left, "a", "resonance")
    note_panel(right, "b", "gain at resonance")
    above.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=1 if len(rigs) > 4 else 2)
    panels = below.subplots(rows, across, sharex=True, sharey=True, squeeze=False).ravel()
    for i, (axes, curves) in enumerate(zip(panels, rigs, strict=False)):
        draw_gains(axes, curves)
        note_panel(axes, chr(ord("c") + i), shortened(curves.name, across))
        axes.set_ylabel("gain")
    panels[0].set_ylim(0, None)
    label_outer(list(panels), len(rigs), across)
    pretensions = np.unique(np.concatenate([curves.pretension_mm for curves in rigs]))
    pretension_bar(below, list(panels[: len(rigs)]), pretensions)
    return figure


def shortened(name: str, across: int) -> str:
    """Return a rig's name, cut to what fits above one of so many panels in a row."""
    most = _CHARACTERS // across
    return name if len(name) <= most else f"{name[: most - 1].rstrip(' ,')}…"


def label_outer(panels: list[Axes], count: int, across: int) -> None:
    """Label the axes at the left and at the bottom of a grid of which the first `count` panels are used."""
    for i, axes in enumerate(panels):
        axes.set_visible(i < count)
        axes.tick_params(labelbottom=i + across >= count, labelleft=i % across == 0)
        if i + across < count:
            axes.set_xlabel("")
        if i % across:
            axes.set_ylabel("")


def _draw_marks(axes: Axes, rigs: list[Curves], what: str) -> None:
    """Draw frequency or gain of the peaks over pretension, a line for each rig."""
    for i, curves in enumerate(rigs):
        values = [
            np.nan
            if b.peak is None
            else float(b.peak.frequency_hz if what == "frequency_hz" else curves.gain(b.peak.amplitude))
            for b in curves.branches
        ]
        order = np.argsort(curves.pretension_mm)
        axes.plot(
            np.asarray(curves.pretension_mm)[order],
            np.asarray(values)[order],
            color=_COLOURS[i % len(_COLOURS)],
            marker=MARKERS[i % len(MARKERS)],
            markeredgecolor="white",
            markeredgewidth=0.5,
            label=curves.name,
        )
    axes.tick_params(colors=INK)
