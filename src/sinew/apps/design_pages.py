"""This is where designed joints are written into a folder: rigs, plans, figures, one page."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from sinew.apps.console import write_json
from sinew.apps.joint import write_rig

if TYPE_CHECKING:
    from sinew.figures.design_curves import EndCurves
    from sinew.plan.plan import Plan
    from sinew.tune.design import Designed
    from sinew.tune.proposal import Proposal

__all__ = ["write_design"]


def write_design(found: "Designed", document: dict[str, Any], folder: Path, rebuild: str) -> Path:
    """Write proposal-N/rig.toml and plan.toml, figures, design.json and design.html; return the page.

    document: gets the paths of rigs and plans. Raises FileError where the folder cannot be written.
    """
    from sinew.figures.design_curves import draw_design_curves
    from sinew.figures.design_front import draw_design_front
    from sinew.figures.design_page import write_design_page
    from sinew.figures.style import save_figure
    from sinew.measure.provenance import provenance
    from sinew.tune.proposal import plan_of

    curves = []
    for number, (i, row) in enumerate(zip(found.chosen, document["proposals"], strict=True), start=1):
        one, place = found.evaluated[i], folder / f"proposal-{number}"
        plan = plan_of(one)
        place.mkdir(parents=True, exist_ok=True)
        write_rig(one.rig, place / "rig.toml")
        _write_plan(plan, place / "plan.toml")
        row["rig"], row["plan"] = (str(place / name) for name in ("rig.toml", "plan.toml"))
        curves.append(_curves(one, plan, row))
    figures = []
    if document["evaluated"]:
        figure = draw_design_front(document["evaluated"], document["proposals"])
        figures += save_figure(figure, folder / "figures", "design_front", ("png", "pdf"))
    if curves:
        figure = draw_design_curves(curves, document["target"]["yaw_deg"])
        figures += save_figure(figure, folder / "figures", "design_curves", ("png", "pdf"))
    write_json(document, folder / "design.json")
    return write_design_page(
        folder / "design.html",
        document,
        figures=figures,
        rebuild=rebuild,
        origins=[("versions", str(provenance("twin")["versions"]))],
    )


def _write_plan(plan: "Plan", path: Path) -> None:
    from sinew.measure.netcdf import write_atomically
    from sinew.plan.toml import dump_plan

    def write(temporary: Path) -> None:
        temporary.write_text(dump_plan(plan), encoding="utf-8")

    write_atomically(path, write)


def _curves(one: "Proposal", plan: "Plan", row: dict[str, Any]) -> "EndCurves":
    from sinew.figures.design_curves import EndCurves
    from sinew.predict.drawn import COARSE
    from sinew.predict.joint import joint_problem
    from sinew.predict.prediction import predict

    assert plan.sweep is not None
    band = 0.8 * plan.sweep.frequency_hz[0], 1.1 * plan.sweep.frequency_hz[-1]
    problem = joint_problem(one.rig, list(plan.pretension.pretension_mm), plan.sweep.amplitude_deg, band)
    return EndCurves(row, predict(problem, band, COARSE).branches)
