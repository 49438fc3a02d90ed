"""This is where `sinew analyse` turns a recording, or somebody's CSV file, into resonance and damping."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps.console import print_json, print_table, remark, require_folder, write_json
from sinew.apps.convert import read_csv
from sinew.apps.options import ColumnDrive, ColumnResponse, ColumnTime, Gaps, Json, Start, Stop
from sinew.measure.errors import RecordingError, SpecError

if TYPE_CHECKING:
    import xarray as xr

    from sinew.plan.rig import RigSpec

__all__ = ["analyse", "recording_rig"]

_HDF5, _CLASSIC = b"\x89HDF", b"CDF"


def analyse(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A CSV file, or a recording of Sinew (NetCDF).")],
    kind: Annotated[
        str | None, typer.Option("--kind", metavar="ring-down|sweep", help="What a CSV file holds.")
    ] = None,
    time: ColumnTime = None,
    response: ColumnResponse = None,
    drive: ColumnDrive = None,
    start: Start = None,
    stop: Stop = None,
    gaps: Gaps = "refuse",
    rig: Annotated[
        str | None, typer.Option("--rig", metavar="RIG", help="A rig: inertia and sensor delays; else the recording's.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder for recording.nc, results.nc and analysis.json.")
    ] = None,
    json: Json = False,
) -> None:
    """Analyse a ring-down, a sweep or a whole recording.

    A ring-down gives frequency and damping with intervals, by the paper's method and by a direct fit; a sweep gives
    the table of gain and phase.
    """
    if out is not None:
        require_folder(out)
    if _is_recording(file):
        _refuse_columns(time, response, drive, start, stop, kind)
        document, parts = _analyse_recording(file, rig)
    elif kind is None:
        raise SpecError(f"{file.name} is a table: say what it holds with --kind ring-down or --kind sweep")
    else:
        recording = read_csv(file, kind, time, response, drive, start, stop, gaps)
        document, parts = _analyse_table(recording, kind, rig, has_drive=drive is not None)
    if out is not None:
        _write(document, parts, out)
    if json:
        print_json(document)
    else:
        _print(document, parts["recording.nc"])
    for note in str(parts["recording.nc"].attrs.get("import_notes", "")).splitlines():
        remark(note)


def recording_rig(recording: "xr.Dataset", rig: str | None) -> "RigSpec":
    """Return the rig that the user named, else the one in the recording. Raises SpecError where there is neither."""
    from sinew.plan.toml import load_rig, parse_rig

    if rig is not None:
        return load_rig(rig)
    if not recording.attrs.get("rig"):
        raise SpecError("the recording names no rig; say which with --rig RIG")
    return parse_rig(str(recording.attrs["rig"]), source="the recording's rig")


def _is_recording(file: Path) -> bool:
    if file.suffix == ".nc":
        return True
    if not file.is_file():
        return False
    with file.open("rb") as opened:
        head = opened.read(4)
    return head == _HDF5 or head[:3] == _CLASSIC


def _refuse_columns(*given: object) -> None:
    if any(value is not None for value in given):
        raise SpecError(
            "a recording knows its columns; --kind, --time, --response, --drive, --start, --stop are for CSV"
        )


def _analyse_recording(file: Path, rig: str | None) -> tuple[dict[str, Any], dict[str, "xr.Dataset"]]:
    from sinew.measure.netcdf import load_recording

    recording = load_recording(file)
    kinds = set(map(str, recording["kind"].values))
    if recording.attrs.get("source") == "import":
        kind = "ring-down" if "ring-down" in kinds else "sweep"
        return _analyse_table(recording, kind, rig, has_drive="drive" in recording or "drive_rad" in recording)
    from sinew.analysis.analysis import analyse_recording, response_table_json

    results = analyse_recording(recording, recording_rig(recording, rig))
    document: dict[str, Any] = {"kind": "recording"}
    if "gain" in results:
        document["response"] = response_table_json(results)
    if "decay_rate_per_s" in results:
        document["ring_down"] = _decay_rows(results)
    return document, {"recording.nc": recording, "results.nc": results}


def _decay_rows(results: "xr.Dataset") -> list[dict[str, Any]]:
    """Return one row for each pretension: mean over the repeats, standard deviation and 90 % interval of that mean."""
    import numpy as np

    from sinew.measure.estimate import Estimate

    rows = []
    names = ("decay_frequency_hz", "decay_rate_per_s", "damping_ratio", "paper_decay_rate_per_s")
    for index, pretension in enumerate(results["pretension_mm"].values):
        row: dict[str, Any] = {"pretension_mm": float(pretension)}
        for name in names:
            found = results[name].values[index]
            found = found[np.isfinite(found)]
            if found.size:
                spread = float(np.std(found, ddof=1) / np.sqrt(found.size)) if found.size > 1 else float("nan")
                row[name] = Estimate.student(float(found.mean()), spread, found.size - 1).to_json()
        rows.append(row)
    return rows


def _analyse_table(
    recording: "xr.Dataset", kind: str, rig: str | None, *, has_drive: bool
) -> tuple[dict[str, Any], dict[str, "xr.Dataset"]]:
    if kind == "ring-down":
        return _analyse_ring_down(recording, rig), {"recording.nc": recording}
    if not has_drive:
        raise RecordingError("a sweep needs the drive beside the response; name its column with --drive COL[:unit]")
    from sinew.analysis.analysis import analyse_recording, response_table_json
    from sinew.analysis.groups import split_by_drive
    from sinew.plan.toml import load_rig

    grouped = split_by_drive(recording)
    results = analyse_recording(grouped, load_rig(rig) if rig else None)
    document = {"kind": "sweep", "response": response_table_json(results)}
    return document, {"recording.nc": grouped, "results.nc": results}


def _analyse_ring_down(recording: "xr.Dataset", rig: str | None) -> dict[str, Any]:
    """Return the answer for the longest part of a record; parts come from `--gaps split`."""
    from sinew.analysis.ring_down import analyse_ring_down, ring_down_json
    from sinew.measure.recording import segment_slices
    from sinew.plan.toml import load_rig

    slices = segment_slices(recording)
    longest = max(slices, key=lambda where: where.stop - where.start)
    time = recording["time_s"].values[longest]
    name = "torsion_rad" if "torsion_rad" in recording else "response"
    drive = next((recording[d].values[longest] for d in ("drive_rad", "drive") if d in recording), None)
    unit = str(recording[name].attrs["units"])
    inertia = None
    if rig is not None:
        parts = load_rig(rig).inertia
        inertia = parts.head.value + parts.lever.value
    result = analyse_ring_down(
        time,
        recording[name].values[longest],
        drive=drive,
        is_rate=unit == "rad/s",
        unit=unit,
        inertia_kg_m2=inertia,
    )
    if len(slices) > 1:
        remark(
            f"gaps split the record into {len(slices)} parts; the longest, {time[0]:g} to {time[-1]:g} s, is analysed; "
            "choose another with --start and --stop"
        )
    return dict(ring_down_json(result))


def _write(document: dict[str, Any], parts: dict[str, "xr.Dataset"], folder: Path) -> None:
    from sinew.measure.netcdf import save_dataset, save_recording

    for name, dataset in parts.items():
        (save_recording if name == "recording.nc" else save_dataset)(dataset, folder / name)
    write_json(document, folder / "analysis.json")


def _print(document: dict[str, Any], recording: "xr.Dataset") -> None:
    if document["kind"] == "ring-down":
        _print_ring_down(document, recording)
    for part in ("response", "ring_down"):
        if document.get(part):
            rows = document[part]
            columns = list(rows[0])
            print_table(columns, [[_cell(row.get(column)) for column in columns] for row in rows], part)


def _print_ring_down(document: dict[str, Any], recording: "xr.Dataset") -> None:
    print_table(
        ("ring-down, direct fit", "value", "std", "90 % interval"),
        [
            (label, *_estimate_cells(document[key]))
            for label, key in (
                ("frequency/Hz", "frequency_hz"),
                ("damping ratio", "damping_ratio"),
                ("decay rate/(1/s)", "decay_rate_per_s"),
            )
        ],
    )
    paper = document["paper_method"]
    print_table(("paper's method (Eq. 7)", "value"), [(key, _cell(value)) for key, value in paper.items()])
    name = "torsion_rad" if "torsion_rad" in recording else "response"
    print(f"exponential: {'yes' if document['exponential'] else 'no'}. {document['reason']}")
    print(f"drift of the rest position: {_cell(document['rest_drift'])} {recording[name].attrs['units']}")


def _estimate_cells(estimate: dict[str, Any]) -> tuple[str, str, str]:
    low, high = estimate["interval90"]
    return _cell(estimate["value"]), _cell(estimate["std"]), f"{_cell(low)} to {_cell(high)}"


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, dict) and "value" in value:
        return f"{_cell(value['value'])} ± {_cell(value['std'])}"
    return f"{value:.5g}" if isinstance(value, int | float) else str(value)
