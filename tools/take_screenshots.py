"""Pictures of the dashboard in README and docs, taken from a real browser.

`python tools/take_screenshots.py docs/pictures` serves an emulated bench, runs a plan on it, and takes the live page in
light and the page for designs in dark; with `--all` every page in both. `--states` takes the pages in every state of
a bench, on screens of all sizes; its runs are played. Needs Chromium and `make setup-dev`.
"""

import argparse
import importlib
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Literal

from playwright.sync_api import Error, Page, sync_playwright

ARGUMENTS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-first-run",
]
SIZE = {"width": 1360, "height": 860}
PLAN = """
name = "demonstration"
[pretension]
pretension_mm = [2, 6]
rest_s = 0.5
[sweep]
frequency_hz = [2.5, 2.8, 3, 3.2, 3.4, 3.6, 4]
settle_s = 1
periods = 4
repeats = 1
"""
PAGES = {"plan": "#sinew-duration", "runs": "#sinew-open", "design": "#sinew-peak"}
PATIENCE_MS = 120_000
THEMES: tuple[Literal["light"], Literal["dark"]] = ("light", "dark")


def choose_plan(page: Page, name: str) -> None:
    """Choose a plan of the shelf; the list of a select may close again while the page is still busy."""
    option = page.get_by_role("option", name=name)
    for _ in range(10):
        page.get_by_label("Begin with the plan").click()
        try:
            option.click(timeout=3000)
            return
        except Error:
            page.keyboard.press("Tab")
    raise TimeoutError(f"found no plan {name} to choose")


def start_run(page: Page, base: str) -> None:
    """Start the demonstration and return when it has measured half of its segments."""
    page.goto(f"{base}/plan")
    page.wait_for_selector("#sinew-duration")
    page.click("#sinew-take")
    page.wait_for_function("Sinew.status().operator?.mine")
    choose_plan(page, "demonstration")
    page.wait_for_function("document.querySelector('textarea.sinew-code').value.includes('demonstration')")
    page.wait_for_selector("#sinew-start:not([disabled])")
    page.click("#sinew-start")
    page.wait_for_url(f"{base}/")
    page.wait_for_function("parseInt(document.querySelector('#sinew-progress-text').textContent) >= 10")


def take(page: Page, folder: Path, everything: bool) -> None:
    """Take the pictures of a dashboard that was just opened."""
    base = page.url.rstrip("/")
    start_run(page, base)
    for theme in THEMES if everything else THEMES[:1]:
        page.emulate_media(color_scheme=theme)
        page.wait_for_timeout(1000)
        page.screenshot(path=folder / f"dashboard-live-{theme}.png", full_page=everything)
    page.wait_for_function("Sinew.status().run === null")
    wanted: dict[str, str] = dict(PAGES) if everything else {"design": PAGES["design"]}
    if everything:
        name = str(page.evaluate("Sinew.status().last.name"))
        wanted[f"runs/{name}"] = "a[data-kind=csv]"
    for path, ready in wanted.items():
        for theme in THEMES if everything else THEMES[1:]:
            page.emulate_media(color_scheme=theme)
            page.goto(f"{base}/{path}")
            page.wait_for_selector(ready)
            page.wait_for_timeout(3000)
            picture = f"dashboard-{'run' if '/' in path else path}-{theme}.png"
            page.screenshot(path=folder / picture, full_page=everything)


STATES = ("empty", "preparing", "running", "paused", "ended-early", "emergency", "complete", "lost")
SCREENS = {"1440": (1440, 900), "2560": (2560, 1440), "390": (390, 844), "844": (844, 390)}


