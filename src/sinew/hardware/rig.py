"""All devices of a bench as one: read in one transaction, told their goals in another, set up alike.

A cycle of the bench is `write_goals` and `read`. What a device did not answer, or answered too late, is missing from a
reading and never repeated: the next cycle comes soon enough.
"""

import math
from collections import Counter, deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from sinew.hardware.believable import MotorBounds, SensorBounds
from sinew.hardware.bus import Bus, Clock, MonotonicClock, Outcome, Reply
from sinew.hardware.codec import Read, Write, wire_bytes
from sinew.hardware.configuration import (
    Post,
    answer_everything,
    bring_to_known_state,
    changed_registers,
    refuse_unfit,
    registers_read,
)
from sinew.hardware.imu import ClockTrack, Imu, ImuReading, SensorReader
from sinew.hardware.motor import TENDON_MODES, DriveServo, Motor, TendonServo
from sinew.hardware.registers import CURRENT_POSITION_MODE, MOTORS, OPENCR_NODE, POSITION_MODE, lay_out
from sinew.measure.errors import DeviceError, PortError, RegisterError
from sinew.plan.plan import TendonMode
from sinew.plan.rig import RigSpec
from sinew.plan.servo import COUNTS_PER_TURN, SERVOS

_PRESENT = ("realtime_tick", "present_pwm", "present_current", "present_velocity", "present_position")
_CLIMATE = ("present_input_voltage", "present_temperature")
_GOAL = ("goal_position",)  # just before what is present: four bytes more, and it is known which goal was in force
_ORDERS = ("bus_watchdog", "goal_pwm", "goal_current", *_GOAL)
_MOST_GOALS = 16  # packets of goals; that many in a row are lost on no line that a run goes on with
_JUST_STARTED_MS = 5000
_LATEST_S = 0.2  # no answer comes so much later than it was asked for
_LATE = "its answers come late: they are of an earlier cycle"
_READ_MOST_S = 0.02  # on the wire; the bus watchdogs of a run wait four times as long


@dataclass(frozen=True, slots=True)
class MotorReading:
    """One motor at one moment, in the rig's sense: a tendon's is positive where it pulls.

    angle [rad], speed [rad/s], current [A], duty [share of the supply], tick [ms, of its own clock].
    alert: whether it reports a hardware error. goal: the angle in its register of goals [rad]; of the drive alone.
    """

    angle: float
    speed: float
    current: float
    duty: float
    tick: int
    alert: bool
    goal: float = math.nan


@dataclass(frozen=True, slots=True)
class Climate:
    """Supply voltage [V] and temperature [°C] at the motor of that name."""

    name: str
    voltage: float
    temperature: float


@dataclass(frozen=True, slots=True)
class Lack:
    """Why a device of that name gave no reading, or no climate. words: what is the matter with it."""

    name: str
    why: Literal["silent", "damaged", "refused", "stale", "impossible"]
    words: str


_WHY: dict[Outcome, tuple[Literal["silent", "damaged", "refused"], str]] = {
    Outcome.SILENT: ("silent", "it sends nothing"),
    Outcome.DAMAGED: ("damaged", "its answers come damaged"),
    Outcome.WRONG_LENGTH: ("damaged", "its answers have another length than asked for"),
    Outcome.REFUSED: ("refused", "it refuses to be read"),
}


