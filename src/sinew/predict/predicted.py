"""What a rig or an oscillator is predicted to do: its curves, backbones and bands, and what they are worth."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from math import degrees
from pathlib import Path
from typing import Annotated, Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import SpecError
from sinew.measure.estimate import Estimate, finite, number, span
from sinew.measure.result import Column, Field, Result, Rows, Table
from sinew.mechanics.parameters import TENDON_MODES
from sinew.plan.plan import TendonMode
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.predict.against import Against
from sinew.predict.band import Band, Marked, Tube, bands_of, carried_over, draw_rigs
from sinew.predict.joint import RESOLUTION, joint_problem
from sinew.predict.linear import Equivalent, equivalent_of_oscillator, equivalent_of_rig, harmonic_shares
from sinew.predict.oscillator import Oscillator, oscillator_problem, resolution_of
from sinew.predict.validity import Check, check_drive, check_joint, doubt_broken_curves, loads_of
from sinew.solve.backbone import Backbone, follow_backbones
from sinew.solve.branch import Branch, Mark, Prediction
from sinew.solve.curves import Problem
from sinew.solve.curves import predict as predict_problem
from sinew.solve.programs import configure, use_all_cores
from sinew.twin.parameters import Effects


class PredictionRequest(NamedTuple):
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


# The parts of a prediction.


@dataclass(frozen=True, repr=False)
class MarkResult(Result):
    """A marked point of a curve. gain: of the peak of a rig's, its amplitude over that of the drive's command.
    damping_ratio: of the ends of a backbone."""

    frequency_hz: Annotated[float, Field("frequency")]
    amplitude_deg: Annotated[float, Field("amplitude")]
    gain: Annotated[float | None, Field("gain")] = None
    damping_ratio: Annotated[float | None, Field("damping ratio")] = None

    def cell(self) -> str:
        """Return it in words."""
        gain = "" if self.gain is None else f", gain {number(self.gain)}"
        damping = "" if self.damping_ratio is None else f", D {number(self.damping_ratio, 3)}"
        return f"{number(self.frequency_hz, unit='Hz')}, {number(self.amplitude_deg)}°{gain}{damping}"


@dataclass(frozen=True, repr=False)
class Followed(Result):
    """The points of a curve in the order in which it was followed, (n,) each, and how it ended; see `Branch`.

    pretension_mm: None of an oscillator.
    """

    pretension_mm: Annotated[float | None, Field("pretension")]
    frequency_hz: Column
    stable: Annotated[Mask, Field("", "detail")]
    multiplier: Column
    error: Column
    complete: Annotated[bool, Field("", "detail")]
    message: Annotated[str, Field("", "detail")]

    def remarks(self) -> list[str]:
        """Return what the curve did not reach, and how much of it is not stable."""
        lines = [] if self.complete and "not" not in self.message else [self.message]
        if unstable := int(np.sum(~self.stable)):
            lines.append(f"{unstable} of {self.stable.size} points are not stable")
        at = "" if self.pretension_mm is None else f"at {self.pretension_mm:g} mm "
        return [f"- {at}{one}" for one in lines]


def followed(branch: Branch, pretension_mm: float | None) -> Followed:
    """Return how a curve was followed."""
    points = (branch.frequency_hz, branch.stable, branch.multiplier, branch.error)
    return Followed(pretension_mm, *points, branch.complete, branch.message)


@dataclass(frozen=True, repr=False)
class Points(Followed):
    """A curve's amplitudes, half of peak to peak, those of the fundamental, and the harmonics from the second to the
    fifth as shares of it, by order."""

    amplitude_deg: Column
    fundamental_deg: Column
    harmonic_shares: Annotated[Mapping[str, Array], Field("", "detail")]


def _points(branch: Branch, pretension_mm: float | None) -> Points:
    return Points(
        **vars(followed(branch, pretension_mm)),
        amplitude_deg=np.degrees(branch.amplitude),
        fundamental_deg=np.degrees(branch.fundamental),
        harmonic_shares={str(order): share for order, share in harmonic_shares(branch).items()},
    )


@dataclass(frozen=True, repr=False)
class CurveResult(Points):
    """One response curve through its folds, with what is marked on it; see `Branch`."""

    phase_deg: Column
    peak: Annotated[MarkResult | None, Field("peak (Eq. 6)", unit="")]
    fundamental_peak: Annotated[MarkResult | None, Field("peak of the fundamental", unit="")]
    phase_90: Annotated[MarkResult | None, Field("90° of phase", unit="")]
    folds: Annotated[Rows[MarkResult], Field("folds", unit="")]


def _curve(branch: Branch, pretension_mm: float | None, command_deg: float | None = None) -> CurveResult:
    def mark(one: Mark | None, over_deg: float | None = None) -> MarkResult | None:
        if one is None:
            return None
        size = degrees(one.amplitude)
        return MarkResult(one.frequency_hz, size, None if over_deg is None else size / over_deg)

    return CurveResult(
        **vars(_points(branch, pretension_mm)),
        phase_deg=np.degrees(branch.phase),
        peak=mark(branch.peak, command_deg),
        fundamental_peak=mark(branch.fundamental_peak),
        phase_90=mark(branch.phase_90),
        folds=Rows(MarkResult(one.frequency_hz, degrees(one.amplitude)) for one in branch.folds),
    )


@dataclass(frozen=True, repr=False)
class BackboneResult(Points):
    """Where the response lags by 90°, from a small share of the drive to the whole.

    command_deg, lever_deg: of a rig, amplitudes of the command and of the lever's fundamental; torque_n_m or base_deg:
    of an oscillator. stiffness_n_m_rad and those below: of the spring and damper that take the fundamental's place.
    """

    weakest: Annotated[MarkResult | None, Field("weakest drive", unit="")]
    whole: Annotated[MarkResult | None, Field("whole drive", unit="")]
    stiffness_n_m_rad: Column
    damping_n_m_s_rad: Column
    damping_ratio: Column
    command_deg: Annotated[Array | None, Field("", "detail")] = None
    lever_deg: Annotated[Array | None, Field("", "detail")] = None
    torque_n_m: Annotated[Array | None, Field("", "detail")] = None
    base_deg: Annotated[Array | None, Field("", "detail")] = None


def _backbone(backbone: Backbone, pretension_mm: float | None, equivalent: Equivalent, **drive: Any) -> BackboneResult:
    points, ratio = _points(backbone.curve, pretension_mm), equivalent.damping_ratio
    rows = np.stack([points.frequency_hz, points.amplitude_deg, ratio], axis=1).tolist()
    ends: list[MarkResult | None] = [None, None]
    if rows:
        ends = [MarkResult(hz, size, None, finite(damping)) for hz, size, damping in (rows[0], rows[-1])]
    return BackboneResult(
        **vars(points),
        weakest=ends[0],
        whole=ends[1],
        **vars(equivalent),
        **drive,
    )


@dataclass(frozen=True, repr=False)
class MarkedResult(Result):
    """A marked point with intervals; draws: how many of them have it."""

    frequency_hz: Annotated[Estimate, Field("frequency", "interval")]
    amplitude_deg: Annotated[Estimate, Field("amplitude", "interval")]
    draws: Annotated[int, Field("", "detail")]

    def cell(self) -> str:
        """Return its intervals."""
        hz, size = self.frequency_hz, self.amplitude_deg
        if not np.isfinite([hz.low, hz.high, size.low, size.high]).all():
            return "too few draws have it"
        return f"{span(hz.low, hz.high, 'Hz')}, {span(size.low, size.high)}°"


@dataclass(frozen=True, repr=False)
class BandResult(Result):
    """What is known of one curve, see `sinew.predict.band.Band`. up, down: of `amplitude_deg` and `phase_deg`."""

    pretension_mm: Annotated[float, Field("pretension")]
    frequency_hz: Column
    up: Annotated[Mapping[str, Tube], Field("", "detail")]
    down: Annotated[Mapping[str, Tube], Field("", "detail")]
    reached: Annotated[NDArray[np.int64], Field("", "detail")]
    peak: Annotated[MarkedResult | None, Field("peak", unit="")]
    phase_90: Annotated[MarkedResult | None, Field("90° of phase", unit="")]
    folds: Annotated[Rows[MarkedResult], Field("folds", unit="")]
    draws: Annotated[int, Field("", "detail")]
    complete: Annotated[int, Field("draws that reach the end")]
    folded: Annotated[int, Field("draws with folds")]


def _band(band: Band, pretension_mm: float) -> BandResult:
    def tubes(pair: tuple[Tube, Tube]) -> dict[str, Tube]:
        return dict(zip(("amplitude_deg", "phase_deg"), (one.times(degrees(1.0)) for one in pair), strict=True))

    def marked(one: Marked | None) -> MarkedResult | None:
        return None if one is None else MarkedResult(one.frequency_hz, one.amplitude.times(degrees(1.0)), one.draws)

    return BandResult(
        pretension_mm,
        band.frequency_hz,
        tubes(band.up),
        tubes(band.down),
        band.reached,
        marked(band.peak),
        marked(band.phase_90),
        Rows(found for fold in band.folds if (found := marked(fold)) is not None),
        band.draws,
        band.complete,
        band.folded,
    )


@dataclass(frozen=True, repr=False)
class DrawsResult(Result):
    """What was drawn: how often, from which seed, names of the parameters that vary, and sentences on them."""

    count: Annotated[int, Field("", "detail")]
    seed: Annotated[int, Field("", "detail")]
    parameters: Annotated[tuple[str, ...], Field("", "detail")]
    remarks: Annotated[tuple[str, ...], Field("", "detail")]


@dataclass(frozen=True, repr=False)
class Steady(Result):
    """Steady response over frequency: of an oscillator one curve, of a rig one for each pretension.

    prediction: as it was solved. error_estimate: the largest error of all points; wall_s: time that it took.
    """

    prediction: Prediction
    branches: Annotated[Rows[CurveResult], Field("")]
    harmonics: Annotated[int, Field("", "detail")]
    error_estimate: Annotated[float, Field("", "detail")]
    wall_s: Annotated[float, Field("", "detail")]
    _: KW_ONLY
    backbone: Annotated[Rows[BackboneResult] | None, Field("backbone: response lags by 90°")] = None

    def closing(self) -> list[str]:
        """Return what curves and backbones did not reach, and how good they are."""
        lines = [line for one in (*self.branches, *(self.backbone or ())) for line in one.remarks()]
        error = f"error estimate {self.error_estimate:.1e}, {self.wall_s * 1e3:.0f} ms"
        return [*lines, f"{self.harmonics} harmonics, {error}"]


@dataclass(frozen=True, repr=False)
class Predicted(Steady):
    """A rig's prediction: its curves, what they are worth, and where asked for how far they can be off.

    spec: the rig. asked, problem: what was solved. tubes: the bands in SI, one for each pretension. source: what the
    rig was named by, among others.
    """

    rig: Annotated[str, Field("", "detail")]
    spec: RigSpec
    request: PredictionRequest
    problem: Problem
    validity: Annotated[Rows[Check], Field("", "detail")]
    bands: Annotated[Rows[BandResult] | None, Field("90 % intervals from draws of the rig")] = None
    draws: Annotated[DrawsResult | None, Field("", "detail")] = None
    against: Annotated[Against | None, Field("", "detail")] = None
    source: Annotated[str | None, Field("", "detail")] = None
    tubes: tuple[Band, ...] = ()

    def blocks(self) -> list[Table | str]:
        """Return its tables and sentences, and those of the recording that it is held against."""
        return [*super().blocks(), *(self.against.blocks() if self.against is not None else ())]

    def closing(self) -> list[str]:
        """Return what each assumption is worth, and what to know of curves and draws."""
        lines = [one.line() for one in self.validity]
        return [*lines, *(f"- {one}" for one in (self.draws.remarks if self.draws else ())), *super().closing()]


def _steady(prediction: Prediction, pretensions: Sequence[float | None], command_deg: float | None = None) -> Steady:
    rows = Rows(_curve(one, mm, command_deg) for one, mm in zip(prediction.branches, pretensions, strict=True))
    return Steady(prediction, rows, prediction.harmonics, prediction.error_estimate, prediction.wall_s)


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
    >>> peak = found.branches[0].peak
    >>> 3.0 < peak.frequency_hz < 4.0
    True
    """
    made = rig if isinstance(rig, RigSpec) else load_rig(rig)
    pretensions = [float(mm) for mm in np.atleast_1d(pretension_mm)]
    request = PredictionRequest(pretensions, amplitude_deg, mode, tuple(without), (band_hz[0], band_hz[1]))
    found = predict_rig(made, request)
    return found if bands is None else with_bands(found, made, bands, seed, progress)


