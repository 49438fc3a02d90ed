"""`sinew calibrate`: a rig with the parameters that recordings, or the paper's numbers, have for it."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps import console
from sinew.apps.console import Device, Json, Keep, RigArgument, Scheduler, Workers, flag, option
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
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
    ranges: Annotated[
        bool, flag("--ranges", "With --paper: how far each parameter can move, as RIG2-ranges.json.")
    ] = False,
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
    """Write a rig whose parameters come from recordings of it, each with origin, 90 % interval and source.

    What the recordings do not determine keeps its old value and origin. With --paper the ten parameters that the paper
    does not print are fitted to the numbers that it does; --posterior and --ranges take minutes.
    """
    files = recordings or []
    _refuse_mixture(files, free, paper=paper, extras=ranges or posterior)
    if out.suffix != ".toml":
        raise SpecError(f"--out is {out}, expected a name that ends with .toml")
    beside = [out.with_name(f"{out.stem}-{what}.json") for what in ("ranges", "posterior")]
    for path in (out, *(path for path, asked in zip(beside, (ranges, posterior), strict=True) if asked)):
        console.require_file(path, reads=rig)
    spread = console.spread_of(scheduler, workers, keep, device)
    command = ["sinew", "calibrate", rig, *map(str, files), *(["--free", free] if free else [])]
    command += ["--paper"] if paper else []
    if paper:
        also = beside[0] if ranges else None, beside[1] if posterior else None
        document = _from_paper(rig, out, *also, seed, command, spread)
    else:
        document = _from_recordings(rig, files, out, free, command, spread)
    from sinew.identify.joint.calibration import calibration_told

    made = f"{document['rig']}: rig {document['name']}, calibrated from {document['before']}"
    console.print_result(document, calibration_told(document), made, json=json)


def _refuse_mixture(files: list[Path], free: str | None, *, paper: bool, extras: bool) -> None:
    if paper and (files or free is not None):
        raise SpecError(
            "--paper fits the paper's numbers and takes neither recordings nor --free; leave one or the other"
        )
    if not paper and extras:
        raise SpecError("--ranges and --posterior are about the paper's numbers; add --paper, or leave them out")
    if not paper and not files:
        raise SpecError("found no recording to calibrate from; name one or more (NetCDF), or fit with --paper")


def _from_recordings(
    rig: str, files: list[Path], out: Path, free: str | None, command: list[str], spread: "Spread"
) -> dict[str, Any]:
    from sinew.identify.joint.calibration import calibrate as run
    from sinew.plan.toml import save_rig

    chosen = {} if free is None else {"free": [name.strip() for name in free.split(",") if name.strip()]}
    with console.progress_bar("calibrate") as progress:
        done = run(rig, files, name=out.stem, spread=spread, progress=progress, **chosen)
    head = [f"{shlex.join(command)} --out {out.name}"]
    head += [f"{source.file}: content hash {source.content_hash}" for source in done.sources]
    save_rig(done.rig, out, head)
    return {"rig": str(out), **done.document()}


def _from_paper(
    rig: str, out: Path, ranges: Path | None, posterior: Path | None, seed: int, command: list[str], spread: "Spread"
) -> dict[str, Any]:
    from sinew.identify.joint.calibration import with_intervals
    from sinew.paper.numbers import FREE, TARGETS, find_ranges, fit_paper
    from sinew.paper.posterior import paper_posterior, require_sampler
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
    if ranges is not None:
        with console.progress_bar("ranges") as progress:
            console.write_json(find_ranges(before, fitted.values, progress, spread=spread), ranges)
    # The shipped rig is written by this command; without an interval it stays in the plain form of a rig file.
    save_rig(
        result, out, [] if found is None else [f"{shlex.join(command)} --posterior --seed {seed} --out {out.name}"]
    )
    old, new = dict(before.parameters()), dict(result.parameters())
    told = [] if found is None else found.sentences()
    return {
        "rig": str(out),
        "name": result.name,
        "before": before.name,
        "parameters": {
            free.name: {
                "unit": new[free.name].unit,
                "before": old[free.name].value,
                "after": {
                    "value": new[free.name].value,
                    "std": None,
                    "interval90": list(new[free.name].interval90 or (None, None)),
                },
            }
            for free in FREE
        },
        "numbers": [
            {"quantity": one.name, "paper": one.value, "twin": float(number), "tolerance": one.within}
            for one, number in zip(TARGETS, fitted.observed, strict=True)
        ],
        "ranges": None if ranges is None else str(ranges),
        "posterior": None if posterior is None else str(posterior),
        "remarks": told,
    }
