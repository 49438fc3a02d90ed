"""`sinew transfer`: transfer functions of a rig, linear at rest and over the amplitude."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

from sinew.apps import console
from sinew.apps.console import Json, RigArgument, Without, option
from sinew.apps.joints.options import MODES
from sinew.measure.errors import SpecError
from sinew.measure.estimate import fixed, number

if TYPE_CHECKING:
    from sinew.plan.plan import TendonMode
    from sinew.plan.rig import RigSpec
    from sinew.predict.bent import BentJoint
    from sinew.predict.linear import Gear
    from sinew.twin.parameters import Effects


def transfer(
    rig: RigArgument,
    pretension: Annotated[
        str, option("MM,...", "Pretensions, one linear joint for each.", "--pretension-mm")
    ] = "0,4,8,12",
    gear: Annotated[
        str, option("sliding|creeping", "Friction of the gear: the lever slides, or hardly moves.")
    ] = "sliding",
    amplitude: Annotated[
        str | None, option("DEG,...", "Also the describing function at these commands.", "--amplitude-deg")
    ] = None,
    start: Annotated[float, option("HZ", "Its lowest frequency.", "--from-hz")] = 1.0,
    stop: Annotated[float, option("HZ", "Its highest frequency.", "--to-hz")] = 6.0,
    mode: Annotated[str, option("|".join(MODES), "Mode of the motors.")] = "position",
    bend: Annotated[
        float | None, option("DEG", "Also in space, the head bent by this: from lever and tendons.", "--bend-deg")
    ] = None,
    azimuth: Annotated[float, option("DEG", "Direction of the bend, from y towards z.", "--azimuth-deg")] = 0.0,
    without: Without = None,
    out: Annotated[Path | None, option("PATH", "FILE.json, FILE.mat, or a folder for both.")] = None,
    json: Json = False,
) -> None:
    """Give the transfer functions of a rig's joint: linear at rest, and the describing function over amplitude.

    Linear: state space, poles, zeros and gains, from command, lever and torque on the head to torsion, for
    python-control and MATLAB. Where linear is not enough, --amplitude-deg gives gain and lag of the fundamental, and
    the joint's equivalent stiffness and damping, at each amplitude of the command.
    With --bend-deg, zero for a straight joint, also the joint in space: from the lever's angle, from what the motors
    take up of the tendons in pitch, roll and alike, and from a torque, to torsion, pitch, roll and axial motion.
    """
    pretensions = console.number_list("--pretension-mm", pretension, "zero or more: cables cannot push", low=0)
    expected = f"positive angles up to {console.LARGEST_DEG:g}°"
    amplitudes = []
    if amplitude is not None:
        amplitudes = console.number_list(
            "--amplitude-deg", amplitude, expected, low=0, high=console.LARGEST_DEG, above=True
        )
    console.checked_band((start, stop))
    console.check_choice("--mode", mode, MODES)
    if bend is not None:
        console.checked_number("--bend-deg", bend, "0 to 60°; turn it by --azimuth-deg", low=0, high=60)
        if without:
            raise SpecError(f"found --without {without[0]} with --bend-deg; in space all effects act, leave one out")
    elif azimuth:
        raise SpecError("found --azimuth-deg without --bend-deg; say how far the head is bent")
    if out is not None:
        if out.suffix not in ("", ".json", ".mat"):
            raise SpecError(f"--out is {out}, expected a name that ends with .json or .mat, or a folder")
        (console.require_file if out.suffix else console.require_folder)(out)

    from sinew.plan.toml import load_rig
    from sinew.predict.linear import GEARS, joint_document, linear_joints, write_transfer
    from sinew.predict.predicted import refuse_pretensions
    from sinew.twin.parameters import Effects

    console.check_choice("--gear", gear, GEARS)
    spec = load_rig(rig)
    refuse_pretensions(spec, pretensions)
    effects = Effects().without(*(without or []))
    held = cast("TendonMode", mode)
    joints = linear_joints(spec, pretensions, gear=cast("Gear", gear), mode=held, effects=effects)
    document: dict[str, Any] = {
        "rig": spec.name,
        "gear": gear,
        "mode": mode,
        "effects_off": [name for name in Effects.names() if not getattr(effects, name)],
        "joints": [joint_document(joint) for joint in joints],
    }
    if amplitudes:
        document["describing"] = _describing(spec, pretensions, amplitudes, (start, stop), held, effects)
    bent: tuple[BentJoint, ...] = ()
    if bend is not None:
        from sinew.predict.bent import bent_document, bent_joints

        bent = bent_joints(spec, pretensions, bend, azimuth_deg=azimuth, mode=held)
        document["space"] = [bent_document(joint) for joint in bent]
    if out is not None:
        files = write_transfer(joints, document, out, [joint.system for joint in bent])
        document["files"] = [str(file) for file in files]
    if json:
        console.print_json(document)
    else:
        _print(document)


def _ratio(ratio: Any) -> dict[str, list[float]]:
    import numpy as np

    from sinew.measure.arrays import wrapped_lag

    return {"gain": np.abs(ratio).tolist(), "lag_deg": np.degrees(wrapped_lag(ratio)).tolist()}


def _describing(
    rig: "RigSpec",
    pretensions: list[float],
    amplitudes: list[float],
    band_hz: tuple[float, float],
    mode: "TendonMode",
    effects: "Effects",
) -> list[dict[str, Any]]:
    import math

    from sinew.predict.joint import RESOLUTION, joint_problem
    from sinew.predict.linear import describing_function
    from sinew.predict.predicted import equivalent_document
    from sinew.solve.curves import predict

    lanes = [(mm, degrees) for mm in pretensions for degrees in amplitudes]
    problem = joint_problem(
        rig, [mm for mm, _ in lanes], [degrees for _, degrees in lanes], band_hz, mode=mode, effects=effects
    )
    rows = []
    for (mm, degrees), branch in zip(lanes, predict(problem, band_hz, RESOLUTION).branches, strict=True):
        found = describing_function(branch, math.radians(degrees), rig, prescribed=problem.equations.drive is None)
        rows.append(
            {
                "pretension_mm": mm,
                "command_deg": degrees,
                "frequency_hz": branch.frequency_hz.tolist(),
                "torsion_per_command": _ratio(found.torsion_per_command),
                "torsion_per_lever": _ratio(found.torsion_per_lever),
                "lever_per_command": _ratio(found.lever_per_command),
                **equivalent_document(found.equivalent),
                "stable": branch.stable.tolist(),
                "complete": branch.complete,
                "message": branch.message,
            }
        )
    return rows


def _print(document: dict[str, Any]) -> None:
    def swings(system: dict[str, Any]) -> str:
        pairs = [pole for pole in system["poles"] if pole["imag_per_s"] > 0]
        return (
            "; ".join(f"{number(p['frequency_hz'], unit='Hz')}, D {number(p['damping_ratio'], 3)}" for p in pairs)
            or "none"
        )

    rows = []
    for joint in document["joints"]:
        static = next(c["static_gain"] for c in joint["lever"]["channels"] if c["input"] == "torque_n_m")
        cells = number(joint["tension_n"], 3), number(1 / static)
        rows.append((f"{joint['pretension_mm']:g}", *cells, swings(joint["lever"]), swings(joint["drive"])))
    columns = "pretension/mm", "tension/N", "static stiffness/(N m/rad)", "lever as told", f"servo, {document['gear']}"
    console.print_table(columns, rows, "linear at rest: undamped frequency and damping ratio of the poles that swing")
    if "describing" in document:
        _print_describing(document["describing"])
    if "space" in document:
        _print_space(document["space"])
    for note in document["joints"][0]["notes"]:
        print(f"- at {document['joints'][0]['pretension_mm']:g} mm {note}")
    for file in document.get("files", []):
        print(f"wrote {file}")


def _print_describing(describing: list[dict[str, Any]]) -> None:
    rows = []
    for one in describing:
        gains = one["torsion_per_command"]["gain"]
        top = gains.index(max(gains)) if gains else None
        if top is None:
            rows.append((f"{one['pretension_mm']:g}", f"{one['command_deg']:g}", *["-"] * 6))
            continue
        at = one["torsion_per_command"]["lag_deg"][top], one["lever_per_command"]["gain"][top]
        ratio = one["damping_ratio"][top]
        rows.append(
            (
                f"{one['pretension_mm']:g}",
                f"{one['command_deg']:g}",
                number(one["frequency_hz"][top]),
                number(gains[top]),
                fixed(at[0], 1),
                number(at[1]),
                number(one["stiffness_n_m_rad"][top]),
                number(ratio, 3),
            )
        )
    columns = "pretension/mm", "command/°", "peak/Hz", "torsion/command", "lag/°", "lever/command", "k/(N m/rad)", "D"
    console.print_table(columns, rows, "describing function where torsion over command is largest")
    for one in describing:
        if not one["complete"]:
            print(f"- at {one['pretension_mm']:g} mm and {one['command_deg']:g}° {one['message']}")


def _print_space(joints: list[dict[str, Any]]) -> None:
    rows = []
    for one in joints:
        swung = [pole for pole in one["poles"] if pole["imag_per_s"] > 0 and pole["damping_ratio"] < 1]
        slow = "; ".join(
            f"{number(p['frequency_hz'], unit='Hz')}, D {number(p['damping_ratio'], 2)}" for p in swung[:3]
        )
        gain = one["static_gain"]
        rows.append(
            (
                f"{one['pretension_mm']:g}",
                f"{one['bend_deg']:g}" + ("" if one["taut"] else " (slack)"),
                number(1 / gain["torque_n_m"]["torsion_rad"]),
                number(1e-3 * 57.29578 * gain["pitch_take_up_m"]["pitch_rad"], 3),
                number(1e-3 * 57.29578 * gain["roll_take_up_m"]["roll_rad"], 3),
                slow,
                f"{100 * one['cut']:.2g}",
            )
        )
    columns = (
        *("pretension/mm", "bend/°", "static stiffness/(N m/rad)", "pitch/(°/mm)", "roll/(°/mm)"),
        *("slowest poles", "cut/%"),
    )
    console.print_table(columns, rows, "in space: lever and tendons to torsion, pitch, roll and axial motion")
