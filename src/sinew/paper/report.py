"""The report of a campaign: everything in one HTML page that needs nothing beside itself."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from sinew.analysis.doubts import doubts_of
from sinew.analysis.signal.groups import split_by_drive
from sinew.analysis.sweep.response import FEWEST_PRETENSIONS, fit_saturation
from sinew.figures import page, response
from sinew.figures.decay import draw_damping, draw_decay
from sinew.figures.motion import draw_lissajous, draw_phase_portraits
from sinew.figures.style import save_figures
from sinew.measure.arrays import Array
from sinew.measure.estimate import Estimate, span, typeset
from sinew.measure.recording import SOURCES
from sinew.measure.tasks import Hand
from sinew.paper.answers.answer import Answer, Cell
from sinew.paper.table import count_roles, is_the_papers
from sinew.plan.rig import RigSpec

# The report says in words whether the gain levels off above some pretension, and what levels it.

_PAPER_MM = 12.0
"""The paper's saturation threshold (sections 4.1 and 5.2.4)."""

_COLUMNS = (
    "pretension_mm",
    "paper_resonance_hz",
    "paper_gain_peak",
    "gain_peak_measured_drive",
    "drive_amplitude_at_resonance_rad",
)


def describe_threshold(
    results: xr.Dataset, beyond: xr.Dataset | None = None, *, about_paper: bool = False
) -> list[str]:
    """Return sentences on the saturation of the peak gain, none below six pretensions with a resonance.

    results: of the campaign. beyond: results of a sweep at further pretensions, joined to it.
    about_paper: whether to hold the kink against the paper's 12 mm.
    """
    parts = [part for part in (results, beyond) if part is not None and set(_COLUMNS) <= set(part.variables)]
    if not parts:
        return []
    rows = np.concatenate([np.stack([part[name].values for name in _COLUMNS]) for part in parts], axis=1)
    rows = rows[:, np.isfinite(rows).all(axis=0)]
    pretension, resonance, gain, by_measured, drive = rows[:, np.argsort(rows[0])]
    if np.unique(pretension).size < FEWEST_PRETENSIONS:
        return []
    fit = fit_saturation(pretension, gain)
    span = f"{pretension[0]:g} to {pretension[-1]:g} mm"
    sentences = [
        f"Two straight lines through the peak gain at {pretension.size} pretensions, {span}. {_printed(fit.sentence)}"
    ]
    if about_paper:
        inside = fit.threshold_mm.low <= _PAPER_MM <= fit.threshold_mm.high
        sentences.append(
            f"The paper's threshold, {_PAPER_MM:g} mm, lies "
            + ("inside that interval." if inside else "outside that interval: the fit finds no threshold there.")
        )
    if fit.preferred:
        sentences.append("A curve that bends evenly prefers two lines as well, so a kink alone is no threshold.")
    return [
        *sentences,
        f"By measured drive instead. {_printed(fit_saturation(pretension, by_measured).sentence)}",
        _rise(pretension, resonance),
        _upper_half(pretension, gain, by_measured, drive),
    ]


def _rise(pretension: Array, resonance: Array) -> str:
    falls = int((np.diff(resonance) <= 0).sum())
    how = "rises at every step" if falls == 0 else f"fails to rise at {falls} of {resonance.size - 1} steps"
    return (
        f"The resonance {how}, from {resonance[0]:.2f} Hz at {pretension[0]:g} mm to {resonance[-1]:.2f} Hz at "
        f"{pretension[-1]:g} mm."
    )


