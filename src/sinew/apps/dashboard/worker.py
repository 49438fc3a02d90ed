"""Workers of a page server: for what takes long, or needs JAX, processes of their own.

Five pools, all with less right to a core than a control loop. `quick` is one process that needs no JAX: shelf, lists,
what a run under way has found. `sketch` is one that has compiled what sliders need. `heavy` is one for all the rest,
and a second while the first is busy. `preview` is one for what a start waits for, `save` one for the text of a rig
that is saved. So neither a list nor a slider nor a start nor a save waits behind what takes long. A process begins with
its first call, so that a bench that keeps time beside it is not held up by what nobody has asked for; it ends where
nobody asks any more, and its memory goes back; and it ends with the process that made it.
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
from contextlib import nullcontext, suppress
from dataclasses import dataclass
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


class TooSlowError(WorkerError):
    """What was asked took too long: the computer is busy, or it was much at once."""


class Call(NamedTuple):
    """A function that can be called.

    module: of the package `work`. pool: one of `POOLS`. most_s: longest time that it may take, after which its process
    is ended.
    """

    module: str
    pool: str
    most_s: float


class Size(NamedTuple):
    """What a pool is made for. processes: so many at most. idle_s: after so long without a call one is ended [s].
    is_cut: whether a process is ended that works for nobody any more; else it finishes, for what it knows is needed."""

    processes: int
    idle_s: float
    is_cut: bool = False


POOLS = {
    "quick": Size(1, 45.0),
    "sketch": Size(1, 600.0),
    "heavy": Size(2, 45.0, is_cut=True),
    "preview": Size(1, 45.0, is_cut=True),
    "save": Size(1, 45.0),
}
"""The pools by name. Who thinks for a minute about a slider finds it warm; to become so again takes 5 s of a core."""

CALLS = {
    "shelf": Call(f"{_WORK}.runs", "quick", _SHORT_S),
    "read_shelf": Call(f"{_WORK}.runs", "quick", _SHORT_S),
    "look_at_runs": Call(f"{_WORK}.runs", "quick", _SHORT_S),
    "run_summary": Call(f"{_WORK}.runs", "quick", _SHORT_S),
    "kept_results": Call(f"{_WORK}.results", "quick", _SHORT_S),
    "list_bin": Call(f"{_WORK}.runs", "quick", _SHORT_S),
    "run_trends": Call(f"{_WORK}.runs", "quick", _SHORT_S),
    "run_differences": Call(f"{_WORK}.runs", "quick", _SHORT_S),
    "measured_so_far": Call(f"{_WORK}.results", "quick", _SHORT_S),
    "samples_about": Call(f"{_WORK}.samples", "quick", _SHORT_S),
    "samples_piece": Call(f"{_WORK}.samples", "quick", _SHORT_S),
    "samples_spectrum": Call(f"{_WORK}.samples", "quick", _SHORT_S),
    "plan_outline": Call(f"{_WORK}.design", "quick", _SHORT_S),
    "rig_text": Call(f"{_WORK}.design", "save", _SHORT_S),
    "preview_document": Call(f"{_WORK}.design", "preview", 2 * _SHORT_S),
    "design_curves": Call(f"{_WORK}.design", "heavy", 2 * _SHORT_S),
    "sketch_curves": Call(f"{_WORK}.design", "sketch", _SHORT_S),
    "warm_up": Call(f"{_WORK}.design", "sketch", _WARM_UP_S),
    "suggest_pretension": Call(f"{_WORK}.design", "sketch", 2 * _SHORT_S),
    "prediction_for_plan": Call(f"{_WORK}.design", "heavy", _LONG_S),
    "run_results": Call(f"{_WORK}.results", "heavy", _LONG_S),
    "prediction_of_run": Call(f"{_WORK}.results", "heavy", _LONG_S),
    "download": Call(f"{_WORK}.results", "heavy", _LONG_S),
}
"""What can be called, by name."""


def _begin() -> None:
    """Prepare a process: low priority, so much memory, an end with whoever made it."""
    os.nice(_NICE)
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    most = _MOST_DATA + _DATA_OF_A_CORE * (os.cpu_count() or 1)
    resource.setrlimit(resource.RLIMIT_DATA, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))
    threading.Thread(target=_end_with_the_maker, daemon=True).start()


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
        raise WorkerError("this takes more memory than a page may have; use the command line for it") from None
    except Exception as error:  # a page shows a sentence, the log the rest
        traceback.print_exc(file=sys.stderr)
        raise WorkerError(f"this failed ({type(error).__name__}: {error}), a fault of Sinew; see the log") from None


@dataclass(eq=False)
class _Request:
    name: str
    arguments: tuple[Any, ...]
    is_wanted: bool = True


class _Place:
    """The place of one process in a pool, taken by one call at a time."""

    def __init__(self, idle_s: float) -> None:
        self._idle_s = idle_s
        self._executor: ProcessPoolExecutor | None = None
        self._idle: asyncio.TimerHandle | None = None

    @property
    def is_taken(self) -> bool:
        """Whether there is a process."""
        return self._executor is not None

    async def run(self, request: _Request) -> Any:
        """Return what a request's function says, in a process that is begun where there is none."""
        self._forget_idle()
        most_s = CALLS[request.name].most_s
        try:
            for _ in range(2):
                with suppress(BrokenProcessPool):
                    return await asyncio.wait_for(asyncio.wrap_future(self._submit(request)), most_s)
                self.end()
            raise WorkerError("the process that computes this ended twice, perhaps for want of memory")
        except TimeoutError:
            self.end()
            raise TooSlowError(
                f"this took more than {most_s:g} s and was ended; the computer may be too busy"
            ) from None
        except asyncio.CancelledError:
            self.end()
            raise
        finally:
            if self.is_taken:
                self._idle = asyncio.get_running_loop().call_later(self._idle_s, self.end)

    def end(self) -> None:
        """End the process at once, whatever it does."""
        self._forget_idle()
        executor, self._executor = self._executor, None
        if executor is None:
            return
        # The executor knows no way to end a call that is under way.
        for process in list((getattr(executor, "_processes", None) or {}).values()):
            process.kill()
        executor.shutdown(wait=False, cancel_futures=True)

    def _submit(self, request: _Request) -> "Future[Any]":
        if self._executor is None:
            self._executor = ProcessPoolExecutor(1, get_context("spawn"), initializer=_begin)
        return self._executor.submit(_run, CALLS[request.name].module, request.name, request.arguments)

    def _forget_idle(self) -> None:
        if self._idle is not None:
            self._idle.cancel()
            self._idle = None


