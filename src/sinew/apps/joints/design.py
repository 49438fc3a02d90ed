"""`sinew design`, `sinew joint`, `sinew tune` and `sinew calibrate`: commands that make or set a rig."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, cast

import typer

from sinew.apps import console
from sinew.apps.console import Device, Json, Keep, RigArgument, Scheduler, Workers, flag, option
from sinew.apps.joints.options import BASE_RIG, MODES, JointOptions, Mode, check_angle, designed_rig, with_options
from sinew.measure.errors import RecordingError, SpecError

if TYPE_CHECKING:
    from sinew.identify.joint.calibration import CalibrationResult
    from sinew.measure.tasks import Spread
    from sinew.plan.plan import TendonMode
    from sinew.tune.design import Designed
    from sinew.tune.gait import GaitTarget


def _walk(metavar: str, help_: str, *flags: str) -> Any:
    return typer.Option(*flags, metavar=metavar, help=f"Walk: {help_}")


class WalkOptions(NamedTuple):
    """Recordings of walking, and how they are read; None where nothing was said."""

    walk: Annotated[list[Path] | None, _walk("FILE", "a recording, CSV or npz; may be repeated.", "--walk")] = None
    pelvis: Annotated[str | None, _walk("NAME|LEFT,RIGHT", "sensor or pair of markers on the pelvis.")] = None
    trunk: Annotated[str | None, _walk("NAME|LEFT,RIGHT", "the same on the trunk or shoulders.")] = None
    yaw_column: Annotated[str | None, _walk("COL[:unit]", "instead of both: a column of trunk against pelvis.")] = None
    time: Annotated[str | None, _walk("COL[:unit]", "column of the time stamps.")] = None
    start: Annotated[float | None, _walk("S", "take samples from this time on [s].")] = None
    stop: Annotated[float | None, _walk("S", "take samples up to this time [s].")] = None
    up: Annotated[str | None, _walk("x|y|z", "the markers' upward axis; else z.")] = None
    gyro_unit: Annotated[str | None, _walk("UNIT", "where names do not say it; else rad/s.")] = None
    acc_unit: Annotated[str | None, _walk("UNIT", "the same (g_0 for gravities); else m/s2.")] = None


def _gait_of(options: WalkOptions) -> "tuple[GaitTarget, list[str]]":
    """Return the stride frequency and yaw of recordings of walking, and remarks on how they were read.

    Raises SpecError where options do not go together, FileError or RecordingError for a file that holds no gait.
    """
    from sinew.measure.files.walk import WalkColumns, read_walk
    from sinew.tune.gait import body_motion, estimate_gait, target_of_walks

    bodies = {role: name for role in ("pelvis", "trunk") if (name := getattr(options, role)) is not None}
    if options.yaw_column is not None and bodies:
        raise SpecError("--yaw-column is an angle that is ready; leave --pelvis and --trunk out")
    up = options.up or "z"
    console.check_choice("--up", up, ("x", "y", "z"))
    columns = WalkColumns(
        time=options.time,
        bodies=bodies,
        yaw=options.yaw_column,
        up=up,
        gyro_unit=options.gyro_unit,
        acceleration_unit=options.acc_unit,
    )
    walks, notes = [], []
    for file in options.walk or ():
        try:
            record = read_walk(file, columns, start_s=options.start, stop_s=options.stop)
            walks.append(estimate_gait(body_motion(record), file.name))
        except RecordingError as error:
            raise type(error)(f"{file.name}: {error}") from error
        parts = ", ".join(f"{role} by {name}" for role, name in record.names.items()) or "yaw as given"
        notes += [f"{file.name}: {note}" for note in (parts, *record.notes)]
    return target_of_walks(walks), notes


@with_options
def design(
    context: typer.Context,
    rig: Annotated[str, typer.Argument(metavar="RIG", help="Its motors, guides and sensors are kept.")] = BASE_RIG,
    stride: Annotated[str | None, option("LOW:HIGH", "Stride frequencies to resonate at.", "--stride-hz")] = None,
    yaw: Annotated[float | None, option("DEG", "Amplitude of the torsion.", "--yaw-deg")] = None,
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
    gait_only: Annotated[bool, flag("--gait-only", "Walk: find the gait, and design nothing.")] = False,
    out: Annotated[Path | None, option("DIR", "Rigs, plans, figures and a page; of --walk also gait.json.")] = None,
    *,
    walk: WalkOptions,
    json: Json = False,
) -> None:
    """Design joints whose resonance can follow a gait.

    The gait is given by --stride-hz and --yaw-deg, or found in recordings of walking, --walk: stride frequency and the
    yaw between trunk and pelvis, with 90 % intervals; several files give one band. Sensors and markers are found by
    their usual names: an npz file with t, hip_gyr, hip_acc, upper_back_gyr and so on, columns hip_gyr_x and so on, or
    markers LASI_x_mm, RASI, LSHO, RSHO.

    Section, silicone, length, tendon circle, lever and pretensions. Thousands of starts are improved by gradients
    of the twin's forces, the best are computed by harmonic balance, and the plans of a few that differ run on the
    full twin. No joint within the limits is no error: the answer says so.
    """
    from sinew.tune.design import design as run

    if out is not None:
        console.require_folder(out)
    gait = _gait(walk, stride, yaw, out, only=gait_only, json=json)
    if gait_only:
        return
    if torso is None and centre is not None:
        raise SpecError("--torso-centre-mm belongs to --torso-kg, which is missing")
    with console.progress_bar("design") as bar:
        found = run(
            *_band_and_yaw(stride, yaw, gait),
            rig,
            inertia_kg_m2=inertia,
            torso_kg=torso,
            torso_centre_mm=250.0 if centre is None else centre,
            envelope_mm=_pair(envelope.lower(), "x", "--envelope-mm", "DxL in millimetres, as 200x250"),
            shapes=_names(shape),
            materials=_names(material),
            starts=starts,
            exact=exact,
            proposals=proposals,
            seed=seed,
            spread=console.spread_of(scheduler, workers, keep, device),
            progress=lambda _, done, total: bar(done, total),
        )
    document = found.to_dict()
    if gait is not None:
        document["gait"] = gait.to_dict()
    if out is not None:
        write_design(found, document, out, console.command_line(context))
    console.print_result(document, found.blocks(), f"page: {out / 'design.html'}" if out else "", json=json)


def _gait(
    walk: WalkOptions, stride: str | None, yaw: float | None, out: Path | None, *, only: bool, json: bool
) -> "GaitTarget | None":
    """Return the gait of recordings of walking, None without any; print it, unless in a design's document, and write
    gait.json where `out` says so. Raises SpecError where options do not go together."""
    if not walk.walk:
        given = [f"--{name.replace('_', '-')}" for name, value in walk._asdict().items() if value is not None]
        if only or given:
            raise SpecError(f"{'--gait-only' if only else given[0]} is about recordings of walking; name one by --walk")
        return None
    if stride is not None or yaw is not None:
        raise SpecError("found --walk with --stride-hz or --yaw-deg; expected either the recording or the two numbers")
    gait, notes = _gait_of(walk)
    document = gait.to_dict()
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        document["files"] = [str(out / "gait.json")]
        console.write_json(document, out / "gait.json")
    if not json:
        console.print_lines(gait.blocks())
    elif only:
        console.print_json(document)
    for note in notes:
        console.remark(note)
    return gait


def _band_and_yaw(
    stride: str | None, yaw: float | None, gait: "GaitTarget | None"
) -> tuple[tuple[float, float], float]:
    if gait is not None:
        return gait.stride_band_hz, gait.yaw_amplitude_deg.value
    if stride is None or yaw is None:
        raise SpecError("expected --stride-hz LOW:HIGH with --yaw-deg, or --walk FILE")
    return _pair(stride, ":", "--stride-hz", "LOW:HIGH in hertz, as 0.7:1.1"), yaw


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
    from sinew.figures.tuned import EndCurves, draw_design_curves, draw_design_front, write_design_page
    from sinew.measure.files.netcdf import provenance
    from sinew.plan.toml import save_plan, save_rig
    from sinew.predict.band import COARSE
    from sinew.predict.joint import joint_problem
    from sinew.solve.curves import predict
    from sinew.tune.design import plan_of

    curves = []
    for rank, (one, row) in enumerate(zip(found.proposals, document["proposals"], strict=True), start=1):
        plan, own = plan_of(one), folder / f"proposal-{rank}"
        assert plan.sweep is not None
        own.mkdir(parents=True, exist_ok=True)
        save_rig(one.rig, own / "rig.toml")
        save_plan(plan, own / "plan.toml")
        row |= {"rig": str(own / "rig.toml"), "plan": str(own / "plan.toml")}
        band = 0.8 * plan.sweep.frequency_hz[0], 1.1 * plan.sweep.frequency_hz[-1]
        problem = joint_problem(one.rig, list(plan.pretension.pretension_mm), plan.sweep.amplitude_deg, band)
        curves.append(EndCurves(one, predict(problem, band, COARSE).branches))
    drawn = {}
    if found.evaluated:
        drawn["design_front"] = draw_design_front(found.evaluated, found.proposals)
    if curves:
        drawn["design_curves"] = draw_design_curves(curves, found.target.yaw_deg)
    kinds = ("png", "pdf")
    figures = [path for name, one in drawn.items() for path in save_figure(one, folder / "figures", name, kinds)]
    console.write_json(document, folder / "design.json")
    versions = str(provenance("twin")["versions"])
    return write_design_page(folder / "design.html", found, figures, rebuild, versions)


# ---- `sinew joint`: the rig of a joint that is not built yet


@with_options
def joint(
    rig: Annotated[str, typer.Argument(metavar="RIG", help="The rig to derive it from; else the paper's.")] = BASE_RIG,
    out: Annotated[Path | None, option("RIG.toml", "Write the rig into this file.")] = None,
    *,
    joint: JointOptions,
    json: Json = False,
) -> None:
    """Make a rig of another section, length or material.

    Tendons and inertia may differ as well. What is not said stays as in the rig it is derived from. Every changed
    parameter is marked as assumed.
    """
    if not joint.given:
        raise SpecError("found nothing to change; say for instance --section annulus --outer-mm 60 --inner-mm 30")
    if out is not None:
        console.require_file(out)
    from sinew.plan.toml import save_rig
    from sinew.predict.design import designed_joint

    made, design = designed_rig(rig, joint)
    assert design is not None
    found = designed_joint(made, design)
    document = {"name": made.name, **found.to_dict(), "out": None if out is None else str(out)}
    if out is not None:
        save_rig(made, out)
    console.print_result(document, [made.name, *found.blocks()], f"rig: {out}" if out else "", json=json)


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
    """Find the pretension for a wanted resonance.

    The range that can be reached is said as well. A rig that `sinew calibrate` wrote knows how far it can be off:
    pretension and frequency get 90 % intervals. A frequency that is out of reach is no error: the answer says why,
    and the exit status is 0.
    """
    from sinew.tune.pretension import tune as run

    if amplitude is not None and yaw is not None:
        raise SpecError("found --amplitude-deg and --yaw-deg; expected one of them")
    console.check_choice("--mode", mode, MODES)
    for name, degrees in (("--amplitude-deg", amplitude), ("--yaw-deg", yaw)):
        if degrees is not None:
            check_angle(name, degrees)
    expected = f"frequencies above 0 and up to {console.HIGHEST_HZ:g} Hz, as 3.2,3.6"
    wanted = console.number_list("--resonance-hz", resonance, expected, low=0, high=console.HIGHEST_HZ, above=True)
    held = cast("TendonMode", mode)
    with console.progress_bar("draw") as progress:
        found = run(
            rig, wanted, amplitude_deg=amplitude, yaw_deg=yaw, mode=held, bands=bands, seed=seed, progress=progress
        )
    console.print_result(found.to_dict(), found.blocks(), json=json)


# ---- `sinew calibrate`: a rig with the parameters that recordings, or the paper's numbers, have for it


def calibrate(
    rig: RigArgument,
    out: Annotated[Path, option("RIG2", "The rig to write, TOML; its stem names it.")],
    recordings: Annotated[
        list[Path] | None, typer.Argument(metavar="RECORDING", help="Recordings of that rig (NetCDF).")
    ] = None,
    free: Annotated[
        str | None, option("NAME,...", "Parameters to find, as tendons.head_radius; else the usual.")
    ] = None,
    paper: Annotated[bool, flag("--paper", "Fit to the numbers of the paper, without recordings.")] = False,
    posterior: Annotated[
        bool, flag("--posterior", "With --paper: what the numbers determine, as RIG2-posterior.json.")
    ] = False,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the posterior's draws.")] = 0,
    scheduler: Scheduler = None,
    workers: Workers = 1,
    keep: Keep = None,
    device: Device = "cpu",
    json: Json = False,
) -> None:
    """Write a rig whose parameters come from recordings.

    Each parameter has origin, 90 % interval and source. What the recordings do not determine keeps its old value
    and origin. With --paper the ten parameters that the paper does not print are fitted to the numbers that it
    does; --posterior takes minutes.
    """
    files = recordings or []
    _refuse_mixture(files, free, paper=paper, posterior=posterior)
    if out.suffix != ".toml":
        raise SpecError(f"--out is {out}, expected a name that ends with .toml")
    also = out.with_name(f"{out.stem}-posterior.json") if posterior else None
    for path in (out, *([] if also is None else [also])):
        console.require_file(path, reads=rig)
    spread = console.spread_of(scheduler, workers, keep, device)
    command = ["sinew", "calibrate", rig, *map(str, files), *(["--free", free] if free else [])]
    command += ["--paper"] if paper else []
    found: CalibrationResult
    if paper:
        found = _from_paper(rig, out, also, seed, command, spread)
    else:
        found = _from_recordings(rig, files, out, free, command, spread)
    made = f"{out}: rig {found.name}, calibrated from {found.before}"
    console.print_result({"rig": str(out), **found.to_dict()}, found.blocks(), made, json=json)


def _refuse_mixture(files: list[Path], free: str | None, *, paper: bool, posterior: bool) -> None:
    if paper and (files or free is not None):
        raise SpecError(
            "--paper fits the paper's numbers and takes neither recordings nor --free; leave one or the other"
        )
    if not paper and posterior:
        raise SpecError("--posterior is about the paper's numbers; add --paper, or leave it out")
    if not paper and not files:
        raise SpecError("found no recording to calibrate from; name one or more (NetCDF), or fit with --paper")


def _from_recordings(
    rig: str, files: list[Path], out: Path, free: str | None, command: list[str], spread: "Spread"
) -> "CalibrationResult":
    from sinew.identify.joint.calibration import calibrate as run
    from sinew.plan.toml import read_spec, save_rig

    chosen = {} if free is None else {"free": [name.strip() for name in free.split(",") if name.strip()]}
    with console.progress_bar("calibrate") as progress:
        done = run(rig, files, name=out.stem, spread=spread, progress=progress, **chosen)
    head = [f"{shlex.join(command)} --out {out.name}"]
    head += [f"{source.file}: content hash {source.content_hash}" for source in done.sources]
    save_rig(done.rig, out, head, like=read_spec("rigs", rig) if Path(rig).is_file() else "")
    return done


def _from_paper(
    rig: str, out: Path, posterior: Path | None, seed: int, command: list[str], spread: "Spread"
) -> "CalibrationResult":
    from sinew.identify.joint.calibration import (
        CalibratedNumber,
        PaperCalibration,
        calibrated_parameter,
        with_intervals,
    )
    from sinew.measure.result import Rows
    from sinew.paper.numbers import FREE, TARGETS, fit_paper, paper_posterior, require_sampler
    from sinew.plan.toml import load_rig, save_rig
    from sinew.solve.programs import configure

    before = load_rig(rig)
    if posterior is not None:
        require_sampler()
    configure()
    fitted = fit_paper(before)
    if not fitted.met:
        raise SpecError(f"with {rig} the paper's numbers cannot all be met; nothing was written")
    result, found = fitted.rig.model_copy(update={"name": out.stem}), None
    if posterior is not None:
        with console.progress_bar("posterior") as progress:
            found = paper_posterior(before, fitted.values, seed=seed, spread=spread, progress=progress)
        console.write_json(found.to_json(), posterior)
        result = with_intervals(result, found.intervals())
    # The shipped rig is written by this command; without an interval it stays in the plain form of a rig file.
    save_rig(
        result, out, [] if found is None else [f"{shlex.join(command)} --posterior --seed {seed} --out {out.name}"]
    )
    return PaperCalibration(
        name=result.name,
        before=before.name,
        parameters={free.name: calibrated_parameter(before, result, free.name) for free in FREE},
        remarks=() if found is None else tuple(found.sentences()),
        numbers=Rows(
            CalibratedNumber(one.name, one.value, float(number), one.within)
            for one, number in zip(TARGETS, fitted.observed, strict=True)
        ),
        posterior=None if posterior is None else str(posterior),
    )
