"""From journal to recording: whole groups, in the plan's order, on one time axis."""

import json
import math
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sinew.bench.record.journal import JournalReader, Stretch
from sinew.bench.record.sample import Sample
from sinew.measure.arrays import Array, robust_std
from sinew.measure.errors import RecordingError
from sinew.measure.events import Hole, Pretensioned
from sinew.measure.files.netcdf import provenance, save_recording
from sinew.measure.recording import LIMITS_ATTRIBUTE, REGISTERS_ATTRIBUTE, SPATIAL_SEGMENTS, Segment, build_recording
from sinew.plan.plan import Group
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_plan, parse_rig

# The IMU's samples get the times at which they were taken, and are brought onto the rows of a recording.
#
# The node samples by its own crystal. The host knows when by asking, which jitters; but between two clocks nothing
# except offset and drift is true over some seconds. So the host's times are replaced by the straight line through
# them over the node's own time, and readings are taken between samples by cubics: straight lines would lose 0.2 % at
# 4 Hz.


MOST_PERIODS = 2.5
"""Between samples further apart than so many periods of the node there are no readings."""

_COUNTER_WRAP_S = 2**32 * 1e-6
_ASTRAY = 0.3  # of a period: from there on it is not sure which of the node's samples it was
_FEWEST = 4


@dataclass(frozen=True)
class ImuSeries:
    """Samples of the node.

    time_s: host times at which they were taken [s], increasing, shape (k,). values: shape (k, columns).
    period_s: of the node by the host's clock [s]. jitter_s: median distance of the host's times from their line [s].
    """

    time_s: Array
    values: Array
    period_s: float
    jitter_s: float


def imu_series(imu_time_s: Array, values: Array, counter_s: Array | None = None) -> ImuSeries:
    """Return the node's own samples out of cycles that read its newest one, some seconds of them.

    imu_time_s: host's time of the sample read in each cycle [s], shape (n,), NaN where none came; the same sample may
    come several times. values: what was read, shape (n, columns). counter_s: the node's own time [s], wrapping at
    2³² µs, shape (n,); None, or NaN anywhere, leaves the order of samples, which must then be evenly spaced and not
    asked for much less often than they are taken.
    """
    came = np.isfinite(imu_time_s)
    host, values = imu_time_s[came], values[came]
    if host.size < _FEWEST:
        return ImuSeries(np.empty(0), np.empty((0, values.shape[1])), float("nan"), float("nan"))
    if counter_s is not None and np.isfinite(counter_s[came]).all():
        own = np.unwrap(counter_s[came], period=_COUNTER_WRAP_S)
        own = own - own[0]
        steps = np.diff(own)
        period = float(np.median(steps[steps > 0])) if (steps > 0).any() else float("nan")
    else:
        own, period = _by_order(host)
    offset, slope = _line(own, host)
    off = host - (offset + slope * own)
    sure = np.abs(off) < _ASTRAY * period * slope
    own, first = np.unique(own[sure], return_index=True)
    return ImuSeries(offset + slope * own, values[sure][first], period * slope, float(np.median(np.abs(off))))


def _by_order(host: Array) -> tuple[Array, float]:
    """Return (times by the node's clock [s], its period by the host's clock [s]) of samples counted by their times."""
    steps = np.diff(host)
    period = float(np.median(steps[steps > 0.5 * np.median(steps)]))
    number = np.concatenate([[0.0], np.cumsum(np.rint(steps / period))])
    for _ in range(3):
        offset, slope = _line(number, host)
        period, number = slope, np.rint((host - offset) / slope)
    return number * period, period


def _line(x: Array, y: Array) -> tuple[float, float]:
    """Return (offset, slope) of the straight line through most of the points: least squares, then Tukey's weights."""
    weight = np.ones(x.size)
    offset, slope = 0.0, 1.0
    for step in range(20):
        mean_x, mean_y = np.average(x, weights=weight), np.average(y, weights=weight)
        dx = x - mean_x
        slope = float((weight * dx * y).sum() / max((weight * dx * dx).sum(), 1e-300))
        offset = float(mean_y - slope * mean_x)
        off = np.abs(y - offset - slope * x)
        scale = robust_std(off) + 1e-9
        # Absolute values first, which no outlier can lead astray.
        weight = scale / np.maximum(off, scale) if step < 8 else np.clip(1 - (off / (4.685 * scale)) ** 2, 0, None) ** 2
    return offset, slope


