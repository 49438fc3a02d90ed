"""This is where a goal becomes a trajectory: a motor's speed and acceleration profile.

Source: e-Manual, "What is the Profile". The trajectory is advanced in steps, from where it is and as fast as it is, so
that a goal that changes on the way is met smoothly.
"""

import math
from dataclasses import dataclass

__all__ = ["PROFILE_STEP", "Profile"]

PROFILE_STEP = 2e-3
"""Time between two points of a trajectory [s]."""


@dataclass(slots=True)
class Profile:
    """Where a trajectory is, in counts and counts/s, and where it goes.

    top_speed: [counts/s], 0: none, the goal is taken at once. acceleration: [counts/s²], 0: the speed is taken at once.
    """

    position: float = 0.0
    speed: float = 0.0
    goal: float = 0.0
    top_speed: float = 0.0
    acceleration: float = 0.0
    is_running: bool = False

    def jump(self, position: float) -> None:
        """Be at a position, at rest."""
        self.position = self.goal = position
        self.speed = 0.0
        self.is_running = False

    def aim(self, goal: float, top_speed: float, acceleration: float) -> None:
        """Set out for a goal."""
        if top_speed <= 0:
            self.jump(goal)
            return
        self.goal, self.top_speed, self.acceleration = goal, top_speed, acceleration
        self.is_running = goal != self.position or self.speed != 0.0

    def advance(self, dt: float) -> None:
        """Move on by a time [s]."""
        if not self.is_running:
            return
        way = self.goal - self.position
        if self.acceleration <= 0:
            self.speed = math.copysign(self.top_speed, way)
            done = abs(way) <= self.top_speed * dt
        else:
            a = self.acceleration
            # Largest speed from which it still stops at the goal, in whole steps.
            brake = a * (math.sqrt(dt * dt / 4 + 2 * abs(way) / a) - dt / 2)
            wanted = math.copysign(min(self.top_speed, brake), way)
            change = max(-a * dt, min(a * dt, wanted - self.speed))
            self.speed += change
            done = abs(way) <= a * dt * dt and abs(self.speed) <= 2 * a * dt
        if done:
            self.jump(self.goal)
        else:
            self.position += self.speed * dt
