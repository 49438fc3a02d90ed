"""Coupling of torsion and sway: what the head of a bent joint does in each direction, by drive and by torsion.

Of each steady segment the attitude gives three channels: the torsion, and the tilt away from the pose in the plane of
the bend and out of it (`sinew.measure.attitude`). Their harmonics are fitted together with the drive's. A channel's
response is its fundamental over the drive's; its coupling ratio is its fundamental over the torsion's, size and lag;
and twice the drive's frequency is where a bend answers a torsion that goes both ways: in the plane of the bend the
first harmonic is small, and the second tells.

The interval of an amplitude near its own noise reaches to zero: noise alone makes an amplitude of a channel that does
not move, and in nine cases of ten the interval holds that nothing, too.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from scipy import special

from sinew.analysis.results import CouplingRow
from sinew.analysis.signal.attitude import Attitude, read_attitude
from sinew.analysis.signal.harmonics import Harmonics, fit_harmonics, relative_noise
from sinew.analysis.signal.repeats import combine_repeats, variable_of
from sinew.analysis.signal.signals import RestPose, Signals, drive_chain, torsion_chain
from sinew.measure.arrays import Array, Complexes, mean_of_known, wrapped_lag
from sinew.measure.attitude import tilt_from, torsion_of, turned_about_x
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import Estimate, finite
from sinew.measure.recording import CHANNELS, RESULT_VARIABLES, Segment, result_axis
from sinew.measure.result import Rows

TORSION, IN_PLANE, OUT_OF_PLANE = range(3)
"""Places of the channels; their names are `sinew.measure.recording.CHANNELS`."""

_DRIVE = 3
_FREEDOM = 16.0
"""Degrees of freedom of a standard deviation by eight sidebands, complex ones."""
_FREEDOM_OF_HARMONIC = 24.0
"""Of one by the twelve lines beside a harmonic."""


@dataclass(frozen=True)
class _Of:
    """What one steady segment says, by channel, (3,): phasors of the fundamental by drive and by torsion, with relative
    standard deviation of their size and standard deviation of their angle; amplitude of fundamental and second harmonic
    [rad] with theirs; mean [rad]."""

    amplitude: Array
    amplitude_std: Array
    gain: Complexes
    gain_noise: Array
    coupling: Complexes
    coupling_noise: Array
    second: Complexes
    second_std: Array
    mean: Array


def analyse_coupling(signals: Signals) -> xr.Dataset:
    """Return the coupling part of the results over pretension, frequency, repeat and channel.

    signals: of a head that bends or sways. Without a drive that was measured the response by drive is NaN. Segments
    that are too short for their frequency are NaN. Raises RecordingError where nothing tells the attitude, the drives
    differ, or no steady segment can be analysed.
    """
    pose, attitude = signals.pose, read_attitude(signals)
    if pose is None:
        raise RecordingError("the head of this recording is upright and only turns; nothing couples")
    if attitude is None:
        raise RecordingError(
            "nothing tells how the head leans: expected a recorded orientation, or gyroscope and accelerometer"
        )
    steady = [row for row in signals.of_kind("steady") if np.isfinite(row[0].frequency_hz)]
    drives = sorted({segment.excitation for segment, _ in steady})
    if len(drives) != 1:
        raise RecordingError(f"found steady segments driven by {' and '.join(drives) or 'nothing'}, expected one drive")
    found: list[tuple[Segment, _Of]] = []
    for segment, where in steady:
        try:
            found.append((segment, _analyse_segment(signals, attitude, pose, segment, where)))
        except ValueError:
            continue  # too short, or too coarse, for this frequency: its place in the grid stays NaN
    if not found:
        raise RecordingError("no steady segment holds a whole period of its drive with a known attitude; record longer")
    return _on_grid(found, [segment for segment, _ in steady], drives[0])


def _analyse_segment(signals: Signals, attitude: Attitude, pose: RestPose, segment: Segment, where: slice) -> _Of:
    """Return what one steady segment says. Raises ValueError where it is too short, or its attitude is not known."""
    time, frequency = signals.time_s[where], np.array([segment.frequency_hz])
    orientation = attitude.orientation[where]
    if not np.isfinite(orientation).all():
        raise ValueError("the attitude is not known")
    if not attitude.is_recorded:  # the torsion swings about zero: its offset and slope are the filter's heading
        torsion = fit_harmonics(time[None], torsion_of(orientation)[None, None], frequency)
        heading = torsion.offset[0, 0] + torsion.slope[0, 0] * (time - torsion.reference_s[0])
        orientation = turned_about_x(orientation, -heading)
    channels = [torsion_of(orientation), *tilt_from(orientation, pose.bend, pose.azimuth).T]
    drive = _drive(signals, segment, where)
    fitted = fit_harmonics(time[None], np.stack([*channels, *([] if drive is None else [drive])])[None], frequency)
    order = np.arange(1, fitted.coefficient.shape[2] + 1) * frequency[0]
    chain = np.ones(order.size) if attitude.is_recorded else torsion_chain(signals.budget, order)
    wave = fitted.coefficient[0, :_DRIVE] / chain
    # Without a drive the channel that moves most is the clock; the second harmonic is seen from twice its phase.
    clock, gain, gain_noise = wave[np.abs(wave[:, 0]).argmax(), 0], np.full(3, np.nan + 0j), np.full((3, 2), np.nan)
    if drive is not None and np.abs(fitted.coefficient[0, _DRIVE, 0]) > 0:
        late = drive_chain(signals.budget, frequency[0]) if segment.excitation == "lever" else 1.0
        clock = fitted.coefficient[0, _DRIVE, 0] / late
        gain, gain_noise = wave[:, 0] / clock, _noises(fitted, _DRIVE)
    coupling = _over(wave[:, 0], wave[TORSION, 0])
    coupling[TORSION] = 1.0
    second = _over(wave[:, 1] * abs(clock) ** 2, clock**2)
    return _Of(
        np.abs(wave[:, 0]),
        fitted.std[0, :_DRIVE, 0],
        gain,
        gain_noise,
        coupling,
        _noises(fitted, TORSION),
        second,
        fitted.std[0, :_DRIVE, 1],
        fitted.offset[0, :_DRIVE],
    )


def _over(waves: Complexes, by: complex) -> Complexes:
    """Return waves over another one, NaN where that is none."""
    return waves / by if abs(by) > 0 else np.full_like(waves, np.nan)


def _noises(fitted: Harmonics, reference: int) -> Array:
    """Return of each channel over the reference the relative noise of the size and the noise of the angle, (3, 2)."""
    rows = [relative_noise(fitted, c, reference) if c != reference else (np.zeros(1), np.zeros(1)) for c in range(3)]
    return np.array([[float(size[0]), float(angle[0])] for size, angle in rows])


def _drive(signals: Signals, segment: Segment, where: slice) -> Array | None:
    """Return what drives: the lever's angle [rad], or the cable that the tendons take up against one another [mm].

    The latter is the amplitude of the pattern in the motors' measured angles, whose tendons stand evenly on their
    circle, the first at y: 2/N Σ w_i s_i with w the weights of pitch or roll. None where it was not measured.
    """
    if segment.excitation == "lever":
        return None if signals.drive is None or signals.drive.unit != "rad" else signals.drive.values[where]
    if signals.rig is None or "tendon_rad" not in signals.recorded:
        return None
    cable = np.asarray(signals.recorded["tendon_rad"], dtype=float)[where] * signals.rig.tendons.pulley_radius.value
    turn = 2.0 * np.pi * np.arange(cable.shape[1]) / cable.shape[1]
    weights = np.cos(turn) if segment.excitation == "roll" else -np.sin(turn)
    return np.asarray(2e3 / cable.shape[1] * (cable @ weights))


def _on_grid(found: list[tuple[Segment, _Of]], steady: list[Segment], excitation: str) -> xr.Dataset:
    names = ("pretension_mm", "frequency_hz", "repeat")
    marks = {name: np.unique([getattr(segment, name) for segment in steady]) for name in names}
    shape = (*(axis.size for axis in marks.values()), len(CHANNELS))
    columns = {name: np.full(shape, np.nan) for name in _CHANNEL_COLUMNS}
    for segment, of in found:
        at = tuple(int(np.searchsorted(axis, getattr(segment, name))) for name, axis in marks.items())
        for name, phasor, noise in (
            ("channel", of.gain, of.gain_noise),
            ("coupling", of.coupling, of.coupling_noise),
        ):
            size = "channel_gain" if name == "channel" else "coupling_ratio"
            columns[size][at], columns[f"{size}_std"][at] = np.abs(phasor), np.abs(phasor) * noise[:, 0]
            columns[f"{name}_lag_rad"][at], columns[f"{name}_lag_std_rad"][at] = wrapped_lag(phasor), noise[:, 1]
        columns["channel_amplitude_rad"][at], columns["channel_amplitude_std_rad"][at] = of.amplitude, of.amplitude_std
        columns["second_harmonic_rad"][at], columns["second_harmonic_std_rad"][at] = np.abs(of.second), of.second_std
        columns["second_harmonic_lag_rad"][at], columns["channel_mean_rad"][at] = wrapped_lag(of.second), of.mean
    variables = {name: variable_of(name, values) for name, values in columns.items()}
    for name in ("channel_gain", "channel_gain_std"):
        variables[name].attrs["units"] = "1" if excitation == "lever" else "rad/mm"
    axes = marks | {"repeat": marks["repeat"] + 1, "channel": np.array(CHANNELS, dtype=object)}
    coordinates = {name: result_axis(name, values) for name, values in axes.items()}
    return xr.Dataset(variables, coordinates, attrs={"coupling_drive": excitation})


_BY_DRIVE = ("channel_gain", "channel_gain_std", "channel_lag_rad", "channel_lag_std_rad")
_BY_TORSION = ("coupling_ratio", "coupling_ratio_std", "coupling_lag_rad", "coupling_lag_std_rad")
_SECOND = ("second_harmonic_rad", "second_harmonic_std_rad", "second_harmonic_lag_rad")
_CHANNEL_COLUMNS = tuple(
    name for name, row in RESULT_VARIABLES.items() if row.dims[-1] == "channel" and len(row.dims) > 1
)


# The mean over the repeats is one of phasors: sizes alone would not cancel what noise makes of nothing.


def _mean_phasor(
    size: Array, size_std: Array, lag: Array, lag_std: Array, *, freedom: float = _FREEDOM
) -> tuple[Estimate, Estimate]:
    """Return size and lag [rad] of the mean of phasors over repeats, arrays (r,), NaN left out."""
    known = np.isfinite(size) & np.isfinite(lag)
    if not known.any():
        nothing = Estimate(math.nan, math.nan, math.nan, math.nan)
        return nothing, nothing
    size, size_std, lag, lag_std = (values[known] for values in (size, size_std, lag, lag_std))
    phasors = size * np.exp(-1j * lag)
    mean = complex(phasors.mean())
    turned = phasors * np.exp(-1j * np.angle(mean))
    along = combine_repeats(turned.real, size_std, freedom)
    across = combine_repeats(turned.imag, size * lag_std, freedom)
    # Of a phasor that is nothing but noise, |mean|²/(2 s²) has Fisher's F of 2 and ν degrees of freedom.
    count = phasors.size
    both = math.hypot(float(along.std_of_value), float(across.std_of_value)) / math.sqrt(2.0)
    noise, nu = (both, 2.0 * count - 2.0) if count > 1 else (float(along.std_of_value), freedom)
    low = 0.0 if abs(mean) < math.sqrt(2.0 * special.fdtri(2.0, nu, 0.9)) * noise else max(float(along.low), 0.0)
    amplitude = Estimate(abs(mean), float(along.std_of_value), low, float(along.high))
    middle = float(wrapped_lag(np.array([mean]))[0])
    if not abs(mean) > 0:
        return amplitude, Estimate(math.nan, math.nan, math.nan, math.nan)
    half = float(across.high - across.low) / 2.0 / abs(mean)
    return amplitude, Estimate(middle, float(across.std_of_value) / abs(mean), middle - half, middle + half)


def _mean_size(size: Array, std: Array, lag: Array) -> Estimate:
    """Return the mean of phasors [rad] in degrees; of their sizes, where no lag is known."""
    lag = lag if np.isfinite(lag).any() else np.zeros_like(lag)
    with np.errstate(divide="ignore", invalid="ignore"):
        return _degrees(_mean_phasor(size, std, lag, std / size, freedom=_FREEDOM_OF_HARMONIC)[0])


def coupling_rows(results: xr.Dataset) -> Rows[CouplingRow]:
    """Return the coupling table, one row for each pretension, frequency and channel."""
    values = {name: results[name].values for name in _CHANNEL_COLUMNS}
    by_drive = "gain" if results["channel_gain"].attrs["units"] == "1" else "gain_rad_mm"
    rows = []
    for p, f, c in np.ndindex(*(results.sizes[name] for name in ("pretension_mm", "frequency_hz", "channel"))):
        of = {name: array[p, f, :, c] for name, array in values.items()}
        repeats = int(np.isfinite(of["channel_amplitude_rad"]).sum())
        if not repeats:
            continue
        gain, lag = _mean_phasor(*(of[name] for name in _BY_DRIVE))
        row: dict[str, Any] = {
            "pretension_mm": float(results["pretension_mm"].values[p]),
            "frequency_hz": float(results["frequency_hz"].values[f]),
            "channel": str(results["channel"].values[c]),
            "repeats": repeats,
            "amplitude_deg": _mean_size(
                of["channel_amplitude_rad"], of["channel_amplitude_std_rad"], of["channel_lag_rad"]
            ),
            by_drive: gain,
            "phase_lag_deg": _degrees(lag),
        }
        if c != TORSION:
            ratio, behind = _mean_phasor(*(of[name] for name in _BY_TORSION))
            row |= {"coupling_ratio": ratio, "lag_behind_torsion_deg": _degrees(behind)}
        row["second_harmonic_deg"] = _mean_size(*(of[name] for name in _SECOND))
        row["mean_deg"] = finite(math.degrees(float(mean_of_known(of["channel_mean_rad"]))))
        rows.append(CouplingRow(**row))
    return Rows(rows)


def _degrees(of: Estimate) -> Estimate:
    return of.times(math.degrees(1.0))
