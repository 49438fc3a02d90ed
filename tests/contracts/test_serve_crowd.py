"""A crowd before the steering port keeps no emergency out."""

import json
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack
from http.client import HTTPConnection
from pathlib import Path

import httpx
import pytest
from tests.contracts.serving import TOKEN, Served, serving, until
from tests.patience import LONG_S

from sinew.apps.dashboard import access as front

CROWD = 1000


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    with serving(tmp_path / "runs") as served:
        yield served


def crowd(served: Served, stack: ExitStack, say: bytes) -> list[socket.socket]:
    lines = []
    for _ in range(CROWD):
        line = stack.enter_context(socket.create_connection(served.address, timeout=LONG_S))
        if say:
            line.sendall(say)
        lines.append(line)
    return lines


def best_emergency(served: Served) -> tuple[int, float]:
    """Return the status of an emergency stop, and how long it takes [s] where this computer lets us do our work."""
    return min((emergency(served) for _ in range(5)), key=lambda found: found[1])


def emergency(served: Served) -> tuple[int, float]:
    """Return the status of an emergency stop of a program with the token, and how long it took [s]."""
    start = time.monotonic()
    answer = httpx.post(
        f"http://127.0.0.1:{served.address[1]}/command",
        json={"command": "emergency"},
        headers={"Authorization": f"Bearer {TOKEN}"},
        verify=False,
        timeout=LONG_S,
    )
    return answer.status_code, time.monotonic() - start


@pytest.mark.parametrize("say", [b"", b"GET /status HTTP/1.1\r\nX-Drip: "], ids=["idle", "half a head"])
def test_a_thousand_connections_do_not_keep_an_emergency_waiting(served: Served, say: bytes) -> None:
    with ExitStack() as stack:
        crowd(served, stack, say)
        status, took = best_emergency(served)
    assert status == 200
    assert took < 1.0


def test_a_thousand_half_commands_do_not_keep_an_emergency_waiting(served: Served) -> None:
    head = f"POST /command HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://127.0.0.1:{served.access.port}\r\n"
    with ExitStack() as stack:
        crowd(served, stack, f"{head}Content-Length: 100\r\n\r\n{{".encode())
        status, took = best_emergency(served)
    assert status == 200
    assert took < 1.0


def test_who_drips_a_head_is_hung_up_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(front, "HEAD_S", 0.2)
    with serving(tmp_path / "runs") as served, socket.create_connection(served.address, timeout=0.02) as line:
        line.sendall(b"GET /status HTTP/1.1\r\n")

        def is_hung_up() -> bool:
            try:
                line.sendall(b"X: y\r\n")
                return line.recv(1) == b""
            except TimeoutError:
                return False
            except OSError:
                return True

        assert until(is_hung_up)


def test_who_asked_once_and_then_drips_is_hung_up_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(front, "HEAD_S", 0.2)
    with serving(tmp_path / "runs") as served:
        line = HTTPConnection(*served.address, timeout=LONG_S)
        line.request("GET", "/status")
        line.getresponse().read()
        line.sock.sendall(b"GET /status HTTP/1.1\r\n")
        left = line.sock.recv(1)
        line.close()
    assert left == b""


def test_an_idle_connection_makes_room_for_a_newcomer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(front, "MOST_OPEN", 5)
    with serving(tmp_path / "runs") as served, ExitStack() as stack:
        lines = [stack.enter_context(socket.create_connection(served.address, timeout=LONG_S)) for _ in range(20)]
        assert emergency(served)[0] == 200
        assert lines[0].recv(1) == b""


def test_half_commands_in_every_place_make_room_for_an_emergency(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(front, "MOST_OPEN", 5)
    head = f"POST /command HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://127.0.0.1:{served.access.port}\r\n"
    with ExitStack() as stack:
        for _ in range(5):
            line = stack.enter_context(socket.create_connection(served.address, timeout=LONG_S))
            line.sendall(f"{head}Content-Length: 100\r\nExpect: 100-continue\r\n\r\n".encode())
            assert line.recv(65536).startswith(b"HTTP/1.1 100")  # its rest is awaited
        assert emergency(served)[0] == 200


def test_a_request_that_came_whole_is_not_hung_up_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(front, "HEAD_S", 0.2)
    with serving(tmp_path / "runs") as served:
        served.bench.gate.clear()
        with socket.create_connection(served.address, timeout=LONG_S) as line:
            body = json.dumps({"command": "emergency"}).encode()
            head = f"POST /command HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {TOKEN}\r\n"
            line.sendall(f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body)
            time.sleep(0.5)
            served.bench.gate.set()
            assert line.recv(65536).startswith(b"HTTP/1.1 200")
