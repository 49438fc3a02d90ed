"""This is where the devices meet the mechanics: one plant, moved on only when somebody looks or pushes."""

import math

from sinew.emulator.plant import HornMotion, Law, Motion, Plant

__all__ = ["PULSE", "Horn", "Mechanics"]

PULSE = math.tau / 4096
"""One count of a motor's encoder [rad]."""


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
