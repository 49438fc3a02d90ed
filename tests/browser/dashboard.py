"""`sinew serve` for tests in a real browser: a process of its own, its address, its end."""

import json
import os
import re
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from tests.contracts.serving import free_port

SINEW = Path(sys.executable).with_name("sinew")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
PATIENCE = 120.0

ARGUMENTS = [
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]
"""Of every browser. Most have no graphics processor, as a page must do with: drawing in space by software costs more
time than all the rest."""

IN_SPACE = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
"""Of one that draws in space, by software."""


@dataclass
class Served:
    """A dashboard at work. link: its address with the token. runs: its folder of runs."""

    link: str
    runs: Path
    process: subprocess.Popen[str]

    @property
    def base(self) -> str:
        """The address without the token."""
        return self.link.split("/#")[0]

    def truth(self) -> dict[str, Any]:
        """End it, the emulator with it, and return what truly happened on the bench."""
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(PATIENCE)
        return dict(json.loads((self.runs / ".bench" / "truth.json").read_text()))

    def await_run(self, seconds: float = PATIENCE) -> Path:
        """Return the folder of the first run that has a journal."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            found = sorted(self.runs.glob("*/journal.sqlite"))
            if found:
                return found[0].parent
            time.sleep(0.1)
        raise AssertionError("no run begins")


def choose_plan(page: Any, name: str) -> None:
    """Choose a plan of the library; the list of a select may close again while the page is still busy."""
    option = page.get_by_role("option", name=name)
    for _ in range(10):
        page.get_by_label("Begin with the plan").click()
        page.wait_for_timeout(1000)
        if option.count():
            option.first.click()
            return
        page.keyboard.press("Tab")
    raise AssertionError(f"no plan {name} can be chosen")


_AT_REST = """() => {
  const ends = (one) => one.effect?.getComputedTiming().endTime !== Infinity;
  const moves = document.getAnimations().some((one) => one.playState === "running" && ends(one));
  return !moves && !document.querySelector("[class*=-enter-from], [class*=-enter-active], [class*=-leave-active]");
}"""
"""Whether nothing in a page fades in or out any more; what turns for ever, as a spinner, is let be."""


def findings(page: Any, within: str | None = None) -> list[tuple[str, str, str]]:
    """Return whatever axe-core finds in a page that is at rest, or within a part of it, however small."""
    playwright = pytest.importorskip("playwright.sync_api")
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="no axe-core: make setup-dev installs it")
    page.wait_for_function(_AT_REST, timeout=20_000)
    try:
        found = axe.Axe().run(page, within)
    except playwright.Error:  # on a busy computer a page that lost its server for a moment loads itself anew
        page.wait_for_function("window.Sinew && Sinew.status()")
        found = axe.Axe().run(page, within)
    return [
        (rule["id"], node["html"][:160], node["failureSummary"][:200])
        for rule in found.response["violations"]
        for node in rule["nodes"]
    ]


def plan_text(page: Any) -> str:
    """Return the plan in the editor, which draws only the lines that are seen."""
    page.wait_for_selector("#sinew-plan-text .cm-content[aria-label]")
    page.wait_for_function("document.querySelector('#sinew-plan-text .cm-content').textContent")
    return str(
        page.evaluate("""() => {
      const place = document.querySelector("#sinew-plan-text").firstElementChild;
      return window.getElement(Number(place.id.slice(1))).editor.state.doc.toString();
    }""")
    )


def edit_plan(page: Any, before: str, after: str) -> None:
    """Write something else into the plan. before: a pattern."""
    text = re.sub(before, after, plan_text(page), count=1)
    page.locator("#sinew-plan-text .cm-content").fill(text)


@contextmanager
def served(runs: Path, *options: str) -> Iterator[Served]:
    """Give a dashboard whose pages are up; it is over at the end, whatever happens."""
    runs.mkdir(parents=True, exist_ok=True)
    command = [str(SINEW), "serve", "--runs", str(runs), "--http", f"127.0.0.1:{free_port()}", *options]
    with (runs / "serve.err").open("w") as err:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=err, text=True, start_new_session=True)
    try:
        assert process.stdout is not None
        if not select.select([process.stdout], [], [], PATIENCE)[0]:
            pytest.fail(f"the dashboard does not get ready: {(runs / 'serve.err').read_text()}")
        link = process.stdout.readline().strip()
        assert "#token=" in link, (runs / "serve.err").read_text()
        yield Served(link, runs, process)
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(30.0)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        if process.stdout is not None:
            process.stdout.close()
