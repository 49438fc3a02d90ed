"""Tasks: a function of a module over many inputs, here, in processes or on a Dask cluster, kept as they come.

A task is a pure function of what it is given: it holds its own seed, and all that it puts into one batch. So its result
does not depend on who computes it, nor on how many do, and may be asked of another where a worker dies. A cluster costs
some milliseconds for each; tasks of seconds to minutes are what it is for.
"""

import asyncio
import hashlib
import io
import logging
import os
import pickle
import signal
import sqlite3
import time
import warnings
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, ProcessPoolExecutor, as_completed
from contextlib import closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import cache, partial, wraps
from importlib.metadata import PackageNotFoundError, version
from inspect import getsourcefile
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

from sinew.measure.errors import FileError, SinewError, SpecError, how_to_install

if TYPE_CHECKING:
    from distributed import Client

P = ParamSpec("P")
T = TypeVar("T")
R = TypeVar("R")
Progress = Callable[[float, float], None]

CORES = "SINEW_CORES"
"""Environment: how many threads of its own a process keeps busy; see `cores`."""

DEVICE = "SINEW_DEVICE"
"""Environment: what JAX computes on, `cpu` or `gpu`; see `sinew.solve.programs.configure`."""

DEVICES = ("cpu", "gpu")

_BLAS = "OPENBLAS_NUM_THREADS"

_TIMEOUT_S = 20.0
"""How long a scheduler is waited for."""

_PATIENCE_S = 60.0
"""The same where there was one before, and for its first worker."""

_CONNECT_S = 3.0

_TRIES = 3
"""How often processes may end, or Dask give a task up whose workers died, with no result in between, until the task is
taken for the cause."""


@dataclass(frozen=True)
class Spread:
    """Where tasks run, and where their results are kept.

    scheduler: address of a Dask scheduler, `tcp://host:8786`, whose workers do them. workers: processes of this
    computer that do them instead; 1 is this process alone. More need the usual `if __name__ == "__main__":` in a
    script. keep: a file that takes every result as it comes; what it holds already is not computed again. It is
    Python's pickles in SQLite, to be trusted as far as who wrote it. device: what JAX computes on, `cpu` or `gpu`.
    Raises SpecError where that cannot be.

    >>> import sinew as sn
    >>> sn.Spread(workers=4, keep="found.sqlite").workers
    4
    """

    scheduler: str | None = None
    workers: int = 1
    keep: Path | str | None = None
    device: str = "cpu"

    def __post_init__(self) -> None:
        if self.scheduler is not None and self.workers != 1:
            raise SpecError("found a scheduler and workers of this computer; a scheduler has its own, give one of both")
        if self.workers < 1:
            raise SpecError(f"found {self.workers} workers, expected 1 or more")
        if self.device not in DEVICES:
            raise SpecError(f"found the device {self.device!r}, expected one of {', '.join(DEVICES)}")


HERE: Spread = Spread()
"""In this process, one task after the other, nothing kept."""


def cores() -> int:
    """Return how many threads of its own this process may keep busy: $SINEW_CORES, else one for each processor.

    Processes that share a computer have their share of it, a worker of a cluster one, unless the environment says more.
    """
    return max(1, int(os.environ.get(CORES) or os.cpu_count() or 1))


