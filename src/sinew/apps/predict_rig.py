"""This is where a rig, shipped, calibrated or of a joint that is not built yet, becomes its predicted curves."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, cast

import typer

from sinew.apps.console import (
    LARGEST_DEG,
    checked_band,
    checked_number,
    number_list,
    print_table,
    progress_bar,
    write_json,
)
from sinew.apps.joint import BASE_RIG, write_rig
from sinew.measure.errors import SpecError
from sinew.measure.estimate import Estimate, number, span

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from sinew.figures.predicted import Curves
    from sinew.plan.plan import TendonMode
    from sinew.plan.rig import RigSpec
    from sinew.predict.band import Band, Marked, Tube
    from sinew.predict.curves.backbone import Backbone
    from sinew.predict.curves.branch import Branch, Mark, Prediction
    from sinew.predict.curves.prediction import Problem
    from sinew.predict.describing import Equivalent
    from sinew.predict.joints.validity import Check
    from sinew.predict.oscillator import Oscillator
    from sinew.twin.parameters import Effects


# A prediction becomes the JSON document of `sinew predict`, and the table that is printed of it.


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
        "harmonic_shares": shares_document(branch),
        "folds": [_mark(fold) for fold in branch.folds],
        "peak": _mark(branch.peak),
        "fundamental_peak": _mark(branch.fundamental_peak),
        "phase_90": _mark(branch.phase_90),
        "error": branch.error.tolist(),
        "complete": branch.complete,
        "message": branch.message,
    }


def prediction_document(prediction: "Prediction", pretensions: list[float]) -> dict[str, Any]:
    """Return the document of a prediction. pretensions: of its branches [mm]; NaN for an oscillator."""
    return {
        "branches": [_branch(one, mm) for one, mm in zip(prediction.branches, pretensions, strict=True)],
        "harmonics": prediction.harmonics,
        "error_estimate": prediction.error_estimate,
        "wall_s": prediction.wall_s,
    }


def mark_cell(mark: dict[str, float] | None) -> str:
    """Return a marked point in words."""
    return "-" if mark is None else f"{number(mark['frequency_hz'], unit='Hz')}, {number(mark['amplitude_deg'])}°"


def print_prediction(document: dict[str, Any]) -> None:
    """Print a row for each branch, and what is to be said of them."""
    rows = []
    for branch in document["branches"]:
        pretension = branch["pretension_mm"]
        folds = "; ".join(mark_cell(fold) for fold in branch["folds"]) or "none"
        name = "-" if pretension is None else f"{pretension:g}"
        steady = f"{sum(branch['stable'])} of {len(branch['stable'])}"
        peaks = (mark_cell(branch[key]) for key in ("peak", "fundamental_peak", "phase_90"))
        rows.append((name, *peaks, folds, steady))
    head = ("pretension/mm", "peak (Eq. 6)", "peak of the fundamental", "90° of phase", "folds", "stable points")
    print_table(head, rows)
    print_remarks(document)
    error = document["error_estimate"]
    print(f"{document['harmonics']} harmonics, error estimate {error:.1e}, {document['wall_s'] * 1e3:.0f} ms")


def print_remarks(document: dict[str, Any], *, faults_only: bool = False) -> None:
    """Print what a curve did not reach, and what each assumption is worth; faults_only: those that do not hold."""
    for branch in document["branches"]:
        if not branch["complete"] or "not" in branch["message"]:
            print(f"- {branch['message']}")
    for check in document.get("validity", []):
        if faults_only and check["holds"]:
            continue
        print(f"- {check['check']} {'holds' if check['holds'] else 'DOES NOT HOLD'}: {check['sentence']}")


_MODES = ("position", "position-with-current-limit", "current")
_BAND_HZ = (1.0, 6.0)

Pretension = Annotated[
    str, typer.Option("--pretension-mm", metavar="MM,...", help="Rig: pretensions, one curve for each.")
]
Amplitude = Annotated[
    float, typer.Option("--amplitude-deg", metavar="DEG", help="Rig: amplitude of the drive's command.")
]
Mode = Annotated[str, typer.Option("--mode", metavar="|".join(_MODES), help="Rig: mode of the motors.")]
Without = Annotated[
    list[str] | None,
    typer.Option("--without", metavar="EFFECT", help="Rig: switch an effect of the twin off; may be repeated."),
]


class RigAsked(NamedTuple):
    """What is asked of a rig: pretensions [mm], amplitude of the command [deg], mode of the motors, effects of the
    twin that are off, and band [Hz]."""

    pretensions: list[float]
    amplitude_deg: float
    mode: str
    without: tuple[str, ...]
    band_hz: tuple[float, float]

    def words(self) -> list[str]:
        """Return the options that ask for it again."""
        pretensions = ",".join(f"{mm:g}" for mm in self.pretensions)
        words = ["--pretension-mm", pretensions, "--amplitude-deg", f"{self.amplitude_deg:g}", "--mode", self.mode]
        words += [word for effect in self.without for word in ("--without", effect)]
        return [*words, "--from-hz", f"{self.band_hz[0]:g}", "--to-hz", f"{self.band_hz[1]:g}"]


class Predicted(NamedTuple):
    """A rig's prediction: the problem it was, its curves, and what it is worth."""

    rig: "RigSpec"
    asked: RigAsked
    problem: "Problem"
    prediction: "Prediction"
    checks: "list[Check]"

    def document(self) -> dict[str, Any]:
        """Return it as JSON holds it."""
        found = prediction_document(self.prediction, self.asked.pretensions)
        found["validity"] = [
            {"check": c.name, "value": c.value, "limit": c.limit, "holds": c.holds, "sentence": c.sentence}
            for c in self.checks
        ]
        return found

    def backbones(self) -> list[dict[str, Any]]:
        """Return the documents of its backbones."""
        from sinew.twin.parameters import Effects

        asked, effects = self.asked, Effects().without(*self.asked.without)
        mode = cast("TendonMode", asked.mode)
        return rig_backbones(self.rig, asked.pretensions, asked.amplitude_deg, asked.band_hz, mode, effects)


