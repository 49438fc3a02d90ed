"""`sinew analyse` of hammer blows, and of a table whose kind it finds out."""

import json
from pathlib import Path

import numpy as np
import pytest
from tests.contracts.commands import answered_with_remarks
from tests.experiments.impacts import Pulse, struck

from sinew.apps.cli import main

COLUMNS = ("--time", "t", "--response", "phi:deg", "--drive", "force:N")
REFERENCE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "json.md"


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("impact") / "blows.csv"
    pulses = [Pulse(0.5 + 5 * k, 1.0, 0.015) for k in range(3)]
    noises = {"force_noise": 0.003, "response_noise": 0.01}
    struck([(3.0, 0.04, 1.0)], pulses, 15.5, np.random.default_rng(1), **noises).to_csv(path, index=False)
    return path


def test_the_document_has_the_keys_of_the_reference_and_the_folder_holds_it_with_its_figure(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ("analyse", table, *COLUMNS, "--kind", "impact", "--out", tmp_path / "out")
    found, _ = answered_with_remarks(capsys, *line)
    page = REFERENCE.read_text(encoding="utf-8")
    sections = page.split("### A broadband record")[1].split("### A recording of Sinew")[0]
    keys = {*found, *found["modes"][0], *found["frequency_response"][0], *found["hits"][0], *found["window"]}
    assert {key for key in keys if f"`{key}`" not in sections} == set()
    assert json.loads((tmp_path / "out" / "analysis.json").read_text(encoding="utf-8")) == found
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"analysis.json", "recording.nc", "impact.png", "impact.pdf"}


def test_without_a_kind_it_is_found_and_said_with_its_reason(table: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found, err = answered_with_remarks(capsys, "analyse", table, *COLUMNS)
    assert found["kind"] == "impact"
    assert found["kind_reason"].startswith("the drive rests but for 3 hits of at most")
    assert "taken for a record of hammer blows: the drive rests but for 3 hits" in err
    assert "`kind_reason`" in REFERENCE.read_text(encoding="utf-8")


def test_a_person_reads_the_hits_and_the_modes(table: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["analyse", str(table), *COLUMNS, "--kind", "impact"]) == 0
    out = capsys.readouterr().out
    assert "hit at/s" in out
    assert "natural frequency/Hz" in out
    assert [line for line in out.splitlines() if len(line) > 100] == []


def test_a_kind_of_a_recording_of_a_table_can_be_said(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["import", str(table), *COLUMNS, "--out", str(tmp_path / "a.nc")]) == 0
    found, _ = answered_with_remarks(capsys, "analyse", tmp_path / "a.nc")
    said, _ = answered_with_remarks(capsys, "analyse", tmp_path / "a.nc", "--kind", "impact")
    assert found.pop("kind_reason")
    assert found == said
