"""This is where `sinew tune` finds the pretension at which a rig resonates at a wanted frequency."""

from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from sinew.apps.console import (
    HIGHEST_HZ,
    LARGEST_DEG,
    Json,
    checked_number,
    number_list,
    print_json,
    print_table,
    progress_bar,
)
from sinew.apps.predict_rig import Mode, check_mode
from sinew.measure.errors import SpecError
from sinew.measure.estimate import fixed, number, shown_interval

if TYPE_CHECKING:
    from sinew.plan.plan import TendonMode
    from sinew.plan.rig import RigSpec
    from sinew.predict.band import Draws
    from sinew.tune.pretension import Reachable, Setting, Tuning

_DRAWS = 100
_MEANT = "where the torsion lags behind the lever by 90°"


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
    from sinew.plan.toml import load_rig
    from sinew.tune.pretension import tune_pretension
    from sinew.tune.resonance import Swing
    from sinew.twin.cache import configure

    if amplitude is not None and yaw is not None:
        raise SpecError("found --amplitude-deg and --yaw-deg; expected one of them")
    check_mode(mode)
    for option, asked in (("--amplitude-deg", amplitude), ("--yaw-deg", yaw)):
        if asked is not None:
            expected = f"a positive angle up to {LARGEST_DEG:g}°"
            checked_number(option, asked, expected, low=0, high=LARGEST_DEG, above=True)
    wanted = _frequencies(resonance)
    swing = Swing(yaw_deg=yaw) if yaw is not None else Swing(command_deg=20.0 if amplitude is None else amplitude)
    loaded = load_rig(rig)
    configure()
    draws, remark = _draws(loaded, bands, seed)
    held = cast("TendonMode", mode)
    with progress_bar("draw") as progress:
        found = tune_pretension(loaded, wanted, swing, draws=draws, mode=held, progress=progress)
    document = tuning_document(found)
    document |= {
        "rig": loaded.name,
        "resonance": _MEANT,
        "command_deg": swing.command_deg,
        "yaw_deg": swing.yaw_deg,
        "mode": mode,
        "draws": None if draws is None else {"count": len(draws.rigs), "seed": seed, "parameters": list(draws.names)},
    }
    document["remarks"] = [*document["remarks"], *([remark] if remark else [])]
    if json:
        print_json(document)
    else:
        _print(document)


def tuning_document(found: "Tuning") -> dict[str, Any]:
    """Return settings, reachable range and remarks as JSON holds them."""
    return {
        "settings": [_setting(one) for one in found.settings],
        "range": _range(found.reachable),
        "remarks": list(found.remarks),
    }


def _setting(one: "Setting") -> dict[str, Any]:
    from math import degrees

    at = one.resonance
    if at is None or one.pretension_mm is None or one.frequency_hz is None:
        return {"wanted_hz": one.wanted_hz, "feasible": False, "sentence": one.sentence}
    return {
        "wanted_hz": one.wanted_hz,
        "feasible": one.feasible,
        "sentence": one.sentence,
        "pretension_mm": one.pretension_mm.to_json(),
        "frequency_hz": one.frequency_hz.to_json(),
        "slope_hz_mm": one.slope_hz_mm,
        "peak_hz": at.peak_hz if at.peak_hz == at.peak_hz else None,
        "torsion_deg": degrees(at.torsion),
        "command_deg": degrees(at.command),
        "lever_deg": degrees(abs(at.lever)),
        "rest_tension_n": at.rest_tension,
        "tension_n": at.tension,
        "draws": one.draws,
    }


def _range(reachable: "Reachable") -> dict[str, Any]:
    from math import degrees

    found = reachable.resonances
    return {
        "pretension_mm": None if reachable.pretension_mm is None else list(reachable.pretension_mm),
        "frequency_hz": None if reachable.frequency_hz is None else list(reachable.frequency_hz),
        "why": list(reachable.why),
        "curve": {
            "pretension_mm": [one.pretension_mm for one in found],
            "frequency_hz": [one.frequency_hz for one in found],
            "torsion_deg": [degrees(one.torsion) for one in found],
            "command_deg": [degrees(one.command) for one in found],
            "tension_n": [one.tension for one in found],
        },
    }


def _frequencies(text: str) -> list[float]:
    expected = f"frequencies above 0 and up to {HIGHEST_HZ:g} Hz, as 3.2,3.6"
    return number_list("--resonance-hz", text, expected, low=0, high=HIGHEST_HZ, above=True)


def _draws(rig: "RigSpec", bands: int | None, seed: int) -> "tuple[Draws | None, str]":
    """Return (draws where something is known of the rig's uncertainty, the sentence why there are none)."""
    from sinew.predict.band import draw_rigs

    if bands == 0:
        return None, ""
    known = rig.calibration is not None or any(one.interval90 is not None for _, one in rig.parameters())
    if not known and bands is None:
        return None, (
            f"the rig {rig.name} holds no intervals, so nothing is known of how far the pretension can be off; "
            "sinew calibrate writes a rig that knows"
        )
    if bands == 1:
        raise SpecError("--bands is 1, expected 2 or more draws, or 0 for no intervals")
    return draw_rigs(rig, bands or _DRAWS, seed), ""


def _print(document: dict[str, Any]) -> None:
    rows = []
    for one in document["settings"]:
        if one["feasible"]:
            cells = (
                shown_interval(one["pretension_mm"]),
                shown_interval(one["frequency_hz"]),
                fixed(one["torsion_deg"], 1),
                fixed(one["command_deg"], 1),
            )
            rows.append((f"{one['wanted_hz']:g}", *cells, fixed(one["tension_n"], 0)))
        else:
            rows.append((f"{one['wanted_hz']:g}", "-", "-", "-", "-", "-"))
    columns = ("wanted/Hz", "pretension/mm", "resonance/Hz", "torsion/°", "command/°", "tension/N")
    print_table(columns, rows, f"{document['rig']}: resonance is {document['resonance']}")
    reached = document["range"]
    if reached["frequency_hz"] is not None:
        ends = zip(reached["frequency_hz"], reached["pretension_mm"], strict=True)
        print("range: " + " to ".join(f"{number(hz, unit='Hz')} at {number(mm, 3, 'mm')}" for hz, mm in ends))
    for one in document["settings"]:
        print(f"- {one['sentence']}")
    for sentence in document["remarks"]:
        print(f"- {sentence}")
