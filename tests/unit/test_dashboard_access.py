"""Who gets through the gate: hosts, origins, sessions, and the limits on what is sent."""

import asyncio
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from starlette.requests import HTTPConnection
from starlette.responses import Response

from sinew.apps.dashboard import access as access_module
from sinew.apps.dashboard.access import IDLE_S, LONGEST_S, Access, Gate, SignedOut, new_token

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


def at(time_s: float, **more: Any) -> Access:
    return Access(ACCESS.token, "127.0.0.1", 8080, clock=lambda: time_s, **more)


def asking(*headers: tuple[bytes, bytes], client: str = "127.0.0.1", **more: Any) -> HTTPConnection:
    scope = {"type": "http", "headers": [HOST, *headers], "client": (client, 5000), "server": ("192.0.2.1", 8080)}
    return HTTPConnection({**scope, "path": "/", "query_string": b"", **more})


def test_a_session_is_known_by_whoever_knows_the_token() -> None:
    assert Access(ACCESS.token, "::1", 8080).session_in(ACCESS.new_session()) is not None


def test_dashboards_beside_each_other_have_cookies_of_their_own() -> None:
    assert Access("t", "127.0.0.1", 8080).cookie_name != Access("t", "127.0.0.1", 8090).cookie_name


def test_a_session_of_the_dashboard_beside_us_is_none_of_ours_even_under_the_same_token() -> None:
    assert Access(ACCESS.token, "127.0.0.1", 8090).session_in(ACCESS.new_session()) is None


@pytest.mark.parametrize(
    ("later", "is_known"), [(0.0, True), (IDLE_S - 1, True), (IDLE_S + 1, False), (-3600.0, False)]
)
def test_a_session_that_nobody_uses_ends(later: float, is_known: bool) -> None:
    assert (at(NOON + later).session_in(at(NOON).new_session()) is not None) is is_known


def test_a_session_lives_while_its_page_is_open_and_not_for_ever() -> None:
    cookie, now = at(NOON).new_session(), NOON
    while at(now).session_in(cookie) is not None:
        response = Response()
        at(now).keep_session(response, asking((b"cookie", f"{ACCESS.cookie_name}={cookie}".encode())))
        if "set-cookie" in response.headers:
            cookie = response.headers["set-cookie"].split("=", 1)[1].split(";")[0]
        now += 3600.0
    assert LONGEST_S < now - NOON < LONGEST_S + 2 * 3600.0


def test_a_session_that_was_renewed_ends_with_the_one_that_it_renews() -> None:
    later = at(NOON + 3600.0)
    response, old = Response(), at(NOON).new_session()
    later.keep_session(response, asking((b"cookie", f"{ACCESS.cookie_name}={old}".encode())))
    later.end_session(asking((b"cookie", f"{ACCESS.cookie_name}={old}".encode())))
    renewed = response.headers["set-cookie"].split("=", 1)[1].split(";")[0]
    assert later.session_in(renewed) is None


def test_what_one_server_ends_the_other_knows_even_when_it_begins_later(tmp_path: Path) -> None:
    page, steward = (at(NOON, signed_out=SignedOut(tmp_path / "signed-out")) for _ in range(2))
    cookies = [page.new_session() for _ in range(2)]
    known = [steward.session_in(cookie) is not None for cookie in cookies]
    for cookie in cookies:
        page.end_session(asking((b"cookie", f"{ACCESS.cookie_name}={cookie}".encode())))
    late = at(NOON, signed_out=SignedOut(tmp_path / "signed-out"))
    assert (known, [one.session_in(c) for one in (page, steward, late) for c in cookies]) == ([True, True], [None] * 6)


def test_a_list_of_ended_sessions_that_goes_away_is_not_forgotten(tmp_path: Path) -> None:
    steward, cookie = at(NOON, signed_out=SignedOut(tmp_path / "list")), ACCESS.new_session()
    cookie = steward.new_session()
    steward.end_session(asking((b"cookie", f"{ACCESS.cookie_name}={cookie}".encode())))
    steward.session_in(cookie)
    (tmp_path / "list").unlink()
    assert steward.session_in(cookie) is None


@pytest.mark.parametrize(("scheme", "is_secure"), [(b"https", True), (b"http", False)])
def test_a_session_behind_a_proxy_with_tls_is_shown_under_tls_alone(scheme: bytes, is_secure: bool) -> None:
    found = []
    for header in ((b"x-forwarded-proto", scheme), (b"origin", scheme + b"://127.0.0.1:8080")):
        response = Response()
        ACCESS.set_cookie(response, asking(header), ACCESS.new_session())
        found.append("secure" in response.headers["set-cookie"].lower())
    assert found == [is_secure, is_secure]


@pytest.mark.parametrize("client", ["127.0.0.1", "127.8.8.8", "::1", "::ffff:127.0.0.1", "192.0.2.1"])
def test_who_sits_at_the_machine_may_stop_without_a_token(client: str) -> None:
    assert NEAR.may_stop(asking(client=client))