def check_mode(mode: str) -> None:
    """Do nothing where a mode of the tendon motors is known; else raise SpecError."""
    if mode not in _MODES:
        raise SpecError(f"--mode is {mode!r}, expected one of {', '.join(_MODES)}")


def rig_asked(
    pretension: str, amplitude: float, mode: str, without: list[str] | None, start: float | None, stop: float | None
) -> RigAsked:
    """Return what the options ask of a rig. Raises SpecError where one of them cannot be meant."""
    check_mode(mode)
    pretensions = number_list("--pretension-mm", pretension, "zero or more: cables cannot push", low=0)
    expected = f"a positive angle up to {LARGEST_DEG:g}°"
    checked_number("--amplitude-deg", amplitude, expected, low=0, high=LARGEST_DEG, above=True)
    band_hz = checked_band((_BAND_HZ[0] if start is None else start, _BAND_HZ[1] if stop is None else stop))
    return RigAsked(pretensions, amplitude, mode, tuple(without or ()), band_hz)


def refuse_pretensions(rig: "RigSpec", pretension_mm: "Sequence[float]") -> None:
    """Do nothing where a rig allows the pretensions [mm]; else raise SpecError."""
    low, high = rig.limits.pretension_mm
    for mm in pretension_mm:
        if not low <= mm <= high:
            raise SpecError(
                f"--pretension-mm holds {mm:g}, the rig {rig.name} allows {low:g} to {high:g} mm; stay between them, "
                "or widen limits.pretension_mm in the rig's file if its motors and tendons bear that"
            )


