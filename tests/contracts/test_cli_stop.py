"""`sinew stop`: from every state that a bench can be found in, what it leaves and what it says.

Where nothing else is said, the bench is the emulator's in virtual time, and the whole command runs in this process.
"""

import json
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from campaigns.same_numbers import TINY
from tests.contracts.emulated_bench import (
    PATIENCE,
    WatchedPort,
    joint,
    playing,
    rig_file,
    running,
    virtual_port,
)
from tests.contracts.virtual_run import Said, torques
from tests.patience import await_end
from tests.unit.bench_virtual import set_going

from sinew.apps.cli import main
from sinew.hardware.bus import Bus, BusTiming
from sinew.hardware.rig import Rig
from sinew.plan.plan import TendonMode
from sinew.plan.toml import load_rig

SPEC = load_rig("paper")
NAMES = {"tendon 1", "tendon 2", "tendon 3", "tendon 4", "drive"}


def stop(capsys: pytest.CaptureFixture[str], *options: str, port: str = "/dev/bench") -> Said:
    capsys.readouterr()
    status = main(["stop", "--port", port, *options])
    return Said(status, *capsys.readouterr())


def in_motion(port: WatchedPort, mode: TendonMode = "position") -> None:
    """Leave the bench as a run does that dies: motors under way, bus watchdogs armed."""
    rig = Rig(Bus(port, port, BusTiming(latency=4e-3)), port, SPEC)
    set_going(rig, port, mode, cycles=40, drive_step=0.01, tendon_step=0.01, current=0.1)


def tripped(port: WatchedPort) -> None:
    in_motion(port)
    port.wait_until(port.now() + 0.5)
    assert all(state.is_tripped for state in port.rig.states().values())


def browned_out(port: WatchedPort) -> None:
    in_motion(port)
    port.rig.set_supply(5.0)
    port.wait_until(port.now() + 0.5)
    port.rig.set_supply(12.0)
    port.wait_until(port.now() + 0.5)


UNDER_TORQUE: dict[str, Callable[[WatchedPort], None]] = {
    "position": in_motion,
    "position with a current limit": lambda port: in_motion(port, "position-with-current-limit"),
    "current": lambda port: in_motion(port, "current"),
    "stopped by the watchdogs": tripped,
}
WITHOUT_TORQUE: dict[str, Callable[[WatchedPort], None]] = {
    "as switched on": lambda _: None,
    "after a brown-out": browned_out,
}
STATES = UNDER_TORQUE | WITHOUT_TORQUE


@pytest.fixture
def left(request: pytest.FixtureRequest, port: WatchedPort) -> WatchedPort:
    """Return the port of a bench in the state of that name."""
    STATES[request.param](port)
    return port


@pytest.mark.parametrize("left", STATES, indirect=True)
def test_a_bench_is_released_from_any_state(left: WatchedPort, capsys: pytest.CaptureFixture[str]) -> None:
    told = stop(capsys, "--state", "release")
    assert (told.status, told.err, told.out.count("torque off on all motors")) == (0, "", 1)
    left.wait_until(left.now() + 0.5)
    assert (left.rig.stopped(), any(torques(left.rig))) == (True, False)


def test_motors_that_were_stopped_by_their_watchdogs_are_not_said_to_have_let_their_tension_down(
    port: WatchedPort, capsys: pytest.CaptureFixture[str]
) -> None:
    in_motion(port)
    before = stop(capsys, "--state", "release")
    tripped(port)
    after = stop(capsys, "--state", "release")
    assert before.out == "release: tension let down, torque off on all motors\n"
    assert "tendon 1, tendon 2, tendon 3 and tendon 4 took no goal, as behind a bus watchdog" in after.out


@pytest.mark.parametrize("left", UNDER_TORQUE, indirect=True)
def test_a_bench_under_torque_is_held_from_any_state(left: WatchedPort, capsys: pytest.CaptureFixture[str]) -> None:
    told = stop(capsys, "--state", "hold")
    assert (told.status, told.err, told.out.startswith("hold: all motors stand still")) == (0, "", True)
    left.wait_until(left.now() + 0.5)
    assert (left.rig.in_safe_state(), left.rig.stopped(), all(torques(left.rig))) == (True, True, True)


@pytest.mark.parametrize("left", WITHOUT_TORQUE, indirect=True)
def test_a_bench_without_torque_is_not_said_to_hold(left: WatchedPort, capsys: pytest.CaptureFixture[str]) -> None:
    told = stop(capsys, "--state", "hold")
    assert (told.status, told.out.count("\n"), any(torques(left.rig))) == (1, 1, False)
    assert "has no torque, expected it to hold" in told.out