def with_one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function that leaves BLAS one thread, for of small matrices two mostly wait for each other.

    A command has one by its environment; a notebook has one for each core, and an analysis there took three times as
    much of a processor. Calls of several threads that overlap may leave BLAS one thread for good.
    """

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        with threadpool_limits(1, "blas"):
            return function(*args, **kwargs)

    return limited


def run_tasks(
    function: Callable[[T], R], tasks: Sequence[T], spread: Spread = HERE, progress: Progress | None = None
) -> list[R]:
    """Return the result of every task, in their order; see `each_task`."""
    found = dict(each_task(function, tasks, spread, progress))
    return [found[index] for index in range(len(tasks))]


def each_task(
    function: Callable[[T], R], tasks: Sequence[T], spread: Spread = HERE, progress: Progress | None = None
) -> Iterator[tuple[int, R]]:
    """Yield (place, result) of every task as they come, those first that were kept.

    function: of a module, so that others find it. progress: called with (done, total). A result that is yielded is
    kept already: who is killed has lost what was being computed, and no more.
    Raises SpecError where the cluster cannot be used, FileError where nothing can be kept, and what a task raises.
    """
    source = None if spread.keep is None and spread.scheduler is None else source_of(function)
    with nullcontext() if spread.keep is None else _results_in(Path(spread.keep)) as store:
        keys = [] if store is None else [digest_of((source, spread.device, function, task)) for task in tasks]
        coming = _computed(function, dict(enumerate(tasks)), spread, source, keys, store)
        with closing(coming):
            for done, (index, result) in enumerate(coming, start=1):
                if progress is not None:
                    progress(done, len(tasks))
                yield index, result


def _computed(
    function: Callable[[T], R],
    waiting: dict[int, T],
    spread: Spread,
    source: str | None,
    keys: Sequence[str],
    store: sqlite3.Connection | None,
) -> Generator[tuple[int, R], None, None]:
    """Yield (place, result) of what is kept by some keys, then of what is not and is computed, and kept."""
    for index, key in enumerate(keys):
        assert store is not None
        if (row := store.execute("SELECT result FROM kept WHERE key = ?", (key,)).fetchone()) is not None:
            del waiting[index]
            yield index, pickle.loads(row[0])
    do = partial(_do, function, spread.device)
    come: Generator[tuple[int, R], None, None]
    if spread.scheduler is not None:
        come = _on_cluster(partial(_do_there, function, spread.device, source), waiting, spread.scheduler)
    elif spread.workers > 1 and len(waiting) > 1:
        come = _in_processes(do, waiting, min(spread.workers, len(waiting)))
    else:
        come = ((index, do(task)) for index, task in waiting.items())
    with closing(come):
        for index, result in come:
            if store is not None:
                with store:  # on the disk before it is handed out
                    store.execute("INSERT OR REPLACE INTO kept VALUES (?, ?)", (keys[index], pickle.dumps(result)))
            yield index, result


def _do(function: Callable[[T], R], device: str, task: T) -> R:
    """Return a task's result, computed in this process, which may not have begun on another device."""
    if device != "cpu" or DEVICE in os.environ:
        os.environ[DEVICE] = device
    return function(task)


def _do_there(function: Callable[[T], R], device: str, source: str | None, task: T) -> R:
    """Return a task's result, computed on a worker. Raises SpecError where it would be another program's."""
    os.environ.setdefault(CORES, "1")
    if source_of(function) != source:
        raise SpecError(
            "a worker of the cluster has another Sinew, or another JAX, NumPy or SciPy, than this computer, and would "
            "give other numbers; install the same there, and start the worker anew"
        )
    return _do(function, device, task)


# ---- processes of this computer


