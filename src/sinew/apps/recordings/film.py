"""The command `sinew film`: a recording as a film."""

from pathlib import Path
from typing import Annotated, cast, get_args

import typer

from sinew.apps import console
from sinew.apps.console import Json, option
from sinew.measure.errors import SpecError


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
