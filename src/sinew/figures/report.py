"""This is where everything becomes one HTML page that needs nothing beside itself."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr

from sinew.analysis.doubts import doubts_of
from sinew.figures.captions import CAPTIONS
from sinew.figures.page import picture, write_page
from sinew.figures.paper import count_roles, is_the_papers
from sinew.figures.tables import measured_tables, parameter_rows, reaches, window_table
from sinew.figures.threshold import describe_threshold
from sinew.plan.rig import RigSpec

__all__ = ["write_report"]


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
    source = str(results.attrs.get("source", ""))
    return write_page(
        folder / "report.html",
        "report.html",
        title=f"Resonance report of the rig “{rig.name}”" if rig is not None and about_paper else "Resonance report",
        source=_SOURCES.get(source, source),
        doubts=[one["sentence"] for one in doubts_of(results)],
        effects_off=", ".join(str(results.attrs.get("effects_off", "")).split()),
        paper=paper,
        agreeing=sum(bool(row["ok"]) for row in paper),
        counted=count_roles(paper),
        has_roles=any(row["role"] == "fitted" for row in paper),
        about_paper=about_paper,
        threshold=describe_threshold(results, beyond, about_paper=about_paper),
        tables=measured_tables(results),
        windows=window_table(results),
        pictures=[picture(path, CAPTIONS) for path in figures if path.suffix == ".png"],
        parameters=parameter_rows(rig) if rig is not None else [],
        reaches=reaches(determination or {}),
        effects=list(effects or ()),
        answers=None if answers is None else list(answers),
        rebuild=rebuild,
        timing={key: summary[key] for key in ("wall_s", "simulated_s")} if summary is not None else {},
        origins=_origins(results),
        texts={name: str(results.attrs[name]) for name in ("rig", "plan") if str(results.attrs.get(name, "")).strip()},
    )


_SOURCES = {
    "twin": "simulated by the physics twin",
    "emulator": "recorded on the emulated rig",
    "bench": "recorded on the bench",
    "import": "an imported recording",
}


def _origins(results: xr.Dataset) -> list[tuple[str, str]]:
    """Return what the results say of how they were made: source, versions, seed and content hashes."""
    names = ["source", "versions", "seed", *sorted(k for k in map(str, results.attrs) if k.endswith("hash"))]
    rows = [(name.replace("_", " "), str(results.attrs[name])) for name in names if name in results.attrs]
    return [row for row in rows if row != ("seed", "-1")]