def _in_processes(
    function: Callable[[T], R], waiting: dict[int, T], workers: int
) -> Generator[tuple[int, R], None, None]:
    """Yield (place, result) as they come; new processes compute what was lost with one that ended."""
    tries = 0
    while waiting:
        broken: BrokenExecutor | None = None
        with process_pool(workers, cores() // workers) as pool:
            futures = {pool.submit(function, task): index for index, task in waiting.items()}
            for future in as_completed(futures):
                try:
                    result = future.result()
                except BrokenExecutor as error:  # every call that was not done fails with it
                    broken = error
                    continue
                del waiting[futures[future]]
                tries = 0
                yield futures[future], result
        tries += broken is not None
        if tries == _TRIES:
            raise SinewError(
                f"processes that compute ended {_TRIES} times before any of {len(waiting)} tasks was done, perhaps for "
                'want of memory; take fewer workers, and in a script begin under `if __name__ == "__main__":`'
            ) from broken


@contextmanager
def process_pool(processes: int, share: int) -> Iterator[ProcessPoolExecutor]:
    """Give a pool of spawned processes; an error or an interrupt in this process ends them at once.

    share: threads that each of them may keep busy. A script needs the usual `if __name__ == "__main__":`.
    Raises SinewError where a process was lost whose result is asked for.
    """
    pool = ProcessPoolExecutor(processes, get_context("spawn"), _begin_process, (max(1, share),))
    try:
        yield pool
    except BrokenExecutor as error:
        raise SinewError("a process that computes ended, perhaps for want of memory; run the command again") from error
    except BaseException:
        for process in list((pool._processes or {}).values()):
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _begin_process(share: int) -> None:
    """Set a process of a pool up: Ctrl-C ends it without a word, and it leaves the other cores to others."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    os.environ[CORES] = str(share)
    for library in (_BLAS, "OMP_NUM_THREADS"):
        os.environ.setdefault(library, str(share))


# ---- a cluster


class _LostError(Exception):
    """The scheduler went, and with it all that it knew."""


def _on_cluster(
    function: Callable[[T], R], waiting: dict[int, T], address: str
) -> Generator[tuple[int, R], None, None]:
    """Yield (place, result) as they come. Dask asks others for what a worker that died was at; where the scheduler
    dies, a new one at the same address is handed what is not here yet."""
    begun = False
    while waiting:
        with suppress(_LostError), _client(address, begun) as client:
            begun = True
            for index, result in _gathered(client, function, waiting):
                del waiting[index]
                yield index, result


@contextmanager
def _client(address: str, again: bool) -> "Iterator[Client]":
    try:
        import distributed
    except ImportError as error:
        raise SpecError(f"--scheduler needs dask.distributed; install it: {how_to_install('cluster')}") from error
    for name in ("distributed", "distributed.client"):  # what it says of a lost scheduler, we say
        logging.getLogger(name).setLevel(logging.CRITICAL)
    patience = _PATIENCE_S if again else _TIMEOUT_S
    advice = "; what was done before is in the file of --keep: the same command goes on from it" if again else ""
    until = time.monotonic() + patience
    client = None
    while client is None:
        try:  # in short tries, for between two of its own Dask waits ever longer
            client = distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:  # a timeout is an OSError
            if time.monotonic() > until or isinstance(error, ValueError):
                raise SpecError(
                    f"found no Dask scheduler at {address} within {patience:g} s; start one (dask scheduler) and give "
                    f"its address, as tcp://host:8786{advice}"
                ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_PATIENCE_S)
        except TimeoutError as error:
            raise SpecError(
                f"the scheduler at {address} has no workers; start some (dask worker {address} --nthreads 1){advice}"
            ) from error
        except OSError as error:
            raise _LostError from error
        yield client


def _gathered(client: "Client", function: Callable[[T], R], waiting: Mapping[int, T]) -> Iterator[tuple[int, R]]:
    """Yield (place, result) as they come. Raises _LostError where the scheduler is gone, and what a task raised."""
    from distributed import as_completed as completed

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Sending large graph")  # a recording is one
        futures = client.map(function, list(waiting.values()), pure=False)
    index_of = dict(zip((future.key for future in futures), tuple(waiting), strict=True))
    # Not `with_results`: a result that was being fetched when the scheduler went would be waited for for ever.
    for batch in completed(futures, loop=client.loop).batches():
        here = [future for future in batch if future.status == "finished"]
        lost = [future for future in batch if future.status != "finished" and future.key in index_of]
        try:
            results = client.gather(here)
        except (OSError, asyncio.CancelledError, CancelledError) as error:
            raise _LostError from error
        for future in here:  # before any is yielded, so that none is computed again; it is "cancelled" from here on
            future.release()
        for future, result in zip(here, results, strict=True):
            yield index_of[future.key], result
        for future in lost:
            raise (future.exception() if future.status == "error" else None) or _LostError


# ---- finished results that are kept, by the key of their task, in a file; each is there whole or not at all


@contextmanager
def _results_in(path: Path) -> Iterator[sqlite3.Connection]:
    """Give the file in which results are kept. Raises FileError where it is none, is damaged, or takes no more."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with closing(sqlite3.connect(path, timeout=30)) as file:
            file.execute("CREATE TABLE IF NOT EXISTS kept (key TEXT PRIMARY KEY, result BLOB NOT NULL)")
            yield file
    except sqlite3.Error as error:
        raise FileError(
            f"cannot keep results in {path} ({error}); check the free space, delete the file, or name a new one with "
            "--keep"
        ) from error


class _Plain(pickle.Pickler):
    """Pickles of equal tasks are equal: what is the same object twice is written twice, a set by its sorted words."""

    fast = True

    def persistent_id(self, obj: Any) -> Any:
        return sorted(map(repr, obj)) if isinstance(obj, (set, frozenset)) else None


def digest_of(value: object) -> str:
    """Return a hash of every bit of a value; equal values have one."""
    written = io.BytesIO()
    _Plain(written).dump(value)
    return hashlib.sha256(written.getvalue()).hexdigest()


def source_of(function: Callable[..., Any]) -> str:
    """Return a hash of what computes: all source of Sinew, the function's own, versions of what both stand on."""
    outside = {one for one in _functions(function) if not one.__module__.startswith("sinew.")}
    return _source(tuple(sorted(filter(None, map(getsourcefile, outside)))))


def _functions(function: Callable[..., Any]) -> Iterator[Callable[..., Any]]:
    if isinstance(function, partial):
        for one in (function.func, *filter(callable, function.args)):
            yield from _functions(one)
    else:
        yield function


@cache
def _source(others: tuple[str, ...]) -> str:
    taken = hashlib.sha256()
    for path in (*sorted(Path(__file__).parents[1].rglob("*.py")), *map(Path, others)):
        taken.update(path.read_bytes())
    for name in ("jax", "jaxlib", "numpy", "scipy"):
        try:
            taken.update(f"{name} {version(name)}\n".encode())
        except PackageNotFoundError:
            continue
    return taken.hexdigest()
