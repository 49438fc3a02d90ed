"""Figures of what a joint is tuned to: motions tracked in resonance, and designed joints as a page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator

from sinew.analysis.tracked import Tracking
from sinew.figures.page import Caption, pictures, result_tables, write_page
from sinew.figures.predicted import label_outer, shortened
from sinew.figures.style import (
    ACCENT,
    GREEN,
    GREY,
    INK,
    MARKERS,
    RED,
    in_style,
    new_figure,
    note_panel,
    pretension_colours,
    save_figure,
)
from sinew.measure.errors import RecordingError
from sinew.solve.branch import Branch
from sinew.tune.design import Designed, Proposal

_PHASE_DEG = 15.0
_TARGET_DEG = 3.0


@in_style
def draw_tracking(tracks: Sequence[Mapping[str, Any]], expected: Sequence[Mapping[str, Any]]) -> Figure:
    """Return frequency and phase error of tracked motions over time, and torsion over frequency beside the prediction.

    tracks, expected: as in the document of `sinew track`. Colour is the pretension; of one that moves, its begin.
    Raises RecordingError where there is no track.
    """
    if not tracks:
        raise RecordingError("there is no tracked motion to draw; track one to its end")
    figure = new_figure(5.0)
    panels = figure.subplot_mosaic([["frequency", "backbone"], ["phase", "backbone"]], width_ratios=(1.1, 1.0))
    pretensions = sorted({one["pretension_mm"] for one in expected or tracks})
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


_TRACKING = {
    "tracking": Caption(
        "Tracked motions",
        "Frequency and phase error over time, turn by turn; where the joint resonated, with 90 % intervals, beside the "
        "backbone that was predicted.",
        "Drive frequency and phase error over time, and torsion over frequency with the predicted backbone.",
    )
}


def save_tracking(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write the figure of tracked motions as tracking.png and tracking.pdf, and return where they are.

    document: of `sinew.analysis.tracked.Tracking.to_dict`.
    """
    return save_figure(draw_tracking(document["tracks"], document["expected"]), folder, "tracking", ("png", "pdf"))


def write_tracking_page(path: Path, found: Tracking, figures: Sequence[Path], rebuild: str) -> Path:
    """Write the page of tracked motions, atomically, and return its path.

    figures: the PNGs among them are put into the page. rebuild: the command that makes all of this again.
    Raises FileError where the folder cannot be written.
    """
    count = f"{len(found.tracks)} motion{'s' * (len(found.tracks) != 1)}"
    return write_page(
        path,
        "prediction.html",
        title="A tracked resonance",
        about=f"{count}, {sum(len(track.turns['time_s']) for track in found.tracks)} turns of the drive.",
        lead=" ".join(f"{one}." for one in found.blocks() if isinstance(one, str)),
        tables=result_tables(found),
        pictures=pictures(figures, _TRACKING),
        validity=[],
        rebuild=rebuild,
        origins=[],
    )


# Designed joints become one HTML page.

_CAPTIONS = {
    "design_front": Caption(
        "What is traded",
        "Every joint that was computed exactly. Full marks are not dominated in energy, size and tension; numbers are "
        "the proposals.",
        "Drive energy over volume and over tension for the computed joints, proposals numbered.",
    ),
    "design_curves": Caption(
        "Proposals at both ends of the band",
        "Predicted torsion at the command of the proposal's plan; rings are where the full twin lags by 90°, at its "
        "peak's height.",
        "Torsion over frequency of each proposal at two pretensions.",
    ),
}


def write_design_page(path: Path, found: Designed, figures: Sequence[Path], rebuild: str, versions: str) -> Path:
    """Write the page of designed joints, atomically, and return its path.

    figures: the PNGs among them are put into the page. rebuild: the command that makes all of this again.
    Raises FileError where the folder cannot be written.
    """
    target = found.target
    low, high = target.stride_band_hz
    return write_page(
        path,
        "prediction.html",
        title="Joints for a gait",
        about=f"Resonant from {low:g} to {high:g} Hz with ±{target.yaw_deg:g}° and {target.inertia_kg_m2:g} kg m².",
        lead=" ".join(f"{sentence[:1].upper()}{sentence[1:]}." for sentence in found.sentences),
        tables=[table for one in (found, *found.proposals) for table in result_tables(one)],
        pictures=pictures(figures, _CAPTIONS),
        validity=[{"title": one.name, "checks": one.validity} for one in found.proposals],
        rebuild=rebuild,
        origins=[("versions", versions)],
    )


# Proposals are drawn at both ends of their band: predicted torsion, with the twin beside it.

_ACROSS = 2
_ON_TWIN = "90° of lag on the twin"


class EndCurves(NamedTuple):
    """One proposal, and its predicted curves at both ends of the band, at its plan's command."""

    proposal: Proposal
    branches: tuple[Branch, ...]


