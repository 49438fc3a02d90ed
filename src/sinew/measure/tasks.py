"""Tasks: a function of a module over many inputs, here, in processes or on a Dask cluster, kept as they come.

A task is a pure function of what it is given: it holds its own seed, and all that it puts into one batch. So its result
does not depend on who computes it, nor on how many do, and may be asked of another where a worker dies. A cluster costs
some milliseconds for each; tasks of seconds to minutes are what it is for.
"""

import asyncio
import atexit
import gc
import hashlib
import io
import logging
import math
import os
import pickle
import signal
import sqlite3
import sys
import time
import warnings
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, as_completed
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, nullcontext, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache, partial, wraps
from importlib.metadata import PackageNotFoundError, version
from inspect import getsourcefile
from multiprocessing import current_process, get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Lock
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from sinew.measure.errors import FileError, SinewError, SpecError, how_to_install

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor

    from distributed import Client, Future

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
    much of a processor.
    """

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        if os.environ.get(_BLAS) == "1":
            return function(*args, **kwargs)
        with _one_blas_thread():
            return function(*args, **kwargs)

    return limited


_limiting = Lock()
_limits: list[Any] = []
"""Of BLAS, as long as calls that leave it one thread overlap: what the first of them found, once for each."""


@contextmanager
def _one_blas_thread() -> Iterator[None]:
    from threadpoolctl import threadpool_limits  # no command needs it

    with _limiting:
        _limits.append(_limits[0] if _limits else threadpool_limits(1, "blas"))
    try:
        yield
    finally:
        with _limiting:
            before = _limits.pop()
            if not _limits:
                before.restore_original_limits()


def run_tasks(
    function: Callable[[T], R], tasks: Sequence[T], spread: Spread = HERE, progress: Progress | None = None
) -> list[R]:
    """Return the result of every task, in their order; see `each_task`."""
    found = dict(each_task(function, tasks, spread, progress))
    return [found[place] for place in range(len(tasks))]


def each_task(
    function: Callable[[T], R], tasks: Sequence[T], spread: Spread = HERE, progress: Progress | None = None
) -> Iterator[tuple[int, R]]:
    """Yield (place, result) of every task as they come, those first that were kept.

    function: of a module, so that others find it. progress: called with (done, total). A result that is yielded is
    kept already: who is killed has lost what was being computed, and no more.
    Raises SpecError where the cluster cannot be used, FileError where nothing can be kept, and what a task raises.
    """
    source = None if spread.keep is None and spread.scheduler is None else source_of(function)
    done = 0

    def told() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, len(tasks))

    with _kept_in(spread.keep) as kept:
        keys = [] if kept is None else [digest_of((source, spread.device, function, task)) for task in tasks]
        waiting = dict(enumerate(tasks))
        if kept is not None:
            for place, key in enumerate(keys):
                if (blob := kept.get(key)) is not None:
                    del waiting[place]
                    told()
                    yield place, pickle.loads(blob)
        do = partial(_do, function, spread.device)
        come: Generator[tuple[int, R], None, None]
        if spread.scheduler is not None:
            come = _on_cluster(partial(_do_there, function, spread.device, source), waiting, spread.scheduler)
        elif spread.workers > 1 and len(waiting) > 1:
            come = _in_processes(do, waiting, min(spread.workers, len(waiting)))
        else:
            come = ((place, do(task)) for place, task in waiting.items())
        with closing(come):
            for place, result in come:
                if kept is not None:
                    kept.put(keys[place], pickle.dumps(result))
                told()
                yield place, result


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
    """Yield (place, result) as they come; what a process that ended took with it is asked of new ones."""
    tries = 0
    while waiting:
        broken: BrokenExecutor | None = None
        pool = _pool_of(workers)
        try:
            with _share_of(workers):
                futures = {pool.submit(_interruptible, function, task): place for place, task in waiting.items()}
            for future in as_completed(futures):
                try:
                    result = future.result()
                except BrokenExecutor as error:  # of all that were not done; what was comes beside them
                    broken = error
                    continue
                del waiting[futures[future]]
                tries = 0
                yield futures[future], result
        finally:
            pool.shutdown(wait=not waiting, cancel_futures=True)
        tries += broken is not None
        if tries == _TRIES:
            raise SinewError(
                f"processes that compute ended {_TRIES} times before any of {len(waiting)} tasks was done, perhaps for "
                'want of memory; take fewer workers, and in a script begin under `if __name__ == "__main__":`'
            ) from broken


Hand = Callable[..., Callable[[], Any]]
"""What hands a call over, `hand(function, *arguments)`, and returns what fetches its result; see `beside`."""

_hand: ContextVar[Hand | None] = ContextVar("hand", default=None)
"""What hands calls to the processes that this one has beside it."""


@contextmanager
def beside(processes: int) -> Iterator[Hand]:
    """Give what hands calls to further processes while this one goes on.

    processes: 0 leaves all to this one. `hand(function, *arguments)` returns what fetches the result, for one time. A
    call that no process has begun by then, or that one took with it when it ended, is made here. The processes are
    spawned: a script needs the usual `if __name__ == "__main__":`. Calls that nobody fetched before an error are not
    begun.

    >>> with beside(0) as hand:
    ...     later = hand(divmod, 7, 2)
    ...     later()
    (3, 1)
    """
    if processes < 1:
        with _handing(None):
            yield partial
        return
    pool = _pool_of(processes)
    claims: list[Path] = []
    with TemporaryDirectory(prefix="sinew-") as folder:

        def hand(function: Callable[..., Any], *arguments: Any) -> Callable[[], Any]:
            claims.append(claim := Path(folder, str(len(claims))))
            try:
                with _share_of(processes + 1):
                    future = pool.submit(_unless_claimed, claim, function, *arguments)
            except RuntimeError:  # a process has ended, perhaps for want of memory, or all are over: this one goes on
                return partial(function, *arguments)

            def fetched() -> Any:
                if not _claimed_here(claim):
                    with suppress(BrokenExecutor):
                        return future.result()
                return function(*arguments)

            return fetched

        try:
            with _handing(hand):
                yield hand
        finally:
            for claim in claims:
                _claimed_here(claim)
            pool.shutdown(cancel_futures=True)


def fetch_all(later: Sequence[Callable[[], R]]) -> list[R]:
    """Return the results of calls that were handed over, in their order; those that no process has begun are made here.

    The last is fetched first: the processes begin with the first, so they meet.
    """
    return [fetched() for fetched in reversed(later)][::-1]


@contextmanager
def _handing(hand: Hand | None) -> Iterator[None]:
    token = _hand.set(hand)
    try:
        yield
    finally:
        _hand.reset(token)


def _claimed_here(claim: Path) -> bool:
    """Return whether a call is this process's to make: of all that ask, the first."""
    try:
        claim.touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def _unless_claimed(claim: Path, function: Callable[..., R], *arguments: Any) -> R | None:
    """Make a call in a process of a pool, unless who handed it over makes it."""
    if _interrupted.is_set() or not _claimed_here(claim):
        return None
    return _interruptible(function, *arguments)


