"""What an emulated motor asks of the mechanics, and what the mechanics answer.

The device side (registers, modes, limits) sets a `Law` for each horn; the mechanics side (`Plant`) moves on in time and
tells a `Motion`. Angles are at the horn, in the motor's own positive sense being *pulling* for a tendon motor and
the lever's positive sense for the drive; everything is in SI.
"""

from dataclasses import dataclass
from typing import Literal, Protocol

from sinew.plan.servo import PULSE

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
    """The mechanics at one moment.

    time: [s] since the start. drive, tendons: of the motors. tension: of every tendon [N].
    torsion [rad] and torsion_rate [rad/s]: true ones. tilt: of the head plate about y and z of frame B [rad].
    gyro: torsion rate behind the chip's low-pass, and the rates of tilt, in frame H [rad/s].
    acceleration: specific force at the chip, in frame H [m/s²]; at rest it points up.
    """

    time: float
    drive: HornMotion
    tendons: tuple[HornMotion, ...]
    tension: tuple[float, ...]
    torsion: float
    torsion_rate: float
    tilt: tuple[float, float]
    gyro: tuple[float, float, float]
    acceleration: tuple[float, float, float]


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

    def advance(self, until: float) -> None:
        """Move on to a time [s]; one that has passed changes nothing."""
        ...

    def motion(self) -> Motion:
        """Return the state at the time last advanced to."""
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

    def go_to(self, time: float) -> None:
        """Let the devices be at a time [s], not before the present one."""
        self.time = max(self.time, time)

    def catch_up(self) -> Plant:
        """Return the plant, moved on to `time`, to be changed: what was known of its motion is forgotten."""
        if self._at != self.time:
            self.plant.advance(self.time)
            self._at = self.time
        self._motion = None
        return self.plant

    def motion(self) -> Motion:
        """Return the motion at `time`."""
        if self._motion is None or self._at != self.time:
            self._motion = self.catch_up().motion()
        return self._motion


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
        motion = self._mechanics.motion()
        return motion.tendons[self.index] if self.index < len(motion.tendons) else motion.drive

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
