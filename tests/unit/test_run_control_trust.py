"""Whom the dashboard believes to be a run: folders that somebody planted or copied lead to nobody's process."""

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import psutil
import pytest

from sinew.apps.bench import run_control
from sinew.apps.bench.run_control import CONTROL, ControlError, listening, send_control
from sinew.apps.dashboard.run_desk import PID, adopt, adopt_from, find_runs, read_pid, read_specs, write_pid
from sinew.bench.stops import Steering
from sinew.measure.errors import SpecError
from sinew.plan.toml import dump_rig, load_rig

PLAN = 'name = "a"\n[pretension]\npretension_mm = [2]\n[sweep]\nfrequency_hz = [3]\n'
SLEEP = [sys.executable, "-S", "-c", "import time; time.sleep(600)"]
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


@pytest.fixture
def victim(runs: Path) -> Iterator["subprocess.Popen[bytes]"]:
    """Give a process of ours that is no run, though it names the folder of one."""
    command = [*SLEEP, str(runs / "planted" / "journal.sqlite")]
    with subprocess.Popen(command) as process:
        end = time.monotonic() + 10
        while psutil.Process(process.pid).cmdline() != command:  # the system names its arguments after it has begun
            assert time.monotonic() < end
            time.sleep(0.001)
        yield process
        process.kill()


def folder_of(runs: Path, name: str = "planted") -> Path:
    folder = runs / name
    folder.mkdir()
    (folder / "plan.toml").write_text(PLAN)
    (folder / "rig.toml").write_text(dump_rig(load_rig("paper")))
    return folder


def began(process: "subprocess.Popen[bytes]") -> float:
    return float(psutil.Process(process.pid).create_time())


def test_a_number_in_a_planted_folder_is_no_run_of_ours(runs: Path, victim: "subprocess.Popen[bytes]") -> None:
    folder = folder_of(runs)
    for text in (f"{victim.pid}\n", f"{victim.pid} {began(victim)}\n", f"{victim.pid} {began(victim) - 60}\n"):
        (folder / PID).write_text(text)
        assert list(find_runs(runs, send_control)) == []


def test_a_number_that_was_given_to_another_process_is_not_taken_for_the_first(
    runs: Path, victim: "subprocess.Popen[bytes]"
) -> None:
    words = SLEEP[-1:]
    assert adopt(victim.pid, words, began(victim) - 60) is None
    found = adopt(victim.pid, words, began(victim))
    assert found is not None
    found.close()


def test_a_process_that_was_written_down_is_found_again(tmp_path: Path, victim: "subprocess.Popen[bytes]") -> None:
    write_pid(tmp_path / PID, victim.pid)
    found = adopt_from(tmp_path / PID, SLEEP[-1:])
    assert found is not None
    assert found.pid == victim.pid
    found.close()


def test_a_part_of_an_argument_is_not_the_argument(victim: "subprocess.Popen[bytes]") -> None:
    assert adopt(victim.pid, ["journal.sqlite"]) is None


def test_a_link_names_no_process(tmp_path: Path, victim: "subprocess.Popen[bytes]") -> None:
    write_pid(tmp_path / "elsewhere", victim.pid)
    (tmp_path / PID).symlink_to(tmp_path / "elsewhere")
    assert read_pid(tmp_path / PID) is None


def test_a_file_of_somebody_else_names_no_process(
    tmp_path: Path, victim: "subprocess.Popen[bytes]", monkeypatch: pytest.MonkeyPatch
) -> None:
    write_pid(tmp_path / PID, victim.pid)
    monkeypatch.setattr(os, "geteuid", lambda: 4711)
    assert read_pid(tmp_path / PID) is None