def take_states(folder: Path, link: str, stage: Any, chromium: str) -> None:
    """Take the live page in every state, and the other pages at rest, as STATE-SCREEN-THEME.png."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        page = browser.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto(link)
        page.wait_for_function("window.Sinew && Sinew.status()?.signed_in")
        page.click("#sinew-take")
        for state in STATES:
            _bring_to(page, stage, state)
            _shoot(page, folder, state)
        page.wait_for_function("document.body.dataset.stream === 'open'")
        for name, (path, ready) in {
            "plan": ("/plan", "#sinew-duration"),
            "runs": ("/runs", "#sinew-open"),
            "design": ("/design", "#sinew-peak"),
            "missing": ("/no-such-page", "h1"),
            "sign-in": ("/login", "#token"),
        }.items():
            page.goto(stage.base + path)
            page.wait_for_selector(ready)
            page.wait_for_timeout(1500)
            _shoot(page, folder, name)
        page.goto(stage.base)
        page.evaluate("Sinew.signIn('Sign in to take control.')")
        _shoot(page, folder, "dialog")
        browser.close()


def _bring_to(page: Page, stage: Any, state: str) -> None:
    if state == "preparing":
        stage.begin("one", "prepares")
        page.wait_for_selector("#sinew-notice-begins")
    elif state == "running":
        page.click("#sinew-stop")
        stage.until("over")
        stage.begin("two", repeats=60)
        page.wait_for_function("parseInt(document.querySelector('#sinew-progress-text').textContent) >= 4")
    elif state == "paused":
        page.click("#sinew-pause")
        page.wait_for_function("Sinew.status().run?.state === 'paused'")
    elif state == "ended-early":
        page.click("#sinew-stop")
        page.wait_for_selector("#sinew-go-on")
    elif state == "emergency":
        page.click("#sinew-go-on")
        page.wait_for_function("document.body.dataset.stale === 'false'")
        page.keyboard.press("F9")
        page.wait_for_selector("#sinew-notice-emergency")
        page.wait_for_selector("#sinew-notice-ended")
    elif state == "complete":
        stage.begin("three", repeats=1)
        page.wait_for_selector("#sinew-notice-ended.good")
    elif state == "lost":
        stage.begin("four", repeats=60)
        page.wait_for_function("document.body.dataset.stale === 'false'")
        stage.kill_pages()
        page.wait_for_selector("#sinew-notice-lost")
    page.wait_for_timeout(1500)


def _shoot(page: Page, folder: Path, name: str) -> None:
    for screen, (width, height) in SCREENS.items():
        page.set_viewport_size({"width": width, "height": height})
        for theme in THEMES:
            page.emulate_media(color_scheme=theme)
            page.wait_for_timeout(400)
            page.screenshot(path=folder / f"{name}-{screen}-{theme}.png")
    page.set_viewport_size({"width": 1440, "height": 900})


def main(arguments: list[str]) -> int:
    """Take the pictures; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--states", action="store_true", help="every state of a bench, on screens of all sizes")
    parser.add_argument("--all", action="store_true", help="every page, light and dark, whole")
    asked = parser.parse_args(arguments)
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        print("found no chromium; apt-get install chromium", file=sys.stderr)
        return 2
    asked.folder.mkdir(parents=True, exist_ok=True)
    if asked.states:
        sys.path.insert(0, str(Path(__file__).parents[1]))
        staged = importlib.import_module("tests.browser.stage").staged
        with tempfile.TemporaryDirectory() as scratch, staged(Path(scratch) / "runs") as stage:
            take_states(asked.folder, stage.link, stage, chromium)
        return 0
    with tempfile.TemporaryDirectory() as scratch:
        runs = Path(scratch) / "runs"
        (runs / "plans").mkdir(parents=True)
        (runs / "plans" / "demonstration.toml").write_text(PLAN)
        command = [str(Path(sys.executable).with_name("sinew")), "serve", "--emulate", "--runs", str(runs)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            try:
                assert process.stdout is not None
                link = process.stdout.readline().strip()
                with sync_playwright() as playwright:
                    browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS)
                    options: dict[str, Any] = {"viewport": SIZE}
                    page = browser.new_context(**options).new_page()
                    page.set_default_timeout(PATIENCE_MS)
                    page.goto(link)
                    page.wait_for_function("window.Sinew && Sinew.status()?.signed_in")
                    take(page, asked.folder, asked.all)
                    browser.close()
            finally:
                process.send_signal(signal.SIGTERM)
                process.wait(60)
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
