"""A dashboard whose runs are played: every state of its pages without a bench, without keeping time with one."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
from tests.browser import played_run
from tests.contracts.serving import PATIENCE, Bench, free_port, until
from tests.unit.bench_journal import RIG_TEXT

from sinew.apps.dashboard.access import Access, new_token
from sinew.apps.dashboard.steward import Settings, Steward

LATE = [sys.executable, "-c", "import os, sys, time; time.sleep(12); os.execv(sys.argv[1], sys.argv[1:])"]
"""What is put before a command so that it begins later."""

PLAN = """
name = "{name}"
[pretension]
pretension_mm = [2, 6]
rest_s = 0.5
[sweep]
frequency_hz = [2.5, 3, 3.5]
settle_s = 0.3
periods = 2
repeats = {repeats}
"""


class Stage:
    """A dashboard at work. link: its address with the token. bench: what is brought to rest where no run does it."""

    def __init__(self, steward: Steward, bench: Bench, link: str) -> None:
        self.steward, self.bench, self.link = steward, bench, link
        self.base = link.split("/#")[0]
        self.runs = steward.settings.runs

    def begin(self, name: str, behaviour: str = "", *, repeats: int = 20) -> None:
        """Begin a run, as a page does."""
        self.steward.start(name, PLAN.format(name=f"watched-{behaviour}", repeats=repeats), RIG_TEXT)

    def until(self, state: str) -> None:
        """Wait until the run is at something; "over": until there is none."""
        until(lambda: (self.steward.status()["run"] or {"state": "over"})["state"] == state)

    def clear(self) -> None:
        """End the run there is, and wait for whatever else is under way."""
        run = self.steward._desk.run
        if run is not None:
            run.process.send_signal(9)
            self.until("over")
        until(lambda: not self.steward.status()["stopping"])
        self.steward._desk.last = self.steward._emergency.last = None

    def kill_pages(self) -> None:
        """End the pages' server and let it begin again only after a while: what a page sees of one that is lost."""
        pid = self.steward._page.pid
        assert pid is not None
        self.steward._page._command[:0] = [] if self.steward._page._command[1] == "-c" else LATE
        os.kill(pid, signal.SIGKILL)


def played(*words: str) -> list[str]:
    return [sys.executable, played_run.__file__, words[words.index("--out") + 1], *words[-1:]]


@contextmanager
def staged(runs: Path, *, bench: str | None = "emulator") -> Iterator[Stage]:
    """Give a dashboard with played runs; what it began is over at the end. bench: what the pages take it for."""
    runs.mkdir(parents=True, exist_ok=True)
    port, resting = free_port(), Bench()
    resting.gate.set()
    told = Access(new_token(), "127.0.0.1", port)
    settings = Settings(
        access=told,
        runs=runs,
        bench="port" if bench else None,
        port="/dev/bench" if bench else None,
        command=played,
        rest=resting.rest,
    )
    steward = Steward(settings)
    if bench == "emulator":  # as the pages take it: there is no process to look after
        object.__setattr__(settings, "bench", "emulator")
        steward._page._config["bench"] = "emulator"
    with steward:
        until(lambda: steward.page_state == "up")
        until(lambda: _is_up(f"http://127.0.0.1:{port}/sinew/style.css"))
        stage = Stage(steward, resting, f"http://127.0.0.1:{port}/#token={told.token}")
        try:
            yield stage
        finally:
            stage.clear()


def _is_up(url: str) -> bool:
    try:
        return httpx.get(url, timeout=PATIENCE, trust_env=False).status_code == 200
    except httpx.HTTPError:
        return False