@in_style
def draw_design_curves(proposals: Sequence[EndCurves], yaw_deg: float) -> Figure:
    """Return torsion over frequency, a panel for each proposal: lines predicted, rings where the twin lags by 90°."""
    rows = -(-len(proposals) // _ACROSS)
    figure = new_figure(0.5 + 2.2 * rows)
    panels = figure.subplots(rows, _ACROSS, sharex=True, sharey=True, squeeze=False).ravel()
    for i, (axes, one) in enumerate(zip(panels, proposals, strict=False)):
        _draw(axes, one, yaw_deg)
        axes.set(xlabel="drive frequency in Hz", ylabel="torsion in degrees")
        note_panel(axes, chr(ord("a") + i), f"{i + 1}: {shortened(one.proposal.name, _ACROSS)[:44]}")
    panels[0].set_ylim(0, None)
    panels[0].margins(x=0)
    label_outer(list(panels), len(proposals), _ACROSS)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _draw(axes: Axes, one: EndCurves, yaw_deg: float) -> None:
    looks = zip(one.branches, one.proposal.ends, (ACCENT, RED), ("lower", "upper"), strict=True)
    for branch, end, colour, name in looks:
        axes.plot(branch.frequency_hz, np.degrees(branch.amplitude), color=colour, label=f"{name} end, predicted")
        axes.axvline(end.wanted_hz, color=colour, linewidth=0.8, linestyle=(0, (2, 2)), zorder=1)
        top = float(np.degrees(branch.amplitude).max())
        text = f"{end.pretension_mm:.1f} mm"
        axes.annotate(text, (end.wanted_hz, top), (8, 5), textcoords="offset points", fontsize=8)
    found = [(end.measured_hz.value, end.yaw_deg) for end in one.proposal.confirmed or ()]
    axes.plot(*np.array(found).reshape(-1, 2).T, "o", color="white", markeredgecolor=INK, zorder=5, label=_ON_TWIN)
    label = f"±{yaw_deg:g}° wanted"
    axes.axhline(yaw_deg, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1, label=label)


# Designed joints are drawn in what is traded: the drive's energy against size and tension.

_COLOURS = (ACCENT, RED, GREEN, "#7a4fa3", "#b8690b")


@in_style
def draw_design_front(evaluated: Sequence[Proposal], proposals: Sequence[Proposal]) -> Figure:
    """Return energy over size and over tension of every exactly computed joint.

    evaluated, proposals: of a `Designed`. Full marks are not dominated, empty ones are, grey ones
    break a limit; numbers are those of the proposals.
    """
    figure = new_figure(3.4)
    left, right = figure.subplots(1, 2, sharey=True)
    shapes = list(dict.fromkeys(one.shape for one in evaluated))
    for axes, key in ((left, "volume_cm3"), (right, "tension_n")):
        for one in evaluated:
            _draw_candidate(axes, one, key, shapes.index(one.shape))
        for number, one in enumerate(proposals, start=1):
            at = (getattr(one, key), 1e3 * one.energy_j)
            axes.annotate(str(number), at, (5, 4), textcoords="offset points", fontsize=9, fontweight="bold", color=INK)
        axes.margins(0.08, 0.12)
    left.set(xlabel="volume of joint and guides in cm³", ylabel="drive energy in mJ a cycle", xscale="log")
    right.set(xlabel="tension of a tendon in N")
    left.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=99))
    left.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
    left.minorticks_off()
    left.set_ylim(0, None)
    note_panel(left, "a", "against size")
    note_panel(right, "b", "against tension")

    def marked(label: str, marker: str, colour: str, edge: str | None = None) -> Line2D:
        return Line2D([], [], linestyle="none", marker=marker, color=colour, markeredgecolor=edge, label=label)

    keys = [marked(name, MARKERS[i % len(MARKERS)], _COLOURS[i % len(_COLOURS)]) for i, name in enumerate(shapes)]
    keys.append(marked("dominated", "o", "white", INK))
    if any(not one.feasible for one in evaluated):
        keys.append(marked("breaks a limit", "o", GREY))
    figure.legend(handles=keys, loc="outside lower center", ncols=len(keys))
    return figure


def _draw_candidate(axes: Axes, one: Proposal, key: str, shape: int) -> None:
    colour = _COLOURS[shape % len(_COLOURS)] if one.feasible else GREY
    full = one.on_front or not one.feasible
    axes.plot(
        getattr(one, key),
        1e3 * one.energy_j,
        linestyle="none",
        marker=MARKERS[shape % len(MARKERS)],
        color=colour if full else "white",
        markeredgecolor="white" if full else colour,
        markersize=6 if full else 4.5,
        zorder=4 if full else 3,
    )
