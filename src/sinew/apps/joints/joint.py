"""`sinew joint`: the rig of a joint that is not built yet."""

from pathlib import Path
from typing import Annotated, Any

import typer

from sinew.apps import console
from sinew.apps.console import Json, option
from sinew.apps.joints.options import BASE_RIG, JointOptions, designed_rig, with_joint_options
from sinew.measure.errors import SpecError
from sinew.measure.estimate import number


@with_joint_options
def joint(
    rig: Annotated[str, typer.Argument(metavar="RIG", help="The rig to derive it from; else the paper's.")] = BASE_RIG,
    out: Annotated[Path | None, option("RIG.toml", "Write the rig into this file.")] = None,
    *,
    joint: JointOptions,
    json: Json = False,
) -> None:
    """Make the rig of a joint that is not built yet: section, length, material, tendons, inertia.

    What is not said stays as in the rig it is derived from. Every changed parameter is marked as assumed.
    """
    if not joint.given:
        raise SpecError("found nothing to change; say for instance --section annulus --outer-mm 60 --inner-mm 30")
    if out is not None:
        console.require_file(out)
    from sinew.plan.toml import save_rig
    from sinew.predict.joints.design import design_document

    made, design = designed_rig(rig, joint)
    assert design is not None
    document: dict[str, Any] = {"name": made.name, **design_document(made, design), "out": None}
    if out is not None:
        save_rig(made, out)
        document["out"] = str(out)
    if json:
        console.print_json(document)
        return
    rows = [(name, number(value)) for name, value in document["section"].items() if isinstance(value, float)]
    console.print_table(("section", ""), rows, title=f"{made.name}: {document['section']['shape']}")
    print(f"torsional rigidity G·J {number(document['torsional_rigidity_n_m2'], unit='N m²')}", end="")
    stiffness = number(document["stiffness_n_m_rad"], unit="N m/rad")
    print(f", G {number(document['shear_modulus_kpa'], unit='kPa')}, G·J/L {stiffness}")
    if design.material is not None:
        curve = design.material
        slack = "" if curve.slack is None else f", slack {number(100 * curve.slack, unit='%')}"
        print(f"{curve.title}: G {curve.shear_modulus.times(1e-3).shown('kPa')} by fits of its curve", end="")
        print(f", {number(1e-3 * curve.secant, unit='kPa')} at 100 % strain{slack}")
    if out is not None:
        print(f"rig: {out}")
