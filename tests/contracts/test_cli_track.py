"""`sinew track`: what it refuses, what it writes, and how it is told."""

import json
from pathlib import Path

import pytest
from tests.contracts.commands import command_lines, refused
from tests.contracts.virtual_run import spoken

from sinew.apps.cli import main
from sinew.measure.files.netcdf import load_recording


@command_lines("""
    => neither
    --emulate --port /dev/bench => found both --port and --emulate
    --port /dev/bench --fault unplug@1 => faults are for --emulate
    --emulate --amplitude-deg 0 => expected positive angles
    --emulate --hold current => expected one of command, lever, torsion
    --emulate --pretension-mm loose => expected a number
    --emulate --pretension-mm '-1, 2' => cables cannot push
    --emulate --pretension-mm 0:99 => the rig allows 0 to 16 mm
    --emulate --pretension-mm 4:4 => expected FROM:TO
    --emulate --pretension-mm 4 --follow-hz 3:4 => needs room to move
    --emulate --follow-hz 3 => expected FROM:TO
    --emulate --duration-s 1 => --duration-s
    papre --emulate => did you mean paper
""")
def test_what_cannot_be_meant_is_refused_in_one_line(
    arguments: tuple[str, ...], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sentence in refused(capsys, "track", *arguments, "--out", tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_holds_a_run_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "journal.sqlite").touch()
    assert main(["track", "--emulate", "--out", str(tmp_path)]) == 2
    assert "holds a run already" in capsys.readouterr().err


@pytest.mark.slow
def test_a_run_on_the_emulated_bench_gives_a_point_a_recording_and_a_figure(tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ("track", "paper", "--emulate", "--pretension-mm", "6", "--duration-s", "8", "--seed", "1004", "--json")
    status, said, err = spoken(*words, "--out", str(out))
    document = json.loads(said)
    assert status == 0
    assert "locked at" in err
    assert json.loads((out / "track.json").read_text()) == document
    names = {path.name for path in out.iterdir()}
    assert {"journal.sqlite", "recording.nc", "track.json", "tracking.pdf", "tracking.png"} <= names
    (track,) = document["tracks"]
    assert track["point"]["frequency_hz"]["value"] == pytest.approx(track["point"]["predicted_hz"], rel=0.01)
    assert track["lock_cycles"] < 10
    assert document["is_safe"]
    recording = load_recording(out / "recording.nc")
    assert recording.attrs["source"] == "emulator"
    command = recording.attrs["command"]
    assert command.startswith("sinew track paper --emulate --seed 1004 --pretension-mm 6")


@pytest.mark.slow
def test_a_frequency_out_of_reach_is_refused_with_what_can_be_reached(tmp_path: Path) -> None:
    words = (
        "track",
        "paper",
        "--emulate",
        "--pretension-mm",
        "4:8",
        "--follow-hz",
        "3.5:5",
        "--out",
        str(tmp_path / "o"),
    )
    status, said, err = spoken(*words)
    assert (status, said, list(tmp_path.iterdir())) == (2, "", [])
    assert "which is what 4 to 8 mm can reach" in err
