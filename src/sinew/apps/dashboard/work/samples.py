"""Samples of a run as traces: in the units of a screen, thinned to its columns, and read piece by piece.

A piece is one of a ladder: at level L its bins are 2^L/1024 s wide, and it has 512 of them. So whoever looks at hours
asks for as much as whoever looks at a second, the same piece is never cut twice in different ways, and pieces that
follow one another join. Time is that of the run: 0 at its first sample. Where a run was taken up again its clock is
another; what was measured then follows a second after what was measured before.
"""

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sinew.apps.bench.bench_run import JOURNAL
from sinew.apps.dashboard.folders import unlinked
from sinew.bench.record.journal import JournalReader, Stretch, is_being_written
from sinew.bench.tilt import TiltEstimator
from sinew.measure.arrays import Array
from sinew.measure.attitude import gyro_share, quaternion, tilt_from
from sinew.measure.errors import FileError
from sinew.measure.events import Contact, Event, Health
from sinew.plan.plan import STRAIGHT, Pose
from sinew.plan.rig import RigSpec, Tendons
from sinew.plan.toml import parse_plan, parse_rig

# A rig becomes what a page draws of it: its shape, its traces, the limit of its tendons.


_SIDES = 28
"""Points around a section of the silicone; some go along each axis, where a flat section has its ends."""


def drawn_rig(rig: RigSpec, pose: Pose = STRAIGHT) -> dict[str, Any]:
    """Return what a page draws of a rig, for JSON.

    `shape`: lengths in those of the silicone, the number of tendons, and the points (y, z) of the silicone's surface
    around a section; `length_mm` of the silicone; `traces`: key, label and unit of each; `sensors`: key and label of
    those with a node of their own; `tension_limit_n` [N]; `newton_per_ampere` of a tendon motor; `alarms`: by reading,
    where its alarm begins unless somebody sets it elsewhere, and the rig's own limit; `pose`: in words, None of an
    upright head, which is drawn upright.
    """
    length = rig.silicone.length.value
    circle = rig.tendons.head_radius.value / length
    radius = 0.5 * rig.silicone.diameter.value / length
    shape = {
        "length": 1.0,
        "outline": (rig.outline(np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)) / length).tolist(),
        "circle": max(circle, radius + 0.04),  # tendons that run inside the silicone would not be seen
        "plate": max(circle, radius) + 0.16,
        "lever": 1.2 * max(circle, radius) + 0.3,
        "tendons": rig.tendons.count,
    }
    traces = [asdict(channel) for channel in LiveChannels(rig, pose).channels]
    sensors = [{"key": one.channel, "label": f"{one.model} / {one.unit}"} for one in rig.sensors]
    return {
        "shape": shape,
        "length_mm": 1e3 * length,
        "traces": traces,
        "sensors": sensors,
        "tension_limit_n": rig.limits.tension_n,
        "newton_per_ampere": rig.tendons.tension(1.0),
        "name": rig.name,
        "alarms": alarm_limits(rig),
        "pose": None if pose.is_straight else pose.words(),
    }


# The samples of a journal become what the oscilloscope shows, in the units of a screen.


_MEMORY_S = 3.0  # of the live torsion: long against a turn, short against a drift
_LONG_STEP_S = 0.05


@dataclass(frozen=True, slots=True)
class Channel:
    """A trace: its key, the label and the unit that stand beside it."""

    key: str
    label: str
    unit: str


