"""How people turn in walking, and what a torso joint should do then: a band and a yaw.

Each stride is brought onto one cycle of phase. The mean over one stride, moved along, is taken off: that removes the
arbitrary zero and the drift of yaw, and nothing that repeats. What is left has a fundamental in each stride, and the
amplitude of a bout is that of their mean: noise and swings out of step do not add to it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.integrate import cumulative_simpson, cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d, median_filter
from scipy.optimize import brentq, minimize_scalar
from scipy.signal import butter, sosfiltfilt
from scipy.special import stdtr
from vqf import offlineVQF

from sinew.measure.arrays import Array, Complexes, Mask
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import Estimate
from sinew.measure.files.walk_file import Imu, MarkerPair, WalkRecord
from sinew.measure.units import STANDARD_GRAVITY

_SLOWEST_STEP_HZ = 0.4
_TALLEST_BOUNCE_M = 0.3
_LEAST_SPEED_M_S = 0.2


@dataclass(frozen=True)
class BodyMotion:
    """How pelvis and trunk turn about the vertical, and how the body goes up and down, on an even clock.

    time_s: [s], shape (n,). pelvis, trunk: yaw [rad], shape (n,), zero and slow drift arbitrary; None where unknown.
    relative: trunk against pelvis [rad], (n,); None where one is missing.
    bounce: vertical velocity [m/s], (n,), of pelvis or trunk; None where unknown.
    place: where the pelvis or trunk is on the ground [m], (n, 2), where markers tell it. drifts: whether yaw may drift
    (inertial sensors). given_speed_m_s: walking speed that somebody knows, NaN else.
    """

    time_s: Array
    pelvis: Array | None
    trunk: Array | None
    relative: Array | None
    bounce: Array | None
    place: Array | None
    drifts: bool
    given_speed_m_s: float = np.nan

    @property
    def swing(self) -> tuple[str, Array]:
        """What the joint must do: trunk against pelvis, else the one that is known, with its name."""
        for name, yaw in (("trunk against pelvis", self.relative), ("pelvis", self.pelvis), ("trunk", self.trunk)):
            if yaw is not None:
                return name, yaw
        raise AssertionError("a body motion without a yaw")

    def speed(self, start_s: float, stop_s: float) -> float:
        """Return the walking speed in a stretch [m/s]; NaN where unknown, or on a treadmill, where nobody moves on."""
        if self.place is None or np.isfinite(self.given_speed_m_s):
            return self.given_speed_m_s
        ends = [np.interp([start_s, stop_s], self.time_s, axis) for axis in self.place.T]
        speed = float(np.hypot(*(end[1] - end[0] for end in ends))) / (stop_s - start_s)
        return speed if speed > _LEAST_SPEED_M_S else np.nan


def body_motion(record: WalkRecord) -> BodyMotion:
    """Return how pelvis and trunk move in a record.

    The relative yaw of two sensors is the integral of the difference of their rates about the vertical, so it needs
    neither their mounting nor a common heading. Raises RecordingError where markers are not level or are no person.
    """
    time = record.time_s
    if record.yaw is not None:
        return BodyMotion(time, None, None, np.unwrap(record.yaw), None, None, False)
    yaw, bounce, place = {}, None, None
    for role, body in record.bodies.items():
        name = record.names[role]
        if isinstance(body, Imu):
            yaw[role], velocity = _of_imu(time, body)
        else:
            yaw[role], velocity, place = _of_markers(time, body, name)
        bounce = velocity if bounce is None else bounce
    pelvis, trunk = yaw.get("pelvis"), yaw.get("trunk")
    relative = None if pelvis is None or trunk is None else trunk - pelvis
    drifts = any(isinstance(body, Imu) for body in record.bodies.values())
    if relative is not None and not drifts:
        relative = relative - 2 * np.pi * np.round(relative.mean() / (2 * np.pi))
    return BodyMotion(time, pelvis, trunk, relative, bounce, place, drifts)


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


def _of_markers(time: Array, pair: MarkerPair, name: str) -> tuple[Array, Array, Array]:
    """Return yaw [rad], vertical velocity [m/s], both (n,), and the place on the ground [m], (n, 2)."""
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
    velocity = np.gradient(middle[:, 2], time)
    return yaw, velocity, middle[:, :2]


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


FEWEST_STRIDES, SHORTEST_STRIDES = 5, 1.5
_WINDOW_S, _HOP_S = 5.0, 0.25
_LOWEST_HZ, _HIGHEST_HZ, _STEP_HZ = 0.35, 1.7, 0.01
_REPEATS = 0.4
_LEAST_BOUNCE_M_S, _LEAST_YAW_RATE = 0.03, np.radians(2.0)
_TURNING = np.radians(20.0)
_LENGTH, _LIVELY, _STARTING = 0.2, 0.5, 2
_SMOOTHED = 0.35  # strides; what leaks in from neighbouring harmonics repeats with the stride and moves none


@dataclass(frozen=True)
class Strides:
    """Strides in a row. start_s: where each begins and the last ends [s], shape (strides + 1,).

    regularity: autocorrelation of the motion at one stride, the mean over the windows there.
    """

    start_s: Array
    regularity: float


@dataclass(frozen=True)
class Walk:
    """The walking in a record.

    bouts: at least five strides in a row each, in order. longest_s: ends of the longest walking stretch, be it as short
    as it may. frequency_hz, regularity: stride frequency there, by the windows alone, and its regularity.
    left_out_s: time in the record that is in no bout.
    """

    bouts: tuple[Strides, ...]
    longest_s: tuple[float, float]
    frequency_hz: float
    regularity: float
    left_out_s: float


@dataclass(frozen=True)
class _Windows:
    """Windows of a record: middle [s], stride frequency [Hz], autocorrelation at one stride, shape (w,) each."""

    middle_s: Array
    frequency_hz: Array
    regularity: Array


def find_walk(motion: BodyMotion) -> Walk:
    """Return the strides of steady walking in a record.

    The regularity is the autocorrelation at one stride (Moe-Nilssen and Helbostad, J. Biomech. 37, 2004), here the mean
    of bounce and yaw rate. Raises RecordingError where the record is too short, or nothing in it repeats as steps do.
    """
    time = motion.time_s
    rate = np.gradient(motion.swing[1], time)
    windows = _windows(time, rate, motion.bounce)
    walking = windows.regularity >= _REPEATS
    if not walking.any():
        raise RecordingError(
            f"no steps found between {time[0]:.4g} and {time[-1]:.4g} s: nothing repeats at a stride of "
            f"{_LOWEST_HZ:g} to {_HIGHEST_HZ:g} Hz; choose a stretch of walking with --start and --stop, or another "
            "sensor"
        )
    nearest = np.rint(np.interp(time, windows.middle_s, np.arange(walking.size))).astype(int)
    runs = _runs(walking[nearest])
    starts, sound = _cut(motion, rate, windows, walking[nearest])
    bouts = []
    for first, last in _runs(sound):
        for a, b in _alike(np.diff(starts[first : last + 1])):
            edge = starts[first + a : first + b + 1]
            bouts.append(Strides(edge, _mean_regularity(windows, edge[0], edge[-1])))
    longest = max(runs, key=lambda run: run[1] - run[0])
    ends = float(time[longest[0]]), float(time[longest[1] - 1])
    inside = (windows.middle_s >= ends[0]) & (windows.middle_s <= ends[1])
    frequency = float(np.median(windows.frequency_hz[inside & walking]))
    walked = sum(float(bout.start_s[-1] - bout.start_s[0]) for bout in bouts)
    left_out = float(time[-1] - time[0]) - walked
    return Walk(tuple(bouts), ends, frequency, _mean_regularity(windows, *ends), left_out)


def _windows(time: Array, rate: Array, bounce: Array | None) -> _Windows:
    step = float(time[1] - time[0])
    size = min(time.size, round(_WINDOW_S / step))
    lowest = max(_LOWEST_HZ, SHORTEST_STRIDES / (size * step))
    if lowest >= _HIGHEST_HZ - 2 * _STEP_HZ:
        raise RecordingError(
            f"the record lasts {time[-1] - time[0]:.3g} s, too short for {SHORTEST_STRIDES:g} strides; "
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


def _mean_regularity(windows: _Windows, start_s: float, stop_s: float) -> float:
    inside = (windows.middle_s >= start_s) & (windows.middle_s <= stop_s)
    if not inside.any():
        inside[np.argmin(np.abs(windows.middle_s - 0.5 * (start_s + stop_s)))] = True
    return float(windows.regularity[inside].mean())


def _cut(motion: BodyMotion, rate: Array, windows: _Windows, walking: Mask) -> tuple[Array, Mask]:
    """Return (starts of all strides [s], (s + 1,); which of the s strides are walking, lively and straight, (s,))."""
    time = motion.time_s
    step = float(time[1] - time[0])
    frequency = np.interp(time, windows.middle_s, windows.frequency_hz)
    carrier = 2 * np.pi * cumulative_trapezoid(frequency, time, initial=0)
    order, signal = (1, rate) if motion.bounce is None else (2, motion.bounce)
    width = _SMOOTHED / (float(np.median(windows.frequency_hz)) * step)
    slow = _smooth((signal - signal.mean()) * np.exp(-1j * order * carrier), width)
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
    return starts, there & inside & (lively > _LIVELY * usual) & _straight(motion, starts)


def _smooth(signal: NDArray[np.complex128], width: float) -> NDArray[np.complex128]:
    """Return a signal under a Gaussian window of so many samples, its weight made up for at the ends."""
    weight = gaussian_filter1d(np.ones(signal.size), width, mode="constant")
    real = gaussian_filter1d(signal.real, width, mode="constant")
    return np.asarray((real + 1j * gaussian_filter1d(signal.imag, width, mode="constant")) / weight)


def _straight(motion: BodyMotion, starts: Array) -> Mask:
    """Return which strides turn the body by less than 20°/s on average; all of them where no part's yaw is known."""
    heading = motion.trunk if motion.pelvis is None else motion.pelvis
    if heading is None:
        return np.ones(starts.size - 1, dtype=bool)
    turned = np.diff(np.interp(starts, motion.time_s, heading)) / np.diff(starts)
    return np.asarray(np.abs(turned) < _TURNING)


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
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


