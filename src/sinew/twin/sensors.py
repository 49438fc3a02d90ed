"""This is where the true motion becomes what the registers and stamps of a bench would say."""

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from sinew.plan.rig import Bus, Imu
from sinew.twin.effects import Effects

__all__ = ["GRAVITY", "read_accelerometer", "read_gyro", "read_rounded", "stamp"]

GRAVITY = 9.80665
"""Standard gravity [m/s²]; the rig stands upright, so it is on the x axis of the accelerometer."""

Samples = NDArray[np.float64]


def _noise(std: float, imu: Imu, size: int, sample_hz: float, rng: np.random.Generator) -> Samples:
    """Return noise of a standard deviation, coloured by the sensor's own low-pass."""
    white = rng.standard_normal(size)
    corner = imu.low_pass.value
    if corner >= 0.45 * sample_hz:
        return std * white
    b, a = signal.butter(2, corner, fs=sample_hz)
    _, h = signal.freqz(b, a, worN=512)
    return np.asarray(std / np.sqrt(np.mean(np.abs(h) ** 2)) * signal.lfilter(b, a, white))


def _moving_average(values: Samples, starts: NDArray[np.intp], count: int) -> Samples:
    """Return the causal mean over `count` samples; before the start of a group the first sample is repeated."""
    index = np.arange(values.size)
    first = np.zeros(values.size, dtype=np.intp)
    first[starts] = starts
    first = np.maximum.accumulate(first)
    total = np.zeros_like(values)
    for back in range(count):
        total += values[np.maximum(index - back, first)]
    return total / count


def read_rounded(values: Samples, lsb: float, effects: Effects) -> Samples:
    """Return values rounded to a register's unit."""
    return np.round(values / lsb) * lsb if effects.sensor_noise else values


def read_gyro(
    low_passed: Samples,
    low_passed_rate: Samples,
    true_rate: Samples,
    starts: NDArray[np.intp],
    sample_hz: float,
    imu: Imu,
    effects: Effects,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """Return the gyroscope's three axes as the stock OpenCR library reports them [rad/s], shape (sample, 3).

    low_passed, low_passed_rate: torsion rate behind the chip's low-pass and its derivative, (sample,).
    true_rate: before it. starts: first sample of every group.
    Range, noise, bias, residual delay (first order in τ: its remainder is (Ωτ)²/2 = 6e-5 at 4.3 Hz), moving
    average, whole LSB, dead band.
    """
    readings = np.zeros((true_rate.size, 3), dtype=np.float32)
    along = low_passed - imu.residual_delay.value * low_passed_rate if effects.sensor_filter else true_rate
    for axis in range(3):
        values = along if axis == 0 else np.zeros_like(along)
        if effects.sensor_noise:
            bias = imu.gyro_bias.value * rng.standard_normal()
            values = values + bias + _noise(imu.gyro_noise.value, imu, values.size, sample_hz, rng)
            values = np.clip(values, -imu.gyro_range.value, imu.gyro_range.value)
        if effects.sensor_filter:
            values = _moving_average(values, starts, imu.average_samples)
        if effects.sensor_noise:
            raw = np.round(values / imu.gyro_lsb.value)
            values = np.where(np.abs(raw) <= imu.dead_band, 0.0, raw) * imu.gyro_lsb.value
        readings[:, axis] = values
    return readings


def read_accelerometer(
    rate: Samples, acceleration: Samples, imu: Imu, effects: Effects, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Return the accelerometer's three axes [m/s²], shape (sample, 3), for a chip at (0, r, 0) in frame H.

    rate, acceleration: of the torsion. Specific force: +g along x, -r φ̇² along y, r φ̈ along z; clipped at the
    range. Its low-pass is not modelled.
    """
    radius = imu.mount_radius.value
    force = np.stack([np.full_like(rate, GRAVITY), -radius * rate**2, radius * acceleration], axis=-1)
    if effects.sensor_noise:
        force += imu.accelerometer_noise.value * rng.standard_normal(force.shape)
        force = np.clip(force, -imu.accelerometer_range.value, imu.accelerometer_range.value)
        force = np.round(force / imu.accelerometer_lsb.value) * imu.accelerometer_lsb.value
    return force.astype(np.float32)


def stamp(counts: NDArray[np.intp], sample_hz: float, bus: Bus, effects: Effects, rng: np.random.Generator) -> Samples:
    """Return the host's time stamps [s] of groups that follow one another, shape (sum of counts,).

    Jitter is normal, cut at 0.4 sample intervals so that stamps keep their order.
    """
    index = np.arange(int(counts.sum()))
    ideal = index / sample_hz
    if not effects.stamp_jitter:
        return ideal
    jitter = bus.stamp_jitter.value * rng.standard_normal(index.size)
    return np.asarray(ideal + np.clip(jitter, -0.4 / sample_hz, 0.4 / sample_hz))
