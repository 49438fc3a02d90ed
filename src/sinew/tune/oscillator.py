"""This is where the drive's sine runs on: its frequency may change at any time, its phase never jumps."""

import math
from collections import deque

__all__ = ["Oscillator"]

_KEPT = 400  # pieces; two seconds of cycles, older times are told by the oldest piece


class Oscillator:
    """The sine A sin ψ(t) whose angular frequency is constant in pieces.

    time: at which its phase is zero [s]. omega: until it is changed [rad/s].
    A change acts from the latest time on that was asked for as a command, so what was sent stays true.
    """

    def __init__(self, time: float, omega: float) -> None:
        self._pieces: deque[tuple[float, float, float]] = deque([(time, 0.0, omega)], maxlen=_KEPT)
        self._latest = time
        self.amplitude = 0.0

    @property
    def omega(self) -> float:
        """Angular frequency from now on [rad/s]."""
        return self._pieces[-1][2]

    def phase(self, time: float) -> float:
        """Return ψ [rad] at a time [s], past or coming."""
        for since, phase, omega in reversed(self._pieces):
            if time >= since:
                return phase + omega * (time - since)
        since, phase, omega = self._pieces[0]
        return phase + omega * (time - since)

    def command(self, time: float) -> float:
        """Return the sine [rad] at a time [s] for which it is then fixed."""
        self._latest = max(self._latest, time)
        return self.amplitude * math.sin(self.phase(time))

    def change(self, omega: float) -> None:
        """Let the angular frequency be another one [rad/s] from the latest commanded time on."""
        if omega != self.omega:
            self._pieces.append((self._latest, self.phase(self._latest), omega))
