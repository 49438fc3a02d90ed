"""Pretension on the bench: first contact of the tendons, and goals of the motors.

The paper's routine (section 3.2): first every motor pulls to a set current, the positions reached are stored; then a
linear map takes pretension and a correction of tilt to motor positions, and a loop levels the head plate by that
correction. Where the plate is tilted by a about y and b about z, its point over tendon i, at (y_i, z_i), is raised
by u_i = a z_i - b y_i; shortening cable i by u_i takes it back.

A pose that is not upright has take-ups of its own, or tensions where the motors hold currents. They come from who runs
the bench, as the twin finds them; the loop then corrects what the plate's tilt lacks of the pose's.
"""

import itertools
import math
import operator
import statistics
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sinew.bench.loop import Loop
from sinew.bench.record.sample import Sample
from sinew.bench.tilt import tilt_of, turned_frame
from sinew.hardware.rig import Rig
from sinew.measure.arrays import Complexes
from sinew.measure.errors import LostError
from sinew.measure.events import Pretensioned
from sinew.plan.plan import TendonMode
from sinew.plan.rig import LIMIT_RESERVE_N, RigSpec

if TYPE_CHECKING:
    from sinew.solve.spatial import Rest  # JAX

Tilt = tuple[float, float]
"""About y and z [rad]."""

# The head plate is levelled, at rest. The paper has a PI loop and tells no gains.

LEVEL_RATE = 1.5
"""Gain of the levelling integrator [1/s]: the tilt goes back by a factor e in 1/1.5 s."""

LEVEL_MEMORY_S = 0.18
"""Time constant of each of the two low-passes through which it sees the tilt [s]."""
# A head with mass sways on its tendons with little damping, and an accelerometer takes that for up to a thousand times
# the tilt that was asked for (decision 29). So there is no proportional part, and rate, memory and
# the sway's peak set the margin: rate·peak/(ω(1 + (ω·memory)²)) stays below 1/3 for every sway of the rig, while
# rate·memory = 0.27 leaves 60° of phase where the tilt follows at once.

GOOD_ENOUGH_DEG = 0.05
"""Tilt at which levelling by position ends, held for a moment [deg]; the paper does not say how level its plate was."""

GOOD_ENOUGH_BY_CURRENT_DEG = 0.12
"""The same where the motors hold currents: one count, 2.69 mA, in one tendon alone tilts the paper's plate by 0.16°."""

ACCEPTED_DEG = 0.2
"""What must be reached at least [deg]."""

ACCEPTED_BY_CURRENT_DEG = 0.3
"""The same by current: compression softens the joint, at 12 mm a count tilts it by 0.28°, and half of it stays in each
direction."""

MOST_S = 15.0
"""After so long levelling ends, well or not [s]."""

_HOLD_S = 0.5
_HOLD_BY_CURRENT_S = 1.0  # its band is wide enough for a tilt to pass through it behind the low-passes
_STANDS_S = 2.0
_STANDS_COUNTS = 1.5
_LOOKS_S = 1.0
_MOST_LOOKS = 2
# By current the tilt may lie between two counts. The correction then goes to and fro about the edge between them; its
# place is the mean of what the counts made of it in that time, and of what was still lacking.


_LEAST_GAIN = 0.75  # of tilt by its correction; by current it is 0.75 to 1.08, by position near 1 (docs/decisions/0029)
_PULLS = 1.3  # times the tension that the twin expects, beside LIMIT_RESERVE_N; the paper leaves it open by a quarter
_WIRED = "are tendons on the right motors (wiring.tendon_ids, tendon_pull), and is wiring.imu_axes right?"


@dataclass(frozen=True, slots=True)
class Levelling:
    """How levelling ended: correction about y and z [rad], tilt that is left [rad], how long it took [s]."""

    offsets: tuple[float, float]
    tilt: float
    duration_s: float