def predict_rig(rig: RigSpec, request: PredictionRequest) -> Predicted:
    """Return the prediction of a rig, with what it is worth. Raises SpecError for what the rig does not allow."""
    refuse_pretensions(rig, request.pretensions)
    refuse_drive(request.mode, request.amplitude_deg, request.band_hz)
    use_all_cores()
    problem = joint_problem(
        rig,
        request.pretensions,
        request.amplitude_deg,
        request.band_hz,
        mode=request.tendon_mode,
        effects=request.effects,
    )
    prediction = predict_problem(problem, request.band_hz, RESOLUTION)
    torsion = np.array([float(np.max(branch.amplitude, initial=0.0)) for branch in prediction.branches])
    checks = check_joint(rig, request.pretensions, loads_of(problem, torsion), tilt_held=request.mode != "current")
    broken = [mm for mm, one in zip(request.pretensions, prediction.branches, strict=True) if not one.complete]
    checks = [*doubt_broken_curves(checks, broken), *check_drive(rig, request.amplitude_deg, request.band_hz[1])]
    return predicted_of(rig, request, problem, prediction, checks)


def predicted_of(
    rig: RigSpec, request: PredictionRequest, problem: Problem, prediction: Prediction, checks: Sequence[Check]
) -> Predicted:
    """Return curves of a rig with what they are worth."""
    steady = _steady(prediction, request.pretensions, request.amplitude_deg)
    return Predicted(**vars(steady), rig=rig.name, spec=rig, request=request, problem=problem, validity=Rows(checks))


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
    request = found.request
    rig, changed = carried_over(base, found.spec)
    draws = draw_rigs(rig, count, seed)
    bands = bands_of(
        found.prediction,
        rig,
        draws,
        request.pretensions,
        request.amplitude_deg,
        request.band_hz,
        mode=request.tendon_mode,
        effects=request.effects,
        progress=progress,
    )
    certain = (f"what the design changes is taken as certain: {', '.join(changed)}",) if changed else ()
    return replace(
        found,
        bands=Rows(_band(one, mm) for one, mm in zip(bands, request.pretensions, strict=True)),
        draws=DrawsResult(count, seed, draws.names, (*draws.remarks, *certain)),
        tubes=tuple(bands),
    )


