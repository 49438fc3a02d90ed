"""Harmonics of a known frequency, with the noise that is really there; groups of constant frequency in a drive."""

import math
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sinew.analysis.signal.signals import drive_channel
from sinew.measure.arrays import Array, Complexes
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.recording import SAMPLE_VARIABLES, Segment, build_recording, iterate_segments

HARMONICS = 5
_LINES = 12
_SIDEBANDS = 8
NYQUIST_SHARE = 0.45
_BLOCK = 6000
"""Samples that are fitted together, so that what is made of them stays in a processor's cache."""


@dataclass(frozen=True)
class Harmonics:
    """Harmonics of s records of q signals each: x(t) = offset + slope·(t - t₀) + Re Σ X_h exp(jhΩ(t - t₀)).

    frequency_hz, reference_s: Ω/2π and t₀ of each record, shape (s,).
    coefficient: X_h for h = 1..5, shape (s, q, h), in the unit of the signal; NaN above 0.45 of the sample rate.
    std: standard deviation of the real and of the imaginary part of X_h, each, shape (s, q, h).
    offset, slope: shape (s, q).
    growth: change of X_1 per period, complex, shape (s, q); growth_std: of its real and imaginary part, each.
    sidebands: what the residual puts m cycles per record above and below the fundamental, complex,
    shape (s, q, m, 2), relative to nothing; NaN where the record is too short for any.
    """

    frequency_hz: Array
    reference_s: Array
    coefficient: Complexes
    std: Array
    offset: Array
    slope: Array
    growth: Complexes
    growth_std: Array
    sidebands: Complexes