def rest_tilt(sample: Sample) -> tuple[float, float] | None:
    """Return the tilt about y and z [rad] that the accelerometer sees in a sample at rest; None without a reading."""
    x, y, z = sample.acceleration_m_s2
    if math.isnan(x) or x <= 0.0:
        return None
    return tilt_of(x, y, z)


def level(
    loop: Loop,
    goals: Callable[[tuple[float, float]], tuple[float, ...]],
    start: tuple[float, float],
    pose: tuple[float, float] = (0.0, 0.0),
    count: float = 0.0,
    whole: Callable[[Tilt], Tilt] = lambda correction: correction,
    expected_n: Sequence[float] = (),
) -> Levelling:
    """Correct the tendons until the head plate is level, or stands in a pose, and return how it ended.

    goals: of the tendon motors for a correction of tilt about y and z [rad]. start: correction to begin with. pose:
    tilt about y and z that is asked for [rad]. count: correction that one count of a motor makes up for [rad]; whole:
    what whole counts make of a correction. expected_n: tension of each tendon at rest, as the twin has it [N].
    The controller integrates what the accelerometer's tilt lacks of the pose, behind two low-passes, and ends when
    little is left, or when the correction stands and more would not make it better; then the tilt that is left is
    measured anew. Raises LostError where the plate does not come level, and as soon as tilt, correction or tension is
    not what a correction brings about.
    """
    by_current = loop.watch.by_current
    enough = math.radians(GOOD_ENOUGH_BY_CURRENT_DEG if by_current else GOOD_ENOUGH_DEG)
    hold = _HOLD_BY_CURRENT_S if by_current else _HOLD_S
    accepted = math.radians(ACCEPTED_BY_CURRENT_DEG if by_current else ACCEPTED_DEG)
    weight = 1 - math.exp(-loop.period / LEVEL_MEMORY_S)
    gain, integral, quiet = LEVEL_RATE * loop.period, start, 0.0
    once: tuple[float, float] | None = None
    smooth: tuple[float, float] | None = None
    acted = at_once = start  # the correction behind the same low-passes: what the tilt that is seen answers to
    recent: deque[tuple[Tilt, Tilt]] = deque(maxlen=round(_STANDS_S / loop.period))
    most = [_PULLS * newtons + LIMIT_RESERVE_N for newtons in expected_n]
    first: float | None = None
    look, looks = 0, 0  # cycle at which a correction that stands is judged by what it leaves
    for k in range(1, round(MOST_S / loop.period) + 1):
        sample = loop.cycle()
        _refuse_pull(loop, sample, most)
        seen = rest_tilt(sample)
        if seen is None:
            continue
        once = _followed(once, (seen[0] - pose[0], seen[1] - pose[1]), weight)
        smooth = _followed(smooth, once, weight)
        tilt = math.hypot(*smooth)
        at_once = _followed(at_once, integral, weight)
        acted = _followed(acted, at_once, weight)
        first = tilt if first is None else max(first, tilt) if k * loop.period <= LEVEL_MEMORY_S else first
        _refuse_astray(tilt, first, math.dist(acted, start), accepted)
        quiet = quiet + loop.period if tilt < enough else 0.0
        if quiet >= hold:
            return Levelling(integral, tilt, k * loop.period)
        if quiet > 0 or k < look:
            continue
        if look > 0:  # the correction has stood long enough to tell exactly what it leaves
            made, look = whole(integral), 0
            rounded = made[0] + smooth[0], made[1] + smooth[1]
            if looks < _MOST_LOOKS and whole(rounded) != made:
                integral, look, looks = rounded, k + round(_LOOKS_S / loop.period), looks + 1
                loop.set_goals(goals(integral))
                continue
            if tilt < accepted:
                return Levelling(integral, tilt, k * loop.period)
        integral = (integral[0] + gain * smooth[0], integral[1] + gain * smooth[1])
        if count > 0:
            made = whole(integral)
            recent.append((integral, (made[0] + smooth[0], made[1] + smooth[1])))
        if len(recent) == recent.maxlen and _width([at for at, _ in recent]) < _STANDS_COUNTS * count:
            integral = statistics.fmean(y for _, (y, _) in recent), statistics.fmean(z for _, (_, z) in recent)
            look = k + round(_LOOKS_S / loop.period)
            recent.clear()
        loop.set_goals(goals(integral))
    if smooth is not None and math.hypot(*smooth) < accepted:
        return Levelling(integral, math.hypot(*smooth), MOST_S)
    found = math.degrees(math.hypot(*smooth)) if smooth is not None else math.nan
    raise LostError(
        f"the head plate is still tilted by {found:.2f}° after {MOST_S:.0f} s of levelling, expected less than "
        f"{math.degrees(accepted):.2g}°; {_WIRED}"
    )


