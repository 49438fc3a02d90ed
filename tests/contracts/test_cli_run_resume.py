"""`sinew run --resume`: a bench left in hold, plans and rigs that are not the same, and a run brought to its end."""

import json
from pathlib import Path

import pytest
from campaigns.same_numbers import TINY
from tests.contracts.emulated_bench import WatchedPort, joint, rig_file, virtual_port
from tests.contracts.virtual_run import interrupt, run, spoken, torques, without_motor

from sinew.measure.files.netcdf import load_recording
from sinew.plan.toml import load_rig


@pytest.fixture
def held(
    plan: str, out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> tuple[WatchedPort, str]:
    """A bench that a run has left in hold, and its rig."""
    port = virtual_port(monkeypatch)
    rig = rig_file(tmp_path, limits={"safe_state": "hold"})
    interrupt(port, 3.0)
    assert run(capsys, plan, out, "--rig", rig).status == 1
    assert all(torques(port.rig))
    return port, rig


@pytest.mark.slow
def test_a_bench_left_in_hold_is_taken_over_by_resuming(
    held: tuple[WatchedPort, str], plan: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = run(capsys, plan, out, "--rig", held[1], "--resume")
    assert (told.status, "has travelled" in told.out, all(torques(held[0].rig))) == (1, True, True)


def test_resuming_with_another_rig_or_without_a_motor_is_refused_and_leaves_the_journal_as_it_was(
    held: tuple[WatchedPort, str], plan: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (out / "journal.sqlite").read_bytes()
    told = run(capsys, plan, out, "--resume")
    assert (told.status, told.err.count("\n")) == (2, 1)
    assert all(word in told.err for word in ("begun with another rig", "safe_state", "use the same"))
    without_motor(held[0].rig)
    told = run(capsys, plan, out, "--rig", held[1], "--resume")
    assert (told.status, (out / "journal.sqlite").read_bytes() == before) == (2, True)


@pytest.mark.slow
def test_a_run_that_was_interrupted_is_completed_by_resuming(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spec, plan, out = load_rig("paper"), tmp_path / "tiny.toml", tmp_path / "out"
    plan.write_text(TINY)
    port = virtual_port(monkeypatch, spec, joint(spec))
    command = ("run", str(plan), "--port", "b", "--out", str(out), "--json")
    interrupt(port, 13.0)  # in its second group
    first = json.loads(spoken(*command)[1])
    port.wait_until(port.now() + 10.0)  # until the joint is at rest
    second = json.loads(spoken(*command, "--resume")[1])
    assert (first["complete"], first["groups_done"], first["recording"] is not None) == (False, 1, True)
    assert (second["complete"], second["groups_done"]) == (True, 2)
    assert load_recording(out / "recording.nc").attrs["runs"] == 2
