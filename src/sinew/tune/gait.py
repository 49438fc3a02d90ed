"""How people turn in walking, and what a torso joint should do then: a band and a yaw.

Each stride is brought onto one cycle of phase. The mean over one stride, moved along, is taken off: that removes the
arbitrary zero and the drift of yaw, and nothing that repeats. What is left has a fundamental in each stride, and the
amplitude of a bout is that of their mean: noise and swings out of step do not add to it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.integrate import cumulative_simpson, cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.ndimage import find_objects, gaussian_filter1d, label, median_filter
from scipy.optimize import brentq, minimize_scalar
from scipy.signal import butter, sosfiltfilt
from scipy.special import stdtr
from vqf import offlineVQF

from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import Estimate
from sinew.measure.files.walk import Imu, MarkerPair, WalkRecord
from sinew.measure.result import Field, Result, Rows
from sinew.measure.units import STANDARD_GRAVITY

_SLOWEST_STEP_HZ = 0.4
_TALLEST_BOUNCE_M = 0.3


@dataclass(frozen=True)
class BodyMotion:
    """How pelvis and trunk turn about the vertical, and how the body goes up and down, on an even clock.

    time_s: [s], shape (n,). pelvis, trunk: yaw [rad], shape (n,), zero and slow drift arbitrary; None where unknown.
    relative: trunk against pelvis [rad], (n,); None where one is missing.
    bounce: vertical velocity [m/s], (n,), of pelvis or trunk; None where unknown.
    drifts: whether yaw may drift (inertial sensors).
    """

    time_s: Array
    pelvis: Array | None
    trunk: Array | None
    relative: Array | None
    bounce: Array | None
    drifts: bool

    @property
    def swing(self) -> tuple[str, Array]:
        """What the joint must do: trunk against pelvis, else the one that is known, with its name."""
        for name, yaw in (("trunk against pelvis", self.relative), ("pelvis", self.pelvis), ("trunk", self.trunk)):
            if yaw is not None:
                return name, yaw
        raise AssertionError("a body motion without a yaw")


def body_motion(record: WalkRecord) -> BodyMotion:
    """Return how pelvis and trunk move in a record.

    The relative yaw of two sensors is the integral of the difference of their rates about the vertical, so it needs
    neither their mounting nor a common heading. Raises RecordingError where markers are not level or are no person.
    """
    time = record.time_s
    if record.yaw is not None:
        return BodyMotion(time, None, None, np.unwrap(record.yaw), None, False)
    yaw, bounce = {}, None
    for role, body in record.bodies.items():
        name = record.names[role]
        if isinstance(body, Imu):
            yaw[role], velocity = _of_imu(time, body)
        else:
            yaw[role], velocity = _of_markers(time, body, name)
        bounce = velocity if bounce is None else bounce
    pelvis, trunk = yaw.get("pelvis"), yaw.get("trunk")
    relative = None if pelvis is None or trunk is None else trunk - pelvis
    drifts = any(isinstance(body, Imu) for body in record.bodies.values())
    if relative is not None and not drifts:
        relative = relative - 2 * np.pi * np.round(relative.mean() / (2 * np.pi))
    return BodyMotion(time, pelvis, trunk, relative, bounce, drifts)


def _of_imu(time: Array, imu: Imu) -> tuple[Array, Array]:
    """Return yaw [rad] and vertical velocity [m/s], both drifting or high-passed, shape (n,)."""
    step = float(time[1] - time[0])
    found = offlineVQF(imu.gyro, imu.acceleration, None, step)
    w, x, y, z = np.asarray(found["quat6D"]).T
    up = np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z])
    rate = np.sum(up * (imu.gyro - np.asarray(found["bias"])), axis=1)
    rise = np.sum(up * imu.acceleration, axis=1) - STANDARD_GRAVITY
    yaw = cumulative_simpson(rate, x=time, initial=0.0)
    velocity = cumulative_simpson(rise - rise.mean(), x=time, initial=0.0)
    sections = butter(2, _SLOWEST_STEP_HZ, "highpass", fs=1.0 / step, output="sos")
    return np.asarray(yaw), np.asarray(sosfiltfilt(sections, velocity, padlen=min(time.size - 1, int(2.0 / step))))


def _of_markers(time: Array, pair: MarkerPair, name: str) -> tuple[Array, Array]:
    """Return yaw [rad] and vertical velocity [m/s], shape (n,)."""
    across, middle = pair.left - pair.right, 0.5 * (pair.left + pair.right)
    length = np.median(np.linalg.norm(across, axis=1))
    tilted = float(np.median(np.abs(across[:, 2])) / length) if length > 0 else 1.0
    height = float(np.ptp(middle[:, 2]))
    if not tilted < 0.5:
        raise RecordingError(
            f"the line between markers {name} is {np.degrees(np.arcsin(min(tilted, 1.0))):.0f}° off the level in the "
            "median, expected a left and a right marker; name the pair, or the upward axis with --up"
        )
    if height > _TALLEST_BOUNCE_M:
        raise RecordingError(
            f"the markers {name} rise and fall by {height:.2g} m, expected less than {_TALLEST_BOUNCE_M:g} m in a "
            "walk; is the upward axis another (--up), or the unit (write it into the columns' names, LASI_x_mm)?"
        )
    yaw = np.unwrap(np.arctan2(across[:, 1], across[:, 0]))
    return yaw, np.gradient(middle[:, 2], time)


# The mean over strides in a row gets its uncertainty, though neighbours resemble each other.
#
# A stride's length and size carry over to the next. With few strides their likeness cannot be told from the record, and
# taking them as independent gives intervals that are too short. So the mean is taken under every first-order likeness
# from 0 to 0.9, each weighed by how well the strides speak for it (Bayes, flat in likeness, mean and log scale).


_MOST_ALIKE, _GRID = 0.9, 46
_FEWEST = 4


def mean_of_strides(values: Array) -> Estimate:
    """Return the mean of what strides in a row tell, shape (s,), with its standard deviation and 90 % interval.

    Under the likeness ρ the covariance is σ²R, R_ij = ρ^|i-j|, the variance of the plain mean is σ² 1ᵀR1/s², and σ² is
    known with s - 1 degrees of freedom. The result is the mixture over ρ of these Student distributions. Fewer than
    four values give their mean without an uncertainty.
    """
    n = values.size
    plain = float(values.mean())
    spread = float(values.std())
    if n < _FEWEST:
        return Estimate(plain, np.nan, np.nan, np.nan)
    if not spread > 1e-12 * abs(plain):
        return Estimate(plain, 0.0, plain, plain)
    x = (values - plain) / spread
    likeness = np.linspace(0.0, _MOST_ALIKE, _GRID)
    # R⁻¹ is tridiagonal: vᵀR⁻¹v = v₁² + Σ (v_i - ρ v_{i-1})² / (1 - ρ²), and |R| = (1 - ρ²)^(n-1).
    left = 1 - likeness**2
    information = 1 + (n - 1) * (1 - likeness) ** 2 / left
    middle = (x[0] + (1 - likeness) * np.sum(x[1:, None] - likeness * x[:-1, None], axis=0) / left) / information
    off = x[:, None] - middle
    squares = off[0] ** 2 + np.sum((off[1:] - likeness * off[:-1]) ** 2, axis=0) / left
    log_weight = -0.5 * ((n - 1) * np.log(left) + np.log(information) + (n - 1) * np.log(squares))
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    lag = np.arange(1, n)
    alike = (n + 2 * (n - lag) @ likeness ** lag[:, None]) / n**2
    scale = np.sqrt(alike * squares / (n - 1))
    std = float(np.sqrt(weight @ scale**2 * (n - 1) / (n - 3)))
    half = float(brentq(lambda z: float(weight @ stdtr(n - 1, z / scale)) - 0.95, 0.0, 50.0 * float(scale.max())))
    return Estimate(plain, spread * std, plain - spread * half, plain + spread * half)


FEWEST_STRIDES, _SHORTEST_STRIDES = 5, 1.5
_WINDOW_S, _HOP_S = 5.0, 0.25
_LOWEST_HZ, _HIGHEST_HZ, _STEP_HZ = 0.35, 1.7, 0.01
_REPEATS = 0.4
_LEAST_BOUNCE_M_S, _LEAST_YAW_RATE = 0.03, np.radians(2.0)
_TURNING = np.radians(20.0)
_LENGTH, _LIVELY, _STARTING = 0.2, 0.5, 2
_SMOOTHED = 0.35  # strides; what leaks in from neighbouring harmonics repeats with the stride and moves none


class _Windows(NamedTuple):
    """Windows of a record: middle [s], stride frequency [Hz], autocorrelation at one stride, shape (w,) each."""

    middle_s: Array
    frequency_hz: Array
    regularity: Array

    def within(self, start_s: float, stop_s: float) -> Mask:
        """Return which windows are between two times [s], or that the nearest one is."""
        inside = (self.middle_s >= start_s) & (self.middle_s <= stop_s)
        if not inside.any():
            inside[np.argmin(np.abs(self.middle_s - 0.5 * (start_s + stop_s)))] = True
        return inside


def _mean_within(windows: _Windows, start_s: float, stop_s: float) -> float:
    return float(windows.regularity[windows.within(start_s, stop_s)].mean())


def _windows(time: Array, rate: Array, bounce: Array | None) -> _Windows:
    step = float(time[1] - time[0])
    size = min(time.size, round(_WINDOW_S / step))
    lowest = max(_LOWEST_HZ, _SHORTEST_STRIDES / (size * step))
    if lowest >= _HIGHEST_HZ - 2 * _STEP_HZ:
        raise RecordingError(
            f"the record lasts {time[-1] - time[0]:.3g} s, too short for {_SHORTEST_STRIDES:g} strides; "
            "record ten strides or more"
        )
    candidates = np.arange(lowest, _HIGHEST_HZ, _STEP_HZ)
    first = np.arange(0, time.size - size + 1, max(1, round(_HOP_S / step)))
    signals = [rate] if bounce is None else [rate, bounce]
    score = sum(
        _shares(sliding_window_view(x, size)[first], step * (order + 1) * candidates) for order, x in enumerate(signals)
    )
    frequency = np.array([_crest(candidates, row) for row in np.asarray(score)])
    regularity = np.zeros(first.size)
    for i, at in enumerate(first):
        pieces = [x[at : at + size] for x in signals]
        if pieces[-1].std() > (_LEAST_YAW_RATE if bounce is None else _LEAST_BOUNCE_M_S):
            regularity[i] = np.mean([_autocorrelation(x, round(1.0 / (frequency[i] * step))) for x in pieces])
    smooth = median_filter(frequency, 5, mode="nearest")
    return _Windows(time[first] + 0.5 * (size - 1) * step, smooth, regularity)


def _shares(windows: Array, cycles: Array) -> Array:
    """Return the share of each window's variance (w, n) that a sine of so many cycles per sample holds, (w, f)."""
    taper = np.hanning(windows.shape[1])
    clean = taper * (windows - (windows @ taper / taper.sum())[:, None])
    angle = 2 * np.pi * np.outer(np.arange(taper.size), cycles)
    power = (clean @ np.cos(angle)) ** 2 + (clean @ np.sin(angle)) ** 2
    power *= 2.0 * np.sum(taper**2) / np.sum(taper) ** 2
    return np.asarray(power / np.maximum(np.sum(clean**2, axis=1), 1e-300)[:, None])


