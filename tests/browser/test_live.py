"""A run in a real browser, on an emulated bench in real time: seen, paused, stopped at once, and kept whole."""

import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.browser.dashboard import Served, choose_plan, served
from tests.contracts.emulated_bench import alone, rig_file

from sinew.bench.record.journal import JournalReader

pytestmark = [pytest.mark.slow, pytest.mark.realtime]

Open = Callable[..., Any]

PLAN = """
name = "watched"
[pretension]
pretension_mm = [2]
rest_s = 0.5
[sweep]
frequency_hz = [2.5, 3, 3.5, 4]
settle_s = 1
periods = 3
repeats = {repeats}
"""
SAFE_WITHIN_S = 0.2


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Served]:
    """Give a dashboard with an emulated bench whose rig is left under hold, and a plan on its library."""
    runs = tmp_path / "runs"
    (runs / "plans").mkdir(parents=True)
    (runs / "plans" / "long.toml").write_text(PLAN.format(repeats=10))
    (runs / "plans" / "brief.toml").write_text(PLAN.format(repeats=1))
    rig = rig_file(tmp_path, limits={"safe_state": "hold"})
    with alone(), served(runs, "--emulate", "--rig", rig) as dashboard:
        yield dashboard


def start(page: Any, dashboard: Served, plan: str) -> Path:
    """Start a plan of the library from the page, as a user does, and return the run's folder when samples come."""
    page.goto(f"{dashboard.base}/plan")
    page.wait_for_selector("#sinew-duration")
    choose_plan(page, plan)
    page.wait_for_function("document.querySelector('#sinew-plan-text').textContent.includes('watched')")
    page.wait_for_selector("#sinew-start:not([disabled])")
    page.click("#sinew-start")
    page.wait_for_url(f"{dashboard.base}/")
    page.wait_for_function("Number(document.body.dataset.samples) > 50", timeout=120_000)
    return dashboard.await_run()


def test_a_newcomer_comes_to_a_finished_run_with_its_curve_by_three_clicks_in_a_minute(
    opened: Open, tmp_path: Path
) -> None:
    began = time.monotonic()
    with served(tmp_path / "runs", "--emulate") as dashboard:
        page = opened(dashboard, signed_in=False)
        # The address is pasted into a tab that shows the page already.
        page.evaluate("hash => { location.hash = hash; }", dashboard.link.split("#")[1])
        page.wait_for_function("Sinew.status()?.signed_in && !location.hash")
        for key in ("Tab", "Tab", "Enter", "Tab"):  # the stop, then past the head
            page.keyboard.press(key)
        assert page.evaluate("document.activeElement.textContent") == "Plan a run"
        page.get_by_role("link", name="Plan a run").click()
        page.get_by_role("button", name="Start", exact=True).click()
        page.wait_for_url(f"{dashboard.base}/")
        page.locator("#sinew-open-last").click(timeout=200_000)
        page.wait_for_function(
            "document.querySelector('.nicegui-echart')?.textContent.includes('4 mm')", timeout=120_000
        )
        assert time.monotonic() - began < 60.0
        page.wait_for_selector("tr >> text=frequency of the largest fundamental")
        page.wait_for_selector("[data-verdict] >> text=judged values")
        assert re.search(r"^f_r [1-9].* Hz at 4 mm", page.inner_text("[data-headline]"), re.M)
        assert "Recorded on the emulated bench: no motor moved" in page.inner_text("[data-headline]")


def test_a_run_is_watched_paused_resumed_and_stopped_at_once(opened: Open, bench: Served) -> None:
    page = opened(bench)
    folder = start(page, bench, "long")
    before = int(page.evaluate("Number(document.body.dataset.samples)"))
    page.wait_for_function(f"Number(document.body.dataset.samples) > {before + 100}")
    page.wait_for_function("/^[1-9]/.test(document.querySelector('#sinew-progress-text').textContent)", timeout=120_000)
    page.wait_for_function("document.querySelector('.nicegui-echart svg text') !== null")
    page.wait_for_function(
        "[...document.querySelectorAll('.nicegui-echart')][0].textContent.includes('measured')", timeout=120_000
    )

    page.click("#sinew-pause")
    page.wait_for_function("Sinew.status().run?.state === 'paused'", timeout=60_000)
    with JournalReader(folder / "journal.sqlite") as journal:
        paused_at = journal.count_finished()
    page.wait_for_timeout(2000)
    with JournalReader(folder / "journal.sqlite") as journal:
        assert journal.count_finished() == paused_at
    page.click("#sinew-resume")
    page.wait_for_function("Sinew.status().run?.state === 'running'", timeout=60_000)
    page.wait_for_timeout(1500)

    pressed = time.monotonic()
    page.keyboard.press("F9")
    page.wait_for_function("document.body.dataset.emergencyMs !== undefined")
    page.wait_for_function("Sinew.status().run === null", timeout=30_000)
    truth = bench.truth()
    frozen = truth["clock_s_at_zero"] + truth["frozen_since_s"]
    assert truth["in_safe_state"]
    assert 0.0 < frozen - pressed < SAFE_WITHIN_S
