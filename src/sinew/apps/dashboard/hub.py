"""What the pages' server keeps of the bench, newest samples, state of the run, its results, and streams to viewers.

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
from time import monotonic
from time import time as wall_clock
from typing import Any, Literal

import numpy as np
import orjson
from starlette.websockets import WebSocket, WebSocketDisconnect

from sinew.apps.bench.bench_run import JOURNAL
from sinew.apps.dashboard.folders import unlinked
from sinew.apps.dashboard.work.results import judged
from sinew.apps.dashboard.work.samples import (
    GAP_S,
    TORSION,
    Channel,
    JournalTail,
    LiveChannels,
    News,
    Readings,
    drawn_rig,
    dumped,
    thin,
)
from sinew.apps.dashboard.worker import TooSlowError, Worker
from sinew.measure.arrays import Array
from sinew.measure.errors import FileError, SinewError
from sinew.measure.estimate import finite
from sinew.measure.events import Doubted, Ended, Frozen, Health, Severity
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_plan, parse_rig


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
        latest = columns[:, -capacity:]
        first = self.count + columns.shape[1] - latest.shape[1]
        self._table[:, np.arange(first, first + latest.shape[1]) % capacity] = latest
        self.count += columns.shape[1]

    def get(self, first: int, end: int) -> Array:
        """Return the columns with numbers in [first, end), those that are still kept."""
        first, end = max(first, self.oldest), min(end, self.count)
        return self._table[:, np.arange(first, max(first, end)) % self._table.shape[1]]


FRAME_S = 1 / 32
"""Time between two frames [s]: a few more than the 30 a second that are to be drawn: two may reach a page at once."""

_STATUS_S = 0.5
_KEPT = 24_000  # samples: a minute at 400 Hz
_PLAY_S = 0.12  # a journal gets its rows ten times a second; they are played out evenly
_MOST_EVENTS = 200
_MOST_DOUBTS = 8

Status = dict[str, Any]


Told = tuple[int, Severity | Literal["stop"], str, float | None, float | None]
"""An event as a page gets it: number, severity ("stop" of what ended a run early), sentence, when [s since 1970], and
how long after the run, or its resumption, began [s]."""


@dataclass
class Live:
    """A run that is followed.

    name: of its folder; started: when, as the steward has it. rig: what a page draws of it. epoch: rises whenever
    another run is followed. ring: row 0 is the time of the run [s], 0 at its first sample, the others the channels.
    played: how many samples the viewers may see. tension_n: of each tendon at the newest of them. health: what the
    run told of itself last. events: the newest, see `Told`. readings: what alarms are about. doubts: what the run
    doubts of itself. source: what was measured where that is no real bench, else None. seen: when the newest sample
    came [s since 1970]; None where that is not known, which is as long as all came from before. looked: when the
    journal was read last [s since 1970].
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
    tension_n: list[float] = field(default_factory=list)
    health: dict[str, Any] = field(default_factory=dict)
    events: deque[Told] = field(default_factory=lambda: deque(maxlen=_MOST_EVENTS))
    readings: Readings = field(default_factory=Readings)
    doubts: list[str] = field(default_factory=list)
    source: str | None = None
    seen: float | None = None
    looked: float = 0.0
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
        self._newest = math.nan
        # A connection of SQLite belongs to its thread.
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="journal")
        self._epoch = 0
        self.next_look = asyncio.Event()
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
        self.live.looked = wall_clock()
        waiting = self.live.ring.count - self.live.played
        self.live.played += min(waiting, math.ceil(waiting * (1 - math.exp(-elapsed / _PLAY_S))))
        self.next_look.set()
        self.next_look = asyncio.Event()  # who waits from now on waits for the next

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
        rig, plan = parse_rig(tail.rig_toml), parse_plan(tail.plan_toml)
        self._channels = LiveChannels(rig, plan.rest_pose, plan.sample_hz)
        self._newest = math.nan
        self._epoch += 1
        channels = self._channels.channels
        drawn, groups = drawn_rig(rig, plan.rest_pose), len(plan.groups())
        ring = Ring(1 + len(channels), _KEPT)
        texts = tail.plan_toml, tail.rig_toml
        self.live = Live(run["name"], started, self._epoch, drawn, channels, ring, *texts, groups)
        self.live.source, self.live.seen = tail.source, run.get("ended")
        self.live.readings = Readings(rig.tendons)

    def _take(self, live: Live, news: News) -> None:
        assert self._channels is not None
        if news.contact is not None:
            self._channels.touch(news.contact)
        if news.rows:
            self._put(live, news.rows, news.zero_s)
        for number, event in news.events:
            if isinstance(event, Health):
                live.health = asdict(event)
                when, _ = news.times.get(number, (wall_clock(), None))  # many may come at once, from long ago
                live.readings.take_health(when, event)
            elif event.severity != "state":
                if isinstance(event, Doubted) and event.sentence not in live.doubts:
                    live.doubts = [*live.doubts, event.sentence][-_MOST_DOUBTS:]
                is_stop = isinstance(event, Frozen) or (isinstance(event, Ended) and news.groups_done < live.groups)
                times = news.times.get(number, (None, None))
                live.events.append((number, "stop" if is_stop else event.severity, str(event), *times))
        live.groups_done = news.groups_done
        if news.segment is not None:
            planned = news.segment.planned
            numbers = {
                name: finite(getattr(planned, name)) for name in ("pretension_mm", "frequency_hz", "amplitude_deg")
            }
            live.segment = {"kind": news.segment.kind, "state": news.segment.state, **numbers}

    def _put(self, live: Live, rows: dict[str, Array], zero_s: float) -> None:
        """Take samples; those from before a run was taken up again are of another clock, and are left out."""
        assert self._channels is not None
        time = rows["time_s"]
        before = self._newest if math.isfinite(self._newest) else float(time[0])
        steps = np.diff(time, prepend=before)
        breaks = np.flatnonzero((steps < 0) | (steps > GAP_S))
        if breaks.size:
            first = int(breaks[-1])
            rows, time = {name: column[first:] for name, column in rows.items()}, time[first:]
            self._epoch += 1
            live.epoch, live.ring, live.played = self._epoch, Ring(1 + len(live.channels), _KEPT), 0
        self._newest = float(time[-1])
        traces = self._channels.take(rows)
        live.ring.put(np.vstack([time - zero_s, traces]))
        live.tension_n = self._channels.tensions(traces)
        if self._tail is not None and rows["id"][-1] > self._tail.found:
            live.seen = wall_clock()
            fresh = traces[:, rows["id"] > self._tail.found]
            live.readings.take(monotonic(), dict(zip((one.key for one in live.channels), fresh, strict=True)))


