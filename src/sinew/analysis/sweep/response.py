"""Amplitude, gain and phase of steady segments, over pretension, frequency and repeat; their Lissajous figures."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import special

from sinew.analysis.signal.attitude import steady_torsion, torsion_harmonics
from sinew.analysis.signal.harmonics import (
    HARMONICS,
    Harmonics,
    add_waves,
    fit_harmonics,
    harmonic_design,
    multiples,
    relative_noise,
)
from sinew.analysis.signal.motors import power_columns
from sinew.analysis.signal.repeats import variable_of
from sinew.analysis.signal.signals import (
    Signals,
    by_length,
    drive_chain,
    hidden_quantisation,
    read_signals,
    torsion_chain,
)
from sinew.measure.arrays import Array, Complexes, wrapped_lag
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import NORMAL_90, Estimate
from sinew.measure.recording import POWER_COLUMNS, RESULT_VARIABLES, Segment, result_axis
from sinew.plan.rig import RigSpec

DRIFT_THRESHOLD = 0.005
"""A group is settled if the relative change of its complex amplitude per period is below this, or below its noise."""

_DRIFT_SIGNIFICANCE = 3.0
_DUTY_SHARE = 0.99
_CREST = 0.5
_CYCLE = multiples(2.0 * np.pi * np.arange(720) / 720, HARMONICS)

_COLUMNS = tuple(
    name for name, row in RESULT_VARIABLES.items() if row.dims == ("pretension_mm", "frequency_hz", "repeat")
)
_FURTHER = ("transfer", "nominal_transfer", "nominal_gain_std", "nominal_phase_std", "power_per_inertia")


@dataclass(frozen=True)
class Response:
    """The frequency response of a recording on its grid.

    pretension_mm, frequency_hz, repeat: axes of length p, f and r; repeats count from 1.
    columns: the response variables of the result schema by name, shape (p, f, r), NaN where nothing was measured.
    transfer: torsion over measured drive, complex, chain corrected, shape (p, f, r); the standard deviations of its
    size and angle are columns. nominal_transfer: torsion over nominal amplitude at the command's phase, or at the
    drive's where no command was recorded; nominal_gain_std: of its size, relative; nominal_phase_std: of its angle.
    power_per_inertia: mean of φ̈ θ̇ [rad²/s³], of which the lever's inertia makes the drive's mechanical power; None
    where nobody measured it.
    """

    pretension_mm: Array
    frequency_hz: Array
    repeat: NDArray[np.int64]
    columns: dict[str, Array]
    transfer: Complexes
    nominal_transfer: Complexes
    nominal_gain_std: Array
    nominal_phase_std: Array
    power_per_inertia: Array | None = None


@dataclass(frozen=True)
class _Batch:
    """Steady segments of one length: numbers, frequency [Hz] and nominal amplitude [rad] of each, (s,); numbers of
    their samples, and stamps [s], (s, n); torsion channel, drive, command (s, c, n)."""

    rows: NDArray[np.int64]
    samples: NDArray[np.int64]
    time: Array
    frequency: Array
    nominal: Array
    signal: Array


def estimate_response(recording: xr.Dataset | Signals, rig: RigSpec | None = None) -> Response:
    """Return the frequency response of all steady segments.

    recording: its steady segments carry a frequency; see `sinew.analysis.signal.harmonics.split_by_drive` for those
    that do not.
    rig: whose delay budget is undone in amplitude and phase, at each harmonic; None for perfect sensors.
    Without a nominal amplitude (a foreign recording) the measured drive takes its place. Of two groups at the same
    pretension, frequency and repeat the later counts.
    Raises RecordingError where no steady segment can be analysed.
    """
    signals = read_signals(recording, rig)
    steady = [row for row in signals.of_kind("steady") if np.isfinite(row[0].frequency_hz)]
    if not steady:
        raise RecordingError("recording has no steady segment with a drive frequency; a sweep needs at least one")
    found = list(_measured(signals, steady))
    if not found:
        raise RecordingError("every steady segment is shorter than one period of its drive; record whole periods")
    columns = {name: np.concatenate([part[name] for part in found]) for name in found[0]}
    rows = columns.pop("rows")
    if signals.rig is not None and "power_per_inertia" in columns:
        columns["drive_mechanical_w"] = signals.rig.inertia.lever.value * columns["power_per_inertia"]
    flat: dict[str, NDArray[Any]] = {}
    for name in (*_COLUMNS, *_FURTHER):
        flat[name] = np.full(len(steady), np.nan, dtype=complex if name.endswith("transfer") else float)
        if name in columns:
            flat[name][rows] = columns[name]
    return _on_grid([segment for segment, _ in steady], flat)


def _batches(signals: Signals, steady: list[tuple[Segment, slice]]) -> Iterator[_Batch]:
    """Yield the steady segments in batches of equal length; signals: torsion channel, drive, command (the last two
    where they were recorded)."""
    channels = [signals.response.values]
    if signals.drive is not None:
        channels.append(signals.drive.values)
        if "drive_command_rad" in signals.recorded and signals.drive.unit == "rad":
            channels.append(signals.recorded["drive_command_rad"])
    commanded = np.array([[segment.frequency_hz, math.radians(segment.amplitude_deg)] for segment, _ in steady])
    for rows, samples in by_length([where for _, where in steady]):
        frequency, nominal = commanded[rows].T
        sampled = np.stack([channel[samples] for channel in channels], axis=1, dtype=float)
        yield _Batch(rows, samples, signals.time_s[samples], frequency, nominal, sampled)


def _measured(signals: Signals, steady: list[tuple[Segment, slice]]) -> Iterator[dict[str, NDArray[Any]]]:
    """Yield the response columns of batches of steady segments by name, each of shape (s,).

    Among them are, of what was sensed: rows; nominal [rad]; peaks of the torsion; of a measured drive its hidden
    quantisation [rad] and figure, the lag by the Lissajous figure [rad].
    """
    response, drive, rig = signals.response, signals.drive, signals.rig
    limit = _DUTY_SHARE * (1.0 if rig is None else rig.drive.duty_limit.value)
    for batch in _batches(signals, steady):
        try:
            design = harmonic_design(batch.time, batch.frequency)
            fitted = fit_harmonics(batch.time, batch.signal, batch.frequency, design)
        except ValueError:
            continue  # too short, or too coarse, for this frequency: its place in the grid stays NaN
        sensed, harmonic = steady_torsion(batch.time, batch.signal[:, 0], fitted, response.is_rate, design)
        peaks = _mean_peaks(torsion_harmonics(fitted, response.is_rate), sensed - harmonic, design[:, 2:])
        columns = {"rows": batch.rows, "nominal": batch.nominal, "peaks": peaks}
        if drive is not None:
            columns["hidden"] = hidden_quantisation(signals.budget, batch.frequency, batch.time.shape[1])
            columns["figure"] = _figure_phase(batch, sensed)
        columns |= _motor_columns(signals, batch, limit)
        columns |= power_columns(signals, batch.time, batch.samples, batch.frequency)
        yield _columns(signals, fitted, columns)


def _columns(signals: Signals, fitted: Harmonics, measured: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the response columns of steady segments by name, each of shape (s,), those that were measured among
    them."""
    response, drive, budget, frequency = signals.response, signals.drive, signals.budget, fitted.frequency_hz
    nominal, peaks = measured["nominal"], measured["peaks"] / np.abs(torsion_chain(budget, frequency))
    order = np.arange(1, HARMONICS + 1) * frequency[:, None]
    torsion = torsion_harmonics(fitted, response.is_rate) / torsion_chain(budget, order)
    spread, own_wobble = relative_noise(fitted, 0)
    out = {**measured, "distortion": _distortion(torsion), **_settled(fitted)}
    if response.is_rate or response.unit == "rad":
        size = np.abs(torsion[:, 0])
        out |= {"amplitude_rad": size, "amplitude_std_rad": size * spread, "amplitude_peaks_rad": peaks}
    if drive is None:
        return out | _nominal_gain(torsion[:, 0], peaks, nominal, np.ones(nominal.size), spread, own_wobble)
    driven = fitted.coefficient[:, 1] / drive_chain(budget, order)
    out["drive_distortion"] = _distortion(driven)
    hidden = np.zeros(nominal.size)
    if drive.unit == "rad":
        size = np.abs(driven[:, 0])
        hidden = _ratio(measured["hidden"], size)
        spread_of_drive = np.hypot(relative_noise(fitted, 1)[0], hidden)
        out |= {"drive_amplitude_rad": size, "drive_amplitude_std_rad": size * spread_of_drive}
        out["power_per_inertia"] = -0.5 * np.nansum((2.0 * np.pi * order) ** 3 * (torsion * driven.conj()).imag, axis=1)
    else:
        nominal = np.full(nominal.size, np.nan)
    gain_std, phase_std = (np.hypot(noise, hidden) for noise in relative_noise(fitted, 0, 1))
    transfer = _ratio(torsion[:, 0], driven[:, 0])
    gain = np.abs(transfer)
    out |= {"transfer": transfer, "gain_measured_drive": gain, "gain_measured_drive_std": gain * gain_std}
    out |= {"phase_lag_rad": wrapped_lag(transfer), "phase_std_rad": phase_std}
    out["phase_delay_std_rad"] = 2.0 * np.pi * frequency * budget.delay_std_s
    late = np.angle(torsion_chain(budget, frequency) / drive_chain(budget, frequency))
    out["lissajous_phase_rad"] = wrapped_lag(np.exp(-1j * (measured["figure"] + late)))
    nominal = np.where(np.isfinite(nominal), nominal, np.abs(driven[:, 0]))
    commanded = fitted.coefficient.shape[1] == 3
    command = fitted.coefficient[:, 2, 0] if commanded else driven[:, 0]
    wobble = relative_noise(fitted, 0, 2)[1] if commanded else phase_std
    return out | _nominal_gain(torsion[:, 0], peaks, nominal, command, spread, wobble)


