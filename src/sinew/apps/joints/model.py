"""`sinew model`: a rig's joint as a model for simulators, MJCF for MuJoCo or URDF."""

from pathlib import Path
from typing import Annotated, cast, get_args

import typer

from sinew.apps import console
from sinew.apps.console import Json, RigArgument, option
from sinew.apps.joints.options import MODES, Mode, check_angle
from sinew.measure.errors import SpecError


def model(
    rig: RigArgument,
    out: Annotated[Path, option("FILE", "The model to write: .xml or .mjcf for MuJoCo, .urdf.")],
    pretension: Annotated[float, option("MM", "Mean take-up of the tendons.", "--pretension-mm")] = 6.0,
    bend: Annotated[float, option("DEG", "How far the head rests bent; MJCF only.", "--bend-deg")] = 0.0,
    azimuth: Annotated[float, option("DEG", "Direction of the bend, from y towards z.", "--azimuth-deg")] = 0.0,
    mode: Mode = "position",
    swing: Annotated[float, option("DEG", "Torsion for which guides get spring and damper.", "--swing-deg")] = 10.0,
    pieces: Annotated[int, option("N", "Pieces of the silicone's chain.")] = 6,
    sway: Annotated[
        bool, typer.Option("--sway/--no-sway", help="A joint that sways, or one that twists and sinks alone.")
    ] = True,
    json: Json = False,
) -> None:
    """Write a rig's joint as a model for simulators: MJCF for MuJoCo, with silicone, tendons and motors, or URDF.

    The MJCF loads at its rest pose; its controls are what each motor takes up beyond that, and the lever's angle. The
    URDF has hinges alone, for the sways and the torsion; the springs that they need are told in it. Both files say what
    they lack. A rig without a [space] knows no sways: --no-sway.
    """
    from sinew.predict.multibody import ENDINGS

    if out.suffix not in ENDINGS:
        raise SpecError(f"--out is {out}, expected a name that ends with {', '.join(ENDINGS)}")
    console.require_file(out)
    console.check_choice("--mode", mode, MODES)
    console.checked_number("--pretension-mm", pretension, "0 to 100: cables cannot push", low=0, high=100)
    console.checked_number("--bend-deg", bend, "0 to 60°; turn it by --azimuth-deg", low=0, high=60)
    console.checked_number("--azimuth-deg", azimuth, "an angle from -360 to 360°", low=-360, high=360)
    check_angle("--swing-deg", swing)

    from sinew.plan.plan import TendonMode
    from sinew.plan.rig import moments_of
    from sinew.plan.toml import load_rig
    from sinew.predict.multibody import export_model, model_document

    assert mode in get_args(TendonMode)
    spec = load_rig(rig)
    bodies = export_model(
        spec,
        out,
        pretension,
        bend_deg=bend,
        azimuth_deg=azimuth,
        mode=cast(TendonMode, mode),
        swing_deg=swing,
        pieces=pieces,
        sway=sway,
    )
    document = {
        "rig": spec.name,
        "file": str(out),
        "format": ENDINGS[out.suffix],
        "pretension_mm": pretension,
        "bend_deg": bend,
        "azimuth_deg": azimuth,
        "mode": mode,
        "swing_deg": swing,
        "assumptions": list(moments_of(spec).assumptions),
        **model_document(bodies),
    }
    modes = ", ".join(f"{name} {hz:.3f} Hz" for name, hz in document["frequency_hz"].items())
    told = [f"{out}: {document['pieces']} pieces, {len(document['tension_n'])} tendons", modes] if modes else [str(out)]
    told += [f"- {sentence}" for sentence in document["assumptions"]]
    console.print_result(document, told, json=json)
