"""The stretch of a record that is fitted: between two times, an angle unwrapped, what no sensor saw left out, and of a
free decay its free part."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sinew.analysis.decay.free_decay import Peaks, find_peaks, free_decay
from sinew.analysis.decay.samples import read_samples, unwrapped_angle
from sinew.identify.oscillator.record import FEWEST, Record
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError
from sinew.measure.timing import choose_stretch

_STRUCK = 3.0  # times the three swings before: a motion begun anew, which no beat does within one swing
_LARGE = 0.3  # of the largest swing
_CALM = 3  # swings before
_FEWEST_SWINGS = 5
_AT_ONCE = 1.25  # half periods: what begins free so soon begins with the record


def cut_to(record: Record, start_s: float | None, stop_s: float | None) -> Record:
    """Return the samples from start_s to stop_s. Raises TimeError where there are none, RecordingError for too few."""
    if start_s is None and stop_s is None:
        return record
    inside = np.flatnonzero(choose_stretch(record.time_s, start_s, stop_s, of="record"))
    if inside.size < FEWEST:
        raise RecordingError(
            f"found {inside.size} samples between start and stop, expected at least {FEWEST}; choose a longer stretch"
        )
    return record.cut(int(inside[0]), int(inside[-1]) + 1)


def unwrapped(record: Record) -> Record:
    """Return the record with angles that jump by a whole turn between two samples made continuous, and a note on it."""
    notes = []
    output, turns = unwrapped_angle(record.output, record.output_unit)
    if turns:
        notes.append(f"the output jumps by a whole turn {_times(turns)}; it was unwrapped")
    given = record.input
    if given is not None:
        given, turns = unwrapped_angle(given, record.input_unit)
        if turns:
            notes.append(f"the input jumps by a whole turn {_times(turns)}; it was unwrapped")
    return replace(record, output=output, input=given, notes=(*record.notes, *notes)) if notes else record


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def telling(record: Record, *, counted: bool = False) -> Record:
    """Return a free decay without samples that are clipped or frozen, as `analyse` leaves them out, and a note on them.

    counted: samples were asked for by their index, so none is left out and the note says that they are there.
    """
    if record.excitation != "none":
        return record
    try:
        samples = read_samples(record.time_s, record.output, None, record.output_unit)
    except RecordingError:
        return record
    if lost := record.size - samples.time_s.size:
        notes = [one for one in samples.remarks if one.endswith("left out")]
        if counted:
            notes = [f"{lost} samples are clipped or frozen, and fitted; without train and test they are left out"]
            return replace(record, notes=(*record.notes, *notes))
        return replace(record, time_s=samples.time_s, output=samples.values, notes=(*record.notes, *notes))
    return record


def free_part(record: Record) -> Record:
    """Return the free part of a free decay, found as `analyse` finds it, and a note where that is not all of it.

    Of several decays in one record it is the one with most swing. A record that begins free, within half a swing, and
    one in which no free decay is found stays as it is.
    """
    if record.excitation != "none":
        return record
    try:
        samples = read_samples(record.time_s, record.output, None, record.output_unit)
        decays = find_decays(samples.even_s, samples.even)
    except RecordingError:
        return record
    if not decays:
        return record
    best = max(range(len(decays)), key=lambda k: decays[k][2])
    first, last, _ = decays[best]
    notes = []
    if len(decays) > 1:
        listed = " and ".join(f"{a:.4g} to {b:.4g} s" for a, b, _ in decays)
        notes.append(
            f"the record holds {len(decays)} free decays, {listed}; that from {first:.4g} s was fitted: choose another "
            "by start and stop"
        )
    elif first > float(record.time_s[0]) + 0.5 * record.step_s:
        notes.append(f"the motion is free from {first:.4g} s on, and fitted from there; choose another by start")
    else:
        return record
    step = record.step_s
    inside = np.flatnonzero((record.time_s >= first - 0.5 * step) & (record.time_s <= last + 0.5 * step))
    if inside.size < FEWEST:
        return record
    part = record.cut(int(inside[0]), int(inside[-1]) + 1)
    return replace(part, notes=(*part.notes, *notes))


def find_decays(t: Array, x: Array) -> list[tuple[float, float, float]]:
    """Return begin [s], end [s] and sum of swings of every free decay in a record, in order of time.

    t, x: shape (n,), evenly sampled. The motion begins anew where one swing is three times as large as those before.
    A decay that begins within half a swing of its stretch begins with it.
    """
    peaks = find_peaks(t, x)
    struck = _struck(peaks)
    ends = [float(peaks.time_s[k]) for k in struck[1:]] + [float(t[-1])]
    begins = [float(t[0]), *ends[:-1]]
    found = []
    for begin, end in zip(begins, ends, strict=True):
        inside = (t >= begin) & (t <= end)
        try:
            fit, _, _, own = free_decay(t[inside], x[inside], None)
        except RecordingError:
            continue
        start = begin if fit.start_s <= begin + _AT_ONCE * own.half_period_s else fit.start_s
        found.append((start, end, float(own.swing.sum())))
    return found


def _struck(peaks: Peaks) -> Sequence[int]:
    """Return the peaks at which a motion begins: the first, and those that a new stroke leads away from."""
    swing = peaks.swing
    large = _LARGE * float(swing.max(initial=0.0))
    new = [
        k
        for k in range(_CALM, swing.size - _FEWEST_SWINGS)
        if swing[k] >= max(large, _STRUCK * float(swing[k - _CALM : k].max()))
    ]
    return [0, *new]
