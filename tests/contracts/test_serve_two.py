"""Two dashboards beside each other on one host, before one browser: each keeps to its own bench."""

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from tests.contracts.serving import PATIENCE, Served, serving

TAKE = {"page": "a-page-of-tests", "command": "take"}


@pytest.fixture
def two(tmp_path: Path) -> Iterator[tuple[Served, Served]]:
    with serving(tmp_path / "first") as first, serving(tmp_path / "second") as second:
        yield first, second


@pytest.fixture
def browser(two: tuple[Served, Served]) -> Iterator[httpx.Client]:
    """Give a browser that is signed in at both: it keeps cookies by host and name, and sends each to every port."""
    with httpx.Client(timeout=PATIENCE, verify=False) as made:
        for served in two:
            made.cookies.set(served.access.cookie_name, served.access.new_session(), domain="127.0.0.1")
        yield made


def post(browser: httpx.Client, served: Served, path: str, said: object = None) -> httpx.Response:
    origin = {"Origin": f"http://127.0.0.1:{served.access.port}"}
    return browser.post(f"http://127.0.0.1:{served.address[1]}{path}", json=said, headers=origin)


def test_one_browser_is_signed_in_at_both(browser: httpx.Client, two: tuple[Served, Served]) -> None:
    assert [post(browser, served, "/command", TAKE).status_code for served in two] == [200, 200]


@pytest.mark.parametrize("number", [0, 1])
def test_a_stop_of_one_bench_leaves_the_other(browser: httpx.Client, two: tuple[Served, Served], number: int) -> None:
    assert post(browser, two[number], "/command", {"command": "emergency"}).status_code == 200
    assert [len(served.bench.stops) for served in two] == [1 - number, number]


def test_a_page_of_one_bench_commands_nothing_at_the_other(browser: httpx.Client, two: tuple[Served, Served]) -> None:
    first, second = two
    origin = {"Origin": f"http://127.0.0.1:{first.access.port}"}
    there = f"http://127.0.0.1:{second.address[1]}/command"
    assert browser.post(there, json={"command": "emergency"}, headers=origin).status_code == 403
    assert second.bench.stops == []
