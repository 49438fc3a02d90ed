"""This is where `sinew design` finds joints that resonate with a gait, and writes a rig and a plan for each."""

import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps.console import Json, print_json, print_table, progress_bar, require_folder, write_json
from sinew.apps.joint import BASE_RIG, write_rig
from sinew.measure.errors import FileError, SpecError
from sinew.measure.estimate import number

if TYPE_CHECKING:
    from sinew.figures.design_page import EndCurves
    from sinew.plan.plan import Plan
    from sinew.plan.rig import RigSpec
    from sinew.predict.joints.validity import Torso
    from sinew.tune.candidate import DesignTarget
    from sinew.tune.design import Confirmed, Designed, Effort
    from sinew.tune.proposal import Proposal


# Designed joints become the JSON document of `sinew design`.


def design_document(found: "Designed", target: "DesignTarget", base: str, effort: "Effort") -> dict[str, Any]:
    """Return what a search found, as JSON holds it."""
    proposals = [
        {**_joint(found.evaluated[i], bool(found.front[i])), **_proposal(found.evaluated[i], confirmed)}
        for i, confirmed in zip(found.chosen, found.confirmed, strict=True)
    ]
    return {
        "base": base,
        "target": {
            "stride_band_hz": list(target.band_hz),
            "yaw_deg": target.yaw_deg,
            "inertia_kg_m2": target.inertia,
            "envelope_mm": [1e3 * target.diameter, 1e3 * target.length],
            "torso_kg": None if target.torso is None else target.torso.mass,
            "torso_centre_mm": None if target.torso is None else 1e3 * target.torso.centre,
        },
        "assumptions": _assumptions(target),
        "effort": {**effort.__dict__},
        "candidates": found.candidates,
        "feasible": found.feasible,
        "evaluated": [_joint(one, bool(on)) for one, on in zip(found.evaluated, found.front, strict=True)],
        "proposals": proposals,
        "sentences": [*_sentences(found, proposals), *_assumptions(target)],
        "wall_s": {"search": found.search_s, "exact": found.exact_s, "confirm": found.confirm_s},
    }


def _joint(one: "Proposal", on_front: bool) -> dict[str, Any]:
    return {
        "name": one.rig.name,
        "shape": one.draft.shape,
        "material": one.draft.material,
        "feasible": not one.faults,
        "faults": list(one.faults),
        "on_front": on_front,
        "energy_j": one.energy,
        "volume_cm3": 1e6 * one.volume,
        "tension_n": one.tension,
        "diameter_mm": 1e3 * one.diameter,
        "envelope_length_mm": 1e3 * one.length,
    }


def _proposal(one: "Proposal", confirmed: "tuple[Confirmed, ...]") -> dict[str, Any]:
    from sinew.predict.joints.design import section_of
    from sinew.tune.design import ENOUGH

    rig = one.rig
    rows = [_confirmed(found) for found in confirmed]
    return {
        "section": section_of(rig).shape,
        "length_mm": 1e3 * rig.silicone.length.value,
        "tendon_circle_mm": 1e3 * rig.tendons.head_radius.value,
        "lever_inertia_kg_m2": rig.inertia.lever.value,
        "holding_a": one.holding_a,
        "ends": [_end(one, i) for i in range(2)],
        "validity": [
            {"check": c.name, "value": c.value, "limit": c.limit, "holds": c.holds, "sentence": c.sentence}
            for c in one.checks
        ],
        "confirmed": rows,
        "is_confirmed": all(row["error"] is not None and abs(row["error"]) <= ENOUGH for row in rows),
        "rig": None,
        "plan": None,
    }


