"""This is where the doctor measures what a glance does not show: the sensor at rest, and how fast the loop can go."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sinew.bench.doctor import Finding
from sinew.hardware.errors import HardwareError, PortError
from sinew.hardware.imu import ImuReading
from sinew.hardware.rig import Rig
from sinew.hardware.transport import Clock

_PERIOD = 2.5e-3  # twice as often as there are samples, so that none is missed
_GRAVITY = 9.80665
_GRAVITY_TOLERANCE = 0.1
_UPRIGHT = math.cos(math.radians(15))
_LOWEST_RATE = 150.0
_ALL_NEW = 0.9  # of the answers; where more bring a new sample, some samples may have been missed
_LARGEST_BIAS = math.radians(1.0)
_STILL = math.radians(1.0)
_GOAL_BYTES = 9  # of each motor in the packet of goals
_FOR_PYTHON = 0.2  # of a cycle, for all that is not the bus


@dataclass(frozen=True, slots=True)
class LoopTimes:
    """How long readings of all devices took [s]: half of them, 99 of 100, and the longest; `cycles` were made.

    goals: what the packet with the goals needs on the wire besides [s]. incomplete: cycles with a missing answer.
    """

    cycles: int
    median: float
    most: float
    longest: float
    goals: float
    incomplete: int

    @property
    def rate(self) -> float:
        """Cycles that 99 of 100 times are finished in time [1/s], with a share left for all that is not the bus."""
        return (1 - _FOR_PYTHON) / (self.most + self.goals)


def listen_to_imu(rig: Rig, clock: Clock, seconds: float = 2.0) -> tuple[list[ImuReading], int]:
    """Return the different samples of the sensor over a time, and how many answers brought them.

    It is asked at 400 Hz, or as fast as the bus can; what it does not answer is left out. Raises PortError.
    """
    samples: dict[int, ImuReading] = {}
    answers = 0
    start = clock.now()
    for cycle in range(round(seconds / _PERIOD)):
        clock.wait_until(start + cycle * _PERIOD)
        if clock.now() > start + seconds:
            break
        try:
            reading = rig.imu.read()
        except PortError:
            raise
        except HardwareError:
            continue
        samples.setdefault(reading.counter, reading)
        answers += 1
    return list(samples.values()), answers


def examine_imu(rig: Rig, clock: Clock, seconds: float = 2.0) -> list[Finding]:
    """Return what is to be said about the sensor: rate, bias and noise at rest, whether x is up. Raises PortError."""
    samples, answers = listen_to_imu(rig, clock, seconds)
    return judge_imu(samples, rig.spec.wiring.imu_axes, is_whole=len(samples) < _ALL_NEW * answers)


def judge_imu(samples: Sequence[ImuReading], axes: tuple[str, ...], *, is_whole: bool = True) -> list[Finding]:
    """Return what is to be said about samples of the sensor at rest.

    axes: of the chip, as the wiring has them. is_whole: False where the sensor may have had samples that nobody asked
    for, because the bus is slow; its rate is then not judged.
    """
    if len(samples) < 3:
        found = f"{len(samples)} different samples"
        return [Finding("fault", "IMU", found, "200 each second", "it is frozen or silent: restart its board")]
    rate = _sample_rate([sample.counter for sample in samples])
    gyro = np.degrees([sample.gyro for sample in samples])
    force = np.mean([sample.acceleration for sample in samples], axis=0)
    bias, noise = gyro.mean(axis=0), gyro.std(axis=0)
    texts = ", ".join(f"{value:+.2f}" for value in bias)
    found = f"{'' if is_whole else 'at least '}{rate:.0f} samples/s, bias {texts} °/s, noise {noise.max():.2f} °/s"
    findings = [Finding("ok", "IMU", f"{found}, {_texts(force)} m/s²")]
    if is_whole and rate < _LOWEST_RATE:
        advice = "flash the node's firmware that samples at 200 Hz; the sweep's phases need it"
        findings.append(Finding("warning", "IMU", f"{rate:.0f} samples/s", f"at least {_LOWEST_RATE:.0f}", advice))
    if noise.max() > math.degrees(_STILL):
        advice = "examine it at rest; bias and gravity are not to be trusted now"
        findings.append(Finding("warning", "IMU", f"rates vary by {noise.max():.1f} °/s", "rest", advice))
    elif np.abs(bias).max() > math.degrees(_LARGEST_BIAS):
        found = f"bias of {np.abs(bias).max():.1f} °/s"
        advice = "restart its board while the head is still: it takes its zero then"
        findings.append(Finding("warning", "IMU", found, f"within {math.degrees(_LARGEST_BIAS):g} °/s", advice))
    return findings + _gravity_findings(force, axes)


def _sample_rate(counters: Sequence[int]) -> float:
    """Return the rate [1/s] at which counters [µs] were taken, of which some may be missing."""
    steps = np.array([(after - before) % 2**32 for before, after in pairwise(counters)], dtype=float)
    period = np.quantile(steps, 0.25)
    return float(1e6 * np.round(steps / period).sum() / steps.sum())


def _gravity_findings(force: np.ndarray, axes: tuple[str, ...]) -> list[Finding]:
    size = float(np.linalg.norm(force))
    if abs(size / _GRAVITY - 1) > _GRAVITY_TOLERANCE:
        advice = "is it at rest? is it the sensor that the wiring names?"
        return [Finding("fault", "IMU", f"{size:.2f} m/s² at rest", "9.81 m/s²", advice)]
    if force[0] > _UPRIGHT * size:
        return []
    place = int(np.abs(force).argmax())
    up = axes[place] if force[place] > 0 else _opposite(axes[place])
    if abs(force[place]) > _UPRIGHT * size:
        fitting = ", ".join(f'"{axis}"' for axis in _frame_from(up))
        advice = f"set the rig's wiring.imu_axes, for instance to [{fitting}]; which way round about x, a tilt shows"
    else:
        advice = "level the rig, or mount the board along its axes"
    return [Finding("fault", "IMU", f"x of the head is not up: {_texts(force)} m/s²", "+9.81, 0, 0", advice)]


def time_loop(rig: Rig, clock: Clock, seconds: float = 1.0) -> LoopTimes:
    """Return how long readings take that follow one another; no goal is written. Raises PortError."""
    times: list[float] = []
    incomplete = 0
    stop = clock.now() + seconds
    while (begun := clock.now()) < stop or len(times) < 2:
        reading = rig.read()
        times.append(clock.now() - begun)
        incomplete += bool(reading.faults or reading.stale)
    median, most = np.quantile(times, (0.5, 0.99))
    goals = (10 + _GOAL_BYTES * len(rig.motors)) * 10 / rig.bus.timing.baud
    return LoopTimes(len(times), float(median), float(most), max(times), goals, incomplete)


def examine_loop(times: LoopTimes, wanted_hz: float) -> list[Finding]:
    """Return what is to be said about the speed of the loop. wanted_hz: cycles a plan asks for [1/s]."""
    found = (
        f"readings take {1e3 * times.median:.2f} ms (median), {1e3 * times.most:.2f} ms (99 of 100), "
        f"{1e3 * times.longest:.2f} ms (longest of {times.cycles}); with goals good for {times.rate:.0f} Hz"
    )
    if times.rate >= wanted_hz:
        return [Finding("ok", "loop", found)]
    advice = "return delay 0, latency timer 1 ms, a higher baud, fewer programs on the computer; or a lower sample_hz"
    return [Finding("warning", "loop", found, f"{wanted_hz:g} Hz", advice)]


def examine_bus(rig: Rig, times: LoopTimes | None) -> list[Finding]:
    """Return what is to be said about errors on the bus since it was opened."""
    counts = rig.bus.statistics
    errors = {
        "silent": counts.silent,
        "damaged": counts.damaged,
        "of a wrong length": counts.wrong_length,
        "with a wrong CRC": counts.crc_errors,
        "nobody asked for": counts.strays,
        "of an earlier time": rig.stale.total(),
    }
    told = ", ".join(f"{count} {what}" for what, count in errors.items() if count)
    shown = f"{counts.answers} answers to {counts.transactions} instructions"
    if times is not None and times.incomplete:
        shown += f"; {times.incomplete} of {times.cycles} readings incomplete"
    if not told:
        return [Finding("ok", "bus", f"{shown}, none lost or damaged")]
    advice = "check plugs, ground and length of the cables; a silent device explains silence"
    return [Finding("warning", "bus", f"{shown}: {told}", "no errors", advice)]


def _texts(vector: Sequence[float] | np.ndarray) -> str:
    return ", ".join(f"{value:+.2f}" for value in vector)


def _opposite(axis: str) -> str:
    return ("-" if axis[0] == "+" else "+") + axis[1]


def _frame_from(up: str) -> tuple[str, str, str]:
    """Return a right-handed frame of signed axes that begins with this one."""
    letters = "xyz"
    place = letters.index(up[1])
    return up, "+" + letters[(place + 1) % 3], up[0] + letters[(place + 2) % 3]
