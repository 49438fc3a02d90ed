"""Who gets through the gate: hosts, origins, sessions, and the limits on what is sent."""

import asyncio
import re
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from starlette.requests import HTTPConnection
from starlette.responses import Response

from sinew.apps.dashboard.access import SESSION_S, Access, Gate

ACCESS = Access("a-token-for-tests", "127.0.0.1", 8080, ("bench.lab",))
NEAR = Access("a-token-for-tests", "127.0.0.1", 8080)
NOON = 1.8e9
OURS = (b"origin", b"http://127.0.0.1:8080")
HOST = (b"host", b"127.0.0.1:8080")


def session(access: Access = ACCESS) -> tuple[bytes, bytes]:
    return b"cookie", f"{access.cookie_name}={access.new_session()}".encode()


class Answering:
    """An application that notes what gets to it."""

    def __init__(self) -> None:
        self.bodies: list[bytes] = []

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] == "websocket":
            self.bodies.append(b"socket")
            await send({"type": "websocket.accept"})
            return
        self.bodies.append((await receive())["body"])
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b""})


def ask(
    gate: Gate, *headers: tuple[bytes, bytes], kind: str = "http", method: str = "GET", path: str = "/",
    messages: tuple[dict[str, Any], ...] = ({"type": "http.request", "body": b""},),
) -> list[dict[str, Any]]:  # fmt: skip
    """Return what a gate sends to a request."""
    sent: list[dict[str, Any]] = []
    left = list(messages)

    async def receive() -> dict[str, Any]:
        if not left:
            await asyncio.Event().wait()
        return left.pop(0)

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {"type": kind, "method": method, "path": path, "headers": list(headers), "query_string": b""}
    asyncio.run(gate(scope, receive, send))
    return sent


def status(*args: Any, **more: Any) -> int:
    return int(ask(*args, **more)[0]["status"])


@pytest.fixture
def behind() -> Answering:
    return Answering()


@pytest.fixture
def gate(behind: Answering) -> Gate:
    return Gate(behind, ACCESS, must_sign_in=False)


@pytest.fixture
def locked(behind: Answering) -> Gate:
    return Gate(behind, ACCESS, must_sign_in=True, free=("/login", "/static/"), sign_in_page="<p>sign in</p>")


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost:8080", "LOCALHOST", "[::1]:9000", "bench.lab:8080"])
def test_our_names_are_ours_on_every_port(host: str) -> None:
    assert ACCESS.host_is_ours(host)


@pytest.mark.parametrize("host", [None, "", "evil", "bench.lab.evil", "localhost.", "a@localhost", "[::2]", "[", ":1"])
def test_other_names_are_not(host: str | None) -> None:
    assert not ACCESS.host_is_ours(host)


@pytest.mark.parametrize(
    "origin", [None, "", "null", "http://127.0.0.1:8081", "http://127.0.0.1", "http://localhost:8080/", "ftp://bench.lab:8080"]
)  # fmt: skip
def test_other_origins_are_not_ours(origin: str | None) -> None:
    assert not ACCESS.origin_is_ours(origin)


def test_a_proxy_with_tls_on_its_usual_port_is_ours_under_the_name_that_was_given() -> None:
    assert ACCESS.origin_is_ours("https://bench.lab")
    assert not ACCESS.origin_is_ours("https://localhost")


@pytest.mark.parametrize(("port", "origin"), [(80, "http://127.0.0.1"), (443, "https://127.0.0.1")])
def test_an_origin_leaves_the_usual_port_out(port: int, origin: str) -> None:
    assert Access("t", "127.0.0.1", port).origin_is_ours(origin)


@pytest.mark.parametrize(
    ("host", "names", "must"),
    [("127.0.0.1", (), False), ("127.0.0.1", ("bench.lab",), True), ("0.0.0.0", (), True)],
)
def test_looking_takes_no_sign_in_only_where_no_proxy_and_no_network_is(
    host: str, names: tuple[str, ...], must: bool
) -> None:
    assert Access("t", host, 8080, names).must_sign_in is must


def at(time_s: float) -> Access:
    return replace(NEAR, clock=lambda: time_s)


def asking(*headers: tuple[bytes, bytes], client: str = "127.0.0.1", **more: Any) -> HTTPConnection:
    scope = {"type": "http", "headers": [HOST, *headers], "client": (client, 5000), "server": ("192.0.2.1", 8080)}
    return HTTPConnection({**scope, "path": "/", "query_string": b"", **more})


def test_a_session_is_known_to_both_servers_of_one_start_and_to_no_other_start() -> None:
    known = [Access(NEAR.token, "::1", 8080, key=key).session_in(NEAR.new_session()) for key in (NEAR.key, "another")]
    assert [one is not None for one in known] == [True, False]


@pytest.mark.parametrize(("later", "is_known"), [(0.0, True), (SESSION_S - 1.0, True), (SESSION_S + 1.0, False)])
def test_a_session_ends_a_week_after_the_token_was_shown(later: float, is_known: bool) -> None:
    assert (at(NOON + later).session_in(at(NOON).new_session()) is not None) is is_known


def test_a_session_that_was_ended_is_none() -> None:
    access = Access("t", "127.0.0.1", 8080)
    first, second = access.new_session(), access.new_session()
    access.signed_out.add(str(access.session_in(first)))
    assert (access.session_in(first), access.session_in(second) is not None) == (None, True)


