"""A prediction against a recording of the joint: same pretensions, same readings, differences.

Two predictions are compared, each with what was measured the same way:

- from the command: lever and torsion from what the servo was told. `gain` is the paper's, half of peak to peak over the
  nominal amplitude; it is off where the rig's servo is.
- from the measured lever: the joint alone, moved by the lever as it was measured, its harmonics with it.
  `gain_measured_drive` and `phase_lag_rad` are fundamental over fundamental.

Peaks are read off the predicted curve as off the measured one: at the measured frequencies, by the same fit. That way
the bias of such a reading is in both.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sinew.analysis.signal.attitude import LeverMotion, measure_lever
from sinew.analysis.signal.harmonics import split_by_drive
from sinew.analysis.signal.repeats import combine_repeats
from sinew.analysis.sweep.resonance import estimate_resonance
from sinew.analysis.sweep.response import Response, estimate_response
from sinew.measure.arrays import Array, wrapped_lag
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import NORMAL_90, Estimate
from sinew.measure.recording import FEWEST_FREQUENCIES
from sinew.measure.result import Field, Result, Rows, Table
from sinew.plan.plan import TendonMode
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_plan
from sinew.predict.joint import RESOLUTION, lever_problem
from sinew.solve.branch import Prediction, Swept, sweep
from sinew.solve.curves import predict
from sinew.twin.parameters import Effects

_POINTS = ("gain", "phase_from_command_deg", "gain_measured_drive", "phase_lag_deg")
_READINGS = ("resonance_hz", "gain_peak", "resonance_measured_drive_hz", "gain_peak_measured_drive", "phase_90_hz")


@dataclass(frozen=True)
class Measured:
    """What a recording says of the joint's steady response, and how it was driven.

    response: over pretension (p), frequency (f) and repeat. resonance: its readings, None below six frequencies.
    lever: as it was measured, None where it was not. amplitude_deg: of the command, one for all.
    mode: of the tendon motors. effects_off: names of effects that the twin had switched off, if it was the twin.
    """

    response: Response
    resonance: xr.Dataset | None
    lever: LeverMotion | None
    amplitude_deg: float
    mode: TendonMode
    effects_off: tuple[str, ...]

    @property
    def band_hz(self) -> tuple[float, float]:
        """Return lowest and highest frequency."""
        frequency = self.response.frequency_hz
        return float(frequency[0]), float(frequency[-1])


class _Reading(NamedTuple):
    """A number over pretension (p,) or pretension and frequency (p, f): measured, with standard deviation and 90 %
    interval of the mean over repeats, and predicted; NaN where there is none."""

    measured: Array
    std: Array
    low: Array
    high: Array
    predicted: Array


def measured_of(recording: xr.Dataset, rig: RigSpec) -> Measured:
    """Return what a recording says of the steady response.

    rig: whose delays of the sensors are undone. Raises RecordingError without steady segments, SpecError for an
    imported table and for a recording that was driven with several amplitudes.
    """
    if recording.attrs.get("source") == "import":
        raise SpecError("the recording was imported from a table; expected one of a bench or of the twin")
    recording = split_by_drive(recording)
    steady = recording["kind"].values == "steady"
    if not steady.any():
        raise RecordingError("the recording has no steady segment; expected a sweep, to hold a prediction against")
    amplitude = np.unique(recording["amplitude_deg"].values[steady])
    if amplitude.size != 1 or not np.isfinite(amplitude).all():
        found = ", ".join(f"{one:g}" for one in amplitude)
        raise SpecError(f"the recording was driven with {found}°, expected one amplitude; compare each on its own")
    response = estimate_response(recording, rig)
    text = str(recording.attrs.get("plan", ""))
    mode: TendonMode = parse_plan(text, source="the recording's plan").pretension.mode if text.strip() else "position"
    try:
        lever = measure_lever(recording, rig)
    except RecordingError:
        lever = None
    enough = response.frequency_hz.size >= FEWEST_FREQUENCIES
    off = tuple(str(recording.attrs.get("effects_off", "")).split())
    return Measured(response, estimate_resonance(response) if enough else None, lever, float(amplitude[0]), mode, off)


def _compared(
    measured: Measured, command: Prediction, lever: Prediction | None
) -> tuple[dict[str, _Reading], dict[str, _Reading]]:
    """Return (numbers of the steady states over (p, f), readings of the resonance over (p,)), by name.

    command: from the command, lever: from the measured lever, each one curve for every pretension of the recording.
    """
    response = measured.response
    f, columns = response.frequency_hz, response.columns
    nominal = np.radians(measured.amplitude_deg)
    from_command = _stacked([sweep(branch, f, "up") for branch in command.branches])
    points = {
        "gain": _points(columns["gain"], response.nominal_gain_std * columns["gain"], from_command.amplitude / nominal),
        "phase_from_command_deg": _lag(response, from_command.phase),
    }
    transfer = from_command.fundamental / from_command.drive
    if lever is not None and measured.lever is not None:
        joint = _stacked([sweep(branch, f, "up") for branch in lever.branches])
        transfer = joint.fundamental / (-1j * measured.lever.amplitude)
        points["gain_measured_drive"] = _points(
            columns["gain_measured_drive"], columns["gain_measured_drive_std"], np.abs(transfer)
        )
        points["phase_lag_deg"] = _lag(response, joint.phase)
    if measured.resonance is None:
        return points, {}
    curve = _as_measured(response, from_command, transfer, nominal)
    return points, _readings(measured.resonance, estimate_resonance(curve), with_lever=lever is not None)


def _stacked(rows: Sequence[Swept]) -> Swept:
    return Swept(*(np.stack(parts) for parts in zip(*rows, strict=True)))


def _points(values: Array, stds: Array, predicted: Array) -> _Reading:
    mean = combine_repeats(values, stds)
    return _Reading(
        mean.value, mean.std_of_value, mean.low, mean.high, np.where(np.isfinite(mean.value), predicted, np.nan)
    )


def _lag(response: Response, predicted: Array) -> _Reading:
    """Return the lag [deg], that of the prediction on the turn of the measured one [rad]."""
    columns = response.columns
    delay = np.nan_to_num(np.nanmax(np.nan_to_num(columns["phase_delay_std_rad"]), axis=2))
    mean = combine_repeats(columns["phase_lag_rad"], columns["phase_std_rad"], np.inf, delay)
    apart = np.mod(predicted - mean.value + np.pi, 2 * np.pi) - np.pi
    parts = (mean.value, mean.std_of_value, mean.low, mean.high, mean.value + apart)
    return _Reading(*(np.degrees(part) for part in parts))


def _as_measured(response: Response, command: Swept, transfer: NDArray[np.complex128], nominal: float) -> Response:
    """Return the predicted curves as if they had been measured once: at the same frequencies, as certain."""

    def once(values: NDArray[np.generic]) -> NDArray[np.generic]:
        return values[:, :, None]

    def certain(values: Array) -> Array:
        known = np.isfinite(values)
        return np.asarray(np.where(known, values, 0).sum(axis=2) / np.maximum(known.sum(axis=2), 1))

    there = np.isfinite(response.columns["gain"]).any(axis=2)
    gone = np.where(there, 1.0, np.nan)
    measured, by_command = transfer * gone, command.fundamental / (-1j * nominal) * gone
    ratio = certain(response.columns["gain_measured_drive_std"] / response.columns["gain_measured_drive"])
    drive = np.abs(command.drive) * gone
    columns = {
        "gain": command.amplitude / nominal * gone,
        "gain_harmonic": np.abs(by_command),
        "gain_measured_drive": np.abs(measured),
        "gain_measured_drive_std": np.abs(measured) * ratio,
        "phase_lag_rad": wrapped_lag(measured),
        "phase_std_rad": certain(response.columns["phase_std_rad"]),
        "phase_delay_std_rad": certain(response.columns["phase_delay_std_rad"]),
        "drive_amplitude_rad": drive,
        "drive_amplitude_std_rad": np.zeros_like(drive),
    }
    return Response(
        response.pretension_mm,
        response.frequency_hz,
        np.ones(1, dtype=np.int64),
        {name: np.asarray(once(values), dtype=float) for name, values in columns.items()},
        np.asarray(once(measured), dtype=complex),
        np.asarray(once(by_command), dtype=complex),
        np.asarray(once(certain(response.nominal_gain_std)), dtype=float),
        np.asarray(once(certain(response.nominal_phase_std)), dtype=float),
    )


def _readings(measured: xr.Dataset, predicted: xr.Dataset, *, with_lever: bool) -> dict[str, _Reading]:
    found = {}
    for name in _READINGS if with_lever else _READINGS[:2]:
        suffix = "_hz" if name.endswith("_hz") else ""
        stem = name.removesuffix(suffix)
        low, high = (measured[f"{stem}_{end}{suffix}"].values for end in ("low", "high"))
        found[name] = _Reading(measured[name].values, (high - low) / (2 * NORMAL_90), low, high, predicted[name].values)
    return found


# It is said in numbers how well a prediction meets a recording, and what it was not fitted to.

Subset = Literal["all", "fitted", "others"]


@dataclass(frozen=True, repr=False)
class Score(Result):
    """Errors of one number over the places where it was both measured and predicted.

    Relative errors, predicted over measured less one [1], or differences of angles [deg]; see `is_angle`.
    count: of places. rms, largest: of the error, the measurement's own among it. noise: what rms a perfect prediction
    would have because of the measurement's standard deviations. inside: share of places whose 90 % interval holds the
    prediction.
    """

    count: Annotated[int, Field("number")]
    rms: Annotated[float, Field("rms error", unit="")]
    largest: Annotated[float, Field("largest", unit="")]
    noise: Annotated[float, Field("noise", unit="")]
    inside: Annotated[float, Field("inside", unit="%")]


@dataclass(frozen=True, repr=False)
class Met(Result):
    """One number at one place: measured, predicted, and the error, whose interval is that of the measurement; relative,
    predicted over measured less one, or of an angle the difference."""

    measured: Annotated[Estimate, Field("measured")]
    predicted: Annotated[float, Field("predicted")]
    error: Annotated[Estimate, Field("error")]


_Met = Annotated[Met | None, Field("", "detail")]


@dataclass(frozen=True, repr=False)
class ReadingRow(Result):
    """Readings of the peak at a pretension, those by the measured lever None without one; `fitted` as of `Against`."""

    pretension_mm: Annotated[float, Field("pretension")]
    fitted: Annotated[bool, Field("fitted")]
    resonance_hz: _Met
    gain_peak: _Met
    resonance_measured_drive_hz: _Met
    gain_peak_measured_drive: _Met
    phase_90_hz: _Met


@dataclass(frozen=True, repr=False)
class PointRow(Result):
    """Numbers of a steady state, those by the measured lever None without one."""

    pretension_mm: Annotated[float, Field("pretension")]
    frequency_hz: Annotated[float, Field("frequency")]
    fitted: Annotated[bool, Field("fitted")]
    gain: _Met
    phase_from_command_deg: _Met
    gain_measured_drive: _Met
    phase_lag_deg: _Met


@dataclass(frozen=True, repr=False)
class Against(Result):
    """A prediction held against a recording.

    recording: its file's name. amplitude_deg: of the command. mode: of the motors. fitted_mm: pretensions that the rig
    was calibrated to. scores: over all pretensions, those fitted to, and the others, by name of the number.
    """

    recording: Annotated[str, Field("", "detail")]
    amplitude_deg: Annotated[float, Field("", "detail")]
    mode: Annotated[str, Field("", "detail")]
    fitted_mm: Annotated[tuple[float, ...], Field("", "detail")]
    scores: Annotated[Mapping[Subset, Mapping[str, Score]], Field("", "detail")]
    resonance: Annotated[Rows[ReadingRow], Field("", "detail")]
    points: Annotated[Rows[PointRow], Field("", "detail")]
    remarks: Annotated[tuple[str, ...], Field("", "detail")]

    def blocks(self) -> list[Table | str]:
        """Return how far the prediction is off, a row for each number and subset of the pretensions."""
        rows = []
        for name, title in _TITLES.items():
            factor, unit = (1.0, "°") if is_angle(name) else (100.0, " %")
            for subset, where in _SUBSETS.items():
                score = self.scores[subset].get(name) if subset in self.scores else None
                if score is not None and (subset == "all" or "others" in self.scores):
                    cells = [f"{factor * part:.2f}{unit}" for part in (score.rms, score.largest)]
                    rows.append((title if subset == "all" else "", where, str(score.count), *cells))
        head = ("against the recording", "pretensions", "number", "rms error", "largest")
        return [Table(head, rows, self.recording), *(f"- {sentence}" for sentence in self.remarks)]


_TITLES = {
    "resonance_hz": "frequency of the fundamental's peak, by the command",
    "gain_peak": "gain at the peak, by the command",
    "resonance_measured_drive_hz": "frequency of the peak, by the measured lever",
    "gain_peak_measured_drive": "gain at the peak, by the measured lever",
    "phase_90_hz": "frequency of 90° of phase",
    "gain": "gain, by the command",
    "phase_from_command_deg": "phase, by the command",
    "gain_measured_drive": "gain, by the measured lever",
    "phase_lag_deg": "phase, by the measured lever",
}
_SUBSETS: dict[Subset, str] = {"all": "all", "fitted": "fitted to", "others": "not fitted to"}


def hold_against(
    measured: Measured,
    prediction: Prediction,
    rig: RigSpec,
    effects: Effects,
    fitted_mm: Sequence[float] | None = None,
    recording: str = "",
) -> Against:
    """Return a prediction held against what a recording says.

    prediction: of the rig at the recording's pretensions, with these effects. fitted_mm: pretensions that the rig was
    calibrated to; None for what it says itself. recording: its name.
    """
    lever = None
    if measured.lever is not None:
        band = measured.band_hz
        lever = predict(lever_problem(rig, measured.lever, band, mode=measured.mode, effects=effects), band, RESOLUTION)
    calibrated_mm = rig.calibration.pretension_mm if rig.calibration is not None else ()
    fitted = tuple(calibrated_mm if fitted_mm is None else fitted_mm)
    numbers, readings = _compared(measured, prediction, lever)
    response = measured.response
    places = [(float(mm), any(np.isclose(mm, one) for one in fitted)) for mm in response.pretension_mm]
    resonance = [
        ReadingRow(mm, known, *(_met_at(name, readings.get(name), (i,)) for name in _READINGS))
        for i, (mm, known) in enumerate(places)
        if readings
    ]
    points = []
    for i, (mm, known) in enumerate(places):
        for j, hertz in enumerate(response.frequency_hz):
            met = [_met_at(name, numbers.get(name), (i, j)) for name in _POINTS]
            if any(one is not None for one in met):
                points.append(PointRow(mm, float(hertz), known, *met))
    scores = scores_of(resonance, points)
    remarks = []
    if not fitted:
        remarks.append(
            "the rig does not say to which pretensions it was calibrated, so none counts as fitted; say it with "
            "--fitted-mm"
        )
    elif "others" not in scores:
        remarks.append("the rig was calibrated to every pretension of the recording; nothing here is a prediction")
    if lever is None:
        remarks.append("the recording has no motion of the lever, so the joint was not compared by it")
    if measured.effects_off:
        remarks.append(f"the recording's twin had {', '.join(measured.effects_off)} off, and so has the prediction")
    return Against(
        recording,
        measured.amplitude_deg,
        measured.mode,
        fitted,
        scores,
        Rows(resonance),
        Rows(points),
        tuple(remarks),
    )


def is_angle(name: str) -> bool:
    """Return whether a number's error is a difference of angles [deg] instead of a relative one."""
    return name.endswith("_deg")


