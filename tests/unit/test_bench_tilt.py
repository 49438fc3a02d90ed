"""The tilt of the head plate: signs, rest, swing, and the gyroscope's bias, on motions in closed form."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from scipy import signal

from sinew.bench.record.sample import MISSING
from sinew.bench.tilt import TiltEstimator
from sinew.plan.toml import load_rig

RIG = load_rig("paper")
GRAVITY = 9.80665
RATE_HZ = 200
FINE = 10  # steps of the motion between two samples
NOISE_RAD_S, NOISE_M_S2 = math.radians(0.08), 0.0024 * GRAVITY


@dataclass(frozen=True)
class Readings:
    """What chip and truth say: gyro and acceleration (n, 3), true tilt about y and z of frame H (n, 2)."""

    gyro: np.ndarray
    acceleration: np.ndarray
    tilt: np.ndarray


def swing(
    amplitude_deg: float,
    frequency_hz: float,
    *,
    lean_deg: tuple[float, float] = (1.0, -0.5),
    seconds: float = 30.0,
    rest_s: float = 1.0,
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0),
    noise: float = 1.0,
) -> Readings:
    """A joint that leans, at rest and then twisting ever faster, up to its amplitude over two seconds.

    The lean is fixed in the base's frame. The gyroscope has its low-pass and mean of three; the chip sits off the axis.
    """
    random = np.random.default_rng(1)
    step = 1.0 / (RATE_HZ * FINE)
    time = np.arange(round(seconds * RATE_HZ) * FINE) * step
    rise = np.clip((time - rest_s) / 2.0, 0.0, 1.0)
    torsion = math.radians(amplitude_deg) * rise * np.sin(2 * np.pi * frequency_hz * time)
    rate = np.gradient(torsion, step)
    about_y, about_z = np.radians(lean_deg)
    tilt = np.stack(
        [
            about_y * np.cos(torsion) + about_z * np.sin(torsion),
            -about_y * np.sin(torsion) + about_z * np.cos(torsion),
        ],
        axis=1,
    )
    angle = math.hypot(about_y, about_z)
    share = np.sinc(angle / np.pi)
    up = np.stack([np.full(time.size, math.cos(angle)), -share * tilt[:, 1], share * tilt[:, 0]], axis=1)
    radius = RIG.imu.mount_radius.value
    force = GRAVITY * up + np.stack([0 * rate, -radius * rate**2, radius * np.gradient(rate, step)], axis=1)
    low_passed = signal.lfilter(*signal.butter(2, 41.0, fs=1.0 / step), rate)[::FINE]
    gyro = np.zeros((low_passed.size, 3))
    gyro[:, 0] = np.convolve(low_passed, np.ones(3) / 3)[: low_passed.size]
    gyro += np.array(bias) + noise * NOISE_RAD_S * random.standard_normal(gyro.shape)
    acceleration = force[::FINE] + noise * NOISE_M_S2 * random.standard_normal(gyro.shape)
    return Readings(gyro, acceleration.clip(-2 * GRAVITY, 2 * GRAVITY), tilt[::FINE])


def followed(readings: Readings, estimator: TiltEstimator | None = None) -> np.ndarray:
    """Tilt angle and its components after every sample, (n, 3) [rad]."""
    estimator = estimator or TiltEstimator(RIG)
    rows = []
    for k, (gyro, force) in enumerate(zip(readings.gyro, readings.acceleration, strict=True)):
        rows.append((estimator.update(tuple(gyro), tuple(force), k / RATE_HZ), *estimator.components))
    return np.array(rows)


@pytest.mark.parametrize("lean_deg", [(2.0, 0.0), (-2.0, 0.0), (0.0, 3.0), (0.0, -3.0), (1.0, 2.0)])
def test_a_lean_at_rest_comes_back_with_its_signs(lean_deg: tuple[float, float]) -> None:
    found = followed(swing(0.0, 1.0, lean_deg=lean_deg, seconds=2.0, noise=0.0))
    assert np.degrees(found[-1, 1:]) == pytest.approx(lean_deg, abs=0.01)


@pytest.mark.parametrize(("amplitude_deg", "frequency_hz"), [(20.0, 1.5), (60.0, 3.0), (40.0, 4.0), (20.0, 6.0)])
def test_a_swing_does_not_look_like_a_tilt(amplitude_deg: float, frequency_hz: float) -> None:
    readings = swing(amplitude_deg, frequency_hz)
    off = followed(readings)[:, 0] - np.hypot(*readings.tilt.T)
    assert np.degrees(np.abs(off)).max() < 0.7


def test_the_components_turn_with_the_head() -> None:
    readings = swing(40.0, 1.5)
    off = followed(readings)[-1000:, 1:] - readings.tilt[-1000:]
    assert np.degrees(np.abs(off)).max() < 0.5


def test_the_bias_is_learnt_at_rest() -> None:
    bias = (0.002, -0.003, 0.004)
    estimator = TiltEstimator(RIG)
    followed(swing(0.0, 1.0, seconds=20.0, bias=bias), estimator)
    assert estimator.bias == pytest.approx(bias, abs=5e-4)


def test_a_missing_sample_keeps_the_tilt() -> None:
    estimator = TiltEstimator(RIG)
    before = followed(swing(0.0, 1.0, seconds=1.0), estimator)[-1, 0]
    assert estimator.update((MISSING,) * 3, (MISSING,) * 3, MISSING) == before


def test_a_sample_that_is_read_twice_counts_once() -> None:
    once, twice = TiltEstimator(RIG), TiltEstimator(RIG)
    readings = swing(20.0, 3.0, seconds=3.0)
    for k, (gyro, force) in enumerate(zip(readings.gyro, readings.acceleration, strict=True)):
        once.update(tuple(gyro), tuple(force), k / RATE_HZ)
        for jitter in (0.0, 3e-4):
            twice.update(tuple(gyro), tuple(force), k / RATE_HZ + jitter)
    assert twice.components == pytest.approx(once.components, abs=math.radians(0.02))


def test_at_400_hz_a_sample_that_is_read_twice_counts_for_both_steps() -> None:
    # A head that turns about y at 10 °/s for two seconds stands 20° from where it was, however often it is asked.
    rate, found = math.radians(10.0), {}
    for hz in (200, 400):
        estimator = TiltEstimator(RIG, float(hz))
        for n in range(2 * hz + 1):
            taken = (n * 200 // hz) / 200
            angle = rate * taken
            force = (GRAVITY * math.cos(angle), 0.0, GRAVITY * math.sin(angle))
            estimator.update((0.0, rate, 0.0), force, taken)
        found[hz] = math.degrees(estimator.components[0])
    assert found[400] == pytest.approx(found[200], abs=0.2)
    assert abs(found[200]) == pytest.approx(20.0, abs=1.5)
