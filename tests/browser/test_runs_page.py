"""The page of runs in a real browser: searched by numbers, by keyboard, noted, renamed, put away and taken back."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.run_index import make_runs
from tests.browser.dashboard import Served, findings, served
from tests.unit.bench_journal import RIG_TEXT
from tests.unit.dashboard_journal import PLAN

from sinew.bench.record.journal import Journal
from sinew.measure.files.netcdf import load_dataset, save_dataset
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


def listed(opened: Open, lab: Served, path: str = "/runs", *, take: bool = False) -> Any:
    """Return the page with its list filled, in control of the bench where asked for."""
    page = opened(lab, path)
    if take:
        page.wait_for_function("Sinew.status().signed_in")
        page.click("#sinew-take")
        page.wait_for_function("Sinew.status().operator && Sinew.status().operator.mine")
    await_found(page, r"\d+ runs?")
    page.wait_for_selector(f"{ROWS} td:nth-child(3)")
    return page


def await_found(page: Any, said: str) -> None:
    """Wait until every folder is read, and so many runs are found. said: a pattern."""
    page.wait_for_function(f"/^{said}$/.test(document.querySelector('#sinew-found')?.textContent)")


def test_a_search_by_numbers_finds_runs_and_stands_in_the_address(opened: Open, lab: Served) -> None:
    page = listed(opened, lab)
    page.fill("input[type=search]", "tag:aged f_r>3 pretension=6")
    await_found(page, "1 run found")
    page.wait_for_function("location.search.startsWith('?search=tag')")
    assert "run-0000" in page.inner_text(ROWS)


def test_a_search_that_is_none_says_what_was_expected(opened: Open, lab: Served) -> None:
    page = listed(opened, lab)
    page.fill("input[type=search]", "f_q>3")
    page.wait_for_selector(".sinew-bad")
    assert "is f_r meant?" in page.inner_text(".sinew-bad")


def test_a_trend_is_told_in_a_sentence_beside_its_chart(opened: Open, lab: Served) -> None:
    page = listed(opened, lab)
    page.wait_for_selector("[data-trend] svg")
    assert "f_r at 6 mm falls by" in page.inner_text("[data-trend]")


def test_a_trend_opens_with_what_a_run_has(opened: Open, tmp_path: Path) -> None:
    make_runs(tmp_path / "runs", 3)
    for folder in sorted((tmp_path / "runs").glob("run-*")):
        results = load_dataset(folder / "results.nc").load()
        unknown = {name: np.nan * results[name] for name in results if str(name).startswith("resonance_")}
        save_dataset(results.assign(unknown), folder / "results.nc")
    with served(tmp_path / "runs") as lab:
        page = listed(opened, lab)
        page.wait_for_selector("[data-trend] svg")
        assert "D at 6 mm" in page.inner_text("[data-trend]")
        page.get_by_text("Frequency of the largest fundamental").click()
        page.wait_for_selector("[data-trend] >> text=No run of the list tells the frequency of the largest")
        page.fill("input[type=search]", "name:nowhere")
        await_found(page, "0 runs found")
        page.wait_for_selector("[data-trend] >> text=No run of the list tells the frequency of the largest")


def test_that_no_run_tells_anything_over_months_is_said(opened: Open, tmp_path: Path) -> None:
    with served(tmp_path / "runs") as lab:
        page = opened(lab, "/runs")
        page.wait_for_selector("[data-trend] >> text=No run of the list tells any of these")


def test_why_a_run_has_no_damping_is_said_in_the_list_and_on_its_page(opened: Open, tmp_path: Path) -> None:
    (tmp_path / "runs" / "bare").mkdir(parents=True)
    plan = dump_plan(PLAN.model_copy(update={"ring_down": None}))
    Journal.create(tmp_path / "runs" / "bare" / "journal.sqlite", plan, RIG_TEXT).close()
    with served(tmp_path / "runs") as lab:
        page = listed(opened, lab)
        assert "no ring-downs" in page.inner_text(ROWS)
        page.wait_for_selector("[data-trend] >> text=none is analysed yet, which opening one does")
        page.goto(f"{lab.base}/runs?open=bare")
        page.wait_for_selector("[data-note] >> text=D needs ring-downs, which its plan lacks")
        assert "No resonance and no damping could be told." in page.inner_text("[data-headline]")


@pytest.mark.parametrize("width", [1280, 390])
def test_tables_do_not_make_the_page_wider_than_its_window(opened: Open, tmp_path: Path, width: int) -> None:
    runs, long = tmp_path / "runs", "a" * 60
    make_runs(runs, 2)
    (runs / "run-0000").rename(runs / long)
    (runs / long / "notes.json").write_text('{"notes": "%s", "tags": ["aged"]}' % ("after the move " * 12))
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


def test_enter_opens_the_row_that_has_the_focus(opened: Open, lab: Served) -> None:
    page = listed(opened, lab)
    page.wait_for_selector(f"{ROWS}[tabindex='0']")
    page.locator(ROWS).first.focus()
    page.keyboard.press("Enter")
    page.wait_for_url("**/runs?open=run-0005")


def test_a_run_is_noted_renamed_put_away_and_taken_back(opened: Open, lab: Served) -> None:
    page = listed(opened, lab, "/runs?open=run-0002", take=True)
    page.wait_for_selector("[data-keep]")
    page.fill("[data-notes]", "a new tendon")
    page.fill("[data-tags]", "tendon, second")
    page.click("[data-keep]")
    page.wait_for_selector("text=notes and tags of run-0002 are kept")
    page.wait_for_selector(f"{ROWS}:has-text('tendon second')")
    page.fill("[data-name]", "mended")
    page.click("[data-rename]")
    page.wait_for_url("**/runs?open=mended")
    page.wait_for_selector("[data-keep]")
    assert page.input_value("[data-tags]") == "tendon second"
    page.click("[data-bin]")
    page.wait_for_selector("text=mended lies in the bin.")
    assert not Path(lab.runs / "mended").exists()
    page.get_by_role("button", name="Take it out again").click()
    page.wait_for_selector("[data-bin]")
    page.click("[data-bin]")
    page.wait_for_selector("text=mended lies in the bin.")
    page.reload()
    page.wait_for_selector("[role=alert]:has-text('There is no run mended')")
    page.goto(lab.base + "/runs")
    page.wait_for_selector("[aria-label='Restore mended']")
    page.locator("[role=heading]").first.click()
    page.keyboard.press("/")
    page.wait_for_function("document.activeElement.id === 'sinew-search'")
    page.click("[aria-label='Restore mended']")
    page.wait_for_selector(f"{ROWS}:has-text('mended')")
    assert Path(lab.runs / "mended" / "notes.json").exists()


def test_what_a_search_hides_is_not_put_into_the_bin_and_the_rest_once_it_was_asked(opened: Open, lab: Served) -> None:
    page = listed(opened, lab, take=True)
    page.click("#sinew-bin")
    page.wait_for_selector("text=No run is ticked")
    for name in ("run-0003", "run-0004"):
        page.click(f"[aria-label='choose {name}']")
    page.wait_for_selector("text=No run is ticked", state="detached")
    page.fill("input[type=search]", "name:run-0004")
    await_found(page, "1 run found")
    page.click("#sinew-bin")
    assert page.inner_text("[data-asked]") == "Put run-0004 into the bin? It can be taken out again."
    assert findings(page, ".q-dialog") == []
    page.click("#sinew-bin-not")
    page.wait_for_selector("[data-asked]", state="detached")
    assert Path(lab.runs / "run-0004").exists()
    page.click("#sinew-bin")
    page.click("#sinew-bin-sure")
    page.wait_for_selector("text=run-0004 lies in the bin; Restore, below, takes")
    page.wait_for_selector("[aria-label='Restore run-0004']")
    assert Path(lab.runs / "run-0003").exists()
    page.click("[aria-label='Restore run-0004']")
    page.wait_for_selector(f"{ROWS}:has-text('run-0004')")


def test_axe_finds_nothing_on_runs_that_are_compared(opened: Open, lab: Served) -> None:
    page = listed(opened, lab, "/runs?open=run-0000&open=run-0001")
    page.wait_for_selector("[data-compared]")
    page.wait_for_selector("[data-trend] svg")
    assert findings(page) == []
