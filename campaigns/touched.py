"""Which functions of Sinew does each file of tests call? A plugin of pytest that notes it, also in child processes.

`pytest -p campaigns.touched` with `SINEW_TOUCHED` naming a file writes there a line for each file of tests and function:
the test file, the module below src/sinew and the function's first line, tabs between. Before each file of tests what
Sinew or JAX kept is forgotten, so that a function which is traced or computed once is seen by each file that needs it.
What modules call while they are imported is noted for the file of tests `EVERY`, for it concerns all.
"""

import atexit
import functools
import gc
import inspect
import os
import sys
import threading
from collections.abc import Generator
from pathlib import Path
from types import CodeType, FrameType

import pytest

EVERY = "*"
_OUT, _OF = "SINEW_TOUCHED", "SINEW_TOUCHED_BY"
_SOURCE = f"{Path(__file__).resolve().parents[1] / 'src/sinew'}{os.sep}"

_seen: dict[int, CodeType] = {}  # with its code, so that no other code comes to lie in its place


def _note(frame: FrameType, event: str, arg: object) -> None:
    code = frame.f_code
    if id(code) in _seen:
        return
    _seen[id(code)] = code
    if not code.co_filename.startswith(_SOURCE) or not code.co_flags & inspect.CO_OPTIMIZED:
        return
    by, above = os.environ.get(_OF, EVERY), frame.f_back
    while above is not None:
        if above.f_code.co_name == "<module>" and above.f_globals.get("__name__", "").startswith("sinew."):
            by = EVERY
        above = above.f_back
    line = f"{by}\t{code.co_filename.removeprefix(_SOURCE)}\t{code.co_firstlineno}\n"
    with Path(os.environ[_OUT]).open("a", encoding="utf-8") as out:
        out.write(line)


def begin() -> None:
    """Note from now on what this process calls."""
    atexit.register(sys.settrace, None)
    threading.settrace(_note)
    sys.settrace(_note)


def _turn_to(file: str) -> None:
    if os.environ.get(_OF) == file:
        return
    os.environ[_OF] = file
    for kept in [one for one in gc.get_objects() if isinstance(one, functools._lru_cache_wrapper)]:
        if (kept.__module__ or "").split(".")[0] in ("sinew", "tests"):
            kept.cache_clear()
    if "jax" in sys.modules:
        sys.modules["jax"].clear_caches()
    _seen.clear()


def pytest_configure() -> None:
    """Begin to note, in the process that runs the tests."""
    begin()


@pytest.hookimpl(hookwrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Generator[None, None, None]:
    """Note what a file of tests calls while it is imported."""
    if isinstance(collector, pytest.Module):
        os.environ[_OF] = collector.nodeid
        _seen.clear()
    yield


def pytest_runtest_logstart(nodeid: str) -> None:
    """Note what a test calls for its file."""
    _turn_to(nodeid.split("::")[0])
