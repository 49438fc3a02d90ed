"""Figure of a gait: the yaw over the mean stride, and how its amplitude goes with the stride frequency."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.figures.style import GREY, INK, MARKERS, frequency_colours, in_style, new_figure, note_panel
from sinew.tune.gait import BoutGait, GaitTarget

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
