"""Tasks over this process and others: order, progress, what is kept and gone on from, what a killed process costs."""

import gc
import os
import pickle
import re
import signal
import sqlite3
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from sinew.measure import tasks
from sinew.measure.errors import FileError, SinewError, SpecError
from sinew.measure.tasks import (
    CORES,
    DEVICE,
    Spread,
    beside,
    cores,
    digest_of,
    each_task,
    halved,
    run_tasks,
)


class Job(NamedTuple):
    """What a test has done. log: gets a line whenever it is computed. killed: a file without which who does it dies."""

    number: float
    log: Path
    killed: Path | None = None


def square(job: Job) -> float:
    with job.log.open("a", encoding="utf-8") as log:
        log.write(f"{job.number:g}\n")
    if job.number < 0:
        raise SpecError("no square of that")
    if job.killed is not None and not job.killed.exists():
        job.killed.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return job.number**2


def dying(_: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def own_cores(_: int) -> tuple[int, str]:
    return cores(), os.environ["OPENBLAS_NUM_THREADS"]


def computed(log: Path) -> list[float]:
    return [float(line) for line in log.read_text(encoding="utf-8").split()]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "log"


def test_results_come_back_in_the_order_of_their_tasks(log: Path) -> None:
    told: list[tuple[float, float]] = []
    found = run_tasks(square, [Job(2.0, log), Job(3.0, log)], progress=lambda done, total: told.append((done, total)))
    assert (found, told) == ([4.0, 9.0], [(1, 2), (2, 2)])


def test_what_was_kept_is_not_computed_again(log: Path, tmp_path: Path) -> None:
    spread = Spread(keep=tmp_path / "new" / "kept.sqlite")
    run_tasks(square, [Job(2.0, log), Job(3.0, log)], spread)
    assert run_tasks(square, [Job(4.0, log), Job(3.0, log), Job(2.0, log)], spread) == [16.0, 9.0, 4.0]
    assert computed(log) == [2.0, 3.0, 4.0]


def test_a_command_that_broke_off_has_kept_what_was_done(log: Path, tmp_path: Path) -> None:
    spread = Spread(keep=tmp_path / "kept.sqlite")
    with pytest.raises(SpecError, match="no square"):
        run_tasks(square, [Job(2.0, log), Job(-1.0, log), Job(3.0, log)], spread)
    run_tasks(square, [Job(2.0, log), Job(3.0, log)], spread)
    assert computed(log) == [2.0, -1.0, 3.0]


def test_a_result_is_on_the_disk_before_it_is_handed_out(log: Path, tmp_path: Path) -> None:
    path = tmp_path / "kept.sqlite"
    with sqlite3.connect(path) as beside:
        for done, _ in enumerate(each_task(square, [Job(2.0, log), Job(3.0, log)], Spread(keep=path)), start=1):
            assert beside.execute("SELECT count(*) FROM kept").fetchone() == (done,)
    beside.close()


@pytest.mark.parametrize("same", [0.5, "word", {"a", "b", "c"}, np.arange(3.0), (("a" * 9,) * 2, None)])
def test_equal_tasks_have_one_digest(same: object) -> None:
    assert digest_of(pickle.loads(pickle.dumps(same))) == digest_of(same)


@pytest.mark.parametrize("other", [0.1, 0.3, np.float64(0.1 + 0.2), [0.1 + 0.2], "0.3"])
def test_tasks_that_differ_in_a_bit_have_other_digests(other: object) -> None:
    assert digest_of(other) != digest_of(0.1 + 0.2)


def test_what_another_program_kept_is_computed_again(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spread = Spread(keep=tmp_path / "kept.sqlite")
    run_tasks(square, [Job(2.0, log)], spread)
    monkeypatch.setattr(tasks, "source_of", lambda _: "of tomorrow")
    run_tasks(square, [Job(2.0, log)], spread)
    assert computed(log) == [2.0, 2.0]


def test_what_a_killed_process_was_at_is_computed_again_and_nothing_else(log: Path, tmp_path: Path) -> None:
    killed = tmp_path / "killed"
    jobs = [Job(float(i), log, killed if i == 2 else None) for i in range(5)]
    kept = Spread(workers=2, keep=tmp_path / "kept.sqlite")
    assert run_tasks(square, jobs, kept) == [0.0, 1.0, 4.0, 9.0, 16.0]
    assert len(computed(log)) - len(jobs) in (1, 2)  # its own, and that of the process beside it, which ends with it


def test_a_task_that_kills_every_process_is_told_of_in_the_end() -> None:
    with pytest.raises(SinewError, match="ended 3 times before any of 2 tasks was done"):
        run_tasks(dying, [1, 2], Spread(workers=2))


def test_processes_share_the_cores_of_the_computer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CORES, "6")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    assert run_tasks(own_cores, [1, 2], Spread(workers=2)) == [(3, "3")] * 2
    assert os.environ[CORES] == "6"
    assert "OPENBLAS_NUM_THREADS" not in os.environ


def test_a_file_of_something_else_is_refused_before_anything_is_computed(log: Path, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("not of this kind " * 100, encoding="utf-8")
    with pytest.raises(FileError, match=re.escape("notes.txt cannot keep results")):
        run_tasks(square, [Job(2.0, log)], Spread(keep=tmp_path / "notes.txt"))
    assert not log.exists()


def test_a_damaged_file_of_results_is_told_of_with_what_to_do(log: Path, tmp_path: Path) -> None:
    path = tmp_path / "kept.sqlite"
    jobs = [Job(float(i), log) for i in range(200)]
    run_tasks(square, jobs, Spread(keep=path))
    with path.open("r+b") as file:  # its first page, which says what is in it, stays whole
        file.seek(4096)
        file.write(b"\x5a" * (path.stat().st_size - 4096))
    with pytest.raises(FileError, match=r"kept\.sqlite is damaged \(.*\); delete it, or name a new file with --keep"):
        run_tasks(square, jobs, Spread(keep=path))


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"scheduler": "tcp://there:1", "workers": 2}, "give one of both"),
        ({"workers": 0}, "expected 1 or more"),
        ({"device": "tpu"}, "expected one of cpu, gpu"),
    ],
)
def test_a_spread_that_cannot_be_is_refused(options: dict[str, object], sentence: str) -> None:
    with pytest.raises(SpecError, match=sentence):
        Spread(**options)  # type: ignore[arg-type]


