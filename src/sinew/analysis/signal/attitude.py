"""Attitude of the head over a recording: as it was recorded, or as gyroscope and accelerometer tell it.

Without a recorded orientation the filter vqf (Laidig and Seel, 2023, without magnetometer; forwards and backwards)
tells it: the gyroscope is integrated, its bias estimated, and the accelerometer leant on over three seconds. What
that is good for:

- What swings is the gyroscope's, and as good as that: its delay and its low-pass are those of the torsion, and are
  undone with the harmonics. The accelerometer has no say above a tenth of a hertz, so that the head's own
  acceleration, which at 4 Hz looks like ten degrees of tilt, averages out.
- Where the head leans on average is the accelerometer's: good to about half a degree in a record of some seconds, worse
  where the head swings all the time, for what a swing does to a chip off the axis does not average out (it is taken out
  where a rig says how far off the chip is).
- The turn about gravity is seen by no such filter. Of an upright or a bent head it is the torsion's rest, which is held
  to be zero: a line through the torsion of each stretch is taken for drift. A twist that stays is therefore not seen.
- The base is held to stand upright, with the x axis of frame B against gravity, and not to move.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sinew.analysis.signal.harmonics import HARMONICS, Harmonics, add_waves, fit_harmonics, harmonic_design, waveform
from sinew.analysis.signal.signals import Channel, Signals, by_length, drive_chain, read_signals, torsion_chain
from sinew.measure.arrays import Array, Complexes
from sinew.measure.attitude import quaternion
from sinew.measure.errors import RecordingError
from sinew.measure.recording import Excitation
from sinew.plan.rig import RigSpec

_EARTH_TO_BASE = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
"""The filter's earth has z upwards, the base has x."""

_SHORTEST = 16
_GAP_STEPS = 3.0


@dataclass(frozen=True)
class Attitude:
    """Orientation of H against B, unit quaternions (n, 4); NaN where a stretch is too short to tell.

    is_recorded: whether it was measured; else the filter told it, and the torsion's rest is a line through it.
    """

    orientation: Array
    is_recorded: bool


def read_attitude(signals: Signals) -> Attitude | None:
    """Return the attitude of the head over a recording, None where neither it nor what tells it was recorded.

    Stretches without a gap between their samples are filtered by themselves.
    """
    if "orientation" in signals.recorded:
        return Attitude(np.asarray(signals.recorded["orientation"], dtype=float), True)
    if not {"gyro_rad_s", "acceleration_m_s2"} <= set(signals.recorded):
        return None
    gyro = np.asarray(signals.recorded["gyro_rad_s"], dtype=float)
    force = np.asarray(signals.recorded["acceleration_m_s2"], dtype=float)
    step = 1.0 / signals.budget.sample_hz
    found = np.full((gyro.shape[0], 4), np.nan)
    for start, stop in _stretches(signals):
        if stop - start >= _SHORTEST:
            found[start:stop] = _filtered(
                gyro[start:stop], _on_axis(gyro[start:stop], force[start:stop], signals), step
            )
    return Attitude(found, False)


_TILTS: dict[str, int] = {"pitch": 1, "impulse-pitch": 1, "roll": 2, "impulse-roll": 2}
"""About which axis of frame B what moves the head tilts it."""


def tilting(signals: Signals, excitation: Excitation) -> Signals | None:
    """Return the ring-downs of one excitation with the rate of the tilt that it excites for their response.

    That rate is the gyroscope's about y (pitch) or z (roll) of B, seen from the head in its pose. None where there
    are no such decays, or no gyroscope.
    """
    decays = signals.moved_by(excitation)
    if (
        signals.pose is None
        or "gyro_rad_s" not in signals.recorded
        or not any(True for _ in decays.of_kind("ring-down"))
    ):
        return None
    stands = quaternion(0.0, signals.pose.bend, signals.pose.azimuth)
    gyro = np.asarray(signals.recorded["gyro_rad_s"], dtype=float)
    rate = scipy.spatial.transform.Rotation.from_quat(stands[0], scalar_first=True).apply(gyro)[:, _TILTS[excitation]]
    return replace(decays, response=Channel(np.ascontiguousarray(rate), "rad/s", True), drive=None)


def _stretches(signals: Signals) -> list[tuple[int, int]]:
    """Return (first, last + 1) of the samples that follow one another without a gap; a group of a plan is one."""
    time = signals.time_s
    # A group begins where a settle or an idle record does; what comes before it ended with a pause, or with another
    # swing.
    begins = {0, time.size} | {where.start for segment, where in signals.segments if segment.kind in ("settle", "idle")}
    steps = np.diff(time)
    begins |= set((np.flatnonzero((steps <= 0) | (steps > _GAP_STEPS / signals.budget.sample_hz)) + 1).tolist())
    marks = sorted(begins)
    return list(pairwise(marks))


def _filtered(gyro: Array, force: Array, step_s: float) -> Array:
    from vqf import offlineVQF  # a recording of an upright head does without

    # The filter turns by the rate of a sample over the step before it, which alone would be half a step too early
    # (2.7° at 3 Hz and 200 samples a second): it gets the mean of the rate over that step, by the cubic through four
    # samples.
    far = np.pad(gyro, ((2, 1), (0, 0)), mode="edge")
    mean = (13.0 * (far[1:-2] + far[2:-1]) - far[:-3] - far[3:]) / 24.0
    found = offlineVQF(np.ascontiguousarray(mean), np.ascontiguousarray(force), None, step_s)
    here = Rotation.from_matrix(_EARTH_TO_BASE) * Rotation.from_quat(np.asarray(found["quat6D"]), scalar_first=True)
    return np.asarray(here.as_quat(scalar_first=True))


