"""This is where the bands of a prediction are drawn: how far a calibrated rig's curves can be off."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.figures.predicted import Curves
from sinew.figures.style import GREY, Floats, in_style, new_figure, note_panel, pretension_bar, pretension_colours
from sinew.predict.band import Band, Tube

__all__ = ["draw_bands"]


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


def _draw_tube(axes: Axes, frequency_hz: Floats, tube: Tube, colour: Floats, factor: float) -> None:
    axes.fill_between(frequency_hz, factor * tube.low, factor * tube.high, color=colour, alpha=0.35, linewidth=0)
    axes.plot(frequency_hz, factor * tube.median, color=colour, linewidth=0.9)