def met(name: str, measured: Estimate, predicted: float) -> Met | None:
    """Return a number with its error, None where it was not measured or not predicted."""
    if not np.isfinite([measured.value, predicted]).all():
        return None
    if is_angle(name):
        off = (predicted - measured.value, measured.std, predicted - measured.high, predicted - measured.low)
        return Met(measured, predicted, Estimate(*off))
    low, high = (end if end > 0 else np.nan for end in (measured.low, measured.high))
    std = predicted * measured.std / measured.value**2
    error = Estimate(predicted / measured.value - 1, std, predicted / high - 1, predicted / low - 1)
    return Met(measured, predicted, error)


def _met_at(name: str, reading: _Reading | None, index: tuple[int, ...]) -> Met | None:
    if reading is None:
        return None
    *measured, predicted = (float(part[index]) for part in reading)
    return met(name, Estimate(*measured), predicted)


def scores_of(resonance: Sequence[ReadingRow], points: Sequence[PointRow]) -> dict[Subset, dict[str, Score]]:
    """Return the scores of all numbers: over all pretensions, over those that the rig was calibrated to, and over the
    others. A subset without a place is left out."""
    found: dict[Subset, dict[str, Score]] = {}
    rows: list[ReadingRow | PointRow] = [*resonance, *points]
    for subset in _SUBSETS:
        mine = [row for row in rows if subset == "all" or row.fitted == (subset == "fitted")]
        known = {name: [one for row in mine if (one := getattr(row, name, None)) is not None] for name in _TITLES}
        if scores := {name: _score(every) for name, every in known.items() if every}:
            found[subset] = scores
    return found


def _score(every: Sequence[Met]) -> Score:
    error, std = np.array([(one.error.value, one.error.std) for one in every]).T
    low, high, predicted = np.array([(one.measured.low, one.measured.high, one.predicted) for one in every]).T
    bounded = np.isfinite(low) & np.isfinite(high)
    inside = (low <= predicted) & (predicted <= high)
    return Score(
        len(every),
        float(np.sqrt(np.mean(error**2))),
        float(np.max(np.abs(error))),
        float(np.sqrt(np.mean(np.nan_to_num(std) ** 2))),
        float(np.mean(inside[bounded])) if bounded.any() else float("nan"),
    )
