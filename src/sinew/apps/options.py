"""This is where arguments and options that several commands share are spelt once."""

from typing import Annotated

import typer

__all__ = [
    "ColumnDrive",
    "ColumnResponse",
    "ColumnTime",
    "Gaps",
    "Json",
    "PlanArgument",
    "Rig",
    "Seed",
    "Settle",
    "Start",
    "Stop",
]

PlanArgument = Annotated[str, typer.Argument(metavar="PLAN", help="A plan: a TOML file, or the name of a shipped one.")]
Rig = Annotated[str, typer.Option("--rig", metavar="RIG", help="A rig: a TOML file, or the name of a shipped one.")]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of scatter, noise and jitter.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")]
ColumnTime = Annotated[str | None, typer.Option("--time", metavar="COL[:unit]", help="Column of the time stamps.")]
ColumnResponse = Annotated[
    str | None,
    typer.Option(
        "--response", metavar="COL[:unit]", help="Column of the response; several are averaged: COL,COL:unit."
    ),
]
ColumnDrive = Annotated[str | None, typer.Option("--drive", metavar="COL[:unit]", help="Column of the drive.")]
Start = Annotated[float | None, typer.Option("--start", metavar="S", help="Take samples from this time on [s].")]
Stop = Annotated[float | None, typer.Option("--stop", metavar="S", help="Take samples up to this time [s].")]
Gaps = Annotated[str, typer.Option("--gaps", metavar="refuse|split", help="What to do where samples are missing.")]
Settle = Annotated[
    float | None,
    typer.Option(
        "--settle", metavar="S", help="Sweep: how long each group settles before it is measured [s]; else its half."
    ),
]
