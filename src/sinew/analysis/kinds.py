"""The kind of a foreign record: a free decay, a sweep of steady stretches, a broadband drive, or hammer blows.

Without a moving drive a record can only be a decay. With one, its drive tells: short blows with rest between them, rest
at the end while the response decays, stretches of one frequency, or power over a band.
"""

import math
from typing import Literal, NamedTuple, cast

import numpy as np
import scipy
import xarray as xr

from sinew.analysis.broadband import repeats_every
from sinew.analysis.decay.free_decay import evenly, find_peaks, noise_level
from sinew.analysis.impact import find_blows, struck_force
from sinew.analysis.signal.harmonics import Group, find_groups, rising_crossings
from sinew.analysis.signal.signals import drive_channel, response_channel
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import number
from sinew.measure.recording import IMPORT_SEGMENTS, RecordKind, segment_slices

_DRIVE_NOISE = 10.0  # times its noise: a drive that moves less has perhaps not moved
_FALLS = 0.3  # share of the scatter of ln(swing) that a straight fall explains: less is no decay
_FEW_SWINGS = 6  # of which no such share is known
_AMONG = 5  # neighbouring swings, the largest of which counts: two modes make small ones between large ones
_SMALL = 0.8  # of the largest swing: the fall may begin with the last swing so large,
_LASTS = 0.25  # and takes at least that share of the swings
_STRUCK = 0.1  # of the time, at most, in which a hammer touches
_ONE_SIDED = 0.5  # of the force: what goes the other way
_AT_REST = 0.05  # of the drive's largest motion
_TAIL_SWINGS = 3  # of a decay behind a drive that stopped
_MANY_CYCLES = 10  # of a drive that is more than a pull and a release
_HELD, _NOT_HELD = 0.5, 0.2  # of the time that a drive moves: more is held frequency, less is none
_LINES, _SPREAD = 4.0, 1.3  # a broad drive has power in so many lines, and between frequencies so far apart
_RUNS = 0.8  # rank correlation of a drive's periods with time: a chirp
_COHERENT = 0.5
_SHORTEST = 64  # samples


class JudgedKind(NamedTuple):
    """Which kind a record is, and by what that was told, in half a sentence."""

    kind: RecordKind
    reason: str


class _Decay(NamedTuple):
    """Swings that fall: the largest over the last, the half period [s], how many; whether they do fall."""

    ratio: float
    half_s: float
    swings: int
    is_falling: bool


def find_kind(recording: xr.Dataset) -> JudgedKind:
    """Return which kind a foreign record is, by its longest part.

    recording: of a table. Raises RecordingError, with the kinds that are possible, where that cannot be told.

    Each rule looks for what its analysis needs. Without a drive, or with one that does not move: swings that fall. With
    a drive: it rests for nine tenths of the time but for pulses to one side that are shorter than a swing of the
    response (impact); it rests at the end, where the response decays, after one frequency, a pull or a step at most
    (ring-down); half of the time that it moves it holds frequencies, six equal periods each (sweep); it holds none, and
    its power spreads over more than four lines and a third of an octave (broadband).
    """
    where = max(segment_slices(recording), key=lambda one: one.stop - one.start)
    time = np.asarray(recording["time_s"].values[where], dtype=float)
    response, channel = response_channel(recording).values[where], drive_channel(recording)
    if channel is None:
        return _of_response(time, response, "no drive is named")
    if time.size < _SHORTEST:
        raise _unclear(f"{time.size} samples are too few to tell", "ring-down", "sweep", "broadband", "impact")
    drive = channel.values[where]
    reach, noise = float(np.ptp(drive)), noise_level(drive)
    if reach <= 1e-9 * max(1.0, float(np.abs(drive).max())):
        return _of_response(time, response, "the drive stands still")
    if reach <= _DRIVE_NOISE * noise and _held(time, find_groups(time, drive)) < _HELD:
        return _of_noise(time, response, drive)
    return _impact(time, response, drive) or _of_motion(time, response, drive, noise)


def recorded_kind(recording: xr.Dataset) -> RecordKind | Literal["auto"]:
    """Return the kind that a foreign record was read as."""
    said = recording.attrs.get("import_kind")
    if said is not None:
        return cast(RecordKind, str(said))
    return "ring-down" if "ring-down" in recording["kind"].values else "sweep"


def as_kind(recording: xr.Dataset, kind: RecordKind) -> xr.Dataset:
    """Return a foreign record labelled as of a kind; nothing else changes."""
    if recorded_kind(recording) == kind:
        return recording
    labels = np.full(recording.sizes["segment"], IMPORT_SEGMENTS[kind], dtype=object)
    labelled = recording.assign(kind=("segment", labels, recording["kind"].attrs))
    labelled.attrs = {key: value for key, value in recording.attrs.items() if key != "content_hash"}
    return labelled.assign_attrs(import_kind=kind)