def _upper_half(pretension: Array, gain: Array, by_measured: Array, drive: Array) -> str:
    """Return whose the change over the upper half of the range is: the drive's or the joint's."""
    first = int(np.searchsorted(pretension, (pretension[0] + pretension[-1]) / 2))
    nominal, joint, reached = (float(row[-1] / row[first] - 1) for row in (gain, by_measured, drive))
    if abs(joint) < 0.25 * abs(nominal):
        verdict = "up there the gain by nominal drive changes because the drive does, not the joint"
    elif abs(joint) < 0.5 * abs(nominal):
        verdict = "up there the gain by nominal drive changes mostly because the drive does"
    else:
        verdict = "up there the joint itself still changes"
    return (
        f"From {pretension[first]:g} to {pretension[-1]:g} mm the gain by nominal drive changes by {_percent(nominal)} "
        f"({gain[first]:.2f} to {gain[-1]:.2f}), the gain by measured drive by {_percent(joint)} "
        f"({by_measured[first]:.2f} to {by_measured[-1]:.2f}), and the drive amplitude at resonance by "
        f"{_percent(reached)}: {verdict}."
    )


def _printed(sentence: str) -> str:
    """Return a sentence with the minus signs of print."""
    return sentence.replace(" -", " −")


def _percent(share: float) -> str:
    return f"{100 * share:+.0f} %".replace("-", "−")


def write_report(
    folder: Path,
    *,
    results: xr.Dataset,
    figures: Sequence[Path] = (),
    summary: Mapping[str, Any] | None = None,
    beyond: xr.Dataset | None = None,
    rig: RigSpec | None = None,
    determination: Mapping[str, Mapping[str, Any]] | None = None,
    effects: Sequence[Mapping[str, Any]] | None = None,
    answers: Sequence[Mapping[str, str]] | None = None,
    rebuild: str = "",
) -> Path:
    """Write report.html into a folder, atomically, and return its path. What is not given is left out.

    figures: files of `draw_figures`; the PNGs among them are put into the page.
    summary: of `summarise`; its table of the paper is shown where `is_the_papers` holds. rig: whose parameters are
        listed. beyond: results of a sweep above 12 mm, for the sentences on the saturation threshold.
    determination: by parameter, `{"value", "unit", "alone": [low, high], "together": [low, high], "bounds": [low,
    high], "sentence"}`: how far it can move without leaving the paper's numbers, alone and with the others following.
    effects: rows of `{"effect", "resonance_hz_0", "resonance_hz_12", "gain_0", "gain_12", "damping_0", "damping_12"}`.
    answers: rows of `{"question", "verdict", "sentence"}` of an answers.html in the same folder; with none in them the
        page says how to get them.
    rebuild: the command that makes all of this again.
    Raises FileError where the folder cannot be written.
    """
    about_paper = is_the_papers(results, rig)
    paper = list(summary["paper"]) if summary is not None and rig is not None and about_paper else []
    return page.write_page(
        folder / "report.html",
        "report.html",
        title=f"Resonance report of the rig “{rig.name}”" if rig is not None and about_paper else "Resonance report",
        **_made_by(results),
        doubts=[one["sentence"] for one in doubts_of(results)],
        paper=paper,
        agreeing=sum(bool(row["ok"]) for row in paper),
        counted=count_roles(paper),
        has_roles=any(row["role"] == "fitted" for row in paper),
        about_paper=about_paper,
        threshold=describe_threshold(results, beyond, about_paper=about_paper),
        tables=page.measured_tables(results),
        windows=page.window_table(results),
        pictures=page.pictures(figures, CAPTIONS),
        parameters=page.parameter_rows(rig) if rig is not None else [],
        reaches=page.reaches(determination or {}) if about_paper else [],
        effects=list(effects or ()) if about_paper else [],
        answers=None if answers is None else list(answers),
        rebuild=rebuild,
        timing={key: summary[key] for key in ("wall_s", "simulated_s")} if summary is not None else {},
        origins=_origins(results),
        texts={name: str(results.attrs[name]) for name in ("rig", "plan") if str(results.attrs.get(name, "")).strip()},
    )


def _made_by(dataset: xr.Dataset) -> dict[str, str]:
    source = str(dataset.attrs.get("source", ""))
    off = ", ".join(str(dataset.attrs.get("effects_off", "")).split())
    return {"source": SOURCES.get(source, source), "effects_off": off}


