"""`sinew run`: what it does with commands at its socket, and with Ctrl-\\.

The bench is the emulator's in virtual time, and the whole command runs in this process.
"""

import json
import signal
import socket
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from tests.contracts.emulated_bench import WatchedPort, joint, rig_file, virtual_port
from tests.contracts.virtual_run import interrupt, run, torques
from tests.patience import LONG_S

from sinew.apps.bench.run_control import ControlError, RunControl, send_control
from sinew.bench.record.journal import JournalReader
from sinew.bench.stops import Steering, StopReport
from sinew.measure.events import Health
from sinew.plan.toml import load_rig

PULLED_S = 3.0
Ask = Callable[..., list[dict[str, Any]]]


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> WatchedPort:
    spec = load_rig("paper")
    return virtual_port(monkeypatch, spec, joint(spec))


@pytest.fixture
def ask(bench: WatchedPort, out: Path) -> Ask:
    """Have commands be sent at times of the run [s]; return the list in which the answers will be."""

    def plan(*commands: tuple[float, str]) -> list[dict[str, Any]]:
        answers: list[dict[str, Any]] = []
        bench.agenda = [
            (bench.now() + at, lambda command=command: answers.append(send_control(out, command)))
            for at, command in commands
        ]
        return answers

    return plan


def events(out: Path) -> list[tuple[str, str]]:
    with JournalReader(out / "journal.sqlite") as journal:
        return [(event.kind, str(event)) for _, event in journal.events()]


