"""`sinew identify`: the mechanics of an oscillation from its recording."""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from sinew.apps.console import (
    ColumnTime,
    Json,
    print_json,
    print_told,
    progress_bar,
    require_folder,
    write_json,
)
from sinew.apps.recordings.identify_input import (
    recording_points,
    refuse_columns,
    refuse_rig_options,
    table_points,
    table_record,
)
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    import xarray as xr

    from sinew.identify.identified import Identified
    from sinew.identify.oscillator.record import Excitation, Record


# The arguments and options of `sinew identify` are spelt.

EXCITATIONS = ("force", "torque", "base", "lever", "none")
KINDS = ("samples", "stepped")
_MODELS = "linear|loss-factor|coulomb|cubic|cubic-quadratic|bouc-wen|drag|tendon|auto"

FileArgument = Annotated[Path, typer.Argument(metavar="FILE", help="A CSV file, or a recording of Sinew (NetCDF).")]
ColumnInput = Annotated[str | None, typer.Option("--input", metavar="COL[:unit]", help="Column of what drives it.")]
ColumnOutput = Annotated[str | None, typer.Option("--output", metavar="COL[:unit]", help="Column of how it moves.")]
ExcitationOption = Annotated[
    str | None,
    typer.Option("--excitation", metavar="|".join(EXCITATIONS), help="What the input is; none is a free decay."),
]
ModelOption = Annotated[str, typer.Option("--model", metavar=_MODELS, help="What to fit.")]
Train = Annotated[str | None, typer.Option("--train", metavar="A:B", help="Samples to fit: indices from 0, half open.")]
Test = Annotated[str | None, typer.Option("--test", metavar="A:B", help="Samples to predict, held out of the fit.")]
Rate = Annotated[
    float | None, typer.Option("--rate", metavar="HZ", help="Samples per second, where there is no time column.")
]
PretensionOption = Annotated[
    float | None, typer.Option("--pretension", metavar="MM", help="Of a rig's recording; else its smallest.")
]
RigOption = Annotated[
    str | None, typer.Option("--rig", metavar="RIG", help="Where model tendon begins; else the recording's rig.")
]
Profile = Annotated[
    bool, typer.Option("--profile", help="Add intervals of the nonlinear numbers by profile likelihood.")
]
Posterior = Annotated[
    bool, typer.Option("--posterior", help="Add the posterior by NUTS: minutes; needs the extra posterior.")
]
Bootstrap = Annotated[
    int | None,
    typer.Option("--bootstrap", metavar="N", min=20, help="Of a rig's repeats: add intervals from N draws of them."),
]
Kind = Annotated[
    str,
    typer.Option("--kind", metavar="|".join(KINDS), help="What FILE holds: samples, or steady states of a sine."),
]
Frequency = Annotated[
    str | None,
    typer.Option("--frequency", metavar="COL", help="Of steady states: column of frequencies; else frequency_hz."),
]
Phase = Annotated[
    str | None,
    typer.Option("--phase", metavar="COL[:unit]", help="Of steady states: column of phases; else phase_deg."),
]
ChainOption = Annotated[
    str | None,
    typer.Option(
        "--chain", metavar="phase,background", help="Of steady states: what the measuring chain may add; a constant."
    ),
]
DrawSeed = Annotated[int, typer.Option("--seed", min=0, help="Seed of the draws of posterior and bootstrap.")]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder for fit.json, fit.html and figures.")]