class _Pool:
    """A few places, and whose turn it is. The first that is free is taken: it is the warmest."""

    def __init__(self, size: Size) -> None:
        self.places = [_Place(size.idle_s) for _ in range(size.processes)]
        self.is_cut = size.is_cut
        self._free = asyncio.PriorityQueue[int]()
        for number in range(size.processes):
            self._free.put_nowait(number)
        self._keys: dict[str, tuple[asyncio.Lock, _Request]] = {}

    def put(self, request: _Request, key: str) -> asyncio.Lock:
        """Make a request the newest of its key, and return what lets one of them after the other run."""
        lock = self._keys[key][0] if key in self._keys else asyncio.Lock()
        self._keys[key] = lock, request
        return lock

    async def serve(self, request: _Request, key: str | None, lock: asyncio.Lock | None) -> Any:
        """Return what a request's function says, when it is its turn; None where nobody wants it by then."""
        try:
            async with lock or nullcontext():
                number = await self._free.get()
                try:
                    is_wanted = request.is_wanted and self._is_newest(request, key)
                    return await self.places[number].run(request) if is_wanted else None
                finally:
                    self._free.put_nowait(number)
        finally:
            if key is not None and self._is_newest(request, key):
                del self._keys[key]

    def _is_newest(self, request: _Request, key: str | None) -> bool:
        return key is None or (key in self._keys and self._keys[key][1] is request)


class Worker:
    """Runs the functions of `CALLS` in other processes; for one event loop."""

    def __init__(self) -> None:
        self._pools = {name: _Pool(size) for name, size in POOLS.items()}
        self._tasks: set[asyncio.Task[Any]] = set()

    def warm_up(self) -> None:
        """Begin to compile what sliders need, where no process has done so; returns at once."""
        pool = self._pools[CALLS["warm_up"].pool]
        if not any(place.is_taken for place in pool.places):
            self._begin(pool, _Request("warm_up", ()), None)

    async def call(self, name: str, *arguments: Any, key: str | None = None) -> Any:
        """Return what a function of `sinew.apps.dashboard.work` returns for these arguments, plain data all.

        key: of requests that replace each other, as those of a slider. Of those that wait only the newest is run, the
        older ones return None. Whoever waits no longer, and is cancelled, has it computed on only where that is short.
        Raises SinewError: what the function raises; WorkerError where it took too long or its process ended twice.
        """
        request = _Request(name, arguments)
        pool = self._pools[CALLS[name].pool]
        task = self._begin(pool, request, key)
        try:
            return await asyncio.shield(task)
        except asyncio.CancelledError:
            if pool.is_cut:
                task.cancel()
            raise
        finally:
            request.is_wanted = False

    def _begin(self, pool: _Pool, request: _Request, key: str | None) -> "asyncio.Task[Any]":
        lock = None if key is None else pool.put(request, key)
        task = asyncio.create_task(pool.serve(request, key, lock))
        self._tasks.add(task)
        task.add_done_callback(self._heard)
        return task

    def _heard(self, task: "asyncio.Task[Any]") -> None:
        self._tasks.discard(task)
        with suppress(asyncio.CancelledError):
            task.exception()

    def close(self) -> None:
        """End all processes at once."""
        for pool in self._pools.values():
            for place in pool.places:
                place.end()


# It is said what the pages ask of whoever computes for them.


class Work(Protocol):
    """Runs what takes long, or needs JAX, in another process."""

    def warm_up(self) -> None:
        """Begin to compile what sliders need; returns at once."""
        ...

    def call(self, name: str, *arguments: Any, key: str | None = None) -> Awaitable[Any]:
        """Return what a function of `sinew.apps.dashboard.work` returns; with a key only the latest request runs."""
        ...


async def unless_left(asked: Awaitable[Any], left: Awaitable[Any]) -> Any:
    """Return what is asked for a page, unless that is left before: it is cancelled then.

    left: ends when the page is left. Raises CancelledError where it was.
    """
    call, leaving = asyncio.ensure_future(asked), asyncio.ensure_future(left)
    try:
        await asyncio.wait((call, leaving), return_when=asyncio.FIRST_COMPLETED)
    finally:
        leaving.cancel()
        call.cancel()  # nothing happens to what is done
    return await call