def _distortion(coefficient: Complexes) -> Array:
    """Return √Σ|X_h|², h = 2..5, over |X_1|, shape (s,); harmonics that could not be fitted are left out."""
    return np.asarray(_ratio(np.sqrt(np.nansum(np.abs(coefficient[:, 1:]) ** 2, axis=1)), np.abs(coefficient[:, 0])))


def _ratio(over: NDArray[Any], under: NDArray[Any]) -> NDArray[Any]:
    """Return over/under, NaN where there is nothing to divide by."""
    quotient: NDArray[Any] = np.divide(over, under, out=np.full_like(over, np.nan), where=np.abs(under) > 0)
    return quotient


def _settled(fitted: Harmonics) -> dict[str, NDArray[Any]]:
    """Return drift per period and the claim that it is small or not significant."""
    size = np.abs(fitted.coefficient[:, 0, 0])
    relative = np.asarray(_ratio(fitted.growth[:, 0], fitted.coefficient[:, 0, 0]))
    noise = np.asarray(_ratio(fitted.growth_std[:, 0], size))
    drift = np.abs(relative)
    settled = (drift <= DRIFT_THRESHOLD) | (drift <= _DRIFT_SIGNIFICANCE * noise)
    return {"drift_per_period": relative.real, "settled": np.where(np.isfinite(drift), settled.astype(float), np.nan)}