def _origins(results: xr.Dataset) -> list[tuple[str, str]]:
    """Return what the results say of how they were made: source, versions, seed and content hashes."""
    names = ["source", "versions", "seed", *sorted(k for k in map(str, results.attrs) if k.endswith("hash"))]
    rows = [(name.replace("_", " "), str(results.attrs[name])) for name in names if name in results.attrs]
    return [row for row in rows if row != ("seed", "-1")]


# The answers to the open questions become one HTML page that needs nothing beside itself.

_ALT = {
    "hardening": "cubic term, quadratic term and lopsidedness of the phase portraits over pretension",
    "saturation": "peak gain by nominal and by measured drive, drive amplitude and resonance over pretension",
    "losses": "shares of Lehr's damping over pretension, and measured beside modelled damping",
    "constancy": "Lehr's damping over pretension with its line, and what two laws would make of it",
    "delay": "extra delay at each pretension beside the uncertainty of the written delay budget",
}


def write_answers(
    folder: Path, answers: Sequence[Answer], *, recording: xr.Dataset, figures: Sequence[Path] = (), rebuild: str = ""
) -> Path:
    """Write answers.html of a recording into a folder, atomically, and return its path.

    recording: what was asked; only its attributes are read. figures: of `draw_answers`; the
    PNGs among them are put into the page. rebuild: the command that makes the page again.
    Raises FileError where the folder cannot be written.
    """
    made = _made_by(recording)
    captions = {f"answer_{name}": page.Caption("", "", alt) for name, alt in _ALT.items()}
    told = sum(answer.told for answer in answers)
    return page.write_page(
        folder / "answers.html",
        "answers.html",
        source=f"Source: {made['source']}." if made["source"] else "",
        effects_off=made["effects_off"],
        lead=f"This recording answers {told} of {len(answers)} questions that the paper leaves open.",
        answers=_all_shown(answers, page.pictures(figures, captions), "By pretension"),
        recording_hash=str(recording.attrs.get("content_hash", "")),
        report=(folder / "report.html").is_file(),
        rebuild=rebuild,
    )


def write_rig_answers(
    folder: Path,
    answers: Sequence[Answer],
    rig: RigSpec,
    *,
    captions: Mapping[str, page.Caption],
    figures: Sequence[Path] = (),
    rebuild: str = "",
) -> Path:
    """Write answers.html of a rig into a folder, atomically, and return its path.

    captions: of the figures, by the names of their files; else as `write_answers`.
    Raises FileError where the folder cannot be written.
    """
    return page.write_page(
        folder / "answers.html",
        "answers.html",
        source=f"Source: the joint in space, predicted for the rig “{rig.name}”; no bench has measured it.",
        effects_off="",
        lead="What the paper leaves open of a joint that bends, what it rests on, and how a bench would test it.",
        answers=_all_shown(answers, page.pictures(figures, captions), "By pretension and bend"),
        recording_hash="",
        report=False,
        rebuild=rebuild,
    )


def _all_shown(answers: Sequence[Answer], drawn: Sequence[Mapping[str, Any]], rows_of: str) -> list[dict[str, Any]]:
    """Return answers as the page takes them, each with its pictures: `answer_NAME` and `answer_NAME_...`."""
    shown = []
    for answer in answers:
        own = f"answer_{answer.name}"
        mine = [one for one in drawn if one["name"] == own or one["name"].startswith(f"{own}_")]
        shown.append(_shown(answer) | {"pictures": mine, "rows_of": rows_of})
    return shown


def _shown(answer: Answer) -> dict[str, Any]:
    names = list(dict.fromkeys(key for row in answer.rows for key in row if not key.startswith("repeat_")))
    return {
        "name": answer.name,
        "question": answer.question,
        "verdict": answer.verdict,
        "told": answer.told,
        "sentences": answer.sentences,
        "numbers": [(name, _cell(one), typeset(span(one.low, one.high))) for name, one in answer.numbers.items()],
        "head": names,
        "rows": [[_cell(row.get(name, math.nan)) for name in names] for row in answer.rows],
    }