@dataclass(frozen=True, slots=True)
class Reading:
    """What one transaction brought; None stands for a device that gave no fresh answer.

    time: host's time at which the drive read its encoder [s]; what port and operating system take is not in it.
    climate: of the one motor that was asked for it this time. faults: answers that were not ok.
    lacks: who gave nothing that can be used, and why. sensors: in the order of the rig's, NaN for
    one that gave no answer. altered: what the one motor in turn holds, twice running, that nobody here has told it.
    """

    time: float
    drive: MotorReading | None
    tendons: tuple[MotorReading | None, ...]
    imu: ImuReading | None
    climate: Climate | None
    faults: tuple[Reply, ...]
    lacks: tuple[Lack, ...] = ()
    sensors: tuple[float, ...] = ()
    altered: str = ""

    @property
    def stale(self) -> tuple[str, ...]:
        """Names of devices whose answer was whole but of an earlier time."""
        return tuple([lack.name for lack in self.lacks if lack.why == "stale"])

    @property
    def impossible(self) -> tuple[str, ...]:
        """Names of devices whose answer was whole and of this time, but cannot be true."""
        return tuple([lack.name for lack in self.lacks if lack.why == "impossible"])


class _Present:
    """Turns a motor's answer into its reading; all that can be worked out before is."""

    def __init__(self, motor: Motor, spec: RigSpec, zero: int = 0, *, tells_goal: bool = False) -> None:
        self.name, self.id = motor.name, motor.id
        self.bounds = MotorBounds(motor.table, spec)
        self.objection = self.climate_objection = ""
        names = (*_GOAL, *_PRESENT) if tells_goal else _PRESENT
        layouts = names, (*names, *_CLIMATE), (*_ORDERS, *_PRESENT)
        short, long, whole = (lay_out(motor.table, registers) for registers in layouts)
        self.ask, self.ask_climate, self.ask_orders = (
            Read(motor.id, block.address, block.length) for block in (short, long, whole)
        )
        self._unpack, self._unpack_climate, self._unpack_orders = (
            short.unpack.unpack_from, long.unpack.unpack, whole.unpack.unpack
        )  # fmt: skip
        self._before = short.address - whole.address  # bytes of the orders
        self._motor, self._odd = motor, ""
        tick, duty, current, speed, angle, self._volt, self._degree = long.scales[-7:]
        sign = motor.sign
        self._duty, self._current, self._speed, self._angle = sign * duty, sign * current, sign * speed, sign * angle
        self._zero = zero
        self.track = ClockTrack(tick, motor.table["realtime_tick"].highest + 1)

    def decode(self, reply: Reply, time: float) -> MotorReading | None:
        """Return what an answer says, or None if it is not good, does not belong to this host time [s], or cannot be
        true; then `objection` says why."""
        self.objection = ""
        if not reply.ok:
            return None
        counts = self._counts(reply.data) if not reply.rivals else self._only_fresh(reply, time)
        if counts is None:
            self.objection = "two answers come under its id, and differ: do two devices have it?"
            return None
        *goal, tick, duty, current, speed, position = counts
        if not self.track.is_fresh(tick, time):
            if tick < _JUST_STARTED_MS and abs(self.track.ahead(tick, time)) > _LATEST_S:
                self.objection = f"its clock begins anew ({1e-3 * tick:.1f} s): it started anew, did its supply dip?"
            return None
        self.objection = self.bounds.objection(duty, current, speed, position, time)
        if self.objection:
            return None
        angle = (position - self._zero) * self._angle
        held = (goal[0] - self._zero) * self._angle if goal else math.nan
        return MotorReading(
            angle, speed * self._speed, current * self._current, duty * self._duty, tick, reply.alert, held
        )

    def climate(self, reply: Reply, time: float) -> Climate | None:
        """Return voltage and temperature out of an answer to `ask_climate`; None, and `climate_objection`, where they
        cannot be true."""
        *_, voltage, temperature = self._unpack_climate(reply.data)
        volts, degrees = voltage * self._volt, temperature * self._degree
        self.climate_objection = self.bounds.climate_objection(volts, degrees, time)
        return None if self.climate_objection else Climate(self.name, volts, degrees)

    def altered(self, reply: Reply, goals: Collection[int], but: str) -> str:
        """Return what an answer to `ask_orders` and the one before it hold, under torque, that nobody here has told it.

        goals: counts of goal_position that it was told lately. but: a register that may change.
        """
        before, self._odd = self._odd, ""
        kept = self._motor.kept
        if kept.get("torque_enable"):
            found = dict(zip(_ORDERS, self._unpack_orders(reply.data), strict=False))
            goal = found.pop("goal_position")
            odd = [f"{name} {count}" for name, count in found.items() if name != but and kept.get(name, count) != count]
            odd += [f"goal_position {goal}"] if goals and goal not in goals else []
            self._odd = f"{self.name} (id {self.id}) holds {', '.join(odd)}" if odd else ""
        return self._odd if before else ""

    def forget(self) -> None:
        """Take the next answer as fresh, and its position for possible."""
        self._odd = ""
        self.track.reset()
        self.bounds.forget()

    def _counts(self, data: bytes) -> tuple[int, ...]:
        return self._unpack(data, self._before if len(data) == self.ask_orders.length else 0)

    def _only_fresh(self, reply: Reply, time: float) -> tuple[int, ...] | None:
        """Return the counts of the one of several answers that belongs to a host time [s]; None where two do."""
        readings = [self._counts(data) for data in (reply.data, *reply.rivals)]
        fresh = [counts for counts in readings if self.track.could_be(counts[-len(_PRESENT)], time)]
        return None if len(fresh) > 1 else (fresh or readings)[0]