def predict_rig(rig: "RigSpec", asked: RigAsked) -> Predicted:
    """Return the prediction of a rig, with what it is worth.

    Raises SpecError where it is asked at a pretension that the rig does not allow.
    """
    import numpy as np

    from sinew.predict.curves.prediction import predict
    from sinew.predict.joint import RESOLUTION, joint_problem
    from sinew.predict.joints.validity import check_drive, check_joint, doubt_broken_curves, loads_of
    from sinew.twin.cache import configure
    from sinew.twin.parameters import Effects

    refuse_pretensions(rig, asked.pretensions)
    configure()
    mode, effects = cast("TendonMode", asked.mode), Effects().without(*asked.without)
    problem = joint_problem(rig, asked.pretensions, asked.amplitude_deg, asked.band_hz, mode=mode, effects=effects)
    prediction = predict(problem, asked.band_hz, RESOLUTION)
    torsion = np.array([float(np.max(branch.amplitude, initial=0.0)) for branch in prediction.branches])
    held = asked.mode != "current"
    checks = check_joint(rig, asked.pretensions, loads_of(problem, torsion), tilt_held=held)
    broken = [mm for mm, one in zip(asked.pretensions, prediction.branches, strict=True) if not one.complete]
    checks = [*doubt_broken_curves(checks, broken), *check_drive(rig, asked.amplitude_deg, asked.band_hz[1])]
    return Predicted(rig, asked, problem, prediction, checks)


# `sinew predict` tells of backbones and of harmonics above the first.


def _numbers(values: "NDArray[np.float64]") -> list[float | None]:
    import numpy as np

    return [float(value) if np.isfinite(value) else None for value in values]


def shares_document(branch: "Branch") -> dict[str, list[float | None]]:
    """Return the harmonics from the second to the fifth as shares of the fundamental, by order."""
    from sinew.predict.describing import harmonic_shares

    return {str(order): _numbers(share) for order, share in harmonic_shares(branch).items()}


def equivalent_document(equivalent: "Equivalent") -> dict[str, list[float | None]]:
    """Return the spring and damper that take the fundamental's place."""
    return {
        "stiffness_n_m_rad": _numbers(equivalent.stiffness),
        "damping_n_m_s_rad": _numbers(equivalent.damping),
        "damping_ratio": _numbers(equivalent.damping_ratio),
    }


def _document(
    backbone: "Backbone", pretension_mm: float | None, drive: dict[str, Any], equivalent: "Equivalent"
) -> dict[str, Any]:
    import numpy as np

    curve = backbone.curve
    return {
        "pretension_mm": pretension_mm,
        "frequency_hz": curve.frequency_hz.tolist(),
        "amplitude_deg": np.degrees(curve.amplitude).tolist(),
        "fundamental_deg": np.degrees(curve.fundamental).tolist(),
        **drive,
        **equivalent_document(equivalent),
        "harmonic_shares": shares_document(curve),
        "stable": curve.stable.tolist(),
        "multiplier": curve.multiplier.tolist(),
        "error": curve.error.tolist(),
        "complete": curve.complete,
        "message": curve.message,
    }


def oscillator_backbones(one: "Oscillator", band_hz: tuple[float, float]) -> list[dict[str, Any]]:
    """Return the backbone of an oscillator up to its drive."""
    import numpy as np

    from sinew.predict.curves.backbone import follow_backbones
    from sinew.predict.describing import equivalent_of_oscillator
    from sinew.predict.oscillator import oscillator_problem, resolution_of

    (backbone,) = follow_backbones(oscillator_problem([one], band_hz), band_hz, resolution_of([one]))
    share = backbone.share
    drive = {"torque_n_m": (share * one.torque).tolist()}
    if one.base:
        drive = {"base_deg": np.degrees(share * one.base).tolist()}
    return [_document(backbone, None, drive, equivalent_of_oscillator(backbone.curve, one, share))]


