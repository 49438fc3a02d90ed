"""This is where the yaw of pelvis and trunk about gravity comes out of their sensors or markers.

A sensor's yaw is the integral of its rotation rate about the vertical, which the orientation filter tells (vqf, Laidig
and Seel, 2023, no magnetometer). Its zero is arbitrary and it drifts: gravity says nothing of yaw. What is used of it
later repeats with every stride; offset and drift are taken out there. A pair of markers tells the angle itself.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.signal import butter, sosfiltfilt
from vqf import offlineVQF

from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError
from sinew.measure.walk_file import Imu, MarkerPair, WalkRecord

_GRAVITY = 9.80665
_SLOWEST_STEP_HZ = 0.4
_TALLEST_BOUNCE_M = 0.3
_LEAST_SPEED_M_S = 0.2


@dataclass(frozen=True)
class BodyMotion:
    """How pelvis and trunk turn about the vertical, and how the body goes up and down, on an even clock.

    time_s: [s], shape (n,). pelvis, trunk: yaw [rad], shape (n,), zero and slow drift arbitrary; None where unknown.
    relative: trunk against pelvis [rad], (n,); None where one is missing.
    bounce: vertical velocity [m/s], (n,), of pelvis or trunk; None where unknown.
    place: where the pelvis or trunk is on the ground [m], (n, 2), where markers tell it. drifts: whether yaw may drift
    (inertial sensors). given_speed_m_s: walking speed that somebody knows, NaN else.
    """

    time_s: Array
    pelvis: Array | None
    trunk: Array | None
    relative: Array | None
    bounce: Array | None
    place: Array | None
    drifts: bool
    given_speed_m_s: float = np.nan

    @property
    def swing(self) -> tuple[str, Array]:
        """What the joint must do: trunk against pelvis, else the one that is known, with its name."""
        for name, yaw in (
            ("trunk against pelvis", self.relative),
            ("pelvis", self.pelvis),
            ("trunk", self.trunk),
        ):
            if yaw is not None:
                return name, yaw
        raise AssertionError("a body motion without a yaw")

    def speed(self, start_s: float, stop_s: float) -> float:
        """Return the walking speed in a stretch [m/s]; NaN where unknown, or on a treadmill, where nobody moves on."""
        if self.place is None or np.isfinite(self.given_speed_m_s):
            return self.given_speed_m_s
        ends = [np.interp([start_s, stop_s], self.time_s, axis) for axis in self.place.T]
        speed = float(np.hypot(*(end[1] - end[0] for end in ends))) / (stop_s - start_s)
        return speed if speed > _LEAST_SPEED_M_S else np.nan


def body_motion(record: WalkRecord) -> BodyMotion:
    """Return how pelvis and trunk move in a record.

    The relative yaw of two sensors is the integral of the difference of their rates about the vertical, so it needs
    neither their mounting nor a common heading. Raises RecordingError where markers are not level or are no person.
    """
    time = record.time_s
    if record.yaw is not None:
        return BodyMotion(time, None, None, np.unwrap(record.yaw), None, None, False)
    yaw, bounce, place = {}, None, None
    for role, body in record.bodies.items():
        name = record.names[role]
        if isinstance(body, Imu):
            yaw[role], velocity = _of_imu(time, body)
        else:
            yaw[role], velocity, place = _of_markers(time, body, name)
        bounce = velocity if bounce is None else bounce
    pelvis, trunk = yaw.get("pelvis"), yaw.get("trunk")
    relative = None if pelvis is None or trunk is None else trunk - pelvis
    drifts = any(isinstance(body, Imu) for body in record.bodies.values())
    if relative is not None and not drifts:
        relative = relative - 2 * np.pi * np.round(relative.mean() / (2 * np.pi))
    return BodyMotion(time, pelvis, trunk, relative, bounce, place, drifts)


def _of_imu(time: Array, imu: Imu) -> tuple[Array, Array]:
    """Return yaw [rad] and vertical velocity [m/s], both drifting or high-passed, shape (n,)."""
    step = float(time[1] - time[0])
    found = offlineVQF(imu.gyro, imu.acceleration, None, step)
    w, x, y, z = np.asarray(found["quat6D"]).T
    up = np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z])
    rate = np.sum(up * (imu.gyro - np.asarray(found["bias"])), axis=1)
    rise = np.sum(up * imu.acceleration, axis=1) - _GRAVITY
    yaw = cumulative_simpson(rate, x=time, initial=0.0)
    velocity = cumulative_simpson(rise - rise.mean(), x=time, initial=0.0)
    sections = butter(2, _SLOWEST_STEP_HZ, "highpass", fs=1.0 / step, output="sos")
    return np.asarray(yaw), np.asarray(sosfiltfilt(sections, velocity, padlen=min(time.size - 1, int(2.0 / step))))


def _of_markers(time: Array, pair: MarkerPair, name: str) -> tuple[Array, Array, Array]:
    """Return yaw [rad], vertical velocity [m/s], both (n,), and the place on the ground [m], (n, 2)."""
    across, middle = pair.left - pair.right, 0.5 * (pair.left + pair.right)
    length = np.median(np.linalg.norm(across, axis=1))
    tilted = float(np.median(np.abs(across[:, 2])) / length) if length > 0 else 1.0
    height = float(np.ptp(middle[:, 2]))
    if not tilted < 0.5:
        raise RecordingError(
            f"the line between markers {name} is {np.degrees(np.arcsin(min(tilted, 1.0))):.0f}° off the level in the "
            "median, expected a left and a right marker; name the pair, or the upward axis with --up"
        )
    if height > _TALLEST_BOUNCE_M:
        raise RecordingError(
            f"the markers {name} rise and fall by {height:.2g} m, expected less than {_TALLEST_BOUNCE_M:g} m in a "
            "walk; is the upward axis another (--up), or the unit (write it into the columns' names, LASI_x_mm)?"
        )
    yaw = np.unwrap(np.arctan2(across[:, 1], across[:, 0]))
    velocity = np.gradient(middle[:, 2], time)
    return yaw, velocity, middle[:, :2]
