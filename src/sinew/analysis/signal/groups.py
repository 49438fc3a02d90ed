"""Groups of constant drive frequency in a recording that does not say what was driven."""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from sinew.analysis.signal.harmonics import fit_harmonics, refine_frequency
from sinew.analysis.signal.signals import drive_channel
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError
from sinew.measure.recording import Segment, build_recording, iterate_segments
from sinew.measure.schema import SAMPLE_VARIABLES

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
    Raises RecordingError without a drive, where the drive never holds a frequency, where settle_s is no time, and where
    it leaves no whole period of a group.
    """
    if settle_s is not None and not (np.isfinite(settle_s) and settle_s >= 0):
        raise RecordingError(f"settle time is {settle_s:g} s; give a finite number of seconds, zero or more")
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
        for place, (before, count) in enumerate(seen):
            if abs(frequency / before - 1.0) < _SAME_FREQUENCY:
                frequency, repeat = before, count
                seen[place] = (before, count + 1)
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
