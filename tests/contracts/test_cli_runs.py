"""`sinew runs`: a folder of runs as a table, by search, and as a trend that is drawn."""

from pathlib import Path

import pytest
from tests.contracts.commands import answered, refused
from tests.experiments.run_index import FALLS_HZ, make_runs

from sinew.apps.cli import main


@pytest.fixture(scope="module")
def year(tmp_path_factory: pytest.TempPathFactory) -> Path:
    runs = tmp_path_factory.mktemp("year")
    make_runs(runs, 12)
    return runs


def test_a_search_lists_the_runs_that_meet_it(year: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = answered(capsys, "runs", year, "--search", "f_r=3.. pretension=6 aged")
    assert [run["name"] for run in found["runs"]] == ["run-0010", "run-0000"]
    assert {row["pretension_mm"] for run in found["runs"] for row in run["found"]} == {6.0}


def test_a_known_ageing_lies_in_the_interval_of_the_trend(year: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = answered(capsys, "runs", year, "--trend", "f_r", "--search", "pretension=6")
    (trend,) = found["trends"]
    low, high = trend["slope_per_month"]["interval90"]
    assert low < -FALLS_HZ < high
    assert trend["differs_from_zero"] is True


@pytest.mark.parametrize("ending", ["svg", "html"])
def test_a_trend_is_drawn_and_says_its_sentence(year: Path, tmp_path: Path, ending: str) -> None:
    out = tmp_path / f"trend.{ending}"
    assert main(["runs", str(year), "--trend", "gain", "--out", str(out)]) == 0
    assert [path.name for path in tmp_path.iterdir()] == [out.name]
    assert ("<svg" if ending == "svg" else "gain at 6 mm") in out.read_text(encoding="utf-8")


def test_wrong_input_is_one_sentence(year: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "is f_r meant" in refused(capsys, "runs", year, "--search", "f_q=3..")
    assert "expected one of f_r" in refused(capsys, "runs", year, "--trend", "beauty")
    assert "there is no folder" in refused(capsys, "runs", tmp_path / "none")
    assert "--trend" in refused(capsys, "runs", year, "--out", tmp_path / "x.svg")
