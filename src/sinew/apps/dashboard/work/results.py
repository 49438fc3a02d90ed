"""Results of a run, made once and read from then on."""

import json
import math
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sinew.apps.bench.bench_run import JOURNAL
from sinew.apps.dashboard.operators import CACHE, held_inside, unlinked
from sinew.apps.dashboard.work.live import LiveResults, mean_of, shared_delay
from sinew.apps.dashboard.work.runs import RECORDING
from sinew.bench.record.journal_reader import is_being_written
from sinew.measure.errors import FileError, SinewError, SpecError
from sinew.measure.estimate import finite

if TYPE_CHECKING:
    import xarray as xr


_RESULTS, _VERSION = "results.json", 2

_QUANTITIES = {
    "paper_resonance_hz": ("frequency of the largest mean of peaks (Eq. 6)", "Hz"),
    "resonance_hz": ("frequency of the largest fundamental", "Hz"),
    "gain_peak": ("largest gain", ""),
    "phase_90_hz": ("frequency of 90° of lag", "Hz"),
    "gain_peak_measured_drive": ("largest gain over the measured lever", ""),
    "half_power_width_hz": ("half-power width", "Hz"),
    "drive_amplitude_at_resonance_rad": ("lever amplitude at resonance", "°"),
    "energy_reduction": ("energy saved by the resonance", ""),
    "damping_ratio": ("Lehr's damping", ""),
    "decay_frequency_hz": ("frequency of the decay", "Hz"),
    "decay_rate_per_s": ("decay rate", "1/s"),
    "paper_stiffness_n_m_rad": ("stiffness ω² I", "N m/rad"),
    "paper_damping_n_m_s_rad": ("damping constant 2 λ I", "N m s/rad"),
}
"""Title and unit of what is found at each pretension."""


def run_results(folder: Path | str) -> dict[str, Any]:
    """Return what a run has found; the first time it is analysed, which writes results.nc and analysis.json beside it.

    `curves` and `damping` as of `LiveResults.update`; `parameters`: rows of `pretension_mm`, `quantity` (as in the
    results), `name` (in words), `estimate` (`{"value", "std", "interval90"}`) and `unit`; `document`: what `sinew
    analyse --json` says; `notes`: sentences. A run that is under way gives what its finished groups say.
    Raises SinewError where there is no recording, or it cannot be analysed.
    """
    folder = unlinked(Path(folder))
    journal, recording = folder / JOURNAL, folder / RECORDING
    if is_being_written(journal):
        found = LiveResults(journal, most_at_once=10**6).update()
        return {**found, "parameters": list(_of_decays(found["damping"])), "document": None, "doubts": []}
    recording_of(folder)
    about = recording.stat()
    stamp = [_VERSION, about.st_size, about.st_mtime_ns]
    kept = folder / CACHE / _RESULTS
    with suppress(OSError, ValueError, KeyError, TypeError):
        stored = json.loads(kept.read_text(encoding="utf-8"))
        if stored["stamp"] == stamp:
            return dict(stored["results"])
    results = _document(results_of(folder)[1])
    with suppress(SinewError, OSError):
        from sinew.apps.console import write_json

        kept.parent.mkdir(exist_ok=True)
        write_json({"stamp": stamp, "results": results}, kept)
    return results


def recording_of(folder: Path) -> Path:
    """Return the recording of a run, made from its journal where there is none yet.

    Raises FileError where there is neither, or the run is under way; RecordingError where no group is whole.
    """
    from sinew.bench.record.conversion import convert

    recording, journal = unlinked(folder) / RECORDING, folder / JOURNAL
    if recording.is_file():
        return recording
    if not journal.is_file():
        raise FileError(f"{folder.name} holds no run; expected a {JOURNAL} or a {RECORDING} in it")
    if is_being_written(journal):
        raise FileError(f"{folder.name} is still being recorded; its files can be had when it has ended")
    return convert(journal, recording)


def load_own(folder: Path) -> "xr.Dataset":
    """Return the recording of a run, read through no link. Raises as `recording_of` and `load_recording`."""
    from sinew.measure.files.netcdf import load_recording

    with held_inside(folder.parent, recording_of(folder)) as path:
        return load_recording(path)


def results_of(folder: Path) -> "tuple[xr.Dataset, xr.Dataset]":
    """Return (recording, results) of a run; results that belong to another recording are made anew."""
    from sinew.analysis.analysed import analyse_with, recording_rig, results_document
    from sinew.apps.console import write_json
    from sinew.apps.recordings.stored import stored_results
    from sinew.measure.files.netcdf import save_dataset

    recording = load_own(folder)
    rig = recording_rig(recording, None)
    results = stored_results(folder / "results.nc", recording, rig)
    if results is None:
        results = analyse_with(recording, rig)
        with suppress(FileError, OSError):  # in a folder that may not be written they are made anew each time
            save_dataset(results, folder / "results.nc")
            write_json(results_document(results), folder / "analysis.json")
    return recording, results


def _document(results: "xr.Dataset") -> dict[str, Any]:
    from sinew.analysis.analysed import results_document

    document = results_document(results)
    curves = list(_curves(results)) if "gain" in results else []
    decays = [row for row in document.get("ring_down", []) if "damping_ratio" in row]
    notes = [str(results.attrs.get(name, "")) for name in ("resonance_notes", "ring_down_notes")]
    return {
        "curves": curves,
        "damping": decays,
        "parameters": [*_of_resonances(document), *_of_decays(decays), *_of_constants(results)],
        "document": document,
        "doubts": [one["sentence"] for one in document["doubts"]],
        "notes": [note for note in notes if note],
    }


