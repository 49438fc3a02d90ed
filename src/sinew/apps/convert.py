"""This is where `sinew import` and `sinew export` carry recordings in and out of other programs' files."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import typer

from sinew.apps.console import (
    ColumnDrive,
    ColumnResponse,
    ColumnTime,
    Gaps,
    Json,
    Start,
    Stop,
    option,
    print_json,
    remark,
    require_file,
)
from sinew.measure.errors import SpecError, TimeError

if TYPE_CHECKING:
    import xarray as xr


def read_csv(
    file: Path,
    kind: str,
    time: str | None,
    response: str | None,
    drive: str | None,
    start: float | None,
    stop: float | None,
    gaps: str,
) -> "xr.Dataset":
    """Return a CSV file as a recording, with the words of the command line checked. Raises SinewError."""
    from sinew.measure.csv import import_csv  # pandas and xarray: not for --help

    if time is None or response is None:
        missing = "--time" if time is None else "--response"
        raise SpecError(f"{file.name} is a table: name its columns; {missing} COL is missing")
    _one_of("--kind", kind, ("ring-down", "sweep"))
    _one_of("--gaps", gaps, ("refuse", "split"))
    return import_csv(
        file,
        time=time,
        response=response,
        drive=drive,
        kind=cast(Literal["ring-down", "sweep"], kind),
        start_s=start,
        stop_s=stop,
        gaps=cast(Literal["refuse", "split"], gaps),
    )


def _one_of(option: str, found: str, expected: tuple[str, ...]) -> None:
    if found not in expected:
        raise SpecError(f"{option} is {found!r}, expected {' or '.join(expected)}")


def import_(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A CSV file.")],
    out: Annotated[Path, option("--out", "FILE", "The recording to write, NetCDF.")],
    time: ColumnTime = None,
    response: ColumnResponse = None,
    drive: ColumnDrive = None,
    kind: Annotated[str, option("--kind", "ring-down|sweep", "What was recorded.")] = "ring-down",
    start: Start = None,
    stop: Stop = None,
    gaps: Gaps = "refuse",
    json: Json = False,
) -> None:
    """Turn a CSV file into a recording.

    Units: after the column (angle:deg, stamp:ms), else from its name (angle_deg, x [mm]), else seconds for the time and
    none for the rest.
    """
    from sinew.measure.netcdf import save_recording

    recording = read_csv(file, kind, time, response, drive, start, stop, gaps)
    save_recording(recording, require_file(out))
    notes = [note for note in str(recording.attrs.get("import_notes", "")).splitlines() if note]
    document: dict[str, Any] = {
        "recording": str(out),
        "segments": recording.sizes["segment"],
        "samples": recording.sizes["sample"],
        "notes": notes,
    }
    if json:
        print_json(document)
        return
    print(f"{out}: {document['samples']} samples in {document['segments']} segments")
    for note in notes:
        remark(note)


def export(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A recording, NetCDF.")],
    to: Annotated[str, option("--to", "csv|mat", "The format to write.")],
    out: Annotated[Path, option("--out", "PATH", "The file to write.")],
    json: Json = False,
) -> None:
    """Write a recording as a CSV table or a MATLAB file."""
    _one_of("--to", to, ("csv", "mat"))
    from sinew.measure.netcdf import load_recording

    recording = load_recording(file)
    require_file(out)
    if to == "csv":
        from sinew.measure.csv import export_csv

        export_csv(recording, out)
    else:
        from sinew.measure.netcdf import export_mat

        export_mat(recording, out)
    if json:
        print_json({"file": str(out), "format": to, "samples": recording.sizes["sample"]})
    else:
        print(f"{out}: {recording.sizes['sample']} samples")


# An imported recording is cut to the stretch of time that the user names.


def cut_recording(recording: "xr.Dataset", start_s: float | None, stop_s: float | None) -> "xr.Dataset":
    """Return the samples of an imported recording from start_s to stop_s, both included [s]; None leaves an end open.

    The times are those of the recording, as in the file it came from. Segments without a sample left are dropped, and
    `import_notes` tells of the cut. Raises SpecError for a recording that was not imported, whose segments mean
    something, and TimeError where start is not before stop or nothing is left.
    """
    if start_s is None and stop_s is None:
        return recording
    import numpy as np

    from sinew.measure.recording import segment_slices
    from sinew.measure.schema import validate_recording

    if recording.attrs.get("source") != "import":
        raise SpecError(
            "--start and --stop choose a stretch of a CSV file or of an imported recording; this one is a campaign "
            "whose segments are analysed whole; leave them out"
        )
    start, stop = (-math.inf if start_s is None else start_s), (math.inf if stop_s is None else stop_s)
    if not start < stop:
        raise TimeError(f"found start {start:g} s and stop {stop:g} s, expected start before stop")
    time = recording["time_s"].values
    kept = (time >= start) & (time <= stop)
    if not kept.any():
        raise TimeError(
            f"no samples from {start:g} s to {stop:g} s; the recording runs from {time.min():g} s to {time.max():g} s"
        )
    sizes = np.array([int(kept[where].sum()) for where in segment_slices(recording)], dtype=np.int64)
    cut = recording.isel(sample=np.flatnonzero(kept), segment=np.flatnonzero(sizes))
    cut["row_size"] = ("segment", sizes[sizes > 0], recording["row_size"].attrs)
    note = f"cut to {time[kept].min():g} to {time[kept].max():g} s"
    told = str(recording.attrs.get("import_notes", ""))
    cut.attrs = {k: v for k, v in recording.attrs.items() if k != "content_hash"} | {
        "import_notes": f"{told}\n{note}" if told else note
    }
    return validate_recording(cut)
