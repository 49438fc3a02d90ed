"""The list of runs, their results and their files: made once, kept, and never an exception for a damaged folder."""

from pathlib import Path

import pandas as pd
import pytest
from scipy import io
from tests.unit.bench_journal import RIG_TEXT
from tests.unit.dashboard_journal import DECAY_PER_S, PLAN_TEXT, run_folder

from sinew.apps.dashboard.pages.runs import _row
from sinew.apps.dashboard.work import runs as runs_module
from sinew.apps.dashboard.work.results import download, run_results
from sinew.apps.dashboard.work.runs import look_at_runs, read_run
from sinew.bench.record.journal import Journal
from sinew.measure.errors import FileError, SpecError
from sinew.measure.files.netcdf import load_recording


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_folder(tmp_path_factory.mktemp("runs") / "whole")


def test_why_a_run_has_no_resonance_is_in_its_row(whole: Path) -> None:
    assert _row(look_at_runs(whole.parent)["runs"][0])["resonance_hz"] == "not analysed yet"
    run_results(whole)
    row = _row(look_at_runs(whole.parent)["runs"][0])
    assert row["resonance_hz"] == "too few frequencies for a resonance"
    assert row["untold"].endswith("found 2, expected at least 6; measure more")


def test_a_run_that_was_cut_off_is_stopped_and_says_how_far_it_came(tmp_path: Path) -> None:
    summary = read_run(run_folder(tmp_path / "run", [0, 1]))
    assert (summary["state"], summary["groups_done"]) == ("stopped", 2)


def test_a_run_whose_journal_is_locked_is_running(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    with Journal.create(tmp_path / "run" / "journal.sqlite", PLAN_TEXT, RIG_TEXT):
        state = read_run(tmp_path / "run")["state"]
    assert (state, read_run(tmp_path / "run")["state"]) == ("running", "stopped")


def test_a_damaged_journal_is_a_row_with_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "journal.sqlite").write_bytes(b"SQLite format 3\0" + bytes(200))
    (row,) = look_at_runs(tmp_path)["runs"]
    assert row["state"] == "damaged"
    assert "damaged" in row["sentence"]


def test_a_second_look_opens_no_journal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run_folder(tmp_path / "run", [0, 1])
    first = look_at_runs(tmp_path)["runs"]

    def refuse(path: Path) -> None:
        raise AssertionError(f"{path} was opened again")

    monkeypatch.setattr(runs_module, "summarise_journal", refuse)
    assert look_at_runs(tmp_path)["runs"] == first


def test_results_of_a_journal_hold_curves_and_damping(whole: Path) -> None:
    found = run_results(whole)
    assert [curve["frequency_hz"] for curve in found["curves"]] == [[2.9, 4.3], [2.9, 4.3]]
    assert [row["decay_rate_per_s"]["value"] for row in found["damping"]] == pytest.approx([DECAY_PER_S] * 2, rel=0.02)


def test_results_of_a_run_under_way_are_those_of_its_groups(tmp_path: Path) -> None:
    path = run_folder(tmp_path / "run", [0, 1]) / "journal.sqlite"
    with Journal.open(path, PLAN_TEXT, RIG_TEXT):
        found = run_results(tmp_path / "run")
    assert [curve["frequency_hz"] for curve in found["curves"]] == [[2.9]]
    assert not (tmp_path / "run" / "recording.nc").exists()


def test_a_damaged_recording_is_said_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "recording.nc").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    with pytest.raises(FileError, match="damaged"):
        run_results(tmp_path / "run")


def test_a_downloaded_table_has_a_row_for_each_sample(whole: Path) -> None:
    rows = len(pd.read_csv(download(whole, "csv")))
    assert rows == load_recording(download(whole, "recording")).sizes["sample"]


def test_a_downloaded_matlab_file_reads_back(whole: Path) -> None:
    samples = load_recording(download(whole, "recording")).sizes["sample"]
    assert io.loadmat(download(whole, "mat"))["time_s"].size == samples


@pytest.mark.slow
def test_a_downloaded_report_needs_nothing_beside_itself(whole: Path) -> None:
    page = download(whole, "report").read_text(encoding="utf-8")
    assert "data:image/png;base64" in page


def test_a_run_under_way_gives_no_files(tmp_path: Path) -> None:
    path = run_folder(tmp_path / "run", [0, 1]) / "journal.sqlite"
    with (
        Journal.open(path, PLAN_TEXT, RIG_TEXT),
        pytest.raises(FileError, match="still being recorded"),
    ):
        download(tmp_path / "run", "recording")


def test_a_file_of_no_known_kind_is_refused(whole: Path) -> None:
    with pytest.raises(SpecError, match="expected one of recording, csv, mat, report"):
        download(whole, "../../etc/passwd")
