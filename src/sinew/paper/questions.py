"""All of the paper's open questions, asked of a recording or of a rig, and drawn."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from sinew.analysis.signal.harmonics import split_by_drive
from sinew.figures.style import MARKERS, in_style, new_figure, note_panel, pretension_colours, save_figures
from sinew.identify.joint.fit import JointFit, fit_joint
from sinew.measure.errors import SinewError, SpecError
from sinew.measure.recording import iterate_segments
from sinew.measure.units import named_unit, with_unit
from sinew.paper.answer import Answer
from sinew.paper.bent import answer_asymmetry, answer_bent, answer_carrying
from sinew.paper.hardening import answer_hardening
from sinew.paper.losses import answer_losses
from sinew.paper.sweeps import answer_constancy, answer_delay, answer_saturation
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
    progress: Progress = lambda _step, _done, _total: None,
) -> list[Answer]:
    """Return one answer for each question: hardening, saturation, losses, constancy, delay.

    recording: of a rig, or imported. results: of `analyse_recording` of it with the same rig. rig: None where none is
    known; then sensors are perfect and the losses cannot be told apart. beyond: results of a sweep at further
    pretensions, for the saturation. joint: the tendon joint fitted to the recording; fitted here where it is None and
    the rig is known. progress: called with (step, done, total).
    """
    if "gain" in results:
        recording = split_by_drive(recording)
    why_not = ""
    if joint is None:
        joint, why_not = _fitted_joint(recording, rig, results, progress)
    return [
        answer_hardening(recording, rig, lambda done, total: progress(STEPS[2], done, total)),
        answer_saturation(results, beyond),
        answer_losses(results, recording, joint, why_not),
        answer_constancy(results),
        answer_delay(results, recording, rig, joint),
    ]


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


# The questions on a joint that bends are asked of a rig.

AZIMUTH_DEG = 90.0
"""Of `plans/bent.toml`, which tests what is answered here."""
_DRAWS = 12
_STATICS = 8  # of the work, in rigs drawn


def answer_rig(
    rig: RigSpec,
    *,
    azimuth_deg: float = AZIMUTH_DEG,
    progress: Callable[[float, float], None] = lambda _done, _total: None,
) -> list[Answer]:
    """Return one answer for each question that a rig answers: resonance, coupling, asymmetry, engine, carrying.

    azimuth_deg: direction of the bend, from y towards z. progress: called with (done, total).
    Raises SpecError where the rig knows no space.
    """
    if rig.space is None:
        raise SpecError(
            f"rig {rig.name} has no [space], expected the masses of a joint that bends; take the rig paper's"
        )
    total = _DRAWS + 1 + 2 * _STATICS
    resonance, coupling, engine = answer_bent(
        rig, azimuth_deg=azimuth_deg, draws=_DRAWS, progress=lambda done, _: progress(done, total)
    )
    asymmetry = answer_asymmetry(rig, azimuth_deg=azimuth_deg)
    progress(total - _STATICS, total)
    carrying = answer_carrying(rig, azimuth_deg=azimuth_deg)
    progress(total, total)
    return [resonance, coupling, asymmetry, engine, carrying]


# Each answer has a figure: a panel for each column that it shows.


def draw_answers(answers: Sequence[Answer], folder: Path, formats: Sequence[str] = ("png", "pdf")) -> list[Path]:
    """Draw the figure of every answer that has one into a folder and return the paths that were written.

    Raises FileError where the folder cannot be written.
    """
    figures = ((f"answer_{answer.name}", draw_answer(answer)) for answer in answers)
    return save_figures(((name, figure) for name, figure in figures if figure is not None), folder, formats)


@in_style
def draw_answer(answer: Answer) -> Figure | None:
    """Return the shown columns of an answer with their 90 % intervals, None where it has no rows to draw.

    Over pretension; where the rows are of several bends, over the bend, a line for each pretension.
    """
    if not answer.rows or not answer.shown:
        return None
    figure = new_figure(2.5)
    pretension = answer.column("pretension_mm")[0]
    over = "bend_deg" if "bend_deg" in answer.rows[0] else "pretension_mm"
    across = answer.column(over)[0]
    groups = [pretension == mm for mm in np.unique(pretension)] if over == "bend_deg" else [np.isfinite(pretension)]
    colours = pretension_colours([float(pretension[of][0]) for of in groups])
    for axes, letter, name in zip(
        figure.subplots(1, len(answer.shown), squeeze=False)[0], "abcd", answer.shown, strict=False
    ):
        value, low, high = answer.column(name)
        reach = np.maximum(np.nan_to_num(np.stack([value - low, high - value])), 0.0)
        for of, colour, marker in zip(groups, colours, MARKERS, strict=False):
            label = f"{pretension[of][0]:g} mm" if len(groups) > 1 else None
            axes.errorbar(
                across[of],
                value[of],
                reach[:, of],
                fmt=f"{marker}-",
                ms=4,
                lw=0.8,
                capsize=2.5,
                color=colour,
                label=label,
            )
        axes.set(xlabel=_label(over), ylabel=_label(name))
        axes.margins(x=0.06)
        note_panel(axes, letter if len(answer.shown) > 1 else "", "")
    if len(groups) > 1:
        axes.legend()
    return figure


def _label(column: str) -> str:
    """Return the label of an axis: the words of a column and its unit."""
    words, *parts = named_unit(column)
    unit = "/".join(" ".join(symbol for symbol, _ in part) for part in parts if part)
    return with_unit(" ".join(words), unit)
