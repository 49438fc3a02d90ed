"""The open questions on a joint that bends, asked of a rig and drawn: nobody has measured one."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.figures.page import Caption
from sinew.figures.space import draw_over_pretension, draw_workspace
from sinew.figures.style import (
    ACCENT,
    GREEN,
    INK,
    MARKERS,
    RED,
    in_style,
    new_figure,
    note_panel,
    pretension_colours,
    save_figure,
)
from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import SpecError
from sinew.paper.answers.answer import Answer
from sinew.paper.answers.bent import (
    ASYMMETRY,
    CARRYING,
    COUPLING,
    ENGINE,
    RESONANCE,
    answer_asymmetry,
    answer_bent,
    answer_carrying,
)
from sinew.plan.rig import RigSpec
from sinew.predict.modes import find_modes
from sinew.predict.workspace import map_workspace

AZIMUTH_DEG = 90.0
"""Of `plans/bent.toml`, which tests what is answered here."""
DRAWS = 12

_STATICS = 8  # of the work, in rigs drawn

Progress = Callable[[float, float], None]


def answer_rig(
    rig: RigSpec,
    *,
    azimuth_deg: float = AZIMUTH_DEG,
    draws: int = DRAWS,
    seed: int = 0,
    progress: Progress = lambda _done, _total: None,
) -> list[Answer]:
    """Return one answer for each question that a rig answers: resonance, coupling, asymmetry, engine, carrying.

    azimuth_deg: direction of the bend, from y towards z. draws: of what is assumed, for intervals of what moves.
    progress: called with (done, total). Raises SpecError where the rig knows no space.
    """
    if rig.space is None:
        raise SpecError(
            f"rig {rig.name} has no [space], expected the masses of a joint that bends; take the rig paper's"
        )
    total = draws + 1 + 2 * _STATICS
    resonance, coupling, engine = answer_bent(
        rig, azimuth_deg=azimuth_deg, draws=draws, seed=seed, progress=lambda done, _: progress(done, total)
    )
    asymmetry = answer_asymmetry(rig, azimuth_deg=azimuth_deg)
    progress(total - _STATICS, total)
    carrying = answer_carrying(rig, azimuth_deg=azimuth_deg)
    progress(total, total)
    return [resonance, coupling, asymmetry, engine, carrying]


# Each answer has figures: its rows over the bend, and what the whole rig does.

_MAP_STEP_DEG = 4.0
_MAP_MM = (0.0, 6.0, 12.0)

CAPTIONS = {
    f"answer_{RESONANCE}": Caption(
        "",
        "Torsion's frequency against that of the straight joint, with 90 % intervals; open marks: a tendon is slack.",
        "relative shift of the torsion's frequency over the bend, a line for each pretension",
    ),
    f"answer_{RESONANCE}_waterfall": Caption(
        "",
        "Frequencies of the modes over pretension, a panel for each bend; colour is the torsion's share of a mode's "
        "energy; the torsion's square excites a sway that meets the dotted line, twice the torsion's frequency.",
        "modal frequencies over pretension in a panel for each bend",
    ),
    f"answer_{COUPLING}": Caption(
        "",
        "(a) Tilt across the bend over torsion, the lever driven at the torsion's resonance; dashed: half the sine of "
        "the bend, of a rod that is twisted slowly. (b) The ratio over that: what inertia adds.",
        "tilt across over torsion over the bend, and its ratio to half the sine of the bend",
    ),
    f"answer_{ASYMMETRY}": Caption(
        "",
        "The highest and the lowest tension of a tendon over the bend, held by position; at zero a tendon is slack.",
        "highest and lowest tension over the bend, a pair of lines for each pretension",
    ),
    f"answer_{ENGINE}": Caption(
        "",
        "(a) Twist that tendons give which drive the head sideways as fast as their motors can, at the frequency where "
        "it is largest. (b) Twist per tilt, there and slowly. Squares: the same joint cast with a bend of 30°, or "
        "straight where it is curved.",
        "twist and twist per tilt over the bend, of the joint as it is and of one that is cast otherwise",
    ),
    f"answer_{CARRYING}": Caption(
        "",
        "(a) Moment on the upright head at which a tendon goes slack, and at which one reaches the rig's limit. "
        "(b) Mass 100 mm above the plate that the joint carries, upright and bent by 20°.",
        "moments and masses that the joint carries over pretension",
    ),
    f"answer_{CARRYING}_poses": Caption(
        "",
        "Poses over pitch and roll, a panel for each pretension; lines: the highest tension of a tendon in newtons.",
        "maps of the poses that the joint reaches, by what ends them",
    ),
}
"""What is to be seen in the figures, by the names of their files."""


def draw_rig_answers(
    answers: Sequence[Answer],
    rig: RigSpec,
    folder: Path,
    formats: Sequence[str] = ("png", "pdf"),
    *,
    azimuth_deg: float = AZIMUTH_DEG,
    progress: Progress = lambda _done, _total: None,
) -> list[Path]:
    """Draw the figures of a rig's answers into a folder and return the paths that were written.

    Beside their rows that are the modes over all of the rig's pretensions, and a map of its poses.
    Raises FileError where the folder cannot be written.
    """
    steps = len(answers) + 2
    paths: list[Path] = []
    for i, answer in enumerate(answers):
        paths += save_figure(draw_rig_answer(answer), folder, f"answer_{answer.name}", formats)
        progress(i + 1, steps)
    by_name = {answer.name: answer for answer in answers}
    if RESONANCE in by_name:
        bends = sorted({float(x) for x in by_name[RESONANCE].column("bend_deg")[0]})
        modes = find_modes(rig, (rig.limits.pretension_mm[0],), bend_deg=bends, azimuth_deg=azimuth_deg)
        paths += save_figure(draw_over_pretension(modes), folder, f"answer_{RESONANCE}_waterfall", formats)
    progress(steps - 1, steps)
    if CARRYING in by_name:
        found = map_workspace(rig, _MAP_MM, step_deg=_MAP_STEP_DEG)
        paths += save_figure(draw_workspace(found), folder, f"answer_{CARRYING}_poses", formats)
    progress(steps, steps)
    return paths


@in_style
def draw_rig_answer(answer: Answer) -> Figure:
    """Return the figure of an answer's rows."""
    figure = new_figure(2.6)
    _FIGURES[answer.name](answer, figure)
    return figure


