"""`sinew run`: what it says and leaves when something ends it before its plan does.

The bench is the emulator's in virtual time, and the whole command runs in this process.
"""

import json
import signal
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from campaigns.same_numbers import TINY
from tests.contracts.emulated_bench import WatchedPort, rig_file, virtual_port
from tests.contracts.virtual_run import RunHere, interrupt, run, spoken, torques

SIGNALS = {
    signal.SIGINT: "interrupted by Ctrl-C",
    signal.SIGTERM: "terminated",
    signal.SIGHUP: "the terminal closed",
}


@pytest.mark.parametrize(
    ("number", "state"), [(signal.SIGINT, "hold"), (signal.SIGTERM, "release"), (signal.SIGHUP, "release")]
)
def test_a_signal_ends_a_run_in_the_declared_safe_state(
    number: signal.Signals, state: str, run_here: RunHere, tmp_path: Path
) -> None:
    rig = rig_file(tmp_path, limits={"safe_state": state})
    interrupt(run_here.port, 3.0, number=number)
    told = run_here("--rig", rig, "--json")
    document = json.loads(told.out)
    keys = ("complete", "ended", "safe_state", "is_safe")
    assert [told.status, *(document[key] for key in keys)] == [1, False, SIGNALS[number], state, True]
    assert (run_here.port.rig.in_safe_state(), set(torques(run_here.port.rig))) == (True, {state == "hold"})


@dataclass(frozen=True)
class Interrupted:
    """A run that was interrupted three times. signals: whether what they do was the same before and after."""

    plan: Path
    out: Path
    status: int
    document: dict[str, Any]
    err: str
    signals: bool
    agenda: list[object]
    torques: list[bool]


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory: pytest.TempPathFactory) -> Interrupted:
    folder = tmp_path_factory.mktemp("interrupted")
    plan, out = folder / "tiny.toml", folder / "out"
    plan.write_text(TINY)
    before = [signal.getsignal(number) for number in SIGNALS]
    with pytest.MonkeyPatch.context() as patch:
        port = virtual_port(patch)
        interrupt(port, 3.0, 3.0, 3.03)
        status, said, err = spoken("run", str(plan), "--port", "/dev/bench", "--out", str(out), "--json")
    same = [signal.getsignal(number) for number in SIGNALS] == before
    return Interrupted(plan, out, status, json.loads(said), err, same, [*port.agenda], torques(port.rig))


def test_a_second_and_a_third_interrupt_change_nothing(interrupted: Interrupted) -> None:
    assert (interrupted.status, interrupted.agenda, any(interrupted.torques)) == (1, [], False)
    document = interrupted.document
    assert (document["ended"], document["groups_done"]) == ("interrupted by Ctrl-C", 0)
    assert (document["safe_state"], document["is_safe"]) == ("release", True)


def test_a_run_that_ended_early_says_how_to_go_on(interrupted: Interrupted) -> None:
    plan, out = interrupted.plan, interrupted.out
    assert interrupted.err.splitlines()[-1] == (
        f"sinew: interrupted by Ctrl-C; go on with: sinew run {plan} --rig paper --port /dev/bench --out {out} --resume"
    )


def test_an_unplugged_port_is_said_and_the_watchdogs_stop_the_motors(
    plan: str, out: Path, port: WatchedPort, capsys: pytest.CaptureFixture[str]
) -> None:
    port.agenda = [(port.now() + 3.0, lambda: setattr(port.rig, "unplugged", True))]
    told = run(capsys, plan, out)
    assert told.status == 1
    assert "the port is gone; plug it in again; 0 of 2 groups are recorded" in told.out
    assert "bus watchdog has stopped them where they are; switch the supply off" in told.out
    assert told.err.splitlines()[-1].startswith(f"sinew: go on with: sinew run {plan} ")
    port.rig.advance(port.spoke + 0.2)
    assert [state.is_tripped for state in port.rig.states().values()] == [True] * 5


def test_a_bench_without_cables_is_let_go_with_a_sentence(
    plan: str, out: Path, port: WatchedPort, capsys: pytest.CaptureFixture[str]
) -> None:
    told = run(capsys, plan, out)
    assert (told.status, any(torques(port.rig))) == (1, False)
    assert "expected -20 to 40 (tendon_travel_mm); is the cable off its pulley" in told.out