POINTS = 64
_AVERAGED = 5


@dataclass(frozen=True)
class BoutGait:
    """The gait of one bout.

    start_s, stop_s: its ends [s]. strides: how many are in it, a whole number in a bout of five or more.
    frequency_hz: of the strides; slowest_hz, fastest_hz: least and greatest mean of five strides in a row.
    yaw_deg: amplitude, half of peak to peak of the fundamental of the swing (`BodyMotion.swing`).
    line_deg: amplitude of the one sine, of constant frequency, that fits the whole bout best; smaller where the
    strides' length varies, for the sine then falls out of step. It is what a Fourier spectrum shows.
    peak_to_peak_deg: greatest less least within a stride, all harmonics. range_deg: the same over the whole bout.
    pelvis_deg, trunk_deg: amplitudes of the parts alone. trunk_lag_deg: how late the trunk is behind the pelvis, in
    degrees of the stride, -180 to 180. None where a part is unknown.
    regularity: autocorrelation of the motion at one stride. speed_m_s: NaN where unknown.
    cycles_deg: the swing of each stride from its greatest mean value on, shape (strides, 64).
    """

    start_s: float
    stop_s: float
    strides: float
    frequency_hz: Estimate
    slowest_hz: float
    fastest_hz: float
    yaw_deg: Estimate
    line_deg: float
    peak_to_peak_deg: Estimate
    range_deg: float
    pelvis_deg: Estimate | None
    trunk_deg: Estimate | None
    trunk_lag_deg: Estimate | None
    regularity: float
    speed_m_s: float
    cycles_deg: Array


