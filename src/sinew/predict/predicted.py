"""What a rig is predicted to do: its curves, backbones and bands, the document of `sinew predict`, and its tables."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import degrees
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from sinew.measure.arrays import Array, wrapped_lag
from sinew.measure.errors import SpecError
from sinew.measure.estimate import Estimate, all_finite, finite, number, span
from sinew.measure.told import Table, Told
from sinew.mechanics.parameters import TENDON_MODES
from sinew.plan.plan import TendonMode
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.predict.band import Band, Draws, Marked, Tube, bands_of, carried_over, crest, draw_rigs
from sinew.predict.joint import RESOLUTION, joint_problem
from sinew.predict.joints.validity import Check, check_drive, check_joint, doubt_broken_curves, loads_of
from sinew.predict.linear import Equivalent, equivalent_of_oscillator, equivalent_of_rig, harmonic_shares
from sinew.predict.oscillator import Oscillator, oscillator_problem, resolution_of
from sinew.solve.backbone import Backbone, follow_backbones
from sinew.solve.balance import Equations, Lane, Size, orders
from sinew.solve.branch import Branch, Mark, Prediction
from sinew.solve.continuation import OUTSIDE, Stride
from sinew.solve.curves import ENDS, Problem, first_curves
from sinew.solve.curves import predict as predict_problem
from sinew.solve.examination import (
    drive_phasor,
    half_range,
    lag_product,
    largest_multiplier,
    maps_of,
    phasors,
    rows_of,
)
from sinew.solve.landmark import FOLD, QUARTER, guesses
from sinew.solve.programs import use_all_cores
from sinew.twin.parameters import Effects


class RigAsked(NamedTuple):
    """What is asked of a rig: pretensions [mm], amplitude of the command [deg], mode of the motors, effects of the
    twin that are off, and band [Hz]."""

    pretensions: list[float]
    amplitude_deg: float
    mode: str
    without: tuple[str, ...]
    band_hz: tuple[float, float]

    @property
    def tendon_mode(self) -> TendonMode:
        """Return the mode of the tendon motors."""
        return cast(TendonMode, self.mode)

    @property
    def effects(self) -> Effects:
        """Return the effects that act."""
        return Effects().without(*self.without)


@dataclass(frozen=True)
class Drawn:
    """How far curves can be off. bands: one for each pretension. draws: of the rig. changed: what a design changed."""

    bands: list[Band]
    draws: Draws
    count: int
    seed: int
    changed: tuple[str, ...]

    def document(self, pretension_mm: Sequence[float]) -> dict[str, Any]:
        """Return the keys `bands` and `draws` of a prediction."""
        remarks = list(self.draws.remarks)
        if self.changed:
            remarks.append(f"what the design changes is taken as certain: {', '.join(self.changed)}")
        told = {"count": self.count, "seed": self.seed, "parameters": list(self.draws.names), "remarks": remarks}
        return {"bands": [_band(one, mm) for one, mm in zip(self.bands, pretension_mm, strict=True)], "draws": told}


@dataclass(frozen=True, repr=False)
class Predicted(Told):
    """A rig's prediction: the problem it was, its curves, what it is worth, and how far it can be off where asked."""

    rig: RigSpec
    asked: RigAsked
    problem: Problem
    prediction: Prediction
    checks: list[Check]
    drawn: Drawn | None = None

    def document(self) -> dict[str, Any]:
        """Return it as JSON holds it, without the rig's name."""
        found = prediction_document(self.prediction, self.asked.pretensions)
        found["validity"] = [one.to_json() for one in self.checks]
        return found if self.drawn is None else found | self.drawn.document(self.asked.pretensions)

    def backbones(self) -> list[dict[str, Any]]:
        """Return the documents of its backbones."""
        asked = self.asked
        return rig_backbones(
            self.rig, asked.pretensions, asked.amplitude_deg, asked.band_hz, asked.tendon_mode, asked.effects
        )

    def told(self) -> list[Table | str]:
        """Return a row for each curve, what each assumption is worth, and the bands where there are some."""
        document = self.document()
        return prediction_told(document) + (bands_told(document) if self.drawn is not None else [])


