"""Which rows of a foreign recording are no measurement, and what its time stamps are worth.

Rows over again or out of order, a clock set back or standing still, single failed reads, turns of an angle or a
counter are mended where the neighbours decide it, with one note each. Honest stamps stay, jittering or irregular as
they may be. Stamps that a busy host gave late to regular samples (see `has_clock`) are replaced by the straight line
through them. Gaps are refused, split, or bridged: then they stay where they are, for a fit that needs no samples there.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import TimeError
from sinew.measure.files.names import says

Gaps: TypeAlias = Literal["refuse", "split", "bridge"]
Rows: TypeAlias = "int | NDArray[np.int64]"
"""Data row of the first sample, or of each where some were left out; for the sentences of errors."""


def _row_of(rows: Rows, index: int) -> int:
    return index + rows if isinstance(rows, int) else int(rows[index])


# Late stamps are told from missing samples, by the regular clock behind them.
#
# A logger that samples regularly can still stamp badly: samples wait in a serial buffer while the host is busy, and
# then many of them get almost the same stamp. Such stamps are late but never early, so the earliest of them lie on a
# straight line over the sample index. A burst leaves that line and comes back to it; where samples are missing the
# line itself jumps. Stamps alone cannot tell a serial buffer from a recorder that by design takes a few quick samples
# and then sleeps.
#
# In all functions `stamps` are the time stamps [s], shape (n,), not decreasing; `steps` their differences; `step` the
# sampling step [s].


# A pause counts as a gap from this many missing samples on: one or two leave honest stamps and little else.
_FEWEST_MISSING = 3
# Below this many samples a regular clock behind ragged stamps cannot be recognised.
_FEWEST_FOR_CLOCK = 64


@dataclass(frozen=True)
class Gap:
    """A stretch without samples.

    after: index of the last sample before the gap; start_s, stop_s: stamps around it [s].
    missing: about how many samples it lacks.
    """

    after: int
    start_s: float
    stop_s: float
    missing: int


def is_even(stamps: Array, steps: Array) -> tuple[bool, float]:
    """Return whether nine steps in ten are within half a step of the usual one, and that step [s]."""
    lag = _lag(stamps.size)
    step = float(np.median(stamps[lag:] - stamps[:-lag])) / lag or float(steps.mean())
    low, high = np.quantile(steps, 0.05, method="higher"), np.quantile(steps, 0.95, method="lower")
    return bool(low > 0.5 * step and high < 1.5 * step), step


def has_clock(stamps: Array, steps: Array) -> bool:
    """Return whether ragged stamps come from samples that were taken regularly.

    Steps without a clock add up like a random walk: over k steps their sum spreads sqrt(k) times as much as one of
    them. Stamps that are only late spread over k steps no more than they are late.
    """
    if stamps.size < _FEWEST_FOR_CLOCK:
        return False
    lag = _lag(stamps.size)
    low, high = np.quantile(stamps[lag:] - stamps[:-lag], (0.16, 0.84))
    one = np.minimum(steps, 2 * np.quantile(steps, 0.99)).std()
    return bool((high - low) / 2 < 0.4 * np.sqrt(lag) * one)


def _lag(samples: int) -> int:
    return max(1, min(256, samples // 16))


def gaps_of_clock(stamps: Array, steps: Array, step: float, even: bool) -> tuple[list[Gap], bool, float]:
    """Return (gaps, whether there were pauses without missing samples, refined step [s]) of regular samples."""
    gaps: list[Gap] = []
    bursts = False
    for _ in range(4):
        before = list(afters(gaps))
        gaps, bursts = _scan_pauses(stamps, steps, step, even)
        step = _common_slope(stamps, gaps)
        if list(afters(gaps)) == before:
            break
    return gaps, bursts, step


def _scan_pauses(stamps: Array, steps: Array, step: float, even: bool) -> tuple[list[Gap], bool]:
    late = stamps - step * np.arange(stamps.size)
    late -= late[0]
    gaps: list[Gap] = []
    start, longest_burst = 0, 0.0
    for i in np.flatnonzero(steps > (_FEWEST_MISSING + 0.5) * step):
        pause = float(steps[i])
        reach = int(4 * pause / step)
        behind = late[max(start, i + 1 - max(reach, 16 if even else 128)) : i + 1]
        ahead = late[i + 1 : i + 1 + max(reach, 16 if even else 256)]
        missing = round((float(ahead.min()) - float(behind.min())) / step)
        if missing < _FEWEST_MISSING or _is_cut_short(ahead, pause, step, longest_burst):
            longest_burst = max(longest_burst, pause)
        else:
            missing = min(missing, round(pause / step) - 1)
            gaps.append(Gap(int(i), float(stamps[i]), float(stamps[i + 1]), missing))
            start = int(i) + 1
    return gaps if even else _merged(gaps), longest_burst > 0


def _merged(gaps: list[Gap]) -> list[Gap]:
    """Return gaps of bursty stamps, those inside one burst joined at the longest pause.

    The stamps between two pauses of a burst are all late, so how much is missing at which of them is not known.
    """
    merged: list[Gap] = []
    for gap in gaps:
        if merged and gap.after - merged[-1].after < _FEWEST_FOR_CLOCK:
            before = merged.pop()
            longer = max(before, gap, key=lambda g: g.stop_s - g.start_s)
            gap = replace(longer, missing=before.missing + gap.missing)  # noqa: PLW2901
        merged.append(gap)
    return merged


def _is_cut_short(ahead: Array, pause: float, step: float, longest_burst: float) -> bool:
    """Return whether the record ends while the stamps after a pause are still catching up."""
    if ahead.size >= pause / step:
        return False
    if ahead.size < 3:
        return longest_burst > pause / 2
    return float(ahead[-1] - ahead[0]) < -0.3 * step * (ahead.size - 1)


def gaps_of_irregular(stamps: Array, steps: Array) -> list[Gap]:
    """Return the pauses that stand out from uneven steps."""
    usual = float(np.median(steps))
    limit = max((_FEWEST_MISSING + 0.5) * usual, 4 * float(np.quantile(steps, 0.95, method="lower")))
    mean = float(steps[steps <= limit].mean())
    found = np.flatnonzero(steps > limit)
    return [Gap(int(i), float(stamps[i]), float(stamps[i + 1]), round(float(steps[i]) / mean) - 1) for i in found]


def afters(gaps: Sequence[Gap]) -> NDArray[np.int64]:
    """Return the index of the last sample before each gap."""
    return np.array([gap.after for gap in gaps], dtype=np.int64)


def _piece_index(samples: int, gaps: Sequence[Gap]) -> NDArray[np.int64]:
    return np.searchsorted(afters(gaps), np.arange(samples)).astype(np.int64)


def _centred(values: Array, piece: NDArray[np.int64]) -> Array:
    means = np.bincount(piece, weights=values) / np.bincount(piece)
    return np.asarray(values - means[piece], dtype=float)


def _common_slope(stamps: Array, gaps: Sequence[Gap]) -> float:
    """Return the least-squares slope of stamp over index, one for all pieces, each with its own offset [s]."""
    piece = _piece_index(stamps.size, gaps)
    index = _centred(np.arange(stamps.size, dtype=float), piece)
    return float(index @ _centred(stamps, piece) / (index @ index))


def off_line(stamps: Array, gaps: Sequence[Gap], step: float) -> Array:
    """Return how far each stamp is from the line of its piece [s]; the line has slope `step` and the piece's mean."""
    return _centred(stamps - step * np.arange(stamps.size), _piece_index(stamps.size, gaps))