class LiveChannels:
    """Turns rows of a run's journal into traces, batch after batch.

    The torsion is the gyroscope's rate, integrated by trapezoids with a leak of 3 s that takes the drift out: at 3 Hz
    it leads by 1° and is for the eye alone; what is measured comes from `sinew.analysis`. Of a pose that is not upright
    there are the head's tilt, by the orientation filter of the bench, and how far the tendons drew the plates together;
    what the gyroscope under-reads there is made good.
    """

    def __init__(self, rig: RigSpec, pose: Pose = STRAIGHT, sample_hz: float = 200.0) -> None:
        self._tendons = rig.tendons.count
        self._force = rig.tendons.tension(1.0)
        self._radius = rig.tendons.pulley_radius.value
        self.channels = (
            Channel("drive_command", "lever, command", "°"),
            Channel("drive", "lever θ", "°"),
            Channel("torsion", "torsion φ", "°"),
            Channel("drive_current", "drive current", "A"),
            *(Channel(f"tendon_{i + 1}_current", f"current of tendon {i + 1}", "A") for i in range(self._tendons)),
            Channel("tilt", "tilt", "°"),
            *(Channel(one.channel, one.model, one.unit) for one in rig.sensors),
            *(() if pose.is_straight else _BENT),
        )
        self._bent = None if pose.is_straight else _BentHead(rig, pose, sample_hz)
        self._share = gyro_share(pose.bend_rad)
        self._sensors = [one.channel for one in rig.sensors]
        self._torsion, self._rate, self._time = 0.0, math.nan, math.nan

    def take(self, rows: dict[str, Array]) -> Array:
        """Return the traces (c, n), in the order of `channels`, of rows as `JournalReader.samples` gives them."""
        tendons = [rows[f"tendon_{i + 1}_current_a"] for i in range(self._tendons)]
        torsion = self._integrate(rows["time_s"], rows["gyro_x_rad_s"] / self._share)
        return np.stack(
            [
                np.degrees(rows["drive_command_rad"]),
                np.degrees(rows["drive_rad"]),
                np.degrees(torsion),
                rows["drive_current_a"],
                *tendons,
                np.degrees(rows["tilt_rad"]),
                *(rows[name] for name in self._sensors),
                *(() if self._bent is None else self._bent.take(rows, torsion)),
            ]
        )

    def touch(self, angles: Array) -> None:
        """Take notice of where the tendon motors stood at first contact [rad], (tendon,)."""
        if self._bent is not None:
            self._bent.contact = angles

    def tensions(self, traces: Array) -> list[float]:
        """Return the tension of each tendon [N] at the newest row of some traces, from its motor's current."""
        currents = traces[4 : 4 + self._tendons, -1]
        return [float(max(0.0, current) * self._force) if np.isfinite(current) else math.nan for current in currents]

    def _integrate(self, time: Array, rate: Array) -> Array:
        out = np.empty(time.size)
        for i, (now, value) in enumerate(zip(time.tolist(), rate.tolist(), strict=True)):
            step = now - self._time
            if math.isfinite(value) and math.isfinite(self._rate) and 0.0 < step < _LONG_STEP_S:
                self._torsion += 0.5 * (value + self._rate) * step
                self._torsion *= math.exp(-step / _MEMORY_S)
            if math.isfinite(now):
                self._time = now
            if math.isfinite(value):
                self._rate = value
            out[i] = self._torsion
        return out


_BENT = (
    Channel("pitch", "pitch of the head", "°"),
    Channel("roll", "roll of the head", "°"),
    Channel("in_plane", "tilt in plane", "°"),
    Channel("out_of_plane", "tilt out of plane", "°"),
    Channel("shortening", "plates drawn together by", "mm"),
)


