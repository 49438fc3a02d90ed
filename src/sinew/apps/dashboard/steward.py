"""The steward, who holds a dashboard's processes together: bench, run, page, and the port that steers them.

The steward needs no event loop to stop the bench, and nothing here draws or computes. What it began are its children:
where it is killed, a run stops and leaves the bench in its declared state, and the emulator and the page end.
"""

import asyncio
import fcntl
import json
import socket
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import uvicorn
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from starlette.applications import Starlette
from starlette.middleware.cors import CORSMiddleware
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

from sinew import __version__
from sinew.apps.bench.run_control import forget_socket, send_control
from sinew.apps.dashboard.access import Access, Gate, said, server_config
from sinew.apps.dashboard.folders import BENCH, RefusedError
from sinew.apps.dashboard.run_desk import (
    BenchPort,
    Control,
    Emergency,
    Order,
    Process,
    Rest,
    RunDesk,
    Specs,
    await_end,
    bring_to_rest,
    end_process,
    ending_sentence,
    let_go,
    running_elsewhere,
    sinew_command,
    spawn,
)
from sinew.apps.dashboard.work.runs import put_in_library
from sinew.measure.errors import FileError, SpecError
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_rig, load_rig

_ANEW_S = 180.0  # until the port of an emulator is there, on a busy computer; in space it compiles for some seconds
_END_S = 5.0
_LOOK_S = 0.1


class BenchEmulator:
    """`sinew emulate` in a process of its own, begun anew for each run as the rig of that run.

    folder: for its link, its log and what truly happened (truth.json).
    """

    def __init__(self, folder: Path, command: Callable[..., list[str]]) -> None:
        self._folder, self._command, self._log = folder, command, folder / "emulator.log"
        self._process: Process | None = None
        self.port = str(folder / "port")

    @property
    def is_ready(self) -> bool:
        """Whether its port is there; not for a while after it was begun."""
        return self._process is not None and self._process.poll() is None and Path(self.port).exists()

    def begin(self, spec: RigSpec, seed: int, *, in_space: bool) -> None:
        """Begin an emulator that plays a rig, and end the one before. Raises OSError where there can be no process.

        in_space: whether it plays a head with mass, that bends and sways; a second of it costs thirty times as much.
        """
        self.close()
        for link in self._folder.glob("port*"):
            if link.is_symlink():  # of an emulator that is gone, or goes in some seconds
                forget_socket(link.readlink())
                link.unlink()
        rig = self._folder / "played.toml"
        rig.write_text(dump_rig(spec), encoding="utf-8")
        words = ["emulate", "--link", self.port, "--rig", str(rig), "--seed", str(seed)]
        words += ["--truth", str(self._folder / "truth.json"), "--force", "--json"]
        self._log.unlink(missing_ok=True)
        self._process = spawn(self._command(*words, *["--in-space"] * in_space), self._log)

    def trouble(self) -> str | None:
        """Return why it has ended, with the last it said; None where it goes on."""
        if self._process is None or self._process.poll() is None:
            return None
        said = ending_sentence(self._folder, self._log.name) or "it says nothing"
        return f"the emulated bench has ended: {said}; see {self._log}"

    def close(self) -> None:
        """End the emulator."""
        if self._process is not None:
            end_process(self._process, _END_S)


# The page server is kept alive: a process that may fall over without anything moving.
#
# It gets what it needs to know as one line of JSON on its stdin, for arguments and environments can be read by others;
# that its stdin ends is its sign that nobody needs it any more.

_PATIENCE_S = 3.0
_RESTS_S = (0.3, 60.0)
"""Before a page server is begun again: at first, and at most; the rest doubles each time that it never answered [s]."""


