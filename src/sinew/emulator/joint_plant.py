"""The joint as a plant: laws become orders, time becomes whole ticks, numbers become a motion."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np

from sinew.emulator.joint import (
    TICK_S,
    Form,
    Kind,
    Layout,
    hanging,
    joint_of,
    layout,
    move_on,
    move_on_in_space,
    space_layout,
    space_of,
    steps_per_tick,
)
from sinew.emulator.plant import HornMotion, Law, Motion
from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.measure.units import STANDARD_GRAVITY
from sinew.mechanics.drive import duty_for
from sinew.mechanics.parameters import POSITION, Parameters
from sinew.mechanics.space import space_at_rest, tendon_spans
from sinew.mechanics.tendons import span_lengths
from sinew.plan.rig import RigSpec
from sinew.plan.servo import FULL_DUTY_COUNTS, P_GAIN_LSB, SERVOS
from sinew.solve.programs import configure
from sinew.solve.rest import set_pretension
from sinew.twin.parameters import from_rig

GEAR_HOLD = 0.1
"""Torque at the horn that the gear of an unpowered tendon motor holds [N m]; assumed. Gears of 353:1 hardly yield."""

_INSTANT_S = 1e-6  # the unit of every time stamp on the bench
_FAR = 1e3  # [m] or [m/s]: no bound
_AT_ONCE = 1e9  # [rad]: a goal without a speed limit


@dataclass(frozen=True, slots=True)
class Head:
    """How the head moves: what of `Motion` is its own, and needs to be known to tell it."""

    torsion: float
    torsion_rate: float
    tilt: tuple[float, float]
    gyro: tuple[float, float, float]
    acceleration: tuple[float, float, float]


class Body(Protocol):
    """Equations of motion of a joint behind motors, compiled, and what its head tells.

    p: of the torsional joint. where: everything in the vectors. lever, lever_rate: where in `now`. steps: in a tick.
    first_end: the twin's cable end at first contact [m].
    """

    p: Parameters
    where: Layout
    lever: int
    lever_rate: int
    steps: int
    first_end: float

    def begin(self, now: Array) -> Array:
        """Put the unpulled joint at rest into a vector of zeros; return the lengths of its tendons [m], (tendon,)."""
        ...

    def move_on(self, now: Array, tendons: Array, drive: Array) -> Array:
        """Return the numbers of `now` and what is seen after the steps that the vectors ask for."""
        ...

    def head(self, seen: list[float], late: float) -> Head:
        """Return how the head moves, `late` after the last tick [s]."""
        ...


class Upright:
    """A head that twists and sinks, and tilts without inertia; see `emulator.joint`."""

    def __init__(self, spec: RigSpec, rest_tilt: tuple[float, float]) -> None:
        joint, self._kind = joint_of(spec, rest_tilt), Kind.of(spec)
        self._constants = jnp.stack([jnp.asarray(leaf) for leaf in jax.tree.leaves(joint)])
        self._rest_tilt, self._chip = rest_tilt, spec.imu.mount_radius.value
        self.p, self.where = joint.p, layout(self._kind)
        self.steps = steps_per_tick(joint, np.radians(spec.limits.torsion_deg) * 2 * np.pi * spec.limits.drive_hz)
        self.first_end = _first_end(spec)
        motion = self.where.now.tilting.motion
        self.lever, self.lever_rate = motion.lever, motion.lever_rate

    def begin(self, now: Array) -> Array:
        now[list(self.where.now.tilting.tilt)] = self._rest_tilt
        zero, tilt = jnp.zeros(()), (jnp.asarray(self._rest_tilt[0]), jnp.asarray(self._rest_tilt[1]))
        return np.asarray(jnp.stack(span_lengths(zero, zero, self.p, tilt)))

    def move_on(self, now: Array, tendons: Array, drive: Array) -> Array:
        return np.asarray(move_on(now, tendons, drive, self._constants, self._kind))

    def head(self, seen: list[float], late: float) -> Head:
        where, motion = self.where.seen, self.where.now.tilting.motion
        speed = seen[motion.torsion_rate] + late * seen[where.torsion_acceleration]
        torsion = seen[motion.torsion] + late * seen[motion.torsion_rate]
        gyro = seen[motion.gyro] + late * seen[motion.gyro_rate]
        rate_y, rate_z = (seen[i] for i in where.tilt_rate)
        y, z = (seen[i] for i in self.where.now.tilting.tilt)
        c, s = math.cos(torsion), math.sin(torsion)
        along = self._chip * seen[where.torsion_acceleration]
        return Head(
            torsion,
            speed,
            (y + late * rate_y, z + late * rate_z),
            (gyro, c * rate_y + s * rate_z, c * rate_z - s * rate_y),
            _specific_force((y, z), c, s, -self._chip * speed**2, along),
        )


class InSpace:
    """The head of a rod, with mass; see `emulator.space_joint`. Raises SpecError for a rig that tells no masses."""

    def __init__(self, spec: RigSpec, rest_tilt: tuple[float, float]) -> None:
        space, self.first_end = space_of(spec, rest_tilt)
        self._space, self._chip = jax.tree.map(jnp.asarray, space), spec.imu.mount_radius.value
        self._form, self._constants = Form.of(Kind.of(spec), space)
        self.p, self.where = space.rod.joint, space_layout(self._form.kind)
        self.steps = 1
        motion = self.where.now.motion
        self.lever, self.lever_rate = int(motion.lever), int(motion.lever_rate)

    def begin(self, now: Array) -> Array:
        q = hanging(self._space)
        motion, state = self.where.now.motion, space_at_rest(jnp.asarray(q), self._space)
        now[motion.q], now[motion.memory] = state.q, state.memory
        return np.asarray(tendon_spans(jnp.asarray(q), self._space))

    def move_on(self, now: Array, tendons: Array, drive: Array) -> Array:
        return np.asarray(move_on_in_space(now, tendons, drive, self._constants, self._form))

    def head(self, seen: list[float], late: float) -> Head:
        where, motion = self.where.seen, self.where.now.motion

        def numbers(indices: Array) -> list[float]:
            return [seen[i] for i in indices]

        def going(now: list[float], rates: list[float]) -> tuple[float, ...]:
            return tuple(a + late * b for a, b in zip(now, rates, strict=True))

        (x, y, z), (turn_x, _, turn_z) = numbers(where.spin), numbers(where.spin_rate)
        force, r = numbers(where.force), self._chip
        # what turning gives a chip at (0, r, 0): α x p + ω x (ω x p)
        chip = (force[0] + r * (x * y - turn_z), force[1] - r * (x * x + z * z), force[2] + r * (y * z + turn_x))
        torsion, rate = seen[where.torsion], seen[where.torsion_rate]
        tilt, gyro = (
            going(numbers(where.tilt), numbers(where.tilt_rate)),
            going(*map(numbers, (motion.gyro, motion.gyro_rate))),
        )
        return Head(torsion + late * rate, rate, tilt, gyro, chip)  # type: ignore[arg-type]


class JointPlant:
    """The twin's joint behind one motor for each tendon and one for the lever; see `Plant` and `emulator.joint`.

    spec: the rig. slack_m: by how much each tendon is loose where its motor's angle is zero and the joint rests
    untensioned and untilted [m]; negative: taut. rest_tilt: to which the unloaded continuum is bent, about y and z of
    frame B [rad]. motors_at: angles of the horns at time zero [rad], tendons first, then the drive; zero if not given.
    in_space: whether the joint is a rod with a heavy head, which bends and sways; else its head has no inertia across
    its axis, and a second of it costs a thirtieth.

    All motors are off at first, and fed with the rig's drive.supply_voltage. The joint starts untwisted and unpulled,
    at its rest tilt; in space it hangs under its weight. It moves in ticks of `joint.TICK_S`, and in a shorter one to
    where a law changes, which acts from then on. The drive is told as it is at the moment. Of the rest `motion` tells
    how it has gone on since the last tick: angles at their speed, rates at their acceleration, tensions and the
    tendons' currents as they were.

    Tendon motors know no inertia: they turn as the cable, the law and the line through stall torque and no-load speed
    let them. By position, and by pwm or current with the tension that belongs to it, they are the twin's motors.
    The gear's friction counts while a motor is off only. Where the joint is not in space, weight does not pull on the
    tilted head, the gyroscope's low-pass is left out for y and z, and the accelerometer knows neither axial nor tilting
    acceleration.

    Raises SpecError for a number of slacks or angles that is not the number of motors.
    """

    def __init__(
        self,
        spec: RigSpec,
        *,
        slack_m: Sequence[float],
        rest_tilt: tuple[float, float] = (0.0, 0.0),
        motors_at: Sequence[float] | None = None,
        in_space: bool = False,
    ) -> None:
        count = spec.tendons.count
        at = (0.0,) * (count + 1) if motors_at is None else tuple(motors_at)
        if len(slack_m) != count or len(at) != count + 1:
            raise SpecError(
                f"{len(slack_m)} slacks and {len(at)} motor angles were given; "
                f"the rig has {count} tendons and {count + 1} motors, give one for each"
            )
        configure()
        self.spec, self.count = spec, count
        self._servo_gain = _servo_gain(spec)
        self._radius = spec.tendons.pulley_radius.value
        self._newton = spec.tendons.current(1.0)  # [A/N]
        self._body: Body = InSpace(spec, rest_tilt) if in_space else Upright(spec, rest_tilt)
        self._p, self._where = self._body.p, self._body.where
        self._now, self._tendons, self._drive = (np.zeros(size) for size in self._where.sizes())
        self._laws = [Law()] * (count + 1)
        self._stuck = [False] * count
        self._supply = spec.drive.supply_voltage.value
        self._push = 0.0
        self._ticks, self._counted_from, self._until = 0, 0.0, 0.0
        self._begin(slack_m, at)

    def _begin(self, slack_m: Sequence[float], at: Sequence[float]) -> None:
        state, now = self._now, self._where.now
        bent, unpulled = self._body.begin(state), self.spec.tendons
        across = unpulled.base_radius.value - unpulled.head_radius.value
        ends = math.hypot(unpulled.free_span.value, across) + np.asarray(slack_m, dtype=float)
        horns = np.asarray(at[: self.count]) * self._radius
        stiffness = self.spec.tendons.cable_stiffness.value
        self._tendons[list(self._where.tendons.cable_end)] = ends
        state[self._body.lever] = state[now.goal] = at[self.count]
        state[list(now.horn)], state[list(now.span)] = horns, bent
        state[list(now.tension)] = np.maximum(0.0, stiffness * (bent - ends + horns))
        self._order_all()
        for tendon in range(self.count):
            self._anchor(tendon)
        self._seen: list[float] = []
        self._go(0)

    def set_law(self, motor: int, law: Law) -> None:
        self._reach_present()
        old, self._laws[motor] = self._laws[motor], law
        if motor == self.count:
            if law.kind != old.kind:
                self._now[self._where.now.goal] = self._now[self._body.lever]
            self._order_drive()
            return
        self._order_tendon(motor)
        if (law.kind, law.gain) != (old.kind, old.gain) or law.kind in ("pwm", "current"):
            self._anchor(motor)

    def set_supply(self, voltage: float) -> None:
        self._reach_present()
        self._supply = voltage
        self._order_all()

    def stick(self, tendon: int, stuck: bool) -> None:
        self._reach_present()
        self._stuck[tendon] = stuck
        self._order_tendon(tendon)

    def slip(self, tendon: int, length: float) -> None:
        state, now, order = self._now, self._where.now, self._where.tendons
        give = 0.0 if self._stuck[tendon] else float(self._tendons[order.compliance[tendon]])
        before = float(state[now.tension[tendon]])
        stiffness = 1 / (1 / self.spec.tendons.cable_stiffness.value + give)
        after = max(0.0, before - stiffness * length)
        self._tendons[order.cable_end[tendon]] += length
        state[now.horn[tendon]] += (before - after) * give
        state[now.tension[tendon]] = after
        self._go(0)

    def push(self, torque: float) -> None:
        self._reach_present()
        self._push = torque
        self._order_drive()

    def place_lever(self, angle: float) -> None:
        body = self._body
        self._now[body.lever] = self._now[self._where.now.goal] = angle
        self._now[body.lever_rate] = 0.0
        self._go(0)

    def advance(self, until: float) -> None:
        if until <= self._until:
            return
        self._until = until
        ticks = math.floor((until - self._counted_from) / TICK_S + 1e-6) - self._ticks
        if ticks > 0:
            self._go(ticks)
            self._ticks += ticks

    def motion(self) -> Motion:
        head = self._body.head(self._seen, self._late())
        return Motion(
            time=self._until,
            drive=self.horn(self.count),
            tendons=tuple(self.horn(i) for i in range(self.count)),
            tension=self.tension,
            torsion=head.torsion,
            torsion_rate=head.torsion_rate,
            tilt=head.tilt,
            gyro=head.gyro,
            acceleration=head.acceleration,
        )

    def horn(self, motor: int) -> HornMotion:
        return self._tendon_motion(motor, self._late()) if motor < self.count else self._drive_motion()

    @property
    def pretension(self) -> float:
        """The common shortening of the cables since first contact, by the motors' goals, as in the twin [m].

        A goal is what a motor holding its position would have been told for the tension that there is.
        """
        state, now = self._now, self._where.now
        wound = state[list(now.horn)] + state[list(now.tension)] / self.spec.tendons.servo_stiffness.value
        ends = self._tendons[list(self._where.tendons.cable_end)] - wound
        return self._body.first_end - float(ends.mean())

    @property
    def tension(self) -> tuple[float, ...]:
        """The tension of every tendon [N], at the last tick."""
        return tuple(self._seen[i] for i in self._where.now.tension)

    @property
    def tilt_angles(self) -> tuple[float, float]:
        """The tilt of the head plate about y and z of frame B [rad], at the last tick."""
        return self._body.head(self._seen, 0.0).tilt

    @property
    def tilt_angle(self) -> float:
        """The angle between the head plate and the base [rad], at the last tick."""
        return math.hypot(*self.tilt_angles)

    @property
    def state(self) -> Any:
        """The state of the equations of motion, as numbers, at the last tick: `Tilting`, or `SpaceState`."""
        where = self._where.now[0]
        return jax.tree.map(lambda w: np.array(self._seen)[w] if np.ndim(w) else self._seen[w], where)

    def _late(self) -> float:
        """Return how long ago the last tick was [s]."""
        return self._until - self._counted_from - self._ticks * TICK_S

    def _reach_present(self) -> None:
        """Move on to the present, by less than a tick, and count ticks from here."""
        if (late := self._late()) > _INSTANT_S:
            self._go(1, late)
            self._ticks, self._counted_from = 0, self._until

    def _go(self, ticks: int, tick_s: float = TICK_S) -> None:
        out = self._after(ticks, tick_s)
        self._now = out[: self._now.size].copy()
        self._seen = out.tolist()

    def _after(self, ticks: int, tick_s: float) -> Array:
        """Return the numbers after some ticks of a length [s] under the present laws."""
        where, steps = self._where, self._body.steps
        self._drive[where.steps], self._drive[where.step_s] = ticks * steps, tick_s / steps
        return self._body.move_on(self._now, self._tendons, self._drive)

    def _anchor(self, tendon: int) -> None:
        """Let a motor's position loop start from where its horn is, under the tension there is."""
        state, now, order = self._now, self._where.now, self._where.tendons
        if self._laws[tendon].kind in ("position", "velocity"):
            give = state[now.tension[tendon]] * self._tendons[order.compliance[tendon]]
            state[now.wound[tendon]] = state[now.horn[tendon]] + give
        else:
            state[now.wound[tendon]] = self._tendons[order.goal[tendon]]

    def _order_all(self) -> None:
        for tendon in range(self.count):
            self._order_tendon(tendon)
        self._order_drive()

    def _order_tendon(self, tendon: int) -> None:
        law, held, radius = self._laws[tendon], self._stuck[tendon], self._radius
        servo = SERVOS[self.spec.wiring.tendon_model]
        share = servo.supply_share(self._supply)
        stall = max(1e-9, servo.stall_torque * share / radius)
        fastest = servo.no_load_speed * share * radius
        speed_limit = min(_FAR, law.speed_limit * radius)
        orders: dict[str, float] = {
            "goal": _FAR, "speed": 0.0, "compliance": 0.0, "limit": stall * law.duty_limit, "duty": law.duty_limit,
            "stall": stall, "fastest": fastest, "wind_cap": _FAR, "may_wind": 1.0, "may_pay": 1.0, "follows": 0.0,
        }  # fmt: skip
        limit = min(stall * law.duty_limit, law.current_limit / self._newton)
        if law.kind == "position":
            gain = max(law.gain, 1e-9)
            orders |= {"goal": law.goal * radius, "speed": min(speed_limit, fastest * law.duty_limit), "limit": limit}
            orders["compliance"] = self._servo_gain / gain / self.spec.tendons.servo_stiffness.value
        elif law.kind == "velocity":
            orders |= {"goal": math.copysign(_FAR, law.goal), "limit": limit, "follows": 1.0}
            orders["speed"] = min(abs(law.goal) * radius, fastest * law.duty_limit)
        elif law.kind == "off":
            orders |= {"limit": GEAR_HOLD / radius, "duty": 1.0, "may_wind": 0.0}
        else:
            if law.kind == "current":
                pull = max(-limit, min(limit, law.goal / self._newton))
            else:
                pull = stall * max(-law.duty_limit, min(law.duty_limit, law.goal))
                orders["duty"] = min(law.duty_limit, abs(law.goal))
            orders |= {"goal": math.copysign(_FAR, pull), "limit": max(0.0, pull), "wind_cap": speed_limit}
            orders["may_wind"] = float(pull > 0)
        if held:
            orders |= {"may_wind": 0.0, "may_pay": 0.0}
        for name, value in orders.items():
            self._tendons[getattr(self._where.tendons, name)[tendon]] = value

    def _order_drive(self) -> None:
        law, p = self._laws[self.count], self._p
        share = self._supply / self.spec.drive.supply_voltage.value
        constant = float(p.torque_constant)
        duty_torque = float(p.duty_torque) * share
        orders: dict[str, float] = dict.fromkeys(self._where.drive._fields, 0.0)
        orders |= {
            "push": self._push,
            "duty_limit": law.duty_limit,
            "on": float(law.kind != "off"),
            "duty_torque": duty_torque,
        }
        orders["torque_limit"] = min(1e9, constant * law.current_limit)
        if law.kind == "position":
            orders |= {"goal": law.goal, "gain": law.gain}
            limited = math.isfinite(law.speed_limit)
            orders |= {"speed": law.speed_limit if limited else 0.0, "jump": 0.0 if limited else _AT_ONCE}
        elif law.kind == "velocity":
            feed = float(p.speed_slope) * law.goal / max(1e-9, duty_torque)
            orders |= {"speed_gain": law.gain, "feed": feed + law.gain * law.goal}
        elif law.kind == "pwm":
            orders["feed"] = law.goal
        elif law.kind == "current":
            orders |= {"by_torque": 1.0, "torque": constant * max(-law.current_limit, min(law.current_limit, law.goal))}
        for name, value in orders.items():
            self._drive[getattr(self._where.drive, name)] = value

    def _drive_motion(self) -> HornMotion:
        late, p = self._late(), self._p
        seen = (self._after(1, late) if late > _INSTANT_S else self._after(0, TICK_S)).tolist()
        torque, speed = seen[self._where.seen.torque], seen[self._body.lever_rate]
        duty = 0.0
        if self._laws[self.count].kind != "off":
            full = max(1e-9, float(self._drive[self._where.drive.duty_torque]))
            duty = float(duty_for(torque, speed, p._replace(duty_torque=full)))  # type: ignore[arg-type]
        return HornMotion(seen[self._body.lever], speed, torque / float(p.torque_constant), max(-1.0, min(1.0, duty)))

    def _tendon_motion(self, tendon: int, late: float) -> HornMotion:
        seen, now, order, law = self._seen, self._where.now, self._where.tendons, self._laws[tendon]
        horn, speed = seen[now.horn[tendon]], seen[now.horn_speed[tendon]]
        pull = self._stuck_pull(tendon) if self._stuck[tendon] else seen[now.tension[tendon]]
        if law.kind == "off":
            pull = duty = 0.0
        else:
            duty = pull / float(self._tendons[order.stall[tendon]])
            duty += speed / max(1e-9, float(self._tendons[order.fastest[tendon]]))
        angle = (horn + late * speed) / self._radius
        return HornMotion(angle, speed / self._radius, pull * self._newton, max(-1.0, min(1.0, duty)))

    def _stuck_pull(self, tendon: int) -> float:
        """Return what a motor whose pulley is jammed pulls with [N], whatever the cable carries."""
        state, now, order, law = self._now, self._where.now, self._where.tendons, self._laws[tendon]
        limit = float(self._tendons[order.limit[tendon]])
        if law.kind == "position":
            lag = float(state[now.wound[tendon]] - state[now.horn[tendon]])
            return max(-limit, min(limit, lag / float(self._tendons[order.compliance[tendon]])))
        if law.kind == "velocity":
            return limit * ((law.goal > 0) - (law.goal < 0))
        return limit