def _refuse_pull(loop: Loop, sample: Sample, most: Sequence[float]) -> None:
    """Raise where a tendon carries more than a correction of tilt can bring about. most: of each [N]."""
    for index, (current, newtons) in enumerate(zip(sample.tendon_current_a, most, strict=False)):
        if (carries := loop.tension(current)) > newtons:
            raise LostError(
                f"tendon {index + 1} carries {carries:.0f} N while the head plate is levelled, expected at most "
                f"{newtons:.0f}; {_WIRED}"
            )


def _refuse_astray(tilt: float, first: float, corrected: float, accepted: float) -> None:
    """Raise where a correction [rad] has not tilted the plate back; first: tilt at the begin [rad].

    corrected: behind the low-passes that the tilt is seen through, else a plate that follows looks as if it did not.
    A correction as large as this one takes back the whole tilt of a rig that is as it should be, none of another. More
    than half of it left is nearer to none.
    """
    if tilt > max(accepted, 0.5 * first) and _LEAST_GAIN * corrected > max(first, accepted):
        raise LostError(
            f"the head plate is still tilted by {math.degrees(tilt):.2f}°, {math.degrees(first):.2f}° before, though "
            f"its tendons were corrected by {math.degrees(corrected):.2f}°; {_WIRED}"
        )


def _followed(old: tuple[float, float] | None, seen: tuple[float, float], weight: float) -> tuple[float, float]:
    return seen if old is None else (old[0] + weight * (seen[0] - old[0]), old[1] + weight * (seen[1] - old[1]))


def _width(tilts: Sequence[Tilt]) -> float:
    widths = [max(at[i] for at in tilts) - min(at[i] for at in tilts) for i in (0, 1)]
    return max(widths)


PULL_SPEED = 0.015
"""Speed at which slack is taken up [m/s]."""

CHANGE_SPEED = 0.006
"""Speed at which the pretension is changed [m/s]."""

CONTACT_HOLD_S = 0.4
"""How long a motor must stand at its limit of current to be at first contact [s]."""

_CONTACT_TOLERANCE = 0.06
_AHEAD_M = 2e-3
_REST_S = 0.5
_MEAN_S = 0.3
_CREEP_S = 0.8
_CREEP_MOST_S = 8.0


@dataclass(frozen=True, slots=True)
class Held:
    """What holds a pose at a pretension: take-up of each tendon from first contact [mm], its tension at rest [N]."""

    take_up_mm: tuple[float, ...]
    tension_n: tuple[float, ...]

    @classmethod
    def of(cls, rest: "Rest") -> "Held":
        """Return what holds a rest pose that was found."""
        return cls(tuple((1e3 * rest.take_up).tolist()), tuple(rest.at.tension.tolist()))

    @classmethod
    def upright(cls, pretension_mm: float, tension_n: float, count: int) -> "Held":
        """Return what holds the plate level: `count` tendons alike."""
        return cls((pretension_mm,) * count, (tension_n,) * count)


@dataclass(frozen=True, slots=True)
class Contact:
    """Where the tendons came to first contact.

    angles: of the horns, while each tendon carried the current [rad]. current: mean over motors and time [A].
    """

    angles: tuple[float, ...]
    current: float


