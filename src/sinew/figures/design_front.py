"""This is where designed joints are drawn in what is traded: the drive's energy against size and tension."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from sinew.figures.style import ACCENT, GREEN, GREY, INK, MARKERS, RED, in_style, new_figure, note_panel

__all__ = ["draw_design_front"]

_COLOURS = (ACCENT, RED, GREEN, "#7a4fa3", "#b8690b")


@in_style
def draw_design_front(evaluated: Sequence[Mapping[str, Any]], proposals: Sequence[Mapping[str, Any]]) -> Figure:
    """Return energy over size and over tension of every exactly computed joint.

    evaluated, proposals: as in the document of `sinew design`. Full marks are not dominated, empty ones are, grey ones
    break a limit; numbers are those of the proposals.
    """
    figure = new_figure(3.4)
    left, right = figure.subplots(1, 2, sharey=True)
    shapes = list(dict.fromkeys(str(one["shape"]) for one in evaluated))
    for axes, key in ((left, "volume_cm3"), (right, "tension_n")):
        for one in evaluated:
            _draw(axes, one, key, shapes.index(one["shape"]))
        for number, one in enumerate(proposals, start=1):
            at = (one[key], 1e3 * one["energy_j"])
            axes.annotate(str(number), at, (5, 4), textcoords="offset points", fontsize=9, fontweight="bold", color=INK)
        axes.margins(0.08, 0.12)
    left.set(xlabel="volume of joint and guides in cm³", ylabel="drive energy in mJ a cycle", xscale="log")
    right.set(xlabel="tension of a tendon in N")
    if evaluated:
        left.set_xticks(_ticks([float(one["volume_cm3"]) for one in evaluated]))
        left.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
        left.minorticks_off()
    left.set_ylim(0, None)
    note_panel(left, "a", "against size")
    note_panel(right, "b", "against tension")
    keys = [_key(i, name) for i, name in enumerate(shapes)]
    keys.append(Line2D([], [], linestyle="none", marker="o", color="white", markeredgecolor=INK, label="dominated"))
    if any(not one["feasible"] for one in evaluated):
        keys.append(Line2D([], [], linestyle="none", marker="o", color=GREY, label="breaks a limit"))
    figure.legend(handles=keys, loc="outside lower center", ncols=len(keys))
    return figure


def _draw(axes: Axes, one: Mapping[str, Any], key: str, shape: int) -> None:
    colour = _COLOURS[shape % len(_COLOURS)] if one["feasible"] else GREY
    full = one["on_front"] or not one["feasible"]
    axes.plot(
        one[key],
        1e3 * one["energy_j"],
        linestyle="none",
        marker=MARKERS[shape % len(MARKERS)],
        color=colour if full else "white",
        markeredgecolor="white" if full else colour,
        markersize=6 if full else 4.5,
        zorder=4 if full else 3,
    )


def _key(shape: int, name: str) -> Line2D:
    marker = MARKERS[shape % len(MARKERS)]
    return Line2D([], [], linestyle="none", marker=marker, color=_COLOURS[shape % len(_COLOURS)], label=name)


def _ticks(values: list[float]) -> list[float]:
    """Return one, two and five times powers of ten around values."""
    decades = 10.0 ** np.arange(np.floor(np.log10(min(values))), np.ceil(np.log10(max(values))) + 1)
    every = np.outer(decades, (1, 2, 5)).ravel()
    kept = every[(every >= 0.7 * min(values)) & (every <= 1.4 * max(values))]
    return [float(x) for x in kept]
