"""A made-up walking person: strides that vary, the yaw and bounce that follow them, and sensors."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from sinew.measure.arrays import Array
from sinew.measure.units import STANDARD_GRAVITY
from sinew.tune.gait import BodyMotion

RATE_HZ = 100.0


@dataclass(frozen=True)
class Walker:
    """What a made-up person does: mean stride frequency [Hz], amplitudes [deg], how late the trunk is [deg of stride].

    cv: of period and yaw, standard deviation over mean from stride to stride; likeness: correlation of neighbours.
    """

    frequency_hz: float = 0.95
    pelvis_deg: float = 4.5
    trunk_deg: float = 3.0
    trunk_lag_deg: float = 130.0
    cv: tuple[float, float] = (0.025, 0.12)
    likeness: float = 0.4

    @property
    def relative_deg(self) -> float:
        """Amplitude of trunk against pelvis: the difference of two phasors."""
        return float(abs(self.trunk_deg * np.exp(-1j * np.radians(self.trunk_lag_deg)) - self.pelvis_deg))


def alike(count: int, likeness: float, generator: np.random.Generator) -> Array:
    """Return a stationary first-order autoregression of mean 0 and variance 1, shape (count,)."""
    draw = generator.normal(size=count)
    for i in range(1, count):
        draw[i] = likeness * draw[i - 1] + np.sqrt(1 - likeness**2) * draw[i]
    return draw


def phase_of(walker: Walker, strides: int, generator: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return (time [s], phase [rad], relative size of the yaw) of so many strides, shape (n,) each."""
    period = (1 + walker.cv[0] * alike(strides, walker.likeness, generator)) / walker.frequency_hz
    size = 1 + walker.cv[1] * alike(strides, walker.likeness, generator)
    ends = np.concatenate([[0.0], np.cumsum(period)])
    time = np.arange(0, ends[-1], 1 / RATE_HZ)
    phase = CubicSpline(ends, 2 * np.pi * np.arange(strides + 1))(time)
    return time, phase, np.interp(time, 0.5 * (ends[1:] + ends[:-1]), size)


def yaw_of(walker: Walker, phase: Array, size: Array) -> tuple[Array, Array]:
    """Return the yaw of pelvis and trunk [rad] over the phase [rad], with a second and a third harmonic."""
    pelvis = np.cos(phase) + 0.15 * np.cos(2 * phase + 0.4) + 0.1 * np.cos(3 * phase)
    trunk = np.cos(phase - np.radians(walker.trunk_lag_deg)) + 0.1 * np.cos(3 * phase)
    return np.radians(walker.pelvis_deg) * size * pelvis, np.radians(walker.trunk_deg) * size * trunk


def walk(walker: Walker, strides: int, generator: np.random.Generator, drift_deg_s: float = 0.5) -> BodyMotion:
    """Return the motion of so many strides, with drift of the trunk's yaw and noise."""
    time, phase, size = phase_of(walker, strides, generator)
    pelvis, trunk = yaw_of(walker, phase, size)
    wander = np.radians(0.3) * np.cumsum(generator.normal(size=time.size)) / np.sqrt(RATE_HZ)
    noise = np.radians(0.1) * generator.normal(size=(2, time.size))
    bounce = 0.2 * np.cos(2 * phase + 1) + 0.06 * np.cos(4 * phase) + 0.03 * np.cos(phase + 2)
    bounce = bounce + 0.02 * generator.normal(size=time.size)
    pelvis, trunk = pelvis + noise[0], trunk + np.radians(drift_deg_s) * time + wander + noise[1]
    return BodyMotion(time, pelvis, trunk, trunk - pelvis, bounce, True)


def sensor_columns(
    name: str, time: Array, yaw: Array, height: Array, mounting: Rotation, generator: np.random.Generator
) -> dict[str, Array]:
    """Return what an inertial sensor reads that turns with yaw [rad] and goes up and down with height [m].

    It nods and rolls by some degrees beside. mounting: turns the sensor's axes into the body's. Biases of up to 0.5°/s
    and noise are added. Rates are differences of the exact orientation, rad/s; accelerations m/s².
    """
    nod, roll = np.radians(3) * np.cos(2 * np.pi * 1.9 * time), np.radians(2) * np.sin(2 * np.pi * 0.95 * time)
    turned = Rotation.from_euler("ZYX", np.column_stack([yaw, nod, roll])) * mounting
    step = time[1] - time[0]
    between = (turned[:-1].inv() * turned[1:]).as_rotvec() / step
    gyro = np.vstack([between[:1], 0.5 * (between[:-1] + between[1:]), between[-1:]])
    rise = np.gradient(np.gradient(height, step), step) + STANDARD_GRAVITY
    force = turned.inv().apply(np.column_stack([np.zeros_like(rise), np.zeros_like(rise), rise]))
    gyro = gyro + np.radians([0.4, -0.3, 0.5]) + np.radians(0.1) * generator.normal(size=gyro.shape)
    force = force + 0.05 * generator.normal(size=force.shape)
    columns = {f"{name}_gyr_{axis}": gyro[:, i] for i, axis in enumerate("xyz")}
    return columns | {f"{name}_acc_{axis}": force[:, i] for i, axis in enumerate("xyz")}