def _nominal_gain(
    torsion: Complexes, peaks: Array, nominal: Array, command: NDArray[Any], spread: Array, wobble: Array
) -> dict[str, NDArray[Any]]:
    """Return the gains over the nominal amplitude (paper Eq. 6) and the complex response at the command's phase."""
    phasor = np.where(np.isfinite(nominal), nominal, 0.0) * np.exp(1j * np.angle(command))
    return {
        "gain": _ratio(peaks, np.abs(phasor)),
        "gain_harmonic": _ratio(np.abs(torsion), np.abs(phasor)),
        "nominal_transfer": _ratio(torsion, phasor),
        "nominal_gain_std": spread,
        "nominal_phase_std": wobble,
    }


def _mean_peaks(coefficient: Complexes, beyond: Array, waves: Array) -> Array:
    """Return the mean of positive and negative peaks of the torsion as sensed (paper, section 4.1), shape (s,).

    coefficient: its harmonics, (s, h). beyond: what the samples have beyond them, (s, n). waves: cosines and sines of
    the samples' phases, (s, 2h, n).
    A crest is the mean waveform's crest plus the mean of what the samples within 0.5 rad of it, in all periods, have
    beyond that waveform: noise does not push it up, as it does the largest sample, and sampling does not cut it.
    """
    cycle = add_waves(coefficient, _CYCLE)
    each = np.arange(cycle.shape[0])
    extent = np.zeros(each.size)
    for sign, crest in ((1.0, cycle.argmax(axis=1)), (-1.0, cycle.argmin(axis=1))):
        cosine, sine = _CYCLE[::HARMONICS, crest, None]
        near = cosine * waves[:, 0] + sine * waves[:, HARMONICS] >= np.cos(_CREST)
        local = _ratio((beyond * near).sum(axis=1), np.count_nonzero(near, axis=1).astype(float))
        extent += sign * (cycle[each, crest] + local)
    return 0.5 * extent


