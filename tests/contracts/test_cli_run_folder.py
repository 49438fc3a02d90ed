"""`sinew run`: which folders it refuses to write into, and that it leaves them as they were."""

import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.contracts.emulated_bench import WatchedPort
from tests.contracts.virtual_run import RunHere, run


def occupied(folder: Path) -> None:
    folder.mkdir(parents=True)
    (folder / "journal.sqlite").write_text("a run")


def with_recording(folder: Path) -> None:
    folder.mkdir(parents=True)
    (folder / "recording.nc").write_text("a recording")


def under_a_file(folder: Path) -> None:
    folder.parent.write_text("a file")


UNFIT_FOLDERS: dict[str, tuple[Callable[[Path], object], tuple[str, ...], tuple[str, ...]]] = {
    "run there": (occupied, (), ("holds a run already", "--resume", "another --out")),
    "recording there": (with_recording, (), ("holds a recording.nc", "another --out")),
    "under a file": (under_a_file, (), ("cannot write into", "Not a directory", "--out")),
    "resume without a run": (lambda _: None, ("--resume",), ("found no run to go on with", "leave --resume out")),
}


@pytest.mark.parametrize(("prepare", "options", "words"), UNFIT_FOLDERS.values(), ids=UNFIT_FOLDERS.keys())
def test_an_unfit_folder_is_refused_and_left_as_it_was(
    prepare: Callable[[Path], object],
    options: tuple[str, ...],
    words: tuple[str, ...],
    run_here: RunHere,
    tmp_path: Path,
) -> None:
    prepare(run_here.out)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    run_here.refused(words, *options)
    assert run_here.port.codes == set()
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="a folder that takes no file, whoever asks")
def test_a_folder_that_may_not_be_written_is_refused(
    plan: str, port: WatchedPort, capsys: pytest.CaptureFixture[str]
) -> None:
    told = run(capsys, plan, Path("/proc/out"))
    assert (told.status, told.err.count("\n"), port.codes) == (2, 1, set())
    assert "cannot write into /proc/out" in told.err


def test_a_disk_without_room_for_the_run_is_refused(run_here: RunHere, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=1_000_000))
    run_here.refused(("has 1.0 MB left", "the run writes about", "--out"))
    assert not run_here.out.parent.exists()