def _line(axes: Axes, answer: Answer, of: Mask, over: str, name: str, factor: float | Array = 1.0, **look: Any) -> None:
    """Draw a column of some rows with its intervals, times a factor. of: which rows (row,). over: column across."""
    value, low, high = (factor * column[of] for column in answer.column(name))
    x = answer.column(over)[0][of]
    reach = np.maximum(np.nan_to_num(np.stack([value - low, high - value])), 0.0)
    plain: dict[str, Any] = {"marker": "o", "markersize": 4.0, "capsize": 2.5, "elinewidth": 1.0, "linewidth": 1.0}
    axes.errorbar(x, value, reach, **(plain | look))


def _each_pretension(answer: Answer) -> list[tuple[Mask, str, dict[str, Any]]]:
    """Return for each pretension (its rows, its words, colour and marker)."""
    at = answer.column("pretension_mm")[0]
    values = np.unique(at)
    tones = pretension_colours(values)
    return [
        (at == mm, f"{mm:g} mm", {"color": tuple(tone), "marker": MARKERS[i % len(MARKERS)]})
        for i, (mm, tone) in enumerate(zip(values, tones, strict=True))
    ]


def _finish(axes: Axes, letter: str, title: str, over: str, label: str) -> None:
    axes.set(xlabel=over, ylabel=label)
    axes.margins(x=0.06)
    note_panel(axes, letter, title)


def _resonance(answer: Answer, figure: Figure) -> None:
    axes = figure.subplots()
    axes.axhline(0.0, color=INK, linewidth=0.8)
    for of, words, look in _each_pretension(answer):
        _line(axes, answer, of, "bend_deg", "relative_shift", 100, label=words, **look)
        slack = of & (answer.column("slack_tendons")[0] > 0)
        x, y = answer.column("bend_deg")[0][slack], 100 * answer.column("relative_shift")[0][slack]
        axes.plot(x, y, linestyle="none", marker=look["marker"], color=look["color"], mfc="white", zorder=4)
    axes.legend(loc="upper left")
    _finish(axes, "", "frequency of the torsion against the straight joint", "bend in degrees", "shift in %")


