"""`sinew identify`: the mechanics of an oscillation from its recording."""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

import typer

from sinew.apps import console
from sinew.apps.console import Columns, ColumnTime, Gaps, Json, Rate, Run, Start, Stop, flag, option
from sinew.apps.recordings import identify_input
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    import xarray as xr

    from sinew.identify.identified import Identified
    from sinew.identify.oscillator.record import Excitation, Record

EXCITATIONS = ("force", "torque", "base", "lever", "none")
KINDS = ("samples", "stepped")
_MODELS = "linear|loss-factor|coulomb|cubic|cubic-quadratic|bouc-wen|drag|tendon|auto"


def identify(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A table of any lab, or a recording of Sinew (NetCDF).")],
    time: ColumnTime = None,
    input_: Annotated[str | None, option("COL[:unit]", "Column of what drives it.", "--input")] = None,
    output: Annotated[str | None, option("COL[:unit]", "Column of how it moves.")] = None,
    excitation: Annotated[str | None, option("|".join(EXCITATIONS), "What the input is; none is a free decay.")] = None,
    model: Annotated[str, option(_MODELS, "What to fit.")] = "auto",
    start: Start = None,
    stop: Stop = None,
    train: Annotated[str | None, option("A:B", "Samples to fit: indices from 0, half open.")] = None,
    test: Annotated[str | None, option("A:B", "Samples to predict, held out of the fit.")] = None,
    gaps: Gaps = "refuse",
    run: Run = None,
    columns: Columns = None,
    rate: Rate = None,
    pretension: Annotated[float | None, option("MM", "Of a rig's recording; else its smallest.")] = None,
    rig: Annotated[str | None, option("RIG", "Where model tendon begins; else the recording's rig.")] = None,
    profile: Annotated[
        bool, flag("--profile", "Add intervals of the nonlinear numbers by profile likelihood.")
    ] = False,
    posterior: Annotated[
        bool, flag("--posterior", "Add the posterior by NUTS: minutes; needs the extra posterior.")
    ] = False,
    bootstrap: Annotated[
        int | None, option("N", "Of a rig's repeats: add intervals from N draws of them.", min=20)
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the draws of posterior and bootstrap.")] = 0,
    kind: Annotated[str, option("|".join(KINDS), "What FILE holds: samples, or steady states of a sine.")] = "samples",
    frequency: Annotated[
        str | None, option("COL", "Of steady states: column of frequencies; else frequency_hz.")
    ] = None,
    phase: Annotated[str | None, option("COL[:unit]", "Of steady states: column of phases; else phase_deg.")] = None,
    chain: Annotated[
        str | None, option("phase,background", "Of steady states: what the measuring chain may add; a constant.")
    ] = None,
    out: Annotated[Path | None, option("DIR", "Folder for fit.json, fit.html and figures.")] = None,
    json: Json = False,
) -> None:
    """Identify stiffness, damping law and nonlinearity, with intervals, and say which model the data support.

    Without --train and --test the fit is to all samples, and every fourth block of them is held out once to compare
    models. With --model auto the stiffness law and the damping law are chosen, or it says what cannot be told.
    Of a free decay the free part is found, unless --start, --stop, --train or --test choose one.

    \b
    a force sweep, figures too:
      sinew identify a.csv --time t --input u:N --output x:mm --excitation force --out out/a
    a free decay:
      sinew identify b.csv --time t_s --output angle:deg --excitation none
    volts in, volts out, no time column, fitted on the first half and tested on the second:
      sinew identify c.csv --rate 600 --input u:V --output y:V --excitation force --train 0:4000 --test 4000:8000
    a moving base:
      sinew identify d.csv --time t --input base:mm --output tip:mm --excitation base --model loss-factor
    a recording of a rig, one pretension as one degree of freedom, or all of it as the tendon joint:
      sinew identify recording.nc --pretension 4 --model cubic
      sinew identify recording.nc --model tendon --out out/joint
    a stepped sine, each row a steady state with columns frequency_hz and phase_deg; each level of the drive a curve:
      sinew identify steps.csv --kind stepped --output amplitude:deg --input torque:N*m --excitation torque --out out/e
    """
    if excitation is not None:
        console.check_choice("--excitation", excitation, EXCITATIONS)
    console.check_choice("--kind", kind, KINDS)
    if out is not None:
        console.require_folder(out)
    asked = _Asked(
        file=file,
        time=time,
        input=input_,
        output=output,
        rate_hz=rate,
        excitation=cast("Excitation | None", excitation),
        model=model,
        start_s=start,
        stop_s=stop,
        gaps=console.checked_gaps(gaps),
        run=run,
        columns=columns,
        train=_range("--train", train),
        test=_range("--test", test),
        pretension_mm=pretension,
        rig=rig,
        profile=profile,
        posterior=posterior,
        bootstrap=bootstrap,
        seed=seed,
        kind=kind,
        frequency=frequency,
        phase=phase,
        chain=chain,
    )
    found = _find_stepped(asked) if kind == "stepped" else _find(asked)
    written = ""
    if out is not None:
        with console.progress_bar("draw"):
            written = f"page: {_write(found, asked, out)}"
    console.print_result(found.document, found.told(), written, json=json)


@dataclass(frozen=True)
class _Asked:
    """What the command line asked for."""

    file: Path
    time: str | None
    input: str | None
    output: str | None
    rate_hz: float | None
    excitation: "Excitation | None"
    model: str
    start_s: float | None
    stop_s: float | None
    gaps: Literal["refuse", "split", "bridge"]
    run: str | None
    columns: str | None
    train: tuple[int, int] | None
    test: tuple[int, int] | None
    pretension_mm: float | None
    rig: str | None
    profile: bool
    posterior: bool
    bootstrap: int | None
    seed: int
    kind: str
    frequency: str | None
    phase: str | None
    chain: str | None

    def more(self) -> list[str]:
        """Return the options that ask for something to be added to the fit."""
        found = [name for name, given in (("--profile", self.profile), ("--posterior", self.posterior)) if given]
        found += ["--bootstrap", str(self.bootstrap)] if self.bootstrap is not None else []
        return [*found, "--seed", str(self.seed)] if self.posterior or self.bootstrap is not None else found

    def steps(self) -> dict[str, str | None]:
        """Return what was asked of steady states, by option."""
        kind = None if self.kind == "samples" else self.kind
        return {"--kind": kind, "--frequency": self.frequency, "--phase": self.phase, "--chain": self.chain}

    def about(self) -> str:
        """Return what was fitted, a sentence for the page."""
        shown = {"input": self.input, "output": self.output, "excitation": self.excitation}
        told = ", ".join(f"{name} {value}" for name, value in shown.items() if value is not None)
        return f"From {self.file.name}{f': {told}' if told else ''}."

    def command(self, out: Path) -> str:
        """Return the command line that makes all of it again."""
        options = {
            "--run": self.run,
            "--columns": self.columns,
            "--gaps": _said(self.gaps),
            "--time": self.time,
            "--rate": None if self.rate_hz is None else f"{self.rate_hz:g}",
            "--input": self.input,
            "--output": self.output,
            "--excitation": self.excitation,
            "--model": self.model,
            "--start": None if self.start_s is None else f"{self.start_s:.12g}",
            "--stop": None if self.stop_s is None else f"{self.stop_s:.12g}",
            "--train": None if self.train is None else f"{self.train[0]}:{self.train[1]}",
            "--test": None if self.test is None else f"{self.test[0]}:{self.test[1]}",
            "--pretension": None if self.pretension_mm is None else f"{self.pretension_mm:g}",
            "--rig": self.rig,
            **self.steps(),
        }
        words = [word for name, value in options.items() if value is not None for word in (name, value)]
        return shlex.join(["sinew", "identify", str(self.file), *words, *self.more(), "--out", str(out)])


def _said(gaps: str) -> str | None:
    """Return the word of --gaps, None where it is the default."""
    return None if gaps == "refuse" else gaps


def _range(flag: str, text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    found = re.fullmatch(r"(\d+):(\d+)", text.strip())
    if found is None:
        raise SpecError(f"{flag} is {text!r}, expected A:B, two sample indices (from 0, B not included)")
    return int(found[1]), int(found[2])


def _find(asked: _Asked) -> "Identified":
    from sinew.measure.files.netcdf import load_recording
    from sinew.measure.read import is_recording

    for name, value in asked.steps().items():
        if value is not None:
            raise SpecError(f"{name} is for steady states; add --kind stepped, or leave it out")
    record: xr.Dataset | Record
    train, test = asked.train, asked.test
    with console.progress_bar("models compared" if asked.model == "auto" else "fit") as progress:
        if is_recording(asked.file):
            identify_input.refuse_columns(
                asked.time, asked.input, asked.output, asked.rate_hz, asked.run, asked.columns, _said(asked.gaps)
            )
            record = load_recording(asked.file)
        else:
            identify_input.refuse_rig_options(asked.model, asked.pretension_mm, asked.rig, asked.bootstrap)
            if asked.excitation is None and asked.input is not None:
                raise SpecError(f"say what the input is: --excitation {'|'.join(EXCITATIONS[:-1])}")
            if asked.gaps != "refuse" and (train is not None or test is not None):
                what = "a part" if asked.gaps == "split" else "leaves some out"
                raise SpecError(
                    f"--train and --test choose samples, and --gaps {asked.gaps} {what}; leave one of them out"
                )
            judged = None if train is None else _hull(train, test)
            record = identify_input.table_record(
                asked.file,
                asked.time,
                asked.input,
                asked.output,
                asked.excitation or "none",
                asked.rate_hz,
                stretch_s=(asked.start_s, asked.stop_s),
                samples=judged,
                gaps=asked.gaps,
                run=asked.run,
                columns=asked.columns,
            )
            if judged is not None and (judged[1] is None or record.size == judged[1] - judged[0]):
                train, test = _moved(train, judged[0]), _moved(test, judged[0])
        from sinew.identify.identified import identify as run  # JAX: seconds, behind the bar

        return run(
            record,
            asked.model,
            excitation=asked.excitation,
            pretension_mm=asked.pretension_mm,
            rig=asked.rig,
            start_s=asked.start_s,
            stop_s=asked.stop_s,
            train=train,
            test=test,
            profile=asked.profile,
            bootstrap=asked.bootstrap,
            posterior=asked.posterior,
            seed=asked.seed,
            progress=progress,
        )


def _hull(train: tuple[int, int], test: tuple[int, int] | None) -> tuple[int, int | None]:
    """Return the samples that matter: those of both ranges and between them; without a test all behind the first."""
    return (train[0], None) if test is None else (min(train[0], test[0]), max(train[1], test[1]))


def _moved(samples: tuple[int, int] | None, by: int) -> tuple[int, int] | None:
    return None if samples is None else (samples[0] - by, samples[1] - by)


def _find_stepped(asked: _Asked) -> "Identified":
    from sinew.identify.identified import identify as run
    from sinew.measure.read import is_recording

    given = {"--time": asked.time, "--rate": asked.rate_hz, "--train": asked.train, "--test": asked.test}
    given |= {
        "--start": asked.start_s,
        "--stop": asked.stop_s,
        "--gaps": _said(asked.gaps),
    }
    given |= dict.fromkeys(asked.more(), "")
    for name, value in given.items():
        if value is not None:
            raise SpecError(f"{name} is for samples over time, FILE holds steady states; leave it out")
    if asked.model == "tendon":
        raise SpecError("model tendon is fitted to samples of a rig's recording; leave --kind stepped out")
    chain = _chain(asked.chain)
    if is_recording(asked.file):
        of_table = (asked.input, asked.output, asked.frequency, asked.phase, asked.run, asked.columns)
        identify_input.refuse_columns(*of_table)
        points = identify_input.recording_points(asked.file, asked.excitation, asked.pretension_mm, asked.rig)
    else:
        identify_input.refuse_rig_options(asked.model, asked.pretension_mm, asked.rig, None)
        points = identify_input.table_points(
            asked.file,
            asked.frequency,
            asked.phase,
            asked.input,
            asked.output,
            asked.excitation,
            run=asked.run,
            columns=asked.columns,
        )
    with console.progress_bar("models compared" if asked.model == "auto" else "fit") as progress:
        return run(points, asked.model, chain=chain, progress=progress)


def _chain(text: str | None) -> tuple[str, ...]:
    known = {"phase": ("phase",), "background": ("background_real", "background_imag")}
    parts = [] if text is None else [part.strip() for part in text.split(",")]
    for part in parts:
        if part not in known:
            raise SpecError(f"--chain holds {part!r}, expected phase, background or both: phase,background")
    return tuple(name for part in known if part in parts for name in known[part])


def _write(found: "Identified", asked: _Asked, out: Path) -> Path:
    """Write fit.json, figures and fit.html into a folder and return the path of the page."""
    from sinew.apps.recordings.stored import hash_file
    from sinew.figures.fit import draw_identified, write_fit_page
    from sinew.figures.style import save_figure
    from sinew.measure.files.netcdf import provenance

    paths = []
    for name, figure in draw_identified(found).items():
        paths += save_figure(figure, out / "figures", name, ("png", "pdf"))
    console.write_json(found.document, out / "fit.json")
    versions = str(provenance("import")["versions"])
    return write_fit_page(
        out,
        found.document,
        sentences=found.sentences,
        figures=paths,
        about=asked.about(),
        rebuild=asked.command(out),
        origins=[("file", str(asked.file)), ("SHA-256", hash_file(asked.file)), ("versions", versions)],
    )
