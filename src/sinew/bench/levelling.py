"""This is where the head plate is levelled: a PI loop on its tilt, at rest."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sinew.bench.errors import LostError
from sinew.bench.loop import Loop
from sinew.bench.sample import Sample

__all__ = ["ACCEPTED_DEG", "GOOD_ENOUGH_BY_CURRENT_DEG", "GOOD_ENOUGH_DEG", "Levelling", "level", "rest_tilt"]

GOOD_ENOUGH_DEG = 0.05
"""Tilt at which levelling by position ends, held for a moment [deg]; the paper does not say how level its plate was."""

GOOD_ENOUGH_BY_CURRENT_DEG = 0.12
"""The same where the motors hold currents: one count, 2.69 mA, in one tendon alone tilts the paper's plate by 0.16°."""

ACCEPTED_DEG = 0.2
"""What must be reached at least [deg]."""

MOST_S = 15.0
"""After so long levelling ends, well or not [s]."""

_PROPORTIONAL = 0.2
_INTEGRAL = 4.0  # 1/s
_SMOOTHING_S = 0.08
# The controller must be quick; by position, whether the plate is level may be seen through less of the sensor's noise.
# By current the plate goes from one count of the motors to the next, and a mean over that would look level.
_JUDGED_S = 0.3
_HOLD_S = 0.5


@dataclass(frozen=True, slots=True)
class Levelling:
    """How levelling ended: correction about y and z [rad], tilt that is left [rad], how long it took [s]."""

    offsets: tuple[float, float]
    tilt: float
    duration_s: float


def rest_tilt(sample: Sample) -> tuple[float, float] | None:
    """Return the tilt about y and z [rad] that the accelerometer sees in a sample at rest; None without a reading.

    A plate tilted by a about y and b about z sees gravity's (1, 0, 0) at (1, -b, a) in its own frame.
    """
    x, y, z = sample.acceleration_m_s2
    if math.isnan(x) or x <= 0.0:
        return None
    return math.atan2(z, x), -math.atan2(y, x)


def level(
    loop: Loop, goals: Callable[[tuple[float, float]], tuple[float, ...]], start: tuple[float, float]
) -> Levelling:
    """Correct the tendons until the head plate is level, and return how it ended.

    goals: of the tendon motors for a correction of tilt about y and z [rad]. start: correction to begin with.
    The controller is PI on the accelerometer's tilt behind a low-pass of 80 ms; by position it ends by the tilt behind
    one of 0.3 s. Raises LostError where the plate does not come level.
    """
    integral, smooth, judged = list(start), None, None
    enough = math.radians(GOOD_ENOUGH_BY_CURRENT_DEG if loop.watch.by_current else GOOD_ENOUGH_DEG)
    quiet = 0.0
    memories = (_SMOOTHING_S, _SMOOTHING_S if loop.watch.by_current else _JUDGED_S)
    weight, slow = (1 - math.exp(-loop.period / memory) for memory in memories)
    steps = round(MOST_S / loop.period)
    for k in range(steps):
        seen = rest_tilt(loop.cycle())
        if seen is None:
            continue
        smooth, judged = _followed(smooth, seen, weight), _followed(judged, seen, slow)
        tilt = math.hypot(*judged)
        if tilt < enough:
            quiet += loop.period
            if quiet >= _HOLD_S:
                return Levelling((integral[0], integral[1]), tilt, (k + 1) * loop.period)
            continue
        quiet = 0.0
        integral = [i + _INTEGRAL * loop.period * s for i, s in zip(integral, smooth, strict=True)]
        correction = (integral[0] + _PROPORTIONAL * smooth[0], integral[1] + _PROPORTIONAL * smooth[1])
        loop.set_goals(goals(correction))
    found = math.degrees(math.hypot(*judged)) if judged is not None else math.nan
    if found < ACCEPTED_DEG:
        return Levelling((integral[0], integral[1]), math.radians(found), MOST_S)
    raise LostError(
        f"the head plate is still tilted by {found:.2f}° after {MOST_S:.0f} s of levelling, expected less than "
        f"{ACCEPTED_DEG:g}°; are tendons on the right motors (tendon_ids) and is imu_axes right?"
    )


def _followed(old: list[float] | None, seen: Sequence[float], weight: float) -> list[float]:
    return list(seen) if old is None else [o + weight * (v - o) for o, v in zip(old, seen, strict=True)]
