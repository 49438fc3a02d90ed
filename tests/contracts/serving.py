"""The dashboard's steward for tests: real sockets on loopback, runs and pages that are cheap, a bench that notes."""

import os
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
from tests.contracts import fake_run
from tests.patience import LONG_S, until

from sinew.apps.dashboard.access import Access
from sinew.apps.dashboard.steward import Settings, Steward
from sinew.bench.stops import StopReport
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_rig, load_rig

TOKEN = "a-token-for-tests-and-nothing-else"
RIG = dump_rig(load_rig("paper"))
PATIENCE = LONG_S  # s; for time-outs that do not follow the load
PAGE = """
import json, socket, sys
told = json.loads(sys.stdin.readline())
with socket.create_server((told["http_host"], told["http_port"])):
    sys.stdin.read()
"""


def plan(behaviour: str = fake_run.OBEDIENT) -> str:
    """Return a plan whose run behaves like that."""
    return f'name = "{behaviour}"\n[pretension]\npretension_mm = [2]\n[sweep]\nfrequency_hz = [3]\n'


def fake_command(*words: str) -> list[str]:
    return [sys.executable, "-S", str(fake_run.__file__), words[words.index("--out") + 1]]


_FIRST_PORT, _PORTS = 20_000, 10_000  # below those that the kernel gives to connections
_reserved: list[socket.socket] = []


def free_port() -> int:
    """Return a port that is free, like the one after it, and that no other test gets while this process lives.

    A server binds it seconds later, when a number that the kernel gave could be another's again. So it is reserved by a
    name of a Unix socket (Linux's abstract ones), which goes with the process.
    """
    for place in range(0, _PORTS, 2):
        port = _FIRST_PORT + (os.getpid() * 38 + place) % _PORTS
        name = socket.socket(socket.AF_UNIX)
        try:
            name.bind(f"\0sinew-tests-{port}")
            for number in (port, port + 1):
                with socket.socket() as one:
                    one.bind(("127.0.0.1", number))
        except OSError:
            name.close()
        else:
            _reserved.append(name)
            return port
    raise OSError("found no two free ports side by side")


@dataclass
class Bench:
    """A bench that notes when it is brought to rest: which port, by which rig, to which state.

    urgent: whether that was an emergency, as it began and before it let go.
    """

    stops: list[tuple[str, str, str | None]] = field(default_factory=list)
    urgent: list[bool] = field(default_factory=list)
    gate: threading.Event = field(default_factory=threading.Event)

    def rest(
        self,
        port: str,
        spec: RigSpec,
        state: str | None,
        on_frozen: Callable[[StopReport], None],
        is_emergency: Callable[[], bool],
    ) -> StopReport:
        self.stops.append((port, spec.name, state))
        self.urgent.append(is_emergency())
        on_frozen(StopReport("release", frozen=frozenset(range(5))))
        self.gate.wait(PATIENCE)
        self.urgent.append(is_emergency())
        return StopReport("release", ["drive"])


@dataclass
class Page:
    """A page that was loaded, of a browser that is signed in."""

    client: httpx.Client

    def says(self, command: str, **more: object) -> httpx.Response:
        return self.client.post("/command", json={"command": command, **more})

    def starts(self, name: str = "one", behaviour: str = fake_run.OBEDIENT) -> httpx.Response:
        return self.says("start", name=name, plan=plan(behaviour), rig=RIG)


@dataclass
class Served:
    """A steward at work. client: not signed in, from our own page. bench: what it brings to rest."""

    steward: Steward
    access: Access
    client: httpx.Client
    bench: Bench
    pages: list[httpx.Client] = field(default_factory=list)

    @property
    def runs(self) -> Path:
        return self.steward.settings.runs

    @property
    def address(self) -> tuple[str, int]:
        return "127.0.0.1", self.access.steering_port

    def status(self) -> dict[str, Any]:
        return dict(self.client.get("/status").json())

    def page(self) -> Page:
        """Return a page that was just loaded, in a browser of its own."""
        own = httpx.Client(base_url=self.client.base_url, headers=self.client.headers, timeout=PATIENCE, verify=False)
        own.cookies.set(self.access.cookie_name, self.access.new_session(), domain="127.0.0.1")
        self.pages.append(own)
        return Page(own)

    def runs_as(self, state: str) -> bool:
        run = self.status()["run"]
        return run is not None and run["state"] == state


@contextmanager
def serving(runs: Path, **settings: Any) -> Iterator[Served]:
    """Give a steward with a bench that is none; what it began is over at the end."""
    port, bench = free_port(), Bench()
    bench.gate.set()
    access = Access(TOKEN, "127.0.0.1", port)
    chosen = {
        "access": access,
        "runs": runs,
        "bench": "port",
        "port": "/dev/bench",
        "command": fake_command,
        "page": (sys.executable, "-S", "-c", PAGE),
        "rest": bench.rest,
    }
    steward = Steward(Settings(**(chosen | settings)))
    origin = {"Origin": f"http://127.0.0.1:{port}"}
    with (
        steward,
        httpx.Client(base_url=f"http://127.0.0.1:{port + 1}", headers=origin, timeout=PATIENCE, verify=False) as client,
    ):
        served = Served(steward, steward.settings.access, client, bench)
        try:
            yield served
        finally:
            for page in served.pages:
                page.close()
            bench.gate.set()
            run = steward._desk.run
            if run is not None:
                run.process.send_signal(9)
                until(lambda: steward._desk.run is None)
