"""Two dashboards on one host in one browser, and what their pages may load: each keeps to itself."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from tests.browser.dashboard import Served, served

pytestmark = pytest.mark.slow


@pytest.fixture
def two(tmp_path: Path) -> Iterator[tuple[Served, Served]]:
    with served(tmp_path / "first") as first, served(tmp_path / "second") as second:
        yield first, second


def stopped(dashboard: Served) -> bool:
    """Return whether the steward of a dashboard was told of an emergency."""
    host, port = dashboard.base.removeprefix("http://").split(":")
    return (
        httpx.get(f"http://{host}:{int(port) + 1}/status", timeout=60.0, trust_env=False).json()["emergency"]
        is not None
    )


def test_f9_on_the_first_of_two_dashboards_stops_the_first_only(chromium: Any, two: tuple[Served, Served]) -> None:
    context = chromium.new_context()
    pages, complaints = [], []
    for dashboard in two:
        page = context.new_page()
        page.set_default_timeout(120_000)
        page.on("console", lambda told: complaints.append(told.text) if "Content Security" in told.text else None)
        page.goto(dashboard.link)
        page.wait_for_function("window.Sinew && Sinew.status() && Sinew.status().signed_in")
        pages.append(page)
    names = {cookie["name"] for cookie in context.cookies()}
    pages[0].bring_to_front()
    pages[0].keyboard.press("F9")
    pages[0].wait_for_function("Sinew.status().emergency !== null")
    both_signed_in = [page.evaluate("Sinew.status().signed_in") for page in pages]
    found = [stopped(dashboard) for dashboard in two]
    context.close()
    assert found == [True, False]
    assert both_signed_in == [True, True]
    assert len(names) == 2
    assert complaints == []


def test_a_page_runs_no_script_that_it_is_made_to_build_and_speaks_to_no_other_port(
    chromium: Any, two: tuple[Served, Served]
) -> None:
    page = chromium.new_context().new_page()
    page.set_default_timeout(120_000)
    page.goto(two[0].base)
    page.wait_for_function("window.Sinew && Sinew.status()")
    page.evaluate("document.body.insertAdjacentHTML('beforeend', '<img src=x onerror=\"window.pwned=1\">')")
    page.evaluate(
        "s => { const e = document.createElement('script'); e.textContent = s; document.body.append(e) }", "pwned=1"
    )
    page.wait_for_timeout(500)
    refused = page.evaluate("""() => new Promise((go) => {
      addEventListener("securitypolicyviolation", (event) => go(event.effectiveDirective));
      fetch("http://127.0.0.1:1234/").catch(() => null);
      setTimeout(() => go("nothing"), 10000);
    })""")
    got = page.evaluate("window.pwned ?? null")
    page.context.close()
    assert (got, refused) == (None, "connect-src")