def bout_gait(motion: BodyMotion, bout: Strides) -> BoutGait:
    """Return the gait of a bout of at least five strides.

    The uncertainties are those of means over strides that resemble their neighbours (`mean_of_strides`).
    """
    periods = np.diff(bout.start_s)
    mean = mean_of_strides(periods)
    frequency = Estimate(1 / mean.value, mean.std / mean.value**2, 1 / mean.high, 1 / mean.low)
    five = 1.0 / np.convolve(periods, np.full(_AVERAGED, 1 / _AVERAGED), "valid")
    swing = np.degrees(_cycles(motion, motion.swing[1], bout.start_s))
    first = fundamental(swing)
    parts = {
        name: None if yaw is None else fundamental(np.degrees(_cycles(motion, yaw, bout.start_s)))
        for name, yaw in (("pelvis", motion.pelvis), ("trunk", motion.trunk))
    }
    pelvis, trunk = parts["pelvis"], parts["trunk"]
    turn = round(-np.angle(first.mean()) / (2 * np.pi) * POINTS) % POINTS
    return BoutGait(
        start_s=float(bout.start_s[0]),
        stop_s=float(bout.start_s[-1]),
        strides=periods.size,
        frequency_hz=frequency,
        slowest_hz=float(five.min()),
        fastest_hz=float(five.max()),
        yaw_deg=_amplitude(first),
        line_deg=_line(swing, bout.start_s),
        peak_to_peak_deg=mean_of_strides(np.ptp(swing, axis=1)),
        range_deg=float(np.ptp(swing)),
        pelvis_deg=None if pelvis is None else _amplitude(pelvis),
        trunk_deg=None if trunk is None else _amplitude(trunk),
        trunk_lag_deg=None if pelvis is None or trunk is None else _lag(pelvis, trunk),
        regularity=bout.regularity,
        speed_m_s=motion.speed(float(bout.start_s[0]), float(bout.start_s[-1])),
        cycles_deg=np.roll(swing, -turn, axis=1),
    )