def _first_end(spec: RigSpec) -> float:
    """Return the twin's cable end at first contact [m]."""
    p = from_rig(spec)
    contact = jnp.asarray(spec.tendons.first_contact_tension.value)
    held, _ = jax.jit(set_pretension)(p, jnp.zeros(()), contact, jnp.asarray(POSITION), jnp.zeros(()))
    return float(held.cable_end)


def _specific_force(
    tilt: tuple[float, float], c: float, s: float, radial: float, tangential: float
) -> tuple[float, float, float]:
    """Return the specific force [m/s²] in frame H at (0, r, 0): against gravity, and what the twist adds to it."""
    y, z = tilt
    angle = math.hypot(y, z)
    sine = math.sin(angle) / angle if angle else 1.0
    up_y, up_z = -sine * z, sine * y
    force_y, force_z = c * up_y + s * up_z, c * up_z - s * up_y
    g = STANDARD_GRAVITY
    return g * math.cos(angle), g * force_y + radial, g * force_z + tangential


def _servo_gain(spec: RigSpec) -> float:
    """Return the gain of a tendon motor's position loop [duty/rad] to which the rig's servo_stiffness belongs."""
    per_count = SERVOS[spec.wiring.tendon_model].position_gain_counts * P_GAIN_LSB / FULL_DUTY_COUNTS
    return per_count * spec.tendons.counts_per_turn.value / math.tau
