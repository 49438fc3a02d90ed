"""Signing in: the token for a session, and how often one may be wrong."""

import asyncio
from http.cookies import SimpleCookie
from typing import Any

import httpx
import pytest
from starlette.applications import Starlette

from sinew.apps.dashboard.access import SIGN_IN, WINDOW_S, WRONG_MOST, Access, Attempts, sign_in_routes

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

    def __init__(self, clock: Clock, access: Access = ACCESS, address: str = "192.0.2.9") -> None:
        self.routes = sign_in_routes(access, SIGN_IN, Attempts(clock))
        self.move_to(address)
        self.cookies = httpx.Cookies()

    def move_to(self, address: str) -> None:
        self.transport = httpx.ASGITransport(Starlette(routes=self.routes), client=(address, 5000))

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
    assert ACCESS.session_in(client.cookies[ACCESS.cookie_name]) is not None


def test_the_session_is_kept_from_scripts_and_foreign_pages(client: Browser) -> None:
    cookie = client.post("/login", json={"token": ACCESS.token}).headers["set-cookie"].lower()
    assert {"httponly", "samesite=strict", "path=/"} <= {part.strip() for part in cookie.split(";")}


def test_a_wrong_token_gives_none(client: Browser) -> None:
    assert (sign_in(client, "wrong"), ACCESS.cookie_name in client.cookies) == (401, False)


@pytest.mark.parametrize("body", [b"", b"token", b"[]", b'{"token": 1}', b"{}", b"[" * 100_000, b"\xff"])
def test_what_is_no_token_is_refused(client: Browser, body: bytes) -> None:
    assert client.post("/login", content=body).status_code == 400


def test_signing_out_takes_the_session_away(client: Browser) -> None:
    sign_in(client)
    client.post("/logout")
    assert ACCESS.cookie_name not in client.cookies


def test_the_page_takes_the_token_out_of_the_address(client: Browser) -> None:
    assert client.get("/login").text == SIGN_IN
    assert "history.replaceState" in SIGN_IN


def test_after_too_many_wrong_tokens_a_source_is_told_to_wait(client: Browser) -> None:
    codes = [sign_in(client, f"wrong {number}") for number in range(WRONG_MOST + 5)]
    assert codes == [401] * WRONG_MOST + [429] * 5


def test_who_holds_the_token_is_never_locked_out(client: Browser) -> None:
    for _ in range(100):
        sign_in(client, "wrong")
    assert sign_in(client) == 200


def test_wrong_tokens_of_one_source_are_not_those_of_another(client: Browser) -> None:
    for _ in range(WRONG_MOST):
        sign_in(client, "wrong")
    client.move_to("192.0.2.10")
    assert sign_in(client, "wrong") == 401


def test_who_sits_at_the_machine_is_never_told_to_wait(client: Browser) -> None:
    client.move_to("127.0.0.1")
    assert [sign_in(client, "wrong") for _ in range(WRONG_MOST + 5)] == [401] * (WRONG_MOST + 5)


def test_a_source_is_answered_again_a_minute_after_its_first_wrong_token(client: Browser, clock: Clock) -> None:
    for _ in range(100):
        sign_in(client, "wrong")
    clock.time += WINDOW_S
    assert sign_in(client, "wrong") == 401


def test_a_crowd_of_sources_takes_no_memory(clock: Clock) -> None:
    attempts = Attempts(clock)
    for number in range(3000):
        attempts.note_wrong(str(number))
    assert len(attempts._wrong) < 2000


def test_a_session_that_was_recorded_opens_nothing_after_signing_out(client: Browser) -> None:
    sign_in(client)
    recorded = client.cookies[ACCESS.cookie_name]
    client.post("/logout")
    assert ACCESS.session_in(recorded) is None


def test_signing_out_of_one_browser_leaves_the_others(client: Browser, clock: Clock) -> None:
    other = Browser(clock)
    sign_in(client)
    sign_in(other)
    client.post("/logout")
    assert ACCESS.session_in(other.cookies[ACCESS.cookie_name]) is not None


def test_signing_in_at_one_dashboard_leaves_the_session_of_the_one_beside_it(clock: Clock) -> None:
    jar: SimpleCookie = SimpleCookie()
    beside = Access("the-token-of-another-bench", "127.0.0.1", 8090)
    for access in (ACCESS, beside):
        answer = Browser(clock, access).post("/login", json={"token": access.token})
        jar.load(answer.headers["set-cookie"])  # a browser keeps cookies by name, whatever the port
    assert all(access.session_in(jar[access.cookie_name].value) is not None for access in (ACCESS, beside))


def test_right_tokens_are_not_counted(client: Browser) -> None:
    assert [sign_in(client) for _ in range(2 * WRONG_MOST)] == [200] * 2 * WRONG_MOST
