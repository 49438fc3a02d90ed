"""Mechanics without mechanics, for tests of the devices: horns that go where their law says, and a bench of them."""

import math

from sinew.emulator.bench import EmulatedRig, VirtualPort
from sinew.emulator.plant import HornMotion, JointPlant, Law, Motion
from sinew.hardware.bus import Bus, BusTiming
from sinew.measure.units import STANDARD_GRAVITY
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_rig, read_spec

FASTEST = 4.0  # rad/s, of every horn at full duty


def paper_rig(**wiring: object) -> RigSpec:
    spec = parse_rig(read_spec("rigs", "paper"))
    return spec.model_copy(update={"wiring": spec.wiring.model_copy(update=wiring)})


class StandIn(JointPlant):
    """Horns reach a position at FASTEST, keep a speed, and do not mind a load.

    What no law decides can be set: `current` by motor, `gyro`, `acceleration`.
    """

    def __init__(self, motors: int = 5) -> None:
        self.time = 0.0
        self.laws = [Law() for _ in range(motors)]
        self.angles = [0.0] * motors
        self.speeds = [0.0] * motors
        self.current = [0.0] * motors
        self.duty = [0.0] * motors
        self.gyro = (0.0, 0.0, 0.0)
        self.acceleration = (STANDARD_GRAVITY, 0.0, 0.0)  # upright; no sensor on a bench tells none at all
        self.stuck: dict[int, bool] = {}
        self.slipped: dict[int, float] = {}
        self.supply = math.nan
        self.pushed = 0.0

    def set_law(self, motor: int, law: Law) -> None:
        self.laws[motor] = law

    def set_supply(self, voltage: float) -> None:
        self.supply = voltage

    def stick(self, tendon: int, stuck: bool) -> None:
        self.stuck[tendon] = stuck

    def slip(self, tendon: int, length: float) -> None:
        self.slipped[tendon] = length

    def push(self, torque: float) -> None:
        self.pushed = torque

    def place_lever(self, angle: float) -> None:
        self.angles[-1] = angle

    def catch_up(self) -> None:
        pass

    def advance(self, until: float) -> None:
        dt = until - self.time
        if dt <= 0:
            return
        self.time = until
        for motor, law in enumerate(self.laws):
            self.speeds[motor] = self._speed(law, self.angles[motor], dt)
            self.angles[motor] += self.speeds[motor] * dt

    def motion(self) -> Motion:
        rows = zip(self.angles, self.speeds, self.current, self.duty, strict=True)
        *tendons, drive = (HornMotion(*row) for row in rows)
        slack = (0.0,) * len(tendons)
        return Motion(self.time, drive, tuple(tendons), slack, gyro=self.gyro, acceleration=self.acceleration)

    def horn(self, motor: int) -> HornMotion:
        motion = self.motion()
        return (*motion.tendons, motion.drive)[motor]

    @staticmethod
    def _speed(law: Law, angle: float, dt: float) -> float:
        if law.kind == "position":
            fastest = FASTEST * law.duty_limit
            return max(-fastest, min(fastest, (law.goal - angle) / dt))
        return {"velocity": law.goal, "pwm": law.goal * FASTEST}.get(law.kind, 0.0)


class Bench:
    """An emulated rig with a stand-in behind it, and a bus to it in virtual time."""

    def __init__(self, spec: RigSpec | None = None, *, latency: float = 1e-3, retries: int = 0, **rig: object) -> None:
        self.spec = spec or paper_rig()
        self.plant = StandIn(len(self.spec.wiring.tendon_ids) + 1)
        self.rig = EmulatedRig(self.spec, self.plant, **rig)  # type: ignore[arg-type]
        self.port = VirtualPort(self.rig)
        self.bus = Bus(self.port, self.port, BusTiming(self.spec.wiring.baud, 508e-6, latency), retries)

    def get(self, device: int, name: str) -> int:
        """Return the counts of a motor's register, read over the bus."""
        row = self.rig.motors[device].registers.rows[name]
        reply = self.bus.read(device, row.address, row.size)
        assert reply.ok, reply
        return int.from_bytes(reply.data, "little", signed=row.signed)

    def put(self, device: int, name: str, count: int) -> int:
        """Write counts into a motor's register over the bus; return the error number."""
        row = self.rig.motors[device].registers.rows[name]
        reply = self.bus.write(device, row.address, count.to_bytes(row.size, "little", signed=row.signed))
        return reply.number

    def wait(self, seconds: float) -> None:
        self.port.wait_until(self.port.now() + seconds)