def _curves(results: "xr.Dataset") -> Iterator[dict[str, Any]]:
    """Yield the response at each pretension, as a run under way has it."""
    import numpy as np

    columns = {str(name): row.values for name, row in results.data_vars.items() if row.dims == results["gain"].dims}
    relative = columns["amplitude_std_rad"] / np.where(columns["amplitude_rad"] > 0, columns["amplitude_rad"], np.nan)
    columns["gain_std"] = columns["gain"] * relative
    frequencies = results["frequency_hz"].values
    names = ("frequency_hz", "gain", "gain_measured_drive", "phase", "repeats", "settled", "saturated_share")
    for p, pretension in enumerate(results["pretension_mm"].values):
        curve: dict[str, Any] = {"pretension_mm": float(pretension), **{name: [] for name in names}}
        for f, frequency in enumerate(frequencies):
            there = np.isfinite(columns["gain"][p, f])
            if not there.any():
                continue
            table = {name: values[p, f][None] for name, values in columns.items()}
            delay = shared_delay(table["phase_delay_std_rad"])
            share = float(np.max(table["saturated_share"][0, there]))
            curve["frequency_hz"].append(float(frequency))
            curve["gain"].append(mean_of(table["gain"], table["gain_std"]))
            curve["gain_measured_drive"].append(mean_of(table["gain_measured_drive"], table["gain_measured_drive_std"]))
            curve["phase"].append(mean_of(table["phase_lag_rad"], table["phase_std_rad"], delay, 180 / np.pi))
            curve["repeats"].append(int(there.sum()))
            curve["settled"].append(bool(np.all(table["settled"][0, there] == 1.0)))
            curve["saturated_share"].append(finite(share))
        if curve["frequency_hz"]:
            yield curve


def _row(pretension_mm: float, quantity: str, estimate: dict[str, Any]) -> dict[str, Any]:
    name, unit = _QUANTITIES[quantity]
    if unit == "°":
        turned = [None if x is None else math.degrees(x) for x in (estimate["std"], *estimate["interval90"])]
        value = None if estimate["value"] is None else math.degrees(estimate["value"])
        estimate = {"value": value, "std": turned[0], "interval90": turned[1:]}
    return {"pretension_mm": pretension_mm, "quantity": quantity, "name": name, "estimate": estimate, "unit": unit}


def _of_resonances(document: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for rows in (document.get("resonance", []), document.get("energy", {}).get("pretensions", [])):
        for row in rows:
            for quantity in _QUANTITIES:
                if quantity in row and row[quantity]["value"] is not None:
                    yield _row(row["pretension_mm"], quantity, row[quantity])


def _of_decays(decays: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    for row in decays:
        for quantity in ("damping_ratio", "decay_frequency_hz", "decay_rate_per_s"):
            if quantity in row:
                yield _row(row["pretension_mm"], quantity, row[quantity])


def _of_constants(results: "xr.Dataset") -> Iterator[dict[str, Any]]:
    """Yield the paper's stiffness and damping constant, whose repeats alone tell how certain they are."""
    import numpy as np

    for quantity in ("paper_stiffness_n_m_rad", "paper_damping_n_m_s_rad"):
        if quantity not in results:
            continue
        for p, pretension in enumerate(results["pretension_mm"].values):
            values = results[quantity].values[p][None]
            if np.isfinite(values).any():
                yield _row(float(pretension), quantity, mean_of(values, np.full(values.shape, np.nan)))


# A run's files are made for who takes them along.

FILES = {"recording": "recording.nc", "csv": "csv.zip", "mat": "recording.mat", "report": "report.html"}
"""What can be had, and the name of its file."""


def download(folder: Path | str, kind: str) -> Path:
    """Return where a run's recording, CSV table (zipped), MATLAB file or report is, made where it is not yet.

    Made files lie in the cache of the run's folder; one that is older than its recording is made anew, whole or not
    at all. Raises SpecError for an unknown kind; FileError and RecordingError as `recording_of`.
    """
    folder = Path(folder)
    if kind not in FILES:
        raise SpecError(f"found a file of kind {kind!r}, expected one of {', '.join(FILES)}")
    recording = recording_of(folder)
    if kind == "recording":
        return recording
    path = folder / CACHE / FILES[kind]
    if path.is_file() and path.stat().st_mtime_ns >= recording.stat().st_mtime_ns:
        return path
    make: dict[str, Callable[[Path, Path], None]] = {"csv": _csv, "mat": _mat, "report": _report}
    make[kind](folder, path)
    return path


def _csv(folder: Path, path: Path) -> None:
    from sinew.measure.files.csv import export_csv
    from sinew.measure.files.netcdf import write_atomically

    table = path.with_name(f".{folder.name}.csv")
    export_csv(load_own(folder), table)

    def write(temporary: Path) -> None:
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as packed:
            packed.write(table, f"{folder.name}.csv")

    try:
        write_atomically(path, write)
    finally:
        table.unlink(missing_ok=True)


def _mat(folder: Path, path: Path) -> None:
    from sinew.measure.files.netcdf import export_mat

    export_mat(load_own(folder), path)


def _report(folder: Path, path: Path) -> None:
    from sinew.analysis.analysed import recording_rig
    from sinew.paper.report import draw_figures, write_report

    recording, results = results_of(folder)
    figures = draw_figures(recording, results, path.with_name("figures"), formats=("png",))
    rebuild = str(recording.attrs.get("command", ""))
    write_report(path.parent, results=results, figures=figures, rig=recording_rig(recording, None), rebuild=rebuild)
