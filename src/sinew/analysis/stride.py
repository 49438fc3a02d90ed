"""This is where a record is cut into strides, and what is no steady walking is left out.

Yaw repeats with every stride, the bounce of the body with every step, two to a stride. In windows of five seconds the
stride frequency is the one at which both are largest together; it carries a demodulation whose phase then tells each
stride. A stride is walking where the motion repeats, about as long and as lively as the others, and without a turn.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import gaussian_filter1d, median_filter

from sinew.analysis.body_yaw import BodyMotion
from sinew.measure.errors import RecordingError

__all__ = ["FEWEST_STRIDES", "SHORTEST_STRIDES", "Strides", "Walk", "find_walk"]

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

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

    start_s: Floats
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

    middle_s: Floats
    frequency_hz: Floats
    regularity: Floats


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


def _windows(time: Floats, rate: Floats, bounce: Floats | None) -> _Windows:
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


def _shares(windows: Floats, cycles: Floats) -> Floats:
    """Return the share of each window's variance (w, n) that a sine of so many cycles per sample holds, (w, f)."""
    taper = np.hanning(windows.shape[1])
    clean = taper * (windows - (windows @ taper / taper.sum())[:, None])
    angle = 2 * np.pi * np.outer(np.arange(taper.size), cycles)
    power = (clean @ np.cos(angle)) ** 2 + (clean @ np.sin(angle)) ** 2
    power *= 2.0 * np.sum(taper**2) / np.sum(taper) ** 2
    return np.asarray(power / np.maximum(np.sum(clean**2, axis=1), 1e-300)[:, None])


def _crest(at: Floats, height: Floats) -> float:
    """Return where a curve on an even grid is largest, by the parabola through its three highest points."""
    top = int(np.clip(np.argmax(height), 1, at.size - 2))
    before, here, after = height[top - 1 : top + 2]
    bend = before - 2 * here + after
    shift = 0.5 * (before - after) / bend if bend < 0 else 0.0
    return float(at[top] + np.clip(shift, -1, 1) * (at[1] - at[0]))


def _autocorrelation(signal: Floats, lag: int) -> float:
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


def _cut(motion: BodyMotion, rate: Floats, windows: _Windows, walking: Mask) -> tuple[Floats, Mask]:
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


def _straight(motion: BodyMotion, starts: Floats) -> Mask:
    """Return which strides turn the body by less than 20°/s on average; all of them where no part's yaw is known."""
    heading = motion.trunk if motion.pelvis is None else motion.pelvis
    if heading is None:
        return np.ones(starts.size - 1, dtype=bool)
    turned = np.diff(np.interp(starts, motion.time_s, heading)) / np.diff(starts)
    return np.asarray(np.abs(turned) < _TURNING)


def _alike(period: Floats) -> list[tuple[int, int]]:
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
