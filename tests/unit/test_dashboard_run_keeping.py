"""Runs are renamed, noted, put into the bin and taken back: whole or not at all, and nothing that is under way."""

import json
import sys
from pathlib import Path

import pytest
from tests.patience import finished
from tests.unit.bench_journal import RIG_TEXT
from tests.unit.dashboard_journal import PLAN_TEXT, run_folder

from sinew.apps.dashboard.access import Access
from sinew.apps.dashboard.operators import RefusedError
from sinew.apps.dashboard.steward import Settings, SteeringCommand, Steward
from sinew.apps.dashboard.work.runs import bin_run, list_bin, list_runs, note_run, rename_run, restore_run
from sinew.bench.record.journal import Journal


def names(runs: Path) -> list[str]:
    return sorted(row["name"] for row in list_runs(runs))


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    run_folder(tmp_path / "old", [0])
    return tmp_path


def test_a_run_that_was_renamed_is_listed_by_its_new_name_alone(runs: Path) -> None:
    assert names(runs) == ["old"]
    assert rename_run(runs, "old", "new") == "the run old is called new now"
    assert names(runs) == ["new"]


@pytest.mark.parametrize("to", ["../out", "rigs", "", ".hidden", "a/b"])
def test_a_name_that_leads_elsewhere_is_refused(runs: Path, to: str) -> None:
    with pytest.raises(RefusedError, match="letters, digits"):
        rename_run(runs, "old", to)
    assert names(runs) == ["old"]


def test_a_name_that_is_taken_is_refused(runs: Path) -> None:
    (runs / "taken").mkdir()
    with pytest.raises(RefusedError, match="there is a run taken already"):
        rename_run(runs, "old", "taken")


@pytest.mark.parametrize("name", ["none", "../old", ".bin"])
def test_what_is_no_run_is_not_put_into_the_bin(runs: Path, name: str) -> None:
    with pytest.raises(RefusedError, match="there is no run"):
        bin_run(runs, name)


def test_a_run_comes_back_from_the_bin_as_it_was(runs: Path) -> None:
    before = (runs / "old" / "journal.sqlite").read_bytes()
    bin_run(runs, "old")
    assert (names(runs), list_bin(runs)) == ([], ["old"])
    restore_run(runs, "old")
    assert (names(runs), list_bin(runs)) == (["old"], [])
    assert (runs / "old" / "journal.sqlite").read_bytes() == before


def test_two_runs_of_one_name_lie_side_by_side_in_the_bin(runs: Path) -> None:
    bin_run(runs, "old")
    run_folder(runs / "old", [0])
    assert bin_run(runs, "old").startswith("the run old lies in the bin as old.2;")
    assert list_bin(runs) == ["old", "old.2"]


def test_a_run_comes_back_beside_whatever_has_its_name(runs: Path) -> None:
    bin_run(runs, "old")
    run_folder(runs / "old", [0])
    assert restore_run(runs, "old") == "the run old is back as old.2: something else has its name"
    assert names(runs) == ["old", "old.2"]


