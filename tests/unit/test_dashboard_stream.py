"""What a viewer is sent: only what is new, thinned to its screen, and never more than it takes."""

import asyncio
import json
import math
import sqlite3
import time as clock
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from starlette.websockets import WebSocket

from sinew.apps.dashboard.hub import MOST_MESSAGE, Hub, Live, Ring, View, frame_of, serve_stream, state_of
from sinew.apps.dashboard.work.samples import Channel, LiveChannels, Readings, alarm_limits
from sinew.bench.record.journal import Journal
from sinew.bench.record.sample import MISSING, Sample
from sinew.measure.events import Contact, Doubted, Ended, Health
from sinew.measure.recording import Segment
from sinew.plan.toml import dump_plan, dump_rig, load_plan, load_rig

RATE = 200.0
CHANNELS = tuple(Channel(key, key, "°") for key in ("drive_command", "drive", "torsion"))


def live(count: int, capacity: int = 5000) -> Live:
    ring = Ring(1 + len(CHANNELS), capacity)
    time = np.arange(count) / RATE
    ring.put(np.vstack([time, *(np.sin(2 * np.pi * 3 * time + c) for c in range(len(CHANNELS)))]))
    return Live("run", 0.0, 1, {}, CHANNELS, ring, "", "", 3, played=count)


def told(frame: bytes | None) -> dict[str, Any]:
    assert frame is not None
    return dict(json.loads(frame))


def test_the_first_frame_holds_no_more_of_the_past_than_the_screen() -> None:
    frame = told(frame_of(live(4000), View(base_s=2.0, pixels=4000)))
    assert frame["time"][-1] - frame["time"][0] == pytest.approx(2.0, abs=2 / RATE)


def test_a_second_frame_holds_only_what_is_new() -> None:
    run, view = live(400), View()
    frame_of(run, view)
    run.ring.put(np.array([[2.0], [1.0], [2.0], [3.0]]))
    run.played += 1
    frame = told(frame_of(run, view))
    assert (frame["reset"], frame["time"], frame["now"]) == (False, [2.0], [1.0, 2.0, 3.0])


def test_a_frame_has_no_more_columns_than_the_screen() -> None:
    frame = told(frame_of(live(4000), View(base_s=20.0, pixels=100)))
    assert len(frame["time"]) <= 101
    assert len(frame["high"][0]) == len(frame["time"])


@pytest.mark.parametrize("message", ["[]", "nonsense", '{"base_s": "x"}', '{"pixels": true}', " " * (MOST_MESSAGE + 1)])
def test_what_no_viewer_says_is_refused(message: str) -> None:
    with pytest.raises(ValueError, match=r"expected|unexpected|invalid"):
        View().change(message)


@given(st.floats(allow_nan=False, allow_infinity=False), st.integers())
def test_whatever_numbers_are_asked_for_the_view_stays_within_bounds(base: float, pixels: int) -> None:
    view = View()
    view.change(json.dumps({"base_s": base, "pixels": pixels})[:MOST_MESSAGE])
    assert 0.5 <= view.base_s <= 60.0
    assert 50 <= view.pixels <= 4000


def sample(index: int, tendons: int = 4, rate: float | None = None) -> Sample:
    t = index / RATE
    torsion_rate = 2 * math.pi * 3 * math.cos(2 * math.pi * 3 * t) if rate is None else rate
    four = (0.1,) * tendons
    return Sample(
        100 + t, 100 + t, 0.1, 0.2, 0.3, 0.2, four, four, four, (torsion_rate, 0.0, 0.0), (9.81, 0.0, 0.0), 0.01, 1e-4
    )  # fmt: skip


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    (tmp_path / "one").mkdir()
    return tmp_path


def journal_of(runs: Path, name: str = "one") -> Journal:
    return Journal.create(runs / name / "journal.sqlite", dump_plan(load_plan("short")), dump_rig(load_rig("paper")))


def put(journal: Journal, indices: range) -> None:
    for i in indices:
        journal.append(sample(i))
    journal.flush()


def hub_at(runs: Path, name: str = "one") -> Hub:
    async def status() -> dict[str, Any]:
        return {"run": {"name": name, "state": "running"}}

    hub = Hub(runs, status)
    hub.steward = asyncio.run(status())
    return hub