@pytest.mark.parametrize("state", ["hold", "release"])
def test_after_it_no_watchdog_waits_to_bite(state: str, port: WatchedPort, capsys: pytest.CaptureFixture[str]) -> None:
    in_motion(port)
    stop(capsys, "--state", state)
    port.wait_until(port.now() + 2.0)
    assert not any(motor.is_tripped for motor in port.rig.states().values())


def test_a_held_bench_is_let_go(port: WatchedPort, capsys: pytest.CaptureFixture[str]) -> None:
    in_motion(port)
    stop(capsys, "--state", "hold")
    held = torques(port.rig)
    stop(capsys, "--state", "release")
    assert (held, torques(port.rig)) == ([True] * 5, [False] * 5)


@pytest.mark.parametrize("state", ["hold", "release"])
def test_without_an_option_the_state_is_the_rigs_and_the_json_names_every_motor(
    state: str, tmp_path: Path, port: WatchedPort, capsys: pytest.CaptureFixture[str]
) -> None:
    in_motion(port)
    told = stop(capsys, "--rig", rig_file(tmp_path, limits={"safe_state": state}), "--json")
    document = json.loads(told.out)
    assert set(document.pop("reached")) == NAMES
    assert (told.status, document) == (0, {"state": state, "is_safe": True, "failed": []})


@pytest.mark.parametrize("state", ["hold", "release"])
def test_a_motor_that_does_not_answer_is_named_and_the_others_obey(
    state: str, port: WatchedPort, capsys: pytest.CaptureFixture[str]
) -> None:
    in_motion(port)
    port.rig.line.devices = [device for device in port.rig.line.devices if device.id != 3]
    told = stop(capsys, "--state", state)
    assert (told.status, told.out.count("\n")) == (1, 1)
    assert all(word in told.out for word in (f"{state} is not confirmed", "tendon 3 (id 3)", "switch the supply off"))
    others = [motor for device, motor in port.rig.states().items() if device != 3]
    assert [motor.torque for motor in others] == [state == "hold"] * 4


def test_a_bench_on_which_nobody_answers_is_said_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    virtual_port(monkeypatch, baud=57_600)
    told = stop(capsys)
    assert (told.status, told.out.count("\n")) == (1, 1)
    motors = ("drive", *(f"tendon {i}" for i in range(1, 5)))
    facts = ("release is not confirmed", *motors, "sent nothing", "supply, id and baud", "switch the supply off")
    assert [fact for fact in facts if fact not in told.out] == []


def test_an_interrupt_does_not_cut_it_short(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    port = virtual_port(monkeypatch, SPEC, joint(SPEC))
    in_motion(port)
    port.agenda = [(port.now() + late, lambda: os.kill(os.getpid(), signal.SIGINT)) for late in (0.0, 0.01, 0.02)]
    told = stop(capsys, "--state", "release")
    assert (told.status, port.agenda, any(torques(port.rig))) == (0, [], False)


def test_tension_is_let_down_before_the_torque_goes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    port = virtual_port(monkeypatch, SPEC, joint(SPEC))
    in_motion(port)
    seen: list[tuple[float, int]] = []
    port.witness = lambda: seen.append((max(port.rig.motion().tension), sum(torques(port.rig)[:4])))
    stop(capsys, "--state", "release")
    before = [tension for tension, powered in seen if powered == 4]
    assert before[0] > 20.0
    assert before[-1] < 10.0


def test_a_state_that_there_is_not_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    told = stop(capsys, "--state", "off")
    assert told == (2, "", "sinew: found --state off, expected hold or release\n")


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals of Linux")
@pytest.mark.parametrize("state", ["hold", "release"])
def test_after_a_run_was_killed_the_bench_is_brought_to_rest(
    state: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = tmp_path / "tiny.toml"
    plan.write_text(TINY)
    with playing(tmp_path) as bench:
        with running(bench.port, plan, tmp_path / "out") as process:
            process.kill()
            await_end(process, PATIENCE)
        time.sleep(0.3)  # so that the watchdogs trip
        told = stop(capsys, "--state", state, port=bench.port)
        truth = bench.truth()
    assert (told.status, told.err) == (0, "")
    assert (truth["in_safe_state"], truth["stopped"]) == (True, True)
    assert {motor["torque"] for motor in truth["motors"]} == {state == "hold"}


@pytest.mark.parametrize("state", ["hold", "release"])
def test_twice_is_as_good_as_once(state: str, port: WatchedPort, capsys: pytest.CaptureFixture[str]) -> None:
    in_motion(port)
    first, second = (stop(capsys, "--state", state) for _ in range(2))
    assert (first, port.rig.in_safe_state()) == (second, True)