def fit_harmonics(time_s: Array, signal: Array, frequency_hz: Array, design: Array | None = None) -> Harmonics:
    """Return offset, slope, the fundamental and harmonics 2 to 5 of records of equal length, by least squares.

    time_s: stamps as they are, jitter included, shape (s, n). signal: shape (s, q, n). frequency_hz: shape (s,).
    design: `harmonic_design` of the same records, from whoever needs it further.

    The standard deviations come from the residual's own spectrum: on the grid of whole cycles per record the residual
    is projected on the twelve lines nearest to each harmonic that are no harmonic themselves. What noise puts there it
    puts on the harmonic too, whatever its colour; a formula for white noise is too small by two for a gyroscope
    behind a 41 Hz low-pass and a three-sample average, and knows nothing of a transient that has not died.
    Records must hold at least one period and more samples than coefficients; ValueError otherwise.
    """
    records, samples = time_s.shape
    if design is None:
        design = harmonic_design(time_s, frequency_hz)
    span = (time_s[:, -1] - time_s[:, 0]) * samples / (samples - 1)
    count = int(min(HARMONICS, np.floor(NYQUIST_SHARE * (samples / span / frequency_hz).min())))
    if count < 1 or (span * frequency_hz).min() < 0.8 or samples < 2 * count + 6:
        raise ValueError(f"{samples} samples over {float(span.min()):g} s cannot hold harmonics of the drive")
    periods = np.maximum(1, np.rint(span * frequency_hz)).astype(int)
    reference = _middle(time_s)
    if count < HARMONICS:
        design = design[:, [0, 1, *range(2, 2 + count), *range(2 + HARMONICS, 2 + HARMONICS + count)]]
    shape = (records, signal.shape[1])
    parts = {
        "coefficient": np.full((*shape, HARMONICS), np.nan + 0j),
        "std": np.full((*shape, HARMONICS), np.nan),
        "offset": np.empty(shape),
        "slope": np.empty(shape),
        "growth": np.empty(shape, dtype=complex),
        "growth_std": np.empty(shape),
        "sidebands": np.full((*shape, _SIDEBANDS, 2), np.nan + 0j),
    }
    for whole in np.unique(periods):
        same = np.flatnonzero(periods == whole)
        for part in np.array_split(same, -(-same.size * samples // _BLOCK)):
            rows = slice(part[0], part[-1] + 1) if part[-1] - part[0] < part.size else part
            turn = 2.0 * np.pi / whole * frequency_hz[rows, None] * (time_s[rows] - reference[rows, None])
            batch = _fit_batch(turn, signal[rows], design[rows], int(whole))
            for name, values in zip(parts, batch, strict=True):
                if name in ("coefficient", "std"):
                    parts[name][rows, :, :count] = values
                else:
                    parts[name][rows] = values
    parts["slope"] /= 0.5 * (time_s[:, -1:] - time_s[:, :1])
    return Harmonics(frequency_hz, reference, **parts)


def _fit_batch(turn: Array, signal: Array, design: Array, whole: int) -> tuple[NDArray[np.generic], ...]:
    """Return the fields from coefficient to sidebands of records with one number of whole periods, the slope per half
    record; turn: one in the whole record, shape (s, n)."""
    samples, count = design.shape[2], design.shape[1] // 2 - 1
    lines = _line_numbers(whole, count, int(NYQUIST_SHARE * samples))
    moments = design @ signal.transpose(0, 2, 1)
    solution = np.linalg.solve(design @ design.transpose(0, 2, 1), moments).transpose(0, 2, 1)
    coefficient = solution[:, :, 2 : 2 + count] - 1j * solution[:, :, 2 + count :]
    residual = signal - solution @ design

    ramp = design[:, 1]
    power = (ramp**2).sum(axis=1)[:, None]
    swelling = residual @ (ramp[:, None] * design[:, 2::count]).transpose(0, 2, 1)
    growth = 2.0 * (swelling[:, :, 0] - 1j * swelling[:, :, 1]) / power
    if lines.size < 4:
        variance = np.repeat(2.0 * (residual**2).mean(axis=2)[:, :, None] / (samples - design.shape[1]), count, axis=2)
        floor, sidebands = variance[:, :, 0], np.full((*signal.shape[:2], _SIDEBANDS, 2), np.nan + 0j)
    else:
        amplitudes = _line_amplitudes(residual, turn, int(lines[-1]))[:, :, lines]
        sidebands, spectrum = _sidebands(amplitudes, lines, whole), amplitudes.real**2 + amplitudes.imag**2
        nearest = np.argsort(np.abs(lines - whole * np.arange(1, count + 1)[:, None]), kind="stable")[:, :_LINES]
        of_harmonic = spectrum[:, :, nearest]
        variance = 0.5 * of_harmonic.mean(axis=3)
        ordered, half = np.sort(of_harmonic[:, :, 0], axis=2), of_harmonic.shape[3] // 2
        floor = 0.25 * (ordered[:, :, half] + ordered[:, :, ~half]) / np.log(2.0)
    per_period = 2.0 / whole
    return (
        coefficient,
        np.sqrt(variance),
        solution[:, :, 0],
        solution[:, :, 1],
        growth * per_period,
        np.sqrt(floor * samples / power) * per_period,
        sidebands,
    )


def _line_numbers(whole: int, count: int, highest: int) -> NDArray[np.int64]:
    """Return the lines (cycles per record) that tell of noise: no harmonics, not the lowest, below Nyquist."""
    numbers = np.arange(2, max(count * whole + _LINES, 3 * _LINES // 2 + count) + 1)
    is_harmonic = (numbers % whole == 0) & (numbers <= count * whole)
    return np.asarray(numbers[~is_harmonic & (numbers <= highest)], dtype=np.int64)


def _line_amplitudes(residual: Array, turn: Array, highest: int) -> Complexes:
    """Return 2/n Σ r exp(-ikψ) at the lines k = 0..highest, at least, shape (s, q, lines).

    turn: ψ, (s, n). A line is k = mw ± b with b <= w/2, w odd: the residual is turned back by mw, and what that gives
    by b, which takes waves for √k instead of k; for three signals it is quickest with w about √(6k).
    """
    (records, signals, samples), side = residual.shape, math.isqrt(6 * highest) // 2
    width = 2 * side + 1
    steps = 1 + (highest + side) // width
    sums = np.zeros((records, signals * (2 * steps - 1), width))
    for first in range(0, samples, _BLOCK):
        part = slice(first, first + _BLOCK)
        fine, coarse = multiples(turn[:, part], side, 1), multiples(width * turn[:, part], steps - 1, 1)
        fine[:, 0] = coarse[:, 0] = 1.0
        turned = residual[:, :, None, part] * coarse[:, None]
        sums += turned.reshape(records, sums.shape[1], -1) @ fine.transpose(0, 2, 1)
    sums = sums.reshape(records, signals, 2 * steps - 1, width)
    cosine, sine = sums[:, :, :steps], np.zeros((records, signals, steps, width))
    sine[:, :, 1:] = sums[:, :, steps:]
    even = cosine[..., : side + 1] - 1j * sine[..., : side + 1]
    odd = sine[..., side + 1 :] + 1j * cosine[..., side + 1 :]
    centre, neighbours = even[..., :1], even[..., 1:]
    found = np.concatenate([(neighbours + odd)[..., ::-1], centre, neighbours - odd], axis=3)
    return np.asarray(2.0 / samples * found.reshape(records, signals, steps * width)[:, :, side:])


def _sidebands(amplitudes: Complexes, lines: NDArray[np.int64], whole: int) -> Complexes:
    """Return the amplitudes m lines above and below the fundamental, (s, q, 8, 2), for the eight smallest such m."""
    column_of = {int(line): column for column, line in enumerate(lines)}
    pairs = [m for m in range(1, int(lines[-1])) if whole + m in column_of and abs(whole - m) in column_of][:_SIDEBANDS]
    out = np.full((*amplitudes.shape[:2], _SIDEBANDS, 2), np.nan + 0j)
    lower = amplitudes[:, :, [column_of[abs(whole - m)] for m in pairs]]
    out[:, :, : len(pairs), 0] = amplitudes[:, :, [column_of[whole + m] for m in pairs]]
    out[:, :, : len(pairs), 1] = np.where(np.array(pairs) < whole, lower, lower.conj())
    return out


def relative_noise(fitted: Harmonics, signal: int, reference: int | None = None) -> tuple[Array, Array]:
    """Return relative standard deviation of a fundamental's amplitude, and standard deviation of its phase [rad], (s,).

    reference: another signal; then amplitude and phase are those of the quotient of the two, and what both share, as
    they do the jitter of the stamps, drops out. The sidebands of the residual, seen from the fundamental, part into
    those that modulate amplitude and those that modulate phase; jitter is nearly all of the second kind.
    """

    def seen_from_fundamental(column: int) -> Complexes:
        size = fitted.coefficient[:, column, 0, None, None]
        with np.errstate(invalid="ignore"):  # a channel that stands still
            return np.asarray(fitted.sidebands[:, column] / np.where(size == 0, np.nan, size))

    noise = seen_from_fundamental(signal)
    if reference is not None:
        noise = noise - seen_from_fundamental(reference)
    upper, lower = noise[:, :, 0], noise[:, :, 1].conj()
    count = np.isfinite(upper).sum(axis=1)
    parts = [np.nansum(np.abs(0.5 * part) ** 2, axis=1) for part in (upper + lower, upper - lower)]
    few = count < 3
    plain = np.zeros(few.size)
    for column in (signal,) if reference is None else (signal, reference):
        size = np.abs(fitted.coefficient[:, column, 0])
        plain = np.hypot(
            plain, np.divide(fitted.std[:, column, 0], size, out=np.full_like(size, np.nan), where=size > 0)
        )
    amplitude, phase = (np.where(few, plain, np.sqrt(part / np.maximum(count, 1))) for part in parts)
    return amplitude, phase


def multiples(angle: Array, count: int, before: int = 0) -> Array:
    """Return cos hψ, h = 1..count, then sin hψ, of angles ψ (..., n), as rows: shape (..., 2h, n).

    before: how many rows stand before them, for the caller to fill. The first wave is by the tangent of the half angle,
    which NumPy has in vector registers, where it has neither sine nor cosine; the others are by Chebyshev's recurrence,
    whose round-off grows as h².
    """
    out = np.empty((before + 2 * count, *angle.shape))
    cosine, sine = waves = out[before:].reshape(2, count, *angle.shape)
    if count:
        half = np.tan(0.5 * angle)
        square = half * half
        np.divide(1.0 - square, 1.0 + square, out=cosine[0])
        np.divide(2.0 * half, 1.0 + square, out=sine[0])
        twice = 2.0 * cosine[0]
    for h in range(1, count):
        np.multiply(waves[:, h - 1], twice, out=waves[:, h])
        if h > 1:
            waves[:, h] -= waves[:, h - 2]
        else:
            cosine[h] -= 1.0
    return np.moveaxis(out, 0, -2)


def harmonic_design(time_s: Array, frequency_hz: Array) -> Array:
    """Return what is fitted to records with stamps (s, n) and frequencies (s,), shape (s, 12, n).

    Rows: one, a ramp from -1 to 1, cos hΩ(t - t₀) for h = 1..5, and sin hΩ(t - t₀). ValueError where n is one.
    """
    if time_s.shape[1] < 2:
        raise ValueError("a record of one sample holds no harmonics")
    elapsed = time_s - _middle(time_s)[:, None]
    design = multiples(2.0 * np.pi * frequency_hz[:, None] * elapsed, HARMONICS, 2)
    design[:, 0], design[:, 1] = 1.0, elapsed / (0.5 * (time_s[:, -1:] - time_s[:, :1]))
    return design


def _middle(time_s: Array) -> Array:
    """Return t₀ of each record: half way between its first stamp and its last."""
    return 0.5 * (time_s[:, 0] + time_s[:, -1])


def waveform(coefficient: Complexes, angle: Array) -> Array:
    """Return Re Σ X_h exp(jhψ) for coefficients (s, h), NaN harmonics left out, at phases ψ (s, n) or (n,)."""
    return add_waves(coefficient, multiples(angle, coefficient.shape[1]))


def add_waves(coefficient: Complexes, waves: Array) -> Array:
    """Return `waveform` at phases whose `multiples` are known, (s, 2h, n) or (2h, n)."""
    known = np.nan_to_num(coefficient)
    parts = np.concatenate([known.real, -known.imag], axis=1)
    return np.asarray(parts @ waves if waves.ndim == 2 else (parts[:, None] @ waves)[:, 0])


def refine_frequency(time_s: Array, signal: Array, frequency_hz: float) -> float:
    """Return the frequency of a steady periodic signal [Hz], from a guess that is right within a fifth of 1/duration.

    time_s, signal: shape (n,). The phase of the fundamental must not turn inside the record: its growth per period
    gives the correction (Newton on the least-squares phase), until it is below 1e-9 of the frequency.
    """
    for _ in range(20):
        fitted = fit_harmonics(time_s[None], signal[None, None], np.array([frequency_hz]))
        turn = float((fitted.growth[0, 0] / fitted.coefficient[0, 0, 0]).imag) / (2.0 * np.pi)
        frequency_hz *= 1.0 + turn
        if abs(turn) < 1e-9:
            break
    return frequency_hz


# Stretches of constant drive are found by the spacing of its zero crossings.


FEWEST_PERIODS = 6
SETTLE_SHARE = 0.5
_SAME_FREQUENCY = 5e-4
_LOOSEST, _TIGHTEST = 0.02, 0.003
_BREAK = 0.25


@dataclass(frozen=True)
class Group:
    """A stretch of constant drive: sample numbers [start, stop), frequency [Hz], amplitude in the drive's unit."""

    start: int
    stop: int
    frequency_hz: float
    amplitude: float


def split_by_drive(recording: xr.Dataset, settle_s: float | None = None) -> xr.Dataset:
    """Return the same samples with a settle and a steady segment for each group of constant drive frequency.

    Only steady segments whose frequency is NaN are split; a recording without any comes back as it is. The drive's
    rising zero crossings give its periods; at least six in a row that agree (within four times their own noise, 0.3 %
    at least, 2 % at most, without a trend) are a group. Its outermost periods are set aside; its first half settles, or
    its first settle_s seconds where that is given, counted from the first of the equal periods; the rest, whole
    periods, is steady.
    Between groups the samples belong to the next settle, after the last one to an idle segment. The amplitude is that
    of the measured drive where it is an angle, else NaN; a frequency that comes again is the next repeat.
    Raises RecordingError without a drive, where the drive never holds a frequency, and where settle_s leaves no whole
    period of a group; SpecError where settle_s is no time.
    """
    if settle_s is not None and not (np.isfinite(settle_s) and settle_s >= 0):
        raise SpecError(f"found {settle_s:g} s to settle, expected a time of 0 s or more")
    kinds, frequencies = recording["kind"].values, recording["frequency_hz"].values
    unknown = (kinds == "steady") & ~np.isfinite(frequencies)
    if not unknown.any():
        return recording
    drive = drive_channel(recording)
    if drive is None:
        raise RecordingError("a sweep without its drive frequencies needs a drive signal; name its column with --drive")
    stamps = recording["time_s"].values
    segments: list[Segment] = []
    sizes: list[int] = []
    for index, known, where in iterate_segments(recording):
        if not unknown[index]:
            segments.append(known)
            sizes.append(where.stop - where.start)
            continue
        groups = find_groups(stamps[where], drive.values[where])
        if not groups:
            raise RecordingError(
                f"found no group of constant drive frequency (at least {FEWEST_PERIODS} equal periods in a row); "
                "cut the recording to its steady parts, or choose another drive column"
            )
        parts = _label(known, groups, stamps[where], drive.unit == "rad", settle_s)
        segments += [segment for segment, _ in parts]
        sizes += [size for _, size in parts]
    samples = {name: recording[name].values for name in SAMPLE_VARIABLES if name in recording}
    units = {name: str(recording[name].attrs.get("units", "")) for name in samples}
    attrs = {key: value for key, value in recording.attrs.items() if key != "content_hash"}
    return build_recording(samples, segments, sizes, attrs, units)


def find_groups(stamps: Array, drive: Array) -> list[Group]:
    """Return the groups of constant drive frequency in one stretch, in order."""
    crossings = rising_crossings(stamps, drive)
    groups = []
    for first, last in _equal_runs(np.diff(crossings)):
        # the outermost periods may hold a piece of the step before or after and still seem equal
        start, stop = np.searchsorted(stamps, (crossings[first + 1], crossings[last - 1]))
        time, signal = stamps[start:stop], drive[start:stop]
        guess = (last - first - 2) / (crossings[last - 1] - crossings[first + 1])
        try:
            frequency = refine_frequency(time, signal, float(guess))
            fitted = fit_harmonics(time[None], signal[None, None], np.array([frequency]))
        except ValueError:
            continue  # too few samples in a period: no frequency response can be had from it
        if abs(frequency / guess - 1.0) < _LOOSEST:
            groups.append(Group(int(start), int(stop), frequency, float(np.abs(fitted.coefficient[0, 0, 0]))))
    return groups


def rising_crossings(stamps: Array, drive: Array) -> Array:
    """Return the times at which the drive rises through its middle [s], with hysteresis against noise."""
    low, high = np.percentile(drive, (2.0, 98.0))
    signal = drive - 0.5 * (low + high)
    band = 0.15 * (high - low)
    state = np.where(signal > band, 1, np.where(signal < -band, -1, 0))
    marks = np.flatnonzero(state)
    ups = np.flatnonzero((state[marks][1:] == 1) & (state[marks][:-1] == -1))
    times = []
    for before, after in zip(marks[ups], marks[ups + 1], strict=True):
        at = int(before) + int(np.flatnonzero(signal[before : after + 1] < 0)[-1])
        share = -signal[at] / (signal[at + 1] - signal[at])
        times.append(stamps[at] + share * (stamps[at + 1] - stamps[at]))
    return np.asarray(times, dtype=float)


def _equal_runs(periods: Array) -> list[tuple[int, int]]:
    """Return (first, last) crossing of each longest run of equal periods, at least six of them."""
    if periods.size < FEWEST_PERIODS:
        return []
    relative = np.abs(np.diff(periods)) / periods[1:]
    noise = float(np.median(relative)) / 0.6745 / np.sqrt(2.0)
    tolerance = float(np.clip(4.0 * noise, _TIGHTEST, _LOOSEST))
    runs, first = [], 0
    for index in range(1, periods.size + 1):
        if index < periods.size:
            off = np.abs(periods[index : index + 3] / np.median(periods[first:index]) - 1.0)
            if off[0] <= tolerance or (off[0] < _BREAK and off.min() <= tolerance):
                continue  # a crossing displaced by noise spoils the two periods beside it, but no third
        if index - first >= FEWEST_PERIODS and _is_level(periods[first:index], tolerance):
            runs.append((first, index))
        first = index
    return runs


def _is_level(periods: Array, tolerance: float) -> bool:
    """Whether periods hold still: from the first to the last third they change by less than half the tolerance, or by
    less than three times what their scatter explains."""
    third = max(2, periods.size // 3)
    head, tail = periods[:third], periods[-third:]
    change = abs(float(head.mean() - tail.mean())) / float(periods.mean())
    scatter = float(np.std(np.diff(periods)) / np.sqrt(2.0) / periods.mean())
    return change <= max(0.5 * tolerance, 3.0 * scatter * float(np.sqrt(2.0 / third)))


def _steady_periods(group: Group, start: float, end: float, settle_s: float | None) -> float:
    """Return how many whole periods at the end of a group are steady; start, end: its first and last stamp [s]."""
    left = (1.0 - SETTLE_SHARE) * (end - start)
    if settle_s is not None:
        # the group leaves out the first of its equal periods, which settles too
        left = end - max(start, start - 1.0 / group.frequency_hz + settle_s)
    periods = float(np.floor(left * group.frequency_hz + 0.1))
    if periods < 1.0:
        raise RecordingError(
            f"the drive holds {group.frequency_hz:.4g} Hz for {end - start + 2.0 / group.frequency_hz:.3g} s, a settle "
            f"time of {settle_s:g} s leaves no whole period of it; ask for a shorter one"
        )
    return periods


def _label(
    known: Segment, groups: list[Group], stamps: Array, is_angle: bool, settle_s: float | None
) -> list[tuple[Segment, int]]:
    """Return the new segments of one stretch with their sizes, which add up to the stretch."""
    out: list[tuple[Segment, int]] = []
    seen: list[tuple[float, int]] = []
    done = 0
    for group in groups:
        frequency, repeat = group.frequency_hz, known.repeat
        for column_of, (before, count) in enumerate(seen):
            if abs(frequency / before - 1.0) < _SAME_FREQUENCY:
                frequency, repeat = before, count
                seen[column_of] = (before, count + 1)
                break
        else:
            seen.append((frequency, known.repeat + 1))
        amplitude = float(np.rad2deg(group.amplitude)) if is_angle else float("nan")
        settle = replace(known, kind="settle", frequency_hz=frequency, amplitude_deg=amplitude, repeat=repeat)
        end = float(stamps[group.stop - 1])
        periods = _steady_periods(group, float(stamps[group.start]), end, settle_s)
        first = int(np.searchsorted(stamps, end - periods / group.frequency_hz))
        out.append((settle, first - done))
        out.append((replace(settle, kind="steady"), group.stop - first))
        done = group.stop
    if done < stamps.size:
        rest = replace(known, kind="idle", frequency_hz=float("nan"), amplitude_deg=float("nan"))
        out.append((rest, stamps.size - done))
    return out
