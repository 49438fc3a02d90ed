"""What the pages' server keeps of the bench: newest samples, state of the run, its results.

It looks and never steers: samples come from the journal that the run writes, the state from the steward. What it keeps
in memory does not grow with the run.
"""

import asyncio
import math
import sqlite3
from collections import deque
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from time import time as wall_clock
from typing import Any

import numpy as np

from sinew.apps.bench.bench_run import JOURNAL
from sinew.apps.dashboard.operators import unlinked
from sinew.bench.journal_reader import JournalReader, Stretch
from sinew.measure.arrays import Array
from sinew.measure.errors import FileError
from sinew.measure.estimate import finite
from sinew.measure.events import Doubted, Event, Health, Severity
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_plan, parse_rig

# A rig becomes what a page draws of it: its shape, its traces, the limit of its tendons.


def drawn_rig(rig: RigSpec) -> dict[str, Any]:
    """Return what a page draws of a rig, for JSON.

    `shape`: lengths in those of the silicone, and the number of tendons; `labels` of the traces by key;
    `tension_limit_n` [N].
    """
    length = rig.silicone.length.value
    circle = rig.tendons.head_radius.value / length
    radius = 0.5 * rig.silicone.diameter.value / length
    shape = {
        "length": 1.0,
        "radius": radius,
        "circle": max(circle, radius + 0.04),  # tendons that run inside the silicone would not be seen
        "plate": max(circle, radius) + 0.16,
        "lever": 1.2 * max(circle, radius) + 0.3,
        "tendons": rig.tendons.count,
    }
    labels = {channel.key: channel.label for channel in LiveChannels(rig).channels}
    return {"shape": shape, "labels": labels, "tension_limit_n": rig.limits.tension_n}


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
    it leads by 1° and is for the eye alone; what is measured comes from `sinew.analysis`.
    """

    def __init__(self, rig: RigSpec) -> None:
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
        )
        self._torsion, self._rate, self._time = 0.0, math.nan, math.nan

    def take(self, rows: dict[str, Array]) -> Array:
        """Return the traces (c, n), in the order of `channels`, of rows as `JournalReader.samples` gives them."""
        tendons = [rows[f"tendon_{i + 1}_current_a"] for i in range(self._tendons)]
        return np.stack(
            [
                np.degrees(rows["drive_command_rad"]),
                np.degrees(rows["drive_rad"]),
                np.degrees(self._integrate(rows["time_s"], rows["gyro_x_rad_s"])),
                rows["drive_current_a"],
                *tendons,
                np.degrees(rows["tilt_rad"]),
            ]
        )

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


class Ring:
    """The newest columns of a table that goes on.

    rows: how many rows a column has. capacity: how many columns are kept. count: columns put so far; a column's number
    is its place in that count, and stays.
    """

    def __init__(self, rows: int, capacity: int) -> None:
        self._table = np.full((rows, capacity), np.nan)
        self.count = 0

    @property
    def oldest(self) -> int:
        """Number of the oldest column that is kept."""
        return max(0, self.count - self._table.shape[1])

    def put(self, columns: Array) -> None:
        """Add columns (rows, n); the oldest make room."""
        capacity = self._table.shape[1]
        kept = columns[:, -capacity:]
        first = self.count + columns.shape[1] - kept.shape[1]
        self._table[:, np.arange(first, first + kept.shape[1]) % capacity] = kept
        self.count += columns.shape[1]

    def get(self, first: int, end: int) -> Array:
        """Return the columns with numbers in [first, end), those that are still kept."""
        first, end = max(first, self.oldest), min(end, self.count)
        return self._table[:, np.arange(first, max(first, end)) % self._table.shape[1]]


_MOST_ROWS = 4000


@dataclass(frozen=True)
class News:
    """What a journal has that it had not: rows by column, as `JournalReader.samples` gives them; events with
    their numbers; the segment that was begun last, or None; how many groups are finished."""

    rows: dict[str, Array]
    events: list[tuple[int, Event]]
    segment: Stretch | None
    groups_done: int


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
        source = self._reader.attrs.get("source")
        self.source = None if source is None else str(source)

    def look(self) -> News:
        """Return what is new, at most 4000 rows at a time."""
        reader = self._reader
        end = min(reader.last_sample(), self._last + _MOST_ROWS)
        rows = reader.samples(self._last + 1, end + 1) if end > self._last else {}
        self._last = max(self._last, end)
        events = reader.events(self._event)
        if events:
            self._event = events[-1][0]
        return News(rows, events, reader.newest_stretch(), reader.count_finished())

    def close(self) -> None:
        """Give the file back."""
        self._reader.close()


FRAME_S = 0.04
"""Time between two frames [s]."""

_STATUS_S = 0.5
_KEPT = 24_000  # samples: a minute at 400 Hz
_PLAY_S = 0.12  # a journal gets its rows ten times a second; they are played out evenly
_MOST_EVENTS = 50
_MOST_DOUBTS = 8
_GAP_S = 60.0  # between samples: what lies before was another session of the run

Status = dict[str, Any]


@dataclass
class Live:
    """A run that is followed.

    name: of its folder; started: when, as the steward has it. rig: what a page draws of it. epoch: rises whenever
    another run is followed. ring: row 0 is the time since the first sample that was seen [s], the others the channels.
    played: how many samples the viewers may see. latest: what there is to say of the newest of them. health: what the
    run told of itself last. events: the newest, (number, severity, sentence). doubts: what the run doubts of itself.
    source: what was measured where that is no real bench, else None. seen: when the newest sample came [s since 1970];
    None where that is not known, which is as long as all came from before.
    """

    name: str
    started: float
    epoch: int
    rig: dict[str, Any]
    channels: tuple[Channel, ...]
    ring: Ring
    plan_toml: str
    rig_toml: str
    groups: int
    played: int = 0
    latest: dict[str, Any] = field(default_factory=dict)
    health: dict[str, Any] = field(default_factory=dict)
    events: deque[tuple[int, Severity, str]] = field(default_factory=lambda: deque(maxlen=_MOST_EVENTS))
    doubts: list[str] = field(default_factory=list)
    source: str | None = None
    seen: float | None = None
    segment: dict[str, Any] | None = None
    groups_done: int = 0


class Hub:
    """What all viewers share.

    runs: folder of the runs. status: asks the steward, GET /status; raises OSError where it does not answer.
    live: the run under way, or the last one; None before the first. steward: its last answer; None where it gives none.
    """

    def __init__(self, runs: Path, status: Callable[[], Awaitable[Status]]) -> None:
        self._runs, self._ask = runs, status
        self._tail: JournalTail | None = None
        self._channels: LiveChannels | None = None
        self._start = self._newest = math.nan
        # A connection of SQLite belongs to its thread.
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="journal")
        self._epoch = 0
        self.live: Live | None = None
        self.steward: Status | None = None
        self.trouble = ""

    async def run(self) -> None:
        """Keep up with the bench until cancelled."""
        loop = asyncio.get_running_loop()
        asking = asyncio.create_task(self._watch_steward())
        try:
            due = loop.time()
            while True:
                await self.tick(FRAME_S)
                due = max(due + FRAME_S, loop.time())
                await asyncio.sleep(due - loop.time())
        finally:
            asking.cancel()
            self._thread.shutdown(wait=False)

    async def tick(self, elapsed: float) -> None:
        """Look once; elapsed: time since the last look [s]."""
        loop = asyncio.get_running_loop()
        await self._follow()
        if self._tail is None or self.live is None:
            return
        try:
            news = await loop.run_in_executor(self._thread, self._tail.look)
        except sqlite3.Error as trouble:
            self.trouble = f"the journal of {self.live.name} cannot be read: {trouble}"
            return
        self.trouble = ""
        self._take(self.live, news)
        waiting = self.live.ring.count - self.live.played
        self.live.played += min(waiting, math.ceil(waiting * (1 - math.exp(-elapsed / _PLAY_S))))

    async def _watch_steward(self) -> None:
        while True:
            try:
                self.steward = await self._ask()
            except OSError:
                self.steward = None
            await asyncio.sleep(_STATUS_S)

    async def _follow(self) -> None:
        """Turn to the run that is under way, or else to the last one, once it has a journal."""
        steward = self.steward or {}
        run = steward.get("run") or steward.get("last")
        if run is None:
            return
        started = float(run.get("started") or 0.0)
        if self.live is not None and (self.live.name, self.live.started) == (run["name"], started):
            self.live.seen = self.live.seen or run.get("ended")
            return
        path = self._runs / run["name"] / JOURNAL
        if not path.is_file():
            return
        loop = asyncio.get_running_loop()
        try:
            unlinked(path.parent)
            tail = await loop.run_in_executor(self._thread, lambda: JournalTail(path, _KEPT))
        except (FileError, sqlite3.Error) as trouble:
            self.trouble = str(trouble)
            return
        if self._tail is not None:
            with suppress(sqlite3.Error):
                await loop.run_in_executor(self._thread, self._tail.close)
        self._tail, self.trouble = tail, ""
        rig = parse_rig(tail.rig_toml)
        self._channels = LiveChannels(rig)
        self._start = self._newest = math.nan
        self._epoch += 1
        channels = self._channels.channels
        groups = len(parse_plan(tail.plan_toml).groups())
        ring = Ring(1 + len(channels), _KEPT)
        texts = tail.plan_toml, tail.rig_toml
        self.live = Live(run["name"], started, self._epoch, drawn_rig(rig), channels, ring, *texts, groups)
        self.live.source, self.live.seen = tail.source, run.get("ended")

    def _take(self, live: Live, news: News) -> None:
        assert self._channels is not None
        if news.rows:
            self._put(live, news.rows)
        for number, event in news.events:
            if isinstance(event, Health):
                live.health = asdict(event)
            elif event.severity != "state":
                if isinstance(event, Doubted) and event.sentence not in live.doubts:
                    live.doubts = [*live.doubts, event.sentence][-_MOST_DOUBTS:]
                live.events.append((number, event.severity, str(event)))
        live.groups_done = news.groups_done
        if news.segment is not None:
            asked = news.segment.asked
            live.segment = {
                "kind": news.segment.kind,
                "state": news.segment.state,
                "pretension_mm": finite(asked.pretension_mm),
                "frequency_hz": finite(asked.frequency_hz),
                "amplitude_deg": finite(asked.amplitude_deg),
            }

    def _put(self, live: Live, rows: dict[str, Array]) -> None:
        """Take samples; those from before a run was taken up again are of another clock, and are left out."""
        assert self._channels is not None
        time = rows["time_s"]
        before = self._newest if math.isfinite(self._newest) else float(time[0])
        steps = np.diff(time, prepend=before)
        breaks = np.flatnonzero((steps < 0) | (steps > _GAP_S))
        if breaks.size:
            first = int(breaks[-1])
            rows, time = {name: column[first:] for name, column in rows.items()}, time[first:]
            self._epoch += 1
            live.epoch, live.ring, live.played = self._epoch, Ring(1 + len(live.channels), _KEPT), 0
            self._start = math.nan
        if math.isnan(self._start):
            self._start = float(time[0])
        self._newest = float(time[-1])
        traces = self._channels.take(rows)
        live.ring.put(np.vstack([time - self._start, traces]))
        live.latest["tension_n"] = self._channels.tensions(traces)
        if self._tail is not None and rows["id"][-1] > self._tail.found:
            live.seen = wall_clock()
