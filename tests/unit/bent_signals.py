"""Synthetic recordings of a bent joint: a joint of constant curvature, swung by hand, and what its sensors say.

The joint is an even rod whose rotation vector per length is constant: the head's orientation is exp(u), u = (t, b_y,
b_z). Nothing here is taken from `sinew.measure.attitude`.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sinew.measure.recording import Segment, build_recording

RATE_HZ = 200.0
GRAVITY = 9.80665
LENGTH_M = 0.095

Rates = NDArray[np.float64]
Motion = Callable[[Rates], Rates]
"""Time [s], (n,), to the head's rotation vector against the base [rad], (n, 3)."""


def arc(bend: float, azimuth: float, twist: Rates, more: Rates | float = 0.0, sideways: Rates | float = 0.0) -> Rates:
    """Return rotation vectors [rad] of an arc: twisted, bent by bend + more towards azimuth, and by sideways across."""
    b, s = bend + more + 0.0 * twist, sideways + 0.0 * twist
    y = -b * np.sin(azimuth) - s * np.cos(azimuth)
    z = b * np.cos(azimuth) - s * np.sin(azimuth)
    return np.stack([twist, y, z], axis=-1)


def body_rates(motion: Motion, time: Rates) -> Rates:
    """Return the angular velocity in the head's axes [rad/s], by a central difference of orientations."""
    h = 1e-5
    before, after = Rotation.from_rotvec(motion(time - h)), Rotation.from_rotvec(motion(time + h))
    return (before.inv() * after).as_rotvec() / (2 * h)


def place(motion: Motion, time: Rates) -> Rates:
    """Return where the head of an arc is [m], (n, 3): the integral of its direction over the length, by Gauss."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    turn = motion(time)
    along = [
        w * Rotation.from_rotvec(0.5 * (1 + x) * turn).apply([1.0, 0.0, 0.0])
        for x, w in zip(nodes, weights, strict=True)
    ]
    return 0.5 * LENGTH_M * np.sum(along, axis=0)


def sensed(motion: Motion, time: Rates, noise: float, random: np.random.Generator) -> dict[str, Rates]:
    """Return gyroscope and accelerometer of the head, with its own acceleration; noise: of the rates [rad/s]."""
    h = 1e-3
    pushed = (place(motion, time + h) - 2 * place(motion, time) + place(motion, time - h)) / h**2
    force = Rotation.from_rotvec(motion(time)).inv().apply(np.add(pushed, [GRAVITY, 0.0, 0.0]))
    rates = body_rates(motion, time) + noise * random.normal(size=(time.size, 3))
    return {"gyro_rad_s": rates, "acceleration_m_s2": force + 10 * noise * random.normal(size=(time.size, 3))}


def orientation(motion: Motion, time: Rates) -> Rates:
    return Rotation.from_rotvec(motion(time)).as_quat(scalar_first=True)


def bent_recording(
    groups: Sequence[tuple[Segment, Motion, Rates]],
    *,
    noise: float = 0.0,
    recorded: float | None = None,
    seed: int = 0,
) -> xr.Dataset:
    """Return a recording of steady groups, each behind a settle of 2 s: what was asked, the motion, the drive [rad].

    noise: of the gyroscope [rad/s]. recorded: None, or the noise [rad] of an orientation that was measured.
    The drive is a function of time as the motion is.
    """
    random = np.random.default_rng(seed)
    parts: list[dict[str, Rates]] = []
    segments: list[Segment] = []
    sizes: list[int] = []
    begin = 0.0
    for asked, motion, phasor in groups:
        settle, record = int(2 * RATE_HZ), round(5 / asked.frequency_hz * RATE_HZ)
        time = np.arange(settle + record) / RATE_HZ
        wave = phasor * np.exp(2j * np.pi * asked.frequency_hz * time)
        part = {"time_s": begin + time, "drive_rad": wave.real, **sensed(motion, time, noise, random)}
        if recorded is not None:
            shaken = Rotation.from_rotvec(recorded * random.normal(size=(time.size, 3)))
            true = Rotation.from_quat(orientation(motion, time), scalar_first=True)
            part["orientation"] = (shaken * true).as_quat(scalar_first=True)
        parts.append(part)
        segments += [replace(asked, kind="settle"), asked]
        sizes += [settle, record]
        begin += time[-1] + 1.0
    samples = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return build_recording(samples, segments, sizes, {"source": "twin"})
