"""This is where a device's own clock is held against the host's, so that an old answer is not taken for a new one.

A bus may deliver late what was asked a cycle before: whole, with the right id and the right CRC. Its values are then
good, but of another time. Every device counts its own time, and that gives such an answer away.
"""

import math

__all__ = ["ClockTrack"]

_TOLERANCE = 3e-3  # s; an answer that is a cycle of 5 ms old is found, a host that was 2 ms late is not disturbed
_DRIFT = 0.01  # of the time since the last answer; far more than two crystals differ by
_WEIGHT = 0.05
_FORGETS_AFTER = 0.1  # s
_FIRST_ANSWERS = 3


class ClockTrack:
    """Follows the difference between a device's counter and the host's clock.

    unit: of a count [s]. span: the counter counts 0 to span - 1 and begins anew.

    An answer is fresh if the counter has advanced by as much as the host's clock since the last fresh one, within 3 ms
    and 1 % of the time that has passed. One that is not fresh changes nothing, except among the first three: if the
    very first was an old one, the next runs ahead of it and takes its place. A device that has started anew is
    therefore not fresh until `reset`.
    """

    def __init__(self, unit: float, span: int) -> None:
        self._unit, self._span = unit, span
        self.reset()

    def reset(self) -> None:
        """Begin anew: the next answer is fresh."""
        self._time, self._count, self._answers = math.nan, 0.0, 0

    def is_fresh(self, count: int, time: float) -> bool:
        """Return whether an answer with this count belongs to this host time [s]."""
        if not self._answers:
            self._take(time, count)
            return True
        passed = time - self._time
        expected = self._count + passed / self._unit
        half = self._span / 2
        ahead = ((count - expected + half) % self._span - half) * self._unit
        tolerance = _TOLERANCE + _DRIFT * passed
        if abs(ahead) <= tolerance:
            weight = 1.0 if passed > _FORGETS_AFTER else _WEIGHT
            self._take(time, expected + weight * ahead / self._unit)
            return True
        if self._answers < _FIRST_ANSWERS and 0 < ahead < _FORGETS_AFTER:
            self._take(time, count)
            return True
        return False

    def host_time(self, count: int) -> float:
        """Return the host time [s] of a count of the device, by the last fresh answer; NaN before one."""
        half = self._span / 2
        return self._time + ((count - self._count + half) % self._span - half) * self._unit

    def _take(self, time: float, count: float) -> None:
        self._time, self._count = time, count % self._span
        self._answers += 1
