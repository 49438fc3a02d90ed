"""This is where a predicted response is drawn: amplitude and phase over frequency, through folds, with stability."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike

from sinew.figures.style import (
    GREY,
    INK,
    Floats,
    few,
    in_style,
    new_figure,
    note_panel,
    pretension_bar,
    pretension_colours,
)
from sinew.predict.branch import Branch

__all__ = ["Curves", "draw_gains", "draw_predicted", "stretches", "upper_gain"]

_STABLE: dict[str, Any] = {"linestyle": "-", "linewidth": 1.3}
_UNSTABLE: dict[str, Any] = {"linestyle": (0, (1.2, 1.4)), "linewidth": 1.1}


@dataclass(frozen=True)
class Curves:
    """The prediction of one rig: its name, a branch for each pretension [mm], and the command's amplitude [deg]."""

    name: str
    pretension_mm: tuple[float, ...]
    branches: tuple[Branch, ...]
    amplitude_deg: float

    def gain(self, amplitude: Floats | float) -> Floats:
        """Return half of peak to peak [rad] over the amplitude of the drive's command."""
        return np.asarray(amplitude) / math.radians(self.amplitude_deg)


@in_style
def draw_predicted(curves: Curves) -> Figure:
    """Return gain and lag over frequency, a line for each pretension.

    Solid lines are stable, dotted ones are not; rings mark the peaks, diamonds the folds.
    """
    figure = new_figure(3.5)
    left, right = figure.subplots(1, 2)
    draw_gains(left, curves)
    left.set_ylim(0, None)
    for branch, colour in zip(curves.branches, pretension_colours(curves.pretension_mm), strict=True):
        _draw_line(right, branch, np.degrees(branch.phase), colour)
        for fold in branch.folds:
            right.plot(fold.frequency_hz, math.degrees(fold.phase), **_diamond(colour))
    right.axhline(90.0, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
    right.set(xlabel="drive frequency in Hz", ylabel="lag of torsion behind lever in degrees")
    lowest = min((float(np.min(b.phase, initial=0.0)) for b in curves.branches), default=0.0)
    highest = max((float(np.max(b.phase, initial=np.pi)) for b in curves.branches), default=np.pi)
    right.set_yticks(range(45 * math.floor(math.degrees(lowest) / 45 + 0.1), math.ceil(math.degrees(highest)) + 1, 45))
    right.margins(x=0)
    note_panel(left, "a", "amplitude")
    note_panel(right, "b", "phase")
    _add_key(left, curves)
    pretension_bar(figure, (left, right), np.array(curves.pretension_mm))
    return figure


def draw_gains(axes: Axes, curves: Curves) -> None:
    """Draw the gain of every branch over frequency, with peaks and folds, and some pretensions beside the peaks."""
    labelled = set(few(len(curves.branches), 4).tolist()) if len(curves.branches) > 1 else set()
    colours = pretension_colours(curves.pretension_mm)
    for i, (branch, colour) in enumerate(zip(curves.branches, colours, strict=True)):
        _draw_line(axes, branch, curves.gain(branch.amplitude), colour)
        for fold in branch.folds:
            axes.plot(fold.frequency_hz, curves.gain(fold.amplitude), **_diamond(colour))
        if branch.peak is not None:
            at = (branch.peak.frequency_hz, float(curves.gain(branch.peak.amplitude)))
            axes.plot(*at, "o", markersize=3, color="white", markeredgecolor=INK, zorder=5)
            if i in labelled:
                text = f"{curves.pretension_mm[i]:g} mm"
                axes.annotate(text, at, (1, 5), textcoords="offset points", fontsize=8, color=INK, rotation=60)
    axes.axhline(1.0, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
    axes.set(xlabel="drive frequency in Hz", ylabel="gain: torsion amplitude / command")
    axes.margins(x=0, y=0.2)


def stretches(stable: ArrayLike) -> list[tuple[slice, bool]]:
    """Return (points, whether they are stable) of each stretch of a curve; a line between two stretches belongs to the
    unstable one."""
    flags = np.asarray(stable, dtype=bool)
    solid = flags[:-1] & flags[1:]
    if not solid.size:
        return []
    edges = np.flatnonzero(np.diff(solid)) + 1
    begins, ends = np.concatenate([[0], edges]), np.concatenate([edges, [solid.size]])
    return [(slice(int(a), int(b) + 1), bool(solid[a])) for a, b in zip(begins, ends, strict=True)]


def upper_gain(curves: Curves, frequency_hz: Floats) -> Floats:
    """Return the largest stable gain (p, f) at each frequency [Hz]; NaN where no stable motion was found.

    It is what a sweep that comes from the side of the larger amplitude finds.
    """
    out = np.full((len(curves.branches), frequency_hz.size), np.nan)
    for row, branch in zip(out, curves.branches, strict=True):
        gain = curves.gain(branch.amplitude)
        for part, is_stable in stretches(branch.stable):
            if is_stable:
                _raise_to(row, frequency_hz, branch.frequency_hz[part], gain[part])
    return out


def _raise_to(row: Floats, frequency_hz: Floats, at_hz: Floats, gain: Floats) -> None:
    """Raise a row to a stretch of a curve, which may run either way and turn at folds."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(at_hz)))) + 1
    for piece in np.split(np.arange(at_hz.size), turns):
        index = piece if piece[-1] == at_hz.size - 1 else np.append(piece, piece[-1] + 1)
        order = np.argsort(at_hz[index])
        found = np.interp(frequency_hz, at_hz[index][order], gain[index][order], left=np.nan, right=np.nan)
        row[:] = np.fmax(row, found)


def _draw_line(axes: Axes, branch: Branch, values: Floats, colour: Floats) -> None:
    for part, is_stable in stretches(branch.stable):
        look = _STABLE if is_stable else _UNSTABLE
        axes.plot(branch.frequency_hz[part], values[part], color=colour, **look)


def _diamond(colour: Floats) -> dict[str, Any]:
    return {"marker": "D", "markersize": 3.5, "color": colour, "markeredgecolor": "white", "zorder": 4}


def _add_key(axes: Axes, curves: Curves) -> None:
    """Tell the line styles apart, where there are two."""
    if all(branch.stable.all() for branch in curves.branches):
        return
    keys = [
        Line2D([], [], color=INK, label="stable", **_STABLE),
        Line2D([], [], color=INK, label="unstable", **_UNSTABLE),
        Line2D([], [], color=INK, linestyle="none", marker="D", markersize=3.5, label="fold"),
    ]
    axes.legend(handles=keys, loc="upper right")
