"""This is where a response curve gives its resonance: peak, 90° crossing and half-power width, with intervals."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sinew.analysis.rational import RationalCurve, evaluate_curve, fit_curve, parameter_spread
from sinew.analysis.repeats import Interval, combine_repeats
from sinew.analysis.response import Response, wrapped_lag
from sinew.measure.results import RESULT_VARIABLES

__all__ = ["FEWEST_FREQUENCIES", "Peak", "estimate_resonance", "find_crossing", "find_peak"]

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

FEWEST_FREQUENCIES = 6

_WINDOW_GAIN = 0.55
_WINDOW_POINTS = 8
_WINDOW_REACH = 0.6
_GRID = 2001
Reading = tuple[float, float, float]
_NAN: Reading = (math.nan, math.nan, math.nan)
_QUANTITIES = (
    "resonance_hz",
    "gain_peak",
    "resonance_measured_drive_hz",
    "gain_peak_measured_drive",
    "phase_90_hz",
    "half_power_width_hz",
    "drive_amplitude_at_resonance_rad",
)


@dataclass(frozen=True)
class Peak:
    """What one response curve says of its resonance, NaN where a reading is absent.

    Each reading is (value, standard deviation, degrees of freedom of that deviation by Welch and Satterthwaite).
    frequency_hz, gain: of the largest gain. width_hz: between the points at gain/√2. crossing_hz: where the lag
    passes 90°; crossing_slope: change of lag with frequency there [rad/Hz].
    reason: one sentence where a reading is absent, else empty.
    """

    frequency_hz: Reading = _NAN
    gain: Reading = _NAN
    width_hz: Reading = _NAN
    crossing_hz: Reading = _NAN
    crossing_slope: float = math.nan
    reason: str = ""


def _window(frequency: Floats, closeness: Floats, centre: int) -> slice:
    """Return the contiguous points around a centre whose closeness stays above the limit, at least eight."""
    low = high = centre
    reach = _WINDOW_REACH * frequency[centre]
    good = (closeness >= _WINDOW_GAIN) & (np.abs(frequency - frequency[centre]) <= reach)
    while low > 0 and good[low - 1]:
        low -= 1
    while high < frequency.size - 1 and good[high + 1]:
        high += 1
    while high - low + 1 < min(_WINDOW_POINTS, frequency.size):
        left = frequency[centre] - frequency[low - 1] if low > 0 else math.inf
        right = frequency[high + 1] - frequency[centre] if high < frequency.size - 1 else math.inf
        low, high = (low - 1, high) if left <= right else (low, high + 1)
    return slice(low, high + 1)


def _finite(frequency: Floats, response: Complexes, *stds: Floats) -> tuple[Any, ...]:
    """Return the points at which everything is known."""
    valid = np.isfinite(response) & np.all(np.isfinite(stds), axis=0)
    return frequency[valid], response[valid], *(std[valid] for std in stds)


def find_peak(frequency_hz: Floats, response: Complexes, size_std: Floats, angle_std: Floats) -> Peak:
    """Return the resonance of one complex response curve, all arguments of shape (f,), NaN points left out.

    size_std: relative standard deviation of the response's size; angle_std: of its angle [rad].
    A rational curve (`sinew.analysis.rational`) is fitted to the points around the largest gain, down to 0.55 of it;
    peak, crossing and width are read off the curve and their standard deviations propagated from its covariance.
    A largest gain at the edge of the points is no resonance: the readings are NaN and `reason` says so.
    """
    f, h, size, angle = _finite(frequency_hz, response, size_std, angle_std)
    if f.size < FEWEST_FREQUENCIES:
        return Peak(reason=f"{f.size} frequencies are too few for a resonance; measure at least {FEWEST_FREQUENCIES}")
    gain = np.abs(h)
    window = _window(f, gain / gain.max(), int(np.argmax(gain)))
    curve = fit_curve(f[window], h[window], size[window], angle[window])
    if curve is None:
        return Peak(reason="no smooth curve fits the points around the largest gain; measure more frequencies there")
    readings, inside = _read(curve)
    if not inside:
        edge = "lowest" if readings[0, 0] < curve.centre_hz else "highest"
        return Peak(reason=f"the gain is largest at the {edge} frequency of the sweep; extend the sweep beyond it")
    reason = "" if np.isfinite(readings[0, 2]) else "the sweep does not reach down to half power on both sides"
    frequency, largest, width, crossing = (_reading(readings[:, i], curve) for i in range(4))
    return Peak(frequency, largest, width, crossing, float(readings[0, 4]), reason)


def _reading(values: Floats, curve: RationalCurve) -> Reading:
    """Return (value, std, degrees of freedom) from what the curve and its 32 neighbours say, shape (33,)."""
    shares = (0.25 * (values[1:17] - values[17:]) ** 2).reshape(2, 8).sum(axis=1)
    variance = float(shares.sum())
    spent = float((shares**2 / np.asarray(curve.degrees_of_freedom)).sum())
    return float(values[0]), math.sqrt(variance), variance**2 / spent if spent > 0 else sum(curve.degrees_of_freedom)


def find_crossing(frequency_hz: Floats, response: Complexes, size_std: Floats, angle_std: Floats) -> Peak:
    """Return a Peak that holds only the 90° crossing, from a curve fitted around it instead of around the peak."""
    f, h, size, angle = _finite(frequency_hz, response, size_std, angle_std)
    lag = wrapped_lag(h)
    rising = np.flatnonzero((lag[:-1] < 0.5 * np.pi) & (lag[1:] >= 0.5 * np.pi))
    if f.size < FEWEST_FREQUENCIES or rising.size == 0:
        return Peak(reason="the lag does not pass 90° inside the sweep; extend the sweep")
    centre = int(rising[np.argmax(np.abs(h[rising]))])
    window = _window(f, np.sin(np.clip(lag, 0.0, np.pi)), centre)
    curve = fit_curve(f[window], h[window], size[window], angle[window])
    if curve is None:
        return Peak(reason="no smooth curve fits the points around the 90° crossing; measure more frequencies there")
    readings, _ = _read(curve)
    return Peak(crossing_hz=_reading(readings[:, 3], curve), crossing_slope=float(readings[0, 4]))


def _read(curve: RationalCurve) -> tuple[Floats, bool]:
    """Return peak frequency, gain, width, crossing and lag slope of the curve and its neighbours, shape (33, 5), and
    whether the curve itself has its peak inside the window."""
    v = np.linspace(curve.low, curve.high, _GRID)
    h = evaluate_curve(parameter_spread(curve), v, curve.half_width_hz / curve.centre_hz)
    gain = np.abs(h)
    rows = np.arange(gain.shape[0])
    top = np.clip(np.argmax(gain, axis=1), 1, _GRID - 2)
    before, middle, after = (gain[rows, top + i] for i in (-1, 0, 1))
    bend = before - 2.0 * middle + after
    shift = np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, -1.0), 0.0).clip(-1.0, 1.0)
    largest = middle - 0.25 * (before - after) * shift
    width = np.full(rows.size, np.nan)
    crossing, slope = np.full(rows.size, np.nan), np.full(rows.size, np.nan)
    lag = wrapped_lag(h)
    for row in rows:
        level = gain[row] - largest[row] / math.sqrt(2.0)
        left, right = _zero(-level[top[row] :: -1]), _zero(-level[top[row] :])
        width[row] = left + right
        passes = np.flatnonzero((lag[row, :-1] < 0.5 * np.pi) & (lag[row, 1:] >= 0.5 * np.pi))
        passes = passes[lag[row, passes + 1] - lag[row, passes] < 0.5 * np.pi]
        if passes.size:
            at = int(passes[np.argmin(np.abs(passes - top[row]))])
            crossing[row] = at + _zero(lag[row, at : at + 2] - 0.5 * np.pi)
            slope[row] = lag[row, at + 1] - lag[row, at]
    pitch = (v[1] - v[0]) * curve.half_width_hz
    start = curve.centre_hz + curve.low * curve.half_width_hz
    readings = np.stack(
        [start + pitch * (top + shift), largest, pitch * width, start + pitch * crossing, slope / pitch]
    )
    inside = 1 < np.argmax(gain[0]) < _GRID - 2
    return readings.T, bool(inside)


def _zero(values: Floats) -> float:
    """Return the fractional index of the first passage from below to zero, NaN where there is none."""
    above = np.flatnonzero(values >= 0)
    if above.size == 0 or above[0] == 0:
        return math.nan if above.size == 0 else 0.0
    at = int(above[0])
    return float(at - 1 - values[at - 1] / (values[at] - values[at - 1]))


def estimate_resonance(response: Response) -> xr.Dataset:
    """Return the resonance part of the results, each over pretension, with `_std`, `_low` and `_high`.

    Each repeat is fitted by itself; repeats are combined by Student's t, a single repeat keeps its fit's interval.
    gain_peak is the curve's largest gain by nominal drive times the ratio of the mean of peaks to the fundamental
    there, so that it is the paper's. The interval of phase_90_hz holds the delay budget's uncertainty too.
    Absent readings are NaN; the attribute `resonance_notes` says why, one line per pretension and repeat.
    """
    shape = (response.pretension_mm.size, response.transfer.shape[2])
    value, std, freedom = ({name: np.full(shape, np.nan) for name in _QUANTITIES} for _ in range(3))
    delay, notes = np.full(shape, np.nan), []
    for p, r in np.ndindex(*shape):
        peaks = _peaks(response, p, r)
        for name, reading in _readings(response, p, r, *peaks).items():
            value[name][p, r], std[name][p, r], freedom[name][p, r] = reading
        delay[p, r] = _delay_share(response, p, r, peaks[2])
        used = peaks[1:] if math.isfinite(peaks[0].frequency_hz[0]) else peaks  # no one asks for a nominal width
        said = " and ".join(dict.fromkeys(peak.reason for peak in used if peak.reason))
        if said and np.isfinite(response.columns["gain_harmonic"][p, :, r]).any():
            notes.append(f"{response.pretension_mm[p]:g} mm, repeat {r}: {said}")
    dataset = xr.Dataset(attrs={"resonance_notes": "\n".join(notes)})
    for name in _QUANTITIES:
        shared = _mean(delay) if name == "phase_90_hz" else 0.0
        _store(dataset, name, combine_repeats(value[name], std[name], freedom[name], shared))
    return dataset


def _peaks(response: Response, p: int, r: int) -> tuple[Peak, Peak, Peak]:
    """Return the peak by nominal drive, the peak by measured drive, and the one that holds the 90° crossing."""
    f, columns = response.frequency_hz, response.columns
    stds = (response.nominal_gain_std[p, :, r], response.nominal_phase_std[p, :, r])
    nominal = find_peak(f, response.nominal_transfer[p, :, r], *stds)
    transfer = response.transfer[p, :, r]
    relative = columns["gain_measured_drive_std"][p, :, r] / columns["gain_measured_drive"][p, :, r]
    stds = (relative, columns["phase_std_rad"][p, :, r])
    measured = find_peak(f, transfer, *stds)
    crossing = measured if math.isfinite(measured.crossing_hz[0]) else find_crossing(f, transfer, *stds)
    return nominal, measured, crossing


def _readings(response: Response, p: int, r: int, nominal: Peak, measured: Peak, crossing: Peak) -> dict[str, Reading]:
    """Return the readings of one pretension and repeat by name."""
    at = nominal.frequency_hz[0]
    columns = {name: values[p, :, r] for name, values in response.columns.items()}
    ratio, ratio_std = _local(response.frequency_hz, columns["gain"] / columns["gain_harmonic"], at)
    peak_std = math.hypot(nominal.gain[1] * ratio, nominal.gain[0] * ratio_std)
    drive = _at(response.frequency_hz, columns["drive_amplitude_rad"], at)
    drive_std = _at(response.frequency_hz, columns["drive_amplitude_std_rad"], at)
    return {
        "resonance_hz": nominal.frequency_hz,
        "gain_peak": (nominal.gain[0] * ratio, peak_std, nominal.gain[2]),
        "resonance_measured_drive_hz": measured.frequency_hz,
        "gain_peak_measured_drive": measured.gain,
        "phase_90_hz": crossing.crossing_hz,
        "half_power_width_hz": measured.width_hz,
        "drive_amplitude_at_resonance_rad": (drive, drive_std, nominal.frequency_hz[2]),
    }


def _local(frequency: Floats, values: Floats, where: float) -> tuple[float, float]:
    """Return value and standard deviation, at a frequency, of a straight line through the six nearest points."""
    valid = np.flatnonzero(np.isfinite(values))
    if not math.isfinite(where) or valid.size < 3:
        return _at(frequency, values, where), 0.0
    near = valid[np.argsort(np.abs(frequency[valid] - where))[:6]]
    design = np.stack([np.ones(near.size), frequency[near] - where], axis=1)
    inverse = np.linalg.pinv(design)
    line = inverse @ values[near]
    residual = values[near] - design @ line
    return float(line[0]), float(np.linalg.norm(inverse[0]) * np.sqrt((residual @ residual) / (near.size - 2)))


def _at(frequency: Floats, values: Floats, where: float) -> float:
    """Return a column at a frequency, linear between its finite points, NaN outside them."""
    valid = np.isfinite(values)
    if not math.isfinite(where) or not valid.any():
        return math.nan
    return float(np.interp(where, frequency[valid], values[valid], left=math.nan, right=math.nan))


def _delay_share(response: Response, p: int, r: int, crossing: Peak) -> float:
    """Return the standard uncertainty of the crossing from that of the delay [Hz]."""
    lag = _at(response.frequency_hz, response.columns["phase_delay_std_rad"][p, :, r], crossing.crossing_hz[0])
    return lag / abs(crossing.crossing_slope) if math.isfinite(lag) and crossing.crossing_slope else 0.0


def _mean(values: Floats) -> Floats:
    """Return the mean over repeats, zero where there is none."""
    valid = np.isfinite(values)
    return np.asarray(np.where(valid, values, 0.0).sum(axis=1) / np.maximum(valid.sum(axis=1), 1))


def _store(dataset: xr.Dataset, name: str, interval: Interval) -> None:
    """Put a quantity and its three companions into the dataset, under the names of the result schema."""
    unit = RESULT_VARIABLES[name].unit
    suffix = {"1": "", "Hz": "_hz", "rad": "_rad"}[unit]
    stem = name.removesuffix(suffix)
    parts = {name: interval.value, f"{stem}_std{suffix}": interval.std}
    parts |= {f"{stem}_low{suffix}": interval.low, f"{stem}_high{suffix}": interval.high}
    for key, values in parts.items():
        row = RESULT_VARIABLES[key]
        dataset[key] = (row.dims, values, {"units": unit, "long_name": row.meaning})
