"""`sinew calibrate`: a rig with the parameters that recordings, or the paper's numbers, have for it."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sinew.apps import console
from sinew.apps.console import Device, Json, Keep, RigArgument, Scheduler, Workers, flag, option
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.identify.joint.calibration import CalibrationResult
    from sinew.measure.tasks import Spread


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