def readings_at(series: ImuSeries, time_s: Array) -> Array:
    """Return the readings at other times, shape (n, columns): the cubic through the four samples around each.

    Beside a gap or an end the cubic leans to one side. NaN outside the samples, and between two that are more than
    `MOST_PERIODS` apart. Error of a sine: (ωT)⁴·3/128, at 4.3 Hz and 200 Hz 8e-6 of its amplitude.
    """
    found = np.full((time_s.size, series.values.shape[1]), np.nan)
    if series.time_s.size < _FEWEST:
        return found
    near = np.concatenate([np.diff(series.time_s) <= MOST_PERIODS * series.period_s, [False, False, False]])
    three = near[:-2] & near[1:-1] & near[2:]  # three[i]: samples i..i+3 follow one another
    interval = np.searchsorted(series.time_s, time_s, side="right") - 1
    interval[time_s == series.time_s[-1]] -= 1
    inside = (interval >= 0) & (interval < series.time_s.size - 1)
    start = np.full(time_s.size, -1)
    for lean in (0, 2, 1):
        candidate = interval - lean
        usable = inside & (candidate >= 0)
        usable[usable] &= three[np.minimum(candidate[usable], three.size - 1)]
        start[usable] = candidate[usable]  # the last one, centred, is the best
    rows = np.flatnonzero(start >= 0)
    nodes = start[rows, None] + np.arange(4)
    at, times = time_s[rows, None], series.time_s[nodes]
    for j in range(4):
        others = [k for k in range(4) if k != j]
        weight = np.prod((at - times[:, others]) / (times[:, [j]] - times[:, others]), axis=1)
        found[rows] = (0.0 if j == 0 else found[rows]) + weight[:, None] * series.values[nodes[:, j]]
    return found


MOST_MISSING = 0.02
"""A group that lacks more than this share of its rows is measured again."""

MOST_GAP_S = 0.05
"""And so is one with a longer stretch without rows [s]."""

_NEIGHBOURHOOD_S = 5.0
_GRACE = 5  # rows
_AXES = (("gyro", "rad_s"), ("acceleration", "m_s2"))
_IMU_COLUMNS = (*(f"{what}_{axis}_{unit}" for what, unit in _AXES for axis in "xyz"), "tilt_rad")


def group_is_whole(samples: Sequence[Sample], sample_hz: float) -> bool:
    """Return whether the samples of a group have so few holes that it need not be measured again.

    samples: all cycles of the group, in order. sample_hz: asked rate of the cycles [Hz].
    A row is missing where the drive, a tendon or the IMU did not answer, where a cycle did not run, and where the
    IMU's samples lie more than 2.5 periods apart; 2 % may be, and no more than 50 ms in one piece.
    """
    stamps = np.array([s.time_s for s in samples])
    complete = np.array([s.time_s for s in samples if math.isfinite(_sum(s))])
    taken = np.array([s.imu_time_s for s in samples])
    taken = taken[np.isfinite(taken)]
    steps = np.diff(taken)
    fresh = steps > 0.5 / sample_hz  # shorter ones are the same sample twice
    if complete.size == 0 or not fresh.any():
        return False
    for i in np.flatnonzero(steps > MOST_PERIODS * np.median(steps[fresh])):
        complete = complete[(complete <= taken[i]) | (complete >= taken[i + 1])]
    return _has_few_holes(complete, stamps, sample_hz)


def _sum(s: Sample) -> float:
    """Return a number that is NaN if any reading is that a row cannot do without."""
    return (
        s.time_s + s.imu_time_s + s.drive_rad + s.drive_current_a + s.drive_pwm + sum(s.tendon_rad)
        + sum(s.tendon_current_a) + sum(s.gyro_rad_s) + sum(s.acceleration_m_s2)
    )  # fmt: skip


def _has_few_holes(complete: Array, stamps: Array, sample_hz: float, grace: int = 1) -> bool:
    """Return whether rows with these times are enough for a group whose cycles had these stamps [s].

    grace: so many rows more may be missing. The conversion grants more of them than who decides to measure again: a
    group that was found whole then stays so, whatever the interpolation costs at its ends.
    """
    if complete.size == 0:
        return False
    first, last = float(np.nanmin(stamps)), float(np.nanmax(stamps))
    expected = round((last - first) * sample_hz) + 1
    longest = float(np.diff(complete, prepend=first, append=last).max())
    few = complete.size >= (1 - MOST_MISSING) * expected - grace
    return few and longest <= MOST_GAP_S + (grace - 1) / sample_hz


