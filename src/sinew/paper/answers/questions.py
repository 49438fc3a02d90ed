"""All of the paper's open questions, asked of a recording and drawn."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.analysis.signal.groups import split_by_drive
from sinew.figures.style import ACCENT, GREEN, GREY, INK, MARKERS, RED, in_style, new_figure, note_panel, save_figures
from sinew.identify.joint.fit import JointFit, fit_joint
from sinew.measure.arrays import Array
from sinew.measure.errors import SinewError
from sinew.measure.recording import iterate_segments
from sinew.measure.tasks import Hand
from sinew.paper.answers.answer import Answer
from sinew.paper.answers.constancy import answer_constancy
from sinew.paper.answers.delay import answer_delay
from sinew.paper.answers.hardening import answer_hardening
from sinew.paper.answers.losses import answer_losses
from sinew.paper.answers.saturation import answer_saturation
from sinew.plan.rig import RigSpec

STEPS = ("the joint", "losses", "hardening")
"""What takes time, in order; `progress` of `answer_questions` names it."""

_MOST_PRETENSIONS = 5
_MOST_STEADY = 4
_MOST_DECAYS = 2

Progress = Callable[[str, float, float], None]


def answer_questions(
    recording: xr.Dataset,
    results: xr.Dataset,
    rig: RigSpec | None = None,
    *,
    beyond: xr.Dataset | None = None,
    joint: JointFit | None = None,
    hand: Hand = partial,
    progress: Progress = lambda _step, _done, _total: None,
) -> list[Answer]:
    """Return one answer for each question: hardening, saturation, losses, constancy, delay.

    recording: of a rig, or imported. results: of `analyse_recording` of it with the same rig. rig: None where none is
    known; then sensors are perfect and the losses cannot be told apart. beyond: results of a sweep at further
    pretensions, for the saturation. joint: the tendon joint fitted to the recording; fitted here where it is None and
    the rig is known. hand: of `sinew.measure.tasks.beside`, where a further process asks for the hardening beside all
    that is asked here, and says nothing of how far it is. progress: called with (step, done, total).
    """
    if "gain" in results:
        recording = split_by_drive(recording)
    why_not = ""
    told = [lambda done, total: progress(STEPS[2], done, total)] if hand is partial else []
    hardening = hand(answer_hardening, recording, rig, *told)
    if joint is None:
        joint, why_not = _fitted_joint(recording, rig, results, progress)
    others = [
        answer_saturation(results, beyond),
        answer_losses(results, recording, joint, why_not),
        answer_constancy(results),
        answer_delay(results, recording, rig, joint),
    ]
    return [hardening(), *others]


def _fitted_joint(
    recording: xr.Dataset, rig: RigSpec | None, results: xr.Dataset, progress: Progress
) -> tuple[JointFit | None, str]:
    if rig is None:
        return None, "That takes a tendon joint fitted to the recording, and no rig is known; name one."
    if "paper_lehr_damping" not in results:
        return None, ""
    try:
        few = joint_selection(recording)
        return fit_joint([few], rig, progress=lambda done, total: progress(STEPS[0], done, total)), ""
    except SinewError as error:
        return None, f"No tendon joint could be fitted: {error}."


def joint_selection(recording: xr.Dataset) -> xr.Dataset:
    """Return the part of a recording that the tendon joint is fitted to here.

    Of at most five pretensions, evenly spread: two ring-downs, and four steady segments of the first repeat, spread
    evenly over frequency; each with what settled before it.
    """
    rows = list(iterate_segments(recording))
    levels = sorted({segment.pretension_mm for _, segment, _ in rows if segment.kind in ("steady", "ring-down")})
    spread = np.linspace(0, len(levels) - 1, min(_MOST_PRETENSIONS, len(levels))).round().astype(int)
    wanted = {levels[i] for i in spread}
    chosen: set[int] = set()
    for level in wanted:
        mine = [(index, segment) for index, segment, _ in rows if segment.pretension_mm == level]
        steady = [index for index, segment in mine if segment.kind == "steady" and segment.repeat == 0]
        some = np.linspace(0, len(steady) - 1, min(_MOST_STEADY + 2, len(steady))).round().astype(int)
        inner = some[1:-1] if some.size > _MOST_STEADY else some
        chosen |= {steady[i] for i in inner}
        chosen |= {index for index, segment in mine if segment.kind == "ring-down" and segment.repeat < _MOST_DECAYS}
    chosen |= {index - 1 for index in chosen if index > 0 and rows[index - 1][1].kind == "settle"}
    order = sorted(chosen)
    samples = np.concatenate([np.arange(rows[i][2].start, rows[i][2].stop) for i in order]) if order else slice(0, 0)
    return recording.isel(sample=samples, segment=order)


# Each answer has a figure.

_HEIGHT_IN = 2.5
_SHARES = {
    "silicone_share": ("silicone", ACCENT),
    "guide_friction_share": ("guides' friction", GREEN),
    "recoil_share": ("lever's recoil", RED),
    "sensor_share": ("sensors", GREY),
    "method_share": ("method", INK),
}


def draw_answers(
    answers: Sequence[Answer], folder: Path, formats: Sequence[str] = ("png", "pdf"), hand: Hand = partial
) -> list[Path]:
    """Draw the figure of every answer that has one into a folder and return the paths that were written.

    hand: of `sinew.measure.tasks.beside`, where a further process helps to write the files.
    Raises FileError where the folder cannot be written.
    """
    figures = ((f"answer_{answer.name}", draw_answer(answer)) for answer in answers)
    return save_figures(((name, figure) for name, figure in figures if figure is not None), folder, formats, hand)


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
    axes: Axes, answer: Answer, name: str, factor: float, colour: str, label: str = "", marker: str = "o", x: float = 0
) -> None:
    """Draw a column of the rows with its intervals over pretension, moved aside by x [mm]."""
    value, low, high = (factor * column for column in answer.column(name))
    reach = np.maximum(np.nan_to_num(np.stack([value - low, high - value])), 0.0)
    look: dict[str, Any] = {"linestyle": "none", "marker": marker, "markersize": 4.5, "capsize": 2.5, "elinewidth": 1.0}
    axes.errorbar(_pretension(answer) + x, value, reach, color=colour, label=label or None, **look)


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