def test_samples_of_a_run_reach_the_ring(runs: Path) -> None:
    with journal_of(runs) as journal:
        put(journal, range(100))
        hub = hub_at(runs)
        asyncio.run(hub.tick(0.04))
        assert hub.live is not None
        assert hub.live.ring.count == 100
        put(journal, range(100, 150))
        asyncio.run(hub.tick(0.04))
        assert hub.live.ring.count == 150


class Sink:
    """A socket that takes all it is sent, and says nothing."""

    def __init__(self) -> None:
        self.kinds: list[str] = []

    async def accept(self) -> None:
        pass

    async def send_text(self, text: str) -> None:
        self.kinds.append(json.loads(text)["kind"])

    async def receive_text(self) -> str:
        await asyncio.Event().wait()
        return ""


def test_a_viewer_gets_a_frame_with_each_look_that_finds_samples(runs: Path) -> None:
    async def watch(hub: Hub) -> list[int]:
        sink, counts = Sink(), []
        watching = asyncio.create_task(serve_stream(cast(WebSocket, sink), hub))
        for i in range(5):
            put(journal, range(50 * i, 50 * i + 50))
            await hub.tick(0.04)
            for _ in range(100):  # turns of the loop, not time
                await asyncio.sleep(0)
            counts.append(sink.kinds.count("samples"))
        watching.cancel()
        return counts

    with journal_of(runs) as journal:
        assert asyncio.run(watch(hub_at(runs))) == [1, 2, 3, 4, 5]


HEALTH = Health("running", 7, 0, 0, 0.1, 2.0, {"drive": 31.0}, 12.0, {"retries": 0}, 1.0, 9.0, 0, 2)


def test_events_segment_and_health_are_told(runs: Path) -> None:
    with journal_of(runs) as journal:
        journal.append(sample(0))
        journal.event(Contact.of(current_ma=43.4))
        journal.event(HEALTH)
        journal.event(Doubted("the lever went 3°"))
        journal.event(Doubted("the lever went 3°"))
        journal.begin_segment(0, 0, Segment("steady", 4.0, 3.0, 20.0, 0))
        journal.flush()
        hub = hub_at(runs)
        asyncio.run(hub.tick(0.04))
        said = json.loads(state_of(hub))["live"]
    assert (said["health"]["cycles"], said["health"]["temperature_c"]) == (7, {"drive": 31.0})
    assert [tuple(event[1:3]) for event in said["events"]] == [
        ("note", "first contact at 43 mA"), *2 * [("warning", "the lever went 3°")]
    ]  # fmt: skip
    assert said["doubts"] == ["the lever went 3°"]
    assert (said["segment"]["kind"], said["segment"]["frequency_hz"]) == ("steady", 3.0)


def test_a_new_run_is_followed_instead(runs: Path) -> None:
    hub = hub_at(runs)
    (runs / "two").mkdir()
    with journal_of(runs) as one, journal_of(runs, "two") as two:
        for journal in (one, two):
            journal.append(sample(0))
            journal.flush()
        asyncio.run(hub.tick(0.04))
        hub.steward = {"run": {"name": "two"}}
        asyncio.run(hub.tick(0.04))
    assert hub.live is not None
    assert (hub.live.name, hub.live.epoch, hub.live.ring.count) == ("two", 2, 1)


def rows_of(samples: list[Sample]) -> dict[str, np.ndarray]:
    rows = {
        name: [getattr(s, name) for s in samples]
        for name in ("time_s", "drive_command_rad", "drive_rad", "drive_current_a", "tilt_rad")
    }
    rows["gyro_x_rad_s"] = [s.gyro_rad_s[0] for s in samples]
    rows |= {f"tendon_{i + 1}_current_a": [s.tendon_current_a[i] for s in samples] for i in range(4)}
    return {name: np.array(values, dtype=float) for name, values in rows.items()}


def test_the_live_torsion_is_the_swing_within_two_percent() -> None:
    channels = LiveChannels(load_rig("paper"))
    traces = channels.take(rows_of([sample(i) for i in range(4000)]))
    torsion = traces[2, 2000:]
    assert 0.5 * (torsion.max() - torsion.min()) == pytest.approx(math.degrees(1.0), rel=0.02)
    assert abs(torsion.mean()) < math.degrees(0.02)


