"""This is where one group of the plan is run: settle, then record; or drive, stop, and record the free decay."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

from sinew.bench.loop import Loop
from sinew.bench.sample import Sample
from sinew.bench.settle import SettleRule
from sinew.measure.schema import SegmentKind
from sinew.plan.plan import Group

# The drive's motion in one group is a function of time.


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


_QUIET_RATE = math.radians(3.0)
_QUIET_S = 0.3
_PAUSE_MOST_S = 4.0


class Segments(Protocol):
    """Where the samples of the present stretch go."""

    def begin(self, kind: SegmentKind) -> None:
        """Begin a segment; samples belong to it from now on."""
        ...

    def end(self) -> None:
        """End the segment: it is complete."""
        ...


def run_group(loop: Loop, group: Group, sample_hz: float, segments: Segments, settle: SettleRule | None = None) -> None:
    """Run a group from rest; its samples go to `segments`, settle and record apart.

    settle: an adaptive rule for a steady group; None keeps the plan's settle_s.
    Whatever loop.cycle raises passes through, with the segment left open.
    """
    settle_count, record_count = group.sample_counts(sample_hz)
    if group.kind == "idle":
        _record(loop, segments, "idle", record_count)
        return
    start = loop.due
    swing = Swing(math.radians(group.amplitude_deg), group.frequency_hz, start)
    if group.kind == "ring-down":
        swing = replace(swing, stop=swing.crossing_after(start + group.settle_s - 1e-6))
    segments.begin("settle")
    if settle is None:
        _until(loop, start + settle_count / sample_hz if group.kind != "ring-down" else swing.stop, swing)
    else:
        _settle(loop, swing, settle)
    segments.end()
    _record(loop, segments, group.kind, record_count, swing)


def pause(loop: Loop) -> None:
    """Let the joint come to rest, lever at zero: until the torsion's rate stays small, or four seconds."""
    window = round(_QUIET_S / loop.period)
    rates: deque[float] = deque(maxlen=window)
    for _ in range(round(_PAUSE_MOST_S / loop.period)):
        rate = loop.cycle().gyro_rad_s[0]
        if not math.isnan(rate):
            rates.append(abs(rate))
        if len(rates) == window and max(rates) < _QUIET_RATE:
            return


def _record(
    loop: Loop, segments: Segments, kind: SegmentKind, count: int, drive: Callable[[float], float] | None = None
) -> None:
    segments.begin(kind)
    for _ in range(count):
        loop.cycle(drive) if drive is not None else loop.cycle()
    segments.end()


def _until(loop: Loop, end: float, drive: Callable[[float], float]) -> None:
    """Run all cycles that begin before a host time [s]."""
    while loop.due < end - 0.01 * loop.period:
        loop.cycle(drive)


@dataclass(slots=True)
class _Period:
    """Samples of the drive period under way."""

    times: list[float]
    rates: list[float]

    def take(self, sample: Sample) -> None:
        if not math.isnan(sample.gyro_rad_s[0]):
            self.times.append(sample.imu_time_s)
            self.rates.append(sample.gyro_rad_s[0])


def _settle(loop: Loop, swing: Swing, rule: SettleRule) -> None:
    """Run whole periods until the rule says that the response is steady."""
    turn = 0
    while not rule.is_settled:
        turn += 1
        period = _Period([], [])
        end = swing.start + turn / swing.frequency_hz
        while loop.due < end - 0.01 * loop.period:
            period.take(loop.cycle(swing))
        rule.feed(period.times, period.rates)
