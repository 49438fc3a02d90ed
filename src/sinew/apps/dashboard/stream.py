"""Frames of live samples for one viewer, over a web socket: as fast as it takes them and no faster.

A frame has what is new since the last one, thinned to the viewer's columns of pixels. A viewer that falls behind gets
fewer frames with more in each; what waits for it is never more than one frame.
"""

import asyncio
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import orjson
from starlette.websockets import WebSocket, WebSocketDisconnect

from sinew.apps.dashboard.hub import FRAME_S, Hub, Live
from sinew.measure.arrays import Array

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


MOST_MESSAGE = 512
"""Most characters of a message from a viewer."""

_STATE_S = 0.25
_SEND_S = 10.0
_LISSAJOUS_POINTS = 120
_DRIVE, _TORSION = 2, 3  # rows of the ring
_BASES = (0.5, 60.0)
_PIXELS = (50, 4000)


@dataclass
class View:
    """How a viewer looks: base_s, width of its oscilloscope [s], in so many columns of pixels; sent: number of the next
    sample that it has not seen, of a run's epoch."""

    base_s: float = 5.0
    pixels: int = 600
    epoch: int = 0
    sent: int = 0

    def change(self, message: str) -> None:
        """Take what the viewer says: {"base_s": number, "pixels": number}. Raises ValueError where it is not that."""
        if len(message) > MOST_MESSAGE:
            raise ValueError(f"found a message of {len(message)} characters, expected at most {MOST_MESSAGE}")
        said = orjson.loads(message)
        if not isinstance(said, dict):
            raise ValueError("expected an object")
        base, pixels = said.get("base_s", self.base_s), said.get("pixels", self.pixels)
        if not all(isinstance(x, int | float) and not isinstance(x, bool) for x in (base, pixels)):
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
    channel], "high": the same, or null where nothing was thinned, "points": [[θ...], [φ...]] in degrees, "now": the
    newest value of each channel, "tension_n": of each tendon}.
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
        frame["traces"] = [{"key": c.key, "label": c.label, "unit": c.unit} for c in live.channels]
    thinned = thin(new[0], new[1:], view.base_s / view.pixels)
    frame["time"] = np.round(thinned.time, 4)
    frame["low"] = np.round(thinned.low, 3)
    frame["high"] = None if thinned.high is thinned.low else np.round(thinned.high, 3)
    stride = max(1, -(-new.shape[1] // _LISSAJOUS_POINTS))
    frame["points"] = np.round(new[[_DRIVE, _TORSION], ::stride], 2)
    frame["now"] = np.round(new[1:, -1], 3) if new.shape[1] else []
    frame["tension_n"] = live.latest.get("tension_n", [])
    return orjson.dumps(frame, option=orjson.OPT_SERIALIZE_NUMPY)


def state_of(hub: Hub) -> bytes:
    """Return what is going on, as JSON: {"kind": "state", "steward": its status, "live": state of the run}."""
    live = hub.live
    said: dict[str, Any] = {"kind": "state", "steward": hub.steward, "live": None, "trouble": hub.trouble}
    if live is not None:
        said["live"] = {
            "name": live.name,
            "groups": live.groups,
            "groups_done": live.groups_done,
            "segment": live.segment,
            "health": live.health,
            "events": list(live.events)[-12:],
            "doubts": live.doubts,
            "source": live.source,
            "age_s": None if live.seen is None else max(0.0, time.time() - live.seen),
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
    told = -_STATE_S
    due = loop.time()
    while not listening.done():
        frame = frame_of(hub.live, view) if hub.live is not None else None
        if frame is not None:
            await asyncio.wait_for(socket.send_text(frame.decode()), _SEND_S)
        if loop.time() - told >= _STATE_S:
            told = loop.time()
            await asyncio.wait_for(socket.send_text(state_of(hub).decode()), _SEND_S)
        due = max(due + FRAME_S, loop.time())
        await asyncio.sleep(due - loop.time())


async def _listen(socket: WebSocket, view: View) -> None:
    """Take the viewer's wishes; what is none of them ends the connection."""
    while True:
        message = await socket.receive_text()
        try:
            view.change(message)
        except ValueError:
            await socket.close(1008, "not understood")
            return
