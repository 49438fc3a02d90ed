"""`sinew identify` on several files: a row and a document for each, what is kept, and what it refuses."""

import json
import shutil
from pathlib import Path

import pytest
from tests.contracts.identify_sweep import COLUMNS, LINEAR, identified, unidentified

from sinew.apps.recordings import identify


def test_each_file_has_what_it_has_alone_and_a_bad_one_says_why(
    sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bad = tmp_path / "bad.csv"
    bad.write_text("t,u,y\n0,1,1\n0.1,1,1\n", encoding="utf-8")
    kept = ("--keep", tmp_path / "kept.sqlite", "--out", tmp_path / "out")
    found = identified(capsys, sweep, bad, *COLUMNS, *LINEAR, *kept)
    alone = identified(capsys, sweep, *COLUMNS, *LINEAR)
    assert (found["identified"], found["refused"]) == (1, 1)
    assert found["files"][0] == {"file": str(sweep), **alone}
    assert "2 samples" in found["files"][1]["refused"]
    assert json.loads((tmp_path / "out" / "0002-bad.json").read_text(encoding="utf-8")) == found["files"][1]

    def computed(*_: object) -> None:
        raise AssertionError("what is kept was computed again")

    monkeypatch.setattr(identify, "_found", computed)
    assert identified(capsys, sweep, bad, *COLUMNS, *LINEAR, *kept) == found


def test_a_file_that_changed_is_identified_anew(
    sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = Path(shutil.copy(sweep, tmp_path / "mine.csv"))
    (tmp_path / "none.csv").write_text("t,u,y\n", encoding="utf-8")
    words = (file, tmp_path / "none.csv", *COLUMNS, *LINEAR, "--keep", tmp_path / "kept.sqlite")
    before = identified(capsys, *words)
    rows = file.read_text(encoding="utf-8").splitlines(keepends=True)
    file.write_text("".join(rows[:1200]), encoding="utf-8")
    assert identified(capsys, *words)["files"][0]["rmse"] != before["files"][0]["rmse"]


def test_a_folder_without_recordings_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "neither NAME.nc nor NAME/recording.nc" in unidentified(capsys, tmp_path)


def test_one_file_is_not_spread(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "are for several files" in unidentified(capsys, sweep, *COLUMNS, "--workers", "2")