def follows_line(stamps: Array, gaps: Sequence[Gap], step: float) -> bool:
    """Return whether no stamp strays from its line further than pauses explain (a rate that changes would)."""
    if len(gaps) > stamps.size // 8:
        return False
    pause = float(np.delete(np.diff(stamps), afters(gaps)).max())
    return bool(np.ptp(off_line(stamps, gaps, step)) <= 2 * pause + 4 * step)


Pattern = Literal["even", "jittering", "bursty", "irregular"]

FEWEST_SAMPLES = 8


@dataclass(frozen=True)
class TimeDiagnosis:
    """What the time stamps of a record are like.

    step_s: sampling step, the slope of stamp over index between gaps [s]. jitter_s: standard deviation of the stamps
    from the straight line between gaps [s]. repeated: how many stamps equal the one before.
    pattern: even (jitter below 1 % of a step), jittering, bursty (regular samples that were stamped late, in
        bursts), or irregular (steps that differ and no clock behind them).
    gaps: in order. sentence: all this in words.
    """

    step_s: float
    jitter_s: float
    repeated: int
    pattern: Pattern
    gaps: tuple[Gap, ...]
    sentence: str


@dataclass(frozen=True)
class Timeline:
    """Time that can be worked with.

    time_s: one time for each sample [s], strictly increasing inside every piece.
    pieces: the stretches between gaps. notes: sentences on what was found and done.
    """

    time_s: Array
    pieces: tuple[slice, ...]
    notes: tuple[str, ...]
    diagnosis: TimeDiagnosis