def with_backbone(found: Predicted) -> Predicted:
    """Return a prediction with the backbone at each pretension, up to the amplitude of the command that was asked."""
    request, rows = found.request, []
    followed = follow_backbones(found.problem, request.band_hz, RESOLUTION)
    for mm, backbone in zip(request.pretensions, followed, strict=True):
        command = backbone.share * np.radians(request.amplitude_deg)
        lever = backbone.curve.drive * (command if found.problem.equations.drive is None else 1.0)
        drive = {"command_deg": np.degrees(command), "lever_deg": np.degrees(np.abs(lever))}
        rows.append(_backbone(backbone, mm, equivalent_of_rig(backbone.curve, lever, found.spec), **drive))
    return replace(found, backbone=Rows(rows))


def predict_oscillator(one: Oscillator, band_hz: tuple[float, float], *, backbone: bool = False) -> Steady:
    """Return the steady response of an oscillator over a band [Hz]. backbone: also that, up to its drive."""
    configure()
    problem, resolution = oscillator_problem([one], band_hz), resolution_of([one])
    found = _steady(predict_problem(problem, band_hz, resolution), [None])
    if not backbone:
        return found
    (followed,) = follow_backbones(problem, band_hz, resolution)
    share = followed.share
    drive = {"base_deg": np.degrees(share * one.base)} if one.base else {"torque_n_m": share * one.torque}
    equivalent = equivalent_of_oscillator(followed.curve, one, share)
    return replace(found, backbone=Rows([_backbone(followed, None, equivalent, **drive)]))