def _crest(at: Array, height: Array) -> float:
    """Return where a curve on an even grid is largest, by the parabola through its three highest points."""
    top = int(np.clip(np.argmax(height), 1, at.size - 2))
    before, here, after = height[top - 1 : top + 2]
    bend = before - 2 * here + after
    shift = 0.5 * (before - after) / bend if bend < 0 else 0.0
    return float(at[top] + np.clip(shift, -1, 1) * (at[1] - at[0]))


def _autocorrelation(signal: Array, lag: int) -> float:
    if signal.size - lag < 8:
        return 0.0
    a, b = signal[:-lag] - signal[:-lag].mean(), signal[lag:] - signal[lag:].mean()
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 0 else 0.0


def _cut(motion: BodyMotion, rate: Array, windows: _Windows, walking: Mask) -> tuple[Array, Mask]:
    """Return (starts of all strides [s], (s + 1,); which of the s strides are walking, lively and straight, (s,))."""
    time = motion.time_s
    step = float(time[1] - time[0])
    frequency = np.interp(time, windows.middle_s, windows.frequency_hz)
    carrier = 2 * np.pi * cumulative_trapezoid(frequency, time, initial=0)
    order, signal = (1, rate) if motion.bounce is None else (2, motion.bounce)
    width = _SMOOTHED / (float(np.median(windows.frequency_hz)) * step)
    turned = (signal - signal.mean()) * np.exp(-1j * order * carrier)
    # Under a Gaussian window, whose weight is made up for at the ends.
    weight = gaussian_filter1d(np.ones(time.size), width, mode="constant")
    slow = gaussian_filter1d(turned, width, mode="constant") / weight
    phase = carrier + np.unwrap(np.angle(slow)) / order
    phase = np.maximum.accumulate(phase) + 1e-9 * np.arange(time.size)
    whole = 2 * np.pi * np.arange(np.ceil(phase[0] / (2 * np.pi)), np.floor(phase[-1] / (2 * np.pi)) + 1)
    starts = np.interp(whole, phase, time)
    if starts.size < 2:
        return starts, np.zeros(0, dtype=bool)
    middles = 0.5 * (starts[:-1] + starts[1:])
    lively = np.interp(middles, time, np.abs(slow))
    there = np.interp(middles, time, walking.astype(float)) > 0.5
    usual = np.median(lively[there]) if there.any() else np.inf
    clear = 0.5 / float(np.median(windows.frequency_hz))  # the demodulation's window is cut off at the ends
    inside = (starts[:-1] >= time[0] + clear) & (starts[1:] <= time[-1] - clear)
    heading = motion.trunk if motion.pelvis is None else motion.pelvis
    turning = 0.0 if heading is None else np.diff(np.interp(starts, time, heading)) / np.diff(starts)
    return starts, there & inside & (lively > _LIVELY * usual) & (np.abs(turning) < _TURNING)