def _clock_of(stamps: Array) -> tuple[bool, bool, list[Gap], float, bool]:
    """Return (whether there is a regular clock, whether it comes in bursts, gaps, step [s], whether repeats are wrong).

    Samples that were honestly stamped never share a stamp, so repeats are late stamps or rows written twice.
    """
    steps = np.diff(stamps)
    repeated = int((steps == 0).sum())
    even, step = is_even(stamps, steps)
    clock = even or has_clock(stamps, steps) or repeated > 0.02 * stamps.size
    bursts = False
    gaps: list[Gap] = []
    if clock:
        gaps, bursts, step = gaps_of_clock(stamps, steps, step, even)
        clock = follows_line(stamps, gaps, step)
    if not clock:
        gaps, bursts, step = gaps_of_irregular(stamps, steps), False, float(steps.mean())
    twice = even and not bursts and (repeated < 5 or np.ptp(off_line(stamps, gaps, step)) > 3 * step)
    doubtful = bool(repeated and (twice or (not clock and not _are_rounded(steps))))
    return clock, bursts, gaps, step, doubtful


def diagnose_times(stamps: Array, *, rows: Rows = 1) -> TimeDiagnosis:
    """Return what a record's time stamps are like.

    stamps: time stamps as logged [s], finite, shape (n,). rows: where they stand, for the sentences of errors.
    Raises TimeError for fewer than 8 stamps, time that goes backwards, and repeated stamps without a
    regular clock behind them that could say which is which.
    """
    if stamps.size < FEWEST_SAMPLES:
        raise TimeError(f"found {stamps.size} samples, expected at least {FEWEST_SAMPLES}; record or select more")
    steps = np.diff(stamps)
    back = np.flatnonzero(steps < 0)
    if back.size:
        i = int(back[0])
        raise TimeError(
            f"time goes backwards at data row {_row_of(rows, i + 1)} (from {stamps[i]:.6g} s to "
            f"{stamps[i + 1]:.6g} s); sort the rows, keep one run of the recorder in a file, or split the record where "
            "its clock was set back (--gaps split)"
        )
    if stamps[-1] == stamps[0]:
        raise TimeError(f"all {stamps.size} time stamps are {stamps[0]:.6g} s; is this the time column?")
    clock, bursts, gaps, step, doubtful = _clock_of(stamps)
    repeated = int((steps == 0).sum())
    if doubtful:
        at = int(np.argmax(steps == 0))
        raise TimeError(
            f"data rows {_row_of(rows, at)} and {_row_of(rows, at + 1)} have the same time stamp {stamps[at]:.6g} s "
            "and no regular clock shows which is right; remove the repeated rows or export the time with more digits"
        )
    jitter = float(off_line(stamps, gaps, step).std()) if clock else float(np.delete(steps, afters(gaps)).std())
    pattern: Pattern = "irregular"
    if clock:
        pattern = "bursty" if repeated or bursts else "even" if jitter < 0.01 * step else "jittering"
    pause = float(np.delete(steps, afters(gaps)).max())
    what = {
        "even": "even",
        "jittering": f"jittering by {_time(jitter)} (kept as they are)",
        "bursty": f"stamped in bursts (jitter {_time(jitter)}, longest pause without a loss {_time(pause)}, "
        f"{100 * repeated / stamps.size:.0f} % repeated)",
        "irregular": f"irregular (steps vary by {_time(jitter)}, at most {_time(pause)}; kept as they are)",
    }[pattern]
    mean = "mean " if pattern == "irregular" else ""
    gap = f"; {_counted(len(gaps), 'gap')}, the longest {max(g.stop_s - g.start_s for g in gaps):.4g} s" if gaps else ""
    sentence = f"{stamps.size} time stamps, {mean}step {_time(step)}: {what}{gap}"
    return TimeDiagnosis(step, jitter, repeated, pattern, tuple(gaps), sentence)


