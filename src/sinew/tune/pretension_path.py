"""This is where the pretension moves while the resonance is tracked: not at all, on a ramp, or after a frequency."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

__all__ = ["FASTEST_MM_S", "Follow", "PretensionPath", "Ramp", "Stand"]

FASTEST_MM_S = 1.5
"""Fastest change of the pretension while the joint swings [mm/s]."""


class PretensionPath(Protocol):
    """Where the pretension is to be [mm]."""

    @property
    def wanted_hz(self) -> float | None:
        """Resonance frequency that is asked for [Hz], None where the path asks for none."""
        ...

    def update(self, time: float, frequency_hz: float | None, step: float) -> float:
        """Return the pretension [mm] at a time since the start [s].

        frequency_hz: of the locked resonance, None while it is not. step: time since the last update [s].
        """
        ...


@dataclass(frozen=True, slots=True)
class Stand:
    """The pretension stays [mm]."""

    pretension_mm: float
    wanted_hz: None = None

    def update(self, time: float, frequency_hz: float | None, step: float) -> float:
        """Return the pretension [mm]."""
        return self.pretension_mm


class Ramp:
    """The pretension goes from one value to another [mm] in a time [s], after a lead [s]; it waits without a lock."""

    wanted_hz: None = None

    def __init__(self, first_mm: float, last_mm: float, duration: float, lead: float = 0.0) -> None:
        self._mm, self._last, self._lead = first_mm, last_mm, lead
        self._speed = min(abs(last_mm - first_mm) / duration, FASTEST_MM_S) if duration > 0 else FASTEST_MM_S

    def update(self, time: float, frequency_hz: float | None, step: float) -> float:
        """Return the pretension [mm]."""
        if frequency_hz is not None and time >= self._lead:
            reach = self._speed * step
            self._mm += max(-reach, min(reach, self._last - self._mm))
        return self._mm


class Follow:
    """The pretension moves so that the resonance is at a commanded frequency: the outer loop.

    wanted: frequency [Hz] at a time since the start [s]. table_mm, table_hz: resonance over pretension as expected;
    only its slope and its start are used, the rest is the controller's. rate: K_o [1/s], at most a fifth of the phase
    loop's crossover.

    With f the locked resonance and s = df/dp of the table at f, dp/dt = (df_wanted/dt + K_o (f_wanted - f)) / s, at
    most `fastest` [mm/s] and within the table's range: the pretension is itself the integral, so it cannot wind up.
    """

    def __init__(
        self,
        wanted: Callable[[float], float],
        table_mm: Sequence[float],
        table_hz: Sequence[float],
        rate: float,
        fastest: float = FASTEST_MM_S,
    ) -> None:
        self._table_mm, self._table_hz = np.asarray(table_mm, dtype=float), np.asarray(table_hz, dtype=float)
        if self._table_mm.size < 2 or (np.diff(self._table_mm) <= 0).any() or (np.diff(self._table_hz) <= 0).any():
            raise ValueError("following a frequency needs a resonance that rises with pretension, at two or more")
        self._wanted, self._rate, self._fastest = wanted, rate, fastest
        self._mm = float(np.interp(wanted(0.0), self._table_hz, self._table_mm))
        self._before = wanted(0.0)
        self.wanted_hz: float | None = self._before

    def update(self, time: float, frequency_hz: float | None, step: float) -> float:
        """Return the pretension [mm]."""
        asked = self._wanted(time)
        moved, self._before, self.wanted_hz = asked - self._before, asked, asked
        if frequency_hz is not None:
            change = (moved + self._rate * step * (asked - frequency_hz)) / self.slope(frequency_hz)
            reach = self._fastest * step
            self._mm += max(-reach, min(reach, change))
            self._mm = min(max(self._mm, float(self._table_mm[0])), float(self._table_mm[-1]))
        return self._mm

    def slope(self, frequency_hz: float) -> float:
        """Return df/dp of the table [Hz/mm] where the resonance is at a frequency [Hz]."""
        slopes = np.diff(self._table_hz) / np.diff(self._table_mm)
        at = int(np.searchsorted(self._table_hz, frequency_hz)) - 1
        return float(slopes[min(max(at, 0), slopes.size - 1)])