def _alike(period: Array) -> list[tuple[int, int]]:
    """Return the runs of at least five strides whose length is within 20 % of that of their neighbours.

    The first and the last two strides of a run are left out as far as five remain: there a walker starts and stops.
    """
    usual = median_filter(period, 2 * FEWEST_STRIDES + 1, mode="nearest")
    runs = [run for run in _runs(np.abs(period / usual - 1) < _LENGTH) if run[1] - run[0] >= FEWEST_STRIDES]
    spare = [min(_STARTING, (b - a - FEWEST_STRIDES) // 2) for a, b in runs]
    return [(a + less, b - less) for (a, b), less in zip(runs, spare, strict=True)]


def _runs(mask: Mask) -> list[tuple[int, int]]:
    """Return (first, one past the last) of each run of true values."""
    return [(run.start, run.stop) for (run,) in find_objects(label(mask)[0])]


_POINTS = 64
_AVERAGED = 5


@dataclass(frozen=True, repr=False)
class BoutGait(Result):
    """The gait of one bout.

    file: that it is in. start_s, stop_s: its ends [s]. strides: how many are in it, a whole number in a bout of five or
    more. stride_band_hz: least and greatest mean of five strides in a row. yaw_amplitude_deg: half of peak to peak of
    the fundamental of the swing (`BodyMotion.swing`). regularity: autocorrelation of the motion at one stride.
    """

    file: Annotated[str, Field("file")]
    start_s: Annotated[float, Field("from")]
    stop_s: Annotated[float, Field("to")]
    strides: Annotated[float, Field("strides")]
    stride_frequency_hz: Annotated[Estimate, Field("stride", "interval")]
    stride_band_hz: Annotated[tuple[float, float], Field("", "detail")]
    yaw_amplitude_deg: Annotated[Estimate, Field("yaw", "interval")]
    regularity: Annotated[float, Field("regularity")]


def _bout_gait(motion: BodyMotion, file: str, start_s: Array, regularity: float) -> BoutGait:
    """Return the gait of a bout of at least five strides; start_s: where each begins and the last ends [s].

    The uncertainties are those of means over strides that resemble their neighbours (`mean_of_strides`).
    """
    periods = np.diff(start_s)
    mean = mean_of_strides(periods)
    frequency = Estimate(1 / mean.value, mean.std / mean.value**2, 1 / mean.high, 1 / mean.low)
    five = 1.0 / np.convolve(periods, np.full(_AVERAGED, 1 / _AVERAGED), "valid")
    band = float(five.min()), float(five.max())
    # Of each stride the fundamental c, x = Re(c e^{jφ}), counts with its part in the mean's direction.
    first = 2 / _POINTS * np.fft.fft(np.degrees(_cycles(motion, motion.swing[1], start_s)))[:, 1]
    yaw = mean_of_strides(np.real(first * np.exp(-1j * np.angle(first.mean()))))
    return BoutGait(file, float(start_s[0]), float(start_s[-1]), periods.size, frequency, band, yaw, regularity)


def _cycles(motion: BodyMotion, yaw: Array, start_s: Array) -> Array:
    """Return the drift-free yaw of each stride over its phase, in the unit of yaw, shape (strides, 64)."""
    strides, half = start_s.size - 1, _POINTS // 2
    before, after = start_s[0] - (start_s[1] - start_s[0]), start_s[-1] + (start_s[-1] - start_s[-2])
    phase = np.arange(-half, strides * _POINTS + half + 1) / _POINTS
    time = np.interp(phase, np.arange(-1, strides + 2), np.concatenate([[before], start_s, [after]]))
    near = slice(*np.searchsorted(motion.time_s, [time[0] - 1.0, time[-1] + 1.0]))
    sampled = CubicSpline(motion.time_s[near], yaw[near])(time)
    weight = np.full(_POINTS + 1, 1.0 / _POINTS)
    weight[[0, -1]] *= 0.5
    clean = sampled[half:-half] - np.convolve(sampled, weight, "valid")
    return np.asarray(clean[:-1].reshape(strides, _POINTS))


# A record of one and a half to some strides still gives its stride frequency and yaw.
#
# Too few strides show no scatter, so their numbers come without an interval. One frequency is fitted to the whole
# stretch: harmonics of it, a level and, where yaw may drift, a slope.

_YAW_HARMONICS, _BOUNCE_HARMONICS = 3, 4
_NEAR = 0.15


def _short_gait(
    motion: BodyMotion, file: str, ends_s: tuple[float, float], near_hz: float, regularity: float
) -> BoutGait:
    """Return the gait of a stretch of walking by one fit; its uncertainties are unknown (NaN).

    The frequency is the one within 15 % of the windows' whose harmonics leave least of yaw and bounce together.
    """
    start_s, stop_s = ends_s
    inside = (motion.time_s >= start_s) & (motion.time_s <= stop_s)
    since = motion.time_s[inside] - motion.time_s[inside].mean()
    signals = [(motion.swing[1][inside], _YAW_HARMONICS)]
    if motion.bounce is not None:
        signals.append((motion.bounce[inside], _BOUNCE_HARMONICS))
    slow = [np.ones_like(since), *([since] if motion.drifts else [])]

    def fitted(frequency: float, signal: Array, harmonics: int) -> tuple[Array, Array]:
        """Return (level, slope where yaw drifts, cosine and sine of each harmonic; residual) by least squares."""
        angle = 2 * np.pi * frequency * since
        design = np.column_stack([*slow, *(f(h * angle) for h in range(1, harmonics + 1) for f in (np.cos, np.sin))])
        weights = np.linalg.lstsq(design, signal, rcond=None)[0]
        return weights, signal - design @ weights

    def left(frequency: float) -> float:
        parts = ((x, fitted(frequency, x, harmonics)[1]) for x, harmonics in signals if np.var(x) > 0)
        return sum(float(np.mean(rest**2)) / float(np.var(x)) for x, rest in parts)

    grid = np.linspace(near_hz * (1 - _NEAR), near_hz * (1 + _NEAR), 31)
    best = int(np.argmin([left(f) for f in grid]))
    ends = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    hertz = float(minimize_scalar(left, bounds=ends, method="bounded").x)
    first = fitted(hertz, *signals[0])[0][len(slow) : len(slow) + 2]
    frequency, yaw = (Estimate(one, *[math.nan] * 3) for one in (hertz, math.hypot(*np.rad2deg(first))))
    strides = (stop_s - start_s) * hertz
    return BoutGait(file, start_s, stop_s, strides, frequency, (hertz, hertz), yaw, regularity)


# What a torso joint has to do.

_LARGEST_YAW_DEG = 45.0
_REGULAR, _THROUGHOUT = 0.6, 0.8


class WalkGait(NamedTuple):
    """The gait of one record: its bouts, what swings in them (`BodyMotion.swing`), and what is in no bout [s]."""

    name: str
    swing: str
    drifts: bool
    bouts: tuple[BoutGait, ...]
    left_out_s: float


@dataclass(frozen=True, repr=False)
class GaitTarget(Result, title="mean over all strides, of two steps each"):
    """What a torso joint has to do for a gait.

    stride_frequency_hz: mean over all strides. stride_band_hz: least and greatest mean of five strides in a row.
    yaw_amplitude_deg: half of peak to peak of the fundamental, mean over all strides; yaw_band_deg: least and greatest
    of a bout. yaw_of: what turns against what. sentences: on what was left out, and on what the numbers do not say.
    """

    bouts: Annotated[Rows[BoutGait], Field("bouts: yaw, half of peak to peak at the stride frequency; 90 % intervals")]
    stride_frequency_hz: Annotated[Estimate, Field("stride frequency")]
    stride_band_hz: Annotated[tuple[float, float], Field("strides over five in a row")]
    yaw_amplitude_deg: Annotated[Estimate, Field("yaw")]
    yaw_band_deg: Annotated[tuple[float, float], Field("", "detail")]
    yaw_of: Annotated[str, Field("yaw of", "sentence")]
    strides: Annotated[float, Field("strides")]
    regularity: Annotated[float, Field("regularity")]
    sentences: Annotated[tuple[str, ...], Field("", "sentence")]


def estimate_gait(motion: BodyMotion, name: str) -> WalkGait:
    """Return the gait of a record; of one with fewer than five strides in a row the one short stretch.

    The regularity is the autocorrelation at one stride (Moe-Nilssen and Helbostad, J. Biomech. 37, 2004), here the mean
    of bounce and yaw rate. Raises RecordingError where there are no steps, where the steps of a longer record are too
    few or too uneven, and where the yaw is not a walking person's.
    """
    time, (swing, yaw) = motion.time_s, motion.swing
    rate = np.gradient(yaw, time)
    windows = _windows(time, rate, motion.bounce)
    repeats = windows.regularity >= _REPEATS
    if not repeats.any():
        raise RecordingError(
            f"no steps found between {time[0]:.4g} and {time[-1]:.4g} s: nothing repeats at a stride of "
            f"{_LOWEST_HZ:g} to {_HIGHEST_HZ:g} Hz; choose a stretch of walking with --start and --stop, or another "
            "sensor"
        )
    walking = repeats[np.rint(np.interp(time, windows.middle_s, np.arange(repeats.size))).astype(int)]
    starts, sound = _cut(motion, rate, windows, walking)
    edges = [
        starts[first + a : first + b + 1]
        for first, last in _runs(sound)
        for a, b in _alike(np.diff(starts[first : last + 1]))
    ]
    bouts = [_bout_gait(motion, name, edge, _mean_within(windows, edge[0], edge[-1])) for edge in edges]
    whole = float(time[-1] - time[0])
    if not bouts:
        first, last = max(_runs(walking), key=lambda run: run[1] - run[0])
        longest = float(time[first]), float(time[last - 1])
        length, regularity = longest[1] - longest[0], _mean_within(windows, *longest)
        hertz = float(np.median(windows.frequency_hz[windows.within(*longest) & repeats]))
        if length < _THROUGHOUT * whole or length * hertz < _SHORTEST_STRIDES or regularity < _REGULAR:
            raise RecordingError(
                f"no {FEWEST_STRIDES} strides of steady walking in a row; the longest stretch that repeats somewhat "
                f"like steps lasts {length:.3g} s of {whole:.3g} s (autocorrelation {regularity:.2f}); record ten "
                "strides straight on, or choose a stretch with --start and --stop"
            )
        bouts = [_short_gait(motion, name, longest, hertz, regularity)]
    if not (largest := max(bout.yaw_amplitude_deg.value for bout in bouts)) < _LARGEST_YAW_DEG:
        raise RecordingError(
            f"the yaw of {swing} swings by ±{largest:.3g}°, more than a walking person's {_LARGEST_YAW_DEG:g}°; "
            "check its unit (--yaw-column COL:unit, or --gyro-unit)"
        )
    left_out_s = whole - sum(bout.stop_s - bout.start_s for bout in bouts)
    return WalkGait(name, swing, motion.drifts, tuple(bouts), left_out_s)


def target_of_walks(walks: Sequence[WalkGait]) -> GaitTarget:
    """Return the target of one or several records. Raises RecordingError where their yaws are of different parts."""
    kinds = {walk.swing: walk.name for walk in walks}
    if len(kinds) > 1:
        found = " and ".join(f"{name} that of {swing}" for swing, name in kinds.items())
        raise RecordingError(f"the files hold different yaws, {found}; give files of one kind, or one part in all")
    bouts = [bout for walk in walks for bout in walk.bouts]
    strides = np.array([bout.strides for bout in bouts])
    time = strides / np.array([bout.stride_frequency_hz.value for bout in bouts])
    yaw = [bout.yaw_amplitude_deg.value for bout in bouts]
    regularity = float(strides @ np.array([bout.regularity for bout in bouts]) / strides.sum())
    return GaitTarget(
        bouts=Rows(bouts),
        stride_frequency_hz=_mean([bout.stride_frequency_hz for bout in bouts], time),
        stride_band_hz=(min(bout.stride_band_hz[0] for bout in bouts), max(bout.stride_band_hz[1] for bout in bouts)),
        yaw_amplitude_deg=_mean([bout.yaw_amplitude_deg for bout in bouts], strides),
        yaw_band_deg=(min(yaw), max(yaw)),
        yaw_of=walks[0].swing,
        strides=float(strides.sum()),
        regularity=regularity,
        sentences=tuple(_remarks(walks, bouts, regularity)),
    )


def _mean(estimates: Sequence[Estimate], weights: Array) -> Estimate:
    """Return the weighted mean of independent estimates; half widths of intervals add as standard deviations do."""
    value, std, low, high = np.array([[one.value, one.std, one.low, one.high] for one in estimates]).T
    share = weights / weights.sum()
    centre, half = float(share @ value), float(np.linalg.norm(share * 0.5 * (high - low)))
    return Estimate(centre, float(np.linalg.norm(share * std)), centre - half, centre + half)


def _remarks(walks: Sequence[WalkGait], bouts: Sequence[BoutGait], regularity: float) -> list[str]:
    """Return what was left out, and what the numbers do not say."""
    swing, left_out = walks[0].swing, sum(walk.left_out_s for walk in walks)
    rows = (
        (
            any(walk.drifts for walk in walks),
            "inertial sensors give yaw no zero, and it drifts: what is slower than a stride was taken out, and a "
            "lasting twist between the parts is not known",
        ),
        (
            swing in ("pelvis", "trunk"),
            f"only the {swing} was recorded: this is its yaw in space, not that between trunk and pelvis, which a "
            "torso joint has to make and which is larger where the two swing against each other",
        ),
        (
            any(math.isnan(bout.stride_frequency_hz.std) for bout in bouts),
            f"fewer than {FEWEST_STRIDES} strides in a row show no scatter from stride to stride, so there is no "
            f"interval and no band; record at least {FEWEST_STRIDES + 4} strides, better thirty",
        ),
        (left_out > 1.0, f"left out: {left_out:.3g} s of standing, starting, stopping, and turning (above 20°/s)"),
        (
            regularity < _REGULAR,
            f"the motion repeats poorly from stride to stride (autocorrelation {regularity:.2f}, of even walking "
            "about 0.9)",
        ),
    )
    return [sentence for holds, sentence in rows if holds]
