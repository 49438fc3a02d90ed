"""What a run leaves behind while it goes on: its samples, what happened, how far it is and how it fares."""

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from typing import Protocol

import numpy as np

from sinew.analysis.doubts import group_doubts
from sinew.bench.loop import Loop
from sinew.bench.record.journal import Journal
from sinew.bench.record.sample import Sample
from sinew.hardware.bus import Bus
from sinew.measure import events
from sinew.measure.errors import FileError, StoppedError
from sinew.measure.recording import SegmentKind
from sinew.plan.plan import Group
from sinew.plan.rig import RigSpec

HEALTH_S = 1.0
"""Time between two reports of how a run fares [s]."""


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
        self._written_at = -math.inf

    def take(self, now: float, supply_v: float) -> events.Health | None:
        """Take what the newest cycle told, at a time [s]; return how the run fares when that is due, else None."""
        reading = self._loop.last
        if reading is not None and reading.climate is not None:
            self._celsius[reading.climate.name] = reading.climate.temperature
        self._progress.newest_s = now
        if not now - self._written_at >= HEALTH_S:
            return None
        self._written_at = now
        cycles, progress = self._loop.statistics, self._progress
        return events.Health(
            state=progress.state,
            cycles=cycles.cycles,
            missed=cycles.missed,
            incomplete=cycles.incomplete,
            worst_late_ms=round(1e3 * cycles.worst_late_s, 3),
            busy_ms=round(1e3 * cycles.busy_s / max(1, cycles.cycles), 3),
            temperature_c=dict(sorted(self._celsius.items())),
            supply_v=None if math.isnan(supply_v) else round(supply_v, 2),
            bus=asdict(self._bus.statistics),
            done_s=round(progress.done_s(now), 2),
            total_s=round(progress.total_s, 2),
            group=progress.group,
            groups=progress.groups,
        )


class Listener(Protocol):
    """Sees what happens on a bench, in the run's own thread: whoever takes long holds it up."""

    def on_sample(self, sample: Sample) -> None:
        """Take the sample of one cycle."""
        ...

    def on_event(self, event: events.Event) -> None:
        """Take what happened besides."""
        ...


class Recorder:
    """Writes into a run's journal, and passes on to a listener; where a group's segments go.

    kept: samples of the attempt under way. group: the one under way, None before the first. health: says how the run
    fares. is_over: whether the run has ended; a journal that takes nothing any more is no news then.
    """

    def __init__(self, journal: Journal, health: Health, listener: Listener | None) -> None:
        self._journal, self._listener = journal, listener
        self.health = health
        self.kept: list[Sample] = []
        self.group: Group | None = None
        self._index = self._attempt = 0
        self.is_over = False

    def expect(self, index: int, group: Group, attempt: int) -> None:
        """Have the segments that begin from now on belong to an attempt at a group of the plan, by its index."""
        self._index, self.group, self._attempt = index, group, attempt

    def begin(self, kind: SegmentKind) -> None:
        """Begin a segment of the present group."""
        assert self.group is not None
        self._journal.begin_segment(self._index, self._attempt, self.group.segment(kind))

    def end(self) -> None:
        """End the segment under way."""
        self._journal.end_segment("complete")

    def take(self, sample: Sample) -> None:
        """Take the sample of a cycle."""
        self._journal.append(sample)
        self.kept.append(sample)
        if (health := self.health.take(sample.time_s, sample.supply_v)) is not None:
            self.say(health)
        if self._listener is not None:
            self._listener.on_sample(sample)

    def say(self, event: events.Event) -> None:
        """Take what happened. Raises StoppedError where the journal does not, while the run goes on."""
        try:
            self._journal.event(event)
        except FileError as trouble:
            if not self.is_over:
                raise StoppedError(str(trouble)) from trouble
        if self._listener is not None:
            self._listener.on_event(event)

    def doubt(self, spec: RigSpec, sample_hz: float) -> None:
        """Say what speaks against the group that was just recorded."""
        group = self.group
        if group is not None and group.kind == "steady" and group.excitation == "lever":
            kept = self.kept[-group.sample_counts(sample_hz)[1] :]
            columns = np.array([(s.time_s, s.drive_rad, s.gyro_rad_s[0]) for s in kept])
            for sentence in group_doubts(spec, group.segment("steady"), *columns.T):
                self.say(events.Doubted(sentence))

    def count(self, loop: Loop, bus: Bus, more: Mapping[str, int]) -> None:
        """Leave in the journal how cycles and bus have fared; a journal that takes nothing has been complained of."""
        cycles = loop.statistics
        numbers = {"cycles": cycles.cycles, "cycles_missed": cycles.missed, "cycles_incomplete": cycles.incomplete}
        numbers |= {"readings_stale": cycles.stale, "readings_impossible": cycles.impossible}
        numbers |= {f"bus_{name}": number for name, number in asdict(bus.statistics).items()}
        with suppress(FileError):
            self._journal.count({**numbers, **more})
