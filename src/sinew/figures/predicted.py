"""Figures and page of a prediction: curves, bands, maps, and a recording that it did not know beside them."""

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike

from sinew.figures.page import Caption, pictures, result_tables, write_page
from sinew.figures.response import along_ridge, draw_map, map_bar
from sinew.figures.style import (
    ACCENT,
    GREEN,
    GREY,
    INK,
    MARKERS,
    RED,
    few,
    in_style,
    new_figure,
    note_panel,
    pretension_bar,
    pretension_colours,
    save_figure,
)
from sinew.identify.forced import Forced
from sinew.measure.arrays import Array
from sinew.measure.files.netcdf import provenance
from sinew.measure.result import Result
from sinew.predict.against import Against, Met, PointRow
from sinew.predict.band import Band, Tube
from sinew.predict.predicted import Compared, Predicted
from sinew.solve.branch import Branch, Mark

_STABLE: dict[str, Any] = {"linestyle": "-", "linewidth": 1.3}
UNSTABLE: dict[str, Any] = {"linestyle": (0, (1.2, 1.4)), "linewidth": 1.1}


@dataclass(frozen=True)
class Curves:
    """The prediction of one rig: its name, a branch for each pretension [mm], and the command's amplitude [deg]."""

    name: str
    pretension_mm: tuple[float, ...]
    branches: tuple[Branch, ...]
    amplitude_deg: float

    def gain(self, amplitude: Array | float) -> Array:
        """Return half of peak to peak [rad] over the amplitude of the drive's command."""
        return np.asarray(amplitude) / math.radians(self.amplitude_deg)

    def ridge(self) -> Array:
        """Return resonance [Hz], pretension [mm] and gain there of each branch, NaN without a peak, (3, p)."""
        none = Mark(math.nan, math.nan, math.nan)
        hertz, amplitude, _ = np.array([astuple(b.peak or none) for b in self.branches]).T
        return np.stack([hertz, np.array(self.pretension_mm), self.gain(amplitude)])


def curves_of(found: Predicted) -> Curves:
    """Return the curves of a rig's prediction."""
    request = found.request
    return Curves(found.rig, tuple(request.pretensions), found.prediction.branches, request.amplitude_deg)


def in_order(curves: Curves) -> Curves:
    """Return curves in the order of their pretensions."""
    order = np.argsort(curves.pretension_mm)
    branches = tuple(curves.branches[i] for i in order)
    return replace(curves, pretension_mm=tuple(sorted(curves.pretension_mm)), branches=branches)


@in_style
def draw_predicted(curves: Curves) -> Figure:
    """Return gain and lag over frequency, a line for each pretension.

    Solid lines are stable, dotted ones are not; rings mark the peaks, diamonds the folds.
    """
    figure = new_figure(3.5)
    left, right = figure.subplots(1, 2)
    draw_gains(left, curves)
    left.set_ylim(0, None)
    draw_phases(right, curves)
    note_panel(left, "a", "amplitude")
    note_panel(right, "b", "phase")
    _add_key(left, curves)
    pretension_bar(figure, (left, right), np.array(curves.pretension_mm))
    return figure