def unknown(value: float) -> Estimate:
    """Return a number whose uncertainty is not known."""
    return Estimate(float(value), np.nan, np.nan, np.nan)


def fundamental(cycles: Array) -> Complexes:
    """Return the complex fundamental c, x = Re(c e^{jφ}), of cycles of shape (s, points), shape (s,)."""
    points = cycles.shape[1]
    return np.asarray(2.0 / points * cycles @ np.exp(-2j * np.pi * np.arange(points) / points))


def _cycles(motion: BodyMotion, yaw: Array, start_s: Array) -> Array:
    """Return the drift-free yaw of each stride over its phase, in the unit of yaw, shape (strides, 64)."""
    strides, half = start_s.size - 1, POINTS // 2
    before, after = start_s[0] - (start_s[1] - start_s[0]), start_s[-1] + (start_s[-1] - start_s[-2])
    phase = np.arange(-half, strides * POINTS + half + 1) / POINTS
    time = np.interp(phase, np.arange(-1, strides + 2), np.concatenate([[before], start_s, [after]]))
    near = slice(*np.searchsorted(motion.time_s, [time[0] - 1.0, time[-1] + 1.0]))
    sampled = CubicSpline(motion.time_s[near], yaw[near])(time)
    weight = np.full(POINTS + 1, 1.0 / POINTS)
    weight[[0, -1]] *= 0.5
    clean = sampled[half:-half] - np.convolve(sampled, weight, "valid")
    return np.asarray(clean[:-1].reshape(strides, POINTS))


def _line(cycles: Array, start_s: Array) -> float:
    """Return the amplitude of the sine of constant frequency that fits the strides (s, points) best in time."""
    phase = np.arange(cycles.size) / cycles.shape[1]
    time = np.interp(phase, np.arange(start_s.size), start_s) - start_s[0]
    weight = np.repeat(np.diff(start_s), cycles.shape[1])  # points are even in phase, not in time
    weight /= weight.sum()
    mean = (start_s.size - 1) / (start_s[-1] - start_s[0])

    def size(frequency: float) -> float:
        return float(2.0 * np.abs(np.sum(weight * cycles.ravel() * np.exp(-2j * np.pi * frequency * time))))

    width = 1.0 / (start_s[-1] - start_s[0])
    return max(size(frequency) for frequency in np.linspace(mean - width, mean + width, 101))


def _amplitude(first: Complexes) -> Estimate:
    """Return the size of the mean fundamental; each stride counts with its part in the mean's direction."""
    return mean_of_strides(np.real(first * np.exp(-1j * np.angle(first.mean()))))


def _lag(pelvis: Complexes, trunk: Complexes) -> Estimate:
    """Return how late the trunk's fundamental is behind the pelvis's [deg]."""
    cross = pelvis * trunk.conj()
    middle = float(np.angle(cross.mean()))
    aside = mean_of_strides(np.imag(cross * np.exp(-1j * middle)) / np.abs(cross.mean()))
    value, std, low, high = np.degrees([middle, aside.std, middle + aside.low, middle + aside.high])
    return Estimate(float(value), float(std), float(low), float(high))


# A record of one and a half to some strides still gives its stride frequency and yaw.
#
# Too few strides show no scatter, so their numbers come without an interval. One frequency is fitted to the whole
# stretch: harmonics of it, a level and, where yaw may drift, a slope.

_YAW_HARMONICS, _BOUNCE_HARMONICS = 3, 4
_NEAR = 0.15


