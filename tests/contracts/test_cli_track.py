"""`sinew track`: what it refuses, what it writes, and how it is told."""

import json
import subprocess
from pathlib import Path

import pytest
from campaigns.same_numbers import TINY
from tests.contracts.commands import command_lines, refused
from tests.contracts.emulated_bench import PATIENCE, SINEW, playing
from tests.contracts.virtual_run import spoken
from tests.patience import finished, until

from sinew.apps.cli import main
from sinew.bench.record.journal import Journal, JournalReader
from sinew.measure.files.netcdf import load_recording
from sinew.plan.toml import dump_plan, dump_rig, load_rig, parse_plan


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
    --emulate --resume => found no run to go on with
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


def begun(folder: Path) -> None:
    """Leave the journal of a run that was begun, of a plan that does not track."""
    rig = load_rig("paper")
    Journal.create(folder / "journal.sqlite", dump_plan(parse_plan(TINY)), dump_rig(rig)).close()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--pretension-mm", "4"), "found --pretension-mm beside --resume"),
        (("--amplitude-deg", "20"), "found --amplitude-deg beside --resume"),
        ((), "go on by `sinew run --resume`"),
    ],
)
def test_what_was_begun_is_gone_on_with_and_nothing_else(
    words: tuple[str, ...], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    begun(tmp_path)
    assert sentence in refused(capsys, "track", "--emulate", "--resume", *words, "--out", tmp_path)


def locks(out: Path) -> int:
    """Return how often the run in a folder has found a resonance."""
    if not (out / "journal.sqlite").exists():
        return 0
    with JournalReader(out / "journal.sqlite") as journal:
        return sum(event.kind == "lock" for _, event in journal.events())


@pytest.mark.slow
@pytest.mark.long
def test_tracking_through_a_terminal_that_was_killed_is_completed_by_resuming(tmp_path: Path) -> None:
    out = tmp_path / "out"
    asked = ["--pretension-mm", "4", "--amplitude-deg", "10, 20", "--duration-s", "8"]
    with playing(tmp_path, "--seed", "3") as bench:
        where = ["track", "paper", "--port", bench.port, "--out", str(out)]
        with subprocess.Popen([SINEW, *where, *asked], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as process:
            try:
                until(lambda: locks(out) == 2 or process.poll() is not None, PATIENCE, "the second does not lock")
                assert process.poll() is None, "it ended by itself"
            finally:
                process.kill()
        told = finished([SINEW, *where, "--resume", "--json"], PATIENCE)
        truth = bench.truth()
    document = json.loads(told.stdout)
    assert (told.returncode, document["complete"], truth["in_safe_state"]) == (0, True, True)
    assert [track["amplitude_deg"] for track in document["tracks"]] == [10.0, 20.0]
    for track in document["tracks"]:
        assert track["point"]["frequency_hz"]["value"] == pytest.approx(track["point"]["predicted_hz"], rel=0.01)
    recording = load_recording(out / "recording.nc")
    assert recording.attrs["runs"] == 2
    assert spoken("analyse", str(out / "recording.nc"), "--json")[1] == json.dumps(
        {"kind": "recording", "doubts": [], "tracking": {key: document[key] for key in ("held", "expected", "tracks")}},
        indent=2, ensure_ascii=False,
    ) + "\n"  # fmt: skip


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
