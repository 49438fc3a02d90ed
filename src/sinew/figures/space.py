"""Figures and page of a joint in space: modes and their coupling, bent poses and responses."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from sinew.figures.page import Caption, pictures, result_tables, write_page
from sinew.figures.predicted import UNSTABLE, draw_line, stretches
from sinew.figures.style import (
    ACCENT,
    GREY,
    INK,
    MARKERS,
    RED,
    frequency_map,
    in_style,
    new_figure,
    note_panel,
    pretension_bar,
    pretension_colours,
    save_figure,
    save_figures,
)
from sinew.measure.arrays import Array
from sinew.plan.plan import bend_of_swing
from sinew.predict.coupled import Coupled, PredictedBent
from sinew.predict.modes import Modes

if TYPE_CHECKING:
    from sinew.predict.pose import Posed
    from sinew.predict.workspace import Workspace


_TOP_HZ = 13.0

CAPTIONS = {
    "modes_over_pretension": Caption(
        "Torsion and sway over pretension",
        "Frequencies of the modes over pretension, a panel for each bend; colour is the share of a mode's energy that "
        "is torsion. The dotted line is twice the torsion's frequency: where a sway meets it, the torsion's square "
        "excites it. Bars are 90 % intervals of what is assumed, of taut poses: else they fill the panel. "
        "Jumps are where a tendon goes slack.",
        "Lines of modal frequencies over pretension in a panel for each bend",
    ),
    "coupling_over_bend": Caption(
        "What else moves when the head twists",
        "Left: tilt of the head across the plane of the bend in the torsional mode, over its torsion; the dashed line "
        "is ½ sin β, that of a rod that is twisted slowly. Right: frequency of that mode over that of the straight "
        "joint. Open marks: a tendon is slack; the interval there, far wider than all values, is not drawn.",
        "Tilt across per torsion, and relative frequency of torsion, over the bend angle",
    ),
}


@in_style
def draw_over_pretension(found: Modes) -> Figure:
    """Return the frequencies of the modes over pretension, a panel for each bend."""
    bends = list(found.scanned)
    figure = new_figure(3.4 if len(bends) <= 4 else 6.0)
    rows = 1 if len(bends) <= 4 else 2
    panels = np.atleast_1d(figure.subplots(rows, math.ceil(len(bends) / rows), sharey=True)).ravel()
    colours, scale = frequency_map(), Normalize(0, 1)
    for k, (axes, bend_deg) in enumerate(zip(panels, bends, strict=False)):
        track = found.scanned[bend_deg]
        at = [one.pretension_mm for one in track]
        count = max(len(one.modes) for one in track)
        for i in range(count):
            hz = [one.modes[i].frequency_hz if i < len(one.modes) else math.nan for one in track]
            share = [float(one.modes[i].shares[0]) if i < len(one.modes) else 0.0 for one in track]
            axes.plot(at, hz, color=GREY, linewidth=0.8, zorder=2)
            axes.scatter(at, hz, c=share, cmap=colours, norm=scale, s=12, zorder=3)
        double = [2 * one.torsion_hz() for one in track]
        axes.plot(at, double, color=RED, linewidth=0.9, linestyle=(0, (1, 2)))
        known = [(x, y) for x, y in zip(at, double, strict=True) if math.isfinite(y)]
        if k == 0 and known:
            middle = known[len(known) // 2]
            axes.annotate("2 · torsion", middle, (4, -3), textcoords="offset points", va="top", color=RED, fontsize=8.0)
        for pose in found.poses:
            for mode in pose.modes if pose.bend_deg == bend_deg and pose.taut else ():
                one = mode.frequency_hz
                if math.isfinite(one.low):
                    axes.plot([pose.pretension_mm] * 2, [one.low, one.high], **_INTERVAL)
        axes.set(xlabel="pretension in mm", ylim=(0, _TOP_HZ))
        note_panel(axes, "abcdefgh"[k], f"bent by {bend_deg:g}°" if bend_deg else "straight")
    for axes in panels[len(bends) :]:
        axes.set_visible(False)
    panels[0].set_ylabel("frequency in Hz")
    bar = figure.colorbar(ScalarMappable(scale, colours), ax=list(panels), label="torsion's share of the energy")
    bar.outline.set_visible(False)
    return figure


_INTERVAL: dict[str, Any] = {"color": ACCENT, "linewidth": 2.4, "alpha": 0.35, "zorder": 1}


@in_style
def draw_coupling(found: Modes) -> Figure:
    """Return the tilt across per torsion in the torsional mode, and its frequency, over the bend."""
    figure = new_figure(2.9)
    left, right = figure.subplots(1, 2)
    pretensions = sorted({one.pretension_mm for one in found.poses})
    straight = {p: found.finder.at(p, 0.0).torsion_hz() for p in pretensions}
    for k, (p, colour) in enumerate(zip(pretensions, pretension_colours(pretensions), strict=True)):
        rows = [
            (pose.bend_deg, mode.tilt_across_per_torsion, mode.frequency_hz.value, pose.taut)
            for pose in sorted(found.poses, key=lambda one: one.bend_deg)
            for mode in [one for one in pose.modes if one.kind.startswith("torsion")][:1]
            if pose.pretension_mm == p
        ]
        if not rows:
            continue
        bend_deg = np.array([row[0] for row in rows])
        tilt = np.array([(row[1].value, row[1].low, row[1].high) for row in rows])
        hz = np.array([row[2] for row in rows]) / straight[p]
        tone, marker = tuple(colour), MARKERS[k % len(MARKERS)]
        left.plot(bend_deg, tilt[:, 0], color=tone, linewidth=1.0)
        right.plot(bend_deg, hz, color=tone, linewidth=1.0)
        taut = np.array([row[3] for row in rows])
        if np.isfinite(tilt[taut, 1]).any():
            left.fill_between(bend_deg, tilt[:, 1], tilt[:, 2], where=taut, color=tone, alpha=0.15, linewidth=0)
        for axes, values in ((left, tilt[:, 0]), (right, hz)):
            for x, y, row in zip(bend_deg, values, rows, strict=True):
                axes.plot(x, y, marker, color=tone, mfc=tone if row[3] else "white", markersize=4.5, zorder=4)
    most = max((one.bend_deg for one in found.poses), default=0.0)
    angles = np.linspace(0, max(most, 1.0), 60)
    left.plot(angles, 0.5 * np.sin(np.radians(angles)), color=INK, linewidth=0.9, linestyle=(0, (4, 3)))
    left.annotate(
        "½ sin β",
        (angles[-1], 0.5 * math.sin(math.radians(angles[-1]))),
        (-4, 4),
        textcoords="offset points",
        ha="right",
    )
    left.set(xlabel="bend in degrees", ylabel="tilt across / torsion")
    right.set(xlabel="bend in degrees", ylabel="frequency / that of the straight joint")
    note_panel(left, "a", "what the head does besides")
    note_panel(right, "b", "frequency of the torsion")
    pretension_bar(figure, (left, right), np.array(pretensions))
    return figure


def write_modes(found: Modes, path: Path) -> Path:
    """Write the figures of modes beside one another, or a page with them and all numbers, and return the path.

    path: ends with .html for the page; else the modes over pretension have that name, and their coupling has it with
    `-coupling` behind it. Raises FileError where the folder cannot be written.
    """
    figures = {"": draw_over_pretension(found), "-coupling": draw_coupling(found)}
    if path.suffix != ".html":
        save_figures(((path.stem + end, figure) for end, figure in figures.items()), path.parent, (path.suffix[1:],))
        return path
    named = zip(CAPTIONS, figures.values(), strict=True)
    files = save_figures(named, path.parent / f"{path.stem}-figures", ("png",))
    notes = [one.removeprefix("- ") for one in found.blocks() if isinstance(one, str)]
    return write_page(
        path,
        "prediction.html",
        title=f"Modes of “{found.rig}”",
        about=f"Small motion about rest, tendon motors in mode {found.mode}, the lever locked to the head.",
        lead=". ".join(f"{note[:1].upper()}{note[1:]}" for note in notes),
        tables=result_tables(found),
        pictures=pictures(files, CAPTIONS),
        validity=[],
        rebuild="",
        origins=[],
    )


# ---- figure of a bent joint's response: torsion, tilt and tensions over frequency, a colour for each pretension


@in_style
def draw_bent(found: PredictedBent) -> Figure:
    """Return the response of a bent joint: torsion, tilt across, tilt in the plane at 2f, tensions of the tendons."""
    figure = new_figure(5.0)
    panels = figure.subplots(2, 2, sharex=True)
    torsion, across, twice, pulls = panels.ravel()
    pretensions = [one.pretension_mm or 0.0 for one in found.curves]
    for one, colour in zip(found.curves, pretension_colours(pretensions), strict=True):
        _curve((torsion, across, twice, pulls), one, colour)
    torsion.set(ylabel="torsion in degrees")
    across.set(ylabel="tilt across in degrees")
    twice.set(xlabel="frequency in Hz", ylabel="tilt in the plane in degrees")
    pulls.set(xlabel="frequency in Hz", ylabel="tension of a tendon in N")
    for axes in (torsion, across, twice, pulls):
        axes.set_ylim(bottom=0)
        axes.set_xlim(*found.band_hz)
    note_panel(torsion, "a", "torsion of the head, f")
    note_panel(across, "b", "tilt across the bend, f")
    note_panel(twice, "c", "tilt in the plane of the bend, 2f")
    note_panel(pulls, "d", "lowest and highest tension of any tendon")
    keys = [Line2D([], [], color=GREY, label="largest torsion", marker="o", linestyle="", mfc="white")]
    if any(not one.branch.stable.all() for one in found.curves):
        keys.append(Line2D([], [], color=INK, label="not stable", **UNSTABLE))
    figure.legend(handles=keys, loc="outside lower center", ncols=2)
    figure.suptitle(f"{found.pose.words()}, lever commanded {found.amplitude_deg:g}°", fontsize=8.5, x=0.01, ha="left")
    if len(pretensions) > 1:
        pretension_bar(figure, list(panels.ravel()), np.array(pretensions))
    return figure


def _curve(panels: tuple[Axes, Axes, Axes, Axes], one: Coupled, colour: Array) -> None:
    *angles, pulls = panels
    for axes, name in zip(angles, ("torsion_deg", "tilt_across_deg", "tilt_in_plane_twice_deg"), strict=True):
        draw_line(axes, one.branch, getattr(one, name), colour)
        if one.peak is not None:
            axes.plot(one.peak.frequency_hz, getattr(one.peak, name), "o", color=colour, mfc="white", markersize=4.5)
    low, high = one.lowest_tension_n.min(axis=1), one.highest_tension_n.max(axis=1)
    for row in (low, high):
        draw_line(pulls, one.branch, row, colour)
    if not one.branch.folds:  # over a curve that folds back a band would cover itself
        for part, _ in stretches(one.stable, one.branch.holes):
            pulls.fill_between(one.frequency_hz[part], low[part], high[part], color=colour, alpha=0.12, linewidth=0)


def write_bent(found: PredictedBent, path: Path) -> Path:
    """Write the figure of a bent joint's response and return the path. Raises FileError where the folder cannot be
    written."""
    save_figure(draw_bent(found), path.parent, path.stem, (path.suffix[1:],))
    return path


# ---- figures of a joint that bends: the bent silicone with its tendons, and how far it may be bent


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
    shape, rig = posed.shape, posed.spec
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


_VERDICT_COLOURS = ("#bfe3c6", "#f4e3a1", "#f2b28c", "#c9b5dc", "#e59aa0", "#9a9a9a", "#4d4d4d")
_COLUMNS = 3


@in_style
def draw_workspace(found: "Workspace") -> Figure:
    """Return the maps of a joint's poses over roll and pitch, one panel for each pretension, with lines of the highest
    tension in newtons."""
    count = len(found.maps)
    columns = min(count, _COLUMNS)
    rows = math.ceil(count / columns)
    figure = new_figure(0.6 + 2.5 * rows)
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    colours, norm = (
        ListedColormap(_VERDICT_COLOURS),
        BoundaryNorm(np.arange(len(_VERDICT_COLOURS) + 1) - 0.5, len(_VERDICT_COLOURS)),
    )
    for index, axes in enumerate(panels.flat):
        if index >= count:
            axes.set_axis_off()
            continue
        one = found.maps[index]
        verdict = np.array(one.verdict, dtype=float)  # NaN where it was not asked for
        axes.pcolormesh(found.roll_deg, found.pitch_deg, verdict, cmap=colours, norm=norm, shading="nearest")
        if np.isfinite(one.highest_n).sum() > 3:
            lines = axes.contour(found.roll_deg, found.pitch_deg, one.highest_n, levels=6, colors=INK, linewidths=0.6)
            axes.clabel(lines, fmt="%.0f", fontsize=8.0)
        axes.set_aspect("equal")
        axes.grid(visible=False)
        if index % columns == 0:
            axes.set_ylabel("pitch in degrees")
        if index // columns == rows - 1:
            axes.set_xlabel("roll in degrees")
        note_panel(axes, "abcdefghijkl"[index % 12], f"{one.pretension_mm:g} mm")
    seen = [
        code
        for code, name in enumerate(found.verdicts)
        if any(vars(one.shares)[name.replace(" ", "_")] for one in found.maps)
    ]
    figure.legend(
        handles=[Patch(facecolor=_VERDICT_COLOURS[code], label=found.verdicts[code]) for code in seen],
        loc="outside upper center",
        ncols=len(seen),
    )
    return figure
