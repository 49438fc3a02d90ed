"""Amplitude, gain and phase of steady segments, over pretension, frequency and repeat."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sinew.analysis.signal.harmonics import Harmonics, fit_harmonics, relative_noise, waveform
from sinew.analysis.signal.power import power_columns, read_power
from sinew.analysis.signal.signals import Signals, drive_chain, hidden_quantisation, read_signals, torsion_chain
from sinew.analysis.signal.torsion import steady_torsion
from sinew.analysis.sweep.portrait import lissajous_phase
from sinew.measure.arrays import Array, Complexes, wrapped_lag
from sinew.measure.errors import RecordingError
from sinew.measure.recording import Segment
from sinew.measure.schema import POWER_COLUMNS, RESULT_VARIABLES, result_axis
from sinew.plan.rig import RigSpec

DRIFT_THRESHOLD = 0.005
"""A group is settled if the relative change of its complex amplitude per period is below this, or below its noise."""

_DRIFT_SIGNIFICANCE = 3.0
_DUTY_SHARE = 0.99
_CREST = 0.5

_COLUMNS = tuple(
    name for name, row in RESULT_VARIABLES.items() if row.dims == ("pretension_mm", "frequency_hz", "repeat")
)


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

    recording: its steady segments carry a frequency; see `sinew.analysis.signal.groups.split_by_drive` for those that
    do not.
    rig: whose delay budget is undone in amplitude and phase, at each harmonic; None for perfect sensors.
    Without a nominal amplitude (a foreign recording) the measured drive takes its place. Of two groups at the same
    pretension, frequency and repeat the later counts.
    Raises RecordingError where no steady segment can be analysed.
    """
    signals = read_signals(recording, rig)
    steady = [row for row in signals.of_kind("steady") if np.isfinite(row[0].frequency_hz)]
    if not steady:
        raise RecordingError("recording has no steady segment with a drive frequency; a sweep needs at least one")
    rig, power = signals.rig, read_power(signals)
    limit = _DUTY_SHARE * (1.0 if rig is None else rig.drive.duty_limit.value)
    flat: dict[str, NDArray[Any]] = {name: np.full(len(steady), np.nan) for name in _COLUMNS}
    for name in ("transfer", "nominal_transfer"):
        flat[name] = np.full(len(steady), np.nan + 0j)
    for name in ("nominal_gain_std", "nominal_phase_std", "power_per_inertia"):
        flat[name] = np.full(len(steady), np.nan)
    analysed = 0
    for batch in _batches(signals, steady):
        try:
            columns = _analyse_batch(signals, batch)
        except ValueError:
            continue  # too short, or too coarse, for this frequency: its place in the grid stays NaN
        analysed += batch.rows.size
        columns |= _motor_columns(signals, batch, limit)
        columns |= power_columns(power, batch.time, batch.samples, batch.frequency)
        if rig is not None and "power_per_inertia" in columns:
            columns["drive_mechanical_w"] = rig.inertia.lever.value * columns["power_per_inertia"]
        for name, values in columns.items():
            flat[name][batch.rows] = values
    if not analysed:
        raise RecordingError("every steady segment is shorter than one period of its drive; record whole periods")
    return _on_grid([segment for segment, _ in steady], flat)


def _batches(signals: Signals, steady: list[tuple[Segment, slice]]) -> Iterator[_Batch]:
    """Yield the steady segments in batches of equal length; signals: torsion channel, drive, command (the last two
    where they were recorded)."""
    channels = [signals.response.values]
    if signals.drive is not None:
        channels.append(signals.drive.values)
        if "drive_command_rad" in signals.recorded and signals.drive.unit == "rad":
            channels.append(signals.recorded["drive_command_rad"].astype(float))
    sizes = np.array([where.stop - where.start for _, where in steady])
    for size in np.unique(sizes):
        rows = np.flatnonzero(sizes == size)
        samples = np.array([steady[row][1].start for row in rows])[:, None] + np.arange(size)
        frequency, nominal = np.array([[steady[i][0].frequency_hz, steady[i][0].amplitude_deg] for i in rows]).T
        sampled = np.stack([channel[samples] for channel in channels], axis=1)
        yield _Batch(rows, samples, signals.time_s[samples], frequency, np.deg2rad(nominal), sampled)


