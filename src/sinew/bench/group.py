"""One group of a plan on the bench: settling, recording, tracking; or drive, stop, and the free decay."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from sinew.bench.loop import Loop
from sinew.bench.pretension import MotorMap
from sinew.bench.record.sample import Sample
from sinew.measure.events import Event, Lock, Track, Unlock
from sinew.measure.recording import SegmentKind
from sinew.plan.plan import Group

# The drive's motion in one group is a function of time.


@dataclass(frozen=True, slots=True)
class Swing:
    """A command A sin Ω(t - start), zero before start and from stop on: the lever's, or that of driven tendons.

    amplitude [rad], frequency_hz; start, stop: host times [s]. A stop belongs on a zero crossing (`crossing_after`), so
    that the command does not jump.
    """

    amplitude: float
    frequency_hz: float
    start: float
    stop: float = math.inf

    def __call__(self, time: float) -> float:
        """Return the commanded angle [rad] at a host time [s]."""
        if not self.start <= time < self.stop:
            return 0.0
        return self.amplitude * math.sin(math.tau * self.frequency_hz * (time - self.start))

    def crossing_after(self, time: float) -> float:
        """Return the first rising zero crossing of the command at or after a host time [s]."""
        turns = math.ceil((time - self.start) * self.frequency_hz - 1e-9)
        return self.start + max(0, turns) / self.frequency_hz


_QUIET_RATE = math.radians(3.0)
_QUIET_S = 0.3
_PAUSE_MOST_S = 10.0


class Segments(Protocol):
    """Where the samples of the present stretch go."""

    def begin(self, kind: SegmentKind) -> None:
        """Begin a segment; samples belong to it from now on."""
        ...

    def end(self) -> None:
        """End the segment: it is complete."""
        ...


@dataclass(frozen=True, slots=True)
class Moving:
    """What moves in a group: the lever, or the tendons against one another while the lever stays at zero.

    swing: of the lever, or of the motor of a tendon that stands furthest from the axis. weights: of each tendon in the
    pattern, none where the lever is driven.
    """

    swing: Swing
    weights: tuple[float, ...] = ()

    @classmethod
    def of(cls, group: Group, start: float, pulley_radius: float, tendons: int) -> "Moving":
        """Return it for a group that begins at a host time [s]; the tendons stand evenly, the first at y."""
        if group.excitation == "lever":
            return cls(Swing(math.radians(group.amplitude_deg), group.frequency_hz, start))
        turns = [math.tau * i / tendons for i in range(tendons)]
        in_roll = group.excitation == "roll"
        weights = tuple(math.cos(turn) if in_roll else -math.sin(turn) for turn in turns)
        swing = Swing(1e-3 * group.amplitude_mm / pulley_radius, group.frequency_hz, start)
        return cls(swing, weights)

    def cycle(self, loop: Loop) -> Sample:
        """Run one cycle of the loop with what moves."""
        if not self.weights:
            return loop.cycle(self.swing)
        return loop.cycle(pull=lambda time: [weight * self.swing(time) for weight in self.weights])


def run_group(loop: Loop, group: Group, sample_hz: float, segments: Segments) -> None:
    """Run a group from rest; its samples go to `segments`, settle and record apart.

    Whatever loop.cycle raises passes through, with the segment left open.
    """
    settle_count, record_count = group.sample_counts(sample_hz)
    if group.kind == "idle":
        _record(loop, segments, "idle", record_count)
        return
    start = loop.due
    moving = Moving.of(group, start, loop.pulley_radius, len(loop.watch.goals))
    if group.kind == "ring-down":
        stop = moving.swing.crossing_after(start + group.settle_s - 1e-6)
        moving = replace(moving, swing=replace(moving.swing, stop=stop))
    segments.begin("settle")
    end = start + settle_count / sample_hz if group.kind != "ring-down" else moving.swing.stop
    while loop.due < end - 0.01 * loop.period:
        moving.cycle(loop)
    segments.end()
    _record(loop, segments, group.kind, record_count, moving)


def pause(loop: Loop) -> None:
    """Let the joint come to rest, lever at zero: until the head's rates stay small, or ten seconds.

    After a swing of 20° at resonance the paper's joint takes six.
    """
    window = round(_QUIET_S / loop.period)
    rates: deque[float] = deque(maxlen=window)
    for _ in range(round(_PAUSE_MOST_S / loop.period)):
        turning = loop.cycle().gyro_rad_s
        if not math.isnan(turning[0]):
            rates.append(max(map(abs, turning)))
        if len(rates) == window and max(rates) < _QUIET_RATE:
            return


def _record(loop: Loop, segments: Segments, kind: SegmentKind, count: int, moving: Moving | None = None) -> None:
    segments.begin(kind)
    for _ in range(count):
        moving.cycle(loop) if moving is not None else loop.cycle()
    segments.end()


MOVE_SPEED = 0.002
"""Fastest change of the pretension while the joint swings [m/s]."""

_FADE_S = 0.6
_TELL_S = 0.5
_MEMORY_S = 0.5  # as the guard's, of the parts of the tension


class DriveLaw(Protocol):
    """Moves the lever by what it is told of the swing. Times are of the bench's clock [s]."""

    pretension_mm: float
    """Where the pretension is to be next [mm]."""

    def command(self, time: float) -> float:
        """Return the lever's angle [rad] at a time."""
        ...

    def take(self, now: float, lever_time: float, lever: float, rate_time: float, rate: float) -> None:
        """Take a cycle's lever angle [rad] and torsion rate [rad/s], each with its time; NaN where nothing came."""
        ...

    def tell(self) -> Track:
        """Return its present state."""
        ...


