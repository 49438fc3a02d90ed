"""This is where `sinew predict --bands` tells how far a rig's curves can be off, as far as its calibration knows."""

from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from sinew.apps.console import print_table, progress_bar
from sinew.apps.joint import BASE_RIG
from sinew.measure.estimate import span

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sinew.apps.predict_rig import Predicted
    from sinew.measure.estimate import Estimate
    from sinew.plan.plan import TendonMode
    from sinew.predict.band import Band, Marked, Tube

__all__ = ["BandSeed", "Bands", "bands_document", "print_bands"]

Bands = Annotated[
    int | None,
    typer.Option(
        "--bands", metavar="N", min=20, help="Calibrated rig: 90 % bands from N draws of what is known of it."
    ),
]
BandSeed = Annotated[int, typer.Option("--seed", min=0, help="Seed of the draws of --bands.")]


def bands_document(found: "Predicted", base: str | None, count: int, seed: int) -> "tuple[dict[str, Any], list[Band]]":
    """Return (the keys `bands` and `draws` of a prediction, the bands).

    base: file or name of the rig that the predicted one was made from; what is still known of it is taken over.
    Raises SpecError where nothing is known of how certain the rig's parameters are.
    """
    from sinew.plan.toml import load_rig
    from sinew.predict.band import bands_of, carried_over, draw_rigs
    from sinew.twin.parameters import Effects

    asked = found.asked
    rig, changed = carried_over(load_rig(base or BASE_RIG), found.rig)
    draws = draw_rigs(rig, count, seed)
    with progress_bar("draw") as progress:
        bands = bands_of(
            found.prediction,
            rig,
            draws,
            asked.pretensions,
            asked.amplitude_deg,
            asked.band_hz,
            mode=cast("TendonMode", asked.mode),
            effects=Effects().without(*asked.without),
            progress=progress,
        )
    remarks = list(draws.remarks)
    if changed:
        remarks.append(f"what the design changes is taken as certain: {', '.join(changed)}")
    told = {"count": count, "seed": seed, "parameters": list(draws.names), "remarks": remarks}
    rows = [_band(one, mm) for one, mm in zip(bands, asked.pretensions, strict=True)]
    return {"bands": rows, "draws": told}, bands


def _band(band: "Band", pretension_mm: float) -> dict[str, Any]:
    return {
        "pretension_mm": pretension_mm,
        "frequency_hz": band.frequency_hz.tolist(),
        "up": _swept(band.up),
        "down": _swept(band.down),
        "reached": band.reached.tolist(),
        "peak": _marked(band.peak),
        "phase_90": _marked(band.phase_90),
        "folds": [_marked(fold) for fold in band.folds],
        "draws": band.draws,
        "complete": band.complete,
        "folded": band.folded,
    }


def _swept(tubes: "tuple[Tube, Tube]") -> dict[str, Any]:
    import numpy as np

    def degrees(tube: "Tube") -> dict[str, Any]:
        return {name: _numbers(np.degrees(getattr(tube, name))) for name in ("low", "median", "high")}

    return {name: degrees(tube) for name, tube in zip(("amplitude_deg", "phase_deg"), tubes, strict=True)}


def _numbers(values: "NDArray[Any]") -> list[float | None]:
    import numpy as np

    return [float(one) if np.isfinite(one) else None for one in values]


def _marked(one: "Marked | None") -> dict[str, Any] | None:
    if one is None:
        return None
    return {
        "frequency_hz": one.frequency_hz.to_json(),
        "amplitude_deg": _in_degrees(one.amplitude).to_json(),
        "draws": one.draws,
    }


def _in_degrees(one: "Estimate") -> "Estimate":
    from math import degrees

    from sinew.measure.estimate import Estimate

    return Estimate(degrees(one.value), degrees(one.std), degrees(one.low), degrees(one.high))


def print_bands(document: dict[str, Any]) -> None:
    """Print a row of intervals for each curve."""
    rows = []
    for band in document["bands"]:
        folds = "; ".join(_cell(fold) for fold in band["folds"]) or "none"
        rows.append((f"{band['pretension_mm']:g}", _cell(band["peak"]), _cell(band["phase_90"]), folds))
    draws = document["draws"]
    title = f"90 % intervals from {draws['count']} draws"
    print_table(("pretension/mm", "peak", "90° of phase", "folds"), rows, title)
    for band in document["bands"]:
        if band["complete"] < band["draws"]:
            lost = band["draws"] - band["complete"]
            print(f"- at {band['pretension_mm']:g} mm {lost} of {band['draws']} draws do not reach the end of the band")
        if 0 < band["folded"] < band["draws"]:
            print(f"- at {band['pretension_mm']:g} mm {band['folded']} of {band['draws']} draws have folds")
    for sentence in draws["remarks"]:
        print(f"- {sentence}")


def _cell(mark: dict[str, Any] | None) -> str:
    if mark is None:
        return "-"
    (f_low, f_high), (a_low, a_high) = mark["frequency_hz"]["interval90"], mark["amplitude_deg"]["interval90"]
    if None in (f_low, f_high, a_low, a_high):
        return "too few draws have it"
    return f"{span(f_low, f_high, 'Hz')}, {span(a_low, a_high)}°"
