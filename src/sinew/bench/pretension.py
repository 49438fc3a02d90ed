"""Pretension on the bench: first contact of the tendons, and goals of the motors.

The paper's routine (section 3.2): first every motor pulls to a set current, the positions reached are stored; then a
linear map takes pretension and a correction of tilt to motor positions, and a loop levels the head plate by that
correction. Where the plate is tilted by a about y and b about z, its point over tendon i, at (y_i, z_i), is raised
by u_i = a z_i - b y_i; shortening cable i by u_i takes it back.

A pose that is not upright has take-ups of its own, or tensions where the motors hold currents. They come from who runs
the bench, as the twin finds them; the loop then corrects what the plate's tilt lacks of the pose's.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sinew.bench.loop import Loop
from sinew.bench.record.sample import Sample
from sinew.bench.tilt import tilt_of
from sinew.hardware.rig import Rig
from sinew.measure.errors import LostError
from sinew.measure.events import Pretensioned
from sinew.plan.plan import TendonMode
from sinew.plan.rig import RigSpec

if TYPE_CHECKING:
    from sinew.solve.spatial import Rest  # JAX

# The head plate is levelled, at rest. The paper has a PI loop and tells no gains.

GOOD_ENOUGH_DEG = 0.05
"""Tilt at which levelling by position ends, held for a moment [deg]; the paper does not say how level its plate was."""

GOOD_ENOUGH_BY_CURRENT_DEG = 0.12
"""The same where the motors hold currents: one count, 2.69 mA, in one tendon alone tilts the paper's plate by 0.16°."""

ACCEPTED_DEG = 0.2
"""What must be reached at least [deg]."""

MOST_S = 15.0
"""After so long levelling ends, well or not [s]."""

_UPRIGHT = (0.2, 4.0, 0.08)  # proportional, integral in 1/s, low-pass in s
_POSED = (0.0, 1.0, 0.3)
# A head with mass sways on its tendons, at 9 Hz with little damping, and an accelerometer takes that for some fifteen
# times the tilt that it is. So in a pose the controller is slow and looks through two low-passes; a proportional part,
# or one low-pass of 80 ms with an integrator of 1.5 per second, makes 0.8 kg sway until a limit stops it.
_JUDGED_S = 0.3
# By position, whether the plate is level may be seen through less of the sensor's noise than the controller sees. By
# current it goes from one count of the motors to the next, and a mean over that would look level.
_HOLD_S = 0.5


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
) -> Levelling:
    """Correct the tendons until the head plate is level, or stands in a pose, and return how it ended.

    goals: of the tendon motors for a correction of tilt about y and z [rad]. start: correction to begin with. pose:
    tilt about y and z that is asked for [rad].
    Upright, the controller is PI on the accelerometer's tilt behind a low-pass of 80 ms, as it was tried on a plate
    without mass; in a pose it integrates the tilt behind two low-passes of 0.3 s. By position it ends by the tilt
    behind one of 0.3 s. Raises LostError where the plate does not come level.
    """
    integral, once, smooth, judged = list(start), None, None, None
    by_current, posed, quiet = loop.watch.by_current, any(pose), 0.0
    enough = math.radians(GOOD_ENOUGH_BY_CURRENT_DEG if by_current else GOOD_ENOUGH_DEG)
    proportional, rate, memory = _POSED if posed else _UPRIGHT
    weight, slow = (1 - math.exp(-loop.period / m) for m in (memory, memory if by_current else _JUDGED_S))
    steps = round(MOST_S / loop.period)
    for k in range(steps):
        seen = rest_tilt(loop.cycle())
        if seen is None:
            continue
        lacking = (seen[0] - pose[0], seen[1] - pose[1])
        once, judged = _followed(once, lacking, weight), _followed(judged, lacking, slow)
        smooth = _followed(smooth, once, weight) if posed else once
        tilt = math.hypot(*judged)
        if tilt < enough:
            quiet += loop.period
            if quiet >= _HOLD_S:
                return Levelling((integral[0], integral[1]), tilt, (k + 1) * loop.period)
            continue
        quiet = 0.0
        integral = [i + rate * loop.period * s for i, s in zip(integral, smooth, strict=True)]
        loop.set_goals(goals((integral[0] + proportional * smooth[0], integral[1] + proportional * smooth[1])))
    found = math.degrees(math.hypot(*judged)) if judged is not None else math.nan
    if found < ACCEPTED_DEG:
        return Levelling((integral[0], integral[1]), math.radians(found), MOST_S)
    raise LostError(
        f"the head plate is still tilted by {found:.2f}° after {MOST_S:.0f} s of levelling, expected less than "
        f"{ACCEPTED_DEG:g}°; are tendons on the right motors (tendon_ids) and is imu_axes right?"
    )


