"""This is where a run's files are made for who takes them along."""

import zipfile
from collections.abc import Callable
from pathlib import Path

from sinew.apps.dashboard.names import CACHE
from sinew.apps.dashboard.work.results import load_own, recording_of, results_of
from sinew.measure.errors import SpecError

__all__ = ["FILES", "download"]

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
    from sinew.measure.csv import export_csv
    from sinew.measure.netcdf import write_atomically

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
    from sinew.measure.mat import export_mat

    export_mat(load_own(folder), path)


def _report(folder: Path, path: Path) -> None:
    from sinew.apps.analyse import recording_rig
    from sinew.figures.figures import draw_figures
    from sinew.figures.report import write_report

    recording, results = results_of(folder)
    figures = draw_figures(recording, results, path.with_name("figures"), formats=("png",))
    rebuild = str(recording.attrs.get("command", ""))
    write_report(path.parent, results=results, figures=figures, rig=recording_rig(recording, None), rebuild=rebuild)
