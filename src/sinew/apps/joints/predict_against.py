"""`sinew predict --against`: a rig's curves against a recording of the joint."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from sinew.apps.console import number_list, option, print_table
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.predict.against import Comparison, Measured
    from sinew.predict.predicted import Predicted, RigAsked

Against = Annotated[
    Path | None,
    option(
        "RECORDING", "Rig: hold it against a recording (NetCDF), at its pretensions, amplitude and mode.", "--against"
    ),
]
FittedMm = Annotated[
    str | None, option("MM,...", "--against: pretensions that the rig was fitted to; else what it says.", "--fitted-mm")
]

_TITLES = {
    "resonance_hz": "frequency of the fundamental's peak, by the command",
    "gain_peak": "gain at the peak, by the command",
    "resonance_measured_drive_hz": "frequency of the peak, by the measured lever",
    "gain_peak_measured_drive": "gain at the peak, by the measured lever",
    "phase_90_hz": "frequency of 90° of phase",
    "gain": "gain, by the command",
    "phase_from_command_rad": "phase, by the command",
    "gain_measured_drive": "gain, by the measured lever",
    "phase_lag_rad": "phase, by the measured lever",
}
_SUBSETS = {"all": "all", "fitted": "fitted to", "others": "not fitted to"}


class Held(NamedTuple):
    """A recording and what it says of the steady response. file: its name, without folder."""

    file: str
    measured: "Measured"


def measured_against(file: Path, rig: str | None) -> Held:
    """Return what a recording says. rig: file or name of the rig, whose sensors are taken."""
    from sinew.measure.files.netcdf import load_recording
    from sinew.plan.toml import load_rig
    from sinew.predict.against import measured_of

    if rig is None:
        raise SpecError("--against needs a RIG: the one that was calibrated, to be held against the recording")
    return Held(file.name, measured_of(load_recording(file), load_rig(rig)))


def asked_of(held: Held, asked: "RigAsked", start: float | None, stop: float | None) -> "RigAsked":
    """Return what is asked of the rig so that it can be held against the recording.

    Pretensions, amplitude and mode are the recording's, and so is the band unless it was given; what the twin had
    switched off is off. Raises SpecError where the recording reaches beyond the given band.
    """
    measured = held.measured
    low, high = measured.band_hz
    band = (min(start or low, low), max(stop or high, high))
    if (start or low) > low or (stop or high) < high:
        raise SpecError(f"{held.file} goes from {low:g} to {high:g} Hz; leave --from-hz and --to-hz out, or widen them")
    without = tuple(dict.fromkeys((*asked.without, *measured.effects_off)))
    pretensions = [float(one) for one in measured.response.pretension_mm]
    return asked._replace(
        pretensions=pretensions, amplitude_deg=measured.amplitude_deg, mode=measured.mode, without=without, band_hz=band
    )


def hold_against(held: Held, found: "Predicted", fitted_mm: str | None) -> "tuple[dict[str, Any], Comparison]":
    """Return (the key `against` of a prediction, the comparison)."""
    from sinew.predict.against import compare
    from sinew.predict.joint import RESOLUTION, lever_problem
    from sinew.solve.curves import predict
    from sinew.twin.parameters import Effects

    measured, asked = held.measured, found.asked
    lever = None
    if measured.lever is not None:
        band = measured.band_hz
        effects = Effects().without(*asked.without)
        problem = lever_problem(found.rig, measured.lever, band, mode=measured.mode, effects=effects)
        lever = predict(problem, band, RESOLUTION)
    known = found.rig.calibration
    told = known.pretension_mm if known is not None else ()
    fitted = tuple(told) if fitted_mm is None else tuple(millimetres(fitted_mm))
    comparison = compare(measured, found.prediction, lever, fitted)
    return _document(held, comparison, fitted, lever is not None), comparison


def millimetres(text: str) -> list[float]:
    """Return the numbers of --fitted-mm. Raises SpecError where one is none."""
    return number_list("--fitted-mm", text, "pretensions of zero or more, as 0,4,8", low=0)


def _document(held: Held, comparison: "Comparison", fitted: tuple[float, ...], with_lever: bool) -> dict[str, Any]:
    from sinew.predict.against import scores_of

    scores = {
        subset: {_key(name): _score(name, one) for name, one in each.items()}
        for subset, each in scores_of(comparison).items()
    }
    remarks = []
    if not fitted:
        remarks.append(
            "the rig does not say to which pretensions it was calibrated, so none counts as fitted; say it with "
            "--fitted-mm"
        )
    elif "others" not in scores:
        remarks.append("the rig was calibrated to every pretension of the recording; nothing here is a prediction")
    if not with_lever:
        remarks.append("the recording has no motion of the lever, so the joint was not compared by it")
    if held.measured.effects_off:
        remarks.append(
            f"the recording's twin had {', '.join(held.measured.effects_off)} off, and so has the prediction"
        )
    return {
        "recording": held.file,
        "amplitude_deg": held.measured.amplitude_deg,
        "mode": held.measured.mode,
        "fitted_mm": list(fitted),
        "scores": scores,
        "resonance": _resonance(comparison),
        "points": _points(comparison),
        "remarks": remarks,
    }


def _key(name: str) -> str:
    return f"{name.removesuffix('_rad')}_deg" if name.endswith("_rad") else name


def _score(name: str, score: Any) -> dict[str, Any]:
    from math import degrees, isfinite

    from sinew.predict.against import is_angle

    def number(value: float, *, angle: bool) -> float | None:
        return None if not isfinite(value) else degrees(value) if angle else value

    found: dict[str, Any] = {"count": score.count}
    for part in ("rms", "largest", "noise"):
        found[part] = number(getattr(score, part), angle=is_angle(name))
    return {**found, "inside": number(score.inside, angle=False)}


def _place(name: str, reading: Any, place: tuple[int, ...]) -> dict[str, Any] | None:
    from math import degrees, isfinite

    from sinew.measure.estimate import Estimate
    from sinew.predict.against import estimate_at, is_angle

    measured, predicted, error = estimate_at(name, reading, place)
    if not (isfinite(measured.value) and isfinite(predicted)):
        return None
    if is_angle(name):
        predicted = degrees(predicted)
        measured, error = (
            Estimate(*(degrees(part) for part in (one.value, one.std, one.low, one.high))) for one in (measured, error)
        )
    return {"measured": measured.to_json(), "predicted": predicted, "error": error.to_json()}


def _resonance(c: "Comparison") -> list[dict[str, Any]]:
    rows = []
    for i, mm in enumerate(c.pretension_mm):
        row = {_key(name): _place(name, reading, (i,)) for name, reading in c.readings.items()}
        rows.append({"pretension_mm": float(mm), "fitted": bool(c.fitted[i]), **row})
    return rows if c.readings else []


def _points(c: "Comparison") -> list[dict[str, Any]]:
    rows = []
    for i, mm in enumerate(c.pretension_mm):
        for j, hertz in enumerate(c.frequency_hz):
            row = {_key(name): _place(name, reading, (i, j)) for name, reading in c.points.items()}
            if any(one is not None for one in row.values()):
                head = {"pretension_mm": float(mm), "frequency_hz": float(hertz), "fitted": bool(c.fitted[i])}
                rows.append({**head, **row})
    return rows


def print_against(document: dict[str, Any]) -> None:
    """Print how well the rig predicts the recording."""
    rows = []
    for name, title in _TITLES.items():
        angle, key = name.endswith("_rad"), _key(name)
        for subset, where in _SUBSETS.items():
            score = document["scores"].get(subset, {}).get(key)
            if score is not None and (subset == "all" or "others" in document["scores"]):
                factor, unit = (1.0, "°") if angle else (100.0, " %")
                cells = [f"{factor * score[part]:.2f}{unit}" for part in ("rms", "largest")]
                rows.append((title if subset == "all" else "", where, str(score["count"]), *cells))
    print_table(("against the recording", "pretensions", "number", "rms error", "largest"), rows, document["recording"])
    for sentence in document["remarks"]:
        print(f"- {sentence}")
