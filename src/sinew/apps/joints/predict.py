"""`sinew predict` and `sinew compare`: the steady response over frequency, of a rig, an oscillator, a fit, or rigs."""

import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from sinew.apps import console
from sinew.apps.console import Json, flag, option
from sinew.apps.joints import predict_against
from sinew.apps.joints.options import (
    BASE_RIG,
    Amplitude,
    JointOptions,
    Mode,
    Pretension,
    Without,
    designed_rig,
    rig_asked,
    with_joint_options,
)
from sinew.measure.errors import SpecError
from sinew.measure.estimate import number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sinew.identify.forced import Forced, Kind, Mechanics
    from sinew.predict.predicted import Predicted, RigAsked
    from sinew.solve.branch import Prediction


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

_POINT = re.compile(
    r"(?P<hertz>[^:@]+):(?P<size>[^:@]+?)(?:(?:\+-|±)(?P<std>[^:@]+))?(?::(?P<unit>[^@]+))?(?:@(?P<level>.+))?"
)


def is_fit(name: str | None) -> bool:
    """Return whether what is to be predicted is a fit's document, by its ending."""
    return name is not None and Path(name).suffix.lower() == ".json"


class AskedOfFit(NamedTuple):
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

    def words(self) -> list[str]:
        """Return the command's words that ask for the same again."""
        numbers = {"--from-hz": self.start, "--to-hz": self.stop}
        given = {"--torque": self.torque, "--base": self.base, "--through": self.through}
        given |= {name: f"{value:g}" for name, value in numbers.items() if value is not None}
        given |= {"--bands": str(self.bands or DRAWS), "--seed": str(self.seed)}
        return ["sinew", "predict", self.file, *(w for name, value in given.items() if value for w in (name, value))]