@dataclass(frozen=True, slots=True)
class Levelled:
    """A pretension at which the plate was levelled [mm], by which correction about y and z [rad], and how much more
    current than the mean each motor then drew [A]."""

    pretension_mm: float
    offsets: tuple[float, float]
    extra_a: tuple[float, ...]

    @classmethod
    def of(
        cls, pretension_mm: float, offsets: tuple[float, float], share: Sequence[float], current_a: float
    ) -> "Levelled":
        """Return it from each tendon's part of the tension and the mean current [A]."""
        return cls(pretension_mm, offsets, tuple((part * len(share) - 1) * current_a for part in share))


class Mover:
    """Moves the pretension between two levelled ones; tilt correction and parts of the tension lie between theirs."""

    def __init__(self, loop: Loop, motors: MotorMap, first: Levelled, last: Levelled) -> None:
        self._loop, self._motors, self._first, self._last = loop, motors, first, last
        self.pretension_mm = first.pretension_mm
        self._mean = math.nan

    def move(self, wanted_mm: float) -> None:
        """Go towards a pretension [mm] for the next cycle, as far as range and speed allow."""
        low, high = sorted((self._first.pretension_mm, self._last.pretension_mm))
        reach = 1e3 * MOVE_SPEED * self._loop.period
        step = min(max(wanted_mm, low), high) - self.pretension_mm
        self.pretension_mm += max(-reach, min(reach, step))
        share = self._share()
        offsets = self._between(self._first.offsets, self._last.offsets, share)
        self._loop.set_goals(self._motors.goals(self.pretension_mm, (offsets[0], offsets[1])), resting=True)
        self._expect_parts(self._between(self._first.extra_a, self._last.extra_a, share))

    def _share(self) -> float:
        change = self._last.pretension_mm - self._first.pretension_mm
        return (self.pretension_mm - self._first.pretension_mm) / change if change else 0.0

    @staticmethod
    def _between(first: Sequence[float], last: Sequence[float], share: float) -> tuple[float, ...]:
        return tuple(a + share * (b - a) for a, b in zip(first, last, strict=True))

    def _expect_parts(self, extra: Sequence[float]) -> None:
        """Tell the guard which part of the tension each tendon should carry here."""
        reading = self._loop.last
        currents = [m.current for m in reading.tendons if m is not None] if reading is not None else []
        if len(currents) != len(extra):
            return
        mean = sum(currents) / len(currents)
        weight = 1 - math.exp(-self._loop.period / _MEMORY_S)
        self._mean = mean if math.isnan(self._mean) else self._mean + weight * (mean - self._mean)
        if self._mean > 0:
            self._loop.watch.share = tuple((1 + more / self._mean) / len(extra) for more in extra)


def run_tracking(
    loop: Loop,
    group: Group,
    sample_hz: float,
    law: DriveLaw,
    segments: Segments,
    say: Callable[[Event], None],
    mover: Mover | None,
) -> Track:
    """Run a law for the length of a group, then let the lever come to rest; return the law's last state.

    mover: moves the pretension after the law; None where it stays. say: takes the state twice a second, and that the
    lock comes or goes.
    Whatever loop.cycle raises passes through, with the segment left open.
    """
    largest = math.radians(loop.limits.drive_amplitude_deg)
    _, count = group.sample_counts(sample_hz)

    def command(time: float) -> float:
        return max(-largest, min(largest, law.command(time)))

    segments.begin("tracking")
    shown_at, was_locked = -math.inf, False
    for index in range(count):
        sample = loop.cycle(command)
        law.take(sample.time_s, sample.time_s, sample.drive_rad, sample.imu_time_s, sample.gyro_rad_s[0])
        if mover is not None:
            mover.move(law.pretension_mm)
        if index * loop.period - shown_at >= _TELL_S:
            shown_at = index * loop.period
            say(law.tell())
        if index % 10 == 0 and (state := law.tell()).is_locked is not was_locked:
            was_locked = state.is_locked
            kind = Lock if was_locked else Unlock
            say(kind.of(frequency_hz=state.frequency_hz, elapsed_s=state.elapsed_s))
    segments.end()
    last, begin = law.tell(), loop.due
    for _ in range(round(_FADE_S / loop.period)):
        loop.cycle(lambda time: max(0.0, 1 - (time - begin) / _FADE_S) * command(time))
    return last
