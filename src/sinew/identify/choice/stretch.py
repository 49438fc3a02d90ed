"""The stretch of a record that is fitted: between two times, an angle unwrapped, and of a free decay its free part."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sinew.analysis.decay.free_decay import Peaks, evenly, find_peaks, free_decay
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
    output, turns = _unwrapped(record.output, record.output_unit)
    if turns:
        notes.append(f"the output jumps by a whole turn {_times(turns)}; it was unwrapped")
    given = record.input
    if given is not None:
        given, turns = _unwrapped(given, record.input_unit)
        if turns:
            notes.append(f"the input jumps by a whole turn {_times(turns)}; it was unwrapped")
    return replace(record, output=output, input=given, notes=(*record.notes, *notes)) if notes else record


def _unwrapped(values: Array, unit: str) -> tuple[Array, int]:
    """Return an angle without jumps of a turn, and how many there were; as it is where it never was within one turn."""
    if unit != "rad" or np.ptp(values) > 2 * np.pi * 1.001:
        return values, 0
    turns = int(np.count_nonzero(np.abs(np.diff(values)) > np.pi))
    if not turns:
        return values, 0
    whole = np.unwrap(values)
    return (whole, turns) if np.abs(np.diff(whole)).max() < 0.5 * np.pi else (values, 0)


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def free_part(record: Record) -> Record:
    """Return the free part of a free decay, found as `analyse` finds it, and a note where that is not all of it.

    Of several decays in one record it is the one with most swing. A record that begins free, within half a swing, and
    one in which no free decay is found stays as it is.
    """
    if record.excitation != "none":
        return record
    try:
        t, x, _, _ = evenly(record.time_s, record.output, None)
        decays = find_decays(t, x)
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