def straighten_times(stamps: Array, *, gaps: Gaps = "refuse", rows: Rows = 1) -> Timeline:
    """Return time to work with: honest stamps as they are, bursty ones replaced by the straight line through them.

    stamps, rows: as in `diagnose_times`.
    gaps: refuse them; split the record there, where a piece of fewer than 8 samples is left out; or bridge them: the
        record stays one piece with uneven times, and whoever fits it judges whether a gap is short enough.
    Raises TimeError as `diagnose_times` does, for a gap that is not to be split, and if no piece is long enough.
    """
    diagnosis = diagnose_times(stamps, rows=rows)
    notes = [diagnosis.sentence]
    if diagnosis.gaps and gaps == "refuse":
        raise TimeError(_refusal(diagnosis.gaps, diagnosis.step_s, rows))
    cuts = [] if gaps == "bridge" else [gap.after + 1 for gap in diagnosis.gaps]
    edges = [0, *cuts, stamps.size]
    pieces = [slice(a, b) for a, b in pairwise(edges)]
    usable = tuple(piece for piece in pieces if piece.stop - piece.start >= FEWEST_SAMPLES)
    if not usable:
        raise TimeError(
            f"the gaps leave no piece of at least {FEWEST_SAMPLES} samples; choose a record with fewer gaps"
        )
    if diagnosis.gaps and gaps == "bridge":
        missing = _counted(sum(gap.missing for gap in diagnosis.gaps), "missing sample")
        notes.append(
            f"{_counted(len(diagnosis.gaps), 'gap')} of about {missing} bridged: the fit goes on through them and "
            "needs no samples there"
        )
    elif diagnosis.gaps:
        short = sum(piece.stop - piece.start for piece in pieces if piece not in usable)
        left_out = f", {_counted(short, 'sample')} in shorter pieces left out" if short else ""
        notes.append(f"split at {_counted(len(diagnosis.gaps), 'gap')} into {_counted(len(usable), 'piece')}{left_out}")
    time = np.array(stamps, dtype=float)
    if diagnosis.pattern == "bursty":
        time -= off_line(stamps, diagnosis.gaps, diagnosis.step_s)
        notes.append(
            f"time stamps replaced by the straight line through them, one sample every {_time(diagnosis.step_s)}"
        )
    elif diagnosis.repeated:
        time = _spread(time)
        notes.append(
            f"{_counted(diagnosis.repeated, 'stamp')} repeat the one before, for they were written with too few "
            "digits; samples of one stamp are spread over its last digit"
        )
    return Timeline(time, usable, tuple(notes), diagnosis)


_MOST_ALIKE = 3  # samples with one stamp that rounding may account for
_FEWEST_ALIKE = 5  # stamps that repeat the one before: fewer are rows written twice


def _are_rounded(steps: Array) -> bool:
    """Return whether stamps repeat because they were written with too few digits.

    All are whole multiples of the smallest step, most steps are that one, and no more than three have one stamp.
    """
    least = float(steps[steps > 0].min())
    multiples = steps / least
    whole = bool(np.abs(multiples - np.rint(multiples)).max() < 1e-3)
    repeats = steps == 0
    longest = int(np.diff(np.flatnonzero(np.concatenate([[True], ~repeats, [True]]))).max())
    usual = float(np.median(multiples[~repeats]))
    return whole and usual < 1.5 and longest <= _MOST_ALIKE and int(repeats.sum()) >= _FEWEST_ALIKE