def draw_phases(axes: Axes, curves: Curves) -> Axes:
    """Draw the lag of every branch behind the lever over frequency, with its folds."""
    for branch, colour in zip(curves.branches, pretension_colours(curves.pretension_mm), strict=True):
        draw_line(axes, branch, np.degrees(branch.phase), colour)
        for fold in branch.folds:
            axes.plot(fold.frequency_hz, math.degrees(fold.phase), **_diamond(colour))
    axes.axhline(90.0, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
    axes.set(xlabel="drive frequency in Hz", ylabel="lag of torsion behind lever in degrees")
    lowest = min((float(np.min(b.phase, initial=0.0)) for b in curves.branches), default=0.0)
    highest = max((float(np.max(b.phase, initial=np.pi)) for b in curves.branches), default=np.pi)
    axes.set_yticks(range(45 * math.floor(math.degrees(lowest) / 45 + 0.1), math.ceil(math.degrees(highest)) + 1, 45))
    axes.margins(x=0)
    return axes


def draw_gains(axes: Axes, curves: Curves) -> Axes:
    """Draw the gain of every branch over frequency, with peaks and folds, and some pretensions beside the peaks."""
    labelled = set(few(len(curves.branches), 4).tolist()) if len(curves.branches) > 1 else set()
    colours = pretension_colours(curves.pretension_mm)
    for i, (branch, colour) in enumerate(zip(curves.branches, colours, strict=True)):
        draw_line(axes, branch, curves.gain(branch.amplitude), colour)
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
    axes.set_ylim(bottom=0)
    return axes


def stretches(stable: ArrayLike, holes: ArrayLike = ()) -> list[tuple[slice, bool]]:
    """Return (points, whether they are stable) of each stretch of a curve; a line between two stretches belongs to the
    unstable one, and none leads to a point of `holes` (see `Branch`) from the one before."""
    flags = np.asarray(stable, dtype=bool)
    lines = (flags[:-1] & flags[1:]).astype(int)
    if not lines.size:
        return []
    lines[np.asarray(holes, dtype=np.intp) - 1] = -1
    edges = np.flatnonzero(np.diff(lines)) + 1
    begins, ends = np.concatenate([[0], edges]), np.concatenate([edges, [lines.size]])
    return [(slice(int(a), int(b) + 1), bool(lines[a])) for a, b in zip(begins, ends, strict=True) if lines[a] >= 0]


def upper_gain(curves: Curves, frequency_hz: Array) -> Array:
    """Return the largest stable gain (p, f) at each frequency [Hz]; NaN where no stable motion was found.

    It is what a sweep that comes from the side of the larger amplitude finds.
    """
    out = np.full((len(curves.branches), frequency_hz.size), np.nan)
    for row, branch in zip(out, curves.branches, strict=True):
        gain = curves.gain(branch.amplitude)
        for part, is_stable in stretches(branch.stable, branch.holes):
            if is_stable:
                _raise_to(row, frequency_hz, branch.frequency_hz[part], gain[part])
    return out


def _raise_to(row: Array, frequency_hz: Array, at_hz: Array, gain: Array) -> None:
    """Raise a row to a stretch of a curve, which may run either way and turn at folds."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(at_hz)))) + 1
    for piece in np.split(np.arange(at_hz.size), turns):
        index = piece if piece[-1] == at_hz.size - 1 else np.append(piece, piece[-1] + 1)
        order = np.argsort(at_hz[index])
        found = np.interp(frequency_hz, at_hz[index][order], gain[index][order], left=np.nan, right=np.nan)
        row[:] = np.fmax(row, found)


def draw_line(axes: Axes, branch: Branch, values: Array, colour: Array) -> None:
    """Draw numbers along a curve, dotted where the motion is not stable, with gaps where points were left out."""
    for part, is_stable in stretches(branch.stable, branch.holes):
        look = _STABLE if is_stable else UNSTABLE
        axes.plot(branch.frequency_hz[part], values[part], color=colour, **look)


def _diamond(colour: Array) -> dict[str, Any]:
    return {"marker": "D", "markersize": 3.5, "color": colour, "markeredgecolor": "white", "zorder": 4}


def _add_key(axes: Axes, curves: Curves) -> None:
    """Tell the line styles apart, where there are two."""
    if all(branch.stable.all() for branch in curves.branches):
        return
    keys = [
        Line2D([], [], color=INK, label="stable", **_STABLE),
        Line2D([], [], color=INK, label="unstable", **UNSTABLE),
        Line2D([], [], color=INK, linestyle="none", marker="D", markersize=3.5, label="fold"),
    ]
    axes.legend(handles=keys, loc="upper right")


# The bands of a prediction are drawn: how far a calibrated rig's curves can be off.


@in_style
def draw_bands(curves: Curves, bands: Sequence[Band]) -> Figure:
    """Return gain and lag over frequency with 90 % bands, and the half width of the gain's band.

    Bands are of what a sweep with growing frequency meets; where draws have folds, dashed edges are of the sweep down.
    """
    figure = new_figure(3.2)
    left, middle, right = figure.subplots(1, 3)
    colours = pretension_colours(curves.pretension_mm)
    for band, colour in zip(bands, colours, strict=True):
        f, (amplitude, phase) = band.frequency_hz, band.up
        _draw_tube(left, f, amplitude, colour, float(curves.gain(1.0)))
        _draw_tube(middle, f, phase, colour, 180 / np.pi)
        if band.folded:
            for edge in (band.down[0].low, band.down[0].high):
                left.plot(f, curves.gain(edge), color=colour, linewidth=0.7, linestyle=(0, (3, 2)))
        right.plot(f, 50 * (amplitude.high - amplitude.low) / amplitude.median, color=colour, linewidth=1.1)
    left.axhline(1.0, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
    left.set(ylabel="gain: torsion amplitude / command", ylim=(0, None))
    middle.set(ylabel="lag of torsion behind lever in degrees")
    right.set(ylabel="half width of the gain's band in %", ylim=(0, None))
    for axes, letter, text in ((left, "a", "amplitude"), (middle, "b", "phase"), (right, "c", "certainty")):
        axes.set_xlabel("drive frequency in Hz")
        axes.margins(x=0)
        note_panel(axes, letter, text)
    pretension_bar(figure, (left, middle, right), np.array(curves.pretension_mm))
    return figure


def _draw_tube(axes: Axes, frequency_hz: Array, tube: Tube, colour: Array, factor: float) -> None:
    axes.fill_between(frequency_hz, factor * tube.low, factor * tube.high, color=colour, alpha=0.35, linewidth=0)
    axes.plot(frequency_hz, factor * tube.median, color=colour, linewidth=0.9)


# The forced response of a fit is drawn: a curve with its band for each level of the drive, and the measured point.


@in_style
def draw_forced(found: Forced) -> Figure:
    """Return amplitude and lag over frequency, a line and its 90 % band for each level of the drive."""
    figure = new_figure(3.5)
    left, right = figure.subplots(1, 2)
    draw_levels(left, found)
    for one, colour in zip(found.levels, _colours_of(found), strict=True):
        _draw_tube(right, one.band.frequency_hz, one.band.up[1], colour, 180 / np.pi)
        draw_line(right, one.branch, np.degrees(one.branch.phase), colour)
    right.axhline(90.0, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
    right.set(xlabel="drive frequency in Hz", ylabel="lag of the motion behind the drive in degrees")
    right.set_yticks(range(0, 181, 45))
    right.margins(x=0)
    note_panel(left, "a", "amplitude")
    note_panel(right, "b", "phase")
    return figure


def draw_levels(axes: Axes, found: Forced) -> Axes:
    """Draw the amplitude over frequency at every level with its band, the peaks and the measured point."""
    factor, unit = found.motion.factor, found.motion.unit
    for one, colour in zip(found.levels, _colours_of(found), strict=True):
        _draw_tube(axes, one.band.frequency_hz, one.band.up[0], colour, factor)
        if one.band.folded:
            for edge in (one.band.down[0].low, one.band.down[0].high):
                axes.plot(one.band.frequency_hz, factor * edge, color=colour, linewidth=0.7, linestyle=(0, (3, 2)))
        draw_line(axes, one.branch, factor * one.branch.amplitude, colour)
        axes.plot([], [], color=colour, label=found.drive.of(one.level))
        if one.branch.peak is not None:
            at = (one.branch.peak.frequency_hz, factor * one.branch.peak.amplitude)
            axes.plot(*at, "o", markersize=3, color="white", markeredgecolor=INK, zorder=5)
    if (point := found.through) is not None:
        size, error = factor * point.amplitude, factor * point.std
        axes.errorbar(point.frequency_hz, size, error, color=RED, marker="s", markersize=4, zorder=6, label="measured")
    axes.set(xlabel="drive frequency in Hz", ylabel="amplitude" if unit == "1" else f"amplitude in {unit}")
    axes.set_ylim(0, None)
    axes.margins(x=0)
    axes.legend(title=found.kind, loc="upper right")
    return axes


def _colours_of(found: Forced) -> Array:
    return pretension_colours([one.level for one in found.levels])


# The predicted responses of several rigs are drawn beside each other.

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
    _draw_marks(left, rigs, 0)
    left.set(xlabel="pretension in mm", ylabel="resonance in Hz")
    _draw_marks(right, rigs, 2)
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


def _draw_marks(axes: Axes, rigs: list[Curves], row: int) -> None:
    """Draw a row of `Curves.ridge` over pretension, a line for each rig."""
    for i, curves in enumerate(map(in_order, rigs)):
        ridge, colour = curves.ridge(), _COLOURS[i % len(_COLOURS)]
        (line,) = axes.plot(ridge[1], ridge[row], color=colour, marker=MARKERS[i % len(MARKERS)], label=curves.name)
        line.set(markeredgecolor="white", markeredgewidth=0.5)
    axes.tick_params(colors=INK)


# The predicted gain is drawn over frequency and pretension, a map for each rig.

_FREQUENCIES = 241
_MAP_ACROSS = 2
_ONE_ROW = 3
_FEWEST = 3


@in_style
def draw_predicted_map(rigs: list[Curves]) -> Figure | None:
    """Return the largest stable gain over frequency and pretension, on one scale of colour, or None where fewer than
    three pretensions were predicted.

    The red line with rings is the ridge: the resonance at each predicted pretension. Between pretensions the map
    follows it.
    """
    rigs = [in_order(curves) for curves in rigs if len(set(curves.pretension_mm)) >= _FEWEST]
    if not rigs:
        return None
    across = len(rigs) if len(rigs) <= _ONE_ROW else _MAP_ACROSS
    rows = -(-len(rigs) // across)
    figure = new_figure(2.7 * rows + 0.2, 7.1 if across > 1 else 4.6)
    panels = figure.subplots(rows, across, sharex=True, sharey=True, squeeze=False).ravel()
    maps = [_map(curves) for curves in rigs]
    top = max(float(np.nanmax(gain)) for *_, gain in maps)
    for i, (axes, curves, found) in enumerate(zip(panels, rigs, maps, strict=False)):
        last = draw_map(axes, *found, list(curves.ridge()[:2]), top)
        note_panel(axes, chr(ord("a") + i) if len(rigs) > 1 else "", shortened(curves.name, across))
    label_outer(list(panels), len(rigs), across)
    map_bar(figure, last, list(panels[: len(rigs)]))
    return figure


def _map(curves: Curves) -> tuple[Array, Array, Array]:
    """Return frequency [Hz], pretension [mm] and gain, all (p, s), on a mesh along the ridge."""
    low = max(float(b.frequency_hz.min()) for b in curves.branches)
    high = min(float(b.frequency_hz.max()) for b in curves.branches)
    frequency = np.linspace(low, high, _FREQUENCIES)
    pretension = np.array(curves.pretension_mm)
    fine = np.linspace(pretension[0], pretension[-1], 4 * (len(pretension) - 1) + 1)
    x, gain = along_ridge(frequency, upper_gain(curves, frequency), curves.ridge()[0])
    across = [np.array([np.interp(fine, pretension, column) for column in values.T]).T for values in (x, gain)]
    return across[0], np.broadcast_to(fine[:, None], across[0].shape), across[1]


# Each figure of a prediction gets its words.

PREDICTION_CAPTIONS = {
    "predicted_response": Caption(
        "Predicted response",
        "(a) Half of peak to peak of the torsion over the amplitude of the drive's command. (b) Lag of the torsion's "
        "fundamental behind the lever's. Colour is pretension. Solid lines are stable, dotted ones are not; rings mark "
        "the peaks, diamonds the folds, where a sweep jumps; dashed lines a gain of one and a lag of 90°.",
        "Two panels over drive frequency, a line for each pretension: gain on the left, lag on the right.",
    ),
    "predicted_comparison": Caption(
        "Rigs compared",
        "(a) Resonance and (b) gain there over pretension, a line for each rig. Below, each rig's gain over frequency "
        "on equal axes, coloured by pretension; solid lines are stable, dotted ones are not, diamonds are folds.",
        "Resonance and gain over pretension for all rigs, above a panel of response curves for each.",
    ),
    "predicted_map": Caption(
        "Map of gain",
        "The largest stable gain over frequency and pretension, lines of equal gain in white. The red line is the "
        "resonance; its rings stand at the predicted pretensions, between them the map follows the line.",
        "Gain as colour over drive frequency and pretension, with a red line along the resonance.",
    ),
    "predicted_bands": Caption(
        "How far the curves can be off",
        "Medians and 90 % bands of rigs drawn from what the calibration knows of the parameters. (a) and (b): what a "
        "sweep with growing frequency meets; dashed edges, where there are folds, what one with falling frequency "
        "meets. (c) Half the width of the gain's band over its median. Assumed parameters do not vary.",
        "Gain, lag and the half width of the gain's band over drive frequency, a tube for each pretension.",
    ),
    "forced_response": Caption(
        "Forced response",
        "(a) Half of peak to peak of the motion, a colour for each level of the drive, with 90 % bands of what a sweep "
        "with growing frequency meets; dashed edges, where draws have folds, what one with falling frequency meets. "
        "Solid lines are stable, dotted ones are not, rings mark the peaks, the red square the measured point. "
        "(b) Lag of the motion's fundamental behind the drive's.",
        "Amplitude and lag over drive frequency, a line with a band for each level of the drive.",
    ),
    "predicted_against": Caption(
        "Against the recording",
        "(a) and (b): points are measured, bars their 90 % intervals, lines predicted. (c) Error of the predicted gain "
        "at every point. (d) Error of the peak's frequency and gain, both read off the prediction as off the "
        "recording, with the measurement's 90 % intervals. Full marks: pretensions that the rig was calibrated to; "
        "open ones are predictions.",
        "Measured points and predicted lines of gain and lag, and their differences over frequency and pretension.",
    ),
}
"""By the name of the figure's files, in the order of the page."""


def write_prediction(folder: Path, stem: str, found: Predicted | Compared | Forced, *, rebuild: str = "") -> Path:
    """Write figures and page of a prediction into a folder, atomically, and return the page.

    stem: of the page's name. rebuild: the command that makes all of this again. Raises FileError where the folder
    cannot be written.
    """
    paths = []
    for name, figure in _figures_of(found).items():
        if figure is not None:
            paths += save_figure(figure, folder / "figures", name, ("png", "pdf"))
    rigs: Sequence[Predicted] = ()
    if isinstance(found, Forced):
        title = f"Forced response of a fit, model {found.mechanics.model}"
        about = "Steady response of the fitted law to levels of a drive."
        lead = ". ".join(f"{sentence[:1].upper()}{sentence[1:]}" for sentence in found.remarks)
    else:
        rigs = found.rigs if isinstance(found, Compared) else [found]
        title = "Rigs compared" if isinstance(found, Compared) else f"Predicted response of “{found.rig}”"
        about = f"Steady response to a lever that is commanded to swing by {rigs[0].request.amplitude_deg:g}°."
        broken = sum(not check.holds for rig in rigs for check in rig.validity)
        verb = "does" if broken == 1 else "do"
        lead = (
            f"{broken} of the checked assumptions {verb} not hold."
            if broken
            else "Every assumption that was checked holds."
        )
    shown: Sequence[Result] = rigs or [found]
    return write_page(
        folder / f"{stem}.html",
        "prediction.html",
        title=title,
        about=about,
        lead=lead,
        tables=[table for one in shown for table in result_tables(one, vars(one)["rig"] if len(rigs) > 1 else "")],
        pictures=pictures(paths, PREDICTION_CAPTIONS),
        validity=[{"title": rig.rig if len(rigs) > 1 else "", "checks": rig.validity} for rig in rigs],
        rebuild=rebuild,
        origins=[("versions", str(provenance("twin")["versions"]))],
    )


def _figures_of(found: Predicted | Compared | Forced) -> dict[str, Figure | None]:
    """Return the figures of a prediction by the name of their files, in the order of the page."""
    if isinstance(found, Forced):
        return {"forced_response": draw_forced(found)}
    if isinstance(found, Compared):
        rigs = [curves_of(one) for one in found.rigs]
        return {"predicted_comparison": draw_comparison(rigs), "predicted_map": draw_predicted_map(rigs)}
    curves = curves_of(found)
    return {
        "predicted_response": draw_predicted(curves),
        "predicted_map": draw_predicted_map([curves]),
        "predicted_bands": draw_bands(curves, found.tubes) if found.tubes else None,
        "predicted_against": None if found.against is None else draw_against(found.against),
    }


# A prediction and a recording that it did not know.

_SHOWN = 7
_POINT: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 2.6, "markeredgewidth": 0.6}