class Rig:
    """The bench's devices.

    bus, clock: the seams; nothing is sent while it is made. spec: wiring, limits and gear of the rig.
    tendons, drive, imu, sensors: the devices. motors: tendons first, then the drive. stale, impossible: answers of an
    earlier time, and those that cannot be true, by device.
    Raises RegisterError if the wiring names a sensor of which there is no register table.
    """

    def __init__(self, bus: Bus, clock: Clock, spec: RigSpec) -> None:
        self.bus, self.clock, self.spec = bus, clock, spec
        wiring, limits, supply = spec.wiring, spec.limits, spec.drive.supply_voltage.value
        tendon, drive = (MOTORS[SERVOS[model].number] for model in (wiring.tendon_model, wiring.drive_model))
        if wiring.imu_model != OPENCR_NODE.model:
            raise RegisterError(
                f"rig key wiring.imu_model: there is no register table of {wiring.imu_model!r}; expected "
                f"{OPENCR_NODE.model}"
            )
        self.tendons = tuple(
            TendonServo(bus, f"tendon {i}", id_, tendon, pull, current_limit=limits.tendon_current_a, supply=supply)
            for i, (id_, pull) in enumerate(zip(wiring.tendon_ids, wiring.tendon_pull, strict=True), start=1)
        )
        window = math.radians(limits.drive_window_deg)
        # It swings in a mode of one turn: a zero that was read while it counted more is the same place in that one.
        zero = wiring.drive_zero_counts % COUNTS_PER_TURN
        self.drive = DriveServo(bus, "drive", wiring.drive_id, drive, wiring.drive_sign, zero=zero, window=window)
        self.imu = Imu(bus, wiring.imu_id, wiring.imu_axes)
        self.sensors = tuple(SensorReader(bus, sensor) for sensor in spec.sensors)
        self.motors: tuple[Motor, ...] = (*self.tendons, self.drive)
        self.devices: tuple[Motor | Imu | SensorReader, ...] = (*self.motors, self.imu, *self.sensors)
        self.stale: Counter[str] = Counter()
        self.impossible: Counter[str] = Counter()
        self.imu.bounds = SensorBounds(spec)
        self._mode: TendonMode | None = None
        self._needed_a = 0.0
        self._return_delay = bus.timing.return_delay
        self._drive_present = _Present(self.drive, spec, self.drive.zero, tells_goal=True)
        self._tendon_presents = tuple(_Present(motor, spec) for motor in self.tendons)
        self._presents = (*self._tendon_presents, self._drive_present)
        self._turns = [self._reads(index) for index in range(2 * len(self._presents))]
        self._turn = 0
        self._sent: deque[dict[int, int]] = deque(maxlen=_MOST_GOALS)

    @property
    def cycle_bytes(self) -> int:
        """Return how many bytes are on the wire in one cycle, without stuffing; before a mode is set, at most."""
        return self.bytes_in(self._mode)

    def bytes_in(self, mode: TendonMode | None) -> int:
        """Return `cycle_bytes` in a mode of the tendon motors; None: at most."""
        query = self._turns[0]
        answers = sum(wire_bytes(read.length, status=True) for read in query)
        single = sum(wire_bytes(4) + wire_bytes(sensor.row.size, status=True) for sensor in self.sensors)
        return self._goal_bytes(mode) + wire_bytes(5 * len(query)) + answers + single

    def _goal_bytes(self, mode: TendonMode | None) -> int:
        if mode == "current":
            return wire_bytes(9 + 7 * len(self.tendons))
        return wire_bytes(4 + 5 * len(self.motors) if mode else 9 * len(self.motors))

    @property
    def goals_s(self) -> float:
        """Return how long the packet with all goals is on the wire [s], without stuffing."""
        return self._goal_bytes(self._mode) * 10 / self.spec.wiring.baud

    @property
    def wire_s(self) -> float:
        """Return how long the bytes of a cycle are on the wire [s]."""
        return self.cycle_bytes * 10 / self.spec.wiring.baud

    def read(self) -> Reading:
        """Return what all devices say, in one transaction that is never repeated; a missing answer raises nothing.

        The drive answers first and the IMU second; sensors with a node of their own are asked after it, one by one. One
        motor in turn also tells its climate and, a cycle later, its bus watchdog and its goals. Raises PortError.
        """
        turn, bus = self._turn, self.bus
        self._turn = (turn + 1) % len(self._turns)
        replies = bus.bulk_read(self._turns[turn], retries=0)
        time = bus.left_wire + self._return_delay
        drive = self._drive_present.decode(replies[self.drive.id], time)
        tendons = tuple([present.decode(replies[present.id], time) for present in self._tendon_presents])
        imu = self._imu_reading(replies, time)
        query = self._presents[turn // 2]
        fresh = drive if query is self._drive_present else tendons[turn // 2]
        is_fresh = fresh is not None and not replies[query.id].rivals
        asks_climate = turn % 2 == 0
        has_climate = is_fresh and asks_climate
        climate = query.climate(replies[query.id], time) if has_climate else None
        altered = query.altered(replies[query.id], *self._orders_of(query)) if is_fresh and not asks_climate else ""
        replies |= {sensor.id: sensor.ask() for sensor in self.sensors}
        values = tuple([sensor.value(replies[sensor.id]) for sensor in self.sensors])
        faults = tuple([reply for reply in replies.values() if not reply.ok])
        lacks: tuple[Lack, ...] = ()
        if faults or (climate is None and has_climate) or imu is None or drive is None or None in tendons:
            lacks = tuple(self._lacks(replies, (*tendons, drive, imu)))
            if has_climate and climate is None:
                lacks += (Lack(query.name, "impossible", query.climate_objection),)
            self.stale.update([lack.name for lack in lacks if lack.why == "stale"])
            self.impossible.update([lack.name for lack in lacks if lack.why == "impossible"])
        return Reading(time, drive, tendons, imu, climate, faults, lacks, values, altered)

    def _orders_of(self, query: _Present) -> tuple[Collection[int], str]:
        """Return the positions that a motor was told lately, and the register of its goals that may change."""
        by_current = self._mode == "current" and query is not self._drive_present
        return ([] if by_current else [goals[query.id] for goals in self._sent]), "goal_current" if by_current else ""

    def _lacks(self, replies: Mapping[int, Reply], found: Sequence[MotorReading | ImuReading | None]) -> Iterator[Lack]:
        """Yield why devices gave no reading. found: what they gave, motors first, then the IMU."""
        objections = [*(present.objection for present in self._presents), self.imu.objection]
        for device, there, objection in zip(self.devices, found, objections, strict=False):
            reply = replies[device.id]
            if not reply.ok:
                yield Lack(device.name, *_WHY[reply.outcome])
            elif there is None and objection:
                yield Lack(device.name, "impossible", objection)
            elif there is None:
                yield Lack(device.name, "stale", _LATE)
        for sensor in self.sensors:
            if not replies[sensor.id].ok:
                yield Lack(sensor.name, *_WHY[replies[sensor.id].outcome])

    def write_goals(self, drive_angle: float, tendon_goals: Sequence[float]) -> None:
        """Tell all motors their goals, in one packet that nobody answers.

        drive_angle: of the lever against the head [rad]. tendon_goals: angles [rad] or, in current mode, currents [A],
        by tendon. Raises DeviceError before `set_tendon_mode`, RegisterError for a goal beyond the rig's limits or
        what a register holds, PortError.
        """
        if self._mode is None:
            raise DeviceError("tendon goals have no meaning yet; expected a mode, call set_tendon_mode first")
        by_current = self._mode == "current"
        drive = self.drive.goal_angle
        writes = [Write(self.drive.id, drive.address, drive.encode(drive_angle))]
        for motor, goal in zip(self.tendons, tendon_goals, strict=True):
            encoder = motor.goal_current if by_current else motor.goal_angle
            writes.append(Write(motor.id, encoder.address, encoder.encode(goal)))
        self._sent.append({write.id: int.from_bytes(write.data, "little", signed=True) for write in writes})
        if by_current:
            self.bus.bulk_write(writes)
        else:  # the same register of all: four bytes less for each of them on the wire
            self.bus.sync_write(drive.address, {write.id: write.data for write in writes})

    def set_tendon_mode(self, mode: TendonMode) -> None:
        """Have all tendon motors run as a plan calls it, from its known state, and `write_goals` mean that.

        Those under torque that are in it already are left. Raises DeviceError if a motor has another mode and its
        torque is on, or does not take a register, which it names.
        """
        self._mode = None
        for motor in self.tendons:
            if motor.get_count("operating_mode") != TENDON_MODES[mode] or not motor.torque_is_on():
                self.prepare_tendon(motor, mode)
        self._mode = mode

    def prepare_tendon(self, motor: TendonServo, mode: TendonMode) -> None:
        """Bring one tendon motor, its torque off, to the known state of a mode. Raises DeviceError."""
        bring_to_known_state(Post(motor, self.spec, TENDON_MODES[mode], self._needed_a))
        # A change of mode may take whole turns off its position.
        next(present for present in self._presents if present.id == motor.id).bounds.forget()

    def configure(self, tendon_current_a: float = 0.0) -> None:
        """Bring every motor to the known state in which a run begins, see `configuration`, and the IMU to its own.

        The tendon motors go into the position mode with a current limit; `set_tendon_mode` gives them another.
        tendon_current_a: the largest current that will be asked of a tendon motor [A].
        Raises DeviceError, naming the register, also if a torque is on; nothing is written then, or before that.
        """
        self._needed_a = tendon_current_a
        modes = {motor.name: CURRENT_POSITION_MODE for motor in self.tendons} | {self.drive.name: POSITION_MODE}
        for motor in self.motors:
            answer_everything(motor)
            motor.require_torque_off("to be set up")
        posts = [Post(m, self.spec, modes[m.name], 0.0 if m is self.drive else tendon_current_a) for m in self.motors]
        for post in posts:
            refuse_unfit(post)
        for post in posts:
            bring_to_known_state(post)
        self.imu.configure()
        self._return_delay = 0.0
        # Nobody waits any more before he answers, so neither need we: a lost answer costs one cycle and not two.
        self.bus.timing = replace(self.bus.timing, return_delay=0.0)
        self.forget()

    def read_registers(self) -> dict[str, dict[str, int]]:
        """Return the registers that matter to a run as every motor holds them now, by its name. Raises DeviceError.

        All are asked at once, or one after the other on a bus so slow that a watchdog would trip meanwhile.
        """
        names = registers_read(self.drive)
        answers = sum(wire_bytes(lay_out(motor.table, names).length, status=True) for motor in self.motors)
        is_quick = answers * 10 / self.bus.timing.baud <= _READ_MOST_S
        found = self.ask_at_once(self.motors, names) if is_quick else {}
        return {motor.name: found.get(motor.name) or motor.get_counts(names) for motor in self.motors}

    def ask_at_once(self, motors: Sequence[Motor], names: Sequence[str]) -> dict[str, dict[str, int]]:
        """Return registers, named by increasing address, of those motors that answer one question to all, by motor.

        It is never repeated. Raises PortError.
        """
        layouts = {motor.id: lay_out(motor.table, names) for motor in motors}
        replies = self.bus.bulk_read([Read(id_, lay.address, lay.length) for id_, lay in layouts.items()], retries=0)
        return {
            motor.name: dict(zip(names, layouts[motor.id].unpack.unpack(replies[motor.id].data), strict=True))
            for motor in motors
            if replies[motor.id].ok and not replies[motor.id].rivals
        }

    def changed_registers(self, found: Mapping[str, Mapping[str, int]]) -> list[str]:
        """Return which of the registers found are no longer as the run set them; goals that it tells are left out."""
        but = ("goal_current",) if self._mode == "current" else ()
        return [clause for motor in self.motors for clause in changed_registers(motor, found[motor.name], but)]

    def forget(self) -> None:
        """Take the next answer of every device as fresh, after one was started anew on purpose."""
        for present in self._presents:
            present.forget()
        self.imu.forget()

    def stand(self) -> tuple[float, ...]:
        """Return where the tendons' horns stand [rad], each told twice; the next reading is held against it.

        Raises DeviceError.
        """
        angles = []
        self._sent.clear()
        for motor, present in zip(self.tendons, self._tendon_presents, strict=True):
            angles.append(motor.angle())
            count = round(motor.sign * angles[-1] / motor.table["present_position"].scale)
            present.bounds.begin(count, self.clock.now())
        return tuple(angles)

    def pace(self, period: float) -> None:
        """Expect to be read in cycles of so long [s]: what is older than that is stale."""
        for present in self._presents:
            present.track.pace(period)
        self.imu.track.pace(period)

    def _reads(self, turn: int) -> list[Read]:
        """Return what is asked in a cycle, in the order of the answers."""
        more = [p.ask_orders if turn % 2 else p.ask_climate for p in self._presents]
        asks = [more[index] if index == turn // 2 else p.ask for index, p in enumerate(self._presents)]
        return [asks[-1], self.imu.ask, *asks[:-1]]

    def _imu_reading(self, replies: dict[int, Reply], time: float) -> ImuReading | None:
        """Return what the IMU says. It answers behind the drive; where that was silent, its own clock says when."""
        before = replies[self.drive.id]
        behind = wire_bytes(len(before.data), status=True) * 10 / self.bus.timing.baud
        answered = time + behind if before.ok else math.nan
        return self.imu.decode(replies[self.imu.id], answered)


class _NoPort:
    """A transport that carries nothing."""

    def write(self, data: bytes) -> None:
        raise PortError("there is no port")

    def read(self, deadline: float) -> bytes:
        raise PortError("there is no port")

    def close(self) -> None:
        pass


def wire_s(spec: RigSpec, mode: TendonMode) -> float:
    """Return how long the bytes of a cycle of a rig are on the wire [s], without stuffing; nobody is asked.

    mode: of the tendon motors.
    """
    clock = MonotonicClock()
    rig = Rig(Bus(_NoPort(), clock), clock, spec)
    return rig.bytes_in(mode) * 10 / spec.wiring.baud
