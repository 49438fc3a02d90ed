"""The steward, who holds a dashboard's processes together: bench, run, page, and the port that steers them.

The steward needs no event loop to stop the bench, and nothing here draws or computes. Its death stops nothing: a run
goes on, an emulator too, and the next steward finds both.
"""

import asyncio
import fcntl
import json
import select
import socket
import subprocess
import threading
import time
from collections import deque
from collections.abc import Awaitable, Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Annotated, Any, Literal, Protocol

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
from sinew.apps.dashboard import run_desk
from sinew.apps.dashboard.access import Access, Gate, SignedOut, raise_file_limit, server_config
from sinew.apps.dashboard.emergency import Emergency, Order, Outcome, Rest, bring_to_rest
from sinew.apps.dashboard.operators import BENCH, SIGNED_OUT, Operators, RefusedError, Ticket
from sinew.apps.dashboard.run_desk import (
    Adopted,
    Control,
    Process,
    RunDesk,
    Specs,
    Way,
    end_process,
    sinew_command,
)
from sinew.apps.dashboard.work.runs import (
    bin_run,
    note_run,
    put_on_shelf,
    rename_run,
    restore_run,
    take_off_shelf,
)
from sinew.measure.errors import FileError, SinewError, SpecError
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_rig, load_rig

# The dashboard gets an emulated bench to play with, or finds the one that a steward before it began.

_READY_S = 90.0
_ANEW_S = 180.0  # until its port is there, on a busy computer; in space there is a quarter of a minute to compile
_END_S = 5.0
_PID, _RIG, _LOG = "emulator.pid", "rig", "emulator.log"
_PLAYED = "played.toml"
_IN_SPACE = "--in-space"