def _pool_of(processes: int) -> "ProcessPoolExecutor":
    from concurrent.futures import ProcessPoolExecutor  # a table needs none

    as_here = (gc.get_threshold(), sys.modules.get("dask", sys) is None)
    return ProcessPoolExecutor(processes, get_context("spawn"), _begin_process, as_here)


_interrupted, _at_work = Event(), Event()
"""Of a process of a pool: whether an interrupt reached it, and whether it makes a call."""


def _begin_process(collected: tuple[int, int, int], without_dask: bool) -> None:
    """Set up a process of a pool, which leaves the word on an interrupt to whoever asked for it.

    collected: when it looks for what to collect, see `gc.set_threshold`. without_dask: an import of
    Dask is to find nothing, as a command keeps it out that needs none; xarray imports all of it to look at an array.
    """
    gc.set_threshold(*collected)
    if without_dask:
        sys.modules.setdefault("dask", None)  # type: ignore[arg-type]

    def interrupt(*_: object) -> None:
        _interrupted.set()
        if _at_work.is_set():
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, interrupt)
    atexit.register(os._exit, 0)  # the last that is called: to take all modules apart takes up to half a second


def _interruptible(function: Callable[..., R], *arguments: Any) -> R:
    """Make a call in a process of a pool. An interrupt breaks it off, and after one no call is begun."""
    if _interrupted.is_set():
        raise KeyboardInterrupt
    _at_work.set()
    try:
        return function(*arguments)
    finally:
        _at_work.clear()


