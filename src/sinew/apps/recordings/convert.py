"""`sinew look`, `import`, `export`, `table` and `film`: files for and of other programs, looked into and written."""

import json as json_
from pathlib import Path
from typing import Annotated, Any, cast, get_args

import typer

from sinew.apps import console
from sinew.apps.console import Json, option
from sinew.measure.errors import FileError, SpecError


def look(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A table of any lab, or a recording of Sinew.")],
    run: console.Run = None,
    columns: console.Columns = None,
    rate: console.Rate = None,
    json: Json = False,
) -> None:
    """Tell what is in a file: format, runs, columns with their units, rate, gaps, and the command to go on with.

    Text in any dialect (preambles, units below the header, decimal commas, no header at all), LabVIEW .lvm, MATLAB
    .mat, HDF5, TDMS, UFF 58, Excel, Parquet, MCAP.
    """
    from sinew.measure.read import look as find

    found = find(file, run=run, columns=columns, rate_hz=rate)
    console.print_result(found.document, found.told(), json=json)


def import_(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A table: text in any dialect, or another program's.")],
    out: Annotated[Path, option("FILE", "The recording to write, NetCDF.")],
    time: console.ColumnTime = None,
    response: console.ColumnResponse = None,
    drive: console.ColumnDrive = None,
    kind: Annotated[str, option(console.KINDS, "What was recorded; auto leaves it to analyse to find out.")] = "auto",
    start: console.Start = None,
    stop: console.Stop = None,
    gaps: console.Gaps = "refuse",
    run: console.Run = None,
    columns: console.Columns = None,
    rate: console.Rate = None,
    json: Json = False,
) -> None:
    """Turn somebody's file into a recording: text in any dialect, MATLAB, HDF5, TDMS, UFF 58, Excel, Parquet, MCAP.

    Units: after the column (angle:deg, stamp:ms), else from its name (angle_deg, x [mm]), else seconds for the time and
    none for the rest.
    """
    from sinew.measure.files.netcdf import save_recording

    recording = console.read_csv(file, kind, time, response, drive, start, stop, gaps, run, columns, rate)
    save_recording(recording, console.require_file(out))
    notes = [note for note in str(recording.attrs.get("import_notes", "")).splitlines() if note]
    document: dict[str, Any] = {
        "recording": str(out),
        "segments": recording.sizes["segment"],
        "samples": recording.sizes["sample"],
        "notes": notes,
    }
    if json:
        console.print_json(document)
        return
    print(f"{out}: {document['samples']} samples in {document['segments']} segments")
    for note in notes:
        console.remark(note)


def export(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A recording, NetCDF.")],
    to: Annotated[str, option("csv|mat|parquet|uff|mcap", "The format to write.")],
    out: Annotated[Path, option("PATH", "The file to write.")],
    json: Json = False,
) -> None:
    """Write a recording for other programs: CSV or Parquet table, MATLAB, UFF 58, MCAP (Foxglove, PlotJuggler)."""
    from sinew.measure.files.export import EXPORTS, export_recording
    from sinew.measure.files.netcdf import load_recording

    console.check_choice("--to", to, EXPORTS)
    recording = load_recording(file)
    export_recording(recording, console.require_file(out), to)
    document = {"file": str(out), "format": to, "samples": recording.sizes["sample"]}
    console.print_result(document, [f"{out}: {recording.sizes['sample']} samples"], json=json)


# Results as tables.