class MotorMap:
    """The linear map from pretension and tilt correction to goals of the tendon motors.

    contact: the stored positions. A motor gives way under its load by T/k_servo; the goal at first contact is therefore
    a little further than the horn stood, so that the cable carries there, by position, what it carried by current.
    held: by pretension [mm], what the twin has at rest.
    """

    def __init__(self, spec: RigSpec, mode: TendonMode, contact: Contact, held: Mapping[float, Held]) -> None:
        tendons = spec.tendons
        self._mode, self._contact, self._held = mode, contact, held
        self.radius = tendons.pulley_radius.value
        self.newton = tendons.current(1.0)  # A/N
        self._servo = tendons.servo_stiffness.value
        self._contact_tension = tendons.first_contact_tension.value
        # The current comes in whole counts, so the pull stopped a little beside the tension of first contact. Take-up
        # per newton in each tendon: cable and servo in series, and the silicone under all.
        series = 1 / tendons.cable_stiffness.value + 1 / tendons.servo_stiffness.value
        missing = self._contact_tension - contact.current / self.newton
        self._first = missing * (series + tendons.count / spec.axial_stiffness) - missing / self._servo
        turns = [math.tau * i / tendons.count for i in range(tendons.count)]
        r = self.guide_radius = tendons.head_radius.value
        self._points = tuple((r * math.cos(turn), r * math.sin(turn)) for turn in turns)
        # By current, unequal tensions level against the silicone's bending stiffness.
        self._bending = spec.bending_over_torsional_rigidity * spec.silicone.stiffness(0.0)
        self._length = spec.silicone.length.value
        self._lsb = tendons.current_lsb.value
        self._count = math.tau / tendons.counts_per_turn.value

    @property
    def by_current(self) -> bool:
        """Whether the goals are currents."""
        return self._mode == "current"

    def goals(self, pretension_mm: float, offsets: tuple[float, float]) -> tuple[float, ...]:
        """Return goals [rad or A] for a pretension [mm] and a correction of tilt about y and z [rad]."""
        rises = [offsets[0] * z - offsets[1] * y for y, z in self._points]
        held = self._held.get(pretension_mm)
        if self.by_current:
            tensions = self._held[pretension_mm].tension_n
            per_rise = self.tilt_stiffness(pretension_mm) / sum(y * y for y, _ in self._points)
            wanted = [max(0.0, (t + per_rise * u) * self.newton) for t, u in zip(tensions, rises, strict=True)]
            return self._in_counts(wanted, self._lsb)
        take_up = (pretension_mm,) * len(rises) if held is None else held.take_up_mm  # None: on its way
        first = self._first + self._contact_tension / self._servo
        turned = [
            angle + (1e-3 * mm + first + rise) / self.radius
            for angle, mm, rise in zip(self._contact.angles, take_up, rises, strict=True)
        ]
        return self._in_counts(turned, self._count)

    def count(self, pretension_mm: float) -> float:
        """Return by how much one count of current in one tendon tilts the plate [rad]; zero by position."""
        if not self.by_current:
            return 0.0
        return self._lsb / self.newton * self.guide_radius / self.tilt_stiffness(pretension_mm)

    def whole(self, pretension_mm: float, offsets: Tilt) -> Tilt:
        """Return what whole counts of current make of a correction of tilt about y and z [rad]."""
        if not self.by_current:
            return offsets
        currents, tensions = self.goals(pretension_mm, offsets), self._held[pretension_mm].tension_n
        pulls = [c / self.newton - t for c, t in zip(currents, tensions, strict=True)]
        ys, zs = zip(*self._points, strict=True)
        stiffness = self.tilt_stiffness(pretension_mm)
        return sum(map(operator.mul, pulls, zs)) / stiffness, -sum(map(operator.mul, pulls, ys)) / stiffness

    def tilt_stiffness(self, pretension_mm: float) -> float:
        """Return how the joint resists a tilt under constant tensions [N m/rad].

        Chords of tension T bend an arc of length L further, by T L/12 each. With weight and shear, in space, the
        paper's joint has 3.6 in place of 3.2 N m/rad upright at 6 mm, 2.6 in place of 2.0 at 12 mm. A quarter of the
        silicone's own is the least that counts.
        """
        pulled = sum(self._held[pretension_mm].tension_n)
        return max(0.25 * self._bending, self._bending - pulled * self._length / 12)

    def _in_counts(self, wanted: Sequence[float], lsb: float) -> tuple[float, ...]:
        """Return currents [A] or angles [rad] in whole counts of a size, up or down each, that come nearest to what was
        wanted: by current first in tilt, by position first in their sum.

        Rounded one by one, two tendons that face each other may both step at once. That leaves a whole count of tilt
        between, or moves the pretension by half a count, some 0.1 % of the tension, with whatever tilt was seen. By
        position the tilt is levelled again, and the pretension, which is in every number, is not.
        """
        below = [math.floor(value / lsb) for value in wanted]
        rest = [value / lsb - low for value, low in zip(wanted, below, strict=True)]

        def off(up: Sequence[int]) -> tuple[float, ...]:
            missed = [step - part for step, part in zip(up, rest, strict=True)]
            y, z = (sum(m * at[i] for m, at in zip(missed, self._points, strict=True)) for i in (0, 1))
            both = round(math.hypot(y, z) / self.guide_radius, 9), round(abs(sum(missed)), 9)  # alike but for rounding
            return both if self.by_current else both[::-1]

        best = min(itertools.product((0, 1), repeat=len(wanted)), key=off)
        return tuple(lsb * (low + step) for low, step in zip(below, best, strict=True))

    def tensions(self, pretension_mm: float) -> tuple[float, ...]:
        """Return the tension of each tendon at rest that belongs to a pretension [N]."""
        return self._held[pretension_mm].tension_n

    def tension(self, pretension_mm: float) -> float:
        """Return the mean tension of the tendons at rest that belongs to a pretension [N]."""
        return statistics.fmean(self.tensions(pretension_mm))

    def reached_mm(self, angles: Sequence[float], currents: Sequence[float]) -> float:
        """Return the mean take-up since first contact [mm], of horns at angles [rad] under currents [A]."""
        mean = sum(angles) / len(angles) - sum(self._contact.angles) / len(angles) - self._first / self.radius
        load = (sum(currents) / len(currents) / self.newton - self._contact_tension) / self._servo
        return 1e3 * (mean * self.radius + load)


