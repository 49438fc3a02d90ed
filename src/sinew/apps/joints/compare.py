"""`sinew compare`: the predicted responses of several rigs beside each other."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps.console import Json, option, print_json, print_table, print_told, progress_bar, require_folder
from sinew.apps.joints.rig_asked import (
    Amplitude,
    Mode,
    Pretension,
    Without,
    rig_asked,
    words_of,
    write_comparison,
)
from sinew.measure.errors import SpecError
from sinew.measure.estimate import number

if TYPE_CHECKING:
    from sinew.predict.predicted import Predicted, RigAsked


def compare(
    rigs: Annotated[
        list[str], typer.Argument(metavar="RIG RIG...", help="Rigs: TOML files, or names of shipped ones.")
    ],
    pretension: Pretension = "0,4,8,12",
    amplitude: Amplitude = 20.0,
    mode: Mode = "position",
    without: Without = None,
    start: Annotated[float | None, option("--from-hz", "HZ", "Lowest frequency; else 1.")] = None,
    stop: Annotated[float | None, option("--to-hz", "HZ", "Highest frequency; else 6.")] = None,
    out: Annotated[Path | None, option("--out", "DIR", "Write figures and a page there.")] = None,
    json: Json = False,
) -> None:
    """Predict the response of several rigs and set them beside each other: tables, curves and maps of gain."""
    if len(rigs) < 2:
        raise SpecError(f"found {len(rigs)} rig, expected two or more; one alone is for sinew predict")
    asked = rig_asked(pretension, amplitude, mode, without, start, stop)
    if out is not None:
        require_folder(out)
    found = _predicted(rigs, asked)
    document: dict[str, Any] = {
        "amplitude_deg": amplitude,
        "rigs": [{"rig": one.rig.name, "source": rig, **one.document()} for rig, one in zip(rigs, found, strict=True)],
    }
    page = None
    if out is not None:
        page = write_comparison(found, document, out, _command(rigs, asked, out))
    if json:
        print_json(document)
        return
    _print(document, amplitude)
    if page is not None:
        print(f"page: {page}")


def _predicted(rigs: list[str], asked: "RigAsked") -> "list[Predicted]":
    from sinew.plan.toml import load_rig
    from sinew.predict.predicted import predict_rig

    loaded = [load_rig(rig) for rig in rigs]
    found = []
    with progress_bar("predict") as progress:
        for i, rig in enumerate(loaded):
            progress(i, len(loaded))
            found.append(predict_rig(rig, asked))
    return found


def _print(document: dict[str, Any], amplitude_deg: float) -> None:
    from sinew.predict.predicted import mark_cell, remarks_told

    rows = []
    for rig in document["rigs"]:
        for i, branch in enumerate(rig["branches"]):
            peak = branch["peak"]
            gain = number(None if peak is None else peak["amplitude_deg"] / amplitude_deg)
            folds = str(len(branch["folds"]))
            rows.append((rig["rig"] if i == 0 else "", f"{branch['pretension_mm']:g}", mark_cell(peak), gain, folds))
    print_table(("rig", "pretension/mm", "peak", "gain", "folds"), rows)
    for rig in document["rigs"]:
        held = sum(check["holds"] for check in rig["validity"])
        print(f"{rig['rig']}: {held} of {len(rig['validity'])} assumptions hold")
        print_told(remarks_told(rig, faults_only=True))


def _command(rigs: list[str], asked: "RigAsked", out: Path) -> str:
    return shlex.join(["sinew", "compare", *rigs, *words_of(asked), "--out", str(out)])
