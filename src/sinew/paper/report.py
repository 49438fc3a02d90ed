"""The report of a campaign: everything in one HTML page that needs nothing beside itself."""

import math
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr
from matplotlib.figure import Figure

from sinew.analysis.doubts import doubts_of
from sinew.analysis.signal.harmonics import split_by_drive
from sinew.figures import page, response
from sinew.figures.decay import draw_damping, draw_decay
from sinew.figures.motion import draw_lissajous
from sinew.figures.style import save_figures
from sinew.measure.estimate import Estimate, span, typeset
from sinew.measure.recording import SOURCES
from sinew.paper.answer import Answer, Cell
from sinew.paper.campaign import count_roles, is_the_papers
from sinew.plan.rig import RigSpec


def write_report(
    folder: Path,
    *,
    results: xr.Dataset,
    figures: Sequence[Path] = (),
    summary: Mapping[str, Any] | None = None,
    rig: RigSpec | None = None,
    posterior: Mapping[str, Mapping[str, Any]] | None = None,
    effects: Sequence[Mapping[str, Any]] | None = None,
    answers: Sequence[Mapping[str, str]] | None = None,
    rebuild: str = "",
) -> Path:
    """Write report.html into a folder, atomically, and return its path. What is not given is left out.

    figures: files of `draw_figures`; the PNGs among them are put into the page.
    summary: of `summarise`; its table of the paper is shown where `is_the_papers` holds. rig: whose parameters are
        listed.
    posterior: of the rig's parameters given the paper's numbers, as `sinew.plan.toml.read_posterior` returns it.
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
        doubts=[one.sentence for one in doubts_of(results)],
        paper=paper,
        agreeing=sum(bool(row["ok"]) for row in paper),
        counted=count_roles(paper),
        has_roles=any(row["role"] == "fitted" for row in paper),
        about_paper=about_paper,
        tables=page.measured_tables(results),
        windows=page.window_table(results),
        pictures=page.pictures(figures, CAPTIONS),
        parameters=page.parameter_rows(rig) if rig is not None else [],
        determined=page.determined_rows(posterior or {}) if about_paper else [],
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


def write_answers(
    folder: Path,
    answers: Sequence[Answer],
    of: xr.Dataset | RigSpec,
    *,
    figures: Sequence[Path] = (),
    rebuild: str = "",
) -> Path:
    """Write answers.html into a folder, atomically, and return its path.

    of: the recording that was asked, of which only attributes are read, or the rig. figures: of `draw_answers`; the
    PNGs among them are put into the page. rebuild: the command that makes the page again.
    Raises FileError where the folder cannot be written.
    """
    captions = {f"answer_{one.name}": page.Caption("", "", one.question) for one in answers}
    drawn = page.pictures(figures, captions)
    if isinstance(of, RigSpec):
        source = f"the joint in space, predicted for the rig “{of.name}”; no bench has measured it"
        made, recording_hash = {"source": source, "effects_off": ""}, ""
        lead = (
            "What the paper leaves open of a joint that bends, and how a bench would test it. Intervals hold the "
            "bounds of the masses that are assumed of head, lever and silicone; all else is held at the rig's values."
        )
    else:
        made, recording_hash = _made_by(of), str(of.attrs.get("content_hash", ""))
        is_answered = sum(answer.is_answered for answer in answers)
        lead = f"This recording answers {is_answered} of {len(answers)} questions that the paper leaves open."
    return page.write_page(
        folder / "answers.html",
        "answers.html",
        source=f"Source: {made['source']}." if made["source"] else "",
        effects_off=made["effects_off"],
        lead=lead,
        answers=[
            _shown(one) | {"pictures": [each for each in drawn if each["name"] == f"answer_{one.name}"]}
            for one in answers
        ],
        recording_hash=recording_hash,
        report=isinstance(of, xr.Dataset) and (folder / "report.html").is_file(),
        rebuild=rebuild,
    )


def _shown(answer: Answer) -> dict[str, Any]:
    names = list(dict.fromkeys(key for row in answer.rows for key in row if not key.startswith("repeat_")))
    return {
        "name": answer.name,
        "question": answer.question,
        "verdict": answer.verdict,
        "told": answer.is_answered,
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
    "energy": response.draw_energy,
}
"""What draws each figure, by the name of its files, in the order of the paper."""


_WORDS = Path(page.__file__).with_name("templates") / "captions.toml"
CAPTIONS = {name: page.Caption(**words) for name, words in tomllib.loads(_WORDS.read_text(encoding="utf-8")).items()}
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
) -> list[Path]:
    """Draw all figures into a folder and return the paths that were written, in the order of the paper.

    formats: file endings that matplotlib knows.
    Raises FileError where the folder cannot be written.
    """
    return save_figures(build_figures(recording, results), folder, formats)
