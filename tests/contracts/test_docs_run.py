"""The pages of the documentation, run as their reader would.

Every Markdown page under docs, and README, is one test: its ```python blocks, and the lines of its ```console blocks
that start with `$ sinew`, run in order in one empty folder, and each must end well. Other lines of a console block are
what the reader sees. A page that takes long says `<!-- test: slow -->`, one that takes minutes `<!-- test: long -->`;
one that runs a bench says `<!-- test: realtime -->`.
"""

import sys
from pathlib import Path

import pytest
from tests.patience import until
from tools.pages import Step, run_page, steps

ROOT = Path(__file__).resolve().parents[2]


def pages() -> list[object]:
    found = []
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        text = path.read_text(encoding="utf-8")
        if "_build" not in path.parts and steps(text):
            marks = [pytest.mark.slow] if "<!-- test: slow -->" in text else []
            marks += [pytest.mark.slow, pytest.mark.long] if "<!-- test: long -->" in text else []
            marks += [pytest.mark.slow, pytest.mark.realtime] if "<!-- test: realtime -->" in text else []
            found.append(pytest.param(path, marks=marks, id=path.relative_to(ROOT).as_posix()))
    return found


@pytest.mark.parametrize("page", pages())
def test_a_page_runs_from_top_to_bottom(page: Path, tmp_path: Path) -> None:
    for step, done in run_page(page.read_text(encoding="utf-8"), tmp_path):
        assert done.returncode == 0, f"{step.text}\n{done.stdout}\n{done.stderr}"


def test_a_page_is_taken_apart_in_the_order_of_reading() -> None:
    page = "```python\na = 1\n```\ntext\n```console\n$ sinew check plan.toml \\\n    --json\nsaid\n$ make test\n```\n"
    assert steps(page) == [Step("python", "a = 1\n"), Step("console", "sinew check plan.toml      --json")]


@pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals of Linux")
def test_what_a_page_leaves_running_ends_with_it(tmp_path: Path) -> None:
    page = "```console\n$ sinew emulate --link bench > log 2>&1 &\n```\n"
    bench = tmp_path / "bench"
    was_there = [until(bench.exists, 60.0) for _ in run_page(page, tmp_path)]
    gone = until(lambda: not bench.is_symlink(), 60.0)
    assert (was_there, gone) == ([True], True)
