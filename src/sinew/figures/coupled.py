"""Figures of a bent joint's response: torsion, tilt and tensions over frequency, a colour for each pretension; over
some pretensions also a waterfall of torsion and sway."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from sinew.figures.style import (
    GREY,
    INK,
    in_style,
    new_figure,
    note_panel,
    pretension_bar,
    pretension_colours,
    save_figure,
)
from sinew.measure.arrays import Array, Complexes
from sinew.predict.coupled import Coupled, Motions, PredictedBent
from sinew.solve.branch import Branch

_DASHES = (0, (2, 1.5))


def _parted(row: Array, branch: Branch) -> Array:
    """Return numbers along a curve with a NaN where points were left out."""
    return np.insert(row, branch.holes, np.nan)


def _line(axes: Axes, y: Array, branch: Branch, colour: Sequence[float]) -> None:
    """Draw a curve, dashed where the motion is not stable."""
    for keep, style in ((branch.stable, "-"), (~branch.stable, _DASHES)):
        if keep.any():
            wide = keep | np.roll(keep, 1) & (np.arange(keep.size) > 0)  # so that the parts meet
            shown = _parted(np.where(wide, y, np.nan), branch)
            axes.plot(_parted(branch.frequency_hz, branch), shown, color=colour, linestyle=style, linewidth=1.2)


def _band(axes: Axes, low: Array, high: Array, branch: Branch, colour: Sequence[float], alpha: float) -> None:
    """Fill what lies between two rows along a curve; over one that folds back it would cover itself."""
    if branch.folds == ():
        x, below, above = (_parted(row, branch) for row in (branch.frequency_hz, low, high))
        axes.fill_between(x, below, above, color=colour, alpha=alpha, linewidth=0)


@in_style
def draw_bent(found: PredictedBent) -> Figure:
    """Return the response of a bent joint: torsion, tilt across, tilt in the plane at 2f, tensions of the tendons."""
    figure = new_figure(5.0)
    panels = figure.subplots(2, 2, sharex=True)
    torsion, across, twice, pulls = panels.ravel()
    pretensions = [one.pretension_mm for one in found.curves]
    for one, colour in zip(found.curves, pretension_colours(pretensions), strict=True):
        _curve((torsion, across, twice, pulls), one, tuple(colour))
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
        keys.append(Line2D([], [], color=INK, linestyle=_DASHES, label="not stable"))
    figure.legend(handles=keys, loc="outside lower center", ncols=2)
    figure.suptitle(f"{found.pose.words()}, lever commanded {found.amplitude_deg:g}°", fontsize=8.5, x=0.01, ha="left")
    if len(pretensions) > 1:
        pretension_bar(figure, list(panels.ravel()), np.array(pretensions))
    return figure


def _curve(panels: tuple[Axes, Axes, Axes, Axes], one: Coupled, colour: Sequence[float]) -> None:
    torsion, across, twice, pulls = panels
    seen, peak = one.seen, one.peak
    tops = (None,) * 3 if peak is None else (peak.torsion, peak.across, peak.twice)
    rows = (np.abs(seen.torsion[:, 1]), np.abs(seen.across[:, 1]), np.abs(seen.in_plane[:, 2]))
    for axes, row, top in zip((torsion, across, twice), rows, tops, strict=True):
        _line(axes, np.degrees(row), one.branch, colour)
        if peak is not None and top is not None:
            axes.plot(peak.frequency_hz, np.degrees(top), "o", color=colour, mfc="white", markersize=4.5)
    low, high = seen.tension[:, :, 0].min(axis=1), seen.tension[:, :, 1].max(axis=1)
    for row in (low, high):
        _line(pulls, row, one.branch, colour)
    _band(pulls, low, high, one.branch, colour, 0.12)


_ROOM = 1.4  # of the highest crest, in steps of pretension

_RISING: dict[str, Callable[[Motions], Complexes]] = {
    "torsion of the head, f": lambda seen: seen.torsion[:, 1],
    "tilt in the plane of the bend, 2f": lambda seen: seen.in_plane[:, 2],
}


@in_style
def draw_waterfall(found: PredictedBent) -> Figure:
    """Return torsion at f and tilt in the plane at 2f over frequency, each curve on the line of its pretension."""
    figure = new_figure(4.6)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    pretensions = np.array([one.pretension_mm for one in found.curves])
    step = float(np.ptp(pretensions)) / max(pretensions.size - 1, 1) or 1.0
    curves = sorted(
        zip(found.curves, pretension_colours(pretensions), strict=True), key=lambda one: -one[0].pretension_mm
    )
    for axes, letter, (title, of) in zip(panels, "ab", _RISING.items(), strict=True):
        rows = [np.degrees(np.abs(of(one.seen))) for one, _ in curves]
        scale = _ROOM * step / (max(float(row.max(initial=0.0)) for row in rows) or 1.0)
        for (one, colour), row in zip(curves, rows, strict=True):  # the lower lines in front
            _rise(axes, one, scale * row, row, tuple(colour))
        axes.set(xlabel="frequency in Hz", xlim=found.band_hz, yticks=pretensions)
        axes.set_ylim(pretensions.min() - 0.1 * step, pretensions.max() + (_ROOM + 0.25) * step)
        axes.grid(visible=False, axis="y")
        note_panel(axes, letter, title)
    panels[0].set_ylabel("pretension in mm")
    if any(not one.branch.stable.all() for one in found.curves):
        figure.legend(
            handles=[Line2D([], [], color=INK, linestyle=_DASHES, label="not stable")], loc="outside lower center"
        )
    told = f"{found.pose.words()}, lever commanded {found.amplitude_deg:g}°; numbers: highest of each curve"
    figure.suptitle(told, fontsize=8.5, x=0.01, ha="left")
    return figure


def _rise(axes: Axes, one: Coupled, raised: Array, row_deg: Array, colour: Sequence[float]) -> None:
    """Draw a curve on the line of its pretension, by as much above it as `raised` says, its crest named in degrees."""
    hz, base = one.branch.frequency_hz, one.pretension_mm
    axes.axhline(base, color=GREY, linewidth=0.5)
    if hz.size == 0:
        return
    _band(axes, np.full(hz.size, base), base + raised, one.branch, colour, 0.18)
    _line(axes, base + raised, one.branch, colour)
    top = int(np.argmax(row_deg))
    place = (hz[top], base + raised[top])
    axes.annotate(
        f"{row_deg[top]:.2g}°",
        place,
        (0, 3),
        textcoords="offset points",
        ha="center",
        fontsize=7.5,
        annotation_clip=False,
    )


_FEWEST = 3  # pretensions of a waterfall


def write_bent(found: PredictedBent, path: Path) -> list[Path]:
    """Write the figure of a bent joint's response, beside it the waterfall where there are three pretensions or more,
    with `-waterfall` behind the name, and return the paths. Raises FileError where the folder cannot be written."""
    figures = {"": draw_bent(found)}
    if len(found.curves) >= _FEWEST:
        figures["-waterfall"] = draw_waterfall(found)
    return [
        file
        for ending, figure in figures.items()
        for file in save_figure(figure, path.parent, f"{path.stem}{ending}", (path.suffix[1:],))
    ]
