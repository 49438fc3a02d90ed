"""A linear joint with a servo and late sensors, in plain Python: what the tracking law is tried on without the twin."""

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array
from sinew.plan.plan import Held
from sinew.tune.track import Follow, Mode, Ramp, Tracker, TrackerSetting

INERTIA, LEVER = 12.74e-3, 7.8e-3  # kg m²
STEP_S, CYCLE_S = 5e-4, 5e-3
SERVO_S, MOTOR_S, FASTEST = 0.03, 8e-3, 5.0  # of the servo: lag of its loop and of its motor [s], largest speed [rad/s]


@dataclass
class Joint:
    """A joint of natural frequency [Hz], a constant or of the pretension [mm], and damping ratio; delay: of its gyro
    [s], all of it or what the law knows of it. silent, push: (from, to [s], torque [N m])."""

    natural_hz: float | Callable[[float], float] = 3.5
    damping_ratio: float = 0.07
    delay: float = 0.011
    known_delay: float = 0.011
    silent: tuple[float, float] = (math.inf, math.inf)
    push: tuple[float, float, float] = (math.inf, math.inf, 0.0)

    def hertz(self, pretension_mm: float) -> float:
        return self.natural_hz(pretension_mm) if callable(self.natural_hz) else self.natural_hz


@dataclass
class Run:
    """What came of it, by cycle: time [s], frequency [Hz], true natural frequency [Hz], the law's phase error [rad],
    whether it was locked, its turns, torsion's amplitude [rad] and pretension [mm]."""

    tracker: Tracker
    time: Array
    frequency_hz: Array
    natural_hz: Array
    error: Array
    locked: NDArray[np.bool_]
    torsion: Array
    pretension_mm: Array


def setting(
    joint: Joint,
    start_hz: float,
    *,
    mode: Mode | None = None,
    wanted_deg: float = 20.0,
    held: Held = "command",
    hz_per_mm: float = 0.0,
) -> TrackerSetting:
    return TrackerSetting(
        mode=mode or Mode(joint.hertz(4.0), joint.damping_ratio),
        start_hz=start_hz,
        low_hz=1.5,
        high_hz=6.0,
        wanted=math.radians(wanted_deg),
        most=math.radians(45.0),
        held=held,
        chain=lambda hertz: cmath.exp(-2j * math.pi * hertz * joint.known_delay),
        hz_per_mm=hz_per_mm,
    )


def run(joint: Joint, law: TrackerSetting, seconds: float, path: Ramp | Follow | None = None) -> Run:
    tracker = Tracker(law, path or Ramp(4.0), 0.0)
    torsion = rate = lever = lever_rate = goal = 0.0
    rates: list[float] = []
    rows = []
    cycle = round(CYCLE_S / STEP_S)
    late = round((0.002 + joint.delay) / STEP_S)  # samples are 2 ms old when they come
    for step in range(round(seconds / STEP_S)):
        time = step * STEP_S
        if step % cycle == 0:
            goal = tracker.command(time + 0.5 * CYCLE_S)
            silent = joint.silent[0] <= time < joint.silent[1]
            seen = rates[-late - 1] if len(rates) > late else 0.0  # the newest is of now
            tracker.take(time, time, lever, math.nan if silent else time - 0.002, math.nan if silent else seen)
            natural = joint.hertz(tracker.pretension_mm)
            state = (tracker.frequency_hz, natural, tracker.error, tracker.lock.is_locked, tracker.torsion)
            rows.append((time, *state, tracker.pretension_mm))
        wanted = max(-FASTEST, min(FASTEST, (goal - lever) / SERVO_S))
        acceleration = (wanted - lever_rate) / MOTOR_S
        lever_rate += acceleration * STEP_S
        lever += lever_rate * STEP_S
        omega = math.tau * natural
        pushed = joint.push[2] if joint.push[0] <= time < joint.push[1] else 0.0
        damping = 2 * joint.damping_ratio * omega * rate
        rate += (-(omega**2) * torsion - damping + (pushed - LEVER * acceleration) / INERTIA) * STEP_S
        torsion += rate * STEP_S
        rates.append(rate)
    columns = np.array(rows, dtype=float).T
    locked = columns[4].astype(bool)
    return Run(tracker, columns[0], columns[1], columns[2], columns[3], locked, columns[5], columns[6])
