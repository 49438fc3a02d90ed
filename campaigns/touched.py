"""Which functions of Sinew does each file of tests call? A plugin of pytest that notes it, also in child processes.

`calls_of` runs a tree's tests once with it. Before each file of tests what Sinew or JAX kept is forgotten, so that a
function which is traced or computed once is seen by each file that needs it. What modules call while they are imported
concerns all tests. What a fixture of the whole session calls is seen by the first file that asks for it: so do the
tests in a browser, and no others.
"""

import atexit
import functools
import gc
import inspect
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Generator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, FrameType

import pytest

import sinew

_OUT, _BY = "SINEW_TOUCHED", "SINEW_TOUCHED_BY"
_EVERY = "*"
_SOURCE = f"{Path(__file__).resolve().parents[1] / 'src/sinew'}{os.sep}"
_AT_START = f"""import os
if "{_BY}" in os.environ:
    import campaigns.touched
    campaigns.touched.begin()
"""

_seen: dict[int, CodeType] = {}  # with its code, so that no other code comes to lie in its place
_began = time.monotonic()


@dataclass(frozen=True)
class Calls:
    """What the tests of a tree call.

    files: by module below src/sinew and first line of a function, the files of tests that call it. every: functions
    that are called by whoever imports their module. seconds: that each file of tests took.
    """

    files: dict[tuple[str, int], set[str]]
    every: set[tuple[str, int]]
    seconds: dict[str, float]


def calls_of(tree: Path, command: Sequence[str], environment: Mapping[str, str]) -> tuple[Calls, str]:
    """Return what the tests call that a command of pytest runs in a tree, and what it printed.

    The command imports `campaigns` from the tree, by the PYTHONPATH of the environment.
    """
    with tempfile.TemporaryDirectory(prefix="touched") as folder:
        out, site = Path(folder) / "touched", Path(folder) / "site"
        site.mkdir()
        (site / "sitecustomize.py").write_text(_AT_START, encoding="utf-8")  # child processes of a test note too
        path = f"{site}{os.pathsep}{environment['PYTHONPATH']}"
        noted = dict(environment) | {"PYTHONPATH": path, _OUT: str(out)}
        done = subprocess.run(
            [*command, "-p", "campaigns.touched"], cwd=tree, env=noted, capture_output=True, text=True, check=False
        )
        files, every, seconds = defaultdict[tuple[str, int], set[str]](set), set[tuple[str, int]](), dict[str, float]()
        for line in out.read_text(encoding="utf-8").splitlines() if out.exists() else ():
            by, module, number = line.split("\t")
            if not module:
                seconds[by] = seconds.get(by, 0.0) + float(number)
            elif by == _EVERY:
                every.add((module, int(number)))
            else:
                files[module, int(number)].add(by)
        return Calls(dict(files), every, seconds), done.stdout


def _write(by: str, module: str, number: float) -> None:
    # A test may forbid its child process to write files of some size.
    with suppress(OSError), Path(os.environ[_OUT]).open("a", encoding="utf-8") as out:
        out.write(f"{by}\t{module}\t{number:.6g}\n")


def _note(frame: FrameType, event: str, arg: object) -> None:
    code = frame.f_code
    if id(code) in _seen:
        return
    _seen[id(code)] = code
    if not code.co_filename.startswith(_SOURCE) or not code.co_flags & inspect.CO_OPTIMIZED:
        return
    by, above = os.environ.get(_BY) or _EVERY, frame.f_back
    while above is not None:
        if above.f_code.co_name == "<module>" and str(above.f_globals.get("__name__", "")).startswith("sinew."):
            by = _EVERY
        above = above.f_back
    _write(by, code.co_filename.removeprefix(_SOURCE), code.co_firstlineno)


def begin() -> None:
    """Note from now on what this process calls.

    It reads no program that another has traced, as if its source had changed meanwhile: none of its functions would
    be called.
    """
    sinew._began_ns = 0
    atexit.register(sys.settrace, None)
    threading.settrace(_note)
    sys.settrace(_note)


def _end_file() -> None:
    global _began  # noqa: PLW0603
    now = time.monotonic()
    if os.environ.get(_BY):
        _write(os.environ[_BY], "", now - _began)
    _began = now


class _Noting:
    """Turns to the file of tests that is collected or run."""

    @pytest.hookimpl(hookwrapper=True)
    def pytest_make_collect_report(self, collector: pytest.Collector) -> Generator[None, None, None]:
        if isinstance(collector, pytest.Module):
            os.environ[_BY] = collector.nodeid
            _seen.clear()
        yield
        os.environ[_BY] = ""

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        file = nodeid.split("::")[0]
        if os.environ.get(_BY) == file:
            return
        _end_file()
        os.environ[_BY] = file
        for kept in [one for one in gc.get_objects() if isinstance(one, functools._lru_cache_wrapper)]:
            if (kept.__module__ or "").split(".")[0] in ("sinew", "tests"):
                kept.cache_clear()
        if "jax" in sys.modules:
            sys.modules["jax"].clear_caches()
        if programs := sys.modules.get("sinew.solve.programs"):
            programs.forget()
        _seen.clear()

    def pytest_sessionfinish(self) -> None:
        _end_file()


def pytest_configure(config: pytest.Config) -> None:
    """Begin to note, in the processes that run tests."""
    if hasattr(config, "workerinput") or not config.getoption("numprocesses", None):
        config.pluginmanager.register(_Noting())
        begin()