class BenchEmulator:
    """`sinew emulate` in a process of its own. folder: for its link, its log and what truly happened (truth.json).

    spec: the rig that it plays. is_in_space: whether it plays a head with mass, that bends and sways; a second of it
    costs thirty times as much, so it is begun where a plan bends.
    """

    def __init__(self, folder: Path, command: Callable[..., list[str]]) -> None:
        self._folder, self._command = folder, command
        self._process: Process | None = None
        self._announced: IO[bytes] | None = None
        self._served = ""  # the rig that it is to play where no run asks for another
        self.spec: RigSpec | None = None
        self.is_in_space = False

    @property
    def port(self) -> str:
        """The name of its port."""
        return str(self._folder / "port")

    @property
    def is_there(self) -> bool:
        """Whether the emulator goes on."""
        return self._process is not None and self._process.poll() is None

    @property
    def is_ready(self) -> bool:
        """Whether its port is there; not for a while after it was begun anew."""
        return self.is_there and Path(self.port).exists()

    def plays(self, spec: RigSpec, *, in_space: bool) -> bool:
        """Return whether it plays such a rig; what is known of its certainty does not count."""
        return in_space == self.is_in_space and self.spec is not None and spec.model_dump() == self.spec.model_dump()

    def open(self, rig: str, seed: int) -> bool:
        """Begin the emulator, or take over one that is there; return whether it was there.

        rig: TOML file or name. Its port is there after a while, see `await_ready`; meanwhile the pages are begun.
        Raises FileError where one that is there is to play another rig.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        self._served, self.spec = rig, load_rig(rig)
        self._process = self._found(rig)
        if self._process is not None:
            return True
        self._clear_link()
        self._announced = self._begin(rig, seed, subprocess.PIPE).stdout
        return False

    def await_ready(self, over: threading.Event) -> None:
        """Wait until the emulator that was begun says that its port is there, unless that is over before.

        Raises FileError where it does not get ready.
        """
        process, out, self._announced = self._process, self._announced, None
        if out is None:
            return
        end = time.monotonic() + _READY_S
        with out:
            while not (comes := select.select([out], [], [], _LOOK_S)[0]) and time.monotonic() < end:
                if over.is_set():
                    return
            if (comes and out.readline()) or self._process is not process:  # the last: it was begun anew meanwhile
                return
        self.close()
        raise FileError(f"the emulator does not get ready: {self.last_words()}; see {self._folder / _LOG}")

    def change(self, spec: RigSpec, seed: int, *, in_space: bool) -> None:
        """End the emulator and begin one that plays a rig whose head bends and sways, or only turns.

        Its port is there after a while. Raises OSError where there can be no process.
        """
        self.close()
        self._clear_link()
        self.spec, self.is_in_space = spec, in_space
        (self._folder / _PLAYED).write_text(dump_rig(spec), encoding="utf-8")
        self._begin(str(self._folder / _PLAYED), seed, subprocess.DEVNULL)

    def last_words(self) -> str:
        """Return what it said last."""
        said = (self._folder / _LOG).read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return said[-1] if said else "it says nothing"

    def close(self) -> None:
        """End the emulator."""
        if self._process is not None:
            end_process(self._process, _END_S)
            (self._folder / _PID).unlink(missing_ok=True)

    def _found(self, rig: str) -> Adopted | None:
        process = run_desk.adopt_from(self._folder / _PID, ["emulate", self.port])
        if process is None or not Path(self.port).exists():
            return None
        told = (self._folder / _RIG).read_text(encoding="utf-8") if (self._folder / _RIG).exists() else ""
        served, *how = told.splitlines() or [""]
        if served != rig:
            process.close()
            raise FileError(
                f"an emulator plays the rig {served} on {self.port} already, expected {rig}; "
                f"serve with --rig {served}, or end process {process.pid}"
            )
        self.is_in_space = _IN_SPACE in how
        if _PLAYED in how:
            self.spec = load_rig(self._folder / _PLAYED)
        return process

    def _clear_link(self) -> None:
        link = Path(self.port)
        if link.is_symlink():
            # Its emulator is gone; what it leads to may be somebody else's terminal by now.
            forget_socket(link.readlink())
            link.unlink()

    def _begin(self, rig: str, seed: int, out: int) -> "subprocess.Popen[bytes]":
        words = ["emulate", "--link", self.port, "--socket", "--rig", rig, "--seed", str(seed)]
        words += ["--truth", str(self._folder / "truth.json"), "--force", "--json"]
        words += [_IN_SPACE] if self.is_in_space else []
        with (self._folder / _LOG).open("wb") as file:
            process = subprocess.Popen(
                self._command(*words),
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=file,
                start_new_session=True,
            )
        self._process = process
        run_desk.write_pid(self._folder / _PID, process.pid)
        how = [*([_IN_SPACE] if self.is_in_space else []), *([_PLAYED] if rig != self._served else [])]
        (self._folder / _RIG).write_text("\n".join([self._served, *how]), encoding="utf-8")
        return process


# The page server is kept alive: a process that may fall over without anything moving.
#
# It gets what it needs to know as one line of JSON on its stdin, for arguments and environments can be read by others;
# that its stdin ends is its sign that nobody needs it any more.

MOST_RESTARTS = 5
"""So often it is begun anew within `WITHIN_S`; then it rests until the oldest time is that long ago."""

WITHIN_S = 60.0
"""See `MOST_RESTARTS` [s]."""

_PAGE_LOOK_S = 0.1
_PATIENCE_S = 3.0
_REST_S = 0.3  # before it is begun anew


class PageProcess:
    """The page server, begun again when it dies.

    command: what begins it. config: what it is told. address: where it listens, (host, port). log: for what it says.
    """

    def __init__(
        self,
        command: Sequence[str],
        config: dict[str, Any],
        address: tuple[str, int],
        log: Path,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._command, self._config, self._address, self._log = list(command), config, address, log
        self._clock = clock
        self._begun: deque[float] = deque()
        self._over = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
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
            assert self._process.stdin is not None
            self._process.stdin.close()
            try:
                self._process.wait(_PATIENCE_S)
            except subprocess.TimeoutExpired:
                end_process(self._process, _PATIENCE_S)

    @property
    def pid(self) -> int | None:
        """The number of its process, or None where there is none."""
        process = self._process
        return process.pid if process is not None and process.poll() is None else None

    def _keep(self) -> None:
        while not self._over.is_set():
            if self._process is None or self._process.poll() is not None:
                self._begin_again()
            elif self.state == "starting" and self._answers():
                self.state = "up"
            self._over.wait(_PAGE_LOOK_S)

    def _begin_again(self) -> None:
        now = self._clock()
        while self._begun and now - self._begun[0] >= WITHIN_S:
            self._begun.popleft()
        if len(self._begun) > MOST_RESTARTS:
            self.state = "down"
            return
        self.state = "starting"
        if self._process is not None:
            assert self._process.stdin is not None
            self._process.stdin.close()
            self._over.wait(_REST_S)
        self._begun.append(now)
        try:
            self._process = self._begin()
        except OSError:
            self._process = None

    def _begin(self) -> "subprocess.Popen[bytes]":
        with self._log.open("ab") as log:
            # Unbuffered: what a process that has died did not take is not tried again when its stdin is closed.
            process = subprocess.Popen(
                self._command,
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        assert process.stdin is not None
        with suppress(BrokenPipeError):  # it has died already, which is seen at the next look
            process.stdin.write(json.dumps(self._config).encode() + b"\n")
        return process

    def _answers(self) -> bool:
        try:
            with socket.create_connection(self._address, timeout=_PAGE_LOOK_S):
                return True
        except OSError:
            return False


# Commands to the bench arrive: an application of a few lines, on a port of its own, beside the page.
#
# The page's server draws, streams and computes, and may be busy. Nothing of that happens here: what may block runs in
# threads, and the emergency stop in one that is kept for it.

TICKET_HEADER = "X-Sinew-Ticket"
"""Header in which a page says who it is when it asks for the status; the query `ticket` does, too."""

_Text = Annotated[str, Field(max_length=256 * 1024)]


class SteeringCommand(BaseModel):
    """What a page says, and in which order. number: greater than that of its last command."""

    model_config = ConfigDict(frozen=True, strict=True)

    ticket: Annotated[str, Field(max_length=64)]
    number: Annotated[int, Field(ge=1, le=2**53)]
    command: Literal[
        "take",
        "give",
        "start",
        "continue",
        "pause",
        "resume",
        "hold",
        "release",
        "stop",
        "rename",
        "bin",
        "restore",
        "note",
        "shelve",
        "unshelve",
    ]
    plan: _Text | None = None
    rig: _Text | None = None
    name: _Text | None = None
    to: _Text | None = None
    notes: _Text | None = None
    tags: Annotated[list[_Text], Field(max_length=100)] | None = None
    shelf: Literal["rigs", "plans"] | None = None
    text: _Text | None = None
    replace: bool = False


class Helm(Protocol):
    """What steers: the steward. Everything but `emergency` may block."""

    @property
    def operators(self) -> Operators:
        """Return who looks on and who operates."""

    def status(self, asking: str | None) -> dict[str, Any]:
        """Return what is going on, as seen by a ticket; never blocks."""

    def start(self, name: str, plan: str, rig: str) -> str:
        """Begin a run. Raises RefusedError."""

    def go_on(self, name: str) -> str:
        """Go on with a run that ended early. Raises RefusedError."""

    def tell(self, command: str) -> str:
        """Tell the run something. Raises RefusedError."""

    def keep(self, command: SteeringCommand) -> str:
        """Note a run, or rename, put away or take back one that has ended. Raises RefusedError."""

    def shelve(self, shelf: str, name: str, text: str | None, replace: bool) -> str:
        """Put a rig or plan on the lab's shelf, or take it off where there is no text. Raises RefusedError."""

    def emergency(self) -> Awaitable[Outcome]:
        """Bring the bench to rest at once."""


