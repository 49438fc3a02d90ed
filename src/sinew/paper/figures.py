"""This is where the figures of the paper are listed, drawn and written to files."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import xarray as xr
from matplotlib.figure import Figure

from sinew.analysis.signal.groups import split_by_drive
from sinew.figures.decay import draw_damping, draw_decay
from sinew.figures.drive_groups import draw_drive_amplitude, draw_drive_groups
from sinew.figures.energy import draw_energy
from sinew.figures.lissajous import draw_lissajous, draw_phase_portraits
from sinew.figures.response import draw_response, draw_response_map
from sinew.figures.style import save_figure

FIGURES: dict[str, Callable[[xr.Dataset, xr.Dataset], Figure | None]] = {
    "figure05_drive_groups": lambda recording, _: draw_drive_groups(recording),
    "figure06_response": lambda _, results: draw_response(results),
    "figure07_lissajous": lambda recording, _: draw_lissajous(recording),
    "figure08_map": lambda _, results: draw_response_map(results),
    "figure09_decay": draw_decay,
    "figure10_damping": draw_damping,
    "drive_amplitude": draw_drive_amplitude,
    "energy": draw_energy,
    "phase_portraits": draw_phase_portraits,
}
"""What draws each figure, by the name of its files, in the order of the paper."""


def build_figures(recording: xr.Dataset, results: xr.Dataset) -> Iterator[tuple[str, Figure]]:
    """Yield (name, figure) of every figure whose parts the recording and the results hold.

    Steady segments that do not say their frequency are split as the analysis splits them.
    """
    if "gain" in results:
        recording = split_by_drive(recording)
    for name, draw in FIGURES.items():
        figure = draw(recording, results)
        if figure is not None:
            yield name, figure


def draw_figures(
    recording: xr.Dataset,
    results: xr.Dataset,
    folder: Path,
    formats: Sequence[str] = ("png", "pdf"),
    workers: int = 1,
) -> list[Path]:
    """Draw all figures into a folder and return the paths that were written, in the order of the paper.

    formats: file endings that matplotlib knows.
    workers: processes that write the files, this one among them; drawing stays here. Further ones are spawned (a
        script that asks for them needs the usual `if __name__ == "__main__":`) and take a second to start. On two
        free cores 2 workers save about a second of 4.5, on busy ones they cost more than they save.
    Raises FileError where the folder cannot be written.
    """
    drawn = list(build_figures(recording, results))
    jobs = [(figure, folder, name, formats) for name, figure in drawn]
    if workers < 2:
        return [path for job in jobs for path in save_figure(*job)]
    with ProcessPoolExecutor(workers - 1, mp_context=get_context("spawn")) as pool:
        elsewhere = {i: pool.submit(save_figure, *job) for i, job in enumerate(jobs) if i % workers}
        here = {i: save_figure(*job) for i, job in enumerate(jobs) if not i % workers}
        return [path for i in range(len(jobs)) for path in (here[i] if i in here else elsewhere[i].result())]