def _figure_phase(batch: _Batch, torsion: Array) -> Array:
    """Return the lag by the Lissajous figure of a torsion (s, n), shape (s,)."""
    span = (batch.time[:, -1] - batch.time[:, 0]) * torsion.shape[1] / (torsion.shape[1] - 1)
    periods = np.maximum(1.0, np.floor(span * batch.frequency + 0.02))
    step = 2.0 * np.pi * batch.frequency * span / torsion.shape[1]
    lag = np.empty(torsion.shape[0])
    whole = np.minimum(torsion.shape[1], np.rint(2.0 * np.pi * periods / step).astype(int))
    for count in np.unique(whole):
        rows = np.flatnonzero(whole == count)
        drive = batch.signal[rows, 1, :count]
        lag[rows] = lissajous_phase(drive, torsion[rows, :count], step[rows], periods[rows])
    return lag


def _motor_columns(signals: Signals, batch: _Batch, limit: float) -> dict[str, NDArray[Any]]:
    """Return the share of samples at the duty limit and the root mean square of the drive current, where recorded."""
    out: dict[str, NDArray[Any]] = {}
    if "drive_pwm" in signals.recorded:
        saturated = np.abs(signals.recorded["drive_pwm"][batch.samples]) >= limit
        out["saturated_share"] = np.count_nonzero(saturated, axis=1) / batch.time.shape[1]
    if "drive_current_a" in signals.recorded:
        out["drive_current_rms_a"] = np.sqrt((signals.recorded["drive_current_a"][batch.samples] ** 2).mean(axis=1))
    return out


def _on_grid(steady: list[Segment], flat: dict[str, NDArray[Any]]) -> Response:
    """Return the columns of the steady segments laid out over pretension, frequency and repeat."""
    pretension, row = np.unique([segment.pretension_mm for segment in steady], return_inverse=True)
    frequency, column = np.unique([segment.frequency_hz for segment in steady], return_inverse=True)
    repeat, layer = np.unique([segment.repeat for segment in steady], return_inverse=True)
    shape = (pretension.size, frequency.size, repeat.size)
    grid: dict[str, NDArray[Any]] = {}
    for name, values in flat.items():
        grid[name] = np.full(shape, np.nan, dtype=values.dtype)
        grid[name][row, column, layer] = values
    fields = {name: grid.pop(name) for name in list(grid) if name not in _COLUMNS}
    return Response(pretension, frequency, repeat.astype(np.int64) + 1, grid, **fields)


def response_dataset(response: Response) -> xr.Dataset:
    """Return the response part of the results, with units and meanings from the result schema.

    The powers are in it where there is any.
    """
    axes = {name: getattr(response, name) for name in ("pretension_mm", "frequency_hz", "repeat")}
    has_power = bool(np.isfinite(response.columns["drive_power_w"]).any())
    columns = {name: values for name, values in response.columns.items() if has_power or name not in POWER_COLUMNS}
    variables = {name: variable_of(name, values) for name, values in columns.items()}
    return xr.Dataset(variables, {name: result_axis(name, values) for name, values in axes.items()})


# ---- saturation threshold: the pretension beyond which the gain hardly falls any more


FEWEST_PRETENSIONS = 6
_GRID = 401


@dataclass(frozen=True)
class SaturationFit:
    """A continuous line with one kink through the peak gain against pretension, beside one straight line.

    threshold_mm: the kink, its 90 % interval where the residual is within the F test's reach of the smallest.
    slope_below_per_mm, slope_above_per_mm: of the two parts.
    preferred: whether the kink is worth its two parameters (Bayesian information criterion lower by 2 or more).
    """

    threshold_mm: Estimate
    slope_below_per_mm: float
    slope_above_per_mm: float
    preferred: bool


def fit_saturation(pretension_mm: Array, gain_peak: Array) -> SaturationFit:
    """Return the saturation threshold of a campaign (paper, sections 4.1 and 5.2.4).

    pretension_mm, gain_peak: shape (p,); NaN pairs are left out.
    The kink is searched on a grid between the second and the last but one pretension, the lines by least squares.
    A kink that the data do not prefer is given all the same, with its (then wide) interval.
    Raises RecordingError below six pretensions.
    """
    valid = np.isfinite(pretension_mm) & np.isfinite(gain_peak)
    x, y = pretension_mm[valid], gain_peak[valid]
    if x.size < FEWEST_PRETENSIONS:
        raise RecordingError(
            f"a saturation threshold needs at least {FEWEST_PRETENSIONS} pretensions, found {x.size}; measure more"
        )
    order = np.argsort(x)
    x, y = x[order], y[order]
    kinks = np.linspace(x[1], x[-2], _GRID)
    residual, lines = zip(*(_line(x, y, kink) for kink in kinks), strict=True)
    squares = np.asarray(residual)
    straight, _ = _line(x, y, None)
    best = int(np.argmin(squares))
    freedom = x.size - 4
    smallest = max(float(squares[best]), 1e-24 * float(y @ y))
    reach = smallest * (1.0 + float(special.fdtri(1.0, freedom, 0.9)) / freedom)
    inside = kinks[squares <= reach]
    low, high = float(inside[0]), float(inside[-1])
    bic_gain = x.size * math.log(max(straight, smallest) / smallest) - 2.0 * math.log(x.size)
    _, below, bend = lines[best]
    threshold = Estimate(float(kinks[best]), (high - low) / (2.0 * NORMAL_90), low, high)
    return SaturationFit(threshold, below, below + bend, bic_gain >= 2.0)


