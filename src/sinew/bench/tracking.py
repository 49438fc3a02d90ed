"""This is where a drive that listens runs in the bench's cycle: samples to a law, its command to the motors.

What the law is, is not the bench's business; what it may do, is. Its command stays within the rig's largest amplitude,
its pretension within the levelled range and below `MOVE_SPEED`, and the guard looks at every cycle as in any run.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from sinew.bench.group import Segments
from sinew.bench.loop import Loop
from sinew.bench.pretension import MotorMap
from sinew.bench.sample import Sample
from sinew.plan.plan import Group

MOVE_SPEED = 0.002
"""Fastest change of the pretension while the joint swings [m/s]."""

_FADE_S = 0.6
_TELL_S = 0.5
_MEMORY_S = 0.5  # as the guard's, of the parts of the tension

Say = Callable[[str, str], None]


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

    def tell(self) -> Mapping[str, float | bool | None]:
        """Return its present state, by names that carry their units; `is_locked` is among them."""
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
        way = self._last.pretension_mm - self._first.pretension_mm
        return (self.pretension_mm - self._first.pretension_mm) / way if way else 0.0

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
    loop: Loop, group: Group, sample_hz: float, law: DriveLaw, segments: Segments, say: Say, mover: Mover | None
) -> Mapping[str, float | bool | None]:
    """Run a law for the length of a group, then let the lever come to rest; return the law's last state.

    mover: moves the pretension after the law; None where it stays. say: takes ("track", state as JSON) twice a second
    and ("lock", sentence) when the lock comes or goes.
    Whatever loop.cycle raises passes through, with the segment left open.
    """
    largest = math.radians(loop.limits.drive_amplitude_deg)
    _, count = group.sample_counts(sample_hz)

    def command(time: float) -> float:
        return max(-largest, min(largest, law.command(time)))

    segments.begin("tracking")
    told, was_locked = -math.inf, False
    for index in range(count):
        sample = loop.cycle(command)
        _pass_on(law, sample)
        if mover is not None:
            mover.move(law.pretension_mm)
        if index * loop.period - told >= _TELL_S:
            told = index * loop.period
            say("track", json.dumps(dict(law.tell())))
        was_locked = _tell_lock(law.tell(), was_locked, say) if index % 10 == 0 else was_locked
    segments.end()
    last, begin = law.tell(), loop.due
    for _ in range(round(_FADE_S / loop.period)):
        loop.cycle(lambda time: max(0.0, 1 - (time - begin) / _FADE_S) * command(time))
    return last


def _pass_on(law: DriveLaw, sample: Sample) -> None:
    law.take(sample.time_s, sample.time_s, sample.drive_rad, sample.imu_time_s, sample.gyro_rad_s[0])


def _tell_lock(state: Mapping[str, float | bool | None], was_locked: bool, say: Say) -> bool:
    is_locked = bool(state["is_locked"])
    if is_locked != was_locked:
        frequency, elapsed = state.get("frequency_hz"), state.get("elapsed_s")
        what = "locked" if is_locked else "the lock is lost"
        say("lock", f"{what} at {frequency:.3f} Hz, {elapsed:.1f} s after the start")
    return is_locked