@pytest.mark.slow
def test_a_paused_run_goes_on_and_is_complete_and_samples_of_its_pause_belong_to_no_group(
    ask: Ask, plan: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ask((PULLED_S, "pause"), (14.0, "resume"))
    told = run(capsys, plan, out)
    kinds = [kind for kind, _ in events(out) if kind in ("paused", "resumed", "end")]
    assert (told.status, kinds) == (0, ["paused", "resumed", "end"])
    with JournalReader(out / "journal.sqlite") as journal:
        (rest,) = [stretch for stretch in journal.stretches() if stretch.kind == "pause"]
    assert rest.group is None
    assert rest.end is not None
    assert rest.end - rest.first > 200


@pytest.mark.parametrize("state", ["hold", "release"])
def test_a_run_ends_in_the_state_that_was_asked_for_and_not_in_the_declared_one(
    state: str, ask: Ask, bench: WatchedPort, plan: str, out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    declared = rig_file(tmp_path, limits={"safe_state": "release" if state == "hold" else "hold"})
    ask((PULLED_S, state))
    document = json.loads(run(capsys, plan, out, "--rig", declared, "--json").out)
    assert (document["safe_state"], document["is_safe"]) == (state, True)
    assert set(torques(bench.rig)) == {state == "hold"}


@pytest.mark.slow
def test_a_run_that_pauses_is_stopped(ask: Ask, plan: str, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ask((PULLED_S, "pause"), (14.0, "stop"))
    told = run(capsys, plan, out)
    assert (told.status, events(out)[-1][1]) == (
        1,
        "stopped by the operator; release: tension let down, torque off on all motors",
    )


def test_ctrl_backslash_freezes_all_motors_within_200_ms_and_the_journal_says_when(
    bench: WatchedPort, plan: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    interrupt(bench, PULLED_S, number=signal.SIGQUIT)
    document = json.loads(run(capsys, plan, out, "--json").out)
    assert (document["ended"], document["is_safe"]) == ("emergency stop by Ctrl-\\", True)
    (sentence,) = [sentence for kind, sentence in events(out) if kind == "frozen"]
    assert float(sentence.removeprefix("all motors stand, ").split()[0]) == pytest.approx(document["frozen_ms"], abs=1)
    assert document["frozen_ms"] < 200


@pytest.mark.slow
def test_an_emergency_while_a_run_lets_its_tension_down_freezes_all_motors(
    ask: Ask, plan: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ask((8.0, "release"), (8.06, "emergency"))
    run(capsys, plan, out)
    (sentence,) = [sentence for kind, sentence in events(out) if kind == "frozen"]
    assert float(sentence.removeprefix("all motors stand, ").split()[0]) < 200


def test_that_motors_stood_before_they_moved_again_confirms_no_emergency() -> None:
    steering = Steering(lambda: 0.0)
    steering.has_begun = True
    steering.note_frozen(StopReport("release", frozen=frozenset({"drive"})))
    answer = RunControl(steering).carry_out("emergency")
    assert (answer["ok"], answer["sentence"].startswith("no motor has confirmed that it stands")) == (False, True)


def test_a_run_that_has_let_go_answers_an_emergency_with_how_the_rig_was_left() -> None:
    steering = Steering(lambda: 0.0)
    steering.has_begun = True
    steering.note_over(StopReport("release"))
    answer = RunControl(steering).carry_out("emergency")
    assert (answer["ok"], answer["sentence"]) == (True, "release: tension let down, torque off on all motors")


def test_a_command_before_anything_moves_keeps_the_run_from_starting(
    bench: WatchedPort, plan: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answers: list[dict[str, Any]] = []
    bench.agenda = [(bench.now(), lambda: answers.append(send_control(out, "emergency")))]
    told = run(capsys, plan, out)
    assert (answers[0]["ok"], answers[0]["sentence"]) == (True, "nothing has moved, and the run will not start")
    assert (told.status, told.err) == (2, "sinew: emergency stop by the operator; nothing has moved\n")
    assert (out.exists(), any(torques(bench.rig))) == (False, False)


def test_while_it_goes_on_a_run_tells_its_state_and_behind_it_nobody_listens(
    ask: Ask, plan: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answers = ask((0.0, "status"), (PULLED_S, "status"), (PULLED_S, "stop"))
    run(capsys, plan, out)
    assert [answer["state"]["state"] for answer in answers[:2]] == ["preparing", "pulling the tendons"]
    with pytest.raises(ControlError, match="no run in"):
        send_control(out, "status")


NO_COMMANDS = (b"\n", b"[]\n", b'{"command": 3}\n', b"\xff\n", b"x" * 5000, b'{"command": "fly"}\n')


def test_what_is_no_command_is_refused_and_the_run_goes_on(
    ask: Ask, bench: WatchedPort, plan: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    got: list[bytes] = []

    def speak(line: bytes) -> None:
        with socket.socket(socket.AF_UNIX) as client:
            client.settimeout(LONG_S)
            client.connect((out / "control").read_text())
            client.sendall(line)
            got.append(client.recv(4096))

    ask((PULLED_S + 0.1, "stop"))
    bench.agenda[:0] = [(bench.now() + PULLED_S, partial(speak, line)) for line in NO_COMMANDS]
    run(capsys, plan, out)
    assert [json.loads(answer)["ok"] for answer in got] == [False] * len(NO_COMMANDS)
    assert events(out)[-1][1].startswith("stopped")


def test_clients_that_say_nothing_hold_up_nobody(
    ask: Ask, bench: WatchedPort, plan: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    silent: list[socket.socket] = []

    def connect() -> None:
        for _ in range(3):
            client = socket.socket(socket.AF_UNIX)
            client.connect((out / "control").read_text())
            silent.append(client)

    answers = ask((PULLED_S, "stop"))
    bench.agenda.insert(0, (bench.now() + PULLED_S, connect))
    run(capsys, plan, out)
    for client in silent:
        client.close()
    assert answers[0]["ok"]


@pytest.mark.slow
def test_health_is_told_once_a_second(ask: Ask, plan: str, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ask((5.5, "stop"))
    told = run(capsys, plan, out)
    with JournalReader(out / "journal.sqlite") as journal:
        health = [event for _, event in journal.events() if isinstance(event, Health)]
    assert 4 <= len(health) <= 6
    assert set(health[-1].temperature_c) == {"drive", *(f"tendon {i}" for i in range(1, 5))}
    assert "temperature" not in told.err


def test_a_run_that_tracks_refuses_a_pause_with_a_sentence() -> None:
    answer = RunControl(Steering(lambda: 0.0, can_pause=False)).carry_out("pause")
    assert (answer["ok"], "tracks a resonance" in answer["sentence"]) == (False, True)