class _BentHead:
    """The head of a bent joint, sample by sample.

    contact: angles of the tendon motors at first contact [rad], NaN where that is not known. Since then a motor has
    taken up r Δangle of its cable, which is longer by ΔT/k itself; the mean of what is left is how far the plates came
    together. The tilt is counted in the head's axes, which the torsion turns, and comes out in those of the base.
    """

    def __init__(self, rig: RigSpec, pose: Pose, sample_hz: float) -> None:
        self._tilt, self._pose, self._tendons = TiltEstimator(rig, sample_hz), pose, rig.tendons
        self.contact = np.full(rig.tendons.count, np.nan)

    def take(self, rows: dict[str, Array], torsion: Array) -> Array:
        """Return pitch, roll, tilt away from the pose in its plane and out of it [deg], shortening [mm]: (5, n)."""
        axes = [rows[f"gyro_{a}_rad_s"] for a in "xyz"] + [rows[f"acceleration_{a}_m_s2"] for a in "xyz"]
        tilt = np.empty((torsion.size, 2))
        for i, (now, *axes_now) in enumerate(
            zip(rows["imu_time_s"].tolist(), *map(np.ndarray.tolist, axes), strict=True)
        ):
            known = math.isfinite(self._tilt.update(tuple(axes_now[:3]), tuple(axes_now[3:]), now))
            tilt[i] = self._tilt.components if known else math.nan
        cos, sin = np.cos(torsion), np.sin(torsion)
        pitch, roll = cos * tilt[:, 0] - sin * tilt[:, 1], sin * tilt[:, 0] + cos * tilt[:, 1]
        stands = quaternion(torsion, np.hypot(pitch, roll), np.arctan2(-pitch, roll))
        away = tilt_from(stands, self._pose.bend_rad, self._pose.azimuth_rad)
        return np.vstack([np.degrees([pitch, roll, *away.T]), 1e3 * self._drawn_together(rows)])

    def _drawn_together(self, rows: dict[str, Array]) -> Array:
        """Return by how much the plates are nearer than at first contact [m], (n,)."""
        count, tendons = self.contact.size, self._tendons
        angle, current = (np.stack([rows[f"tendon_{i + 1}_{of}"] for i in range(count)]) for of in ("rad", "current_a"))
        taken_up = tendons.pulley_radius.value * (angle - self.contact[:, None])
        pulled = tendons.tension(np.maximum(current, 0.0)) - tendons.first_contact_tension.value
        return np.asarray(np.mean(taken_up - pulled / tendons.cable_stiffness.value, axis=0))


# Samples are thinned to what a screen can show: least and largest value of each column of pixels.


@dataclass(frozen=True)
class Thinned:
    """time: begin of each bin [s], (b,), or of each sample where nothing was thinned. low, high: least and largest
    value of each channel there, (c, b); the same array where nothing was thinned."""

    time: Array
    low: Array
    high: Array


def thin(time: Array, values: Array, bin_s: float) -> Thinned:
    """Return the least and largest value of every channel in bins of a common grid, k · bin_s.

    time: not decreasing [s], (n,). values: (c, n), not a number where there is none. bin_s: width of a bin [s].
    A bin holds what falls into it and is not empty; with one sample or less to a bin the samples are given as they
    are. Bins lie on one grid, so parts that were thinned one after the other join: a bin that both have is the least
    of the least and the largest of the largest.
    """
    if time.size == 0 or bin_s <= 0 or (time[-1] - time[0]) / bin_s + 1 >= time.size:
        return Thinned(time, values, values)
    number = np.floor(time / bin_s)
    first = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
    low = np.fmin.reduceat(values, first, axis=1)
    high = np.fmax.reduceat(values, first, axis=1)
    return Thinned(number[first] * bin_s, low, high)


# A run's samples lie in its journal, the unfinished and the paused ones, too; their ids count from 1 without a gap.

_APART_S = 1.0  # what follows where the clock is another


@dataclass(frozen=True)
class Span:
    """Samples [first, end) of one clock, by id. clock_s: what it showed at the first of them; begin_s, end_s: time of
    the run of the first and of the last of them."""

    first: int
    end: int
    clock_s: float
    begin_s: float
    end_s: float


def spans_of(journal: JournalReader) -> list[Span]:
    """Return the stretches of one clock in a journal, in order of time: one of each time that a run wrote there."""
    found: list[Span] = []
    for first, end in pairwise([*journal.first_samples(), journal.last_sample() + 1]):
        if end > first:
            clock, at = journal.clock(first), found[-1].end_s + _APART_S if found else 0.0
            found.append(Span(first, end, clock, at, at + journal.clock(end - 1) - clock))
    return found


