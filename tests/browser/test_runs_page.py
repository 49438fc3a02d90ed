"""The page of runs in a real browser: searched by numbers, by keyboard, opened and compared."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.browser.dashboard import Served, findings, served
from tests.experiments.run_index import make_runs
from tests.unit.bench_journal import RIG_TEXT
from tests.unit.dashboard_journal import PLAN

from sinew.bench.record.journal import Journal
from sinew.plan.toml import dump_plan

pytestmark = pytest.mark.slow

Open = Callable[..., Any]
ROWS = "#sinew-runs tbody tr"


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Give a dashboard over six runs of a year."""
    runs = tmp_path_factory.mktemp("lab")
    make_runs(runs, 6)
    with served(runs) as dashboard:
        yield dashboard


def listed(opened: Open, lab: Served, path: str = "/runs") -> Any:
    """Return the page with its list filled."""
    page = opened(lab, path)
    await_found(page, r"\d+ runs?")
    page.wait_for_selector(f"{ROWS} td:nth-child(3)")
    return page


def await_found(page: Any, said: str) -> None:
    """Wait until every folder is read, and so many runs are found. said: a pattern."""
    page.wait_for_function(f"/^{said}$/.test(document.querySelector('#sinew-found')?.textContent)")


def test_a_search_by_numbers_finds_runs_and_stands_in_the_address(opened: Open, lab: Served) -> None:
    page = listed(opened, lab)
    page.fill("input[type=search]", "aged f_r=3.. pretension=6")
    await_found(page, "1 run found")
    page.wait_for_function("location.search.startsWith('?search=aged')")
    assert "run-0000" in page.inner_text(ROWS)


def test_a_search_that_is_none_says_what_was_expected(opened: Open, lab: Served) -> None:
    page = listed(opened, lab)
    page.fill("input[type=search]", "f_q=3..")
    page.wait_for_selector(".sinew-bad")
    assert "is f_r meant?" in page.inner_text(".sinew-bad")


def test_a_trend_is_told_in_a_sentence_beside_its_chart(opened: Open, lab: Served) -> None:
    page = listed(opened, lab)
    page.wait_for_selector("[data-trend] svg")
    assert "f_r at 6 mm falls by" in page.inner_text("[data-trend]")


def test_that_no_run_tells_anything_over_months_is_said(opened: Open, tmp_path: Path) -> None:
    with served(tmp_path / "runs") as lab:
        page = opened(lab, "/runs")
        page.wait_for_selector("[data-trend] >> text=No run of the list determines the")


def test_why_a_run_has_no_damping_is_said_in_the_list_and_on_its_page(opened: Open, tmp_path: Path) -> None:
    (tmp_path / "runs" / "bare").mkdir(parents=True)
    plan = dump_plan(PLAN.model_copy(update={"ring_down": None}))
    Journal.create(tmp_path / "runs" / "bare" / "journal.sqlite", plan, RIG_TEXT).close()
    with served(tmp_path / "runs") as lab:
        page = listed(opened, lab)
        assert "no ring-downs" in page.inner_text(ROWS)
        page.goto(f"{lab.base}/runs?open=bare")
        page.wait_for_selector("[data-note] >> text=D needs ring-downs, which its plan lacks")
        assert "No resonance and no damping could be told." in page.inner_text("[data-headline]")


@pytest.mark.parametrize("width", [1280, 390])
def test_tables_do_not_make_the_page_wider_than_its_window(opened: Open, tmp_path: Path, width: int) -> None:
    runs, long = tmp_path / "runs", "a" * 60
    make_runs(runs, 2)
    (runs / "run-0000").rename(runs / long)
    with served(runs) as lab:
        page = opened(lab, f"/runs?open={long}&open=run-0001", size=(width, 800))
        page.wait_for_selector("[data-compared]")
        page.wait_for_selector("#sinew-runs .q-checkbox >> nth=1")
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        cut = "[...document.querySelectorAll('.q-table__middle')].filter(one => one.scrollWidth > one.clientWidth)"
        assert page.evaluate(f"{cut}.every(one => innerWidth < 620 && getComputedStyle(one).overflowX === 'auto')")


def test_rows_are_chosen_and_opened_by_keyboard_and_the_address_opens_the_same(opened: Open, lab: Served) -> None:
    page = listed(opened, lab)
    page.wait_for_selector(f"{ROWS}[tabindex='0']")
    page.locator(ROWS).first.focus()
    for step, key in enumerate(("Space", "ArrowDown", "Space")):
        page.keyboard.press(key)
        page.wait_for_function(f"document.querySelectorAll('{ROWS}.selected').length === {(1, 1, 2)[step]}")
        page.wait_for_function(f"document.activeElement.matches('{ROWS}')")
    page.click("#sinew-open")
    page.wait_for_selector("[data-compared]")
    assert "significant at 90 %" in page.inner_text("main")
    other = listed(opened, lab, page.url.removeprefix(lab.base))
    other.wait_for_function(f"document.querySelectorAll('{ROWS}.selected').length === 2")


def test_axe_finds_nothing_on_runs_that_are_compared(opened: Open, lab: Served) -> None:
    page = listed(opened, lab, "/runs?open=run-0000&open=run-0001")
    page.wait_for_selector("[data-compared]")
    page.wait_for_selector("[data-trend] svg")
    assert findings(page) == []