def _coupling(answer: Answer, figure: Figure) -> None:
    left, right = figure.subplots(1, 2)
    for of, words, look in _each_pretension(answer):
        _line(left, answer, of, "bend_deg", "tilt_across_per_torsion", label=words, **look)
        bent = of & (answer.column("bend_deg")[0] > 0)
        even = 1 / answer.column("half_sine_of_bend")[0][bent]
        _line(right, answer, bent, "bend_deg", "tilt_across_per_torsion", even, **look)
    bend = np.linspace(0, float(answer.column("bend_deg")[0].max()), 60)
    left.plot(bend, 0.5 * np.sin(np.radians(bend)), color=INK, linewidth=0.9, linestyle=(0, (4, 3)), label="½ sin β")
    left.legend(loc="upper left")
    right.axhline(1.0, color=INK, linewidth=0.9, linestyle=(0, (4, 3)))
    _finish(left, "a", "what the head does besides", "bend in degrees", "tilt across / torsion")
    _finish(right, "b", "against a rod that is twisted slowly", "bend in degrees", "ratio / (½ sin β)")


def _asymmetry(answer: Answer, figure: Figure) -> None:
    axes = figure.subplots()
    for of, words, look in _each_pretension(answer):
        _line(axes, answer, of, "bend_deg", "highest_n", label=f"{words}, highest", **look)
        _line(axes, answer, of, "bend_deg", "lowest_n", label="lowest", linestyle=(0, (4, 3)), **look)
    axes.set_ylim(bottom=0)
    figure.legend(loc="outside right center")
    _finish(axes, "", "tension of the tendons", "bend in degrees", "tension in N")


def _engine(answer: Answer, figure: Figure) -> None:
    left, right = figure.subplots(1, 2)
    every = np.ones(len(answer.rows), dtype=bool)
    _line(left, answer, every, "bend_deg", "twist_deg", color=ACCENT, label="as it is cast")
    _line(left, answer, every, "bend_deg", "recast_twist_deg", color=RED, marker="s", label="cast otherwise")
    left.set_ylim(bottom=0)
    left.legend(loc="upper left")
    _line(right, answer, every, "bend_deg", "twist_per_tilt", color=ACCENT, label="at resonance")
    slowly: dict[str, Any] = {"linestyle": (0, (4, 3)), "label": "slowly"}
    _line(right, answer, every, "bend_deg", "twist_per_tilt_slow", color=ACCENT, **slowly)
    _line(right, answer, every, "bend_deg", "recast_twist_per_tilt", color=RED, marker="s")
    _line(right, answer, every, "bend_deg", "recast_twist_per_tilt_slow", color=RED, marker="s", linestyle=(0, (4, 3)))
    right.set_yscale("log")
    for axes in (left, right):
        axes.set_xticks(answer.column("bend_deg")[0])
    right.legend(loc="center left")
    _finish(left, "a", "largest twist by sideways drive", "bend in degrees", "twist in degrees")
    _finish(right, "b", "twist / tilt", "bend in degrees", "degrees a degree")


def _carrying(answer: Answer, figure: Figure) -> None:
    left, right = figure.subplots(1, 2)
    every = np.ones(len(answer.rows), dtype=bool)
    _line(left, answer, every, "pretension_mm", "slack_moment_n_m", color=ACCENT, label="a tendon goes slack")
    _line(left, answer, every, "pretension_mm", "tension_moment_n_m", color=RED, marker="s", label="limit on tension")
    _line(right, answer, every, "pretension_mm", "upright_kg", color=ACCENT, label="upright")
    _line(right, answer, every, "pretension_mm", "bent_kg", color=GREEN, marker="s", label="bent by 20°")
    for axes in (left, right):
        axes.set_ylim(bottom=0)
        axes.legend()
    _finish(left, "a", "moment about pitch or roll", "pretension in mm", "moment in N m")
    _finish(right, "b", "mass on the head", "pretension in mm", "mass in kg")


_FIGURES: dict[str, Callable[[Answer, Figure], None]] = {
    RESONANCE: _resonance,
    COUPLING: _coupling,
    ASYMMETRY: _asymmetry,
    ENGINE: _engine,
    CARRYING: _carrying,
}
