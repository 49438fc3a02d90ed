"""Workers of a page server: for what takes long, or needs JAX, processes of their own.

Five of them, each with one call at a time, all with less right to a core than a control loop: `light` needs no JAX,
`sliders` sketches, `curves` refines and previews, `bands` predicts plans, `long` opens past runs and makes files. Each
begins with its first call, so that a bench that keeps time beside them is not held up by what nobody has asked for.
They end with the process that made them.
"""

import asyncio
import importlib
import os
import resource
import sys
import threading
import traceback
from collections.abc import Awaitable, Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing import get_context, parent_process
from typing import Any, NamedTuple, Protocol

from sinew.measure.errors import SinewError

_WORK = "sinew.apps.dashboard.work"
_NICE = 10
_MOST_DATA = 4 << 30  # bytes that a process may take, and for each core
_DATA_OF_A_CORE = 64 << 20  # the stacks of JAX's threads
_SHORT_S, _LONG_S, _WARM_UP_S = 60.0, 900.0, 600.0


class WorkerError(SinewError):
    """What was asked could not be computed: it took too long, or its process ended."""


class Call(NamedTuple):
    """A function that can be called.

    module: of the package `work`. lane: light, sliders, curves, bands or long. most_s: longest time that it may take,
    after which its process is ended.
    """

    module: str
    lane: str
    most_s: float


CALLS = {
    "shelf": Call(f"{_WORK}.runs", "light", _SHORT_S),
    "read_shelf": Call(f"{_WORK}.runs", "light", _SHORT_S),
    "list_runs": Call(f"{_WORK}.runs", "light", _SHORT_S),
    "measured_so_far": Call(f"{_WORK}.results", "light", _SHORT_S),
    "samples_about": Call(f"{_WORK}.samples", "light", _SHORT_S),
    "samples_piece": Call(f"{_WORK}.samples", "light", _SHORT_S),
    "samples_spectrum": Call(f"{_WORK}.samples", "light", _SHORT_S),
    "preview_document": Call(f"{_WORK}.design", "curves", 2 * _SHORT_S),
    "design_curves": Call(f"{_WORK}.design", "curves", 2 * _SHORT_S),
    "sketch_curves": Call(f"{_WORK}.design", "sliders", _SHORT_S),
    "warm_up": Call(f"{_WORK}.design", "sliders", _WARM_UP_S),
    "suggest_pretension": Call(f"{_WORK}.design", "long", _LONG_S),
    "prediction_for_plan": Call(f"{_WORK}.design", "bands", _LONG_S),
    "run_results": Call(f"{_WORK}.results", "long", _LONG_S),
    "download": Call(f"{_WORK}.results", "long", _LONG_S),
}
"""What can be called, by name."""


def _begin(lane: str) -> None:
    """Prepare a process: low priority, so much memory, JAX as everywhere, an end with whoever made it."""
    os.nice(_NICE)
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    most = _MOST_DATA + _DATA_OF_A_CORE * (os.cpu_count() or 1)
    resource.setrlimit(resource.RLIMIT_DATA, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))
    threading.Thread(target=_end_with_the_maker, daemon=True).start()
    if lane != "light":
        from sinew.twin.cache import configure

        configure()


def _end_with_the_maker() -> None:
    above = parent_process()
    if above is not None:
        above.join()
        os._exit(0)


def _run(module: str, name: str, arguments: tuple[Any, ...]) -> Any:
    """Return what a function says; whatever goes wrong in it comes back as a SinewError."""
    try:
        function: Callable[..., Any] = getattr(importlib.import_module(module), name)
        return function(*arguments)
    except SinewError:
        raise
    except MemoryError:
        raise WorkerError(f"{name} takes more memory than a page may have; use the command line for it") from None
    except Exception as error:  # a page shows a sentence, the log the rest
        traceback.print_exc(file=sys.stderr)
        raise WorkerError(
            f"{name} failed ({type(error).__name__}: {error}); this is a fault of Sinew, see the log"
        ) from None


@dataclass(eq=False)
class _Request:
    name: str
    arguments: tuple[Any, ...]
    is_wanted: bool = True


