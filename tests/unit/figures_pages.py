"""What tests read in an HTML page: its tags, its pictures, its links, and what it would fetch from elsewhere."""

import re
from html.parser import HTMLParser


class Outline(HTMLParser):
    """Every tag that opens must close, and nothing may point outside the page."""

    VOID = ("meta", "img", "br")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []
        self.images: list[dict[str, str | None]] = []
        self.tags: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.links += [value or "" for name, value in attrs if name in ("href", "src", "xlink:href")]
        if tag == "img":
            self.images.append(dict(attrs))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def outline(page: str) -> Outline:
    parser = Outline()
    parser.feed(page)
    parser.close()
    return parser


def alternatives(page: str) -> list[str]:
    """Return the words of every picture of the page for those who cannot see it."""
    return [image.get("alt") or "" for image in outline(page).images]


def asked_outside(page: str) -> list[str]:
    """Return what the page asks for from outside: links that leave it, tags that load something, addresses."""
    found = outline(page)
    links = [link for link in found.links if not link.startswith(("data:image/png;base64,", "#"))]
    tags = sorted(found.tags & {"script", "link", "iframe", "object", "embed"})
    addresses = re.findall(r"https?:|url\(|@import", re.sub(r"base64,[A-Za-z0-9+/=]+", "", page))
    return links + tags + addresses
