"""What an emulated motor asks of the mechanics, and what the mechanics answer; motors that pull nothing.

The device side (registers, modes, limits) sets a `Law` for each horn; the mechanics side (`Plant`) moves on in time and
tells a `Motion`. Angles are at the horn, in the motor's own positive sense being *pulling* for a tendon motor and
the lever's positive sense for the drive; everything is in SI.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, Protocol

from sinew.measure.units import STANDARD_GRAVITY
from sinew.plan.rig import RigSpec
from sinew.plan.servo import PULSE, SERVOS

LawKind = Literal["off", "pwm", "velocity", "position", "current"]


@dataclass(frozen=True, slots=True)
class Law:
    """What a motor's controller does until it is told otherwise.

    kind: off (no torque), or what `goal` is: duty [-1..1], speed [rad/s], angle [rad] or current [A].
    gain: duty per radian of error (position) or per rad/s of error (velocity).
    duty_limit: largest duty. current_limit: largest current [A]; infinite where the mode does not limit it.
    speed_limit: largest speed at which a goal is approached [rad/s]; infinite: as fast as the motor can.
    """

    kind: LawKind = "off"
    goal: float = 0.0
    gain: float = 0.0
    duty_limit: float = 1.0
    current_limit: float = float("inf")
    speed_limit: float = float("inf")


@dataclass(frozen=True, slots=True)
class HornMotion:
    """One motor at one moment: angle [rad], speed [rad/s], signed current [A], duty [-1..1]."""

    angle: float
    speed: float
    current: float
    duty: float


@dataclass(frozen=True, slots=True)
class Motion:
    """The mechanics at one moment; what is left out is zero.

    time: [s] since the start. drive, tendons: of the motors. tension: of every tendon [N].
    torsion [rad] and torsion_rate [rad/s]: true ones. tilt: of the head plate about y and z of frame B [rad].
    gyro: torsion rate behind the chip's low-pass, and the rates of tilt, in frame H [rad/s].
    acceleration: specific force at the chip, in frame H [m/s²]; at rest it points up.
    """

    time: float
    drive: HornMotion
    tendons: tuple[HornMotion, ...]
    tension: tuple[float, ...]
    torsion: float = 0.0
    torsion_rate: float = 0.0
    tilt: tuple[float, float] = (0.0, 0.0)
    gyro: tuple[float, float, float] = (0.0, 0.0, 0.0)
    acceleration: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Plant(Protocol):
    """Mechanics behind the motors; motor 0..n-1 pull the tendons, motor n is the drive."""

    def set_law(self, motor: int, law: Law) -> None:
        """Give a motor another law, from now on."""
        ...

    def set_supply(self, voltage: float) -> None:
        """Feed the motors another voltage [V], from now on."""
        ...

    def stick(self, tendon: int, stuck: bool) -> None:
        """Hold a tendon's motor where it is (a jammed pulley), or let it go."""
        ...

    def slip(self, tendon: int, length: float) -> None:
        """Let so much cable slip out of a pulley [m], at once."""
        ...

    def push(self, torque: float) -> None:
        """Push the head about the joint's axis with a torque from now on [N m]; positive as the torsion is."""
        ...

    def place_lever(self, angle: float) -> None:
        """Put the lever at an angle to the head [rad], at once and at rest, as a hand does while its motor is off."""
        ...

    def advance(self, until: float) -> None:
        """Move on to a time [s]; one that has passed changes nothing."""
        ...

    def motion(self) -> Motion:
        """Return the state at the time last advanced to."""
        ...

    def horn(self, motor: int) -> HornMotion:
        """Return one motor of that state, without the others."""
        ...


# The devices meet the mechanics: one plant, moved on only when somebody looks or pushes.


class Mechanics:
    """The plant and the time the devices are at, which the plant follows when it is needed.

    Laws take effect, and motion is told, at `time` exactly; in between the plant may lag.
    """

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.time = 0.0
        self._at = -1.0
        self._motion: Motion | None = None
        self._horns: dict[int, HornMotion] = {}

    def go_to(self, time: float) -> None:
        """Let the devices be at a time [s], not before the present one."""
        self.time = max(self.time, time)

    def catch_up(self) -> Plant:
        """Return the plant, moved on to `time`, to be changed: what was known of its motion is forgotten."""
        if self._at != self.time:
            self.plant.advance(self.time)
            self._at = self.time
        self._motion = None
        self._horns.clear()
        return self.plant

    def motion(self) -> Motion:
        """Return the motion at `time`."""
        if self._motion is None or self._at != self.time:
            self._motion = self.catch_up().motion()
        return self._motion

    def horn(self, index: int) -> HornMotion:
        """Return how one horn moves at `time`."""
        if self._at != self.time:
            self.catch_up()
        if index not in self._horns:
            self._horns[index] = self.plant.horn(index)
        return self._horns[index]


class Horn:
    """One motor's end of the mechanics, in the counts of its encoder.

    index: of the motor in the plant; one beyond the tendons is the drive. sign: of the counts that the plant's
    positive sense makes. zero_counts: what the encoder reads at the plant's angle zero. law, law_since: what controls
    the horn, and since when [s].
    """

    def __init__(self, mechanics: Mechanics, index: int, sign: int, zero_counts: float) -> None:
        self.index, self.sign, self.zero_counts = index, sign, zero_counts
        self._mechanics = mechanics
        self.law = Law()
        self.law_since = 0.0
        mechanics.plant.set_law(index, self.law)

    def motion(self) -> HornMotion:
        """Return how the horn moves at present, in the plant's sense."""
        return self._mechanics.horn(self.index)

    def counts_of(self, angle: float) -> float:
        """Return the encoder's counts, turns and fractions included, at an angle [rad] of the plant."""
        return self.zero_counts + self.sign * angle / PULSE

    def angle_of(self, counts: float) -> float:
        """Return the plant's angle [rad] at the encoder's counts."""
        return self.sign * (counts - self.zero_counts) * PULSE

    def set_law(self, law: Law) -> None:
        """Control the horn by another law from now on."""
        if law != self.law:
            self._mechanics.catch_up().set_law(self.index, law)
            self.law, self.law_since = law, self._mechanics.time