# A journal is followed while it grows.

MOST_NEW_ROWS = 4000


@dataclass(frozen=True)
class News:
    """What a journal has that it had not: rows by column, as `JournalReader.samples` gives them; events with their
    numbers, and when each was (see `JournalReader.event_times`); the segment that was begun last, or None; how many
    groups are finished; what the clock of the newest rows showed when the time of the run was 0 [s]; where the tendon
    motors stood at first contact [rad], where that is among the events; what makes of that clock seconds since 1970."""

    rows: dict[str, Array]
    events: list[tuple[int, Event]]
    segment: Stretch | None
    groups_done: int
    zero_s: float = math.nan
    contact: Array | None = None
    times: dict[int, tuple[float, float]] = field(default_factory=dict)
    epoch_s: float = math.nan


class JournalTail:
    """Follows one journal.

    path: of the journal. backlog: how many of the samples that there are already are read first.
    Every look is a short read transaction of its own, which keeps nothing from whoever writes. Raises FileError where
    it is no journal; sqlite3.OperationalError may come from a look at a disk that fails.
    """

    def __init__(self, path: Path, backlog: int = 0) -> None:
        self._reader = JournalReader(path)
        self.plan_toml, self.rig_toml = self._reader.plan_toml, self._reader.rig_toml
        self.found = self._reader.last_sample()  # what was there before we came
        self._last = max(0, self.found - backlog)
        self._event = 0
        self._session, self._zero_s = 0, math.nan
        source = self._reader.attrs.get("source")
        self.source = None if source is None else str(source)

    def look(self, most: int = MOST_NEW_ROWS) -> News:
        """Return what is new, at most so many rows at a time."""
        reader = self._reader
        end = min(reader.last_sample(), self._last + most)
        rows = reader.samples(self._last + 1, end + 1) if end > self._last else {}
        self._last = max(self._last, end)
        events, times = reader.events(self._event), reader.event_times(self._event)
        if events:
            self._event = events[-1][0]
        touched = any(isinstance(event, Contact) for _, event in events)
        contact = reader.tendons_at_contact() if touched else None
        if rows and (session := reader.session(self._last)) != self._session:
            newest = spans_of(reader)[-1]
            self._session, self._zero_s = session, newest.clock_s - newest.begin_s
        done, epoch = reader.count_finished(), reader.epoch(self._session) if rows else math.nan
        return News(rows, events, reader.newest_stretch(), done, self._zero_s, contact, times, epoch)

    def close(self) -> None:
        """Give the file back."""
        self._reader.close()


GAP_S = 60.0
"""Between two samples of one clock there is less [s]: what lies before was another session of the run."""


@contextmanager
def opened(folder: Path | str) -> Iterator[JournalReader]:
    """Give the samples of a run. Raises FileError where it has no journal."""
    folder = unlinked(Path(folder))
    if not (folder / JOURNAL).is_file():
        raise FileError(f"{folder.name} has no {JOURNAL}, which holds the samples of a run; look at its curves instead")
    with JournalReader(folder / JOURNAL) as journal:
        yield journal


_WARM_S = 30.0  # ten times the memory of the live torsion: what lies before makes 5e-5 of it


