"""This is where `sinew predict` turns an oscillator's numbers, or a rig, into its steady response over frequency."""

from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from sinew.apps.console import print_json, print_table
from sinew.apps.options import Json
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.plan.plan import TendonMode
    from sinew.predict.branch import Branch, Mark, Prediction

__all__ = ["predict"]

_KEYS = {
    "inertia_kg_m2": "inertia",
    "frequency_hz": "frequency_hz",
    "damping_ratio": "damping_ratio",
    "cubic_n_m_rad3": "cubic",
    "quadratic": "quadratic",
    "quadratic_n_m_rad2": "quadratic",
    "coulomb_n_m": "coulomb",
}
_NEEDED = ("inertia_kg_m2", "frequency_hz", "damping_ratio")
_MODES = ("position", "position-with-current-limit", "current")


def predict(
    rig: Annotated[
        str | None, typer.Argument(metavar="RIG", help="A rig: a TOML file, or the name of a shipped one.")
    ] = None,
    oscillator: Annotated[
        str | None,
        typer.Option("--oscillator", metavar="KEY=VALUE,...", help=f"Instead of a rig: {', '.join(_KEYS)}."),
    ] = None,
    torque: Annotated[
        float | None, typer.Option("--torque-n-m", metavar="NM", help="Oscillator: amplitude of the torque on it.")
    ] = None,
    base: Annotated[
        float | None, typer.Option("--base-deg", metavar="DEG", help="Oscillator: amplitude by which its base turns.")
    ] = None,
    pretension: Annotated[
        str, typer.Option("--pretension-mm", metavar="MM,...", help="Rig: pretensions, one curve for each.")
    ] = "0,4,8,12",
    amplitude: Annotated[
        float, typer.Option("--amplitude-deg", metavar="DEG", help="Rig: amplitude of the drive's command.")
    ] = 20.0,
    mode: Annotated[
        str, typer.Option("--mode", metavar="|".join(_MODES), help="Rig: mode of the motors.")
    ] = "position",
    without: Annotated[
        list[str] | None,
        typer.Option("--without", metavar="EFFECT", help="Rig: switch an effect of the twin off; may be repeated."),
    ] = None,
    start: Annotated[
        float | None,
        typer.Option("--from-hz", metavar="HZ", help="Lowest frequency; else 1, or a third of the natural."),
    ] = None,
    stop: Annotated[
        float | None, typer.Option("--to-hz", metavar="HZ", help="Highest frequency; else 6, or twice the natural.")
    ] = None,
    json: Json = False,
) -> None:
    """Predict the steady response over frequency, through its folds, with stability.

    Amplitudes are half of peak to peak of the rotation of the head against the base; phases are the lag of the
    fundamental behind the drive: the torque, the base's motion, or the rig's lever.
    """
    if (rig is None) == (oscillator is None):
        raise SpecError("expected either a RIG or --oscillator, and not both")
    if oscillator is not None:
        prediction, pretensions = _oscillator(oscillator, torque, base, start, stop)
    else:
        if torque is not None or base is not None:
            raise SpecError("--torque-n-m and --base-deg drive an oscillator; a rig is driven with --amplitude-deg")
        if mode not in _MODES:
            raise SpecError(f"--mode is {mode!r}, expected one of {', '.join(_MODES)}")
        pretensions = [_number("--pretension-mm", part) for part in pretension.split(",")]
        prediction = _rig(str(rig), pretensions, amplitude, mode, without or [], (start or 1.0, stop or 6.0))
    document = _document(prediction, pretensions)
    if json:
        print_json(document)
    else:
        _print(document)


