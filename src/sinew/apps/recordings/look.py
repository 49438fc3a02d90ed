"""The command `sinew look`: what is in somebody's file, and the command to go on with."""

from pathlib import Path
from typing import Annotated

import typer

from sinew.apps import console
from sinew.apps.console import Columns, Json, Rate, Run


def look(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A table of any lab, or a recording of Sinew.")],
    run: Run = None,
    columns: Columns = None,
    rate: Rate = None,
    json: Json = False,
) -> None:
    """Tell what is in a file: format, runs, columns with their units, rate, gaps, and the command to go on with.

    Text in any dialect (preambles, units below the header, decimal commas, no header at all), LabVIEW .lvm, MATLAB
    .mat, HDF5, TDMS, UFF 58, Excel, Parquet, MCAP.
    """
    from sinew.measure.look import look as find

    found = find(file, run=run, columns=columns, rate_hz=rate)
    if json:
        console.print_json(found.document)
    else:
        console.print_told(found.told())
