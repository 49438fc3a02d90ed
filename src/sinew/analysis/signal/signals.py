"""Signals of a recording: channels, the sensors' delays, segments and motors, read once at the door and passed on."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from sinew.measure.arrays import Array, Mask
from sinew.measure.attitude import gyro_share
from sinew.measure.errors import RecordingError, TimeError
from sinew.measure.recording import SAMPLE_VARIABLES, Excitation, Segment, SegmentKind, iterate_segments
from sinew.measure.validation import as_dataset
from sinew.plan.rig import NODE_HZ, RigSpec

# The delay budget: what the sensors' chain does to torsion and drive before they are recorded.

_REPEATS = 1e-3


@dataclass(frozen=True)
class DelayBudget:
    """The written delay budget of a rig; the default is a perfect sensor.

    sample_hz: rate of the samples [Hz].
    low_pass_hz: corner of the gyroscope's second-order Butterworth low-pass [Hz]; inf where there is none.
    residual_delay_s: pure delay beyond that filter's [s].
    average_samples: a reading is the mean of the newest so many samples at sample_hz.
    drive_delay_s: pure delay of the recorded drive angle against the stamp [s].
    delay_std_s: standard uncertainty of the delay between torsion and drive [s].
    drive_lsb_rad: step of the drive's encoder [rad].
    """

    sample_hz: float
    low_pass_hz: float = math.inf
    residual_delay_s: float = 0.0
    average_samples: int = 1
    drive_delay_s: float = 0.0
    delay_std_s: float = 0.0
    drive_lsb_rad: float = 0.0


def _rate(time_s: Array, row_size: NDArray[np.int64]) -> float:
    steps = np.diff(time_s)
    inside = np.ones(steps.size, dtype=bool)
    inside[np.cumsum(row_size)[:-1] - 1] = False
    if not inside.any():
        raise TimeError("no segment holds two samples, so there is no sample rate; record longer segments")
    return float(1.0 / np.median(steps[inside]))


def _budget(rate: float, rig: RigSpec | None) -> DelayBudget:
    if rig is None:
        return DelayBudget(rate)
    return DelayBudget(
        rate,
        rig.imu.low_pass.value,
        rig.imu.residual_delay.value,
        rig.imu.average_samples,
        rig.bus.drive_delay.value,
        rig.imu.delay_std.value,
        2.0 * math.pi / rig.drive.counts_per_turn.value,
    )


def sensor_budget(rig: RigSpec) -> DelayBudget:
    """Return the delays of a rig's sensor at its own rate."""
    imu = rig.imu
    return DelayBudget(NODE_HZ, imu.low_pass.value, imu.residual_delay.value, imu.average_samples)