@in_style
def draw_against(found: Against) -> Figure:
    """Return the overlay of a prediction on a recording.

    (a) and (b): gain by the command and lag behind the lever, points measured with 90 % intervals, lines predicted.
    (c) error of the gain at every point. (d) errors of the resonance and of the gain there over pretension. Full marks
    are pretensions that the rig was calibrated to, open ones are not.
    """
    figure = new_figure(5.6)
    (upper_left, upper_right), (lower_left, lower_right) = figure.subplots(2, 2)
    lag = "phase_lag_deg" if any(row.phase_lag_deg for row in found.points) else "phase_from_command_deg"
    pretensions = sorted({row.pretension_mm for row in found.points})
    colours = pretension_colours(pretensions)
    for i, (mm, colour) in enumerate(zip(pretensions, colours, strict=True)):
        rows = [row for row in found.points if row.pretension_mm == mm]
        if i in few(len(colours), _SHOWN):
            _draw_curve(upper_left, rows, "gain", colour)
            _draw_curve(upper_right, rows, lag, colour)
        off = [(row.frequency_hz, 100 * row.gain.error.value) for row in rows if row.gain is not None]
        if off:
            lower_left.plot(
                *zip(*off, strict=True), **_POINT, color=colour, markerfacecolor=_face(rows[0].fitted, colour)
            )
    upper_left.legend(handles=_keys("measured, fitted to", "measured, not fitted to", "predicted"), fontsize=7.5)
    upper_left.set(ylabel="gain: torsion amplitude / command", ylim=(0, None))
    upper_right.set(ylabel="lag of torsion behind lever in degrees")
    upper_right.set_yticks(range(0, 181, 45))
    lower_left.axhline(0, color=INK, linewidth=0.7)
    lower_left.set_ylabel("predicted over measured, less one, in %")
    _draw_readings(lower_right, found)
    for axes, letter, text in (
        (upper_left, "a", "gain"),
        (upper_right, "b", "phase"),
        (lower_left, "c", "error of the gain"),
        (lower_right, "d", "error at the resonance"),
    ):
        note_panel(axes, letter, text)
    for axes in (upper_left, upper_right, lower_left):
        axes.set_xlabel("drive frequency in Hz")
    pretension_bar(figure, (upper_left, upper_right, lower_left, lower_right), pretensions)
    return figure


