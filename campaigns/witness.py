"""How the joint really moved, and what a reading may have been.

A reading is right if the truth had that value at the time it is filed under, give or take what the bench cannot know:

* **When.** A motor's clock ticks in milliseconds, and an answer counts as fresh if it is within 3 ms of where that
  clock should be (`sinew.hardware.imu`); a cycle's answers follow the drive's by at most the time of their
  bytes. The sensor's samples lie, in a recording, on a line through the host's times, which is good to half a
  millisecond, and 1 ms is allowed; in the journal they have the 3 ms of the answer that brought them.
* **How much.** An encoder tells whole counts, half a count either way, and the emulated mechanics, which tell an angle
  between two ticks of 1.25 ms at the speed of the first, are off by ½ a t², 0.1 count at the strongest swing. A current
  and a duty are half a unit of their registers off. The gyroscope has bias, noise behind its average of three, and
  a dead band.

So with `Truth.range` every reading gets a window in time and the lowest and highest true value in it. An answer that is
a cycle of 5 ms old at more than 0.6 rad/s of the lever lies outside.
"""

import math
from array import array
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from sinew.emulator.imu_node import SAMPLE_PERIOD
from sinew.emulator.plant import HornMotion, Law, Motion, Plant
from sinew.measure.arrays import Array
from sinew.plan.rig import RigSpec

MOTOR_S = 3.1e-3
"""How far off the time of a motor's fresh reading may be [s]."""

SENSOR_S = 1.0e-3
"""How far off the time of a sensor's reading in a recording may be [s]."""

TENDON_COUNTS = 2048
"""What the encoders of the tendon motors read in the beginning."""

_ENCODER = 0.75  # counts
_REGISTER = 0.6  # counts
_SIGMAS = 6.0
_BIASES = 4.5
_STEP_S = 5.1e-3  # between two looks at the joint, at most; the sensor alone looks every 5 ms
_SWING = 8e-3  # rad/s: ½ φ''' t² of the gyro between two ticks, at the strongest swing
_FORCE = 0.05  # m/s²: the same of the accelerometer


class Witness:
    """A plant whose every motion is written down; see `Plant`.

    plant: that moves. Nothing about it changes, except that it is looked at more often.
    """

    def __init__(self, plant: Plant, tendons: int) -> None:
        self.plant, self.tendons = plant, tendons
        self._seen = array("d")
        self._newest = 0.0

    def set_law(self, motor: int, law: Law) -> None:
        self.plant.set_law(motor, law)

    def set_supply(self, voltage: float) -> None:
        self.plant.set_supply(voltage)

    def stick(self, tendon: int, stuck: bool) -> None:
        self.plant.stick(tendon, stuck)

    def slip(self, tendon: int, length: float) -> None:
        self.plant.slip(tendon, length)

    def place_lever(self, angle: float) -> None:
        self.plant.place_lever(angle)

    def push(self, torque: float) -> None:
        self.plant.push(torque)

    def advance(self, until: float) -> None:
        while until - self._newest > _STEP_S:
            self.plant.advance(self._newest + _STEP_S)
            self.motion()
        self.plant.advance(until)

    def motion(self) -> Motion:
        motion = self.plant.motion()
        drive = motion.drive
        self._seen.extend((motion.time, drive.angle, drive.speed, drive.current, drive.duty))
        self._seen.extend([tendon.angle for tendon in motion.tendons])
        self._seen.extend([tendon.current for tendon in motion.tendons])
        self._seen.append(motion.gyro[0])
        self._seen.extend(motion.acceleration)
        self._newest = motion.time
        return motion

    def horn(self, motor: int) -> HornMotion:
        motion = self.motion()
        return (*motion.tendons, motion.drive)[motor]

    def truth(self, spec: RigSpec) -> "Truth":
        """Return what was seen."""
        rows = np.frombuffer(self._seen.tobytes()).reshape(-1, 9 + 2 * self.tendons)
        return Truth(rows, spec)