def short_gait(motion: BodyMotion, walk: Walk) -> BoutGait:
    """Return the gait of the longest stretch of walking by one fit; its uncertainties are unknown (NaN).

    The frequency is the one within 15 % of the windows' whose harmonics leave least of yaw and bounce together.
    """
    inside = (motion.time_s >= walk.longest_s[0]) & (motion.time_s <= walk.longest_s[1])
    time = motion.time_s[inside]
    since = time - time.mean()
    signals = [(motion.swing[1][inside], _YAW_HARMONICS)]
    if motion.bounce is not None:
        signals.append((motion.bounce[inside], _BOUNCE_HARMONICS))

    def left(frequency: float) -> float:
        return sum(_left(since, x, frequency, harmonics, motion.drifts) for x, harmonics in signals)

    bounds = walk.frequency_hz * (1 - _NEAR), walk.frequency_hz * (1 + _NEAR)
    grid = np.linspace(*bounds, 31)
    best = int(np.argmin([left(f) for f in grid]))
    ends = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    frequency = float(minimize_scalar(left, bounds=ends, method="bounded").x)

    def harmonics(yaw: Array | None) -> NDArray[np.complex128] | None:
        if yaw is None:
            return None
        weights, _ = _fit(since, yaw[inside], frequency, _YAW_HARMONICS, motion.drifts)
        first = 2 if motion.drifts else 1
        return np.asarray(np.rad2deg(weights[first::2]) - 1j * np.rad2deg(weights[first + 1 :: 2]))

    swing, pelvis, trunk = harmonics(motion.swing[1]), harmonics(motion.pelvis), harmonics(motion.trunk)
    assert swing is not None
    order = np.arange(1, swing.size + 1)
    turned = swing * np.exp(-1j * order * np.angle(swing[0]))
    cycle = np.real(turned @ np.exp(2j * np.pi * np.outer(order, np.arange(POINTS) / POINTS)))
    lag = None if pelvis is None or trunk is None else unknown(np.degrees(np.angle(pelvis[0] / trunk[0])))
    return BoutGait(
        start_s=float(time[0]),
        stop_s=float(time[-1]),
        strides=float((time[-1] - time[0]) * frequency),
        frequency_hz=unknown(frequency),
        slowest_hz=frequency,
        fastest_hz=frequency,
        yaw_deg=unknown(abs(swing[0])),
        line_deg=abs(swing[0]),
        peak_to_peak_deg=unknown(np.ptp(cycle)),
        range_deg=float(np.degrees(np.ptp(_level(since, motion.swing[1][inside], motion.drifts)))),
        pelvis_deg=None if pelvis is None else unknown(abs(pelvis[0])),
        trunk_deg=None if trunk is None else unknown(abs(trunk[0])),
        trunk_lag_deg=lag,
        regularity=walk.regularity,
        speed_m_s=motion.speed(float(time[0]), float(time[-1])),
        cycles_deg=cycle[None, :],
    )


def _fit(since: Array, signal: Array, frequency: float, harmonics: int, slope: bool) -> tuple[Array, Array]:
    """Return (level, slope if asked, cosine and sine of each harmonic; residual) by least squares."""
    angle = 2 * np.pi * frequency * since
    waves = [wave(h * angle) for h in range(1, harmonics + 1) for wave in (np.cos, np.sin)]
    design = np.column_stack([np.ones_like(since), *([since] if slope else []), *waves])
    weights = np.linalg.lstsq(design, signal, rcond=None)[0]
    return weights, signal - design @ weights


def _left(since: Array, signal: Array, frequency: float, harmonics: int, slope: bool) -> float:
    spread = float(np.var(signal))
    residual = _fit(since, signal, frequency, harmonics, slope)[1]
    return float(np.mean(residual**2)) / spread if spread > 0 else 0.0


def _level(since: Array, signal: Array, slope: bool) -> Array:
    """Return a signal without its straight drift, where it may drift."""
    return signal - np.polyval(np.polyfit(since, signal, 1), since) if slope else signal


# What a torso joint has to do, from walking or from numbers that somebody gives.

_LARGEST_YAW_DEG = 45.0
_REGULAR, _THROUGHOUT = 0.6, 0.8


