"""`sinew export --to foxglove`: a run as it goes, by Foxglove's web socket protocol, for Foxglove and PlotJuggler.

It follows the journal that the run writes, as the pages do, and takes nothing from viewers.
"""

import math
import sqlite3
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from sinew.apps.dashboard.work.samples import GAP_S, JournalTail, LiveChannels, News
from sinew.bench.record.journal import JournalReader, is_being_written
from sinew.measure.errors import SinewError, how_to_install
from sinew.measure.files.names import unit_suffix
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_plan, parse_rig

if TYPE_CHECKING:
    from foxglove import Channel, Context
import sys

from sinew.apps import console
from sinew.apps.bench.bench_run import JOURNAL
from sinew.measure.errors import FileError

HOST = "127.0.0.1"
SAMPLES, SHOWN, SEGMENT, LOG = "/sinew/samples", "/sinew/shown", "/sinew/segment", "/sinew/log"

_MOST_ROWS = 400
"""In one look: what was measured before comes forty times as fast as it was."""
_BACKLOG = 8000
"""Messages that wait for a viewer who is slow; then the oldest is left out."""

_SUFFIXES = {"°": "deg"}
_LEVELS = {"state": 1, "note": 2, "warning": 3}  # of foxglove.Log: debug, info, warning
_TEXT, _NUMBER = {"type": "string"}, {"type": "number"}
_MOMENT = {"type": "object", "title": "time", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_LOG_SCHEMA = {"timestamp": _MOMENT, "level": {"type": "integer"}, "message": _TEXT, "name": _TEXT}
"""As Foxglove's panel of logs wants it."""
_SEGMENT_SCHEMA = {
    **dict.fromkeys(("kind", "state"), _TEXT),
    **dict.fromkeys(("pretension_mm", "frequency_hz", "amplitude_deg"), _NUMBER),
}


class RunStream:
    """A server of one run's journal; a context manager.

    journal: its path. port: of the web socket, 0 for a free one. seconds: how much of what is there already is sent
    first. Nothing is read before somebody looks. Raises FileError where it is no journal, SinewError where the port is
    taken. Messages bear the time of the run in seconds since 1970.
    """

    def __init__(self, journal: Path, port: int, seconds: float) -> None:
        try:
            from foxglove import Context, start_server
            from foxglove.websocket import ServerListener
        except ImportError as error:
            raise SinewError(
                f"found no foxglove-sdk, which the web socket needs; install it: {how_to_install('files')}"
            ) from error

        self._journal, self._seen = journal, threading.Event()
        seen = self._seen

        class Listener(ServerListener):
            """Notices that somebody looks."""

            def on_subscribe(self, client: object, channel: object) -> None:
                seen.set()

        plan, rig, columns = _setup_of(journal)
        self._tail = JournalTail(journal, math.ceil(seconds * plan.sample_hz))
        self._shown = LiveChannels(rig, plan.rest_pose, plan.sample_hz)
        self._context = context = Context()  # channels that nobody's context holds are not told of
        try:
            self._server = start_server(
                name=f"sinew {journal.parent.name}",
                host=HOST,
                port=port,
                capabilities=[],
                server_listener=Listener(),
                context=context,
                message_backlog_size=_BACKLOG,
            )
        except Exception as error:  # the library's own, without a class
            self._tail.close()
            raise SinewError(
                f"cannot open a web socket on {HOST}:{port} ({error}); another program may be there, "
                "--ws-port 0 takes a free one"
            ) from error
        shown = [f"{one.key}_{_SUFFIXES.get(one.unit) or unit_suffix(one.unit)}" for one in self._shown.channels]
        self._names = shown
        self._channels = {
            name: _channel(name, title, properties, context)
            for name, title, properties in (
                (SAMPLES, "sinew.Sample", dict.fromkeys(columns, _NUMBER)),
                (SHOWN, "sinew.Shown", dict.fromkeys(shown, _NUMBER)),
                (SEGMENT, "sinew.Segment", _SEGMENT_SCHEMA),
                (LOG, "foxglove.Log", _LOG_SCHEMA),
            )
        }
        self._segment: dict[str, Any] | None = None
        self._stamp = time.time_ns()

    @property
    def url(self) -> str:
        """Where viewers connect."""
        return f"ws://{HOST}:{self._server.port}"

    @property
    def topics(self) -> list[str]:
        """Names of the channels."""
        return list(self._channels)

    @property
    def is_under_way(self) -> bool:
        """Whether somebody still writes the journal."""
        return is_being_written(self._journal)

    def seen(self, timeout_s: float) -> bool:
        """Return whether somebody looks, waiting for it so long [s]."""
        return self._seen.wait(timeout_s)

    def look(self) -> int:
        """Send what is new, and return how many samples that was; none while nobody looks."""
        if not self._seen.is_set():
            return 0
        try:
            news = self._tail.look(_MOST_ROWS)
        except sqlite3.Error:  # a disk that fails, or a moment of the writer's: the next look tells
            return 0
        if news.contact is not None:
            self._shown.touch(news.contact)
        sent = self._send_samples(news) if news.rows else 0
        for number, event in news.events:
            stamp = round(1e9 * news.times[number][0]) if number in news.times else self._stamp
            message = {
                "timestamp": {"sec": stamp // 10**9, "nsec": stamp % 10**9},
                "level": _LEVELS[event.severity],
                "message": str(event),
                "name": type(event).__name__,
            }
            self._channels[LOG].log(message, log_time=stamp)
        self._send_segment(news)
        return sent

    def _send_samples(self, news: News) -> int:
        rows = news.rows
        time_s = rows["time_s"]
        breaks = np.flatnonzero((np.diff(time_s) < 0) | (np.diff(time_s) > GAP_S))
        first = int(breaks[-1]) + 1 if breaks.size else 0  # what lies before is of another clock
        rows = {name: column[first:] for name, column in rows.items() if name != "id"}
        traces = dict(zip(self._names, self._shown.take(rows), strict=True))
        # Nanoseconds since 1970 are more than a float holds: each part is rounded on its own.
        stamps = (np.rint(1e9 * rows["time_s"]).astype(np.int64) + round(1e9 * news.epoch_s)).tolist()
        for topic, table in ((SAMPLES, rows), (SHOWN, traces)):
            columns = {name: column.tolist() for name, column in table.items()}
            channel = self._channels[topic]
            for i, stamp in enumerate(stamps):
                channel.log({name: c[i] for name, c in columns.items() if c[i] == c[i]}, log_time=stamp)
        self._stamp = stamps[-1]
        return len(stamps)

    def _send_segment(self, news: News) -> None:
        if news.segment is None:
            return
        planned = news.segment.planned
        numbers = {name: getattr(planned, name) for name in ("pretension_mm", "frequency_hz", "amplitude_deg")}
        known = {name: value for name, value in numbers.items() if math.isfinite(value)}
        message = {"kind": news.segment.kind, "state": news.segment.state, **known}
        if message != self._segment:
            self._channels[SEGMENT].log(message, log_time=self._stamp)
            self._segment = message

    def close(self) -> None:
        """Close the web socket, and give the journal back."""
        self._server.stop()
        self._tail.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def _setup_of(journal: Path) -> tuple[Plan, RigSpec, tuple[str, ...]]:
    """Return (plan, rig, columns of its samples) of a journal."""
    with JournalReader(journal) as reader:
        columns = tuple(name for name in reader.samples(0, 0) if name != "id")
        return parse_plan(reader.plan_toml), parse_rig(reader.rig_toml), columns


def _channel(name: str, title: str, properties: dict[str, Any], context: "Context") -> "Channel":
    from foxglove import Channel

    return Channel(name, schema={"title": title, "type": "object", "properties": properties}, context=context)


_LOOK_S = 0.05


def stream_run(run: Path, port: int, back: float, *, until_end: bool, json: bool) -> None:
    """Stream a run to Foxglove and PlotJuggler as it goes, until Ctrl-C, or until its end.

    run: its folder or its journal. port: of the web socket on this machine, 0 for a free one. back: sent first is what
    was measured so long before [s]. Channels: /sinew/samples, each cycle's readings in SI as the journal has them;
    /sinew/shown, torsion, lever, tilt and currents as the dashboard draws them; /sinew/segment, what is being measured;
    /sinew/log, what happened. Each has a JSON schema.
    """
    console.checked_number("--ws-port", port, "0 to 65535", low=0, high=65535)
    console.checked_number("--back-s", back, "0 to 86400", low=0, high=86400)
    journal = run / JOURNAL if run.is_dir() else run
    if not journal.is_file():
        raise FileError(f"there is no journal {journal}, expected the folder of a run; start the run first")
    with RunStream(journal, port, back) as streamed:
        document = {"url": streamed.url, "run": str(run), "topics": streamed.topics}
        lines = [
            streamed.url,
            "- Foxglove: open a connection, Foxglove WebSocket; PlotJuggler: stream from Foxglove Bridge",
        ]
        console.print_result(document, lines, json=json)
        sys.stdout.flush()
        try:
            while streamed.look() or streamed.is_under_way or not until_end:
                time.sleep(_LOOK_S)
        except KeyboardInterrupt:
            pass
