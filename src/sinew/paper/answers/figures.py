"""Figures of the answers to the open questions, one each."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.figures.style import ACCENT, GREEN, GREY, INK, MARKERS, RED, in_style, new_figure, note_panel, save_figure
from sinew.measure.arrays import Array
from sinew.paper.answers.answer import Answer

_HEIGHT_IN = 2.5
_SHARES = {
    "silicone_share": ("silicone", ACCENT),
    "guide_friction_share": ("guides' friction", GREEN),
    "recoil_share": ("lever's recoil", RED),
    "sensor_share": ("sensors", GREY),
    "method_share": ("method", INK),
}


def draw_answers(answers: Sequence[Answer], folder: Path, formats: Sequence[str] = ("png", "pdf")) -> list[Path]:
    """Draw the figure of every answer that has one into a folder and return the paths that were written.

    Raises FileError where the folder cannot be written.
    """
    paths: list[Path] = []
    for answer in answers:
        figure = draw_answer(answer)
        if figure is not None:
            paths += save_figure(figure, folder, f"answer_{answer.name}", formats)
    return paths


@in_style
def draw_answer(answer: Answer) -> Figure | None:
    """Return the figure of an answer, None where it has no rows to draw."""
    draw = ANSWER_FIGURES.get(answer.name)
    if draw is None or not answer.rows:
        return None
    figure = new_figure(_HEIGHT_IN)
    draw(answer, figure)
    return figure


def _bars(
    axes: Axes,
    answer: Answer,
    name: str,
    factor: float,
    colour: str,
    label: str = "",
    marker: str = "o",
    shift: float = 0.0,
) -> None:
    value, low, high = (factor * column for column in answer.column(name))
    reach = np.nan_to_num(np.stack([value - low, high - value]))
    axes.errorbar(
        _pretension(answer) + shift,
        value,
        np.maximum(reach, 0.0),
        linestyle="none",
        marker=marker,
        markersize=4.5,
        capsize=2.5,
        elinewidth=1.0,
        color=colour,
        label=label or None,
    )


def _pretension(answer: Answer) -> Array:
    return answer.column("pretension_mm")[0]


def _zero(axes: Axes) -> None:
    axes.axhline(0.0, color=INK, linewidth=0.8)


def _finish(axes: Axes, letter: str, title: str, label: str) -> None:
    axes.set(xlabel="pretension in mm", ylabel=label)
    axes.margins(x=0.06)
    note_panel(axes, letter, title)


def _hardening(answer: Answer, figure: Figure) -> None:
    """Draw what cubic term, quadratic term and portraits say, against zero."""
    shown = [
        ("frequency_shift", "cubic term", "shift of f₀ at the swing in %", 100.0),
        ("quadratic_share", "quadratic term", "share of the linear force in %", 100.0),
        ("half_area_asymmetry", "phase portrait", "larger on one side by %", 100.0),
    ]
    there = [row for row in shown if np.isfinite(answer.column(row[0])[0]).any()]
    for axes, letter, (name, title, label, factor) in zip(
        figure.subplots(1, len(there), squeeze=False)[0], "abc", there, strict=False
    ):
        _zero(axes)
        _bars(axes, answer, name, factor, ACCENT)
        _finish(axes, letter, title, label)


def _saturation(answer: Answer, figure: Figure) -> None:
    """Draw the peak gain by nominal and by measured drive, the drive's amplitude, and the resonance."""
    left, middle, right = figure.subplots(1, 3)
    _bars(left, answer, "gain_peak_measured_drive", 1.0, GREEN, "by measured drive", "s")
    _bars(left, answer, "gain_peak", 1.0, ACCENT, "by nominal drive")
    if "threshold_mm" in answer.numbers:
        left.axvline(answer.numbers["threshold_mm"].value, color=GREY, ymax=0.6, linestyle="--", label="threshold")
    left.set_ylim(0, 1.45 * float(np.nanmax(answer.column("gain_peak_measured_drive")[0])))
    left.legend(loc="upper right", borderaxespad=0.1)
    _finish(left, "a", "peak gain", "gain")
    _bars(middle, answer, "drive_amplitude_at_resonance_rad", math.degrees(1.0), RED)
    middle.set_ylim(bottom=0)
    _finish(middle, "b", "drive amplitude at resonance", "amplitude in degrees")
    _bars(right, answer, "resonance_hz", 1.0, INK)
    _finish(right, "c", "resonance", "frequency in Hz")


