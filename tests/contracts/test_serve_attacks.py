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
from tests.contracts.serving import RIG, TOKEN, Page, Served, free_port, plan, serving
from tests.patience import LONG_S
from tests.unit.dashboard_journal import run_folder

from sinew.apps.dashboard.access import Access


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with serving(tmp_path_factory.mktemp("runs")) as served:
        yield served


@pytest.fixture(scope="module")
def anybody(served: Served) -> Page:
    return served.page()


@pytest.fixture
def operator(served: Served) -> Page:
    return served.operator()


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


def cookie(access: Access) -> dict[str, str]:
    return {"Cookie": f"{access.cookie_name}={access.new_session()}"}


@pytest.mark.parametrize("path", ["/ticket", "/leave", "/command"])
def test_without_a_token_nothing_is_steered(served: Served, path: str) -> None:
    assert post(served, path, our_page(served), {"command": "stop"}).status_code == 401


@pytest.mark.parametrize("host", ["bench.lab", "127.0.0.1"])
def test_behind_a_proxy_the_bench_is_not_even_stopped_without_a_token(tmp_path: Path, host: str) -> None:
    access = Access(TOKEN, "127.0.0.1", free_port(), ("bench.lab",))
    with serving(tmp_path / "runs", access=access) as served:
        headers = {"Origin": f"https://{host}:{access.port}", "Host": host}
        status = post(served, "/command", headers, {"command": "emergency"}).status_code
    assert (status, served.bench.stops) == (401, [])


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


def test_a_page_on_the_machine_that_serves_is_told_that_it_may_stop(served: Served) -> None:
    told = served.client.get("/status").json()
    assert (told["signed_in"], told["may_stop"]) == (False, True)


@pytest.mark.parametrize("path", ["/ticket", "/command"])
def test_a_wrong_token_steers_nothing(served: Served, path: str) -> None:
    headers = our_page(served) | {"Authorization": "Bearer wrong-token-of-the-same-size"}
    assert post(served, path, headers).status_code == 401


def test_a_session_of_another_token_steers_nothing(served: Served) -> None:
    other = Access("another-token-than-the-right-one", "127.0.0.1", served.access.port)
    assert post(served, "/ticket", our_page(served) | cookie(other)).status_code == 401


@pytest.mark.parametrize("value", ["", ".", "nonce", "nonce.", ".mark", "nonce." + "0" * 64, TOKEN])
def test_a_made_up_session_steers_nothing(served: Served, value: str) -> None:
    assert (
        post(served, "/ticket", our_page(served) | {"Cookie": f"{served.access.cookie_name}={value}"}).status_code
        == 401
    )


@pytest.mark.parametrize(
    "origin",
    ["https://evil.example", "null", "http://127.0.0.1:1", "http://127.0.0.1", "http://127.0.0.1.evil.example:{port}"],
)
def test_a_foreign_page_steers_nothing_with_the_cookie_of_ours(served: Served, origin: str) -> None:
    headers = cookie(served.access) | {"Origin": origin.format(port=served.access.port)}
    assert post(served, "/ticket", headers).status_code == 403


def test_a_form_that_says_no_origin_steers_nothing_with_the_cookie_alone(served: Served) -> None:
    assert post(served, "/ticket", cookie(served.access)).status_code == 403


def test_a_foreign_page_steers_nothing_even_with_the_token(served: Served) -> None:
    headers = {"Authorization": f"Bearer {TOKEN}", "Origin": "https://evil.example"}
    assert post(served, "/ticket", headers).status_code == 403


def test_a_program_with_the_token_needs_no_origin(served: Served) -> None:
    assert post(served, "/ticket", {"Authorization": f"Bearer {TOKEN}"}).status_code == 200


def test_a_foreign_page_may_not_read_the_status(served: Served) -> None:
    answer = httpx.get(f"{served.client.base_url}/status", headers={"Origin": "https://evil.example"})
    assert "access-control-allow-origin" not in answer.headers


def test_our_own_page_may_read_the_status(served: Served) -> None:
    answer = served.client.get("/status")
    assert answer.headers["access-control-allow-origin"] == our_page(served)["Origin"]


