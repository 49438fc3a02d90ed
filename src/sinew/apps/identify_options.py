"""This is where the arguments and options of `sinew identify` are spelt."""

from pathlib import Path
from typing import Annotated

import typer

__all__ = [
    "EXCITATIONS",
    "Bootstrap",
    "ColumnInput",
    "ColumnOutput",
    "DrawSeed",
    "ExcitationOption",
    "FileArgument",
    "ModelOption",
    "Out",
    "Posterior",
    "PretensionOption",
    "Profile",
    "Rate",
    "RigOption",
    "Test",
    "Train",
]

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
