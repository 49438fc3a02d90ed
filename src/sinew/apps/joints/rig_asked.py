"""What `sinew predict`, `compare` and `tune` ask of a rig by their options, and the files they write of its curves."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps.console import (
    LARGEST_DEG,
    checked_band,
    checked_number,
    number_list,
    write_json,
)
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sinew.predict.predicted import Predicted, RigAsked


_MODES = ("position", "position-with-current-limit", "current")
_BAND_HZ = (1.0, 6.0)

Pretension = Annotated[
    str, typer.Option("--pretension-mm", metavar="MM,...", help="Rig: pretensions, one curve for each.")
]
Amplitude = Annotated[
    float, typer.Option("--amplitude-deg", metavar="DEG", help="Rig: amplitude of the drive's command.")
]
Mode = Annotated[str, typer.Option("--mode", metavar="|".join(_MODES), help="Rig: mode of the motors.")]
Without = Annotated[
    list[str] | None,
    typer.Option("--without", metavar="EFFECT", help="Rig: switch an effect of the twin off; may be repeated."),
]

Bands = Annotated[
    int | None,
    typer.Option(
        "--bands", metavar="N", min=20, help="Calibrated rig: 90 % bands from N draws of what is known of it."
    ),
]
BandSeed = Annotated[int, typer.Option("--seed", min=0, help="Seed of the draws of --bands.")]


def words_of(asked: "RigAsked") -> list[str]:
    """Return the options that ask for the same again."""
    pretensions = ",".join(f"{mm:g}" for mm in asked.pretensions)
    words = ["--pretension-mm", pretensions, "--amplitude-deg", f"{asked.amplitude_deg:g}", "--mode", asked.mode]
    words += [word for effect in asked.without for word in ("--without", effect)]
    return [*words, "--from-hz", f"{asked.band_hz[0]:g}", "--to-hz", f"{asked.band_hz[1]:g}"]


def check_mode(mode: str) -> None:
    """Do nothing where a mode of the tendon motors is known; else raise SpecError."""
    if mode not in _MODES:
        raise SpecError(f"--mode is {mode!r}, expected one of {', '.join(_MODES)}")


def rig_asked(
    pretension: str, amplitude: float, mode: str, without: list[str] | None, start: float | None, stop: float | None
) -> "RigAsked":
    """Return what the options ask of a rig. Raises SpecError where one of them cannot be meant."""
    check_mode(mode)
    pretensions = number_list("--pretension-mm", pretension, "zero or more: cables cannot push", low=0)
    expected = f"a positive angle up to {LARGEST_DEG:g}°"
    checked_number("--amplitude-deg", amplitude, expected, low=0, high=LARGEST_DEG, above=True)
    band_hz = checked_band((_BAND_HZ[0] if start is None else start, _BAND_HZ[1] if stop is None else stop))
    from sinew.predict.predicted import RigAsked

    return RigAsked(pretensions, amplitude, mode, tuple(without or ()), band_hz)


# A prediction's figures, page and files are written into a folder.

_FORMATS = ("png", "pdf")


def write_prediction(
    found: "Predicted", document: dict[str, Any], folder: Path, rebuild: str, more: "Mapping[str, Figure]"
) -> Path:
    """Write prediction.json, rig.toml, figures and prediction.html into a folder; return the page.

    rebuild: the command line that makes it again. more: further figures, by name. Raises FileError where the folder
    cannot be written.
    """
    from sinew.figures.predicted import curves_of, draw_predicted, draw_predicted_map
    from sinew.plan.toml import save_rig

    curves = curves_of(found)
    figures = {"predicted_response": draw_predicted(curves), "predicted_map": draw_predicted_map([curves])} | dict(more)
    save_rig(found.rig, folder / "rig.toml")
    return _write(folder, "prediction", document, [document], figures, found, rebuild)


def write_comparison(rigs: "Sequence[Predicted]", document: dict[str, Any], folder: Path, rebuild: str) -> Path:
    """Write comparison.json, figures and comparison.html into a folder; return the page."""
    from sinew.figures.predicted import curves_of, draw_comparison, draw_predicted_map

    curves = [curves_of(found) for found in rigs]
    figures = {"predicted_comparison": draw_comparison(curves), "predicted_map": draw_predicted_map(curves)}
    return _write(folder, "comparison", document, document["rigs"], figures, rigs[0], rebuild)


def _write(
    folder: Path,
    stem: str,
    document: dict[str, Any],
    rigs: list[dict[str, Any]],
    figures: "dict[str, Figure | None]",
    found: "Predicted",
    rebuild: str,
) -> Path:
    from sinew.figures.predicted import write_prediction_page
    from sinew.figures.style import save_figure
    from sinew.measure.files.netcdf import provenance

    paths = []
    for name, figure in figures.items():
        if figure is not None:
            paths += save_figure(figure, folder / "figures", name, _FORMATS)
    write_json(document, folder / f"{stem}.json")
    return write_prediction_page(
        folder / f"{stem}.html",
        rigs,
        amplitude_deg=found.asked.amplitude_deg,
        figures=paths,
        rebuild=rebuild,
        origins=[("versions", str(provenance("twin")["versions"]))],
    )
