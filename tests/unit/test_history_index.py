"""The index of runs: only what changed is read, whatever lies in the folder, by one process or two."""

import math
import os
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from benchmarks.run_index import make_runs

from sinew.analysis import run_index as index_module
from sinew.analysis.run_index import INDEX, Refreshed, RunIndex
from sinew.apps.dashboard.work.runs import index_of, list_runs, read_run
from sinew.measure.errors import FileError
from sinew.measure.files.netcdf import load_dataset, save_dataset


def folder_of(tmp_path: Path, *names: str) -> Path:
    for name in names:
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text("1")
    return tmp_path


def look(folder: Path) -> str | None:
    file = folder / "file"
    return f"{file.stat().st_size} {file.stat().st_ino}" if file.exists() else None


class Reader:
    """Reads folders and counts which."""

    def __init__(self) -> None:
        self.read: list[str] = []

    def __call__(self, folder: Path) -> dict[str, Any]:
        self.read.append(folder.name)
        text = (folder / "file").read_text()
        if text == "bad":
            raise RuntimeError("this is broken")
        return {"name": folder.name, "started": "2026", "notes": text, "state": "complete", "found": []}


def refreshed(runs: Path, reader: Reader) -> list[str]:
    """Return the names that a refresh reads."""
    reader.read.clear()
    with RunIndex(runs, look, reader) as opened:
        opened.refresh()
    return reader.read


def test_a_second_look_reads_nothing(tmp_path: Path) -> None:
    runs, reader = folder_of(tmp_path, "a", "b"), Reader()
    assert refreshed(runs, reader) == ["a", "b"]
    assert refreshed(runs, reader) == []


def test_only_what_changed_is_read_again(tmp_path: Path) -> None:
    runs, reader = folder_of(tmp_path, "a", "b"), Reader()
    refreshed(runs, reader)
    (runs / "b" / "file").write_text("22")
    assert refreshed(runs, reader) == ["b"]


def test_a_run_that_was_deleted_is_gone(tmp_path: Path) -> None:
    runs, reader = folder_of(tmp_path, "a", "b"), Reader()
    refreshed(runs, reader)
    shutil.rmtree(runs / "a")
    with RunIndex(runs, look, reader) as opened:
        assert opened.refresh().gone == 1
        assert [row["name"] for row in opened.search()] == ["b"]


def test_a_run_that_is_under_way_is_read_every_time(tmp_path: Path) -> None:
    runs = folder_of(tmp_path, "a")
    with RunIndex(runs, look, lambda folder: {"state": "running", "found": []}) as opened:
        assert [opened.refresh().read, opened.refresh().read] == [1, 1]


def test_a_broken_run_is_a_row_that_says_why(tmp_path: Path) -> None:
    runs = folder_of(tmp_path, "a", "b")
    (runs / "a" / "file").write_text("bad")
    with RunIndex(runs, look, Reader()) as opened:
        opened.refresh()
        rows = {row["name"]: (row["state"], row.get("sentence")) for row in opened.search()}
    assert rows == {"a": ("damaged", "this is broken"), "b": ("complete", None)}


@pytest.mark.parametrize("content", [b"no database at all, but text", b"SQLite format 3\0" + bytes(500)])
def test_an_index_that_is_damaged_is_made_anew(tmp_path: Path, content: bytes) -> None:
    runs = folder_of(tmp_path, "a")
    (runs / INDEX).mkdir()
    (runs / INDEX / "runs.sqlite").write_bytes(content)
    assert refreshed(runs, Reader()) == ["a"]
    assert refreshed(runs, Reader()) == []


def test_an_index_of_another_version_is_made_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = folder_of(tmp_path, "a")
    refreshed(runs, Reader())
    monkeypatch.setattr(index_module, "_VERSION", 999)
    assert refreshed(runs, Reader()) == ["a"]


def test_an_index_that_is_a_folder_is_done_without(tmp_path: Path) -> None:
    runs = folder_of(tmp_path, "a")
    (runs / INDEX / "runs.sqlite").mkdir(parents=True)
    assert refreshed(runs, Reader()) == ["a"]


