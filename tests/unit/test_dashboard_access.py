"""Who gets through the gate: hosts, origins, sessions, and the limits on what is sent."""

import asyncio
import re
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from starlette.requests import HTTPConnection

from sinew.apps.dashboard.access import SESSION_S, Access, Gate

ACCESS = Access("a-token-for-tests", "127.0.0.1", 8080, ("bench.lab",))
OPEN = Access("a-token-for-tests", "0.0.0.0", 8080)
NOON = 1.8e9
OURS = (b"origin", b"http://127.0.0.1:8080")
HOST = (b"host", b"127.0.0.1:8080")
CONNECT = ({"type": "websocket.connect"},)


def session(access: Access = ACCESS) -> tuple[bytes, bytes]:
    return b"cookie", f"{access.cookie_name}={access.new_session()}".encode()


async def page(scope: Any, receive: Any, send: Any) -> None:
    """A page with two scripts."""
    html = b"<script>1</script><SCRIPT src='a'></script><p>&lt;script&gt;</p>"
    start = {"type": "http.response.start", "status": 200}
    length = str(len(html)).encode()
    await send({**start, "headers": [(b"content-type", b"text/html; charset=utf-8"), (b"content-length", length)]})
    await send({"type": "http.response.body", "body": html[:10], "more_body": True})
    await send({"type": "http.response.body", "body": html[10:]})


GATE = Gate(page, ACCESS)
LOCKED = Gate(page, OPEN, free=("/login", "/static/"), sign_in_page="<p>sign in</p>")


def ask(
    gate: Gate, *headers: tuple[bytes, bytes], kind: str = "http", method: str = "GET", path: str = "/",
    messages: tuple[dict[str, Any], ...] = ({"type": "http.request", "body": b""},),
) -> list[dict[str, Any]]:  # fmt: skip
    """Return what a gate sends to a request."""
    sent: list[dict[str, Any]] = []
    left = list(messages)

    async def receive() -> dict[str, Any]:
        return left.pop(0)

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {"type": kind, "method": method, "path": path, "headers": list(headers), "query_string": b""}
    asyncio.run(gate(scope, receive, send))
    return sent


def status(*args: Any, **more: Any) -> int:
    return int(ask(*args, **more)[0]["status"])


def policy(*headers: tuple[bytes, bytes]) -> dict[str, list[str]]:
    told = dict(ask(GATE, *headers)[0]["headers"])[b"content-security-policy"].decode()
    return {part.split()[0]: part.split()[1:] for part in told.split("; ")}


def test_our_names_are_ours_on_every_port_and_no_other_is() -> None:
    ours = ["127.0.0.1", "localhost:8080", "LOCALHOST", "[::1]:9000", "bench.lab:8080"]
    others = [None, "", "evil", "bench.lab.evil", "localhost.", "a@localhost", "[::2]", "[", ":1"]
    assert [host for host in (*ours, *others) if ACCESS.host_is_ours(host)] == ours


def test_our_page_alone_is_an_origin_of_ours_by_its_scheme_name_and_port() -> None:
    ours = ["http://127.0.0.1:8080", "http://bench.lab:8080", "http://[::1]:8080"]
    others = [None, "", "null", "http://127.0.0.1:8081", "http://127.0.0.1", "https://bench.lab:8080"]
    others += ["http://localhost:8080/", "ftp://bench.lab:8080"]
    assert [origin for origin in (*ours, *others) if ACCESS.origin_is_ours(origin)] == ours
    assert Access("t", "127.0.0.1", 80).origin_is_ours("http://127.0.0.1")  # browsers leave the usual port out


def test_a_session_is_known_to_both_servers_of_one_start_and_to_no_other_start() -> None:
    known = [
        Access(ACCESS.token, "::1", 8080, key=key).session_in(ACCESS.new_session()) for key in (ACCESS.key, "another")
    ]
    assert [one is not None for one in known] == [True, False]


@pytest.mark.parametrize(("later", "is_known"), [(0.0, True), (SESSION_S - 1.0, True), (SESSION_S + 1.0, False)])
def test_a_session_ends_a_week_after_the_token_was_shown(later: float, is_known: bool) -> None:
    begun, now = (replace(ACCESS, clock=lambda at=at: at) for at in (NOON, NOON + later))
    assert (now.session_in(begun.new_session()) is not None) is is_known