def _followed(old: list[float] | None, seen: Sequence[float], weight: float) -> list[float]:
    return list(seen) if old is None else [o + weight * (v - o) for o, v in zip(old, seen, strict=True)]


PULL_SPEED = 0.015
"""Speed at which slack is taken up [m/s]."""

CHANGE_SPEED = 0.006
"""Speed at which the pretension is changed [m/s]."""

_CONTACT_HOLD_S = 0.4
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
            per_rise = self._bending / sum(y * y for y, _ in self._points)
            return tuple(max(0.0, (t + per_rise * u) * self.newton) for t, u in zip(tensions, rises, strict=True))
        take_up = (pretension_mm,) * len(rises) if held is None else held.take_up_mm  # None: on its way
        first = self._first + self._contact_tension / self._servo
        return tuple(
            angle + (1e-3 * mm + first + rise) / self.radius
            for angle, mm, rise in zip(self._contact.angles, take_up, rises, strict=True)
        )

    def tension(self, pretension_mm: float) -> float:
        """Return the mean tension of the tendons at rest that belongs to a pretension [N]."""
        tensions = self._held[pretension_mm].tension_n
        return sum(tensions) / len(tensions)

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
    radius = tendons.pulley_radius.value
    counts = round(tendons.current(tendons.first_contact_tension.value) / tendons.current_lsb.value)
    limit = counts * tendons.current_lsb.value
    for motor in rig.tendons:
        motor.limit_output(limit)
    start = loop.watch.origin
    travel_m = 1e-3 * rig.spec.limits.tendon_travel_mm[1]
    step = PULL_SPEED * loop.period / radius
    goals = list(start)
    held = [0.0] * len(goals)
    for _ in range(round((travel_m / PULL_SPEED + 2.0) / loop.period)):
        loop.set_goals(goals)
        sample = loop.cycle()
        for index, (angle, current) in enumerate(zip(sample.tendon_rad, sample.tendon_current_a, strict=True)):
            if math.isnan(angle):
                continue
            at_limit = current >= (1 - _CONTACT_TOLERANCE) * limit - tendons.current_lsb.value
            held[index] = held[index] + loop.period if at_limit else 0.0
            goals[index] = min(goals[index] + step, angle + _AHEAD_M / radius)
        if min(held) > _CONTACT_HOLD_S:
            break
    else:
        loose = [f"tendon {i + 1}" for i, time in enumerate(held) if time <= _CONTACT_HOLD_S]
        raise LostError(
            f"{', '.join(loose)} found no contact within {1e3 * travel_m:.0f} mm at {1e3 * limit:.0f} mA; "
            "is the cable on its pulley? Take up its slack by hand, or widen tendon_travel_mm"
        )
    return _crept(loop, 2 * math.pi / tendons.counts_per_turn.value)


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
    way = 1e-3 * abs(asked_mm - before_mm)
    if not motors.by_current:
        way = max(way, motors.radius * max(abs(b - a) for a, b in zip(start, stop, strict=True)))
    way = max(way, motors.guide_radius * math.dist(leant, pose))
    steps = max(1, round(way / CHANGE_SPEED / loop.period))
    for k in range(1, steps + 1):
        share = k / steps
        leaning = (leant[0] + share * (pose[0] - leant[0]), leant[1] + share * (pose[1] - leant[1]))
        loop.set_goals([a + share * (b - a) for a, b in zip(start, stop, strict=True)], pose=leaning)
        loop.cycle()
    loop.run(_REST_S)
    levelling: Levelling = level(loop, lambda correction: motors.goals(asked_mm, correction), offsets, pose)
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
