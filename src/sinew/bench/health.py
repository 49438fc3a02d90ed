"""This is where it is told once a second how a run fares: cycles, bus, temperatures, progress."""

import json
import math
from dataclasses import asdict
from typing import Any

from sinew.bench.loop import Loop
from sinew.hardware.bus import Bus

__all__ = ["HEALTH_S", "Health", "Progress"]

HEALTH_S = 1.0
"""Time between two reports [s]."""


class Progress:
    """How far a run is. state: what it is at, in words. done_s, total_s: of the plan [s]; group, groups: of the plan.

    group counts from 0 and is None before the first. newest_s: time of the newest cycle, by the run's clock [s].
    """

    def __init__(self, groups: int, total_s: float) -> None:
        self.state = "starting"
        self.group: int | None = None
        self.newest_s = 0.0
        self.groups, self.total_s = groups, total_s
        self._before = self._length = 0.0
        self._began: float | None = None

    def begin(self, group: int, before_s: float, length_s: float, now: float) -> None:
        """Note that a group begins, after so much of the plan [s]."""
        self.group, self._before, self._length, self._began = group, before_s, length_s, now

    def end(self) -> None:
        """Note that the group under way is over."""
        self._before, self._began = self._before + self._length, None

    def done_s(self, now: float) -> float:
        """Return how much of the plan is done at a time of the run's clock [s]."""
        under_way = 0.0 if self._began is None else min(self._length, max(0.0, now - self._began))
        return self._before + under_way


class Health:
    """Gathers what is told, from the loop, the bus and the progress of a run."""

    def __init__(self, loop: Loop, bus: Bus, progress: Progress) -> None:
        self._loop, self._bus, self._progress = loop, bus, progress
        self._celsius: dict[str, float] = {}
        self._told = -math.inf
        self._volts = math.nan

    def take(self, now: float, supply_v: float) -> str | None:
        """Take what the newest cycle told, at a time [s]; return a report as JSON when one is due, else None."""
        reading = self._loop.last
        if reading is not None and reading.climate is not None:
            self._celsius[reading.climate.name] = reading.climate.temperature
        self._volts, self._progress.newest_s = supply_v, now
        if not now - self._told >= HEALTH_S:
            return None
        self._told = now
        return json.dumps(self.document(now))

    def document(self, now: float) -> dict[str, Any]:
        """Return how the run fares at a time [s]."""
        cycles, progress = self._loop.statistics, self._progress
        return {
            "state": progress.state,
            "cycles": cycles.cycles,
            "missed": cycles.missed,
            "incomplete": cycles.incomplete,
            "worst_late_ms": round(1e3 * cycles.worst_late_s, 3),
            "busy_ms": round(1e3 * cycles.busy_s / max(1, cycles.cycles), 3),
            "temperature_c": dict(sorted(self._celsius.items())),
            "supply_v": None if math.isnan(self._volts) else round(self._volts, 2),
            "bus": asdict(self._bus.statistics),
            "done_s": round(progress.done_s(now), 2),
            "total_s": round(progress.total_s, 2),
            "group": progress.group,
            "groups": progress.groups,
        }