def _share_of(workers: int) -> AbstractContextManager[None]:
    """Set what processes that are begun now are to know of their share of the computer.

    A process is begun when a task is handed in, and has the environment of that moment. NPROC stays
    `sinew.solve.programs`'s to say; BLAS has the threads of the share.
    """
    share = str(max(1, cores() // workers))
    return _environment({CORES: share, _BLAS: share, "OMP_NUM_THREADS": share})


@contextmanager
def _environment(settings: Mapping[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in settings}
    for name, value in settings.items():
        os.environ[name] = value if name == CORES else os.environ.get(name, value)
    try:
        yield
    finally:
        for name, old in before.items():
            if old is None:
                del os.environ[name]
            else:
                os.environ[name] = old


# ---- the other half of some calls


_FEWEST_SHARED, _MOST_CLAIMS, _MOST_PARTS = 4, 1000, 10
_CLAIM = 4
"""Bytes of a claim, so that all of them find room in the smallest pipe. Whoever reads one has it, and no one else."""

_COPY_S = 600.0
"""How long what a copy of this process made is waited for."""


@contextmanager
def halved(function: Callable[[T], R], items: Sequence[T]) -> Iterator[Callable[[], list[R]]]:
    """Begin calls in another process, and give what makes those left and returns all results, in their order.

    function: pure, its results such as can be pickled. The other process is one of `beside`, to which calls are handed
    in parts, where this one is inside of that; there function and items are pickled too. Else it is a copy of this one.
    A call that failed in the copy, or was lost with it, is made here; warnings that it gave there are not seen. What is
    given returns the results for one time, and raises what a call raised; of several that did, any.
    The copy is a fork, begun in milliseconds where a new process takes half a second to import what this one holds.
    Only a process of one thread, on Linux, with a core to spare and allowed children, is copied; in any other, and
    where a fork fails, all calls are made here.

    >>> with halved(abs, [-1, 2, -3]) as rest:
    ...     rest()
    [1, 2, 3]
    """
    if len(items) >= _FEWEST_SHARED and (hand := _hand.get()) is not None:
        step = math.ceil(len(items) / _MOST_PARTS)
        later = [hand(_part, function, items[begin : begin + step]) for begin in range(0, len(items), step)]
        yield lambda: [result for part in fetch_all(later) for result in part]
        return
    if len(items) < _FEWEST_SHARED or cores() < 2 or not _can_be_copied():
        yield lambda: [function(item) for item in items]
        return
    first, fork, every = os.getpid(), get_context("fork"), min(len(items), _MOST_CLAIMS)
    with ExitStack() as stack:
        claims, written = os.pipe()
        stack.callback(os.close, claims)
        os.write(written, b"".join(place.to_bytes(_CLAIM, "big") for place in range(every)))
        os.close(written)
        receiver, sender = (stack.enter_context(end) for end in fork.Pipe(duplex=False))

        def made() -> Iterator[tuple[int, R]]:
            while claim := os.read(claims, _CLAIM):
                for place in range(int.from_bytes(claim, "big"), len(items), every):
                    yield place, function(items[place])

        def make() -> None:
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # the word on an interrupt is the first one's
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            receiver.close()
            found: dict[int, R] = {}
            with suppress(Exception):  # what a call raises, the first raises when it makes that call again
                for place, result in made():
                    if os.getppid() != first:  # which was killed
                        return
                    found[place] = result
            with suppress(Exception):
                sender.send(found)

        copy = fork.Process(target=make, daemon=True)
        with suppress(OSError):  # no memory, or no process left: everything is made here
            copy.start()
            stack.callback(_ended, copy)
        sender.close()

        def rest() -> list[R]:
            found = dict(made())
            with suppress(EOFError, OSError, pickle.UnpicklingError):  # it ended, perhaps in the middle of a word
                if receiver.poll(_COPY_S):
                    found |= receiver.recv()
            return [found[place] if place in found else function(item) for place, item in enumerate(items)]

        yield rest


@with_one_blas_thread
def _part(function: Callable[[T], R], items: Sequence[T]) -> list[R]:
    return [function(item) for item in items]


def _can_be_copied() -> bool:
    """Return whether this process may have children and has no thread, of Python or of a library, beside this one.

    A fork copies one thread alone, and a lock that another held would stay locked.
    """
    if sys.platform != "linux" or not hasattr(os, "fork") or current_process().daemon:
        return False
    return sum(1 for _ in Path("/proc/self/task").iterdir()) == 1


def _ended(process: BaseProcess) -> None:
    process.kill()
    process.join()
    with suppress(ValueError):  # nobody can tell that it ended where SIGCHLD is ignored
        process.close()


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
            for place, result in _gathered(client, function, waiting):
                del waiting[place]
                yield place, result


@contextmanager
def _client(address: str, again: bool) -> "Iterator[Client]":
    try:
        import distributed
    except ImportError as error:
        raise SpecError(f"--scheduler needs dask.distributed; install it: {how_to_install('cluster')}") from error
    for name in ("distributed", "distributed.client"):  # what it says of a lost scheduler, we say
        logging.getLogger(name).setLevel(logging.CRITICAL)
    patience = _PATIENCE_S if again else _TIMEOUT_S
    kept = "; what was done before is in the file of --keep: the same command goes on from it" if again else ""
    until = time.monotonic() + patience
    client = None
    while client is None:
        try:  # in short tries, for between two of its own Dask waits ever longer
            client = distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:  # a timeout is an OSError
            if time.monotonic() > until or isinstance(error, ValueError):
                raise SpecError(
                    f"found no Dask scheduler at {address} within {patience:g} s; start one (dask scheduler) and give "
                    f"its address, as tcp://host:8786{kept}"
                ) from error
            time.sleep(0.1)
    with client:
        try:
            client.wait_for_workers(1, timeout=_PATIENCE_S)
        except TimeoutError as error:
            raise SpecError(
                f"the scheduler at {address} has no workers; start some (dask worker {address} --nthreads 1){kept}"
            ) from error
        except OSError as error:
            raise _LostError from error
        yield client


def _gathered(client: "Client", function: Callable[[T], R], waiting: Mapping[int, T]) -> Iterator[tuple[int, R]]:
    """Yield (place, result) as they come. Raises _LostError where the scheduler is gone."""
    from distributed import as_completed as completed
    from distributed.scheduler import KilledWorker

    place_of: dict[Any, int] = {}

    def handed(places: Sequence[int]) -> "list[Future]":
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Sending large graph")  # a recording is one
            futures = client.map(function, [waiting[place] for place in places], pure=False)
        place_of.update(zip((future.key for future in futures), places, strict=True))
        return list(futures)

    tries = 0
    # Not `with_results`: a result that was being fetched when the scheduler went would be waited for for ever.
    coming = completed(handed(list(waiting)), loop=client.loop)
    for batch in coming.batches():
        here = [future for future in batch if future.status == "finished"]
        try:
            results = client.gather(here)
        except (OSError, asyncio.CancelledError, CancelledError) as error:
            raise _LostError from error
        for future, result in zip(here, results, strict=True):
            tries = 0
            yield place_of[future.key], result
            future.release()
        for future in batch:
            if any(future is one for one in here):
                continue
            if future.status != "error":
                raise _LostError
            raised = future.exception()
            if not isinstance(raised, KilledWorker) or tries == _TRIES:
                _raise_of(raised)
            tries += 1  # by itself, or by chance: that is not known
            coming.update(handed([place_of[future.key]]))


def _raise_of(error: BaseException) -> None:
    """Raise what a task raised; what the cluster did to it, in a sentence."""
    from distributed.scheduler import KilledWorker

    if isinstance(error, KilledWorker):
        raise SinewError(
            "a task took several workers with it, perhaps for want of memory; give the workers more, or fewer of them"
        ) from error
    if isinstance(error, ImportError):
        raise SpecError(f"the workers cannot load what they are to compute ({error}); install Sinew there") from error
    raise error


# ---- what is kept


class _Kept:
    """Results by the key of their task, in a file; each is there whole or not at all."""

    def __init__(self, file: sqlite3.Connection, path: Path) -> None:
        self._file, self._path = file, path

    def get(self, key: str) -> bytes | None:
        """Return a result as it was put; None where there is none. Raises FileError where the file is damaged."""
        try:
            row = self._file.execute("SELECT result FROM kept WHERE key = ?", (key,)).fetchone()
        except sqlite3.Error as error:
            raise FileError(f"{self._path} is damaged ({error}); delete it, or name a new file with --keep") from error
        return None if row is None else bytes(row[0])

    def put(self, key: str, result: bytes) -> None:
        """Keep a result, on the disk before this returns. Raises FileError where it cannot."""
        try:
            with self._file:
                self._file.execute("INSERT OR REPLACE INTO kept VALUES (?, ?)", (key, result))
        except sqlite3.Error as error:
            raise FileError(f"cannot keep results in {self._path}: {error}; check the free space") from error


@contextmanager
def _opened(path: Path) -> Iterator[_Kept]:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = sqlite3.connect(path, timeout=30)
        file.execute("CREATE TABLE IF NOT EXISTS kept (key TEXT PRIMARY KEY, result BLOB NOT NULL)")
    except (OSError, sqlite3.Error) as error:
        raise FileError(f"{path} cannot keep results ({error}); name a new file with --keep") from error
    with closing(file):
        yield _Kept(file, path)


def _kept_in(path: Path | str | None) -> AbstractContextManager[_Kept | None]:
    return nullcontext() if path is None else _opened(Path(path))


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
