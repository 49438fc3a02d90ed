"""Signals of a recording: channels, delays, segments and motors, read once at the door and passed on."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sinew.analysis.signal.sensor import DelayBudget, delay_budget
from sinew.measure.arrays import Array
from sinew.measure.doors import as_dataset
from sinew.measure.errors import RecordingError
from sinew.measure.recording import Segment, iterate_segments
from sinew.measure.schema import SAMPLE_VARIABLES, SegmentKind
from sinew.plan.rig import RigSpec


@dataclass(frozen=True)
class Channel:
    """One signal of a recording: values of shape (sample,), their unit, and whether they are the torsion's rate."""

    values: Array
    unit: str
    is_rate: bool = False


@dataclass(frozen=True)
class Signals:
    """What a recording says, read once.

    time_s: stamps [s], (n,). segments: all, each with its samples. response: what tells the torsion. drive: as it was
    measured, an angle or not; None where it was not. rig: whose sensors these were, None for perfect ones. budget: what
    they did to torsion and drive. recorded: every variable over samples by its name in the schema. attrs: provenance.
    """

    time_s: Array
    segments: list[tuple[Segment, slice]]
    response: Channel
    drive: Channel | None
    rig: RigSpec | None
    budget: DelayBudget
    recorded: Mapping[str, NDArray[Any]]
    attrs: Mapping[Any, Any]

    def of_kind(self, kind: SegmentKind) -> Iterator[tuple[Segment, slice]]:
        """Yield the segments of one kind."""
        return ((segment, where) for segment, where in self.segments if segment.kind == kind)


def read_signals(recording: xr.Dataset, rig: RigSpec | None = None) -> Signals:
    """Return the signals of a recording.

    rig: whose sensors' delays count; None for perfect sensors.
    Raises RecordingError where nothing tells the torsion, TimeError where no segment holds two samples.
    """
    as_dataset(recording, "recording")
    return Signals(
        recording["time_s"].values,
        [(segment, where) for _, segment, where in iterate_segments(recording)],
        response_channel(recording),
        drive_channel(recording),
        rig,
        delay_budget(recording, rig),
        {name: recording[name].values for name in SAMPLE_VARIABLES if name in recording},
        recording.attrs,
    )


def response_channel(recording: xr.Dataset) -> Channel:
    """Return the channel that tells the torsion: the gyroscope's x axis, else an angle, else any response.

    A response in rad/s counts as the torsion's rate.
    Raises RecordingError where there is none of the three.
    """
    if "gyro_rad_s" in recording:
        return Channel(np.ascontiguousarray(recording["gyro_rad_s"].values[:, 0], dtype=float), "rad/s", True)
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