def traces_between(journal: JournalReader, begin_s: float, end_s: float) -> tuple[Array, Array]:
    """Return (time of the run [s], traces (c, n)) of what lies in [begin_s, end_s), a row without numbers where the
    clock changes. What has a memory, as the torsion, is begun half a minute before."""
    rig, plan, contact = parse_rig(journal.rig_toml), parse_plan(journal.plan_toml), journal.tendons_at_contact()
    channels = LiveChannels(rig, plan.rest_pose, plan.sample_hz)
    times, tables = [np.empty(0)], [np.empty((len(channels.channels), 0))]
    for span in spans_of(journal):
        if span.end_s < begin_s or span.begin_s >= end_s:
            continue
        warm, first, end = (
            bisect_left(range(span.end), at - span.begin_s + span.clock_s, lo=span.first, key=journal.clock)
            for at in (begin_s - _WARM_S, begin_s, end_s)
        )
        if end == first:
            continue
        channels = LiveChannels(rig, plan.rest_pose, plan.sample_hz)
        if contact is not None:
            channels.touch(contact)
        rows = journal.samples(warm, end)
        values = channels.take(rows)
        if times[-1].size:
            times.append(np.array([span.begin_s - 0.5 * _APART_S]))
            tables.append(np.full((values.shape[0], 1), np.nan))
        times.append(rows["time_s"][first - warm :] - span.clock_s + span.begin_s)
        tables.append(values[:, first - warm :])
    return np.concatenate(times), np.hstack(tables)


TORSION = 2
"""Row of the torsion among the traces; that of the lever is the one before."""


# Pieces: read whole where they are short, put together from parts where they are long.

PIECE_BINS = 512
"""Bins of a piece."""

FINEST_HZ = 1024.0
MOST_LEVEL = 20  # bins of 17 minutes
_READ_LEVEL = 9  # pieces of 256 s are read sample by sample
_PART_S, _PART_BIN_S = 128.0, 1.0
_SPENT_S = 0.4  # on one answer; what is not read by then comes with the next one
_MOST_PARTS = 2048  # three days


Part = tuple[NDArray[Any], NDArray[Any], NDArray[Any]]
"""Time [s], least and largest values; these in single precision, for a day of them is kept."""


@lru_cache(maxsize=_MOST_PARTS)
def _part(folder: str, inode: int, number: int) -> Part:
    """Return a part of a run in bins of a second, which is kept.

    inode: of its journal, for a run may be deleted and another take its name.
    """
    first = number * _PART_S
    with opened(folder) as journal:
        thinned = thin(*traces_between(journal, first, first + _PART_S), _PART_BIN_S)
    return thinned.time, thinned.low.astype(np.float32), thinned.high.astype(np.float32)


