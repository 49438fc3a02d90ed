"""Who must not steer the bench does not: each test is an attack on the steering port of a real server that fails."""

import contextlib
import json
import socket
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.contracts.serving import RIG, TOKEN, Page, Served, plan, serving
from tests.patience import LONG_S

from sinew.apps.dashboard.access import Access


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with serving(tmp_path_factory.mktemp("runs")) as served:
        yield served


@pytest.fixture(scope="module")
def anybody(served: Served) -> Page:
    return served.page()


def raw(served: Served, text: bytes) -> int:
    """Return the status that a request gets which no decent client sends."""
    with socket.create_connection(served.address, timeout=LONG_S) as line:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            line.sendall(text)
        return int(line.makefile("rb").readline().split()[1])


def post(served: Served, path: str, headers: dict[str, str], body: object = None) -> httpx.Response:
    with httpx.Client(base_url="http://{}:{}".format(*served.address), verify=False) as client:
        return client.post(path, headers=headers, json=body)


def our_page(served: Served) -> dict[str, str]:
    return {"Origin": f"http://127.0.0.1:{served.access.port}"}


PAUSE = {"command": "pause"}  # of no run: who may say it gets 409
OURS, BEARER = "http://127.0.0.1:{port}", f"Bearer {TOKEN}"


@pytest.mark.parametrize(
    ("origin", "session", "token", "status"),
    [
        (OURS, None, None, 401),
        (OURS, "ours", None, 409),
        (OURS, "of another start", None, 401),
        *((OURS, made_up, None, 401) for made_up in ("", ".", "nonce", "nonce.", ".mark", "nonce." + "0" * 64, TOKEN)),
        (OURS, None, "Bearer wrong-token-of-the-same-size", 401),
        (None, "ours", None, 403),
        ("https://evil.example", "ours", None, 403),
        ("null", "ours", None, 403),
        ("http://127.0.0.1:1", "ours", None, 403),
        ("http://127.0.0.1.evil.example:{port}", "ours", None, 403),
        ("https://evil.example", None, BEARER, 403),
        (None, None, BEARER, 409),  # a program
    ],
)
def test_who_steers_shows_our_origin_with_a_session_of_this_start_or_the_token(
    served: Served, origin: str | None, session: str | None, token: str | None, status: int
) -> None:
    other = Access(TOKEN, "127.0.0.1", served.access.port)
    values = {"ours": served.access.new_session(), "of another start": other.new_session()}
    told = {
        "Origin": origin and origin.format(port=served.access.port),
        "Cookie": None if session is None else f"{served.access.cookie_name}={values.get(session, session)}",
        "Authorization": token,
    }
    headers = {name: text for name, text in told.items() if text is not None}
    assert post(served, "/command", headers, PAUSE).status_code == status


@pytest.mark.parametrize("origin", ["http://127.0.0.1:{port}", "https://evil.example"])
def test_only_our_own_page_may_read_what_is_answered(served: Served, origin: str) -> None:
    headers = {"Origin": origin.format(port=served.access.port)}
    for answer in (
        httpx.get(f"{served.client.base_url}/status", headers=headers),
        httpx.post(f"{served.client.base_url}/command", headers=headers),
    ):
        assert answer.headers.get("access-control-allow-origin") == (None if "evil" in origin else headers["Origin"])


@pytest.mark.parametrize(
    "body",
    [
        "Content-Length: 262145\r\n\r\n",
        "Transfer-Encoding: chunked\r\n\r\n" + 5 * ("10000\r\n" + "x" * 65536 + "\r\n"),
    ],
    ids=["too large by its word", "too large in chunks"],
)
def test_a_body_is_bounded_however_it_is_sent(served: Served, body: str) -> None:
    head = f"POST /command HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: {our_page(served)['Origin']}\r\n"
    assert raw(served, f"{head}{body}".encode()) == 413


def test_who_sits_at_the_bench_stops_it_without_a_token_and_does_nothing_else(served: Served) -> None:
    codes = [
        post(served, "/command", our_page(served), {"command": each}).status_code for each in ("emergency", "hold")
    ]
    assert codes == [200, 401]


@pytest.mark.parametrize("header", ["X-Forwarded-For", "Forwarded", "X-Real-IP", "Via"])
def test_what_was_passed_on_to_this_machine_stops_nothing_without_a_token(tmp_path: Path, header: str) -> None:
    with serving(tmp_path) as served:
        headers = our_page(served) | {header: "192.0.2.7"}
        assert post(served, "/command", headers, {"command": "emergency"}).status_code == 401
        assert served.bench.stops == []


