"""One group of a plan on the bench: settling, recording, tracking; or drive, stop, and the free decay."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Protocol

import numpy as np

from sinew.bench.loop import Loop
from sinew.bench.pretension import MotorMap
from sinew.bench.record.sample import Sample
from sinew.measure.arrays import Array, Complexes
from sinew.measure.events import Event, Lock, Track, Unlock
from sinew.measure.schema import SegmentKind
from sinew.plan.plan import Group, Sweep

_MEMORY = 16  # periods; a joint that is not quite linear is followed rather than averaged
_FEWEST = 5  # periods
_HARMONICS = 3
_DECAYS = np.geomspace(0.03, 4.0, 14)  # λ·2π/Ω of the grid
_TURNS = (np.arange(22) + 0.5) * math.pi / 22  # |(ω_d - Ω) 2π/Ω| of the grid, as far as a period shows it
_FAR = 20.0  # tolerances; what was further from the end is too large for a linear model to tell the last of it
_AHEAD = np.arange(0.5, 8.5, 0.5)  # periods over which what is left is looked for
_POLISH = 4
_SIGNIFICANT = 2.0
_BOUNDS = np.array([[math.log(_DECAYS[0]), 0.02], [math.log(_DECAYS[-1]), math.pi - 0.02]])


class SettleRule:
    """Says when the response to a drive of one frequency is steady.

    settle_s: never before [s], counted from the first sample. most_s: at the latest [s]. tolerance: share of the steady
    amplitude that the transient may still have. frequency_hz: of the drive.
    """

    def __init__(self, frequency_hz: float, settle_s: float, tolerance: float, most_s: float) -> None:
        self._frequency, self._settle_s, self._tolerance, self._most_s = frequency_hz, settle_s, tolerance, most_s
        self._amplitudes: deque[Complexes] = deque(maxlen=_MEMORY)
        self._start = math.nan
        self._elapsed = 0.0
        self.remaining = math.inf

    @classmethod
    def of(cls, sweep: Sweep, frequency_hz: float) -> "SettleRule":
        """Return the adaptive rule of a plan's sweep, for one of its frequencies."""
        return cls(frequency_hz, sweep.settle_s, sweep.settle_tolerance, sweep.settle_most_s)

    @property
    def is_settled(self) -> bool:
        """Whether recording may begin: little is left of the transient, or time is up."""
        return self.is_out_of_time or (self._elapsed >= self._settle_s and self.remaining < self._tolerance)

    @property
    def is_out_of_time(self) -> bool:
        """Whether the longest time has passed."""
        return self._elapsed >= self._most_s

    def feed(self, times: Sequence[float], rates: Sequence[float]) -> None:
        """Take one period of the drive.

        times: of the samples [s]. rates: of the torsion [rad/s], or any response that is linear in it. The first period
        begins with the drive. A period with too few samples makes the rule begin anew, without turning back its time.
        """
        if times:
            self._start = times[0] if math.isnan(self._start) else self._start
            self._elapsed = times[-1] - self._start + (times[-1] - times[0]) / max(len(times) - 1, 1)
        else:
            self._elapsed += 1.0 / self._frequency
        if len(times) < 2 * (2 * _HARMONICS + 1):
            self._amplitudes.clear()
            self.remaining = math.inf
            return
        self._amplitudes.append(_amplitudes(np.asarray(times) - self._start, np.asarray(rates), self._frequency))
        if len(self._amplitudes) >= _FEWEST and self._elapsed >= self._settle_s:
            self.remaining = _remaining(_late(np.array(self._amplitudes), _FAR * self._tolerance))


def _amplitudes(time: Array, rate: Array, frequency_hz: float) -> Complexes:
    """Return √2 times the mean and the amplitudes of the harmonics over one period, such that their squares add up."""
    phase = 2.0 * np.pi * frequency_hz * time
    columns = [np.full(time.size, math.sqrt(0.5))]
    for h in range(1, _HARMONICS + 1):
        columns += [np.cos(h * phase), np.sin(h * phase)]
    found = np.linalg.lstsq(np.stack(columns, axis=1), rate, rcond=None)[0]
    return np.concatenate([found[:1].astype(complex), found[1::2] - 1j * found[2::2]])


def _late(z: Complexes, far: float) -> Complexes:
    """Return the periods after the last one that differs from the newest by more than a share; five at least."""
    away = np.sqrt((np.abs(z - z[-1]) ** 2).sum(axis=1)) > far * abs(z[-1, 1])
    start = int(np.flatnonzero(away)[-1]) + 1 if away.any() else 0
    return z[min(start, len(z) - _FEWEST) :]


