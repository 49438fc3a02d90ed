"""A Dask cluster whose workers and scheduler are killed: `python -m campaigns.cluster --kills 50`.

Decays are analysed here and on 1, 2 and 4 workers of a scheduler on loopback: their numbers must be the same bit for
bit. Then workers and schedulers are killed with SIGKILL at random moments: only what was in flight may be computed
again. Exit status 1 if something happened that may not. Takes some minutes on two quiet cores.
"""

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from campaigns.options import campaign_parser, conclude
from sinew.measure.tasks import CORES, Spread, digest_of, each_task, run_tasks

LEAN = {"DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False", "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "1s"}
"""Environment of scheduler and workers, as the page on clusters has it: Dask looks after itself less often."""

_DECAYS = 2
"""In a job that is analysed between kills: some tenths of a second of a core."""


# ---- the cluster: processes that are begun, and ended by their own id


@dataclass
class Cluster:
    """A scheduler on loopback and workers of one thread each."""

    folder: Path
    count: int
    port: int = 0
    scheduler: "subprocess.Popen[bytes] | None" = None
    workers: dict[int, "subprocess.Popen[bytes]"] = field(default_factory=dict)

    @property
    def address(self) -> str:
        return f"tcp://127.0.0.1:{self.port}"

    @contextmanager
    def running(self) -> Iterator["Cluster"]:
        """Begin all of it, and end it."""
        with socket.socket() as one:
            one.bind(("127.0.0.1", 0))
            self.port = int(one.getsockname()[1])
        try:
            self.begin()
            yield self
        finally:
            for process in (*self.workers.values(), self.scheduler):
                if process is not None:
                    process.kill()
                    process.wait()

    def begin(self) -> None:
        """Begin a scheduler at its port, and the workers."""
        self.scheduler = self._begin("scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-show")
        for number in range(self.count):
            self.begin_worker(number)

    def kill_scheduler(self) -> frozenset[int]:
        """Kill the scheduler, and the workers, which would end without it; return the ids of the workers."""
        assert self.scheduler is not None
        for process in (self.scheduler, *self.workers.values()):
            process.kill()
        for process in (self.scheduler, *self.workers.values()):
            process.wait()
        return frozenset(process.pid for process in self.workers.values())

    def begin_worker(self, number: int) -> None:
        """Begin a worker."""
        self.workers[number] = self._begin(
            "worker", self.address, "--nthreads", "1", "--no-nanny", "--host", "127.0.0.1"
        )

    def _begin(self, what: str, *options: str) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", *options, "--no-dashboard"]
        # Scheduler and workers load the jobs of this campaign, which no installed package holds.
        path = os.pathsep.join([str(Path(__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])])
        environment = os.environ | {"PYTHONPATH": path} | LEAN
        with (self.folder / f"{what}.log").open("ab") as log:
            return subprocess.Popen(command, stdout=log, stderr=log, cwd=self.folder, env=environment)


# ---- what is computed


class Job(NamedTuple):
    """A task that writes down when it began and ended, by a clock that all processes share."""

    function: Callable[[Any], Any]
    task: Any
    number: int
    log: Path


def run_job(job: Job) -> str:
    """Return a digest of what a job's function gives, to the last bit."""
    _write(job.log, "begun", job.number)
    result = job.function(job.task)
    _write(job.log, "ended", job.number)
    return digest_of(result)


def _write(log: Path, what: str, number: int) -> None:
    with log.open("a", encoding="utf-8") as file:
        file.write(f"{time.monotonic()} {what} {number} {os.getpid()}\n")


def decays(log: Path, count: int, seed: int) -> list[Job]:
    """Return jobs of a campaign: a few decays each, analysed."""
    from campaigns.decays import KINDS

    kinds = list(KINDS)
    work = [tuple((kinds[(i + k) % len(kinds)], seed + i) for k in range(_DECAYS)) for i in range(count)]
    return [Job(analyse_decays, task, number, log) for number, task in enumerate(work)]


def analyse_decays(task: Sequence[tuple[str, int]]) -> list[tuple[Any, ...]]:
    """Return what becomes of some records of `campaigns.decays`, without the time that it took."""
    from campaigns.decays import try_one

    found = [try_one(one) for one in task]
    return [(one.kind, one.seed, one.refusal, one.fault, one.off) for one in found]


def other_numbers(folder: Path, counts: Sequence[int], seed: int) -> list[str]:
    """Return which sizes of a cluster give other numbers than this process."""
    jobs = decays(folder / "jobs.log", 12, seed)
    here = run_tasks(run_job, jobs)
    wrong = []
    for count in counts:
        with Cluster(folder, count).running() as cluster:
            if run_tasks(run_job, jobs, Spread(cluster.address)) != here:
                wrong.append(f"{count} workers give other numbers")
    return wrong


# ---- kills


class Kill(NamedTuple):
    """A kill. at: time of the common clock. pids: of the workers that were computing and ended by it."""

    what: str
    at: float
    pids: frozenset[int]


def kill_series(
    folder: Path, kills: int, seed: int, longest_s: float, workers: int = 2
) -> tuple[list[Kill], list[str]]:
    """Kill workers and, every third time, schedulers at random moments while jobs are computed, until there were so
    many kills or so long a time has gone; return the kills, and what happened that may not."""
    log, chance = folder / "kills.log", np.random.default_rng([seed, kills])
    log.touch()
    jobs = decays(log, 12, seed)
    expected = [run_job(job._replace(log=folder / "alone.log")) for job in jobs[:2]]
    done: list[Kill] = []
    received: dict[int, float] = {}
    found: dict[int, str] = {}
    until, due = time.monotonic() + longest_s, 1
    with Cluster(folder, workers).running() as cluster:
        spread = Spread(cluster.address, keep=folder / "kept.sqlite")
        while len(done) < kills and time.monotonic() < until:
            for place, bits in each_task(run_job, jobs, spread):
                received.setdefault(place, time.monotonic())
                found[place] = bits
                if len(received) >= due and len(done) < kills and time.monotonic() < until:
                    time.sleep(float(chance.uniform(0.1, 1.1)))  # Dask's client says within 10 ms what is here
                    done.append(_killed(cluster, chance))
                    due = len(received) + int(chance.integers(1, 5))
            jobs = jobs + [job._replace(number=job.number + len(jobs)) for job in decays(log, 12, seed + len(jobs))]
    wrong = begun_in_vain(log.read_text(encoding="utf-8"), received, done)
    if any(found.get(place, bits) != bits for place, bits in enumerate(expected)):
        wrong.append("a job gave other numbers than here")
    return done, wrong


def _killed(cluster: Cluster, chance: np.random.Generator) -> Kill:
    """Kill a worker or, every third time, the scheduler, and begin another."""
    at = time.monotonic()
    if chance.random() < 1 / 3:
        pids = cluster.kill_scheduler()
        cluster.begin()
        return Kill("scheduler", at, pids)
    number = int(chance.integers(cluster.count))
    process = cluster.workers[number]
    process.kill()
    process.wait()
    cluster.begin_worker(number)
    return Kill("worker", at, frozenset({process.pid}))


def begun_in_vain(log: str, received: dict[int, float], kills: Sequence[Kill]) -> list[str]:
    """Return, a sentence each, the jobs that were begun again although no process that held one was killed before its
    result was here. received: when it was, by job."""
    begun: dict[int, list[tuple[float, int]]] = {}
    for line in log.splitlines():
        when, what, job, process = line.split()
        if what == "begun":
            begun.setdefault(int(job), []).append((float(when), int(process)))
    return [
        f"job {number} was begun again though nothing that held it was killed"
        for number, times in begun.items()
        for at, process in times[:-1]
        if not any(process in kill.pids and at <= kill.at < received.get(number, float("inf")) for kill in kills)
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the campaign, print its tables, and return the exit status."""
    parser = campaign_parser("cluster", __doc__, count=50, of="kills")
    parser.add_argument("--workers", type=int, nargs="*", default=[1, 2, 4], help="sizes of the clusters [1 2 4]")
    parser.add_argument("--for-s", type=float, default=150.0, help="kills end after this time, whatever is left [150]")
    given = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that nothing that was begun is left behind
    os.environ.setdefault(CORES, "1")  # as a worker has
    wrong: list[str] = []
    counts = Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        wrong += other_numbers(Path(folder), given.workers, given.seed)
        if given.kills:
            kills, vain = kill_series(Path(folder), given.kills, given.seed, given.for_s)
            counts.update(kill.what for kill in kills)
            wrong += vain
            if len(kills) < given.kills:
                wrong.append(f"only {len(kills)} of {given.kills} kills in {given.for_s:g} s")
    return conclude(given.out, f"kills: {dict(counts)}", counts, wrong)


if __name__ == "__main__":
    # What workers are handed they know by the module's name, not by that of the program.
    from campaigns.cluster import main as named

    sys.exit(named())