def identify(
    file: FileArgument,
    time: ColumnTime = None,
    input_: ColumnInput = None,
    output: ColumnOutput = None,
    excitation: ExcitationOption = None,
    model: ModelOption = "auto",
    train: Train = None,
    test: Test = None,
    rate: Rate = None,
    pretension: PretensionOption = None,
    rig: RigOption = None,
    profile: Profile = False,
    posterior: Posterior = False,
    bootstrap: Bootstrap = None,
    seed: DrawSeed = 0,
    kind: Kind = "samples",
    frequency: Frequency = None,
    phase: Phase = None,
    chain: ChainOption = None,
    out: Out = None,
    json: Json = False,
) -> None:
    """Identify stiffness, damping law and nonlinearity, with intervals, and say which model the data support.

    Without --train and --test the fit is to all samples, and every fourth block of them is held out once to compare
    models. With --model auto the stiffness law and the damping law are chosen, or it says what cannot be told.

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
    if excitation is not None and excitation not in EXCITATIONS:
        raise SpecError(f"--excitation is {excitation!r}, expected one of {', '.join(EXCITATIONS)}")
    if kind not in KINDS:
        raise SpecError(f"--kind is {kind!r}, expected one of {', '.join(KINDS)}")
    if out is not None:
        require_folder(out)
    asked = _Asked(
        file,
        _Columns(time, input_, output, rate),
        cast("Excitation | None", excitation),
        model,
        _range("--train", train),
        _range("--test", test),
        pretension,
        rig,
        _More(profile, posterior, bootstrap, seed),
        _Steps(kind, frequency, phase, chain),
    )
    found = _find(asked)
    if out is not None:
        with progress_bar("draw"):
            page = _write(found, asked, out)
    if json:
        print_json(found.document)
        return
    print_told(found.told())
    if out is not None:
        print(f"page: {page}")


@dataclass(frozen=True)
class _Columns:
    time: str | None
    input: str | None
    output: str | None
    rate_hz: float | None


@dataclass(frozen=True)
class _More:
    """What is to be added to the fit."""

    profile: bool
    posterior: bool
    bootstrap: int | None
    seed: int

    def words(self) -> list[str]:
        """Return the options that ask for it."""
        found = [name for name, given in (("--profile", self.profile), ("--posterior", self.posterior)) if given]
        found += ["--bootstrap", str(self.bootstrap)] if self.bootstrap is not None else []
        return [*found, "--seed", str(self.seed)] if self.posterior or self.bootstrap is not None else found


@dataclass(frozen=True)
class _Steps:
    """What is asked of steady states."""

    kind: str
    frequency: str | None
    phase: str | None
    chain: str | None

    def options(self) -> dict[str, str | None]:
        """Return what was given, by option."""
        kind = None if self.kind == "samples" else self.kind
        return {"--kind": kind, "--frequency": self.frequency, "--phase": self.phase, "--chain": self.chain}


@dataclass(frozen=True)
class _Asked:
    """What the command line asked for."""

    file: Path
    columns: _Columns
    excitation: "Excitation | None"
    model: str
    train: tuple[int, int] | None
    test: tuple[int, int] | None
    pretension_mm: float | None
    rig: str | None
    more: _More
    steps: _Steps

    @property
    def about(self) -> str:
        """Return what was fitted, a sentence for the page."""
        shown = {"input": self.columns.input, "output": self.columns.output, "excitation": self.excitation}
        told = ", ".join(f"{name} {value}" for name, value in shown.items() if value is not None)
        return f"From {self.file.name}{f': {told}' if told else ''}."

    @property
    def origins(self) -> list[tuple[str, str]]:
        """Return what the numbers were made from: the file's hash and the versions."""
        from sinew.apps.recordings.stored import hash_file
        from sinew.measure.files.netcdf import provenance

        versions = str(provenance("import")["versions"])
        return [("file", str(self.file)), ("SHA-256", hash_file(self.file)), ("versions", versions)]

    def command(self, out: Path) -> str:
        """Return the command line that makes all of it again."""
        options = {
            "--time": self.columns.time,
            "--rate": None if self.columns.rate_hz is None else f"{self.columns.rate_hz:g}",
            "--input": self.columns.input,
            "--output": self.columns.output,
            "--excitation": self.excitation,
            "--model": self.model,
            "--train": _text(self.train),
            "--test": _text(self.test),
            "--pretension": None if self.pretension_mm is None else f"{self.pretension_mm:g}",
            "--rig": self.rig,
            **self.steps.options(),
        }
        words = [word for name, value in options.items() if value is not None for word in (name, value)]
        return shlex.join(["sinew", "identify", str(self.file), *words, *self.more.words(), "--out", str(out)])


