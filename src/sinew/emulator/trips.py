"""This is where it is noted when a bus watchdog has stopped a motor, and what became of it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sinew.emulator.line import Line
from sinew.emulator.motor import Motor

__all__ = ["WATCHED_S", "Trip", "TripLog"]

WATCHED_S = 0.3
"""For how long a motor is watched after it was stopped [s]."""

_STEP = 2e-3


@dataclass(slots=True)
class Trip:
    """A motor that was stopped by its bus watchdog; times are emulated [s].

    motor: its id. heard: when the last instruction had passed. tripped: when the watchdog stopped it.
    turned: how far it then went from there, at most, within `WATCHED_S` [rad]: it holds its place as stiffly as its
    controller can, and the joint may still swing. instructions, group_reads: that had passed since the start.
    """

    motor: int
    heard: float
    tripped: float
    turned: float
    instructions: int
    group_reads: int


class TripLog:
    """Sees to it that nothing of that is missed. To be asked to `look` whenever a motor has done something.

    trips: in the order of time. due: when to look next [s]; infinite: when a motor is due.
    """

    def __init__(self, motors: Sequence[Motor], line: Line) -> None:
        self._motors, self._line = motors, line
        self._tripped = [False] * len(motors)
        self._watched: list[tuple[Trip, Motor, float]] = []
        self.trips: list[Trip] = []
        self.due = math.inf

    def look(self, now: float) -> None:
        """Note who has been stopped, and who still moves, at a time [s]."""
        for index, motor in enumerate(self._motors):
            was, self._tripped[index] = self._tripped[index], motor.is_tripped
            if self._tripped[index] and not was:
                self._begin(motor, now)
        if self._watched and now >= self.due:
            self._follow(now)

    def _begin(self, motor: Motor, now: float) -> None:
        line = self._line
        trip = Trip(motor.id, line.heard_at, now, 0.0, line.instructions, line.group_reads)
        self.trips.append(trip)
        self._watched.append((trip, motor, motor.horn.motion().angle))
        self.due = min(self.due, now + _STEP)

    def _follow(self, now: float) -> None:
        self._watched = [seen for seen in self._watched if now <= seen[0].tripped + WATCHED_S and seen[1].is_tripped]
        for trip, motor, start in self._watched:
            trip.turned = max(trip.turned, abs(motor.horn.motion().angle - start))
        self.due = now + _STEP if self._watched else math.inf
