"""This is where a prediction's figures, page and files are written into a folder."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sinew.apps.console import write_json
from sinew.apps.joint import write_rig
from sinew.apps.predict_rig import Predicted

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sinew.figures.predicted import Curves

__all__ = ["write_comparison", "write_prediction"]

_FORMATS = ("png", "pdf")


def write_prediction(
    found: Predicted, document: dict[str, Any], folder: Path, rebuild: str, more: "Mapping[str, Figure]"
) -> Path:
    """Write prediction.json, rig.toml, figures and prediction.html into a folder; return the page.

    rebuild: the command line that makes it again. more: further figures, by name. Raises FileError where the folder
    cannot be written.
    """
    from sinew.figures.predicted import draw_predicted, draw_predicted_map

    curves = _curves(found)
    figures = {"predicted_response": draw_predicted(curves), "predicted_map": draw_predicted_map([curves])} | dict(more)
    write_rig(found.rig, folder / "rig.toml")
    return _write(folder, "prediction", document, [document], figures, found, rebuild)


def write_comparison(rigs: Sequence[Predicted], document: dict[str, Any], folder: Path, rebuild: str) -> Path:
    """Write comparison.json, figures and comparison.html into a folder; return the page."""
    from sinew.figures.predicted import draw_comparison, draw_predicted_map

    curves = [_curves(found) for found in rigs]
    figures = {"predicted_comparison": draw_comparison(curves), "predicted_map": draw_predicted_map(curves)}
    return _write(folder, "comparison", document, document["rigs"], figures, rigs[0], rebuild)


def _curves(found: Predicted) -> "Curves":
    from sinew.figures.predicted import Curves

    asked = found.asked
    return Curves(found.rig.name, tuple(asked.pretensions), found.prediction.branches, asked.amplitude_deg)


def _write(
    folder: Path,
    stem: str,
    document: dict[str, Any],
    rigs: list[dict[str, Any]],
    figures: "dict[str, Figure | None]",
    found: Predicted,
    rebuild: str,
) -> Path:
    from sinew.figures.prediction_page import write_prediction_page
    from sinew.figures.style import save_figure
    from sinew.measure.netcdf import provenance

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