def _end(one: "Proposal", i: int) -> dict[str, float]:
    at, load = one.ends[i], one.loads[i]
    return {
        "wanted_hz": one.draft.target.band_hz[i],
        "frequency_hz": at.frequency_hz,
        "pretension_mm": at.pretension_mm,
        "command_deg": math.degrees(at.command),
        "lever_deg": math.degrees(abs(at.lever)),
        "torsion_deg": math.degrees(at.torsion),
        "damping_ratio": one.damping_ratio[i],
        "rest_tension_n": at.rest_tension,
        "tension_n": at.tension,
        "torque_n_m": load.torque,
        "speed_rad_s": load.speed,
        "duty": load.duty,
        "current_a": load.current,
        "work_j": load.work,
        "energy_j": load.energy,
    }


def _confirmed(found: "Confirmed") -> dict[str, Any]:
    def number(x: float) -> float | None:
        return x if math.isfinite(x) else None

    return {
        "pretension_mm": found.pretension_mm,
        "predicted_hz": number(found.predicted_hz),
        "measured_hz": found.measured_hz.to_json(),
        "peak_hz": found.peak_hz.to_json(),
        "yaw_deg": number(found.yaw_deg),
        "error": number(found.error),
    }


def _assumptions(target: "DesignTarget") -> list[str]:
    """Return what is taken for granted of the torso, a sentence each."""
    if target.torso is None:
        return [
            "assumed: nothing presses on the joint but its tendons; the weight of what sits on it is left out, for no "
            "mass was given. Give it with --torso-kg, and buckling, strain, tension and tipping are checked under it"
        ]
    torso = target.torso
    return [
        f"assumed: {torso.mass:g} kg stand upright on the joint with their centre {1e3 * torso.centre:g} mm above the "
        f"head plate and press with {torso.weight:.0f} N; pretension counts from the first contact under that weight; "
        f"the head tilts no further than the rig allows. Candidates that fail under it are refused after the search, "
        "which does not know of it; the swing's resonance is that without weight"
    ]


def _sentences(found: "Designed", proposals: list[dict[str, Any]]) -> list[str]:
    told = [f"{found.feasible} of {found.candidates} candidates of the search keep every limit"]
    fit = sum(not one.faults for one in found.evaluated)
    told.append(f"{fit} of {len(found.evaluated)} that were computed exactly do, {int(found.front.sum())} undominated")
    if not proposals:
        told.append("no joint within these limits was found; allow a larger envelope, a narrower band or less yaw")
        return told
    sure = sum(one["is_confirmed"] for one in proposals)
    told.append(f"{sure} of {len(proposals)} proposals resonate on the full twin within 3 % of what was predicted")
    held = max(one["holding_a"] for one in proposals)
    told.append(
        f"holding the tendons takes up to {held:.2f} A of each tendon motor if its gear holds nothing; that is not in "
        "the drive's energy"
    )
    return told


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


def _shapes(text: str | None) -> list[str]:
    from sinew.tune.candidate import SHAPES

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


# Designed joints are written into a folder: rigs, plans, figures, one page.


def write_design(found: "Designed", document: dict[str, Any], folder: Path, rebuild: str) -> Path:
    """Write proposal-N/rig.toml and plan.toml, figures, design.json and design.html; return the page.

    document: gets the paths of rigs and plans. Raises FileError where the folder cannot be written.
    """
    from sinew.figures.design_page import draw_design_curves, draw_design_front, write_design_page
    from sinew.figures.style import save_figure
    from sinew.measure.netcdf import provenance
    from sinew.tune.proposal import plan_of

    curves = []
    for rank, (i, row) in enumerate(zip(found.chosen, document["proposals"], strict=True), start=1):
        one, place = found.evaluated[i], folder / f"proposal-{rank}"
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
    from sinew.figures.design_page import EndCurves
    from sinew.predict.band import COARSE
    from sinew.predict.joint import joint_problem
    from sinew.solve.curves import predict

    assert plan.sweep is not None
    band = 0.8 * plan.sweep.frequency_hz[0], 1.1 * plan.sweep.frequency_hz[-1]
    problem = joint_problem(one.rig, list(plan.pretension.pretension_mm), plan.sweep.amplitude_deg, band)
    return EndCurves(row, predict(problem, band, COARSE).branches)
