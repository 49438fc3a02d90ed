"""The dashboard's emergency stop on an emulated bench in real time, as the emulator saw it."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import httpx
import pytest
from campaigns.same_numbers import TINY
from tests.contracts.emulated_bench import alone
from tests.contracts.serving import PAGE, PATIENCE, RIG, TOKEN, Page, Served, free_port, serving, until

from sinew.apps.bench.run_control import send_control
from sinew.apps.dashboard.run_desk import LOG, bring_to_rest, ending_of, sinew_command

pytestmark = [pytest.mark.slow, pytest.mark.realtime]

REAL = {
    "bench": "emulator",
    "port": None,
    "command": sinew_command,
    "control": send_control,
    "rest": bring_to_rest,
    "page": (sys.executable, "-S", "-c", PAGE),
}
STARTS = 5


def pulling(served: Served) -> int:
    """Return the number of a run's process whose motors have just begun to pull.

    Where a pause of the computer ends it before that, it is begun anew.
    """
    page = served.page()
    for number in range(STARTS):
        assert page.says("start", name=f"run-{number}", plan=TINY, rig=RIG).status_code == 200
        log = served.runs / f"run-{number}" / LOG
        until(lambda log=log: "pulled to first contact" in log.read_text() or served.status()["run"] is None)
        if (run := served.status()["run"]) is not None:
            return int(run["pid"])
        page.says("release")
    raise AssertionError("no run got as far as pulling")


def emergency(served: Served) -> dict[str, Any]:
    return dict(served.page().says("emergency").json())


def truth(runs: Path) -> dict[str, Any]:
    return dict(json.loads((runs / ".bench" / "truth.json").read_text()))


def test_a_run_that_hangs_is_ended_and_the_bench_let_go(tmp_path: Path) -> None:
    with alone(), serving(tmp_path / "runs", **REAL) as served:
        run = pulling(served)
        os.kill(run, signal.SIGSTOP)
        said = emergency(served)
        until(lambda: not served.steward._emergency.is_under_way)
    true = truth(tmp_path / "runs")
    assert said["ok"] is True
    assert [motor["torque"] for motor in true["motors"]] == [False] * 5
    assert true["in_safe_state"] is True


def test_a_run_in_motion_is_stopped(tmp_path: Path) -> None:
    with alone(), serving(tmp_path / "runs", **REAL) as served:
        pulling(served)
        said = emergency(served)
        until(lambda: served.status()["run"] is None and not served.steward._emergency.is_under_way)
    assert said["sentence"].startswith("all motors stand, ")
    assert said["took_ms"] < 200
    assert truth(tmp_path / "runs")["in_safe_state"] is True


def test_after_a_kill_of_the_server_the_motors_are_safe_and_the_run_can_go_on(tmp_path: Path) -> None:
    runs, port = tmp_path / "runs", free_port()
    token = tmp_path / "token"
    token.write_text(TOKEN)
    token.chmod(0o600)
    words = ["--emulate", "--runs", str(runs), "--http", f"127.0.0.1:{port}", "--token-file", str(token), "--json"]
    command = [str(Path(sys.executable).with_name("sinew")), "serve", *words]
    headers = {"Authorization": f"Bearer {TOKEN}"}
    with (
        alone(),
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process,
        httpx.Client(base_url=f"http://127.0.0.1:{port + 1}", headers=headers, timeout=PATIENCE) as client,
    ):
        assert process.stdout is not None
        process.stdout.readline()
        page = Page(client)
        assert page.says("start", name="one", plan=TINY, rig=RIG).status_code == 200
        log = runs / "one" / LOG
        until(lambda: "pulled to first contact" in log.read_text())
        process.kill()
        until((runs / ".bench" / "truth.json").exists)
    true = truth(runs)
    assert true["in_safe_state"] is True
    assert [motor["torque"] for motor in true["motors"]] == [False] * 5
    assert ending_of(runs / "one")["can_resume"]
