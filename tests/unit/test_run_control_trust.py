"""Whom the dashboard believes to be a run: folders that somebody planted or copied lead to nobody's process."""

import os
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from sinew.apps.bench.run_control import CONTROL, ControlError, listening, send_control
from sinew.apps.dashboard.run_desk import read_specs, running_elsewhere
from sinew.bench.stops import Steering
from sinew.measure.errors import SpecError
from sinew.plan.toml import dump_rig, load_rig

PLAN = 'name = "a"\n[pretension]\npretension_mm = [2]\n[sweep]\nfrequency_hz = [3]\n'
LISTEN = """
import socket, sys, time
line = socket.socket(socket.AF_UNIX)
line.bind(sys.argv[1])
line.listen()
print("ready", flush=True)
time.sleep(600)
"""


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    (tmp_path / "runs").mkdir()
    return tmp_path / "runs"


def folder_of(runs: Path, name: str = "planted") -> Path:
    folder = runs / name
    folder.mkdir()
    (folder / "plan.toml").write_text(PLAN)
    (folder / "rig.toml").write_text(dump_rig(load_rig("paper")))
    return folder


def test_a_control_file_of_somebody_else_leads_to_nobody(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, heard = folder_of(runs), Steering(lambda: 0.0)
    with listening(folder, heard):
        monkeypatch.setattr(os, "geteuid", lambda: 4711)
        with pytest.raises(ControlError):
            send_control(folder, "stop")
        monkeypatch.undo()
    assert heard.halt is None


def test_a_folder_that_leads_to_another_run_stops_none(runs: Path) -> None:
    true, planted, heard = folder_of(runs, "true"), folder_of(runs), Steering(lambda: 0.0)
    with listening(true, heard):
        (planted / CONTROL).write_text((true / CONTROL).read_text())
        for command in ("status", "stop", "emergency"):
            with pytest.raises(ControlError, match="leads to a run in another folder"):
                send_control(planted, command)
        assert running_elsewhere(runs, send_control) == true
        assert heard.halt is None
        assert send_control(true, "status")["ok"]


@pytest.mark.parametrize("mode", [0o755, 0o777])
def test_a_socket_where_others_may_go_is_told_nothing(runs: Path, tmp_path: Path, mode: int) -> None:
    folder = folder_of(runs)
    with tempfile.TemporaryDirectory() as place, socket.socket(socket.AF_UNIX) as server:
        server.bind(f"{place}/agent")
        server.listen()
        server.setblocking(False)
        Path(place).chmod(mode)
        (folder / CONTROL).write_text(f"{place}/agent")
        with pytest.raises(ControlError, match="no socket of a run of our own"):
            send_control(folder, "status")
        with pytest.raises(BlockingIOError):
            server.accept()


def test_a_control_file_that_is_a_link_is_not_written_through(runs: Path, tmp_path: Path) -> None:
    folder = folder_of(runs)
    (tmp_path / "precious").write_text("all of it")
    (folder / CONTROL).symlink_to(tmp_path / "precious")
    with listening(folder, Steering(lambda: 0.0)):
        assert send_control(folder, "status")["ok"]
    assert (tmp_path / "precious").read_text() == "all of it"


def test_the_next_run_clears_what_a_killed_one_left_and_nothing_else(tmp_path: Path) -> None:
    with listening(tmp_path / "alive", Steering(lambda: 0.0)):
        alive = Path((tmp_path / "alive" / CONTROL).read_text())
        private = Path(tempfile.mkdtemp(prefix="sinew-"))
        command = [sys.executable, "-S", "-c", LISTEN, str(private / CONTROL)]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            process.stdout.readline()
            process.kill()
        (tmp_path / "run").mkdir()
        (tmp_path / "run" / CONTROL).write_text(str(private / CONTROL))
        with listening(tmp_path / "run", Steering(lambda: 0.0)):
            assert (private.exists(), alive.exists()) == (False, True)


def test_a_run_that_is_under_way_keeps_its_folder(tmp_path: Path) -> None:
    with listening(tmp_path / "one", Steering(lambda: 0.0)), listening(tmp_path / "two", Steering(lambda: 0.0)):
        assert all(send_control(tmp_path / name, "status")["ok"] for name in ("one", "two"))


def test_a_plan_that_keeps_its_reader_busy_is_refused_unread() -> None:
    rig = dump_rig(load_rig("paper"))
    assert read_specs(PLAN, rig).plan == "a"
    with pytest.raises(SpecError, match="expected at most 49152"):
        read_specs(PLAN + "#" * 49_152, rig)
