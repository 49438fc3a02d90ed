"""Tilt of the head plate, from gyroscope and accelerometer.

The plate is level where gravity's reaction lies along x, the continuum's direction. Its tilt is the shortest turn that
takes it from there: an angle, and two components about y and z of frame H. They are in H because the accelerometer is;
H turns with the torsion, so the same lean of the joint changes its components by the torsion's angle as the head
twists. At rest the torsion is about zero and the axes are those of the base plate.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from vqf import VQF

from sinew.plan.rig import RigSpec

Vector = tuple[float, float, float]

_ASLEEP_S = 0.5
_SENSOR_HZ, _MOST_STEPS = 200.0, 4  # samples a second that an OpenCR's node has at least; steps that one may stand for


def tilt_of(x: float, y: float, z: float) -> tuple[float, float]:
    """Return the turn about y and z [rad] by which frame H left level, if gravity's reaction is (x, y, z) in it.

    A turn by (a, b) about y and z takes (1, 0, 0) to (1, -b, a) where it is small.
    """
    sideways = math.hypot(y, z)
    per = math.atan2(sideways, x) / sideways if sideways > 0.0 else 0.0
    return per * z, -per * y


def lean_from(tilt: tuple[float, float], torsion: float, target: tuple[float, float]) -> float:
    """Return the angle [rad] between the head's axis and the one that was asked for.

    tilt: about y and z of frame H [rad], which has turned by a torsion [rad]. target: about y and z of frame B [rad].
    """
    c, s = math.cos(torsion), math.sin(torsion)
    in_base = (c * tilt[0] - s * tilt[1], s * tilt[0] + c * tilt[1])
    (x, y, z), (u, v, w) = _axis(in_base), _axis(target)
    across = (y * w - z * v, z * u - x * w, x * v - y * u)
    return math.atan2(math.hypot(*across), x * u + y * v + z * w)


def _axis(tilt: tuple[float, float]) -> Vector:
    """Return where the head's x axis points in B, tilted by a rotation vector about y and z [rad]."""
    angle = math.hypot(*tilt)
    share = math.sin(angle) / angle if angle > 0 else 1.0
    return math.cos(angle), share * tilt[1], -share * tilt[0]


# How the board with the sensor is mounted: signed axes of its chip along x, y and z of the head.


def opposite(axis: str) -> str:
    """Return the signed axis that points the other way."""
    return ("-" if axis[0] == "+" else "+") + axis[1]


def frame_from(up: str) -> tuple[str, str, str]:
    """Return a right-handed frame of signed axes that begins with this one."""
    letters = "xyz"
    letter = letters.index(up[1])
    return up, "+" + letters[(letter + 1) % 3], up[0] + letters[(letter + 2) % 3]


def turned_frame(axes: Sequence[str], turns: int) -> tuple[str, str, str]:
    """Return axes of a frame turned about its x by quarters."""
    x, y, z = axes
    for _ in range(turns % 4):
        y, z = z, opposite(y)
    return x, y, z


class TiltEstimator:
    """Tells the tilt while the joint swings, sample by sample.

    spec: of the rig. sample_hz: at which samples come; a moment without one is stepped over. Above 200 Hz a sensor may
    have fewer samples than there are cycles: each then counts for all steps since the one before.
    The orientation filter (vqf, Laidig and Seel, 2023, without magnetometer) follows the gyroscope and leans on the
    accelerometer over three seconds; its bias is learnt at rest. What the swing itself gives a chip at (0, r, 0) is
    taken out first, α x p + ω x (ω x p): at 40° and 4 Hz that is 4.6 m/s² on average along y, which by itself would
    look like 25°. Turned into the earth's frame it averages out, but only after some seconds; taken out, it halves the
    error while a swing begins. Both ω and α come from the gyroscope, whose chain is 11 ms late: what is left is below
    half a degree at such a swing, and nothing at rest.
    """

    def __init__(self, spec: RigSpec, sample_hz: float = 200.0) -> None:
        self._radius = spec.imu.mount_radius.value
        self._step = 1.0 / sample_hz
        self._may_repeat = sample_hz > _SENSOR_HZ
        self._filter = VQF(self._step)
        self._rate: Vector | None = None
        self._time = math.nan
        self._tilt = (0.0, 0.0)

    @property
    def components(self) -> tuple[float, float]:
        """Tilt about y and z of frame H [rad] after the newest sample."""
        return self._tilt

    @property
    def bias(self) -> Vector:
        """Bias of the gyroscope as learnt so far [rad/s]."""
        found, _ = self._filter.getBiasEstimate()
        return float(found[0]), float(found[1]), float(found[2])

    def update(self, gyro: Vector, acceleration: Vector, time: float) -> float:
        """Return the tilt [rad] after another sample of the IMU; NaN as long as there was none.

        gyro [rad/s], acceleration [m/s²]: axes of frame H. time: when it was taken [s]; the same sample twice counts
        once.
        """
        if math.isnan(sum(gyro) + sum(acceleration)):
            return self._angle()
        since = time - self._time
        if abs(since) < 0.25 * self._step and gyro == self._rate:
            return self._angle()
        force = self._on_axis(gyro, acceleration, since)
        self._rate, self._time = gyro, time
        steps = min(_MOST_STEPS, max(1, round(since / self._step))) if self._may_repeat and since > 0.0 else 1
        for _ in range(steps):
            self._filter.update(np.array(gyro, dtype=float), np.array(force, dtype=float))
        up = _up(self._filter.getQuat6D())
        self._tilt = tilt_of(*up)
        return self._angle()

    def _angle(self) -> float:
        return math.nan if self._rate is None else math.hypot(*self._tilt)

    def _on_axis(self, gyro: Vector, acceleration: Vector, since: float) -> Vector:
        """Return what the accelerometer would read on the joint's axis."""
        x, y, z = gyro
        r = self._radius
        bend = twist = 0.0
        if self._rate is not None and 0.0 < since < _ASLEEP_S:
            steps = max(since, 0.5 * self._step)
            twist, bend = (x - self._rate[0]) / steps, (z - self._rate[2]) / steps
        return (
            acceleration[0] - r * (x * y - bend),
            acceleration[1] + r * (x * x + z * z),
            acceleration[2] - r * (y * z + twist),
        )


def _up(q: NDArray[np.float64]) -> Vector:
    """Return the direction against gravity in the sensor's frame; q turns sensor to earth."""
    w, x, y, z = (float(v) for v in q)
    return 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z
