"""The shelves of rigs and plans: what ships with Sinew, what the lab keeps beside its runs, nothing else."""

from pathlib import Path

import pytest

from sinew.apps.dashboard.work.runs import read_shelf, shelf
from sinew.measure.errors import SpecError
from sinew.plan.toml import list_shipped, read_spec


def test_what_ships_is_listed_with_a_line_on_what_it_is() -> None:
    rows = shelf()["plans"]
    assert [row["name"] for row in rows] == list_shipped("plans")
    assert all(row["ok"] and "mm" in row["about"] for row in rows)


def test_the_labs_own_plans_follow(tmp_path: Path) -> None:
    (tmp_path / "plans").mkdir()
    (tmp_path / "plans" / "mine.toml").write_text(read_spec("plans", "short"), encoding="utf-8")
    row = shelf(tmp_path)["plans"][-1]
    assert (row["name"], row["shipped"]) == ("mine.toml", False)
    assert read_shelf("plans", "mine.toml", tmp_path) == read_spec("plans", "short")


def test_a_file_that_is_no_plan_says_so_in_its_line(tmp_path: Path) -> None:
    (tmp_path / "plans").mkdir()
    (tmp_path / "plans" / "bad.toml").write_text("name = 3", encoding="utf-8")
    row = shelf(tmp_path)["plans"][-1]
    assert not row["ok"]
    assert "plan" in row["about"]


@pytest.mark.parametrize("name", ["../secret.toml", "/etc/passwd", "..", "a/b.toml", ".hidden.toml", "paper.toml"])
def test_nothing_outside_the_shelves_is_read(name: str, tmp_path: Path) -> None:
    (tmp_path / "secret.toml").write_text("key = 1", encoding="utf-8")
    (tmp_path / "plans").mkdir()
    with pytest.raises(SpecError):
        read_shelf("plans", name, tmp_path)
