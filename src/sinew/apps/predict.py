"""This is where `sinew predict` turns an oscillator's numbers, or a rig, into its steady response over frequency."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps.console import print_json, remark
from sinew.apps.joint_options import JointOptions, with_joint_options
from sinew.apps.options import Json, checked_band, number_list
from sinew.apps.predict_against import Against, FittedMm
from sinew.apps.predict_backbone import print_backbones
from sinew.apps.predict_bands import Bands, BandSeed
from sinew.apps.predict_document import prediction_document, print_prediction
from sinew.apps.predict_further import Further, print_further
from sinew.apps.predict_joint import predict_joint
from sinew.apps.predict_rig import Amplitude, Mode, Pretension, Without, rig_asked
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.predict.branch import Prediction

__all__ = ["predict"]

Backbones = Callable[[], list[dict[str, Any]]]

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

_Torque = Annotated[
    float | None, typer.Option("--torque-n-m", metavar="NM", help="Oscillator: amplitude of the torque on it.")
]
_Base = Annotated[
    float | None, typer.Option("--base-deg", metavar="DEG", help="Oscillator: amplitude by which its base turns.")
]
_Backbone = Annotated[
    bool,
    typer.Option("--backbone", help="Also where it resonates, over the drive's amplitude up to the asked one."),
]
_Out = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR|RIG.toml", help="Rig: write figures and page, or the joint's rig alone."),
]


@with_joint_options
def predict(
    rig: Annotated[
        str | None, typer.Argument(metavar="RIG", help="A rig: a TOML file, or the name of a shipped one.")
    ] = None,
    oscillator: Annotated[
        str | None,
        typer.Option("--oscillator", metavar="KEY=VALUE,...", help=f"Instead of a rig: {', '.join(_KEYS)}."),
    ] = None,
    torque: _Torque = None,
    base: _Base = None,
    pretension: Pretension = "0,4,8,12",
    amplitude: Amplitude = 20.0,
    mode: Mode = "position",
    without: Without = None,
    start: Annotated[
        float | None,
        typer.Option("--from-hz", metavar="HZ", help="Lowest frequency; else 1, or a third of the natural."),
    ] = None,
    stop: Annotated[
        float | None, typer.Option("--to-hz", metavar="HZ", help="Highest frequency; else 6, or twice the natural.")
    ] = None,
    backbone: _Backbone = False,
    out: _Out = None,
    bands: Bands = None,
    seed: BandSeed = 0,
    against: Against = None,
    fitted: FittedMm = None,
    *,
    joint: JointOptions,
    json: Json = False,
) -> None:
    """Predict the steady response over frequency, through its folds, with stability.

    Amplitudes are half of peak to peak of the rotation of the head against the base; phases are the lag of the
    fundamental behind the drive: the torque, the base's motion, or the rig's lever.

    A joint that is not built yet is a RIG, else the paper's, in which what is said of the joint is changed.
    """
    further = Further(bands, seed, against, fitted, start, stop)
    if oscillator is not None:
        for option in (*joint.given, *further.given, *(["--out"] if out is not None else [])):
            raise SpecError(f"{option} is for a rig; leave it out with --oscillator")
    if (rig is None and not joint.given) == (oscillator is None):
        raise SpecError("expected either a RIG or --oscillator, and not both")
    if oscillator is not None:
        prediction, pretensions, backbones = _oscillator(oscillator, torque, base, start, stop)
        document = prediction_document(prediction, pretensions)
    else:
        if torque is not None or base is not None:
            raise SpecError("--torque-n-m and --base-deg drive an oscillator; a rig is driven with --amplitude-deg")
        asked = rig_asked(pretension, amplitude, mode, without, start, stop)
        document, backbones = predict_joint(rig, joint, asked, further, out)
    if backbone:
        document["backbone"] = backbones()
    if json:
        print_json(document)
        return
    print_prediction(document)
    print_further(document)
    if backbone:
        print_backbones(document["backbone"])
    if out is not None:
        print(f"written: {out}")


def _number(what: str, text: str) -> float:
    return number_list(what, text, "a finite number", between="\n")[0]


def _oscillator(
    text: str, torque: float | None, base: float | None, start: float | None, stop: float | None
) -> "tuple[Prediction, list[float], Backbones]":
    import math
    from functools import partial

    from sinew.apps.predict_backbone import oscillator_backbones
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
    band_hz = checked_band(
        (one.frequency_hz / 3 if start is None else start, 2 * one.frequency_hz if stop is None else stop)
    )
    if sentence := one.friction_remark():
        remark(sentence)
    prediction = run(oscillator_problem([one], band_hz), band_hz, resolution_of([one]))
    return prediction, [math.nan], partial(oscillator_backbones, one, band_hz)