def predict(
    rig: RigSpec | str | Path,
    pretension_mm: float | Sequence[float] = (0.0, 4.0, 8.0, 12.0),
    *,
    amplitude_deg: float = 20.0,
    mode: TendonMode = "position",
    without: Sequence[str] = (),
    band_hz: tuple[float, float] = (1.0, 6.0),
    bands: int | None = None,
    seed: int = 0,
    progress: Callable[[float, float], None] | None = None,
) -> Predicted:
    """Return the steady response of a rig over frequency, through its folds, with stability and what it is worth.

    rig: as such, the path of its TOML file, or the name of a shipped one. pretension_mm: a curve for each [mm].
    amplitude_deg: of the drive's command [deg]. mode: of the tendon motors. without: effects of the twin that are off.
    band_hz: lowest and highest frequency [Hz]. bands: number of draws for 90 % bands, of a calibrated rig; seed: of
    them. progress: called with (done, total) draws.
    Amplitudes of the curves are half of peak to peak of the torsion [rad], phases its lag behind the lever [rad].
    Raises SpecError where the rig does not allow what is asked, or nothing is known of how certain it is.

    >>> import sinew as sn
    >>> found = sn.predict("paper", 4, band_hz=(2.5, 4.0))
    >>> peak = found.prediction.branches[0].peak
    >>> 3.0 < peak.frequency_hz < 4.0
    True
    """
    made = rig if isinstance(rig, RigSpec) else load_rig(rig)
    pretensions = [float(mm) for mm in np.atleast_1d(pretension_mm)]
    asked = RigAsked(pretensions, amplitude_deg, mode, tuple(without), (band_hz[0], band_hz[1]))
    found = predict_rig(made, asked)
    return found if bands is None else with_bands(found, made, bands, seed, progress)


def predict_rig(rig: RigSpec, asked: RigAsked) -> Predicted:
    """Return the prediction of a rig, with what it is worth. Raises SpecError for what the rig does not allow."""
    refuse_pretensions(rig, asked.pretensions)
    low, high = asked.band_hz
    if asked.mode not in TENDON_MODES or not 0 < low < high or not asked.amplitude_deg > 0:
        raise SpecError(
            f"found mode {asked.mode!r}, {asked.amplitude_deg:g}° and a band from {low:g} to {high:g} Hz; expected one "
            f"of {', '.join(TENDON_MODES)}, a positive angle, and two positive frequencies, the lower first"
        )
    use_all_cores()
    problem = joint_problem(
        rig, asked.pretensions, asked.amplitude_deg, asked.band_hz, mode=asked.tendon_mode, effects=asked.effects
    )
    prediction = predict_problem(problem, asked.band_hz, RESOLUTION)
    torsion = np.array([float(np.max(branch.amplitude, initial=0.0)) for branch in prediction.branches])
    checks = check_joint(rig, asked.pretensions, loads_of(problem, torsion), tilt_held=asked.mode != "current")
    broken = [mm for mm, one in zip(asked.pretensions, prediction.branches, strict=True) if not one.complete]
    checks = [*doubt_broken_curves(checks, broken), *check_drive(rig, asked.amplitude_deg, asked.band_hz[1])]
    return Predicted(rig, asked, problem, prediction, checks)


def with_bands(
    found: Predicted,
    base: RigSpec,
    count: int,
    seed: int,
    progress: Callable[[float, float], None] | None = None,
) -> Predicted:
    """Return a prediction with 90 % bands from draws of what is known of the rig.

    base: that the predicted one was made from; what is still known of it is taken over.
    Raises SpecError where nothing is known of how certain the rig's parameters are.
    """
    asked = found.asked
    rig, changed = carried_over(base, found.rig)
    draws = draw_rigs(rig, count, seed)
    bands = bands_of(
        found.prediction,
        rig,
        draws,
        asked.pretensions,
        asked.amplitude_deg,
        asked.band_hz,
        mode=asked.tendon_mode,
        effects=asked.effects,
        progress=progress,
    )
    return replace(found, drawn=Drawn(bands, draws, count, seed, changed))


def refuse_pretensions(rig: RigSpec, pretension_mm: Sequence[float]) -> None:
    """Do nothing where a rig allows the pretensions [mm]; else raise SpecError."""
    low, high = rig.limits.pretension_mm
    for mm in pretension_mm:
        if not low <= mm <= high:
            raise SpecError(
                f"pretension_mm holds {mm:g}, the rig {rig.name} allows {low:g} to {high:g} mm; stay between them, "
                "or widen limits.pretension_mm in the rig's file if its motors and tendons bear that"
            )