def pull_to_contact(loop: Loop, rig: Rig) -> Contact:
    """Take up the slack until every tendon carries the rig's first-contact tension, and return where that was.

    The tendon motors must run by position with a current limit, which is set here to the current that belongs to that
    tension; their goals move ahead of them until each stands still at its limit. Raises LostError where a tendon finds
    no contact within its position window.
    """
    tendons = rig.spec.tendons
    counts = round(tendons.current(tendons.first_contact_tension.value) / tendons.current_lsb.value)
    limit = counts * tendons.current_lsb.value
    for motor in rig.tendons:
        motor.limit_output(limit)
    travel_m = 1e-3 * rig.spec.limits.tendon_travel_mm[1]
    goals, held = wind_to_contact(loop, rig, limit, (1,) * tendons.count, travel_m)
    if loose := [f"tendon {i + 1}" for i, time in enumerate(held) if time <= CONTACT_HOLD_S]:
        raise LostError(
            f"{', '.join(loose)} found no contact within {1e3 * travel_m:.0f} mm at {1e3 * limit:.0f} mA; "
            "is the cable on its pulley, and does more of the encoder pull (wiring.tendon_pull)? Take up its slack by "
            "hand, or widen tendon_travel_mm"
        )
    refuse_wrong_wiring(loop, rig, goals)
    return _crept(loop, 2 * math.pi / tendons.counts_per_turn.value)