def test_a_gpu_that_is_not_there_is_told_of_with_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    import jax

    from sinew.solve.programs import _begun

    monkeypatch.setenv(DEVICE, "gpu")
    monkeypatch.setattr(jax, "default_backend", lambda: "cpu")
    with pytest.raises(SpecError, match=r"found no GPU that JAX can use, only cpu; install .* \(--device cpu\)"):
        _begun.__wrapped__()


def test_a_process_that_began_on_the_cpu_does_not_go_on_on_another_device(monkeypatch: pytest.MonkeyPatch) -> None:
    from sinew.solve.programs import configure

    configure()
    monkeypatch.setenv(DEVICE, "gpu")
    with pytest.raises(SpecError, match="computes on the cpu already; begin a new one for the gpu"):
        configure()


def of_process() -> tuple[int, int]:
    return os.getpid(), cores()


def lost_elsewhere(mine: int, log: Path) -> int:
    log.touch()
    if os.getpid() != mine:
        os.kill(os.getpid(), signal.SIGKILL)
    return mine


def test_a_call_is_made_beside_this_process_or_here_when_it_is_asked_for(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CORES, "4")
    with beside(1) as hand:
        elsewhere, refused = hand(of_process), hand(square, Job(-1.0, log))
        wait_for(log)
        other, threads = elsewhere()
        with pytest.raises(SpecError, match="no square of that"):
            refused()
    assert (other != os.getpid(), threads, cores()) == (True, 2, 4)
    with beside(0) as hand:
        here = hand(square, Job(3.0, log))
        assert computed(log) == [-1.0]
        assert (here(), computed(log)) == (9.0, [-1.0, 3.0])


def wait_for(log: Path) -> None:
    for _ in range(600):
        if log.exists():
            return
        time.sleep(0.1)
    raise AssertionError("no process has begun in a minute")


def pausing(seconds: float, log: Path) -> int:
    with log.open("a", encoding="utf-8") as lines:
        lines.write(f"{seconds:g}\n")
    time.sleep(seconds)
    return os.getpid()


def test_what_no_process_has_begun_is_done_here_when_it_is_asked_for(log: Path) -> None:
    with beside(1) as hand:
        begun, *waiting = (hand(pausing, seconds, log) for seconds in (2.0, 0.0, 0.0, 0.0))
        wait_for(log)
        assert [fetched() for fetched in waiting] == [os.getpid()] * 3
        assert begun() != os.getpid()
    assert computed(log) == [2.0, 0.0, 0.0, 0.0], "none is done twice"


