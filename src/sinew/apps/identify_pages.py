"""This is where `sinew identify` draws its figures and writes its page."""

from pathlib import Path
from typing import TYPE_CHECKING

from sinew.apps.console import write_json
from sinew.apps.identify_found import Found

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sinew.identify.backbone import Backbone
    from sinew.identify.fitted import Fit
    from sinew.identify.joint_fitted import JointFit

__all__ = ["write_pages"]

_FORMATS = ("png", "pdf")


def write_pages(found: Found, folder: Path, *, about: str, rebuild: str, origins: list[tuple[str, str]]) -> Path:
    """Write fit.json, figures and fit.html into a folder and return the path of the page.

    Raises FileError where the folder cannot be written.
    """
    from sinew.figures.fit_page import write_fit_page
    from sinew.figures.style import save_figure

    paths = []
    for name, figure in _figures(found).items():
        paths += save_figure(figure, folder / "figures", name, _FORMATS)
    write_json(found.document, folder / "fit.json")
    return write_fit_page(
        folder,
        found.document,
        sentences=found.sentences,
        figures=paths,
        about=about,
        rebuild=rebuild,
        origins=origins,
    )


def _figures(found: Found) -> "dict[str, Figure]":
    drawn = _joint_figures(found.joint) if found.joint is not None else {}
    if found.fit is not None:
        drawn = _fit_figures(found, found.fit)
    return {name: figure for name, figure in drawn.items() if figure is not None}


def _fit_figures(found: Found, fit: "Fit") -> "dict[str, Figure | None]":
    import math

    from sinew.figures.backbone import draw_backbone
    from sinew.figures.corner import draw_corner
    from sinew.figures.fit_cloud import cloud_of
    from sinew.figures.fit_data import draw_fit
    from sinew.figures.fit_trace import traces_of
    from sinew.figures.residuals import draw_residuals
    from sinew.identify.start import dominant_omega
    from sinew.identify.swing import swing_of

    record = fit.records[0]
    frequency = fit.natural_frequency_hz.value
    if not math.isfinite(frequency):
        frequency = dominant_omega(record) / (2 * math.pi)
    traces = traces_of(fit, found.split, found.held_out)
    cloud = cloud_of(fit)
    if found.posterior is not None:
        cloud = cloud.drawn(found.posterior.names, found.posterior.draws)
    return {
        "fit_data": draw_fit(traces, frequency),
        "residuals": draw_residuals(traces, frequency),
        "corner": draw_corner(cloud),
        "backbone": draw_backbone(swing_of(fit), _decay(fit), record.motion_unit),
    }


def _decay(fit: "Fit") -> "Backbone | None":
    """Return the backbone of the first free decay without a model, or None where the record is none."""
    from sinew.identify.backbone import fit_backbone
    from sinew.identify.record import derivative_order
    from sinew.measure.errors import RecordingError

    record = fit.records[0]
    if record.input is not None or derivative_order(record.output_unit):
        return None
    try:
        return fit_backbone(record.time_s, record.output)
    except RecordingError:
        return None


def _joint_figures(joint: "JointFit") -> "dict[str, Figure | None]":
    import numpy as np

    from sinew.apps.identify_found import joint_names
    from sinew.figures.backbone import draw_over_pretension
    from sinew.figures.corner import draw_corner
    from sinew.figures.fit_cloud import Cloud
    from sinew.figures.fit_data import draw_fit
    from sinew.figures.fit_trace import traces_of_joint
    from sinew.figures.residuals import draw_residuals

    traces = traces_of_joint(joint)
    first = joint.at_pretension("natural_frequency_hz", joint.pretension_mm[0]).value
    count = len(joint.parameters)
    value = np.array([one.value for one in joint.parameters.values()])
    cloud = Cloud(joint_names(joint), value, joint.covariance.matrix[:count, :count])
    kept = [k for k in range(count) if np.isfinite(cloud.covariance[k, k]) and cloud.covariance[k, k] > 0]
    pretension = draw_over_pretension(joint) if len(joint.pretension_mm) > 1 else None
    return {
        "fit_data": draw_fit(traces, first, "rate"),
        "residuals": draw_residuals(traces, first),
        "corner": draw_corner(cloud.take(kept)),
        "pretension": pretension,
    }
