"""Figures of what a joint is tuned to: motions tracked in resonance, a gait's yaw, and designed joints as a page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from sinew.analysis.tracked import POINT_COLUMNS, moved_sentence, point_row
from sinew.figures.page import Caption, Table, pictures, write_page
from sinew.figures.predicted import label_outer, shortened
from sinew.figures.style import (
    ACCENT,
    GREEN,
    GREY,
    INK,
    MARKERS,
    RED,
    frequency_colours,
    in_style,
    new_figure,
    note_panel,
    pretension_colours,
    save_figure,
)
from sinew.measure.errors import RecordingError
from sinew.solve.branch import Branch
from sinew.tune.gait import BoutGait, GaitTarget

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

    document: of `sinew.analysis.tracked.tracking_document`.
    """
    return save_figure(draw_tracking(document["tracks"], document["expected"]), folder, "tracking", ("png", "pdf"))


def write_tracking_page(path: Path, document: Mapping[str, Any], figures: Sequence[Path], rebuild: str) -> Path:
    """Write the page of tracked motions, atomically, and return its path.

    document: of `sinew.analysis.tracked.tracking_document`. figures: the PNGs among them are put into the page.
    rebuild: the command that makes all of this again. Raises FileError where the folder cannot be written.
    """
    tracks = document["tracks"]
    points = [point_row(track) for track in tracks if track["point"] is not None]
    moved = [moved_sentence(track) for track in tracks if track["point"] is None]
    count = f"{len(tracks)} motion{'s' * (len(tracks) != 1)}"
    tables = [
        Table("Points of the backbone", list(POINT_COLUMNS), points, "The torsion lags the measured lever by 90°.")
    ]
    return write_page(
        path,
        "prediction.html",
        title="A tracked resonance",
        about=f"{count}, {sum(len(track['turns']['time_s']) for track in tracks)} turns of the drive.",
        lead=" ".join(f"{sentence[:1].upper()}{sentence[1:]}." for sentence in moved),
        tables=tables if points else [],
        pictures=pictures(figures, _TRACKING),
        validity=[],
        rebuild=rebuild,
        origins=[],
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


# Designed joints become one HTML page.

_SIZES = [
    "proposal",
    "silicone",
    "length in mm",
    "circle in mm",
    "lever in kg m²",
    "envelope in mm",
    "energy in mJ",
    "tension in N",
]
_ENDS = [
    "proposal",
    "stride in Hz",
    "p in mm",
    "command in °",
    "yaw in °",
    "D",
    "tension in N",
    "drive in A",
    "twin in Hz",
    "off by",
]

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


def write_design_page(
    path: Path,
    document: Mapping[str, Any],
    *,
    figures: Sequence[Path] = (),
    rebuild: str = "",
    origins: Sequence[tuple[str, str]] = (),
) -> Path:
    """Write the page of a document of `sinew design`, atomically, and return its path.

    figures: the PNGs among them are put into the page. rebuild: the command that makes all of this again.
    Raises FileError where the folder cannot be written.
    """
    target, proposals = document["target"], document["proposals"]
    low, high = target["stride_band_hz"]
    asked = f"±{target['yaw_deg']:g}° and {target['inertia_kg_m2']:g} kg m²"
    return write_page(
        path,
        "prediction.html",
        title="Joints for a gait",
        about=f"Resonant from {low:g} to {high:g} Hz with {asked}.",
        lead=" ".join(f"{sentence[:1].upper()}{sentence[1:]}." for sentence in document["sentences"]),
        tables=[
            Table(
                "Sizes",
                _SIZES,
                [_size_row(i, one) for i, one in enumerate(proposals, 1)],
                "Energy: electrical, a cycle.",
            ),
            Table(
                "Both ends of the band",
                _ENDS,
                [row for i, one in enumerate(proposals, 1) for row in _end_rows(i, one)],
                "",
            ),
        ],
        pictures=pictures(figures, _CAPTIONS),
        validity=[{"title": one["name"], "checks": one["validity"]} for one in proposals],
        rebuild=rebuild,
        origins=list(origins),
    )


def _size_row(number: int, one: Mapping[str, Any]) -> list[str]:
    return [
        f"{number}: {one['section']}",
        str(one["material"]),
        f"{one['length_mm']:g}",
        f"{one['tendon_circle_mm']:g}",
        f"{one['lever_inertia_kg_m2']:.4f}",
        f"{one['diameter_mm']:.0f} × {one['envelope_length_mm']:.0f}",
        f"{1e3 * one['energy_j']:.0f}",
        f"{one['tension_n']:.0f}",
    ]


def _end_rows(number: int, one: Mapping[str, Any]) -> list[list[str]]:
    rows = []
    for end, found in zip(one["ends"], one["confirmed"], strict=True):
        measured, error = found["measured_hz"]["value"], found["error"]
        rows.append(
            [
                str(number),
                f"{end['wanted_hz']:g}",
                f"{end['pretension_mm']:.2f}",
                f"{end['command_deg']:.1f}",
                f"{end['torsion_deg']:.2f}",
                f"{end['damping_ratio']:.4f}",
                f"{end['tension_n']:.0f}",
                f"{end['current_a']:.2f}",
                "-" if measured is None else f"{measured:.4f}",
                "-" if error is None else f"{error:+.1%}",
            ]
        )
    return rows


# Proposals are drawn at both ends of their band: predicted torsion, with the twin beside it.

_ACROSS = 2


class EndCurves(NamedTuple):
    """One proposal: its document, and its predicted curves at both ends of the band, at its plan's command."""

    document: Mapping[str, Any]
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
        note_panel(axes, chr(ord("a") + i), f"{i + 1}: {shortened(str(one.document['name']), _ACROSS)[:44]}")
    panels[0].set_ylim(0, None)
    panels[0].margins(x=0)
    label_outer(list(panels), len(proposals), _ACROSS)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _draw(axes: Axes, one: EndCurves, yaw_deg: float) -> None:
    ends = one.document["ends"]
    for branch, end, colour, name in zip(one.branches, ends, (ACCENT, RED), ("lower", "upper"), strict=True):
        axes.plot(branch.frequency_hz, np.degrees(branch.amplitude), color=colour, label=f"{name} end, predicted")
        axes.axvline(end["wanted_hz"], color=colour, linewidth=0.8, linestyle=(0, (2, 2)), zorder=1)
        top = float(np.degrees(branch.amplitude).max())
        axes.annotate(
            f"{end['pretension_mm']:.1f} mm", (end["wanted_hz"], top), (8, 5), textcoords="offset points", fontsize=8
        )
    for i, found in enumerate(one.document["confirmed"]):
        measured = found["measured_hz"]["value"]
        if measured is None:
            continue
        label = "90° of lag on the twin" if i == 0 else None
        axes.plot(measured, found["yaw_deg"], "o", color="white", markeredgecolor=INK, zorder=5, label=label)
    label = f"±{yaw_deg:g}° wanted"
    axes.axhline(yaw_deg, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1, label=label)


# Designed joints are drawn in what is traded: the drive's energy against size and tension.

_COLOURS = (ACCENT, RED, GREEN, "#7a4fa3", "#b8690b")


@in_style
def draw_design_front(evaluated: Sequence[Mapping[str, Any]], proposals: Sequence[Mapping[str, Any]]) -> Figure:
    """Return energy over size and over tension of every exactly computed joint.

    evaluated, proposals: as in the document of `sinew design`. Full marks are not dominated, empty ones are, grey ones
    break a limit; numbers are those of the proposals.
    """
    figure = new_figure(3.4)
    left, right = figure.subplots(1, 2, sharey=True)
    shapes = list(dict.fromkeys(str(one["shape"]) for one in evaluated))
    for axes, key in ((left, "volume_cm3"), (right, "tension_n")):
        for one in evaluated:
            _draw_candidate(axes, one, key, shapes.index(one["shape"]))
        for number, one in enumerate(proposals, start=1):
            at = (one[key], 1e3 * one["energy_j"])
            axes.annotate(str(number), at, (5, 4), textcoords="offset points", fontsize=9, fontweight="bold", color=INK)
        axes.margins(0.08, 0.12)
    left.set(xlabel="volume of joint and guides in cm³", ylabel="drive energy in mJ a cycle", xscale="log")
    right.set(xlabel="tension of a tendon in N")
    if evaluated:
        left.set_xticks(_ticks([float(one["volume_cm3"]) for one in evaluated]))
        left.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
        left.minorticks_off()
    left.set_ylim(0, None)
    note_panel(left, "a", "against size")
    note_panel(right, "b", "against tension")
    keys = [_key(i, name) for i, name in enumerate(shapes)]
    keys.append(Line2D([], [], linestyle="none", marker="o", color="white", markeredgecolor=INK, label="dominated"))
    if any(not one["feasible"] for one in evaluated):
        keys.append(Line2D([], [], linestyle="none", marker="o", color=GREY, label="breaks a limit"))
    figure.legend(handles=keys, loc="outside lower center", ncols=len(keys))
    return figure


def _draw_candidate(axes: Axes, one: Mapping[str, Any], key: str, shape: int) -> None:
    colour = _COLOURS[shape % len(_COLOURS)] if one["feasible"] else GREY
    full = one["on_front"] or not one["feasible"]
    axes.plot(
        one[key],
        1e3 * one["energy_j"],
        linestyle="none",
        marker=MARKERS[shape % len(MARKERS)],
        color=colour if full else "white",
        markeredgecolor="white" if full else colour,
        markersize=6 if full else 4.5,
        zorder=4 if full else 3,
    )


def _key(shape: int, name: str) -> Line2D:
    marker = MARKERS[shape % len(MARKERS)]
    return Line2D([], [], linestyle="none", marker=marker, color=_COLOURS[shape % len(_COLOURS)], label=name)


def _ticks(values: list[float]) -> list[float]:
    """Return one, two and five times powers of ten around values."""
    decades = 10.0 ** np.arange(np.floor(np.log10(min(values))), np.ceil(np.log10(max(values))) + 1)
    every = np.outer(decades, (1, 2, 5)).ravel()
    kept = every[(every >= 0.7 * min(values)) & (every <= 1.4 * max(values))]
    return [float(x) for x in kept]