def steering_app(access: Access, helm: Helm) -> ASGIApp:
    """Return the application of the steering port: POST /ticket, POST /leave, POST /command, GET /status.

    Answers are JSON, {"ok", "sentence", ...} and a status of 4xx where a command is not carried out.
    """
    desk = _Desk(access, helm)
    routes = [
        Route("/ticket", _signed_in(access, desk.ticket), methods=["POST"]),
        Route("/leave", _signed_in(access, desk.leave), methods=["POST"]),
        Route("/command", desk.command, methods=["POST"]),
        Route("/status", desk.status, methods=["GET"]),
    ]
    gate = Gate(
        Starlette(routes=routes), access, must_sign_in=access.must_sign_in, free=("/command",), urgent=("/command",)
    )
    return CORSMiddleware(
        gate,
        allow_origins=access.origins(),
        allow_credentials=True,
        allow_methods=["GET", "POST"],
        allow_headers=["Content-Type", "Authorization", TICKET_HEADER],
    )


class _Desk:
    """What is behind the routes."""

    def __init__(self, access: Access, helm: Helm) -> None:
        self._access, self._helm = access, helm

    async def ticket(self, _request: Request) -> Response:
        ticket = self._helm.operators.give_ticket()
        return JSONResponse({"ok": True, "ticket": ticket.id, "number": 0, "name": ticket.name})

    async def leave(self, request: Request) -> Response:
        """Hear that a page is closed; a browser says so in passing, and waits for no answer."""
        try:
            ticket = json.loads(await request.body())["ticket"]
        except (ValueError, RecursionError, KeyError, TypeError):
            return _said(400, "found no ticket, expected that of the page that is left")
        self._helm.operators.leave(str(ticket))
        return _said(200, "the page is left")

    async def status(self, request: Request) -> Response:
        asking = request.headers.get(TICKET_HEADER) or request.query_params.get("ticket")
        told = self._helm.status(asking)
        may = {"signed_in": self._access.is_signed_in(request), "may_stop": self._access.may_stop(request)}
        answer = JSONResponse(told | may)
        self._access.keep_session(answer, request)
        return answer

    async def command(self, request: Request) -> Response:
        told: object = None
        if self._access.may_stop(request):
            with suppress(ValueError, RecursionError):
                told = json.loads(await request.body())
            if isinstance(told, dict) and told.get("command") == "emergency":
                # Whoever is signed in or sits here may stop the bench, however old the page: twice harms nobody.
                outcome = await asyncio.shield(self._helm.emergency())
                return _said(200 if outcome.is_safe else 409, outcome.sentence, took_ms=1e3 * outcome.took)
        if not self._access.is_signed_in(request):
            return _nobody()
        if not isinstance(told, dict):
            return _said(400, "found no JSON object, expected a command")
        try:
            command = SteeringCommand.model_validate(told)
            ticket = self._helm.operators.admit(command.ticket, command.number)
            return _said(200, await self._carry_out(command, ticket))
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            where = ".".join(map(str, first["loc"])) or "the command"
            return _said(422, f"{where}: {first['msg']}")
        except RefusedError as refusal:
            return _said(refusal.status, str(refusal), **refusal.more)

    async def _carry_out(self, command: SteeringCommand, ticket: Ticket) -> str:
        operators = self._helm.operators
        if command.command == "take":
            return operators.take(ticket)
        if command.command == "give":
            return operators.give(ticket)
        operators.require_operator(ticket)
        if command.command == "continue":
            if command.name is None:
                raise RefusedError(422, "found no name; expected that of the run to go on with")
            return await asyncio.to_thread(self._helm.go_on, command.name)
        if command.command in ("rename", "bin", "restore", "note"):
            return await asyncio.to_thread(self._helm.keep, command)
        if command.command in ("shelve", "unshelve"):
            text = command.text if command.command == "shelve" else None
            if command.shelf is None or command.name is None or (text is None) != (command.command == "unshelve"):
                raise RefusedError(422, "found no shelf, name or text; expected what to keep, and where")
            return await asyncio.to_thread(self._helm.shelve, command.shelf, command.name, text, command.replace)
        if command.command != "start":
            return await asyncio.to_thread(self._helm.tell, command.command)
        if command.plan is None or command.rig is None or command.name is None:
            raise RefusedError(422, "found a start without plan, rig or name; expected all three")
        return await asyncio.to_thread(self._helm.start, command.name, command.plan, command.rig)