class PageProcess:
    """The page server, begun again when it dies.

    command: what begins it. config: what it is told. address: where it listens, (host, port). log: for what it says.
    state: starting, up, or down where it died before it answered.
    """

    def __init__(self, command: Sequence[str], config: dict[str, Any], address: tuple[str, int], log: Path) -> None:
        self._command, self._config, self._address, self._log = list(command), config, address, log
        self._over = threading.Event()
        self._process: Process | None = None
        self._thread = threading.Thread(target=self._keep, name="page", daemon=True)
        self.state = "starting"

    def open(self) -> None:
        """Begin the page server, and watch it from now on."""
        self._thread.start()

    def close(self) -> None:
        """End the page server: its stdin ends, and after a while it is ended by force."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()
        if self._process is not None:
            let_go(self._process)
            if not await_end(self._process, _PATIENCE_S):
                end_process(self._process, _PATIENCE_S)

    @property
    def pid(self) -> int | None:
        """The number of its process, or None where there is none."""
        process = self._process
        return process.pid if process is not None and process.poll() is None else None

    def _keep(self) -> None:
        rest_s = _RESTS_S[0]
        while not self._over.is_set():
            with suppress(OSError):  # a broken pipe: it has died already, which is seen at the next look
                self._process = spawn(self._command, self._log)
                assert self._process.stdin is not None
                self._process.stdin.write(json.dumps(self._config).encode() + b"\n")
            while self.pid is not None and not self._over.wait(_LOOK_S):
                if self.state != "up" and self._answers():
                    self.state, rest_s = "up", _RESTS_S[0]
            if self._process is not None and self.pid is None:
                let_go(self._process)
            self.state = "starting" if self.state == "up" else "down"
            self._over.wait(rest_s)
            rest_s = min(2 * rest_s, _RESTS_S[1])

    def _answers(self) -> bool:
        try:
            with socket.create_connection(self._address, timeout=_LOOK_S):
                return True
        except OSError:
            return False


# Commands to the bench arrive: an application of a few lines, on a port of its own, beside the page.
#
# The page's server draws, streams and computes, and may be busy. Nothing of that happens here: what may block runs in
# threads, and the emergency stop in one that is kept for it.

_Text = Annotated[str, Field(max_length=256 * 1024)]


class SteeringCommand(BaseModel):
    """What a page says, of whoever is signed in: one run at a time takes commands, so pages need no order."""

    model_config = ConfigDict(frozen=True, strict=True)

    command: Literal["start", "continue", "pause", "resume", "hold", "release", "stop", "store"]
    plan: _Text | None = None
    rig: _Text | None = None
    name: _Text | None = None
    library: Literal["rigs", "plans"] | None = None
    text: _Text | None = None
    replace: bool = False

    def needed(self, *names: str) -> list[Any]:
        """Return what a command needs. Raises RefusedError where it lacks some of it."""
        if lacking := [name for name in names if getattr(self, name) is None]:
            raise RefusedError(422, f"found {self.command} without {', '.join(lacking)}; expected {', '.join(names)}")
        return [getattr(self, name) for name in names]


def steering_app(access: Access, steward: "Steward") -> ASGIApp:
    """Return the application of the steering port: POST /command, POST /logout, GET /status.

    Answers are JSON, {"ok", "sentence", ...} and a status of 4xx where a command is not carried out.
    """

    async def status(request: Request) -> Response:
        content = steward.status()
        content |= {"signed_in": access.is_signed_in(request), "may_stop": access.may_stop(request)}
        if access.bearer_is_right(request):  # the server of the pages, which lets no ended session in
            content["signed_out"] = sorted(access.signed_out)
        return JSONResponse(content)

    async def sign_out(request: Request) -> Response:
        session = access.session(request)
        if session is not None:  # it is over for both servers, and for good
            access.signed_out.add(session)
        answer = said(200, "signed out")
        access.set_cookie(answer, "")
        return answer

    async def command(request: Request) -> Response:
        content: object = None
        if access.may_stop(request):
            with suppress(ValueError, RecursionError):
                content = json.loads(await request.body())
            if isinstance(content, dict) and content.get("command") == "emergency":
                # Whoever is signed in or sits here may stop the bench, however old the page: twice harms nobody.
                outcome = await asyncio.shield(asyncio.wrap_future(steward.order_emergency().answer))
                return said(200 if outcome.is_safe else 409, outcome.sentence, took_ms=1e3 * outcome.took)
        if not access.is_signed_in(request):
            return said(401, "nobody is signed in; sign in with the token that `sinew serve` printed")
        if not isinstance(content, dict):
            return said(400, "found no JSON object, expected a command")
        try:
            steering_command = SteeringCommand.model_validate(content)
            return said(200, await asyncio.to_thread(_carry_out, steward, steering_command))
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            where = ".".join(map(str, first["loc"])) or "the command"
            return said(422, f"{where}: {first['msg']}")
        except RefusedError as refusal:
            return said(refusal.status, str(refusal), **refusal.more)

    routes = [
        Route("/command", command, methods=["POST"]),
        Route("/logout", sign_out, methods=["POST"]),
        Route("/status", status, methods=["GET"]),
    ]
    gate = Gate(Starlette(routes=routes), access, free=("/command",))
    return CORSMiddleware(
        gate,
        allow_origins=access.origins(),
        allow_credentials=True,
        allow_methods=["GET", "POST"],
        allow_headers=["Content-Type", "Authorization"],
    )


def _carry_out(steward: "Steward", command: SteeringCommand) -> str:
    if command.command == "start":
        return steward.start(*command.needed("name", "plan", "rig"))
    if command.command == "continue":
        return steward.go_on(*command.needed("name"))
    if command.command == "store":
        return put_in_library(steward.runs, *command.needed("library", "name", "text"), replace=command.replace)
    return steward.tell(command.command)


_RUN_ENDS_S = 60.0
_LOOP_S = 10.0
_BACKLOG = 2048


@dataclass(frozen=True)
class Settings:
    """What is served, and where.

    runs: folder of the runs. bench: emulator, port or None. port: of the bench, where it is a port. rig: that is
    offered first, and that the emulator plays until a run asks for another. The last four are the seams: how a run or
    an emulator is begun, the page server, how a run is asked, how a bench is brought to rest.
    """

    access: Access
    runs: Path
    bench: str | None = None
    port: str | None = None
    rig: str = "paper"
    seed: int = 0
    command: Callable[..., list[str]] = sinew_command
    page: tuple[str, ...] = (*sinew_command()[:2], "-m", "sinew.apps.dashboard")
    control: Control = send_control
    rest: Rest = bring_to_rest


class Steward:
    """Who holds a bench, its run and the page together; a context manager.

    runs: folder of the runs. hurry: set where the end is not to wait for a run.
    Raises SinewError on entering, before anything has begun, where a port, the folder or the rig is not to be had.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._spec = load_rig(settings.rig)
        self.runs = settings.runs.absolute()
        self._emulator = BenchEmulator(self.runs / BENCH, settings.command) if settings.bench == "emulator" else None
        self._desk = RunDesk(self.runs, settings.control, settings.command)
        is_emulated = self._emulator is not None
        self._emergency = Emergency(settings.control, settings.rest, lambda: self._desk.elsewhere, is_emulated)
        self._page = self._page_process()
        self._ends = ExitStack()
        self.hurry = threading.Event()

    def __enter__(self) -> "Steward":
        with ExitStack() as ends:
            ends.callback(self._emergency.close)
            steering = self._claim(ends)
            if self._emulator is not None:
                ends.callback(self._emulator.close)
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

    @property
    def _motors(self) -> str | None:
        """The port behind which motors may move; None where there is no bench, or no emulator is there."""
        return self.settings.port if self._emulator is None else self.port if self._emulator.is_ready else None

    def status(self) -> dict[str, Any]:
        """Return what is going on; never blocks."""
        last = self._emergency.last
        if last is not None and last.at < self._desk.newest_s:
            last = None  # a run has begun since, so it is over, whatever became of that run
        elsewhere = self._desk.elsewhere
        return {
            "time_s": time.time(),
            "bench": {"kind": self.settings.bench, "port": self.port, "rig": self.settings.rig},
            "run": self._desk.document(),
            "last": self._desk.last,
            "elsewhere": elsewhere and elsewhere.name,
            "page": self._page.state,
            "emergency": last and {**asdict(last), "took_ms": 1e3 * last.took},
            "stopping": self._emergency.is_under_way,
        }

    def start(self, name: str, plan: str, rig: str) -> str:
        """Begin a run, and return a sentence. Raises RefusedError."""
        return self._desk.start(name, plan, rig, self._free_bench)

    def go_on(self, name: str) -> str:
        """Go on with a run that ended early, and return a sentence. Raises RefusedError."""
        return self._desk.go_on(name, self._free_bench)

    def _free_bench(self, specs: Specs) -> BenchPort:
        """Return the way to the bench, where a run can begin on it. Raises RefusedError.

        An emulated one is begun for the run, which waits for it; not under a run in a terminal, which may use it.
        """
        if self.port is None:
            raise RefusedError(409, "no bench is connected; serve with --port-bench PORT or --emulate")
        if self._emergency.is_under_way:
            raise RefusedError(409, "the bench is being brought to rest; wait until it is")
        if self._emulator is None:
            return BenchPort(self.port)
        if specs.sways and specs.rig.space is None:
            raise RefusedError(
                409,
                f"the rig {specs.rig.name} has no [space], so its emulated head cannot bend; choose one that has the "
                "masses of head and lever",
            )
        if by_hand := running_elsewhere(self.runs, self.settings.control):
            raise RefusedError(409, f"the run {by_hand.name}, begun in a terminal, may use the bench; end it first")
        self._emulator.begin(specs.rig, self.settings.seed, in_space=specs.sways)
        return BenchPort(self.port, _ANEW_S, self._emulator.trouble)

    def tell(self, command: str) -> str:
        """Tell the run under way something, or bring a bench without one to rest; return a sentence.

        Raises RefusedError.
        """
        if command not in ("hold", "release", "stop") or not self._desk.is_idle or self._motors is None:
            return self._desk.tell(command)
        state, spec = None if command == "stop" else command, self._desk.rig or self._spec
        outcome = self._emergency.order(None, self._motors, spec, state, is_emergency=False).end.result()
        if not outcome.is_safe:
            raise RefusedError(409, outcome.sentence)
        return outcome.sentence

    def order_emergency(self) -> Order:
        """Bring the bench to rest at once, from any thread, and return what will tell how that goes."""
        return self._emergency.order(self._desk.alarm(), self._motors, self._desk.rig or self._spec)

    def run_left(self) -> str | None:
        """Return the name of the run under way; None where there is none."""
        run = self._desk.run
        return None if run is None else run.name

    def _claim(self, ends: ExitStack) -> socket.socket:
        """Return the socket of the steering port; nobody else serves these runs, and the page's port is free."""
        access = self.settings.access
        _listener(access.host, access.port).close()
        steering = ends.enter_context(_listener(access.host, self.settings.access.steering_port))
        try:
            (self.runs / BENCH).mkdir(parents=True, exist_ok=True)
            lock = ends.enter_context((self.runs / BENCH / "steward.lock").open("w"))
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise FileError(
                f"another `sinew serve` looks after {self.runs} already; end it, or choose other --runs"
            ) from None
        except OSError as error:
            raise FileError(f"cannot write into {self.runs}: {error.strerror}; choose other --runs") from error
        return steering

    def _serve(self, steering: socket.socket, ends: ExitStack) -> None:
        """Serve the steering port in a thread of its own."""
        server = uvicorn.Server(server_config(steering_app(self.settings.access, self), ws="none"))
        thread = threading.Thread(target=lambda: asyncio.run(server.serve([steering])), name="steering", daemon=True)

        def end() -> None:
            server.should_exit = True
            thread.join(_LOOP_S)

        thread.start()
        ends.callback(end)
        while not server.started and thread.is_alive():
            thread.join(0.01)

    def _page_process(self) -> PageProcess:
        access, settings = self.settings.access, self.settings
        config = {
            "token": access.token,
            "key": access.key,
            "http_host": access.host,
            "http_port": access.port,
            "own_names": access.own_names,
            "runs": str(self.runs),
            "bench": settings.bench,
            "rig": settings.rig,
            "version": __version__,
        }
        return PageProcess(settings.page, config, (access.near, access.port), self.runs / BENCH / "page.log")

    def _leave_run(self) -> None:
        """End the run, which would lose its bench or its dashboard; a second signal does not wait for it."""
        run = self._desk.run
        if run is None or run.process.poll() is not None:
            return
        with suppress(RefusedError):
            self._desk.tell("stop")
        end = time.monotonic() + _RUN_ENDS_S
        while run.process.poll() is None and time.monotonic() < end and not self.hurry.wait(_LOOK_S):
            pass
        if run.process.poll() is None:
            end_process(run.process, _END_S if not self.hurry.is_set() else 0.0)


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
        raise SpecError(f"cannot listen on {host} port {port} ({reason}); choose another with --http") from error
    return listener