@dataclass(frozen=True)
class _Rows:
    """Rows of one group: values by variable of the recording, and how many rows each of its segments has."""

    values: dict[str, NDArray[Any]]
    sizes: list[int]
    left_out: int
    is_whole: bool


def recording_from_journal(path: Path, groups: Collection[int] | None = None) -> xr.Dataset:
    """Return the recording of all whole groups of a journal, in the order of the plan, the latest attempt of each.

    groups: their indices in the plan; None for all that are finished.
    Rows have the time of the drive's reading plus the rig's drive_delay, so that the rig's delay budget holds; the
    IMU's readings are brought from its own times to those. Rows without a reading of drive, tendons or IMU are left
    out; a sensor with a node of its own that gave no answer leaves only its own value unknown, NaN. Time counts from
    the first run; those that resumed it follow after as long as the computer's calendar says.
    Attributes beside those of `provenance`, and those given to the journal: `started` (date), `runs`, `left_out_rows`,
    `left_out_groups` (found to have too many holes), `pauses` (JSON: what was said of each pause of the computer after
    which a run went on by itself; only where there was one), `registers` (see
    `sinew.measure.recording.read_registers`), `tendon_limit_a` (where the motors have one, as they were set last at
    each pretension), and the journal's statistics.
    Raises FileError where it is no journal, RecordingError where no group is whole.
    """
    with JournalReader(path) as journal:
        plan, rig = parse_plan(journal.plan_toml), parse_rig(journal.rig_toml)
        finished = {i: parts for i, parts in journal.finished().items() if groups is None or i in groups}
        rows = {index: _group_rows(journal, stretches, rig, plan.sample_hz) for index, stretches in finished.items()}
        whole = {index: part for index, part in rows.items() if part.is_whole}
        if not whole:
            raise RecordingError(f"{path} holds no whole group of the plan yet; resume its run")
        parts = _on_one_clock({index: finished[index][0].session for index in whole}, whole, journal.dates)
        planned = plan.groups()  # of a segment a journal keeps what a straight one says; the plan knows pose and drive
        segments = [_in_space(s.planned, planned[index]) for index in whole for s in finished[index]]
        given: dict[str, Any] = {**journal.attrs, **journal.counts()}
        events = [event for _, event in journal.events()]
        if holes := [str(event) for event in events if isinstance(event, Hole)]:
            given["pauses"] = json.dumps(holes)
        reached = [event for event in events if isinstance(event, Pretensioned)]
        if limits := {f"{one.asked_mm:g}": one.limit_a for one in reached if one.limit_a is not None}:
            given[LIMITS_ATTRIBUTE] = json.dumps(limits)
        if registers := journal.registers():
            given[REGISTERS_ATTRIBUTE] = json.dumps([{"run": run, **state} for run, state in registers.items()])
        attrs = provenance(
            str(given.pop("source", "bench")),
            rig=journal.rig_toml,
            plan=journal.plan_toml,
            **given,
            started=journal.dates[0],
            runs=len(journal.dates),
            left_out_rows=sum(part.left_out for part in whole.values()),
            left_out_groups=" ".join(str(index) for index in rows if index not in whole),
        )
    names = [name for name in parts[0] if all(name in part for part in parts)]
    samples = {name: np.concatenate([part[name] for part in parts]) for name in names}
    return build_recording(samples, segments, [n for part in whole.values() for n in part.sizes], attrs)


def convert(path: Path, out: Path) -> Path:
    """Write the recording of a journal to a NetCDF file, whole or not at all, and return where it is.

    Raises as `recording_from_journal` does, and FileError where the file cannot be written. The journal stays.
    """
    save_recording(recording_from_journal(path), out)
    return out


def _in_space(planned: Segment, group: Group) -> Segment:
    """Return what was asked of a segment with the pose and the drive of its group."""
    here = group.segment(planned.kind)
    return replace(planned, **{name: getattr(here, name) for name in SPATIAL_SEGMENTS})