def test_a_bin_that_is_a_link_is_refused(runs: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    (runs / ".bin").symlink_to(tmp_path_factory.mktemp("elsewhere"))
    with pytest.raises(RefusedError, match="no folder of ours"):
        bin_run(runs, "old")


def test_a_run_under_way_is_neither_renamed_nor_put_away(runs: Path) -> None:
    with Journal.open(runs / "old" / "journal.sqlite", PLAN_TEXT, RIG_TEXT):
        with pytest.raises(RefusedError, match="under way"):
            rename_run(runs, "old", "new")
        with pytest.raises(RefusedError, match="under way"):
            bin_run(runs, "old")


def test_notes_and_tags_are_found_by_a_search_at_once(runs: Path) -> None:
    assert list_runs(runs, "tag:aged") == []
    note_run(runs, "old", "after the Move", ["aged", "aged", "first"])
    (row,) = list_runs(runs, "tag:aged move")
    assert (row["notes"], row["tags"]) == ("after the Move", ["aged", "first"])


@pytest.mark.parametrize("letter", ["\x01", "\N{GRINNING FACE}"])
def test_the_longest_notes_are_read_whole(runs: Path, letter: str) -> None:
    tags = [f"{k:0>40}" for k in range(20)]
    note_run(runs, "old", 4000 * letter, tags)
    (row,) = list_runs(runs)
    assert (row["notes"] == 4000 * letter, row["tags"]) == (True, tags)


@pytest.mark.parametrize("tags", [["two words"], ["<b>"], [""], [f"t{k}" for k in range(21)]])
def test_tags_that_a_search_could_not_name_are_refused(runs: Path, tags: list[str]) -> None:
    note_run(runs, "old", "", ["aged"])
    with pytest.raises(RefusedError, match="expected up to 20 tags, each of up to 40 letters"):
        note_run(runs, "old", "the note", tags)
    (row,) = list_runs(runs)
    assert (row["notes"], row["tags"]) == ("the note", ["aged"])


@pytest.mark.parametrize("text", ["{", "[]", '{"notes": 1}', json.dumps({"notes": "x", "tags": 3})])
def test_notes_of_somebody_else_harm_nobody(runs: Path, text: str) -> None:
    (runs / "old" / "notes.json").write_text(text)
    (row,) = list_runs(runs)
    assert (row["notes"], row["tags"], row["state"]) == ("", [], "stopped")


def test_a_note_keeps_the_begin_of_a_run_as_it_was(runs: Path) -> None:
    before = list_runs(runs)[0]["started"]
    note_run(runs, "old", "noted", [])
    assert list_runs(runs)[0]["started"] == before


@pytest.fixture
def steward(runs: Path) -> Steward:
    return Steward(Settings(Access("t" * 20, "127.0.0.1", 8080), 8081, runs))


def told(command: str, **more: str) -> SteeringCommand:
    return SteeringCommand.model_validate({"ticket": "t", "number": 1, "command": command, **more})


def test_the_run_that_was_last_is_told_by_the_name_that_it_has_now(steward: Steward) -> None:
    steward._desk.last = {"name": "old", "folder": "", "started": 1.0}
    steward.keep(told("rename", name="old", to="new"))
    assert steward._desk.last["name"] == "new"
    steward.keep(told("bin", name="new"))
    assert steward._desk.last is None


@pytest.mark.parametrize("command", ["rename", "bin"])
def test_a_run_that_is_being_begun_is_neither_renamed_nor_put_away(steward: Steward, command: str) -> None:
    steward._desk.beginning = "old"
    with pytest.raises(RefusedError, match="under way"):
        steward.keep(told(command, name="old", to="new"))


def test_a_run_does_not_go_on_while_it_is_renamed(steward: Steward, monkeypatch: pytest.MonkeyPatch) -> None:
    refusals = []

    def rename_slowly(runs: Path, name: str, to: str) -> str:
        with pytest.raises(RefusedError) as refusal:
            steward.go_on(name)
        refusals.append(str(refusal.value))
        return rename_run(runs, name, to)

    monkeypatch.setattr("sinew.apps.dashboard.steward.rename_run", rename_slowly)
    steward.keep(told("rename", name="old", to="new"))
    assert "is being renamed" in refusals[0]


def test_a_run_that_could_not_be_renamed_may_go_on(steward: Steward, runs: Path) -> None:
    (runs / "taken").mkdir()
    with pytest.raises(RefusedError, match="there is a run taken already"):
        steward.keep(told("rename", name="old", to="taken"))
    with pytest.raises(RefusedError, match="no bench is connected"):
        steward.go_on("old")


def test_a_note_needs_no_reader_of_recordings(runs: Path) -> None:
    code = f"""
import sys
from pathlib import Path
import sinew.apps.dashboard.steward
from sinew.apps.dashboard.work.runs import note_run
note_run(Path({str(runs)!r}), "old", "soft", ["wet"])
print("xarray" in sys.modules, "pandas" in sys.modules)"""
    assert finished([sys.executable, "-c", code], check=True).stdout.split() == ["False", "False"]
