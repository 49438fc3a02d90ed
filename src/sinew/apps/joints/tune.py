"""`sinew tune`: the pretension at which a rig resonates at a wanted frequency."""

from typing import TYPE_CHECKING, Annotated, cast

import typer

from sinew.apps import console
from sinew.apps.console import Json, RigArgument, option
from sinew.apps.joints.options import MODES, Mode, check_angle
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.plan.plan import TendonMode


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
    """Find the pretension that makes a rig resonate at a wanted frequency, and the range that it can reach.

    A rig that `sinew calibrate` wrote knows how far it can be off: pretension and frequency get 90 % intervals. A
    frequency that is out of reach is no error: the answer says why, and the exit status is 0.
    """
    from sinew.tune.pretension import tune as run

    if amplitude is not None and yaw is not None:
        raise SpecError("found --amplitude-deg and --yaw-deg; expected one of them")
    console.check_choice("--mode", mode, MODES)
    for flag, asked in (("--amplitude-deg", amplitude), ("--yaw-deg", yaw)):
        if asked is not None:
            check_angle(flag, asked)
    expected = f"frequencies above 0 and up to {console.HIGHEST_HZ:g} Hz, as 3.2,3.6"
    wanted = console.number_list("--resonance-hz", resonance, expected, low=0, high=console.HIGHEST_HZ, above=True)
    held = cast("TendonMode", mode)
    with console.progress_bar("draw") as progress:
        found = run(
            rig, wanted, amplitude_deg=amplitude, yaw_deg=yaw, mode=held, bands=bands, seed=seed, progress=progress
        )
    if json:
        console.print_json(found.document())
    else:
        console.print_told(found.told())