def _number(what: str, text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise SpecError(f"{what} holds {text.strip()!r}, expected a number") from error


def _band(band_hz: tuple[float, float]) -> tuple[float, float]:
    if not 0 < band_hz[0] < band_hz[1]:
        raise SpecError(f"found a band from {band_hz[0]:g} to {band_hz[1]:g} Hz, expected 0 < --from-hz < --to-hz")
    return band_hz


def _oscillator(
    text: str, torque: float | None, base: float | None, start: float | None, stop: float | None
) -> "tuple[Prediction, list[float]]":
    import math

    from sinew.predict.oscillator import Oscillator, oscillator_problem, resolution_of
    from sinew.predict.prediction import predict as run
    from sinew.twin.cache import configure

    values: dict[str, float] = {}
    for part in text.split(","):
        key, equal, value = (piece.strip() for piece in part.partition("="))
        if key not in _KEYS or not equal:
            raise SpecError(f"--oscillator holds {part.strip()!r}, expected KEY=VALUE with one of {', '.join(_KEYS)}")
        values[_KEYS[key]] = _number(f"--oscillator {key}", value)
    missing = [key for key in _NEEDED if _KEYS[key] not in values]
    if missing:
        raise SpecError(f"--oscillator lacks {', '.join(missing)}; add {missing[0]}=...")
    if (torque is None) == (base is None):
        raise SpecError("say what drives the oscillator: either --torque-n-m or --base-deg")
    configure()
    one = Oscillator(**values, torque=torque or 0.0, base=math.radians(base or 0.0)).checked()
    band_hz = _band((start or one.frequency_hz / 3, stop or 2 * one.frequency_hz))
    return run(oscillator_problem([one], band_hz), band_hz, resolution_of([one])), [math.nan]


def _rig(
    name: str, pretensions: list[float], amplitude: float, mode: str, without: list[str], band_hz: tuple[float, float]
) -> "Prediction":
    from sinew.plan.toml import load_rig
    from sinew.predict.joint import RESOLUTION, joint_problem
    from sinew.predict.prediction import predict as run
    from sinew.twin.effects import Effects

    if amplitude <= 0:
        raise SpecError(f"--amplitude-deg is {amplitude:g}, expected a positive angle")
    if min(pretensions) < 0:
        raise SpecError(f"--pretension-mm holds {min(pretensions):g}, expected zero or more: cables cannot push")
    rig, effects = load_rig(name), Effects().without(*without)
    problem = joint_problem(rig, pretensions, amplitude, _band(band_hz), mode=cast("TendonMode", mode), effects=effects)
    return run(problem, band_hz, RESOLUTION)


def _mark(mark: "Mark | None") -> dict[str, float] | None:
    from math import degrees

    if mark is None:
        return None
    return {"frequency_hz": mark.frequency_hz, "amplitude_deg": degrees(mark.amplitude)}


def _branch(branch: "Branch", pretension_mm: float) -> dict[str, Any]:
    import numpy as np

    return {
        "pretension_mm": pretension_mm if np.isfinite(pretension_mm) else None,
        "frequency_hz": branch.frequency_hz.tolist(),
        "amplitude_deg": np.degrees(branch.amplitude).tolist(),
        "fundamental_deg": np.degrees(branch.fundamental).tolist(),
        "phase_deg": np.degrees(branch.phase).tolist(),
        "stable": branch.stable.tolist(),
        "multiplier": branch.multiplier.tolist(),
        "folds": [_mark(fold) for fold in branch.folds],
        "peak": _mark(branch.peak),
        "phase_90": _mark(branch.phase_90),
        "error": branch.error.tolist(),
        "complete": branch.complete,
        "message": branch.message,
    }


def _document(prediction: "Prediction", pretensions: list[float]) -> dict[str, Any]:
    return {
        "branches": [_branch(one, mm) for one, mm in zip(prediction.branches, pretensions, strict=True)],
        "harmonics": prediction.harmonics,
        "error_estimate": prediction.error_estimate,
        "wall_s": prediction.wall_s,
    }


def _print(document: dict[str, Any]) -> None:
    def cells(mark: dict[str, float] | None) -> str:
        return "-" if mark is None else f"{mark['frequency_hz']:.4f} Hz, {mark['amplitude_deg']:.3f}°"

    rows = []
    for branch in document["branches"]:
        pretension = branch["pretension_mm"]
        folds = "; ".join(cells(fold) for fold in branch["folds"]) or "none"
        name = "-" if pretension is None else f"{pretension:g}"
        steady = f"{sum(branch['stable'])} of {len(branch['stable'])}"
        rows.append((name, cells(branch["peak"]), cells(branch["phase_90"]), folds, steady))
    print_table(("pretension/mm", "peak", "90° of phase", "folds", "stable points"), rows)
    for branch in document["branches"]:
        if not branch["complete"] or "not" in branch["message"]:
            print(f"- {branch['message']}")
    error = document["error_estimate"]
    print(f"{document['harmonics']} harmonics, error estimate {error:.1e}, {document['wall_s'] * 1e3:.0f} ms")
