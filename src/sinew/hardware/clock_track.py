"""This is where a device's own clock is held against the host's, so that an old answer is not taken for a new one.

A bus may deliver late what was asked a cycle before: whole, with the right id and the right CRC. Its values are then
good, but of another time. Every device counts its own time, and that gives such an answer away.
"""

import math
from statistics import median_high

__all__ = ["ClockTrack"]

_TOLERANCE = 3e-3  # s; an answer that is a cycle of 5 ms old is found, a host that was 2 ms late is not disturbed
_DRIFT = 0.01  # of the time since the last answer; far more than two crystals differ by
_WEIGHT = 0.05
_GAP = 0.1  # s
_SETTLED = 15


class ClockTrack:
    """Follows the difference between a device's counter and the host's clock.

    unit: of a count [s]. span: the counter counts 0 to span - 1 and begins anew.

    An answer is fresh if the counter has advanced by as much as the host's clock, within 3 ms. The first 15 answers,
    and those after a gap of 0.1 s, are held against their median, so that a single one, old or with a wrong stamp of
    the host, does not decide; after a gap they must also agree with what was before, within 1 % of the gap. A device
    that has started anew is therefore not fresh until `reset`.
    """

    def __init__(self, unit: float, span: int) -> None:
        self._unit, self._span = unit, span
        self.reset()

    def reset(self) -> None:
        """Begin anew: the next answer is fresh."""
        self._time = self._fresh = math.nan
        self._count = 0.0
        self._first: list[float] | None = None
        self._doubt = _GAP

    def is_fresh(self, count: int, time: float) -> bool:
        """Return whether an answer with this count belongs to this host time [s]."""
        if math.isnan(self._time):
            self._time, self._count, self._fresh, self._first = time, count, time, [0.0]
            return True
        passed = time - self._fresh
        if passed > _GAP:
            self._settle()
            self._first, self._doubt = [], _TOLERANCE + _DRIFT * passed
        ahead = self._since(count, time) - (time - self._time)
        if self._first is not None:
            return self._is_among_first(ahead, time)
        if abs(ahead) > _TOLERANCE:
            return False
        self._count = (self._count + (time - self._time + _WEIGHT * ahead) / self._unit) % self._span
        self._time = self._fresh = time
        return True

    def host_time(self, count: int) -> float:
        """Return the host time [s] of a count of the device, by its answers so far; NaN before one."""
        middle = median_high(self._first) if self._first else 0.0
        return self._time + self._since(count, self._fresh) - middle

    def _since(self, count: int, near: float) -> float:
        """Return by how much the counter has advanced since the reference [s], taken to be about at a host time [s]."""
        expected = (near - self._time) / self._unit
        half = self._span / 2
        return ((count - self._count - expected + half) % self._span - half + expected) * self._unit

    def _is_among_first(self, ahead: float, time: float) -> bool:
        assert self._first is not None
        if abs(ahead) > self._doubt:
            return False
        self._first.append(ahead)
        fresh = abs(ahead - median_high(self._first)) <= _TOLERANCE
        if fresh:
            self._fresh = time
        if len(self._first) >= _SETTLED:
            self._settle()
        return fresh

    def _settle(self) -> None:
        """Move the reference by the median of what was seen, and follow it from now on."""
        if self._first:
            self._count = (self._count + median_high(self._first) / self._unit) % self._span
        self._first = None
