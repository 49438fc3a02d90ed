"""This is where `sinew analyse` turns a recording, or somebody's CSV file, into resonance and damping."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps.console import (
    ColumnDrive,
    ColumnResponse,
    ColumnTime,
    Gaps,
    Json,
    Settle,
    Start,
    Stop,
    print_json,
    remark,
    require_folder,
    write_json,
)
from sinew.apps.convert import cut_recording, read_csv
from sinew.apps.tables import print_analysis
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import NORMAL_90

if TYPE_CHECKING:
    import xarray as xr

    from sinew.measure.estimate import Estimate
    from sinew.plan.rig import RigSpec

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
    settle: Settle = None,
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
    the table of gain and phase, and from six frequencies on the resonance.
    """
    if settle is not None and kind == "ring-down":
        raise SpecError("--settle is for a sweep; the decay of a ring-down is found by itself")
    if settle is not None and not 0 <= settle < math.inf:
        raise SpecError(f"--settle is {settle:g}, expected a time of 0 s or more")
    if out is not None:
        require_folder(out)
    if _is_recording(file):
        _refuse_columns(time, response, drive, kind)
        document, parts = _analyse_recording(file, rig, start, stop, settle)
    elif kind is None:
        raise SpecError(f"{file.name} is a table: say what it holds with --kind ring-down or --kind sweep")
    else:
        recording = read_csv(file, kind, time, response, drive, start, stop, gaps)
        document, parts = _analyse_table(recording, kind, rig, settle)
    if out is not None:
        _write(document, parts, out)
    if json:
        print_json(document)
    else:
        print_analysis(document, parts["recording.nc"], parts.get("results.nc"))
    for note in str(parts["recording.nc"].attrs.get("import_notes", "")).splitlines():
        remark(note)
    if "results.nc" in parts and "resonance" not in document and parts["results.nc"].attrs["resonance_notes"]:
        remark(str(parts["results.nc"].attrs["resonance_notes"]))


def recording_rig(recording: "xr.Dataset", rig: str | None) -> "RigSpec | None":
    """Return the rig that the user named, else the one in the recording, else None. Raises SpecError if it is bad."""
    from sinew.plan.toml import load_rig, parse_rig

    if rig is not None:
        return load_rig(rig)
    text = str(recording.attrs.get("rig", ""))
    return parse_rig(text, source="the recording's rig") if text.strip() else None


def analyse_with(recording: "xr.Dataset", rig: "RigSpec | None") -> "xr.Dataset":
    """Return the results of a recording; their attribute `rig` is the rig they were made with.

    rig: whose inertia and sensor delays are used; None for perfect sensors and no inertia.
    """
    from sinew.analysis.analysis import analyse_recording
    from sinew.plan.toml import dump_rig

    results = analyse_recording(recording, rig)
    return results if rig == recording_rig(recording, None) else results.assign_attrs(rig=dump_rig(rig) if rig else "")


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
        raise SpecError("a recording knows its columns; --kind, --time, --response, --drive are for CSV")


def _analyse_recording(
    file: Path, rig: str | None, start: float | None, stop: float | None, settle: float | None
) -> tuple[dict[str, Any], dict[str, "xr.Dataset"]]:
    from sinew.measure.netcdf import load_recording

    recording = cut_recording(load_recording(file), start, stop)
    if recording.attrs.get("source") == "import":
        kinds = set(map(str, recording["kind"].values))
        return _analyse_table(recording, "ring-down" if "ring-down" in kinds else "sweep", rig, settle)
    if settle is not None:
        raise SpecError("--settle is for the sweep of a foreign file; this recording says itself where it settles")
    results = analyse_with(recording, recording_rig(recording, rig))
    return results_document(results), {"recording.nc": recording, "results.nc": results}


def results_document(results: "xr.Dataset") -> dict[str, Any]:
    """Return the results of a recording as JSON holds them: response, resonance, energy, ring-downs, what there is."""
    from sinew.analysis.doubts import doubts_of

    document: dict[str, Any] = {"kind": "recording", "doubts": doubts_of(results), **_sweep_part(results)}
    if "decay_rate_per_s" in results:
        document["ring_down"] = decay_rows(results)
    return document


def _sweep_part(results: "xr.Dataset") -> dict[str, Any]:
    """Return the response table, and the resonances where there were frequencies enough for them."""
    from sinew.analysis.analysis import response_table_json

    if "gain" not in results:
        return {}
    part: dict[str, Any] = {"response": response_table_json(results)}
    part |= {"resonance": _interval_rows(results, _RESONANCE)} if "resonance_hz" in results else {}
    return part | (_energy_part(results) if "energy_reduction" in results else {})