def test_our_own_page_may_read_why_it_is_refused(served: Served) -> None:
    answer = served.client.post("/ticket")
    assert (answer.status_code, answer.headers["access-control-allow-origin"]) == (401, our_page(served)["Origin"])


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", "", "127.0.0.1@evil"])
def test_a_name_that_was_rebound_to_our_address_is_refused(served: Served, host: str) -> None:
    assert raw(served, f"GET /status HTTP/1.1\r\nHost: {host}\r\n\r\n".encode()) == 421


def test_two_hosts_in_one_request_are_refused(served: Served) -> None:
    assert raw(served, b"GET /status HTTP/1.1\r\nHost: 127.0.0.1\r\nHost: evil.example\r\n\r\n") == 400


@pytest.mark.parametrize("path", ["/ticket", "/command"])
def test_looking_changes_nothing(served: Served, path: str) -> None:
    assert served.client.get(path).status_code == 405


def test_a_body_that_says_to_be_too_large_is_refused_unread(served: Served) -> None:
    head = f"POST /command HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: {our_page(served)['Origin']}\r\n"
    assert raw(served, f"{head}Content-Length: 262145\r\n\r\n".encode()) == 413


def test_a_body_that_grows_too_large_in_chunks_is_refused(served: Served) -> None:
    head = f"POST /command HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: {our_page(served)['Origin']}\r\n"
    chunks = b"10000\r\n" + b"x" * 65536 + b"\r\n"
    assert raw(served, f"{head}Transfer-Encoding: chunked\r\n\r\n".encode() + 5 * chunks) == 413


def test_a_head_that_is_too_large_is_refused(served: Served) -> None:
    assert raw(served, b"GET /status HTTP/1.1\r\nX: " + b"x" * 100_000) == 400


def test_a_body_of_brackets_is_refused(served: Served, operator: Page) -> None:
    assert operator.client.post("/command", content=b"[" * 200_000).status_code == 400


def test_what_is_no_json_is_refused(served: Served, operator: Page) -> None:
    assert operator.client.post("/command", content=b"take").status_code == 400


def test_a_command_that_was_recorded_is_not_done_again(served: Served, operator: Page) -> None:
    told = {"ticket": operator.ticket, "number": 7, "command": "give"}
    operator.client.post("/command", json=told)
    operator.number = 7
    operator.says("take")
    assert operator.client.post("/command", json=told).status_code == 409
    assert served.status()["operator"] is not None


def test_a_page_that_lost_count_is_told_the_last_number(operator: Page) -> None:
    operator.number = 7
    operator.says("take")
    operator.number = 2
    assert operator.says("take").json()["number"] == 8


def test_a_page_may_say_in_a_header_who_it_is(served: Served) -> None:
    asked = {"Access-Control-Request-Method": "GET", "Access-Control-Request-Headers": "X-Sinew-Ticket"}
    assert served.client.options("/status", headers=asked).status_code == 200


def test_behind_a_proxy_on_this_computer_nobody_looks_without_the_token(tmp_path: Path) -> None:
    access = Access(TOKEN, "127.0.0.1", free_port(), ("bench.lab",))
    with serving(tmp_path / "runs", access=access) as served:
        assert served.client.get("/status").status_code == 401


@pytest.mark.parametrize("number", [0, -1, 1, True, 1.5, "2", None, 2**64])
def test_a_number_that_was_passed_or_is_none_is_refused(served: Served, operator: Page, number: object) -> None:
    told = {"ticket": operator.ticket, "number": number, "command": "give"}
    assert operator.client.post("/command", json=told).status_code in (409, 422)


def test_a_ticket_that_was_never_given_is_refused(served: Served, operator: Page) -> None:
    told = {"ticket": "made-up", "number": 1, "command": "take"}
    assert operator.client.post("/command", json=told).status_code == 403


KEEPING = [("rename", {"to": "other"}), ("bin", {}), ("note", {"notes": "x", "tags": []})]