def _analyse_batch(signals: Signals, batch: _Batch) -> dict[str, NDArray[Any]]:
    """Return the response columns of one batch by name, each of shape (s,)."""
    response, drive, budget, nominal = signals.response, signals.drive, signals.budget, batch.nominal
    fitted = fit_harmonics(batch.time, batch.signal, batch.frequency)
    order = np.arange(1, fitted.coefficient.shape[2] + 1) * batch.frequency[:, None]
    torsion = (
        fitted.coefficient[:, 0] / torsion_chain(budget, order) / (2j * np.pi * order if response.is_rate else 1.0)
    )
    peaks = _mean_peaks(batch, fitted, response.is_rate) / np.abs(torsion_chain(budget, batch.frequency))
    spread, own_wobble = relative_noise(fitted, 0)
    out = {"distortion": _distortion(torsion), **_settled(fitted)}
    if response.is_rate or response.unit == "rad":
        size = np.abs(torsion[:, 0])
        out |= {"amplitude_rad": size, "amplitude_std_rad": size * spread, "amplitude_peaks_rad": peaks}
    if drive is None:
        return out | _nominal_gain(torsion[:, 0], peaks, nominal, np.ones(batch.rows.size), spread, own_wobble)
    driven = fitted.coefficient[:, 1] / drive_chain(budget, order)
    out["drive_distortion"] = _distortion(driven)
    hidden = np.zeros(nominal.size)
    if drive.unit == "rad":
        size = np.abs(driven[:, 0])
        hidden = _ratio(hidden_quantisation(budget, batch.frequency, batch.time.shape[1]), size)
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
    out["phase_delay_std_rad"] = 2.0 * np.pi * batch.frequency * budget.delay_std_s
    late = np.angle(torsion_chain(budget, batch.frequency) / drive_chain(budget, batch.frequency))
    out["lissajous_phase_rad"] = _figure_phase(batch, fitted, response.is_rate, late)
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


def _mean_peaks(batch: _Batch, fitted: Harmonics, is_rate: bool) -> Array:
    """Return the mean of positive and negative peaks of the torsion as sensed (paper, section 4.1), shape (s,).

    A crest is the mean waveform's crest plus the mean of what the samples within 0.5 rad of it, in all periods, have
    beyond that waveform: noise does not push it up, as it does the largest sample, and sampling does not cut it.
    """
    angle = steady_torsion(batch.time, batch.signal[:, 0], fitted, is_rate)
    omega = 2.0 * np.pi * batch.frequency[:, None]
    order = np.arange(1, fitted.coefficient.shape[2] + 1)
    coefficient = fitted.coefficient[:, 0] / (1j * order * omega if is_rate else 1.0)
    phase = omega * (batch.time - fitted.reference_s[:, None])
    beyond = angle - waveform(coefficient, phase)
    grid = 2.0 * np.pi * np.arange(720) / 720
    cycle = waveform(coefficient, grid)
    extent = np.zeros(batch.rows.size)
    for sign in (1.0, -1.0):
        crest = np.argmax(sign * cycle, axis=1)
        near = np.cos(phase - grid[crest][:, None]) >= np.cos(_CREST)
        local = np.asarray(_ratio((beyond * near).sum(axis=1), near.sum(axis=1).astype(float)))
        extent += sign * (np.take_along_axis(cycle, crest[:, None], axis=1)[:, 0] + local)
    return 0.5 * extent


def _figure_phase(batch: _Batch, fitted: Harmonics, is_rate: bool, late: Array) -> Array:
    """Return the lag by the Lissajous figure, shape (s,), less what the chain's phase `late` [rad] (s,) makes of it."""
    torsion = steady_torsion(batch.time, batch.signal[:, 0], fitted, is_rate)
    span = (batch.time[:, -1] - batch.time[:, 0]) * torsion.shape[1] / (torsion.shape[1] - 1)
    periods = np.maximum(1.0, np.floor(span * batch.frequency + 0.02))
    step = 2.0 * np.pi * batch.frequency * span / torsion.shape[1]
    lag = np.empty(torsion.shape[0])
    whole = np.minimum(torsion.shape[1], np.rint(2.0 * np.pi * periods / step).astype(int))
    for count in np.unique(whole):
        rows = np.flatnonzero(whole == count)
        drive = batch.signal[rows, 1, :count]
        lag[rows] = lissajous_phase(drive, torsion[rows, :count], step[rows], periods[rows])
    return wrapped_lag(np.exp(-1j * (lag + late)))


def _motor_columns(signals: Signals, batch: _Batch, limit: float) -> dict[str, NDArray[Any]]:
    """Return the share of samples at the duty limit and the root mean square of the drive current, where recorded."""
    out: dict[str, NDArray[Any]] = {}
    if "drive_pwm" in signals.recorded:
        out["saturated_share"] = (np.abs(signals.recorded["drive_pwm"][batch.samples]) >= limit).mean(axis=1)
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
    variables = {}
    has_power = bool(np.isfinite(response.columns["drive_power_w"]).any())
    columns = {name: values for name, values in response.columns.items() if has_power or name not in POWER_COLUMNS}
    for name, values in columns.items():
        row = RESULT_VARIABLES[name]
        variables[name] = (row.dims, values, {"units": row.unit, "long_name": row.meaning})
    return xr.Dataset(variables, {name: result_axis(name, values) for name, values in axes.items()})
