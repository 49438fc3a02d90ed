"""Torsion as a time series: the integral of its rate, and the motion of steady segments on one true time."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.integrate import cumulative_simpson

from sinew.analysis.signal.harmonics import HARMONICS, Harmonics, fit_harmonics, waveform
from sinew.analysis.signal.signals import Signals, drive_chain, read_signals, torsion_chain
from sinew.measure.arrays import Array, Complexes
from sinew.measure.errors import RecordingError
from sinew.plan.rig import RigSpec


def integrate_rate(time_s: Array, rate: Array) -> Array:
    """Return the integral of a rate from the first stamp on, zero there, same shape (..., n).

    Cumulative Simpson on the actual stamps. At 200 Hz and 6 Hz the trapezoidal rule makes an amplitude too small by
    (ωT)²/12 = 0.3 %, the rectangular one turns the phase by ωT/2 (2.7° at 3 Hz); Simpson errs by (ωT)⁴/180 < 1e-5.
    """
    if rate.shape[-1] < 3:
        raise RecordingError(f"cannot integrate {rate.shape[-1]} samples of a rate; record at least 3")
    return np.asarray(cumulative_simpson(rate, x=np.broadcast_to(time_s, rate.shape), axis=-1, initial=0.0))


def steady_torsion(time_s: Array, signal: Array, fitted: Harmonics, is_rate: bool) -> Array:
    """Return the torsion of steady records about its mean, as the sensors saw it, shape (s, n).

    time_s, signal: shape (s, n). fitted: harmonics of the same records, signal 0; their offset and slope are the
    bias and the drift that are removed, from a rate before it is integrated.
    """
    elapsed = time_s - fitted.reference_s[:, None]
    clean = signal - fitted.offset[:, :1] - fitted.slope[:, :1] * elapsed
    if not is_rate:
        return np.asarray(clean)
    angle = integrate_rate(time_s, clean)
    omega = 2.0 * np.pi * fitted.frequency_hz[:, None]
    order = np.arange(1, fitted.coefficient.shape[2] + 1)
    harmonic = waveform(fitted.coefficient[:, 0] / (1j * order * omega), omega * elapsed)
    return np.asarray(angle - (angle - harmonic).mean(axis=1, keepdims=True))


def steady_motion(recording: xr.Dataset | Signals, segment: int, rig: RigSpec | None = None) -> xr.Dataset:
    """Return drive, torsion and its rate over the whole periods of one steady segment, on one true time.

    The torsion's delay and attenuation at the drive frequency are undone, and so is the drive's delay: torsion and
    rate keep their samples, `time_s` says when they were true on the drive's clock, and the drive is evaluated there
    (its harmonics exactly, what they leave by linear interpolation).
    Variables over `sample`: time_s, torsion, rate, and drive where one was recorded. The units are the recording's,
    rad and rad/s for a gyroscope. Attributes: frequency_hz, periods, pretension_mm, segment.
    Raises RecordingError where the segment is not steady, has no frequency or holds no whole period.
    """
    signals = read_signals(recording, rig)
    asked, where = signals.segments[segment]
    frequency = asked.frequency_hz
    if asked.kind != "steady" or not np.isfinite(frequency):
        raise RecordingError(
            f"segment {segment} is {asked.kind} at {frequency:g} Hz; choose a steady one with a frequency"
        )
    response, drive, budget = signals.response, signals.drive, signals.budget
    stamps = signals.time_s[where]
    both = np.stack([c.values[where] for c in (response, drive or response)])
    try:
        fitted = fit_harmonics(stamps[None], both[None], np.array([frequency]))
    except ValueError as error:
        raise RecordingError(f"segment {segment} is too short: {error}") from error
    periods = int((stamps[-1] - stamps[0] + 1.0 / budget.sample_hz) * frequency + 0.02)
    if periods < 1:
        raise RecordingError(f"segment {segment} holds no whole period at {frequency:g} Hz; record longer")
    torsion = steady_torsion(stamps[None], both[None, 0], fitted, response.is_rate)[0]
    rate = np.gradient(torsion, stamps)
    if response.is_rate:
        rate = both[0] - fitted.offset[0, 0] - fitted.slope[0, 0] * (stamps - fitted.reference_s[0])
    chain = complex(torsion_chain(budget, frequency))
    late = -float(np.angle(chain * np.conj(complex(drive_chain(budget, frequency))))) / (2.0 * np.pi * frequency)
    whole = stamps < stamps[0] + periods / frequency - 0.25 / budget.sample_hz
    unit = "rad" if response.is_rate else response.unit
    variables = {
        "time_s": ("sample", (stamps - late)[whole], {"units": "s"}),
        "torsion": ("sample", torsion[whole] / abs(chain), {"units": unit}),
        "rate": ("sample", rate[whole] / abs(chain), {"units": f"{unit}/s"}),
    }
    if drive is not None:
        value = _evaluate(stamps, both[1], fitted, (stamps - late)[whole])
        variables["drive"] = ("sample", value, {"units": drive.unit})
    attrs = {"frequency_hz": frequency, "periods": periods, "pretension_mm": asked.pretension_mm, "segment": segment}
    return xr.Dataset(variables, attrs=attrs)


def _evaluate(stamps: Array, signal: Array, fitted: Harmonics, time_s: Array) -> Array:
    """Return signal 1 of a fitted record at other times (n,): its harmonics there plus its residual, interpolated."""

    def harmonic(time: Array) -> Array:
        omega = 2.0 * np.pi * fitted.frequency_hz[0]
        return np.asarray(waveform(fitted.coefficient[:, 1], omega * (time - fitted.reference_s[0]))[0])

    return np.asarray(harmonic(time_s) + np.interp(time_s, stamps, signal - harmonic(stamps)))


# The lever's waveform is measured: its fundamental, and the odd harmonics of a drive at its limit.


@dataclass(frozen=True)
class LeverMotion:
    """The measured lever over pretension and frequency, mean over the repeats.

    θ = a sin τ + Re Σ a s_h exp(jhτ), h odd and above one: amplitude a [rad], shape (p, f), NaN where nothing was
    measured; orders (h,); shares s_h, complex, shape (p, f, h), zero where they could not be resolved.
    """

    pretension_mm: Array
    frequency_hz: Array
    amplitude: Array
    orders: NDArray[np.int64]
    shares: Complexes


def measure_lever(recording: xr.Dataset, rig: RigSpec | None = None) -> LeverMotion:
    """Return how the lever moved in the steady segments of a recording.

    rig: whose delay of the encoder is undone; None for a perfect one. Segments that are too short for their frequency
    are left out. Raises RecordingError where no angle of the lever was recorded.
    """
    signals = read_signals(recording, rig)
    drive = signals.drive
    if drive is None or drive.unit != "rad":
        raise RecordingError("the recording has no angle of the lever; record drive_rad, or compare by the command")
    steady = [row for row in signals.of_kind("steady") if np.isfinite(row[0].frequency_hz)]
    pretension, row = np.unique([segment.pretension_mm for segment, _ in steady], return_inverse=True)
    frequency, column = np.unique([segment.frequency_hz for segment, _ in steady], return_inverse=True)
    found = np.zeros((pretension.size, frequency.size, HARMONICS), dtype=complex)
    count = np.zeros((pretension.size, frequency.size))
    starts, sizes = (np.array(ends) for ends in ([w.start for _, w in steady], [w.stop - w.start for _, w in steady]))
    for size in np.unique(sizes):
        mine = np.flatnonzero(sizes == size)
        samples = starts[mine][:, None] + np.arange(size)
        hertz = frequency[column[mine]]
        try:
            fitted = fit_harmonics(signals.time_s[samples], drive.values[samples][:, None], hertz)
        except ValueError:
            continue
        order = np.arange(1, HARMONICS + 1) * hertz[:, None]
        waves = np.nan_to_num(fitted.coefficient[:, 0] / drive_chain(signals.budget, order))
        turned = waves * np.exp(-1j * np.arange(1, HARMONICS + 1) * (np.angle(waves[:, :1]) + np.pi / 2))
        np.add.at(found, (row[mine], column[mine]), turned)
        np.add.at(count, (row[mine], column[mine]), 1)
    mean = np.divide(found, count[..., None], out=np.full_like(found, np.nan), where=count[..., None] > 0)
    amplitude = np.abs(mean[..., 0])
    orders = np.arange(3, HARMONICS + 1, 2)
    shares = np.divide(
        mean[..., orders - 1],
        amplitude[..., None],
        out=np.zeros_like(mean[..., orders - 1]),
        where=amplitude[..., None] > 0,
    )
    return LeverMotion(pretension, frequency, amplitude, orders, np.nan_to_num(shares))
