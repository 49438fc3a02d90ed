"""Samples that tell of a decay: angles unwrapped, clipped and frozen ones left out, gaps bridged where a model can."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from sinew.analysis.decay.free_decay import LARGEST_GAP, checked_record, evenly, first_half_period, noise_level
from sinew.analysis.signal.signals import is_cut_off, resolution, rows_of_one_value
from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import RecordingError, TimeError
from sinew.measure.estimate import number

_TURNS = {"deg": 360.0, "rad": 2.0 * np.pi}
_WITHIN = 1.02  # turns that a sensor shows which wraps
_STEADY = 0.25  # of a turn from one sample to the next: a motion that is sampled well enough
_HELD = 0.2  # share of samples in rows of one value, of a sensor slower than its record
_SHORTER = 0.9  # half periods: a crest's plateau is shorter, a hold longer
_FEWEST_FROZEN, _STUCK = 6, 2.0  # samples of one value; times as long as rounding rests on a crest
_JUMP = 1.5  # of the fastest change from sample to sample
_STEPS_OF_MOTION = 8.0  # of the resolution: less motion beside a row of equal samples says nothing of it
_ALIVE = 0.1  # of the range: a record that ends in a row of equal samples was still moving by this much
_STILL_ALIVE = 0.02  # and one that goes on after the row is moving by this much
_LONG_PIECE = 0.2  # of the samples: a shorter one says less of the motion than all pieces in a row
_LONGEST_BRIDGE = 1.0  # half periods that a fit goes without samples
_FEWEST = 16
_COARSE = 0.5  # of the resolution: less noise than this does not fill its steps


@dataclass(frozen=True)
class Samples:
    """A record as it can be searched and fitted.

    time_s, values: samples that tell, shape (n,), as they were taken; even_s, even: the same on an even grid, (m,),
    interpolated where samples are missing, for peaks and spectra. is_even: both are one. missing: which of the even
    ones no sample is near to, shape (m,).
    drive: on the even grid, shape (m,), or None. clock_std: relative, of the time scale.
    resolution: step of the values where they are rounded so coarsely that noise does not hide it, else 0.
    remarks: what was found and done, a sentence each.
    """

    time_s: Array
    values: Array
    even_s: Array
    even: Array
    is_even: bool
    missing: Mask
    drive: Array | None
    clock_std: float
    resolution: float
    remarks: tuple[str, ...]


def read_samples(time_s: ArrayLike, response: ArrayLike, drive: ArrayLike | None, unit: str) -> Samples:
    """Return the samples of a record that tell of its oscillation.

    time_s, response, drive: shape (n,), drive None where not measured; unit: of the response, "deg" and "rad" wrap.

    Left out: samples at a limit that cut crests off, and rows of one value that a moving body does not give. Gaps of
    up to half a period stay open: a fit needs no samples there, and the even grid is interpolated across them.
    Raises RecordingError (TimeError for time stamps and longer gaps) as `checked_record`.
    """
    t, x, lever = checked_record(time_s, response, drive, bridging=True)
    remarks: list[str] = []
    x, turns = unwrapped_angle(x, unit)
    if turns:
        remarks.append("the angle jumps by a turn where its sensor wraps; it was unwrapped")
    steps = np.diff(t)
    step = float(np.median(steps))
    gaps = np.flatnonzero(steps > LARGEST_GAP * step)
    half = _half_period(t, x, gaps)
    if gaps.size:
        where = int(np.argmax(steps))
        if half is None or steps[where] > _LONGEST_BRIDGE * half:
            much = "" if half is None else f", longer than the half period of {number(half, 3)} s that a fit bridges"
            raise TimeError(
                f"gap of {steps[where]:.3g} s after {t[where]:.3f} s{much}; analyse one side of it (--start, --stop) "
                "alone"
            )
        remarks.append(
            f"{gaps.size} gap{'s' if gaps.size > 1 else ''} of up to {steps.max():.3g} s bridged: the fit needs no "
            "samples there"
        )
    usable = np.ones(t.size, dtype=bool) if half is None else _telling(t, x, half / step, remarks)
    q = resolution(x)
    coarse = q if noise_level(x) < _COARSE * q else 0.0
    if usable.all() and not gaps.size:
        even_s, even, lever, clock = evenly(t, x, lever)
        same = even is x
        missing = np.zeros(even_s.size, dtype=bool)
        return Samples(even_s if same else t, x, even_s, even, same, missing, lever, clock, coarse, tuple(remarks))
    if np.count_nonzero(usable) < _FEWEST:
        raise RecordingError(
            f"{np.count_nonzero(usable)} of {t.size} samples are neither clipped nor frozen; check the sensor and its "
            "range"
        )
    even_s = np.linspace(t[0], t[-1], round(float(t[-1] - t[0]) / step) + 1)
    even = np.asarray(scipy.interpolate.PchipInterpolator(t[usable], x[usable], extrapolate=False)(even_s), dtype=float)
    known = np.isfinite(even)
    even = np.interp(even_s, even_s[known], even[known])
    lever = None if lever is None else np.interp(even_s, t, lever)
    after = np.clip(np.searchsorted(t[usable], even_s), 1, np.count_nonzero(usable) - 1)
    nearest = np.minimum(np.abs(even_s - t[usable][after]), np.abs(even_s - t[usable][after - 1]))
    return Samples(t[usable], x[usable], even_s, even, False, nearest > 0.6 * step, lever, 0.0, coarse, tuple(remarks))


def unwrapped_angle(values: Array, unit: str) -> tuple[Array, int]:
    """Return an angle without the jumps of a sensor that wraps, shape (n,), and how many there were.

    It stays as it is in a unit other than deg and rad, where it is seen beyond one turn, and where it would move by
    more than a quarter of a turn between two samples without its jumps: then they were none.
    """
    turn = _TURNS.get(unit)
    if turn is None or np.ptp(values) > _WITHIN * turn:
        return values, 0
    jumps = int(np.count_nonzero(np.abs(np.diff(values)) > 0.5 * turn))
    whole = np.unwrap(values, period=turn) if jumps else values
    if not jumps or np.abs(np.diff(whole)).max() > _STEADY * turn:
        return values, 0
    return np.asarray(whole, dtype=float), jumps


def _half_period(t: Array, x: Array, gaps: NDArray[np.intp]) -> float | None:
    """Return the half period in the longest piece between gaps [s], or in all of them where they are short, or None."""
    edges = np.concatenate([[0], gaps + 1, [t.size]])
    longest = int(np.argmax(np.diff(edges)))
    piece = slice(int(edges[longest]), int(edges[longest + 1]))
    for part in (piece, slice(None)):
        if t[part].size > _LONG_PIECE * t.size:
            try:
                return first_half_period(t[part], x[part], noise_level(x[part]))
            except RecordingError:
                continue
    return None


def _telling(t: Array, x: Array, half: float, remarks: list[str]) -> Mask:
    """Return which samples tell of the motion; half: half period in samples."""
    q = resolution(x)
    rows = rows_of_one_value(x)
    clipped, frozen = np.zeros(x.size, dtype=bool), np.zeros(x.size, dtype=bool)
    ends = float(x.min()), float(x.max())
    inner = sum(stop - first for first, stop in rows if first and stop < x.size and ends[0] < x[first] < ends[1])
    held = inner > _HELD * x.size  # every value stays for some samples: a row of them is no limit
    for first, stop in rows:
        if not held and stop - first <= _SHORTER * half and is_cut_off(x, first, stop, q, ends):
            clipped[first:stop] = True
        elif _is_frozen(x, first, stop, q, half):
            frozen[first + 1 : stop] = True
    if clipped.any():
        clipped |= np.isin(x, x[clipped])  # where a limit is, a crest may touch it for a sample or two
        last = t[np.flatnonzero(clipped)[-1]]
        remarks.append(
            f"the response is clipped at {' and '.join(number(float(v)) for v in np.unique(x[clipped]))} until "
            f"{last:.4g} s; {np.count_nonzero(clipped)} samples are left out"
        )
    if frozen.any():
        at = np.flatnonzero(frozen)
        why = "friction holds the body, or its sensor froze" if frozen[-1] else "the body should move"
        remarks.append(
            f"the response stands still where {why}, first at {t[at[0]]:.4g} s; {at.size} samples are left out"
        )
    return ~(clipped | frozen)


def _is_frozen(x: Array, first: int, stop: int, q: float, half: float) -> bool:
    """Return whether a row of equal samples is longer than rounding explains, amid motion, or ends a moving record."""
    count = stop - first
    if count < _FEWEST_FROZEN or first == 0:
        return False
    reach = int(np.ceil(2.0 * half))
    before, after = x[max(0, first - reach) : first], x[stop : stop + reach]
    if stop == x.size:  # what has died out stands still by right
        return bool(count > half and np.ptp(before) > max(_ALIVE * np.ptp(x), _STEPS_OF_MOTION * q))
    motion = min(float(np.ptp(before)), float(np.ptp(after)))
    if motion < max(_STEPS_OF_MOTION * q, _STILL_ALIVE * float(np.ptp(x))):
        return False
    rests = 2.0 * np.sqrt(2.0 * q / (0.5 * motion)) / np.pi * half  # a rounded sine on its crest
    fastest = 0.5 * np.pi / half * motion  # of a sample: a held body sets out from rest, a sensor that wakes up jumps
    return bool(count > _STUCK * rests and abs(x[stop] - x[stop - 1]) > _JUMP * fastest + 2.0 * q)
