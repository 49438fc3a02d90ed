"""`sinew answer`: the paper's open questions, asked of a recording, and the page of its answers."""

import shlex
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps.console import Json, option, print_json, print_table, progress_bar, require_folder, write_json
from sinew.apps.recordings.stored import stored_beyond, stored_results
from sinew.measure.errors import FileError

if TYPE_CHECKING:
    import xarray as xr

    from sinew.paper.answers.answer import Answer
    from sinew.plan.rig import RigSpec

_WIDTH = 100


def answer(
    file: Annotated[Path, typer.Argument(metavar="RECORDING", help="A recording of Sinew (NetCDF).")],
    out: Annotated[Path | None, option("--out", "DIR", "Folder for the page; the recording's own by default.")] = None,
    rig: Annotated[str | None, option("--rig", "RIG", "A rig; else the recording's.")] = None,
    json: Json = False,
) -> None:
    """Answer the paper's open questions from a recording: numbers with intervals, and what cannot be told.

    Writes answers.html, answers.json and the figures of the answers. results.nc and beyond.nc beside the recording are
    taken up where they belong to it. A whole campaign takes about a minute or two.
    """
    from sinew.analysis.analysed import analyse_with, recording_rig
    from sinew.measure.files.netcdf import load_recording
    from sinew.paper.answers.questions import answer_questions

    if not file.is_file():
        raise FileError(
            f"found no recording {file}; expected a file that sinew simulate, run, import or reproduce wrote"
        )
    folder = require_folder(out if out is not None else file.parent)
    recording = load_recording(file)
    rig_ = recording_rig(recording, rig)
    results = stored_results(file.parent / "results.nc", recording, rig_)
    if results is None:
        with progress_bar("analyse"):
            results = analyse_with(recording, rig_)
    with progress_bar("answer") as progress:
        answers = answer_questions(
            recording,
            results,
            rig_,
            beyond=stored_beyond(file.parent / "beyond.nc", rig_),
            progress=lambda _step, done, total: progress(done, total),
        )
    document = _write(answers, recording, rig_, folder, _rebuild(file, out, rig))
    if json:
        print_json(document)
    else:
        _print(answers, folder)


def _rebuild(file: Path, out: Path | None, rig: str | None) -> str:
    options = (("--out", str(out)) if out is not None else ()) + (("--rig", rig) if rig is not None else ())
    return shlex.join(["sinew", "answer", str(file), *options])


def _write(
    answers: "list[Answer]", recording: "xr.Dataset", rig: "RigSpec | None", folder: Path, rebuild: str
) -> dict[str, Any]:
    from sinew.measure.files.netcdf import content_hash
    from sinew.paper.answers.figures import draw_answers
    from sinew.paper.report import write_answers

    figures = draw_answers(answers, folder / "figures")
    document = {
        "recording_hash": str(recording.attrs.get("content_hash") or content_hash(recording)),
        "rig": "" if rig is None else rig.name,
        "answers": [one.to_json() for one in answers],
    }
    write_json(document, folder / "answers.json")
    write_answers(folder, answers, recording=recording, figures=figures, rebuild=rebuild)
    return document


def _print(answers: "list[Answer]", folder: Path) -> None:
    print_table(("question", "answer"), [(one.question, one.verdict) for one in answers])
    for one in answers:
        for sentence in one.sentences[:2]:
            print(textwrap.fill(sentence, _WIDTH, initial_indent="- ", subsequent_indent="  "))
    print(f"page: {folder / 'answers.html'}")