def torsion_chain(budget: DelayBudget, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
    """Return the complex factor by which the chain multiplies a torsion exp(jωt), any shape.

    Butterworth low-pass ωc²/(s² + √2 ωc s + ωc²), residual delay exp(-jωτ), and the causal moving average
    (1/m) Σ exp(-jωi/fs) over i = 0..m-1. Divide a measured harmonic by it to get the true one.
    """
    frequency = np.asarray(frequency_hz, dtype=float)
    ratio = frequency / budget.low_pass_hz
    low_pass = 1.0 / (1.0 - ratio**2 + 1j * math.sqrt(2.0) * ratio)
    step = np.exp(-2j * np.pi * frequency / budget.sample_hz)
    average = np.stack([step**i for i in range(budget.average_samples)]).mean(axis=0)
    return np.asarray(low_pass * average * np.exp(-2j * np.pi * frequency * budget.residual_delay_s), dtype=complex)


def drive_chain(budget: DelayBudget, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
    """Return the complex factor between the true drive angle and the recorded one, exp(-jωτ), any shape."""
    omega = 2.0 * np.pi * np.asarray(frequency_hz, dtype=float)
    chain: NDArray[np.complex128] = np.exp(-1j * omega * budget.drive_delay_s)
    return chain


def torsion_delay(budget: DelayBudget, frequency_hz: float) -> float:
    """Return the phase delay of the recorded torsion at one frequency [s], positive; 10-11 ms for an MPU9250."""
    if frequency_hz <= 0:
        raise ValueError(f"a phase delay needs a positive frequency, found {frequency_hz:g} Hz")
    grid = np.linspace(0.0, frequency_hz, 65)
    phase = np.unwrap(np.angle(torsion_chain(budget, grid)))
    return float(-phase[-1] / (2.0 * np.pi * frequency_hz))


def hidden_quantisation(budget: DelayBudget, frequency_hz: NDArray[np.float64], samples: int) -> NDArray[np.float64]:
    """Return the standard deviation that the encoder's step gives the drive's fundamental unseen [rad], shape (s,).

    frequency_hz: shape (s,), of records of so many samples. Where the sample rate is a ratio of small whole numbers to
    the frequency, a record holds only m < n distinct phases: its rounding errors repeat, hence are harmonics of the
    drive, and the residual knows nothing of them. They are lsb/√12 times √(2/m), m halved where it is even since
    rounding treats both half waves alike. Zero where no phase comes twice, for then the residual holds them.
    """
    different, which = np.unique(frequency_hz, return_inverse=True)
    turns = different[:, None] / budget.sample_hz * np.arange(1, samples)
    same = np.abs(turns - np.rint(turns)) * samples / np.arange(1, samples) < _REPEATS
    distinct = np.argmax(same, axis=1) + 1
    distinct = np.where(distinct % 2 == 0, distinct // 2, distinct)
    return np.where(same.any(axis=1), budget.drive_lsb_rad * np.sqrt(2.0 / (12.0 * distinct)), 0.0)[which]


@dataclass(frozen=True)
class Channel:
    """One signal of a recording: values of shape (sample,), their unit, and whether they are the torsion's rate."""

    values: Array
    unit: str
    is_rate: bool = False


class RestPose(NamedTuple):
    """The pose that was asked for: bend and azimuth [rad], zero of an upright head; see `sinew.plan.plan`."""

    bend: float
    azimuth: float


@dataclass(frozen=True)
class Signals:
    """What a recording says, read once.

    time_s: stamps [s], (n,). segments: all, each with its samples. response: what tells the torsion, of a bent head
    with what the gyroscope under-reads made good. drive: as it was measured, an angle or not; None where it was not.
    rig: whose sensors these were, None for perfect ones. recorded: every variable over samples by its name in the
    schema. attrs: provenance. pose: of a head that bends or sways; None of one that only turns. row_size: samples
    of every segment of the recording, of those too that `moved_by` leaves out.
    """

    time_s: Array
    segments: list[tuple[Segment, slice]]
    response: Channel
    drive: Channel | None
    rig: RigSpec | None
    recorded: Mapping[str, NDArray[Any]]
    attrs: Mapping[Any, Any]
    pose: RestPose | None
    row_size: NDArray[np.int64]

    @cached_property
    def budget(self) -> DelayBudget:
        """Return what the sensors did to torsion and drive; sought when it is first asked for.

        Raises TimeError where no segment holds two samples.
        """
        return _budget(_rate(self.time_s, self.row_size), self.rig if "gyro_rad_s" in self.recorded else None)

    def moved_by(self, *excitations: Excitation) -> "Signals":
        """Return the same with the segments alone in which one of these moves the head."""
        return replace(self, segments=[row for row in self.segments if row[0].excitation in excitations])

    def of_kind(self, kind: SegmentKind) -> Iterator[tuple[Segment, slice]]:
        """Yield the segments of one kind."""
        return ((segment, where) for segment, where in self.segments if segment.kind == kind)


def read_signals(recording: xr.Dataset | Signals, rig: RigSpec | None = None) -> Signals:
    """Return the signals of a recording; those that were read already are passed through.

    rig: whose sensors' delays count; None for perfect sensors.
    Raises RecordingError where nothing tells the torsion or the segments are in several poses.
    """
    if isinstance(recording, Signals):
        return recording
    as_dataset(recording, "recording")
    segments = [(segment, where) for _, segment, where in iterate_segments(recording)]
    pose = _pose_of([segment for segment, _ in segments])
    return Signals(
        recording["time_s"].values,
        segments,
        response_channel(recording),
        drive_channel(recording),
        rig,
        {name: recording[name].values for name in SAMPLE_VARIABLES if name in recording},
        recording.attrs,
        pose,
        recording["row_size"].values,
    )


def by_length(stretches: Sequence[slice]) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Yield which stretches have one length, (s,), with the numbers of their samples, (s, n), the longest first.

    What is made of one length then finds room in the memory that the length before has left.
    """
    starts = np.array([one.start for one in stretches], dtype=np.int64)
    sizes = np.array([one.stop for one in stretches], dtype=np.int64) - starts
    for size in np.unique(sizes)[::-1]:
        rows = np.flatnonzero(sizes == size)
        yield rows, starts[rows, None] + np.arange(size)


def _pose_of(segments: list[Segment]) -> RestPose | None:
    """Return the one pose of all segments; None where none is bent or moved by anything but the lever."""
    if not any(segment.is_spatial for segment in segments):
        return None
    poses = sorted({(segment.bend_deg, segment.azimuth_deg) for segment in segments})
    if len(poses) > 1:
        sentence = ", ".join(f"{bend:g}° towards {azimuth:g}°" for bend, azimuth in poses)
        raise RecordingError(
            f"the segments are in {len(poses)} poses ({sentence}), expected one; analyse each by itself"
        )
    return RestPose(*map(math.radians, poses[0]))


def response_channel(recording: xr.Dataset) -> Channel:
    """Return the channel that tells the torsion: the gyroscope's x axis, else an angle, else any response.

    A response in rad/s counts as the torsion's rate. Of a bent head what the gyroscope under-reads is made good.
    Raises RecordingError where there is none of the three.
    """
    if "gyro_rad_s" in recording:
        rate = np.ascontiguousarray(recording["gyro_rad_s"].values[:, 0], dtype=float)
        bend = math.radians(float(recording["bend_deg"].values[0])) if "bend_deg" in recording else 0.0
        return Channel(rate if bend == 0.0 else rate / gyro_share(bend), "rad/s", True)
    for name in ("torsion_rad", "response"):
        if name in recording:
            unit = str(recording[name].attrs["units"])
            return Channel(np.asarray(recording[name].values, dtype=float), unit, unit == "rad/s")
    raise RecordingError("recording has no response; expected gyro_rad_s, torsion_rad or response")


def drive_channel(recording: xr.Dataset) -> Channel | None:
    """Return the measured drive, an angle or not, or None where it was not recorded."""
    for name in ("drive_rad", "drive"):
        if name in recording:
            return Channel(np.asarray(recording[name].values, dtype=float), str(recording[name].attrs["units"]))
    return None


# ---- a sensor at the end of its range: rows of one value where the signal goes on


_FEWEST = 3  # samples of one value
_NEAR, _BESIDE = 2.5, 0.3  # steps; share of the samples so near to the limit beside a crest that is not cut off


def resolution(values: Array) -> float:
    """Return the smallest step between different values, the range where there is none."""
    steps = np.diff(np.unique(values))
    return float(steps[steps > 1e-9 * np.ptp(values)].min(initial=np.ptp(values)))


def rows_of_one_value(values: Array) -> list[tuple[int, int]]:
    """Return (first, stop) of all rows of at least three equal samples."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(values) != 0) + 1, [values.size]])
    long = np.flatnonzero(np.diff(edges) >= _FEWEST)
    return [(int(edges[k]), int(edges[k + 1])) for k in long]


def is_cut_off(values: Array, first: int, stop: int, step: float, ends: tuple[float, float]) -> bool:
    """Return whether a row of equal samples is a crest that a limit of the range cut off.

    step: of the values, from `resolution`. ends: their smallest and largest. The rounded crest of a sine has three
    tenths of its samples, or more, within two and a half steps beside its top.
    """
    if first == 0 or stop == values.size:
        return False
    top = values[first]
    side = 1.0 if top > values[first - 1] else -1.0
    if top not in ends or side * (top - values[stop]) <= 0:
        return False
    reach = stop - first
    around = np.concatenate([values[max(0, first - reach) : first], values[stop : stop + reach]])
    return bool(np.count_nonzero(side * (top - around) < _NEAR * step) < _BESIDE * reach)


def overloads(values: Array) -> Mask:
    """Return which samples belong to crests that a limit of the range cut off, (n,)."""
    found = np.zeros(values.size, dtype=bool)
    step, ends = resolution(values), (float(values.min()), float(values.max()))
    for first, stop in rows_of_one_value(values):
        found[first:stop] = is_cut_off(values, first, stop, step, ends)
    return found
