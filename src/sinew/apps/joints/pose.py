"""`sinew pose`, `sinew modes` and `sinew model`: where a joint rests, its small motions, and models for other tools."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from sinew.apps import console
from sinew.apps.console import Device, Json, Keep, RigArgument, Scheduler, Without, Workers, flag, option
from sinew.apps.joints.options import MODES, Mode, check_angle
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sinew.measure.tasks import Spread
    from sinew.plan.plan import TendonMode
    from sinew.predict.linear import Gear
    from sinew.predict.pose import Posed
    from sinew.predict.workspace import Workspace


def pose(
    rig: RigArgument,
    pretension: Annotated[
        str | None,
        option("MM", "Mean take-up of the tendons; else 6. With --map several, else 0,6,12.", "--pretension-mm"),
    ] = None,
    bend: Annotated[float, option("DEG", "How far the head is to be bent.", "--bend-deg")] = 0.0,
    azimuth: Annotated[
        float, option("DEG", "Where to: from y, where the lever lies at rest, towards z.", "--azimuth-deg")
    ] = 0.0,
    mode: Mode = "position",
    take_up: Annotated[
        str | None, option("MM,...", "Instead: the take-up of each tendon from first contact.", "--take-up-mm")
    ] = None,
    tension: Annotated[
        str | None, option("N,...", "Instead: the tension that each current holds.", "--tension-n")
    ] = None,
    map_: Annotated[
        bool, flag("--map", "Instead: all poses that the joint reaches, over pitch and roll, one map a pretension.")
    ] = False,
    step: Annotated[float, option("DEG", "Of a map: from one pose to the next.", "--step-deg")] = 2.0,
    scheduler: Scheduler = None,
    workers: Workers = 1,
    keep: Keep = None,
    device: Device = "cpu",
    out: Annotated[Path | None, option("FILE.png", "Draw joint or maps into this file (png, pdf, svg).")] = None,
    json: Json = False,
) -> None:
    """Find where a bent joint rests, or all poses it reaches.

    Take-ups, tensions and currents that hold it, and what speaks against it. A pose that cannot be reached, does
    not stay or breaks a limit is no error: the answer says why, and the exit status is 0. With --map, at which
    poses tendons go slack and what breaks a limit, as far as the rig may bend (limits.bend_deg, else 40°).
    """
    console.check_choice("--mode", mode, MODES)
    console.checked_number("--bend-deg", bend, "0 to 90; turn the azimuth for the other side", low=0, high=90)
    console.checked_number("--azimuth-deg", azimuth, "-360 to 360", low=-360, high=360)
    levels = pretension or ("0,6,12" if map_ else "6")
    pretensions = console.number_list("--pretension-mm", levels, "0 to 100: cables cannot push", low=0, high=100)
    if len(pretensions) > 1 and not map_:
        raise SpecError(f"--pretension-mm is {levels}, expected one for one pose; --map takes several")
    if out is not None:
        console.require_ending(out, console.PICTURES)
    if map_:
        if bend or azimuth or take_up or tension:
            raise SpecError("found --map beside what makes one pose; leave out the bend, take-ups or tensions")
        _map(rig, pretensions, step, mode, console.spread_of(scheduler, workers, keep, device), out, json=json)
        return
    given = [
        None if text is None else tuple(console.number_list(flag, text, expected))
        for flag, text, expected in (
            ("--take-up-mm", take_up, "one length for each tendon, as 8,6,4,6"),
            ("--tension-n", tension, "one tension for each tendon, as 50,40,30,40"),
        )
    ]
    if any(given) and (bend or azimuth):
        raise SpecError("found --bend-deg or --azimuth-deg beside what the tendons do, from which the pose follows")
    if any(given) and pretension is not None:
        raise SpecError("found --pretension-mm beside what each tendon does; give one of them")
    from sinew.plan.plan import Pose
    from sinew.plan.toml import load_rig
    from sinew.predict.pose import PoseRequest, find_pose

    request = PoseRequest(pretensions[0], Pose(bend_deg=bend, azimuth_deg=azimuth), mode, *given)
    found = find_pose(load_rig(rig), request)
    if out is None:
        _tell(found, json=json)
        return
    from sinew.figures.space import draw_pose

    _tell(found, draw_pose(found), out, json=json)


def _tell(found: "Posed | Workspace", figure: "Figure | None" = None, out: Path | None = None, *, json: bool) -> None:
    """Write the figure, if one was asked for and there is one, and print what was found."""
    if out is not None and figure is None:
        console.remark("there is no pose to draw")
    elif out is not None and figure is not None:
        from sinew.figures.style import save_figure

        save_figure(figure, out.parent, out.stem, (out.suffix[1:],))
    console.print_result(found.to_dict(), found.blocks(), f"wrote {out}" if figure is not None else "", json=json)


def _map(
    rig: str, pretensions: list[float], step: float, mode: str, spread: "Spread", out: Path | None, *, json: bool
) -> None:
    """Map the poses that a joint reaches, and print or draw the maps."""
    console.checked_number("--step-deg", step, "0.1 to 40", low=0.1, high=40)
    from sinew.plan.toml import load_rig
    from sinew.predict.workspace import map_workspace

    with console.progress_bar("map") as progress:
        found = map_workspace(load_rig(rig), pretensions, step_deg=step, mode=mode, spread=spread, progress=progress)
    if out is None:
        _tell(found, json=json)
        return
    from sinew.figures.space import draw_workspace

    _tell(found, draw_workspace(found), out, json=json)


# ---- `sinew modes`: torsion, sway and their coupling, over pretension and bend


def modes(
    rig: RigArgument,
    pretension: Annotated[str, option("MM,...", "Pretensions, modes for each.", "--pretension-mm")] = "0,6,12",
    bend: Annotated[str, option("DEG,...", "Bends of the head, modes for each.", "--bend-deg")] = "0,10,20,30",
    azimuth: Annotated[float, option("DEG", "Direction of the bend, from y towards z.", "--azimuth-deg")] = 0.0,
    mode: Mode = "position",
    swing: Annotated[
        float, option("DEG", "Swing of the head at which the guides slip and lose.", "--swing-deg")
    ] = 10.0,
    bands: Annotated[
        int, option("N", "Draws of what is assumed, for 90 % intervals; 0 for none.", "--bands", min=0)
    ] = 16,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the draws.")] = 0,
    out: Annotated[
        Path | None, option("FILE", "A figure, .png, .pdf or .svg, or a page with all figures, .html.")
    ] = None,
    json: Json = False,
) -> None:
    """Give the modes of a joint that bends.

    Frequency, damping, where their energy is, how the head moves. Torsion, sway in the plane of the bend and across
    it, and axial, over pretension and bend. The rig needs a [space] with the masses of head and lever: intervals
    are over the bounds of those that are assumed.
    """
    if out is not None:
        console.require_ending(out, (*console.PICTURES, ".html"))
    console.check_choice("--mode", mode, MODES)
    check_angle("--swing-deg", swing)
    pretensions = console.number_list("--pretension-mm", pretension, "zero or more: cables cannot push", low=0)
    bends = console.number_list("--bend-deg", bend, "angles from 0 to 60°; turn it by --azimuth-deg", low=0, high=60)
    console.checked_number("--azimuth-deg", azimuth, "an angle from -360 to 360°", low=-360, high=360)

    from sinew.predict.modes import find_modes

    with console.progress_bar("draw") as progress:
        found = find_modes(
            rig,
            pretensions,
            bend_deg=bends,
            azimuth_deg=azimuth,
            mode=cast("TendonMode", mode),
            swing_deg=swing,
            bands=bands,
            seed=seed,
            progress=progress,
        )
    document = found.to_dict()
    if out is not None:
        from sinew.figures.space import write_modes

        document["file"] = str(write_modes(found, out))
    console.print_result(document, found.blocks(), f"wrote {out}" if out else "", json=json)


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
    lines = (
        [f"{out}: {document['pieces']} pieces, {len(document['tension_n'])} tendons", modes] if modes else [str(out)]
    )
    lines += [f"- {sentence}" for sentence in document["assumptions"]]
    console.print_result(document, lines, json=json)


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
