"""Figure 7: torsion over drive as Lissajous curves, beside the ideal shapes."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from sinew.analysis.sweep.portrait import phase_portrait
from sinew.figures.motion import Group, Motion, at_pretension, ellipse_of, groups_of, motion_of, nearest, rig_of
from sinew.figures.style import (
    ACCENT,
    GREY,
    INK,
    WIDTH_IN,
    few,
    frequency_colours,
    frequency_map,
    in_style,
    new_figure,
    note_panel,
    pretension_colours,
)

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


# Motion is drawn over itself: torsion rate over torsion at resonance, for several pretensions.


@in_style
def draw_phase_portraits(recording: xr.Dataset, results: xr.Dataset, at_most: int = 4) -> Figure | None:
    """Return phase portraits at the resonance of some pretensions, or None where the results hold no resonance.

    The dashed ellipse is a harmonic oscillation of the same frequency and amplitude; what departs from it is
    anharmonic (paper, section 5.2.3). Even harmonics bend the portrait to one side, the third squeezes it evenly.
    """
    groups = groups_of(recording, "steady")
    if "resonance_hz" not in results or not groups:
        return None
    known = np.flatnonzero(np.isfinite(results["resonance_hz"].values))
    if known.size == 0:
        return None
    chosen = known[few(known.size, at_most)]
    pretension = results["pretension_mm"].values
    colours = pretension_colours(pretension)
    figure = new_figure(2.6, min(WIDTH_IN, 0.7 + 1.6 * chosen.size))
    label = ""
    row = figure.subplots(1, chosen.size, sharex=True, sharey=True, squeeze=False)[0]
    for i, (axes, p) in enumerate(zip(row, chosen, strict=True)):
        group = nearest(groups, pretension[p], float(results["resonance_hz"].values[p]))
        assert group is not None
        motion = motion_of(recording, group)
        label = motion.label
        _draw_portrait(axes, motion, group.segment.frequency_hz, tuple(colours[p]))
        title = f"{pretension[p]:g} mm, {group.segment.frequency_hz:.3g} Hz"
        note_panel(axes, "abcdefgh"[i], f"{title}\n{_shares(recording, group)}")
    figure.supxlabel(label, fontsize=8.5)
    row[0].set_ylabel("rate dφ/dt in degrees/s" if "degrees" in label else "rate per second")
    return figure


def _shares(recording: xr.Dataset, group: Group) -> str:
    """Return what departs from the ellipse, to one side and to both, as a share of the fundamental."""
    alone = recording.isel(sample=group.record, segment=[group.index])
    portrait = phase_portrait(alone, 0, rig_of(recording))
    even, third = 100 * portrait.even_share.value, 100 * portrait.third_share.value
    return f"even {even:.1f} %, 3rd {third:.1f} %"


def _draw_portrait(axes: Axes, motion: Motion, frequency_hz: float, colour: tuple[float, ...]) -> None:
    """Draw one portrait and the harmonic ellipse of the same fundamental."""
    omega = 2 * np.pi * frequency_hz
    basis = np.column_stack([np.sin(omega * motion.time_s), np.cos(omega * motion.time_s), np.ones(motion.time_s.size)])
    weights = np.linalg.lstsq(basis, motion.torsion, rcond=None)[0]
    amplitude = float(np.hypot(weights[0], weights[1]))
    t = np.linspace(0, 2 * np.pi, 121)
    axes.plot(motion.torsion - weights[2], motion.rate, color=colour, linewidth=1.8)
    axes.plot(amplitude * np.sin(t), omega * amplitude * np.cos(t), color=INK, linestyle=(0, (4, 3)), linewidth=0.8)
    axes.margins(0.08)
