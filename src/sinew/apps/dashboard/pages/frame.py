"""The frame of every page: emergency stop, head with steering, notices, and the theme.

It is plain HTML that stands before what NiceGUI draws and does not depend on it: the stop is there on a page that is
still loading, on one that does not exist, and on one whose server is gone.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nicegui import app, core, ui
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response

from sinew.apps.dashboard.access import SIGN_IN
from sinew.apps.dashboard.hub import Hub, Results
from sinew.apps.dashboard.work.runs import read_shelf
from sinew.apps.dashboard.worker import Work
from sinew.measure.estimate import shown_interval, typeset
from sinew.measure.units import local_time
from sinew.plan.toml import read_spec

# The pages find what they share: folders, hub, worker, access.


@dataclass
class Site:
    """What all pages share.

    runs: folder of the runs. rig: name or file of the rig that is offered first. bench: "emulator", "port" or None.
    steering_port: where the browser sends commands. is_locked: whether even watching needs the token.
    results: analysed groups of the run under way, and its prediction, see `sinew.apps.dashboard.hub`.
    """

    runs: Path
    rig: str
    bench: str | None
    steering_port: int
    is_locked: bool
    version: str
    hub: Hub
    work: Work
    results: Results

    def rig_text(self, name: str) -> str:
        """Return the TOML text of the rig that is offered first, or of one on the shelf. Raises SpecError."""
        return read_spec("rigs", name) if name == self.rig else read_shelf("rigs", name, self.runs)


_PAGES = (("Live", "/"), ("Plan", "/plan"), ("Runs", "/runs"), ("Design", "/design"), ("Help", "/help"))
_BUTTONS = (
    ("take", "Take control", "Have the bench obey this page"),
    ("pause", "Pause", "Rest after the segment under way; the tension stays"),
    ("resume", "Resume", "Go on with the next segment"),
    ("stop", "End run", "End the run now, in the state that the rig declares safe"),
    ("hold", "Hold", "End the run; every motor stands still with limited output"),
    ("release", "Release", "End the run; the tension is let down and the torque taken off"),
)
_STOP = """
<aside aria-label="Emergency stop">
<button id="sinew-emergency" type="button" title="Stops the bench at once: key F9, or Escape twice"
  aria-keyshortcuts="F9"><b>EMERGENCY STOP</b><span>F9 · Esc Esc</span></button>
</aside>
"""


@contextmanager
def framed(site: Site, title: str, here: str) -> Iterator[None]:
    """Give the content of a page; the head stands already."""
    ui.page_title(f"{title} · Sinew")
    ui.colors(primary="#0b5fa5", negative="#b3261e", positive="#0a6b4a", warning="#8a5300")
    ui.add_head_html(_style(site))
    ui.add_body_html(_head(site, here))
    with ui.element("div").classes("sinew-content"):
        yield


def plain_page(site: Site, title: str, content: str, here: str = "") -> str:
    """Return the HTML of a page that needs no server once it is there. content: HTML of its main part."""
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<title>{title} · Sinew</title><link rel="icon" href="/sinew/icon.svg">{_style(site)}</head>'
        f'<body class="sinew-plain">{_head(site, here)}<main class="nicegui-content"><div class="sinew-content">'
        f"{content}</div></main></body></html>"
    )


def _style(site: Site) -> str:
    return f'<link rel="stylesheet" href="/sinew/style.css?{site.version}">'


def _head(site: Site, here: str) -> str:
    links = "".join(
        f'<a href="{path}"{" aria-current=page" if path == here else ""}>{name}</a>' for name, path in _PAGES
    )
    buttons = "".join(
        f'<button type="button" class="sinew-button" id="sinew-{name}" title="{title}" disabled>{label}</button>'
        for name, label, title in _BUTTONS
    )
    config = {"steering_port": site.steering_port, "locked": site.is_locked, "here": here}
    scripts = "".join(
        f'<script type="module" src="/sinew/{name}.js?{site.version}"></script>' for name in ("theme", "steering")
    )
    themes = choice("sinew-theme", "Theme", (("auto", "Auto"), ("light", "Light"), ("dark", "Dark")), "auto")
    skip = '<a class="sinew-skip" href="#sinew-notices">Skip to the content</a>'  # which begins with what is to be said
    return f"""{_STOP}{skip}<header class="sinew-header"><a class="sinew-brand" href="/">Sinew</a>
