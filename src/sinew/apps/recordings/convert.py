"""`sinew look`, `sinew import` and `sinew export`: other programs' files, looked into, read and written."""

from pathlib import Path
from typing import Annotated, Any

import typer

from sinew.apps import console
from sinew.apps.console import Json, option


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
