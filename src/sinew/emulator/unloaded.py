"""Motors that turn with nothing attached: a plant for trying the bus, in closed form and at no cost."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from sinew.emulator.plant import HornMotion, Law, Motion
from sinew.measure.units import STANDARD_GRAVITY
from sinew.plan.rig import RigSpec
from sinew.plan.servo import servo_of

RESPONSE_S = 0.02
"""Time constant with which the speed of an unloaded motor follows what its law asks for [s]; assumed."""


@dataclass(slots=True)
class _Horn:
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
        drive, servo = spec.drive, servo_of(spec.wiring.tendon_model)
        self._time = 0.0
        self._voltages = [servo.nominal_voltage] * count + [drive.nominal_voltage.value]
        speeds = [servo.no_load_speed] * count + [drive.no_load_speed.value]
        self._horns = [_Horn(speed) for speed in speeds]
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

    def advance(self, until: float) -> None:
        self._time = max(self._time, until)

    def motion(self) -> Motion:
        horns = [self._motion(horn) for horn in self._horns]
        return Motion(
            time=self._time,
            drive=horns[-1],
            tendons=tuple(horns[:-1]),
            tension=(0.0,) * (len(horns) - 1),
            torsion=0.0,
            torsion_rate=0.0,
            tilt=(0.0, 0.0),
            gyro=(0.0, 0.0, 0.0),
            acceleration=(STANDARD_GRAVITY, 0.0, 0.0),
        )

    def _motion(self, horn: _Horn) -> HornMotion:
        angle, speed = horn.at(self._time)
        full = horn.no_load_speed * horn.supply
        duty = 0.0 if horn.law.kind == "off" or full <= 0 else max(-1.0, min(1.0, speed / full))
        return HornMotion(angle, speed, 0.0, duty)
