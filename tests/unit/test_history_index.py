"""The index of runs: only what changed is read, whatever lies in the folder, by one process or two."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from tests.experiments.run_index import make_runs

from sinew.analysis.runs import INDEX, RunIndex
from sinew.apps.dashboard.work.runs import index_of, look_at_runs
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
    RunIndex(runs, look, reader).refresh()
    return reader.read


def test_only_what_is_new_or_changed_is_read_and_what_was_deleted_is_gone(tmp_path: Path) -> None:
    runs, reader = folder_of(tmp_path, "a", "b"), Reader()
    assert refreshed(runs, reader) == ["a", "b"]
    assert refreshed(runs, reader) == []
    (runs / "b" / "file").write_text("22")
    assert refreshed(runs, reader) == ["b"]
    shutil.rmtree(runs / "a")
    assert refreshed(runs, reader) == []
    assert [row["name"] for row in RunIndex(runs, look, reader).search()] == ["b"]


def test_a_run_that_is_under_way_is_read_every_time(tmp_path: Path) -> None:
    runs, read = folder_of(tmp_path, "a"), []
    opened = RunIndex(runs, look, lambda folder: {"state": "running", "found": read.append(folder) or []})
    opened.refresh()
    opened.refresh()
    assert len(read) == 2


def test_a_broken_run_is_a_row_that_says_why(tmp_path: Path) -> None:
    runs = folder_of(tmp_path, "a", "b")
    (runs / "a" / "file").write_text("bad")
    opened = RunIndex(runs, look, Reader())
    opened.refresh()
    rows = {row["name"]: (row["state"], row.get("sentence")) for row in opened.search()}
    assert rows == {"a": ("damaged", "this is broken"), "b": ("complete", None)}


@pytest.mark.parametrize(
    "content",
    [b"no JSON at all, but text", b"[1, 2]", b"\xff", b'{"version": 1, "runs": {}}', b'{"version": 3, "runs": 3}'],
)
def test_an_index_that_is_damaged_or_of_another_version_is_made_anew(tmp_path: Path, content: bytes) -> None:
    runs = folder_of(tmp_path, "a")
    (runs / INDEX).write_bytes(content)
    assert refreshed(runs, Reader()) == ["a"]
    assert refreshed(runs, Reader()) == []


def test_what_was_broken_for_a_moment_is_read_again(tmp_path: Path) -> None:
    runs = folder_of(tmp_path, "a")
    answers: list[OSError | dict[str, Any]] = [OSError("too many open files"), {"state": "complete", "found": []}]

    def read(_: Path) -> dict[str, Any]:
        answer = answers.pop(0)
        if isinstance(answer, OSError):
            raise answer
        return answer

    opened = RunIndex(runs, look, read)
    for _ in range(3):
        opened.refresh()
    assert answers == []


def test_a_folder_whose_name_is_no_text_is_left_out_and_counted(tmp_path: Path) -> None:
    runs = folder_of(tmp_path, "a", os.fsdecode(b"caf\xe9"))
    opened = RunIndex(runs, look, Reader())
    assert (opened.refresh(), len(opened.search())) == (1, 1)


def test_a_run_is_found_by_a_pretension_at_which_nothing_could_be_determined(tmp_path: Path) -> None:
    make_runs(tmp_path, 1)
    (path,) = tmp_path.glob("*/results.nc")
    results = load_dataset(path).load()
    at = float(results["pretension_mm"][0])
    bare = results.where(results["pretension_mm"] != at)
    save_dataset(bare.assign_attrs(results.attrs), path)
    (row,) = look_at_runs(tmp_path, f"pretension={at:g}")["runs"]
    assert row["found"] == [{"pretension_mm": at}]


def test_an_index_that_is_a_link_is_replaced_and_not_written_through(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").write_text("mine")
    (tmp_path / "runs").mkdir()
    runs = folder_of(tmp_path / "runs", "a")
    (runs / INDEX).symlink_to(tmp_path / "elsewhere")
    assert refreshed(runs, Reader()) == ["a"]
    assert (tmp_path / "elsewhere").read_text() == "mine"


def test_what_is_not_read_in_time_is_left_for_the_next_look(tmp_path: Path) -> None:
    runs, reader = folder_of(tmp_path, "a", "b"), Reader()
    opened = RunIndex(runs, look, reader)
    assert opened.refresh(most_s=-1.0) == 2
    assert opened.refresh() == 0


def test_two_processes_at_once_index_every_run_once(tmp_path: Path) -> None:
    make_runs(tmp_path / "runs", 12)
    program = """if True:
        import sys
        from sinew.apps.dashboard.work.runs import index_of
        index = index_of(sys.argv[1])
        index.refresh()
        print(len(index.search()))
    """
    command = [sys.executable, "-c", program, str(tmp_path / "runs")]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    assert [int(one.communicate()[0]) for one in both] == [12, 12]
    assert len(index_of(tmp_path / "runs").search()) == 12


def test_results_that_were_cut_short_are_a_damaged_row(tmp_path: Path) -> None:
    make_runs(tmp_path, 1)
    path = tmp_path / "run-0000" / "results.nc"
    os.truncate(path, path.stat().st_size // 2)
    (row,) = look_at_runs(tmp_path)["runs"]
    assert row["state"] == "damaged"
    assert "results.nc" in row["sentence"]