def _spread(stamps: Array) -> Array:
    """Return stamps of which those that repeat are spread evenly over the rounding they share [s], shape (n,)."""
    steps = np.diff(stamps)
    least = float(steps[steps > 0].min())
    starts = np.flatnonzero(np.concatenate([[True], steps > 0]))
    count = np.diff(np.append(starts, stamps.size))
    size = np.repeat(count, count)
    rank = np.arange(stamps.size) - np.repeat(starts, count)
    return np.asarray(stamps + least * ((rank + 0.5) / size - 0.5), dtype=float)


def choose_stretch(time: Array, start_s: float | None, stop_s: float | None, of: str = "file") -> Mask:
    """Return which times [s] lie from start_s to stop_s, both included, shape (n,); None leaves an end open.

    of: what the times are of, for the sentence. Raises TimeError where start is not before stop, or nothing is left.
    """
    low, high = -np.inf if start_s is None else start_s, np.inf if stop_s is None else stop_s
    if not low < high:
        raise TimeError(f"found start {low:g} s and stop {high:g} s, expected start before stop")
    inside = (time >= low) & (time <= high)
    if not inside.any():
        first, last = np.nanmin(time), np.nanmax(time)
        raise TimeError(f"no samples from {low:g} s to {high:g} s; the {of} runs from {first:g} s to {last:g} s")
    return np.asarray(inside)


def _refusal(gaps: Sequence[Gap], step: float, rows: Rows) -> str:
    gap = gaps[0]
    more = f" and {_counted(len(gaps) - 1, 'more gap')}" if len(gaps) > 1 else ""
    return (
        f"gap of {gap.stop_s - gap.start_s:.4g} s after data row {_row_of(rows, gap.after)} (from {gap.start_s:.6g} s "
        f"to {gap.stop_s:.6g} s, about {gap.missing} samples of {_time(step)} missing){more}; "
        "select one side of it with start and stop (--start, --stop), or split the record at its gaps (--gaps split), "
        "or, where it is shorter than half a period, bridge it (--gaps bridge)"
    )


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _time(seconds: float) -> str:
    """Return a duration for people, in ms below a second."""
    return f"{seconds * 1e3:.4g} ms" if seconds < 1 else f"{seconds:.4g} s"


# What is no measurement: rows by their stamps, then samples by their neighbours.

_MOST_MENDS = 50  # times that go backwards in one record: more are no accidents, and the first is named
_COUNTERS = (256.0, 1024.0, 4096.0, 16384.0, 65536.0)  # of encoders: 8 to 16 bits
_COUNTED = re.compile("count|encoder|tick", re.IGNORECASE)
_OVERFLOWS_S = (86_400.0, *(2.0**bits * tick for bits in (16, 24, 32) for tick in (1e-3, 1e-6, 1e-9)))
"""After what clocks begin again: a day, and counters of ticks as microcontrollers have them [s]."""
_Mended: TypeAlias = tuple[NDArray[np.int64], Array, list[str]]


