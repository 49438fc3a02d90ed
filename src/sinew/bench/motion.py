"""This is where the drive's motion in one group is a function of time."""

import math
from dataclasses import dataclass

__all__ = ["Swing"]


@dataclass(frozen=True, slots=True)
class Swing:
    """The lever's command A sin Ω(t - start), zero before start and from stop on.

    amplitude [rad], frequency_hz; start, stop: host times [s]. A stop belongs on a zero crossing (`crossing_after`), so
    that the command does not jump.
    """

    amplitude: float
    frequency_hz: float
    start: float
    stop: float = math.inf

    def __call__(self, time: float) -> float:
        """Return the commanded lever angle [rad] at a host time [s]."""
        if not self.start <= time < self.stop:
            return 0.0
        return self.amplitude * math.sin(math.tau * self.frequency_hz * (time - self.start))

    def crossing_after(self, time: float) -> float:
        """Return the first rising zero crossing of the command at or after a host time [s]."""
        turns = math.ceil((time - self.start) * self.frequency_hz - 1e-9)
        return self.start + max(0, turns) / self.frequency_hz
