"""`sinew predict`: the steady response over frequency, of a rig or of an oscillator by its numbers."""

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from sinew.apps.console import (
    Json,
    checked_band,
    number_list,
    print_json,
    print_told,
    progress_bar,
    remark,
    require_file,
    require_folder,
)
from sinew.apps.joints.options import BASE_RIG, JointOptions, designed_rig, with_joint_options
from sinew.apps.joints.predict_against import (
    Against,
    FittedMm,
    Held,
    asked_of,
    hold_against,
    measured_against,
    millimetres,
    print_against,
)
from sinew.apps.joints.rig_asked import (
    Amplitude,
    Bands,
    BandSeed,
    Mode,
    Pretension,
    Without,
    rig_asked,
    words_of,
    write_prediction,
)
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sinew.predict.predicted import Predicted, RigAsked
    from sinew.solve.branch import Prediction


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
            return [*words_of(asked), *bands]
        off = [word for effect in asked.without for word in ("--without", effect)]
        return [*off, *bands, *against, *fitted]

    def held(self, rig: str | None) -> Held | None:
        """Return the recording. rig: file or name. Raises SpecError, before long work, for what cannot be meant."""
        if self.fitted_mm is not None:
            if self.against is None:
                raise SpecError("--fitted-mm is about a recording; name one with --against, or leave it out")
            millimetres(self.fitted_mm)
        if self.bands is not None:
            from sinew.plan.toml import load_rig
            from sinew.predict.band import spread_of

            spread_of(load_rig(rig or BASE_RIG))
        return None if self.against is None else measured_against(self.against, rig)

    def asked(self, held: Held | None, asked: "RigAsked") -> "RigAsked":
        """Return what is asked of the rig, at the recording's settings where there is one."""
        return asked if held is None else asked_of(held, asked, self.start, self.stop)

    def answered(
        self, held: Held | None, found: "Predicted", base: str | None, *, drawn: bool
    ) -> "tuple[dict[str, Any], dict[str, Figure]]":
        """Return (keys of the document, figures by name; none unless drawn). base: file or name of the rig."""
        document: dict[str, Any] = {}
        figures: dict[str, Figure] = {}
        if self.bands is not None:
            from sinew.plan.toml import load_rig
            from sinew.predict.predicted import with_bands

            with progress_bar("draw") as progress:
                more = with_bands(found, load_rig(base or BASE_RIG), self.bands, self.seed, progress).drawn
            assert more is not None
            document |= more.document(found.asked.pretensions)
            if drawn:
                from sinew.figures.predicted import curves_of, draw_bands

                figures["predicted_bands"] = draw_bands(curves_of(found), more.bands)
        if held is not None:
            document["against"], comparison = hold_against(held, found, self.fitted_mm)
            if drawn:
                from sinew.figures.predicted import draw_against

                figures["predicted_against"] = draw_against(comparison)
        return document, figures


# `sinew predict` takes a rig, or makes one, and writes what it was asked to write.


def predict_joint(
    base: str | None, joint: JointOptions, asked: "RigAsked", further: Further, out: Path | None
) -> tuple[dict[str, Any], Callable[[], list[dict[str, Any]]]]:
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
            require_file(out)
        else:
            require_folder(out)
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
        write_prediction(found, document, out, shlex.join(words), figures)
    return document, found.backbones


Backbones = Callable[[], list[dict[str, Any]]]

_KEYS = {
    "inertia_kg_m2": "inertia",
    "frequency_hz": "frequency_hz",
    "damping_ratio": "damping_ratio",
    "cubic_n_m_rad3": "cubic",
    "quadratic": "quadratic",
    "quadratic_n_m_rad2": "quadratic",
    "coulomb_n_m": "coulomb",
    "drag_n_m_s2_rad2": "drag",
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
    from sinew.predict.predicted import prediction_document

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
    from sinew.predict.predicted import backbones_told, bands_told, prediction_told

    print_told(prediction_told(document))
    if "bands" in document:
        print_told(bands_told(document))
    if "against" in document:
        print_against(document["against"])
    if backbone:
        print_told(backbones_told(document["backbone"]))
    if out is not None:
        print(f"written: {out}")


def _number(what: str, text: str) -> float:
    return number_list(what, text, "a finite number", between="\n")[0]


def _oscillator(
    text: str, torque: float | None, base: float | None, start: float | None, stop: float | None
) -> "tuple[Prediction, list[float], Backbones]":
    import math
    from functools import partial

    from sinew.predict.oscillator import Oscillator, oscillator_problem, resolution_of
    from sinew.predict.predicted import oscillator_backbones
    from sinew.solve.curves import predict as run
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
