"""This is where the processes of a dashboard are held together: bench, run, page, and the port that steers them.

The steward needs no event loop to stop the bench, and nothing here draws or computes. Its death stops nothing: a run
goes on, an emulator too, and the next steward finds both.
"""

import asyncio
import fcntl
import socket
import threading
import time
from collections.abc import Awaitable, Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import uvicorn

from sinew import __version__
from sinew.apps.dashboard.access import Access, SignedOut
from sinew.apps.dashboard.bench_emulator import BenchEmulator
from sinew.apps.dashboard.emergency import Emergency, Order, Outcome, Rest, bring_to_rest
from sinew.apps.dashboard.front import raise_file_limit, server_config
from sinew.apps.dashboard.names import BENCH, SIGNED_OUT
from sinew.apps.dashboard.operators import Operators
from sinew.apps.dashboard.page_process import PageProcess
from sinew.apps.dashboard.processes import end_process, sinew_command
from sinew.apps.dashboard.refusal import RefusedError
from sinew.apps.dashboard.run_desk import RunDesk
from sinew.apps.dashboard.run_folders import Control
from sinew.apps.dashboard.steering import steering_app
from sinew.apps.run_control import send_control
from sinew.measure.errors import FileError, SinewError, SpecError
from sinew.plan.toml import load_rig

__all__ = ["Settings", "Steward", "page_command"]

_LOCK, _PAGE_LOG = "steward.lock", "page.log"
_RUN_ENDS_S = 10.0
_LOOP_S = 10.0
_LOOK_S = 0.05
_BACKLOG = 2048


def page_command() -> list[str]:
    """Return the command line of the page server."""
    return [*sinew_command()[:2], "-m", "sinew.apps.dashboard"]


@dataclass(frozen=True)
class Settings:
    """What is served, and where.

    runs: folder of the runs. bench: emulator, port or None. port: of the bench, where it is a port. rig: that the
    emulator plays and that is offered first. The last four are the seams: how a run or an emulator is begun, the page
    server, how a run is asked, how a bench is brought to rest.
    """

    access: Access
    steering_port: int
    runs: Path
    bench: str | None = None
    port: str | None = None
    rig: str = "paper"
    seed: int = 0
    command: Callable[..., list[str]] = sinew_command
    page: tuple[str, ...] = ()
    control: Control = send_control
    rest: Rest = bring_to_rest


