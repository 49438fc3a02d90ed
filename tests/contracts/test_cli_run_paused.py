"""`sinew run` after a pause of the computer: an emulated bench goes on by itself, a real one by one key.

The bench is the emulator's in virtual time, and the whole command runs in this process.
"""

import json
import os
import pty
import select
import tty
from pathlib import Path

import pytest
from tests.contracts.virtual_run import RunHere, torques

from sinew.apps import console
from sinew.bench.record.journal import JournalReader
from sinew.hardware.imu import Imu

PULLING_S = 3.0


def pause(here: RunHere, *times: float, seconds: float = 0.121) -> None:
    """Have the computer pause at some times of the run [s]."""
    port = here.port
    port.agenda = [(port.now() + time, lambda: port.wait_until(port.now() + seconds)) for time in times]


def press(monkeypatch: pytest.MonkeyPatch, *keys: str) -> list[str]:
    """Have somebody press keys, one for each question; return the list in which the questions will be."""
    asked: list[str] = []

    def answer(question: str) -> str:
        asked.append(question)
        return keys[len(asked) - 1]

    monkeypatch.setattr("sinew.apps.bench.bench_run.one_key", answer)
    return asked


@pytest.fixture
def real(run_here: RunHere, monkeypatch: pytest.MonkeyPatch) -> RunHere:
    """A run on a bench that is not known to be emulated, with a pause while it pulls its tendons."""
    monkeypatch.setattr(Imu, "is_emulated", lambda _: False)
    pause(run_here, PULLING_S)
    return run_here


def test_a_real_bench_stops_in_its_safe_state_and_says_how_to_go_on(real: RunHere) -> None:
    told = real("--json")
    document = json.loads(told.out)
    keys = ("complete", "ended_by_pause", "is_safe", "pauses")
    assert [told.status, *(document[key] for key in keys)] == [1, False, True, True, []]
    assert document["ended"].startswith("the computer paused for 1")
    assert told.err.endswith("--resume\n")
    assert not any(torques(real.port.rig))


def test_one_key_goes_on_with_a_run_that_a_pause_ended(real: RunHere, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = press(monkeypatch, "r")
    told = real()
    with JournalReader(real.out / "journal.sqlite") as journal:
        runs = len(journal.dates)
    assert (runs, told.status) == (2, 1)
    assert asked == ["the computer paused, the bench is at rest: press r to go on, any other key to end"]


def test_another_key_ends_it(real: RunHere, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = press(monkeypatch, "q")
    assert (real().status, len(asked)) == (1, 1)


def test_an_emulated_bench_goes_on_by_itself(run_here: RunHere) -> None:
    pause(run_here, PULLING_S)
    document = json.loads(run_here("--json").out)
    assert len(document["pauses"]) == 1


def test_a_key_is_asked_for_on_a_terminal_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert (console.one_key("go on?"), capsys.readouterr().err) == ("", "")


def test_what_was_typed_before_the_question_does_not_answer_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    master, slave = pty.openpty()
    with os.fdopen(slave, "r", closefd=True) as keyboard, (tmp_path / "err").open("w") as screen:
        monkeypatch.setattr("sys.stdin", keyboard)
        monkeypatch.setattr("sys.stderr", screen)
        monkeypatch.setattr(screen, "isatty", lambda: True, raising=False)
        tty.setcbreak(slave)
        os.write(master, b"r")
        assert select.select([slave], [], [], 10)[0]  # what is written arrives a moment later
        monkeypatch.setattr(console, "remark", lambda _: None)
        flushed = console.os.read
        monkeypatch.setattr(console.os, "read", lambda *given: (os.write(master, b"Q"), flushed(*given))[1])
        assert console.one_key("go on?") == "q"
    os.close(master)