def _remaining(z: Complexes) -> float:
    """Return the transient's share of the steady amplitude after the last period; z: shape (periods, 1 + harmonics).

    The grid finds the place, a few steps of Gauss-Newton the point. The scatter of the periods counts as not settled
    too: noise beyond the tolerance hides what is left. Where the transient is not significant, it is all there is.
    """
    count = len(z)
    z = z / max(float(np.abs(z[:, 1]).mean()), 1e-12)
    caught = np.einsum("gik,ic->gkc", _grid(count).conj(), z)
    best = int(np.argmax((np.abs(caught) ** 2).sum(axis=(1, 2))))
    point = np.array([math.log(_DECAYS[best // _TURNS.size]), _TURNS[best % _TURNS.size]])
    value, off = _fit(point, z)
    for _ in range(_POLISH):
        slope = np.stack([(_fit(point + step, z)[1] - off).ravel() / 1e-4 for step in 1e-4 * np.eye(2)], axis=1)
        both = np.concatenate([slope.real, slope.imag])
        move = np.linalg.lstsq(both, -np.concatenate([off.real.ravel(), off.imag.ravel()]), rcond=1e-8)[0]
        candidate = np.clip(point + np.clip(move, -0.5, 0.5), *_BOUNDS)
        new, new_off = _fit(candidate, z)
        if _square(new_off) >= _square(off):
            break
        point, value, off = candidate, new, new_off
    numbers = 2 * z.size
    plain = _square(z - z.mean(axis=0))
    freedom = numbers - 6 * z.shape[1] - 2
    if (plain - _square(off)) / (4 * z.shape[1] + 2) < _SIGNIFICANT * _square(off) / freedom:
        return math.sqrt(plain / count)
    steady, first, second = value
    q = np.exp((count - 1 + _AHEAD) * complex(-math.exp(point[0]), point[1]))[:, None]
    ahead = np.sqrt((np.abs(first * q + second * q.conj()) ** 2).sum(axis=1))
    noise = math.sqrt(2 * z.shape[1] * _square(off) / freedom)
    return float(math.hypot(ahead.max(), noise) / max(abs(steady[1]), 1e-12))


def _square(z: Complexes) -> float:
    return float((np.abs(z) ** 2).sum())


def _basis(point: Array, count: int) -> Complexes:
    """Return (1, q^k, q̄^k) for periods k = 0 .. count - 1; point: (log of the decay, turn) per period, (..., 2)."""
    k = np.arange(count)
    q = np.exp(k * (-np.exp(point[..., :1]) + 1j * point[..., 1:]))
    return np.stack([np.ones_like(q), q, q.conj()], axis=-1)


def _fit(point: Array, z: Complexes) -> tuple[Complexes, Complexes]:
    """Return (Z, a and b with k = 0 at the first period, shape (3, channels); what they leave of z)."""
    basis = _basis(point, len(z))
    value = np.asarray(np.linalg.lstsq(basis, z, rcond=1e-6)[0], dtype=complex)
    return value, z - basis @ value


@lru_cache(maxsize=_MEMORY)
def _grid(count: int) -> Complexes:
    """Return an orthonormal basis of the model at every point of the grid, shape (points, count, 3)."""
    points = np.stack(np.meshgrid(np.log(_DECAYS), _TURNS, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.linalg.qr(_basis(points, count))[0]


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
_PAUSE_MOST_S = 4.0


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
    pattern, none where the lever is driven. axis: of the gyroscope that tells the response.
    """

    swing: Swing
    weights: tuple[float, ...] = ()
    axis: int = 0

    @classmethod
    def of(cls, group: Group, start: float, pulley_radius: float, tendons: int) -> "Moving":
        """Return it for a group that begins at a host time [s]; the tendons stand evenly, the first at y."""
        if group.excitation == "lever":
            return cls(Swing(math.radians(group.amplitude_deg), group.frequency_hz, start))
        turns = [math.tau * i / tendons for i in range(tendons)]
        in_roll = group.excitation == "roll"
        weights = tuple(math.cos(turn) if in_roll else -math.sin(turn) for turn in turns)
        swing = Swing(1e-3 * group.amplitude_mm / pulley_radius, group.frequency_hz, start)
        return cls(swing, weights, 2 if in_roll else 1)

    def cycle(self, loop: Loop) -> Sample:
        """Run one cycle of the loop with what moves."""
        if not self.weights:
            return loop.cycle(self.swing)
        return loop.cycle(pull=lambda time: [weight * self.swing(time) for weight in self.weights])


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
    moving = Moving.of(group, start, loop.pulley_radius, len(loop.watch.goals))
    if group.kind == "ring-down":
        stop = moving.swing.crossing_after(start + group.settle_s - 1e-6)
        moving = replace(moving, swing=replace(moving.swing, stop=stop))
    segments.begin("settle")
    if settle is None:
        _until(loop, start + settle_count / sample_hz if group.kind != "ring-down" else moving.swing.stop, moving)
    else:
        _settle(loop, moving, settle)
    segments.end()
    _record(loop, segments, group.kind, record_count, moving)


def pause(loop: Loop) -> None:
    """Let the joint come to rest, lever at zero: until the head's rates stay small, or four seconds."""
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


def _until(loop: Loop, end: float, moving: Moving) -> list[Sample]:
    """Run all cycles that begin before a host time [s] and return their samples."""
    samples = []
    while loop.due < end - 0.01 * loop.period:
        samples.append(moving.cycle(loop))
    return samples


def _settle(loop: Loop, moving: Moving, rule: SettleRule) -> None:
    """Run whole periods until the rule says that the response is steady."""
    turn, axis = 0, moving.axis
    while not rule.is_settled:
        turn += 1
        samples = _until(loop, moving.swing.start + turn / moving.swing.frequency_hz, moving)
        told = [
            (sample.imu_time_s, sample.gyro_rad_s[axis]) for sample in samples if not math.isnan(sample.gyro_rad_s[0])
        ]
        rule.feed([time for time, _ in told], [rate for _, rate in told])


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
    told, was_locked = -math.inf, False
    for index in range(count):
        sample = loop.cycle(command)
        law.take(sample.time_s, sample.time_s, sample.drive_rad, sample.imu_time_s, sample.gyro_rad_s[0])
        if mover is not None:
            mover.move(law.pretension_mm)
        if index * loop.period - told >= _TELL_S:
            told = index * loop.period
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