def samples_piece(folder: str, level: int, number: int) -> bytes:
    """Return a piece of a run as JSON: what lies in [number, number + 1) · 512 · 2^level/1024 s.

    {"time": [s], "low": [[...] for each trace], "high": the same, or null where nothing was thinned, "until_s": of the
    newest sample, "share": how much of the piece was read, 1 where it is whole}. Raises FileError.
    """
    level, number = int(np.clip(level, 0, MOST_LEVEL)), max(0, number)
    bin_s = 2**level / FINEST_HZ
    begin, end = number * PIECE_BINS * bin_s, (number + 1) * PIECE_BINS * bin_s
    with opened(folder) as journal:
        spans = spans_of(journal)
        until, share = spans[-1].end_s if spans else 0.0, 1.0
        if level <= _READ_LEVEL:
            time, low = traces_between(journal, begin, end)
            high = low
    if level > _READ_LEVEL:
        inode = (Path(folder) / JOURNAL).stat().st_ino
        first = int(begin // _PART_S)
        numbers = range(first, max(first + 1, math.ceil(min(end, until + 1.0) / _PART_S)))
        began, read = monotonic(), list[Part]()
        for k in numbers:
            # Of the last part more may come: it is read anew each time.
            read.append((_part if (k + 1) * _PART_S <= until else _part.__wrapped__)(folder, inode, k))
            if monotonic() - began > _SPENT_S:
                break
        share = len(read) / len(numbers)
        time, low, high = (np.concatenate([part[i] for part in read], axis=-1) for i in range(3))
    thinned = thin(time, low, bin_s)
    upper = thinned.high if high is low else thin(time, high, bin_s).high
    same = thinned.high is thinned.low and high is low
    return dumped(
        {
            "time": np.round(thinned.time, 4),
            "low": np.round(thinned.low.astype(float), 3),
            "high": None if same else np.round(upper.astype(float), 3),
            "until_s": round(until, 4),
            "share": share,
        }
    )


def dumped(document: dict[str, Any]) -> bytes:
    """Return JSON of a document with arrays; what is no number is null."""
    import orjson

    return orjson.dumps(document, option=orjson.OPT_SERIALIZE_NUMPY)


def samples_about(folder: str) -> bytes:
    """Return what there is of a run's samples, as JSON, without reading them.

    {"rig": see `drawn_rig`, "end_s": time of the newest sample,
    "is_running", "period_s": of the samples, "segments": [{"label", "from_s"}], and of the ladder
    "piece_bins", "finest_hz", "most_level"}.
    Raises FileError.
    """
    with opened(folder) as journal:
        spans, plan = spans_of(journal), parse_plan(journal.plan_toml)
        return dumped(
            {
                "rig": drawn_rig(parse_rig(journal.rig_toml), plan.rest_pose),
                "end_s": spans[-1].end_s if spans else 0.0,
                "is_running": is_being_written(Path(folder) / JOURNAL),
                "period_s": 1.0 / plan.sample_hz,
                "segments": list(_labelled(journal, spans)),
                "piece_bins": PIECE_BINS,
                "finest_hz": FINEST_HZ,
                "most_level": MOST_LEVEL,
            }
        )


_WORDS = {"settle": "settling", "ring-down": "free decay", "idle": "at rest", "pause": "paused"}


def _labelled(journal: JournalReader, spans: list[Span]) -> Iterator[dict[str, Any]]:
    for one in journal.stretches():
        span = next((span for span in spans if span.first <= one.first < span.end), None)
        if span is not None:
            numbers = ((one.planned.pretension_mm, "mm"), (one.planned.frequency_hz, "Hz"))
            words = [_WORDS.get(one.kind, one.kind), *(f"{x:g} {unit}" for x, unit in numbers if x == x)]
            at = journal.clock(one.first) - span.clock_s + span.begin_s
            yield {"label": ", ".join(words), "from_s": round(at, 4)}


_MOST_SPECTRUM_S = 120.0
_SPECTRUM_POINTS = 1200


def samples_spectrum(folder: str, begin_s: float, end_s: float) -> bytes:
    """Return the amplitudes in a stretch of a run by frequency, as JSON; of two minutes at most, its last ones.

    {"frequency_hz": [...], "amplitude": [[...] for each trace], null where a trace has no numbers, "resolution_hz":,
    "from_s", "to_s": what was taken}. By Hann's window, which shows a steady sine's amplitude up to 15 % too small
    between two frequencies; the mean is taken off. Raises FileError.
    """
    begin_s = max(begin_s, end_s - _MOST_SPECTRUM_S)
    with opened(folder) as journal:
        time, traces = traces_between(journal, begin_s, end_s)
        hz = parse_plan(journal.plan_toml).sample_hz
    if time.size < 16:
        raise FileError(f"found {time.size} samples in {begin_s:.2f} to {end_s:.2f} s, a spectrum needs 16")
    even = np.arange(time[0], time[-1], 1 / hz)
    amplitude: list[Array | None] = []
    frequency, window = np.fft.rfftfreq(even.size, 1 / hz), np.hanning(even.size)
    for row in traces:
        known = np.isfinite(row) & np.isfinite(time)
        if np.count_nonzero(known) < 16:
            amplitude.append(None)
            continue
        values = np.interp(even, time[known], row[known])
        amplitude.append(2 * np.abs(np.fft.rfft(window * (values - values.mean()))) / window.sum())
    # A peak must not be lost: the largest of what falls into one column of the screen.
    first = np.arange(0, frequency.size, -(-frequency.size // _SPECTRUM_POINTS))
    largest = [None if a is None else np.round(np.maximum.reduceat(a, first), 5) for a in amplitude]
    return dumped(
        {
            "frequency_hz": np.round(frequency[first], 4),
            "amplitude": largest,
            "resolution_hz": float(hz / even.size),
            "from_s": float(time[0]),
            "to_s": float(time[-1]),
        }
    )


# Alarms: readings of a run under way, and the limits that a rig gives them. Whether one is beyond its limit, and who
# has seen it, is decided by each page (`static/alarms.js`), for its viewer.

_READINGS_S = 1.0  # how long a reading holds on to its largest value: no frame to a page is later
_MISSED_S = 60.0

ALARM_SHARE = 0.9
"""Of a rig's limit, at which its alarm begins unless somebody sets it elsewhere: before the bench stops."""

MISSED_LIMIT = 5
"""Cycles missed within a minute, beyond which their alarm begins; no rig has a limit for them."""


def alarm_limits(rig: RigSpec) -> dict[str, dict[str, float | None]]:
    """Return where the alarm of each reading begins, `limit`, and what the rig allows, `rig`."""
    allowed = {"temperature": rig.limits.temperature_c, "tension": rig.limits.tension_n, "tilt": rig.limits.tilt_deg}
    limits: dict[str, dict[str, float | None]] = {"missed": {"limit": float(MISSED_LIMIT), "rig": None}}
    for name, most in allowed.items():
        limits[name] = {"limit": round(ALARM_SHARE * most, 3), "rig": most}
    return limits


class Readings:
    """What alarms are about: the largest value of each within the last second, so that no peak slips between frames.

    Values are (largest, of which part), by reading: tension [N], tilt [deg] away from the pose, temperature [°C], and
    cycles missed within the last minute. tendons: of the rig; without them only what a run tells of itself is read.
    """

    def __init__(self, tendons: Tendons | None = None) -> None:
        self._tendons = tendons
        self._peaks: deque[tuple[float, Array, float]] = deque()
        self._missed: deque[tuple[float, int]] = deque()
        self._celsius: dict[str, float] = {}

    def take(self, now: float, traces: Mapping[str, Array]) -> None:
        """Take new samples. now: [s], of any clock. traces: by key, (n,) each, as the oscilloscope has them."""
        tendons = self._tendons
        if tendons is None:
            return
        currents = [traces[f"tendon_{i + 1}_current"] for i in range(tendons.count)]
        away = (traces["in_plane"], traces["out_of_plane"]) if "in_plane" in traces else (traces["tilt"],)
        tension = tendons.tension(np.fmax(0.0, np.fmax.reduce(currents, axis=1)))
        self._peaks.append((now, tension, float(np.fmax.reduce(np.hypot.reduce(away, axis=0)))))
        while self._peaks[0][0] < now - _READINGS_S:
            self._peaks.popleft()

    def take_health(self, now: float, health: Health) -> None:
        """Take what a run told of itself."""
        self._celsius = dict(health.temperature_c)
        if self._missed and health.missed < self._missed[-1][1]:
            self._missed.clear()  # the run began anew
        self._missed.append((now, health.missed))
        while self._missed[0][0] < now - _MISSED_S:
            self._missed.popleft()

    def document(self) -> dict[str, tuple[float, str]]:
        """Return the readings that there are."""
        found: dict[str, tuple[float, str]] = {}
        if self._peaks:
            tension = np.fmax.reduce([peak for _, peak, _ in self._peaks], axis=0)
            if np.isfinite(tension).any():
                tendon = int(np.nanargmax(tension))
                found["tension"] = round(float(tension[tendon]), 1), f"tendon {tendon + 1}"
            tilt = float(np.fmax.reduce([tilt for _, _, tilt in self._peaks]))
            if math.isfinite(tilt):
                found["tilt"] = round(tilt, 2), "head plate"
        known = {name: value for name, value in self._celsius.items() if math.isfinite(value)}
        if known:
            hottest = max(known, key=lambda name: known[name])
            found["temperature"] = known[hottest], hottest
        if self._missed:
            found["missed"] = float(self._missed[-1][1] - self._missed[0][1]), "within a minute"
        return found