# A run's curve grows: each recorded group analysed, beside what was predicted for the plan.

_LOOK_S = 0.5
_DRAWS = 40
_POINTS = "Points: mean and 90 % interval, over the repeats, or where there is one over its periods."
_BUSY = (
    "The computer is too busy to judge points while this run goes on; it is tried again and again. When the run is "
    "over, Open its results has the whole curve."
)
_BAND = f"{_POINTS} Band: 90 %, from what the rig's calibration leaves open."
_COMING = f"{_POINTS} The band of the prediction is being computed."
_NO_BAND = (
    f"{_POINTS} The prediction has no band: nothing is known of how certain this rig's parameters are; sinew calibrate "
    "finds out."
)


@dataclass
class Results:
    """What is known of the run that the hub follows.

    predicted: for each pretension `pretension_mm`, `frequency_hz`, `gain`, `phase` [deg], and where the rig knows how
    certain it is `gain_low`, `gain_high`, `phase_low`, `phase_high` of the 90 % band. measured: for each pretension
    `pretension_mm`, `frequency_hz`, and `gain`, `phase` as {"value", "std", "interval90"}, each point with its verdict
    (see `sinew.apps.dashboard.work.results.judged`). damping: of ring-downs. basis: what the prediction rests on.
    remark: what is to be said of the prediction and its band. notes: on groups that could not be analysed. trouble: why
    something is missing. is_predicting: whether a prediction was ever asked for. version: rises with every change.
    """

    hub: Hub
    work: Worker
    runs: Path
    predicted: list[dict[str, Any]] = field(default_factory=list)
    measured: list[dict[str, Any]] = field(default_factory=list)
    damping: list[dict[str, Any]] = field(default_factory=list)
    basis: str = ""
    remark: str = ""
    notes: list[str] = field(default_factory=list)
    is_predicting: bool = False
    version: int = 0
    trouble: str = ""

    async def run(self) -> None:
        """Follow the hub until cancelled."""
        looked: tuple[str, float] | None = None
        predicted_for: tuple[Plan, RigSpec] | None = None
        done: tuple[int, int] | None = None  # epoch and groups that were analysed
        predicting: asyncio.Task[None] | None = None
        while True:
            live = self.hub.live
            if live is not None and (live.name, live.started) != looked:
                looked = (live.name, live.started)
                self.measured, self.damping, self.notes, self.trouble = [], [], [], ""
                setup = parse_plan(live.plan_toml), parse_rig(live.rig_toml)
                if setup != predicted_for:  # a run that goes on keeps what was predicted of it
                    predicted_for = setup
                    self.predicted, self.basis, self.remark, self.is_predicting = [], "", "", True
                    if predicting is not None:
                        predicting.cancel()
                    predicting = asyncio.create_task(self._predict(live.plan_toml, live.rig_toml))
                self.version += 1
            if live is not None and (live.epoch, live.groups_done) != done:
                recorded = live.epoch, live.groups_done  # more may be by the time these are analysed
                done = recorded if await self._measure(live) else None
            await asyncio.sleep(_LOOK_S)

    async def _predict(self, plan_toml: str, rig_toml: str) -> None:
        """Predict the curves first, then their bands, which take longer."""
        for draws in (0, _DRAWS):
            try:
                found = await self.work.call("prediction_for_plan", plan_toml, rig_toml, draws)
            except SinewError as trouble:
                self.remark = f"There is no {'band of the ' if self.predicted else ''}prediction: {trouble}"
                self.version += 1
                return
            self.predicted = numbered(found["curves"], plan_toml)
            self.measured = judged(self.predicted, self.measured)
            can_have = found["can_have_bands"]
            if not self.predicted:
                self.remark = " ".join((_POINTS, *found["remarks"]))
            else:
                self.basis = basis_of(parse_rig(rig_toml))
                self.remark = _BAND if "gain_low" in self.predicted[0] else _COMING if can_have else _NO_BAND
            self.version += 1
            if not can_have:
                return

    async def _measure(self, live: Live) -> bool:
        """Analyse what is new; return whether that went well."""
        pending = 1
        while pending:
            try:
                found = await self.work.call("measured_so_far", str(self.runs / live.name / JOURNAL))
            except SinewError as trouble:
                is_slow = isinstance(trouble, TooSlowError)
                self.trouble = _BUSY if is_slow else f"What was measured cannot be analysed: {trouble}"
                self.version += 1
                return False
            self.measured = judged(self.predicted, numbered(found["curves"], live.plan_toml))
            self.damping, self.notes, pending = found["damping"], found["notes"], found["pending"]
            self.trouble = ""
            self.version += 1
        return True