def ask_for_much_and_break_off(log: Path) -> None:
    with beside(1) as hand:
        for seconds in (1.0, 0.0, 0.0, 0.0, 0.0):
            hand(pausing, seconds, log)
        wait_for(log)
        raise SpecError("something amiss")


def test_calls_that_wait_are_not_begun_after_an_error(log: Path) -> None:
    with pytest.raises(SpecError, match="amiss"):
        ask_for_much_and_break_off(log)
    assert computed(log) == [1.0]


def test_what_a_process_took_with_it_is_made_here(log: Path) -> None:
    with beside(1) as hand:
        fetched = hand(lost_elsewhere, os.getpid(), log)
        wait_for(log)
        assert fetched() == os.getpid()
        assert hand(divmod, 7, 2)() == (3, 1), "what is handed over later is made here, too"


def lost_in_the_other(here: int, number: int) -> tuple[int, int]:
    time.sleep(0.02)
    if os.getpid() != here and number == 5:
        os.kill(os.getpid(), signal.SIGKILL)
    return number, os.getpid()


def test_half_of_some_calls_goes_to_the_process_that_is_there_already(log: Path) -> None:
    with beside(1) as hand:
        hand(pausing, 0.0, log)
        wait_for(log)
        with halved(partial(pausing, log=log), [0.1] * 20) as rest:
            found = rest()
        with pytest.raises(SpecError, match="no square of that"), halved(square, [Job(-1.0, log)] * 4) as rest:
            rest()
        with halved(partial(lost_in_the_other, os.getpid()), range(40)) as rest:
            time.sleep(0.5)
            kept = rest()
    assert len(found) == 20
    assert len(set(found)) == 2
    assert found[0] != os.getpid()
    assert found[-1] == os.getpid()
    assert [number for number, _ in kept] == list(range(40)), "in their order"
    assert kept[0][1] != os.getpid()
    assert {process for number, process in kept if number >= 4} == {os.getpid()}, "what it took with it is made here"


def settings(log: Path) -> tuple[int, bool, int]:
    log.touch()
    return os.getpid(), sys.modules.get("dask", sys) is None, gc.get_threshold()[0]


def test_a_process_beside_keeps_dask_out_as_this_one_does(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "dask", None)
    before = gc.get_threshold()
    gc.set_threshold(54_321)
    try:
        with beside(1) as hand:
            fetched = hand(settings, log)
            wait_for(log)
            process, *found = fetched()
    finally:
        gc.set_threshold(*before)
    assert process != os.getpid()
    assert found == [True, 54_321]


INTERRUPTED = """
import os, signal, sys, time
from pathlib import Path
from sinew.measure.tasks import beside
from tests.unit.test_measure_tasks import pausing, wait_for

if __name__ == "__main__":
    log = Path(sys.argv[1])
    with beside(1) as hand:
        later = [hand(pausing, 20.0, log), hand(pausing, 10.0, log)]
        wait_for(log)
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # as one that is deep in a program of XLA
        os.killpg(0, signal.SIGINT)
        time.sleep(1.0)
        raise KeyboardInterrupt
"""


def test_after_an_interrupt_no_process_begins_what_waits(log: Path, tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(INTERRUPTED, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(script), str(log)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": str(Path.cwd())},
    )
    assert done.returncode == -signal.SIGINT, done.stderr
    assert computed(log) == [20.0]
    assert "pausing" not in done.stderr, "a process of the pool has nothing to say"


BLAS = """
import numpy
from threading import Event, Thread
from threadpoolctl import threadpool_info
from sinew.measure.tasks import with_one_blas_thread

def threads():
    return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}

@with_one_blas_thread
def first():
    begun.set()
    ended.wait(10.0)

@with_one_blas_thread
def second():
    ended.set()
    beside.join()
    return threads()

begun, ended, beside = Event(), Event(), Thread(target=first)
at_first = threads()
beside.start()
begun.wait(10.0)
print([at_first, second(), threads(), with_one_blas_thread(threads)(), threads()])
"""


def test_blas_has_one_thread_for_the_time_of_calls_and_of_those_that_overlap() -> None:
    done = subprocess.run(
        [sys.executable, "-c", BLAS],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "2"},
    )
    assert done.stdout.strip() == "[{2}, {1}, {2}, {1}, {2}]"