def refuse_pretensions(rig: RigSpec, pretension_mm: Sequence[float]) -> None:
    """Do nothing where a rig allows the pretensions [mm]; else raise SpecError."""
    low, high = rig.limits.pretension_mm
    for mm in pretension_mm:
        if not low <= mm <= high:
            raise SpecError(
                f"pretension_mm holds {mm:g}, the rig {rig.name} allows {low:g} to {high:g} mm; stay between them, "
                "or widen limits.pretension_mm in the rig's file if its motors and tendons bear that"
            )


def refuse_drive(mode: str, amplitude_deg: float, band_hz: tuple[float, float]) -> None:
    """Do nothing where motors can have a mode and a drive can have an amplitude [deg] over a band [Hz]; else raise
    SpecError."""
    low, high = band_hz
    if mode not in TENDON_MODES or not 0 < low < high or not amplitude_deg > 0:
        raise SpecError(
            f"found mode {mode!r}, {amplitude_deg:g}° and a band from {low:g} to {high:g} Hz; expected one of "
            f"{', '.join(TENDON_MODES)}, a positive angle, and two positive frequencies, the lower first"
        )


@dataclass(frozen=True, repr=False)
class Compared(Result):
    """Predictions of several rigs together, at one amplitude of the drive's command."""

    amplitude_deg: Annotated[float, Field("", "detail")]
    rigs: Annotated[Rows[Predicted], Field("", "detail")]

    def blocks(self) -> list[Table | str]:
        """Return the peaks of all rigs in one table, and what does not hold of each."""
        rows = [
            (
                found.rig if i == 0 else "",
                f"{one.pretension_mm:g}",
                one.peak.cell() if one.peak else "–",
                f"{len(one.folds)}",
            )
            for found in self.rigs
            for i, one in enumerate(found.branches)
        ]
        lines: list[Table | str] = [Table(("rig", "pretension/mm", "peak (Eq. 6)", "folds"), rows)]
        for found in self.rigs:
            held = sum(check.holds for check in found.validity)
            lines.append(f"{found.rig}: {held} of {len(found.validity)} assumptions hold")
            lines += [line for one in found.branches for line in one.remarks()]
            lines += [check.line() for check in found.validity if not check.holds]
        return lines