class Steward:
    """Who holds a bench, its run, the page and the operator together; a context manager.

    Raises SinewError on entering, before anything has begun, where a port, the folder or the rig is not to be had.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.operators = Operators()
        self._spec = load_rig(settings.rig)
        self._runs = settings.runs.absolute()
        self._emulator = BenchEmulator(self._runs / BENCH, settings.command) if settings.bench == "emulator" else None
        self._desk = RunDesk(self._runs, settings.control, settings.command)
        self._emergency = Emergency(settings.control, settings.rest)
        self._page = self._page_process()
        self._ends = ExitStack()
        self.hurry = threading.Event()

    def __enter__(self) -> "Steward":
        with ExitStack() as ends:
            ends.callback(self._emergency.close)
            steering = self._claim(ends)
            if self._emulator is not None:
                ends.callback(self._emulator.close)
                self._emulator.open(self.settings.rig, self.settings.seed)
            ends.callback(self._desk.close)
            self._desk.open()
            self._serve(steering, ends)
            self._page.open()
            ends.callback(self._page.close)
            # What is done last comes first in the end: until the run is over, its stop and its pages are there.
            ends.callback(self._leave_run)
            self._ends = ends.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.close()

    @property
    def page_state(self) -> str:
        """Whether the page server is up, starting or down."""
        return self._page.state

    @property
    def port(self) -> str | None:
        """The port of the bench, or None where there is none."""
        return self._emulator.port if self._emulator is not None else self.settings.port

    def status(self, asking: str | None) -> dict[str, Any]:
        """Return what is going on, as seen by the ticket `asking`."""
        self.operators.see(asking)
        last = self._emergency.last
        return {
            "time_s": time.time(),
            "bench": {"kind": self.settings.bench, "port": self.port, "rig": self.settings.rig},
            "run": self._desk.document(),
            "last": self._desk.last,
            "operator": self.operators.operator(asking),
            "viewers": self.operators.viewers(),
            "page": self._page.state,
            "emergency": last
            and {
                "at": last.at,
                "took_ms": 1e3 * last.took,
                "sentence": last.sentence,
                "is_safe": last.is_safe,
                "was_emergency": last.was_emergency,
            },
            "stopping": self._emergency.is_under_way,
        }

    def start(self, name: str, plan: str, rig: str) -> str:
        """Begin a run, and return a sentence. Raises RefusedError."""
        return self._desk.start(name, plan, rig, self._free_bench())

    def go_on(self, name: str) -> str:
        """Go on with a run that ended early, and return a sentence. Raises RefusedError."""
        return self._desk.go_on(name, self._free_bench())

    def _free_bench(self) -> str:
        """Return the port of the bench, where a run can begin on it. Raises RefusedError."""
        if self.port is None:
            raise RefusedError(409, "no bench is connected; serve with --port-bench PORT or --emulate")
        if self._emulator is not None and not self._emulator.is_there:
            raise RefusedError(409, f"the emulator has ended; see the log beside {self.port}, and serve again")
        if self._emergency.is_under_way:
            raise RefusedError(409, "the bench is being brought to rest; wait until it is")
        return self.port

    def tell(self, command: str) -> str:
        """Tell the run under way something, or bring a bench without one to rest; return a sentence.

        Raises RefusedError.
        """
        if command not in ("hold", "release", "stop") or not self._desk.is_idle or self.port is None:
            return self._desk.tell(command)
        state = None if command == "stop" else command
        spec = self._desk.spec or self._spec
        outcome = self._emergency.order(None, self.port, spec, state, is_emergency=False).end.result()
        if not outcome.is_safe:
            raise RefusedError(409, outcome.sentence)
        return outcome.sentence

    def order_emergency(self) -> Order:
        """Bring the bench to rest at once, from any thread, and return what will tell how that goes."""
        run = self._desk.alarm()
        return self._emergency.order(run, self.port, self._desk.spec or self._spec)

    def emergency(self) -> Awaitable[Outcome]:
        """Bring the bench to rest at once; to be awaited until the motors stand still."""
        return asyncio.wrap_future(self.order_emergency().answer)

    def run_left(self) -> tuple[str, int] | None:
        """Return name and process of the run that goes on without us; None where there is none."""
        run = self._desk.run
        return None if run is None else (run.name, run.process.pid)

    def _claim(self, ends: ExitStack) -> socket.socket:
        """Return the socket of the steering port; nobody else serves these runs, and the page's port is free."""
        access = self.settings.access
        _listener(access.host, access.port).close()
        steering = ends.enter_context(_listener(access.host, self.settings.steering_port))
        try:
            (self._runs / BENCH).mkdir(parents=True, exist_ok=True)
            lock = ends.enter_context((self._runs / BENCH / _LOCK).open("w"))
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise FileError(
                f"another `sinew serve` looks after {self._runs} already; end it, or choose other --runs"
            ) from None
        except OSError as error:
            raise FileError(f"cannot write into {self._runs}: {error.strerror}; choose other --runs") from error
        return steering

    def _serve(self, steering: socket.socket, ends: ExitStack) -> None:
        """Serve the steering port in a thread of its own."""
        raise_file_limit()
        access = replace(self.settings.access, signed_out=SignedOut(self._runs / BENCH / SIGNED_OUT))
        server = uvicorn.Server(server_config(steering_app(access, self), ws="none"))
        thread = threading.Thread(target=lambda: asyncio.run(server.serve([steering])), name="steering", daemon=True)

        def end() -> None:
            server.should_exit = True
            thread.join(_LOOP_S)

        thread.start()
        ends.callback(end)
        while not server.started and thread.is_alive():
            thread.join(0.01)
        steering.listen(_BACKLOG)  # the system's queue is longer than what is taken out of it at once

    def _page_process(self) -> PageProcess:
        access, settings = self.settings.access, self.settings
        config = {
            "token": access.token,
            "http_host": access.host,
            "http_port": access.port,
            "hosts": list(access.hosts),
            "own_names": list(access.own_names),
            "steering_port": settings.steering_port,
            "runs": str(self._runs),
            "bench": {"kind": settings.bench, "port": self.port, "rig": settings.rig},
            "rig": settings.rig,
            "version": __version__,
        }
        log = self._runs / BENCH / _PAGE_LOG
        return PageProcess(settings.page or page_command(), config, (access.near, access.port), log)

    def _leave_run(self) -> None:
        """End the run on an emulated bench, which ends with us; one on a real bench goes on."""
        run = self._desk.run
        if run is None or self._emulator is None or run.process.poll() is not None:
            return
        try:
            self.settings.control(run.folder, "stop", timeout_s=1.0)
        except SinewError:
            pass  # it does not listen; a signal reaches it
        else:
            end = time.monotonic() + _RUN_ENDS_S
            while run.process.poll() is None and time.monotonic() < end and not self.hurry.wait(_LOOK_S):
                pass
        if run.process.poll() is None:
            end_process(run.process, 0.0 if self.hurry.is_set() else _RUN_ENDS_S)


def _listener(host: str, port: int) -> socket.socket:
    """Return a socket that listens there. Raises SpecError where it cannot."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # asyncio turns Nagle's delay of 40 ms off only where the protocol is named, which socket.create_server does not do.
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            listener.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        listener.bind((host, port))
        listener.listen(_BACKLOG)
    except OSError as error:
        listener.close()
        reason = error.strerror or str(error)
        raise SpecError(
            f"cannot listen on {host} port {port} ({reason}); choose another with --http or --steering-port"
        ) from error
    return listener
