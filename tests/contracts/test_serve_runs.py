"""Runs as the dashboard begins, steers, ends and finds them: by real processes that move nothing."""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.contracts import fake_run
from tests.contracts.serving import PATIENCE, RIG, TOKEN, Served, fake_command, plan, serving, until
from tests.patience import LONG_S
from tests.unit.bench_journal import RIG_TEXT
from tests.unit.dashboard_journal import GROUPS, PLAN_TEXT, run_folder

from sinew.apps.bench.run_control import CONTROL, listening, send_control
from sinew.apps.dashboard.access import Access
from sinew.apps.dashboard.run_desk import RESUMED, ending_sentence, spawn
from sinew.bench.stops import Steering, StopReport
from sinew.measure.errors import PortError


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    with serving(tmp_path / "runs") as served:
        yield served


def test_the_folder_of_a_run_holds_what_was_asked_for(served: Served) -> None:
    served.page().starts("monday")
    folder = served.runs / "monday"
    assert [(folder / name).read_text() for name in ("plan.toml", "rig.toml")] == [plan(), RIG]


def test_a_run_rests_and_goes_on(served: Served) -> None:
    page = served.page()
    page.starts()
    until(lambda: served.runs_as("running"))
    page.says("pause")
    paused = served.status()["run"]["state"]
    page.says("resume")
    assert (paused, served.status()["run"]["state"]) == ("paused", "running")


@pytest.mark.parametrize("command", ["stop", "hold", "release"])
def test_a_run_ends_when_it_is_told_so_and_its_last_words_are_kept(served: Served, command: str) -> None:
    page = served.page()
    page.starts()
    until(lambda: served.runs_as("running"))
    page.says(command)
    last = until(lambda: served.status()["last"])
    assert (last["sentence"], last["exit"]) == (f"{command} was asked for; nothing moves", 0)


def cut_off(served: Served, name: str = "one") -> Path:
    """Leave a run in the folder of runs that recorded two groups and was killed."""
    folder = run_folder(served.runs / name, range(2))
    (folder / "plan.toml").write_text(PLAN_TEXT)
    (folder / "rig.toml").write_text(RIG_TEXT)
    return folder


def test_a_run_that_ended_early_goes_on_in_its_folder(tmp_path: Path) -> None:
    asked: list[tuple[str, ...]] = []

    def command(*words: str) -> list[str]:
        asked.append(words)
        return fake_command(*words)

    with serving(tmp_path / "runs", command=command) as served:
        folder = cut_off(served)
        assert served.page().says("continue", name="one").status_code == 200
        until(lambda: served.runs_as("running"))
        assert asked[-1][-1] == "--resume"
        assert asked[-1][asked[-1].index("--out") + 1] == str(folder)


def test_a_run_that_was_begun_in_a_terminal_goes_on_by_what_its_journal_holds(served: Served) -> None:
    folder = run_folder(served.runs / "one", range(2))
    assert served.page().says("continue", name="one").status_code == 200
    assert [(folder / name).read_text() for name in ("plan.toml", "rig.toml")] == [PLAN_TEXT, RIG_TEXT]


@pytest.mark.parametrize("name", ["none", "../one", "whole", None])
def test_there_is_nothing_to_go_on_with(served: Served, name: str | None) -> None:
    run_folder(served.runs / "whole")
    answer = served.page().says("continue", **({} if name is None else {"name": name}))
    assert answer.status_code in (404, 409, 422)
    assert served.status()["run"] is None


def test_how_far_a_run_came_that_was_killed_is_told(served: Served) -> None:
    cut_off(served)
    served.page().says("continue", name="one")
    until(lambda: served.runs_as("running"))
    os.kill(served.status()["run"]["pid"], signal.SIGKILL)
    last = until(lambda: served.status()["last"])
    assert (last["complete"], last["can_resume"], last["groups_done"], last["groups"]) == (False, True, 2, GROUPS)
    assert "SIGKILL" in last["sentence"]


def test_a_run_that_does_not_listen_yet_is_ended_by_a_signal(served: Served) -> None:
    page = served.page()
    page.starts()
    assert page.says("stop").status_code == 200
    assert until(lambda: served.status()["last"])["name"] == "one"


def test_a_run_that_was_taken_up_again_and_refused_does_not_say_how_it_ended_before(tmp_path: Path) -> None:
    (tmp_path / "run.log").write_text('{\n"ended": "before", "left": "nothing"\n}\n' + RESUMED + "\nsinew: no port\n")
    assert ending_sentence(tmp_path) == "no port"


