"""The frame of every page: emergency stop, head with steering, notices, and the theme.

It is plain HTML that stands before what NiceGUI draws and does not depend on it: the stop is there on a page that is
still loading, on one that does not exist, and on one whose server is gone.
"""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from nicegui import app, core, ui
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from sinew.apps.dashboard.access import Access, said
from sinew.apps.dashboard.hub import Hub, Results
from sinew.apps.dashboard.work.runs import read_library
from sinew.apps.dashboard.worker import Worker
from sinew.measure.estimate import shown_interval, typeset
from sinew.measure.units import local_time
from sinew.plan.toml import read_spec

# The pages find what they share: folders, hub, worker, access.


@dataclass
class Site:
    """What all pages share.

    runs: folder of the runs. rig: name or file of the rig that is offered first. bench: "emulator", "port" or None.
    access: who may come in, and where the browser sends commands.
    results: analysed groups of the run under way, and its prediction, see `sinew.apps.dashboard.hub`.
    """

    runs: Path
    rig: str
    bench: str | None
    access: Access
    version: str
    hub: Hub
    work: Worker
    results: Results

    def rig_text(self, name: str) -> str:
        """Return the TOML text of the rig that is offered first, or of one in the library. Raises SpecError."""
        return read_spec("rigs", name) if name == self.rig else read_library("rigs", name, self.runs)


_PARTS = Environment(
    loader=FileSystemLoader(Path(__file__).parents[1] / "static"),
    undefined=StrictUndefined,
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
)


def part(file: str, name: str, *values: Any) -> str:
    """Return a part of a page: the HTML that a macro of a file in `static` makes of some values."""
    return str(getattr(_PARTS.get_template(f"{file}.html").module, name)(*values))


@contextmanager
def framed(site: Site, title: str, here: str) -> Iterator[None]:
    """Give the content of a page; the head stands already."""
    ui.page_title(f"{title} · Sinew")
    ui.colors(primary="#0b5fa5", negative="#b3261e", positive="#0a6b4a", warning="#8a5300")
    ui.add_head_html(part("frame", "style", site.version))
    ui.add_body_html(part("frame", "head", *_head(site, here)))
    with ui.element("div").classes("sinew-content"):
        yield


def plain_page(site: Site, title: str, name: str, here: str = "") -> str:
    """Return the HTML of a page that needs no server once it is there. name: of the part that is its main one."""
    return part("frame", "plain", *_head(site, here), title, part("frame", name))


def _head(site: Site, here: str) -> tuple[str, str, dict[str, Any]]:
    config = {"steering_port": site.access.steering_port, "locked": not site.access.is_loopback, "here": here}
    return site.version, here, config


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


def columns_of(labels: Mapping[str, str], right: Collection[str] = ()) -> list[dict[str, Any]]:
    """Return columns as a table takes them. labels: by name; right: names of those that stand on the right."""
    sides = {key: "right" if key in right else "left" for key in labels}
    return [
        {"name": key, "label": label, "field": key, "align": sides[key], "sortable": True}
        for key, label in labels.items()
    ]


def tabulate(labels: Mapping[str, str], rows: Sequence[Sequence[str]], right: Collection[str] = ()) -> ui.table:
    """Show rows of texts below their labels. labels, right: as for `columns_of`."""
    shown = [{"key": index, **dict(zip(labels, row, strict=True))} for index, row in enumerate(rows)]
    table = ui.table(rows=shown, columns=columns_of(labels, right), row_key="key", pagination=20)
    return table.props("flat dense wrap-cells").classes("w-full")


def script(name: str, data: Any) -> None:
    """Hand data to the page's own scripts, in an element of that id."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False).replace("<", "\\u003c")
    ui.add_body_html(f'<script id="{name}" type="application/json">{text}</script>')


# Estimates in the words of a page.


def quantity(estimate: dict[str, Any], unit: str) -> str:
    """Return an estimate as a page says it: value and 90 % interval with unit, its digits by its uncertainty."""
    return typeset(shown_interval(estimate, unit))


# Pages that stand in for others: one that does not exist, one that cannot be made.


def add_error_pages(site: Site) -> None:
    """Have pages that do not exist, or break, show what every page shows: the stop, the ways to others, and why."""
    missing = plain_page(site, "No such page", "missing")

    async def no_such_page(request: Request, _: Exception) -> Response:
        if "text/html" in request.headers.get("accept", ""):
            return HTMLResponse(missing, 404)
        return said(404, "There is no such page.")

    core.app.add_exception_handler(404, no_such_page)

    def broken() -> None:
        with framed(site, "Not shown", ""), ui.element("div").classes("sinew-card"):
            heading("This page cannot be shown")
            ui.label("The dashboard made a mistake; its log says which. The bench goes on as it was.")

    app.on_page_exception(broken)