def table(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="RESULT",
            help="What --json of a command printed (.json), results or a recording (.nc), or the folder of its --out.",
        ),
    ],
    to: Annotated[str, option("latex|csv", "The format, where --out does not say it.")] = "latex",
    part: Annotated[str | None, option("NAME,...", "Only these tables, as resonance or ring_down.")] = None,
    columns: Annotated[
        str | None, option("NAME,...", "Only these columns, in this order, as pretension_mm,resonance_hz.")
    ] = None,
    out: Annotated[Path | None, option("FILE", "Write .tex, or .csv (one file for each table); else print.")] = None,
    json: Json = False,
) -> None:
    """Write tables of results with their uncertainties: LaTeX (booktabs, longtable, siunitx) or CSV.

    Resonances, damping, response and energy of a recording, the mechanics of a fit, the paper's numbers beside the
    measured ones: every table that a result's document has. In LaTeX a number is 3.021(20), in CSV its standard
    deviation and 90 % interval have columns.
    """
    from sinew.measure.files.tables import (
        FORMATS,
        csv_table,
        export_table,
        is_wide,
        latex_table,
        table_files,
        tables_of,
    )

    console.check_choice("--to", to, tuple(FORMATS))
    if out is not None:
        if out.suffix not in FORMATS.values():
            raise SpecError(f"--out is {out}, expected a name that ends with {' or '.join(FORMATS.values())}")
        console.writable_file(out)
    document = _result_document(source)
    parts, chosen = ([] if names is None else [name.strip() for name in names.split(",")] for names in (part, columns))
    tables = tables_of(document, parts, chosen)
    in_latex = not json and (FORMATS[to] if out is None else out.suffix) == FORMATS["latex"]
    if wide := [one.name for one in tables if in_latex and is_wide(one)]:
        console.remark(f"wider than a page: {', '.join(wide)}; --columns chooses what they have")
    if out is not None:
        for file in table_files(out, tables):
            console.require_file(file)
        files = export_table(document, out, parts, chosen)
        told = [f"{file}" for file in files]
        names = [one.name for one in tables]
        console.print_result({"files": [str(file) for file in files], "parts": names}, told, json=json)
    elif json:
        console.print_json({"parts": [one._asdict() for one in tables]})
    elif to == "latex":
        print("\n".join(latex_table(one) for one in tables), end="")
    else:
        several = len(tables) > 1
        print("\n".join((f"# {one.name}\n" if several else "") + csv_table(one) for one in tables), end="")


def _result_document(source: Path) -> dict[str, Any]:
    """Return the document of a result: of a file of JSON, of results, of a recording, of a campaign's folder, whose
    summary has the paper's numbers, or of the folder that a command made with --out."""
    from sinew.analysis.analysed import analyse, results_document
    from sinew.measure.errors import SchemaError
    from sinew.measure.files.netcdf import load_results

    if source.is_dir():
        found: dict[str, Any] = {}
        if (source / "results.nc").is_file():
            found |= results_document(load_results(source / "results.nc"))
        if (source / "summary.json").is_file():
            found["paper"] = _read_json(source / "summary.json").get("paper", [])
        documents = [] if found else sorted(source.glob("*.json"))
        if len(documents) == 1:  # what --out of analyse, identify, predict, design, ... leaves
            return _read_json(documents[0])
        if not found:
            said = " and ".join(one.name for one in documents) or "no results.nc, summary.json or other document"
            raise FileError(f"found {said} in {source}, expected the results of one command; name a file in it")
        return found
    if source.suffix == ".json":
        return _read_json(source)
    try:
        return results_document(load_results(source))
    except SchemaError:
        return analyse(source).document


def _read_json(path: Path) -> dict[str, Any]:
    try:
        document = json_.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FileError(f"cannot read {path} as JSON: {error}") from error
    if not isinstance(document, dict):
        raise FileError(f"{path} is no result's document, which is one JSON object")
    return document


# A recording as a film.


def film(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A recording, NetCDF.")],
    out: Annotated[Path, option("FILE", "The film: .gif or .webp; .mp4 or .webm where ffmpeg is installed.")],
    kind: Annotated[str, option("decay|sweep", "A ring-down, or the drive frequencies of one pretension.")] = "decay",
    pretension: Annotated[float, option("MM", "The pretension to show, or the closest one.", "--pretension-mm")] = 0.0,
    speed: Annotated[float, option("X", "How fast it plays: 1 as it was, 0.25 four times slower.")] = 1.0,
    frames: Annotated[int, option("N", "Pictures in a second.", "--frames-per-s")] = 25,
    json: Json = False,
) -> None:
    """Film a recording: the joint as it swings, its amplitude, and its motion over itself (the paper's Video S1)."""
    from sinew.figures.film import FilmKind, save_film
    from sinew.measure.files.netcdf import load_recording

    console.check_choice("--kind", kind, get_args(FilmKind))
    if not (0 < speed <= 100 and 1 <= frames <= 100):
        raise SpecError(f"found --speed {speed:g} and --frames-per-s {frames}; expected 0 to 100 and 1 to 100")
    console.require_file(out)
    recording = load_recording(file)
    with console.progress_bar("film") as progress:
        count = save_film(
            recording,
            out,
            cast(FilmKind, kind),
            pretension,
            frames_per_s=frames,
            speed=speed,
            progress=progress,
        )
    document = {"film": str(out), "kind": kind, "frames": count, "lasts_s": count / frames}
    console.print_result(document, [f"{out}: {count} frames, {count / frames:.1f} s"], json=json)