def predicted_fit(asked: AskedOfFit) -> "Forced":
    """Return the forced response. Raises SinewError where something cannot be meant."""
    from sinew.identify.forced import Through, drive_shown, predict_fit, read_mechanics, shown_in

    known = read_mechanics(asked.file)
    if (asked.torque is None) == (asked.base is None):
        raise SpecError("say what drives it: --torque, the levels of what pushes, or --base, by how much that moves")
    name, text = ("--torque", asked.torque) if asked.torque is not None else ("--base", asked.base)
    assert text is not None
    words, _, unit = text.partition(":")
    levels = console.number_list(name, words, "positive amplitudes, as 0.1,0.2", low=0, above=True)
    kind: Kind = "torque" if asked.base is None else "base"
    drive = drive_shown(known, kind, unit.strip(), through=asked.through is not None)
    point, motion = None, None
    if asked.through is not None:
        found = _point(asked.through)
        motion = shown_in(known.unit, (found["unit"] or "").strip() or known.unit_said)
        hertz, size = (_number(found[part]) for part in ("hertz", "size"))
        std = _number(found["std"]) if found["std"] else 0.0
        level = _number(found["level"]) / drive.factor if found["level"] else None
        point = Through(hertz, size / motion.factor, std / motion.factor, level)
    band = _band(known, asked.start, asked.stop)
    with console.progress_bar("draw") as progress:
        return predict_fit(
            known,
            torque=levels if asked.torque is not None else None,
            base=levels if asked.base is not None else None,
            through=point,
            band_hz=band,
            draws=asked.bands or DRAWS,
            seed=asked.seed,
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


def write_forced(found: "Forced", document: dict[str, Any], folder: Path, rebuild: str) -> Path:
    """Write prediction.json, figures and prediction.html into a folder; return the page."""
    from sinew.figures.predicted import draw_forced, write_forced_page
    from sinew.figures.style import save_figure
    from sinew.measure.files.netcdf import provenance

    paths = list(save_figure(draw_forced(found), folder / "figures", "forced_response", ("png", "pdf")))
    console.write_json(document, folder / "prediction.json")
    origins = [("versions", str(provenance("import")["versions"]))]
    return write_forced_page(folder / "prediction.html", document, figures=paths, rebuild=rebuild, origins=origins)


# ---- the commands


Backbones = Callable[[], list[dict[str, Any]]]


# `sinew predict` is asked for more than curves: bands, and a recording to be held against.


class Further(NamedTuple):
    """What is asked beside the curves. bands: number of draws; seed: of them. against: a recording; fitted_mm: the
    pretensions that the rig was fitted to. start, stop: of the band [Hz] as given."""

    bands: int | None = None
    seed: int = 0
    against: Path | None = None
    fitted_mm: str | None = None
    start: float | None = None
    stop: float | None = None

    @property
    def given(self) -> list[str]:
        """Return the options that were given."""
        named = {"--bands": self.bands, "--against": self.against, "--fitted-mm": self.fitted_mm}
        return [option for option, value in named.items() if value is not None]

    def words(self, asked: "RigAsked") -> list[str]:
        """Return the command's words that ask for the same again. asked: of the rig, before a recording was read."""
        bands = [] if self.bands is None else ["--bands", str(self.bands), "--seed", str(self.seed)]
        against = [] if self.against is None else ["--against", str(self.against)]
        fitted = [] if self.fitted_mm is None else ["--fitted-mm", self.fitted_mm]
        if self.against is None:
            return [*_words_of(asked), *bands]
        off = [word for effect in asked.without for word in ("--without", effect)]
        return [*off, *bands, *against, *fitted]

    def held(self, rig: str | None) -> predict_against.Held | None:
        """Return the recording. rig: file or name. Raises SpecError, before long work, for what cannot be meant."""
        if self.fitted_mm is not None:
            if self.against is None:
                raise SpecError("--fitted-mm is about a recording; name one with --against, or leave it out")
            predict_against.millimetres(self.fitted_mm)
        if self.bands is not None:
            from sinew.plan.toml import load_rig
            from sinew.predict.band import spread_of

            spread_of(load_rig(rig or BASE_RIG))
        return None if self.against is None else predict_against.measured_against(self.against, rig)

    def asked(self, held: predict_against.Held | None, asked: "RigAsked") -> "RigAsked":
        """Return what is asked of the rig, at the recording's settings where there is one."""
        return asked if held is None else predict_against.asked_of(held, asked, self.start, self.stop)

    def answered(
        self, held: predict_against.Held | None, found: "Predicted", base: str | None, *, drawn: bool
    ) -> "tuple[dict[str, Any], dict[str, Figure]]":
        """Return (keys of the document, figures by name; none unless drawn). base: file or name of the rig."""
        document: dict[str, Any] = {}
        figures: dict[str, Figure] = {}
        if self.bands is not None:
            from sinew.plan.toml import load_rig
            from sinew.predict.predicted import with_bands

            with console.progress_bar("draw") as progress:
                more = with_bands(found, load_rig(base or BASE_RIG), self.bands, self.seed, progress).drawn
            assert more is not None
            document |= more.document(found.asked.pretensions)
            if drawn:
                from sinew.figures.predicted import curves_of, draw_bands

                figures["predicted_bands"] = draw_bands(curves_of(found), more.bands)
        if held is not None:
            document["against"], comparison = predict_against.hold_against(held, found, self.fitted_mm)
            if drawn:
                from sinew.figures.predicted import draw_against

                figures["predicted_against"] = draw_against(comparison)
        return document, figures


# `sinew predict` takes a rig, or makes one, and writes what it was asked to write.


def predict_joint(
    base: str | None, joint: JointOptions, asked: "RigAsked", further: Further, out: Path | None
) -> tuple[dict[str, Any], Backbones]:
    """Return the document of a rig's prediction, and what gives its backbones; write files where `out` says so.

    base: file or name of the rig. joint: what is changed in it. further: what is asked beside the curves. out: a folder
    for figures and page, or a file ending in .toml for the rig alone.
    """
    from sinew.plan.toml import save_rig
    from sinew.predict.joints.design import design_document
    from sinew.predict.predicted import predict_rig

    alone = out is not None and out.suffix == ".toml"
    if out is not None:
        if alone:
            console.require_file(out)
        else:
            console.require_own(out, "rig.toml", lambda rig: rig.with_name("prediction.json").exists())
    held = further.held(base)
    rig, design = designed_rig(base, joint)
    found = predict_rig(rig, further.asked(held, asked))
    more, figures = further.answered(held, found, base, drawn=out is not None and not alone)
    document: dict[str, Any] = {"rig": rig.name, **found.document(), **more}
    if design is not None:
        document |= design_document(rig, design)
    if out is not None and alone:
        save_rig(rig, out)
    elif out is not None:
        words = ["sinew", "predict", *([base] if base else []), *joint.words()]
        words += [*further.words(asked), "--out", str(out)]
        _write_prediction(found, document, out, shlex.join(words), figures)
    return document, found.backbones


_NEEDED = ("inertia_kg_m2", "frequency_hz", "damping_ratio")


@with_joint_options
def predict(
    rig: Annotated[
        str | None, typer.Argument(metavar="RIG|FIT.json", help="A rig, file or name; or a fit of sinew identify.")
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
        bool, flag("--backbone", "Also where it resonates, over the drive's amplitude up to the asked one.")
    ] = False,
    out: Annotated[
        Path | None, option("DIR|RIG.toml", "Rig, fit: write figures and page, or the joint's rig alone.")
    ] = None,
    bands: Annotated[
        int | None,
        option("N", "Calibrated rig, fit: 90 % bands from N draws of what is known; of a fit 100.", min=20),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the draws of --bands.")] = 0,
    against: predict_against.Against = None,
    fitted: predict_against.FittedMm = None,
    bend: Annotated[
        float | None, option("DEG", "Rig: the joint in space, its head bent: torsion, tilt, tensions.", "--bend-deg")
    ] = None,
    azimuth: Annotated[float, option("DEG", "Direction of the bend, from y towards z.", "--azimuth-deg")] = 0.0,
    *,
    joint: JointOptions,
    json: Json = False,
) -> None:
    """Predict the steady response over frequency, through its folds, with stability.

    Amplitudes are half of peak to peak of the rotation of the head against the base; phases are the lag of the
    fundamental behind the drive: the torque, the base's motion, or the rig's lever.

    A joint that is not built yet is a RIG, else the paper's, in which what is said of the joint is changed.

    With --bend-deg the joint sways while it twists: fundamentals of torsion and of the tilt across the bend, the tilt
    in its plane at the double frequency, and what the tendons bear. --out is then a picture, .png, .pdf or .svg.

    Of a fit the unit is the record's. A free decay does not tell what a push does; one measured point does:

    \b
      sinew identify decay.csv --time t --output phi:deg --model drag-cubic --out fit
      sinew predict fit/fit.json --torque 1,2,4:V --through 3.1:12+-0.2:deg@2 --out forced
    """
    if rig is not None and is_fit(rig):
        given = [*joint.given, *Further(against=against, fitted_mm=fitted).given]
        rigs = {"--pretension-mm": pretension != "0,4,8,12", "--amplitude-deg": amplitude != 20.0}
        rigs |= {"--mode": mode != "position", "--without": bool(without)}
        rigs |= {"--oscillator": oscillator is not None, "--backbone": backbone}
        rigs |= {"--bend-deg": bend is not None, "--azimuth-deg": azimuth != 0}
        given += [name for name, value in rigs.items() if value]
        if given:
            raise SpecError(f"{given[0]} does not go with a fit; leave it out")
        _predict_fit(AskedOfFit(rig, torque, base, through, start, stop, bands, seed), out, json=json)
        return
    if through is not None:
        raise SpecError("--through is for a fit, FIT.json of sinew identify; leave it out")
    from sinew.predict.predicted import prediction_document

    further = Further(bands, seed, against, fitted, start, stop)
    if bend is not None:
        others = {"--oscillator": oscillator is not None, "--torque-n-m": torque is not None, "--base-deg": base}
        given = [*(name for name, value in others.items() if value), *further.given, *(["--backbone"] * backbone)]
        if given:
            raise SpecError(f"{given[0]} does not go with --bend-deg, the joint in space; leave one of them out")
        if rig is None and not joint.given:
            raise SpecError("expected a RIG beside --bend-deg, or options of a joint")
        asked = rig_asked(pretension, amplitude, mode, without, start, stop)
        _predict_bent(rig, joint, asked, (bend, azimuth), out, json=json)
        return
    if azimuth:
        raise SpecError("found --azimuth-deg without --bend-deg; say how far the head is bent")
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
        console.print_json(document)
        return
    from sinew.predict.predicted import backbones_told, bands_told, prediction_told

    console.print_told(prediction_told(document))
    if "bands" in document:
        console.print_told(bands_told(document))
    if "against" in document:
        predict_against.print_against(document["against"])
    if backbone:
        console.print_told(backbones_told(document["backbone"]))
    if out is not None:
        print(f"written: {out}")


PICTURES = (".png", ".pdf", ".svg")


def _predict_bent(
    base: str | None,
    joint: JointOptions,
    asked: "RigAsked",
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
        if out.suffix not in PICTURES:
            ends = f"{', '.join(PICTURES[:-1])} or {PICTURES[-1]}"
            raise SpecError(
                f"--out is {out}, expected a name that ends with {ends}, as of a bent joint it is a picture"
            )
        console.require_file(out)
    from sinew.predict.coupled import predict_bent

    rig, _ = designed_rig(base, joint)
    with console.progress_bar("follow") as progress:
        found = predict_bent(
            rig,
            asked.pretensions,
            bend_deg=bend,
            azimuth_deg=azimuth,
            amplitude_deg=asked.amplitude_deg,
            mode=asked.tendon_mode,
            without=asked.without,
            band_hz=asked.band_hz,
            progress=progress,
        )
    written = ""
    if out is not None:
        from sinew.figures.space import write_bent

        written = f"wrote {', '.join(map(str, write_bent(found, out)))}"
    console.print_result(found.document(), found.told(), written, json=json)


def _predict_fit(asked: AskedOfFit, out: Path | None, *, json: bool) -> None:
    if out is not None:
        console.require_folder(out)
    found = predicted_fit(asked)
    document = {"fit": asked.file, **found.document()}
    if out is not None:
        write_forced(found, document, out, shlex.join([*asked.words(), "--out", str(out)]))
    console.print_result(document, found.told(), f"written: {out}" if out else "", json=json)


def _oscillator(
    text: str, torque: str | None, base: str | None, start: float | None, stop: float | None
) -> "tuple[Prediction, list[float], Backbones]":
    import math
    from functools import partial

    from sinew.predict.oscillator import KEYS, Oscillator, oscillator_problem, resolution_of
    from sinew.predict.predicted import oscillator_backbones
    from sinew.solve.curves import predict as run
    from sinew.solve.programs import configure

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
    configure()
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
    prediction = run(oscillator_problem([one], band_hz), band_hz, resolution_of([one]))
    return prediction, [math.nan], partial(oscillator_backbones, one, band_hz)


# `sinew compare` sets several rigs beside each other.


def compare(
    rigs: Annotated[
        list[str], typer.Argument(metavar="RIG RIG...", help="Rigs: TOML files, or names of shipped ones.")
    ],
    pretension: Pretension = "0,4,8,12",
    amplitude: Amplitude = 20.0,
    mode: Mode = "position",
    without: Without = None,
    start: Annotated[float | None, option("HZ", "Lowest frequency; else 1.", "--from-hz")] = None,
    stop: Annotated[float | None, option("HZ", "Highest frequency; else 6.", "--to-hz")] = None,
    out: Annotated[Path | None, option("DIR", "Write figures and a page there.")] = None,
    json: Json = False,
) -> None:
    """Predict the response of several rigs and set them beside each other: tables, curves and maps of gain."""
    if len(rigs) < 2:
        raise SpecError(f"found {len(rigs)} rig, expected two or more; one alone is for sinew predict")
    asked = rig_asked(pretension, amplitude, mode, without, start, stop)
    if out is not None:
        console.require_folder(out)
    found = _predict_all(rigs, asked)
    document: dict[str, Any] = {
        "amplitude_deg": amplitude,
        "rigs": [{"rig": one.rig.name, "source": rig, **one.document()} for rig, one in zip(rigs, found, strict=True)],
    }
    page = None
    if out is not None:
        command = ["sinew", "compare", *rigs, *_words_of(asked), "--out", str(out)]
        page = _write_comparison(found, document, out, shlex.join(command))
    if json:
        console.print_json(document)
        return
    _print_compared(document, amplitude)
    if page is not None:
        print(f"page: {page}")


def _predict_all(rigs: list[str], asked: "RigAsked") -> "list[Predicted]":
    from sinew.plan.toml import load_rig
    from sinew.predict.predicted import predict_rig

    loaded = [load_rig(rig) for rig in rigs]
    found = []
    with console.progress_bar("predict") as progress:
        for i, rig in enumerate(loaded):
            progress(i, len(loaded))
            found.append(predict_rig(rig, asked))
    return found


def _print_compared(document: dict[str, Any], amplitude_deg: float) -> None:
    from sinew.predict.predicted import mark_cell, remarks_told

    rows = []
    for rig in document["rigs"]:
        for i, branch in enumerate(rig["branches"]):
            peak = branch["peak"]
            gain = number(None if peak is None else peak["amplitude_deg"] / amplitude_deg)
            folds = str(len(branch["folds"]))
            rows.append((rig["rig"] if i == 0 else "", f"{branch['pretension_mm']:g}", mark_cell(peak), gain, folds))
    console.print_table(("rig", "pretension/mm", "peak", "gain", "folds"), rows)
    for rig in document["rigs"]:
        held = sum(check["holds"] for check in rig["validity"])
        print(f"{rig['rig']}: {held} of {len(rig['validity'])} assumptions hold")
        console.print_told(remarks_told(rig, faults_only=True))


# A prediction's figures, page and files are written into a folder.

_FORMATS = ("png", "pdf")


def _write_prediction(
    found: "Predicted", document: dict[str, Any], folder: Path, rebuild: str, more: "Mapping[str, Figure]"
) -> Path:
    """Write prediction.json, rig.toml, figures and prediction.html into a folder; return the page.

    rebuild: the command line that makes it again. more: further figures, by name. Raises FileError where the folder
    cannot be written.
    """
    from sinew.figures.predicted import curves_of, draw_predicted, draw_predicted_map
    from sinew.plan.toml import save_rig

    curves = curves_of(found)
    figures = {"predicted_response": draw_predicted(curves), "predicted_map": draw_predicted_map([curves])} | dict(more)
    save_rig(found.rig, folder / "rig.toml")
    return _write(folder, "prediction", document, [document], figures, found, rebuild)


def _write_comparison(rigs: "Sequence[Predicted]", document: dict[str, Any], folder: Path, rebuild: str) -> Path:
    """Write comparison.json, figures and comparison.html into a folder; return the page."""
    from sinew.figures.predicted import curves_of, draw_comparison, draw_predicted_map

    curves = [curves_of(found) for found in rigs]
    figures = {"predicted_comparison": draw_comparison(curves), "predicted_map": draw_predicted_map(curves)}
    return _write(folder, "comparison", document, document["rigs"], figures, rigs[0], rebuild)


def _write(
    folder: Path,
    stem: str,
    document: dict[str, Any],
    rigs: list[dict[str, Any]],
    figures: "dict[str, Figure | None]",
    found: "Predicted",
    rebuild: str,
) -> Path:
    from sinew.figures.predicted import write_prediction_page
    from sinew.figures.style import save_figure
    from sinew.measure.files.netcdf import provenance

    paths = []
    for name, figure in figures.items():
        if figure is not None:
            paths += save_figure(figure, folder / "figures", name, _FORMATS)
    console.write_json(document, folder / f"{stem}.json")
    return write_prediction_page(
        folder / f"{stem}.html",
        rigs,
        amplitude_deg=found.asked.amplitude_deg,
        figures=paths,
        rebuild=rebuild,
        origins=[("versions", str(provenance("twin")["versions"]))],
    )


def _words_of(asked: "RigAsked") -> list[str]:
    """Return the options that ask for the same again."""
    pretensions = ",".join(f"{mm:g}" for mm in asked.pretensions)
    words = ["--pretension-mm", pretensions, "--amplitude-deg", f"{asked.amplitude_deg:g}", "--mode", asked.mode]
    words += [word for effect in asked.without for word in ("--without", effect)]
    return [*words, "--from-hz", f"{asked.band_hz[0]:g}", "--to-hz", f"{asked.band_hz[1]:g}"]