def _losses(answer: Answer, figure: Figure) -> None:
    """Draw the shares of D over pretension, and the measured D beside the fitted joint's."""
    left, right = figure.subplots(1, 2)
    _zero(left)
    step = 0.012 * max(float(np.ptp(_pretension(answer))), 1.0)
    for i, (name, (label, colour)) in enumerate(_SHARES.items()):
        _bars(left, answer, name, 100.0, colour, label, MARKERS[i], (i - 2) * step)
    top = max(float(np.nanmax(answer.column(name)[2])) for name in _SHARES)
    left.set_ylim(top=160.0 * top)
    left.legend(loc="upper left", ncols=2, borderaxespad=0.1, columnspacing=1.0, handletextpad=0.3)
    _finish(left, "a", "shares of D", "share of D in %")
    _bars(right, answer, "lehr_damping", 1.0, INK, "measured", "s", -step)
    _bars(right, answer, "lehr_damping_model", 1.0, ACCENT, "fitted joint", "o", step)
    right.set_ylim(0, 1.35 * float(np.nanmax([answer.column(n)[0] for n in ("lehr_damping", "lehr_damping_model")])))
    right.legend(loc="upper right", borderaxespad=0.1)
    _finish(right, "b", "Lehr's damping (paper's method)", "D")


def _constancy(answer: Answer, figure: Figure) -> None:
    """Draw D of every ring-down, its line with band, and the two laws that it is held against."""
    axes = figure.subplots()
    x = _pretension(answer)
    for name in sorted({key for row in answer.rows for key in row if key.startswith("repeat_")}):
        axes.plot(x, answer.column(name)[0], ".", color=GREY, markersize=4, zorder=1)
    _bars(axes, answer, "damping_ratio", 1.0, ACCENT, "mean over repeats, 90 %")
    slope, mean = answer.numbers["slope_per_mm"], answer.numbers["mean"]
    centre = float(x.mean())
    grid = np.linspace(x.min(), x.max(), 50)
    axes.plot(grid, mean.value + slope.value * (grid - centre), color=INK, label="line")
    if math.isfinite(slope.low):
        reach = np.hypot(mean.high - mean.value, (slope.high - slope.value) * (grid - centre))
        line = mean.value + slope.value * (grid - centre)
        axes.fill_between(grid, line - reach, line + reach, color=INK, alpha=0.12, linewidth=0)
    omega = answer.column("omega_rad_s")[0]
    for power, label, colour in ((1, "constant d", RED), (2, "silicone alone", GREEN)):
        law = omega ** -float(power)
        axes.plot(x, mean.value * law / law.mean(), "--", color=colour, linewidth=1.1, label=label)
    axes.set_ylim(0, 1.05 * max(float(np.nanmax(answer.column("damping_ratio")[2])), axes.get_ylim()[1]))
    axes.legend(loc="lower left", ncols=2, borderaxespad=0.1)
    _finish(axes, "", "Lehr's damping by the direct fit", "D")


def _delay(answer: Answer, figure: Figure) -> None:
    """Draw the extra delay at each pretension over the uncertainty of the written budget."""
    axes = figure.subplots()
    budget, extra = answer.numbers["budget_s"], answer.numbers["extra_delay_s"]
    reach = 1e3 * (budget.high - budget.value)
    _zero(axes)
    if reach > 0:
        axes.axhspan(-reach, reach, color=GREY, alpha=0.25, linewidth=0, label="written budget, 90 %")
    if math.isfinite(extra.low):
        axes.axhspan(
            1e3 * extra.low, 1e3 * extra.high, color=ACCENT, alpha=0.2, linewidth=0, label="all together, 90 %"
        )
    _bars(axes, answer, "extra_delay_s", 1e3, ACCENT, "extra delay")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.35 * (high - low))
    axes.legend(loc="upper left", ncols=3, borderaxespad=0.1)
    _finish(axes, "", "delay that the phase asks for beyond the budget", "delay in ms")


ANSWER_FIGURES: dict[str, Callable[[Answer, Figure], None]] = {
    "hardening": _hardening,
    "saturation": _saturation,
    "losses": _losses,
    "constancy": _constancy,
    "delay": _delay,
}
"""What draws the figure of each answer, by its name."""