@dataclass(frozen=True)
class WalkGait:
    """The gait of one record: its bouts, what swings in them (`BodyMotion.swing`), and what is in no bout [s]."""

    name: str
    swing: str
    drifts: bool
    bouts: tuple[BoutGait, ...]
    left_out_s: float


@dataclass(frozen=True)
class GaitTarget:
    """What a torso joint has to do for a gait.

    source: recordings or numbers. frequency_hz: mean over all strides. band_hz: least and greatest mean of five
    strides in a row. yaw_deg: amplitude, half of peak to peak of the fundamental, mean over all strides; yaw_band_deg:
    least and greatest of a bout. swing: what turns against what. strides: how many. regularity: 0 to 1, NaN where
    unknown. An uncertainty that is not known is NaN. sentences: all this in words, with what was left out.
    """

    source: Literal["recordings", "numbers"]
    frequency_hz: Estimate
    band_hz: tuple[float, float]
    yaw_deg: Estimate
    yaw_band_deg: tuple[float, float]
    swing: str
    strides: float
    regularity: float
    walks: tuple[WalkGait, ...]
    sentences: tuple[str, ...]


def estimate_gait(motion: BodyMotion, name: str) -> WalkGait:
    """Return the gait of a record; of one with fewer than five strides in a row the one short stretch.

    Raises RecordingError where there are no steps, where the steps of a longer record are too few or too uneven, and
    where the yaw is not a walking person's.
    """
    walk = find_walk(motion)
    if not walk.bouts:
        _refuse_scraps(motion, walk)
    bouts = tuple(bout_gait(motion, bout) for bout in walk.bouts) or (short_gait(motion, walk),)
    left_out = float(motion.time_s[-1] - motion.time_s[0]) - sum(bout.stop_s - bout.start_s for bout in bouts)
    swing = motion.swing[0]
    for bout in bouts:
        if not bout.yaw_deg.value < _LARGEST_YAW_DEG:
            raise RecordingError(
                f"the yaw of {swing} swings by ±{bout.yaw_deg.value:.3g}°, more than a walking person's "
                f"{_LARGEST_YAW_DEG:g}°; check the unit of the angle or the gyroscope (--yaw COL:unit, --gyro-unit)"
            )
    return WalkGait(name, swing, motion.drifts, bouts, left_out)


def _refuse_scraps(motion: BodyMotion, walk: Walk) -> None:
    """Raise RecordingError unless a walk without a bout is a short record of even walking throughout."""
    length, whole = walk.longest_s[1] - walk.longest_s[0], float(motion.time_s[-1] - motion.time_s[0])
    if length < _THROUGHOUT * whole or length * walk.frequency_hz < SHORTEST_STRIDES or walk.regularity < _REGULAR:
        raise RecordingError(
            f"no {FEWEST_STRIDES} strides of steady walking in a row; the longest stretch that repeats somewhat like "
            f"steps lasts {length:.3g} s of {whole:.3g} s (autocorrelation {walk.regularity:.2f}); record ten strides "
            "straight on, or choose a stretch with --start and --stop"
        )


def target_of_walks(walks: Sequence[WalkGait]) -> GaitTarget:
    """Return the target of one or several records. Raises RecordingError where they do not tell the same swing."""
    kinds = {walk.swing: walk.name for walk in walks}
    if len(kinds) > 1:
        found = " and ".join(f"{name} that of {swing}" for swing, name in kinds.items())
        raise RecordingError(f"the files tell different yaws, {found}; give files of one kind, or one part in all")
    bouts = [bout for walk in walks for bout in walk.bouts]
    strides, time = [bout.strides for bout in bouts], [bout.strides / bout.frequency_hz.value for bout in bouts]
    yaw = [bout.yaw_deg.value for bout in bouts]
    target = GaitTarget(
        source="recordings",
        frequency_hz=_mean([bout.frequency_hz for bout in bouts], time),
        band_hz=(min(bout.slowest_hz for bout in bouts), max(bout.fastest_hz for bout in bouts)),
        yaw_deg=_mean([bout.yaw_deg for bout in bouts], strides),
        yaw_band_deg=(min(yaw), max(yaw)),
        swing=walks[0].swing,
        strides=sum(strides),
        regularity=sum(b.regularity * n for b, n in zip(bouts, strides, strict=True)) / sum(strides),
        walks=tuple(walks),
        sentences=(),
    )
    return _told(target, bouts)