class Truth:
    """How the joint moved. rows: of a `Witness`."""

    def __init__(self, rows: Array, spec: RigSpec) -> None:
        self.time, last = np.unique(rows[::-1, 0], return_index=True)
        rows = rows[::-1][last]
        count = spec.tendons.count
        self.values: dict[str, Array] = {"drive_rad": rows[:, 1], "drive_current_a": rows[:, 3]}
        self.values["drive_pwm"] = rows[:, 4]
        zero = TENDON_COUNTS * math.tau / spec.tendons.counts_per_turn.value
        for i in range(count):
            self.values[f"tendon_{i + 1}_rad"] = rows[:, 5 + i] + zero
            self.values[f"tendon_{i + 1}_current_a"] = rows[:, 5 + count + i]
        gyro, force = rows[:, 5 + 2 * count], rows[:, 6 + 2 * count :]
        # About y and z the low-pass is left out of the mechanics, and a head that tips over is too quick for us.
        samples = SAMPLE_PERIOD * np.arange(spec.imu.average_samples)
        gyro, force, full = rows[:, 5 + 2 * count], rows[:, 6 + 2 * count :], spec.imu.accelerometer_range.value
        self.values["gyro_x_rad_s"] = np.mean(
            [np.interp(self.time - late, self.time, gyro) for late in samples], axis=0
        )
        for axis, letter in enumerate("xyz"):
            self.values[f"acceleration_{letter}_m_s2"] = np.clip(force[:, axis], -full, full)
        self._shown_late = spec.imu.residual_delay.value
        self._drive = CubicHermiteSpline(self.time, rows[:, 1], rows[:, 2]) if self.time.size > 1 else None
        self._tolerance = _tolerances(spec)

    def range(self, name: str, begin: Array, end: Array) -> tuple[Array, Array]:
        """Return the lowest and the highest value between two times [s], by row."""
        values = self.values[name]
        if name.startswith(("gyro", "acceleration")):
            begin, end = begin - self._shown_late, end - self._shown_late
        edges = np.stack([self._at(name, begin), self._at(name, end)])
        low, high = edges.min(axis=0), edges.max(axis=0)
        first, stop = np.searchsorted(self.time, begin), np.searchsorted(self.time, end, side="right")
        some = np.flatnonzero(stop > first)
        if some.size:
            places = np.stack([first[some], stop[some]], axis=1).ravel()
            padded = np.append(values, values[-1])
            low[some] = np.minimum(low[some], np.minimum.reduceat(padded, places)[::2])
            high[some] = np.maximum(high[some], np.maximum.reduceat(padded, places)[::2])
        return low, high

    def tolerance(self, name: str) -> float:
        """Return how far beside the truth a reading may be, in its own unit."""
        return self._tolerance["tendon" + name[8:] if name.startswith("tendon") else name]

    def _at(self, name: str, time: Array) -> Array:
        clipped = np.clip(time, self.time[0], self.time[-1])
        if name == "drive_rad" and self._drive is not None:
            return np.asarray(self._drive(clipped), dtype=float)
        return np.interp(clipped, self.time, self.values[name])


@dataclass(frozen=True, slots=True)
class Wrong:
    """A reading that is not true."""

    name: str
    time_s: float
    found: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.name} at {self.time_s:.4f} s is {self.found:.5g}, was {self.low:.5g} to {self.high:.5g}"


def wrong_readings(
    truth: Truth, readings: Mapping[str, Array], time_s: Array, early_s: float, late_s: float
) -> tuple[list[Wrong], dict[str, float]]:
    """Return the readings that were not true between time - early and time + late, and how near the worst came.

    readings: values by name, NaN where there is none. The second is by name, in tolerances: above 1 it is wrong.
    """
    wrong: list[Wrong] = []
    worst: dict[str, float] = {}
    for name, column in readings.items():
        came = np.flatnonzero(np.isfinite(column) & np.isfinite(time_s))
        if not came.size:
            continue
        found, at = column[came], time_s[came]
        low, high = truth.range(name, at - early_s, at + late_s)
        if name.startswith("tendon") and name.endswith("rad"):
            # A motor forgets its whole turns when it starts anew or changes its mode.
            found = found - math.tau * np.round((found - 0.5 * (low + high)) / math.tau)
        off = np.maximum(low - found, found - high) / truth.tolerance(name)
        worst[name] = max(0.0, float(off.max()))
        wrong += [
            Wrong(name, *(float(numbers[i]) for numbers in (at, found, low, high))) for i in np.flatnonzero(off > 1.0)
        ]
    return wrong, worst


def _tolerances(spec: RigSpec) -> dict[str, float]:
    imu, drive, tendons = spec.imu, spec.drive, spec.tendons
    noise = _SIGMAS * imu.gyro_noise.value / math.sqrt(imu.average_samples) + _BIASES * abs(imu.gyro_bias.value)
    gyro = noise + (imu.dead_band + 1) * imu.gyro_lsb.value + _SWING
    force = _SIGMAS * imu.accelerometer_noise.value + imu.accelerometer_lsb.value + _FORCE
    found = {
        "drive_rad": _ENCODER * math.tau / drive.counts_per_turn.value,
        "drive_current_a": _REGISTER * drive.current_lsb.value,
        "drive_pwm": _REGISTER * drive.duty_lsb.value,
        "tendon_rad": _ENCODER * math.tau / tendons.counts_per_turn.value,
        "tendon_current_a": _REGISTER * tendons.current_lsb.value,
    }
    return found | {"gyro_x_rad_s": gyro} | {f"acceleration_{axis}_m_s2": force for axis in "xyz"}