# Motors that turn with nothing attached: a plant for trying the bus, in closed form and at no cost.


RESPONSE_S = 0.02
"""Time constant with which the speed of an unloaded motor follows what its law asks for [s]; assumed."""


@dataclass(slots=True)
class _FreeHorn:
    """A motor: where it was [rad], how fast [rad/s] and at what time `since` [s], and what it has done since."""

    no_load_speed: float
    law: Law = field(default_factory=Law)
    since: float = 0.0
    angle: float = 0.0
    speed: float = 0.0
    supply: float = 1.0
    stuck: bool = False

    def at(self, time: float) -> tuple[float, float]:
        """Return (angle, speed) at a time, nothing having changed since."""
        return self._path()(time - self.since)

    def change(self, time: float) -> None:
        """Start anew from what there is at a time."""
        self.angle, self.speed = self.at(time)
        self.since = time

    def _path(self) -> Callable[[float], tuple[float, float]]:
        law, fastest = self.law, self.no_load_speed * self.supply
        if self.stuck:
            return lambda _: (self.angle, 0.0)
        if law.kind == "position":
            return self._approach(law.goal, min(law.speed_limit, fastest * law.duty_limit))
        aims = {
            "off": 0.0,
            "pwm": fastest * max(-law.duty_limit, min(law.duty_limit, law.goal)),
            "velocity": max(-fastest * law.duty_limit, min(fastest * law.duty_limit, law.goal)),
            "current": math.copysign(min(law.speed_limit, fastest * law.duty_limit), law.goal) if law.goal else 0.0,
        }
        return self._spin(aims[law.kind])

    def _spin(self, aim: float) -> Callable[[float], tuple[float, float]]:
        """Return the path of a speed that follows an aim to first order."""

        def path(elapsed: float) -> tuple[float, float]:
            rest = (self.speed - aim) * math.exp(-elapsed / RESPONSE_S)
            return self.angle + aim * elapsed + (self.speed - aim - rest) * RESPONSE_S, aim + rest

        return path

    def _approach(self, goal: float, limit: float) -> Callable[[float], tuple[float, float]]:
        """Return the path to a goal: at the limit of speed, then exponentially where that is slower."""
        way = goal - self.angle
        if limit <= 0:
            return lambda _: (self.angle, 0.0)
        near = limit * RESPONSE_S
        straight = max(0.0, (abs(way) - near) / limit)

        def path(elapsed: float) -> tuple[float, float]:
            if elapsed < straight:
                return self.angle + math.copysign(limit * elapsed, way), math.copysign(limit, way)
            left = math.copysign(min(abs(way), near), way) * math.exp(-(elapsed - straight) / RESPONSE_S)
            return goal - left, left / RESPONSE_S

        return path


class Unloaded:
    """Motors with nothing attached, and an upright head that rests; see `Plant`.

    count: of tendon motors; the drive comes after them. spec: the rig, for no-load speeds and the supply.

    A goal position is approached at the speed limit, or at the duty's share of the no-load speed, and reached
    exponentially within `RESPONSE_S`; any other law brings the motor to a speed: off to rest, a current of either sign
    to the no-load speed. Nothing draws current, because nothing resists. `slip` and
    `push` change nothing.
    """

    def __init__(self, count: int, spec: RigSpec) -> None:
        drive, servo = spec.drive, SERVOS[spec.wiring.tendon_model]
        self._time = 0.0
        self._voltages = [servo.nominal_voltage] * count + [drive.nominal_voltage.value]
        speeds = [servo.no_load_speed] * count + [drive.no_load_speed.value]
        self._horns = [_FreeHorn(speed) for speed in speeds]
        self.set_supply(drive.supply_voltage.value)

    def set_law(self, motor: int, law: Law) -> None:
        horn = self._horns[motor]
        horn.change(self._time)
        horn.law = law

    def set_supply(self, voltage: float) -> None:
        for horn, nominal in zip(self._horns, self._voltages, strict=True):
            horn.change(self._time)
            horn.supply = voltage / nominal

    def stick(self, tendon: int, stuck: bool) -> None:
        horn = self._horns[tendon]
        horn.change(self._time)
        horn.stuck = stuck

    def slip(self, tendon: int, length: float) -> None:
        pass

    def push(self, torque: float) -> None:
        pass

    def place_lever(self, angle: float) -> None:
        horn = self._horns[-1]
        horn.change(self._time)
        horn.angle, horn.speed = angle, 0.0

    def advance(self, until: float) -> None:
        self._time = max(self._time, until)

    def motion(self) -> Motion:
        *tendons, drive = (self.horn(motor) for motor in range(len(self._horns)))
        return Motion(
            self._time, drive, tuple(tendons), (0.0,) * len(tendons), acceleration=(STANDARD_GRAVITY, 0.0, 0.0)
        )

    def horn(self, motor: int) -> HornMotion:
        horn = self._horns[motor]
        angle, speed = horn.at(self._time)
        full = horn.no_load_speed * horn.supply
        duty = 0.0 if horn.law.kind == "off" or full <= 0 else max(-1.0, min(1.0, speed / full))
        return HornMotion(angle, speed, 0.0, duty)
