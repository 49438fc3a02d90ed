"""The mechanics behind the emulated motors: each sets a `Law` for its horn, the joint moves on and gives a `Motion`.

Angles are at the horn; a motor's positive sense is pulling for a tendon's and the lever's own for the drive; all is SI.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import jax
import numpy as np

from sinew.emulator.joint import FAR, TICK_S, DriveOrder, InSpace, TendonOrder, Upright
from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.mechanics.drive import duty_for
from sinew.plan.rig import RigSpec
from sinew.plan.servo import FULL_DUTY_COUNTS, P_GAIN_LSB, SERVOS
from sinew.solve.programs import configure

GEAR_HOLD = 0.1
"""Torque at the horn that the gear of an unpowered tendon motor holds [N m]; assumed. Gears of 353:1 hardly yield."""

_INSTANT_S = 1e-6  # the unit of every time stamp on the bench
_AT_ONCE = 1e9  # [rad]: a goal without a speed limit

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


class JointPlant:
    """The twin's joint behind one motor for each tendon and one for the lever; see `emulator.joint`.

    spec: the rig. slack_m: by how much each tendon is loose where its motor's angle is zero and the joint rests
    untensioned and untilted [m]; negative: taut. rest_tilt: to which the unloaded continuum is bent, about y and z of
    frame B [rad]. in_space: whether the joint is a rod with a heavy head, which bends and sways; else its head has no
    inertia across its axis, and a second of it costs a thirtieth.

    Time passes by `advance`; the joint follows it only when somebody looks or pushes, and what is told is of `time`
    exactly. Motor 0..n-1 pull the tendons, motor n is the drive. All are off at first, and fed with the rig's
    drive.supply_voltage. The joint starts untwisted and unpulled, at its rest tilt; in space it hangs under its weight.
    It moves in ticks of `joint.TICK_S`, and in a shorter one to where a law changes, which acts from then on. The drive
    is told as it is at the moment. Of the rest `motion` tells how it has gone on since the last tick: angles at their
    speed, rates at their acceleration, tensions and the tendons' currents as they were.

    Tendon motors know no inertia: they turn as the cable, the law and the line through stall torque and no-load speed
    let them. By position, and by pwm or current with the tension that belongs to it, they are the twin's motors.
    The gear's friction counts while a motor is off only. Where the joint is not in space, weight does not pull on the
    tilted head, the gyroscope's low-pass is left out for y and z, and the accelerometer knows neither axial nor tilting
    acceleration.

    Raises SpecError for a number of slacks that is not the number of tendons.
    """

    def __init__(
        self,
        spec: RigSpec,
        *,
        slack_m: Sequence[float],
        rest_tilt: tuple[float, float] = (0.0, 0.0),
        in_space: bool = False,
    ) -> None:
        count = spec.tendons.count
        if len(slack_m) != count:
            raise SpecError(f"{len(slack_m)} slacks were given; the rig has {count} tendons, give one for each")
        configure()
        self.spec, self.count = spec, count
        per_count = SERVOS[spec.wiring.tendon_model].position_gain_counts * P_GAIN_LSB / FULL_DUTY_COUNTS
        # of a tendon motor's position loop [duty/rad], to which the rig's servo_stiffness belongs
        self._servo_gain = per_count * spec.tendons.counts_per_turn.value / math.tau
        self._radius = spec.tendons.pulley_radius.value
        self._newton = spec.tendons.current(1.0)  # [A/N]
        self._body: Upright | InSpace = InSpace(spec, rest_tilt) if in_space else Upright(spec, rest_tilt)
        self._p, self._where = self._body.p, self._body.where
        self._now = np.zeros(sum(map(np.size, jax.tree.leaves(self._where))))
        self._tendons, self._drive = np.zeros((len(TendonOrder._fields), count)), np.zeros(len(DriveOrder._fields) + 2)
        self._order = TendonOrder(*self._tendons)  # the rows of the orders
        self._laws = [Law()] * (count + 1)
        self._stuck = [False] * count
        self._supply = spec.drive.supply_voltage.value
        self._push = 0.0
        self._ticks, self._counted_from, self.time = 0, 0.0, 0.0
        self._horns: dict[int, HornMotion] = {}  # of `time`, as far as somebody has asked
        self._begin(slack_m)

    def _begin(self, slack_m: Sequence[float]) -> None:
        state, now = self._now, self._where
        bent, unpulled = self._body.begin(state), self.spec.tendons
        across = unpulled.base_radius.value - unpulled.head_radius.value
        ends = math.hypot(unpulled.free_span.value, across) + np.asarray(slack_m, dtype=float)
        stiffness = self.spec.tendons.cable_stiffness.value
        self._order.cable_end[:] = ends
        state[now.span] = bent
        state[now.tension] = np.maximum(0.0, stiffness * (bent - ends))
        self._order_all()
        for tendon in range(self.count):
            self._anchor(tendon)
        self._seen: list[float] = []
        self._go(0)

    def set_law(self, motor: int, law: Law) -> None:
        """Give a motor another law, from now on."""
        self._reach_present()
        old, self._laws[motor] = self._laws[motor], law
        if motor == self.count:
            if law.kind != old.kind:
                self._now[self._where.goal] = self._now[self._body.lever]
            self._order_drive()
            return
        self._order_tendon(motor)
        if (law.kind, law.gain) != (old.kind, old.gain) or law.kind in ("pwm", "current"):
            self._anchor(motor)

    def set_supply(self, voltage: float) -> None:
        """Feed the motors another voltage [V], from now on."""
        self._reach_present()
        self._supply = voltage
        self._order_all()

    def stick(self, tendon: int, stuck: bool) -> None:
        """Hold a tendon's motor where it is (a jammed pulley), or let it go."""
        self._reach_present()
        self._stuck[tendon] = stuck
        self._order_tendon(tendon)

    def slip(self, tendon: int, length: float) -> None:
        """Let so much cable slip out of a pulley [m], at once."""
        self.catch_up()
        state, now, order = self._now, self._where, self._order
        give = 0.0 if self._stuck[tendon] else order.compliance[tendon]
        before = float(state[now.tension[tendon]])
        stiffness = 1 / (1 / self.spec.tendons.cable_stiffness.value + give)
        after = max(0.0, before - stiffness * length)
        order.cable_end[tendon] += length
        state[now.horn[tendon]] += (before - after) * give
        state[now.tension[tendon]] = after
        self._go(0)

    def push(self, torque: float) -> None:
        """Push the head about the joint's axis with a torque from now on [N m]; positive as the torsion is."""
        self._reach_present()
        self._push = torque
        self._order_drive()

    def place_lever(self, angle: float) -> None:
        """Put the lever at an angle to the head [rad], at once and at rest, as a hand does while its motor is off."""
        self.catch_up()
        self._now[self._body.lever] = self._now[self._where.goal] = angle
        self._now[self._body.lever_rate] = 0.0
        self._go(0)

    def advance(self, until: float) -> None:
        """Let time pass to a moment [s]; one that has passed changes nothing."""
        if until > self.time:
            self.time = until
            self._horns.clear()

    def catch_up(self) -> None:
        """Move the joint on to the last tick before `time`."""
        ticks = math.floor((self.time - self._counted_from) / TICK_S + 1e-6) - self._ticks
        if ticks > 0:
            self._go(ticks)
            self._ticks += ticks

    def motion(self) -> Motion:
        """Return how everything moves at `time`."""
        tendons = tuple(self.horn(i) for i in range(self.count))
        drive, head = self.horn(self.count), self._body.head(self._seen, self._late())
        return Motion(self.time, drive, tendons, self.tension, *head)

    def horn(self, motor: int) -> HornMotion:
        """Return how one motor moves at `time`, without the others."""
        if motor not in self._horns:
            self.catch_up()
            self._horns[motor] = self._tendon_motion(motor) if motor < self.count else self._drive_motion()
        return self._horns[motor]

    @property
    def pretension(self) -> float:
        """The common shortening of the cables since first contact, by the motors' goals, as in the twin [m].

        A goal is what a motor holding its position would have been told for the tension that there is.
        """
        self.catch_up()
        state, now = self._now, self._where
        wound = state[now.horn] + state[now.tension] / self.spec.tendons.servo_stiffness.value
        ends = self._order.cable_end - wound
        return self._body.first_end - float(ends.mean())

    @property
    def tension(self) -> tuple[float, ...]:
        """The tension of every tendon [N], at the last tick."""
        self.catch_up()
        return tuple(self._seen[i] for i in self._where.tension)

    @property
    def state(self) -> Any:
        """The state of the equations of motion, as numbers, at the last tick: `Tilting`, or `SpaceState`."""
        self.catch_up()
        where = self._where.motion
        return jax.tree.map(lambda w: np.array(self._seen)[w] if np.ndim(w) else self._seen[w], where)

    def _late(self) -> float:
        """Return how long ago the last tick was [s]."""
        return self.time - self._counted_from - self._ticks * TICK_S

    def _reach_present(self) -> None:
        """Move on to the present, in the end by less than a tick, and count ticks from here: something changes."""
        self.catch_up()
        self._horns.clear()
        if (late := self._late()) > _INSTANT_S:
            self._go(1, late)
            self._ticks, self._counted_from = 0, self.time

    def _go(self, ticks: int, tick_s: float = TICK_S) -> None:
        out = self._after(ticks, tick_s)
        self._horns.clear()
        self._now = out[: self._now.size].copy()
        self._seen = out.tolist()

    def _after(self, ticks: int, tick_s: float) -> Array:
        """Return the numbers after some ticks of a length [s] under the present laws."""
        steps = self._body.steps
        self._drive[-2:] = tick_s / steps, ticks * steps
        return self._body.move_on(self._now, self._tendons, self._drive)

    def _anchor(self, tendon: int) -> None:
        """Let a motor's position loop start from where its horn is, under the tension there is."""
        state, now, order = self._now, self._where, self._order
        if self._laws[tendon].kind in ("position", "velocity"):
            give = state[now.tension[tendon]] * order.compliance[tendon]
            state[now.wound[tendon]] = state[now.horn[tendon]] + give
        else:
            state[now.wound[tendon]] = order.goal[tendon]

    def _order_all(self) -> None:
        for tendon in range(self.count):
            self._order_tendon(tendon)
        self._order_drive()

    def _order_tendon(self, tendon: int) -> None:
        law, radius, servo = self._laws[tendon], self._radius, SERVOS[self.spec.wiring.tendon_model]
        share = servo.supply_share(self._supply)
        stall = max(1e-9, servo.stall_torque * share / radius)
        fastest = servo.no_load_speed * share * radius
        speed_limit = min(FAR, law.speed_limit * radius)
        limit = min(stall * law.duty_limit, law.current_limit / self._newton)
        order = TendonOrder(
            self._order.cable_end[tendon], limit=limit, duty=law.duty_limit, stall=stall, fastest=fastest
        )
        if law.kind == "position":
            give = self._servo_gain / max(law.gain, 1e-9) / self.spec.tendons.servo_stiffness.value
            speed = min(speed_limit, fastest * law.duty_limit)
            order = order._replace(goal=law.goal * radius, speed=speed, compliance=give)
        elif law.kind == "velocity":
            speed = min(abs(law.goal) * radius, fastest * law.duty_limit)
            order = order._replace(goal=math.copysign(FAR, law.goal), speed=speed, follows=1.0)
        elif law.kind == "off":
            order = order._replace(limit=GEAR_HOLD / radius, duty=1.0, may_wind=0.0)
        else:
            pull = max(-limit, min(limit, law.goal / self._newton))
            if law.kind == "pwm":
                pull = stall * max(-law.duty_limit, min(law.duty_limit, law.goal))
                order = order._replace(duty=min(law.duty_limit, abs(law.goal)))
            winds = {"goal": math.copysign(FAR, pull), "wind_cap": speed_limit, "may_wind": float(pull > 0)}
            order = order._replace(limit=max(0.0, pull), **winds)
        if self._stuck[tendon]:
            order = order._replace(may_wind=0.0, may_pay=0.0)
        self._tendons[:, tendon] = order

    def _order_drive(self) -> None:
        law, p = self._laws[self.count], self._p
        constant = float(p.torque_constant)
        duty_torque = float(p.duty_torque) * (self._supply / self.spec.drive.supply_voltage.value)
        torque_limit = min(1e9, constant * law.current_limit)
        order = DriveOrder(self._push, duty_torque, law.duty_limit, torque_limit, on=float(law.kind != "off"))
        if law.kind == "position":
            limited = math.isfinite(law.speed_limit)
            at = {"speed": law.speed_limit, "jump": 0.0} if limited else {"speed": 0.0, "jump": _AT_ONCE}
            order = order._replace(goal=law.goal, gain=law.gain, **at)
        elif law.kind == "velocity":
            feed = float(p.speed_slope) * law.goal / max(1e-9, duty_torque)
            order = order._replace(speed_gain=law.gain, feed=feed + law.gain * law.goal)
        elif law.kind == "pwm":
            order = order._replace(feed=law.goal)
        elif law.kind == "current":
            torque = constant * max(-law.current_limit, min(law.current_limit, law.goal))
            order = order._replace(by_torque=1.0, torque=torque)
        self._drive[: len(order)] = order

    def _drive_motion(self) -> HornMotion:
        late, p = self._late(), self._p
        seen = (self._after(1, late) if late > _INSTANT_S else self._after(0, TICK_S)).tolist()
        torque, speed = seen[self._body.seen_at.torque], seen[self._body.lever_rate]
        duty = 0.0
        if self._laws[self.count].kind != "off":
            full = np.maximum(1e-9, DriveOrder(*self._drive[:-2]).duty_torque)
            duty = float(duty_for(torque, speed, p._replace(duty_torque=full)))
        return HornMotion(seen[self._body.lever], speed, torque / float(p.torque_constant), max(-1.0, min(1.0, duty)))

    def _tendon_motion(self, tendon: int) -> HornMotion:
        seen, now, order, law = self._seen, self._where, self._order, self._laws[tendon]
        horn, speed = seen[now.horn[tendon]], seen[now.horn_speed[tendon]]
        pull = self._stuck_pull(tendon) if self._stuck[tendon] else seen[now.tension[tendon]]
        if law.kind == "off":
            pull = duty = 0.0
        else:
            duty = pull / float(order.stall[tendon])
            duty += speed / max(1e-9, float(order.fastest[tendon]))
        angle = (horn + self._late() * speed) / self._radius
        return HornMotion(angle, speed / self._radius, pull * self._newton, max(-1.0, min(1.0, duty)))

    def _stuck_pull(self, tendon: int) -> float:
        """Return what a motor whose pulley is jammed pulls with [N], whatever the cable carries."""
        state, now, order, law = self._now, self._where, self._order, self._laws[tendon]
        limit = float(order.limit[tendon])
        if law.kind == "position":
            lag = float(state[now.wound[tendon]] - state[now.horn[tendon]])
            return max(-limit, min(limit, lag / float(order.compliance[tendon])))
        if law.kind == "velocity":
            return limit * ((law.goal > 0) - (law.goal < 0))
        return limit
