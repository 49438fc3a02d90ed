"""What links in the folder of runs lead to: nothing, neither for a list nor for a result nor for a download."""

import threading
from pathlib import Path

import pytest

from sinew.apps.bench.run_control import CONTROL
from sinew.apps.dashboard.folders import is_run_name, open_inside, unlinked
from sinew.apps.dashboard.run_desk import ending_sentence, running_elsewhere
from sinew.apps.dashboard.work.results import FILES, download, measured_so_far, run_results
from sinew.apps.dashboard.work.runs import library, look_at_runs, read_library
from sinew.bench.record.journal import Journal
from sinew.measure.errors import FileError, SpecError
from sinew.plan.toml import dump_plan, dump_rig, load_plan, load_rig


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    """Give a folder of somebody else with a journal, a recording and a rig."""
    folder = tmp_path / "secret"
    folder.mkdir()
    (folder / "recording.nc").write_text("not for everybody")
    (folder / "rig.toml").write_text(dump_rig(load_rig("paper")))
    with Journal.create(folder / "journal.sqlite", dump_plan(load_plan("short")), dump_rig(load_rig("paper"))):
        pass
    return folder


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    (tmp_path / "runs" / "planted").mkdir(parents=True)
    return tmp_path / "runs"


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("name", ["recording.nc", "journal.sqlite", "results.nc", ".dashboard/recording.mat"])
def test_no_download_follows_a_link(runs: Path, secret: Path, name: str, kind: str) -> None:
    planted = runs / "planted"
    (planted / name).parent.mkdir(exist_ok=True)
    (planted / name).symlink_to(secret / "recording.nc")
    with pytest.raises(FileError, match="is a link, which is not followed"):
        download(planted, kind)


@pytest.mark.parametrize("what", [run_results, lambda folder: measured_so_far(str(folder / "journal.sqlite"))])
def test_no_result_follows_a_link(runs: Path, secret: Path, what: object) -> None:
    (runs / "planted" / "journal.sqlite").symlink_to(secret / "journal.sqlite")
    with pytest.raises(FileError, match="is a link"):
        what(runs / "planted")  # type: ignore[operator]


def test_a_folder_that_is_a_link_is_no_run(runs: Path, secret: Path) -> None:
    (runs / "elsewhere").symlink_to(secret)
    assert look_at_runs(runs)["runs"] == []
    with pytest.raises(FileError, match="is a link"):
        unlinked(runs / "elsewhere")


def test_a_run_with_a_link_is_listed_as_damaged_and_unread(runs: Path, secret: Path) -> None:
    (runs / "planted" / "journal.sqlite").symlink_to(secret / "journal.sqlite")
    (row,) = look_at_runs(runs)["runs"]
    assert (row["state"], row["plan"]) == ("damaged", None)
    assert "is a link" in row["sentence"]


def test_a_rig_that_is_a_link_is_not_in_the_library(runs: Path, secret: Path) -> None:
    (runs / "rigs").mkdir()
    (runs / "rigs" / "mine.toml").symlink_to(secret / "rig.toml")
    with pytest.raises(SpecError, match="there is no mine"):
        read_library("rigs", "mine.toml", runs)
    assert [row["ok"] for row in library(runs)["rigs"] if row["name"] == "mine.toml"] == [False]


def test_a_run_with_a_link_is_not_taken_for_one_under_way(runs: Path, secret: Path) -> None:
    (runs / "planted" / CONTROL).write_text("somewhere")
    (runs / "planted" / "plan.toml").symlink_to(secret / "recording.nc")
    asked: list[object] = []
    assert running_elsewhere(runs, lambda *given, **_: asked.append(given) or {}) is None
    assert asked == []


def test_what_a_run_said_is_not_read_through_a_link(runs: Path, secret: Path) -> None:
    (runs / "planted" / "run.log").symlink_to(secret / "recording.nc")
    assert ending_sentence(runs / "planted") is None


@pytest.mark.parametrize(
    "path", ["link/secret", "planted/link", "planted/../../secret/recording.nc", "planted", "none"]
)
def test_a_file_is_opened_through_no_link(runs: Path, secret: Path, path: str) -> None:
    (runs / "link").symlink_to(secret)
    (runs / "planted" / "link").symlink_to(secret / "recording.nc")
    with pytest.raises(FileError):
        open_inside(runs, runs / path)


def test_a_file_that_is_exchanged_for_a_link_while_it_is_opened_leaks_nothing(runs: Path, secret: Path) -> None:
    place, over = runs / "planted", threading.Event()

    def exchange() -> None:
        while not over.is_set():
            (place / "new").write_text("ours")
            (place / "new").replace(place / "recording.nc")
            (place / "new").symlink_to(secret / "recording.nc")
            (place / "new").replace(place / "recording.nc")

    thread = threading.Thread(target=exchange)
    thread.start()
    read: set[bytes] = set()
    for _ in range(2000):
        try:
            with open_inside(runs, place / "recording.nc") as file:
                read.add(file.read())
        except FileError:
            continue
    over.set()
    thread.join()
    assert read <= {b"ours", b""}


@pytest.mark.parametrize("name", ["rigs", "plans", "Plans"])
def test_a_run_is_not_called_like_a_library(name: str, runs: Path) -> None:
    assert not is_run_name(name)
    (runs / name).mkdir()
    (runs / name / "recording.nc").write_text("x")
    assert look_at_runs(runs)["runs"] == []