def mend_stamps(stamps: Array, rows: NDArray[np.int64], gaps: Gaps = "refuse") -> _Mended:
    """Return (places of the rows to take in their order, their stamps [s], notes on what was done).

    stamps: finite, as logged [s], shape (n,). rows: their data rows. A row from before is left out, one out of its
    order put back; where a clock was set back by a few steps, what follows is moved on; by more, which may be another
    run, it is moved on behind a gap where gaps are to be split. Of rows with one stamp in a regular clock the second is
    left out, or gets the time that it should have; rows behind the last tick of a clock are left out. What the
    neighbours do not decide stays, and `diagnose_times` names it.
    """
    places, time, notes = np.arange(stamps.size), np.array(stamps, dtype=float), []
    rises = np.diff(time)
    usual = float(np.median(rises[rises > 0])) if (rises > 0).any() else 0.0
    for _ in range(_MOST_MENDS):
        back = np.flatnonzero(np.diff(time) < 0)
        if not back.size:
            break
        at = int(back[0]) + 1
        high, ahead = time[at - 1], np.flatnonzero(time[at:] > time[at - 1])
        end = at + (int(ahead[0]) if ahead.size else time.size - at)
        behind, steps = time[at:end], np.diff(time[at:end])
        which = f"data row {rows[places[at]]}" + (f" and {end - at - 1} below it" if end - at > 1 else "")
        order = np.argsort(time[:end], kind="stable")
        few = end - at < FEWEST_SAMPLES or not np.ptp(np.searchsorted(time[:at], behind))  # or they fill a hole
        if end - at == 1 or (few and ahead.size and time[end] - behind[-1] > 1.5 * usual):
            apart = [float(np.abs(time[:at] - one).min()) for one in behind]
            if min(apart) > 0.5 * usual and behind[0] > time[0]:
                notes.append(f"{which} stood after a later one ({high:.6g} s): put back in order of time")
            else:
                twin = rows[places[int(np.argmin(np.abs(time[:at] - behind[0])))]]
                notes.append(
                    f"{which} goes back to {behind[0]:.6g} s after {high:.6g} s: row {twin} over again or a wrong "
                    f"stamp, where {high + usual:.6g} s belongs; left out"
                )
                order = np.arange(at)
            order = np.r_[order, end : time.size]
            time, places = time[order], places[order]
        elif (steps >= 0).all() and 0.5 * usual < float(np.median(steps)) < 2 * usual:
            back_s = high + usual - time[at]
            cut = back_s > FEWEST_SAMPLES * usual and min(abs(back_s - one) for one in _OVERFLOWS_S) > 2 * usual
            if cut and gaps != "split":
                break
            pause = FEWEST_SAMPLES * float(np.diff(time).max()) if cut else usual  # no step hides the cut
            notes.append(
                f"the clock was set back by {back_s:.6g} s at {which.partition(' and')[0]}: what follows is moved on, "
                f"{'a gap' if cut else 'one step'} of {_time(pause)} behind the row before"
            )
            time[at:] += back_s - usual + pause
        else:
            break
    for mend in (_still, _repeated):
        if time.size > FEWEST_SAMPLES and bool((np.diff(time) >= 0).all()):
            taken, time, said = mend(time, rows[places])
            places, notes = places[taken], [*notes, *said]
    return places, time, notes


def _still(time: Array, rows: NDArray[np.int64]) -> _Mended:
    """Leave out what stands behind the last tick of a clock that stopped."""
    ticks = np.flatnonzero(np.concatenate([[True], np.diff(time) > 0]))
    end = int(ticks[-1]) + 1
    rest = time.size - end
    if ticks.size < 2 or rest < max(FEWEST_SAMPLES, 4 * int(np.diff(ticks).max())):
        return np.arange(time.size), time, []
    note = f"the clock stands still from data row {rows[end - 1]} on: {_counted(rest, 'row')} left out"
    return np.arange(end), time[:end], [note]


def _repeated(time: Array, rows: NDArray[np.int64]) -> _Mended:
    """Leave out rows written twice in a regular clock; a stamp copied from the row before gets its own time."""
    same, repeats = np.arange(time.size), np.flatnonzero(np.diff(time) == 0) + 1
    rest = np.delete(time, repeats)
    if not repeats.size or rest.size < FEWEST_SAMPLES or not _clock_of(time)[-1]:
        return same, time, []
    even, step = is_even(rest, np.diff(rest))
    gaps, _, step = gaps_of_clock(rest, np.diff(rest), step, even)
    if not even or off_line(rest, gaps, step).std() >= 0.3 * step:
        return same, time, []
    step = float(np.median(np.diff(rest)))
    steps = np.diff(time, append=np.inf)[repeats]
    missed = repeats[(steps > 1.5 * step) & np.isfinite(steps)]
    twice = np.setdiff1d(repeats, missed)
    time = time.copy()
    time[missed] += step
    clock, notes = f"by the regular clock of {_time(step)}", []
    if missed.size:
        first = f"data row {rows[missed[0]]} has the stamp of the row before and gets {time[missed[0]]:.6g} s"
        notes.append(f"{first}, {clock} ({_counted(missed.size, 'such row')})")
    if twice.size:
        first = f"data row {rows[twice[0]]} was written twice, {clock}, and is left out"
        notes.append(f"{first} ({_counted(twice.size, 'such row')})")
    return np.delete(same, twice), np.delete(time, twice), notes