@pytest.mark.parametrize(("command", "more"), KEEPING)
def test_who_does_not_operate_changes_no_run_on_the_disk(served: Served, command: str, more: dict[str, object]) -> None:
    if not (served.runs / "kept").exists():
        run_folder(served.runs / "kept", [0])
    served.operator()
    assert served.page().says(command, name="kept", **more).status_code == 403
    assert not (served.runs / "kept" / "notes.json").exists()


def test_an_operator_notes_renames_puts_away_and_takes_back_a_run(served: Served, operator: Page) -> None:
    run_folder(served.runs / "first", [0])
    said = [
        operator.says("note", name="first", notes="x", tags=["aged"]),
        operator.says("rename", name="first", to="second"),
        operator.says("bin", name="second"),
        operator.says("restore", name="second"),
    ]
    assert [answer.status_code for answer in said] == [200] * 4
    assert (served.runs / "second" / "notes.json").exists()


@pytest.mark.parametrize("command", ["rename", "bin", "restore", "note"])
@pytest.mark.parametrize("name", ["../x", ".bench", "rigs", "", "none"])
def test_a_name_that_is_no_run_is_not_touched(operator: Page, command: str, name: str) -> None:
    assert operator.says(command, name=name, to="other").status_code in (404, 422)


@pytest.mark.parametrize(
    "name",
    ["../x", "/tmp/x", ".hidden", "..", "a/b", "a\\b", "a\0b", "a\n", "", " ", "x" * 81, "x" * 5000, "ä", "<b>", "-x"],
)
def test_a_name_that_leads_elsewhere_begins_no_run(served: Served, operator: Page, name: str) -> None:
    before = sorted(served.runs.parent.rglob("*"))
    assert operator.says("start", name=name, plan=plan(), rig=RIG).status_code == 422
    assert sorted(served.runs.parent.rglob("*")) == before


@pytest.mark.parametrize("text", ["", "name = 1", "[", "a = " + "[" * 5000, "x = 1e999", RIG])
def test_a_plan_that_is_none_begins_no_run(served: Served, operator: Page, text: str) -> None:
    assert operator.says("start", name="fine", plan=text, rig=RIG).status_code == 422


def test_only_who_operates_puts_something_on_the_shelf_or_takes_it_off(served: Served, operator: Page) -> None:
    onlooker = served.page()
    told = {"shelf": "plans", "name": "kept", "text": plan()}
    assert onlooker.says("shelve", **told).status_code == 403
    assert not (served.runs / "plans" / "kept.toml").exists()
    assert operator.says("shelve", **told).status_code == 200
    assert operator.says("shelve", **told).status_code == 409
    assert onlooker.says("unshelve", shelf="plans", name="kept").status_code == 403
    assert (served.runs / "plans" / "kept.toml").read_text() == plan()
    assert operator.says("unshelve", shelf="plans", name="kept").status_code == 200
    assert list((served.runs / "plans").iterdir()) == []


@pytest.mark.parametrize(
    "told",
    [
        {"shelf": "runs", "name": "x", "text": ""},
        {"shelf": "plans", "name": "../x", "text": ""},
        {"shelf": "plans", "name": "x", "text": "x" * 300_000},
        {"shelf": "plans", "text": ""},
        {"shelf": "plans", "name": "x"},
    ],
)
def test_what_belongs_on_no_shelf_is_not_written(served: Served, operator: Page, told: dict[str, str]) -> None:
    before = sorted(served.runs.parent.rglob("*"))
    assert operator.says("shelve", **told).status_code in (413, 422)
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
        "ticket": st.just("TICKET") | JSON,
        "number": st.integers() | JSON,
        "command": st.sampled_from(["take", "give", "start", "pause", "resume", "hold", "release", "stop"]) | JSON,
        "plan": JSON,
        "rig": JSON,
        "name": JSON,
        "more": JSON,
    },
)


@settings(max_examples=150)
@given(told=COMMAND | JSON)
def test_whatever_json_comes_is_no_fault_of_ours(served: Served, anybody: Page, told: object) -> None:
    ticket = anybody.client.post("/ticket").json()["ticket"]
    anybody.client.post("/command", json={"ticket": ticket, "number": 1, "command": "take"})
    text = json.dumps(told).replace('"TICKET"', json.dumps(ticket))
    assert anybody.client.post("/command", content=text).status_code < 500