def _group_rows(journal: JournalReader, stretches: Sequence[Stretch], rig: RigSpec, sample_hz: float) -> _Rows:
    """Return the rows of a group's segments; the IMU's samples around them are used too."""
    first, end = stretches[0].first, stretches[-1].end
    assert end is not None, "a segment without an end is not complete"
    margin = math.ceil(_NEIGHBOURHOOD_S * sample_hz)
    table = journal.samples(first - margin, end + margin, stretches[0].session)
    mine = (table["id"] >= first) & (table["id"] < end)
    begin, until = np.nanmin(table["time_s"][mine]), np.nanmax(table["time_s"][mine])
    close = np.abs(table["imu_time_s"] - np.clip(table["imu_time_s"], begin, until)) <= _NEIGHBOURHOOD_S
    series = imu_series(
        table["imu_time_s"][close],
        np.stack([table[name][close] for name in _IMU_COLUMNS], axis=1),
        table["imu_counter_s"][close],
    )
    rows = {name: column[mine] for name, column in table.items()}
    time = rows["time_s"] + rig.bus.drive_delay.value
    readings = readings_at(series, time)
    tendons = [i + 1 for i in range(rig.tendons.count)]
    values: dict[str, NDArray[Any]] = {
        "time_s": time,
        "drive_command_rad": rows["drive_command_rad"],
        "drive_rad": rows["drive_rad"],
        "drive_current_a": rows["drive_current_a"],
        "drive_pwm": rows["drive_pwm"],
        "tendon_rad": np.stack([rows[f"tendon_{i}_rad"] for i in tendons], axis=1),
        "tendon_current_a": np.stack([rows[f"tendon_{i}_current_a"] for i in tendons], axis=1),
        "gyro_rad_s": readings[:, :3],
        "acceleration_m_s2": readings[:, 3:6],
    }
    came = np.all([np.isfinite(rows[name]) for name in ("imu_time_s", *_IMU_COLUMNS[:6])], axis=0)
    whole_rows = came & np.all([np.isfinite(v.reshape(time.size, -1)).all(axis=1) for v in values.values()], axis=0)
    if np.isfinite(readings[whole_rows, 6]).all():
        values["tilt_rad"] = readings[:, 6]
    measured = np.flatnonzero(np.isfinite(rows["supply_v"]))
    # A motor that has not told its voltage yet is no hole: the first cycles get the first one told.
    supply = (
        rows["supply_v"]
        if measured.size == 0
        else np.interp(rows["id"], rows["id"][measured], rows["supply_v"][measured])
    )
    pwm = np.stack([rows[f"tendon_{i}_pwm"] for i in tendons], axis=1)
    more = {"drive_goal_rad": rows["drive_goal_rad"], "tendon_pwm": pwm, "supply_v": supply}
    values |= {name: v for name, v in more.items() if np.isfinite(v[whole_rows]).all()}
    values |= {sensor.channel: rows[sensor.channel] for sensor in rig.sensors}
    sizes = [int((whole_rows & (rows["id"] >= s.first) & (rows["id"] < (s.end or 0))).sum()) for s in stretches]
    tracked = stretches[-1].kind == "tracking"  # a law goes on through holes; they are left out all the same
    whole = min(sizes) > 0 and (tracked or _has_few_holes(time[whole_rows], time, sample_hz, _GRACE))
    single = {name: v if name == "time_s" else v.astype(np.float32) for name, v in values.items()}
    return _Rows({name: v[whole_rows] for name, v in single.items()}, sizes, int((~whole_rows).sum()), whole)


def _on_one_clock(
    session: dict[int, int], groups: dict[int, _Rows], dates: Sequence[str]
) -> list[dict[str, NDArray[Any]]]:
    """Return the groups' values with times that count from the first row of all, over all runs.

    A run that resumed begins after the first one's begin by as much as their dates say, but never before the end of
    what was recorded earlier.
    """
    shift: dict[int, float] = {}
    ended = -math.inf
    start = datetime.fromisoformat(dates[0])
    for run in sorted(Counter(session.values())):
        times = np.concatenate([groups[index].values["time_s"] for index in groups if session[index] == run])
        due = (datetime.fromisoformat(dates[run - 1]) - start).total_seconds()
        begin = max(due, ended + 1.0) if shift else due
        shift[run] = begin - float(times.min())
        ended = begin + float(np.ptp(times))
    first = min(float(part.values["time_s"].min()) + shift[session[index]] for index, part in groups.items())
    return [
        part.values | {"time_s": part.values["time_s"] + (shift[session[index]] - first)}
        for index, part in groups.items()
    ]
