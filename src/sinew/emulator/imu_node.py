"""The emulated sensors: the head's, an OpenCR board with Sinew's firmware, and those with a node of their own.

The head's gyroscope is read at its node's own rate, by its own crystal; a reading is the mean over the newest samples
behind the chip's low-pass, with bias and noise, clipped, in whole LSB, and zero within the dead band. Noise is white
at the node's rate, and drawn before the mean, as it is in the twin, there coloured by the chip's low-pass. A reading
appears `residual_delay` after the moment it belongs to, with the time of its appearance. Roll and pitch are those of
the accelerometer alone; yaw stays 0. What the board answers on the line is what `firmware/` answers
(tests/firmware holds both to one contract); its readings are averaged as those of the stock firmware. It tells the
delay of the rig's filter, and is that of the known chips whose own is nearest.
"""

import math
import struct
from collections import deque
from collections.abc import Iterator
from typing import cast

import numpy as np

from sinew.emulator.device import Board, ControlTable, RegisterSet
from sinew.emulator.plant import Mechanics
from sinew.hardware.registers import (
    BAUD_RATES,
    EMULATED_FIRMWARE,
    FILTER_DELAYS_US,
    OPENCR_NODE,
    sensor_table,
)
from sinew.plan.rig import NODE_HZ, BusSensor, Imu

SAMPLE_PERIOD = 1 / NODE_HZ
"""Time between two samples, by the node's own clock [s]."""

_READINGS = struct.Struct("<9h")
_DRAWN_AT_ONCE = 512  # samples' noise; drawing it one by one would take most of the node's time

Vector = tuple[float, float, float]


