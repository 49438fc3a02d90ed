"""Who gets through the gate: hosts, origins, sessions, and the limits on what is sent."""

import asyncio
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.apps.dashboard import access as access_module
from sinew.apps.dashboard.access import COOKIE, Access, Gate, new_token

ACCESS = Access("a-token-for-tests", "127.0.0.1", 8080, ("bench.lab",))
OURS = (b"origin", b"http://127.0.0.1:8080")
HOST = (b"host", b"127.0.0.1:8080")


def session(access: Access = ACCESS) -> tuple[bytes, bytes]:
    return b"cookie", f"{COOKIE}={access.session_cookie()}".encode()


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


@given(st.text())
def test_whatever_is_said_for_a_host_is_judged(host: str) -> None:
    assert ACCESS.host_is_ours(host) in (True, False)


@pytest.mark.parametrize(
    "origin", [None, "", "null", "http://127.0.0.1:8081", "http://127.0.0.1", "http://localhost:8080/", "ftp://bench.lab:8080"]
)  # fmt: skip
def test_other_origins_are_not_ours(origin: str | None) -> None:
    assert not ACCESS.origin_is_ours(origin)


def test_our_page_behind_a_proxy_with_tls_is_ours() -> None:
    assert ACCESS.origin_is_ours("https://bench.lab:8080")


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


@pytest.mark.parametrize("host", ["127.0.0.1", "127.1.2.3", "::1", "localhost"])
def test_loopback_is_what_only_this_computer_reaches(host: str) -> None:
    assert Access("t", host, 1).is_loopback


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.1", "bench.lab", "localhost.lab"])
def test_what_others_reach_is_not_loopback(host: str) -> None:
    assert not Access("t", host, 1).is_loopback


def test_a_session_is_known_by_whoever_knows_the_token() -> None:
    assert Access(ACCESS.token, "::1", 1).is_session(ACCESS.session_cookie())


@given(st.text())
def test_a_text_that_comes_to_mind_is_no_session_and_no_token(text: str) -> None:
    assert not ACCESS.is_session(text)
    assert not ACCESS.token_is_right(text)


def test_half_a_character_is_a_wrong_token_and_no_fault() -> None:
    assert not ACCESS.token_is_right("\ud800")


def test_the_token_does_not_show_in_what_is_printed() -> None:
    assert ACCESS.token not in repr(ACCESS)


def test_tokens_differ() -> None:
    assert len({new_token() for _ in range(100)}) == 100


def test_looking_is_free_on_loopback(gate: Gate) -> None:
    assert status(gate, HOST) == 200


def test_another_host_is_refused(gate: Gate) -> None:
    assert status(gate, (b"host", b"evil")) == 421


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "INVENTED"])
def test_what_may_change_something_needs_an_origin(gate: Gate, method: str) -> None:
    assert status(gate, HOST, session(), method=method) == 403


def test_our_page_may_post(gate: Gate, behind: Answering) -> None:
    messages = ({"type": "http.request", "body": b"a", "more_body": True}, {"type": "http.request", "body": b"b"})
    ask(gate, HOST, OURS, method="POST", messages=messages)
    assert behind.bodies == [b"ab"]


def test_two_origins_of_which_one_is_foreign_are_refused(gate: Gate) -> None:
    assert status(gate, HOST, OURS, (b"origin", b"http://evil"), method="POST") == 403


@pytest.mark.parametrize("length", [b"262145", b"9" * 5000, b"-1", b"1e3", b""])
def test_a_length_that_is_too_much_or_none_is_refused(gate: Gate, length: bytes) -> None:
    assert status(gate, HOST, OURS, (b"content-length", length), method="POST") == 413


def test_a_body_that_turns_out_too_large_never_gets_through(gate: Gate, behind: Answering) -> None:
    chunk = {"type": "http.request", "body": b"x" * 200_000, "more_body": True}
    assert status(gate, HOST, OURS, method="POST", messages=(chunk, chunk)) == 413
    assert behind.bodies == []


def test_a_body_that_does_not_come_is_not_awaited_for_ever(gate: Gate, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(access_module, "_BODY_S", 0.01)
    assert status(gate, HOST, OURS, method="POST", messages=()) == 408


def test_looking_takes_a_session_where_others_reach_us(locked: Gate) -> None:
    assert (status(locked, HOST), status(locked, HOST, session())) == (401, 200)


def test_a_session_of_another_token_opens_nothing(locked: Gate) -> None:
    assert status(locked, HOST, session(Access("another", "127.0.0.1", 8080))) == 401


@pytest.mark.parametrize("path", ["/login", "/static/login.css"])
def test_what_signing_in_takes_is_free(locked: Gate, path: str) -> None:
    assert status(locked, HOST, path=path) == 200


@pytest.mark.parametrize("path", ["/login/", "/login/../runs", "/static", "/static/../runs", "/loginx", "//login"])
def test_what_looks_like_it_is_not(locked: Gate, path: str) -> None:
    assert status(locked, HOST, path=path) == 401


def test_a_browser_gets_a_page_to_sign_in(locked: Gate) -> None:
    sent = ask(locked, HOST, (b"accept", b"text/html,*/*"))
    assert (sent[0]["status"], sent[1]["body"]) == (401, b"<p>sign in</p>")


def test_every_answer_forbids_to_frame_and_to_guess(gate: Gate) -> None:
    headers = dict(ask(gate, HOST)[0]["headers"])
    assert {headers[name] for name in (b"x-frame-options", b"x-content-type-options", b"cache-control")} == {
        b"DENY",
        b"nosniff",
        b"no-store",
    }


Headers = tuple[tuple[bytes, bytes], ...]
CONNECT = ({"type": "websocket.connect"},)


@pytest.mark.parametrize(
    "headers",
    [(HOST,), (HOST, (b"origin", b"http://evil")), ((b"host", b"evil"), OURS), (HOST, session())],
    ids=["no origin", "foreign origin", "another host", "a session without an origin"],
)
def test_a_foreign_web_socket_is_closed_before_it_is_accepted(gate: Gate, headers: Headers) -> None:
    sent = ask(gate, *headers, kind="websocket", messages=CONNECT)
    assert [(message["type"], message["code"]) for message in sent] == [("websocket.close", 1008)]


def test_our_own_web_socket_is_accepted(gate: Gate) -> None:
    assert ask(gate, HOST, OURS, kind="websocket", messages=CONNECT) == [{"type": "websocket.accept"}]


def test_a_web_socket_takes_a_session_where_others_reach_us(locked: Gate) -> None:
    assert ask(locked, HOST, OURS, kind="websocket", messages=CONNECT)[0]["type"] == "websocket.close"


def test_a_web_socket_too_many_is_closed(behind: Answering) -> None:
    gate = Gate(behind, ACCESS, must_sign_in=False, most_sockets=0)
    assert ask(gate, HOST, OURS, kind="websocket", messages=CONNECT)[0]["type"] == "websocket.close"


def test_a_crowd_keeps_strangers_out_and_not_who_is_signed_in(behind: Answering) -> None:
    gate = Gate(behind, ACCESS, must_sign_in=False, most_connections=0)
    assert (status(gate, HOST), status(gate, HOST, session())) == (503, 200)


@pytest.mark.parametrize(
    ("bound", "near"), [("0.0.0.0", "127.0.0.1"), ("::", "::1"), ("127.0.0.1", "127.0.0.1"), ("192.0.2.7", "192.0.2.7")]
)
def test_this_computer_reaches_what_is_bound_to_every_address_by_its_own(bound: str, near: str) -> None:
    assert Access("t" * 20, bound, 8080).near == near