def _cell(cell: Cell) -> str:
    if not isinstance(cell, Estimate):
        return page.number(cell)
    return typeset(cell.shown() if math.isfinite(cell.std) else cell.shown_interval())


FIGURES: dict[str, Callable[[xr.Dataset, xr.Dataset], Figure | None]] = {
    "figure05_drive_groups": lambda recording, _: response.draw_drive_groups(recording),
    "figure06_response": lambda _, results: response.draw_response(results),
    "figure07_lissajous": lambda recording, _: draw_lissajous(recording),
    "figure08_map": lambda _, results: response.draw_response_map(results),
    "figure09_decay": draw_decay,
    "figure10_damping": draw_damping,
    "drive_amplitude": response.draw_drive_amplitude,
    "energy": response.draw_energy,
    "phase_portraits": draw_phase_portraits,
}
"""What draws each figure, by the name of its files, in the order of the paper."""


# Each figure gets its words: title, what to see, what it looks like, what the paper shows there.

CAPTIONS = {
    "figure05_drive_groups": page.Caption(
        "Figure 5: driving oscillation",
        "(a) The first sweep as it was driven, at the pretension in its title: each group settles (grey) and is then "
        "recorded (colour). The numbers are frequencies, the dotted lines the nominal amplitude. (b) to (d) Three "
        "groups close up: commanded (dashed), settling (grey) and recorded (blue).",
        "Drive angle over time for one whole sweep, and close-ups of three frequency groups, commanded and measured.",
        "The paper drives groups of five periods at constant nominal amplitude, each after 3 s of settling.",
    ),
    "figure06_response": page.Caption(
        "Figure 6: amplitude response and phase difference",
        "(a) Mean of the torsion's peaks over the nominal drive amplitude (Eq. 6). (b) Lag of the torsion behind the "
        "drive. Lines are means over the repeats, tubes ±1 standard deviation, often thinner than the line; colour is "
        "pretension; rings mark the resonance at each pretension, dashed lines a gain of one and a lag of 90°.",
        "Two panels over drive frequency, a line with a tube for each pretension: gain on the left, lag on the right.",
        "The paper finds the resonance rising from 3 to 4.3 Hz while the gain falls from 2.8 to 1.4, and a lag of 90° "
        "at resonance.",
    ),
    "figure07_lissajous": page.Caption(
        "Figure 7: Lissajous curves",
        "Middle: measured torsion over measured drive, a colour for each frequency; dotted lines mark the nominal "
        "drive amplitude, the dashed line is the ellipse fitted to the curve whose lag is closest to 90°. "
        "Left and right: the ideal shapes for lags of 0 to 180°, at equal amplitudes.",
        "Closed curves of torsion over drive angle at several frequencies, between schematic ellipses for five lags.",
        "The paper shows p = 4 mm: a rising line opens to an ellipse and closes again to a falling one, and the curves "
        "become narrower at high frequency, where the drive does not reach its amplitude.",
    ),
    "figure08_map": page.Caption(
        "Figure 8: response map",
        "(a) Gain as a surface over frequency and pretension. (b) The same from above, with lines of equal gain. The "
        "red line is the ridge, the resonance at each pretension. Between measured points the surface follows the "
        "ridge and does not overshoot.",
        "A surface of gain over frequency and pretension, and its view from above with a red line along the ridge.",
        "In the paper the ridge moves to higher frequency and lower gain as pretension rises.",
    ),
    "figure09_decay": page.Caption(
        "Figure 9: free decay",
        "(a) The drive stops at its zero crossing and the joint swings freely. (b) The free decay, its positive and "
        "negative peaks, the fitted envelope, and the quantities that follow (Eq. 7 to 10).",
        "Drive and torsion over time around the stop of the drive, and the decaying torsion inside its envelope.",
        "The paper shows the same without pretension and derives λ, ⟨ω⟩ and D from the envelope.",
    ),
    "figure10_damping": page.Caption(
        "Figure 10: damping over pretension",
        "(a) to (c) Decay coefficient, angular frequency and Lehr's damping, mean ± standard deviation over the "
        "repeats: by the paper's peak method (dots) and by a direct fit in the time domain (squares). Below: measured "
        "decays (grey) under the linear second-order model with the same λ and ⟨ω⟩ (green).",
        "Three panels of damping quantities over pretension, above small panels of decays with the linear model.",
        "In the paper λ and ⟨ω⟩ rise with pretension while D stays about constant.",
    ),
    "drive_amplitude": page.Caption(
        "Drive amplitude",
        "Measured drive amplitude over frequency at each pretension. The dotted line is the nominal amplitude, rings "
        "mark the resonance. Red, where the rig is known: along the dashed line a sine has the motor's no-load speed "
        "ω₀ as its peak speed, amplitude ω₀/(2πf). A saturated drive runs nearly a triangle, at ω₀ all the time: its "
        "peak ω₀/(4f) is π/2 times higher, its fundamental, which is what is measured here, 4/π times (dash-dotted).",
        "Measured drive amplitude over frequency, a line for each pretension, with the nominal amplitude dotted.",
        "The paper reports that the amplitude falls as frequency rises and leaves open whether the drive or the joint "
        "limits the gain; this figure is added for that question.",
    ),
    "energy": page.Caption(
        "Energy",
        "(a) Electrical power of the drive (duty, current and voltage of its servo) as it was driven; rings mark the "
        "resonance. (b) The same per cycle and per squared torsion amplitude: what a swing of the head costs. Dashed: "
        "the trend, which spring and inertia would need if neither helped the other; the arrow is the reduction at "
        "resonance, the triangle the frequency of the cheapest swing. (c) Where the power at resonance goes, with "
        "the tendon motors and the electronics of all servos.",
        "Power of the drive over frequency, energy per swing over frequency with a trend line, and stacked bars of the "
        "power at resonance over pretension.",
        "The paper proposes the reduction of the motor's current at resonance, against its rise with frequency, as a "
        "measure of the energy saved, and leaves it to future work (section 5.3).",
    ),
    "phase_portraits": page.Caption(
        "Phase portraits at resonance",
        "Torsion rate over torsion during the recorded periods at resonance. The dashed ellipse is a harmonic "
        "oscillation of the same frequency and amplitude. Above: the torsion's harmonics as a share of its "
        "fundamental; even ones bend the portrait to one side, the third squeezes it evenly.",
        "Closed curves of torsion rate over torsion at resonance, each with a dashed ellipse, for some pretensions.",
        "The paper expects anharmonicity to show as an asymmetry here (section 5.2.3) and leaves it to its video.",
    ),
}
"""By the name of the figure's files, in the order of the paper."""


def build_figures(recording: xr.Dataset, results: xr.Dataset) -> Iterator[tuple[str, Figure]]:
    """Yield (name, figure) of every figure whose parts the recording and the results hold.

    Steady segments that do not say their frequency are split as the analysis splits them.
    """
    if "gain" in results:
        recording = split_by_drive(recording)
    for name, draw in FIGURES.items():
        figure = draw(recording, results)
        if figure is not None:
            yield name, figure


def draw_figures(
    recording: xr.Dataset,
    results: xr.Dataset,
    folder: Path,
    formats: Sequence[str] = ("png", "pdf"),
    hand: Hand = partial,
) -> list[Path]:
    """Draw all figures into a folder and return the paths that were written, in the order of the paper.

    formats: file endings that matplotlib knows. hand: see `sinew.figures.style.save_figures`.
    Raises FileError where the folder cannot be written.
    """
    return save_figures(build_figures(recording, results), folder, formats, hand)