class ImuNode(RegisterSet, Board):
    """The sensor.

    spec: range, noise and bias of the chip. axes: the chip's axes that point along x, y and z of the head.
    ppm: how much faster than the host's its crystal is [1e-6]; None: drawn, standard deviation 20.
    due: when the next sample is to be taken [s].
    frozen: as a fault, the readings and their time stand still, while the clock goes on. loses: as a fault, the share
    of the samples that the board does not read, evenly; it counts them.
    """

    def __init__(
        self,
        spec: Imu,
        mechanics: Mechanics,
        rng: np.random.Generator,
        *,
        device_id: int = 200,
        baud: int = 1_000_000,
        axes: tuple[str, str, str] = ("+x", "+y", "+z"),
        ppm: float | None = None,
        firmware: int = EMULATED_FIRMWARE,
    ) -> None:
        super().__init__(ControlTable(OPENCR_NODE), firmware, device_id, baud)
        self._spec, self._mechanics, self._rng = spec, mechanics, rng
        self.frozen = False
        self.loses = self._owed = 0.0
        self._rate = 1 + 1e-6 * (float(rng.normal(0, 20)) if ppm is None else ppm)
        self._phase = float(rng.uniform(0, 0.5))
        self._count = int(self._phase / SAMPLE_PERIOD) + 1
        self.due = self._time_of_sample()
        self._bias = spec.gyro_bias.value * rng.standard_normal(3)
        self._noise: Iterator[list[float]] = iter(())
        self._newest: deque[Vector] = deque(maxlen=spec.average_samples)
        self._waiting: tuple[float, bytes] | None = None
        # Index of the head's axis that each axis of the chip lies along, and its sign.
        places = {axis[1]: (head, 1 if axis[0] == "+" else -1) for head, axis in enumerate(axes)}
        self._chip = tuple(places[letter] for letter in "xyz")
        self._readings_start = OPENCR_NODE["gyro_x"].address
        self.registers["id"], self.registers["baud_rate"] = device_id, BAUD_RATES.index(baud)
        self._begin()

    @property
    def knows_fast_reads(self) -> bool:
        return True

    def restart(self, now: float) -> None:
        super().restart(now)
        self._begin()

    def _begin(self) -> None:
        """Tell what the board is and how it samples, and have taken nothing yet."""
        registers = self.registers
        registers["firmware_version"] = self.firmware
        delay = round(1e6 * self._spec.filter_delay)
        registers["filter_delay"] = min(delay, 0xFFFF)
        registers["who_am_i"] = min(FILTER_DELAYS_US, key=lambda chip: abs(FILTER_DELAYS_US[chip] - delay))
        registers["sample_period"] = round(SAMPLE_PERIOD * 1e6)

    def clock(self, now: float) -> float:
        """Return the time by the node's own clock [s]."""
        return now * self._rate + self._phase

    def set_power(self, on: bool, now: float) -> None:
        if on and not self.is_powered:
            self._newest.clear()
            self._waiting = None
        super().set_power(on, now)

    def advance(self, now: float) -> None:
        """Take a sample, if one is due."""
        if now < self.due:
            return
        self._publish(now)
        self._count += 1
        self.due = self._time_of_sample()
        if self.frozen or not self.is_powered:
            return
        self._owed += self.loses
        if self._owed >= 1.0:
            self._owed -= 1.0
            self.registers["lost_samples"] = (self.registers["lost_samples"] + 1) & 0xFFFF_FFFF
            return
        motion, spec = self._mechanics.motion(), self._spec
        noise = self._next_noise()
        limit = spec.gyro_range.value
        rates = (max(-limit, min(limit, rate + extra)) for rate, extra in zip(motion.gyro, noise[:3], strict=True))
        self._newest.append(cast(Vector, tuple(rates)))
        size = len(self._newest)
        gyro = [self._gyro_counts(sum(sample[axis] for sample in self._newest) / size) for axis in range(3)]
        force = [value + extra for value, extra in zip(motion.acceleration, noise[3:], strict=True)]
        x, y, z = (self._chip_axis(force, axis) for axis in range(3))
        readings = _READINGS.pack(
            *(round(self._chip_axis(gyro, axis)) for axis in range(3)),
            *(self._acceleration_counts(value) for value in (x, y, z)),
            round(math.degrees(math.atan2(y, z)) * 10),
            round(math.degrees(math.atan2(-x, math.hypot(y, z))) * 10),
            0,
        )
        self._waiting = now + spec.residual_delay.value, readings

    def refresh(self, address: int, length: int, now: float) -> None:
        self._publish(now)
        self.registers["clock"] = self._microseconds(now)

    def _time_of_sample(self) -> float:
        return (self._count * SAMPLE_PERIOD - self._phase) / self._rate

    def _publish(self, now: float) -> None:
        """Show the sample taken, if it is time."""
        if self.frozen:
            self._waiting = None
        if self._waiting is not None and now >= self._waiting[0]:
            when, readings = self._waiting
            start = self._readings_start
            self.registers.memory[start : start + len(readings)] = readings
            self.registers["sample_time"] = self._microseconds(when)
            self.registers["samples"] = (self.registers["samples"] + 1) & 0xFFFF_FFFF
            self._waiting = None

    def _microseconds(self, now: float) -> int:
        return int(self.clock(now) * 1e6) & 0xFFFF_FFFF

    def _gyro_counts(self, rate: float) -> float:
        counts = round(rate / self._spec.gyro_lsb.value)
        return 0.0 if abs(counts) <= self._spec.dead_band else max(-32_768.0, min(32_767.0, float(counts)))

    def _acceleration_counts(self, force: float) -> int:
        spec = self._spec
        limit = min(spec.accelerometer_range.value / spec.accelerometer_lsb.value, 32_767)
        return round(max(-limit, min(limit, force / spec.accelerometer_lsb.value)))

    def _chip_axis(self, head: list[float], axis: int) -> float:
        """Return what an axis of the chip sees of a vector in the head's frame."""
        along, sign = self._chip[axis]
        return sign * head[along]

    def _next_noise(self) -> list[float]:
        """Return bias and noise of the gyroscope's axes [rad/s] and noise of the accelerometer's [m/s²]."""
        values = next(self._noise, None)
        if values is None:
            drawn = self._rng.standard_normal((_DRAWN_AT_ONCE, 6))
            drawn[:, :3] = self._bias + self._spec.gyro_noise.value * drawn[:, :3]
            drawn[:, 3:] *= self._spec.accelerometer_noise.value
            self._noise = iter(drawn.tolist())
            values = next(self._noise)
        return values


class SensorBoard(Board):
    """A sensor with a node of its own, which takes its value as it is asked for it."""

    def __init__(self, spec: BusSensor, mechanics: Mechanics, rng: np.random.Generator, baud: int) -> None:
        super().__init__(ControlTable(sensor_table(spec)), EMULATED_FIRMWARE, spec.id, baud)
        self._spec, self._mechanics, self._rng = spec, mechanics, rng

    def refresh(self, address: int, length: int, now: float) -> None:
        spec = self._spec
        told = spec.told(np.asarray(self._mechanics.motion().tension), self._rng)
        self.registers[spec.channel] = round(float(told) / spec.lsb)
