"""Figures of a joint that bends: the bent silicone with its tendons, and how far it may be bent."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from sinew.figures.style import ACCENT, GREY, INK, RED, in_style, new_figure, note_panel
from sinew.plan.pose import bend_of_swing

if TYPE_CHECKING:
    from sinew.predict.poses.pose import Posed
    from sinew.predict.poses.workspace import Workspace


_APART_MM = 6.0
"""Distance in the picture below which two tendons share a label."""


@in_style
def draw_pose(posed: "Posed") -> Figure | None:
    """Return a side view of the bent silicone with its tendons, in the plane of its bend, and what each pulls; None
    where there is no pose."""
    if posed.rest is None or posed.shape is None:
        return None
    figure = new_figure(3.4)
    view, pulls = figure.subplots(1, 2, width_ratios=(1.3, 1.0))
    _draw_side(view, posed)
    _draw_pulls(pulls, posed)
    return figure


def _draw_side(axes: Axes, posed: "Posed") -> None:
    shape, rig = posed.shape, posed.rig
    assert shape is not None
    assert posed.rest is not None
    azimuth = bend_of_swing(*map(float, posed.rest.at.tilt))[1]
    aside = np.array([0.0, math.cos(azimuth), math.sin(azimuth)])

    def flat(points: Any) -> tuple[Any, Any]:
        return 1e3 * (points @ aside), 1e3 * points[..., 0]

    reach = rig.support(np.array([azimuth + math.pi, azimuth])) / math.sqrt(1 + float(posed.rest.q[3, 0]))
    across = shape.turns @ aside
    left, right = (flat(shape.line + side * radius * across) for side, radius in zip((-1, 1), reach, strict=True))
    axes.fill(np.r_[left[0], right[0][::-1]], np.r_[left[1], right[1][::-1]], color=GREY, alpha=0.25, linewidth=0)
    axes.plot(*flat(shape.line), color=GREY, linewidth=0.9, linestyle=(0, (6, 3)))
    for station in (0, -1):
        ends = shape.line[station] + np.outer(1.15 * reach * [-1, 1], shape.turns[station] @ aside)
        axes.plot(*flat(ends), color=INK, linewidth=2.5, solid_capstyle="butt")
    above: dict[tuple[float, float], list[str]] = {}  # tendons that lie behind one another share a label
    for i, chord in enumerate(shape.chords):
        slack = posed.rest.at.tension[i] <= 0
        x, y = flat(chord)
        axes.plot(x, y, color=RED if slack else ACCENT, linestyle=(0, (3, 2)) if slack else "-", linewidth=1.4)
        end = next((one for one in above if math.dist(one, (x[1], y[1])) < _APART_MM), (float(x[1]), float(y[1])))
        above.setdefault(end, []).append(str(i + 1))
    for end, names in above.items():
        axes.annotate(
            ", ".join(names), end, xytext=(0, 4), textcoords="offset points", ha="center", va="bottom", fontsize=8.0
        )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel=f"towards {math.degrees(azimuth):.0f}° in mm", ylabel="along x in mm")
    note_panel(axes, "a", "in the plane of the bend")


def _draw_pulls(axes: Axes, posed: "Posed") -> None:
    assert posed.rest is not None
    tension = posed.rest.at.tension
    names = [str(i + 1) for i in range(len(tension))]
    axes.bar(names, tension, color=[RED if pull <= 0 else ACCENT for pull in tension], width=0.6)
    for i, (pull, take_up) in enumerate(zip(tension, 1e3 * posed.rest.take_up, strict=True)):
        axes.annotate(
            f"{pull:.0f} N\n{take_up:.1f} mm", (i, pull), xytext=(0, 3), textcoords="offset points", ha="center"
        )
    axes.set(xlabel="tendon", ylabel="tension in N", ylim=(0, 1.3 * max(float(np.max(tension)), 1.0)))
    note_panel(axes, "b", "tension and take-up")


_COLOURS = ("#bfe3c6", "#f4e3a1", "#f2b28c", "#c9b5dc", "#e59aa0", "#9a9a9a", "#4d4d4d")
_COLUMNS = 3


@in_style
def draw_workspace(found: "Workspace") -> Figure:
    """Return the maps of a joint's poses over roll and pitch, one panel for each pretension, with lines of the highest
    tension in newtons."""
    from sinew.predict.poses.workspace import OUTSIDE, VERDICTS

    count = len(found.pretension_mm)
    columns = min(count, _COLUMNS)
    rows = math.ceil(count / columns)
    figure = new_figure(0.6 + 2.5 * rows)
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    colours, norm = ListedColormap(_COLOURS), BoundaryNorm(np.arange(len(_COLOURS) + 1) - 0.5, len(_COLOURS))
    for index, axes in enumerate(panels.flat):
        if index >= count:
            axes.set_axis_off()
            continue
        verdict = np.ma.masked_equal(found.verdict[index], OUTSIDE)
        axes.pcolormesh(found.roll_deg, found.pitch_deg, verdict, cmap=colours, norm=norm, shading="nearest")
        if np.isfinite(found.highest[index]).sum() > 3:
            lines = axes.contour(
                found.roll_deg, found.pitch_deg, found.highest[index], levels=6, colors=INK, linewidths=0.6
            )
            axes.clabel(lines, fmt="%.0f", fontsize=8.0)
        axes.set_aspect("equal")
        axes.grid(visible=False)
        if index % columns == 0:
            axes.set_ylabel("pitch in degrees")
        if index // columns == rows - 1:
            axes.set_xlabel("roll in degrees")
        note_panel(axes, "abcdefghijkl"[index % 12], f"{found.pretension_mm[index]:g} mm")
    seen = [code for code in range(len(VERDICTS)) if (found.verdict == code).any()]
    figure.legend(
        handles=[Patch(facecolor=_COLOURS[code], label=VERDICTS[code]) for code in seen],
        loc="outside upper center",
        ncols=len(seen),
    )
    return figure
