"""This is where `sinew joint` writes the rig of a joint that is not built yet."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps.console import print_json, print_table, require_file
from sinew.apps.joint_options import BASE_RIG, JointOptions, designed_rig, with_joint_options
from sinew.apps.options import Json
from sinew.measure.errors import SpecError
from sinew.measure.estimate import number

if TYPE_CHECKING:
    from sinew.plan.rig import RigSpec
    from sinew.predict.joints.design import Design

__all__ = ["design_document", "joint", "write_rig"]


@with_joint_options
def joint(
    rig: Annotated[str, typer.Argument(metavar="RIG", help="The rig to derive it from; else the paper's.")] = BASE_RIG,
    out: Annotated[Path | None, typer.Option("--out", metavar="RIG.toml", help="Write the rig into this file.")] = None,
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
        require_file(out)
    made, design = designed_rig(rig, joint)
    assert design is not None
    document: dict[str, Any] = {"name": made.name, **design_document(made, design), "out": None}
    if out is not None:
        write_rig(made, out)
        document["out"] = str(out)
    if json:
        print_json(document)
        return
    rows = [(name, number(value)) for name, value in document["section"].items() if isinstance(value, float)]
    print_table(("section", ""), rows, title=f"{made.name}: {document['section']['shape']}")
    print(f"torsional rigidity G·J {number(document['torsional_rigidity_n_m2'], unit='N m²')}", end="")
    stiffness = number(document["stiffness_n_m_rad"], unit="N m/rad")
    print(f", G {number(document['shear_modulus_kpa'], unit='kPa')}, G·J/L {stiffness}")
    if out is not None:
        print(f"rig: {out}")


def write_rig(rig: "RigSpec", path: Path) -> None:
    """Write a rig as TOML, atomically. Raises FileError where the file cannot be written."""
    from sinew.measure.netcdf import write_atomically
    from sinew.plan.toml import dump_rig

    def write(temporary: Path) -> None:
        temporary.write_text(dump_rig(rig), encoding="utf-8")

    write_atomically(path, write)


def design_document(rig: "RigSpec", design: "Design | None") -> dict[str, Any]:
    """Return the section, material and stiffness of a rig's silicone as JSON holds them."""
    from sinew.predict.joints.design import section_of, shear_modulus_of

    section = (design and design.section) or section_of(rig)
    rigidity, length = rig.silicone.torsional_rigidity.value, rig.silicone.length.value
    material = None if design is None or design.material is None else design.material
    return {
        "section": {
            "shape": section.shape,
            "diameter_mm": 1e3 * section.diameter,
            "area_mm2": 1e6 * section.area,
            "perimeter_mm": 1e3 * section.perimeter,
            "least_moment_mm4": 1e12 * section.least,
            "greatest_moment_mm4": 1e12 * section.greatest,
            "torsion_constant_mm4": 1e12 * section.torsion_constant,
            "torsion_error": section.torsion_error,
            "warping_constant_mm6": 1e18 * section.warping_constant,
            "shear_arm_mm": None if section.shear_arm is None else 1e3 * section.shear_arm,
        },
        "material": None
        if material is None
        else {"name": material.name, "shear_modulus_pa": material.shear_modulus.to_json()},
        "shear_modulus_kpa": 1e-3 * shear_modulus_of(rig),
        "torsional_rigidity_n_m2": rigidity,
        "length_mm": 1e3 * length,
        "stiffness_n_m_rad": rigidity / length,
    }
