"""This is where Figure 7 is drawn: torsion over drive as Lissajous curves, beside the ideal shapes."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from sinew.figures.motion import Group, at_pretension, ellipse_of, groups_of, motion_of
from sinew.figures.style import (
    ACCENT,
    GREY,
    INK,
    few,
    frequency_colours,
    frequency_map,
    in_style,
    new_figure,
    note_panel,
)

__all__ = ["draw_lissajous"]

_SHAPES = {"a": 0, "b": 45, "c": 90, "d": 135, "e": 180}


@in_style
def draw_lissajous(recording: xr.Dataset, pretension_mm: float = 4.0, curves: int = 9) -> Figure | None:
    """Return Figure 7 of the paper, or None where drive and response were not both recorded in steady groups.

    Middle: measured curves of the first repeat at the pretension closest to `pretension_mm`, some frequencies of
    it, and the ellipse fitted where the lag is closest to 90 degrees. Left and right: the ideal shapes for lags from
    0 to 180 degrees, drive and torsion of equal amplitude.
    """
    groups = [g for g in groups_of(recording, "steady") if g.segment.repeat == 0]
    if not groups or not ({"drive_rad", "drive"} & set(map(str, recording.data_vars))):
        return None
    found = min((g.segment.pretension_mm for g in groups), key=lambda p: abs(p - pretension_mm))
    here = sorted((g for g in groups if g.segment.pretension_mm == found), key=lambda g: g.segment.frequency_hz)
    chosen = [here[i] for i in few(len(here), curves)]
    figure = new_figure(3.9)
    places = figure.subplot_mosaic("ame;bmd;cmk", width_ratios=(1, 3.4, 1))
    for place, degrees in _SHAPES.items():
        _draw_shape(places[place], degrees)
    middle = places["m"]
    label = ""
    frequencies = [g.segment.frequency_hz for g in chosen]
    for group, colour in zip(chosen, frequency_colours(frequencies), strict=True):
        motion = motion_of(recording, group)
        assert motion.drive is not None
        label = motion.label
        middle.plot(motion.drive, motion.torsion, color=colour, linewidth=1.0)
    _draw_ellipse(middle, recording, chosen)
    nominal = chosen[0].segment.amplitude_deg
    if "drive_rad" in recording and np.isfinite(nominal):
        for level in (-nominal, nominal):
            middle.axvline(level, color=GREY, linestyle=":", linewidth=1.0)
    angle = "drive_rad" in recording
    drive_label = "drive θ in degrees (dotted: nominal)" if angle else f"drive in {recording['drive'].attrs['units']}"
    middle.set(xlabel=drive_label, ylabel=label)
    note_panel(middle, "", "measured" + at_pretension(recording, found))
    _draw_key(figure, places["k"], frequencies)
    return figure


def _draw_ellipse(axes: Axes, recording: xr.Dataset, groups: list[Group]) -> None:
    """Draw the ellipse fitted to the curve whose lag is closest to a right angle, and say the lag."""
    ellipses = [ellipse_of(recording, group) for group in groups]
    i = min(range(len(groups)), key=lambda i: abs(ellipses[i].lag_rad - np.pi / 2))
    label = f"ellipse at {groups[i].segment.frequency_hz:.3g} Hz: lag {np.rad2deg(ellipses[i].lag_rad):.0f}°"
    axes.plot(*ellipses[i].curve(91), color=INK, linewidth=1.0, linestyle=(0, (4, 3)), zorder=4, label=label)
    axes.legend(loc="upper left", borderaxespad=0.1, handlelength=2.4)


def _draw_shape(axes: Axes, degrees: int) -> None:
    """Draw sin(t - lag) over sin(t), with the sense in which it is run through."""
    lag, t = np.deg2rad(degrees), np.linspace(0, 2 * np.pi, 91)
    axes.plot(np.sin(t), np.sin(t - lag), color=ACCENT, linewidth=1.4)
    if degrees % 180:
        tip, tail = np.array([0.30, 0.05]) + lag / 2 - np.pi / 4
        ends = [(np.sin(a), np.sin(a - lag)) for a in (tip, tail)]
        axes.annotate("", ends[0], ends[1], arrowprops={"arrowstyle": "-|>", "color": ACCENT, "lw": 1.2})
    axes.set(xlim=(-1.25, 1.25), ylim=(-1.25, 1.25), aspect="equal", xticks=[], yticks=[])
    axes.axhline(0, color=GREY, linewidth=0.5)
    axes.axvline(0, color=GREY, linewidth=0.5)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    axes.set_title(f"{degrees}°", loc="center")


def _draw_key(figure: Figure, axes: Axes, frequencies: list[float]) -> None:
    axes.axis("off")
    mappable = ScalarMappable(Normalize(min(frequencies), max(frequencies)), frequency_map())
    inner = axes.inset_axes((0.1, 0.0, 0.16, 1.0))
    bar = figure.colorbar(mappable, cax=inner, label="drive frequency in Hz")
    for frequency in frequencies:
        bar.ax.axhline(frequency, color="white", linewidth=0.7)
    bar.outline.set_visible(False)