def basis_of(rig: RigSpec) -> str:
    """Return in a sentence what a prediction of a rig rests on."""
    known = rig.calibration
    how = "as its file states them; no recording was fitted"
    if known is not None:
        count, at = len(known.recordings), ", ".join(f"{mm:g}" for mm in known.pretension_mm)
        what = f"{count} recording{'s' * (count != 1)}" if count else "recordings"
        how = f"calibrated on {what}" + (f" at {at} mm" if at else "")
    return f"Predicted from the equations with the parameters of the rig {rig.name}, {how}."


def numbered(curves: list[dict[str, Any]], plan_toml: str) -> list[dict[str, Any]]:
    """Return curves with the number of their colour, the place of their pretension in the plan."""
    order = list(parse_plan(plan_toml).pretension.pretension_mm)
    return [{**curve, "number": order.index(curve["pretension_mm"])} for curve in curves]


# A viewer gets frames over a web socket, as fast as it takes them and no faster.

MOST_MESSAGE = 512
"""Most characters of a message from a viewer."""

_STATE_S = 0.25
_SEND_S = 10.0
_LISSAJOUS_POINTS = 400  # as many as scope.js draws
_DRIVE, _TORSION = TORSION, TORSION + 1  # rows of the ring, whose first is the time
_BASES = (0.5, 60.0)
_PIXELS = (50, 4000)


@dataclass
class View:
    """How a viewer looks: base_s, width of its oscilloscope [s], in so many columns of pixels; sent: number of the next
    sample that it has not seen, of a run's epoch. last_sent: run and number of the newest event that it was told."""

    base_s: float = 5.0
    pixels: int = 600
    epoch: int = 0
    sent: int = 0
    last_sent: tuple[str, float, int] | None = None

    def change(self, message: str) -> None:
        """Take what the viewer says: {"base_s": number, "pixels": number}. Raises ValueError where it is not that."""
        if len(message) > MOST_MESSAGE:
            raise ValueError(f"found a message of {len(message)} characters, expected at most {MOST_MESSAGE}")
        said = orjson.loads(message)
        if not isinstance(said, dict):
            raise ValueError("expected an object")
        base, pixels = said.get("base_s", self.base_s), said.get("pixels", self.pixels)
        if not {type(base), type(pixels)} <= {int, float}:
            raise ValueError("expected numbers")
        grown = base > self.base_s
        self.base_s = float(np.clip(base, *_BASES))
        self.pixels = int(np.clip(pixels, *_PIXELS))
        if grown:
            self.epoch = 0  # it wants more of the past than it has


