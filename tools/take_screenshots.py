"""Pictures of every page and state of the dashboard, for README and docs, taken from a real browser.

`python -m tools.take_screenshots docs/pictures/dashboard` serves an emulated bench over a folder of made runs, carries
runs through their states, and writes one WebP each; docs/reference/dashboard-pages.md shows them. Needs Chromium and
`make setup-dev`.
"""

import argparse
import io
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright
from tests.browser.dashboard import ARGUMENTS, CHROMIUM, IN_SPACE, Served, choose_plan, edit_plan, served
from tests.experiments.run_index import make_runs

DESK, PHONE = (1360, 860), (390, 844)
QUALITY = 58
PATIENCE_MS = 120_000
SETTLED_MS = 1200
"""Until what a step changed is drawn, by software and beside a bench that has the first call on the processor."""
LONG = """
name = "demonstration"
[pretension]
pretension_mm = [2, 6]
rest_s = 0.5
[sweep]
frequency_hz = [2.5, 2.8, 3, 3.2, 3.4, 3.6, 4]
settle_s = 1
periods = 4
repeats = 12
"""
MADE_RUNS, YEAR_S = 6, 366 * 86400
PROGRESS = "parseInt(document.querySelector('#sinew-progress-text').textContent)"


class Camera:
    """What writes the pictures of a page."""

    def __init__(self, page: Page, folder: Path) -> None:
        self.page, self._folder = page, folder

    def take(
        self, name: str, *, theme: str = "light", size: tuple[int, int] = DESK, whole: bool = False, at: str = ""
    ) -> None:
        """Write one picture. whole: the page to its end, else what the window shows. at: what is scrolled to."""
        page = self.page
        page.set_viewport_size({"width": size[0], "height": size[1]})
        page.evaluate("scrollTo(0, 0)")
        page.emulate_media(color_scheme=theme)  # type: ignore[arg-type]
        if at:
            page.locator(at).first.scroll_into_view_if_needed()
        page.wait_for_timeout(SETTLED_MS)
        shot = Image.open(io.BytesIO(page.screenshot(full_page=whole)))
        shot.save(self._folder / f"{name}.webp", quality=QUALITY, method=6)
        page.set_viewport_size({"width": DESK[0], "height": DESK[1]})
        page.emulate_media(color_scheme="light")


def take_plan(camera: Camera, base: str) -> None:
    """Take the page Plan: fine, on a phone, and with a fault."""
    page = camera.page
    page.goto(f"{base}/plan")
    page.wait_for_selector("#sinew-start[data-ready=yes]")
    camera.take("plan", whole=True)
    camera.take("plan-dark", theme="dark")
    camera.take("plan-phone", size=PHONE)
    edit_plan(page, r"periods = \d+", "periods = -3")
    page.wait_for_selector("#sinew-faults")
    camera.take("plan-fault", whole=True)
    page.click("#sinew-plan-discard")


def start(page: Page, base: str, plan: str = "") -> None:
    """Start the plan that the page Plan offers, or another one of the library."""
    page.goto(f"{base}/plan")
    page.wait_for_function("Sinew.status()?.signed_in")
    page.wait_for_selector("#sinew-duration:not(:empty)")
    if plan:
        choose_plan(page, plan)
        page.wait_for_function(
            "name => document.querySelector('#sinew-plan-text').textContent.includes(name)", arg=plan
        )
    page.click("#sinew-start:not([disabled])")
    page.wait_for_url(f"{base}/")


def take_live(camera: Camera, base: str) -> None:
    """Take the live page in the states of a run, and what a run leaves."""
    page = camera.page
    page.goto(base)
    page.wait_for_selector("#sinew-joint canvas")
    camera.take("live-idle")
    start(page, base)
    page.wait_for_selector("#sinew-notice-begins")
    camera.take("live-preparing")
    page.wait_for_selector("#sinew-notice-ended.good")
    page.wait_for_selector("#sinew-verdict >> text=12 judged values", timeout=3 * PATIENCE_MS)
    camera.take("live-complete", whole=True)
    page.click("#sinew-open-last")
    page.wait_for_selector("a[data-kind=csv]")
    camera.take("run", whole=True)
    page.click("a[href$='/samples']")
    page.wait_for_function("document.body?.dataset.samples === 'shown'")
    chosen = page.locator("#sinew-segment option", has_text="steady").first.get_attribute("value")
    page.select_option("#sinew-segment", chosen)
    page.click("#sinew-cursors")
    page.click("#sinew-spectrum")
    page.wait_for_function("document.querySelector('#sinew-peaks').textContent.includes('Hz')")
    camera.take("run-samples", whole=True)


