"""The pages of the documentation, run as their reader would.

Every Markdown page under docs, and README, is one test: its ```python blocks, and the lines of its ```console blocks
that start with `$ sinew`, run in order in one empty folder, and each must end well. Other lines of a console block are
what the reader sees. A page that takes long says `<!-- test: slow -->`; one that runs a bench says
`<!-- test: realtime -->`.
"""

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```(python|console)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Step:
    """One thing the reader runs: Python text, or one command line."""

    language: str
    text: str


def steps(page: str) -> list[Step]:
    found: list[Step] = []
    for language, body in BLOCK.findall(page):
        if language == "python":
            found.append(Step(language, body))
        else:
            lines = body.replace("\\\n", " ").splitlines()
            found += [Step(language, line[2:]) for line in lines if line.startswith("$ sinew")]
    return found


def pages() -> list[object]:
    found = []
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        text = path.read_text(encoding="utf-8")
        if "_build" not in path.parts and steps(text):
            marks = [pytest.mark.slow] if "<!-- test: slow -->" in text else []
            marks += [pytest.mark.slow, pytest.mark.realtime] if "<!-- test: realtime -->" in text else []
            found.append(pytest.param(path, marks=marks, id=path.relative_to(ROOT).as_posix()))
    return found


@pytest.mark.parametrize("page", pages())
def test_a_page_runs_from_top_to_bottom(page: Path, tmp_path: Path) -> None:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "MPLBACKEND": "agg"}
    script: list[str] = []
    for step in steps(page.read_text(encoding="utf-8")):
        if step.language == "python":
            # A later block sees the names of the earlier ones, as in one session.
            script.append(step.text)
            command = [sys.executable, "-W", "error", "-c", "\n".join(script)]
        else:
            command = ["bash", "-ceu", step.text]
        done = subprocess.run(
            command,
            cwd=tmp_path,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{step.text}\n{done.stdout}\n{done.stderr}"


def test_a_page_is_taken_apart_in_the_order_of_reading() -> None:
    page = "```python\na = 1\n```\ntext\n```console\n$ sinew check plan.toml \\\n    --json\nsaid\n$ make test\n```\n"
    assert steps(page) == [Step("python", "a = 1\n"), Step("console", "sinew check plan.toml      --json")]
