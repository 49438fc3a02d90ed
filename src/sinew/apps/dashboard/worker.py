"""Workers of a page server: for what takes long, or needs JAX, processes of their own.

Each pool is one process with less right to a core than a control loop. `quick` needs no JAX: library, lists, what a run
under way has found. `sliders` has compiled what those need. `preview` is for what a start and a save wait for, `heavy`
for predictions of whole plans, `results` for runs that are opened. So none of them waits behind what takes longer. A
process begins with its first call, ends where nobody asks any more, and with the process that made it.
"""

import asyncio
import importlib
import os
import resource
import sys
import threading
import traceback
from collections.abc import Awaitable, Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import get_context, parent_process
from typing import Any, NamedTuple

from sinew.measure.errors import SinewError

_NICE = 10
_MOST_DATA = 4 << 30  # bytes that a process may take, and for each core
_DATA_OF_A_CORE = 64 << 20  # the stacks of JAX's threads
_SHORT_S, _LONG_S = 60.0, 900.0


class WorkerError(SinewError):
    """What was asked could not be computed: it took too long, or its process ended."""


class TooSlowError(WorkerError):
    """What was asked took too long: the computer is busy, or it was much at once."""


class Pool(NamedTuple):
    """What a process is for. idle_s: after so long without a call it is ended [s]. is_cut: whether it is ended when
    nobody waits for its call any more; else it finishes, for what it knows is needed."""

    idle_s: float = 45.0
    is_cut: bool = False


POOLS = {
    "quick": Pool(),
    "sliders": Pool(600.0),
    "preview": Pool(is_cut=True),
    "heavy": Pool(is_cut=True),
    "results": Pool(is_cut=True),
}
"""The pools by name. Who thinks for a minute about a slider finds it warm; to become so again takes 5 s of a core."""


class Call(NamedTuple):
    """A function that can be called. most_s: longest time that it may take, after which its process is ended."""

    module: str
    pool: str
    most_s: float


def _calls(module: str, pool: str, most_s: float, *names: str) -> dict[str, Call]:
    return dict.fromkeys(names, Call(f"sinew.apps.dashboard.work.{module}", pool, most_s))


CALLS = {
    **_calls("runs", "quick", _SHORT_S, "library", "read_library", "look_at_runs", "read_run", "run_trends"),
    **_calls("runs", "quick", _SHORT_S, "run_differences"),
    **_calls("results", "quick", _SHORT_S, "measured_so_far"),
    **_calls("samples", "quick", _SHORT_S, "samples_about", "samples_piece", "samples_spectrum"),
    **_calls("design", "quick", _SHORT_S, "plan_outline"),
    **_calls("design", "preview", 2 * _SHORT_S, "preview_document", "rig_text"),
    **_calls("design", "sliders", 2 * _SHORT_S, "design_curves"),
    **_calls("design", "heavy", _LONG_S, "prediction_for_plan"),
    **_calls("results", "results", _LONG_S, "run_results", "prediction_of_run", "download"),
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


class _Process:
    """The process of a pool. turn: who has it calls. newest: of the requests that replace each other, by their key."""

    def __init__(self, pool: Pool) -> None:
        self._pool = pool
        self._executor: ProcessPoolExecutor | None = None
        self._idle: asyncio.TimerHandle | None = None
        self.turn = asyncio.Lock()
        self.newest: dict[str, object] = {}

    async def run(self, name: str, arguments: tuple[Any, ...]) -> Any:
        """Return what a function says, in a process that is begun where there is none."""
        self._forget_idle()
        call = CALLS[name]
        try:
            for _ in range(2):
                if self._executor is None:
                    self._executor = ProcessPoolExecutor(1, get_context("spawn"), initializer=_begin)
                with suppress(BrokenProcessPool):
                    pending = self._executor.submit(_run, call.module, name, arguments)
                    return await asyncio.wait_for(asyncio.wrap_future(pending), call.most_s)
                self.end()
            raise WorkerError("the process that computes this ended twice, perhaps for want of memory")
        except TimeoutError:
            self.end()
            raise TooSlowError(
                f"this took more than {call.most_s:g} s and was ended; the computer may be too busy"
            ) from None
        except asyncio.CancelledError:
            if self._pool.is_cut:
                self.end()
            raise
        finally:
            if self._executor is not None:
                self._idle = asyncio.get_running_loop().call_later(self._pool.idle_s, self.end)

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

    def _forget_idle(self) -> None:
        if self._idle is not None:
            self._idle.cancel()
            self._idle = None


class Worker:
    """Runs the functions of `CALLS` in other processes; for one event loop."""

    def __init__(self) -> None:
        self._processes = {name: _Process(pool) for name, pool in POOLS.items()}

    async def call(self, name: str, *arguments: Any, key: str | None = None) -> Any:
        """Return what a function of `sinew.apps.dashboard.work` returns for these arguments, plain data all.

        key: of requests that replace each other, as those of a slider. Of those that wait only the newest is run, the
        older ones return None.
        Raises SinewError: what the function raises; WorkerError where it took too long or its process ended twice.
        """
        process, request = self._processes[CALLS[name].pool], object()
        if key is not None:
            process.newest[key] = request
        try:
            async with process.turn:
                if key is not None and process.newest.get(key) is not request:
                    return None
                return await process.run(name, arguments)
        finally:
            if key is not None and process.newest.get(key) is request:
                del process.newest[key]

    def close(self) -> None:
        """End all processes at once."""
        for process in self._processes.values():
            process.end()


async def unless_left(pending: Awaitable[Any], left: Awaitable[Any]) -> Any:
    """Return what is asked for a page, unless that is left before: it is cancelled then.

    left: ends when the page is left. Raises CancelledError where it was.
    """
    call, leaving = asyncio.ensure_future(pending), asyncio.ensure_future(left)
    try:
        await asyncio.wait((call, leaving), return_when=asyncio.FIRST_COMPLETED)
    finally:
        leaving.cancel()
        call.cancel()  # nothing happens to what is done
    return await call
