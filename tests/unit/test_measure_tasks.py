"""Tasks over this process and others: order, progress, what is kept and gone on from, what a killed process costs."""

import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from sinew.measure import tasks
from sinew.measure.errors import FileError, SinewError, SpecError
from sinew.measure.tasks import (
    CORES,
    DEVICE,
    Spread,
    cores,
    digest_of,
    run_tasks,
    with_one_blas_thread,
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
    with pytest.raises(FileError, match=r"cannot keep results in .*notes\.txt \("):
        run_tasks(square, [Job(2.0, log)], Spread(keep=tmp_path / "notes.txt"))
    assert not log.exists()


def test_a_damaged_file_of_results_is_told_of_with_what_to_do(log: Path, tmp_path: Path) -> None:
    path = tmp_path / "kept.sqlite"
    jobs = [Job(float(i), log) for i in range(200)]
    run_tasks(square, jobs, Spread(keep=path))
    with path.open("r+b") as file:  # its first page, which says what is in it, stays whole
        file.seek(4096)
        file.write(b"\x5a" * (path.stat().st_size - 4096))
    with pytest.raises(FileError, match=r"kept\.sqlite \(.*\); .*delete the file, or name a new one with --keep"):
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


def pausing(seconds: float, log: Path) -> int:
    with log.open("a", encoding="utf-8") as lines:
        lines.write(f"{os.getpid()}\n")
    time.sleep(seconds)
    return os.getpid()


INTERRUPTED = """
import os, signal, sys, threading, time
from functools import partial
from pathlib import Path
from sinew.measure.tasks import Spread, run_tasks
from tests.unit.test_measure_tasks import pausing

def interrupt(log):
    while not log.exists() or len(log.read_text().split()) < 2:
        time.sleep(0.1)
    if sys.argv[2] == "group":
        os.killpg(0, signal.SIGINT)  # as a terminal does
    else:
        os.kill(os.getpid(), signal.SIGINT)

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in what began in the background
    log = Path(sys.argv[1])
    threading.Thread(target=interrupt, args=(log,), daemon=True).start()
    try:
        run_tasks(partial(pausing, log=log), [100.0] * 4, Spread(workers=2))
    except KeyboardInterrupt:
        sys.exit(130)
"""


@pytest.mark.parametrize("whom", ["group", "process"])
def test_an_interrupt_ends_all_processes_at_once_and_begins_no_further_task(
    log: Path, tmp_path: Path, whom: str
) -> None:
    script = tmp_path / "script.py"
    script.write_text(INTERRUPTED, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(script), str(log), whom],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": str(Path.cwd())},
    )
    assert (done.returncode, done.stderr) == (130, "")
    begun = {int(process) for process in computed(log)}
    assert len(begun) == 2
    assert not any(Path("/proc", str(process)).exists() for process in begun)


@with_one_blas_thread
def blas_threads() -> set[int]:
    return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}


def test_blas_has_one_thread_for_the_time_of_a_call() -> None:
    with threadpool_limits(2, "blas"):
        assert blas_threads() == {1}
        assert {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"} == {2}
