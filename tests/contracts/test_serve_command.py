"""`sinew serve` as a command: what it prints, what it refuses, and how it ends."""

import importlib.util
import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from tests.contracts.commands import command_lines
from tests.contracts.serving import PATIENCE, RIG, TOKEN, free_port, plan, until
from tests.patience import await_end, comes, communicate

from sinew.apps.cli import main
from sinew.measure.errors import how_to_install


@pytest.fixture
def token_file(tmp_path: Path) -> Path:
    path = tmp_path / "token"
    path.write_text(f"{TOKEN}\n")
    path.chmod(0o600)
    return path


@contextmanager
def served(runs: Path, token: Path, *options: str) -> Iterator[tuple["subprocess.Popen[str]", dict[str, Any]]]:
    """Give `sinew serve` in a process of its own, and what it said when it was ready; it is over at the end."""
    words = ("--runs", str(runs), "--http", f"127.0.0.1:{free_port()}", "--token-file", str(token), *options)
    command = [sys.executable, "-m", "tests.contracts.serving_child", *words, "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert comes(process.stdout), "it does not get ready"
            ready = process.stdout.readline()
            assert ready, process.communicate()[1]
            yield process, json.loads(ready)
        finally:
            process.kill()


def told(ready: dict[str, Any], path: str, body: dict[str, Any]) -> Any:
    headers = {"Authorization": f"Bearer {TOKEN}"}
    return httpx.post(ready["steering"] + path, json=body, headers=headers, verify=False, timeout=PATIENCE).json()


def status(ready: dict[str, Any]) -> Any:
    return httpx.get(f"{ready['steering']}/status", verify=False, timeout=PATIENCE).json()


def begin_run(ready: dict[str, Any]) -> int:
    """Begin a run, and return the number of its process once it listens."""
    start = {"command": "start", "name": "monday", "plan": plan(), "rig": RIG}
    assert told(ready, "/command", start)["ok"] is True
    until(lambda: status(ready)["run"]["state"] == "running")
    return int(status(ready)["run"]["pid"])


def test_ctrl_c_ends_a_run_first_and_says_so(tmp_path: Path, token_file: Path) -> None:
    with served(tmp_path / "runs", token_file, "--port-bench", "/dev/bench") as (process, ready):
        begin_run(ready)
        process.send_signal(signal.SIGINT)
        _, err = communicate(process)
    said = json.loads((tmp_path / "runs" / "monday" / "run.log").read_text())
    assert (process.returncode, said["ended"]) == (0, "stop was asked for")
    assert "the run monday is stopped; Ctrl-C again does not wait" in err


def test_the_address_holds_the_token_where_no_server_sees_it_and_the_page_ends_with_a_killed_steward(
    tmp_path: Path, token_file: Path
) -> None:
    with served(tmp_path / "runs", token_file) as (process, ready):
        process.kill()
        await_end(process)
    assert ready["url"].endswith(f"/#token={TOKEN}")
    port = int(ready["url"].split(":")[2].split("/")[0])
    until(lambda: not _listens(port))


def test_sigquit_is_an_emergency_stop(tmp_path: Path, token_file: Path) -> None:
    with served(tmp_path / "runs", token_file, "--port-bench", "/dev/bench") as (process, ready):
        run = begin_run(ready)
        process.send_signal(signal.SIGQUIT)
        last = until(lambda: status(ready)["last"])
    assert (last["pid"], last["sentence"]) == (run, "emergency was asked for; nothing moves")


def _listens(port: int) -> bool:
    try:
        httpx.get(f"http://127.0.0.1:{port}/", verify=False, timeout=0.2)
    except httpx.ConnectError:
        return False
    except httpx.HTTPError:
        pass
    return True


def test_an_address_for_all_needs_a_token_to_look_and_comes_with_a_word_on_tunnels(
    tmp_path: Path, token_file: Path
) -> None:
    port = free_port()
    with served(tmp_path / "runs", token_file, "--http", f"0.0.0.0:{port}") as (process, _):
        answer = httpx.get(f"http://127.0.0.1:{port + 1}/status", verify=False, timeout=PATIENCE)
        process.send_signal(signal.SIGTERM)
        _, err = communicate(process)
    assert (answer.status_code, "ssh -L" in err) == (401, True)


@command_lines("""
    --emulate --port-bench /dev/x => expected one of them at most
    --http 127.0.0.1 => expected HOST:PORT
    --http 127.0.0.1:65536 => expected HOST:PORT
    --http 127.0.0.1:65535 => PORT at most 65534
    --rig papre => did you mean paper?
    --token-file nowhere => cannot read a token from nowhere
    --http 192.0.2.1:8080 => cannot listen on 192.0.2.1
""")
def test_what_cannot_be_served_is_refused_in_one_line_and_nothing_is_begun(
    arguments: tuple[str, ...], sentence: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = signal.getsignal(signal.SIGTERM)
    status = main(["serve", *arguments])
    signal.signal(signal.SIGTERM, before)
    err = capsys.readouterr().err.splitlines()
    assert (status, sentence in err[-1], list(here.iterdir())) == (2, True, [])


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604, 0o620])
def test_a_token_that_others_can_reach_is_refused(
    token_file: Path, mode: int, capsys: pytest.CaptureFixture[str]
) -> None:
    token_file.chmod(mode)
    assert main(["serve", "--token-file", str(token_file)]) == 2
    assert f"chmod 600 {token_file}" in capsys.readouterr().err


@pytest.mark.parametrize("token", ["", "short", "with a space in the middle of it", "ä" * 30, "x" * 201])
def test_a_token_that_is_none_is_refused(token_file: Path, token: str, capsys: pytest.CaptureFixture[str]) -> None:
    token_file.write_text(token)
    assert main(["serve", "--token-file", str(token_file)]) == 2
    assert "found no token in" in capsys.readouterr().err


def test_without_its_packages_the_command_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    assert main(["serve"]) == 2
    assert f"`make serve` installs it, or: {how_to_install('dashboard')}" in capsys.readouterr().err