def test_an_index_that_somebody_holds_is_said_in_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = folder_of(tmp_path, "a")
    monkeypatch.setattr(index_module, "_BUSY_S", 0.0)
    with RunIndex(runs, look, Reader()) as opened, closing(sqlite3.connect(runs / INDEX / "runs.sqlite")) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(FileError, match="locked"):
            opened.refresh()


def test_what_was_broken_for_a_moment_is_read_again(tmp_path: Path) -> None:
    runs = folder_of(tmp_path, "a")
    answers: list[OSError | dict[str, Any]] = [OSError("too many open files"), {"state": "complete", "found": []}]

    def read(_: Path) -> dict[str, Any]:
        answer = answers.pop(0)
        if isinstance(answer, OSError):
            raise answer
        return answer

    with RunIndex(runs, look, read) as opened:
        assert [opened.refresh().read for _ in range(3)] == [1, 1, 0]


def test_a_folder_whose_name_is_no_text_is_left_out_and_counted(tmp_path: Path) -> None:
    runs = folder_of(tmp_path, "a", os.fsdecode(b"caf\xe9"))
    with RunIndex(runs, look, Reader()) as opened:
        assert opened.refresh() == Refreshed(read=1, kept=0, gone=0, left=1)


def test_a_run_is_found_by_a_pretension_at_which_nothing_could_be_determined(tmp_path: Path) -> None:
    make_runs(tmp_path, 1)
    (path,) = tmp_path.glob("*/results.nc")
    results = load_dataset(path).load()
    at = float(results["pretension_mm"][0])
    bare = results.where(results["pretension_mm"] != at)
    save_dataset(bare.assign_attrs(results.attrs), path)
    (row,) = list_runs(tmp_path, f"pretension={at:g}")
    assert row["found"] == [{"pretension_mm": at}]


def test_what_was_found_at_a_pretension_that_is_no_number_is_left_out(tmp_path: Path) -> None:
    runs = folder_of(tmp_path, "a")
    found = [{"pretension_mm": math.nan}, {"pretension_mm": 4.0}]
    with RunIndex(runs, look, lambda folder: {"state": "complete", "found": found}) as opened:
        opened.refresh()
        assert [one["pretension_mm"] for one in opened.search()[0]["found"]] == [4.0]


def test_an_index_that_is_a_link_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "runs").mkdir()
    runs = folder_of(tmp_path / "runs", "a")
    (runs / INDEX).symlink_to(tmp_path / "elsewhere")
    assert refreshed(runs, Reader()) == ["a"]
    assert not any((tmp_path / "elsewhere").iterdir())


def test_what_is_not_read_in_time_is_left_for_the_next_look(tmp_path: Path) -> None:
    runs, reader = folder_of(tmp_path, "a", "b"), Reader()
    with RunIndex(runs, look, reader) as opened:
        assert opened.refresh(most_s=-1.0).left == 2
        assert opened.refresh().left == 0


def test_two_processes_at_once_index_every_run_once(tmp_path: Path) -> None:
    make_runs(tmp_path / "runs", 12)
    program = """if True:
        import sys
        from sinew.apps.dashboard.work.runs import index_of
        with index_of(sys.argv[1]) as index:
            index.refresh()
            print(index.count())
    """
    command = [sys.executable, "-c", program, str(tmp_path / "runs")]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    assert [int(one.communicate()[0]) for one in both] == [12, 12]
    with index_of(tmp_path / "runs") as opened:
        assert (opened.refresh().read, opened.count()) == (0, 12)


def test_results_alone_tell_resonance_damping_and_gain(tmp_path: Path) -> None:
    make_runs(tmp_path, 1)
    row = read_run(tmp_path / "run-0000")
    assert (row["rig"], row["source"], row["analysed"]) == ("bench", "bench", True)
    assert [set(one) >= {"resonance_hz", "damping_ratio", "gain_peak"} for one in row["found"]] == [True, True]


def test_results_that_were_cut_short_are_a_damaged_row(tmp_path: Path) -> None:
    make_runs(tmp_path, 1)
    path = tmp_path / "run-0000" / "results.nc"
    os.truncate(path, path.stat().st_size // 2)
    (row,) = list_runs(tmp_path)
    assert row["state"] == "damaged"
    assert "results.nc" in row["sentence"]