def wind_to_contact(
    loop: Loop, rig: Rig, limit: float, senses: Sequence[int], travel_m: float, most_m: float = math.inf
) -> tuple[list[float], list[float]]:
    """Wind cable until every motor stands at its limit of current [A]; return the goals [rad], and for how long each
    has stood there [s].

    senses: in which each winds, 0 of one that is left alone. travel_m: for as long as that takes [m]. most_m: bound of
    what is wound [m]. Goals move ahead of the horns.
    """
    radius, lsb = loop.pulley_radius, rig.spec.tendons.current_lsb.value
    start, step = loop.watch.origin, PULL_SPEED * loop.period / radius
    goals = list(start)
    held = [0.0 if sense else math.inf for sense in senses]
    for _ in range(round((travel_m / PULL_SPEED + 2.0) / loop.period)):
        loop.set_goals(goals)
        sample = loop.cycle()
        for index, sense in enumerate(senses):
            angle, current = sample.tendon_rad[index], sample.tendon_current_a[index]
            if math.isnan(angle) or not sense:
                continue
            at_limit = sense * current >= (1 - _CONTACT_TOLERANCE) * limit - lsb
            held[index] = held[index] + loop.period if at_limit else 0.0
            ways = (
                goals[index] + sense * step,
                angle + sense * _AHEAD_M / radius,
                start[index] + sense * most_m / radius,
            )
            goals[index] = min(ways, key=lambda goal: sense * goal)
        if min(held) > CONTACT_HOLD_S:
            break
    return goals, held


# The wiring is looked at while the tendons only carry first contact: each gives way a little, one after the other, and
# the plate must rise above that one. No tension rises, whatever is wrong.

_GIVES_DEG = 1.0  # of tilt; 21 counts of the paper's horns, and a tenth of the tilt that its rig allows
_GIVES_S, _SEES_S = 0.2, 0.2  # two thirds each of the slowest sway of the paper's head at first contact, 3 Hz
_ODDS = 1e4  # of a wiring against every other; a wrong accusation costs a run
_ANY_ORDER = 5  # tendons; six have 720 orders
_ROUNDS = 4  # in which a heavy head's sway dies away; of one that sways on nothing is said


def refuse_wrong_wiring(loop: Loop, rig: Rig, goals: Sequence[float]) -> None:
    """Have each tendon give way a little and raise LostError where the head plate rises elsewhere: it names tendons
    that answer to each other's commands, a board that is turned, and the key of the rig.

    The tendon motors pull at first contact; goals: theirs, ahead of the horns [rad]. The tendons give way, round by
    round, until one of all wirings that are thought of is _ODDS times as likely as every other.
    """
    tendons = rig.spec.tendons
    radius, give = tendons.head_radius.value, math.radians(_GIVES_DEG)
    wirings = _wirings(tendons.count, rig.spec.wiring.imu_axes)
    expected = give * np.array([[*each, 0.0] for each, _ in wirings])
    # From where the plate leant, and with what bias of the gyroscope, is free. A horn stands to within a count.
    free = np.linalg.qr(np.vander(np.arange(tendons.count + 1.0), 2))[0]
    counted = math.tau / tendons.counts_per_turn.value * loop.pulley_radius / radius
    likely = np.zeros(len(wirings))
    for _ in range(_ROUNDS):
        seen, spread = _places(loop, goals, give * radius / loop.pulley_radius)
        off = seen - expected
        likely -= (np.abs(off - off @ free @ free.T) ** 2).sum(axis=1) / (2 * (spread**2 + counted**2))
        second, best = np.argsort(likely)[-2:]
        if likely[best] - likely[second] > math.log(_ODDS):
            if best > 0:
                raise LostError(wirings[best][1])
            return