def test_a_control_file_of_somebody_else_leads_to_nobody(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, heard = folder_of(runs), Steering(lambda: 0.0)
    with listening(folder, heard):
        monkeypatch.setattr(os, "geteuid", lambda: 4711)
        with pytest.raises(ControlError):
            send_control(folder, "stop")
        monkeypatch.undo()
    assert heard.halt is None


def test_a_socket_of_somebody_else_is_told_nothing(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, heard = folder_of(runs), Steering(lambda: 0.0)
    with listening(folder, heard):
        monkeypatch.setattr(run_control, "_peer", lambda _: (os.geteuid() + 1, 1))
        with pytest.raises(ControlError, match="somebody else's process"):
            send_control(folder, "stop")
    assert heard.halt is None


def test_a_folder_that_leads_to_another_run_stops_none(runs: Path) -> None:
    true, planted, heard = folder_of(runs, "true"), folder_of(runs), Steering(lambda: 0.0)
    with listening(true, heard):
        (planted / CONTROL).write_text((true / CONTROL).read_text())
        for command in ("status", "stop", "emergency"):
            with pytest.raises(ControlError, match="leads to a run in another folder"):
                send_control(planted, command)
        assert [run.name for run in find_runs(runs, send_control)] == ["true"]
        assert heard.halt is None
        assert send_control(true, "status")["ok"]


def test_a_run_says_the_number_of_no_process_but_its_own(runs: Path, victim: "subprocess.Popen[bytes]") -> None:
    folder = folder_of(runs)
    with listening(folder, Steering(lambda: 0.0)) as control:
        control.state = lambda: {"state": "running", "pid": victim.pid}  # type: ignore[method-assign]
        (found,) = find_runs(runs, send_control)
    assert found.process.pid == os.getpid()


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


def left(stack: ExitStack, place: Path) -> "subprocess.Popen[bytes]":
    """Begin a process that listens in a folder."""
    place.mkdir(mode=0o700)
    process = stack.enter_context(
        subprocess.Popen([sys.executable, "-S", "-c", LISTEN, str(place / CONTROL)], stdout=subprocess.PIPE)
    )
    stack.callback(process.kill)
    assert process.stdout is not None
    process.stdout.readline()
    return process


def test_the_next_run_clears_what_killed_ones_left_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = Path(tempfile.mkdtemp(dir="/tmp"))
    monkeypatch.setattr(tempfile, "tempdir", str(place))
    with ExitStack() as stack:
        stack.callback(lambda: subprocess.run(["rm", "-r", str(place)], check=True))
        left(stack, place / "sinew-alive")
        dead = left(stack, place / "sinew-dead")
        dead.send_signal(signal.SIGKILL)
        dead.wait()
        more = left(stack, place / "sinew-more")
        more.kill()
        more.wait()
        (place / "sinew-more" / "notes").touch()
        (place / "sinew-new").mkdir()
        (place / "sinew-link").symlink_to(place / "sinew-more")
        (place / "another").mkdir()
        with listening(tmp_path / "run", Steering(lambda: 0.0)):
            mine = Path((tmp_path / "run" / CONTROL).read_text()).parent.name
            there = {each.name for each in place.iterdir()}
        assert there - {mine} == {"sinew-alive", "sinew-more", "sinew-new", "sinew-link", "another"}


def test_a_run_that_is_under_way_keeps_its_folder(tmp_path: Path) -> None:
    with listening(tmp_path / "one", Steering(lambda: 0.0)), listening(tmp_path / "two", Steering(lambda: 0.0)):
        assert all(send_control(tmp_path / name, "status")["ok"] for name in ("one", "two"))


def test_a_long_plan_is_read_by_another_process(monkeypatch: pytest.MonkeyPatch) -> None:
    began, rig = [], load_rig("paper")
    true = subprocess.run
    monkeypatch.setattr(subprocess, "run", lambda *given, **more: began.append(given) or true(*given, **more))
    long = PLAN + "#" * 100_000
    assert read_specs(PLAN, dump_rig(rig)) == read_specs(long, dump_rig(rig)) == ("a", False, rig)
    with pytest.raises(SpecError, match="the plan is not valid TOML"):
        read_specs(long + "\nx", dump_rig(rig))
    assert len(began) == 2


def test_a_reader_that_is_killed_is_a_plan_that_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(SpecError, match="takes too long or too much memory"):
        read_specs(PLAN + "#" * 100_000, dump_rig(load_rig("paper")))
