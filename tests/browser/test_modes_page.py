"""The page of modes in a real browser: every shape moves, for hands on keys, for ears and for eyes that want rest."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from sinew.figures.space import write_modes
from sinew.predict.modes import find_modes

axe_api = pytest.importorskip("axe_playwright_python.sync_playwright", reason="no axe-core: make setup-dev installs it")

pytestmark = pytest.mark.slow

Open = Callable[..., Any]


@pytest.fixture(scope="module")
def modes_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the page of a joint that stands and is bent; at 20° and no pretension a tendon is slack."""
    found = find_modes("paper", [0.0, 6.0], bend_deg=[0.0, 20.0], azimuth_deg=90.0, bands=0)
    return write_modes(found, tmp_path_factory.mktemp("modes") / "modes.html")


@pytest.fixture
def show(chromium: Any, modes_page: Path) -> Iterator[Open]:
    """Give what opens the page; what it complains of, or asks of anybody, fails the test."""
    contexts, complaints = [], []

    def opened(*, theme: str = "light", size: tuple[int, int] = (1200, 900), motion: str = "no-preference") -> Any:
        context = chromium.new_context(
            viewport={"width": size[0], "height": size[1]}, color_scheme=theme, reduced_motion=motion
        )
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("console", lambda told: complaints.append(told.text))
        page.on("request", lambda asked: None if _is_own(asked.url) else complaints.append(asked.url))
        page.goto(modes_page.as_uri())
        page.wait_for_selector("#mode option", state="attached")
        return page

    yield opened
    for context in contexts:
        context.close()
    assert complaints == []


def _is_own(url: str) -> bool:
    return url.startswith(("file:", "data:"))


def picture(page: Any) -> str:
    return str(page.evaluate("document.getElementById('joint').toDataURL()"))


def test_a_shape_moves_until_it_is_paused_from_the_keyboard(show: Open) -> None:
    page = show()
    first = picture(page)
    page.wait_for_function("first => document.getElementById('joint').toDataURL() !== first", arg=first)
    page.focus("#play")
    page.keyboard.press("Enter")
    page.wait_for_timeout(200)
    paused = picture(page)
    page.wait_for_timeout(400)
    assert picture(page) == paused
    assert page.inner_text("#play") == "Play"


def test_who_wants_no_motion_sees_a_shape_at_the_end_of_its_swing_and_may_play_it(show: Open) -> None:
    page = show(motion="reduce")
    first = picture(page)
    page.wait_for_timeout(400)
    assert (picture(page), page.inner_text("#play")) == (first, "Play")
    page.click("#play")
    page.wait_for_function("first => document.getElementById('joint').toDataURL() !== first", arg=first)


def test_every_mode_of_every_pose_is_drawn_otherwise_and_named(show: Open) -> None:
    page = show(motion="reduce")
    seen, named = set(), set()
    for pose in range(page.locator("#pose option").count()):
        page.select_option("#pose", str(pose))
        for mode in range(page.locator("#mode option").count()):
            page.select_option("#mode", str(mode))
            seen.add(picture(page))
            named.add(page.get_attribute("#joint", "aria-label"))
    rows = page.locator("#numbers table").first.locator("tbody tr").count()
    assert rows > 15
    assert (len(seen), len(named)) == (rows, rows)


def test_modes_and_sides_are_chosen_from_the_keyboard(show: Open) -> None:
    page = show(motion="reduce")
    before, told = picture(page), page.inner_text("#told")
    page.focus("#mode")
    page.keyboard.press("ArrowDown")
    page.wait_for_function("told => document.getElementById('told').innerText !== told", arg=told)
    assert "sway" in page.inner_text("#told")
    page.focus("#yaw")
    other = picture(page)
    page.keyboard.press("ArrowRight")
    page.wait_for_timeout(100)
    assert len({before, other, picture(page)}) == 3


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_nothing_on_the_page_of_modes(show: Open, theme: str) -> None:
    page = show(theme=theme)
    found = axe_api.Axe().run(page).response["violations"]
    assert [(rule["id"], node["html"][:160]) for rule in found for node in rule["nodes"]] == []


def test_a_phone_shows_the_page_of_modes_without_scrolling_sideways(show: Open) -> None:
    page = show(size=(390, 780))
    assert page.evaluate("document.documentElement.scrollWidth") <= 391


def test_no_script_but_our_own_runs_on_the_page_of_modes(modes_page: Path, chromium: Any) -> None:
    page = chromium.new_page()
    page.goto(modes_page.as_uri())
    page.evaluate(
        "s => { const e = document.createElement('script'); e.textContent = s; document.body.append(e) }", "pwned=1"
    )
    got = page.evaluate("window.pwned ?? null")
    page.close()
    assert got is None