def _on_axis(gyro: Array, force: Array, signals: Signals) -> Array:
    """Return what the accelerometer would read on the joint's axis, (n, 3): less α x p + ω x (ω x p) of a chip at p."""
    if signals.rig is None:
        return force
    lever_arm = np.array([0.0, signals.rig.imu.mount_radius.value, 0.0])
    speeding = np.gradient(gyro, 1.0 / signals.budget.sample_hz, axis=0)
    return np.asarray(force - np.cross(speeding, lever_arm) - np.cross(gyro, np.cross(gyro, lever_arm)))


# ---- torsion as a time series: the integral of its rate, and the motion of steady segments on one true time


def integrate_rate(time_s: Array, rate: Array) -> Array:
    """Return the integral of a rate from the first stamp on, zero there, same shape (..., n).

    Cumulative Simpson on the actual stamps. At 200 Hz and 6 Hz the trapezoidal rule makes an amplitude too small by
    (ωT)²/12 = 0.3 %, the rectangular one turns the phase by ωT/2 (2.7° at 3 Hz); Simpson errs by (ωT)⁴/180 < 1e-5.
    """
    if rate.shape[-1] < 3:
        raise RecordingError(f"cannot integrate {rate.shape[-1]} samples of a rate; record at least 3")
    return np.asarray(
        scipy.integrate.cumulative_simpson(rate, x=np.broadcast_to(time_s, rate.shape), axis=-1, initial=0.0)
    )


def steady_torsion(
    time_s: Array, signal: Array, fitted: Harmonics, is_rate: bool, design: Array | None = None
) -> tuple[Array, Array]:
    """Return the torsion of steady records about its mean, as the sensors saw it, and its harmonics, (s, n) each.

    time_s, signal: shape (s, n). fitted: harmonics of the same records, signal 0; their offset and slope are the
    bias and the drift that are removed, from a rate before it is integrated. design: `harmonic_design` of the records,
    from whoever needs it further.
    """
    design = harmonic_design(time_s, fitted.frequency_hz) if design is None else design
    elapsed = time_s - fitted.reference_s[:, None]
    clean = signal - fitted.offset[:, :1] - fitted.slope[:, :1] * elapsed
    harmonic = add_waves(torsion_harmonics(fitted, is_rate), design[:, 2:])
    if not is_rate:
        return clean, harmonic
    angle = integrate_rate(time_s, clean)
    angle -= (angle - harmonic).mean(axis=1, keepdims=True)
    return angle, harmonic


def torsion_harmonics(fitted: Harmonics, is_rate: bool) -> Complexes:
    """Return the harmonics of the torsion as the sensors saw it, (s, h), by those of signal 0, itself or its rate."""
    order = np.arange(1, HARMONICS + 1)
    return fitted.coefficient[:, 0] / (2j * np.pi * order * fitted.frequency_hz[:, None] if is_rate else 1.0)


def steady_motion(recording: xr.Dataset | Signals, segment: int, rig: RigSpec | None = None) -> xr.Dataset:
    """Return drive and torsion over the whole periods of one steady segment, on one true time.

    The torsion's delay and attenuation at the drive frequency are undone, and so is the drive's delay: the torsion
    keeps its samples, `time_s` says when they were true on the drive's clock, and the drive is evaluated there (its
    harmonics exactly, what they leave by linear interpolation).
    Variables over `sample`: time_s, torsion, and drive where one was recorded. The units are the recording's, rad for
    a gyroscope. Attributes: frequency_hz, periods, pretension_mm, segment.
    Raises RecordingError where the segment is not steady, has no frequency or holds no whole period.
    """
    signals = read_signals(recording, rig)
    planned, where = signals.segments[segment]
    frequency = planned.frequency_hz
    if planned.kind != "steady" or not np.isfinite(frequency):
        raise RecordingError(
            f"segment {segment} is {planned.kind} at {frequency:g} Hz; choose a steady one with a frequency"
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
    torsion = steady_torsion(stamps[None], both[None, 0], fitted, response.is_rate)[0][0]
    chain = complex(torsion_chain(budget, frequency))
    late = -float(np.angle(chain * np.conj(complex(drive_chain(budget, frequency))))) / (2.0 * np.pi * frequency)
    whole = stamps < stamps[0] + periods / frequency - 0.25 / budget.sample_hz
    unit = "rad" if response.is_rate else response.unit
    variables = {
        "time_s": ("sample", (stamps - late)[whole], {"units": "s"}),
        "torsion": ("sample", torsion[whole] / abs(chain), {"units": unit}),
    }
    if drive is not None:
        value = _evaluate(stamps, both[1], fitted, (stamps - late)[whole])
        variables["drive"] = ("sample", value, {"units": drive.unit})
    attrs = {
        "frequency_hz": frequency,
        "periods": periods,
        "pretension_mm": planned.pretension_mm,
        "segment": segment,
    }
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
    for mine, samples in by_length([where for _, where in steady]):
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
