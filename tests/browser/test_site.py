"""The documentation's site as `make docs` wrote it: nothing serious for axe-core, and nothing wider than a phone."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

axe_api = pytest.importorskip("axe_playwright_python.sync_playwright", reason="no axe-core: make setup-dev installs it")

pytestmark = pytest.mark.slow
SITE = Path(__file__).resolve().parents[2] / "docs" / "_build"
PAGES = [
    "index",
    "gallery/index",
    "gallery/02_your_csv",
    "how-to/notebook",
    "explanation/physics",
    "reference/cli",
    "reference/python",
]


@pytest.fixture(scope="module")
def site() -> Path:
    if not (SITE / "index.html").is_file():
        pytest.skip("the site is not built: make docs")
    return SITE


@pytest.fixture(scope="module", params=["light", "dark"])
def page(chromium: Any, request: pytest.FixtureRequest) -> Iterator[Any]:
    context = chromium.new_context(color_scheme=request.param)
    yield context.new_page()
    context.close()


def show(page: Any, path: Path, width: int, height: int) -> None:
    page.set_viewport_size({"width": width, "height": height})
    page.goto(path.as_uri())


@pytest.mark.parametrize("name", PAGES)
def test_axe_finds_nothing_serious(page: Any, site: Path, name: str) -> None:
    show(page, site / f"{name}.html", 1366, 800)
    rules = axe_api.Axe().run(page).response["violations"]
    found = {rule["id"]: rule["nodes"][0]["html"] for rule in rules if rule["impact"] in ("serious", "critical")}
    assert found == {}


@pytest.mark.parametrize("name", PAGES)
def test_a_phone_need_not_be_scrolled_sideways(page: Any, site: Path, name: str) -> None:
    show(page, site / f"{name}.html", 390, 844)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
