"""A computer that pauses in the middle of a run for longer than the motors' watchdogs wait, in virtual time."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import xarray as xr
from tests.unit.bench_virtual import VirtualBench, virtual_bench

from sinew.analysis.analysed import analyse_recording
from sinew.bench.record.conversion import recording_from_journal
from sinew.bench.record.journal import Journal, JournalReader
from sinew.bench.record.sample import Sample
from sinew.bench.run import Runner, RunReport
from sinew.bench.stops import Steering
from sinew.hardware.imu import Imu
from sinew.measure.events import Event, Resumed
from sinew.measure.recording import segment_slices
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_plan, dump_rig, load_rig, parse_plan
from sinew.twin.parameters import Effects
from sinew.twin.simulate import rest_tension, simulate

pytestmark = pytest.mark.slow

RIG = load_rig("paper")
PLAN = parse_plan("""
name = "paused"
pretension = { pretension_mm = [2], rest_s = 0.5 }
sweep = { frequency_hz = [2.5, 3], settle_s = 2.5, periods = 3, repeats = 1 }
""")
SHORT = parse_plan("""
name = "paused"
pretension = { pretension_mm = [0], rest_s = 0.2 }
sweep = { frequency_hz = [3], settle_s = 0.5, periods = 2, repeats = 1 }
""")
SWINGING = 1200  # samples in which the lever is away from zero: in the second record, with its settling behind it


class Pauses:
    """Has the computer pause when the lever has swung for so many samples, once for each number; a Listener.

    states: whether the rig was in a safe state a moment before a tendon was pulled anew.
    """

    def __init__(self, bench: VirtualBench, at: Sequence[int], seconds: float) -> None:
        self._bench, self._at, self._seconds = bench, list(at), seconds
        self._swung = 0
        self.events: list[tuple[str, str]] = []
        self.safe: list[bool] = []

    def on_sample(self, sample: Sample) -> None:
        self._swung += sample.drive_command_rad != 0.0 and abs(sample.drive_rad) > 0.05
        if self._at and self._swung >= self._at[0]:
            self._at.pop(0)
            self._swung = 0
            port = self._bench.port
            port.wait_until(port.now() + self._seconds)

    def on_event(self, event: Event) -> None:
        self.events.append((event.kind, str(event)))
        if isinstance(event, Resumed):
            self.safe.append(self._bench.emulated.in_safe_state())


class Paused(NamedTuple):
    report: RunReport
    pauses: Pauses
    bench: VirtualBench
    folder: Path

    def sentences(self, kind: str) -> list[str]:
        return [sentence for each, sentence in self.pauses.events if each == kind]


def rig_with(**limits: object) -> RigSpec:
    return RIG.model_copy(update={"limits": RIG.limits.model_copy(update=limits)})


def paused_run(folder: Path, at: Sequence[int], seconds: float = 0.2, rig: RigSpec = RIG, plan: Plan = SHORT) -> Paused:
    bench = virtual_bench(rig)
    pretensions = plan.pretension.pretension_mm
    tension = dict(zip(pretensions, rest_tension(pretensions, rig).tolist(), strict=True))
    pauses = Pauses(bench, at, seconds)
    steering = Steering(bench.port.now)
    with Journal.create(folder / "journal.sqlite", dump_plan(plan), dump_rig(rig)) as journal:
        runner = Runner(bench.rig, bench.port, plan, journal, tension, listener=pauses, steering=steering)
        return Paused(runner.run(), pauses, bench, folder)


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Paused:
    return paused_run(tmp_path_factory.mktemp("paused"), [SWINGING], plan=PLAN)


@pytest.fixture(scope="module")
def recording(once: Paused) -> xr.Dataset:
    return recording_from_journal(once.folder / "journal.sqlite")


def test_a_run_goes_on_by_itself_in_a_safe_state_and_measures_nothing_again_that_was_whole(once: Paused) -> None:
    assert (once.report.is_complete, len(once.report.pauses)) == (True, 1)
    with JournalReader(once.folder / "journal.sqlite") as journal:
        aborted = [stretch for stretch in journal.stretches() if stretch.state == "aborted"]
        steady = [stretch.planned.frequency_hz for stretch in journal.stretches("kind = 'steady'")]
    assert [("the computer paused" in each.note) for each in aborted] == [True]
    assert steady == [2.5, 3.0, 3.0]
    assert (once.pauses.safe, len(once.sentences("contact"))) == ([True], 2)  # before the tendons were pulled anew


def test_the_recording_has_every_segment_once_and_no_hole(recording: xr.Dataset) -> None:
    steps = [np.diff(recording["time_s"].values[where]).max() for where in segment_slices(recording)]
    assert recording["kind"].values.tolist() == ["idle", "settle", "steady", "settle", "steady"]
    assert max(steps) < 0.0075


def test_gain_and_phase_are_the_twins(recording: xr.Dataset) -> None:
    bench = analyse_recording(recording, RIG)
    twin = analyse_recording(simulate(PLAN, RIG, effects=Effects().without("repeatability")), RIG)
    assert np.abs(bench["gain"].values / twin["gain"].values - 1).max() < 0.02
    assert np.degrees(np.abs(bench["phase_lag_rad"].values - twin["phase_lag_rad"].values)).max() < 2.0


def test_a_computer_that_pauses_again_and_again_ends_the_run(tmp_path: Path) -> None:
    rig = rig_with(resumes_after_pause=1)
    done = paused_run(tmp_path, [20, 20, 20], rig=rig)
    assert (done.report.is_complete, len(done.sentences("hole"))) == (False, 1)
    assert "the run has gone on 1 times before (resumes_after_pause)" in done.report.sentence
    assert done.bench.emulated.in_safe_state()


@pytest.mark.parametrize("state", ["hold", "release"])
def test_a_real_bench_is_left_in_its_declared_state_until_somebody_goes_on(
    state: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Imu, "is_emulated", lambda _: False)
    done = paused_run(tmp_path, [20], rig=rig_with(safe_state=state))
    assert (done.report.is_complete, done.report.is_paused, done.sentences("hole")) == (False, True, [])
    assert done.report.stop is not None
    assert (done.report.stop.declared, done.report.stop.is_safe) == (state, True)


def test_a_real_bench_whose_rig_allows_it_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Imu, "is_emulated", lambda _: False)
    done = paused_run(tmp_path, [20], rig=rig_with(safe_state="hold", resumes_after_pause=1))
    assert (done.report.is_complete, len(done.report.pauses)) == (True, 1)


def test_a_short_pause_ends_nothing(tmp_path: Path) -> None:
    done = paused_run(tmp_path, [20], seconds=0.03)
    assert (done.report.is_complete, done.report.pauses) == (True, [])