def test_a_drift_of_the_gyroscope_does_not_run_away() -> None:
    channels = LiveChannels(load_rig("paper"))
    traces = channels.take(rows_of([sample(i, rate=math.radians(0.1)) for i in range(20_000)]))
    assert abs(traces[2, -1]) < 0.4


def test_a_gap_leaves_the_torsion_where_it_was() -> None:
    channels = LiveChannels(load_rig("paper"))
    samples = [sample(i) for i in range(50)] + [sample(i, rate=MISSING) for i in range(50, 60)]
    torsion = channels.take(rows_of(samples))[2]
    assert np.all(torsion[50:] == torsion[49])


# What alarms are about.


def test_a_peak_is_told_for_a_second_and_then_is_over() -> None:
    tendons = load_rig("paper").tendons

    def traces(first: list[float], tilt: list[float]) -> dict[str, Any]:
        rest = {f"tendon_{i + 1}_current": np.full(len(first), 0.1) for i in range(1, tendons.count)}
        return {"tendon_1_current": np.array(first), **rest, "tilt": np.array(tilt)}

    readings = Readings(tendons)
    readings.take(10.0, traces([0.05, 0.9, np.nan], [0.1, -8.0, np.nan]))
    readings.take(10.5, traces([0.05], [0.2]))
    peak, low = (round(float(tendons.tension(current)), 1) for current in (0.9, 0.1))
    assert readings.document() == {"tension": (peak, "tendon 1"), "tilt": (8.0, "head plate")}
    readings.take(11.2, traces([0.05], [0.2]))
    assert readings.document() == {"tension": (low, "tendon 2"), "tilt": (0.2, "head plate")}


def test_the_tilt_of_a_bent_head_is_counted_from_its_pose() -> None:
    tendons = load_rig("paper").tendons
    readings = Readings(tendons)
    currents = {f"tendon_{i + 1}_current": np.array([0.1]) for i in range(tendons.count)}
    readings.take(
        0.0, {**currents, "tilt": np.array([30.0]), "in_plane": np.array([3.0]), "out_of_plane": np.array([-4.0])}
    )
    assert readings.document()["tilt"] == (5.0, "head plate")


def test_the_hottest_motor_and_the_cycles_missed_within_a_minute_are_read() -> None:
    readings = Readings()
    for now, missed in ((0.0, 2), (30.0, 3), (61.0, 9), (95.0, 9)):
        readings.take_health(now, replace(HEALTH, missed=missed, temperature_c={"drive": 31.0, "tendon 2": 44.0}))
        if now == 61.0:
            assert readings.document() == {"temperature": (44.0, "tendon 2"), "missed": (6.0, "within a minute")}
    assert readings.document()["missed"] == (0.0, "within a minute")


def test_cycles_missed_before_the_last_minute_are_not_counted_when_a_run_is_found(runs: Path) -> None:
    with journal_of(runs) as journal:
        journal.append(sample(0))
        for missed in (0, 40):
            journal.event(replace(HEALTH, missed=missed))
        journal.flush()
        path = runs / "one" / "journal.sqlite"
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("UPDATE events SET date = '2026-01-01T00:00:00+00:00' WHERE id = 1")
    hub = hub_at(runs)
    asyncio.run(hub.tick(0.04))
    assert hub.live is not None
    assert hub.live.readings.document()["missed"][0] == 0.0


def test_alarms_begin_at_nine_tenths_of_what_the_rig_allows() -> None:
    rig = load_rig("paper")
    limits = alarm_limits(rig)
    assert limits["tension"] == {"limit": 0.9 * rig.limits.tension_n, "rig": rig.limits.tension_n}
    assert limits["missed"]["rig"] is None


def test_events_are_told_once_with_their_times_and_what_ended_a_run_early_as_a_stop(runs: Path) -> None:
    with journal_of(runs) as journal:
        journal.append(sample(0))
        journal.event(Ended("the tension is beyond its limit; the tension is let down"))
        journal.flush()
        hub = hub_at(runs)
        asyncio.run(hub.tick(0.04))
        view = View()
        first, second = (json.loads(state_of(hub, view))["live"]["events"] for _ in range(2))
    [(_, severity, _, at, in_run)] = first
    assert (severity, second) == ("stop", None)
    assert abs(at - clock.time()) < 60.0
    assert 0.0 <= in_run < 60.0
