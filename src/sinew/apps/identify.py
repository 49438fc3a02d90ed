"""This is where `sinew identify` turns the recording of an oscillation into its mechanics."""

import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from sinew.apps.console import ColumnTime, Json, print_json, print_table, progress_bar, require_folder
from sinew.apps.identify_found import (
    Found,
    add_bootstrap,
    add_posterior,
    add_profiles,
    find_joint,
    find_mechanics,
    write_pages,
)
from sinew.apps.identify_input import (
    is_recording,
    joint_rig,
    recording_records,
    refuse_columns,
    refuse_rig_options,
    table_record,
    unit_remarks,
)
from sinew.measure.errors import SpecError
from sinew.measure.estimate import number, shown, span

if TYPE_CHECKING:
    import xarray as xr

    from sinew.identify.oscillator.record import Excitation


# `sinew identify` speaks on a terminal.

_TITLES = {
    "profile": "by profile likelihood",
    "posterior": "posterior",
    "bootstrap": "by bootstrap over repeats",
}


def print_found(found: Found) -> None:
    """Print the numbers, the models that were compared, and the sentences, the verdict first."""
    document = found.document
    both = {name: document[name] for name in ("natural_frequency_hz", "damping_ratio")}
    _print_quantities(f"model {document['model']}", both | document["parameters"])
    for key, title in _TITLES.items():
        if document.get(key):
            _print_quantities(title, document[key])
    unit = "" if document["unit"] == "1" else f"/({document['unit']})"
    if document["compared"]:
        compared = [(row["model"], number(row["rmse_test"]), number(row["bic"])) for row in document["compared"]]
        print_table(("compared", f"held-out rmse{unit}", "BIC"), compared)
    verdict, *rest = found.sentences
    print(f"{verdict[:1].upper()}{verdict[1:]}.")
    train, test = document["rmse"]["train"], document["rmse"]["test"]
    held = "" if test is None else f", {number(test)} where it was held out"
    print(f"- residuals{unit}: {number(train)} rms where it was fitted{held}")
    for sentence in (*rest, *document["unidentifiable"]):
        print(f"- {sentence}")


def _print_quantities(title: str, quantities: Mapping[str, Mapping[str, Any]]) -> None:
    cells = [(name, shown(one), span(*(one["interval90"] or (None, None)))) for name, one in quantities.items()]
    print_table((title, "value ± std", "90 % interval"), cells)


# The arguments and options of `sinew identify` are spelt.

EXCITATIONS = ("force", "torque", "base", "lever", "none")
_MODELS = "linear|loss-factor|coulomb|cubic|cubic-quadratic|tendon|auto"

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
    """
    if excitation is not None and excitation not in EXCITATIONS:
        raise SpecError(f"--excitation is {excitation!r}, expected one of {', '.join(EXCITATIONS)}")
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
    )
    found = _find(asked)
    _add(found, asked.more)
    if out is not None:
        with progress_bar("draw"):
            page = write_pages(found, out, about=asked.about, rebuild=asked.command(out), origins=asked.origins)
    if json:
        print_json(found.document)
        return
    print_found(found)
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

    @property
    def about(self) -> str:
        """Return what was fitted, a sentence for the page."""
        shown = {"input": self.columns.input, "output": self.columns.output, "excitation": self.excitation}
        told = ", ".join(f"{name} {value}" for name, value in shown.items() if value is not None)
        return f"From {self.file.name}{f': {told}' if told else ''}."

    @property
    def origins(self) -> list[tuple[str, str]]:
        """Return what the numbers were made from: the file's hash and the versions."""
        from sinew.apps.stored import hash_file
        from sinew.measure.netcdf import provenance

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


def _find(asked: _Asked) -> "Found":
    columns = asked.columns
    if is_recording(asked.file):
        refuse_columns(columns.time, columns.input, columns.output, columns.rate_hz)
        from sinew.measure.netcdf import load_recording

        recording = load_recording(asked.file)
        if asked.model == "tendon":
            return _find_joint(asked, recording)
        repeats = asked.more.bootstrap is not None
        records = recording_records(recording, asked.excitation, asked.pretension_mm, repeats=repeats)
    else:
        refuse_rig_options(asked.model, asked.pretension_mm, asked.rig, asked.more.bootstrap)
        if asked.excitation is None and columns.input is not None:
            raise SpecError(f"say what the input is: --excitation {'|'.join(EXCITATIONS[:-1])}")
        chosen = asked.excitation or "none"
        records = [table_record(asked.file, columns.time, columns.input, columns.output, chosen, columns.rate_hz)]

    with progress_bar("models compared" if asked.model == "auto" else "fit") as progress:
        return find_mechanics(
            records,
            asked.model,
            asked.train,
            asked.test,
            remarks=(*unit_remarks(records[0]), *records[0].notes),
            progress=progress,
        )


def _find_joint(asked: _Asked, recording: "xr.Dataset") -> "Found":
    given = {"--train": asked.train, "--test": asked.test, "--pretension": asked.pretension_mm}
    for name, value in given.items():
        if value is not None:
            raise SpecError(f"{name} does not go with model tendon, which is fitted to all segments of the recording")
    if asked.more.words():
        raise SpecError(
            f"{asked.more.words()[0]} is for models of one degree of freedom; leave it out with model tendon"
        )
    if asked.excitation not in (None, "lever"):
        raise SpecError(f"--excitation is {asked.excitation}, but a rig is driven by its lever; leave it out")
    rig = joint_rig(recording, asked.rig)
    with progress_bar("fit the tendon joint") as progress:
        return find_joint(recording, rig, progress)


def _add(found: "Found", more: _More) -> None:
    if more.profile:
        with progress_bar("profiles") as progress:
            add_profiles(found, progress)
    if more.bootstrap is not None:
        with progress_bar("bootstrap") as progress:
            add_bootstrap(found, more.bootstrap, more.seed, progress)
    if more.posterior:
        with progress_bar("posterior") as progress:
            add_posterior(found, more.seed, progress)
    found.document["message"] = "; ".join(found.sentences)
