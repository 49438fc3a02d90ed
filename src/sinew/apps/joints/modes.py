"""`sinew modes`: torsion, sway and their coupling, over pretension and bend."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from sinew.apps import console
from sinew.apps.console import Json, RigArgument, option
from sinew.apps.joints.options import MODES, Mode, check_angle
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.plan.plan import TendonMode

ENDINGS = (".png", ".pdf", ".svg", ".html")


def modes(
    rig: RigArgument,
    pretension: Annotated[str, option("MM,...", "Pretensions, modes for each.", "--pretension-mm")] = "0,6,12",
    bend: Annotated[str, option("DEG,...", "Bends of the head, modes for each.", "--bend-deg")] = "0,10,20,30",
    azimuth: Annotated[float, option("DEG", "Direction of the bend, from y towards z.", "--azimuth-deg")] = 0.0,
    mode: Mode = "position",
    swing: Annotated[
        float, option("DEG", "Swing of the head at which the guides slip and lose.", "--swing-deg")
    ] = 10.0,
    bands: Annotated[
        int, option("N", "Draws of what is assumed, for 90 % intervals; 0 for none.", "--bands", min=0)
    ] = 16,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the draws.")] = 0,
    out: Annotated[
        Path | None, option("FILE", "A figure, .png, .pdf or .svg, or a page with moving shapes, .html.")
    ] = None,
    json: Json = False,
) -> None:
    """Give the modes of a joint that bends: frequency, damping, where their energy is, how the head moves.

    Torsion, sway in the plane of the bend and across it, and axial, over pretension and bend; where sway and torsion
    meet at 1:1 and 2:1, and how close they come. The rig needs a [space] with the masses of head and lever: intervals
    are over the bounds of those that are assumed.
    """
    if out is not None:
        if out.suffix not in ENDINGS:
            raise SpecError(
                f"--out is {out}, expected a name that ends with {', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}"
            )
        console.require_file(out)
    console.check_choice("--mode", mode, MODES)
    check_angle("--swing-deg", swing)
    pretensions = console.number_list("--pretension-mm", pretension, "zero or more: cables cannot push", low=0)
    bends = console.number_list("--bend-deg", bend, "angles from 0 to 60°; turn it by --azimuth-deg", low=0, high=60)
    console.checked_number("--azimuth-deg", azimuth, "an angle from -360 to 360°", low=-360, high=360)

    from sinew.predict.modes import find_modes

    with console.progress_bar("draw") as progress:
        found = find_modes(
            rig,
            pretensions,
            bend_deg=bends,
            azimuth_deg=azimuth,
            mode=cast("TendonMode", mode),
            swing_deg=swing,
            bands=bands,
            seed=seed,
            progress=progress,
        )
    document = found.document()
    if out is not None:
        from sinew.figures.space import write_modes

        document["file"] = str(write_modes(found, out))
    if json:
        console.print_json(document)
    else:
        console.print_told(found.told())
        if out is not None:
            print(f"wrote {out}")
