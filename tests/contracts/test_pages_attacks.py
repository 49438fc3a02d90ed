"""What must not get through to the server of the pages: each attack is a test against a real one."""

import json
import select
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import httpx
import pytest
from tests.contracts.serving import free_port
from tests.patience import LONG_S, Patience
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from sinew.apps.dashboard.access import WRONG_S

pytestmark = pytest.mark.skipif(find_spec("nicegui") is None, reason="the dashboard needs the extra")

TOKEN = "a-token-for-the-tests-of-pages"
PATIENCE = 60.0


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pages")
    (folder / "secret.nc").write_text("not for everybody")
    (folder / "runs" / "link").mkdir(parents=True)
    (folder / "runs" / "link" / "recording.nc").symlink_to(folder / "secret.nc")
    return folder / "runs"


@pytest.fixture(scope="module")
def port(runs: Path) -> Iterator[int]:
    """Give the port of a server of pages; its steward is away, which is none of its business here."""
    port = free_port()
    config = {
        "token": TOKEN,
        "key": "signs-the-sessions",
        "http_host": "127.0.0.1",
        "http_port": port,
    }
    config |= {"runs": str(runs), "rig": "paper", "bench": None, "version": "test"}
    command = [sys.executable, "-m", "sinew.apps.dashboard"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdin is not None
            assert process.stderr is not None
            process.stdin.write(json.dumps(config) + "\n")
            process.stdin.flush()
            patience = Patience(PATIENCE)
            while not patience.is_over():
                assert process.poll() is None, process.stderr.read()
                try:
                    httpx.get(f"http://127.0.0.1:{port}/login", timeout=5.0)
                    break
                except httpx.TransportError:
                    select.select([], [], [], 0.1)
            yield port
        finally:
            process.kill()


@pytest.fixture
def client(port: int) -> Iterator[httpx.Client]:
    base = f"http://127.0.0.1:{port}"
    with httpx.Client(base_url=base, headers={"origin": base}, timeout=120.0, trust_env=False) as made:
        yield made


def stream(port: int, origin: str | None = None) -> ClientConnection:
    return connect(f"ws://127.0.0.1:{port}/stream", origin=origin or f"http://127.0.0.1:{port}", open_timeout=LONG_S)  # type: ignore[arg-type]


def is_closed(one: ClientConnection) -> bool:
    """Return whether the other end closes a connection, whatever it says before."""
    try:
        for _ in range(200):
            one.recv(timeout=LONG_S)
    except ConnectionClosed:
        return True
    return False


def test_our_own_page_gets_the_stream(port: int) -> None:
    with stream(port) as socket_:
        assert json.loads(socket_.recv(timeout=LONG_S))["kind"] == "state"


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:1", "https://127.0.0.1.evil.example"]
)
def test_a_foreign_page_gets_no_stream(port: int, origin: str) -> None:
    with pytest.raises(InvalidStatus):
        stream(port, origin)


@pytest.mark.parametrize("origin", ["http://evil.example", "null"])
def test_a_foreign_page_gets_no_socket_of_the_pages(port: int, origin: str) -> None:
    uri = f"ws://127.0.0.1:{port}/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
    with pytest.raises(InvalidStatus):
        connect(uri, origin=origin, open_timeout=LONG_S)  # type: ignore[arg-type]


@pytest.mark.parametrize("origin", ["http://evil.example", "null", ""])
def test_a_foreign_page_cannot_sign_in(client: httpx.Client, origin: str) -> None:
    answer = client.post("/login", json={"token": TOKEN}, headers={"origin": origin})
    assert answer.status_code == 403
    assert "set-cookie" not in answer.headers


def test_a_name_that_was_rebound_to_our_address_gets_nothing(client: httpx.Client) -> None:
    assert client.get("/", headers={"host": "evil.example"}).status_code == 421


def test_the_right_token_gets_at_once_a_session_that_no_script_and_no_foreign_page_has(client: httpx.Client) -> None:
    answer = client.post("/login", json={"token": TOKEN})
    cookie = {part.strip() for part in answer.headers["set-cookie"].lower().split(";")}
    assert {"httponly", "samesite=strict", "path=/"} <= cookie
    assert answer.elapsed.total_seconds() < WRONG_S


@pytest.mark.parametrize("token", ["", "wrong", TOKEN[:-1], TOKEN + "x", "\ud800", None, 7, ["a"]])
def test_a_wrong_token_gets_no_session_and_takes_a_second(client: httpx.Client, token: object) -> None:
    answer = client.post("/login", content=json.dumps({"token": token}))
    assert answer.status_code == (401 if isinstance(token, str) else 400)
    assert "set-cookie" not in answer.headers
    assert answer.status_code == 400 or answer.elapsed.total_seconds() >= WRONG_S


@pytest.mark.parametrize("body", [b"", b"token", b"[]", b"[" * 100_000, b"\xff"])
def test_what_is_no_token_is_refused(client: httpx.Client, body: bytes) -> None:
    assert client.post("/login", content=body).status_code == 400


@pytest.mark.parametrize(
    "path",
    [
        "/download/../secret.nc/recording",
        "/download/..%2Fsecret.nc/recording",
        "/download/%2e%2e/recording",
        "/download/..%2f..%2fetc/recording",
        "/download/%2Fetc/recording",
        "/download/.hidden/recording",
        "/download/link/..%2f..%2fsecret.nc",
        "/download/link/passwd",
        "/download/nothing/recording",
        "/download/" + "a" * 300 + "/recording",
        "/sinew/../page_server.py",
        "/sinew/..%2fpage_server.py",
    ],
)
def test_a_path_leads_nowhere_else(client: httpx.Client, path: str) -> None:
    answer = client.request("GET", httpx.URL(f"{client.base_url}".rstrip("/") + path))
    assert answer.status_code in (400, 404)
    assert "everybody" not in answer.text


def test_a_link_out_of_the_folder_of_runs_is_not_followed(client: httpx.Client) -> None:
    answer = client.get("/download/link/recording")
    assert answer.status_code in (404, 409)
    assert "everybody" not in answer.text


def test_a_message_that_is_too_large_ends_its_connection_alone(port: int, client: httpx.Client) -> None:
    with stream(port) as one, stream(port) as other:
        one.send("x" * 2_000_000)
        assert is_closed(one)
        assert json.loads(other.recv(timeout=LONG_S))["kind"] == "state"


@pytest.mark.parametrize("message", ["[]", "nonsense", '{"base_s": "x"}', "\x00" * 100, "[" * 400])
def test_a_message_that_no_page_sends_ends_its_connection(port: int, message: str) -> None:
    with stream(port) as one:
        one.send(message)
        assert is_closed(one)


def test_too_large_a_post_is_refused(client: httpx.Client) -> None:
    assert client.post("/login", content=b"x" * 1_000_000).status_code == 413


def test_a_page_without_a_steward_says_so(port: int) -> None:
    with stream(port) as socket_:
        for _ in range(40):
            said = json.loads(socket_.recv(timeout=LONG_S))
            if said["kind"] == "state":
                break
    assert said["steward"] is None


@pytest.mark.slow
def test_getting_a_page_writes_nothing(client: httpx.Client, runs: Path) -> None:
    def tree() -> list[str]:
        return sorted(str(path) for path in runs.rglob("*"))

    before = tree()
    for path in ("/", "/plan", "/runs", "/runs/link", "/design", "/runs/%3Cscript%3E"):
        client.get(path)
    assert tree() == before
