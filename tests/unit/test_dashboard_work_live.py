"""The results of a run under way: each group is analysed once, and the end is what the whole recording says."""

from pathlib import Path

import pytest
from tests.unit.bench_journal import RIG_TEXT, write_group
from tests.unit.dashboard_journal import DECAY_PER_S, PLAN, PLAN_TEXT, run_folder, swing

from sinew.apps.dashboard.work.results import LiveResults, run_results
from sinew.bench.record import conversion
from sinew.bench.record.journal import Journal


def test_a_group_appears_when_it_is_finished_while_the_run_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    seen = []
    with Journal.create(path, PLAN_TEXT, RIG_TEXT) as journal:
        live = LiveResults(path)
        for index in range(3):
            write_group(journal, index, swing(index), plan=PLAN)
            journal.flush()
            seen.append([curve["frequency_hz"] for curve in live.update()["curves"]])
    assert seen == [[], [[2.9]], [[2.9, 4.3]]]


def test_every_group_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    read = conversion.recording_from_journal

    def counting(path: Path, groups: set[int]) -> object:
        asked.extend(groups)
        return read(path, groups)

    monkeypatch.setattr(conversion, "recording_from_journal", counting)
    live = LiveResults(run_folder(tmp_path / "run") / "journal.sqlite", most_at_once=5)
    while live.update()["pending"]:
        pass
    live.update()
    moved = [i for i, group in enumerate(PLAN.groups()) if group.kind != "idle"]
    assert sorted(asked) == moved


def test_group_by_group_is_what_the_whole_recording_says(tmp_path: Path) -> None:
    folder = run_folder(tmp_path / "run")
    live = LiveResults(folder / "journal.sqlite", most_at_once=3)
    while live.update()["pending"]:
        pass
    piecewise, whole = live.update(), run_results(folder)
    for name, close in (("gain_measured_drive", {"rel": 1e-4}), ("phase", {"abs": 0.02})):
        assert [one["value"] for curve in piecewise["curves"] for one in curve[name]] == pytest.approx(
            [one["value"] for curve in whole["curves"] for one in curve[name]], **close
        )


def test_the_decay_rate_lies_inside_its_interval(tmp_path: Path) -> None:
    found = LiveResults(run_folder(tmp_path / "run") / "journal.sqlite").update()
    rates = [row["decay_rate_per_s"] for row in found["damping"]]
    assert len(rates) == 2
    assert all(rate["value"] == pytest.approx(DECAY_PER_S, rel=0.02) for rate in rates)


def test_a_group_that_is_measured_again_replaces_what_it_said(tmp_path: Path) -> None:
    path = run_folder(tmp_path / "run", [0, 1]) / "journal.sqlite"
    live = LiveResults(path)
    live.update()
    with Journal.open(path, PLAN_TEXT, RIG_TEXT) as journal:
        write_group(journal, 1, swing(1), attempt=1, plan=PLAN)
    (curve,) = live.update()["curves"]
    assert curve["repeats"] == [1]