def _line(x: Array, y: Array, kink: float | None) -> tuple[float, tuple[float, float, float]]:
    """Return residual sum of squares and (level, slope, bend) of a line through y, bent at the kink if there is one."""
    columns = [np.ones_like(x), x - (kink or 0.0)]
    if kink is not None:
        columns.append(np.maximum(x - kink, 0.0))
    design = np.stack(columns, axis=1)
    solution = np.linalg.lstsq(design, y, rcond=None)[0]
    residual = y - design @ solution
    level, slope, bend = (*map(float, solution), 0.0)[:3]
    return float(residual @ residual), (level, slope, bend)


# Torsion over drive becomes an ellipse, and the ellipse a phase.


@dataclass(frozen=True)
class Ellipse:
    """A Lissajous ellipse: drive = drive_amplitude·cos ψ, torsion = torsion_amplitude·cos(ψ - lag).

    drive_amplitude, torsion_amplitude: half extents, in the units of the motion.
    lag_rad: of the torsion behind the drive, positive lag, in (-π/2, 3π/2].
    area: enclosed by one period, π·drive_amplitude·torsion_amplitude·sin(lag): positive where the drive does work.
    """

    drive_amplitude: float
    torsion_amplitude: float
    lag_rad: float
    area: float

    def curve(self, points: int = 181) -> tuple[Array, Array]:
        """Return (drive, torsion) of the ellipse, closed, each of shape (points,)."""
        angle = np.linspace(0.0, 2.0 * np.pi, points)
        return self.drive_amplitude * np.cos(angle), self.torsion_amplitude * np.cos(angle - self.lag_rad)


def lissajous_phase(drive: Array, torsion: Array, step_rad: Array, periods: Array) -> Array:
    """Return the lag of figures over whole periods, (s,) from drive and torsion of shape (s, n).

    step_rad: phase between samples ΩT, shape (s,). periods: whole periods in the record, shape (s,).
    The area by the shoelace formula is π a b sin(lag) per period (a polygon on the ellipse is short by
    sin(ΩT)/(ΩT), undone here), the mean product a b cos(lag)/2; their quotient is the tangent of the lag in the right
    quadrant and, unlike arcsin(area/(π a b)), well conditioned where the lag is 90°.
    """
    x = drive - drive.mean(axis=1, keepdims=True)
    y = torsion - torsion.mean(axis=1, keepdims=True)
    area = _shoelace(x, y) * (step_rad / np.sin(step_rad)) / periods
    return wrapped_lag(2.0 / x.shape[1] * np.vecdot(x, y) - 1j * area / np.pi)


def _shoelace(x: Array, y: Array) -> Array:
    """Return ∮ x dy over closed polygons, shape (s,): positive counter-clockwise, as torsion behind drive runs."""
    inside = np.vecdot(x[:, :-1], y[:, 1:]) - np.vecdot(x[:, 1:], y[:, :-1])
    return np.asarray(0.5 * (inside + x[:, -1] * y[:, 0] - x[:, 0] * y[:, -1]))


def fit_ellipse(motion: xr.Dataset) -> Ellipse:
    """Return the ellipse of one steady motion (see `sinew.analysis.signal.attitude.steady_motion`).

    The half extents are √2 times the root mean square of each signal, the lag is that of `lissajous_phase`.
    Raises RecordingError where the recording has no drive.
    """
    if "drive" not in motion:
        raise RecordingError(
            "a Lissajous figure needs a measured drive and this recording has none; add a drive column"
        )
    x, y = motion["drive"].values[None], motion["torsion"].values[None]
    periods = np.array([float(motion.attrs["periods"])])
    lag = float(lissajous_phase(x, y, 2.0 * np.pi * periods / x.shape[1], periods)[0])
    a, b = (float(np.sqrt(2.0) * np.std(z)) for z in (x, y))
    return Ellipse(a, b, lag, float(np.pi * a * b * np.sin(lag)))
