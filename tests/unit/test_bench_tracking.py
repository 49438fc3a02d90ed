"""A drive law in the bench's cycle: what it may not do, what is kept of it, and how it ends."""

import math
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.unit.bench_virtual import VirtualBench, virtual_bench

from sinew.bench.group import MOVE_SPEED, DriveLaw
from sinew.bench.record.conversion import recording_from_journal
from sinew.bench.record.journal import Journal, JournalReader
from sinew.bench.run import Runner, RunReport
from sinew.measure.events import Track as State
from sinew.plan.plan import Group, Plan, Pretension, Track
from sinew.plan.toml import dump_plan, dump_rig, load_rig
from sinew.twin.simulate import rest_tension

SPEC = load_rig("paper")
TRACK = Track(amplitude_deg=(5.0,), low_hz=1, high_hz=6, duration_s=2, pretension_to_mm=3, lead_s=0.5, tail_s=0.5)
PLAN = Plan(name="law", pretension=Pretension(pretension_mm=(2.0,), rest_s=0.5), track=TRACK)


class Greedy:
    """Wants far more than it may: 60° at 1 Hz, and all the pretension at once."""

    def __init__(self, begin: float) -> None:
        self.begin = begin
        self.pretension_mm = 50.0
        self.taken: list[tuple[float, ...]] = []
        self.asked_last = math.nan

    def command(self, time: float) -> float:
        self.asked_last = time
        return math.radians(60.0) * math.sin(math.tau * (time - self.begin))

    def take(self, now: float, lever_time: float, lever: float, rate_time: float, rate: float) -> None:
        self.taken.append((now, lever_time, lever, rate_time, rate))

    def tell(self) -> State:
        return State(0.005 * len(self.taken), len(self.taken) > 200, False, 1.0)


class Broken(Greedy):
    """Fails after a second."""

    def take(self, now: float, lever_time: float, lever: float, rate_time: float, rate: float) -> None:
        super().take(now, lever_time, lever, rate_time, rate)
        if now - self.begin > 1.0:
            raise ZeroDivisionError


def run(folder: Path, law: type[Greedy]) -> tuple[VirtualBench, Runner, list[Greedy]]:
    bench, laws = virtual_bench(SPEC), []

    def make(group: Group, time: float) -> DriveLaw:
        assert group.kind == "tracking"
        laws.append(law(time))
        return laws[-1]

    tension = dict(zip((2.0, 3.0), rest_tension((2.0, 3.0), SPEC).tolist(), strict=True))
    with Journal.create(folder / "journal.sqlite", dump_plan(PLAN), dump_rig(SPEC)) as journal:
        runner = Runner(bench.rig, bench.port, PLAN, journal, tension, law=make)
        if law is Greedy:
            runner.run()
        else:
            with pytest.raises(ZeroDivisionError):
                runner.run()
    return bench, runner, laws


@pytest.fixture(scope="module")
def greedy(tmp_path_factory: pytest.TempPathFactory) -> tuple[VirtualBench, RunReport, Greedy, xr.Dataset, Path]:
    folder = tmp_path_factory.mktemp("greedy")
    bench, runner, (law,) = run(folder, Greedy)
    path = folder / "journal.sqlite"
    return bench, runner.report, law, recording_from_journal(path), path


Run = tuple[VirtualBench, RunReport, Greedy, xr.Dataset, Path]


def test_the_whole_motion_is_one_tracking_segment_of_the_recording(greedy: Run) -> None:
    recording = greedy[3]
    (segment,) = np.flatnonzero(recording["kind"].values == "tracking")
    assert recording["row_size"].values[segment] == round(TRACK.motion_s * PLAN.sample_hz)
    assert recording["pretension_mm"].values[segment] == 2.0
    assert recording["amplitude_deg"].values[segment] == 5.0
    assert np.isnan(recording["frequency_hz"].values[segment])


def test_the_command_stays_within_the_rigs_largest_amplitude(greedy: Run) -> None:
    largest = np.abs(greedy[3]["drive_command_rad"].values).max()
    assert np.degrees(largest) == pytest.approx(SPEC.limits.drive_amplitude_deg)


def test_the_pretension_stays_within_its_range_and_below_its_speed(greedy: Run) -> None:
    with JournalReader(greedy[4]) as journal:
        (stretch,) = [stretch for stretch in journal.stretches() if stretch.kind == "tracking"]
        assert stretch.end is not None
        table = journal.samples(stretch.first, stretch.end)
    radius = SPEC.tendons.pulley_radius.value
    taken_up = 1e3 * radius * np.mean([table[f"tendon_{i}_goal"] for i in (1, 2, 3, 4)], axis=0)
    assert taken_up[-1] - taken_up[0] == pytest.approx(1.0, abs=0.02)
    # Goals are whole counts, with the nearest sum of all four: a mean is off by an eighth of a count at most.
    step, count = 1e3 * MOVE_SPEED / PLAN.sample_hz, 1e3 * radius * math.tau / SPEC.tendons.counts_per_turn.value
    for cycles in (1, 10, 100):
        assert (taken_up[cycles:] - taken_up[:-cycles]).max() <= cycles * step + count / 4 + 1e-6
    assert 1e3 * greedy[0].emulated.plant.pretension < 3.05  # type: ignore[attr-defined]


def test_the_law_hears_of_every_cycle(greedy: Run) -> None:
    law, recording = greedy[2], greedy[3]
    assert len(law.taken) == round(TRACK.motion_s * PLAN.sample_hz)
    rows = np.array(law.taken)
    assert 0.5 < law.asked_last - law.taken[-1][0] < 0.67  # for so long the lever fades out of the motion
    assert np.isfinite(rows).all()
    (segment,) = np.flatnonzero(recording["kind"].values == "tracking")
    sizes = recording["row_size"].values
    mine = slice(int(sizes[:segment].sum()), int(sizes[: segment + 1].sum()))
    assert recording["drive_rad"].values[mine] == pytest.approx(rows[:, 2], abs=1e-6)


def test_the_state_and_the_lock_are_in_the_journal_and_it_ends_in_the_safe_state(greedy: Run) -> None:
    with JournalReader(greedy[4]) as journal:
        events = [event for _, event in journal.events()]
    assert sum(isinstance(event, State) for event in events) == 6  # twice a second
    assert [str(event) for event in events if event.kind == "lock"] == ["locked at 1.000 Hz, 1.0 s after the start"]
    bench, report = greedy[:2]
    assert report.tracks == {1: greedy[2].tell()}
    assert (report.is_complete, report.stop is not None and report.stop.is_safe) == (True, True)
    assert bench.emulated.in_safe_state()


def test_a_law_that_fails_leaves_the_bench_in_its_safe_state(tmp_path: Path) -> None:
    bench, runner, _ = run(tmp_path, Broken)
    assert bench.emulated.in_safe_state()
    assert [state.torque for state in bench.emulated.states().values()] == [False] * 5
    assert "ZeroDivisionError" in runner.report.sentence
    with JournalReader(tmp_path / "journal.sqlite") as journal:
        (stretch,) = [stretch for stretch in journal.stretches() if stretch.kind == "tracking"]
    assert stretch.state == "aborted"
