"""What the dashboard costs its computer: `python -m benchmarks serve`.

How long `sinew serve --emulate` takes until its first page is answered, in seconds and in those of the processor, each
process told apart; what its processes hold of the memory then, and what the workers hold after each thing that pages
ask of them, and once nobody asks any more. Memory is the proportional set size: a page that n processes share counts
as 1/n of it in each.
"""

import argparse
import asyncio
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import psutil

from sinew.apps.dashboard import worker as workers
from sinew.plan.toml import dump_plan, load_plan, read_spec

_READY_S = 120.0
_LOOK_S = 0.01
_MB = 1e6


def memory_mb(process: psutil.Process) -> float:
    """Return the proportional set size of a process [MB]; of one that has gone 0."""
    try:
        return float(process.memory_full_info().pss) / _MB
    except psutil.Error:
        return 0.0


def role(process: psutil.Process) -> str:
    """Return what a process of the dashboard is for."""
    words = " ".join(process.cmdline())
    known = {"resource_tracker": "workers", "spawn_main": "workers", " emulate ": "emulated bench", " run ": "run"}
    known["sinew.apps.dashboard"] = "pages"
    return next((name for mark, name in known.items() if mark in words), "steward")


def by_role(root: psutil.Process) -> dict[str, list[psutil.Process]]:
    """Return a process and all below it by what they are for."""
    found: dict[str, list[psutil.Process]] = {}
    for each in (root, *root.children(recursive=True)):
        try:
            found.setdefault(role(each), []).append(each)
        except psutil.Error:
            continue  # it has ended meanwhile
    return found


def _busy_s(processes: Sequence[psutil.Process]) -> float:
    """Return how long a core was busy with some processes [s]."""
    return float(sum(each.cpu_times().user + each.cpu_times().system for each in processes))


@contextmanager
def served(runs: Path, *options: str) -> Iterator[tuple[psutil.Process, float]]:
    """Give `sinew serve` in a process of its own, and after how long its first page was answered [s]."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    begin = time.perf_counter()
    command = [
        str(Path(sys.executable).with_name("sinew")),
        "serve",
        "--http",
        f"127.0.0.1:{port}",
        "--runs",
        str(runs),
    ]
    process = subprocess.Popen([*command, *options], stdout=subprocess.DEVNULL)
    try:
        while not _is_answered(f"http://127.0.0.1:{port}/"):
            if process.poll() is not None or time.perf_counter() - begin > _READY_S:
                raise RuntimeError("sinew serve does not get ready")
            time.sleep(_LOOK_S)
        yield psutil.Process(process.pid), time.perf_counter() - begin
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()


def _is_answered(address: str) -> bool:
    try:
        with urllib.request.urlopen(address, timeout=_READY_S) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False


def _start(runs: Path) -> None:
    with served(runs, "--emulate") as (root, seconds):
        spent = {name: _busy_s(some) for name, some in by_role(root).items()}
        told = ", ".join(f"{name} {busy:.2f}" for name, busy in spent.items())
        print(f"  first page after {seconds:5.2f} s; seconds of a core: {told}; {sum(spent.values()):.2f} in all")


def _rest(runs: Path, rest_s: float) -> None:
    with served(runs, "--emulate") as (root, _):
        time.sleep(rest_s)
        held = {name: sum(map(memory_mb, some)) for name, some in by_role(root).items()}
        before = {name: _busy_s(some) for name, some in by_role(root).items()}
        time.sleep(rest_s)
        busy = {name: (_busy_s(some) - before.get(name, 0.0)) / rest_s for name, some in by_role(root).items()}
    for name, size in held.items():
        print(f"  {name:<16} {size:6.0f} MB, {100 * busy.get(name, 0.0):5.1f} % of a core")
    print(f"  {'in all':<16} {sum(held.values()):6.0f} MB")


def _calls(folder: Path) -> dict[str, tuple[object, ...]]:
    """Return what the pages ask of their workers, in the order in which somebody would walk through them."""
    plan, rig = dump_plan(load_plan("short")), read_spec("rigs", "rigs/paper.toml")
    return {
        "look_at_runs": (str(folder),),
        "shelf": (str(folder),),
        "preview_document": (plan, rig),
        "prediction_for_plan": (plan, rig, 40),
        "warm_up": (),
        "sketch_curves": ("paper", {"length_mm": 90.0}, 4.0, 20.0),
        "design_curves": ("paper", {"length_mm": 90.0}, 4.0, 20.0, (1.0, 6.0), True),
        "suggest_pretension": ("paper", {}, 3.5),
    }


async def _work(folder: Path, rest_s: float) -> None:
    worker = workers.Worker()
    here = psutil.Process()
    try:
        for name, arguments in _calls(folder).items():
            begin, before = time.perf_counter(), {each: _busy_s([each]) for each in here.children(recursive=True)}
            await worker.call(name, *arguments)
            seconds, those = time.perf_counter() - begin, here.children(recursive=True)
            busy = sum(_busy_s([each]) - before.get(each, 0.0) for each in those)
            held = sum(map(memory_mb, those))
            told = f"{seconds:6.2f} s, {busy:6.2f} s of a core; then {len(those)} processes with {held:5.0f} MB"
            print(f"  {name:<20} {told}", flush=True)
        await asyncio.sleep(rest_s)
        left = here.children(recursive=True)
        print(f"  {rest_s:g} s later: {len(left)} processes with {sum(map(memory_mb, left)):5.0f} MB")
    finally:
        worker.close()


def main(words: Sequence[str] = ()) -> None:
    """Print what the start, the rest and the work of a dashboard cost."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks serve")
    parser.add_argument("--rest", type=float, default=10.0, help="how long nobody asks for anything [s]")
    parser.add_argument(
        "--after", type=float, default=70.0, help="how long after the last call the workers are counted [s]"
    )
    parser.add_argument("--times", type=int, default=3, help="how often it is begun")
    parser.add_argument("--only", choices=("start", "rest", "work"), help="one of the three; else all")
    asked = parser.parse_args(words)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with tempfile.TemporaryDirectory() as folder:
        if asked.only in (None, "start"):
            print("start, with an emulated bench")
            for _ in range(asked.times):
                _start(Path(folder) / "runs")
        if asked.only in (None, "rest"):
            print(f"at rest, {asked.rest:g} s after the first page")
            _rest(Path(folder) / "runs", asked.rest)
        if asked.only in (None, "work"):
            print("work of the pages")
            asyncio.run(_work(Path(folder), asked.after))
