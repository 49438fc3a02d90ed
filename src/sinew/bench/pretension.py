"""This is where the tendons are pulled to first contact and where a pretension becomes goals of the motors.

The paper's routine (section 3.2): first every motor pulls to a set current, the positions reached are stored; then a
linear map takes pretension and a correction of tilt to motor positions, and a PI loop levels the head plate by that
correction. Where the plate is tilted by a about y and b about z, its point over tendon i, at (y_i, z_i), is raised
by u_i = a z_i - b y_i; shortening cable i by u_i takes it back.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sinew.bench.errors import LostError
from sinew.bench.levelling import Levelling, level
from sinew.bench.loop import Loop
from sinew.hardware.rig import Rig
from sinew.plan.plan import TendonMode
from sinew.plan.rig import RigSpec

__all__ = ["CHANGE_SPEED", "PULL_SPEED", "Contact", "MotorMap", "Pretensioned", "pull_to_contact", "set_pretension"]

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
class Contact:
    """Where the tendons came to first contact.

    angles: of the horns, while each tendon carried the current [rad]. current: mean over motors and time [A].
    """

    angles: tuple[float, ...]
    current: float


@dataclass(frozen=True, slots=True)
class Pretensioned:
    """A pretension as it was set and as it came out.

    asked_mm. reached_mm: mean take-up of the motors since first contact, less their give under load; NaN by current.
    asked_current_a, current_a: mean of the motors' currents; asked is NaN by position. tilt_deg: that is left.
    offsets: levelling correction about y and z [rad]. levelling_s: how long levelling took.
    """

    asked_mm: float
    reached_mm: float
    asked_current_a: float
    current_a: float
    tilt_deg: float
    offsets: tuple[float, float]
    levelling_s: float


class MotorMap:
    """The linear map from pretension and tilt correction to goals of the tendon motors.

    contact: the stored positions. A motor gives way under its load by T/k_servo; the goal at first contact is therefore
    a little further than the horn stood, so that the cable carries there, by position, what it carried by current.
    currents: by pretension [mm], for motors that hold a current; see `sinew.twin.simulate.rest_tension`.
    """

    def __init__(self, spec: RigSpec, mode: TendonMode, contact: Contact, tension_n: dict[float, float]) -> None:
        tendons = spec.tendons
        self._mode, self._contact, self._tension = mode, contact, tension_n
        self.radius = tendons.pulley_radius.value
        self.newton = self.radius / tendons.torque_constant.value  # A/N
        self._servo = tendons.servo_stiffness.value
        self._contact_tension = tendons.first_contact_tension.value
        # The current comes in whole counts, so the pull stopped a little beside the tension of first contact. Take-up
        # per newton in each tendon: cable and servo in series, and the silicone, axial stiffness 3 G A/L, under all.
        series = 1 / tendons.cable_stiffness.value + 1 / tendons.servo_stiffness.value
        silicone = spec.silicone
        torsional = silicone.torsional_rigidity.value / silicone.length.value
        axial = 3 * torsional * spec.area_over_torsion_constant
        missing = self._contact_tension - contact.current / self.newton
        self._first = missing * (series + tendons.count / axial) - missing / self._servo
        turns = [math.tau * i / tendons.count for i in range(tendons.count)]
        r = tendons.head_radius.value
        self._points = tuple((r * math.cos(turn), r * math.sin(turn)) for turn in turns)
        # By current, unequal tensions level against the silicone's bending stiffness.
        self._bending = spec.bending_over_torsional_rigidity * torsional

    @property
    def by_current(self) -> bool:
        """Whether the goals are currents."""
        return self._mode == "current"

    def goals(self, pretension_mm: float, offsets: tuple[float, float]) -> tuple[float, ...]:
        """Return goals [rad or A] for a pretension [mm] and a correction of tilt about y and z [rad]."""
        rises = [offsets[0] * z - offsets[1] * y for y, z in self._points]
        if self.by_current:
            tension = self.tension(pretension_mm)
            per_rise = self._bending / sum(y * y for y, _ in self._points)
            return tuple(max(0.0, (tension + per_rise * rise) * self.newton) for rise in rises)
        first = self._first + self._contact_tension / self._servo
        return tuple(
            angle + (1e-3 * pretension_mm + first + rise) / self.radius
            for angle, rise in zip(self._contact.angles, rises, strict=True)
        )

    def tension(self, pretension_mm: float) -> float:
        """Return the tension of each tendon at rest that belongs to a pretension [N]."""
        return self._tension[pretension_mm]

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
    counts = round(
        tendons.first_contact_tension.value * radius / tendons.torque_constant.value / tendons.current_lsb.value
    )
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
    loop: Loop, motors: MotorMap, asked_mm: float, before_mm: float, offsets: tuple[float, float]
) -> Pretensioned:
    """Bring the tendons from one pretension to another [mm], level the head plate, and return what came out."""
    steps = max(1, round(1e-3 * abs(asked_mm - before_mm) / CHANGE_SPEED / loop.period))
    start = loop.watch.goals
    stop = motors.goals(asked_mm, offsets)
    for k in range(1, steps + 1):
        share = k / steps
        loop.set_goals([a + share * (b - a) for a, b in zip(start, stop, strict=True)])
        loop.cycle()
    loop.run(_REST_S)
    levelling: Levelling = level(loop, lambda correction: motors.goals(asked_mm, correction), offsets)
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
