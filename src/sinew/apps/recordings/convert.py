"""`sinew look`, `import` and `export`: files for and of other programs, looked into and written."""

import json as json_
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps import console
from sinew.apps.console import Json, option
from sinew.measure.errors import FileError, SchemaError, SpecError

if TYPE_CHECKING:
    import xarray as xr


def look(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A table of any lab, or a recording of Sinew.")],
    run: console.Run = None,
    columns: console.Columns = None,
    rate: console.Rate = None,
    json: Json = False,
) -> None:
    """Tell what is in a file, and the command to go on with.

    Format, runs, columns with their units, rate and gaps are listed. Text in any dialect (preambles, units below
    the header, decimal commas, no header at all), LabVIEW .lvm, MATLAB .mat, HDF5, TDMS, UFF 58, Excel, Parquet,
    MCAP.
    """
    from sinew.measure.read import look as find

    found = find(file, run=run, columns=columns, rate_hz=rate)
    console.print_result(found.to_dict(), found.blocks(), json=json)


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
    """Turn a table of any lab into a recording.

    Text in any dialect, MATLAB, HDF5, TDMS, UFF 58, Excel, Parquet, MCAP. Units: after the column (angle:deg,
    stamp:ms), else from its name (angle_deg, x [mm]), else seconds for the time and none for the rest.
    """
    from sinew.measure.files.netcdf import save_recording
    from sinew.measure.read import is_recording

    if is_recording(file):
        raise SpecError(f"{file} is NetCDF, as recordings of Sinew are; analyse that, or export another's as CSV")
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
    source: Annotated[
        Path,
        typer.Argument(
            metavar="SOURCE",
            help="A recording or results (.nc), what --json of a command printed (.json), the folder of its --out, or "
            "of a run.",
        ),
    ],
    to: Annotated[str, option("csv|mat|parquet|uff|mcap|latex|foxglove", "The format to write.")],
    out: Annotated[Path | None, option("PATH", "The file to write; without it, tables are printed.")] = None,
    part: Annotated[str | None, option("NAME,...", "Of results: only these tables, as resonance or ring_down.")] = None,
    columns: Annotated[
        str | None, option("NAME,...", "Of results: only these columns, in this order, as pretension_mm,resonance_hz.")
    ] = None,
    port: Annotated[
        int, option("N", "Foxglove: port of the web socket on this machine; 0 takes a free one.", "--ws-port")
    ] = 8765,
    back: Annotated[float, option("S", "Foxglove: send first what was measured so long before.", "--back-s")] = 10.0,
    until_end: Annotated[
        bool, typer.Option("--until-end/--wait", help="Foxglove: leave when the run is over, or go on until Ctrl-C.")
    ] = False,
    json: Json = False,
) -> None:
    """Write a recording or results for other programs.

    The samples of a recording: CSV or Parquet table, MATLAB, UFF 58, MCAP (Foxglove, PlotJuggler). Tables of results
    with their uncertainties: LaTeX (booktabs, longtable, siunitx), where a number is 3.021(20), or CSV, where its
    standard deviation and 90 % interval have columns. --to csv of a recording writes its samples; with --part, tables.
    --to foxglove streams a run as it goes, over Foxglove's web socket, on this machine only: the journal is read, the
    bench is never touched, and nothing can be sent back.
    """
    from sinew.measure.files.formats import EXPORTS, export_recording

    console.check_choice("--to", to, (*EXPORTS, "latex", "foxglove"))
    if to == "foxglove":
        if out is not None:
            raise SpecError("found --out with --to foxglove, which writes no file; leave it out")
        from sinew.apps.bench.stream import stream_run

        stream_run(source, port, back, until_end=until_end, json=json)
        return
    recording = None if to == "latex" or (to == "csv" and (part or columns)) else _recording(source, to)
    if recording is None:
        _export_tables(source, to, part, columns, out, json=json)
        return
    if out is None:
        raise SpecError(f"found --to {to} without --out; name the file to write")
    export_recording(recording, console.require_file(out), to)
    document = {"file": str(out), "format": to, "samples": recording.sizes["sample"]}
    console.print_result(document, [f"{out}: {recording.sizes['sample']} samples"], json=json)


def _recording(source: Path, to: str) -> "xr.Dataset | None":
    """Return the recording that a file is, or None of results that --to csv writes as tables."""
    from sinew.measure.files.netcdf import load_recording

    if to == "csv" and (source.is_dir() or source.suffix == ".json"):
        return None
    try:
        return load_recording(source)
    except SchemaError:
        if to == "csv":
            return None
        raise


def _export_tables(
    source: Path, to: str, part: str | None, columns: str | None, out: Path | None, *, json: bool
) -> None:
    """Write tables of results, or print them where no file is named."""
    from sinew.measure.files.tables import (
        FORMATS,
        csv_table,
        export_table,
        is_wide,
        latex_table,
        table_files,
        tables_of,
    )

    if out is not None:
        if out.suffix != FORMATS[to]:
            raise SpecError(f"--out is {out}, expected a name that ends with {FORMATS[to]}")
        console.writable_file(out)
    document = _result_document(source)
    parts, chosen = ([] if names is None else [name.strip() for name in names.split(",")] for names in (part, columns))
    tables = tables_of(document, parts, chosen)
    if not json and to == "latex" and (wide := [one.name for one in tables if is_wide(one)]):
        console.remark(f"wider than a page: {', '.join(wide)}; --columns chooses what they have")
    if out is not None:
        for file in table_files(out, tables):
            console.require_file(file)
        files = export_table(document, out, parts, chosen)
        lines = [f"{file}" for file in files]
        names = [one.name for one in tables]
        console.print_result({"files": [str(file) for file in files], "parts": names}, lines, json=json)
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
    from sinew.analysis.analysed import analyse, recording_result
    from sinew.measure.files.netcdf import load_results

    if source.is_dir():
        found: dict[str, Any] = {}
        if (source / "results.nc").is_file():
            found |= recording_result(load_results(source / "results.nc")).to_dict()
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
        return recording_result(load_results(source)).to_dict()
    except SchemaError:
        return analyse(source).to_dict()


def _read_json(path: Path) -> dict[str, Any]:
    try:
        document = json_.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FileError(f"cannot read {path} as JSON: {error}") from error
    if not isinstance(document, dict):
        raise FileError(f"{path} is no result's document, which is one JSON object")
    return document
