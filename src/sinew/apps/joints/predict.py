"""`sinew predict`: the steady response over frequency, of a rig or several, of a fit or of an oscillator."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from sinew.apps import console
from sinew.apps.console import Json, flag, option
from sinew.apps.joints.options import (
    BASE_RIG,
    Amplitude,
    JointOptions,
    Mode,
    Pretension,
    Without,
    designed_rig,
    prediction_request,
    with_options,
)
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.identify.forced import Forced, Kind, Mechanics
    from sinew.predict.against import Measured
    from sinew.predict.predicted import Compared, Predicted, PredictionRequest, Steady


# ---- on a fit: levels of a drive and one measured point, in the units that they are said in


Torque = Annotated[
    str | None,
    option(
        "LEVEL,...[:UNIT]", "Oscillator, fit: amplitude of what pushes; of a fit several.", "--torque", "--torque-n-m"
    ),
]
Base = Annotated[
    str | None,
    option(
        "LEVEL,...[:UNIT]",
        "Oscillator, fit: amplitude by which its base moves; of an angle in deg.",
        "--base",
        "--base-deg",
    ),
]
Point = Annotated[
    str | None,
    option(
        "HZ:AMPLITUDE[+-STD][:UNIT][@LEVEL]",
        "Fit: a measured steady motion, which gives the drive's gain; at the first level unless said.",
        "--through",
    ),
]
DRAWS = 100
"""Draws of the bands of a fit where nobody said."""

_FITTED = "pretensions of zero or more, as 0,4,8"
_POINT = re.compile(
    r"(?P<hertz>[^:@]+):(?P<size>[^:@]+?)(?:(?:\+-|±)(?P<std>[^:@]+))?(?::(?P<unit>[^@]+))?(?:@(?P<level>.+))?"
)


class FitRequest(NamedTuple):
    """What is asked of a fit, as it stands on the command line. start, stop: of the band [Hz]; bands: number of draws,
    seed: of them."""

    file: str
    torque: str | None
    base: str | None
    through: str | None
    start: float | None
    stop: float | None
    bands: int | None
    seed: int


def predicted_fit(request: FitRequest) -> "Forced":
    """Return the forced response. Raises SinewError where something cannot be meant."""
    from sinew.identify.forced import Through, drive_shown, predict_fit, read_mechanics, shown_in

    known = read_mechanics(request.file)
    if (request.torque is None) == (request.base is None):
        raise SpecError("say what drives it: --torque, the levels of what pushes, or --base, by how much that moves")
    name, text = ("--torque", request.torque) if request.torque is not None else ("--base", request.base)
    assert text is not None
    words, _, unit = text.partition(":")
    levels = console.number_list(name, words, "positive amplitudes, as 0.1,0.2", low=0, above=True)
    kind: Kind = "torque" if request.base is None else "base"
    drive = drive_shown(known, kind, unit.strip(), through=request.through is not None)
    point, motion = None, None
    if request.through is not None:
        found = _point(request.through)
        motion = shown_in(known.unit, (found["unit"] or "").strip() or known.unit_said)
        hertz, size = (_number(found[part]) for part in ("hertz", "size"))
        std = _number(found["std"]) if found["std"] else 0.0
        level = _number(found["level"]) / drive.factor if found["level"] else None
        point = Through(hertz, size / motion.factor, std / motion.factor, level)
    band = _band(known, request.start, request.stop)
    with console.progress_bar("draw") as progress:
        return predict_fit(
            known,
            torque=levels if request.torque is not None else None,
            base=levels if request.base is not None else None,
            through=point,
            band_hz=band,
            draws=request.bands or DRAWS,
            seed=request.seed,
            motion=motion,
            drive=drive,
            progress=progress,
        )


def _point(text: str) -> "re.Match[str]":
    found = _POINT.fullmatch(text.strip())
    if found is None:
        raise SpecError(f"--through is {text!r}, expected HZ:AMPLITUDE, as 3.1:12+-0.2:deg@0.5")
    return found


def _number(text: str) -> float:
    return console.number_list("--through", text.strip(), "a positive number", between="\n", low=0)[0]


def _band(known: "Mechanics", start: float | None, stop: float | None) -> tuple[float, float] | None:
    from math import pi, sqrt

    if start is None and stop is None:
        return None
    natural = sqrt(max(known.value("stiffness"), 0.0)) / (2 * pi)
    return console.checked_band((natural / 3 if start is None else start, 2 * natural if stop is None else stop))


# ---- the commands


# What is predicted is one of these, and each has its options.


class Subject(NamedTuple):
    """What can be predicted: its name in a sentence, and the parameters of `predict` that go with it."""

    name: str
    takes: frozenset[str]


_ALL = {"rigs", "start", "stop", "json"}
_OF_RIGS = _ALL | {"pretension", "amplitude", "mode", "without", "out"}
FIT = Subject("a fit (FIT.json)", frozenset(_ALL | {"torque", "base", "through", "bands", "seed", "out"}))
OSCILLATOR = Subject(
    "an oscillator (--oscillator)", frozenset((_ALL - {"rigs"}) | {"oscillator", "torque", "base", "backbone"})
)
BENT = Subject("a bent joint (--bend-deg)", frozenset(_OF_RIGS | {"bend", "azimuth", *JointOptions._fields}))
RIGS = Subject("several rigs", frozenset(_OF_RIGS))
RIG = Subject("a rig", frozenset(_OF_RIGS | {"backbone", "bands", "seed", "against", "fitted", *JointOptions._fields}))


def subject_of(rigs: Sequence[str], oscillator: str | None, bend: float | None) -> Subject:
    """Return what is meant: an oscillator by its option, a fit by its ending, else one rig, bent or not, or several."""
    if oscillator is not None:
        return OSCILLATOR
    if any(Path(name).suffix.lower() == ".json" for name in rigs):
        return FIT
    if len(rigs) > 1:
        return RIGS
    return RIG if bend is None else BENT


def require_options_of(subject: Subject, given: Mapping[str, str]) -> None:
    """Do nothing where options go with a subject; else raise SpecError. given: options by parameter, as written."""
    for name, written in given.items():
        if name not in subject.takes:
            *most, last = [one.name for one in (RIG, RIGS, BENT, FIT, OSCILLATOR) if name in one.takes]
            others = f"{', '.join(most)} or {last}" if most else last
            raise SpecError(f"{written} is for {others}, and this is {subject.name}; leave it out")


_NEEDED = ("inertia_kg_m2", "frequency_hz", "damping_ratio")


@with_options
def predict(
    context: typer.Context,
    rigs: Annotated[
        list[str] | None, typer.Argument(metavar="RIG...|FIT.json", help="Rigs, files or names; or one fit.")
    ] = None,
    oscillator: Annotated[str | None, option("KEY=VALUE,...", "Instead of a rig: {keys}.")] = None,
    torque: Torque = None,
    base: Base = None,
    through: Point = None,
    pretension: Pretension = "0,4,8,12",
    amplitude: Amplitude = 20.0,
    mode: Mode = "position",
    without: Without = None,
    start: Annotated[
        float | None, option("HZ", "Lowest frequency; else 1, or a third of the natural.", "--from-hz")
    ] = None,
    stop: Annotated[float | None, option("HZ", "Highest frequency; else 6, or twice the natural.", "--to-hz")] = None,
    backbone: Annotated[
        bool,
        flag("--backbone", "Rig, oscillator: also where it resonates, over the drive's amplitude up to the asked one."),
    ] = False,
    out: Annotated[
        Path | None,
        option("DIR|RIG.toml", "Rig, rigs, fit: figures and page; or the rig alone. Of a bent joint a picture."),
    ] = None,
    bands: Annotated[
        int | None,
        option("N", "Calibrated rig, fit: 90 % bands from N draws of what is known; of a fit 100.", min=20),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Rig, fit: seed of the draws of --bands.")] = 0,
    against: Annotated[
        Path | None,
        option("RECORDING", "Rig: hold it against a recording (NetCDF), at its pretensions, amplitude and mode."),
    ] = None,
    fitted: Annotated[
        str | None,
        option("MM,...", "--against: pretensions that the rig was fitted to; else what it says.", "--fitted-mm"),
    ] = None,
    bend: Annotated[
        float | None, option("DEG", "Rig: the joint in space, its head bent: torsion, tilt, tensions.", "--bend-deg")
    ] = None,
    azimuth: Annotated[float, option("DEG", "Bent joint: direction of the bend, from y to z.", "--azimuth-deg")] = 0.0,
    *,
    joint: JointOptions,
    json: Json = False,
) -> None:
    """Predict the steady response, with folds and stability.

    What is predicted follows from what you name. The help of an option begins with what it is for.

    \b
      RIG                a joint; options of a joint change it, without RIG the paper's
      RIG --bend-deg 20  the joint in space, which sways while it twists
      RIG RIG ...        several joints beside each other: tables, curves, maps of gain
      FIT.json           the mechanics that sinew identify found, in the record's units
      --oscillator ...   one degree of freedom, by its numbers

    Amplitudes are half of peak to peak of the rotation of the head against the base; phases are the lag of the
    fundamental behind the drive: the torque, the base's motion, or the rig's lever.

    Of a bent joint: fundamentals of torsion and of the tilt across the bend, the tilt in its plane at the double
    frequency, and what the tendons bear.

    A free decay does not determine the drive gain of a fit; give one measured point with --through:

    \b
      sinew identify decay.csv --time t --output phi:deg --model drag-cubic --out fit
      sinew predict fit/fit.json --torque 1,2,4:V --through 3.1:12+-0.2:deg@2 --out forced
    """
    rigs = rigs or []
    subject = subject_of(rigs, oscillator, bend)
    require_options_of(subject, console.given_options(context))
    rebuild = console.command_line(context)
    if subject is FIT:
        if len(rigs) > 1:
            raise SpecError(f"found {len(rigs)} files, expected one fit, or rigs alone")
        _predict_fit(FitRequest(rigs[0], torque, base, through, start, stop, bands, seed), out, rebuild, json=json)
        return
    if subject is OSCILLATOR:
        assert oscillator is not None
        found = _oscillator(oscillator, torque, base, start, stop, backbone=backbone)
        console.print_result(found.to_dict(), found.blocks(), json=json)
        return
    if not rigs and not joint.given:
        raise SpecError("expected a RIG, FIT.json, --oscillator, or options of a joint")
    requested = prediction_request(pretension, amplitude, mode, without, start, stop)
    if subject is RIGS:
        _predict_rigs(rigs, requested, out, rebuild, json=json)
        return
    rig = rigs[0] if rigs else None
    if bend is not None:
        _predict_bent(rig, joint, requested, (bend, azimuth), out, json=json)
        return
    further = Further(bands, seed, backbone, against, fitted, start, stop)
    _predict_rig(rig, joint, requested, further, out, rebuild, json=json)


class Further(NamedTuple):
    """What is asked of a rig further than its curves.

    bands: number of draws; seed: of them. backbone: whether it is wanted. against: a recording; fitted_mm: the
    pretensions that the rig was fitted to. start, stop: of the band [Hz] as given.
    """

    bands: int | None
    seed: int
    backbone: bool
    against: Path | None
    fitted_mm: str | None
    start: float | None
    stop: float | None


def _predict_rig(
    base: str | None,
    joint: JointOptions,
    requested: "PredictionRequest",
    further: Further,
    out: Path | None,
    rebuild: str,
    *,
    json: bool,
) -> None:
    """Print a rig's prediction, and write it where `out` says so: into a folder, or the rig alone into a TOML file.

    base: file or name of the rig. joint: what is changed in it. rebuild: the command line of the same.
    """
    from sinew.plan.toml import load_rig, save_rig
    from sinew.predict.against import hold_against, measured_of
    from sinew.predict.band import spread_of
    from sinew.predict.design import designed_joint
    from sinew.predict.predicted import predict_rig, with_backbone, with_bands

    alone = out is not None and out.suffix == ".toml"
    if out is not None and alone:
        console.require_file(out)
    elif out is not None:
        console.require_own(out, "rig.toml", lambda rig: rig.with_name("prediction.json").exists())
    if further.fitted_mm is not None and further.against is None:
        raise SpecError("--fitted-mm is about a recording; name one with --against, or leave it out")
    fitted = (
        None if further.fitted_mm is None else console.number_list("--fitted-mm", further.fitted_mm, _FITTED, low=0)
    )
    before = load_rig(base or BASE_RIG)
    if further.bands is not None:
        spread_of(before)  # before long work
    measured = None
    if further.against is not None:
        from sinew.measure.files.netcdf import load_recording

        if base is None:
            raise SpecError("--against needs a RIG: the one that was calibrated, to be held against the recording")
        measured = measured_of(load_recording(further.against), before)
        requested = _request_for_recording(measured, further, requested)
    rig, design = designed_rig(base, joint)
    found = predict_rig(rig, requested)
    if further.bands is not None:
        with console.progress_bar("draw") as progress:
            found = with_bands(found, before, further.bands, further.seed, progress)
    if measured is not None and further.against is not None:
        against = hold_against(measured, found.prediction, rig, requested.effects, fitted, further.against.name)
        found = replace(found, against=against)
    if further.backbone:
        found = with_backbone(found)
    document = found.to_dict() | ({} if design is None else designed_joint(rig, design).to_dict())
    if out is not None:
        save_rig(rig, out if alone else out / "rig.toml")
    _print_written(found, document, out, "prediction", rebuild, json=json)


def _request_for_recording(
    measured: "Measured", further: Further, requested: "PredictionRequest"
) -> "PredictionRequest":
    """Return what is asked of a rig so that it can be held against a recording.

    Pretensions, amplitude and mode are the recording's, and so is the band unless it was given; what the twin had
    switched off is off. Raises SpecError where the recording reaches beyond the given band.
    """
    low, high = measured.band_hz
    start, stop = further.start or low, further.stop or high
    if start > low or stop < high:
        name = further.against.name if further.against is not None else "the recording"
        raise SpecError(f"{name} goes from {low:g} to {high:g} Hz; leave --from-hz and --to-hz out, or widen them")
    return requested._replace(
        pretensions=[float(one) for one in measured.response.pretension_mm],
        amplitude_deg=measured.amplitude_deg,
        mode=measured.mode,
        without=tuple(dict.fromkeys((*requested.without, *measured.effects_off))),
        band_hz=(start, stop),
    )


def _print_written(
    found: "Predicted | Compared | Forced",
    document: dict[str, Any],
    out: Path | None,
    stem: str,
    rebuild: str,
    *,
    json: bool,
) -> None:
    """Write document, figures and page into a folder, where there is one, and print what was found."""
    if out is not None and out.suffix != ".toml":
        from sinew.figures.predicted import write_prediction

        console.write_json(document, out / f"{stem}.json")
        write_prediction(out, stem, found, rebuild=rebuild)
    console.print_result(document, found.blocks(), f"written: {out}" if out else "", json=json)


def _predict_bent(
    base: str | None,
    joint: JointOptions,
    requested: "PredictionRequest",
    pose_deg: tuple[float, float],
    out: Path | None,
    *,
    json: bool,
) -> None:
    """Print the response of a joint in a pose (bend, azimuth) [deg], and draw it where `out` says so."""
    bend, azimuth = pose_deg
    console.checked_number("--bend-deg", bend, "0 to 60°; turn it by --azimuth-deg", low=0, high=60)
    console.checked_number("--azimuth-deg", azimuth, "an angle from -360 to 360°", low=-360, high=360)
    if out is not None:
        console.require_ending(out, console.PICTURES)
    from sinew.predict.coupled import predict_bent

    rig, _ = designed_rig(base, joint)
    with console.progress_bar("follow") as progress:
        found = predict_bent(
            rig,
            requested.pretensions,
            bend_deg=bend,
            azimuth_deg=azimuth,
            amplitude_deg=requested.amplitude_deg,
            mode=requested.tendon_mode,
            without=requested.without,
            band_hz=requested.band_hz,
            progress=progress,
        )
    written = ""
    if out is not None:
        from sinew.figures.space import write_bent

        written = f"wrote {write_bent(found, out)}"
    console.print_result(found.to_dict(), found.blocks(), written, json=json)


def _predict_fit(request: FitRequest, out: Path | None, rebuild: str, *, json: bool) -> None:
    if out is not None:
        console.require_folder(out)
    found = predicted_fit(request)
    _print_written(found, {"fit": request.file, **found.to_dict()}, out, "prediction", rebuild, json=json)


def _oscillator(
    text: str, torque: str | None, base: str | None, start: float | None, stop: float | None, *, backbone: bool
) -> "Steady":
    """Return an oscillator's prediction."""
    import math

    from sinew.predict.oscillator import KEYS, Oscillator
    from sinew.predict.predicted import predict_oscillator

    values: dict[str, float] = {}
    for part in text.split(","):
        key, equal, value = (piece.strip() for piece in part.partition("="))
        if key not in KEYS or not equal:
            raise SpecError(f"--oscillator holds {part.strip()!r}, expected KEY=VALUE with one of {', '.join(KEYS)}")
        values[KEYS[key]] = console.number_list(f"--oscillator {key}", value, "a finite number", between="\n")[0]
    missing = [key for key in _NEEDED if KEYS[key] not in values]
    if missing:
        raise SpecError(f"--oscillator lacks {', '.join(missing)}; add {missing[0]}=...")
    if (torque is None) == (base is None):
        raise SpecError("say what drives the oscillator: either --torque-n-m or --base-deg")
    given = "--torque-n-m" if base is None else "--base-deg"
    level, *more = console.number_list(given, str(torque if base is None else base), "a finite number")
    if more:
        raise SpecError(f"{given} holds {1 + len(more)} levels, expected one; a fit of sinew identify takes several")
    drive = {"torque": level} if base is None else {"base": math.radians(level)}
    one = Oscillator(**values, **drive).checked()
    band_hz = console.checked_band(
        (one.frequency_hz / 3 if start is None else start, 2 * one.frequency_hz if stop is None else stop)
    )
    if sentence := one.friction_remark():
        console.remark(sentence)
    return predict_oscillator(one, band_hz, backbone=backbone)


def _predict_rigs(
    rigs: list[str], requested: "PredictionRequest", out: Path | None, rebuild: str, *, json: bool
) -> None:
    """Print the curves of several rigs side by side; write figures and page where `out` says so."""
    from sinew.measure.result import Rows
    from sinew.plan.toml import load_rig
    from sinew.predict.predicted import Compared, predict_rig

    if out is not None:
        console.require_folder(out)
    loaded, rows = [load_rig(rig) for rig in rigs], []
    with console.progress_bar("predict") as progress:
        for i, (rig, source) in enumerate(zip(loaded, rigs, strict=True)):
            progress(i, len(loaded))
            rows.append(replace(predict_rig(rig, requested), source=source))
    found = Compared(requested.amplitude_deg, Rows(rows))
    _print_written(found, found.to_dict(), out, "comparison", rebuild, json=json)
