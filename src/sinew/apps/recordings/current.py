"""The command `sinew current`: whose current the motors of a recording tell, their own or their supply's."""

from pathlib import Path
from typing import Annotated

import typer

from sinew.apps import console
from sinew.apps.console import Json, option


def current(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A recording of a bench (NetCDF).")],
    rig: Annotated[str | None, option("RIG", "A rig: unit of the current; else the recording's.")] = None,
    json: Json = False,
) -> None:
    """Tell whether Present Current is the motor's or its supply's, motor by motor, from a recording of a bench.

    Nothing but duty, speed and current is asked: at the same torque the motor's current stays where the duty changes,
    the supply's goes with it. The answer is the exponent of the duty with a 90 % interval, 0 for the motor's and 1 for
    the supply's, and says undetermined where the recording does not part the two. The plan `current` loads and moves
    all motors so that it does.
    """
    from sinew.analysis.analysed import recording_rig
    from sinew.analysis.current import currents_told, sense_currents
    from sinew.measure.errors import SpecError
    from sinew.measure.files.netcdf import load_recording

    recording = load_recording(file)
    used = recording_rig(recording, rig)
    if used is None:
        raise SpecError(f"{file} names no rig, expected one for the unit of the current; name it with --rig")
    found = sense_currents(recording, used.tendons.current_lsb.value)
    if json:
        console.print_json({"motors": [one.to_json() for one in found]})
    else:
        console.print_told(currents_told(found))
