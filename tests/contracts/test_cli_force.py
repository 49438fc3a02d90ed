"""Files that exist: no command replaces one without --force, save its own earlier output in its own folder."""

import json
import math
from pathlib import Path

import pytest
import typer
from tests.contracts.commands import refused

from sinew.apps.cli import app, main
from sinew.apps.console import NumbersCommand

IMPORT = ("import", "decay.csv", "--kind", "ring-down", "--time", "time_s", "--response", "angle_deg")
WRITES: dict[str, tuple[tuple[str, ...], str]] = {
    "import": (IMPORT, "there.nc"),
    "export": (("export", "decay.nc", "--to", "csv"), "there.csv"),
    "simulate": (("simulate", "short"), "there.nc"),
    "model": (("model", "paper"), "there.xml"),
    "joint": (("joint", "--section", "circle", "--outer-mm", "60"), "there.toml"),
    "predict": (("predict", "paper"), "there.toml"),
    "pose": (("pose", "paper"), "there.png"),
    "modes": (("modes", "paper"), "there.html"),
    "calibrate": (("calibrate", "paper", "decay.nc"), "there.toml"),
    "runs": (("runs", ".", "--trend", "f_r"), "there.svg"),
    "emulate": (("emulate", "--link", "link", "--for", "0.1"), "there.json"),
}
"""Of each command that writes a file: what asks for it, and a name that it takes."""

OF_FOLDERS = {"analyse", "design", "report", "reproduce", "identify"}
"""Commands that write files of names of their own into a folder."""

OF_BENCHES = {"run", "track"}
"""Commands that go on from what is there, or refuse it."""


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Path:
    monkeypatch.chdir(tmp_path)
    swing = [math.exp(-0.01 * i) * math.cos(0.2 * i) for i in range(400)]
    rows = [f"{i / 100},{value}" for i, value in enumerate(swing)]
    Path("decay.csv").write_text("\n".join(["time_s,angle_deg", *rows]))
    assert main([*IMPORT, "--out", "decay.nc"]) == 0
    Path("found.json").write_text(json.dumps({"resonance": [{"pretension_mm": 6.0}]}))
    capsys.readouterr()
    return tmp_path


@pytest.mark.parametrize("name", WRITES)
def test_a_file_that_exists_is_named_and_stays(name: str, files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words, file = WRITES[name]
    Path(file).write_text("mine")
    said = refused(capsys, *words, "--truth" if name == "emulate" else "--out", file)
    assert f"{file} exists; give another name with --{'truth' if name == 'emulate' else 'out'}" in said
    assert "--force" in said
    assert Path(file).read_text() == "mine"


def test_force_replaces_a_file(files: Path) -> None:
    before = Path("decay.nc").read_bytes()
    Path("decay.nc").write_text("mine")
    assert main([*IMPORT, "--out", "decay.nc", "--force"]) == 0
    assert len(Path("decay.nc").read_bytes()) == len(before)


def test_every_command_with_a_file_to_write_is_asked() -> None:
    commands = typer.main.get_group(app).commands
    assert all(isinstance(one, NumbersCommand) for one in commands.values())
    writing = {name for name, one in commands.items() if {"out", "truth"} & {option.name for option in one.params}}
    assert writing == set(WRITES) | OF_FOLDERS | OF_BENCHES


def test_analyse_makes_its_own_folder_again(files: Path) -> None:
    words = ["analyse", *IMPORT[1:], "--out", "found"]
    assert [main(words), main(words)] == [0, 0]


def measured(folder: str) -> bytes:
    """Put a recording of the twin, as of a bench, into a folder."""
    Path(folder).mkdir()
    assert main(["simulate", "short", "--out", f"{folder}/recording.nc"]) == 0
    return Path(folder, "recording.nc").read_bytes()


def test_analyse_and_reproduce_replace_no_recording_that_they_did_not_make(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = measured("run")
    capsys.readouterr()
    for words in (("analyse", *IMPORT[1:]), ("reproduce", "--plan", "short")):
        assert "run/recording.nc exists" in refused(capsys, *words, "--out", "run")
    assert Path("run/recording.nc").read_bytes() == before


def test_analyse_replaces_no_recording_by_a_part_of_itself(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("own").mkdir()
    Path("decay.nc").rename("own/recording.nc")
    before = Path("own/recording.nc").read_bytes()
    assert main(["analyse", "own/recording.nc", "--out", "own"]) == 0
    capsys.readouterr()
    assert "own/recording.nc exists" in refused(capsys, "analyse", "own/recording.nc", "--start", "1", "--out", "own")
    assert len(Path("own/recording.nc").read_bytes()) == len(before)


def test_predict_replaces_no_rig_that_it_did_not_write(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("rig.toml").write_text("mine")
    assert "rig.toml exists" in refused(capsys, "predict", "paper", "--pretension-mm", "4", "--out", ".")
    assert Path("rig.toml").read_text() == "mine"
