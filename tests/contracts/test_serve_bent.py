"""Bent plans at the steward: the emulated bench is begun anew in space for one, upright again for the next."""

import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from tests.contracts import fake_run
from tests.contracts.serving import RIG, Served, fake_command, plan, serving, until

from sinew.measure.errors import FileError
from sinew.plan.toml import dump_rig, load_rig

BENT = "[pose]\nbend_deg = 20\nazimuth_deg = 90\n"
FLAG = "--in-space"


def bent(behaviour: str = fake_run.OBEDIENT) -> str:
    return plan(behaviour) + BENT


class Commands:
    """Commands of a bench that is none, as they came. late: whether one in space never gets its port."""

    def __init__(self, late: bool = False) -> None:
        self.late, self.words = late, list[tuple[str, ...]]()

    def __call__(self, *words: str) -> list[str]:
        self.words.append(words)
        if words[0] == "run":
            return fake_command(*words)
        there = "" if self.late and FLAG in words else f"pathlib.Path({words[2]!r}).touch(); "
        lasting = f"import pathlib, time; {there}print('{{}}', flush=True); time.sleep(600)"
        return [sys.executable, "-S", "-c", lasting, *words]

    def last(self, command: str) -> tuple[str, ...]:
        return next(words for words in reversed(self.words) if words[0] == command)


@pytest.fixture
def begin(tmp_path: Path) -> "Iterator[Callable[..., tuple[Served, Commands]]]":
    """Give what begins a steward with such a bench."""
    open_ones = []

    def opened(late: bool = False, rig: str = "paper") -> tuple[Served, Commands]:
        commands = Commands(late)
        one = serving(tmp_path / "runs", bench="emulator", port=None, command=commands, rig=rig)
        open_ones.append(one)
        return one.__enter__(), commands

    yield opened
    for one in open_ones:
        one.__exit__(None, None, None)


def started(served: Served, name: str, text: str, rig: str = RIG) -> dict[str, object]:
    """Have a page start a plan, and return what is answered."""
    answer = served.page().says("start", name=name, plan=text, rig=rig)
    return dict(answer.json())


def over(served: Served) -> None:
    served.steward.tell("stop")
    until(lambda: served.status()["run"] is None)


def test_a_bent_plan_has_the_emulated_bench_begun_anew_in_space(begin: Callable[..., tuple[Served, Commands]]) -> None:
    served, commands = begin()
    assert FLAG not in commands.last("emulate")
    said = started(served, "one", bent())
    assert (said["ok"], "begun anew" in str(said["sentence"])) == (True, True)
    assert FLAG in commands.last("emulate")
    assert commands.last("run")[commands.last("run").index("--wait") + 1] == "180"


def test_an_emulator_that_ends_at_once_is_said(tmp_path: Path) -> None:
    def command(*words: str) -> list[str]:
        return [sys.executable, "-S", "-c", "raise SystemExit('no such rig')", *words]

    with (
        pytest.raises(FileError, match="the emulator does not get ready: no such rig"),
        serving(tmp_path / "runs", bench="emulator", port=None, command=command),
    ):
        pass


def test_the_pages_are_begun_before_the_emulated_bench_is_ready(tmp_path: Path) -> None:
    page, go = tmp_path / "page", tmp_path / "go"

    def command(*words: str) -> list[str]:
        waits = f"import pathlib, time\nwhile not pathlib.Path({str(go)!r}).exists(): time.sleep(0.01)"
        lasting = f"pathlib.Path({words[2]!r}).touch(); print('{{}}', flush=True); time.sleep(600)"
        return [sys.executable, "-S", "-c", f"{waits}\n{lasting}", *words]

    begun = f"import pathlib, sys; pathlib.Path({str(page)!r}).touch(); sys.stdin.read()"
    pages = (sys.executable, "-S", "-c", begun)
    with serving(tmp_path / "runs", bench="emulator", port=None, command=command, page=pages, awaits=False) as served:
        until(page.exists)
        was_ready = served.steward._emulator is not None and served.steward._emulator.is_ready
        go.touch()
        served.steward.await_bench(threading.Event())
        until(lambda: served.steward._emulator is not None and served.steward._emulator.is_ready)
    assert not was_ready


def test_a_second_bent_plan_finds_the_bench_that_is_there(begin: Callable[..., tuple[Served, Commands]]) -> None:
    served, commands = begin()
    for name in ("one", "two"):
        started(served, name, bent())
        until(lambda: served.runs_as("running"))
        over(served)
    assert [words[0] for words in commands.words].count("emulate") == 2
    assert "--wait" not in commands.last("run")


def test_an_emergency_while_the_bench_is_begun_anew_ends_the_run_and_asks_no_port(
    begin: Callable[..., tuple[Served, Commands]],
) -> None:
    served, _ = begin(late=True)
    (Path(served.steward.port or "")).unlink()
    started(served, "one", bent(fake_run.DEAF))
    until((served.runs / "one" / "control").exists)
    outcome = served.steward.order_emergency().end.result()
    assert outcome.is_safe
    assert "no motor was told anything" in outcome.sentence
    assert served.bench.stops == []


def test_the_emulated_bench_plays_the_rig_of_the_run(begin: Callable[..., tuple[Served, Commands]]) -> None:
    served, commands = begin()
    rig = load_rig("paper")
    length = rig.silicone.length.model_copy(update={"value": 0.091})
    short = rig.model_copy(update={"name": "short", "silicone": rig.silicone.model_copy(update={"length": length})})
    for name in ("one", "two"):
        started(served, name, plan(), dump_rig(short))
        until(lambda: served.runs_as("running"))
        over(served)
    words = commands.last("emulate")
    assert load_rig(words[words.index("--rig") + 1]) == short
    assert [words[0] for words in commands.words].count("emulate") == 2  # the second run found it there
    emulator = served.steward._emulator
    assert emulator is not None
    assert emulator.plays(short, in_space=False)
    started(served, "three", plan())
    until(lambda: served.runs_as("running"))
    words = commands.last("emulate")
    assert load_rig(words[words.index("--rig") + 1]) == rig


def test_an_emulated_rig_without_masses_is_not_bent(begin: Callable[..., tuple[Served, Commands]]) -> None:
    served, commands = begin()
    said = started(served, "one", bent(), dump_rig(load_rig("paper").model_copy(update={"space": None})))
    assert (said["ok"], "has no [space]" in str(said["sentence"])) == (False, True)
    assert FLAG not in commands.last("emulate")


def test_an_emulated_bench_that_was_killed_at_rest_is_said_to_be_gone_and_begun_anew_by_the_next_run(
    begin: Callable[..., tuple[Served, Commands]],
) -> None:
    served, commands = begin()
    before = served.steward.status()["bench"]["is_there"]
    emulator = served.steward._emulator
    assert emulator is not None
    assert emulator._process is not None
    emulator._process.send_signal(9)
    until(lambda: not served.steward.status()["bench"]["is_there"])
    started(served, "one", plan())
    until(lambda: served.runs_as("running"))
    assert (before, served.steward.status()["bench"]["is_there"]) == (True, True)
    assert [words[0] for words in commands.words].count("emulate") == 2