def take_stops(camera: Camera, base: str) -> None:
    """Take a run that is watched, paused, ended by hand, goes on, alarms and is stopped at once."""
    page = camera.page
    start(page, base, "demonstration")
    page.wait_for_function(f"{PROGRESS} >= 4")
    for drawn in ("measured", "predicted"):
        page.wait_for_selector(f".nicegui-echart >> nth=0 >> text={drawn}")
    camera.take("live-running", whole=True)
    page.click("#sinew-pause")
    page.wait_for_function("Sinew.status().run?.state === 'paused'")
    camera.take("live-paused")
    page.click("#sinew-resume")
    page.wait_for_function("Sinew.status().run?.state === 'running'")
    camera.take("live-running-dark", theme="dark")
    camera.take("live-phone", size=PHONE)
    page.click("#sinew-stop")
    page.wait_for_selector("#sinew-go-on:not([disabled])")
    camera.take("live-ended-early")
    page.fill("#sinew-limit-temperature", "20")
    page.keyboard.press("Tab")
    page.click("#sinew-go-on")
    page.wait_for_selector("#sinew-acknowledge-temperature")
    camera.take("live-alarm", at="#sinew-limits-back")
    page.click("#sinew-acknowledge-temperature")
    page.click("#sinew-limits-back")
    page.keyboard.press("F9")
    page.wait_for_selector("#sinew-notice-ended.bad")
    camera.take("live-emergency")


def take_runs(camera: Camera, base: str) -> None:
    """Take the list of runs with its trend, and two runs beside one another."""
    page = camera.page
    page.goto(f"{base}/runs?search=weekly")
    page.wait_for_selector("[data-trend] svg")
    camera.take("runs", whole=True)
    page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    page.reload()
    page.wait_for_selector("[data-trend] svg")
    camera.take("runs-phone", size=PHONE)
    page.goto(f"{base}/runs?open=run-0000&open=run-0005")
    page.wait_for_selector("[data-compared]")
    camera.take("runs-compared", whole=True)


def take_design(camera: Camera, base: str) -> None:
    """Take the page Design with a joint that differs from the rig as built."""
    page = camera.page
    page.goto(f"{base}/design")
    page.wait_for_selector("text=Refined")
    for key, value in (("length_mm", "110"), ("pretension_mm", "8")):
        page.fill(f"#sinew-number-{key}", value)
        page.keyboard.press("Tab")
        page.wait_for_timeout(SETTLED_MS)
    page.wait_for_selector("#sinew-lag:has-text('against the rig as built')")
    page.wait_for_selector("text=Refined")
    camera.take("design", whole=True)
    camera.take("design-dark", theme="dark")


def take_others(browser: Browser, folder: Path, base: str) -> None:
    """Take the sign-in and the page that does not exist, as somebody sees them who did not sign in."""
    with opened(browser) as page:
        camera = Camera(page, folder)
        page.goto(base)
        page.wait_for_function("window.Sinew && Sinew.status()")
        page.click("#sinew-in")
        page.wait_for_selector("dialog[open]")
        camera.take("sign-in")
        page.goto(f"{base}/help")
        page.wait_for_selector("h1")
        camera.take("help")
        page.goto(f"{base}/no-such-page")
        page.wait_for_selector("h1")
        camera.take("no-such-page")


@contextmanager
def opened(browser: Browser) -> Iterator[Page]:
    """Give a page of a context of its own."""
    options: dict[str, Any] = {"viewport": {"width": DESK[0], "height": DESK[1]}}
    page = browser.new_context(**options).new_page()
    page.set_default_timeout(PATIENCE_MS)
    yield page
    page.context.close()


def make_archive(runs: Path) -> None:
    """Write runs of a year, results alone, by chance around a joint that ages."""
    make_runs(runs, MADE_RUNS)
    for path in runs.glob("*/results.nc"):
        at = path.stat().st_mtime - YEAR_S
        os.utime(path, (at, at))


PARTS = {"live": take_live, "stops": take_stops, "plan": take_plan, "runs": take_runs, "design": take_design}


def take_parts(browser: Browser, folder: Path, dashboard: Served, parts: list[str]) -> None:
    """Take the pictures of some parts, and of who did not sign in."""
    with opened(browser) as page:
        page.goto(dashboard.link)
        page.wait_for_function("window.Sinew && Sinew.status()?.signed_in")
        camera = Camera(page, folder)
        for part in parts:
            PARTS[part](camera, dashboard.base)
    take_others(browser, folder, dashboard.base)


def main(arguments: list[str]) -> int:
    """Take the pictures; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="*", choices=PARTS, default=list(PARTS), help="which parts to take anew")
    asked = parser.parse_args(arguments)
    folder: Path = asked.folder
    if CHROMIUM is None:
        print("found no chromium; apt-get install chromium", file=sys.stderr)
        return 2
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as playwright:
        runs = Path(scratch) / "runs"
        make_archive(runs)
        (runs / "plans").mkdir()
        (runs / "plans" / "demonstration.toml").write_text(LONG, encoding="utf-8")
        with served(runs, "--emulate") as dashboard:
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=[*ARGUMENTS, *IN_SPACE])
            take_parts(browser, folder, dashboard, asked.only)
            browser.close()
        log = (runs / ".bench" / "page.log").read_text(encoding="utf-8")
    if "Traceback" in log:
        print(f"the pictures are there, and the dashboard made a mistake meanwhile:\n{log}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
