"""The browser of the tests in one: Debian's Chromium, driven by Playwright."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from tests.browser.dashboard import ARGUMENTS, CHROMIUM, Served, served

from sinew.apps.cli import main
from sinew.bench.record.journal import Journal
from sinew.measure.events import Note
from sinew.plan.toml import dump_rig, load_rig

sync_api = pytest.importorskip("playwright.sync_api", reason="no Playwright: make setup-dev installs it")


@pytest.fixture(scope="session")
def launch() -> "Iterator[Callable[..., sync_api.Browser]]":
    """Give what starts a browser with some arguments."""
    if CHROMIUM is None:
        pytest.skip("there is no Chromium on this computer: apt-get install chromium")
    with sync_api.sync_playwright() as playwright:
        yield lambda *more: playwright.chromium.launch(executable_path=CHROMIUM, args=[*ARGUMENTS, *more])


@pytest.fixture(scope="session")
def chromium(launch: "Callable[..., sync_api.Browser]") -> "Iterator[sync_api.Browser]":
    browser = launch("--disable-gpu")
    yield browser
    browser.close()


@pytest.fixture
def opened(chromium: "sync_api.Browser") -> "Iterator[Callable[..., sync_api.Page]]":
    """Give what opens a page of a dashboard, signed in unless told otherwise; what it complains of fails the test."""
    contexts, complaints = [], []

    def open_page(
        dashboard: Served,
        path: str = "/",
        *,
        theme: str = "light",
        size: tuple[int, int] = (1440, 900),
        signed_in: bool = True,
        complain: bool = True,
    ) -> "sync_api.Page":
        context = chromium.new_context(
            viewport={"width": size[0], "height": size[1]}, color_scheme=theme, accept_downloads=True
        )
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(120_000)
        if complain:
            page.on("pageerror", lambda error: complaints.append(str(error)))
        if signed_in:
            page.goto(dashboard.link)
            page.wait_for_function("window.Sinew && Sinew.status() && Sinew.status().signed_in")
        if not signed_in or path != "/":
            page.goto(dashboard.base + path)
            page.wait_for_function("window.Sinew && Sinew.status()")
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert not complaints


SHORT = """
name = "{name}"
[pretension]
pretension_mm = [{mm}]
rest_s = 1
[sweep]
frequency_hz = [2, 2.5, 2.8, 3, 3.2, 3.5, 4, 4.5]
settle_s = 2
periods = 5
repeats = 2
[ring_down]
frequency_hz = [3, 3.5]
drive_s = 2
record_s = 3
repeats = 2
"""

PWNED = "<img src=x onerror=window.pwned=1>"


@pytest.fixture(scope="session")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of runs: two from the twin, one that was cut off and whose plan has a script for a name and says
    so in an event, one that is damaged; and a plan of that name in the library."""
    runs = tmp_path_factory.mktemp("archive")
    for number, (name, mm) in enumerate((("soft", "2"), ("stiff", "8"))):
        folder = runs / name
        folder.mkdir()
        (folder / "plan.toml").write_text(SHORT.format(name=name, mm=mm))
        words = ["simulate", str(folder / "plan.toml"), "--out", str(folder / "recording.nc"), "--seed", str(number)]
        assert main(words) == 0
    odd = SHORT.format(name=PWNED, mm="4")
    (runs / "odd").mkdir()
    with Journal.create(runs / "odd" / "journal.sqlite", odd, dump_rig(load_rig("paper"))) as journal:
        journal.event(Note(PWNED))
    (runs / "plans").mkdir()
    (runs / "plans" / "odd.toml").write_text(odd)
    (runs / "damaged").mkdir()
    (runs / "damaged" / "recording.nc").write_bytes(b"this is no recording")
    shutil.copytree(runs / "odd", runs / PWNED)
    return runs


@pytest.fixture(scope="session")
def shown(archive: Path) -> Iterator[Served]:
    """Give a dashboard without a bench, over the archive."""
    with served(archive) as dashboard:
        yield dashboard
