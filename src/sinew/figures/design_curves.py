"""This is where proposals are drawn at both ends of their band: predicted torsion, with the twin beside it."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.figures.predicted_comparison import label_outer, shortened
from sinew.figures.style import ACCENT, GREY, INK, RED, in_style, new_figure, note_panel
from sinew.predict.branch import Branch

__all__ = ["EndCurves", "draw_design_curves"]

_ACROSS = 2


class EndCurves(NamedTuple):
    """One proposal: its document, and its predicted curves at both ends of the band, at its plan's command."""

    document: Mapping[str, Any]
    branches: tuple[Branch, ...]


@in_style
def draw_design_curves(proposals: Sequence[EndCurves], yaw_deg: float) -> Figure:
    """Return torsion over frequency, a panel for each proposal: lines predicted, rings where the twin lags by 90°."""
    rows = -(-len(proposals) // _ACROSS)
    figure = new_figure(0.5 + 2.2 * rows)
    panels = figure.subplots(rows, _ACROSS, sharex=True, sharey=True, squeeze=False).ravel()
    for i, (axes, one) in enumerate(zip(panels, proposals, strict=False)):
        _draw(axes, one, yaw_deg)
        axes.set(xlabel="drive frequency in Hz", ylabel="torsion in degrees")
        note_panel(axes, chr(ord("a") + i), f"{i + 1}: {shortened(str(one.document['name']), _ACROSS)[:44]}")
    panels[0].set_ylim(0, None)
    panels[0].margins(x=0)
    label_outer(list(panels), len(proposals), _ACROSS)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _draw(axes: Axes, one: EndCurves, yaw_deg: float) -> None:
    ends = one.document["ends"]
    for branch, end, colour, name in zip(one.branches, ends, (ACCENT, RED), ("lower", "upper"), strict=True):
        axes.plot(branch.frequency_hz, np.degrees(branch.amplitude), color=colour, label=f"{name} end, predicted")
        axes.axvline(end["wanted_hz"], color=colour, linewidth=0.8, linestyle=(0, (2, 2)), zorder=1)
        top = float(np.degrees(branch.amplitude).max())
        axes.annotate(
            f"{end['pretension_mm']:.1f} mm", (end["wanted_hz"], top), (8, 5), textcoords="offset points", fontsize=8
        )
    for i, found in enumerate(one.document["confirmed"]):
        measured = found["measured_hz"]["value"]
        if measured is None:
            continue
        label = "90° of lag on the twin" if i == 0 else None
        axes.plot(measured, found["yaw_deg"], "o", color="white", markeredgecolor=INK, zorder=5, label=label)
    label = f"±{yaw_deg:g}° wanted"
    axes.axhline(yaw_deg, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1, label=label)
