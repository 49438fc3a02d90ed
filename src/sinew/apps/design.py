"""This is where `sinew design` finds joints that resonate with a gait, and writes a rig and a plan for each."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps.console import print_json, print_table, progress_bar, require_folder
from sinew.apps.design_document import design_document
from sinew.apps.joint_options import BASE_RIG
from sinew.apps.options import Json
from sinew.measure.errors import FileError, SpecError
from sinew.measure.estimate import number

if TYPE_CHECKING:
    from sinew.plan.rig import RigSpec
    from sinew.predict.joints.loads import Torso
    from sinew.tune.design_target import DesignTarget

__all__ = ["design", "read_gait"]


def design(
    rig: Annotated[str, typer.Argument(metavar="RIG", help="Its motors, guides and sensors are kept.")] = BASE_RIG,
    stride: Annotated[
        str | None, typer.Option("--stride-hz", metavar="LOW:HIGH", help="Stride frequencies to resonate at.")
    ] = None,
    yaw: Annotated[float | None, typer.Option("--yaw-deg", metavar="DEG", help="Amplitude of the torsion.")] = None,
    gait: Annotated[
        Path | None, typer.Option("--gait", metavar="gait.json", help="Instead of both: what sinew gait wrote.")
    ] = None,
    inertia: Annotated[
        float, typer.Option("--inertia-kg-m2", metavar="I", help="Of what sits on the joint, about its axis.")
    ] = 0.25,
    torso: Annotated[
        float | None,
        typer.Option("--torso-kg", metavar="KG", help="Mass of what sits on the joint; else its weight is left out."),
    ] = None,
    centre: Annotated[
        float | None,
        typer.Option("--torso-centre-mm", metavar="MM", help="Height of its centre above the head plate; else 250."),
    ] = None,
    envelope: Annotated[
        str, typer.Option("--envelope-mm", metavar="DxL", help="Largest diameter and length, guides included.")
    ] = "200x250",
    shape: Annotated[str | None, typer.Option("--shape", metavar="NAME,...", help="Sections; else all.")] = None,
    material: Annotated[
        str | None, typer.Option("--material", metavar="NAME,...", help="Silicones; `base` is the rig's; else all.")
    ] = None,
    starts: Annotated[int, typer.Option("--starts", min=1, help="Starts for each shape and silicone.")] = 64,
    exact: Annotated[int, typer.Option("--exact", min=1, help="Candidates that are computed exactly.")] = 24,
    proposals: Annotated[int, typer.Option("--proposals", min=1, help="How many, at most.")] = 4,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the starts, and of the twin.")] = 0,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="ADDRESS", help="A Dask scheduler whose workers do it.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Rigs, plans, figures and a page.")] = None,
    json: Json = False,
) -> None:
    """Design joints whose resonance can follow a gait: section, silicone, length, tendon circle, lever, pretensions.

    Thousands of starts are improved by gradients of the twin's forces, the best are computed by harmonic balance, and
    the plans of a few that differ run on the full twin. No joint within the limits is no error: the answer says so.
    """
    from sinew.plan.toml import load_rig
    from sinew.tune.design import Effort, design_joints

    target = _target(stride, yaw, gait, inertia, envelope, _torso(torso, centre))
    base = load_rig(rig)
    silicones, shapes = _silicones(base, material), _shapes(shape)
    if out is not None:
        require_folder(out)
    effort = Effort(starts, exact, proposals, seed)
    with progress_bar("design") as bar:
        found = design_joints(
            base,
            target,
            silicones,
            shapes,
            effort,
            scheduler=scheduler,
            progress=lambda _, done, total: bar(done, total),
        )
    document = design_document(found, target, base.name, effort)
    if out is not None:
        from sinew.apps.design_pages import write_design

        words = ["sinew", "design", rig, "--stride-hz", f"{target.band_hz[0]:g}:{target.band_hz[1]:g}"]
        words += ["--yaw-deg", f"{target.yaw_deg:g}", "--inertia-kg-m2", f"{inertia:g}", "--envelope-mm", envelope]
        if target.torso is not None:
            words += ["--torso-kg", f"{target.torso.mass:g}", "--torso-centre-mm", f"{1e3 * target.torso.centre:g}"]
        words += [w for flag, value in (("--shape", shape), ("--material", material)) if value for w in (flag, value)]
        words += ["--starts", str(starts), "--exact", str(exact), "--proposals", str(proposals), "--seed", str(seed)]
        write_design(found, document, out, shlex.join([*words, "--out", str(out)]))
    if json:
        print_json(document)
    else:
        _print(document, out)


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
    from sinew.predict.joints.loads import Torso

    if mass is None:
        if centre_mm is not None:
            raise SpecError("--torso-centre-mm belongs to --torso-kg, which is missing")
        return None
    return Torso(mass) if centre_mm is None else Torso(mass, 1e-3 * centre_mm)


def _target(
    stride: str | None, yaw: float | None, gait: Path | None, inertia: float, envelope: str, torso: "Torso | None"
) -> "DesignTarget":
    from sinew.tune.design_target import DesignTarget

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


def _shapes(text: str | None) -> list[str]:
    from sinew.tune.shapes import SHAPES

    names = list(SHAPES) if text is None else list(dict.fromkeys(part.strip() for part in text.split(",")))
    for name in names:
        if name not in SHAPES:
            raise SpecError(f"--shape holds {name!r}, expected some of {', '.join(SHAPES)}")
    return names


def _silicones(base: "RigSpec", text: str | None) -> dict[str, float]:
    """Return name and shear modulus [Pa] of each silicone that may be used."""
    from sinew.predict.joints.design import shear_modulus_of
    from sinew.predict.joints.material import list_materials, load_material

    names = ["base", *list_materials()] if text is None else [part.strip() for part in text.split(",")]
    known = {}
    for name in names:
        if name == "base":
            known["base"] = shear_modulus_of(base)
        else:
            one = load_material(name)
            known[one.name] = one.shear_modulus.value
    return known


def _print(document: dict[str, Any], out: Path | None) -> None:
    rows = []
    for i, one in enumerate(document["proposals"], start=1):
        twin = ", ".join("-" if end["error"] is None else f"{end['error']:+.1%}" for end in one["confirmed"])
        pretensions = " to ".join(number(end["pretension_mm"], 3) for end in one["ends"])
        size = f"{one['diameter_mm']:.0f} x {one['envelope_length_mm']:.0f}"
        energy, tension = f"{1e3 * one['energy_j']:.0f}", f"{one['tension_n']:.0f}"
        rows.append((f"{i} {one['name']}", pretensions, size, energy, tension, twin))
    columns = ("proposal", "pretension/mm", "envelope/mm", "energy/mJ", "tension/N", "twin off by")
    if rows:
        print_table(columns, rows)
    for sentence in document["sentences"]:
        print(f"- {sentence}")
    if out is not None:
        print(f"page: {out / 'design.html'}")
