"""This is where the answers to the open questions become one HTML page that needs nothing beside itself."""

import base64
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr

from sinew.figures.page import write_page
from sinew.figures.tables import number
from sinew.identify.answer import Answer, Cell
from sinew.measure import estimate
from sinew.measure.estimate import Estimate, interval, span, typeset

__all__ = ["write_answers"]

_SOURCES = {
    "twin": "simulated by the physics twin",
    "emulator": "recorded on the emulated rig",
    "bench": "recorded on the bench",
    "import": "an imported recording",
}
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
    """Write answers.html into a folder, atomically, and return its path.

    recording: what was asked; only its attributes are read. figures: of `sinew.figures.answers.draw_answers`; the PNGs
    among them are put into the page. rebuild: the command that makes the page again.
    Raises FileError where the folder cannot be written.
    """
    source = str(recording.attrs.get("source", ""))
    pictures = {
        path.stem.removeprefix("answer_"): base64.b64encode(path.read_bytes()).decode("ascii")
        for path in figures
        if path.suffix == ".png"
    }
    return write_page(
        folder / "answers.html",
        "answers.html",
        source=_SOURCES.get(source, source),
        effects_off=", ".join(str(recording.attrs.get("effects_off", "")).split()),
        answers=[_shown(answer, pictures) for answer in answers],
        told=sum(answer.told for answer in answers),
        recording_hash=str(recording.attrs.get("content_hash", "")),
        report=(folder / "report.html").is_file(),
        rebuild=rebuild,
    )


def _shown(answer: Answer, pictures: Mapping[str, str]) -> dict[str, Any]:
    names = list(dict.fromkeys(key for row in answer.rows for key in row if not key.startswith("repeat_")))
    return {
        "name": answer.name,
        "question": answer.question,
        "verdict": answer.verdict,
        "told": answer.told,
        "sentences": answer.sentences,
        "numbers": [(name, *_cells(one)) for name, one in answer.numbers.items()],
        "head": names,
        "rows": [[_cell(row.get(name, math.nan)) for name in names] for row in answer.rows],
        "picture": pictures.get(answer.name, ""),
        "alt": _ALT.get(answer.name, ""),
    }


def _cells(one: Estimate) -> tuple[str, str, str]:
    """Return value, standard deviation and interval, all with the digits that the interval gives."""
    known = not (math.isnan(one.low) or math.isnan(one.high))
    value = interval(one.value, one.low, one.high).split(" (")[0] if known else estimate.pair(one.value, one.std)
    spread = number(one.std, 2) if math.isfinite(one.std) else "–"
    return typeset(value.split(" ±")[0]), spread, typeset(span(one.low, one.high)) if known else "–"


def _cell(cell: Cell) -> str:
    if not isinstance(cell, Estimate):
        return number(cell)
    return typeset(estimate.pair(cell.value, 0.5 * (cell.high - cell.low)))
