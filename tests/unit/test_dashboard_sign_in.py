"""Signing in: the token for a session, and how often one may be wrong."""

import asyncio
from typing import Any

import httpx
import pytest
from starlette.applications import Starlette

from sinew.apps.dashboard.access import COOKIE, Access
from sinew.apps.dashboard.sign_in import SIGN_IN_PAGE, WINDOW_S, WRONG_MOST, Attempts, sign_in_routes

ACCESS = Access("a-token-for-tests", "127.0.0.1", 8080)


class Clock:
    def __init__(self) -> None:
        self.time = 1000.0

    def __call__(self) -> float:
        return self.time


@pytest.fixture
def clock() -> Clock:
    return Clock()


class Browser:
    """A browser with its cookies, before the routes."""

    def __init__(self, clock: Clock) -> None:
        self.transport = httpx.ASGITransport(Starlette(routes=sign_in_routes(ACCESS, Attempts(clock))))
        self.cookies = httpx.Cookies()

    def get(self, path: str) -> httpx.Response:
        return asyncio.run(self._ask("GET", path))

    def post(self, path: str, **more: Any) -> httpx.Response:
        return asyncio.run(self._ask("POST", path, **more))

    async def _ask(self, method: str, path: str, **more: Any) -> httpx.Response:
        async with httpx.AsyncClient(
            transport=self.transport, base_url="http://127.0.0.1", cookies=self.cookies, verify=False
        ) as client:
            answer = await client.request(method, path, **more)
            self.cookies = client.cookies
        return answer


@pytest.fixture
def client(clock: Clock) -> Browser:
    return Browser(clock)


def sign_in(client: Browser, token: str = ACCESS.token) -> int:
    return int(client.post("/login", json={"token": token}).status_code)


def test_the_token_gives_a_session(client: Browser) -> None:
    sign_in(client)
    assert ACCESS.is_session(client.cookies[COOKIE])


def test_the_session_is_kept_from_scripts_and_foreign_pages(client: Browser) -> None:
    cookie = client.post("/login", json={"token": ACCESS.token}).headers["set-cookie"].lower()
    assert {"httponly", "samesite=strict", "path=/"} <= {part.strip() for part in cookie.split(";")}


def test_a_wrong_token_gives_none(client: Browser) -> None:
    assert (sign_in(client, "wrong"), COOKIE in client.cookies) == (401, False)


@pytest.mark.parametrize("body", [b"", b"token", b"[]", b'{"token": 1}', b"{}", b"[" * 100_000, b"\xff"])
def test_what_is_no_token_is_refused(client: Browser, body: bytes) -> None:
    assert client.post("/login", content=body).status_code == 400


def test_signing_out_takes_the_session_away(client: Browser) -> None:
    sign_in(client)
    client.post("/logout")
    assert COOKIE not in client.cookies


def test_the_page_takes_the_token_out_of_the_address(client: Browser) -> None:
    assert client.get("/login").text == SIGN_IN_PAGE
    assert "history.replaceState" in SIGN_IN_PAGE


def test_after_too_many_wrong_tokens_none_is_looked_at(client: Browser) -> None:
    codes = [sign_in(client, f"wrong {number}") for number in range(WRONG_MOST + 5)]
    assert codes == [401] * WRONG_MOST + [429] * 5


def test_the_right_token_is_taken_a_minute_after_the_first_wrong_one_at_most(client: Browser, clock: Clock) -> None:
    for _ in range(100):
        sign_in(client, "wrong")
    refused = sign_in(client)
    clock.time += WINDOW_S
    assert (refused, sign_in(client)) == (429, 200)


def test_right_tokens_are_not_counted(client: Browser) -> None:
    assert [sign_in(client) for _ in range(2 * WRONG_MOST)] == [200] * 2 * WRONG_MOST