def test_a_session_that_was_ended_is_none() -> None:
    access = Access("t", "127.0.0.1", 8080)
    first, second = access.new_session(), access.new_session()
    access.signed_out.add(str(access.session_in(first)))
    assert (access.session_in(first), access.session_in(second) is not None) == (None, True)


@pytest.mark.parametrize(
    ("client", "may"),
    [
        *((near, True) for near in ("127.0.0.1", "127.8.8.8", "::1", "::ffff:127.0.0.1", "192.0.2.1")),
        *((far, False) for far in ("192.0.2.2", "2001:db8::1", "nobody")),
    ],
)
def test_who_sits_at_the_machine_may_stop_without_a_token_and_nobody_from_elsewhere(client: str, may: bool) -> None:
    scope = {"type": "http", "headers": [HOST], "client": (client, 5000), "server": ("192.0.2.1", 8080)}
    assert ACCESS.may_stop(HTTPConnection({**scope, "path": "/", "query_string": b""})) is may


@given(st.text())
def test_a_text_that_comes_to_mind_is_no_session_and_no_token(text: str) -> None:
    assert ACCESS.session_in(text) is None
    assert not ACCESS.token_is_right(text)


def test_the_token_does_not_show_in_what_is_printed() -> None:
    assert ACCESS.token not in repr(ACCESS)


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "INVENTED"])
def test_what_may_change_something_needs_an_origin(method: str) -> None:
    assert status(GATE, HOST, session(), method=method) == 403


@pytest.mark.parametrize("length", [b"262145", b"9" * 5000, b"-1", b"1e3", b""])
def test_a_length_that_is_too_much_or_none_is_refused(length: bytes) -> None:
    assert status(GATE, HOST, OURS, (b"content-length", length), method="POST") == 413


def test_looking_takes_a_session_where_others_reach_us() -> None:
    assert (status(GATE, HOST), status(LOCKED, HOST), status(LOCKED, HOST, session(OPEN))) == (200, 401, 200)
    assert ask(LOCKED, HOST, OURS, kind="websocket", messages=CONNECT)[0]["type"] == "websocket.close"


def test_what_signing_in_takes_is_free_and_what_looks_like_it_is_not() -> None:
    free = ["/login", "/static/login.css"]
    others = ["/login/", "/login/../runs", "/static", "/static/../runs", "/loginx", "//login"]
    assert [path for path in (*free, *others) if status(LOCKED, HOST, path=path) == 200] == free


def test_a_browser_gets_a_page_to_sign_in() -> None:
    sent = ask(LOCKED, HOST, (b"accept", b"text/html,*/*"))
    assert (sent[0]["status"], sent[1]["body"]) == (401, b"<p>sign in</p>")


def test_a_page_speaks_to_its_own_two_ports_and_runs_no_script_of_others_and_none_frames_it() -> None:
    said = policy((b"host", b"bench.lab:8080"))
    assert said["connect-src"] == ["'self'", "ws://bench.lab:8080", "http://bench.lab:8081"]
    assert (said["frame-ancestors"], said["object-src"], said["base-uri"]) == (["'none'"], ["'none'"], ["'none'"])
    assert "'unsafe-inline'" not in said["script-src"]
    assert not [one for sources in said.values() for one in sources if one in ("*", "http:", "https:")]


@pytest.mark.parametrize("host", [b"evil; script-src *", b"evil", b"127.0.0.1;"])
def test_a_host_that_is_not_ours_stands_in_no_policy(host: bytes) -> None:
    assert policy((b"host", host))["connect-src"] == ["'self'"]


def test_each_page_has_a_mark_of_its_own_on_its_scripts() -> None:
    marks = set()
    for _ in range(3):
        sent = ask(GATE, HOST)
        headers = dict(sent[0]["headers"])
        mark = re.search(rb"'nonce-([^']+)'", headers[b"content-security-policy"])
        assert mark is not None
        assert sent[1]["body"].count(b'nonce="' + mark[1] + b'"') == 2
        assert int(headers[b"content-length"]) == len(sent[1]["body"])
        marks.add(mark[1])
    assert len(marks) == 3