def rig_backbones(
    rig: "RigSpec",
    pretensions: list[float],
    amplitude_deg: float,
    band_hz: tuple[float, float],
    mode: "TendonMode",
    effects: "Effects",
) -> list[dict[str, Any]]:
    """Return the backbone of a rig at each pretension, up to an amplitude of the command."""
    import numpy as np

    from sinew.predict.curves.backbone import follow_backbones
    from sinew.predict.describing import equivalent_of_rig
    from sinew.predict.joint import RESOLUTION, joint_problem

    problem = joint_problem(rig, pretensions, amplitude_deg, band_hz, mode=mode, effects=effects)
    documents = []
    for mm, backbone in zip(pretensions, follow_backbones(problem, band_hz, RESOLUTION), strict=True):
        command = backbone.share * np.radians(amplitude_deg)
        lever = backbone.curve.drive * (command if problem.equations.drive is None else 1.0)
        drive = {
            "command_deg": np.degrees(command).tolist(),
            "lever_deg": np.degrees(np.abs(lever)).tolist(),
        }
        documents.append(_document(backbone, mm, drive, equivalent_of_rig(backbone.curve, lever, rig)))
    return documents


def print_backbones(backbones: list[dict[str, Any]]) -> None:
    """Print where each backbone begins and ends."""

    def cells(one: dict[str, Any], at: int) -> str:
        ratio = one["damping_ratio"][at]
        swing = f"{number(one['frequency_hz'][at], unit='Hz')}, {number(one['amplitude_deg'][at])}°"
        return swing if ratio is None else f"{swing}, D {number(ratio, 3)}"

    rows = []
    for one in backbones:
        name = "-" if one["pretension_mm"] is None else f"{one['pretension_mm']:g}"
        ends = (cells(one, 0), cells(one, -1)) if one["frequency_hz"] else ("-", "-")
        rows.append((name, *ends, str(len(one["frequency_hz"]))))
    print_table(("pretension/mm", "weakest drive", "whole drive", "points"), rows, "backbone: response lags by 90°")
    for one in backbones:
        if not one["complete"]:
            print(f"- {one['message']}")


# A prediction's figures, page and files are written into a folder.

_FORMATS = ("png", "pdf")


def write_prediction(
    found: Predicted, document: dict[str, Any], folder: Path, rebuild: str, more: "Mapping[str, Figure]"
) -> Path:
    """Write prediction.json, rig.toml, figures and prediction.html into a folder; return the page.

    rebuild: the command line that makes it again. more: further figures, by name. Raises FileError where the folder
    cannot be written.
    """
    from sinew.figures.predicted import draw_predicted, draw_predicted_map

    curves = _curves(found)
    figures = {"predicted_response": draw_predicted(curves), "predicted_map": draw_predicted_map([curves])} | dict(more)
    write_rig(found.rig, folder / "rig.toml")
    return _write(folder, "prediction", document, [document], figures, found, rebuild)


def write_comparison(rigs: Sequence[Predicted], document: dict[str, Any], folder: Path, rebuild: str) -> Path:
    """Write comparison.json, figures and comparison.html into a folder; return the page."""
    from sinew.figures.predicted import draw_comparison, draw_predicted_map

    curves = [_curves(found) for found in rigs]
    figures = {"predicted_comparison": draw_comparison(curves), "predicted_map": draw_predicted_map(curves)}
    return _write(folder, "comparison", document, document["rigs"], figures, rigs[0], rebuild)


def _curves(found: Predicted) -> "Curves":
    from sinew.figures.predicted import Curves

    asked = found.asked
    return Curves(found.rig.name, tuple(asked.pretensions), found.prediction.branches, asked.amplitude_deg)


def _write(
    folder: Path,
    stem: str,
    document: dict[str, Any],
    rigs: list[dict[str, Any]],
    figures: "dict[str, Figure | None]",
    found: Predicted,
    rebuild: str,
) -> Path:
    from sinew.figures.predicted import write_prediction_page
    from sinew.figures.style import save_figure
    from sinew.measure.netcdf import provenance

    paths = []
    for name, figure in figures.items():
        if figure is not None:
            paths += save_figure(figure, folder / "figures", name, _FORMATS)
    write_json(document, folder / f"{stem}.json")
    return write_prediction_page(
        folder / f"{stem}.html",
        rigs,
        amplitude_deg=found.asked.amplitude_deg,
        figures=paths,
        rebuild=rebuild,
        origins=[("versions", str(provenance("twin")["versions"]))],
    )


# `sinew predict --bands` tells how far a rig's curves can be off, as far as its calibration knows.

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
