"""`sinew analyse`: a recording becomes resonance and damping; and whose current its motors tell."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from sinew.apps import console
from sinew.apps.console import Json, option
from sinew.measure.errors import SinewError, SpecError

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from sinew.analysis.results import Analysed
    from sinew.measure.recording import ReadKind

_KINDS = f"{console.KINDS}|current"


def analyse(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A table of any lab, or a recording of Sinew (NetCDF).")],
    kind: Annotated[
        str | None,
        option(_KINDS, "What a table holds; without it, auto finds out. current: of a bench's recording, see below."),
    ] = None,
    time: console.ColumnTime = None,
    response: console.ColumnResponse = None,
    drive: console.ColumnDrive = None,
    start: console.Start = None,
    stop: console.Stop = None,
    gaps: console.Gaps = "refuse",
    run: console.Run = None,
    columns: console.Columns = None,
    rate: console.Rate = None,
    settle: console.Settle = None,
    from_hz: Annotated[float | None, option("HZ", "Broadband, impact: seek modes from here on; else found.")] = None,
    to_hz: Annotated[float | None, option("HZ", "Broadband, impact: seek modes up to here; else found.")] = None,
    modes: Annotated[int | None, option("N", "How many modes; else as many as show.")] = None,
    segment: Annotated[
        float | None, option("S", "Broadband, impact: length of a segment, or behind a hit [s]; else by the record.")
    ] = None,
    rig: Annotated[str | None, option("RIG", "A rig: inertia and sensor delays; else the recording's.")] = None,
    out: Annotated[Path | None, option("DIR", "Folder for recording, results, JSON and figures.")] = None,
    json: Json = False,
) -> None:
    """Turn a recording or a table into resonance and damping.

    It may hold a ring-down, a sweep, a broadband record, hammer blows, or a whole campaign. A ring-down gives
    frequency and damping with intervals, by the paper's method and by a direct fit; a sweep gives the table of gain
    and phase, and from six frequencies on the resonance; a broadband record (chirp, noise, multisine) and one of
    hammer blows (impact) give their frequency response with coherence, and the modes in it. A resonance that was
    tracked gives where it was, with what lag, and its figure. Without --kind it is found out which of these a table
    holds, and said with the reason. A time that is the only one by its name, and a response that is the only other
    column of numbers, need not be named; `sinew look` tells what is in a file. With --kind current a recording of a
    bench tells whether Present Current is the motor's or its supply's, motor by motor. At the same torque the
    motor's current stays where the duty changes, the supply's goes with it: the answer is the exponent of the duty
    with a 90 % interval, 0 for the motor's and 1 for the supply's, or undetermined. The plan `current` moves all
    motors so that it can be told.
    """
    if kind == "current":
        _current(file, rig, json=json)
        return
    from sinew.analysis.analysed import analyse as find
    from sinew.measure.files.netcdf import load_recording
    from sinew.measure.read import is_recording
    from sinew.measure.recording import cut_recording

    if kind is not None:
        console.check_choice("--kind", kind, _KINDS.split("|"))
    if out is not None:
        console.require_folder(out)
    if is_recording(file):
        _refuse_columns(time, response, drive, run, columns, rate, None if gaps == "refuse" else gaps)
        recording = cut_recording(load_recording(file), start, stop)
    else:
        recording = console.read_csv(file, kind or "auto", time, response, drive, start, stop, gaps, run, columns, rate)
    if out is not None:
        console.require_own(out, "recording.nc", lambda there: _is_own(there, file, recording))
    found = find(
        recording,
        rig,
        settle_s=settle,
        kind=cast("ReadKind | None", kind),
        band_hz=_band(from_hz, to_hz),
        modes=modes,
        segment_s=segment,
    )
    if out is not None:
        _write(found, out)
    console.print_result(found.to_dict(), found.blocks(), json=json)
    for note in found.notes:
        console.remark(note)


def _band(from_hz: float | None, to_hz: float | None) -> tuple[float, float] | None:
    if from_hz is None and to_hz is None:
        return None
    if from_hz is None or to_hz is None:
        raise SpecError("a band has two ends; name --from-hz and --to-hz, or neither")
    return console.checked_band((from_hz, to_hz))


def _refuse_columns(*given: object) -> None:
    if any(value is not None for value in given):
        raise SpecError(
            "a recording knows its columns and its gaps; --time, --response, --drive, --run, --columns, --rate and "
            "--gaps are for tables"
        )


def _is_own(there: Path, file: Path, recording: "xr.Dataset") -> bool:
    """Return whether a recording that is there loses nothing: it is the same one, or was made of a table before."""
    from sinew.measure.files.netcdf import content_hash, load_recording

    try:
        earlier = load_recording(there)
    except SinewError:
        return False
    made = earlier.attrs.get("source") == "import" and not there.samefile(file)
    return made or content_hash(earlier) == content_hash(recording)


def _write(found: "Analysed", folder: Path) -> None:
    from sinew.measure.files.netcdf import save_dataset, save_recording

    save_recording(found.recording, folder / "recording.nc")
    if found.dataset is not None:
        save_dataset(found.dataset, folder / "results.nc")
    document = found.to_dict()
    console.write_json(document, folder / "analysis.json")
    if "tracking" in document:
        from sinew.figures.tuned import save_tracking

        save_tracking(document["tracking"], folder)
    for name, figure in _figures(found).items():
        from sinew.figures.style import save_figure

        save_figure(figure, folder, name, ("png", "pdf"))


def _figures(found: "Analysed") -> "dict[str, Figure]":
    """Return the figures of what was found by name: of many frequencies or hammer blows one, else response and decay,
    each where there is one."""
    from sinew.analysis.analysed import analyse_recording
    from sinew.analysis.results import RingDownResult, SpectrumResult
    from sinew.figures.decay import draw_decay
    from sinew.figures.response import draw_broadband, draw_response

    if isinstance(found, SpectrumResult):
        document = found.to_dict()
        return {str(document["kind"]): draw_broadband(document)}
    if found.dataset is None and not isinstance(found, RingDownResult):
        return {}
    results = analyse_recording(found.recording) if found.dataset is None else found.dataset
    drawn = {"response": draw_response(results), "decay": draw_decay(found.recording, results)}
    return {name: figure for name, figure in drawn.items() if figure is not None}


def _current(file: Path, rig: str | None, *, json: bool) -> None:
    """Print whose current the motors of a recording tell, their own or their supply's."""
    from sinew.analysis.analysed import recording_rig
    from sinew.analysis.signal.motors import sense_currents
    from sinew.measure.files.netcdf import load_recording

    recording = load_recording(file)
    used = recording_rig(recording, rig)
    if used is None:
        raise SpecError(f"{file} names no rig, expected one for the unit of the current; name it with --rig")
    found = sense_currents(recording, used.tendons.current_lsb.value)
    console.print_result(found.to_dict(), found.blocks(), json=json)