def mend_values(name: str, values: Array, unit: str, rows: NDArray[np.int64]) -> tuple[Array, list[str]]:
    """Return a response without failed reads (NaN in their place) and without turns, and notes on what was done.

    values: finite, in `unit` (SI; of a plain number as it came in, "counts"), shape (n,). name: of its column: an angle
    turns by its unit or its name, a counter by its whole numbers where unit or name say angle, encoder or count.
    """
    notes: list[str] = []
    if values.size <= FEWEST_SAMPLES or np.abs(values).max() > max(_COUNTERS):
        return values, notes
    failed = _failed_reads(values)
    if failed.any():
        first = int(np.argmax(failed))
        notes.append(
            f"{failed.sum()} samples of {name!r} stand alone at {values[first]:.6g}, far from both neighbours, the "
            f"first in data row {rows[first]}: failed reads, left out"
        )
    good = ~failed
    whole, turn = _whole_turns(name, values[good], unit)
    if turn:
        first = int(np.argmax(np.abs(np.diff(values[good])) > 0.5 * turn))
        size, at = "a whole turn" if unit == "rad" else f"{turn:g}", rows[good][first + 1]
        notes.append(f"{name!r} jumps by {size} between neighbours, first in data row {at}: turns, unwrapped")
    mended = np.full(values.size, np.nan)
    mended[good] = whole
    return mended, notes


def _failed_reads(values: Array) -> Mask:
    """Return which samples are a driver's word for a failed read: one value, alone again and again, out of range."""
    steps = np.abs(np.diff(values))
    usual = float(np.quantile(steps, 0.9))
    off = np.minimum(np.r_[np.inf, steps], np.r_[steps, np.inf])
    far = np.isfinite(off) & (off > 8 * usual) & (usual > 0)
    if not far.any() or far.all():
        return np.zeros(values.size, dtype=bool)
    levels, counts = np.unique(np.round(values[far], 9), return_counts=True)
    level = float(levels[np.argmax(counts)])
    low, high = np.quantile(values[~far], [0.02, 0.98])
    outside = abs(level - (low + high) / 2) > high - low
    return np.asarray(far & (np.abs(values - level) < 1e-8) & outside & bool(counts.max() >= 3))


def _whole_turns(name: str, values: Array, unit: str) -> tuple[Array, float]:
    """Return values without their jumps by a turn, and the turn; 0 where they make none.

    They fill more than half a turn and no more than one, jump by more than half of it now and then, and move by less
    than a third of it else. Jumps there and back at once are no turns.
    """
    whole, turning = bool((values == np.rint(values)).all()), unit == "1" and says(name, "angle")
    counted = turning or _COUNTED.search(f"{name} {unit}" if unit == "1" else unit)
    counts = _COUNTERS if whole and counted else ()
    angles: tuple[float, ...] = (2 * np.pi,) if unit == "rad" else ()
    if turning:
        angles = (360.0,) if whole else (360.0, 2 * np.pi)
    steps, span = np.diff(values), float(np.ptp(values))
    usual = float(np.quantile(np.abs(steps), 0.9))
    for turn in (*angles, *counts):
        jumps = np.abs(steps) > 0.5 * turn
        if not (0 < jumps.mean() < 0.25 and 0.5 * turn < span <= 1.001 * turn and usual < 0.3 * turn):
            continue
        back = jumps[:-1] & jumps[1:] & (np.sign(steps[:-1]) != np.sign(steps[1:]))
        unwrapped = np.unwrap(values, period=turn)
        rest = np.abs(np.diff(unwrapped))
        if 2 * back.sum() <= 0.8 * jumps.sum() and rest[jumps].max() <= 2 * rest[~jumps].max() < turn:
            return np.asarray(unwrapped), turn
    return values, 0.0
