"""`sinew export --to latex` and `csv` of what other commands left."""

import csv
import io
import json
from pathlib import Path

import pytest

from sinew.apps.cli import main

QUANTITY = {"value": 3.0123, "std": 0.0021, "interval90": [3.009, 3.016]}
FORCED = {
    "levels": [
        {
            "level": 1.0,
            "amplitude": [0.1, 0.2],
            "band": {"peak": {"frequency_hz": QUANTITY}},
            "folds": [{"frequency_hz": QUANTITY}],
        }
    ]
}


@pytest.mark.parametrize("name", ["analysis.json", "fit.json", "prediction.json"])
def test_the_folder_of_a_command_is_a_table(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / name).write_text(json.dumps({"modes": [{"natural_frequency_hz": QUANTITY}]}), encoding="utf-8")
    assert main(["export", str(tmp_path), "--to", "latex"]) == 0
    assert "3.0123(21)" in capsys.readouterr().out


def test_a_forced_prediction_has_its_peaks_and_folds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "prediction.json").write_text(json.dumps(FORCED), encoding="utf-8")
    assert main(["export", str(tmp_path), "--part", "levels", "--to", "csv"]) == 0
    [peaks] = csv.DictReader(io.StringIO(capsys.readouterr().out))
    assert (peaks["level"], peaks["band_peak_frequency_hz_std"]) == ("1.0", "0.0021")
    assert main(["export", str(tmp_path), "--part", "levels_folds", "--to", "csv"]) == 0
    [folds] = csv.DictReader(io.StringIO(capsys.readouterr().out))
    assert (folds["level"], folds["frequency_hz"]) == ("1.0", "3.0123")


def test_a_folder_of_two_documents_is_refused_by_their_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("fit.json", "prediction.json"):
        (tmp_path / name).write_text("{}", encoding="utf-8")
    assert main(["export", str(tmp_path), "--to", "latex"]) == 2
    assert "fit.json and prediction.json" in capsys.readouterr().err