# A prediction, a backbone and a band become JSON.


def _mark(mark: Mark | None) -> dict[str, float] | None:
    if mark is None:
        return None
    return {"frequency_hz": mark.frequency_hz, "amplitude_deg": degrees(mark.amplitude)}


def _branch(branch: Branch, pretension_mm: float) -> dict[str, Any]:
    return {
        "pretension_mm": finite(pretension_mm),
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


def prediction_document(prediction: Prediction, pretensions: list[float]) -> dict[str, Any]:
    """Return the document of a prediction. pretensions: of its branches [mm]; NaN for an oscillator."""
    return {
        "branches": [_branch(one, mm) for one, mm in zip(prediction.branches, pretensions, strict=True)],
        "harmonics": prediction.harmonics,
        "error_estimate": prediction.error_estimate,
        "wall_s": prediction.wall_s,
    }


def shares_document(branch: Branch) -> dict[str, list[float | None]]:
    """Return the harmonics from the second to the fifth as shares of the fundamental, by order."""
    return {str(order): all_finite(share) for order, share in harmonic_shares(branch).items()}


def equivalent_document(equivalent: Equivalent) -> dict[str, list[float | None]]:
    """Return the spring and damper that take the fundamental's place."""
    return {
        "stiffness_n_m_rad": all_finite(equivalent.stiffness),
        "damping_n_m_s_rad": all_finite(equivalent.damping),
        "damping_ratio": all_finite(equivalent.damping_ratio),
    }


def _document(
    backbone: Backbone, pretension_mm: float | None, drive: dict[str, Any], equivalent: Equivalent
) -> dict[str, Any]:
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


def oscillator_backbones(one: Oscillator, band_hz: tuple[float, float]) -> list[dict[str, Any]]:
    """Return the backbone of an oscillator up to its drive."""
    (backbone,) = follow_backbones(oscillator_problem([one], band_hz), band_hz, resolution_of([one]))
    share = backbone.share
    drive = {"torque_n_m": (share * one.torque).tolist()}
    if one.base:
        drive = {"base_deg": np.degrees(share * one.base).tolist()}
    return [_document(backbone, None, drive, equivalent_of_oscillator(backbone.curve, one, share))]


def rig_backbones(
    rig: RigSpec,
    pretensions: Sequence[float],
    amplitude_deg: float,
    band_hz: tuple[float, float],
    mode: TendonMode,
    effects: Effects,
) -> list[dict[str, Any]]:
    """Return the backbone of a rig at each pretension, up to an amplitude of the command."""
    problem = joint_problem(rig, list(pretensions), amplitude_deg, band_hz, mode=mode, effects=effects)
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


def _band(band: Band, pretension_mm: float) -> dict[str, Any]:
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


def _swept(tubes: tuple[Tube, Tube]) -> dict[str, Any]:
    def degrees(tube: Tube) -> dict[str, Any]:
        return {name: all_finite(np.degrees(getattr(tube, name))) for name in ("low", "median", "high")}

    return {name: degrees(tube) for name, tube in zip(("amplitude_deg", "phase_deg"), tubes, strict=True)}


def _marked(one: Marked | None) -> dict[str, Any] | None:
    if one is None:
        return None
    return {
        "frequency_hz": one.frequency_hz.to_json(),
        "amplitude_deg": _in_degrees(one.amplitude).to_json(),
        "draws": one.draws,
    }


def _in_degrees(one: Estimate) -> Estimate:
    return Estimate(degrees(one.value), degrees(one.std), degrees(one.low), degrees(one.high))


# Predictions as a person reads them.


def mark_cell(mark: dict[str, float] | None) -> str:
    """Return a marked point in words."""
    return "-" if mark is None else f"{number(mark['frequency_hz'], unit='Hz')}, {number(mark['amplitude_deg'])}°"


def prediction_told(document: dict[str, Any]) -> list[Table | str]:
    """Return a row for each branch, and what is to be said of them."""
    rows = []
    for branch in document["branches"]:
        pretension = branch["pretension_mm"]
        folds = "; ".join(mark_cell(fold) for fold in branch["folds"]) or "none"
        name = "-" if pretension is None else f"{pretension:g}"
        steady = f"{sum(branch['stable'])} of {len(branch['stable'])}"
        peaks = (mark_cell(branch[key]) for key in ("peak", "fundamental_peak", "phase_90"))
        rows.append((name, *peaks, folds, steady))
    head = ("pretension/mm", "peak (Eq. 6)", "peak of the fundamental", "90° of phase", "folds", "stable points")
    error = f"error estimate {document['error_estimate']:.1e}, {document['wall_s'] * 1e3:.0f} ms"
    return [Table(head, rows), *remarks_told(document), f"{document['harmonics']} harmonics, {error}"]


def remarks_told(document: dict[str, Any], *, faults_only: bool = False) -> list[str]:
    """Return what a curve did not reach, and what each assumption is worth; faults_only: those that do not hold."""
    branches, checks = document["branches"], document.get("validity", [])
    told = [f"- {one['message']}" for one in branches if not one["complete"] or "not" in one["message"]]
    return told + [
        f"- {check['check']} {'holds' if check['holds'] else 'DOES NOT HOLD'}: {check['sentence']}"
        for check in checks
        if not (faults_only and check["holds"])
    ]


def backbones_told(backbones: list[dict[str, Any]]) -> list[Table | str]:
    """Return where each backbone begins and ends."""

    def cells(one: dict[str, Any], at: int) -> str:
        ratio = one["damping_ratio"][at]
        swing = f"{number(one['frequency_hz'][at], unit='Hz')}, {number(one['amplitude_deg'][at])}°"
        return swing if ratio is None else f"{swing}, D {number(ratio, 3)}"

    rows = []
    for one in backbones:
        name = "-" if one["pretension_mm"] is None else f"{one['pretension_mm']:g}"
        ends = (cells(one, 0), cells(one, -1)) if one["frequency_hz"] else ("-", "-")
        rows.append((name, *ends, str(len(one["frequency_hz"]))))
    columns = ("pretension/mm", "weakest drive", "whole drive", "points")
    table = Table(columns, rows, "backbone: response lags by 90°")
    return [table, *(f"- {one['message']}" for one in backbones if not one["complete"])]


def bands_told(document: dict[str, Any]) -> list[Table | str]:
    """Return a row of intervals for each curve, and what to know of the draws."""
    rows = []
    for band in document["bands"]:
        folds = "; ".join(_cell(fold) for fold in band["folds"]) or "none"
        rows.append((f"{band['pretension_mm']:g}", _cell(band["peak"]), _cell(band["phase_90"]), folds))
    draws = document["draws"]
    title = f"90 % intervals from {draws['count']} draws"
    told: list[Table | str] = [Table(("pretension/mm", "peak", "90° of phase", "folds"), rows, title)]
    for band in document["bands"]:
        if band["complete"] < band["draws"]:
            lost = band["draws"] - band["complete"]
            told.append(
                f"- at {band['pretension_mm']:g} mm {lost} of {band['draws']} draws do not reach the end of the band"
            )
        if 0 < band["folded"] < band["draws"]:
            told.append(f"- at {band['pretension_mm']:g} mm {band['folded']} of {band['draws']} draws have folds")
    return [*told, *(f"- {sentence}" for sentence in draws["remarks"])]


def _cell(mark: dict[str, Any] | None) -> str:
    if mark is None:
        return "-"
    (f_low, f_high), (a_low, a_high) = mark["frequency_hz"]["interval90"], mark["amplitude_deg"]["interval90"]
    if None in (f_low, f_high, a_low, a_high):
        return "too few draws have it"
    return f"{span(f_low, f_high, 'Hz')}, {span(a_low, a_high)}°"


# A sketch of a curve for who moves a slider: the same equations, few harmonics, long steps, no refining.
#
# Held against curves refined to 19 harmonics and more, of 30 joints drawn at random (silicone 40 to 80 by 60 to 150 mm,
# guides on circles of 15 to 60 mm, levers of 4 to 20 g m², 0 to 12 mm of pretension, 2 to 30° of drive): amplitudes lay
# within 0.4 % of the curve's height, the point of 90° within 0.05 % in frequency, the peak within 0.3 % in frequency
# and, where it did not lie at the end of the band, 0.2 % in amplitude. A curve takes 50 ms once its code is compiled, a
# long one twice that. Folds come and go in pairs where a curve is all but upright; pairs within 0.2 % of a frequency
# are left out.

SKETCH_ERROR = 5e-3
"""Error of a sketched amplitude, in shares of the largest [1]: above the largest that was found."""

_SIZE, _STABILITY = Size(7, 32), Size(7, 64)
_STRIDE = Stride(first=0.05, most=0.2, correction=3e-2, tolerance=1e-3)
_EVERY = 2
"""So many points share one map of disturbances; between them the multiplier is interpolated."""

_APART = 2e-3


def sketch(problem: Problem, band_hz: Sequence[float]) -> Prediction:
    """Return the curves of all lanes over a band of frequencies [Hz], unrefined; `error` is `SKETCH_ERROR` throughout.

    Marked points are interpolated between the points of the curve, the peak as `sinew.predict.band.crest` does.
    """
    begin = time.perf_counter()
    window = 2 * np.pi * np.asarray(band_hz, dtype=float) / np.asarray(problem.lane.omega)[0]
    curve = first_curves(problem, window, RESOLUTION._replace(stride=_STRIDE), _SIZE)
    branches = []
    for i, (count, status) in enumerate(zip(np.asarray(curve.number), np.asarray(curve.status), strict=True)):
        points, tangents = (np.asarray(rows)[i, :count] for rows in (curve.points, curve.tangents))
        lane = rows_of(problem.lane, np.full(count, i))
        branches.append(_sketched(points, tangents, lane, problem.equations, int(status)))
    return Prediction(tuple(branches), _SIZE.harmonics, SKETCH_ERROR, time.perf_counter() - begin)


def _sketched(points: Array, tangents: Array, lane: Lane, equations: Equations, status: int) -> Branch:
    harmonics, count = _SIZE.harmonics, len(points)
    scale = np.asarray(lane.scale)[0] if count else np.ones(len(equations.coordinates))
    hertz = float(np.asarray(lane.omega)[0]) / (2 * np.pi) if count else 1.0
    response, drive = scale[equations.response], 1.0 if equations.drive is None else scale[equations.drive]
    height, product = half_range(points, equations, harmonics).value, lag_product(points, equations, harmonics)[0]
    folds, quarter = [], None
    for guess in guesses(points, tangents, height, product) if count > 2 else []:
        at = guess.point[None]
        size = float(half_range(at, equations, harmonics).value[0] * response)
        lag = float(wrapped_lag(np.conj(lag_product(at, equations, harmonics)[0]))[0])
        mark = Mark(float(at[0, -1]) * hertz, size, lag)
        if guess.kind == FOLD:
            folds.append(mark)
        elif guess.kind == QUARTER:
            quarter = mark
    branch = Branch(
        frequency_hz=points[:, -1] * hertz,
        amplitude=height * response,
        phase=wrapped_lag(np.conj(product)),
        orders=orders(equations.coordinates[equations.response], harmonics),
        harmonics=phasors(points, equations, harmonics, equations.response) * response,
        drive=drive_phasor(points, equations, harmonics) * drive,
        multiplier=_multipliers(points, lane, equations),
        folds=tuple(_distinct(folds)),
        peak=None,
        phase_90=quarter,
        error=np.full(count, SKETCH_ERROR),
        complete=status == OUTSIDE,
        message=ENDS[status],
    )
    return Branch(**{**branch.__dict__, "peak": crest(branch)})


def _distinct(folds: list[Mark]) -> list[Mark]:
    """Return the folds without pairs that undo each other within a hair of a frequency."""
    kept: list[Mark] = []
    for fold in folds:
        if kept and abs(fold.frequency_hz / kept[-1].frequency_hz - 1) < _APART:
            kept.pop()
        else:
            kept.append(fold)
    return kept


def _multipliers(points: Array, lane: Lane, equations: Equations) -> Array:
    """Return the modulus of the largest multiplier of each point, (n,)."""
    count = len(points)
    if not count:
        return np.zeros(0)
    some = np.unique(np.append(np.arange(0, count, _EVERY), count - 1))
    maps = maps_of(points[some], rows_of(lane, some), equations, _STABILITY)
    return np.asarray(np.interp(np.arange(count), some, largest_multiplier(maps, equations)))