@dataclass
class _Lane:
    """A process, and whose turn it is."""

    name: str
    newest: dict[str, _Request] = field(default_factory=dict)
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)
    pool: ProcessPoolExecutor | None = None

    def submit(self, name: str, arguments: tuple[Any, ...]) -> "Future[Any]":
        """Have the process begin, starting it where there is none."""
        if self.pool is None:
            context = get_context("spawn")
            self.pool = ProcessPoolExecutor(1, context, initializer=_begin, initargs=(self.name,))
        return self.pool.submit(_run, CALLS[name].module, name, arguments)

    def end(self) -> None:
        """End the process at once, whatever it does."""
        pool, self.pool = self.pool, None
        if pool is None:
            return
        # The executor knows no way to end a call that is under way.
        for process in list((getattr(pool, "_processes", None) or {}).values()):
            process.kill()
        pool.shutdown(wait=False, cancel_futures=True)

    async def serve(self, request: _Request, key: str | None) -> Any:
        """Return what a request's function says, when it is its turn; None where nobody wants it by then."""
        async with self.turn:
            if not request.is_wanted or (key is not None and self.newest.get(key) is not request):
                return None
            try:
                return await self._tried(request, again=True)
            finally:
                if key is not None and self.newest.get(key) is request:
                    del self.newest[key]

    async def _tried(self, request: _Request, *, again: bool) -> Any:
        most_s = CALLS[request.name].most_s
        try:
            return await asyncio.wait_for(asyncio.wrap_future(self.submit(request.name, request.arguments)), most_s)
        except TimeoutError:
            self.end()
            raise WorkerError(
                f"{request.name} took more than {most_s:g} s and was ended; ask for less at once"
            ) from None
        except BrokenProcessPool:
            self.end()
            if again:
                return await self._tried(request, again=False)
            raise WorkerError(f"the process of {request.name} ended twice, perhaps for want of memory") from None


class Worker:
    """Runs the functions of `CALLS` in other processes; for one event loop."""

    def __init__(self) -> None:
        self._is_warming = False
        self._lanes = {name: _Lane(name) for name in ("light", "sliders", "curves", "bands", "long")}
        self._tasks: set[asyncio.Task[Any]] = set()

    def warm_up(self) -> None:
        """Begin to compile what sliders need, the first time; returns at once."""
        if not self._is_warming:
            self._is_warming = True
            self._begin(self._lanes["sliders"], _Request("warm_up", ()), None)

    async def call(self, name: str, *arguments: Any, key: str | None = None) -> Any:
        """Return what a function of `sinew.apps.dashboard.work` returns for these arguments, plain data all.

        key: of requests that replace each other, as those of a slider. Of those that wait only the newest is run, the
        older ones return None.
        Raises SinewError: what the function raises; WorkerError where it took too long or its process ended twice.
        """
        lane = self._lanes[CALLS[name].lane]
        request = _Request(name, arguments)
        if key is not None:
            lane.newest[key] = request
        task = self._begin(lane, request, key)
        try:
            return await asyncio.shield(task)
        finally:
            request.is_wanted = False

    def _begin(self, lane: _Lane, request: _Request, key: str | None) -> "asyncio.Task[Any]":
        task = asyncio.create_task(lane.serve(request, key))
        self._tasks.add(task)
        task.add_done_callback(self._heard)
        return task

    def _heard(self, task: "asyncio.Task[Any]") -> None:
        self._tasks.discard(task)
        with suppress(asyncio.CancelledError):
            task.exception()

    def close(self) -> None:
        """End all processes at once."""
        for lane in self._lanes.values():
            lane.end()


# It is said what the pages ask of whoever computes for them.


class Work(Protocol):
    """Runs what takes long, or needs JAX, in another process."""

    def warm_up(self) -> None:
        """Begin to compile what sliders need; returns at once."""
        ...

    def call(self, name: str, *arguments: Any, key: str | None = None) -> Awaitable[Any]:
        """Return what a function of `sinew.apps.dashboard.work` returns; with a key only the latest request runs."""
        ...