@pytest.mark.parametrize(
    ("origin", "is_secure"),
    [(b"https://bench.lab", True), (b"http://127.0.0.1:8080", False), (b"https://evil.example", False)],
)
def test_a_session_that_came_by_tls_is_shown_under_tls_alone(origin: bytes, is_secure: bool) -> None:
    response = Response()
    ACCESS.set_cookie(response, asking((b"origin", origin)), ACCESS.new_session())
    assert ("secure" in response.headers["set-cookie"].lower()) is is_secure


@pytest.mark.parametrize("client", ["127.0.0.1", "127.8.8.8", "::1", "::ffff:127.0.0.1", "192.0.2.1"])
def test_who_sits_at_the_machine_may_stop_without_a_token(client: str) -> None:
    assert NEAR.may_stop(asking(client=client))


@pytest.mark.parametrize("client", ["192.0.2.2", "2001:db8::1", "nobody"])
def test_who_comes_from_elsewhere_may_not(client: str) -> None:
    assert not NEAR.may_stop(asking(client=client))


@given(st.text())
def test_a_text_that_comes_to_mind_is_no_session_and_no_token(text: str) -> None:
    assert ACCESS.session_in(text) is None
    assert not ACCESS.token_is_right(text)


def test_the_token_does_not_show_in_what_is_printed() -> None:
    assert ACCESS.token not in repr(ACCESS)


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "INVENTED"])
def test_what_may_change_something_needs_an_origin(gate: Gate, method: str) -> None:
    assert status(gate, HOST, session(), method=method) == 403


@pytest.mark.parametrize("length", [b"262145", b"9" * 5000, b"-1", b"1e3", b""])
def test_a_length_that_is_too_much_or_none_is_refused(gate: Gate, length: bytes) -> None:
    assert status(gate, HOST, OURS, (b"content-length", length), method="POST") == 413


def test_looking_takes_a_session_where_others_reach_us(locked: Gate) -> None:
    assert (status(locked, HOST), status(locked, HOST, session())) == (401, 200)


@pytest.mark.parametrize("path", ["/login", "/static/login.css"])
def test_what_signing_in_takes_is_free(locked: Gate, path: str) -> None:
    assert status(locked, HOST, path=path) == 200


@pytest.mark.parametrize("path", ["/login/", "/login/../runs", "/static", "/static/../runs", "/loginx", "//login"])
def test_what_looks_like_it_is_not(locked: Gate, path: str) -> None:
    assert status(locked, HOST, path=path) == 401


def test_a_browser_gets_a_page_to_sign_in(locked: Gate) -> None:
    sent = ask(locked, HOST, (b"accept", b"text/html,*/*"))
    assert (sent[0]["status"], sent[1]["body"]) == (401, b"<p>sign in</p>")


CONNECT = ({"type": "websocket.connect"},)


def test_a_web_socket_takes_a_session_where_others_reach_us(locked: Gate) -> None:
    assert ask(locked, HOST, OURS, kind="websocket", messages=CONNECT)[0]["type"] == "websocket.close"


def policy(gate: Gate, *headers: tuple[bytes, bytes]) -> dict[str, list[str]]:
    told = dict(ask(gate, *headers)[0]["headers"])[b"content-security-policy"].decode()
    return {part.split()[0]: part.split()[1:] for part in told.split("; ")}


def test_a_page_speaks_to_its_own_two_ports_alone(behind: Answering) -> None:
    gate = Gate(behind, ACCESS, must_sign_in=False, steering_port=8081)
    said = policy(gate, (b"host", b"bench.lab:8080"))["connect-src"]
    assert said == [
        "'self'",
        "ws://bench.lab:8080",
        "wss://bench.lab:8080",
        "http://bench.lab:8081",
        "https://bench.lab:8081",
    ]


def test_no_page_frames_ours_and_no_script_of_others_runs(gate: Gate) -> None:
    said = policy(gate, HOST)
    assert (said["frame-ancestors"], said["object-src"], said["base-uri"]) == (["'none'"], ["'none'"], ["'none'"])
    assert "'unsafe-inline'" not in said["script-src"]
    assert not [one for sources in said.values() for one in sources if one in ("*", "http:", "https:")]


@pytest.mark.parametrize("host", [b"evil; script-src *", b"evil", b"127.0.0.1;"])
def test_a_host_that_is_not_ours_stands_in_no_policy(gate: Gate, host: bytes) -> None:
    assert policy(gate, (b"host", host))["connect-src"] == ["'self'"]


def test_each_page_has_a_mark_of_its_own_on_its_scripts() -> None:
    async def page(scope: Any, receive: Any, send: Any) -> None:
        html = b"<script>1</script><SCRIPT src='a'></script><p>&lt;script&gt;</p>"
        start = {"type": "http.response.start", "status": 200}
        length = str(len(html)).encode()
        await send({**start, "headers": [(b"content-type", b"text/html; charset=utf-8"), (b"content-length", length)]})
        await send({"type": "http.response.body", "body": html[:10], "more_body": True})
        await send({"type": "http.response.body", "body": html[10:]})

    gate = Gate(page, ACCESS, must_sign_in=False)
    marks = set()
    for _ in range(3):
        sent = ask(gate, HOST)
        headers = dict(sent[0]["headers"])
        mark = re.search(rb"'nonce-([^']+)'", headers[b"content-security-policy"])
        assert mark is not None
        assert sent[1]["body"].count(b'nonce="' + mark[1] + b'"') == 2
        assert int(headers[b"content-length"]) == len(sent[1]["body"])
        marks.add(mark[1])
    assert len(marks) == 3