@pytest.mark.parametrize("client", ["192.0.2.2", "2001:db8::1", "nobody"])
def test_who_comes_from_elsewhere_may_not(client: str) -> None:
    assert not NEAR.may_stop(asking(client=client))


@pytest.mark.parametrize("name", [b"forwarded", b"via", b"x-forwarded-for", b"x-forwarded-proto", b"x-real-ip"])
def test_whom_a_proxy_brings_does_not_sit_at_the_machine(name: bytes) -> None:
    assert not NEAR.is_at_machine(asking((name, b"192.0.2.2")))
    assert not ACCESS.is_at_machine(asking())


def test_only_a_declared_proxy_says_where_a_request_comes_from() -> None:
    header = (b"x-forwarded-for", b"10.0.0.1, 192.0.2.9")
    assert (ACCESS.source(asking(header)), NEAR.source(asking(header))) == ("192.0.2.9", "127.0.0.1")
    assert ACCESS.source(asking(header, client="192.0.2.5")) == "192.0.2.5"


def test_the_addresses_of_one_network_are_one_source() -> None:
    assert NEAR.source(asking(client="2001:db8::1")) == NEAR.source(asking(client="2001:db8::2"))


@given(st.text())
def test_a_text_that_comes_to_mind_is_no_session_and_no_token(text: str) -> None:
    assert ACCESS.session_in(text) is None
    assert not ACCESS.token_is_right(text)


@given(st.text(alphabet="abc.XY0123-_", max_size=60))
def test_a_session_that_was_changed_is_none(text: str) -> None:
    cookie = ACCESS.new_session()
    where = len(text) % len(cookie)
    changed = cookie[:where] + text + cookie[where + len(text) :]
    assert changed == cookie or ACCESS.session_in(changed) is None


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


class Holding:
    """An application whose web sockets stay open."""

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "websocket.accept"})
        await asyncio.Event().wait()


def opened(gate: Gate, *visitors: tuple[bytes, bytes] | None) -> list[bool]:
    """Return who gets a web socket while those before it stay."""

    async def one(headers: list[tuple[bytes, bytes]]) -> bool:
        sent: list[str] = []

        async def receive() -> dict[str, Any]:
            return {"type": "websocket.connect"}

        async def send(message: Any) -> None:
            sent.append(message["type"])

        scope = {"type": "websocket", "path": "/", "headers": headers, "query_string": b""}
        tasks.append(asyncio.create_task(gate(scope, receive, send)))
        while not sent:
            await asyncio.sleep(0)
        return sent == ["websocket.accept"]

    async def all_of_them() -> list[bool]:
        try:
            return [await one([HOST, OURS, *([] if who is None else [who])]) for who in visitors]
        finally:
            for task in tasks:
                task.cancel()

    tasks: list[asyncio.Task[None]] = []
    return asyncio.run(all_of_them())


def test_strangers_take_no_place_of_who_is_signed_in() -> None:
    gate = Gate(Holding(), ACCESS, must_sign_in=False, most_strangers=3, most_in_all=4)
    who = session()
    assert opened(gate, *[None] * 5, *[who] * 5) == [True] * 3 + [False] * 2 + [True] * 4 + [False]


def test_one_session_takes_no_place_of_another() -> None:
    gate = Gate(Holding(), ACCESS, must_sign_in=False, most_sockets=2)
    greedy, other = session(), session()
    assert opened(gate, *[greedy] * 4, other, None) == [True, True, False, False, True, True]


def test_a_place_that_was_left_is_free_again() -> None:
    gate = Gate(Holding(), ACCESS, must_sign_in=False, most_sockets=2, most_strangers=1)
    for _ in range(3):
        assert opened(gate, session(), None) == [True, True]
    assert not gate.sockets


def test_a_crowd_keeps_strangers_out_and_not_who_is_signed_in(behind: Answering) -> None:
    gate = Gate(behind, ACCESS, must_sign_in=False, most_connections=0)
    assert (status(gate, HOST), status(gate, HOST, session())) == (503, 200)


def test_in_a_crowd_an_urgent_request_of_a_stranger_is_heard_if_it_is_whole(behind: Answering) -> None:
    gate = Gate(behind, ACCESS, must_sign_in=False, urgent=("/command",), most_connections=0)
    codes = [status(gate, HOST, OURS, method="POST", path=path) for path in ("/command", "/ticket")]
    assert codes == [200, 503]
    assert status(gate, HOST, OURS, method="POST", path="/command", messages=()) == 408


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


@pytest.mark.parametrize(
    ("bound", "near"), [("0.0.0.0", "127.0.0.1"), ("::", "::1"), ("127.0.0.1", "127.0.0.1"), ("192.0.2.7", "192.0.2.7")]
)
def test_this_computer_reaches_what_is_bound_to_every_address_by_its_own(bound: str, near: str) -> None:
    assert Access("t" * 20, bound, 8080).near == near
