"""The libraries of rigs and plans: what ships with Sinew, what the lab keeps beside its runs, nothing else."""

from pathlib import Path

import pytest

from sinew.apps.dashboard.folders import RefusedError
from sinew.apps.dashboard.work.runs import library, put_in_library, read_library
from sinew.measure.errors import SpecError
from sinew.plan.toml import list_shipped, read_spec


def test_what_ships_is_listed_with_a_line_on_what_it_is() -> None:
    rows = library()["plans"]
    assert [row["name"] for row in rows] == list_shipped("plans")
    assert all(row["ok"] and "mm" in row["about"] for row in rows)


def test_a_file_that_is_no_plan_says_so_in_its_line(tmp_path: Path) -> None:
    (tmp_path / "plans").mkdir()
    (tmp_path / "plans" / "bad.toml").write_text("name = 3", encoding="utf-8")
    row = library(tmp_path)["plans"][-1]
    assert not row["ok"]
    assert "plan" in row["about"]


@pytest.mark.parametrize("name", ["../secret.toml", "/etc/passwd", "..", "a/b.toml", ".hidden.toml", "paper.toml"])
def test_nothing_outside_the_shelves_is_read(name: str, tmp_path: Path) -> None:
    (tmp_path / "secret.toml").write_text("key = 1", encoding="utf-8")
    (tmp_path / "plans").mkdir()
    with pytest.raises(SpecError):
        read_library("plans", name, tmp_path)


def test_what_is_put_in_the_library_is_read_from_it(tmp_path: Path) -> None:
    put_in_library(tmp_path, "plans", "my plan", read_spec("plans", "short"))
    assert library(tmp_path)["plans"][-1]["name"] == "my plan.toml"
    assert read_library("plans", "my plan.toml", tmp_path) == read_spec("plans", "short")


def test_another_of_that_name_is_replaced_only_on_purpose(tmp_path: Path) -> None:
    put_in_library(tmp_path, "rigs", "mine", "old")
    with pytest.raises(RefusedError, match="already; replace it"):
        put_in_library(tmp_path, "rigs", "mine", "new")
    put_in_library(tmp_path, "rigs", "mine.toml", "new", replace=True)
    assert [path.read_text() for path in (tmp_path / "rigs").iterdir()] == ["new"]


@pytest.mark.parametrize("name", ["../secret", "a/b", ".hidden", "", "x" * 90, "ä"])
def test_nothing_is_written_beside_the_library(name: str, tmp_path: Path) -> None:
    (tmp_path / "plans").mkdir()
    (tmp_path / "secret.toml").write_text("kept")
    with pytest.raises(RefusedError, match="for a name"):
        put_in_library(tmp_path, "plans", name, "x")
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["plans", "secret.toml"]


def test_a_library_that_is_no_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "plans").touch()
    with pytest.raises(RefusedError, match=r"cannot write .*mine\.toml"):
        put_in_library(tmp_path, "plans", "mine", "x")


def test_a_library_that_is_a_link_is_not_written(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "plans").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(RefusedError, match="cannot write"):
        put_in_library(tmp_path, "plans", "mine", "x")
    assert list((tmp_path / "elsewhere").iterdir()) == []
