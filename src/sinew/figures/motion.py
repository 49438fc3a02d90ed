"""A stretch of a recording as a picture shows it: drive, torsion and torsion rate over time."""

import functools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import xarray as xr

from sinew.analysis.signal.signals import delay_budget, drive_channel, response_channel, torsion_delay
from sinew.analysis.signal.torsion import integrate_rate, steady_motion
from sinew.analysis.sweep.portrait import Ellipse, fit_ellipse
from sinew.measure.arrays import Array
from sinew.measure.recording import Segment, iterate_segments
from sinew.measure.schema import SegmentKind
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_rig

# Figures read the rig that a dataset was made with.


def rig_of(dataset: xr.Dataset) -> RigSpec | None:
    """Return the rig in the attributes of a recording or of results, None where there is none.

    Raises SpecError where there is one and it is not valid.
    """
    text = str(dataset.attrs.get("rig", ""))
    return _parsed(text) if text.strip() else None


@functools.lru_cache(maxsize=4)
def _parsed(text: str) -> RigSpec:
    return parse_rig(text)


@dataclass(frozen=True)
class Group:
    """One group of a recording: what was asked for, its place, its samples, and those of the settle before it."""

    segment: Segment
    index: int
    record: slice
    settle: slice | None


@dataclass(frozen=True)
class Motion:
    """What a picture shows of a stretch of samples.

    time_s: (n,) from the start of the record [s], negative before it.
    torsion, rate: (n,) in `unit` and per second; degrees where the response is an angle.
    drive: (n,) in degrees or its own unit, None where none was recorded.
    is_integral: the torsion was integrated from its rate, so that its rest position means nothing.
    """

    time_s: Array
    torsion: Array
    rate: Array
    drive: Array | None
    unit: str
    is_integral: bool = False

    @property
    def label(self) -> str:
        """Return the axis label of the torsion, or of a response that is not an angle."""
        return "torsion φ in degrees" if self.unit == "degrees" else f"response in {self.unit}"


def groups_of(recording: xr.Dataset, kind: SegmentKind) -> list[Group]:
    """Return the groups of one kind (steady, ring-down or idle), in the order in which they were recorded."""
    groups = []
    before: tuple[str, slice] | None = None
    for index, segment, where in iterate_segments(recording):
        if segment.kind == kind:
            settle = before[1] if before is not None and before[0] == "settle" else None
            groups.append(Group(segment, index, where, settle))
        before = (segment.kind, where)
    return groups


def nearest(groups: Iterable[Group], pretension_mm: float, frequency_hz: float | None = None) -> Group | None:
    """Return the group closest in pretension, then in frequency where one is given, then of the first repeat."""

    def distance(group: Group) -> tuple[float, float, int]:
        s = group.segment
        off = abs(s.frequency_hz - frequency_hz) if frequency_hz is not None else 0.0
        return (abs(s.pretension_mm - pretension_mm), off, s.repeat)

    return min(groups, key=distance, default=None)


def motion_of(recording: xr.Dataset, group: Group) -> Motion:
    """Return the motion over the whole periods of a steady group, on one true time: the delay budget is undone.

    Raises RecordingError where the group holds no whole period.
    """
    motion = _steady(recording, group)
    factor, unit = _in_degrees(str(motion["torsion"].attrs["units"]))
    drive = None
    if "drive" in motion:
        drive = motion["drive"].values * _in_degrees(str(motion["drive"].attrs["units"]))[0]
    time = motion["time_s"].values - recording["time_s"].values[group.record.start]
    return Motion(time, factor * motion["torsion"].values, factor * motion["rate"].values, drive, unit)


def _steady(recording: xr.Dataset, group: Group) -> xr.Dataset:
    return steady_motion(recording.isel(sample=group.record, segment=[group.index]), 0, rig_of(recording))


def ellipse_of(recording: xr.Dataset, group: Group) -> Ellipse:
    """Return the Lissajous ellipse of a steady group, in the units of `motion_of`.

    Raises RecordingError where the group holds no whole period or no drive was recorded.
    """
    motion = _steady(recording, group)
    ellipse = fit_ellipse(motion)
    drive, torsion = (_in_degrees(str(motion[name].attrs["units"]))[0] for name in ("drive", "torsion"))
    return Ellipse(
        drive * ellipse.drive_amplitude,
        torsion * ellipse.torsion_amplitude,
        ellipse.lag_rad,
        drive * torsion * ellipse.area,
    )


def at_pretension(recording: xr.Dataset, pretension_mm: float) -> str:
    """Return the end of a title that names the pretension, empty for a foreign recording, which has none."""
    return "" if recording.attrs.get("source") == "import" else f" at a pretension of {pretension_mm:g} mm"


def drive_of(recording: xr.Dataset, where: slice, origin_s: float) -> tuple[Array, Array, Array | None]:
    """Return time from an origin [s], measured drive [deg] and commanded drive [deg], None where not recorded."""
    time = recording["time_s"].values[where] - origin_s
    command = None
    if "drive_command_rad" in recording:
        command = np.rad2deg(recording["drive_command_rad"].values[where])
    return time, np.rad2deg(recording["drive_rad"].values[where]), command


def released_motion(recording: xr.Dataset, group: Group, *, with_settle: bool = False) -> Motion:
    """Return the motion in the record of a ring-down, with the drive's last seconds before it on request.

    A rate is integrated after its reading at rest (idle record of the same pretension, where there is one) was taken
    off; the torsion is put earlier by the delay budget's delay at the drive frequency.
    """
    start = group.settle.start if with_settle and group.settle is not None else group.record.start
    alone = recording.isel(sample=slice(start, group.record.stop), segment=[group.index])
    time = alone["time_s"].values - recording["time_s"].values[group.record.start]
    channel, drive = response_channel(alone), drive_channel(alone)
    factor, unit = _in_degrees("rad" if channel.is_rate else channel.unit)
    rate, torsion = channel.values, channel.values
    if channel.is_rate:
        rate = rate - _reading_at_rest(recording, group)
        torsion = integrate_rate(time, rate)
        # Shifted samples keep their stamps: the value that was true at t was read at t + delay.
        late = _delay(recording, group)
        torsion, rate = (np.interp(time + late, time, values) for values in (torsion, rate))
    else:
        rate = np.gradient(torsion, time)
    driven = None if drive is None else drive.values * _in_degrees(drive.unit)[0]
    return Motion(time, factor * torsion, factor * rate, driven, unit, channel.is_rate)


def _in_degrees(unit: str) -> tuple[float, str]:
    return (180.0 / np.pi, "degrees") if unit == "rad" else (1.0, unit)


def _reading_at_rest(recording: xr.Dataset, group: Group) -> float:
    idle = nearest(groups_of(recording, "idle"), group.segment.pretension_mm)
    if idle is None or idle.segment.pretension_mm != group.segment.pretension_mm:
        return 0.0
    return float(recording["gyro_rad_s"].values[idle.record, 0].mean())


def _delay(recording: xr.Dataset, group: Group) -> float:
    """Return the delay of the recorded torsion against the recorded drive [s]."""
    rig = rig_of(recording)
    if rig is None or not np.isfinite(group.segment.frequency_hz):
        return 0.0
    record = recording.isel(sample=group.record, segment=[group.index])
    budget = delay_budget(record, rig)
    return torsion_delay(budget, group.segment.frequency_hz) - budget.drive_delay_s
