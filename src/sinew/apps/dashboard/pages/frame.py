"""This is where every page gets its head: name, ways to the others, steering, and the theme."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from nicegui import ui

from sinew.apps.dashboard.pages.site import Site

__all__ = ["card", "empty", "framed", "script", "theme_choice"]

_PAGES = (("Live", "/"), ("Plan", "/plan"), ("Runs", "/runs"), ("Design", "/design"))


@contextmanager
def framed(site: Site, title: str, here: str) -> Iterator[None]:
    """Give the content of a page; the head stands already."""
    ui.page_title(f"{title} · Sinew")
    ui.colors(primary="#0b5fa5", negative="#b3261e", positive="#0a6b4a", warning="#8a5300")
    ui.add_head_html(f'<link rel="stylesheet" href="/sinew/style.css?{site.version}">')
    script("sinew-config", {"steering_port": site.steering_port, "locked": site.is_locked})
    for name in ("theme", "steering"):
        ui.add_body_html(f'<script type="module" src="/sinew/{name}.js?{site.version}"></script>')
    with ui.header(elevated=False).classes("sinew-header"):
        ui.link("Sinew", "/").classes("sinew-brand")
        with ui.element("nav").classes("sinew-nav").props('aria-label="Pages"'):
            for name, path in _PAGES:
                link = ui.link(name, path)
                if path == here:
                    link.props('aria-current="page"')
        ui.element("div").props("id=sinew-controls")
        theme_choice()
    with ui.element("div").classes("sinew-content"):
        yield


def theme_choice() -> None:
    """Offer light, dark, or what the system says; the browser remembers it."""
    ui.html(
        '<label class="sinew-soft" for="sinew-theme">Theme</label> <select id="sinew-theme">'
        '<option value="auto">as the system</option><option value="light">light</option>'
        '<option value="dark">dark</option></select>',
        sanitize=False,
    )


@contextmanager
def card(title: str, span: int) -> Iterator[ui.element]:
    """Give a titled part of a page that takes so many of twelve columns."""
    with ui.element("section").classes(f"sinew-card span-{span}") as made:
        ui.label(title).props("role=heading aria-level=2").classes("text-bold")
        yield made


def empty(sentence: str) -> ui.label:
    """Show what to do where there is nothing to show yet."""
    return ui.label(sentence).classes("sinew-empty")


def script(name: str, data: Any) -> None:
    """Hand data to the page's own scripts, in an element of that id."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False).replace("<", "\\u003c")
    ui.add_body_html(f'<script id="{name}" type="application/json">{text}</script>')