def _draw_curve(axes: Axes, rows: Sequence[PointRow], name: str, colour: Array) -> None:
    """Draw the measured points of one pretension under the predicted line."""
    known: list[tuple[float, Met]] = [(row.frequency_hz, one) for row in rows if (one := getattr(row, name))]
    if not known:
        return
    hertz, value = ([hz for hz, _ in known], np.array([one.measured.value for _, one in known]))
    ends = np.array([(one.measured.low, one.measured.high) for _, one in known]).T
    bars = np.nan_to_num(np.maximum(np.stack([value - ends[0], ends[1] - value]), 0.0))
    face = _face(rows[0].fitted, colour)
    axes.errorbar(hertz, value, bars, **_POINT, color=colour, markerfacecolor=face, elinewidth=0.6)
    axes.plot(hertz, [one.predicted for _, one in known], color=colour, linewidth=1.1)


def _draw_readings(axes: Axes, found: Against) -> None:
    """Draw the errors of frequency and gain of the peak over pretension, with the measurement's 90 % interval."""
    axes.axhline(0, color=INK, linewidth=0.7)
    axes.set(xlabel="pretension in mm", ylabel="predicted over measured, less one, in %")
    if not found.resonance:
        axes.text(0.5, 0.5, "too few frequencies for a resonance", transform=axes.transAxes, ha="center", color=GREY)
        return
    step = float(np.min(np.diff([row.pretension_mm for row in found.resonance]), initial=1.0)) / 8
    for name, colour, marker, aside in (("resonance_hz", ACCENT, "o", -step), ("gain_peak", RED, "s", step)):
        for row in found.resonance:
            if (one := getattr(row, name)) is not None:
                error = one.error.times(100)
                bar = np.nan_to_num([[max(error.value - error.low, 0.0)], [max(error.high - error.value, 0.0)]])
                made = axes.errorbar(row.pretension_mm + aside, error.value, bar, color=colour, elinewidth=0.7)
                made[0].set(marker=marker, markersize=3.6, markerfacecolor=_face(row.fitted, colour))
    keys = [
        Line2D([], [], color=ACCENT, linestyle="none", marker="o", markersize=3.6, label="frequency"),
        Line2D([], [], color=RED, linestyle="none", marker="s", markersize=3.6, label="gain"),
    ]
    axes.legend(handles=keys, fontsize=7.5)


def _face(fitted: Any, colour: Array | str) -> Any:
    return colour if fitted else "white"


def _keys(full: str, hollow: str, line: str) -> list[Line2D]:
    return [
        Line2D([], [], **_POINT, color=INK, label=full),
        Line2D([], [], **_POINT, color=INK, markerfacecolor="white", label=hollow),
        Line2D([], [], color=INK, linewidth=1.1, label=line),
    ]