def target_of_numbers(band_hz: tuple[float, float], yaw_deg: float) -> GaitTarget:
    """Return the target that somebody gives as numbers; its uncertainties are unknown.

    band_hz: lowest and highest stride frequency [Hz]. yaw_deg: amplitude, half of peak to peak [deg].
    Raises SpecError where they are not positive or in the wrong order.
    """
    low, high = band_hz
    if not 0 < low <= high < math.inf:
        raise SpecError(f"found a stride band of {low:g} to {high:g} Hz, expected 0 < lowest <= highest, as 0.7:1.1")
    if not 0 < yaw_deg < _LARGEST_YAW_DEG:
        raise SpecError(f"found a yaw of ±{yaw_deg:g}°, expected more than 0 and less than {_LARGEST_YAW_DEG:g}°")
    band = f"{low:g} to {high:g} Hz" if low < high else f"{low:g} Hz"
    sentence = f"as asked: strides at {band}, yaw ±{yaw_deg:g}°; numbers without intervals, nothing was measured"
    middle = unknown(0.5 * (low + high))
    amplitude = (float(yaw_deg), float(yaw_deg))
    return GaitTarget(
        "numbers", middle, (low, high), unknown(yaw_deg), amplitude, "as asked", 0.0, math.nan, (), (sentence,)
    )


def _mean(estimates: Sequence[Estimate], weights: Sequence[float]) -> Estimate:
    """Return the weighted mean of independent estimates; half widths of intervals add as standard deviations do."""
    share = [weight / sum(weights) for weight in weights]

    def together(parts: Sequence[float]) -> float:
        return math.sqrt(sum((w * x) ** 2 for w, x in zip(share, parts, strict=True)))

    value = sum(w * e.value for w, e in zip(share, estimates, strict=True))
    half = together([0.5 * (e.high - e.low) for e in estimates])
    return Estimate(value, together([e.std for e in estimates]), value - half, value + half)


def _told(target: GaitTarget, bouts: Sequence[BoutGait]) -> GaitTarget:
    """Return the target with its sentences."""
    low, high = target.band_hz
    sentences = [
        f"{target.strides:.3g} strides in {len(bouts)} bout{'s' if len(bouts) > 1 else ''}: stride frequency "
        f"{_words(target.frequency_hz, 4, ' Hz')}, two steps to a stride"
        + (f"; from {low:.4g} to {high:.4g} Hz over five strides in a row" if low < high else ""),
        f"yaw of {target.swing}: amplitude {_words(target.yaw_deg, 3, '°')}, half of peak to peak of the part at the "
        "stride frequency, in the mean over the strides"
        + (f"; {target.yaw_band_deg[0]:.3g} to {target.yaw_band_deg[1]:.3g}° over the bouts" if len(bouts) > 1 else ""),
    ]
    if any(walk.drifts for walk in target.walks):
        sentences.append(
            "gravity tells nothing of yaw, so the sensors' yaw has no zero and drifts: what is slower than a stride "
            "was taken out, and a lasting twist between the parts is not known"
        )
    if target.swing in ("pelvis", "trunk"):
        sentences.append(
            f"only the {target.swing} was recorded: this is its yaw in space, not that between trunk and pelvis, which "
            "a torso joint has to make and which is larger where the two swing against each other"
        )
    short = [bout for bout in bouts if math.isnan(bout.frequency_hz.std)]
    if short:
        sentences.append(
            f"{min(bout.strides for bout in short):.2g} strides in a row show no scatter from stride to stride, so "
            f"there is no interval and no band; record at least {FEWEST_STRIDES + 4} strides, better thirty"
        )
    left_out = sum(walk.left_out_s for walk in target.walks)
    if left_out > 1.0:
        sentences.append(f"left out: {left_out:.3g} s of standing, starting, stopping, and turning (above 20°/s)")
    if target.regularity < _REGULAR:
        sentences.append(
            f"the motion repeats poorly from stride to stride (autocorrelation {target.regularity:.2f}, of even "
            "walking about 0.9); look at the figure before using the numbers"
        )
    return GaitTarget(**{**target.__dict__, "sentences": tuple(sentences)})


def _words(estimate: Estimate, digits: int, unit: str) -> str:
    value = f"{estimate.value:.{digits}g}{unit}"
    if math.isnan(estimate.low):
        return value
    return f"{value} (90 %: {estimate.low:.{digits}g} to {estimate.high:.{digits}g}{unit})"
