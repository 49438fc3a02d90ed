"""The emulated bench of a dashboard: begun anew for each run, as its rig, in space where its plan bends."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.contracts import fake_run
from tests.contracts.serving import RIG, Served, fake_command, plan, serving, until
from tests.unit.dashboard_journal import run_folder

from sinew.apps.bench.run_control import listening
from sinew.bench.stops import Steering
from sinew.plan.toml import dump_rig, load_rig

BENT = "[pose]\nbend_deg = 20\nazimuth_deg = 90\n"
FLAG = "--in-space"


class Commands:
    """Commands of a bench that is none, as they came. late: whether it never gets its port."""

    late = False

    def __init__(self) -> None:
        self.emulated = list[tuple[str, ...]]()

    def __call__(self, *words: str) -> list[str]:
        if words[0] == "run":
            return fake_command(*words)
        self.emulated.append(words)
        there = "" if self.late else f"pathlib.Path({words[2]!r}).touch(); "
        return [sys.executable, "-S", "-c", f"import pathlib, time; {there}time.sleep(600)", *words]


@pytest.fixture
def commands() -> Commands:
    return Commands()


@pytest.fixture
def served(tmp_path: Path, commands: Commands) -> Iterator[Served]:
    with serving(tmp_path / "runs", bench="emulator", port=None, command=commands) as served:
        yield served


def run_once(served: Served, name: str, text: str, rig: str = RIG) -> None:
    """Run a plan until it is stopped."""
    assert served.page().says("start", name=name, plan=text, rig=rig).status_code == 200
    until(lambda: served.runs_as("running"))
    served.steward.tell("stop")
    until(lambda: served.status()["run"] is None)


def test_each_run_has_an_emulated_bench_of_its_own_that_plays_its_rig_and_bends_where_its_plan_does(
    served: Served, commands: Commands
) -> None:
    rig = load_rig("paper")
    short = rig.model_copy(update={"name": "short"})
    played = []
    for name, text, own in (("one", plan(), rig), ("two", plan() + BENT, short), ("three", plan(), rig)):
        run_once(served, name, text, dump_rig(own))
        words = commands.emulated[-1]
        played.append((load_rig(words[words.index("--rig") + 1]).name, FLAG in words))
    assert played == [("paper", False), ("short", True), ("paper", False)]
    assert len(commands.emulated) == 3


def test_an_emulated_rig_without_masses_is_not_bent(served: Served, commands: Commands) -> None:
    rig = dump_rig(load_rig("paper").model_copy(update={"space": None}))
    said = served.page().says("start", name="one", plan=plan() + BENT, rig=rig).json()
    assert (said["ok"], "has no [space]" in said["sentence"]) == (False, True)
    assert commands.emulated == []


def test_an_emergency_while_the_bench_is_begun_ends_the_run_and_asks_no_port(
    served: Served, commands: Commands
) -> None:
    commands.late = True
    served.page().starts("one", fake_run.DEAF)
    until((served.runs / "one" / "control").exists)
    outcome = served.steward.order_emergency().end.result()
    assert outcome.is_safe
    assert "no motor was told anything" in outcome.sentence
    assert served.bench.stops == []


def test_an_emulator_that_ends_at_once_is_said(tmp_path: Path) -> None:
    def command(*words: str) -> list[str]:
        code = "import time; time.sleep(600)" if words[0] == "run" else "raise SystemExit('no such rig')"
        return [sys.executable, "-S", "-c", code]

    with serving(tmp_path / "runs", bench="emulator", port=None, command=command) as served:
        served.page().starts()
        sentence = until(lambda: served.status()["last"])["sentence"]
    assert sentence.startswith("the emulated bench has ended: no such rig; see ")


def test_a_start_leaves_the_emulated_bench_to_a_run_in_a_terminal(served: Served, commands: Commands) -> None:
    with listening(run_folder(served.runs / "by-hand", ()), Steering(lambda: 0.0)):
        said = served.page().starts()
    assert (said.status_code, "by-hand, begun in a terminal" in said.json()["sentence"]) == (409, True)
    assert commands.emulated == []


def test_a_name_that_is_taken_leaves_the_emulated_bench_alone(served: Served, commands: Commands) -> None:
    (served.runs / "one").mkdir()
    assert (served.page().starts("one").status_code, commands.emulated) == (409, [])


def test_where_no_emulated_bench_was_begun_an_emergency_finds_nothing_that_moves(served: Served) -> None:
    said = served.page().says("emergency").json()
    assert (said["ok"], said["sentence"]) == (
        True,
        "no emulated bench is there, so no motor was told anything",
    )
