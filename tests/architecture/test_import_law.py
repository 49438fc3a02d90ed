"""The line of rooms in the design: who may import whom."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from sinew.apps.cli import COMMANDS

ROOT = Path(__file__).resolve().parents[2]
ROOMS = sorted(path.parent for path in (ROOT / "src" / "sinew").glob("*/__init__.py"))


def test_every_import_contract_is_kept() -> None:
    linter = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run([linter, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.name)
def test_the_front_door_of_a_room_imports_nothing(room: Path) -> None:
    # The contracts name rooms that do not exist yet by `room.**`, which leaves the `__init__` out.
    tree = ast.parse((room / "__init__.py").read_text(encoding="utf-8"))
    imports = [node.lineno for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    assert imports == []


def imported(path: Path) -> Iterator[str]:
    """Yield what a file imports anywhere in it, as dotted names of modules and of what is taken from them."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            yield from (str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names))
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def test_nobody_but_the_command_line_imports_a_command() -> None:
    commands = {f"sinew.apps.{place.partition(':')[0]}" for place in COMMANDS}
    source = ROOT / "src" / "sinew"
    found = {str(path.relative_to(source)): commands.intersection(imported(path)) for path in source.rglob("*.py")}
    assert {path for path, names in found.items() if names} == set()
