"""A run over Foxglove's web socket, as a client sees it that knows the protocol and nothing of the server's library."""

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.dashboard_journal import run_folder
from websockets.sync.client import ClientConnection, connect

from sinew.bench.record.journal import JournalReader

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")

from sinew.apps.bench.stream import SAMPLES, RunStream

MESSAGE = 1
"""Opcode of a message: then the subscription, 4 bytes, and the time in nanoseconds, 8, little-endian."""


class Viewer:
    """A client of the protocol's version foxglove.sdk.v1: what is advertised, and messages by topic."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self.info = json.loads(socket.recv(5))
        self.channels = {one["topic"]: one for one in json.loads(socket.recv(5))["channels"]}

    def subscribe(self, *topics: str) -> None:
        wanted = [{"id": self.channels[topic]["id"], "channelId": self.channels[topic]["id"]} for topic in topics]
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def send(self, said: Any) -> None:
        self._socket.send(json.dumps(said))

    def messages(self, topic: str, count: int) -> list[tuple[int, dict[str, Any]]]:
        """Return the next messages of a topic, with their times [ns]."""
        found: list[tuple[int, dict[str, Any]]] = []
        while len(found) < count:
            raw = self._socket.recv(5)
            if isinstance(raw, bytes) and raw[0] == MESSAGE:
                number, stamp = struct.unpack_from("<IQ", raw, 1)
                if number == self.channels[topic]["id"]:
                    found.append((stamp, json.loads(raw[13:])))
        return found


@pytest.fixture
def stream(tmp_path: Path) -> Iterator[RunStream]:
    with RunStream(run_folder(tmp_path / "run", [0]) / "journal.sqlite", 0, 0.25) as streamed:
        yield streamed


@pytest.fixture
def viewer(stream: RunStream) -> Iterator[Viewer]:
    # a queue without end: where it is full, nobody reads that the server closes, for ten seconds
    with connect(stream.url, subprotocols=["foxglove.sdk.v1"], max_queue=None) as socket:  # type: ignore[list-item]
        yield Viewer(socket)


def sent(stream: RunStream, viewer: Viewer, *topics: str) -> None:
    """Subscribe, and send what there is once the server has noticed."""
    viewer.subscribe(*topics)
    assert stream.seen(5)
    while stream.look():
        pass


def test_streamed_samples_are_those_of_the_journal(stream: RunStream, viewer: Viewer, tmp_path: Path) -> None:
    sent(stream, viewer, SAMPLES)
    got = [message for _, message in viewer.messages(SAMPLES, 50)]
    with JournalReader(tmp_path / "run" / "journal.sqlite") as reader:
        last = reader.last_sample()
        rows = reader.samples(last - 49, last + 1)
    for name in ("time_s", "drive_rad", "gyro_x_rad_s", "tendon_1_current_a"):
        assert [one[name] for one in got] == rows[name].tolist()


def test_times_of_streamed_messages_follow_the_clock_of_the_run(stream: RunStream, viewer: Viewer) -> None:
    sent(stream, viewer, SAMPLES)
    got = viewer.messages(SAMPLES, 50)
    steps = np.diff([stamp for stamp, _ in got]) * 1e-9
    assert steps == pytest.approx(np.diff([message["time_s"] for _, message in got]), abs=2e-9)


def test_a_stream_listens_on_this_machine_only(stream: RunStream) -> None:
    assert stream.url.startswith("ws://127.0.0.1:")


def test_nothing_of_a_run_is_lost_before_somebody_looks(stream: RunStream, viewer: Viewer) -> None:
    assert stream.look() == 0
    sent(stream, viewer, SAMPLES)
    assert len(viewer.messages(SAMPLES, 50)) == 50


def test_a_second_stream_on_a_port_is_refused_in_words(stream: RunStream, tmp_path: Path) -> None:
    port = int(stream.url.rpartition(":")[2])
    with pytest.raises(Exception, match=f"cannot open a web socket on 127.0.0.1:{port}"):
        RunStream(tmp_path / "run" / "journal.sqlite", port, 1.0)
