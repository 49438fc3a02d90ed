"""The emulated bench: motors and sensors on one line, with mechanics behind them; how it is found, and a port to it.

Times are seconds since the bench was made. Things happen when they are due: a sample of the sensor, a step of a
trajectory, a watchdog, an answer. The mechanics move only as far as somebody needs them.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sinew.emulator.device import ImuNode, SensorBoard
from sinew.emulator.faults import Faults, FaultSpec, Happening
from sinew.emulator.line import Line
from sinew.emulator.motor import Motor
from sinew.emulator.plant import JointPlant, Law, Motion
from sinew.hardware.ports import PLUG_ALL, PLUG_DRIVE, TURN_LEVER
from sinew.hardware.registers import BAUD_RATES, MOTORS, OPENCR_NODE
from sinew.measure.errors import PortError, SpecError
from sinew.plan.rig import RigSpec
from sinew.plan.servo import PULSE, SERVOS

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
        follows_goal = self.law.kind in ("position", "current")
        held = follows_goal and (self.law.duty_limit < 1 or self.law.current_limit < math.inf)
        return not self.torque or self.law.kind == "off" or held

    @property
    def is_frozen(self) -> bool:
        """Whether it has no torque, or was told to stay and does: with limited output, or stopped by its watchdog.

        What a joint that swings does to its horn is not its doing.
        """
        return not self.torque or (self.law_s >= _STANDS_S and (self.is_limited or self.is_tripped))


EYE = math.radians(0.5)
"""How well a person turns the lever to its middle, standard deviation [rad]; assumed."""

_NEW_ID, _NEW_BAUD = 1, 57_600


class EmulatedRig:
    """A bench as a master on the line sees it.

    spec: which devices, with which ids and signs, and the sensor's noise. plant: the mechanics, moved on only as far as
    somebody needs them. seed: of the sensor's noise, bias and crystal. tendon_counts: encoder readings of the tendon
    motors at the start. baud: what the devices are set to [1/s]; None: the wiring's, which the master has.
    return_delay: register return_delay_time of the motors, in 2 µs; a factory-new motor has 250. imu_ppm: error of the
    sensor's crystal [1e-6]; None: drawn. faults: where it has any. log: what they have done, in the order of time.
    tells_supply: whether the drive's register of current tells its supply's, which nobody knows of the real ones; the
    tendons' hold by theirs.
    Raises SpecError for a sensor that is not emulated, or a baud that the motors do not have.
    """

    def __init__(
        self,
        spec: RigSpec,
        plant: JointPlant,
        *,
        seed: int = 0,
        tendon_counts: int = 2048,
        baud: int | None = None,
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
        self.faults: Faults | None = None
        self.log: list[Happening] = []
        self._eye = np.random.default_rng([seed, 3])
        self.supply = spec.drive.supply_voltage.value
        plant.set_supply(self.supply)
        self._unplugged = False
        tendons = zip(wiring.tendon_ids, wiring.tendon_pull, strict=True)
        wired = [(device, wiring.tendon_model, sign, tendon_counts) for device, sign in tendons]
        wired.append((wiring.drive_id, wiring.drive_model, wiring.drive_sign, wiring.drive_zero_counts))
        self.motors: dict[int, Motor] = {}
        for index, (device, model, sign, zero) in enumerate(wired):
            motor = Motor(MOTORS[SERVOS[model].number], plant, index, sign, zero, supply=self.supply)
            motor.servo.tells_supply = tells_supply and device == wiring.drive_id
            registers = motor.registers
            registers["id"], registers["baud_rate"] = device, BAUD_RATES.index(baud)
            registers["return_delay_time"] = return_delay
            self.motors[device] = motor
        self._motors = tuple(self.motors.values())
        rng = np.random.default_rng(seed)
        self.imu = ImuNode(spec.imu, plant, rng, device_id=wiring.imu_id, baud=baud, axes=wiring.imu_axes, ppm=imu_ppm)
        self.sensors = tuple(SensorBoard(s, plant, np.random.default_rng((seed, s.id)), baud) for s in spec.sensors)
        self._plugged = frozenset(range(len(self._motors)))
        self.line = Line([*self._motors, self.imu, *self.sensors], wiring.baud)

    @property
    def time(self) -> float:
        """The time it has been advanced to [s]."""
        return self.plant.time

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
        """Return when something happens next, on the line or to the bench [s]; infinite: not until the master sends."""
        return min(self.line.next_event(), math.inf if self.faults is None else self.faults.due)

    def advance(self, now: float) -> None:
        """Let everything happen that is due by a time [s]; one that has passed changes nothing."""
        while self.faults is not None and (due := self.faults.due) <= now:
            self._advance_devices(due)
            self.faults.act(due)
        self._advance_devices(now)

    def catch_up(self) -> None:
        """Move the mechanics on to the present: they lag until somebody needs them, and it takes a while."""
        self.plant.catch_up()

    def _advance_devices(self, now: float) -> None:
        clocked: tuple[Motor | ImuNode, ...] = (*self._motors, self.imu)
        while (due := min(self.line.due, *[device.due for device in clocked])) <= now:
            self.plant.advance(due)
            for device in clocked:
                device.advance(due)
            self.line.work(due)
        self.plant.advance(now)

    def plug(self, motors: Collection[int]) -> None:
        """Leave only these motors on the cable, by their place with the drive last; one that comes or goes loses its
        torque, and one that comes starts anew."""
        for index in self._plugged ^ set(motors):
            self._motors[index].restart(self.time)
        self._plugged = frozenset(motors)
        there = [motor for index, motor in enumerate(self._motors) if index in self._plugged]
        self.line.devices = [*there, self.imu, *self.sensors]

    def unbox(self) -> None:
        """Have all motors as they come from the factory, every one with the same id and baud, and none plugged in."""
        for motor in self._motors:
            motor.registers["id"], motor.registers["baud_rate"] = _NEW_ID, BAUD_RATES.index(_NEW_BAUD)
        self.plug(())

    def do(self, act: int) -> None:
        """Do what a person at the bench would, by its number in `hardware.ports`; another changes nothing.

        What people call tendon 1 is what the label of its motor says, the lowest of the rig's ids, whichever tendon its
        cable is on. The lever is turned as far as an eye can tell.
        """
        labels = sorted(self.spec.wiring.tendon_ids)
        if act == TURN_LEVER:
            middle = PULSE * round(float(self._eye.normal(0.0, EYE)) / PULSE)
            self.plant.place_lever(middle)
        elif act == PLUG_ALL:
            self.plug(range(len(self._motors)))
        elif act == PLUG_DRIVE:
            self.plug([len(labels)])
        elif 0 < act <= len(labels):
            self.plug([self.spec.wiring.tendon_ids.index(labels[act - 1])])

    def set_supply(self, voltage: float) -> None:
        """Feed the bench another voltage [V], from now on; too little turns it off, the sensor with the motors."""
        self.supply = voltage
        self.plant.set_supply(voltage)
        for motor in self._motors:
            motor.set_supply(voltage, self.time)
        for board in (self.imu, *self.sensors):
            board.set_power(all(motor.is_powered for motor in self._motors), self.time)

    def motion(self) -> Motion:
        """Return the true motion at the present time."""
        return self.plant.motion()

    def states(self) -> dict[int, MotorState]:
        """Return the truth about each motor at the present time, by id at the start."""
        found = {}
        for number, motor in self.motors.items():
            law, law_s, moved = motor.servo.law, self.time - motor.servo.law_since, motor.servo.motion()
            state = moved.angle, moved.speed, moved.current, law_s
            found[number] = MotorState(motor.torque, motor.is_tripped, law, *state)
        return found

    def stopped(self) -> bool:
        """Return whether no motor moves of its own: each is without torque, or stands still."""
        return all(not state.torque or not state.is_moving for state in self.states().values())

    def frozen_since(self) -> float | None:
        """Return since when each motor is without torque or holds a goal that stands, limited [s]; None: one drives.

        Since when each is controlled as it is now; a motor that has lost its torque since may have stood before.
        """
        is_frozen = all(state.is_frozen for state in self.states().values())
        return max(motor.servo.law_since for motor in self._motors) if is_frozen else None

    def in_safe_state(self) -> bool:
        """Return whether each motor is without torque, or stands still and is limited or stopped by its watchdog."""
        return all(
            not state.torque or (not state.is_moving and (state.is_limited or state.is_tripped))
            for state in self.states().values()
        )


_WARM_UP = 0.02  # s of emulated time, before a master can open the port: all is compiled then that an answer waits for
_AT_REST = math.radians(60)  # how far from its middle a lever may rest whose motor is new


class Start(NamedTuple):
    """How the bench is found. tilt: of the slack head plate about y and z [rad]; slack: of each tendon [m]."""

    tilt: tuple[float, float]
    slack: tuple[float, ...]


def drawn_start(
    rig: RigSpec, seed: int, tilt_deg: float | None = None, slack_mm: Sequence[float] | None = None
) -> Start:
    """Return how a bench is found for a seed; what is given, tilt [deg] and slack of each tendon [mm], is not drawn."""
    chance = np.random.default_rng([seed, 1])
    size = math.radians(chance.uniform(0.5, 1.5) if tilt_deg is None else tilt_deg)
    towards = chance.uniform(0, math.tau)
    drawn = chance.uniform(0.5e-3, 3e-3, rig.tendons.count)
    slack = drawn.tolist() if slack_mm is None else [1e-3 * millimetres for millimetres in slack_mm]
    return Start((size * math.cos(towards), size * math.sin(towards)), tuple(slack))


def emulated_bench(
    rig: RigSpec,
    start: Start,
    seed: int,
    faults: Sequence[FaultSpec] = (),
    *,
    baud: int | None = None,
    in_space: bool = False,
    is_new: bool = False,
    tells_supply: bool = False,
) -> EmulatedRig:
    """Return an emulated bench that is ready to answer. Raises SpecError for a fault of what the rig does not have, or
    a joint in space without its masses.

    baud: what the devices are set to; else the rig's. in_space: a joint with a heavy head, which bends and sways; one
    that was cast bent is always that. is_new: motors out of their boxes (`EmulatedRig.unbox`), the lever anywhere.
    tells_supply: as of `EmulatedRig`.
    """
    bends = in_space or (rig.space is not None and rig.space.rest_bend_deg != 0)
    plant = JointPlant(rig, slack_m=start.slack, rest_tilt=start.tilt, in_space=bends)
    if is_new:
        plant.place_lever(float(np.random.default_rng([seed, 2]).uniform(-_AT_REST, _AT_REST)))
    bench = EmulatedRig(rig, plant, seed=seed, baud=baud, tells_supply=tells_supply)
    if is_new:
        bench.unbox()
    Faults(bench, faults, seed)
    bench.advance(_WARM_UP)
    bench.motion()
    return bench


class VirtualPort:
    """A bench in virtual time: Transport and Clock of the same time, and nothing sleeps.

    rig: the bench. host_cost: how long each call keeps the host busy [s], so that time passes
    for a master that never waits.
    """

    def __init__(self, rig: EmulatedRig, host_cost: float = 50e-6) -> None:
        self.rig, self.host_cost = rig, host_cost
        self._now = rig.time

    def now(self) -> float:
        self._now = max(self._now, self.rig.time)
        return self._now

    def wait_until(self, time: float) -> None:
        self._now = max(self.now(), time)
        self.rig.advance(self._now)

    def write(self, data: bytes) -> None:
        self._work()
        self.rig.receive(data, self._now)

    def read(self, deadline: float) -> bytes:
        self._work()
        while True:
            data = self.rig.transmit(self._now)
            if data:
                return data
            event = self.rig.next_event()
            if event > deadline:
                self.wait_until(deadline)
                self._refuse_unplugged()
                return self.rig.transmit(self._now)
            self.wait_until(event)
            self._refuse_unplugged()

    def close(self) -> None:
        pass

    def _work(self) -> None:
        self._refuse_unplugged()
        self._now = self.now() + self.host_cost

    def _refuse_unplugged(self) -> None:
        if self.rig.unplugged:
            raise PortError("the port is gone; plug it in again")
