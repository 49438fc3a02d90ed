"""Figures of what a joint is tuned to: motions that were tracked in resonance, and a gait's yaw."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.figures.style import (
    GREY,
    INK,
    MARKERS,
    RED,
    frequency_colours,
    in_style,
    new_figure,
    note_panel,
    pretension_colours,
)
from sinew.tune.gait import BoutGait, GaitTarget

_PHASE_DEG = 15.0
_TARGET_DEG = 3.0


@in_style
def draw_tracking(tracks: Sequence[Mapping[str, Any]], expected: Sequence[Mapping[str, Any]]) -> Figure:
    """Return frequency and phase error of tracked motions over time, and torsion over frequency beside the prediction.

    tracks, expected: as in the document of `sinew track`. Colour is the pretension; of one that moves, its begin.
    """
    figure = new_figure(5.0)
    panels = figure.subplot_mosaic([["frequency", "backbone"], ["phase", "backbone"]], width_ratios=(1.1, 1.0))
    pretensions = [one["pretension_mm"] for one in expected]
    colours = {mm: tuple(colour) for mm, colour in zip(pretensions, pretension_colours(pretensions), strict=True)}
    moves = any(track["point"] is None for track in tracks)
    for track in tracks:
        turns = {name: np.asarray(values) for name, values in track["turns"].items()}
        colour = colours[min(colours, key=lambda mm: abs(mm - track["pretension_mm"]))]
        panels["frequency"].plot(turns["time_s"], turns["frequency_hz"], color=colour)
        panels["phase"].plot(turns["time_s"], turns["phase_error_deg"], color=colour, linewidth=1.0)
        if track.get("follow"):
            _draw_wanted(panels["frequency"], track["follow"], turns["time_s"])
        if track["point"] is None:
            locked = slice(int(track["lock_cycles"] or 0) + 2, None)
            panels["backbone"].plot(
                turns["frequency_hz"][locked], turns["torsion_deg"][locked], color=INK, label="tracked"
            )
        else:
            _draw_point(panels["backbone"], track["point"], colour)
    for one in expected:
        _draw_expected(panels["backbone"], one, colours[one["pretension_mm"]])
    panels["phase"].axhspan(-_TARGET_DEG, _TARGET_DEG, color=GREY, alpha=0.25, linewidth=0)
    panels["phase"].set(xlabel="time in s", ylabel="phase error in degrees", ylim=(-_PHASE_DEG, _PHASE_DEG))
    panels["frequency"].set(xlabel="time in s", ylabel="drive frequency in Hz")
    panels["backbone"].set(xlabel="frequency in Hz", ylabel="torsion amplitude in degrees", ylim=(0, None))
    note_panel(panels["frequency"], "a", "frequency")
    note_panel(panels["phase"], "b", "lag of the torsion less 90°")
    note_panel(panels["backbone"], "c", "where it resonated")
    panels["backbone"].plot([], [], color=GREY, linewidth=1.0, label="predicted")
    if not moves:
        panels["backbone"].plot([], [], "o", color=GREY, label="tracked")
    panels["backbone"].legend(loc="upper right")
    return figure


def _draw_wanted(axes: Axes, follow: Mapping[str, float], time: Any) -> None:
    begin = follow["begin_s"]
    axes.plot(
        [0, begin, begin + follow["duration_s"], time[-1]],
        [follow["from_hz"], follow["from_hz"], follow["to_hz"], follow["to_hz"]],
        color=RED,
        linestyle=(0, (4, 3)),
        linewidth=0.9,
        zorder=4,
        label="wanted",
    )
    axes.legend(loc="upper left")


def _draw_point(axes: Axes, point: Mapping[str, Any], colour: Any) -> None:
    f, torsion = point["frequency_hz"], point["torsion_deg"]
    bars = [[[one["value"] - one["interval90"][0]], [one["interval90"][1] - one["value"]]] for one in (f, torsion)]
    axes.errorbar(
        [f["value"]], [torsion["value"]], xerr=bars[0], yerr=bars[1], fmt="o", color=colour, capsize=2.5, zorder=5
    )


def _draw_expected(axes: Axes, one: Mapping[str, Any], colour: Any) -> None:
    frequency, torsion = np.asarray(one["frequency_hz"]), np.asarray(one["torsion_deg"])
    axes.plot(frequency, torsion, color=colour, linewidth=1.0, alpha=0.8)
    axes.annotate(
        f"{one['pretension_mm']:g} mm",
        (frequency[0], 0.0),
        xytext=(-2, 3),
        textcoords="offset points",
        ha="right",
        rotation=90,
        color=colour,
        fontsize=8.0,
    )


# A gait is drawn: the yaw over the mean stride, and how its amplitude goes with the stride frequency.

_NAMED = 6


@in_style
def draw_gait_yaw(target: GaitTarget) -> Figure | None:
    """Return the mean cycles of a target's bouts and their amplitudes; None for a target of numbers."""
    bouts = [bout for walk in target.walks for bout in walk.bouts]
    if not bouts:
        return None
    figure = new_figure(2.6)
    cycle, over = figure.subplots(1, 2, width_ratios=(3, 2))
    colours = [tuple(c) for c in frequency_colours([bout.frequency_hz.value for bout in bouts])]
    for bout, colour in zip(bouts, colours, strict=True):
        _draw_cycle(cycle, bout, colour)
    if len(bouts) <= _NAMED:
        cycle.legend(loc="upper center")
    note_panel(cycle, "a", f"yaw of {target.swing}")
    cycle.set_xlabel("share of the stride in %")
    cycle.set_ylabel("yaw in degrees")
    cycle.set_xlim(0, 100)
    over.axvspan(*target.band_hz, color=GREY, alpha=0.25, linewidth=0)
    for i, walk in enumerate(target.walks):
        for bout in walk.bouts:
            _draw_amplitude(over, bout, colours[bouts.index(bout)], MARKERS[i % len(MARKERS)])
    note_panel(over, "b", "amplitude of each bout")
    over.set_xlabel("stride frequency in Hz")
    over.set_ylabel("yaw amplitude in degrees")
    over.set_ylim(bottom=0)
    over.margins(x=0.15)
    return figure


def _draw_cycle(axes: Axes, bout: BoutGait, colour: tuple[float, ...]) -> None:
    closed = np.concatenate([bout.cycles_deg, bout.cycles_deg[:, :1]], axis=1)
    share = np.linspace(0, 100, closed.shape[1])
    mean = closed.mean(axis=0)
    axes.plot(share, mean, color=colour, label=f"{bout.frequency_hz.value:.3g} Hz, {bout.strides:.3g} strides")
    if closed.shape[0] > 1:
        spread = closed.std(axis=0, ddof=1)
        axes.fill_between(share, mean - spread, mean + spread, color=colour, alpha=0.2, linewidth=0)
    axes.plot(
        share, bout.yaw_deg.value * np.cos(2 * np.pi * share / 100), color=INK, linestyle=(0, (4, 3)), linewidth=0.8
    )


def _draw_amplitude(axes: Axes, bout: BoutGait, colour: tuple[float, ...], marker: str) -> None:
    f, yaw = bout.frequency_hz, bout.yaw_deg
    if np.isfinite(f.low) and np.isfinite(yaw.low):
        axes.errorbar(
            [f.value],
            [yaw.value],
            xerr=[[f.value - f.low], [f.high - f.value]],
            yerr=[[yaw.value - yaw.low], [yaw.high - yaw.value]],
            color=colour,
            linewidth=1.0,
        )
    axes.plot([f.value], [yaw.value], marker=marker, color=colour, linestyle="none")