<nav class="sinew-nav" aria-label="Pages">{links}</nav>{themes}
<section id="sinew-bar" aria-label="Steering"><div id="sinew-buttons">{buttons}</div>
<span id="sinew-state" class="sinew-chip">Connecting</span><span id="sinew-who"></span></section></header>
<section id="sinew-notices" aria-label="Notices" tabindex="-1"></section>
{_data("sinew-config", config)}{scripts}"""


def choice(name: str, title: str, options: tuple[tuple[str, str], ...], chosen: str) -> str:
    """Return the HTML of a choice of which all options are seen: no list that opens lies over the page.

    options: (value, label).
    """
    rows = "".join(
        f'<label><input type="radio" name="{name}" value="{value}"{" checked" if value == chosen else ""}>'
        f"<span>{label}</span></label>"
        for value, label in options
    )
    return f'<fieldset class="sinew-choice" id="{name}"><legend class="sinew-hidden">{title}</legend>{rows}</fieldset>'


@contextmanager
def card(title: str, span: int) -> Iterator[ui.element]:
    """Give a titled part of a page that takes so many of twelve columns."""
    with ui.element("section").classes(f"sinew-card span-{span}") as made:
        ui.label(title).props("role=heading aria-level=2").classes("text-bold")
        yield made


@contextmanager
def live_card(title: str, span: int) -> Iterator[ui.element]:
    """Give a card whose values are of now; it is grey, and says how old they are, when they are not."""
    with ui.element("section").classes(f"sinew-card sinew-live span-{span}") as made:
        with ui.element("div").classes("sinew-row"):
            ui.label(title).props("role=heading aria-level=2").classes("text-bold")
            ui.html('<span class="sinew-last"></span><span class="sinew-age"></span>', sanitize=False)
        yield made


def heading(text: str) -> ui.label:
    """Show what a page is about."""
    return ui.label(text).props("role=heading aria-level=1").classes("text-h6")


def clock_time(moment: str) -> str:
    """Return an ISO 8601 time as pages say it, in the zone of the bench's computer: "2026-03-01 14:05"."""
    return local_time(moment)[:16]


def empty(sentence: str) -> ui.label:
    """Show what to do where there is nothing to show yet."""
    return ui.label(sentence).classes("sinew-empty")


def script(name: str, data: Any) -> None:
    """Hand data to the page's own scripts, in an element of that id."""
    ui.add_body_html(_data(name, data))


def _data(name: str, data: Any) -> str:
    text = json.dumps(data, ensure_ascii=True, allow_nan=False).replace("<", "\\u003c")
    return f'<script id="{name}" type="application/json">{text}</script>'


# Estimates in the words of a page.


def quantity(estimate: dict[str, Any], unit: str) -> str:
    """Return an estimate as a page says it: value and 90 % interval with unit, its digits by its uncertainty."""
    return typeset(shown_interval(estimate, unit))


# The page of help is as plain as those that stand in for others: it needs no server once it is there.