def alone(code: str, cores: int = 2) -> str:
    """Return what code prints in a process of one thread, which may be copied."""
    done = subprocess.run(
        [sys.executable, "-c", ALONE + code],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={**os.environ, CORES: str(cores), "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(Path.cwd())},
    )
    assert done.stderr == "", done.stderr
    return done.stdout.strip()


ALONE = """
import os, signal, threading, time
from multiprocessing import active_children
from pathlib import Path
from sinew.measure.tasks import halved

first = os.getpid()

def who(number):
    time.sleep(0.05)
    return number, os.getpid()

def while_it_works(number):
    if number == 3 and os.getpid() != first:
        os.kill(os.getpid(), signal.SIGKILL)
    return who(number)

def while_it_sends(number):
    if number == 9 and os.getpid() != first:
        signal.setitimer(signal.ITIMER_REAL, 0.3)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
    return *who(number), bytes(50_000)

def failing(number):
    if number == 3:
        raise ValueError(f"{number} in {os.getpid() == first}")
    return who(number)
"""


@pytest.mark.parametrize(("cores", "processes"), [(2, 2), (1, 1)])
def test_calls_are_shared_with_a_copy_where_there_is_a_core_for_it(cores: int, processes: int) -> None:
    code = "with halved(who, range(10)) as rest:\n    found = rest()\n"
    code += "print([number for number, _ in found] == list(range(10)), len({pid for _, pid in found}))"
    assert alone(code, cores) == f"True {processes}"


def test_a_process_with_another_thread_is_not_copied() -> None:
    code = "threading.Thread(target=time.sleep, args=(2.0,), daemon=True).start()\n"
    code += "with halved(who, range(4)) as rest:\n    print({pid for _, pid in rest()} == {first})"
    assert alone(code) == "True"


@pytest.mark.parametrize("losing", ["while_it_works", "while_it_sends"])
def test_what_a_copy_took_with_it_is_made_here(losing: str) -> None:
    code = f"with halved({losing}, range(10)) as rest:\n    time.sleep(1.0)\n    found = rest()\n"
    code += "print([number for number, *_ in found] == list(range(10)), {pid for _, pid, *_ in found} == {first})"
    assert alone(code) == "True True"


def test_a_copy_ends_with_who_began_it(tmp_path: Path) -> None:
    code = f"""
def much(number):
    Path({str(tmp_path)!r}, f"{{number}}-{{os.getpid()}}").touch()
    time.sleep(0.05)
    return bytes(50_000)  # more than a pipe holds: it waits for a reader

def has_ended(process):  # dead, perhaps not yet waited for
    stat = Path("/proc", process, "stat")
    return not stat.exists() or stat.read_text().split()[2] == "Z"

if os.fork() == 0:
    first = os.getpid()
    with halved(much, range(8)) as rest:
        time.sleep(0.2)
        os.kill(first, signal.SIGKILL)
os.wait()
time.sleep(1.0)
calls = [path.name.split("-") for path in Path({str(tmp_path)!r}).iterdir()]
copies = {{process for _, process in calls}}
print(len(copies), all(map(has_ended, copies)), len(calls) < 8)
"""
    assert alone(code) == "1 True True"


@pytest.mark.parametrize(
    "hindrance",
    [
        "os.fork = lambda: (_ for _ in ()).throw(BlockingIOError(11, 'no process left'))",
        "signal.signal(signal.SIGCHLD, signal.SIG_IGN)",
        "current_process()._config['daemon'] = True",
    ],
    ids=["no fork", "children not waited for", "a daemon"],
)
def test_all_calls_are_made_where_a_copy_is_hindered(hindrance: str) -> None:
    code = f"from multiprocessing import current_process\n{hindrance}\n"
    code += "with halved(who, range(10)) as rest:\n    print([number for number, _ in rest()] == list(range(10)))"
    assert alone(code) == "True"


def test_what_a_call_raises_in_a_copy_is_raised_here() -> None:
    code = "try:\n    with halved(failing, range(10)) as rest:\n        time.sleep(1.0)\n        rest()\n"
    code += "except ValueError as error:\n    print(error, active_children())"
    assert alone(code) == "3 in True []"


def test_a_copy_ends_with_an_interrupt_and_leaves_nothing_open() -> None:
    code = """
def open_files():
    return len(list(Path("/proc/self/fd").iterdir()))

signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in what began in the background
before = open_files()
for _ in range(20):
    try:
        with halved(who, range(1000)) as rest:
            os.kill(first, signal.SIGINT)
            rest()
    except KeyboardInterrupt:
        pass
print(open_files() - before, active_children())
"""
    assert alone(code) == "0 []"
