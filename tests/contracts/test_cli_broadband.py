"""`sinew analyse --kind broadband`: its document, its files, and what a person reads."""

import json
import re
from pathlib import Path

import pytest
from tests.contracts.commands import answered_with_remarks
from tests.unit.broadband_signals import chirp, shaken

from sinew.apps.cli import main

COLUMNS = ("--kind", "broadband", "--time", "t", "--response", "phi:deg", "--drive", "u:N*m")
REFERENCE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "json.md"


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("chirp") / "chirp.csv"
    shaken(chirp, [(3.0, 0.05, 1.0)], 1).to_csv(path, index=False)
    return path


def test_the_document_has_the_keys_of_the_reference_and_the_folder_holds_it_with_its_figure(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found, _ = answered_with_remarks(capsys, "analyse", table, *COLUMNS, "--out", tmp_path / "out")
    (mode,) = found["modes"]
    section = REFERENCE.read_text(encoding="utf-8").split("### A broadband record")[1].split("###")[0]
    keys = {*found, *mode, *found["frequency_response"][0]}
    assert {key for key in keys if f"`{key}`" not in section} == set()
    assert json.loads((tmp_path / "out" / "analysis.json").read_text(encoding="utf-8")) == found
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"analysis.json", "recording.nc", "broadband.png", "broadband.pdf"}


def test_a_person_reads_frequency_and_damping_of_each_mode(table: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["analyse", str(table), *COLUMNS, "--modes", "1", "--from-hz", "1.5", "--to-hz", "6"]) == 0
    out = capsys.readouterr().out
    assert "natural frequency/Hz" in out
    assert re.search(r"band of the modes/Hz +1\.5 to 6\n", out)
    assert [line for line in out.splitlines() if len(line) > 100] == []
