"""This is where a prediction is drawn over a recording: curves over points, their differences, and the resonances."""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from sinew.figures.style import (
    ACCENT,
    GREY,
    INK,
    RED,
    few,
    in_style,
    new_figure,
    note_panel,
    pretension_bar,
    pretension_colours,
)
from sinew.measure.arrays import Array
from sinew.predict.against import Comparison, Reading, error_of

_SHOWN = 7
_POINT: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 2.6, "markeredgewidth": 0.6}


@in_style
def draw_against(comparison: Comparison) -> Figure:
    """Return the overlay of a prediction on a recording.

    (a) and (b): gain by the command and lag behind the lever, points measured with 90 % intervals, lines predicted.
    (c) error of the gain at every point. (d) errors of the resonance and of the gain there over pretension. Full marks
    are pretensions that the rig was calibrated to, open ones are not.
    """
    figure = new_figure(5.6)
    (upper_left, upper_right), (lower_left, lower_right) = figure.subplots(2, 2)
    lag = "phase_lag_rad" if "phase_lag_rad" in comparison.points else "phase_from_command_rad"
    _draw_curves(upper_left, comparison, comparison.points["gain"], 1.0)
    upper_left.legend(handles=_keys("measured, fitted to", "measured, not fitted to", "predicted"), fontsize=7.5)
    _draw_curves(upper_right, comparison, comparison.points[lag], 180 / math.pi)
    upper_left.set(ylabel="gain: torsion amplitude / command", ylim=(0, None))
    upper_right.set(ylabel="lag of torsion behind lever in degrees")
    upper_right.set_yticks(range(0, 181, 45))
    _draw_errors(lower_left, comparison)
    _draw_readings(lower_right, comparison)
    for axes, letter, text in (
        (upper_left, "a", "gain"),
        (upper_right, "b", "phase"),
        (lower_left, "c", "error of the gain"),
        (lower_right, "d", "error at the resonance"),
    ):
        note_panel(axes, letter, text)
    for axes in (upper_left, upper_right, lower_left):
        axes.set_xlabel("drive frequency in Hz")
    pretension_bar(figure, (upper_left, upper_right, lower_left, lower_right), comparison.pretension_mm)
    return figure


def _draw_curves(axes: Axes, comparison: Comparison, reading: Reading, factor: float) -> None:
    """Draw measured points under predicted lines, of a few pretensions where there are many."""
    colours = pretension_colours(comparison.pretension_mm)
    for i in few(len(colours), _SHOWN):
        bars = factor * np.stack([reading.measured[i] - reading.low[i], reading.high[i] - reading.measured[i]])
        axes.errorbar(
            comparison.frequency_hz,
            factor * reading.measured[i],
            np.nan_to_num(np.maximum(bars, 0.0)),
            **_POINT,
            color=colours[i],
            markerfacecolor=_face(comparison.fitted[i], colours[i]),
            elinewidth=0.6,
        )
        known = np.isfinite(reading.predicted[i])
        axes.plot(comparison.frequency_hz[known], factor * reading.predicted[i][known], color=colours[i], linewidth=1.1)


def _draw_errors(axes: Axes, comparison: Comparison) -> None:
    error = 100 * error_of("gain", comparison.points["gain"])[0]
    for row, colour, fitted in zip(error, pretension_colours(comparison.pretension_mm), comparison.fitted, strict=True):
        axes.plot(comparison.frequency_hz, row, **_POINT, color=colour, markerfacecolor=_face(fitted, colour))
    axes.axhline(0, color=INK, linewidth=0.7)
    axes.set_ylabel("predicted over measured, less one, in %")


def _draw_readings(axes: Axes, comparison: Comparison) -> None:
    """Draw the errors of frequency and gain of the peak over pretension, with the measurement's 90 % interval."""
    axes.axhline(0, color=INK, linewidth=0.7)
    axes.set(xlabel="pretension in mm", ylabel="predicted over measured, less one, in %")
    if not comparison.readings:
        axes.text(0.5, 0.5, "too few frequencies for a resonance", transform=axes.transAxes, ha="center", color=GREY)
        return
    step = float(np.min(np.diff(comparison.pretension_mm), initial=1.0)) / 8
    for name, colour, marker, aside in (("resonance_hz", ACCENT, "o", -step), ("gain_peak", RED, "s", step)):
        error, _, low, high = (100 * part for part in error_of(name, comparison.readings[name]))
        for i, fitted in enumerate(comparison.fitted):
            bar = np.nan_to_num([[max(error[i] - low[i], 0.0)], [max(high[i] - error[i], 0.0)]])
            axes.errorbar(
                comparison.pretension_mm[i] + aside,
                error[i],
                bar,
                color=colour,
                marker=marker,
                markersize=3.6,
                markerfacecolor=_face(fitted, colour),
                elinewidth=0.7,
            )
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
