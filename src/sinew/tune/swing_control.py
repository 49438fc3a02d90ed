"""This is where the size of the swing is held: by the lever's command, by the lever, or by the torsion."""

import math
from typing import Literal

__all__ = ["Held", "SwingControl"]

Held = Literal["command", "lever", "torsion"]

_LOG_STEP = 0.7  # of a decade's natural logarithm at most that one correction counts as


class SwingControl:
    """Sets the amplitude of the lever's command.

    held: which amplitude is to be `wanted` [rad]: the command's own, or the measured one of lever or torsion.
    most: of the command [rad]. rise: time in which the command may grow from nothing to `most`, or fall [s].
    rate: of the correction [1/s], well below the mode's decay rate.
    The correction is an integrator of the amplitude's logarithm, so a loop of any gain settles alike; at `most` it
    stands still (anti-windup).
    """

    def __init__(self, held: Held, wanted: float, most: float, rise: float, rate: float) -> None:
        self._held, self._wanted, self._most, self._rise, self._rate = held, wanted, most, rise, rate
        self._aim = min(wanted, most)
        self.amplitude = 0.0

    @property
    def is_limited(self) -> bool:
        """Whether more than the largest command would be needed."""
        return self._held != "command" and self._aim >= self._most

    def update(self, measured: float | None, step: float) -> float:
        """Return the next amplitude of the command [rad].

        measured: amplitude of lever or torsion [rad], None where there is none or the phase is not locked yet.
        step: time since the last update [s].
        """
        if self._held != "command" and measured is not None and measured > 0:
            off = math.log(self._wanted / measured)
            self._aim *= math.exp(self._rate * step * max(-_LOG_STEP, min(_LOG_STEP, off)))
            self._aim = min(self._aim, self._most)
        reach = self._most * step / self._rise
        self.amplitude += max(-reach, min(reach, self._aim - self.amplitude))
        return self.amplitude