def _wirings(count: int, axes: Sequence[str]) -> list[tuple[Complexes, str]]:
    """Return where the plate rises as each of some tendons gives way, along y + i·z, and what is said of that; first as
    the rig says, then where ids are in another order, the board is turned, or the sensor is elsewhere. That one tendon
    does not move the plate is no wiring: weak servos move late. axes: of the board, as the rig has them.
    """
    right = np.exp(2j * np.pi * np.arange(count) / count)
    found = [(right, "")]
    for quarter in (1, 2, 3):
        said = f"whichever tendon gives way, the head plate rises {min(quarter, 4 - quarter) * 90}° beside it: the "
        found.append((1j**quarter * right, f"{said}board is turned about x; {_board_advice(quarter, axes)}"))
    for order in itertools.permutations(range(count)) if count <= _ANY_ORDER else ():
        if not any(np.allclose(right[list(order)], each) for each, _ in found):
            moved = [str(i + 1) for i, j in enumerate(order) if i != j]
            said = f"tendons {', '.join(moved[:-1])} and {moved[-1]} answer to each other's commands: the head plate "
            said += "rises above one where another gives way; swap their ids in wiring.tendon_ids, or their cables"
            found.append((right[list(order)], said))
    return [*found, (0 * right, "no tendon that gives way moves the head plate; is the sensor on it?")]


def _places(loop: Loop, goals: Sequence[float], give: float) -> tuple[Complexes, float]:
    """Return where the plate's highest point is as each tendon gives way, and as none does [rad], along y + i·z from
    where it was, with a drift; and how much it sways about there, a standard deviation along an axis [rad].

    The gyroscope shows it: an accelerometer takes a sway of 3 Hz for four times its tilt. give: by how much the horns
    turn back [rad].
    """
    stood = loop.cycle().tendon_rad
    ramp, sees = (round(duration / loop.period) for duration in (_GIVES_S, _SEES_S))
    rates: list[complex] = []
    for index in range(len(goals) + 1):
        for k in range(1, ramp + sees + 1):
            share = min(1.0, k / ramp)
            shares = [(i == index) * share + (i == index - 1) * (1 - share) for i in range(len(goals))]
            each = zip(goals, stood, shares, strict=True)
            loop.set_goals([at - part * give if part > 0 else goal for goal, at, part in each])
            _, y, z = loop.cycle().gyro_rad_s
            rates.append(1j * complex(y, z) if not math.isnan(y) else rates[-1] if rates else 0.0)
    looks = np.cumsum(rates).reshape(len(goals) + 1, -1)[:, ramp:] * loop.period
    return looks.mean(axis=1), float(np.sqrt(looks.var(axis=1).mean() / 2))


def _board_advice(quarter: int, axes: Sequence[str]) -> str:
    """Return what to write for a board that is turned about x by quarters against its axes."""
    right = list(turned_frame(axes, quarter))
    return f"set wiring.imu_axes to {right}, or wiring.tendon_ids is shifted all round"


_NUDGE, _NUDGE_S, _NUDGE_REST_S = math.radians(3.0), 0.08, 0.08
# The lever's servo follows such a move, and the head, which swings at some 3 Hz, has hardly begun to swing back.


def refuse_wrong_drive_sign(loop: Loop, spec: RigSpec, lever: float, gyro_bias: float) -> None:
    """Move the lever by 3° towards its middle, and raise LostError where the head turns with it and not against it.

    lever: where it stands [rad]; it is left 3° from there. gyro_bias: about x [rad/s]. The head turns by paper Eq. 3 on
    the bare silicone, I φ'' = -k φ - I_l θ'', under the lever's angle θ as it was measured; with the wrong sign by the
    opposite. Of that, its opposite and nothing at all the nearest counts.
    """
    begin, step = loop.due, -math.copysign(_NUDGE, lever)

    def path(time: float) -> float:
        share = min(1.0, max(0.0, (time - begin) / _NUDGE_S))
        return lever + step * 0.5 * (1 - math.cos(math.pi * share))

    inertia = spec.inertia.head.value + spec.inertia.lever.value
    against, square = spec.inertia.lever.value / inertia, spec.silicone.stiffness(0.0) / inertia
    turned = free = rate = match = power = 0.0
    for sample in loop.run(_NUDGE_S + _NUDGE_REST_S, path):
        if math.isnan(sample.gyro_rad_s[0] + sample.drive_rad):
            continue
        turned += (sample.gyro_rad_s[0] - gyro_bias) * loop.period
        expected = free - against * (sample.drive_rad - lever)
        rate -= square * expected * loop.period
        free += rate * loop.period
        match, power = match + turned * expected, power + expected**2
    if match < -0.5 * power:
        raise LostError(
            f"the lever was moved by {math.degrees(step):.0f}° against the head, and the head turned the same way, "
            f"{-match / power:.2f} times as far as it should turn back: wiring.drive_sign is wrong, expected "
            f"{-spec.wiring.drive_sign}"
        )