def test_of_starts_at_the_same_time_one_wins(served: Served) -> None:
    pages = [served.page() for _ in range(4)]
    codes = []

    def start(number: int) -> None:
        codes.append(pages[number].starts(f"run-{number}").status_code)

    threads = [threading.Thread(target=start, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert codes.count(200) == 1
    assert len(list(served.runs.glob("run-*"))) == 1


def test_a_name_that_is_taken_is_not_used_again(served: Served) -> None:
    page = served.page()
    (served.runs / "one").mkdir()
    assert page.starts("one").status_code == 409


def test_an_emergency_ends_a_run_that_obeys(served: Served) -> None:
    served.page().starts()
    until(lambda: served.runs_as("running"))
    served.page().says("emergency")
    assert until(lambda: served.status()["last"])["exit"] == 0
    assert served.bench.stops == []


def test_an_emergency_from_somebody_who_only_looks_is_obeyed(served: Served) -> None:
    served.page()
    assert served.page().says("emergency").status_code == 200
    assert served.bench.stops == [("/dev/bench", "paper", None)]


@pytest.mark.parametrize("behaviour", [fake_run.DEAF, fake_run.LOUT])
def test_an_emergency_ends_a_run_that_does_not_answer_and_stops_the_bench(served: Served, behaviour: str) -> None:
    served.page().starts(behaviour=behaviour)
    sign = "control" if behaviour == fake_run.DEAF else "began"
    until((served.runs / "one" / sign).exists)
    served.page().says("emergency")
    assert until(lambda: served.status()["last"])["exit"] == -signal.SIGKILL
    assert served.bench.stops == [("/dev/bench", "paper", None)]


def test_an_emergency_is_one_for_the_bench_and_an_ordinary_stop_is_none(served: Served) -> None:
    page = served.page()
    page.says("stop")
    page.says("emergency")
    assert until(lambda: served.bench.urgent == [False, False, True, True])  # it is answered before the let-down


def test_an_emergency_makes_one_of_an_ordinary_stop_and_is_answered_anew(served: Served) -> None:
    served.bench.gate.clear()
    page = served.page()
    thread = threading.Thread(target=page.says, args=("release",))
    thread.start()
    until(lambda: served.bench.urgent)
    order = served.steward.order_emergency()
    early = order.answer.done()
    served.bench.gate.set()
    order.end.result(10)
    thread.join()
    assert (early, served.bench.urgent) == (False, [False, True])


def test_a_run_that_has_yet_to_reach_a_motor_is_given_the_time(served: Served) -> None:
    served.page().starts(behaviour=fake_run.RELUCTANT)
    until(lambda: served.runs_as("running"))
    said = served.page().says("emergency").json()
    assert (said["ok"], said["sentence"]) == (True, "emergency is done")
    assert until(lambda: served.status()["last"])["exit"] == 0
    assert served.bench.stops == []


def test_a_run_that_never_reaches_its_motors_is_ended_in_the_end(served: Served) -> None:
    served.page().starts(behaviour=fake_run.FORLORN)
    until(lambda: served.runs_as("running"))
    served.page().says("emergency")
    assert until(lambda: served.status()["last"])["exit"] == -signal.SIGKILL
    assert served.bench.urgent == [True, True]


def test_a_second_emergency_joins_the_first(served: Served) -> None:
    served.bench.gate.clear()
    orders = [served.steward.order_emergency() for _ in range(3)]
    served.bench.gate.set()
    assert {order.end.result(10).at for order in orders} == {orders[0].end.result(10).at}
    assert len(served.bench.stops) == 1


def test_no_run_begins_while_the_bench_is_brought_to_rest(served: Served) -> None:
    page = served.page()
    served.bench.gate.clear()
    served.steward.order_emergency()
    assert page.starts().status_code == 409


def test_an_emergency_takes_back_a_run_that_is_just_being_begun(tmp_path: Path) -> None:
    began, go_on = threading.Event(), threading.Event()

    def slowly(*words: str) -> list[str]:
        began.set()
        go_on.wait(LONG_S)
        return fake_command(*words)

    with serving(tmp_path / "runs", command=slowly) as served:
        page, codes = served.page(), []
        thread = threading.Thread(target=lambda: codes.append(page.starts().status_code))
        thread.start()
        began.wait(LONG_S)
        served.page().says("emergency")
        go_on.set()
        thread.join()
        assert (codes, served.status()["run"]) == ([409], None)


@pytest.mark.parametrize(("command", "state"), [("hold", "hold"), ("release", "release"), ("stop", None)])
def test_a_bench_without_a_run_is_brought_to_rest(served: Served, command: str, state: str | None) -> None:
    assert served.page().says(command).status_code == 200
    assert served.bench.stops == [("/dev/bench", "paper", state)]


def test_without_a_bench_no_run_begins(tmp_path: Path) -> None:
    with serving(tmp_path / "runs", bench=None, port=None) as served:
        answer = served.page().starts()
    assert (answer.status_code, "--port-bench PORT or --emulate" in answer.json()["sentence"]) == (409, True)


def test_a_run_that_was_begun_in_a_terminal_is_told_and_an_emergency_stops_it(tmp_path: Path) -> None:
    def taken(*_: Any) -> StopReport:
        raise PortError("/dev/bench is taken")

    folder, steering = run_folder(tmp_path / "runs" / "by-hand", ()), Steering(lambda: 0.0)
    with listening(folder, steering), serving(tmp_path / "runs", control=send_control, rest=taken) as served:
        assert until(lambda: served.status()["elsewhere"]) == "by-hand"
        said = served.page().says("emergency").json()
    assert (said["ok"], said["sentence"]) == (
        True,
        "the run by-hand, begun in a terminal: nothing has moved, and the run will not start",
    )


@pytest.mark.parametrize("bench", ["emulator", None])
def test_an_emergency_is_not_done_where_a_run_in_a_terminal_does_not_confirm(tmp_path: Path, bench: str | None) -> None:
    silent = threading.Event()

    def control(*_: object, **__: object) -> dict[str, Any]:
        if silent.is_set():
            raise PortError("nobody listens")
        return {"ok": True}

    folder = run_folder(tmp_path / "runs" / "by-hand", ())
    (folder / CONTROL).touch()
    with serving(tmp_path / "runs", bench=bench, port=None, control=control) as served:
        until(lambda: served.status()["elsewhere"])
        silent.set()
        outcome = served.steward._emergency.order(None, served.steward.port, served.steward._spec).end.result()
    assert not outcome.is_safe
    assert outcome.sentence == "the run by-hand, begun in a terminal: it does not answer; switch the supply off"


def test_a_command_ends_with_whoever_began_it(tmp_path: Path) -> None:
    code = (
        "import signal, sys, time; from sinew.apps import cli; signal.signal(signal.SIGTERM, lambda *_: sys.exit(7));"
        "cli.main = lambda: time.sleep(600); import runpy; sys.argv = ['child', 'run'];"
        "runpy.run_module('sinew.apps.dashboard', run_name='__main__')"
    )
    process = spawn([sys.executable, "-c", code], tmp_path / "log")
    time.sleep(1.0)
    goes_on = process.poll() is None
    assert process.stdin is not None
    process.stdin.close()
    assert (goes_on, process.wait(PATIENCE)) == (True, 7)


@pytest.mark.parametrize("bench", ["emulator", "port"])
def test_a_run_ends_with_the_steward(tmp_path: Path, bench: str) -> None:
    def command(*words: str) -> list[str]:
        if words[0] == "run":
            return fake_command(*words)
        ready = f"import pathlib, time; pathlib.Path({words[2]!r}).touch(); print('{{}}', flush=True); time.sleep(600)"
        return [sys.executable, "-c", ready, *words]

    with serving(tmp_path / "runs", bench=bench, command=command) as served:
        served.page().starts()
        until(lambda: served.runs_as("running"))
        run, emulator = served.steward._desk.run, served.steward._emulator
        served.steward.__exit__()
    assert run is not None
    assert run.process.poll() == 0
    assert emulator is None or not emulator.is_ready


def test_a_page_server_that_dies_is_begun_again_and_the_run_does_not_notice(served: Served) -> None:
    served.page().starts()
    until(lambda: served.runs_as("running") and served.status()["page"] == "up")
    before, run = served.steward._page.pid, served.status()["run"]["pid"]
    assert before is not None
    os.kill(before, signal.SIGKILL)
    until(lambda: served.steward._page.pid not in (None, before) and served.status()["page"] == "up")
    assert served.status()["run"]["pid"] == run


def test_two_stewards_do_not_look_after_the_same_runs(served: Served) -> None:
    with pytest.raises(Exception, match="another `sinew serve` looks after"), serving(served.runs):
        pass


def test_a_port_that_is_taken_is_said_before_anything_is_begun(served: Served, tmp_path: Path) -> None:
    taken = Access(TOKEN, "127.0.0.1", served.access.steering_port)
    with pytest.raises(Exception, match="cannot listen on"), serving(tmp_path / "other", access=taken):
        pass
    assert not (tmp_path / "other").exists()