def _text(found: tuple[int, int] | None) -> str | None:
    return None if found is None else f"{found[0]}:{found[1]}"


def _range(option: str, text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    found = re.fullmatch(r"(\d+):(\d+)", text.strip())
    if found is None:
        raise SpecError(f"{option} is {text!r}, expected A:B, two sample indices (from 0, B not included)")
    return int(found[1]), int(found[2])


def _find(asked: _Asked) -> "Identified":
    from sinew.identify.identified import identify as run
    from sinew.measure.files.netcdf import load_recording
    from sinew.measure.read import is_recording

    columns, more = asked.columns, asked.more
    if asked.steps.kind == "stepped":
        return _find_stepped(asked)
    for name, value in asked.steps.options().items():
        if value is not None:
            raise SpecError(f"{name} is for steady states; add --kind stepped, or leave it out")
    record: xr.Dataset | Record
    if is_recording(asked.file):
        refuse_columns(columns.time, columns.input, columns.output, columns.rate_hz)
        record = load_recording(asked.file)
    else:
        refuse_rig_options(asked.model, asked.pretension_mm, asked.rig, more.bootstrap)
        if asked.excitation is None and columns.input is not None:
            raise SpecError(f"say what the input is: --excitation {'|'.join(EXCITATIONS[:-1])}")
        chosen = asked.excitation or "none"
        record = table_record(asked.file, columns.time, columns.input, columns.output, chosen, columns.rate_hz)
    with progress_bar("models compared" if asked.model == "auto" else "fit") as progress:
        return run(
            record,
            asked.model,
            excitation=asked.excitation,
            pretension_mm=asked.pretension_mm,
            rig=asked.rig,
            train=asked.train,
            test=asked.test,
            profile=more.profile,
            bootstrap=more.bootstrap,
            posterior=more.posterior,
            seed=more.seed,
            progress=progress,
        )


def _find_stepped(asked: _Asked) -> "Identified":
    from sinew.identify.identified import identify as run
    from sinew.measure.read import is_recording

    columns, steps = asked.columns, asked.steps
    given = {"--time": columns.time, "--rate": columns.rate_hz, "--train": asked.train, "--test": asked.test}
    given |= dict.fromkeys(asked.more.words(), "")
    for name, value in given.items():
        if value is not None:
            raise SpecError(f"{name} is for samples over time, FILE holds steady states; leave it out")
    if asked.model == "tendon":
        raise SpecError("model tendon is fitted to samples of a rig's recording; leave --kind stepped out")
    chain = _chain(steps.chain)
    if is_recording(asked.file):
        refuse_columns(columns.input, columns.output, steps.frequency, steps.phase)
        points = recording_points(asked.file, asked.excitation, asked.pretension_mm, asked.rig)
    else:
        refuse_rig_options(asked.model, asked.pretension_mm, asked.rig, None)
        points = table_points(asked.file, steps.frequency, steps.phase, columns.input, columns.output, asked.excitation)
    with progress_bar("models compared" if asked.model == "auto" else "fit") as progress:
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
    from sinew.figures.fit.page import draw_identified, write_fit_page
    from sinew.figures.style import save_figure

    paths = []
    for name, figure in draw_identified(found).items():
        paths += save_figure(figure, out / "figures", name, ("png", "pdf"))
    write_json(found.document, out / "fit.json")
    return write_fit_page(
        out,
        found.document,
        sentences=found.sentences,
        figures=paths,
        about=asked.about,
        rebuild=asked.command(out),
        origins=asked.origins,
    )
