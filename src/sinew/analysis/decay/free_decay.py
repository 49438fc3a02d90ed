"""The free decay in a record: its peaks, and where it begins, found and fitted, whatever came before it."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from sinew.analysis.decay.decay_fit import (
    DecayFit,
    fit_bent,
    fit_decay,
    fit_decay_and_rest,
)
from sinew.measure.arrays import Array, Mask, robust_std
from sinew.measure.errors import RecordingError, TimeError
from sinew.measure.validation import as_numbers, as_seconds

Places = NDArray[np.intp]


def _turns(values: Array) -> tuple[Places, Array]:
    """Return places and heights of both ends and of all extremes between, in turn; of a flat one its middle."""
    start = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0]))
    stop = np.append(start[1:], values.size) - 1
    rises = np.diff(values[start]) > 0
    retained = np.concatenate([[True], rises[1:] != rises[:-1], [True]]) if start.size > 1 else np.ones(1, dtype=bool)
    return ((start + stop) // 2)[retained], values[start][retained]


def maxima(values: Array) -> Places:
    """Return the places of the maxima of a signal of shape (n,), without its ends; of a flat one its middle."""
    return np.asarray(scipy.signal.find_peaks(values)[0])


def alternating_extremes(values: Array, least: float) -> Places:
    """Return the places of maxima and minima in turn whose prominence is `least` or more, without the ends.

    values: shape (n,). A maximum's prominence is what the signal falls by on both sides before it rises above it; of
    equal maxima with no such fall between them the first stays. Neighbours that differ by less than `least`, and by
    less than either differs from its other neighbour, take each other out; that leaves all other prominences as they
    are. SciPy's `find_peaks` searches the whole rest of a decay for each of its swings: 42 s for 13 000 of them in a
    million samples, where this takes 0.9 s.
    """
    turns_at, height = _turns(values)
    while turns_at.size > 2:
        step = np.abs(np.diff(height))
        no_more = np.append(step[1:], np.inf) > step  # than the next
        no_less = np.concatenate([[np.inf], step[:-1]]) >= step
        small = step < least
        if not small.any():
            break
        retained = np.ones(turns_at.size, dtype=bool)
        # An end has no neighbour to go with: the extreme beside it becomes the end.
        retained[: int(np.argmin(np.append(small & no_more, False)))] = False
        retained[turns_at.size - int(np.argmin(np.append((small & no_less)[::-1], False))) :] = False
        inner = small & no_more & no_less & retained[:-1] & retained[1:]
        inner[[0, -1]] = False
        retained[:-1] &= ~inner
        retained[1:] &= ~inner
        turns_at, height = turns_at[retained], height[retained]
    return turns_at[1:-1]


def local_cubic(values: Array, window: int, step_s: float) -> tuple[Array, Array, Array]:
    """Return value, slope [1/s] and curvature [1/s²] of the cubic through the samples around each, (n,) (n,) (n,).

    values: shape (n,), evenly sampled; window: of how many samples, odd, from 5 to n (Savitzky and Golay's filter). So
    near an end that there are fewer on one side, the cubic through the window at that end tells.
    """
    value, slope, curvature = (
        scipy.signal.savgol_filter(values, window, 3, deriv=order, delta=step_s) for order in range(3)
    )
    return value, slope, curvature


_DIFFERENCES = 5
_LARGE_SWING = 0.2  # of the largest swing: swings that set the half period
_AIMED_PER_HALF = 24  # aimed at where a record has fewer than half of it
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
    white = robust_std(np.diff(values, _DIFFERENCES)) / gain
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
    half_period = first_half_period(time_s, values, noise)
    step = float(time_s[-1] - time_s[0]) / (time_s.size - 1)
    finer = int(np.ceil(_AIMED_PER_HALF * step / half_period)) if half_period < 0.5 * _AIMED_PER_HALF * step else 1
    if finer > 1:
        coarse = time_s
        time_s = np.linspace(coarse[0], coarse[-1], finer * (coarse.size - 1) + 1)
        values = scipy.interpolate.CubicSpline(coarse, values)(time_s)
        step /= finer
    window = min(2 * int(0.3 * half_period / step) + 1, time_s.size - (1 - time_s.size % 2))
    smooth, slope, curve = local_cubic(values, window, step)
    rough = robust_std(values - smooth)
    noise = max(noise, rough)
    value_std = noise * min(1.0, 1.5 / np.sqrt(window / finer))
    index = alternating_extremes(smooth, max(5.0 * value_std, _SMALL_SWING * span))
    shift = np.clip(-slope[index] / np.where(curve[index] == 0, np.inf, curve[index]), -step, step)
    return Peaks(time_s[index] + shift, smooth[index] + 0.5 * slope[index] * shift, half_period, noise, value_std)


def first_half_period(time_s: Array, values: Array, noise: float) -> float:
    """Return the median spacing of the large peaks of a signal [s]; arguments and errors as of `find_peaks`.

    noise: `noise_level` of the values.
    """
    span = float(np.ptp(values))
    if span <= 1e-12 * max(1.0, float(np.abs(values).max())):
        raise RecordingError("the response is constant; a ring-down needs an oscillation (is it the right column?)")
    length = int(np.clip(np.ceil((30.0 * noise / span) ** 2), 1, max(1, values.size // 20)))
    smooth = np.convolve(values, np.ones(length) / length, mode="valid") if length > 1 else values
    index = alternating_extremes(smooth, max(7.0 * noise / np.sqrt(length), 0.02 * span))
    if index.size < 2:
        raise RecordingError(
            f"no oscillation found: {index.size} peaks stand out of the noise, at least 3 half cycles are needed; "
            "choose another column or a longer stretch"
        )
    swings = np.abs(np.diff(smooth[index]))
    large = swings >= _LARGE_SWING * swings.max()
    return float(np.median(np.diff(time_s[index])[large]))


# The free decay begins: after a rest, a hold, a hand's release or a forced oscillation.


_BEFORE, _AFTER = 6, 8  # swings looked at on both sides of a possible stop of the drive
_FLAT = 0.35  # forced: before the stop the swings shrink by less than this share of what they do after it
_LEVEL = 0.15  # and the first of them is larger by this at most, in its logarithm: dry friction steepens too,
_LEVEL_EACH = 0.04  # and by this for each of them
_EVIDENCE = 20.0  # fall of chi² that a kink must bring, against one straight line
_TOLERANCE = 0.02  # relative scatter of swings that is no evidence of anything
_LONG = 1.8  # times the next half period: longer than any free swing but one from the top of a pendulum
_STILL = 0.25  # of a swing: less motion in the half cycle before is a hold
_STEEP = 2.5  # times the shrinking that follows
_DRIVE_NOISE = 10.0  # times its noise: a drive that moves less has not moved
_ROUND_OFF = 1e-9  # of a swing: of a steady motion's, which are equal but for it, the first counts
_LAST_DRIVE_SWING = 0.3  # of the largest: smaller swings of the drive are parasitic motion after its stop


def first_free_peak(time_s: Array, values: Array, peaks: Peaks) -> int:
    """Return the index of the first peak from which the oscillation decays freely.

    time_s, values: shape (n,), the signal the peaks were found in.

    Without anything before it that is the start of the largest swing. Behind a forced oscillation it is the kink of
    the logarithm of the swings, from level or growing to shrinking (two straight lines against one, the last such kink
    of large swings). Behind a hold or a release by hand the swing out of the hold is left out: the release takes time.
    """
    swing = peaks.swing
    first = int(np.argmax(swing >= (1.0 - _ROUND_OFF) * swing.max()))
    kink = _kink(swing, np.sqrt(2.0) * peaks.value_std)
    if kink is not None:
        first = max(first, kink)
    while first + 2 < swing.size and _is_released(time_s, values, peaks, first):
        first += 1
    return first


def _kink(swing: Array, noise: float) -> int | None:
    """Return the index of the first peak surely behind the last evident kink of the swings' logarithm, or None.

    A drive that stops at peak j leaves swing j - 1 whole and swing j between whole and shrunk, so the lines meet near
    j - 1/2. The kink is sought in steps of a half and rounded up by one peak: half a cycle lost can be won back by
    agreement with the fit, one that was driven spoils it.
    """
    found: int | None = None
    best = _EVIDENCE
    logs = np.log(np.maximum(swing, 1e-300))
    weight = 1.0 / np.hypot(noise / np.maximum(swing, 1e-300), _TOLERANCE)
    for kink in np.arange(1.5, swing.size - 1.5, 0.5):
        if swing[int(kink)] < 0.25 * swing.max():
            continue
        low, high = max(0, int(np.ceil(kink)) - _BEFORE), min(swing.size, int(kink) + _AFTER + 1)
        x, y, w = np.arange(low, high) - kink, logs[low:high], weight[low:high]
        line = np.stack([w, x * w], axis=1)
        bent = np.stack([w, np.minimum(x, 0.0) * w, np.maximum(x, 0.0) * w], axis=1)
        straight = np.linalg.lstsq(line, y * w, rcond=None)[0]
        broken = np.linalg.lstsq(bent, y * w, rcond=None)[0]
        gain = float(np.sum((y * w - line @ straight) ** 2) - np.sum((y * w - bent @ broken) ** 2))
        before, after = -broken[1], -broken[2]
        if logs[low] - logs[int(kink)] > min(_LEVEL, _LEVEL_EACH * (int(kink) - low)):
            continue
        if after > 0.5 * _TOLERANCE and before < _FLAT * after and gain > best:
            best, found = gain, int(np.ceil(kink + 1.5))
    return found


def _is_released(time_s: Array, values: Array, peaks: Peaks, first: int) -> bool:
    """Return whether the swing from this peak is the release itself, out of a hold or a hand, and not yet free.

    Signs: nothing moved in the half cycle before, or the swing lasts far longer than the next, or it shrinks far more
    than those that follow.
    """
    here = peaks.time_s[first]
    halves = np.diff(peaks.time_s)[first : first + 3]
    swing = peaks.swing[first : first + 4]
    if halves.size > 1 and halves[0] > _LONG * halves[1]:
        return True
    half = float(halves[-1])
    before = values[(time_s >= here - half) & (time_s <= here - 0.1 * half)]
    if here - half > time_s[0] and before.size > 1 and np.ptp(before) < _STILL * swing[0] + 6.0 * peaks.noise:
        return True
    if swing.size < 4:
        return False
    fall = -np.diff(np.log(swing))
    noise = 2.0 * peaks.value_std / float(swing[-1])
    return bool(fall[0] > _STEEP * max(float(fall[1:].mean()), 0.0) + max(_TOLERANCE, 5.0 * noise))


def drive_stop(time_s: Array, drive: Array) -> float:
    """Return the time at which the drive stopped [s]: its zero crossing after the last large swing.

    drive: shape (n,), any unit. Small motion of the lever after the stop (below 30 % of the largest swing) is
    parasitic, as in the paper (section 4.2). Returns the first time where the drive never moved more than its noise.
    Raises RecordingError where it still moves at the end.
    """
    rest = float(np.median(drive[-max(3, drive.size // 20) :]))
    motion = np.abs(drive - rest)
    amplitude = float(motion.max())
    if amplitude <= max(1e-9 * max(1.0, abs(rest)), _DRIVE_NOISE * noise_level(drive)):
        return float(time_s[0])
    large = np.flatnonzero(motion > _LAST_DRIVE_SWING * amplitude)
    last = int(large[-1])
    if last >= drive.size - 3:
        raise RecordingError(
            "the drive still moves at the end; a ring-down needs the record of the decay after its stop"
        )
    after = drive[last:] - rest
    crossing = np.flatnonzero(after * np.sign(after[0]) <= 0.02 * amplitude)
    return float(time_s[last + (int(crossing[0]) if crossing.size else 0)])


_HALF_CYCLES = 3.0  # a decay must last at least so long
_WINDOW = 6.0  # time constants of the fit: later there is only noise, which tells how coloured it is
_SAMPLES_PER_HALF = 20  # of the fit, where the record has at least twice as many
_SMALLEST, _LARGEST = 1e-100, 1e100  # of a response: beyond, squares and their products leave the floating point
_JITTER = 0.4  # of a step, between the longest and the shortest
LARGEST_GAP = 5.0  # steps between samples
_SETTLE = 0.2  # half periods after the drive's stop before the decay is taken for free: jerk and sensor delay
_STEADY = 0.05  # of the whole fall of ln(swing): less in the first half is a drive that ran on
_FEWEST_IN_STEP, _OUT_OF_STEP = 6, 0.7  # peaks; how far one of them is from the phase of one frequency [rad]
_LEFT, _OTHER_GUESSES = 0.1, (0.8, 0.9, 1.1, 1.25)  # share of the motion; times the guess of the frequency
_BAND = 0.55, 1.7  # times the frequency of an oscillation that is sought beside others
_FEWEST_CYCLES = 1.2  # in a record, of an oscillation whose line is looked for
_AROUND, _OUTSTANDING, _APART, _MOST_LINES = 4.0, 8.0, 0.25, 3
_WON_BACK = 2.0  # half periods by which the start may move back where the samples agree with the fit


def checked_record(
    time_s: ArrayLike, response: ArrayLike, drive: ArrayLike | None, *, bridging: bool = False
) -> tuple[Array, Array, Array | None]:
    """Return time, response and drive as arrays of shape (n,), or raise RecordingError with what is wrong.

    bridging: leave gaps between samples for the caller to judge.
    """
    t, x = as_seconds(time_s), as_numbers(response, "response")
    lever = None if drive is None else as_numbers(drive, "drive")
    for name, values in (("response", x), ("drive", lever)):
        if values is not None and (values.ndim != 1 or values.shape != t.shape):
            raise RecordingError(
                f"time has shape {t.shape} and {name} {values.shape}; expected one column of equal length each"
            )
        if values is not None and not np.isfinite(values).all():
            where = int(np.argmin(np.isfinite(values)))
            raise RecordingError(
                f"the {name} holds NaN or infinity (first at sample {where}); cut the record or mend it"
            )
    for name, values in (("response", x), ("drive", lever)):
        largest = 0.0 if values is None or not values.size else float(np.abs(values).max())
        if largest and not _SMALLEST <= largest <= _LARGEST:
            raise RecordingError(
                f"the {name} reaches {largest:.3g}, which no sensor measures; expected {_SMALLEST:g} to {_LARGEST:g}; "
                "check its column and unit"
            )
    if t.size < 16:
        raise RecordingError(
            f"ring-down too short: {t.size} samples; record at least {_HALF_CYCLES:.0f} half cycles, 8 samples each"
        )
    steps = np.diff(t)
    if not np.isfinite(t).all() or steps.min() <= 0:
        raise TimeError("time does not increase everywhere; sort the record or use its sample index")
    if steps.max() > LARGEST_GAP * np.median(steps) and not bridging:
        where = int(np.argmax(steps))
        raise TimeError(
            f"gap of {steps[where]:.3g} s after {t[where]:.3f} s; analyse the part behind it (--start) alone"
        )
    return t, x, lever


def evenly(t: Array, x: Array, lever: Array | None) -> tuple[Array, Array, Array | None, float]:
    """Return the record on the time base that its samples tell, even or that of the stamps, and its scale's std.

    A host's stamps jitter where the sampling does not, and the other way round; the wrong base adds noise where the
    response moves fast, which is where a decay tells its frequency. Jitter of up to a step is told apart by whether
    the fifth differences of the response follow velocity × (stamp - even time). Uneven sampling whose steps differ by
    more than 40 % is interpolated (cubic spline; a straight one would add 0.07 % of the amplitude as noise), since
    filters and noise spectra need even samples; the fit bears a little jitter. The last number is the relative standard
    deviation of the even base's step, from the jitter of the stamps it was drawn through.
    """
    steps = np.diff(t)
    step = float(np.median(steps))
    index = np.arange(t.size)
    slope, origin = np.polyfit(index, t, 1)
    even = slope * index + origin
    late = t - even
    if np.abs(late).max() < step:
        follows = np.diff(np.gradient(x, slope) * late, 5)
        if float(follows @ np.diff(x, 5)) < 0.5 * float(follows @ follows):
            clock = float(late.std()) * np.sqrt(12.0 / t.size) / float(t[-1] - t[0])
            return np.asarray(even, dtype=float), x, lever, clock
    if np.ptp(steps) <= _JITTER * step:
        return t, x, lever, 0.0
    even = np.linspace(t[0], t[-1], t.size)
    response = np.asarray(scipy.interpolate.CubicSpline(t, x)(even), dtype=float)
    return even, response, None if lever is None else np.interp(even, t, lever), 0.0


def free_decay(
    t: Array,
    x: Array,
    lever: Array | None,
    free_from_s: float | None = None,
    *,
    samples: tuple[Array, Array] | None = None,
    sought: Array | None = None,
    floor: float = 0.0,
    may_beat: bool = False,
) -> tuple[DecayFit, Array, Array, Peaks]:
    """Return (direct fit, times and samples it was fitted to, peaks of the same stretch).

    t, x: shape (n,), even time base; lever: the drive, shape (n,), or None where it was not measured.
    free_from_s: where the decay is known to be free; None to seek it.
    samples: times and values to fit, shape (k,) each, where they are not those of the even base. sought: x in the band
    of one oscillation, shape (n,), in which start and peaks are sought instead. floor: amplitude at which the window
    ends, for a record that is rounded to steps of this size. may_beat: one exponential need not be seen to decay.
    The fit is bent where the peaks fall out of step with one frequency.
    Raises RecordingError where the free decay is too short, or is none.
    """
    seen = x if sought is None else sought
    if free_from_s is not None:
        after = int(np.searchsorted(t, free_from_s))
    else:
        after = 0 if lever is None else int(np.searchsorted(t, drive_stop(t, lever)))
    if t.size - after < 16:
        raise RecordingError(f"ring-down too short: {t.size - after} samples after the drive stopped; record longer")
    peaks = find_peaks(t[after:], seen[after:])
    half = peaks.half_period_s
    if free_from_s is not None:
        first, start, earliest = 0, float(t[after]), float(t[after])
    elif lever is None and peaks.swing.size:
        first = first_free_peak(t, seen, peaks)
        start = float(peaks.time_s[first])
        earliest = max(float(t[0]), start - _WON_BACK * half)
    else:
        first = int(np.argmax(peaks.swing)) if peaks.swing.size else 0
        start = earliest = float(t[after]) + _SETTLE * half * (after > 0)
    _check_length(t, peaks, first, start)
    guess = _guess(peaks, first)
    lasts = _WINDOW
    if floor > 0.0:
        lasts = min(lasts, float(np.log(max(0.5 * peaks.swing[first] / floor, 1.0))))
    stop = min(float(t[-1]), start + max(lasts / max(guess[0], 1e-9), 6.0 * half))
    t, x = block_means(t, x, half) if samples is None else samples
    inside = _within(t, start, stop)
    fit = _in_step(t[inside], x[inside], _from_guesses(t[inside], x[inside], guess), peaks.between(start, stop))
    fit = _won_back(t, x, fit, earliest, peaks)
    _check_decay(fit, peaks, first, may_beat)
    inside, margin = _within(t, fit.start_s, stop), 0.05 * half
    return fit, t[inside], x[inside], peaks.between(min(fit.start_s, start) - margin, stop + margin)


def _from_guesses(t: Array, x: Array, guess: tuple[float, float]) -> DecayFit:
    """Return the plain fit from a guess of (λ, ω), and where that leaves much of the motion, from others beside it."""
    fit = fit_decay_and_rest(t, x, guess)
    motion = float(np.sum((x - fit.rest(t)) ** 2))
    if float(fit.residual @ fit.residual) < _LEFT * motion:
        return fit
    others = [fit_decay(t, x, (guess[0], factor * guess[1])) for factor in _OTHER_GUESSES]
    best = min(others, key=lambda one: float(one.residual @ one.residual))
    if float(best.residual @ best.residual) > 0.7 * float(fit.residual @ fit.residual):
        return fit
    return fit_decay_and_rest(t, x, (best.decay_rate_per_s, best.omega_rad_s))


def _in_step(t: Array, x: Array, plain: DecayFit, peaks: Peaks) -> DecayFit:
    """Return the plain fit, or the bent one where the peaks fall out of step with one frequency and it fits better."""
    height = peaks.value - plain.rest(peaks.time_s)
    solid = np.abs(height) > max(4.0 * peaks.value_std, 0.02 * float(np.abs(height).max(initial=0.0)))
    last = int(np.argmin(solid)) if not solid.all() else solid.size
    if last < _FEWEST_IN_STEP or not np.all(height[: last - 1] * height[1:last] < 0):
        return plain
    times, size = peaks.time_s[:last], np.abs(height[:last])
    phase = np.arange(last) * np.pi
    line = np.polynomial.Polynomial.fit(times, phase, 1, w=size)
    if float(np.abs(phase - line(times)).max()) < _OUT_OF_STEP:
        return plain
    bent = fit_bent(t, x, plain, times, size)
    return bent if float(bent.residual @ bent.residual) < 0.7 * float(plain.residual @ plain.residual) else plain


def band_passed(t: Array, x: Array, frequency_hz: float) -> Array:
    """Return what of an even record, shape (n,), lies around a frequency, without shift of phase."""
    nyquist = 0.5 * (t.size - 1) / float(t[-1] - t[0])
    band = [_BAND[0] * frequency_hz / nyquist, min(_BAND[1] * frequency_hz / nyquist, 0.98)]
    filtered = scipy.signal.sosfiltfilt(scipy.signal.butter(2, band, "bandpass", output="sos"), x - np.median(x))
    return np.asarray(filtered, dtype=float)


def spectral_lines(t: Array, x: Array) -> list[float]:
    """Return the frequencies [Hz] that stand out of an even record's spectrum, the one of the most energy first."""
    n = t.size
    line = np.polynomial.Polynomial.fit(t, x, 1)
    power = np.abs(np.fft.rfft(x - line(t), 2 * n)) ** 2
    frequency = np.fft.rfftfreq(2 * n, float(t[-1] - t[0]) / (n - 1))
    power = np.convolve(power, np.ones(3) / 3.0, mode="same")
    lowest = _FEWEST_CYCLES / float(t[-1] - t[0])
    found: list[tuple[float, float]] = []
    for top in maxima(power):
        here = float(frequency[top])
        if not lowest < here < 0.9 * float(frequency[-1]):
            continue
        wide = (frequency > here / _AROUND) & (frequency < here * _AROUND)
        if power[top] > _OUTSTANDING * float(np.median(power[wide])):
            near = (frequency > 0.85 * here) & (frequency < 1.15 * here)
            found.append((float(power[near].sum()), here))
    lines: list[float] = []
    for _, here in sorted(found, reverse=True):
        if all(abs(np.log(here / other)) > _APART for other in lines):
            lines.append(here)
    return lines[:_MOST_LINES]


def _within(t: Array, start: float, stop: float) -> Mask:
    return np.asarray((t >= start - 1e-9) & (t <= stop + 1e-9))


def block_means(t: Array, x: Array, half: float) -> tuple[Array, Array]:
    """Return means over blocks of samples that leave 20 or more per half period; loses nothing of the poles."""
    size = int(half / (_SAMPLES_PER_HALF * float(t[1] - t[0])))
    if size < 2:
        return t, x
    count = t.size // size
    return (
        np.asarray(t[: count * size].reshape(count, size).mean(axis=1)),
        np.asarray(x[: count * size].reshape(count, size).mean(axis=1)),
    )


def _guess(peaks: Peaks, first: int) -> tuple[float, float]:
    """Return (λ, ω) from the swings after the first free peak, weighted by size."""
    swing = peaks.swing[first:]
    middle = 0.5 * (peaks.time_s[first:-1] + peaks.time_s[first + 1 :])
    solid = swing > max(0.05 * swing[0], 4.0 * peaks.value_std)
    solid[:2] = True
    rate = -float(np.polyfit(middle[solid], np.log(swing[solid]), 1, w=swing[solid])[0])
    spacing = np.diff(peaks.time_s[first:])[solid]
    return rate, float(np.pi / np.average(spacing, weights=swing[solid]))


def _check_length(t: Array, peaks: Peaks, first: int, start: float) -> None:
    half, swing = peaks.half_period_s, peaks.swing
    left = max(float(t[-1]) - start, 0.0) / half
    if swing.size - first >= 2 and left >= _HALF_CYCLES:
        return
    if (
        2 <= first < swing.size
        and swing[first] > 1.3 * float(np.median(swing[:first]))
        and t[-1] - peaks.time_s[-1] < 3.0 * half
    ):
        raise RecordingError(
            "the oscillation grows instead of decaying; a ring-down needs the part after its drive stopped"
        )
    if left < _HALF_CYCLES + 1.0:
        raise RecordingError(
            f"ring-down too short: {left:.1f} half cycles of free decay after {start:.3f} s, "
            f"at least {_HALF_CYCLES:.0f} are needed; record longer or start from a larger amplitude"
        )
    raise RecordingError(
        f"the oscillation dies out too fast: {max(swing.size - first, 0)} swings after {start:.3f} s stand out of the "
        "noise, at least 2 are needed; start from a larger amplitude, or measure with less noise"
    )


def _check_decay(fit: DecayFit, peaks: Peaks, first: int, may_beat: bool) -> None:
    rate, std = fit.mean_rate_per_s()
    ratio = peaks.swing[-1] / peaks.swing[first]
    if rate <= 0 and ratio > 1.1:
        raise RecordingError(
            "the oscillation grows instead of decaying; a ring-down needs the part after its drive stopped"
        )
    if _steady_to_the_end(peaks.swing[first:]):
        raise RecordingError(
            "ring-down too short: the oscillation is steady until shortly before the end; record at least "
            f"{_HALF_CYCLES:.0f} half cycles after the drive stopped"
        )
    if rate <= 2.0 * std and not may_beat:
        raise RecordingError(
            f"no decay found: the oscillation has λ = {rate:.3g} ± {std:.2g} 1/s; a ring-down needs the part after its "
            "drive stopped"
        )


def _steady_to_the_end(swing: Array) -> bool:
    half = swing.size // 2
    if half < 3:
        return False
    whole = float(np.log(swing[0] / swing[-1]))
    early = float(np.log(swing[:2].mean() / swing[half - 1 : half + 1].mean()))
    return whole > 0.1 and early < _STEADY * whole


def _won_back(t: Array, x: Array, fit: DecayFit, earliest: float, peaks: Peaks) -> DecayFit:
    """Return the fit begun earlier, by steps of a quarter half period, as far as the samples agree with it.

    Agreement: the mean squared deviation of a step stays within three standard deviations of the noise's, and twice
    those of the extrapolated fit. Where it ends, the last step that agreed is given back: part of it may be driven.
    """
    begin, end = (int(np.searchsorted(t, time - 1e-9)) for time in (earliest, fit.start_s))
    last = end + fit.residual.size
    size = max(3, int(0.25 * peaks.half_period_s / float(np.median(np.diff(t)))))
    fits = [fit]
    while end - begin >= 3:
        low = max(begin, end - size)
        chunk, noise = t[low:end], min(float(np.mean(fits[-1].residual ** 2)), 4.0 * peaks.noise**2)
        off = x[low:end] - fits[-1].model(chunk)
        colour = fits[-1].residual.size / (fits[-1].degrees_of_freedom + fits[-1].parameters.size)
        allowed = (1.0 + 3.0 * np.sqrt(2.0 * colour / chunk.size)) * noise + 4.0 * float(
            fits[-1].model_variance(chunk).mean()
        )
        if float(np.mean(off**2)) > allowed + (0.005 * fits[-1].amplitude) ** 2:
            return fits[max(0, len(fits) - 2)]
        end = low
        guess = fits[-1].decay_rate_per_s, fits[-1].omega_rad_s
        relaxing = float(np.exp(fit.parameters[7])) if fit.relaxing else None
        fits.append(fit_decay(t[end:last], x[end:last], guess, relaxing=relaxing, bend=fits[-1].bend_per_s2))
    return fits[-1]