def _energy_part(results: "xr.Dataset") -> dict[str, Any]:
    """Return what a swing costs, by pretension, and what the servos draw with their torque off (by data sheet)."""
    from sinew.measure.schema import ENERGY_QUANTITIES

    idle = float(results.attrs.get("idle_power_w", math.nan))
    rows = _interval_rows(results, ENERGY_QUANTITIES)
    return {"energy": {"idle_power_w": idle if math.isfinite(idle) else None, "pretensions": rows}}


_RESONANCE = (
    "paper_resonance_hz",
    "paper_gain_peak",
    "resonance_hz",
    "gain_peak",
    "gain_peak_measured_drive",
    "resonance_measured_drive_hz",
    "phase_90_hz",
    "half_power_width_hz",
    "drive_amplitude_at_resonance_rad",
)


def _interval_rows(results: "xr.Dataset", names: Sequence[str]) -> list[dict[str, Any]]:
    """Return one row for each pretension, each quantity with the standard deviation of its value and its interval."""
    import numpy as np

    from sinew.measure.schema import companions

    repeats = np.isfinite(results["gain"].values).any(axis=1).sum(axis=-1)
    rows = []
    for index, pretension in enumerate(results["pretension_mm"].values):
        row: dict[str, Any] = {"pretension_mm": float(pretension)}
        for name in names:
            std, low, high = (float(results[end].values[index]) for end in companions(name))
            row[name] = _of_mean(float(results[name].values[index]), std, low, high, int(repeats[index])).to_json()
        rows.append(row)
    return rows


def _of_mean(value: float, std: float, low: float, high: float, repeats: int) -> "Estimate":
    """Return an estimate whose std is that of the value, from the standard deviation over repeats that results keep.

    What the interval holds beyond Student's of the scatter (the delay budget) is shared by all repeats, and is added.
    """
    from scipy import special

    from sinew.measure.estimate import Estimate

    if repeats < 2 or not math.isfinite(high - low):
        return Estimate(value, std, low, high)
    own = std / math.sqrt(repeats)
    scatter = float(special.stdtrit(repeats - 1, 0.95)) * own
    shared = math.sqrt(max(0.0, (0.5 * (high - low)) ** 2 - scatter**2)) / NORMAL_90
    return Estimate(value, math.hypot(own, shared), low, high)


def decay_rows(results: "xr.Dataset") -> list[dict[str, Any]]:
    """Return one row for each pretension: mean over the repeats, standard deviation and 90 % interval of that mean.

    Where one repeat is left, the direct fit's own standard deviation and a normal interval.
    """
    import numpy as np

    from sinew.analysis.signal.repeats import combine_repeats
    from sinew.measure.estimate import Estimate

    rows: list[dict[str, Any]] = [{"pretension_mm": float(p)} for p in results["pretension_mm"].values]
    for name, own in _DECAY.items():
        values = results[name].values
        mean = combine_repeats(values, results[own].values if own else np.full(values.shape, np.nan))
        for row, numbers in zip(
            rows, zip(mean.value, mean.std_of_value, mean.low, mean.high, strict=True), strict=True
        ):
            if np.isfinite(numbers[0]):
                row[name] = Estimate(*map(float, numbers)).to_json()
    return rows


_DECAY = {
    "decay_frequency_hz": "decay_frequency_std_hz",
    "decay_rate_per_s": "decay_rate_std_per_s",
    "damping_ratio": "damping_ratio_std",
    "paper_decay_rate_per_s": "",
}


def _analyse_table(
    recording: "xr.Dataset", kind: str, rig: str | None, settle: float | None
) -> tuple[dict[str, Any], dict[str, "xr.Dataset"]]:
    if kind == "ring-down":
        if settle is not None:
            raise SpecError("--settle is for a sweep, this is a ring-down; its decay is found by itself")
        return _analyse_ring_down(recording, rig), {"recording.nc": recording}
    if "drive" not in recording and "drive_rad" not in recording:
        raise RecordingError("a sweep needs the drive beside the response; name its column with --drive COL[:unit]")
    from sinew.analysis.signal.groups import split_by_drive

    if settle is None:
        grouped = split_by_drive(recording)
    else:
        grouped = split_by_drive(recording, settle_s=settle)
        if grouped is recording:
            raise SpecError("--settle comes too late, the groups of this recording are cut already; leave it out")
    results = analyse_with(grouped, recording_rig(grouped, rig))
    return {"kind": "sweep", **_sweep_part(results)}, {"recording.nc": grouped, "results.nc": results}


def _analyse_ring_down(recording: "xr.Dataset", rig: str | None) -> dict[str, Any]:
    """Return the answer for the longest part of a record; parts come from `--gaps split`."""
    from sinew.analysis.decay.ring_down import analyse_ring_down, ring_down_json
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