@pytest.mark.parametrize("origin", [None, "http://evil.example", "null", "http://127.0.0.1:1"])
def test_a_foreign_page_on_the_machine_that_serves_stops_nothing(tmp_path: Path, origin: str | None) -> None:
    with serving(tmp_path) as served:
        headers = {} if origin is None else {"Origin": origin}
        assert post(served, "/command", headers, {"command": "emergency"}).status_code in (401, 403)
        assert served.bench.stops == []


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", "", "127.0.0.1@evil"])
def test_a_name_that_was_rebound_to_our_address_is_refused(served: Served, host: str) -> None:
    assert raw(served, f"GET /status HTTP/1.1\r\nHost: {host}\r\n\r\n".encode()) == 421


def test_two_hosts_in_one_request_are_refused(served: Served) -> None:
    assert raw(served, b"GET /status HTTP/1.1\r\nHost: 127.0.0.1\r\nHost: evil.example\r\n\r\n") == 400


def test_a_session_that_was_signed_out_steers_no_more_though_its_cookie_was_copied(served: Served) -> None:
    page = served.page()
    recorded = served.access.session_in(page.client.cookies[served.access.cookie_name])
    assert recorded is not None
    kept = dict(page.client.cookies)
    assert page.client.post("/logout").status_code == 200
    page.client.cookies.update(kept)
    assert [page.says("stop").status_code for _ in range(3)] == [401] * 3


def test_only_a_program_with_the_token_is_told_which_sessions_were_ended(served: Served) -> None:
    served.page().client.post("/logout")
    told = served.client.get("/status", headers={"Authorization": f"Bearer {TOKEN}"}).json()
    assert len(told["signed_out"]) >= 1
    assert "signed_out" not in served.status()


@pytest.mark.parametrize(
    "name",
    ["../x", "/tmp/x", ".hidden", "..", "a/b", "a\\b", "a\0b", "a\n", "", " ", "x" * 81, "x" * 5000, "ä", "<b>", "-x"],
)
def test_a_name_that_leads_elsewhere_begins_no_run(served: Served, anybody: Page, name: str) -> None:
    before = sorted(served.runs.parent.rglob("*"))
    assert anybody.says("start", name=name, plan=plan(), rig=RIG).status_code == 422
    assert sorted(served.runs.parent.rglob("*")) == before


@pytest.mark.parametrize("text", ["", "name = 1", "[", "a = " + "[" * 5000, "x = 1e999", RIG])
def test_a_plan_that_is_none_begins_no_run(served: Served, anybody: Page, text: str) -> None:
    assert anybody.says("start", name="fine", plan=text, rig=RIG).status_code == 422


def test_what_is_in_the_library_is_replaced_only_where_that_is_asked(served: Served, anybody: Page) -> None:
    told = {"library": "plans", "name": "kept", "text": plan()}
    assert anybody.says("store", **told).status_code == 200
    assert anybody.says("store", **told).status_code == 409
    assert (served.runs / "plans" / "kept.toml").read_text() == plan()


@pytest.mark.parametrize(
    "told",
    [
        {"library": "runs", "name": "x", "text": ""},
        {"library": "plans", "name": "../x", "text": ""},
        {"library": "plans", "name": "x", "text": "x" * 300_000},
        {"library": "plans", "text": ""},
        {"library": "plans", "name": "x"},
    ],
)
def test_what_belongs_in_no_library_is_not_written(served: Served, anybody: Page, told: dict[str, str]) -> None:
    before = sorted(served.runs.parent.rglob("*"))
    assert anybody.says("store", **told).status_code in (413, 422)
    assert sorted(served.runs.parent.rglob("*")) == before


def test_a_browser_is_told_to_keep_and_frame_nothing(served: Served) -> None:
    headers = served.client.get("/status").headers
    assert [headers[name] for name in ("cache-control", "x-frame-options", "referrer-policy")] == [
        "no-store",
        "DENY",
        "no-referrer",
    ]


def test_the_token_stands_in_no_file_below_the_runs(served: Served) -> None:
    files = [path for path in served.runs.rglob("*") if path.is_file()]
    assert files
    assert [path for path in files if TOKEN.encode() in path.read_bytes()] == []


def test_the_token_stands_in_no_command_line_of_ours(served: Served) -> None:
    lines = [Path(f"/proc/{pid}/cmdline") for pid in ("self", served.steward._page.pid)]
    assert not any(TOKEN.encode() in line.read_bytes() for line in lines)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=10,
)
COMMAND = st.fixed_dictionaries(
    {},
    optional={
        "command": st.sampled_from(["start", "continue", "pause", "resume", "hold", "release", "stop"]) | JSON,
        "plan": JSON,
        "rig": JSON,
        "name": JSON,
        "more": JSON,
    },
)


@settings(max_examples=150)
@given(told=COMMAND | JSON)
def test_whatever_json_comes_is_no_fault_of_ours(served: Served, anybody: Page, told: object) -> None:
    assert anybody.client.post("/command", content=json.dumps(told)).status_code < 500
