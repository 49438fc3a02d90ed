"""This is where an oscillation shows its positive and negative peaks, noise or not."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import interpolate, signal

from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError

_DIFFERENCES = 5
_LARGE_SWING = 0.2  # of the largest swing: swings that set the half period
_SAMPLES_PER_HALF = 24  # aimed at where a record has fewer than half of it
_SMALL_SWING = 0.004  # of the range: below it a swing is no peak even in a record without noise


@dataclass(frozen=True)
class Peaks:
    """Alternating peaks of an oscillation, in order of time.

    time_s, value: shape (h,); a peak's value is that of a parabola through the samples around it, unit of the signal.
    half_period_s: median spacing of the large peaks [s].
    noise: standard deviation of the noise of one sample, unit of the signal.
    value_std: the same of one peak's value.
    """

    time_s: Array
    value: Array
    half_period_s: float
    noise: float
    value_std: float

    @property
    def swing(self) -> Array:
        """Return the distances between neighbouring peaks, shape (h - 1,)."""
        return np.abs(np.diff(self.value))

    def between(self, start_s: float, stop_s: float) -> "Peaks":
        """Return the peaks with start_s <= time <= stop_s."""
        inside = (self.time_s >= start_s) & (self.time_s <= stop_s)
        return Peaks(self.time_s[inside], self.value[inside], self.half_period_s, self.noise, self.value_std)


def noise_level(values: Array) -> float:
    """Return the standard deviation of the white noise in a smooth, well sampled signal.

    The median size of fifth differences is taken, which a smooth signal hardly reaches; it is at least that of the
    resolution, step/sqrt(12).
    """
    steps = np.abs(np.diff(values))
    steps = steps[steps > 0]
    resolution = float(steps.min()) / np.sqrt(12.0) if steps.size else 0.0
    if values.size < 4 * _DIFFERENCES:
        return resolution
    gain = np.sqrt(252.0)  # root of the sum of squared binomials of the fifth difference
    white = 1.4826 * float(np.median(np.abs(np.diff(values, _DIFFERENCES)))) / gain
    return float(max(white, resolution))


def find_peaks(time_s: Array, values: Array) -> Peaks:
    """Return the alternating peaks of a signal that are larger than its noise.

    time_s, values: shape (n,), evenly sampled.

    Peaks of raw samples are too many and too large, which halves a damping taken from them. Here a first look finds the
    half period; then a cubic filter without phase (Savitzky-Golay over 0.6 half periods) finds the peaks and the
    vertex of the parabola through each. The filter takes 0.3 % off a sine, the same share of each peak. Where a half
    period has fewer than 12 samples, a cubic spline refines the record first.
    Raises RecordingError where there is no oscillation above the noise.
    """
    span = float(np.ptp(values))
    noise = noise_level(values)
    if span <= 1e-12 * max(1.0, float(np.abs(values).max())):
        raise RecordingError("the response is constant; a ring-down needs an oscillation (is it the right column?)")
    half_period = _half_period(time_s, values, noise, span)
    step = float(time_s[-1] - time_s[0]) / (time_s.size - 1)
    finer = int(np.ceil(_SAMPLES_PER_HALF * step / half_period)) if half_period < 0.5 * _SAMPLES_PER_HALF * step else 1
    if finer > 1:
        coarse = time_s
        time_s = np.linspace(coarse[0], coarse[-1], finer * (coarse.size - 1) + 1)
        values = interpolate.CubicSpline(coarse, values)(time_s)
        step /= finer
    window = min(2 * int(0.3 * half_period / step) + 1, time_s.size - (1 - time_s.size % 2))
    smooth, slope, curve = (signal.savgol_filter(values, window, 3, deriv=k, delta=step) for k in range(3))
    rough = 1.4826 * float(np.median(np.abs(values - smooth)))
    noise = max(noise, rough)
    value_std = noise * min(1.0, 1.5 / np.sqrt(window / finer))
    index = _alternating(smooth, max(5.0 * value_std, _SMALL_SWING * span))
    shift = np.clip(-slope[index] / np.where(curve[index] == 0, np.inf, curve[index]), -step, step)
    return Peaks(time_s[index] + shift, smooth[index] + 0.5 * slope[index] * shift, half_period, noise, value_std)


def _half_period(time_s: Array, values: Array, noise: float, span: float) -> float:
    length = int(np.clip(np.ceil((30.0 * noise / span) ** 2), 1, max(1, values.size // 20)))
    smooth = np.convolve(values, np.ones(length) / length, mode="valid") if length > 1 else values
    index = _alternating(smooth, max(7.0 * noise / np.sqrt(length), 0.02 * span))
    if index.size < 2:
        raise RecordingError(
            f"no oscillation found: {index.size} peaks stand out of the noise, at least 3 half cycles are needed; "
            "choose another column or a longer stretch"
        )
    swings = np.abs(np.diff(smooth[index]))
    large = swings >= _LARGE_SWING * swings.max()
    return float(np.median(np.diff(time_s[index])[large]))


def _alternating(values: Array, prominence: float) -> NDArray[np.intp]:
    """Return the indices of maxima and minima in turn; of neighbours of one kind the more extreme stays."""
    tops = signal.find_peaks(values, prominence=prominence)[0]
    bottoms = signal.find_peaks(-values, prominence=prominence)[0]
    index = np.concatenate([tops, bottoms])
    sign = np.concatenate([np.ones(tops.size), -np.ones(bottoms.size)])
    order = np.argsort(index)
    index, sign = index[order], sign[order]
    kept: list[int] = []
    signs: list[float] = []
    for i, s in zip(index, sign, strict=True):
        if signs and signs[-1] == s:
            if s * (values[i] - values[kept[-1]]) > 0:
                kept[-1] = int(i)
            continue
        kept.append(int(i))
        signs.append(float(s))
    return np.asarray(kept, dtype=np.intp)
