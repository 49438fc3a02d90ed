"""`sinew design`, `sinew joint` and `sinew tune`: joints that resonate with a gait, another section, the pretension."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from sinew.apps import console
from sinew.apps.console import Device, Json, Keep, RigArgument, Scheduler, Workers, option
from sinew.apps.joints.options import BASE_RIG, MODES, JointOptions, Mode, check_angle, designed_rig, with_joint_options
from sinew.measure.errors import FileError, SpecError
from sinew.measure.estimate import number

if TYPE_CHECKING:
    from sinew.figures.tuned import EndCurves
    from sinew.plan.plan import Plan, TendonMode
    from sinew.predict.joints.validity import Torso
    from sinew.tune.candidate import DesignTarget
    from sinew.tune.design import Designed, Proposal


def design(
    rig: Annotated[str, typer.Argument(metavar="RIG", help="Its motors, guides and sensors are kept.")] = BASE_RIG,
    stride: Annotated[str | None, option("LOW:HIGH", "Stride frequencies to resonate at.", "--stride-hz")] = None,
    yaw: Annotated[float | None, option("DEG", "Amplitude of the torsion.", "--yaw-deg")] = None,
    gait: Annotated[Path | None, option("gait.json", "Instead of both: what sinew gait wrote.")] = None,
    inertia: Annotated[float, option("I", "Of what sits on the joint, about its axis.", "--inertia-kg-m2")] = 0.25,
    torso: Annotated[
        float | None, option("KG", "Mass of what sits on the joint; else its weight is left out.", "--torso-kg")
    ] = None,
    centre: Annotated[
        float | None, option("MM", "Height of its centre above the head plate; else 250.", "--torso-centre-mm")
    ] = None,
    envelope: Annotated[
        str, option("DxL", "Largest diameter and length, guides included.", "--envelope-mm")
    ] = "200x250",
    shape: Annotated[str | None, option("NAME,...", "Sections; else all.")] = None,
    material: Annotated[str | None, option("NAME,...", "Silicones; `base` is the rig's; else all.")] = None,
    starts: Annotated[int, typer.Option("--starts", min=1, help="Starts for each shape and silicone.")] = 64,
    exact: Annotated[int, typer.Option("--exact", min=1, help="Candidates that are computed exactly.")] = 24,
    proposals: Annotated[int, typer.Option("--proposals", min=1, help="How many, at most.")] = 4,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the starts, and of the twin.")] = 0,
    scheduler: Scheduler = None,
    workers: Workers = 1,
    keep: Keep = None,
    device: Device = "cpu",
    out: Annotated[Path | None, option("DIR", "Rigs, plans, figures and a page.")] = None,
    json: Json = False,
) -> None:
    """Design joints whose resonance can follow a gait: section, silicone, length, tendon circle, lever, pretensions.

    Thousands of starts are improved by gradients of the twin's forces, the best are computed by harmonic balance, and
    the plans of a few that differ run on the full twin. No joint within the limits is no error: the answer says so.
    """
    from sinew.plan.toml import load_rig
    from sinew.tune.design import Effort, design_joints, known_shapes, known_silicones

    target = _target(stride, yaw, gait, inertia, envelope, _torso(torso, centre))
    base = load_rig(rig)
    silicones, shapes = known_silicones(base, _names(material)), known_shapes(_names(shape))
    if out is not None:
        console.require_folder(out)
    spread = console.spread_of(scheduler, workers, keep, device)
    effort = Effort(starts, exact, proposals, seed)
    with console.progress_bar("design") as bar:
        found = design_joints(
            base,
            target,
            silicones,
            shapes,
            effort,
            spread=spread,
            progress=lambda _, done, total: bar(done, total),
        )
    document = found.document()
    if out is not None:
        words = ["sinew", "design", rig, "--stride-hz", f"{target.band_hz[0]:g}:{target.band_hz[1]:g}"]
        words += ["--yaw-deg", f"{target.yaw_deg:g}", "--inertia-kg-m2", f"{inertia:g}", "--envelope-mm", envelope]
        if target.torso is not None:
            words += ["--torso-kg", f"{target.torso.mass:g}", "--torso-centre-mm", f"{1e3 * target.torso.centre:g}"]
        words += [w for flag, value in (("--shape", shape), ("--material", material)) if value for w in (flag, value)]
        words += ["--starts", str(starts), "--exact", str(exact), "--proposals", str(proposals), "--seed", str(seed)]
        write_design(found, document, out, shlex.join([*words, "--out", str(out)]))
    console.print_result(document, found.told(), f"page: {out / 'design.html'}" if out else "", json=json)


def read_gait(path: Path) -> tuple[tuple[float, float], float]:
    """Return (stride band [Hz], yaw amplitude [deg]) of a file that `sinew gait` wrote. Raises FileError, SpecError."""
    import json

    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}") from error
    except ValueError as error:
        raise SpecError(f"{path} is no JSON; give the gait.json of sinew gait --out") from error
    try:
        low, high = (float(value) for value in document["stride_band_hz"])
        return (low, high), float(document["yaw_amplitude_deg"]["value"])
    except (KeyError, TypeError, ValueError) as error:
        raise SpecError(
            f"{path} holds no stride_band_hz and yaw_amplitude_deg; give the gait.json of sinew gait"
        ) from error


def _torso(mass: float | None, centre_mm: float | None) -> "Torso | None":
    from sinew.predict.joints.validity import Torso

    if mass is None:
        if centre_mm is not None:
            raise SpecError("--torso-centre-mm belongs to --torso-kg, which is missing")
        return None
    return Torso(mass) if centre_mm is None else Torso(mass, 1e-3 * centre_mm)


def _target(
    stride: str | None, yaw: float | None, gait: Path | None, inertia: float, envelope: str, torso: "Torso | None"
) -> "DesignTarget":
    from sinew.tune.candidate import DesignTarget

    if (gait is None) == (stride is None and yaw is None) or (gait is None and (stride is None or yaw is None)):
        raise SpecError("expected --stride-hz LOW:HIGH with --yaw-deg, or --gait gait.json, and not both")
    if gait is not None:
        band, degrees = read_gait(gait)
    else:
        assert stride is not None
        assert yaw is not None
        band, degrees = _pair(stride, ":", "--stride-hz", "LOW:HIGH in hertz, as 0.7:1.1"), yaw
    diameter, length = _pair(envelope.lower(), "x", "--envelope-mm", "DxL in millimetres, as 200x250")
    return DesignTarget(band, degrees, inertia, 1e-3 * diameter, 1e-3 * length, torso=torso)


def _pair(text: str, mark: str, option: str, expected: str) -> tuple[float, float]:
    first, found, second = text.partition(mark)
    try:
        if found:
            return float(first), float(second)
    except ValueError:
        pass
    raise SpecError(f"{option} is {text!r}, expected {expected}")


def _names(text: str | None) -> list[str] | None:
    return None if text is None else list(dict.fromkeys(part.strip() for part in text.split(",")))


# Designed joints are written into a folder: rigs, plans, figures, one page.


def write_design(found: "Designed", document: dict[str, Any], folder: Path, rebuild: str) -> Path:
    """Write proposal-N/rig.toml and plan.toml, figures, design.json and design.html; return the page.

    document: gets the paths of rigs and plans. Raises FileError where the folder cannot be written.
    """
    from sinew.figures.style import save_figure
    from sinew.figures.tuned import draw_design_curves, draw_design_front, write_design_page
    from sinew.measure.files.netcdf import provenance
    from sinew.plan.toml import save_plan, save_rig
    from sinew.tune.design import plan_of

    curves = []
    for rank, (i, row) in enumerate(zip(found.chosen, document["proposals"], strict=True), start=1):
        one, place = found.evaluated[i], folder / f"proposal-{rank}"
        plan = plan_of(one)
        place.mkdir(parents=True, exist_ok=True)
        save_rig(one.rig, place / "rig.toml")
        save_plan(plan, place / "plan.toml")
        row["rig"], row["plan"] = (str(place / name) for name in ("rig.toml", "plan.toml"))
        curves.append(_curves(one, plan, row))
    figures = []
    if document["evaluated"]:
        figure = draw_design_front(document["evaluated"], document["proposals"])
        figures += save_figure(figure, folder / "figures", "design_front", ("png", "pdf"))
    if curves:
        figure = draw_design_curves(curves, document["target"]["yaw_deg"])
        figures += save_figure(figure, folder / "figures", "design_curves", ("png", "pdf"))
    console.write_json(document, folder / "design.json")
    return write_design_page(
        folder / "design.html",
        document,
        figures=figures,
        rebuild=rebuild,
        origins=[("versions", str(provenance("twin")["versions"]))],
    )


def _curves(one: "Proposal", plan: "Plan", row: dict[str, Any]) -> "EndCurves":
    from sinew.figures.tuned import EndCurves
    from sinew.predict.band import COARSE
    from sinew.predict.joint import joint_problem
    from sinew.solve.curves import predict

    assert plan.sweep is not None
    band = 0.8 * plan.sweep.frequency_hz[0], 1.1 * plan.sweep.frequency_hz[-1]
    problem = joint_problem(one.rig, list(plan.pretension.pretension_mm), plan.sweep.amplitude_deg, band)
    return EndCurves(row, predict(problem, band, COARSE).branches)


# ---- `sinew joint`: the rig of a joint that is not built yet


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


# ---- `sinew tune`: the pretension at which a rig resonates at a wanted frequency


def tune(
    rig: RigArgument,
    resonance: Annotated[str, option("F,...", "Where it is to resonate: 90° of lag.", "--resonance-hz")],
    amplitude: Annotated[
        float | None, option("DEG", "Amplitude of the drive's command; else 20.", "--amplitude-deg")
    ] = None,
    yaw: Annotated[
        float | None, option("DEG", "Instead: amplitude of the torsion; the command is found.", "--yaw-deg")
    ] = None,
    mode: Mode = "position",
    bands: Annotated[int | None, option("N", "Draws for the 90 % intervals; else 100, and 0 for none.", min=0)] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the draws.")] = 0,
    json: Json = False,
) -> None:
    """Find the pretension that makes a rig resonate at a wanted frequency, and the range that it can reach.

    A rig that `sinew calibrate` wrote knows how far it can be off: pretension and frequency get 90 % intervals. A
    frequency that is out of reach is no error: the answer says why, and the exit status is 0.
    """
    from sinew.tune.pretension import tune as run

    if amplitude is not None and yaw is not None:
        raise SpecError("found --amplitude-deg and --yaw-deg; expected one of them")
    console.check_choice("--mode", mode, MODES)
    for flag, asked in (("--amplitude-deg", amplitude), ("--yaw-deg", yaw)):
        if asked is not None:
            check_angle(flag, asked)
    expected = f"frequencies above 0 and up to {console.HIGHEST_HZ:g} Hz, as 3.2,3.6"
    wanted = console.number_list("--resonance-hz", resonance, expected, low=0, high=console.HIGHEST_HZ, above=True)
    held = cast("TendonMode", mode)
    with console.progress_bar("draw") as progress:
        found = run(
            rig, wanted, amplitude_deg=amplitude, yaw_deg=yaw, mode=held, bands=bands, seed=seed, progress=progress
        )
    console.print_result(found.document(), found.told(), json=json)