def _crept(loop: Loop, count: float) -> Contact:
    """Return the contact after the silicone has given way to it: when the horns turn less than a count in a while."""
    angles, currents = _mean_tendons(loop, _MEAN_S)
    for _ in range(round(_CREEP_MOST_S / _CREEP_S)):
        loop.run(_CREEP_S - _MEAN_S)
        before = angles
        angles, currents = _mean_tendons(loop, _MEAN_S)
        if max(abs(a - b) for a, b in zip(angles, before, strict=True)) < 0.5 * count:
            break
    return Contact(angles, sum(currents) / len(currents))


def set_pretension(
    loop: Loop,
    motors: MotorMap,
    asked_mm: float,
    before_mm: float,
    offsets: tuple[float, float],
    pose: tuple[float, float] = (0.0, 0.0),
) -> Pretensioned:
    """Bring the tendons from one pretension to another [mm], the head plate into its pose, and return what came out.

    pose: tilt of the head plate about y and z of frame B [rad]; on the way there the tilt is limited about its share.
    """
    start, stop, leant = loop.watch.goals, motors.goals(asked_mm, offsets), loop.watch.pose
    travel = 1e-3 * abs(asked_mm - before_mm)
    if not motors.by_current:
        travel = max(travel, motors.radius * max(abs(b - a) for a, b in zip(start, stop, strict=True)))
    travel = max(travel, motors.guide_radius * math.dist(leant, pose))
    steps = max(1, round(travel / CHANGE_SPEED / loop.period))
    for k in range(1, steps + 1):
        share = k / steps
        leaning = (leant[0] + share * (pose[0] - leant[0]), leant[1] + share * (pose[1] - leant[1]))
        loop.set_goals([a + share * (b - a) for a, b in zip(start, stop, strict=True)], pose=leaning)
        loop.cycle()
    loop.run(_REST_S)
    levelling = level(
        loop,
        lambda correction: motors.goals(asked_mm, correction),
        offsets,
        pose,
        motors.count(asked_mm),
        lambda correction: motors.whole(asked_mm, correction),
        motors.tensions(asked_mm),
    )
    loop.set_goals(loop.watch.goals, resting=True)
    angles, currents = _mean_tendons(loop, _MEAN_S)
    if sum(currents) > 0:
        loop.watch.share = tuple(current / sum(currents) for current in currents)
    return Pretensioned(
        asked_mm=asked_mm,
        reached_mm=math.nan if motors.by_current else motors.reached_mm(angles, currents),
        asked_current_a=motors.tension(asked_mm) * motors.newton if motors.by_current else math.nan,
        current_a=sum(currents) / len(currents),
        tilt_deg=math.degrees(levelling.tilt),
        offsets=levelling.offsets,
        levelling_s=levelling.duration_s,
    )


def _mean_tendons(loop: Loop, duration: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return mean horn angles [rad] and currents [A] of the tendon motors over a time [s] at rest."""
    samples = [s for s in loop.run(duration) if not any(map(math.isnan, s.tendon_rad))]
    if not samples:
        raise LostError("no cycle had an answer of all tendon motors; check cables and supply, then `sinew doctor`")
    angles = zip(*(s.tendon_rad for s in samples), strict=True)
    currents = zip(*(s.tendon_current_a for s in samples), strict=True)
    return tuple(sum(a) / len(a) for a in angles), tuple(sum(c) / len(c) for c in currents)
