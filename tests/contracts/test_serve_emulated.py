"""The dashboard's emergency stop on an emulated bench in real time, as the emulator saw it."""

import json
import os
import signal
import sys
from pathlib import Path
from typing import Any

import pytest
from campaigns.same_numbers import TINY
from tests.contracts.emulated_bench import alone
from tests.contracts.serving import PAGE, RIG, Served, serving, until

from sinew.apps.bench.run_control import send_control
from sinew.apps.dashboard.emergency import bring_to_rest
from sinew.apps.dashboard.run_desk import LOG, sinew_command

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
    page = served.operator()
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


def test_an_emulator_that_a_killed_steward_left_is_taken_over(tmp_path: Path) -> None:
    with alone(), serving(tmp_path / "runs", **REAL) as served:
        emulator = served.steward._emulator
        assert emulator is not None
        other = type(emulator)(tmp_path / "runs" / ".bench", sinew_command)
        was_there = other.open("paper", 0)
        other.close()
        assert was_there
        assert not emulator.is_there
