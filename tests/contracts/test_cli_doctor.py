"""`sinew doctor` on an emulated bench behind a pseudo-terminal: exit status, JSON, and asking before it writes."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.patience import comes, communicate

from sinew.apps.cli import main

SINEW = Path(sys.executable).with_name("sinew")
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals of Linux")


@pytest.fixture
def port(tmp_path: Path) -> Iterator[str]:
    link = tmp_path / "bench"
    process = subprocess.Popen(
        [SINEW, "emulate", "--link", str(link)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    assert process.stdout is not None
    try:
        assert comes(process.stdout)
        assert os.read(process.stdout.fileno(), 4096)
        yield str(link)
    finally:
        process.terminate()
        communicate(process)


def document(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    capsys.readouterr()
    status = main(["doctor", *arguments, "--json"])
    return status, json.loads(capsys.readouterr().out)


@pytest.mark.slow
@pytest.mark.realtime
def test_a_factory_new_bench_is_told_what_to_set_and_has_no_fault(
    port: str, capsys: pytest.CaptureFixture[str]
) -> None:
    status, told = document(capsys, "--port", port)
    fixable = {(row["subject"], row["found"].split()[0]) for row in told["findings"] if row["fixable"]}
    assert (status, told["ok"], told["written"]) == (0, True, [])
    assert ("tendon 1", "return_delay_time") in fixable
    assert {row["subject"] for row in told["findings"]} >= {"port", "tendon 4", "drive", "IMU", "loop", "bus"}


@pytest.mark.slow
@pytest.mark.realtime
def test_after_the_fix_nothing_can_be_fixed_any_more(port: str, capsys: pytest.CaptureFixture[str]) -> None:
    _, first = document(capsys, "--port", port, "--fix", "--yes")
    _, second = document(capsys, "--port", port)
    assert {row["severity"] for row in first["written"]} == {"ok"}
    assert [row for row in second["findings"] if row["fixable"]] == []


@pytest.mark.slow
@pytest.mark.realtime
def test_without_a_terminal_nothing_is_written_unless_asked_for(port: str, capsys: pytest.CaptureFixture[str]) -> None:
    done = subprocess.run(
        [SINEW, "doctor", "--port", port, "--fix"],
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    _, told = document(capsys, "--port", port)
    assert done.returncode == 2
    assert "add --yes to --fix" in done.stderr.splitlines()[-1]
    assert any(row["fixable"] for row in told["findings"])
