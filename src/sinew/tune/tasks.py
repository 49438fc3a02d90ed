"""This is where tasks are run one after the other, or on the workers of a Dask cluster, with the same results."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from sinew import __version__
from sinew.measure.errors import SpecError
from sinew.measure.extras import how_to_install

__all__ = ["run_tasks"]

T = TypeVar("T")
R = TypeVar("R")

_TIMEOUT = "20s"


def run_tasks(
    function: Callable[[T], R],
    tasks: Sequence[T],
    scheduler: str | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> list[R]:
    """Return the result of every task, in their order.

    function: of a module, so that a worker finds it. scheduler: address of a Dask scheduler, `tcp://host:8786`; None
    runs here. progress: called with (done, total). Raises SpecError where the cluster cannot be used.
    """
    if scheduler is not None:
        return _on_cluster(function, tasks, scheduler, progress)
    found = []
    for task in tasks:
        found.append(function(task))
        if progress is not None:
            progress(len(found), len(tasks))
    return found


def _on_cluster(
    function: Callable[[T], R],
    tasks: Sequence[T],
    address: str,
    progress: Callable[[float, float], None] | None,
) -> list[R]:
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise SpecError(f"--scheduler needs dask.distributed; install it: {how_to_install('cluster')}") from error
    try:
        client = Client(address, timeout=_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:  # a timeout is an OSError
        raise SpecError(
            f"found no Dask scheduler at {address}; start one (dask scheduler) and give its address, as tcp://host:8786"
        ) from error
    with client:
        _refuse_workers(client, address)
        futures = client.map(function, list(tasks), pure=False)
        for done, _ in enumerate(as_completed(futures, loop=client.loop), start=1):
            if progress is not None:
                progress(done, len(tasks))
        found: list[R] = client.gather(futures)
        return found


def _refuse_workers(client: Any, address: str) -> None:
    """Raise SpecError unless there are workers and all have this version of Sinew."""
    try:
        versions: dict[str, str] = client.run(_version)
    except ImportError as error:
        raise SpecError(f"the workers of {address} have no Sinew; install {__version__} there") from error
    if not versions:
        raise SpecError(f"the scheduler at {address} has no workers; start some (dask worker {address})")
    others = sorted({found for found in versions.values() if found != __version__})
    if others:
        raise SpecError(
            f"workers of {address} have Sinew {', '.join(others)}, expected {__version__}; install it there"
        )


def _version() -> str:
    return __version__