def frame_of(live: Live, view: View) -> bytes | None:
    """Return the next frame for a viewer as JSON, or None where there is nothing new; the viewer has seen it then.

    {"kind": "samples", "reset": whether what the viewer has is of another run; then also
    "rig" (see `drawn_rig`) and "traces", "time": [s], "low": [[...] for each
    channel], "high": the same, or null where nothing was thinned, "points": [[θ...], [φ...]] in degrees of the
    newest samples, each of them, "now": the newest value of each channel, "tension_n": of each tendon}.
    """
    reset = view.epoch != live.epoch
    if reset:
        view.epoch, view.sent = live.epoch, 0
        first = live.ring.get(live.played - 1, live.played)
        if first.size:  # no more of the past than the screen shows
            times = live.ring.get(live.ring.oldest, live.played)[0]
            view.sent = live.played - int(np.count_nonzero(times > times[-1] - view.base_s))
    new = live.ring.get(view.sent, live.played)
    view.sent = live.played
    if not new.shape[1] and not reset:
        return None
    frame: dict[str, Any] = {"kind": "samples", "reset": reset}
    if reset:
        frame["rig"] = live.rig
        frame["traces"] = [asdict(channel) for channel in live.channels]
    thinned = thin(new[0], new[1:], view.base_s / view.pixels)
    frame["time"] = np.round(thinned.time, 4)
    frame["low"] = np.round(thinned.low, 3)
    frame["high"] = None if thinned.high is thinned.low else np.round(thinned.high, 3)
    frame["points"] = np.round(new[[_DRIVE, _TORSION], -_LISSAJOUS_POINTS:], 2)
    frame["now"] = np.round(new[1:, -1], 3) if new.shape[1] else []
    frame["tension_n"] = live.tension_n
    return dumped(frame)


def state_of(hub: Hub, view: View | None = None) -> bytes:
    """Return what is going on, as JSON: {"kind": "state", "steward": its status, "live": state of the run}.

    Its `events` are null where a viewer was told all of them.
    """
    live = hub.live
    said: dict[str, Any] = {"kind": "state", "steward": hub.steward, "live": None, "trouble": hub.trouble}
    if live is not None:
        newest = (live.name, live.started, live.events[-1][0] if live.events else 0)
        is_old = view is not None and view.last_sent == newest
        if view is not None:
            view.last_sent = newest
        said["live"] = {
            "name": live.name,
            "groups": live.groups,
            "groups_done": live.groups_done,
            "segment": live.segment,
            "health": live.health,
            "events": None if is_old else list(live.events),
            "readings": live.readings.document(),
            "doubts": live.doubts,
            "source": live.source,
            "age_s": None if live.seen is None else max(0.0, wall_clock() - live.seen),
            "silent_s": None if live.seen is None else max(0.0, live.looked - live.seen),
        }
    return orjson.dumps(said)


async def serve_stream(socket: WebSocket, hub: Hub) -> None:
    """Serve one viewer until it leaves, says something that is not understood, or takes nothing for 10 s."""
    await socket.accept()
    view = View()
    listening = asyncio.create_task(_listen(socket, view))
    try:
        await _speak(socket, hub, view, listening)
    except (WebSocketDisconnect, TimeoutError, RuntimeError):
        pass  # RuntimeError: the socket was closed while something was on its way
    finally:
        listening.cancel()


async def _speak(socket: WebSocket, hub: Hub, view: View, listening: "asyncio.Task[None]") -> None:
    loop = asyncio.get_running_loop()
    state_sent_s = -_STATE_S
    while not listening.done():
        looked = hub.next_look  # before the frame is made: a look while it is sent is not missed
        frame = frame_of(hub.live, view) if hub.live is not None else None
        if frame is not None:
            await asyncio.wait_for(socket.send_text(frame.decode()), _SEND_S)
        if loop.time() - state_sent_s >= _STATE_S:
            state_sent_s = loop.time()
            await asyncio.wait_for(socket.send_text(state_of(hub, view).decode()), _SEND_S)
        tick = asyncio.ensure_future(looked.wait())
        try:  # who leaves makes room at once, also where nothing is looked at
            await asyncio.wait({tick, listening}, timeout=_STATE_S, return_when=asyncio.FIRST_COMPLETED)
        finally:
            tick.cancel()


async def _listen(socket: WebSocket, view: View) -> None:
    """Take the viewer's wishes; what is none of them ends the connection."""
    while True:
        message = await socket.receive_text()
        try:
            view.change(message)
        except ValueError:
            await socket.close(1008, "not understood")
            return
