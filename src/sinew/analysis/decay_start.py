"""This is where the free decay begins: after a rest, a hold, a hand's release or a forced oscillation."""

import numpy as np
from numpy.typing import NDArray

from sinew.analysis.peaks import Peaks, noise_level
from sinew.measure.errors import RecordingError

__all__ = ["drive_stop", "first_free_peak"]

Array = NDArray[np.float64]

_BEFORE, _AFTER = 6, 8  # swings looked at on both sides of a possible stop of the drive
_FLAT = 0.35  # forced: before the stop the swings shrink by less than this share of what they do after it
_EVIDENCE = 20.0  # fall of chi² that a kink must bring, against one straight line
_TOLERANCE = 0.02  # relative scatter of swings that is no evidence of anything
_LONG = 1.8  # times the next half period: longer than any free swing but one from the top of a pendulum
_STILL = 0.25  # of a swing: less motion in the half cycle before is a hold
_STEEP = 2.5  # times the shrinking that follows
_DRIVE_NOISE = 10.0  # times its noise: a drive that moves less has not moved
_LAST_DRIVE_SWING = 0.3  # of the largest: smaller swings of the drive are parasitic motion after its stop


def first_free_peak(time_s: Array, values: Array, peaks: Peaks) -> int:
    """Return the index of the first peak from which the oscillation decays freely.

    time_s, values: shape (n,), the signal the peaks were found in.

    Without anything before it that is the start of the largest swing. Behind a forced oscillation it is the kink of
    the logarithm of the swings, from level or growing to shrinking (two straight lines against one, the last such kink
    of large swings). Behind a hold or a release by hand the swing out of the hold is left out: the release takes time.
    """
    swing = peaks.swing
    first = int(np.argmax(swing))
    kink = _kink(swing, np.sqrt(2.0) * peaks.value_std)
    if kink is not None:
        first = max(first, kink)
    while first + 1 < swing.size and _is_released(time_s, values, peaks, first):
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
