"""What every command of `sinew` keeps to: help with an example, exit status, one line on stderr, quiet pipes."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from tests.contracts.commands import command_lines, refused

from sinew import __version__
from sinew.apps.cli import GROUPS, app, main

SINEW = Path(sys.executable).with_name("sinew")
COMMANDS = (
    "analyse", "calibrate", "check", "design", "doctor", "emulate", "export",
    "identify", "import", "joint", "look", "model", "modes", "pose", "predict", "report", "reproduce", "run", "runs",
    "serve", "simulate", "stop", "track", "tune",
)  # fmt: skip


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([SINEW, *arguments], capture_output=True, text=True, check=False)


def test_the_commands_are_those_of_the_reference_each_once_in_one_of_four_groups() -> None:
    assert tuple(sorted(typer.main.get_command(app).commands)) == COMMANDS  # type: ignore[attr-defined]
    assert len(GROUPS) == 4
    assert sorted(name for names in GROUPS.values() for name in names) == list(COMMANDS)


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_ends_with_an_example_that_parses(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*command.split(), "--help"]) == 0
    last_paragraph = capsys.readouterr().out.rstrip().split("\n\n")[-1]
    assert last_paragraph.split()[:2] == ["Example:", "sinew"]
    if command:
        name, *words = last_paragraph.split("Example: sinew ")[-1].split()
        found = typer.main.get_command(app).commands[command]  # type: ignore[attr-defined]
        assert name == command
        assert found.make_context(command, words).params


def test_help_loads_neither_jax_nor_matplotlib_nor_rich() -> None:
    code = (
        "import sys; from sinew.apps.cli import main; main(['analyse', '--help']);"
        "print([m for m in ('jax', 'matplotlib', 'rich') if m in sys.modules],"
        " file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]"


def test_the_version_is_the_packages() -> None:
    assert run("--version").stdout == f"sinew {__version__}\n"


def test_a_shell_completes_the_name_of_a_command() -> None:
    asked = os.environ | {"_SINEW_COMPLETE": "complete_bash", "COMP_WORDS": "sinew ana", "COMP_CWORD": "1"}
    done = subprocess.run([SINEW], capture_output=True, text=True, check=False, env=asked)
    assert done.stdout.split() == ["analyse"]


@command_lines("""
    chek => Did you mean 'check'?
    compare paper ring.toml => sinew compare is now sinew predict RIG RIG...
    workspace paper => sinew workspace is now sinew pose --map
    check paper --rgi paper => --rgi
    check => PLAN
    simulate paper => --out
    simulate short --out x.nc --seed one => --seed
    analyse x.csv --kind decay --time t --response x => auto, ring-down, sweep, broadband, impact
    export x.nc --to xls --out x.xls => csv, mat, parquet, uff, mcap
    gait walk.csv => sinew gait is now sinew design --walk
    film x.nc => sinew film is now sinew report --film
    simulate short --out x.nc --without gravity => unknown effect 'gravity'
    analyse x.csv => cannot read x.csv
    analyse x.csv --gaps jump => --gaps is 'jump', expected one of refuse, split, bridge
    analyse x.nc --time t => are for tables
    report nowhere => found no recording nowhere
    reproduce --plan papre => did you mean paper?
""")
def test_a_wrong_command_line_is_one_line_and_status_2(
    arguments: tuple[str, ...], sentence: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sentence in refused(capsys, *arguments)
    assert list(here.iterdir()) == []


def test_a_wrong_command_line_leaves_the_process_with_status_2_and_one_line() -> None:
    done = run("check", "nope")
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)


@pytest.mark.slow
def test_json_is_the_only_thing_on_stdout() -> None:
    done = run("check", "short", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout)["plan"] == "short"


@pytest.mark.slow
def test_a_reader_that_leaves_early_causes_no_traceback() -> None:
    done = subprocess.run(
        ["bash", "-c", f"{SINEW} check paper | true; exit ${{PIPESTATUS[0]}}"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(("words", "status"), [("--version", 0), ("check nothing", 2), ("check paper", 1)])
def test_a_process_ends_with_its_status_and_all_that_others_registered(words: str, status: int) -> None:
    code = f"""
import atexit, sys
import sinew.plan.toml
from sinew.apps.cli import main
if {status == 1}:
    sinew.plan.toml.load_plan = None
sys.argv = ["sinew", *"{words}".split()]
try:
    found = main()
finally:
    atexit.register(print, "put away")
sys.exit(found)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == status
    assert done.stdout.endswith("put away\n")
    assert ("Traceback" in done.stderr) == (status == 1)


def test_a_process_without_stdout_ends_as_any_other() -> None:
    done = subprocess.run(["bash", "-c", f"{SINEW} --version >&-"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
