"""`sinew tune`: the pretension at which a rig resonates at a wanted frequency."""

from typing import TYPE_CHECKING, Annotated, cast

import typer

from sinew.apps.console import (
    HIGHEST_HZ,
    LARGEST_DEG,
    Json,
    checked_number,
    number_list,
    print_json,
    print_told,
    progress_bar,
)
from sinew.apps.joints.rig_asked import Mode, check_mode
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.plan.plan import TendonMode


def tune(
    rig: Annotated[str, typer.Argument(metavar="RIG", help="A rig: a TOML file, or the name of a shipped one.")],
    resonance: Annotated[
        str, typer.Option("--resonance-hz", metavar="F,...", help="Where it is to resonate: 90° of lag.")
    ],
    amplitude: Annotated[
        float | None, typer.Option("--amplitude-deg", metavar="DEG", help="Amplitude of the drive's command; else 20.")
    ] = None,
    yaw: Annotated[
        float | None,
        typer.Option("--yaw-deg", metavar="DEG", help="Instead: amplitude of the torsion; the command is found."),
    ] = None,
    mode: Mode = "position",
    bands: Annotated[
        int | None,
        typer.Option("--bands", metavar="N", min=0, help="Draws for the 90 % intervals; else 100, and 0 for none."),
    ] = None,
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
    check_mode(mode)
    for option, asked in (("--amplitude-deg", amplitude), ("--yaw-deg", yaw)):
        if asked is not None:
            expected = f"a positive angle up to {LARGEST_DEG:g}°"
            checked_number(option, asked, expected, low=0, high=LARGEST_DEG, above=True)
    wanted, held = _frequencies(resonance), cast("TendonMode", mode)
    with progress_bar("draw") as progress:
        found = run(
            rig, wanted, amplitude_deg=amplitude, yaw_deg=yaw, mode=held, bands=bands, seed=seed, progress=progress
        )
    if json:
        print_json(found.document())
    else:
        print_told(found.told())


def _frequencies(text: str) -> list[float]:
    expected = f"frequencies above 0 and up to {HIGHEST_HZ:g} Hz, as 3.2,3.6"
    return number_list("--resonance-hz", text, expected, low=0, high=HIGHEST_HZ, above=True)