def _unclear(what: str, *possible: RecordKind) -> RecordingError:
    kinds = " or ".join([", ".join(possible[:-1]), possible[-1]] if len(possible) > 1 else possible)
    return RecordingError(f"cannot tell what this record is: {what}; say it, its kind can be {kinds}")


def _of_response(time: Array, response: Array, why: str) -> JudgedKind:
    """Return a ring-down, unless the swings of a response that nothing drives do not fall.

    Where there are no swings to look at, the analysis of a ring-down says best what it lacks.
    """
    try:
        decay = _decay(time, response) if time.size >= _SHORTEST else None
    except RecordingError:
        decay = None
    if decay is None:
        return JudgedKind("ring-down", f"{why}, which leaves nothing else")
    if not decay.is_falling:
        raise RecordingError(
            f"cannot tell what this record is: {why}, and the swings of the response do not fall; where something "
            "drove it, name its column (drive), and the kind can be sweep, broadband or impact; where it decays in a "
            "part of the record, cut it there (start, stop), or say that its kind is ring-down"
        )
    return JudgedKind("ring-down", f"{why}, and the swings fall to 1/{number(decay.ratio, 2)}")


def _decay(time: Array, response: Array) -> _Decay:
    """Return whether swings fall. Raises RecordingError where there is no oscillation."""
    even, values, *_ = evenly(time, response, None)
    peaks = find_peaks(even, values)
    swing = peaks.swing[peaks.swing > 0]
    if swing.size < 2:
        raise RecordingError("no oscillation found: fewer than two swings stand out of the noise")
    starts = {int(np.argmax(swing)), int(np.flatnonzero(swing >= _SMALL * swing.max())[-1])}
    among = np.lib.stride_tricks.sliding_window_view(np.pad(swing, _AMONG // 2, mode="edge"), _AMONG)
    logs = np.log(among.max(axis=-1))
    falls = max(_fall(logs[start:]) if swing.size - start >= _LASTS * swing.size else 0.0 for start in starts)
    ratio = float(swing.max() / swing[-1])
    is_falling = ratio > 1.0 and (falls >= _FALLS or swing.size < _FEW_SWINGS)
    return _Decay(ratio, peaks.half_period_s, int(swing.size), is_falling)


def _fall(logs: Array) -> float:
    """Return the share of the scatter that a falling straight line explains, zero where it does not fall."""
    if logs.size < _FEW_SWINGS or not logs.std() > 0:
        return 0.0
    return max(0.0, -float(np.corrcoef(np.arange(logs.size), logs)[0, 1])) ** 2


def _of_noise(time: Array, response: Array, drive: Array) -> JudgedKind:
    """Return what a drive is that may be noise on purpose, or only that of a sensor.

    A response that dies soon coheres with anything in the few segments in which it lives, so the lines that cohere are
    counted against those that cohere with the same drive reversed or moved, which has driven nothing.
    """
    length = min(max(_SHORTEST, time.size // 16), time.size // 2)

    def coherent(other: Array) -> int:
        return int(np.count_nonzero(scipy.signal.coherence(other, response, nperseg=length)[1] > _COHERENT))

    by_chance = max(coherent(drive[::-1]), coherent(np.roll(drive, time.size // 3)))
    if coherent(drive) > 3 * (by_chance + 1):
        return JudgedKind("broadband", "the drive is noise, and the response coheres with it")
    return _of_response(time, response, "the drive does not move beyond its noise")


def _impact(time: Array, response: Array, drive: Array) -> JudgedKind | None:
    """Return an impact where the drive rests but for short pulses to one side, else None."""
    blows, (force, _) = find_blows(drive), struck_force(drive)
    if not blows or sum(blow.width for blow in blows) > _STRUCK * drive.size:
        return None
    if -float(force.min()) > _ONE_SIDED * float(force.max()):
        return None
    hardest = max(range(len(blows)), key=lambda k: float(force[blows[k].top]))
    stop = blows[hardest + 1].begin if hardest + 1 < len(blows) else drive.size
    ringing = response[blows[hardest].end : stop]
    if ringing.size < _SHORTEST:
        return None
    step = float(time[-1] - time[0]) / (time.size - 1)
    power = np.abs(scipy.fft.rfft(ringing - ringing.mean())) ** 2
    period = ringing.size * step / max(1, int(np.argmax(power[1:]) + 1))
    widest = step * max(blow.width for blow in blows)
    if widest > period:
        return None
    hits = "one hit" if len(blows) == 1 else f"{len(blows)} hits"
    return JudgedKind(
        "impact",
        f"the drive rests but for {hits} of at most {number(1000 * widest, 2)} ms, and the response swings on with a "
        f"period of {number(period, 2, 's')}",
    )


def _of_motion(time: Array, response: Array, drive: Array, noise: float) -> JudgedKind:
    """Return what a drive makes of a record that goes on for a while."""
    rest = float(np.median(drive[-max(3, drive.size // 20) :]))
    away = np.abs(drive - rest)
    moving = np.flatnonzero(away > max(_AT_REST * float(away.max()), 5.0 * noise))
    first, last = (int(moving[0]), int(moving[-1])) if moving.size else (0, drive.size - 1)
    tail = _tail(time, response, last)
    t, u = time[first : last + 1], drive[first : last + 1]
    groups = find_groups(t, u) if u.size >= _SHORTEST else []
    held = _held(t, groups) if groups else 0.0
    cycles = rising_crossings(t, u).size if u.size >= _SHORTEST else 0
    hertz = [group.frequency_hz for group in groups]
    several = bool(hertz) and max(hertz) > 1.005 * min(hertz)
    low, high, lines = _band(t, u)
    broad = lines >= _LINES and high >= _SPREAD * low and cycles >= _MANY_CYCLES
    if tail is not None and not (several and held >= _HELD):
        stops = f"the drive rests from {number(float(time[last]), unit='s')} on, and the swings fall to "
        if not broad or held >= _HELD:
            return JudgedKind("ring-down", f"{stops}1/{number(tail.ratio, 2)}")
        if time[-1] - time[last] > 0.5 * (time[last] - time[first]):
            raise _unclear(
                f"{stops}1/{number(tail.ratio, 2)}, but before that it holds many frequencies", "ring-down", "broadband"
            )
    if held >= _HELD:
        count = f"{len(groups)} stretches from {number(min(hertz))} to {number(max(hertz), unit='Hz')}"
        one = f"one frequency, {number(hertz[0], unit='Hz')}"
        return JudgedKind("sweep", f"the drive holds {count if several else one}, {100 * held:.0f} % of its time")
    if held <= _NOT_HELD and broad:
        return JudgedKind(
            "broadband",
            f"the drive's power spreads from {number(low, 3)} to {number(high, 3, 'Hz')}, {_manner(t, u)}",
        )
    if not broad and held <= _NOT_HELD:
        raise _unclear(
            "the drive neither rests, nor holds a frequency, nor spreads over a band", "sweep", "broadband", "ring-down"
        )
    raise _unclear(f"the drive holds a frequency for {100 * held:.0f} % of its time only", "sweep", "broadband")


def _held(time: Array, groups: list[Group]) -> float:
    """Return the share of the time in which the drive holds a frequency."""
    return sum(float(time[group.stop - 1] - time[group.start]) for group in groups) / float(time[-1] - time[0])


def _tail(time: Array, response: Array, last: int) -> _Decay | None:
    """Return the decay behind the drive's last motion; None where there is none."""
    if time.size - last < _SHORTEST // 2:
        return None
    try:
        found = _decay(time[last:], response[last:])
    except RecordingError:
        return None
    long_enough = time[-1] - time[last] >= _TAIL_SWINGS * found.half_s
    return found if long_enough and found.is_falling else None


def _band(time: Array, drive: Array) -> tuple[float, float, float]:
    """Return the frequencies that a twentieth of the power lies below and above [Hz], and in how many lines it is."""
    if drive.size < _SHORTEST:
        return math.nan, math.nan, 0.0
    rate = (time.size - 1) / float(time[-1] - time[0])
    f, power = scipy.signal.welch(drive, rate, nperseg=max(_SHORTEST, drive.size // 4))
    f, power = f[1:], power[1:]
    if not power.sum() > 0:
        return math.nan, math.nan, 0.0
    share = np.cumsum(power) / power.sum()
    low, high = (float(f[min(int(np.searchsorted(share, at)), f.size - 1)]) for at in (0.05, 0.95))
    return low, high, float(power.sum() ** 2 / np.sum(power**2))


def _manner(time: Array, drive: Array) -> str:
    """Return how a broad drive goes through its band, in words."""
    period = repeats_every(drive)
    if period is not None:
        step = float(time[-1] - time[0]) / (time.size - 1)
        return f"and repeats itself every {number(period * step, unit='s')} (a multisine)"
    lengths = np.diff(rising_crossings(time, drive))
    ranks = np.argsort(np.argsort(lengths))
    runs = float(np.corrcoef(np.arange(ranks.size), ranks)[0, 1]) if ranks.size > 2 else 0.0
    if abs(runs) >= _RUNS:
        return f"which it runs through from {'high to low' if runs > 0 else 'low to high'} (a chirp)"
    return "all of it at all times (noise)"