def _signed_in(access: Access, answer: Callable[[Request], Awaitable[Response]]) -> Callable[..., Awaitable[Response]]:
    """Return an endpoint that only those get to who are signed in, also where looking takes no token."""

    async def endpoint(request: Request) -> Response:
        if not access.is_signed_in(request):
            return _nobody()
        return await answer(request)

    return endpoint


def _nobody() -> Response:
    return _said(401, "nobody is signed in; sign in with the token that `sinew serve` printed")


def _said(status: int, sentence: str, **more: object) -> Response:
    return JSONResponse({"ok": status < 400, "sentence": sentence, **more}, status)


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

    runs: folder of the runs. bench: emulator, port or None. port: of the bench, where it is a port. rig: that is
    offered first, and that the emulator plays until a run asks for another. The last four are the seams: how a run or
    an emulator is begun, the page server, how a run is asked, how a bench is brought to rest.
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
        self._keeping = threading.Lock()

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

    def await_bench(self, over: threading.Event) -> None:
        """Wait until an emulated bench is there, unless that is over before. Raises FileError where it never is."""
        if self._emulator is not None:
            self._emulator.await_ready(over)

    @property
    def page_state(self) -> str:
        """Whether the page server is up, starting or down."""
        return self._page.state

    @property
    def port(self) -> str | None:
        """The port of the bench, or None where there is none."""
        return self._emulator.port if self._emulator is not None else self.settings.port

    @property
    def _bench_spec(self) -> RigSpec:
        """The rig of the run under way or the last one, else the one that is emulated or served."""
        played = self._emulator.spec if self._emulator is not None else None
        return self._desk.spec or played or self._spec

    def status(self, asking: str | None) -> dict[str, Any]:
        """Return what is going on, as seen by the ticket `asking`."""
        self.operators.see(asking)
        last = self._emergency.last
        if last is not None and last.at < self._desk.newest_s:
            last = None  # a run has begun since, so it is over, whatever became of that run
        is_there = self._emulator is None or self._emulator.is_there
        return {
            "time_s": time.time(),
            "bench": {"kind": self.settings.bench, "port": self.port, "rig": self.settings.rig, "is_there": is_there},
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
        return self._desk.start(name, plan, rig, self._free_bench)

    def go_on(self, name: str) -> str:
        """Go on with a run that ended early, and return a sentence. Raises RefusedError."""
        return self._desk.go_on(name, self._free_bench)

    def keep(self, command: SteeringCommand) -> str:
        """Note a run, or rename, put away or take back one that has ended; return a sentence. Raises RefusedError."""
        with self._keeping:
            return self._kept(command)

    def _kept(self, command: SteeringCommand) -> str:
        """Return what `keep` does, one command at a time: a note goes into the bin with its run, and not beside it."""
        name, to = command.name or "", command.to or "" if command.command == "rename" else None
        if command.command == "note":
            return note_run(self._runs, name, command.notes or "", command.tags or [])
        with self._desk.apart(name, *([] if to is None else [to])):
            if command.command == "restore":
                return restore_run(self._runs, name)
            said = bin_run(self._runs, name) if to is None else rename_run(self._runs, name, to)
            self._desk.forget(name, to)
        return said

    def shelve(self, shelf: str, name: str, text: str | None, replace: bool) -> str:
        """Put a rig or plan on the lab's shelf, or take it off where there is no text. Raises RefusedError."""
        if text is None:
            return take_off_shelf(self._runs, shelf, name)
        return put_on_shelf(self._runs, shelf, name, text, replace=replace)

    def _free_bench(self, specs: Specs) -> Way:
        """Return the way to the bench, where a run can begin on it. Raises RefusedError.

        An emulated one is begun anew where it has ended, where it plays another rig than the run's, or the run needs a
        head that bends, or no longer does; the run waits for it.
        """
        if self.port is None:
            raise RefusedError(409, "no bench is connected; serve with --port-bench PORT or --emulate")
        if self._emergency.is_under_way:
            raise RefusedError(409, "the bench is being brought to rest; wait until it is")
        emulator = self._emulator
        if emulator is None:
            return Way(self.port)
        if emulator.is_there and emulator.plays(specs.rig, in_space=specs.sways):
            return Way(self.port, 0.0 if emulator.is_ready else _ANEW_S)
        if specs.sways and specs.rig.space is None:
            raise RefusedError(
                409,
                f"the rig {specs.rig.name} has no [space], so its emulated head cannot bend; choose one that has the "
                "masses of head and lever",
            )
        try:
            emulator.change(specs.rig, self.settings.seed, in_space=specs.sways)
        except OSError as trouble:
            raise RefusedError(409, f"the emulator cannot be begun anew: {trouble.strerror or trouble}") from trouble
        return Way(self.port, _ANEW_S)

    def tell(self, command: str) -> str:
        """Tell the run under way something, or bring a bench without one to rest; return a sentence.

        Raises RefusedError.
        """
        if command not in ("hold", "release", "stop") or not self._desk.is_idle or self.port is None:
            return self._desk.tell(command)
        state = None if command == "stop" else command
        outcome = self._emergency.order(None, self.port, self._bench_spec, state, is_emergency=False).end.result()
        if not outcome.is_safe:
            raise RefusedError(409, outcome.sentence)
        return outcome.sentence

    def order_emergency(self) -> Order:
        """Bring the bench to rest at once, from any thread, and return what will tell how that goes."""
        run = self._desk.alarm()
        # Of an emulated bench that is being begun anew no motor moves, and there is none to be told anything.
        is_there = self._emulator is None or self._emulator.is_ready or not self._emulator.is_there
        return self._emergency.order(run, self.port if is_there else None, self._bench_spec)

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