_HELP = """
<div class="sinew-card"><h1>Help</h1><h2>A first run</h2><ol class="sinew-steps">
<li><a href="/plan">Plan</a> has chosen a short plan. Its timeline says what the bench will do, and for how long.</li>
<li><b>Take control and start</b> begins it. One page at a time is in control; all others look on.</li>
<li><a href="/">Live</a> shows it: some seconds to get ready, then the bench pulls, swings and records; the curve
grows.</li>
<li><b>Open its results</b> leads to what it found; <a href="/runs">Runs</a> has all runs, their trend, what tells them
apart.</li>
<li><a href="/design">Design</a> needs no bench: sliders change a joint, and its predicted curve follows.</li>
</ol></div>
<div class="sinew-card"><h2>Buttons</h2><dl class="sinew-words">
<dt>Pause, Resume</dt><dd>rests after the group under way, the tension stays; goes on with the next group</dd>
<dt>End run</dt><dd>ends it now, in the state that the rig declares safe; it can be gone on with later</dd>
<dt>Hold</dt><dd>ends the run; every motor stands still with limited output, and the tension stays</dd>
<dt>Release</dt><dd>ends the run; the tension is let down and the torque taken off</dd>
<dt>Emergency stop</dt><dd>F9, or Escape twice: all motors stand at once; then comes the state that the rig declares
safe, hold or release, as Live says it. It is on every page and needs no reset</dd>
<dt>Take over</dt><dd>steers from here when another page, perhaps an older window of yours, is in control</dd>
</dl></div>
<div class="sinew-card"><h2>Words</h2><dl class="sinew-words">
<dt>rig, bench, twin</dt><dd>a joint and its motors as a file; the real one on the table, or emulated; its
equations</dd>
<dt>lever θ, torsion φ</dt><dd>how far the drive turns the lever against the head, the head twists against the base</dd>
<dt>pretension</dt><dd>by how much all tendons are shortened after first contact, where they are just taut</dd>
<dt>gain, f_r</dt><dd>torsion over the commanded angle of the lever; the frequency at which it is largest</dd>
<dt>half-power width</dt><dd>from where the gain is a 1/√2 of its largest below resonance to the same above: the wider,
the more damped</dd>
<dt>fold</dt><dd>where a curve turns back: between two folds a sweep up and one down find different swings</dd>
<dt>phase lag</dt><dd>by how much the torsion comes after the lever: 90° at resonance</dd>
<dt>damping D</dt><dd>Lehr's: at 0.07 a free swing falls to about a quarter within three periods</dd>
<dt>group</dt><dd>what is recorded at one setting: a rest, a swing at one frequency, a free decay</dd>
<dt>settling</dt><dd>the bench drives and waits until the swing is steady; then it records</dd>
<dt>tilt</dt><dd>by how much the head plate leans away from its pose</dd></dl></div>
<div class="sinew-card"><h2>Search of Runs</h2><dl class="sinew-words">
<dt>aged -first</dt><dd>words that must be there; with - before them, that must not</dd>
<dt>f_r&gt;3.2, D&lt;=0.1, f_r=3..3.4</dt><dd>a number above, up to, within; several hold at one pretension</dd>
<dt>pretension=6</dt><dd>that pretension, in mm</dd>
<dt>tag:aged, rig:paper, plan:quick</dt><dd>what a field says, also state:, source:, reason:, notes:</dd>
<dt>begin&gt;=2026-03</dt><dd>runs since a day, a month or a year</dd></dl></div>
<div class="sinew-card"><h2>Colours and marks</h2><p>Blue tendons are slack, orange ones near the rig's limit. Filled
points
are measured, with their 90 % intervals; lines and hollow points are predicted; a red cross misses its prediction.
What is
grey and hatched is old and says how old. A red box is for what ended early or alarms. No meaning is in a colour
alone.</p>
</div>"""


def help_page(site: Site) -> str:
    """Return the HTML of the page of help."""
    return plain_page(site, "Help", _HELP, "/help")


# Pages that stand in for others: one that does not exist, one that cannot be made, one that asks for the token.

_MISSING = """<div class="sinew-card"><h1>There is no such page</h1>
<p>The address may be mistyped, or of a run that was moved.</p>
<p><a href="/">To the live page</a></p></div>"""


def add_error_pages(site: Site) -> None:
    """Have pages that do not exist, or break, show what every page shows: the stop, the ways to others, and why."""
    missing = plain_page(site, "No such page", _MISSING)

    async def no_such_page(request: Request, _: Exception) -> Response:
        if "text/html" in request.headers.get("accept", ""):
            return HTMLResponse(missing, 404)
        return JSONResponse({"ok": False, "sentence": "There is no such page."}, 404)

    core.app.add_exception_handler(404, no_such_page)

    def broken() -> None:
        with framed(site, "Not shown", ""), ui.element("div").classes("sinew-card"):
            heading("This page cannot be shown")
            ui.label("The dashboard made a mistake; its log says which. The bench goes on as it was.")

    app.on_page_exception(broken)


def sign_in_page(site: Site) -> str:
    """Return the HTML of the page that asks for the token, with the stop, which needs none on the serving machine."""
    return plain_page(site, "Sign in", f'<div class="sinew-card sinew-sign-in">{SIGN_IN}</div>')
