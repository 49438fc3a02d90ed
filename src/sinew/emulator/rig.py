"""The emulated bench: motors and sensors on one line, with mechanics behind them.

Times are seconds since the bench was made. Things happen when they are due: a sample of the sensor, a step of a
trajectory, a watchdog, an answer. The mechanics move only as far as somebody needs them.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from sinew.emulator.imu_node import ImuNode, SensorBoard
from sinew.emulator.line import Line
from sinew.emulator.motor import Motor
from sinew.emulator.plant import Horn, Law, Mechanics, Motion, Plant
from sinew.hardware.registers import BAUD_RATES, MOTORS, OPENCR_NODE
from sinew.measure.errors import SpecError
from sinew.plan.rig import RigSpec
from sinew.plan.servo import SERVOS

# It is noted when a bus watchdog has stopped a motor, and what became of it.

WATCHED_S = 0.3
"""For how long a motor is watched after it was stopped [s]."""

_STEP = 2e-3


@dataclass(slots=True)
class Trip:
    """A motor that was stopped by its bus watchdog; times are emulated [s].

    motor: its id. heard: when the last instruction had passed. tripped: when the watchdog stopped it.
    turned: how far it then went from there, at most, within `WATCHED_S` [rad]: it holds its place as stiffly as its
    controller can, and the joint may still swing. instructions, group_reads: that had passed since the start.
    """

    motor: int
    heard: float
    tripped: float
    turned: float
    instructions: int
    group_reads: int


class TripLog:
    """Sees to it that nothing of that is missed. To be asked to `look` whenever a motor has done something.

    trips: in the order of time. due: when to look next [s]; infinite: when a motor is due.
    """

    def __init__(self, motors: Sequence[Motor], line: Line) -> None:
        self._motors, self._line = motors, line
        self._tripped = [False] * len(motors)
        self._watched: list[tuple[Trip, Motor, float]] = []
        self.trips: list[Trip] = []
        self.due = math.inf

    def look(self, now: float) -> None:
        """Note who has been stopped, and who still moves, at a time [s]."""
        for index, motor in enumerate(self._motors):
            was, self._tripped[index] = self._tripped[index], motor.is_tripped
            if self._tripped[index] and not was:
                self._begin(motor, now)
        if self._watched and now >= self.due:
            self._follow(now)

    def _begin(self, motor: Motor, now: float) -> None:
        line = self._line
        trip = Trip(motor.id, line.heard_at, now, 0.0, line.instructions, line.group_reads)
        self.trips.append(trip)
        self._watched.append((trip, motor, motor.horn.motion().angle))
        self.due = min(self.due, now + _STEP)

    def _follow(self, now: float) -> None:
        self._watched = [seen for seen in self._watched if now <= seen[0].tripped + WATCHED_S and seen[1].is_tripped]
        for trip, motor, start in self._watched:
            trip.turned = max(trip.turned, abs(motor.horn.motion().angle - start))
        self.due = now + _STEP if self._watched else math.inf


_RESTING = 0.05  # rad/s; below it a motor counts as standing still
_STANDS_S = 0.02  # four cycles of a bench; a goal that has been the same for so long is not on its way


@dataclass(frozen=True, slots=True)
class MotorState:
    """The truth about a motor, whatever its registers say to a master.

    torque: whether it is on. is_tripped: stopped by its bus watchdog. law: what its controller does, and for how long
    it has done just that [s]. angle [rad], speed [rad/s] and current [A]: in the plant's sense.
    """

    torque: bool
    is_tripped: bool
    law: Law
    angle: float
    speed: float
    current: float
    law_s: float = math.inf

    @property
    def is_moving(self) -> bool:
        """Whether the horn turns."""
        return abs(self.speed) > _RESTING

    @property
    def is_limited(self) -> bool:
        """Whether it has no torque, or holds a position or current with less than full duty or with limited current."""
        kept = self.law.kind in ("position", "current")
        held = kept and (self.law.duty_limit < 1 or self.law.current_limit < math.inf)
        return not self.torque or self.law.kind == "off" or held

    @property
    def is_frozen(self) -> bool:
        """Whether it has no torque, or was told to stay and does: with limited output, or stopped by its watchdog.

        What a joint that swings does to its horn is not its doing.
        """
        return not self.torque or (self.law_s >= _STANDS_S and (self.is_limited or self.is_tripped))


class EmulatedRig:
    """A bench as a master on the line sees it.

    spec: which devices, with which ids and signs, and the sensor's noise. plant: the mechanics.
    seed: of the sensor's noise, bias and crystal. tendon_counts: encoder readings of the tendon motors at the start.
    baud: what the devices are set to [1/s]; None: the wiring's, which the master has. firmware: of the motors.
    return_delay: register return_delay_time of the motors, in 2 µs; a factory-new motor has 250.
    imu_ppm: error of the sensor's crystal [1e-6]; None: drawn. trips: who was stopped by its bus watchdog, and when.
    tells_supply: whether the drive's register of current tells its supply's, which nobody knows of the real ones; the
    tendons' hold by theirs.
    Raises SpecError for a sensor that is not emulated, or a baud that the motors do not have.
    """

    def __init__(
        self,
        spec: RigSpec,
        plant: Plant,
        *,
        seed: int = 0,
        tendon_counts: int = 2048,
        baud: int | None = None,
        firmware: int = 47,
        return_delay: int = 250,
        imu_ppm: float | None = None,
        tells_supply: bool = False,
    ) -> None:
        wiring = spec.wiring
        baud = wiring.baud if baud is None else baud
        if baud not in BAUD_RATES:
            rates = ", ".join(map(str, BAUD_RATES))
            raise SpecError(f"the motors cannot speak at {baud} baud; expected one of {rates}")
        if wiring.imu_model != OPENCR_NODE.model:
            raise SpecError(f"the sensor {wiring.imu_model} is not emulated; expected {OPENCR_NODE.model}")
        self.spec, self.plant = spec, plant
        self.mechanics = Mechanics(plant)
        self.supply = spec.drive.supply_voltage.value
        plant.set_supply(self.supply)
        self._unplugged = False
        ids = (*wiring.tendon_ids, wiring.drive_id)
        models = (wiring.tendon_model,) * len(wiring.tendon_ids) + (wiring.drive_model,)
        signs = (*wiring.tendon_pull, wiring.drive_sign)
        zeros = (tendon_counts,) * len(wiring.tendon_ids) + (wiring.drive_zero_counts,)
        self.motors: dict[int, Motor] = {}
        for index, device in enumerate(ids):
            horn = Horn(self.mechanics, index, signs[index], zeros[index])
            table, code = MOTORS[SERVOS[models[index]].number], BAUD_RATES.index(baud)
            motor = Motor(
                table,
                horn,
                device_id=device,
                baud_code=code,
                firmware=firmware,
                supply=self.supply,
                tells_supply=tells_supply and device == wiring.drive_id,
            )
            motor.registers["return_delay_time"] = return_delay
            self.motors[device] = motor
        self._motors = tuple(self.motors.values())
        self._motors_due = 0.0
        rng = np.random.default_rng(seed)
        self.imu = ImuNode(
            spec.imu, self.mechanics, rng, device_id=wiring.imu_id, baud=baud, axes=wiring.imu_axes, ppm=imu_ppm
        )
        nodes = (SensorBoard(s, self.mechanics, np.random.default_rng((seed, s.id)), baud) for s in spec.sensors)
        self.sensors = tuple(nodes)
        self._plugged = frozenset(range(len(self._motors)))
        self.line = Line([*self._motors, self.imu, *self.sensors], wiring.baud)
        self.trips = TripLog(self._motors, self.line)

    @property
    def time(self) -> float:
        """The time it has been advanced to [s]."""
        return self.mechanics.time

    @property
    def unplugged(self) -> bool:
        """Whether the master is cut off; what is on its way at that moment is lost."""
        return self._unplugged

    @unplugged.setter
    def unplugged(self, unplugged: bool) -> None:
        self._unplugged = unplugged
        self.line.forget()

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes that the master begins to send at a time [s]."""
        self.advance(now)
        if not self.unplugged:
            self.line.receive(data, now)

    def transmit(self, now: float) -> bytes:
        """Return the bytes that have come to the master by a time [s]."""
        self.advance(now)
        return b"" if self.unplugged else self.line.transmit(now)

    def next_event(self) -> float:
        """Return when something happens next on the line [s]; infinite: nothing, until the master sends."""
        return self.line.next_event()

    def advance(self, now: float) -> None:
        """Let everything happen that is due by a time [s]; one that has passed changes nothing."""
        imu, line = self.imu, self.line
        while True:
            due = min(imu.due, line.due, self._motors_due)
            if due > now:
                break
            self.mechanics.go_to(due)
            if self._motors_due <= due:
                for motor in self._motors:
                    if motor.due <= due:
                        motor.advance(due)
                self.trips.look(due)
                self._look_ahead()
            if imu.due <= due:
                imu.advance(due)
            if line.due <= due:
                heard = line.instructions
                line.work(due)
                if line.instructions != heard:
                    self._look_ahead()
        self.mechanics.go_to(now)

    def _look_ahead(self) -> None:
        """Find out when a motor has something to do: to be asked anew after instructions, which may change that."""
        self._motors_due = min(self.trips.due, *[motor.due for motor in self._motors])

    def plug(self, motors: Collection[int]) -> None:
        """Leave only these motors on the cable, by their place with the drive last; one that comes or goes loses its
        torque, and one that comes starts anew."""
        for index in self._plugged ^ set(motors):
            self._motors[index].restart(self.time)
        self._plugged = frozenset(motors)
        there = [motor for index, motor in enumerate(self._motors) if index in self._plugged]
        self.line.devices = [*there, self.imu, *self.sensors]
        self._look_ahead()

    def set_supply(self, voltage: float) -> None:
        """Feed the bench another voltage [V], from now on; too little turns it off, the sensor with the motors."""
        self.supply = voltage
        self.mechanics.catch_up().set_supply(voltage)
        for motor in self._motors:
            motor.set_supply(voltage, self.time)
        self._look_ahead()
        for board in (self.imu, *self.sensors):
            board.set_power(all(motor.is_powered for motor in self._motors), self.time)

    def stick(self, tendon: int, stuck: bool) -> None:
        """Jam a tendon's pulley from now on, or let it go; tendons count from 0."""
        self.mechanics.catch_up().stick(tendon, stuck)

    def slip(self, tendon: int, length: float) -> None:
        """Let so much cable slip out of a pulley [m], at once."""
        self.mechanics.catch_up().slip(tendon, length)

    def push(self, torque: float) -> None:
        """Push the head about the joint's axis with a torque from now on [N m]; 0 lets it go."""
        self.mechanics.catch_up().push(torque)

    def motion(self) -> Motion:
        """Return the true motion at the present time."""
        return self.mechanics.motion()

    def states(self) -> dict[int, MotorState]:
        """Return the truth about each motor at the present time, by id at the start."""
        states: dict[int, MotorState] = {}
        for device, motor in self.motors.items():
            horn = motor.horn.motion()
            states[device] = MotorState(
                motor.torque,
                motor.is_tripped,
                motor.horn.law,
                horn.angle,
                horn.speed,
                horn.current,
                self.time - motor.horn.law_since,
            )
        return states

    def stopped(self) -> bool:
        """Return whether no motor moves of its own: each is without torque, or stands still."""
        return all(not state.torque or not state.is_moving for state in self.states().values())

    def frozen(self) -> bool:
        """Return whether no motor drives any more: each is without torque, or holds a goal that stands, limited."""
        return all(state.is_frozen for state in self.states().values())

    def frozen_since(self) -> float | None:
        """Return since when no motor drives any more [s], None where one does.

        Since when each is controlled as it is now; a motor that has lost its torque since may have stood before.
        """
        if not self.frozen():
            return None
        return max(motor.horn.law_since for motor in self._motors)

    def in_safe_state(self) -> bool:
        """Return whether each motor is without torque, or stands still and is limited or stopped by its watchdog."""
        return all(
            not state.torque or (not state.is_moving and (state.is_limited or state.is_tripped))
            for state in self.states().values()
        )
