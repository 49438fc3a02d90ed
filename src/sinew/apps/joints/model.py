"""`sinew model`: a rig's joint as a model for MuJoCo (MJCF), python-control or MATLAB."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from sinew.apps import console
from sinew.apps.console import Json, RigArgument, Without, option
from sinew.apps.joints.options import MODES, Mode, check_angle
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.plan.plan import TendonMode
    from sinew.predict.linear import Gear

_ENDINGS = {"mjcf": (".xml", ".mjcf"), "control": (".json", ""), "matlab": (".mat", "")}
"""What a file of a model is named; no ending is a folder for both files of a linear joint."""


def model(
    rig: RigArgument,
    to: Annotated[str, option("|".join(_ENDINGS), "What the model is for: MuJoCo, python-control, MATLAB.")] = "mjcf",
    out: Annotated[Path | None, option("FILE", "The model: .xml, .json or .mat; linear: or a folder for both.")] = None,
    pretension: Annotated[
        str | None,
        option("MM", "Take-up of the tendons; else 6. Linear: one joint for each, else 0,4,8,12.", "--pretension-mm"),
    ] = None,
    bend: Annotated[
        float | None,
        option("DEG", "How far the head rests bent. Linear: also in space, from lever and tendons.", "--bend-deg"),
    ] = None,
    azimuth: Annotated[float, option("DEG", "Direction of the bend, from y towards z.", "--azimuth-deg")] = 0.0,
    mode: Mode = "position",
    swing: Annotated[float, option("DEG", "MuJoCo: torsion for which guides get spring and damper.")] = 10.0,
    pieces: Annotated[int, option("N", "MuJoCo: pieces of the silicone's chain.")] = 6,
    sway: Annotated[
        bool, typer.Option("--sway/--no-sway", help="MuJoCo: a joint that sways, or one that twists and sinks alone.")
    ] = True,
    gear: Annotated[
        str, option("sliding|creeping", "Linear: friction of the gear, the lever slides or hardly moves.")
    ] = "sliding",
    without: Without = None,
    json: Json = False,
) -> None:
    """Write a joint for MuJoCo, python-control or MATLAB.

    --to mjcf: silicone, tendons and motors as bodies. The model loads at its rest pose; its controls are what each
    motor takes up beyond that, and the lever's angle. A comment at its top says what it lacks. A rig without a [space]
    has no sways: give --no-sway.
    --to control or matlab: transfer functions, linear at rest: state space, poles, zeros and gains, from command, lever
    and torque on the head to torsion. With --bend-deg, zero for a straight joint, also the joint in space: from the
    lever's angle, from what the motors take up of the tendons in pitch, roll and alike, and from a torque, to torsion,
    pitch, roll and axial motion. Where linear is not enough, sinew predict follows the curves.
    """
    console.check_choice("--to", to, tuple(_ENDINGS))
    console.check_choice("--mode", mode, MODES)
    if out is not None and out.suffix not in _ENDINGS[to]:
        folder = ", or a folder" if "" in _ENDINGS[to] else ""
        raise SpecError(
            f"--out is {out}, expected a name that ends with {' or '.join(filter(None, _ENDINGS[to]))}{folder}"
        )
    if bend is not None:
        console.checked_number("--bend-deg", bend, "0 to 60°; turn it by --azimuth-deg", low=0, high=60)
    levels = pretension or ("6" if to == "mjcf" else "0,4,8,12")
    pretensions = console.number_list("--pretension-mm", levels, "0 to 100: cables cannot push", low=0, high=100)
    if to != "mjcf":
        if bend is not None and without:
            raise SpecError(f"found --without {without[0]} with --bend-deg; in space all effects act, leave one out")
        if bend is None and azimuth:
            raise SpecError("found --azimuth-deg without --bend-deg; say how far the head is bent")
        pose_deg = None if bend is None else (bend, azimuth)
        _write_linear(rig, pretensions, gear, mode, pose_deg, without or (), out, json=json)
        return
    if out is None:
        raise SpecError("found --to mjcf without --out; name the file to write, as joint.xml")
    if len(pretensions) > 1:
        raise SpecError(f"--pretension-mm is {levels}, expected one: a model for MuJoCo rests in one pose")
    console.require_file(out)
    console.checked_number("--azimuth-deg", azimuth, "an angle from -360 to 360°", low=-360, high=360)
    check_angle("--swing-deg", swing)

    from sinew.plan.rig import moments_of
    from sinew.plan.toml import load_rig
    from sinew.predict.multibody import export_model, model_document

    spec = load_rig(rig)
    pose = {"bend_deg": bend or 0.0, "azimuth_deg": azimuth}
    held = cast("TendonMode", mode)
    bodies = export_model(spec, out, pretensions[0], mode=held, swing_deg=swing, pieces=pieces, sway=sway, **pose)
    document = {
        "rig": spec.name,
        "file": str(out),
        "format": "mjcf",
        "pretension_mm": pretensions[0],
        **pose,
        "mode": mode,
        "swing_deg": swing,
        "assumptions": list(moments_of(spec).assumptions),
        **model_document(bodies),
    }
    modes = ", ".join(f"{name} {hz:.3f} Hz" for name, hz in document["frequency_hz"].items())
    told = [f"{out}: {document['pieces']} pieces, {len(document['tension_n'])} tendons", modes] if modes else [str(out)]
    told += [f"- {sentence}" for sentence in document["assumptions"]]
    console.print_result(document, told, json=json)


def _write_linear(
    rig: str,
    pretensions: list[float],
    gear: str,
    mode: str,
    pose_deg: tuple[float, float] | None,
    without: Sequence[str],
    out: Path | None,
    *,
    json: bool,
) -> None:
    """Print a rig's linear joints, and write them for python-control (.json), for MATLAB (.mat), or both."""
    if out is not None:
        (console.require_file if out.suffix else console.require_folder)(out)
    from sinew.plan.toml import load_rig
    from sinew.predict.bent import transfer_functions
    from sinew.predict.linear import GEARS, write_transfer
    from sinew.twin.parameters import Effects

    console.check_choice("--gear", gear, GEARS)
    found = transfer_functions(
        load_rig(rig),
        pretensions,
        gear=cast("Gear", gear),
        mode=cast("TendonMode", mode),
        effects=Effects().without(*without),
        pose_deg=pose_deg,
    )
    document, files = found.to_dict(), []
    if out is not None:
        files = [str(file) for file in write_transfer(found.joints, document, out, found.space or ())]
        document["files"] = files
    console.print_result(document, found.blocks(), "\n".join(f"wrote {file}" for file in files), json=json)
